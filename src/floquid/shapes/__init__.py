"""Readings of mode shapes: whirl of shafts, patterns over the blades of a rotor with names, shares of lines, sidebands.

`read_shapes` reads all modes of a result or of a known system, and `sidebands_of` says how periodic it is.
`path_shapes` reads those that a scanning sensor saw, over its path.
"""

from floquid.shapes._blades import WORDS, BladePattern, PatternShare, Words
from floquid.shapes._path import PathShapes, path_shapes
from floquid.shapes._read import ModeReading, Participation, ShapeOptions, ShapeReadings, ordinal, read_shapes
from floquid.shapes._shares import APART, CLEAR, Blades, Pairs, Whirl, pairs_of, sense_of
from floquid.shapes._sidebands import PeriodicAmount, Sidebands, sidebands_of

__all__ = [
    "WORDS", "BladePattern", "ModeReading", "Participation", "PathShapes", "PatternShare", "PeriodicAmount",
    "ShapeReadings", "Sidebands", "Whirl", "path_shapes", "read_shapes", "sidebands_of",
]  # fmt: skip
