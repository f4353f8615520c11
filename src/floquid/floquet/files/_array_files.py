"""Arrays by name from NumPy archives, MATLAB files, HDF5, JSON, and floquid's own results."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from floquid._checks import input_error, printable
from floquid.errors import InputError
from floquid.io import DamagedError, array_in, attribute, is_elsewhere, letters, load_variables, mat_order, texts_in

OF = "floquet.read_matrix"
NAMES = ("A", "coefficients", "harmonics", "period", "times", "edges", "states")

_LISTED = 40


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Contents:
    """The arrays under the names that count, and the names of all that the file holds."""

    path: Path
    arrays: dict[str, Any]
    names: tuple[str, ...]
    result: bool = False
    """True for a result of `floquid identify`, whose A is (times, n, n)."""

    def error(self, must: str, got: str, remedy: str = "") -> InputError:
        """The message «Argument `paths` of `floquet.read_matrix` must …, but rotor.npz …»."""
        return input_error("paths", OF, must, f"{self.path} {got}", remedy)

    def listing(self) -> str:
        """The names that there are."""
        shown = ", ".join(f"`{printable(name)}`" for name in self.names[:_LISTED]) or "nothing"
        return shown + (f" and {len(self.names) - _LISTED} more" if len(self.names) > _LISTED else "")


def contents(path: Path) -> Contents:
    """The arrays of the file at `path`; nothing in it is ever unpickled or run."""
    loaders = {".npz": _npz, ".mat": _mat, ".h5": _hdf5, ".hdf5": _hdf5, ".json": _json}
    load: Callable[[Path], Contents] | None = loaders.get(path.suffix.lower())
    bare = Contents(path=path, arrays={}, names=())
    if load is None:
        must = "end in .npz, .mat, .h5, .hdf5, .json or .lin"
        raise input_error("paths", OF, must, f"is {path}", "Save A(t) in one of these, and name it by its format.")
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


def _npz(path: Path) -> Contents:
    with path.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in NAMES if name in archive}
        return Contents(path=path, arrays=arrays, names=tuple(archive))


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
        of, result = Contents(path=path, arrays={}, names=names), attribute(file, "format") == "floquid-result"
        places = {name: name for name in NAMES if name in names}
        if result:
            places = {"A": "state/system", "times": "state/times", "states": "state/states", "period": "model/period"}
            if not isinstance(_thing(file, "state"), h5py.Group):  # a dataset without content stands for None
                raise _no_system(of, "result")
        arrays = {name: _array(_thing(file, place), place) for name, place in places.items()}
    return Contents(path=path, arrays=arrays, names=names, result=result)


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


def _array(dataset: Any, name: str) -> Any:
    """An array of numbers, or the texts of a dataset."""
    import h5py

    if not isinstance(dataset, h5py.Dataset) or dataset.shape is None:
        raise DamagedError(f"`{name}` in it is no array")
    if is_elsewhere(dataset):
        raise DamagedError(f"`{name}` is kept in another file")
    texts = texts_in(dataset)
    if texts is not None:
        return texts
    if dataset.dtype.kind not in "biufc" and dataset.dtype.names != ("real", "imag"):
        raise DamagedError(f"`{name}` in it is neither numbers nor text")
    return array_in(dataset)


def _mat(path: Path) -> Contents:
    import h5py

    if h5py.is_hdf5(path):
        return _hdf5(path)
    if not mat_order(path):
        raise DamagedError("it has not the mark of version 5 to 7.3")
    found = load_variables(path)
    arrays: dict[str, Any] = {}
    for name in NAMES:
        if name in found:
            texts = letters(found[name])
            arrays[name] = found[name] if texts is None else texts
            if texts is None and (type(found[name]) is not np.ndarray or found[name].dtype.kind not in "biufc"):
                more = "MATLAB's string arrays become text by `cellstr`"
                raise DamagedError(f"`{name}` is neither numbers nor text; {more}")
    return Contents(path=path, arrays=arrays, names=tuple(found))
