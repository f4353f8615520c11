"""HDF5 files as files of named variables, and records as such files.

No link is followed, and no data are read that are in other files. Files of MATLAB 7.3 are HDF5; how MATLAB keeps arrays
and texts there is known to `floquid.io`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Floats
from floquid._checks import printable
from floquid.core import Record
from floquid.io import Source, array_in, attribute, is_elsewhere, refuse_wrong_name, texts_in
from floquid.readers.variables._by_name import HDF5, MATLAB, SCALE, Dialect, Kind, Variable, VariableFile, refuse_counts
from floquid.readers.variables._by_path import table_of_variables
from floquid.tables import Table, numbered, numbers_of, orbit_of, says_rate, texts_of

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


class Arrays:
    """Arrays that have been read, by their paths; of one of Python objects there is nothing."""

    def __init__(self, source: Source, arrays: Mapping[str, NDArray[Any]], dialect: Dialect) -> None:
        self._source = source
        self._arrays = arrays
        self.variables = {key: _variable(key, array) for key, array in arrays.items()}
        self.dialect = dialect

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


def _variable(path: str, array: NDArray[Any]) -> Variable:
    letter = array.dtype.kind
    return Variable(path=path, shape=array.shape, kind=_KINDS.get(letter, "records"), is_counted=letter in "iu")


if TYPE_CHECKING:
    import h5py

_BLOCK = 1 << 16
_MATLAB_S_OWN = ("#refs#", "#subsystem#")


def load_hdf5(source: Source, *, channels: Sequence[str] | None, ignore_time: bool) -> Table:
    """The table in an HDF5 file, or a MATLAB file of version 7.3."""
    import h5py

    if not h5py.is_hdf5(source.path):
        refuse_wrong_name(source, "an HDF5 file", "Copy it again, or name it by its format.")
    with source.taken_apart("HDF5 file", "Copy or save it again."), h5py.File(source.path, "r") as opened:
        plain = Hdf5File(opened)
        is_gtsdf = attribute(opened, "type").lower() == "general time series data format"
        file: VariableFile = _gtsdf(source, opened, plain) if is_gtsdf else plain
        if is_gtsdf and channels is not None:
            channels = [name for word in channels for name in _by_column(word, file.texts("channels") or [])]
        return table_of_variables(source, file, channels=channels, ignore_time=ignore_time)


def _gtsdf(source: Source, opened: Any, plain: Hdf5File) -> Arrays:
    """Samples and names of a file as HAWC2 writes it, the General Time Series Data Format of DTU, under our names."""
    # There are blocks of samples, one after the other. Whole numbers are times `gains` plus `offsets`, and the largest
    # of their type is missing. The times are `time`, or else the number of the sample, times `time_step` plus
    # `time_start`.
    levels = sorted(match[1] for path in plain.variables if (match := re.fullmatch(r"(block\d{4,}/)data", path)))
    if not levels:
        raise source.error("hold samples", "has no `block0000/data`", "Write it again.")
    values = [_block(plain, level) for level in levels]
    arrays: dict[str, Any] = {"values": values[0] if len(values) == 1 else np.concatenate(values, axis=1)}
    names = plain.texts("attribute_names") if "attribute_names" in plain.variables else None
    arrays["channels"] = numbered(names or [f"ch{row}" for row in range(1, len(values[0]) + 1)])
    if "attribute_units" in plain.variables:
        arrays["units"] = [unit or "-" for unit in plain.texts("attribute_units") or []]
    said = [opened[level].attrs for level in levels]
    if "time_step" in said[0] and len(levels) == 1 and "block0000/time" not in plain.variables:
        arrays |= {"time_step": said[0]["time_step"], "start": said[0].get("time_start", 0.0)}
    elif "time_step" in said[0] or "block0000/time" in plain.variables:
        arrays["time"] = np.concatenate([
            (plain.numbers(f"{level}time") if f"{level}time" in plain.variables else np.arange(block.shape[1]))
            * attributes.get("time_step", 1.0) + attributes.get("time_start", 0.0)
            for level, block, attributes in zip(levels, values, said, strict=True)
        ])  # fmt: skip
    return Arrays(source, {key: np.asarray(array) for key, array in arrays.items()}, HDF5)


def _by_column(word: str, names: Sequence[str]) -> list[str]:
    """The names of what `block0000/data.T` or a column of it asks for; another word is a name itself."""
    match = re.fullmatch(r"block\d{4,}/data\.T(?:\[(\d+)\])?", word) if isinstance(word, str) else None
    if match is None or int(match[1] or 0) >= len(names):
        return [word]
    return list(names) if match[1] is None else [names[int(match[1])]]


def _block(plain: Hdf5File, level: str) -> Floats:
    """The quantities of the block at a level (channels, samples)."""
    raw = plain.numbers(f"{level}data").T
    values = raw.astype(np.float64, order="C")
    if raw.dtype.kind in "iu":
        values[np.equal(raw, np.iinfo(raw.dtype).max)] = np.nan
    for name, combine in (("gains", np.multiply), ("offsets", np.add)):
        if f"{level}{name}" in plain.variables:
            combine(values, plain.numbers(f"{level}{name}").reshape(-1, 1), out=values)
    return values


class Hdf5File:
    """The variables of an open file; nothing is read before it is asked for.

    Numbers among the attributes that may be a rate or a scale are variables below the dataset or the group.
    """

    def __init__(self, file: h5py.File) -> None:
        self._file: Any = file  # what is at a path is checked in `_walk`
        self.variables: dict[str, Variable] = {}
        self._elements: dict[str, Any] = {}  # of struct arrays, which are elsewhere in the file
        matlab = False
        for path, thing in self._walk():
            self.variables[path] = self._variable(path, thing)
            matlab = matlab or (thing is not None and attribute(thing, "MATLAB_class") != "")
        self._attributes = dict(self._numbers_beside())
        for path, array in self._attributes.items():
            if path not in self.variables:
                self.variables[path] = Variable(path=path, shape=array.shape, kind="numbers")
        self.dialect: Dialect = MATLAB if matlab else HDF5

    def numbers(self, path: str) -> NDArray[Any]:
        """The array of a variable of numbers, in its shape."""
        if not self.variables[path].size:
            return np.zeros(self.variables[path].shape)
        return self._attributes[path] if path in self._attributes else _quantity(self._thing(path))

    def texts(self, path: str) -> list[str] | None:
        """The texts in a dataset, the rows of a character array, or the texts in a cell array."""
        return texts_in(self._thing(path))

    def _thing(self, path: str) -> Any:
        return self._elements[path] if path in self._elements else self._file[path or "/"]

    def _walk(self) -> Iterator[tuple[str, Any]]:
        """Every dataset with its path, and a group that MATLAB makes of one thing; of a link None."""
        # Groups are entered by hard links alone, and each but once.
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
                    for element, place in _elements(path, name, thing):
                        if isinstance(element, h5py.Dataset):
                            self._elements[place] = element
                            yield place, element
                        elif element.id not in seen:
                            seen.add(element.id)
                            waiting.append((f"{place}/", element))
                elif isinstance(thing, h5py.Group) and thing.id not in seen:
                    seen.add(thing.id)
                    waiting.append((f"{where}/", thing))

    def _numbers_beside(self) -> Iterator[tuple[str, NDArray[Any]]]:
        """Numbers in the attributes of what is there, by the path that they would have as variables."""
        paths = [path for path, variable in self.variables.items() if variable.kind != "a link"]
        groups = {level for path in paths if "[" not in path for level in self.variables[path].levels}
        for path in (*paths, *groups):
            thing = self._thing(path)
            for name in thing.attrs:
                if name in _PACKING or not (says_rate(name) or SCALE.search(name)):
                    continue
                value = np.asarray(thing.attrs[name])
                if value.dtype.kind in "biuf" and value.size and value.ndim < 2:
                    yield f"{path.rstrip('/')}/{name}".lstrip("/"), value

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
        is_counted = thing.dtype.kind in "iu" and not _PACKING & set(thing.attrs)
        return Variable(path=path, shape=shape, kind=_kind(thing), unit=unit, is_counted=is_counted)


_PACKING = {"scale_factor", "add_offset"}
_MISSING = {"_FillValue", "missing_value"}


def refuse_packed(source: Source, opened: h5py.File, dataset: h5py.Dataset) -> None:
    """Refuse a dataset whose numbers are not the quantities themselves: packed ones, or counts beside their scale."""
    said = sorted((_PACKING | _MISSING) & set(dataset.attrs))
    if said:
        must, got = "hold the quantities themselves, to be read in parts", f"has the attribute `{said[0]}`"
        raise source.error(must, got, "Read it whole, without `lazy=True`, and write it again.")
    refuse_counts(source, Hdf5File(opened), str(dataset.name).lstrip("/"))


def _quantity(dataset: Any) -> NDArray[Any]:
    """The numbers of a dataset, those that netCDF packs as the quantities that they stand for, NaN where missing."""
    array, attributes = array_in(dataset), dataset.attrs
    missing = [attributes[name] for name in sorted(_MISSING) if name in attributes]
    if not missing and not _PACKING & set(attributes):
        return array
    lost = np.isin(array, np.concatenate([np.ravel(value) for value in missing])) if missing else None
    values = array.astype(np.float64)
    values *= attributes.get("scale_factor", 1.0)
    values += attributes.get("add_offset", 0.0)
    if lost is not None:
        values[lost] = np.nan
    return values


def _elements(level: str, name: str, field: Any) -> Iterator[tuple[Any, str]]:
    """The values of a field in a struct array, each with its path: Data in Y/ is Y[0]/Data and so on."""
    import h5py

    if not (level and isinstance(field, h5py.Dataset) and h5py.check_ref_dtype(field.dtype) is h5py.Reference):
        return
    if attribute(field, "MATLAB_class") or attribute(field.parent, "MATLAB_class") != "struct" or is_elsewhere(field):
        return
    for number, reference in enumerate(array_in(field).ravel()):
        if reference:
            yield field.file[reference], f"{level.rstrip('/')}[{number}]/{name}"


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
        for key, number in {**record.point, **numbers_of(record)}.items():
            properties = low.h5p.create(low.h5p.DATASET_CREATE)
            properties.set_layout(low.h5d.COMPACT)  # within the head, whose checksum guards it
            properties.set_obj_track_times(False)  # the same record makes the same file
            scalar = low.h5s.create(low.h5s.SCALAR)
            dataset = low.h5d.create(file.id, key.encode(), low.h5t.IEEE_F64LE, scalar, properties)
            dataset.write(low.h5s.ALL, low.h5s.ALL, np.array(number, dtype=np.float64))
    path.write_bytes(content.getbuffer())
