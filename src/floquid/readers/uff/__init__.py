"""Universal files: time responses in datasets 58."""

from floquid.readers.uff._channels import KINDS
from floquid.readers.uff._read import load_uff, save_uff

__all__ = ["KINDS", "load_uff", "save_uff"]
