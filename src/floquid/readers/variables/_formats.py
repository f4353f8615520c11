"""NumPy archives, HDF5 and MATLAB files as files of named variables, and records as such files.

In HDF5 no link is followed, and no data are read that are in other files. Files of MATLAB 7.3 are HDF5; how MATLAB
keeps arrays and texts there is known to `floquid.io`. Which variable is a channel, a time or a unit is told by their
names, of any format: `_by_name`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zipfile import is_zipfile

import numpy as np
from numpy.typing import NDArray

from floquid._checks import input_error
from floquid.core import Record
from floquid.io import (
    Source,
    array_in,
    attribute,
    is_elsewhere,
    letters,
    load_variables,
    mat_order,
    refuse_wrong_name,
    texts_in,
)
from floquid.readers.variables._by_name import HDF5, MATLAB, NUMPY, Dialect, Kind, Variable, printable
from floquid.readers.variables._by_path import table_of_variables
from floquid.tables import Table, numbers_of, orbit_of, texts_of

if TYPE_CHECKING:
    import h5py

_KINDS: dict[str, Kind] = {
    "O": "Python objects",
    "c": "complex numbers",
    "U": "text",
    "S": "text",
    "M": "dates",
    "m": "time spans",
    "b": "numbers",
    "i": "numbers",
    "u": "numbers",
    "f": "numbers",
}


def load_npz(source: Source, *, channels: Sequence[str] | None, ignore_time: bool) -> Table:
    """The table in a NumPy archive; nothing in it is ever unpickled."""
    return table_of_variables(source, _NpzFile(source), channels=channels, ignore_time=ignore_time)


class _NpzFile:
    """The arrays of an archive; of one of Python objects, nothing."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._arrays = _arrays(source)
        self.variables = {
            key: Variable(path=key, shape=array.shape, kind=_KINDS.get(array.dtype.kind, "records"))
            for key, array in self._arrays.items()
        }
        self.dialect: Dialect = NUMPY

    def numbers(self, path: str) -> NDArray[Any]:
        """The array of a variable of numbers, in its shape."""
        return self._arrays[path]

    def texts(self, path: str) -> list[str] | None:
        """The texts in an array of letters or of bytes."""
        try:
            return [text.decode() if isinstance(text, bytes) else text for text in self._arrays[path].ravel().tolist()]
        except UnicodeDecodeError:
            must, got = f"hold text in UTF-8 in `{printable(path)}`", "has other bytes there"
            raise self._source.error(must, got, "Save it from str.") from None


def _arrays(source: Source) -> dict[str, NDArray[Any]]:
    """The arrays by key."""
    if not is_zipfile(source.path):  # numpy would advise to load a pickle all the same
        refuse_wrong_name(source, "a whole NumPy archive", f"Copy it again. {NUMPY.save}")
    again = source.taken_apart("NumPy archive", f"Copy it again. {NUMPY.save}")
    with again, source.path.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
        return {key: _array(archive, key) for key in archive.files}


def _array(archive: Any, key: str) -> NDArray[Any]:
    try:
        return np.asarray(archive[key])
    except ValueError as error:
        if "Object arrays" not in str(error):
            raise
        return np.empty(0, object)


def save_npz(record: Record, path: Path) -> None:
    """Write `record` with every key that `load_npz` reads."""
    content: dict[str, Any] = {"values": record.values, **numbers_of(record), **orbit_of(record), **texts_of(record)}
    with path.open("wb") as stream:  # savez would add a suffix of its own to a name
        np.savez(stream, **content)


_BLOCK = 1 << 16
_MATLAB_S_OWN = ("#refs#", "#subsystem#")


def load_hdf5(source: Source, *, channels: Sequence[str] | None, ignore_time: bool) -> Table:
    """The table in an HDF5 file, or a MATLAB file of version 7.3."""
    import h5py

    if not h5py.is_hdf5(source.path):
        refuse_wrong_name(source, "an HDF5 file", "Copy it again, or name it by its format.")
    with source.taken_apart("HDF5 file", "Copy or save it again."), h5py.File(source.path, "r") as opened:
        return table_of_variables(source, Hdf5File(opened), channels=channels, ignore_time=ignore_time)


class Hdf5File:
    """The variables of an open file; nothing is read before it is asked for."""

    def __init__(self, file: h5py.File) -> None:
        self._file: Any = file  # what is at a path is checked in `_walk`
        self.variables: dict[str, Variable] = {}
        matlab = False
        for path, thing in self._walk():
            self.variables[path] = self._variable(path, thing)
            matlab = matlab or (thing is not None and attribute(thing, "MATLAB_class") != "")
        self.dialect: Dialect = MATLAB if matlab else HDF5

    def numbers(self, path: str) -> NDArray[Any]:
        """The array of a variable of numbers, in its shape."""
        if not self.variables[path].size:
            return np.zeros(self.variables[path].shape)
        return array_in(self._file[path])

    def texts(self, path: str) -> list[str] | None:
        """The texts in a dataset, the rows of a character array, or the texts in a cell array."""
        return texts_in(self._file[path])

    def _walk(self) -> Iterator[tuple[str, Any]]:
        """Every dataset with its path, and a group that MATLAB makes of one thing; of a link None.

        Groups are entered by hard links alone, and each but once.
        """
        import h5py

        waiting: list[tuple[str, Any]] = [("", self._file)]
        seen = {self._file.id}
        while waiting:
            path, group = waiting.pop(0)
            for name in group:
                where = f"{path}{name}"
                if path == "" and name in _MATLAB_S_OWN:
                    continue
                if not isinstance(group.get(name, getlink=True), h5py.HardLink):
                    yield where, None
                    continue
                thing = group[name]
                if isinstance(thing, h5py.Dataset) or (isinstance(thing, h5py.Group) and _is_one_thing(thing)):
                    yield where, thing
                elif isinstance(thing, h5py.Group) and thing.id not in seen:
                    seen.add(thing.id)
                    waiting.append((f"{where}/", thing))

    def _variable(self, path: str, thing: Any) -> Variable:
        import h5py

        if thing is None:
            return Variable(path=path, shape=(), kind="a link")
        if isinstance(thing, h5py.Group):
            is_sparse = "MATLAB_sparse" in thing.attrs
            return Variable(path=path, shape=(), kind="a sparse matrix" if is_sparse else "a function handle")
        shape = (0,) if thing.shape is None else tuple(int(n) for n in thing.shape)
        if attribute(thing, "MATLAB_class"):
            shape = (0, 0) if "MATLAB_empty" in thing.attrs else shape[::-1]
        unit = attribute(thing, "unit") or attribute(thing, "units")
        return Variable(path=path, shape=shape, kind=_kind(thing), unit=unit)


def _is_one_thing(group: Any) -> bool:
    """True where MATLAB keeps one variable in a group that is not a struct."""
    return "MATLAB_sparse" in group.attrs or attribute(group, "MATLAB_class") == "function_handle"


def _kind(dataset: Any) -> Kind:
    import h5py

    matlab, dtype = attribute(dataset, "MATLAB_class"), dataset.dtype
    kinds: list[tuple[object, Kind]] = [
        (is_elsewhere(dataset), "data of another file"),
        ("MATLAB_object_decode" in dataset.attrs, "a MATLAB object"),
        (matlab == "cell", "a cell array"),
        (matlab == "function_handle", "a function handle"),
        # a field of a struct array has no class and refers to its elements elsewhere
        (matlab == "struct" or h5py.check_ref_dtype(dtype) is not None, "a struct array"),
        (matlab == "char" or h5py.check_string_dtype(dtype) is not None, "text"),
        (dtype.kind == "c" or dtype.names == ("real", "imag"), "complex numbers"),
        ({"scale_factor", "add_offset"} & set(dataset.attrs), "scaled numbers"),  # as netCDF packs them
        (dtype.kind in "biuf", "numbers"),
    ]
    for fits, kind in kinds:
        if fits:
            return kind
    return "records"


def save_hdf5(record: Record, path: Path) -> None:
    """Write `record` with every name that `load_hdf5` reads."""
    import h5py

    low: Any = h5py
    # In memory first: when a disk is full or goes away, HDF5 itself does not end with an error but with a crash.
    content = BytesIO()
    with h5py.File(content, "w", libver=("v108", "v108")) as file:  # its heads have checksums
        values = file.create_dataset(
            "values", data=record.values, chunks=(1, min(record.n_samples, _BLOCK)), fletcher32=True
        )
        values.attrs["axes"] = "channels, samples"
        for key, orbit in orbit_of(record).items():
            file.create_dataset(key, data=orbit, chunks=orbit.shape, fletcher32=True)
        for key, texts in texts_of(record).items():
            coded = [text.encode() for text in texts]
            dtype = h5py.string_dtype("utf-8", max(1, *map(len, coded)))
            file.create_dataset(key, data=np.array(coded, dtype=dtype), chunks=(len(coded),), fletcher32=True)
        for key, number in numbers_of(record).items():
            properties = low.h5p.create(low.h5p.DATASET_CREATE)
            properties.set_layout(low.h5d.COMPACT)  # within the head, whose checksum guards it
            properties.set_obj_track_times(False)  # the same record makes the same file
            scalar = low.h5s.create(low.h5s.SCALAR)
            dataset = low.h5d.create(file.id, key.encode(), low.h5t.IEEE_F64LE, scalar, properties)
            dataset.write(low.h5s.ALL, low.h5s.ALL, np.array(number, dtype=np.float64))
    path.write_bytes(content.getbuffer())


_LARGEST = (1 << 31) - (1 << 16)
"""Bytes that a variable may have in these files: two gibibytes, less what its head takes."""

_HEAD_TEXT = b"MATLAB 5.0 MAT-file, written by floquid".ljust(116)
"""scipy writes the time of day here; the same record makes the same file."""

_SAVE_AGAIN = "In MATLAB save it again, as in save('run.mat', 'values', 'sample_rate', 'channels', '-v7')."


def load_mat(source: Source, *, channels: Sequence[str] | None, ignore_time: bool) -> Table:
    """The table in a MATLAB file, of version 5 to 7, or 7.3; nothing in it is ever run or made an object of."""
    import h5py

    if h5py.is_hdf5(source.path):
        return load_hdf5(source, channels=channels, ignore_time=ignore_time)
    if not mat_order(source.path):
        refuse_wrong_name(
            source, "a MATLAB file of version 5 to 7.3, not of version 4", f"Copy it again. {_SAVE_AGAIN}"
        )
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
    """Every variable with its path: of a struct, its fields."""
    for name, value in content.items():
        if type(value) is np.ndarray and value.dtype.names and value.size == 1:
            record = value.item()
            yield from _leaves(dict(zip(value.dtype.names, record, strict=True)), f"{stem}{name}/")
        else:
            yield f"{stem}{name}", value


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
    return Variable(path=path, shape=array.shape, kind=by_letter.get(array.dtype.kind, "numbers"))


def save_mat(record: Record, path: Path) -> None:
    """Write `record` with every name that `load_mat` reads, as a file of version 7."""
    import scipy.io

    if record.values.nbytes > _LARGEST:
        must = "have less than 2 GiB of samples to fit a MATLAB file of version 7"
        got = f"has {record.values.nbytes / (1 << 30):.3g} GiB"
        raise input_error("record", "write", must, got, "Write it as .h5, which MATLAB reads, too (h5read).")
    content: dict[str, Any] = {
        "values": record.values,
        **numbers_of(record),
        **orbit_of(record),
    }
    for key, texts in texts_of(record).items():
        content[key] = np.empty(len(texts), dtype=object)
        content[key][:] = texts
    with path.open("wb") as stream:  # savemat would add a suffix of its own to a name
        scipy.io.savemat(stream, content, do_compression=True)
        stream.seek(0)
        stream.write(_HEAD_TEXT)
