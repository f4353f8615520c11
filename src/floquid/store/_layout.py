"""What is in a result file of version 1: one `Item` a dataset. `save` and `load` both go by these tables."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import DTypeLike

FORMAT = "floquid-result"
VERSION = 1

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

LIFTED = (
    Item("n_phases", "integer"),
    Item("first_phase", unit="periods"),
    Item("lengths", "integer", ("hits",), unit="periods"),
    Item("noise", axes=("channels", "hits"), unit="that of the channel"),
)

WHITENING = Item("whitening", axes=("channels", "taps"))
"""Of responses that were whitened along the record; absent otherwise."""

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

HELD = Item("held", "integer")
"""1 where the residues were held to their harmonics in the end; absent in older files."""

SYNCHRONISATION = Item("synchronisation", "text", ("sentences",))
"""Absent in older files."""

FIT = (
    Item("noise", axes=("channels", "hits"), unit="that of the channel"),
    Item("period_std", unit="s", optional=True),
)
"""Of records that were fitted as they were sampled; absent otherwise. The records in the file are the free response."""

FORCED = (
    Item("harmonics", "integer", ("harmonics",)),
    Item("coefficients", "complex", ("channels", "hits", "harmonics"), unit="that of the channel"),
    Item("coefficient_std", "complex", ("channels", "hits", "harmonics"), unit="that of the channel"),
    *(Item(name, axes=("channels", "hits"), unit="that of the channel") for name in ("offset", "offset_std")),
    *(Item(name, axes=("channels", "hits"), unit="that of the channel a second") for name in ("drift", "drift_std")),
    Item("revolution", unit="s"),
    Item("speed_dependent", "integer"),
)
"""The forced response beside the free one; absent where there is none."""

STATE = (
    Item("times", axes=("times",), unit="s"),
    Item("transition", axes=("times", "states", "states")),
    Item("system", axes=("times", "states", "states"), unit="1/s in the units of the states"),
    Item("condition", axes=("times",)),
    Item("states", "text", ("states",)),
    Item("system_std", axes=("times", "states", "states"), unit="1/s in the units of the states", optional=True),
)
