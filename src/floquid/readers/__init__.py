"""Foreign files and objects to `Record` and back, and what is in a file.

The formats are one table, `FORMATS`: a reader of a new format is one more row, and `read`, `write`, `describe_file` and
the contract tests take it from there.
"""

from floquid.readers._labelled import from_pandas, from_xarray, record_to_xarray, to_pandas
from floquid.readers._read import FORMATS, SUFFIXES, WRITTEN, Format, read, write
from floquid.readers._sep005 import from_sep005, to_sep005
from floquid.readers._summary import (
    ChannelSummary,
    ClockCandidate,
    ClockKind,
    FileSummary,
    describe_file,
    read_and_describe,
)
from floquid.readers.uff import KINDS as UFF_KINDS

__all__ = [
    "FORMATS", "SUFFIXES", "UFF_KINDS", "WRITTEN", "ChannelSummary", "ClockCandidate", "ClockKind", "FileSummary",
    "Format", "describe_file", "from_pandas", "from_sep005", "from_xarray", "read", "record_to_xarray", "to_pandas",
    "to_sep005", "write",
]  # fmt: skip
