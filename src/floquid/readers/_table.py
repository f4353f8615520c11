"""What every format is read into before its time axis is settled, and how a message names the file."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from floquid._checks import input_error
from floquid.core import Channel, ConstantPeriod, Record, channels_named
from floquid.core._given import Content
from floquid.errors import InputError


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """A file being read by the public callable named `of`."""

    path: Path
    of: str

    def error(self, must: str, got: str, remedy: str = "") -> InputError:
        """The message «Argument `path` of `read` must …, but run.csv …»."""
        return input_error("path", self.of, must, f"{self.path} {got}", remedy)

    def wrapped(self, error: InputError) -> InputError:
        """An error of a type that knows no file, with the file named before it."""
        return self.error("hold a valid record", f"does not: {error}".removesuffix("."))


Table: TypeAlias = Content
"""The content of a file, as it says it."""


def make_channels(
    source: Source,
    names: Sequence[str],
    units: Sequence[str] | None = None,
    **words: Sequence[str] | None,
) -> tuple[Channel, ...]:
    """Channels of distinct names; `words` are `quantity`, `location`, `direction`, one a channel or None.

    Raises
    ------
    InputError
        A name is empty or given twice, or a unit and a quantity contradict each other.
    """
    given = {key: values for key, values in {"unit": units, **words}.items() if values is not None}
    try:
        channels = tuple(
            Channel(name=name, **{key: values[row] for key, values in given.items()})  # type: ignore[arg-type]
            for row, name in enumerate(names)
        )
    except InputError as error:
        raise source.wrapped(error) from None
    check_distinct(source, [channel.name for channel in channels])
    return channels


def rows_of(source: Source, named: Sequence[Channel], channels: Sequence[str] | None) -> list[int]:
    """Which of the channels that a file has are asked for by name, in that order; None asks for all.

    Raises
    ------
    InputError
        One is not there, or is asked for twice.
    """
    if channels is None:
        return list(range(len(named)))
    return channels_named(named, channels, argument="channels", of=source.of)


def texts_of(record: Record) -> dict[str, list[str]]:
    """What the channels of `record` are called and where they are, one text a channel, by the names in our files."""
    channels = record.channels
    places = {"locations": [c.location for c in channels], "directions": [c.direction for c in channels]}
    return {
        "channels": [channel.name for channel in channels],
        "units": [channel.unit for channel in channels],
        "quantities": [str(channel.quantity) for channel in channels],
        **{key: texts for key, texts in places.items() if any(texts)},
    }


def numbers_of(record: Record) -> dict[str, float]:
    """The rate of `record` [Hz], its start and its clock [s], by the names in our files."""
    numbers = {"sample_rate": record.sample_rate, "start": record.start}
    if isinstance(record.clock, ConstantPeriod):
        numbers |= {"period": record.clock.period, "origin": record.clock.origin}
    return numbers


def orbit_of(record: Record) -> dict[str, NDArray[np.float64]]:
    """The orbit of `record`, by its name in our files; empty where there is none."""
    return {} if record.orbit is None else {"orbit": record.orbit}


def checked_orbit(source: Source, array: NDArray[np.float64], n_channels: int) -> NDArray[np.float64]:
    """An orbit as a file has it (channels, phases).

    Raises
    ------
    InputError
        Its shape is not possible, or it is not finite.
    """
    if array.ndim != 2 or array.shape[0] != n_channels or not array.shape[1] or not np.isfinite(array).all():
        raise source.error(
            f"have `orbit` of shape (channels, phases) with {n_channels} channels, all finite",
            f"has shape {array.shape} there" + ("" if np.isfinite(array).all() else ", not all of it finite"),
            "Save one period of the orbit a channel, or leave it out.",
        )
    return np.asarray(array, np.float64)


def check_distinct(source: Source, names: Iterable[str]) -> None:
    """Refuse two channels of one name.

    Raises
    ------
    InputError
        A name is there twice.
    """
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise source.error("name each channel once", f"has {name!r} twice", "Rename one of them in the file.")
        seen.add(name)


def refuse_blurred_times(record: Record) -> None:
    """Refuse to write times of which neighbours are one number.

    Raises
    ------
    InputError
        The record starts so late that its times cannot be told apart.
    """
    if np.spacing(np.abs(record.times).max()) * record.sample_rate > 0.01:
        raise input_error(
            "record",
            "write",
            "have times that a table of numbers can tell apart",
            f"starts at {record.start:.6g} s with steps of {1.0 / record.sample_rate:.3g} s",
            "Write it as .npz, or count its time from a nearer start.",
        )
