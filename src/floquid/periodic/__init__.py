"""A modal model of lifted responses → the `PeriodicModel`: delay, branch, harmonics and their uncertainty."""

from floquid.periodic._assemble import assemble
from floquid.periodic._harmonics import participation, select_bands
from floquid.periodic._synchrony import Synchrony, drift, spacing, synchrony

__all__ = ["Synchrony", "assemble", "drift", "participation", "select_bands", "spacing", "synchrony"]
