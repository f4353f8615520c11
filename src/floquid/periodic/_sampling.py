"""Harmonics that the sampling shows: those of modes lie below half of the samples a period, forced ones up to it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from floquid._checks import input_error
from floquid.core import Record
from floquid.fit import HALF_DIGITS


def most_harmonics(records: Sequence[Record], period: float) -> int:
    """The highest harmonic of the period below half of the lowest sampling rate."""
    return below(half_of(records, period))


def below(half: float) -> int:
    """The highest harmonic below half of the samples a period."""
    return max(int(np.ceil(half)) - 1, 0)


def half_of(records: Sequence[Record], period: float) -> float:
    """Half of the samples a period at the lowest rate, a whole number of them where it is one up to rounding."""
    least = min(record.sample_rate for record in records) * period
    if least < 2.0:
        remedy = "Check the period and the sampling rate."
        raise input_error("period", "fit", "be two sampling intervals or more", f"it is {least:.3g} of them", remedy)
    return 0.5 * (round(least) if abs(least - round(least)) < HALF_DIGITS else least)
