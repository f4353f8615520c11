"""Records to `Cycles`: what ties samples to the phase of the system, before any pole is known."""

from floquid.sync._segment import rejoin, segment

__all__ = ["rejoin", "segment"]
