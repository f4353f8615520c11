"""Arrays by name from NumPy archives, MATLAB files, HDF5, JSON, and floquid's own results."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from floquid._checks import input_error, printable
from floquid.io import (
    GUARD,
    DamagedError,
    Source,
    array_in,
    attribute,
    is_elsewhere,
    letters,
    load_variables,
    mat_order,
    texts_in,
)

OF = "floquet.read_matrix"
NAMES = ("A", "coefficients", "harmonics", "period", "times", "edges", "states", "C", "outputs")

_LISTED = 40


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Contents(Source):
    """The arrays under the names that count, and the names of all that the file holds.

    `result` is true for a result of `floquid identify`, whose A is (times, n, n).
    """

    arrays: Mapping[str, Any]
    names: tuple[str, ...]
    result: bool = False

    def listing(self) -> str:
        """The names that there are."""
        shown = ", ".join(f"`{printable(name)}`" for name in self.names[:_LISTED]) or "nothing"
        return shown + (f" and {len(self.names) - _LISTED} more" if len(self.names) > _LISTED else "")


def contents(path: Path) -> Contents:
    """The arrays of the file at `path`; nothing in it is ever unpickled or run."""
    loaders: dict[str, tuple[str, Callable[[Path], Contents]]] = {
        ".npz": ("NumPy archive", _npz),
        ".mat": ("MATLAB file", _mat),
        ".h5": ("HDF5 file", _hdf5),
        ".hdf5": ("HDF5 file", _hdf5),
        ".json": ("JSON file", _json),
    }
    if path.suffix.lower() not in loaders:
        must = "end in .npz, .mat, .h5, .hdf5, .json or .lin"
        raise input_error("paths", OF, must, f"is {path}", "Save A(t) in one of these, and name it by its format.")
    kind, load = loaders[path.suffix.lower()]
    with _contents(path).taken_apart(kind, "Copy or save it again, and name it by its format."):
        try:
            return GUARD.call(path, load, path) if load in (_hdf5, _mat) else load(path)
        except MemoryError as error:  # a header that lies about its size
            raise ValueError(f"MemoryError: {error}") from None


def _contents(path: Path, arrays: Mapping[str, Any] | None = None, names: Iterable[str] = (), **more: bool) -> Contents:
    return Contents(of=OF, argument="paths", name=str(path), arrays=arrays or {}, names=tuple(names), **more)


def _npz(path: Path) -> Contents:
    with path.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
        return _contents(path, {name: archive[name] for name in NAMES if name in archive}, archive)


def _json(path: Path) -> Contents:
    found = json.loads(path.read_text(encoding="utf-8"))
    if not isinstance(found, dict):
        raise DamagedError("it is no object with names")
    kind = str(found.get("format", ""))
    if not kind.startswith("floquid-"):
        return _contents(path, {name: found[name] for name in NAMES if found.get(name) is not None}, map(str, found))
    system = found.get("system")
    if not isinstance(system, dict):
        raise _no_system(path, kind)
    arrays = {"A": system["values"], "times": system["times"], "states": system["states"], "period": found["period"]}
    return _contents(path, arrays, map(str, found), result=True)


def _no_system(path: Path, kind: str) -> Exception:
    remedy = "Run `floquid identify` with --states, which reconstructs A(t), and give its summary.json."
    return _contents(path).error("hold A(t)", f"is a {printable(kind)} without one", remedy)


def _hdf5(path: Path) -> Contents:
    import h5py

    if not h5py.is_hdf5(path):
        raise DamagedError("it has not the mark of one")
    with h5py.File(path, "r") as file:
        names = tuple(name for name in map(str, file) if not name.startswith("#"))
        result = attribute(file, "format") == "floquid-result"
        places = {name: name for name in NAMES if name in names}
        if result:
            places = {"A": "state/system", "times": "state/times", "states": "state/states", "period": "model/period"}
            if "state" not in file:
                raise _no_system(path, "result")
        return _contents(path, {name: _array(file, place) for name, place in places.items()}, names, result=result)


def _thing(file: Any, name: str) -> Any:
    """The object at a path inside a file, by hard links alone."""
    import h5py

    found = file
    for word in name.split("/"):
        if not isinstance(found, h5py.Group) or word not in found:
            raise DamagedError(f"it has no `{name}`")
        if not isinstance(found.get(word, getlink=True), h5py.HardLink):
            raise DamagedError(f"`{name}` in it is a link, which is not followed")
        found = found[word]
    return found


def _array(file: Any, name: str) -> Any:
    """An array of numbers, or the texts of a dataset."""
    import h5py

    dataset = _thing(file, name)
    if not isinstance(dataset, h5py.Dataset) or dataset.shape is None:
        raise DamagedError(f"`{name}` in it is no array")
    if is_elsewhere(dataset):
        raise DamagedError(f"`{name}` is kept in another file")
    texts = texts_in(dataset)
    if texts is None and dataset.dtype.kind not in "biufc" and dataset.dtype.names != ("real", "imag"):
        raise DamagedError(f"`{name}` in it is neither numbers nor text")
    return array_in(dataset) if texts is None else texts


def _mat(path: Path) -> Contents:
    import h5py

    if h5py.is_hdf5(path):
        return _hdf5(path)
    if not mat_order(path):
        raise DamagedError("it has not the mark of version 5 to 7.3")
    found = load_variables(path)
    arrays: dict[str, Any] = {}
    for name in [name for name in NAMES if name in found]:
        texts = letters(found[name])
        if texts is None and (type(found[name]) is not np.ndarray or found[name].dtype.kind not in "biufc"):
            raise DamagedError(f"`{name}` is neither numbers nor text; MATLAB's strings become text by `cellstr`")
        arrays[name] = found[name] if texts is None else texts
    return _contents(path, arrays, found)
