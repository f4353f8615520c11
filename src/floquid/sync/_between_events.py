"""Records cut at events: the same number of samples in every period, whatever its duration."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from floquid._arrays import Floats
from floquid._checks import input_error
from floquid.core import Cycles, Record, over_gaps
from floquid.sync._count_pulses import FEWEST_PHASES
from floquid.sync._interpolation import BAND
from floquid.sync._resample import bandwidth

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
    return tuple(_resampled(record, own, phases) for record, own in zip(records, bounds, strict=True))


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


def _resampled(record: Record, bounds: Floats, phases: int) -> Cycles:
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
