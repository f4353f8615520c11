"""Records whose excitation goes on as samples: the channels parted, what cannot end well refused."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from floquid._checks import input_error
from floquid.core import Channel, ConstantPeriod, Record, channels_named
from floquid.errors import IdentificationError
from floquid.findings import Finding, note, warning
from floquid.inputs import Hold, Samples, samples_of
from floquid.pipeline._settings import Settings
from floquid.pipeline._state import check_states
from floquid.pipeline.preparation import NO_RESPONSE
from floquid.pipeline.with_inputs._state_matrix import refuse_delayed
from floquid.sync import ShaftAngle, shaft_angle

OF = "identify_driven"

TAKEN = (
    *("period", "tach", "azimuth", "channels", "inputs", "hold", "harmonics", "forced", "validate"),
    *("mode_false_alarm", "harmonic_false_alarm", "pulses_per_revolution", "periods_per_revolution"),
    *("states", "form", "system_times"),
)
"""Settings that count where the excitation goes on."""

PERIODIC = 1e-3
"""The share of an input's energy off the harmonics of the period below which it is periodic itself."""

COPY = 1e-8
"""The smallest eigenvalue of the correlations of the inputs below which one is a sum of others."""

FEWEST = 8
"""Periods that records must hold in all."""

STEADY_LINES = 12
"""Harmonics of the period at which a response that repeats with it is looked for."""

BESIDE = (1, 2, 3, 4)
"""Lines on either side of a harmonic by which the level there is judged."""

BLOCK = 256
"""Samples that are summed to lines at once."""

PERIODS_A_LINE = 4.0
"""Periods of the records over the harmonics that are fitted, at least, where all are."""

LOUD = 8.0
"""The amplitude at a harmonic over that beside it from which on it is fitted."""

MOST_PERIODS = 6
"""Periods of a revolution up to which lines of the revolution are looked for where nobody says how many it holds,"""

LONG, PURE = 60, 50.0
"""in records of as many periods, by this amplitude over that beside: few modes that hardly decay are at such a line."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Parted:
    """Samples of records with inputs, and their channels.

    Parameters
    ----------
    records
        The records as used.
    samples
        Outputs and inputs, one record after another.
    outputs, inputs
        The channels of each.
    turns
        Harmonics of the period that are fitted beside the modes, those of the revolution among them (turns,).
    shafts
        The angle of the shaft in each record; none where the period is constant.
    periods_per_revolution
        Periods of a revolution, as the clock of the record has them, or the settings.
    findings
        What is said of these harmonics.
    """

    records: tuple[Record, ...]
    samples: Samples
    outputs: tuple[Channel, ...]
    inputs: tuple[Channel, ...]
    turns: tuple[float, ...]
    shafts: tuple[ShaftAngle, ...]
    periods_per_revolution: float
    findings: tuple[Finding, ...]


def refuse_others(settings: Settings, of: str, *also: str) -> None:
    """Refuse options that do not count where the excitation goes on, `TAKEN` and others do, and delayed states.

    Raises
    ------
    InputError
        There is such an option.
    """
    usual = Settings()
    for name in (field.name for field in fields(Settings) if field.name not in (*TAKEN, *also)):
        if getattr(settings, name) != getattr(usual, name):
            must, got = "be left as it is where the excitation goes on", f"is {getattr(settings, name)!r:.60}"
            raise input_error(name, of, must, got, f"What counts here: {', '.join(sorted(TAKEN))}.")
    refuse_delayed(settings.form, of)


def parted(records: Sequence[Record], settings: Settings, of: str = OF) -> Parted:
    """The samples of records whose excitation goes on, with what measures it.

    Raises
    ------
    InputError
        The records, the inputs or the clock are not possible.
    IdentificationError
        The inputs say nothing of the system, or the records are too short.
    """
    rates = {record.sample_rate for record in records}
    if len(rates) > 1:
        raise input_error("records", of, "have one rate", f"have {sorted(rates)}", "Resample them.")
    for record in records:
        channels_named(record.channels, settings.inputs, argument="inputs", of=of)
        if np.isnan(record.values).any():
            must, remedy = "miss no sample", "Cut the record at the gap, into two records."
            raise input_error("records", of, must, f"miss {int(np.isnan(record.values).sum())}", remedy)
    period, times, shafts = _turned(records, of)
    channels = {channel.name: channel for channel in records[0].channels}
    clocks = {settings.tach, settings.azimuth}
    wanted = settings.channels or [
        name for name, own in channels.items() if own.quantity not in NO_RESPONSE and name not in clocks
    ]
    outputs = [name for name in channels if name in wanted and name not in settings.inputs]
    if not outputs:
        must = "leave a channel that is an output"
        remedy = "Name the channels that drive the system alone; forces that are responses are named by `channels`."
        raise input_error("inputs", of, must, "leaves none but forces and clocks, or none at all", remedy)
    names = list(channels)
    check_states([channels[name] for name in outputs], settings)
    rows, driven = [names.index(name) for name in outputs], [names.index(name) for name in settings.inputs]
    inputs, values = [record.values[driven] for record in records], [record.values[rows] for record in records]
    for name, row in zip(outputs, rows, strict=True):
        if all(np.ptp(record.values[row]) == 0.0 for record in records):
            raise IdentificationError(
                f"Channel {name!r} never changes: nothing can be learned from it. Leave it out: `channels=`."
            )
    rate = records[0].sample_rate
    periods = sum(record.n_samples for record in records) / (rate * period)
    if periods < FEWEST:
        raise IdentificationError(
            f"The records hold {periods:.3g} periods, fewer than {FEWEST}: too few for a periodic system whose "
            "excitation goes on."
        )
    if driven:
        _refuse(inputs, rate, period)
    given = shafts[0].periods_per_revolution if shafts else settings.periods_per_revolution
    turns, findings = _beside(_Lines(values, inputs, times, rate, period), given, settings)
    hold: Hold = settings.hold
    samples = samples_of(
        values, inputs, times, step=1.0 / rate, fundamental=2.0 * np.pi / period, hold=hold, turns=turns
    )
    return Parted(
        records=tuple(records),
        samples=samples,
        outputs=tuple(channels[name] for name in outputs),
        inputs=tuple(channels[name] for name in settings.inputs),
        turns=turns,
        shafts=shafts,
        periods_per_revolution=given,
        findings=findings,
    )


def _turned(records: Sequence[Record], of: str) -> tuple[float, list[NDArray[np.float64]], tuple[ShaftAngle, ...]]:
    """The mean period of all records, the angle of the system over ω at their samples, and their shafts."""
    constant = [record.clock for record in records if isinstance(record.clock, ConstantPeriod)]
    if any(record.clock is None for record in records) or 0 < len(constant) < len(records):
        must, got = "all have a period, or all a measured clock", "have none, or some of each"
        raise input_error("records", of, must, got, "Give the period, `period=`, or the shaft, `tach=`.")
    ticks = [np.arange(record.n_samples) / record.sample_rate for record in records]
    if constant:
        period = constant[0].period
        if any(own.period != period for own in constant):
            periods = sorted({own.period for own in constant})
            raise input_error("records", of, "have one period", f"have {periods}", "Give the period: `period=`.")
        return period, [own.phase(r.start) * period + t for own, r, t in zip(constant, records, ticks, strict=True)], ()
    shafts = tuple(shaft_angle(record) for record in records)
    angles = [
        shaft.angle(record.start + own) * shaft.periods_per_revolution
        for shaft, record, own in zip(shafts, records, ticks, strict=True)
    ]
    turned = sum(float(own[-1] - own[0]) for own in angles)
    period = 2.0 * np.pi * sum(float(own[-1]) for own in ticks) / turned
    return period, [own * period / (2.0 * np.pi) for own in angles], shafts


def _refuse(inputs: Sequence[NDArray[np.float64]], rate: float, period: float) -> None:
    """Refuse inputs that say nothing: none, copies, periodic ones."""
    whole = np.concatenate(inputs, axis=1)
    centred = whole - whole.mean(axis=1, keepdims=True)
    size = np.sqrt(np.mean(centred**2, axis=1))
    if (size == 0.0).any():
        raise IdentificationError(
            f"Input {int(np.flatnonzero(size == 0.0)[0]) + 1} never changes: nothing can be learned of what it does. "
            "Leave it out of `inputs`."
        )
    if np.linalg.eigvalsh(np.corrcoef(centred).reshape(len(size), -1))[0] < COPY:
        raise IdentificationError(
            "The inputs are copies or sums of one another: what each does cannot be told. Leave one out of `inputs`, "
            "or drive them with signals that are independent."
        )
    off = [_off_harmonics(own, rate, period) for own in inputs]
    if max(off) < PERIODIC:
        raise IdentificationError(
            "The inputs repeat with the period of the system: all of their lines are multiples of its fundamental. The "
            "response then repeats, too, and nothing but that can be learned: modes come from the transient alone. "
            "Drive it with lines between the harmonics, at random, or with blows."
        )


def _off_harmonics(values: NDArray[np.float64], rate: float, period: float) -> float:
    """The share of the energy of the inputs of one record that is off the harmonics of the period."""
    periods = int(values.shape[1] / (rate * period))
    if periods < 3:
        return 1.0
    part = values[:, : round(periods * rate * period)]
    lines = np.abs(np.fft.rfft(part - part.mean(axis=1, keepdims=True), axis=1)) ** 2
    place = np.arange(lines.shape[1]) / periods
    near = np.abs(place - np.rint(place)) * periods <= 2.5
    return float(lines[:, ~near].sum() / max(lines.sum(), np.finfo(float).tiny))


@dataclass(frozen=True, slots=True)
class _Lines:
    """Lines of records at multiples and fractions of the fundamental."""

    outputs: Sequence[NDArray[np.float64]]
    inputs: Sequence[NDArray[np.float64]]
    times: Sequence[NDArray[np.float64]]
    rate: float
    period: float

    def steady(self, periods_of_turn: float) -> tuple[float, ...]:
        """Harmonics of a response that repeats with the period or the revolution: an orbit, gravity, an imbalance.

        Where one stands far above what is beside it all are fitted, as far as the records are long enough: a smaller
        one that is left out would be taken for a mode that never decays.
        """
        turns = self._up_to_highest(periods_of_turn)
        loud = turns[self._above(turns, self.outputs) > LOUD]
        periods = sum(own.shape[1] for own in self.outputs) / (self.rate * self.period)
        return tuple((turns if len(loud) and periods > PERIODS_A_LINE * len(turns) else loud).tolist())

    def periods_of_turn(self) -> int:
        """Periods of the revolution whose lines the outputs have between the harmonics, and no input has."""
        each = {}
        for count in range(2, MOST_PERIODS + 1):
            turns = self._up_to_highest(count)
            each[count] = turns[np.gcd(np.rint(turns * count).astype(np.int64), count) == 1]
        turns = np.concatenate(list(each.values()))
        counts = np.repeat(list(each), [len(own) for own in each.values()])
        pure = self._above(turns, self.outputs, LONG) > PURE
        if not pure.any():
            return 1
        driven = self._above(turns, self.inputs) > LOUD
        found = 1
        for count in each:
            if pure[counts == count].any() and not driven[counts == count].any():
                both = math.lcm(found, count)
                found = both if both <= MOST_PERIODS else found  # lines of 1/4 and 1/5 are no revolution of 20 periods
        return found

    def _up_to_highest(self, periods_of_turn: float) -> NDArray[np.float64]:
        """The harmonics of the period and of the revolution that are looked at, over the fundamental (harmonics,)."""
        highest = min(STEADY_LINES, int(0.5 * self.rate * self.period - 1e-6))
        fractions = np.arange(1, int(highest * periods_of_turn) + 1) / periods_of_turn
        return np.union1d(np.arange(1.0, highest + 1.0), fractions)

    def _above(
        self, harmonics: NDArray[np.float64], values: Sequence[NDArray[np.float64]], periods: float = 0.0
    ) -> NDArray[np.float64]:
        """Lines over those beside, the most of all channels in records of so many periods or more (harmonics,)."""
        each = [
            _above_beside(own, times, self.period, harmonics)
            for own, times in zip(values, self.times, strict=True)
            if times[-1] - times[0] > (periods - 1.0) * self.period
        ]
        return np.max(np.concatenate([np.zeros((1, len(harmonics))), *each]), axis=0)


def _above_beside(
    values: NDArray[np.float64], times: NDArray[np.float64], period: float, harmonics: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The amplitudes of lines at harmonics over the rms of those beside each (channels, harmonics).

    Phases are products of those at whole harmonics and at fractions, and lines beside are sums with cosines and sines
    that go with the values: 2(|C|² + |S|²) = |C - iS|² + |C + iS|².
    """
    fundamental = 2.0 * np.pi / period
    slow = 2.0 * np.pi * np.array(BESIDE) / (times[-1] - times[0])
    whole, i = np.unique(np.floor(harmonics), return_inverse=True)
    fractions, j = np.unique(np.round(harmonics - np.floor(harmonics), 12), return_inverse=True)
    values = values - values.mean(axis=1, keepdims=True)
    room = np.empty((len(whole), len(fractions), BLOCK), np.complex128)
    sums = np.zeros((len(values) * (1 + 2 * len(slow)), 2 * len(whole) * len(fractions)))
    for first in range(0, len(times), BLOCK):
        own = times[first : first + BLOCK]
        coarse, fine = (np.exp(-1j * fundamental * np.multiply.outer(one, own)) for one in (whole, fractions))
        turned = np.multiply(coarse[:, None], fine, out=room[..., : len(own)]).reshape(-1, len(own))
        angles = np.multiply.outer(slow, own)
        beside = np.concatenate([np.ones((1, len(own))), np.cos(angles), np.sin(angles)])
        weighted = (values[:, None, first : first + BLOCK] * beside).reshape(-1, len(own))
        sums += weighted @ np.concatenate([turned.real, turned.imag]).T
    shape = (len(values), 1 + 2 * len(slow), 2, len(whole) * len(fractions))
    squares = np.sum(sums.reshape(shape) ** 2, axis=2)[..., i * len(fractions) + j]
    return np.sqrt(squares[:, 0] / np.maximum(squares[:, 1:].sum(axis=1) / len(slow), np.finfo(float).tiny))


def _beside(lines: _Lines, given: float, settings: Settings) -> tuple[tuple[float, ...], tuple[Finding, ...]]:
    """The harmonics of the period that are fitted beside the modes, and what is said of them.

    `given` are the periods of a revolution as far as they were said.
    """
    asked, told = settings.forced_harmonics, ()
    if not isinstance(asked, str):
        turns = tuple(harmonic / given for harmonic in asked)
    elif asked == "none":
        turns = ()
    else:
        own = lines.periods_of_turn() if given == 1.0 else given
        turns, told = lines.steady(own), () if own == given else (warning("lines_between", periods=own),)
    return turns, (*([note("steady_beside_inputs", harmonics=turns)] if turns else []), *told)
