"""Records whose excitation goes on as samples: the channels parted, what cannot end well refused."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from floquid._arrays import Floats, Mask
from floquid._checks import input_error, wrong_value
from floquid.checks import Parted
from floquid.core import BRIDGED, Channel, Record, channels_named, over_gaps, runs_of
from floquid.errors import IdentificationError
from floquid.findings import Finding, Severity, note, warning
from floquid.fit import HALF_DIGITS, RARE
from floquid.inputs import Hold, samples_of
from floquid.preparation._before import MOST_ABSENT, NO_RESPONSE, faults_of
from floquid.preparation._clocks import check_states, clocks_of, refuse_no_clock, shafts_of
from floquid.preparation._lines import Lines, Tone, tones_of
from floquid.preparation._refuse import LEAST, NAMED, refuse_period
from floquid.preparation._settings import Settings
from floquid.sync import ShaftAngle, refuse_unlike, tied

OF = "identify"

GOES_ON = {
    "estimate_period": "what drives the system repeats with periods of its own",
    "events": "decays run in periods between events, and what drives a system acts in seconds",
    "find_hits": "a blow that was measured is an input",
    "identifier": "it takes samples a period apart for a free response",
    "constrained": "residues that are free at each phase are those of lifted responses",
}
"""Settings that no record can have whose excitation goes on, each with the reason of mathematics."""

FORBIDDEN: Mapping[str, Mapping[str, str]] = {
    "free": {"hold": "inputs are what is held"},
    "inputs": GOES_ON,
    "ambient": {**GOES_ON, "noise_floor": "innovations are what the excitation adds, and no noise of sensors"},
}
"""Settings that a kind of records cannot have, each with the reason of mathematics."""

WORDS = {
    "free": "of free responses",
    "inputs": "where inputs are measured",
    "ambient": "of outputs alone",
}  # a kind of records in messages

FEWEST = 8
"""Periods that records must hold in all: of fewer no line stands apart from the harmonics of the period."""


def refuse_others(settings: Settings, of: str) -> None:
    """Refuse options that records of a kind cannot have."""
    usual, kind = Settings(), settings.kind
    for name, reason in FORBIDDEN[kind].items():
        if getattr(settings, name) != getattr(usual, name):
            must = f"be left as it is {WORDS[kind]}"
            raise wrong_value(name, of, must, getattr(settings, name), f"{reason[0].upper()}{reason[1:]}.")


def parted(records: Sequence[Record], settings: Settings, of: str = OF) -> Parted:
    """The samples of records whose excitation goes on, with what measures it."""
    if any(record.clock is not None and record.clock.cycles for record in records):
        must, got = "be of free responses where their clocks are events", "are of records whose excitation goes on"
        raise input_error("records", of, must, got, "Give the period, or a tachometer.")
    rates = {record.sample_rate for record in records}
    if len(rates) > 1:
        raise input_error("records", of, "have one rate", f"have {sorted(rates)}", "Resample them.")
    refuse_unlike(records, of)
    refuse_period(records, of)
    for record in records:
        for row in channels_named(record.channels, settings.inputs, argument="inputs", of=of):
            _refuse_gaps(record, row, of)
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
    records, cut = _between_gaps(records, [list(channels).index(name) for name in outputs], settings)
    period, times, shafts = _turned(records, of)
    rows, driven = [names.index(name) for name in outputs], [names.index(name) for name in settings.inputs]
    inputs, values = [record.values[driven] for record in records], [record.values[rows] for record in records]
    whole = _refuse_absent(outputs, values)
    rate = records[0].sample_rate
    if rate * period <= LEAST:
        raise input_error("period", of, f"be more than {LEAST:g} samples", f"is {rate * period:.4g}", "Sample faster.")
    periods = sum(int(own.sum()) for own in whole) / (rate * period)
    if periods < FEWEST:
        raise IdentificationError(
            f"The records hold {periods:.3g} periods, fewer than {FEWEST}: too few for a periodic system whose "
            "excitation goes on."
        )
    if driven:
        _refuse(settings.inputs, inputs, rate, period)
    given = shafts[0].periods_per_revolution if shafts else settings.periods_per_revolution
    filled = [over_gaps(own, ~there) for own, there in zip(values, whole, strict=True)]
    turns, findings = _beside(Lines(filled, inputs, times, rate, period), given, settings)
    tones = [
        tones_of(own, drives, _repeated(angles, turns, period), 1.0 / (rate * period))
        for own, drives, angles in zip(filled, inputs, times, strict=True)
    ]
    hold: Hold = settings.hold
    samples = samples_of(
        values,
        inputs,
        times,
        step=1.0 / rate,
        fundamental=2.0 * np.pi / period,
        hold=hold,
        turns=turns,
        tones=[[tone.frequency * rate for tone in own] for own in tones],
        floor=settings.noise_floor,
    )
    return Parted(
        records=tuple(records),
        samples=samples,
        outputs=tuple(channels[name] for name in outputs),
        inputs=tuple(channels[name] for name in settings.inputs),
        turns=turns,
        shafts=shafts,
        periods_per_revolution=given,
        findings=(
            *cut,
            *_partly_missing(values, whole),
            *_faults(records, outputs, settings),
            *_interference(tones, rate, [channels[name] for name in outputs]),
            *findings,
        ),
    )


def _repeated(times: Floats, turns: Sequence[float], period: float) -> Floats:
    """An offset and the harmonics of a response that repeats (columns, samples)."""
    angles = 2.0 * np.pi / period * np.multiply.outer(np.array(turns), times)
    return np.concatenate([np.ones((1, len(times))), np.cos(angles), np.sin(angles)])


def _interference(tones: Sequence[Sequence[Tone]], rate: float, channels: Sequence[Channel]) -> tuple[Finding, ...]:
    """Notes on the steady tones beside the modes: the frequency of each, and its amplitude where it is largest."""
    notes = []
    for tone in (tone for own in tones for tone in own):
        row = int(np.argmax(tone.amplitudes))
        size, channel = float(tone.amplitudes[row]), channels[row]
        hertz = tone.frequency * rate
        notes.append(note("interference", frequency=hertz, amplitude=size, channel=channel.name, unit=channel.unit))
    return tuple(notes)


def _refuse_gaps(record: Record, row: int, of: str) -> None:
    """Refuse an input with missing samples: what it made of the states from there on is not known."""
    gaps = runs_of(np.isnan(record.values[row]))
    if gaps:
        times = [record.start + first / record.sample_rate for first, _ in gaps]
        number, places = sum(last - first for first, last in gaps), ", ".join(f"{time:.6g}" for time in times[:NAMED])
        got = f"input {record.channels[row].name!r} misses {number}, at {places} s" + (
            " and later" * (len(times) > NAMED)
        )
        remedy = "Cut the record there, into two records."
        raise input_error("records", of, "hold every sample of the inputs", got, remedy)


def _between_gaps(
    records: Sequence[Record], rows: Sequence[int], settings: Settings
) -> tuple[Sequence[Record], tuple[Finding, ...]]:
    """Records of the stretches between gaps that are too long to be bridged, where nobody measured what drives."""
    # After such a gap the state is known no better than its variance, and errors of its prediction are no innovations
    # for as long as it takes to tell it: a first state of its own is exact.
    if settings.kind != "ambient" or settings.tach or settings.azimuth:
        return records, ()
    pieces: list[Record] = []
    for record in records:
        there = np.all(np.isfinite(record.values[rows]), axis=0, keepdims=True)[0]
        period = tied(record).period * record.sample_rate
        own: list[tuple[int, int]] = []
        for first, last in runs_of(there):
            near = bool(own) and first - own[-1][1] <= BRIDGED * period
            own = [*own[:-1], (own[-1][0], last)] if near else [*own, (first, last)]
        pieces += [record] if len(own) < 2 else _parts(record, [part for part in own if part[1] - part[0] >= period])
    if not pieces or (len(pieces) == len(records) and all(a is b for a, b in zip(pieces, records, strict=True))):
        return records, ()
    return tuple(pieces), (note("cut_at_gaps", periods=BRIDGED, parts=len(pieces)),)


def _parts(record: Record, places: Sequence[tuple[int, int]]) -> list[Record]:
    """Parts of a record as records of their own, from first samples to before the last ones."""
    found = []
    for first, last in places:
        values = record.values[:, first:last]
        values.flags.writeable = False
        found.append(replace(record, values=values, start=record.start + first / record.sample_rate))
    return found


def _refuse_absent(outputs: Sequence[str], values: Sequence[Floats]) -> list[Mask]:
    """Masks of the samples of each record at which all outputs are there; outputs that tell nothing are refused."""
    joined = np.concatenate(values, axis=1)
    missing = np.isnan(joined)
    for name, own, absent in zip(outputs, joined, missing, strict=True):
        if absent.mean() > MOST_ABSENT:
            raise IdentificationError(
                f"Channel {name!r} misses {100.0 * absent.mean():.3g} % of its samples, at which other channels "
                f"would not count: {100.0 * MOST_ABSENT:g} % may be missing. Leave it out (`channels=`), or cut "
                "the record."
            )
        if np.ptp(own[~absent]) == 0.0:
            raise IdentificationError(
                f"Channel {name!r} never changes: nothing can be learned from it. Leave it out: `channels=`."
            )
    return [~np.any(np.isnan(own), axis=0, keepdims=True)[0] for own in values]


def _partly_missing(values: Sequence[Floats], whole: Sequence[Mask]) -> tuple[Finding, ...]:
    """Note samples that count for no channel, since some channel misses them."""
    partly = sum(int(np.sum(~there & ~np.isnan(own).all(axis=0))) for own, there in zip(values, whole, strict=True))
    return (note("partly_missing", samples=partly),) if partly else ()


def _faults(records: Sequence[Record], outputs: Sequence[str], settings: Settings) -> tuple[Finding, ...]:
    """Findings on samples that are none: an output that is clipped fails, since what is left of it is not linear."""
    return tuple(
        replace(own, severity=Severity.FAILURE) if own.code == "clipped" and own.numbers["channel"] in outputs else own
        for own in faults_of(tuple(records), repair=settings.repair)
    )


def _turned(records: Sequence[Record], of: str) -> tuple[float, list[Floats], tuple[ShaftAngle, ...]]:
    """The mean period of all records, the angle of the system over ω at their samples, and their shafts."""
    refuse_no_clock(records, of)
    shafts = shafts_of(records, lambda _: None, of)
    ticks = [np.arange(record.n_samples) / record.sample_rate for record in records]
    if not shafts:
        clocks = clocks_of(records, ())
        periods = sorted({own.period for own in clocks})
        if len(periods) > 1:
            raise input_error("records", of, "have one period", f"have {periods}", "Give the period: `period=`.")
        starts = zip(clocks, records, ticks, strict=True)
        return periods[0], [own.since_phase_zero(r.start, t)[0] for own, r, t in starts], ()
    angles = [
        shaft.angle(record.start + own) * shaft.periods_per_revolution
        for shaft, record, own in zip(shafts, records, ticks, strict=True)
    ]
    turned = sum(float(own[-1] - own[0]) for own in angles)
    period = 2.0 * np.pi * sum(float(own[-1]) for own in ticks) / turned
    return period, [own * period / (2.0 * np.pi) for own in angles], shafts


def _refuse(names: Sequence[str], inputs: Sequence[Floats], rate: float, period: float) -> None:
    """Refuse inputs that say nothing: none, copies, periodic ones."""
    whole = np.concatenate(inputs, axis=1)
    centred = whole - whole.mean(axis=1, keepdims=True)
    size = np.sqrt(np.mean(centred**2, axis=1))
    if (size == 0.0).any():
        raise IdentificationError(
            f"Input {int(np.flatnonzero(size == 0.0)[0]) + 1} never changes: nothing can be learned of what it does. "
            "Leave it out of `inputs`."
        )
    if np.linalg.eigvalsh(np.corrcoef(centred).reshape(len(size), -1))[0] < HALF_DIGITS:
        raise IdentificationError(
            "The inputs are copies or sums of one another: their effects cannot be separated. Leave one out of "
            "`inputs`, or drive them with signals that are independent."
        )
    for name, rows in zip(names, zip(*inputs, strict=True), strict=True):
        if max(_off_harmonics(row[None], rate, period) for row in rows) < RARE:
            raise IdentificationError(
                f"Input {name!r} repeats with the period of the system: all of its lines are multiples of its "
                "fundamental. So does the response to it, which shows no modes. Leave it out of `inputs`, or drive "
                "with lines between the harmonics, at random, or with blows."
            )


def _off_harmonics(values: Floats, rate: float, period: float) -> float:
    """The share of the energy of the inputs of one record that is off the harmonics of the period."""
    periods = int(values.shape[1] / (rate * period))
    if periods < 3:
        return 1.0
    part = values[:, : round(periods * rate * period)]
    lines = np.abs(np.fft.rfft(part - part.mean(axis=1, keepdims=True), axis=1)) ** 2
    place = np.arange(lines.shape[1]) / periods
    near = np.rint(np.abs(place - np.rint(place)) * periods) <= 2  # lines on either side: those of a window
    return float(lines[:, ~near].sum() / max(lines.sum(), np.finfo(float).tiny))


def _beside(lines: Lines, given: float, settings: Settings) -> tuple[tuple[float, ...], tuple[Finding, ...]]:
    """The harmonics of the period that are fitted beside the modes, and what is said of them."""
    asked, told = settings.forced_harmonics, ()
    if not isinstance(asked, str):
        turns = tuple(harmonic / given for harmonic in asked)
    elif asked == "none":
        turns = ()
    else:
        own = lines.periods_of_turn() if given == 1.0 else given
        turns, told = lines.steady(own), () if own == given else (warning("lines_between", periods=own),)
    return turns, (*([note("steady_beside_inputs", harmonics=turns)] if turns else []), *told)
