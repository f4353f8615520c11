"""Whether the noise is coloured along the record, before any mode is known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from floquid.lifting import Lifted, whitening_filter
from floquid.lti import ERA

GENEROUS = 64
"""Poles that take any response with them and leave nothing but noise; at most one in three periods."""


def first_filter(lifted: Lifted) -> NDArray[np.float64] | None:
    """The filters that whiten what generous poles leave; None where that is white."""
    era = ERA()
    order = max(1, min(GENEROUS, int(lifted.responses.lengths.max()) // 3))
    return whitening_filter(lifted, era.extract(era.prepare(lifted.responses), order))
