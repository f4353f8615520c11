"""Cycles ↔ lifted responses: the samples at one phase, a period apart, are the response of an LTI system."""

from floquid.lifting._lift import Lifted, lift, unlift

__all__ = ["Lifted", "lift", "unlift"]
