"""What files of arrays hold, by name: NumPy archives, MATLAB files, HDF5, JSON, and floquid's own results."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from io import BytesIO
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from floquid._checks import input_error, printable
from floquid.core._hdf5_limits import check_found, check_size
from floquid.core._hdf5_texts import HeapTexts
from floquid.core._npy import read_array, read_head
from floquid.errors import InputError
from floquid.floquet._mat_file import DamagedError, read_variables

OF = "floquet.read_matrix"
NAMES = ("A", "coefficients", "harmonics", "period", "times", "edges", "states")

_LARGEST = 1 << 30
"""Bytes of a file or of an array in it: A(t) of 1000 states at 128 instants."""

_LISTED = 40
_MOST_TEXTS, _MOST_LETTERS = 10_000, 1 << 20


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Contents:
    """What was found under the names that count, and the names of all that is there."""

    path: Path
    arrays: dict[str, Any]
    names: tuple[str, ...]
    result: bool = False
    """Whether it is a result of `floquid identify`: A is then (times, n, n)."""

    def error(self, must: str, got: str, remedy: str = "") -> InputError:
        """The message «Argument `paths` of `floquet.read_matrix` must …, but rotor.npz …»."""
        return input_error("paths", OF, must, f"{self.path} {got}", remedy)

    def listing(self) -> str:
        """The names that there are."""
        shown = ", ".join(f"`{printable(name)}`" for name in self.names[:_LISTED]) or "nothing"
        return shown + (f" and {len(self.names) - _LISTED} more" if len(self.names) > _LISTED else "")


def contents(path: Path) -> Contents:
    """What `path` holds; nothing in it is ever unpickled or run.

    Raises
    ------
    InputError
        The file is of no kind that is read, is not what its name says, is too large, damaged or cut short.
    """
    loaders = {".npz": _npz, ".mat": _mat, ".h5": _hdf5, ".hdf5": _hdf5, ".json": _json}
    load: Callable[[Path], Contents] | None = loaders.get(path.suffix.lower())
    bare = Contents(path=path, arrays={}, names=())
    if load is None:
        must = "end in .npz, .mat, .h5, .hdf5, .json or .lin"
        raise input_error("paths", OF, must, f"is {path}", "Save A(t) in one of these, and name it by its format.")
    if path.stat().st_size > _LARGEST:
        raise bare.error("be of at most 1 GiB", f"has {path.stat().st_size / _LARGEST:.3g} GiB", _LESS)
    try:
        return load(path)
    except InputError:
        raise
    except Exception as error:  # noqa: BLE001  # damage raises anything: zlib.error, struct.error, KeyError, ...
        known = isinstance(error, DamagedError)
        what = str(error) if known else f"{type(error).__name__}: {error}".splitlines()[0]
        must = f"be a whole {_KINDS[path.suffix.lower()]}"
        got = f"is none, is damaged or cut short ({printable(what)})"
        raise bare.error(must, got, "Copy or save it again, and name it by its format.") from None


_KINDS = {
    ".npz": "NumPy archive",
    ".mat": "MATLAB file",
    ".h5": "HDF5 file",
    ".hdf5": "HDF5 file",
    ".json": "JSON file",
}
_LESS = "Save A(t) alone, at as many instants as it takes to resolve it."


def _bounded(name: str, n_bytes: int) -> None:
    if n_bytes > _LARGEST:
        raise DamagedError(f"`{name}` declares {n_bytes / _LARGEST:.3g} GiB, more than the 1 GiB that is read")


def _npz(path: Path) -> Contents:
    arrays: dict[str, Any] = {}
    with zipfile.ZipFile(path) as archive:
        members = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
        for name in NAMES:
            if name in members:
                _bounded(name, members[name].file_size)
                data = BytesIO(archive.read(members[name]))
                if data.read(6) != b"\x93NUMPY":
                    raise DamagedError(f"`{name}` in it is no array")
                data.seek(0)
                read_head(data)
                data.seek(0)
                arrays[name] = read_array(data)
    return Contents(path=path, arrays=arrays, names=tuple(members))


def _json(path: Path) -> Contents:
    found = json.loads(path.read_text(encoding="utf-8"))
    if not isinstance(found, dict):
        raise DamagedError("it is no object with names")
    names = tuple(map(str, found))
    arrays = {name: found[name] for name in NAMES if found.get(name) is not None}
    kind = str(found.get("format", ""))
    if not kind.startswith("floquid-"):
        return Contents(path=path, arrays=arrays, names=names)
    system = found.get("system")
    if not isinstance(system, dict):
        raise _no_system(Contents(path=path, arrays={}, names=names), kind)
    arrays = {"A": system["values"], "times": system["times"], "states": system["states"], "period": found["period"]}
    return Contents(path=path, arrays=arrays, names=names, result=True)


def _no_system(of: Contents, kind: str) -> InputError:
    remedy = "Run `floquid identify` with --states, which reconstructs A(t), and give its summary.json."
    return of.error("hold A(t)", f"is a {printable(kind)} without one", remedy)


def _hdf5(path: Path) -> Contents:
    import h5py

    if not h5py.is_hdf5(path):
        raise DamagedError("it has not the mark of one")
    with h5py.File(path, "r") as file:
        names = tuple(name for name in map(str, file) if not name.startswith("#"))
        held = _Hdf5(
            of=Contents(path=path, arrays={}, names=names), file=file, heap=HeapTexts(path, file.userblock_size)
        )
        if held.heap.attribute(file, "format") == "floquid-result":
            return _result(held)
        return replace(held.of, arrays={name: held.array(name) for name in NAMES if name in names})


def _result(held: _Hdf5) -> Contents:
    """A(t) in the `result.h5` of `floquid identify`."""
    if not held.is_group("state"):  # a dataset without content stands for None
        raise _no_system(held.of, "result")
    places = {"A": "state/system", "times": "state/times", "states": "state/states", "period": "model/period"}
    return replace(held.of, arrays={name: held.array(place) for name, place in places.items()}, result=True)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Hdf5:
    """An open HDF5 file, of which no link is followed and nothing is read that it declares and has not."""

    of: Contents
    file: Any
    heap: HeapTexts

    def thing(self, name: str) -> Any:
        """What is at a path, by hard links alone."""
        import h5py

        found = self.file
        for word in name.split("/"):
            if not isinstance(found, h5py.Group) or word not in found:
                raise DamagedError(f"it has no `{name}`")
            if not isinstance(found.get(word, getlink=True), h5py.HardLink):
                raise DamagedError(f"`{name}` in it is a link, which is not followed")
            if self.heap.is_virtual(found, word):
                raise DamagedError(f"`{name}` is kept in another file")
            found = found[word]
        return found

    def is_group(self, name: str) -> bool:
        """Whether there is a group of that name."""
        import h5py

        return isinstance(self.thing(name), h5py.Group)

    def array(self, name: str) -> Any:
        """An array of numbers or texts; that of a MATLAB file turned round, as it is kept."""
        import h5py

        dataset = self.thing(name)
        if not isinstance(dataset, h5py.Dataset) or dataset.shape is None:
            raise DamagedError(f"`{name}` in it is no array")
        self.check(dataset, name)
        if h5py.check_string_dtype(dataset.dtype) is not None:
            return self.texts(dataset, name)
        kind = self.heap.attribute(dataset, "MATLAB_class")
        if h5py.check_ref_dtype(dataset.dtype) is not None and kind:
            if prod(dataset.shape) > _MOST_TEXTS:
                raise DamagedError(f"`{name}` has more texts than names ever are")
            if self.heap.refer_to_virtual(dataset):
                raise DamagedError("a cell array in it holds other things than texts")
            return [self.codes(self.file[one], name) for one in np.asarray(dataset[()]).T.ravel(order="F")]
        if dataset.dtype.kind not in "biufc" and dataset.dtype.names != ("real", "imag"):
            raise DamagedError(f"`{name}` in it is neither numbers nor text")
        values = np.asarray(dataset[()])
        check_found(self.of, dataset, name, values)
        if not kind:
            return values
        if values.dtype == np.uint16 and kind == "char":
            return [_text(row) for row in np.atleast_2d(values.T)]
        if values.dtype.names == ("real", "imag"):
            values = values["real"] + 1j * values["imag"]
        return values.T

    def texts(self, dataset: Any, name: str) -> list[str]:
        """The texts of a dataset of strings."""
        import h5py

        if dataset.size > _MOST_TEXTS or dataset.id.get_storage_size() > _MOST_LETTERS:
            raise DamagedError(f"`{name}` has more text than names ever are")
        fixed = h5py.check_string_dtype(dataset.dtype).length is not None
        found = np.asarray(dataset[()]).ravel().tolist() if fixed else self.heap.of_dataset(dataset)
        return [text.decode() for text in found]

    def codes(self, cell: Any, name: str) -> str:
        """The text in a cell, which is kept as codes of UTF-16."""
        import h5py

        if not isinstance(cell, h5py.Dataset) or cell.dtype != np.uint16 or prod(cell.shape) > _MOST_LETTERS:
            raise DamagedError("a cell array in it holds other things than texts")
        self.check(cell, name)
        return "" if "MATLAB_empty" in cell.attrs else _text(np.asarray(cell[()]).ravel())

    def check(self, dataset: Any, name: str) -> None:
        """Refuse what is kept elsewhere, is larger than is read, or declares more than there is of it."""
        if dataset.external:
            raise DamagedError(f"`{name}` is kept in another file")
        _bounded(name, prod(dataset.shape) * dataset.dtype.itemsize)
        if dataset.size and not dataset.id.get_storage_size():
            raise DamagedError(f"nothing was written to `{name}`")
        check_size(self.of, dataset, name, self.of.path.stat().st_size)


def _text(codes: NDArray[np.uint16]) -> str:
    return np.ascontiguousarray(codes, dtype="<u2").tobytes().decode("utf-16-le").rstrip(" ")


def _mat(path: Path) -> Contents:
    import h5py

    if h5py.is_hdf5(path):
        return _hdf5(path)
    arrays, names = read_variables(path.read_bytes(), NAMES)
    return Contents(path=path, arrays=arrays, names=names)
