"""Verdict on a model: cycles held out, the residual of the record, and A(t) integrated."""

from floquid.checks._types import Criterion, Validation
from floquid.checks._verdict import validate

__all__ = ["Criterion", "Validation", "validate"]
