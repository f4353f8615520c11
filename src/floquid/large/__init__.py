"""Records larger than memory: `identify_large` reads them in blocks and leaves residues on the disk."""

from floquid.large._identify import identify_large
from floquid.large._result import LARGE as LARGE
from floquid.large._result import LARGE_VERSION as LARGE_VERSION
from floquid.large._result import LargeResult
from floquid.large._result import opened as opened

__all__ = ["LargeResult", "identify_large"]
