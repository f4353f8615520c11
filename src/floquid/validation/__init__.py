"""Whether a model can be believed: cycles held out, what is left of the record, A(t) integrated, and a verdict."""

from floquid.validation._types import Criterion, Validation
from floquid.validation._validate import validate

__all__ = ["Criterion", "Validation", "validate"]
