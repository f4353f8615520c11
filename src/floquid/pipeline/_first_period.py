"""The first period of each hit with values of its own: left out of the fit where that lowers the criterion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from floquid.core import ConstantPeriod
from floquid.fit import chi2_limit
from floquid.periodic import Fit, unexplained
from floquid.pipeline.preparation import Prepared, from_sample
from floquid.sync import ShaftAngle


def promised(fitted: Fit, clocks: Sequence[ConstantPeriod | ShaftAngle], alarm: float) -> float:
    r"""Fall of the criterion where the first period of each hit has values of its own, these modes staying.

    .. math:: \sum_{c,h} N_h \log \frac{\mathrm{RSS}_{c,h}}{\mathrm{RSS}_{c,h} - \mathrm{RSS}^{(1)}_{c,h}} - \chi^2_n

    with n the number of their samples: what noise exceeds with the probability `alarm` is no fall.
    """
    gain, numbers = 0.0, 0
    for record, left in zip(fitted.free, unexplained(fitted.model, fitted.free, clocks), strict=True):
        first = int(np.ceil(fitted.model.period * record.sample_rate))
        squares, there = np.nan_to_num(left) ** 2, np.isfinite(left)
        whole, rest = squares.sum(axis=1), squares[:, first:].sum(axis=1)
        told = rest > 0.0
        gain += float(there.sum(axis=1)[told] @ np.log(whole[told] / rest[told]))
        numbers += int(there[:, :first].sum())
    return gain - chi2_limit(max(numbers, 1), alarm)


def without_first(prepared: Prepared) -> tuple[Prepared, int]:
    """The records without their first period, and the samples of a hit left out."""
    pairs = zip(prepared.clocks, prepared.responses, strict=True)
    samples = max(int(np.ceil(clock.period * record.sample_rate)) for clock, record in pairs)
    records, responses = (from_sample(own, samples) for own in (prepared.records, prepared.responses))
    return replace(prepared, records=records, responses=responses), samples
