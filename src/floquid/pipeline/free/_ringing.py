"""The cycles in which a mode is above the noise: a fit, its peaks and its checks look at no others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from floquid._arrays import Complexes, Integers
from floquid.core import Record
from floquid.lifting import Lifted, largest_values
from floquid.lti import SHORT
from floquid.periodic import Fit
from floquid.pipeline.free._start import Start

TIME_CONSTANTS = 12.0
"""Time constants of the slowest mode [-] that are fitted at least: later cycles have 1e-8 of what tells its decay."""


def ringing(multipliers: Complexes, lifted: Lifted) -> int:
    r"""Number of cycles in which modes of these multipliers are above the noise of lifted responses.

    .. math:: n = \frac{\max\big(12,\; 2 \ln \max_{c,h} a_{c,h}/\sigma_{c,h}\big)}{-\max_r \ln |\mu_r|}

    with a the largest value of a channel and hit and σ its noise: twice its logarithm, so that the response is as far
    below the noise as it was above. All cycles where a mode does not decay, and of a record that is short.
    """
    longest = int(lifted.responses.lengths.max())
    slowest = float(np.log(np.abs(multipliers).max(initial=0.0) + np.finfo(float).tiny))
    if longest <= SHORT or slowest >= 0.0:
        return longest
    above = float((largest_values(lifted.responses.values, lifted.n_channels) / lifted.noise).max())
    cycles = max(TIME_CONSTANTS, 2.0 * float(np.log(above))) / -slowest
    return min(longest, max(SHORT, int(np.ceil(min(cycles, longest)))))


def fitted_ringing(start: Start, records: Sequence[Record], fit: Callable[[Sequence[Record], Lifted], Fit]) -> Fit:
    """The fit of the cycles in which the modes of `start` ring, and half as many more.

    `records` are fitted with the lifted responses in `start` by `fit`. Where it ends at modes that ring for longer than
    was looked at, that is done again with as many as they ring. All cycles are fitted beside what goes on after the
    modes: a forced response, a steady tone.
    """
    lifted = start.whole
    whole = cycles = int(lifted.responses.lengths.max())
    if start.modal is not None and not start.known:
        cycles = ringing(start.modal.multipliers, lifted)
        cycles = min(whole, cycles + cycles // 2) if cycles < whole else whole
    while cycles < whole:
        fitted = fit(_first(records, start, cycles), lifted.first(cycles))
        longer = whole if _goes_on(fitted) else ringing(fitted.model.multipliers, lifted)
        if longer <= cycles:
            return replace(fitted, later=lifted.responses.lengths - np.minimum(lifted.responses.lengths, cycles))
        cycles = min(whole, 2 * longer)
    return fit(records, lifted)


def later_samples(fitted: Fit) -> Integers:
    """The samples of each hit behind those that were fitted (hits,); zeros where all were."""
    if fitted.later is None:
        return np.zeros(len(fitted.free), np.int64)
    return fitted.later * round(fitted.model.period * fitted.free[0].sample_rate)


def _first(records: Sequence[Record], start: Start, cycles: int) -> tuple[Record, ...]:
    """The samples of the first lifted cycles, with those that the filter begins with."""
    before = int((start.raw.responses.lengths - start.whole.responses.lengths).max())
    samples, cut = (cycles + before) * start.raw.n_phases, []
    for record in records:
        values = record.values[:, :samples].copy()
        values.flags.writeable = False
        cut.append(replace(record, values=values))
    return tuple(cut)


def _goes_on(fitted: Fit) -> bool:
    """True where there is something beside the modes that does not decay."""
    forced = fitted.forced
    steady = forced is not None and bool(len(forced.harmonics) or forced.offset.any() or forced.drift.any())
    return steady or any(own.code == "interference" for own in fitted.findings)
