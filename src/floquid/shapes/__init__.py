"""Readings of mode shapes: whirl of shafts, patterns over the blades of a rotor with names, shares of lines.

`read_shapes` reads all modes of a result or of a known system; `whirl_of` and `pattern_of` one shape each.
"""

from floquid.shapes._arguments import Blades as Blades
from floquid.shapes._arguments import Family as Family
from floquid.shapes._arguments import Pair as Pair
from floquid.shapes._arguments import Pairs as Pairs
from floquid.shapes._arguments import families_of as families_of
from floquid.shapes._arguments import pairs_of as pairs_of
from floquid.shapes._blades import WORDS, BladePattern, PatternShare
from floquid.shapes._blades import Words as Words
from floquid.shapes._blades import pattern_of as pattern_of
from floquid.shapes._read import ModeReading, Participation, ShapeReadings, read_shapes
from floquid.shapes._read import ShapeOptions as ShapeOptions
from floquid.shapes._read import ordinal as ordinal
from floquid.shapes._whirl import CLEAR as CLEAR
from floquid.shapes._whirl import Whirl
from floquid.shapes._whirl import whirl_of as whirl_of

__all__ = [
    "WORDS", "BladePattern", "ModeReading", "Participation", "PatternShare", "ShapeReadings", "Whirl", "read_shapes",
]  # fmt: skip
