"""Foreign files to `Record` and back, and what is in a file.

The formats are one table, `FORMATS`: a reader of a new format is one more row, and `read`, `write`, `describe_file` and
the contract tests take it from there.
"""

from floquid.readers._formats import FORMATS, SUFFIXES, Format
from floquid.readers._read import read, write
from floquid.readers._summary import ChannelSummary, ClockCandidate, ClockKind, FileSummary, describe_file

__all__ = [
    "FORMATS",
    "SUFFIXES",
    "ChannelSummary",
    "ClockCandidate",
    "ClockKind",
    "FileSummary",
    "Format",
    "describe_file",
    "read",
    "write",
]
