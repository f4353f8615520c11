"""MATLAB files: which version one is of, and records as files of version 7."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from floquid._checks import input_error
from floquid.core import Record
from floquid.errors import InputError
from floquid.readers._by_path import table_of_variables
from floquid.readers._hdf5 import is_hdf5, load_hdf5
from floquid.readers._mat5 import HEAD, DamagedError, Mat5File
from floquid.readers._table import Source, Table, numbers_of, orbit_of, texts_of

_LARGEST = (1 << 31) - (1 << 16)
"""Bytes that a variable may have in these files: two gibibytes, less what its head takes."""

_HEAD_TEXT = b"MATLAB 5.0 MAT-file, written by floquid".ljust(116)
"""scipy writes the time of day here; the same record makes the same file."""

_SAVE_AGAIN = "In MATLAB save it again, as in save('run.mat', 'values', 'sample_rate', 'channels', '-v7')."


def load_mat(source: Source, *, channels: Sequence[str] | None, ignore_time: bool) -> Table:
    """The table in a MATLAB file, of version 5 to 7, or 7.3; nothing in it is ever run or made an object of.

    Raises
    ------
    InputError
        The file is none, is damaged, has no variables of our names and none are named, or one is not what it must be.
    """
    with source.path.open("rb") as stream:
        head = stream.read(HEAD)
    if is_hdf5(source.path):
        return load_hdf5(source, channels=channels, ignore_time=ignore_time)
    if len(head) < HEAD or head[126:128] not in (b"IM", b"MI"):
        raise _no_mat_file(source, head)
    try:
        file = Mat5File(source, source.path.read_bytes())
        return table_of_variables(source, file, channels=channels, ignore_time=ignore_time)
    except (InputError, OSError, MemoryError):
        raise
    except Exception as error:  # noqa: BLE001  # damage raises anything: zlib.error, struct.error, ...
        what = str(error) if isinstance(error, DamagedError) else f"{type(error).__name__}: {error}"
        raise source.error(
            "be a whole MATLAB file", f"is damaged or cut short: {what}", f"Copy it again. {_SAVE_AGAIN}"
        ) from None


def _no_mat_file(source: Source, head: bytes) -> InputError:
    """What else the file may be, by its first bytes."""
    remedy = f"Copy it again. {_SAVE_AGAIN}"
    if head.startswith(b"MATLAB "):
        got = "is cut short or damaged"
    elif head.startswith((b"PK\x03\x04", b"\x93NUMPY")):
        got, remedy = "is a file of NumPy or a zip archive", "Name it by its format, .npz."
    elif all(byte in b"\t\r\n" or 32 <= byte < 127 for byte in head):
        got, remedy = "is text", "Name it by its format, as in .csv, if it is a table of numbers."
    elif len(head) >= 20 and int.from_bytes(head[:4], "little") < 5000:
        got, remedy = "seems to be of version 4 or not one at all", _SAVE_AGAIN
    else:
        got = "is not one, or is damaged"
    return source.error("be a MATLAB file of version 5 to 7.3", got, remedy)


def save_mat(record: Record, path: Path) -> None:
    """Write `record` with every name that `load_mat` reads, as a file of version 7.

    Raises
    ------
    InputError
        `values` is larger than a variable can be in such a file.
    """
    import scipy.io

    if record.values.nbytes > _LARGEST:
        raise input_error(
            "record",
            "write",
            "have less than 2 GiB of samples to fit a MATLAB file of version 7",
            f"has {record.values.nbytes / (1 << 30):.3g} GiB",
            "Write it as .h5, which MATLAB reads, too (h5read).",
        )
    content: dict[str, Any] = {
        "values": record.values,
        **numbers_of(record),
        **orbit_of(record),
        **{key: _cell(texts) for key, texts in texts_of(record).items()},
    }
    with path.open("wb") as stream:  # savemat would add a suffix of its own to a name
        scipy.io.savemat(stream, content, do_compression=True)
        stream.seek(0)
        stream.write(_HEAD_TEXT)


def _cell(texts: Sequence[str]) -> Any:
    """A row of cells."""
    cell = np.empty(len(texts), dtype=object)
    cell[:] = texts
    return cell
