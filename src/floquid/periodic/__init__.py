"""A modal model of lifted responses → the `PeriodicModel`: delay, branch, harmonics and their uncertainty."""

from floquid.periodic._assemble import assemble
from floquid.periodic._harmonics import select_bands

__all__ = ["assemble", "select_bands"]
