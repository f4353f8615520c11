"""Verdict on a model: cycles held out, the residual of the record, and A(t) integrated."""

from floquid.validation._types import Criterion, Validation
from floquid.validation._validate import validate

__all__ = ["Criterion", "Validation", "validate"]
