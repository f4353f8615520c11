"""A measured record: channels sampled together at one rate."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Floats, Mask
from floquid._checks import Rebuilt, answers_slips, describe, finite, frozen_array, input_error, positive, wrong_value
from floquid._show import Brief
from floquid.core._channel import Channel, channels_named
from floquid.core._clock import CLOCKS, Clock


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance(Brief):
    """The history of a record or a result.

    Parameters
    ----------
    sources
        Where the data came from: file names, or the words of a simulation.
    steps
        What was done since, one sentence a step, in order.
    """

    sources: tuple[str, ...] = ()
    steps: tuple[str, ...] = ()

    def then(self, *steps: str) -> Provenance:
        """History with `steps` added at its end."""
        return replace(self, steps=self.steps + steps)

    @staticmethod
    def merge(parts: tuple[Provenance, ...]) -> Provenance:
        """One history of `parts`: every source, and each distinct step once, in order of first mention."""
        sources = dict.fromkeys(source for part in parts for source in part.sources)
        steps = dict.fromkeys(step for part in parts for step in part.steps)
        return Provenance(sources=tuple(sources), steps=tuple(steps))


_EXAMPLE = 'Pass a mapping, as {"speed_rpm": 742.0}.'


def names_quantity(name: object) -> bool:
    """True where a name is a printable word without a slash or an equals sign, which files and the command line use."""
    return isinstance(name, str) and name.strip(" .") != "" and name.isprintable() and not {"/", "="} & set(name)


def as_point(point: Mapping[str, float] | None, of: str) -> Mapping[str, float]:
    """The numbers of a `point` by their names, read-only; empty of None. InputError, by `of`, where it has others."""
    if point is None:
        return MappingProxyType({})
    if not isinstance(point, Mapping):
        raise wrong_value("point", of, "hold numbers by name", point, _EXAMPLE)
    for name in point:
        if not names_quantity(name):
            raise input_error("point", of, "have plain words for names", f"has {describe(name)}", _EXAMPLE)
    return MappingProxyType({name: finite(value, f"point[{name!r}]", of) for name, value in point.items()})


def point_of(numbers: Mapping[str, float]) -> dict[str, float]:
    """The `numbers` of a file that an operating point can have: finite ones of plain names."""
    return {name: value for name, value in numbers.items() if isfinite(value) and names_quantity(name)}


def common_point(points: Iterable[Mapping[str, float]]) -> Mapping[str, float]:
    """The mean of each number that all `points` have, by name: records identified together are of one of them."""
    given = list(points)
    shared = [name for name in given[0] if all(name in point for point in given)] if given else []
    return MappingProxyType({name: sum(point[name] for point in given) / len(given) for name in shared})


_SLIPS = {
    **{name: f"values={name}" for name in ("y", "x", "data", "samples", "signal")},
    **{name: f"sample_rate={name}" for name in ("fs", "rate", "samplerate", "sampling_rate")},
    **{name: f"sample_rate=1 / ({name}[1] - {name}[0]), start={name}[0]" for name in ("t", "time", "times")},
    **{name: f"channels={name}" for name in ("names", "labels")},
    **dict.fromkeys(("period", "T"), "clock=ConstantPeriod(period=T)"),
    "dt": "sample_rate=1/dt",
    "units": 'channels=[Channel(name="x", unit="m")]',
}


@answers_slips('Record(values=y, sample_rate=fs, channels=["x", "y"])', _SLIPS)
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Record(Rebuilt):
    """Samples of several channels at a constant rate: sample n is at `start` + n/`sample_rate` [s].

    Raises InputError where a shape, a rate, a name or a value is not possible.

    Parameters
    ----------
    values
        The samples (channels, samples); NaN marks a missing one. Held read-only: a writable array is copied.
    sample_rate
        Samples a second [Hz].
    channels
        One `Channel` a row of `values`, or their names.
    clock
        What ties time to the phase of the system, or None while that is not known.
    start
        The time of the first sample [s].
    orbit
        One period of the periodic orbit that the response was about (channels, phases), from phase zero on; None where
        there is none or it is not known. It is part of `values` until `identify` subtracts it.
    provenance
        Where the record comes from.
    point
        The operating point at which it was measured, finite numbers by name: `{"speed_rpm": 742.0}`. Empty for None.
    """

    values: Floats
    sample_rate: float
    channels: tuple[Channel, ...]
    clock: Clock | None = None
    start: float = 0.0
    orbit: Floats | None = None
    provenance: Provenance = field(default_factory=Provenance)
    point: Mapping[str, float] = field(default_factory=dict)

    def __init__(
        self,
        *,
        values: ArrayLike,
        sample_rate: float,
        channels: Sequence[Channel | str],
        clock: Clock | None = None,
        start: float = 0.0,
        orbit: ArrayLike | None = None,
        provenance: Provenance | None = None,
        point: Mapping[str, float] | None = None,
    ) -> None:
        named = as_channels(channels, "Record")
        flat = isinstance(values, np.ndarray) and values.ndim == 1
        array = frozen_array(
            values,
            "values",
            "Record",
            axes=("channels", "samples"),
            missing=True,
            remedy="One row a channel, also when there is only one: pass `values[None, :]`." if flat else "",
        )
        if array.shape[0] != len(named):
            raise input_error(
                "values",
                "Record",
                f"have shape (channels, samples) with {len(named)} channels",
                f"has shape {array.shape}",
                "Time is the last axis: pass `values.T`."
                if array.shape[1] == len(named)
                else "Name every row of `values` in `channels`.",
            )
        if array.shape[1] == 0:
            raise input_error("values", "Record", "hold at least one sample", f"has shape {array.shape}")
        if clock is not None and not isinstance(clock, CLOCKS):
            must = f"be a {', '.join(kind.__name__ for kind in CLOCKS)} or None"
            raise wrong_value("clock", "Record", must, clock, "Pass ConstantPeriod(period=...).")
        put = object.__setattr__
        put(self, "values", array)
        put(self, "sample_rate", positive(sample_rate, "sample_rate", "Record", unit="Hz"))
        put(self, "channels", named)
        put(self, "clock", clock)
        put(self, "start", finite(start, "start", "Record", unit="s"))
        if orbit is not None:
            orbit = frozen_array(orbit, "orbit", "Record", axes=(len(named), "phases"))
            if orbit.shape[1] == 0:
                raise input_error("orbit", "Record", "have at least one phase", "has none", "Pass None for no orbit.")
        put(self, "orbit", orbit)
        put(self, "provenance", provenance if provenance is not None else Provenance())
        put(self, "point", as_point(point, "Record"))

    def __repr__(self) -> str:
        names = ", ".join([channel.name[:20] for channel in self.channels[:4]] + ["…"] * (self.n_channels > 4))
        size = f"{self.n_channels} channels: {names}" if self.n_channels > 1 else names
        return f"Record({size}; {self.n_samples} samples at {self.sample_rate:.8g} Hz; {self.clock!r:.80})"

    @property
    def n_channels(self) -> int:
        """The number of channels."""
        return self.values.shape[0]

    @property
    def n_samples(self) -> int:
        """The number of samples of each channel."""
        return self.values.shape[1]

    @property
    def duration(self) -> float:
        """Samples over rate [s]."""
        return self.n_samples / self.sample_rate

    @property
    def times(self) -> Floats:
        """The time of each sample (samples,) [s]."""
        return self.start + np.arange(self.n_samples) / self.sample_rate

    @property
    def period(self) -> float | None:
        """The period that the clock states [s]; None where it states none."""
        return None if self.clock is None else self.clock.period

    @property
    def origin(self) -> float:
        """The time of phase zero that the clock states [s]; 0 where it states none."""
        return 0.0 if self.clock is None else self.clock.origin

    @property
    def clock_channel(self) -> str | None:
        """The name of the channel that carries the clock; None where none does."""
        return None if self.clock is None else self.clock.channel

    def select(self, names: Sequence[str]) -> Record:
        """The record of the channels called `names`, in that order.

        Raises InputError where a name is unknown or given twice.
        """
        rows = channels_named(self.channels, names, argument="names", of="Record.select")
        values = self.values[rows]
        values.flags.writeable = False
        orbit = None if self.orbit is None else self.orbit[rows]
        return replace(self, values=values, channels=tuple(self.channels[row] for row in rows), orbit=orbit)

    def with_clock(self, clock: Clock) -> Record:
        """Record tied to `clock`."""
        return replace(self, clock=clock)

    def with_point(self, point: Mapping[str, float]) -> Record:
        """Record whose operating point has these numbers, `point`, beside those that it had."""
        return replace(self, point={**self.point, **as_point(point, "Record.with_point")})


def as_channels(channels: Sequence[Channel | str], of: str) -> tuple[Channel, ...]:
    """Channels, or names of channels, as a tuple of channels with distinct names; InputError where they are not."""
    if isinstance(channels, str) or not all(isinstance(c, (Channel, str)) for c in channels) or not len(channels):
        raise wrong_value("channels", of, "be a list of Channel or of names, at least one", channels)
    named = tuple(c if isinstance(c, Channel) else Channel(name=str(c)) for c in channels)
    names = [c.name for c in named]
    doubled = [name for name in dict.fromkeys(names) if names.count(name) > 1]
    if doubled:
        raise input_error("channels", of, "have distinct names", f"has {doubled[0]!r} twice", "Rename one of them.")
    return named


BRIDGED = 0.2  # periods over which missing samples are filled for the start: a cubic follows no harmonic for longer


def runs_of(mask: Mask) -> list[tuple[int, int]]:
    """First and one past the last index of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def longest_run(mask: Mask) -> tuple[int, int]:
    """The first of the longest runs of True; (0, 0) where there is none."""
    return max(runs_of(mask), key=lambda run: run[1] - run[0], default=(0, 0))


def over_gaps(values: Floats, missing: Mask) -> Floats:
    """Values with the missing ones from the cubic through two samples on either side (rows, samples)."""
    there, gaps = np.flatnonzero(~missing), np.flatnonzero(missing)
    if not len(gaps) or not len(there):
        return values
    whole = np.array([np.interp(np.arange(len(missing)), there, own[there]) for own in values])
    gaps = gaps[(gaps > there[0]) & (gaps < there[-1])]
    if len(there) < 4 or not len(gaps):
        return whole
    nodes = there[np.clip(np.searchsorted(there, gaps) - 2, 0, len(there) - 4)[:, None] + np.arange(4)]
    weights = np.ones(nodes.shape)
    for k in range(4):
        for j in range(4):
            if j != k:
                weights[:, k] *= (gaps - nodes[:, j]) / (nodes[:, k] - nodes[:, j])
    whole[:, gaps] = np.sum(weights * values[:, nodes], axis=2)
    return whole


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cycles(Rebuilt):
    """Samples at P equally spaced phases of each of N periods.

    Raises InputError where a shape or a value is not possible.

    Parameters
    ----------
    values
        The samples (channels, phases, cycles). Held read-only.
    periods
        The length of each cycle (cycles,) [s].
    first_phase, first_cycle
        The phase of `values[:, 0, :]`, in periods, in [0, 1), and the whole periods before it since phase zero.
    channels, provenance
        One `Channel` a row of `values`, and where the cycles come from.
    """

    values: Floats
    periods: Floats
    first_phase: float = 0.0
    channels: tuple[Channel, ...]
    provenance: Provenance = field(default_factory=Provenance)
    first_cycle: int = 0

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "channels", as_channels(self.channels, "Cycles"))
        put(self, "provenance", self.provenance or Provenance())
        self._freeze(missing=True, values=(len(self.channels), "phases", "cycles"))
        self._freeze(periods=(self.n_cycles,))
        if self.values.size == 0:
            got = f"has shape {self.values.shape}"
            raise input_error("values", "Cycles", "hold at least one phase and one cycle", got)
        if not (self.periods > 0).all():
            raise input_error("periods", "Cycles", "be positive [s]", f"has {self.periods.min():g}")
        put(self, "first_phase", finite(self.first_phase, "first_phase", "Cycles"))
        if not 0.0 <= self.first_phase < 1.0:
            raise input_error("first_phase", "Cycles", "lie in [0, 1), in periods", f"is {self.first_phase:g}")

    @property
    def n_channels(self) -> int:
        """The number of channels."""
        return self.values.shape[0]

    @property
    def n_phases(self) -> int:
        """The number of samples a period, P."""
        return self.values.shape[1]

    @property
    def n_cycles(self) -> int:
        """The number of periods, N."""
        return self.values.shape[2]

    @property
    def period(self) -> float:
        """The mean period [s]."""
        return float(self.periods.mean())
