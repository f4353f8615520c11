"""Arrays by their names as a file of variables."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from floquid._checks import printable
from floquid.io import Source
from floquid.readers.variables._by_name import Dialect, Kind, Variable

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
