"""NumPy arrays and archives, and MATLAB files as files of named variables, and records as such files.

Which variable is a channel, a time or a unit is told by their names, of any format: `_by_name`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from zipfile import is_zipfile

import numpy as np
from numpy.typing import NDArray

from floquid._checks import input_error
from floquid.core import Record
from floquid.io import Source, is_mat_4, letters, load_variables, mat_order, refuse_wrong_name
from floquid.readers.variables._by_name import MATLAB, NUMPY, TIME_NAMES, Dialect, Kind, Variable
from floquid.readers.variables._by_path import table_of_variables
from floquid.readers.variables._hdf5 import Arrays, load_hdf5
from floquid.tables import Table, numbers_of, orbit_of, texts_of

_NPY = b"\x93NUMPY"


def load_npz(source: Source, *, channels: Sequence[str] | None, ignore_time: bool) -> Table:
    """The table in a NumPy archive; nothing in it is ever unpickled."""
    file = Arrays(source, _arrays(source), NUMPY)
    return table_of_variables(source, file, channels=channels, ignore_time=ignore_time)


def _arrays(source: Source) -> dict[str, NDArray[Any]]:
    """The arrays by key."""
    if not is_zipfile(source.path):  # numpy would advise to load a pickle all the same
        refuse_wrong_name(source, "a whole NumPy archive", f"Copy it again. {NUMPY.save}")
    again = source.taken_apart("NumPy archive", f"Copy it again. {NUMPY.save}")
    with again, source.path.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
        return {key: _array(archive, key) for key in archive.files}


def load_npy(source: Source, *, channels: Sequence[str] | None, ignore_time: bool) -> Table:
    """The table in a file of one array, `data`: a vector, rows of samples, or records with a field a channel."""
    with source.path.open("rb") as stream:
        if stream.read(6) != _NPY:
            refuse_wrong_name(source, "a NumPy array (.npy)", f"Copy it again. {NUMPY.save}")
    with source.taken_apart("NumPy array", f"Copy it again. {NUMPY.save}"):
        found = np.load(source.path, allow_pickle=False)
        fields = found.dtype.names
        file = Arrays(source, {name: found[name] for name in fields} if fields else {"data": found}, NUMPY)
        if channels is None and fields:
            channels = [one.path for one in file.variables.values() if one.is_vector and one.path not in TIME_NAMES]
        elif channels is None and (found.ndim == 1 or (found.ndim == 2 and 0 < len(found) <= found.shape[1])):
            channels = ["data"]
        return table_of_variables(source, file, channels=channels or None, ignore_time=ignore_time)


def _array(archive: Any, key: str) -> NDArray[Any]:
    try:
        return np.asarray(archive[key])
    except ValueError as error:
        if "Object arrays" not in str(error):
            raise
        return np.empty(0, object)


def save_npz(record: Record, path: Path) -> None:
    """Write `record` with every key that `load_npz` reads."""
    content: dict[str, Any] = {**record.point, "values": record.values, **numbers_of(record), **orbit_of(record)}
    content |= texts_of(record)
    with path.open("wb") as stream:  # savez would add a suffix of its own to a name
        np.savez(stream, **content)


_LARGEST = (1 << 31) - (1 << 16)
"""Bytes that a variable may have in these files: two gibibytes, less what its head takes."""

_HEAD_TEXT = b"MATLAB 5.0 MAT-file, written by floquid".ljust(116)
"""scipy writes the time of day here; the same record makes the same file."""

_SAVE_AGAIN = "In MATLAB save it again, as in save('run.mat', 'values', 'sample_rate', 'channels', '-v7')."


def load_mat(source: Source, *, channels: Sequence[str] | None, ignore_time: bool) -> Table:
    """The table in a MATLAB file, of version 4 to 7, or 7.3; nothing in it is ever run or made an object of."""
    import h5py

    if h5py.is_hdf5(source.path):
        return load_hdf5(source, channels=channels, ignore_time=ignore_time)
    if not mat_order(source.path) and not is_mat_4(source.path):
        refuse_wrong_name(source, "a MATLAB file", f"Copy it again. {_SAVE_AGAIN}")
    with source.taken_apart("MATLAB file", f"Copy it again. {_SAVE_AGAIN}"):
        file = _MatFile(load_variables(source.path))
        return table_of_variables(source, file, channels=channels, ignore_time=ignore_time)


class _MatFile:
    """The variables that scipy found, those in structs under their paths."""

    def __init__(self, content: dict[str, Any]) -> None:
        self._values = dict(_leaves(content))
        self.variables = {path: _variable(path, value) for path, value in self._values.items()}
        self.dialect: Dialect = MATLAB

    def numbers(self, path: str) -> NDArray[Any]:
        """The array of a variable of numbers, in its shape."""
        return self._values[path]

    def texts(self, path: str) -> list[str] | None:
        """The rows of a character array without the blanks that fill them up, or the texts in a cell array."""
        return letters(self._values[path])


def _leaves(content: dict[str, Any], stem: str = "") -> Iterator[tuple[str, Any]]:
    """Every variable with its path: of a struct, its fields; of a struct array, itself and those of each element."""
    for name, value in content.items():
        is_struct = type(value) is np.ndarray and value.dtype.names
        if not is_struct or value.size != 1:
            yield f"{stem}{name}", value
        for number, record in enumerate(value.ravel(order="F") if is_struct else ()):
            element = f"{stem}{name}" if value.size == 1 else f"{stem}{name}[{number}]"
            yield from _leaves(dict(zip(value.dtype.names, record, strict=True)), f"{element}/")


def _variable(path: str, value: Any) -> Variable:
    from scipy.io import matlab
    from scipy.sparse import issparse

    kinds: list[tuple[bool, Kind]] = [
        (issparse(value), "a sparse matrix"),
        (isinstance(value, matlab.MatlabFunction), "a function handle"),
        (isinstance(value, (matlab.MatlabObject, matlab.MatlabOpaque)), "a MATLAB object"),
    ]
    for fits, kind in kinds:
        if fits:
            return Variable(path=path, shape=(), kind=kind)
    array = np.asarray(value)
    if array.dtype.names:
        return Variable(path=path, shape=array.shape, kind="a struct array")
    by_letter: dict[str, Kind] = {"O": "a cell array", "U": "text", "c": "complex numbers"}
    kind = by_letter.get(array.dtype.kind, "numbers")
    return Variable(path=path, shape=array.shape, kind=kind, is_counted=array.dtype.kind in "iu")


def save_mat(record: Record, path: Path) -> None:
    """Write `record` with every name that `load_mat` reads, as a file of version 7."""
    import scipy.io

    if record.values.nbytes > _LARGEST:
        must = "have less than 2 GiB of samples to fit a MATLAB file of version 7"
        got = f"has {record.values.nbytes / (1 << 30):.3g} GiB"
        raise input_error("record", "write", must, got, "Write it as .h5, which MATLAB reads, too (h5read).")
    content: dict[str, Any] = {**record.point, "values": record.values, **numbers_of(record), **orbit_of(record)}
    for key, texts in texts_of(record).items():
        content[key] = np.empty(len(texts), dtype=object)
        content[key][:] = texts
    with path.open("wb") as stream:  # savemat would add a suffix of its own to a name
        scipy.io.savemat(stream, content, do_compression=True)
        stream.seek(0)
        stream.write(_HEAD_TEXT)
