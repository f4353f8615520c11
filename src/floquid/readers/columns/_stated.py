"""Statement that floquid writes into a table beside the samples: one line of JSON that other programs skip.

A table cannot say everything that a record says: an exact rate, a period, a quantity. The line has it:

    {"sample_rate": 2533.333333333334, "start": -0.25, "period": 0.0157, "origin": 0.001,
     "channels": [["tip x", "displacement", "m", "disc", "+x"], ...], "orbit": [[...], ...]}
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from floquid._arrays import Floats
from floquid.core import Channel, Record
from floquid.io import Source
from floquid.tables import numbers_of

RECORD_LINE = "# floquid record: "  # begin of the line in a text file

_WORDS = ("name", "quantity", "unit", "location", "direction")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stated:
    """Statements of our own line, None for those it has not; `orbit` is (channels, phases)."""

    sample_rate: float | None = None
    start: float | None = None
    period: float | None = None
    origin: float | None = None
    channels: tuple[Channel, ...] = ()
    orbit: Floats | None = None

    def of(self, channels: Sequence[Channel]) -> dict[str, Any]:
        """The fields of a table of `channels` that do not depend on the samples."""
        known = self.orbit is not None and all(channel in self.channels for channel in channels)
        rows = [self.channels.index(channel) for channel in channels] if known else []
        orbit = self.orbit[rows] if known and self.orbit is not None else None
        return {"channels": tuple(channels), "period": self.period, "origin": self.origin, "orbit": orbit}


def stated_text(record: Record, *, ascii_only: bool = True) -> str:
    """The line of JSON for `record`."""
    said: dict[str, Any] = {**numbers_of(record)}
    said["channels"] = [[getattr(channel, word) for word in _WORDS] for channel in record.channels]
    if record.orbit is not None:
        said["orbit"] = record.orbit.tolist()
    return json.dumps(said, ensure_ascii=ascii_only)


def stated_in(source: Source, text: str | bytes | None, place: str, remedy: str) -> Stated:
    """Statements of our own line at `place` of a file; empty where there is none."""
    if text is None:
        return Stated()
    try:
        said = json.loads(text)
        keys = [key for key in ("sample_rate", "start", "period", "origin") if said.get(key) is not None]
        numbers = {key: float(said[key]) for key in keys}
        channels = tuple(Channel(**dict(zip(_WORDS, words, strict=True))) for words in said.get("channels", []))
        orbit = np.array(said["orbit"], np.float64) if "orbit" in said else None
        if not np.isfinite([*numbers.values()]).all() or (orbit is not None and len(orbit) != len(channels)):
            raise ValueError(text)
        return Stated(**numbers, channels=channels, orbit=orbit)
    except (ValueError, TypeError, AttributeError, OverflowError, RecursionError):
        raise source.error(f"have {place} as floquid wrote it", "has another", remedy) from None


def stated_line(source: Source, lines: Sequence[str]) -> Stated:
    """Statements of our own line among those of a text; empty where there is none."""
    text = next((line.removeprefix(RECORD_LINE) for line in lines if line.startswith(RECORD_LINE)), None)
    remedy = "Delete that line: the table can be read without it."
    return stated_in(source, text, f"the line `{RECORD_LINE.strip()}`", remedy)
