"""Samples of the residual that are no noise."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from floquid._arrays import Floats
from floquid.checks._check import Evidence
from floquid.findings import Finding, Severity, failure, warning

if TYPE_CHECKING:
    from floquid.checks._parted import Parted

SPIKE, SPOILT, QUARTILE = 12.0, 0.1, 0.6745
"""Deviations from which on a sample is no noise, the share of the power in such that spoils a fit, and the median
size of a normal number, from which the deviation is taken."""


def spikes(case: Any, _: Evidence) -> tuple[Finding, ...]:
    """Findings on spikes in the residual; warnings where a blow that nobody measured is excitation, and no fault."""
    found = of_outliers(case.residual, case.own)
    return tuple(replace(own, severity=Severity.WARNING) for own in found) if case.random else found


def of_outliers(left: Floats, own: Parted) -> tuple[Finding, ...]:
    """Findings on samples, in what is left of each output (outputs, samples), that are no noise: spikes."""
    found = []
    for values, channel in zip(left, own.outputs, strict=True):
        far = np.abs(values) > SPIKE * np.median(np.abs(values)) / QUARTILE
        if far.any():
            share, first = float(np.sum(values[far] ** 2) / np.sum(values**2)), int(np.argmax(far))
            record = int(np.searchsorted(own.samples.begins, first, side="right"))
            sample = first - own.samples.begins[record - 1] + 1
            told, number = failure if share > SPOILT else warning, int(far.sum())
            numbers = {"number": number, "share": share, "record": record, "sample": sample}
            found.append(told("outliers", channel=channel.name, **numbers))
    return tuple(found)
