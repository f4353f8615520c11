"""Cycles ↔ lifted responses: the samples at one phase, a period apart, are the response of an LTI system."""

from floquid.lifting._lift import Lifted, floor_of, largest_values, lift, refuse_values, unlift
from floquid.lifting._whiten import LAGS, filters_of, whitened, whitening_filter

__all__ = [
    "LAGS", "Lifted", "filters_of", "floor_of", "largest_values", "lift", "refuse_values", "unlift", "whitened",
    "whitening_filter",
]  # fmt: skip
