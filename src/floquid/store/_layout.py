"""What is in a result file: one `Item` a dataset. `save` and `load` both go by these tables."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import DTypeLike

FORMAT = "floquid-result"
VERSION = 2

Kind = Literal["real", "integer", "complex", "text"]

DTYPES: dict[Kind, DTypeLike] = {"real": np.float64, "integer": np.int64, "complex": np.complex128}


@dataclass(frozen=True, slots=True)
class Item:
    """One dataset: its name is that of the field it holds."""

    name: str
    kind: Kind = "real"
    axes: tuple[str, ...] = ()
    unit: str = ""
    optional: bool = False


SETTINGS_OF_VERSION_1 = (
    "period", "channels", "order", "harmonics", "states", "system_times", "mode_false_alarm", "harmonic_false_alarm",
)  # fmt: skip
"""The fields that every file has; those that `Settings` gains later are written too, and have a default when absent."""

WARNINGS = Item("warnings", "text", ("warnings",))

CHANNELS = tuple(Item(name, "text", ("channels",)) for name in ("name", "quantity", "unit", "location", "direction"))

PROVENANCE = (Item("sources", "text", ("sources",)), Item("steps", "text", ("steps",)))

CLOCK = (Item("period", unit="s", optional=True), Item("origin", unit="s", optional=True))

RECORD = (
    Item("values", axes=("channels", "samples"), unit="that of the channel"),
    Item("sample_rate", unit="Hz"),
    Item("start", unit="s"),
)

KIND = Item("kind", "text")

_SHAFT_TURNS = (Item("periods_per_revolution"),)

SIGNALS = {
    "TachometerSignal": (Item("channel", "text"), Item("pulses_per_revolution", "integer"), *_SHAFT_TURNS),
    "AzimuthSignal": (Item("channel", "text"), *_SHAFT_TURNS),
    "PulseTimes": (Item("times", axes=("pulses",), unit="s"), Item("pulses_per_revolution", "integer"), *_SHAFT_TURNS),
}
"""Of the group `clock` of a record, by its `kind`; absent where the period is constant."""

ORBIT = Item("orbit", axes=("channels", "phases"), unit="that of the channel")
"""Of a record about a periodic orbit that is known; absent otherwise."""

MODAL = (
    Item("multipliers", "complex", ("modes",)),
    Item("residues", "complex", ("modes", "outputs", "inputs"), unit="that of the channel"),
    Item("dt", unit="s"),
    Item("covariance", axes=("2 modes", "2 modes"), unit="1/s^2", optional=True),
    Item("residue_spread", "complex", ("inputs", "modes", "modes"), optional=True),
    Item("residue_slope", "complex", ("inputs", "modes", "modes"), optional=True),
    Item("residual_std", axes=("outputs", "inputs"), unit="that of the channel", optional=True),
)

OUTCOME = Item("outcome", "text")

CHOICE = (Item("reasons", "text", ("reasons",)), Item("doubts", "text", ("doubts",)))
"""Of an order that was found; absent where it was given, and in older files."""

COMPOSITES = (
    Item("angles", axes=("lines",), unit="rad/period"),
    *(Item(name, axes=("lines",)) for name in ("data", "model", "difference")),
)
"""Of algorithms that work with composites; absent otherwise."""

MODEL = (
    Item("exponents", "complex", ("modes",), unit="1/s"),
    Item("coefficients", "complex", ("modes", "channels", "hits", "harmonics"), unit="that of the channel"),
    Item("harmonics", "integer", ("harmonics",)),
    Item("period", unit="s"),
    Item("covariance", axes=("2 modes", "2 modes"), unit="1/s^2", optional=True),
    Item(
        "coefficient_std",
        "complex",
        ("modes", "channels", "hits", "harmonics"),
        unit="that of the channel",
        optional=True,
    ),
)

ESTIMATES = (
    Item("exponents", "complex", ("modes",), unit="1/s"),
    Item("real", "integer", ("modes",)),
    Item("fundamental", unit="rad/s"),
    Item("modes", "integer", ("terms",)),
    Item("harmonics", "integer", ("terms",)),
    Item("coefficients", "complex", ("terms", "channels", "hits"), unit="that of the channel"),
    Item("covariance", axes=("2 modes + 1", "2 modes + 1"), unit="1/s^2"),
    Item("slopes", "complex", ("terms", "channels", "hits", "2 modes + 1"), unit="that of the channel times s"),
    Item("spread", axes=("blocks", "2 terms", "2 terms")),
    Item("blocks", "integer", ("channels", "hits")),
    Item("scales", "complex", ("terms", "channels", "hits"), unit="that of the channel"),
    Item("drift", axes=("blocks", "2 terms", "2 terms"), unit="s", optional=True),
    Item("bend", "complex", ("terms", "channels", "hits"), unit="s", optional=True),
)
"""Of the groups `estimates` and `unselected` of the model; absent where there are none, and in older files."""

SYNCHRONISATION = Item("synchronisation", "text", ("sentences",))
"""Absent in older files."""

FIT = (
    Item("noise", axes=("channels", "hits"), unit="that of the channel"),
    Item("period_std", unit="s", optional=True),
    Item("own_period", axes=("difference and deviation",), optional=True),
    Item("held", "integer"),
    Item("misfit", optional=True),
    Item("whitening", axes=("channels", "taps"), optional=True),
    *CHOICE,
)
"""In version 1 of records fitted as sampled alone; `held` and `misfit` are those of the file there, if it has them."""

SHAFT = (
    Item("periods_per_revolution"),
    *(Item(name, axes=("pulses",), unit=unit) for name, unit in (("times", "s"), ("residuals", "rad"))),
    *(Item(name, "integer", ("pulses",)) for name in ("lines", "kept")),
    Item("jitter", unit="that of jitter_unit"),
    Item("jitter_unit", "text"),
    *(Item(name, axes=("lines",), unit="rad", optional=True) for name in ("geometry", "geometry_std")),
    *(Item(name, "integer") for name in ("n_pulses", "missing", "doubled", "rejected")),
    Item("wander"),
    Item("steady", "integer"),
    Item("reasons", "text", ("reasons",)),
)
"""The angle of the shaft in each record that was measured; absent where the period is constant."""

SPLINE = (
    *(Item(name, unit="s") for name in ("first", "last")),
    Item("slope", unit="rad/s"),
    Item("knots", axes=("knots",)),
    Item("coefficients", axes=("coefficients",), unit="rad"),
    Item("degree", "integer"),
    Item("covariance", axes=("coefficients", "coefficients"), unit="rad^2"),
)
"""Of its group `spline`."""

FORCED = (
    Item("harmonics", "integer", ("harmonics",)),
    Item("coefficients", "complex", ("channels", "hits", "harmonics"), unit="that of the channel"),
    Item("coefficient_std", "complex", ("channels", "hits", "harmonics"), unit="that of the channel", optional=True),
    Item("offset", axes=("channels", "hits"), unit="that of the channel"),
    Item("offset_std", axes=("channels", "hits"), unit="that of the channel", optional=True),
    Item("drift", axes=("channels", "hits"), unit="that of the channel a second"),
    Item("drift_std", axes=("channels", "hits"), unit="that of the channel a second", optional=True),
    Item("revolution", unit="s"),
    Item("speed_dependent", "integer"),
)
"""The forced response beside the free one; absent where there is none."""

VALIDATION = (
    Item("passed", "integer"),
    Item("reasons", "text", ("reasons",)),
    *(Item(name, axes=("channels", "hits")) for name in ("fit", "held_out_error", "colour")),
    Item("turns", axes=("tones",)),
    Item("tones", axes=("channels", "hits", "tones")),
    Item("modes", "integer", ("lines",)),
    Item("harmonics", "integer", ("lines",)),
    Item("lines", axes=("channels", "hits", "lines")),
)
"""The verdict on the model; absent where it was not asked for, and in older files."""

AT_LEAST = Item("at_least", "text", ("criteria",))
"""The names of those limits that are the least allowed."""

PERIODICITY = (
    *(Item(name) for name in ("statistic", "p_value", "level", "power")),
    Item("degrees", "integer"),
    Item("spacing_p", optional=True),
    Item("harmonics", "integer", ("harmonics",)),
    Item("exponents", "complex", ("modes",), unit="1/s"),
    Item("channels", "text", ("channels",)),
    *(Item(name, axes=("modes", "harmonics")) for name in ("sizes", "limits")),
    Item("untested", "integer", ("cases", "mode and harmonic")),
    Item("locked", "integer", ("modes",)),
)
"""Of a model whose periodicity was tested; absent otherwise, and in older files."""

PARTIAL_TESTS = (
    *(Item(name, axes=("parts",)) for name in ("statistics", "p_values", "adjusted")),
    Item("degrees", "integer", ("parts",)),
)
"""Of its groups `by_harmonic`, `by_mode` and `by_channel`."""

STATE = (
    Item("times", axes=("times",), unit="s"),
    Item("transition", axes=("times", "states", "states")),
    Item("system", axes=("times", "states", "states"), unit="1/s in the units of the states"),
    Item("condition", axes=("times",)),
    Item("states", "text", ("states",)),
    Item("system_std", axes=("times", "states", "states"), unit="1/s in the units of the states", optional=True),
)

STATE_LATER = (
    Item("coordinates", "text"),
    Item("transition_std", axes=("times", "states", "states"), optional=True),
)
"""Of the state too; absent in older files."""

REFINEMENT = (
    Item("parameters", axes=("parameters",), unit="1/s to a power, in the units of the states"),
    Item("names", "text", ("parameters",)),
    Item("covariance", axes=("parameters", "parameters")),
    Item("exponents", "complex", ("modes",), unit="1/s"),
    Item("exponent_std", "complex", ("modes",), unit="1/s"),
    Item("chi_square"),
    Item("degrees", "integer"),
    Item("p_value"),
    Item("reasons", "text", ("reasons",)),
)
"""Of an A(t) that was fitted with a structure; absent otherwise, and in older files. Its state is that of the file."""

STRUCTURE = Item("structure", "text")
"""As `floquid.reconstruction.structure_of` reads it."""
