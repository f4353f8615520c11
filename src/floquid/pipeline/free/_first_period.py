"""The first period of each hit with values of its own: left out of the fit where that lowers the criterion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from floquid.fit import chi2_limit
from floquid.lifting import floor_of
from floquid.periodic import Fit, unexplained
from floquid.preparation import Prepared, clocks_of, from_sample

STANDS_OUT = 2.0  # the fall that the first period promises over that of the second, at least


def promised(fitted: Fit, prepared: Prepared) -> float:
    r"""Fall of the criterion where the first period of each hit has values of its own, these modes staying.

    .. math:: \sum_{c,h} N_h \log \frac{\mathrm{RSS}_{c,h}}{\mathrm{RSS}_{c,h} - \mathrm{RSS}^{(1)}_{c,h}} - \chi^2_n

    with n the number of their samples: what noise exceeds with the probability allowed for a mode is no fall, nor is
    what is below the least noise. None is promised where the second period adds half as much: such a residual decays
    on, and no period would be the last to be left out.
    """
    first, both = (_fall(fitted, prepared, periods) for periods in (1, 2))
    return min(first, first - STANDS_OUT * (both - first))


def _fall(fitted: Fit, prepared: Prepared, periods: int) -> float:
    """Fall of the criterion where the first periods of each hit have values of their own."""
    clocks, settings = clocks_of(fitted.free, prepared.shafts), prepared.settings
    floor = floor_of((row for record in fitted.free for row in record.values), settings.noise_floor)
    gain, numbers = 0.0, 0
    for record, left in zip(fitted.free, unexplained(fitted.model, fitted.free, clocks), strict=True):
        first = int(np.ceil(periods * fitted.model.period * record.sample_rate))
        squares, samples = np.nan_to_num(left) ** 2, np.isfinite(left).sum(axis=1)
        least = samples * (floor * np.nanmax(np.abs(record.values), axis=1)) ** 2
        whole, rest = (least + part.sum(axis=1) for part in (squares, squares[:, first:]))
        gain += float(samples @ np.log(whole / rest))
        numbers += int(np.isfinite(left[:, :first]).sum())
    return gain - chi2_limit(max(numbers, 1), settings.mode_false_alarm)


def without_first(prepared: Prepared) -> tuple[Prepared, int]:
    """The records without their first period, and the samples of a hit left out."""
    pairs = zip(prepared.clocks, prepared.responses, strict=True)
    samples = max(int(np.ceil(clock.period * record.sample_rate)) for clock, record in pairs)
    records, responses = (from_sample(own, samples) for own in (prepared.records, prepared.responses))
    return replace(prepared, records=records, responses=responses), samples
