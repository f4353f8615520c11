"""Records larger than memory: `identify_large` reads them in blocks and leaves residues on the disk."""

from floquid.large._identify import identify_large
from floquid.large._result import LARGE_VERSION, LargeResult, opened

__all__ = ["LargeResult", "identify_large"]
