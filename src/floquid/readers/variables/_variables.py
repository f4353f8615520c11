"""Files of named variables, as MATLAB and HDF5 have them: what is in one, whatever its format, and how it is told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import prod
from typing import Any, Literal, Protocol

from numpy.typing import NDArray

from floquid._checks import printable
from floquid.io import Source

Kind = Literal[
    "numbers",
    "text",
    "complex numbers",
    "a sparse matrix",
    "a MATLAB object",
    "a function handle",
    "a cell array",
    "a struct array",
    "a link",
    "data of another file",
    "scaled numbers",
    "records",
    "dates",
    "time spans",
    "Python objects",
]

REMEDIES: dict[Kind, str] = {
    "complex numbers": "Save its real part.",
    "a sparse matrix": "Save it as a full matrix, as `full(x)` gives it.",
    "a MATLAB object": "MATLAB alone reads its objects (string, table, timetable, datetime). Convert it there first, "
    "as in `channels = cellstr(channels)` or `values = table2array(values).'`, and save it again.",
    "a cell array": "Save the numbers as one matrix, and names as a cell array of text: {'x', 'y'}.",
    "a struct array": "Save each of its elements as a struct, or as a variable, of its own.",
    "a link": "Links are not followed: name the path that it points to, or read the file that holds it.",
    "data of another file": "Data in other files are not read: save one file that holds them.",
    "dates": "Save numbers, times in seconds, as np.asarray(x, dtype=float) makes them.",
    "time spans": "Save numbers, times in seconds, as np.asarray(x, dtype=float) makes them.",
    "Python objects": "They are never unpickled: save them as np.asarray(x, dtype=float) or dtype=str makes them.",
    "scaled numbers": "They stand for others, by `scale_factor` and `add_offset`: save the values themselves.",
}

_MOST_LISTED = 40
TIME_NAMES = ("time", "Time", "TIME", "t")  # t is as often a torque or a temperature


@dataclass(frozen=True, slots=True, kw_only=True)
class Variable:
    """One variable: its path with slashes, its shape as its own program says it, what it holds, its unit (or none)."""

    path: str
    shape: tuple[int, ...]
    kind: Kind
    unit: str = ""

    @property
    def name(self) -> str:
        """The last word of the path."""
        return self.path.rpartition("/")[2]

    @property
    def levels(self) -> list[str]:
        """Path of the variable, from the innermost group or struct outwards, each ending in a slash; "" is last."""
        words = self.path.split("/")[:-1]
        return ["".join(f"{word}/" for word in words[:depth]) for depth in range(len(words), -1, -1)]

    @property
    def size(self) -> int:
        """The number of elements."""
        return prod(self.shape)

    @property
    def is_vector(self) -> bool:
        """True for numbers along one axis, at least two."""
        return self.kind == "numbers" and self.size >= 2 and max(self.shape) == self.size

    @property
    def is_matrix(self) -> bool:
        """True for numbers along two axes, at least two of each."""
        return self.kind == "numbers" and len(self.shape) == 2 and min(self.shape) >= 2

    @property
    def words(self) -> str:
        """The shape, and what it holds if that is not numbers."""
        shape = " x ".join(map(str, self.shape)) or "1"
        return shape if self.kind == "numbers" else f"{shape}, {self.kind}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Dialect:
    """Expressions of the program that wrote a file: how to `save` a record, and how to turn `values` round."""

    save: str
    turn: str
    row: str
    texts: str


MATLAB = Dialect(
    save="In MATLAB: values = [x; y]; channels = {'x', 'y'}; save('run.mat', 'values', 'sample_rate', 'channels').",
    turn="Rows are channels and columns are samples: save `values.'`.",
    row="Save `values.'` for one channel, which is a row.",
    texts="Save a cell array of text, as in {'x', 'y'}; from a string array, `cellstr` makes one.",
)
HDF5 = Dialect(
    save="Save the datasets `values` (channels, samples), `sample_rate` and `channels` (texts).",
    turn="Time is the last axis: save `values.T` (MATLAB's h5write turns arrays round: give it `values.'`).",
    row="Save `values[None, :]` for one channel.",
    texts="Save a list of texts.",
)
NUMPY = Dialect(
    save="Save it with np.savez(file, values=values, sample_rate=rate, channels=names, units=units).",
    turn="Time is the last axis: save `values.T`.",
    row="Save `values[None, :]` for one channel.",
    texts="Save np.array([...]) of names.",
)


class VariableFile(Protocol):
    """A file that has been opened and whose variables are known; arrays are read one at a time."""

    @property
    def variables(self) -> Mapping[str, Variable]: ...

    @property
    def dialect(self) -> Dialect: ...

    def numbers(self, path: str) -> NDArray[Any]:
        """The array of a variable of numbers, in its shape."""
        ...

    def texts(self, path: str) -> list[str] | None:
        """The texts in a variable, or None if there are other things in it."""
        ...


def numbers(source: Source, file: VariableFile, path: str) -> NDArray[Any]:
    """The array of the variable at `path`."""
    require_numbers(source, file.variables[path])
    return file.numbers(path)


def require_numbers(source: Source, variable: Variable) -> None:
    """Refuse what is not real numbers, with what to do about it."""
    if variable.kind != "numbers":
        remedy = REMEDIES.get(variable.kind, "Save it as a matrix of numbers.")
        raise source.error(f"hold real numbers in `{printable(variable.path)}`", f"has {variable.kind} there", remedy)


def listing(file: VariableFile) -> str:
    """The variables there are, one a line, those of most numbers first."""
    found = sorted(file.variables.values(), key=lambda one: (one.kind != "numbers", -one.size))
    lines = [f"    {printable(one.path)}: {one.words}" for one in found[:_MOST_LISTED]]
    if len(found) > _MOST_LISTED:
        lines.append(f"    and {len(found) - _MOST_LISTED} more")
    return "\n".join(lines)


def example(file: VariableFile) -> str:
    """Paths such as the user may mean by `channels`: the largest variable, and the next ones of its shape."""
    candidates = [
        one for one in file.variables.values() if (one.is_vector or one.is_matrix) and one.name not in TIME_NAMES
    ]
    if not candidates:
        return ""
    first = max(candidates, key=lambda one: one.size)
    if first.is_vector:
        return ",".join(printable(one.path) for one in candidates if one.shape == first.shape and one.is_vector)[:200]
    turned = ".T" if first.shape[0] > first.shape[1] else ""
    return ",".join(f"{printable(first.path)}{turned}[{row}]" for row in range(2))
