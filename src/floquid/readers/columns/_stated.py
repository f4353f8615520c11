"""What floquid writes into a file of a foreign format beside the samples: one line of JSON that other programs skip.

Most formats cannot say everything that a record says: an exact rate, a period, a quantity. The line has it:

    {"sample_rate": 2533.333333333334, "start": -0.25, "period": 0.0157, "origin": 0.001,
     "channels": [["tip x", "displacement", "m", "disc", "+x"], ...], "orbit": [[...], ...]}
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from floquid.core import Channel, ConstantPeriod, Quantity, Record
from floquid.io import Source

RECORD_LINE = "# floquid record: "
"""What the line begins with in a text file."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stated:
    """What our own line states, None for what it does not; all of it is possible but for a rate or period of any sign.

    `orbit` is (channels, phases).
    """

    sample_rate: float | None = None
    start: float | None = None
    period: float | None = None
    origin: float | None = None
    channels: tuple[Channel, ...] = ()
    orbit: NDArray[np.float64] | None = None

    def of(self, channels: Sequence[Channel]) -> dict[str, Any]:
        """The fields of a table of `channels` that do not depend on the samples."""
        known = self.orbit is not None and all(channel in self.channels for channel in channels)
        rows = [self.channels.index(channel) for channel in channels] if known else []
        orbit = self.orbit[rows] if known and self.orbit is not None else None
        return {"channels": tuple(channels), "period": self.period, "origin": self.origin, "orbit": orbit}


class DamagedLineError(ValueError):
    """The line is there and is not as floquid wrote it."""


def stated_text(record: Record, *, ascii_only: bool = True) -> str:
    """The line of JSON for `record`."""
    said: dict[str, Any] = {"sample_rate": record.sample_rate, "start": record.start}
    if isinstance(record.clock, ConstantPeriod):
        said |= {"period": record.clock.period, "origin": record.clock.origin}
    said["channels"] = [[c.name, c.quantity, c.unit, c.location, c.direction] for c in record.channels]
    if record.orbit is not None:
        said["orbit"] = record.orbit.tolist()
    return json.dumps(said, ensure_ascii=ascii_only)


def parse_stated(text: str | bytes) -> Stated:
    """What a line of JSON states.

    Raises
    ------
    DamagedLineError
        It is not as floquid writes it.
    """
    try:
        said = json.loads(text)
        rate, start, period, origin = (
            _number_or_none(said.get(key)) for key in ("sample_rate", "start", "period", "origin")
        )
        if period is not None and period > 0.0:
            ConstantPeriod(period=period, origin=origin or 0.0)
        channels = tuple(_channel(*words) for words in said.get("channels", []))
        orbit = said.get("orbit")
        return Stated(
            sample_rate=rate,
            start=start,
            period=period,
            origin=origin,
            channels=channels,
            orbit=None if orbit is None else _orbit(orbit, len(channels)),
        )
    except (ValueError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        raise DamagedLineError(str(error)) from None


def stated_in(source: Source, text: str | bytes | None, place: str, remedy: str) -> Stated:
    """What our own line at `place` of a file states; nothing where there is none.

    Raises
    ------
    InputError
        It is there and is not as we write it.
    """
    try:
        return Stated() if text is None else parse_stated(text)
    except DamagedLineError:
        raise source.error(f"have {place} as floquid wrote it", "has another", remedy) from None


def stated_line(source: Source, lines: Sequence[str]) -> Stated:
    """What our own line among those of a text states; nothing where there is none.

    Raises
    ------
    InputError
        It is there and is not as we write it.
    """
    text = next((line.removeprefix(RECORD_LINE) for line in lines if line.startswith(RECORD_LINE)), None)
    remedy = "Delete that line: the table can be read without it."
    return stated_in(source, text, f"the line `{RECORD_LINE.strip()}`", remedy)


def _number_or_none(value: object) -> float | None:
    if isinstance(value, bool) or not isinstance(value, (int, float, type(None))):
        raise TypeError(value)
    if value is not None and not np.isfinite(float(value)):
        raise ValueError(value)
    return None if value is None else float(value)


def _channel(name: str, quantity: Quantity, unit: str, location: str, direction: str) -> Channel:
    if quantity not in get_args(Quantity):
        raise ValueError(quantity)
    return Channel(name=name, quantity=quantity, unit=unit, location=str(location), direction=str(direction))


def _orbit(rows: object, n_channels: int) -> NDArray[np.float64]:
    array = np.asarray(rows, np.float64)
    if array.ndim != 2 or array.shape[0] != n_channels or not array.shape[1] or not np.isfinite(array).all():
        raise ValueError(array.shape)
    return array
