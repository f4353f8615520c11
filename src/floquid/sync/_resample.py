"""Synchronous resampling: the same number of samples in every period, from a record sampled at its own rate.

Periods follow a clock, or lie between events, whatever their duration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from floquid._arrays import Floats, Indices
from floquid._checks import input_error, integer, several
from floquid.core import Cycles, PhaseClock, Record, longest_run, over_gaps
from floquid.fit import SURE
from floquid.sync._count_pulses import FEWEST_PHASES
from floquid.sync._interpolation import ACCURACY, BAND, check_options, half_width, interpolate
from floquid.sync._segment import refuse_unlike

_LENGTHS = (256, 1024, 4096, 16384)  # samples of the stretches whose spectra are looked at


def resample(
    records: Record | Sequence[Record],
    clocks: PhaseClock | Sequence[PhaseClock],
    *,
    n_phases: int | None = None,
    band: float = BAND,
    accuracy: float = ACCURACY,
) -> tuple[Cycles, ...]:
    r"""Each record at P instants of each of its whole periods, all of them from phase zero.

    .. math:: t_{m,p} = t_0 + (m + p/P)\,T \quad\text{or}\quad \nu\,\theta(t_{m,p})/2\pi = m + p/P, \qquad
        f_c = \tfrac12 \min(f_s,\ P/\max_m T_m)

    A constant period gives instants equally spaced in time, a shaft angle θ (with ν periods a revolution) instants
    equally spaced in angle. The interpolation is that of `interpolate`: what lies up to band·f_c is kept within the
    accuracy, what lies beyond (2 - band)·f_c is removed before it can fold. Cycles are kept where every instant has
    its samples on either side; with missing samples, the longest run of such cycles. The provenance says what was done
    and warns of a response beyond the pass band.

    Raises InputError where the channels differ, there is not one clock a record, or no whole cycle has all the samples
    it needs. So it does where a period is shorter than two samples or longer than its record.

    Parameters
    ----------
    records
        One record, or one a hit on the same system: the same channels; rates and periods may differ.
    clocks
        One for each record: a `ConstantPeriod`, a `ShaftAngle`, or another that answers `PhaseClock`.
    n_phases
        Samples a period P. None: as few as hold the `bandwidth` of the records in the pass band, at least 8, and never
        more than the records' own samples a period.
    band, accuracy
        The pass band as a share of the cut-off f_c, and the error as a share of each line's amplitude.
    """
    hits, ties = several(records, Record), several(clocks, PhaseClock)
    check_options(band, accuracy, "resample")
    _check_alike(hits, ties)
    cuts = tuple(_Cut.of(record, clock) for record, clock in zip(hits, ties, strict=True))
    reaches = tuple(bandwidth(record) for record in hits)
    most = min(record.sample_rate * cut.mean for record, cut in zip(hits, cuts, strict=True))
    if n_phases is None:
        wanted = max(2.0 * reach * cut.longest / band for reach, cut in zip(reaches, cuts, strict=True))
        phases = min(max(FEWEST_PHASES, int(np.ceil(wanted))), int(most * (1.0 + 1e-9)))
    else:
        phases = integer(n_phases, "n_phases", "resample", at_least=2)
    return tuple(
        _resampled(record, cut, phases, reach, band, accuracy)
        for record, cut, reach in zip(hits, cuts, reaches, strict=True)
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Cut:
    """The whole cycles within a record."""

    clock: PhaseClock
    first: int
    bounds: Floats  # start of each cycle, and end of the last (cycles + 1,) [s]

    @classmethod
    def of(cls, record: Record, clock: PhaseClock) -> _Cut:
        """The cycles of `clock` that begin and end within `record`."""
        ends = record.start + np.array([0.0, record.n_samples - 1.0]) / record.sample_rate
        low, high = clock.turns(ends)
        first, last = int(np.ceil(low)), int(np.floor(high))
        if last <= first:
            must = "have at least one whole period within each record"
            got = f"one record of {record.duration:.6g} s holds {max(high - low, 0.0):.3g} periods"
            raise input_error("clocks", "resample", must, got, "Check the unit of the period, or use a longer record.")
        # Of more periods than samples, which are refused below, not all bounds are made: there may be any number.
        bounds = clock.times_at(np.arange(first, min(last, first + record.n_samples) + 1.0))
        if not (np.diff(bounds) > 0).all():
            must = "have an angle that grows over each record"
            raise input_error("clocks", "resample", must, "one turns back", "Leave out the part where the shaft does.")
        cut = cls(clock=clock, first=first, bounds=bounds)
        samples = float(np.diff(bounds).min()) * record.sample_rate
        if samples < 2.0:
            raise input_error(
                "clocks",
                "resample",
                "have periods of at least two samples",
                f"one is {samples / record.sample_rate:.6g} s, or {samples:.3g} samples at {record.sample_rate:.6g} Hz",
                "Check the units of the period and of the sampling rate.",
            )
        return cut

    @property
    def n_cycles(self) -> int:
        return len(self.bounds) - 1

    @property
    def mean(self) -> float:
        """The mean period [s]."""
        return float(self.bounds[-1] - self.bounds[0]) / self.n_cycles

    @property
    def longest(self) -> float:
        """The longest period [s]."""
        return float(np.diff(self.bounds).max())

    def lengths(self, kept: slice) -> Floats:
        """The length of each kept cycle (cycles,) [s]."""
        if self.clock.measured:
            return np.diff(self.bounds)[kept]
        return np.full(kept.stop - kept.start, self.clock.period)


def _resampled(record: Record, cut: _Cut, phases: int, reach: float, band: float, accuracy: float) -> Cycles:
    """One record at `phases` instants of each whole cycle that has the samples for them."""
    cutoff = 0.5 * min(record.sample_rate, phases / cut.longest)
    turns = cut.first + np.arange(cut.n_cycles * phases) / phases
    values = interpolate(
        record.values,
        record.sample_rate,
        record.start,
        cut.clock.times_at(turns),
        cutoff=cutoff,
        band=band,
        accuracy=accuracy,
    ).reshape(record.n_channels, cut.n_cycles, phases)
    kept = slice(*longest_run(np.asarray(np.isfinite(values).all(axis=(0, 2)))))
    half = half_width(record.sample_rate, cutoff=cutoff, band=band, accuracy=accuracy)
    if kept.stop == kept.start:
        must = f"hold a whole cycle with {half} samples on either side of each instant, none of them missing"
        got = f"none of the {cut.n_cycles} cycles of one record has them"
        remedy = "Use a longer record, a lower `accuracy` or a lower `band`."
        raise input_error("records", "resample", must, got, remedy)
    taken = values[:, kept]
    if taken.size < values.size:
        taken = taken.copy()  # what was left out is not held on to
    taken.flags.writeable = False
    left = cut.n_cycles - taken.shape[1]
    how = "shaft angle" if cut.clock.measured else "time"
    step = (
        f"resampled from {record.sample_rate:.6g} Hz to {phases} samples a period ({phases / cut.mean:.6g} Hz), "
        f"equally spaced in {how}: pass band up to {band * cutoff:.6g} Hz, error at most {accuracy:.2g} of each line's "
        "amplitude"
    )
    if left:
        step += f"; {left} of {cut.n_cycles} cycles left out, within {half} samples of an end"
        step += " or of a missing sample, or not in the longest run" if np.isnan(record.values).any() else ""
    if reach > band * cutoff:
        step += (
            f"; warning: the response reaches {reach:.6g} Hz, beyond the pass band: what lies above "
            f"{(2.0 - band) * cutoff:.6g} Hz is removed, what lies between is weakened"
        )
    return Cycles(
        values=taken.transpose(0, 2, 1),
        periods=cut.lengths(kept),
        channels=record.channels,
        provenance=record.provenance.then(step),
        first_cycle=cut.first + kept.start,
    )


def _check_alike(records: tuple[Record, ...], clocks: tuple[PhaseClock, ...]) -> None:
    """Refuse records that cannot be hits on one system, and clocks that are not one a record."""
    if not records:
        raise input_error("records", "resample", "hold at least one record", "is empty")
    if len(clocks) != len(records):
        raise input_error("clocks", "resample", f"hold one for each of {len(records)} records", f"holds {len(clocks)}")
    for clock in clocks:
        if not isinstance(clock, PhaseClock):
            must = "be a ConstantPeriod or a shaft angle"
            remedy = "Find the shaft angle from the pulses or the azimuth channel first."
            raise input_error("clocks", "resample", must, f"one is a {type(clock).__name__}", remedy)
    refuse_unlike(records, "resample")


def bandwidth(record: Record) -> float:
    r"""The highest frequency at which a channel of `record` rises above its own white noise [Hz].

    .. math:: \max\Bigl\{f_l : \bar S(f_l) > s\,\chi^2_{\nu}(1 - \alpha)/\nu
        \ \text{ or }\ \max_k S_k(f_l) > s\,\chi^2_2(1 - \alpha/K)/2\Bigr\}

    for the periodograms S_k of K half overlapping stretches and their mean with ν degrees of freedom (Welch 1967), at
    stretches of 256, 1024, 4096 and 16384 samples: a short decay shows in the short ones, a weak line in the long. The
    level of noise s is the median of the mean over frequency: a response may fill up to about half of the lines. White
    noise in every channel gives 0, bar one record in a million. A line below a millionth of the largest one's amplitude
    counts as rounding or leakage. One within five lines of a larger one counts as its flank. Stretches with missing
    samples are left out. Zero where nothing rises above the noise; half the sampling rate where no 64 samples follow
    one another.
    """
    gaps = np.concatenate(([0], np.cumsum(np.isnan(record.values).any(axis=0))))
    begins = {length: _stretches(gaps, length) for length in _LENGTHS if length <= max(256, record.n_samples // 8)}
    begins = {length: starts for length, starts in begins.items() if len(starts)} or {64: _stretches(gaps, 64)}
    if not len(begins[min(begins)]):
        return 0.5 * record.sample_rate
    chance = SURE / (record.n_channels * len(begins))
    return max(
        _highest_line(np.lib.stride_tricks.sliding_window_view(channel, length)[starts], record.sample_rate, chance)
        for length, starts in begins.items()
        for channel in record.values
    )


def _stretches(gaps: Indices, length: int) -> Indices:
    """First samples of half overlapping stretches without a missing one; `gaps` counts those before each sample."""
    starts = np.arange(0, max(len(gaps) - length, 0), length // 2)
    return starts[gaps[starts + length] == gaps[starts]]


def _highest_line(stretches: Floats, sample_rate: float, chance: float) -> float:
    """The highest line of any of the stretches (stretches, samples), or of all, above the white noise; 0 if none is."""
    # Not `scipy.signal`, `scipy.stats` and `scipy.ndimage`: those take longer to load than all else here takes.
    from scipy.special import chdtri

    count, length = stretches.shape
    # Side lobes below the smallest line that counts; half a main lobe is a little over five lines.
    window = np.kaiser(length, 16.0)
    # The trend takes from the lowest lines, and the last one is real.
    frequencies = np.fft.rfftfreq(length, 1.0 / sample_rate)[2:-1]
    ramp = np.linspace(-1.0, 1.0, length)
    flat = stretches - stretches.mean(axis=1, keepdims=True)
    flat = flat - np.multiply.outer(flat @ ramp / (ramp @ ramp), ramp)
    power = np.abs(np.fft.rfft(flat * window)[:, 2:-1]) ** 2
    overlap = (window[length // 2 :] @ window[: length // 2]) / (window @ window)
    freedom = 2.0 * count / (1.0 + 2.0 * (1.0 - 1.0 / count) * overlap**2)
    mean = power.mean(axis=0)
    noise = np.median(mean) * freedom / chdtri(freedom, 0.5)
    floor = ACCURACY**2 * power.max()  # what is weaker may be leakage or rounding
    each = 0.5 * chance / len(frequencies)
    # A summit, and not the flank of a stronger line.
    above = (mean > max(noise * chdtri(freedom, each) / freedom, floor)) & (mean == _highest_near(mean))
    single = power > max(noise * chdtri(2.0, each / count) / 2.0, floor)
    above |= (single & (power == _highest_near(power))).any(axis=0)
    # The line may lie half a bin higher.
    return float(frequencies[above][-1]) + 0.5 * sample_rate / length if above.any() else 0.0


def _highest_near(power: Floats) -> Floats:
    """The highest of each line and the five on either side, along the last axis."""
    padded = np.pad(power, [(0, 0)] * (power.ndim - 1) + [(5, 5)], mode="edge")
    return np.lib.stride_tricks.sliding_window_view(padded, 11, axis=-1).max(axis=-1)


OF = "between_events"


def between_events(records: Sequence[Record]) -> tuple[Cycles, ...]:
    r"""Each record at P equal steps of phase between events, by a spline in phase fitted to its samples.

    .. math:: \varphi(t) = k + \frac{t - e_k}{e_{k+1} - e_k}, \qquad
              \min_g \sum_n \Big( y(t_n) - \sum_j g_j\, N_j(\varphi(t_n)) \Big)^2

    with e the events, and N the B-splines of degree 4 with P knots a period. The instants are midway between knots,
    where the ends of a spline are least noisy. A period is what lies between two events, whatever its duration. P holds
    the `bandwidth` of all records, as far as their samples do. Where a channel misses its samples about an instant, the
    value there is missing.

    `records` have clocks whose pulses begin a period each (`PulseTimes(times=…, cycles=True)`). Raises InputError where
    a record has another clock, or fewer than two events. Cycles come with their own lengths [s], from the first event
    within each record on.
    """
    bounds = [_bounds(record, number) for number, record in enumerate(records, start=1)]
    lengths = np.concatenate([np.diff(own) for own in bounds])
    reach = max(bandwidth(record) for record in records)
    # Of fewer samples than two a knot noise makes large waves.
    most = int(0.5 * (1.0 + 1e-9) * float(lengths.min()) * min(record.sample_rate for record in records))
    phases = min(max(FEWEST_PHASES, int(np.ceil(2.0 * reach * lengths.max() / (0.5 * BAND)))), most)
    if phases < FEWEST_PHASES:
        samples = lengths.min() * min(record.sample_rate for record in records)
        must = f"have {2 * FEWEST_PHASES} samples or more between two events"
        got = f"two are {lengths.min():.6g} s apart, {samples:.3g} samples"
        raise input_error("records", OF, must, got, "Check the unit of the events, and the sampling rate.")
    return tuple(_splined(record, own, phases) for record, own in zip(records, bounds, strict=True))


def _bounds(record: Record, number: int) -> Floats:
    """The events within a record, its first and last sample to half a sample (events,) [s]."""
    if record.clock is None or not record.clock.cycles:
        must, got = "have clocks of events", f"number {number} has {record.clock!r:.60}"
        raise input_error("records", OF, must, got, "Pass record.with_clock(PulseTimes(times=..., cycles=True)).")
    events, half = np.asarray(record.clock.times), 0.5 / record.sample_rate  # type: ignore[union-attr]
    inside = events[(events >= record.start - half) & (events <= record.times[-1] + half)]
    if len(inside) < 2:
        got = f"record {number}, from {record.start:.6g} to {record.times[-1]:.6g} s, has {len(inside)}"
        remedy = "Leave that record out, or give its events on its own time axis."
        raise input_error("records", OF, "have two events or more each", got, remedy)
    return inside


def _splined(record: Record, bounds: Floats, phases: int) -> Cycles:
    """One record at `phases` instants of each period between its events."""
    from scipy.interpolate import make_lsq_spline

    periods, degree = len(bounds) - 1, 4  # at 0.4 of its Nyquist frequency, half of what resampling allows, 0.1 % off
    # Beyond the outer events the pace is that of the period beside.
    ends = np.concatenate([[2.0 * bounds[0] - bounds[1]], bounds, [2.0 * bounds[-1] - bounds[-2]]])
    turns = np.interp(record.times, ends, np.arange(len(ends)) - 1.0)
    near = (turns > -1.0) & (turns < periods + 1.0)
    grid, turns = (np.arange(periods * phases) + 0.5) / phases, turns[near]
    first, last = turns[0], turns[-1]
    inner = np.arange(np.ceil(first * phases) + 1.0, last * phases - 1.0) / phases
    knots = np.concatenate([np.full(degree + 1, first), inner, np.full(degree + 1, last)])
    values = np.empty((record.n_channels, len(grid)))
    for row, own in enumerate(record.values[:, near]):
        missing = np.isnan(own)
        whole = over_gaps(own[None], missing)[0]
        values[row] = make_lsq_spline(turns, whole, knots, degree)(grid) if not missing.all() else np.nan
        if missing.any() and not missing.all():
            there = turns[~missing]
            after = np.clip(np.searchsorted(there, grid), 1, len(there) - 1)
            apart = np.minimum(np.abs(grid - there[after - 1]), np.abs(grid - there[after]))
            values[row, apart > 1.0 / phases] = np.nan
    step = f"at {phases} equal steps of phase between events, by a spline fitted to the samples at "
    return Cycles(
        values=values.reshape(record.n_channels, periods, phases).transpose(0, 2, 1),
        periods=np.diff(bounds),
        first_phase=0.5 / phases,
        channels=record.channels,
        provenance=record.provenance.then(f"{step}{record.sample_rate:.6g} Hz"),
    )
