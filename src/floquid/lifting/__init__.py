"""Cycles ↔ lifted responses: the samples at one phase, a period apart, are the response of an LTI system."""

from floquid.lifting._lift import Lifted, largest_values, lift, unlift
from floquid.lifting._whiten import whitened, whitening_filter

__all__ = ["Lifted", "largest_values", "lift", "unlift", "whitened", "whitening_filter"]
