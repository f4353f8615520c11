"""NumPy archives: arrays by name, ours being `values` (channels, samples), `sample_rate` or `time`, `channels`, ..."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any
from zipfile import is_zipfile

import numpy as np
from numpy.typing import NDArray

from floquid.core import Record
from floquid.io import Source, refuse_wrong_name
from floquid.readers.variables._by_path import table_of_variables
from floquid.readers.variables._variables import NUMPY, Dialect, Kind, Variable, printable
from floquid.tables import Table, numbers_of, orbit_of, texts_of

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
