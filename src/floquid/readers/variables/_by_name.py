"""Files of named variables, of any format, and those with our names: `values`, `channels`, `sample_rate` or `time`, ...

What is refused is told in the file's dialect.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import prod
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Floats
from floquid._checks import describe, printable
from floquid.core import channels_named
from floquid.io import Source
from floquid.tables import SECONDS, Table, TimeColumn, make_channels, rate_stated, says_rate

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
    "a struct array": "Name the numbers in its elements, as in `Y[0]/Data`, or save them as variables of their own.",
    "a link": "Links are not followed: name the path that it points to, or read the file that holds it.",
    "data of another file": "Data in other files are not read: save one file that holds them.",
    "dates": "Save numbers, times in seconds, as np.asarray(x, dtype=float) makes them.",
    "time spans": "Save numbers, times in seconds, as np.asarray(x, dtype=float) makes them.",
    "Python objects": "They are never unpickled: save them as np.asarray(x, dtype=float) or dtype=str makes them.",
}

SCALE = re.compile("gain|scal|slope|offset|intercept|sensitiv|calib", re.IGNORECASE)
"""Names of numbers that make counts a quantity, in a way that they do not say."""

_OFFSET = re.compile("offset|intercept", re.IGNORECASE)
_MOST_LISTED = 40
TIME_NAMES = ("time", "Time", "TIME", "t")  # t is as often a torque or a temperature


@dataclass(frozen=True, slots=True, kw_only=True)
class Variable:
    """One variable: its path with slashes, its shape as its own program says it, what it holds, its unit (or none).

    `is_counted` is true of whole numbers: a scale may make them a quantity.
    """

    path: str
    shape: tuple[int, ...]
    kind: Kind
    unit: str = ""
    is_counted: bool = False

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


def samples(source: Source, file: VariableFile, path: str) -> NDArray[Any]:
    """The array of the variable at `path`, refused where it has counts and a scale stands beside them."""
    refuse_counts(source, file, path)
    return file.numbers(path)


def refuse_counts(source: Source, file: VariableFile, path: str) -> None:
    """Refuse the variable at `path` where it has counts and a scale stands beside them."""
    variable = file.variables[path]
    require_numbers(source, variable)
    for one in file.variables.values() if variable.is_counted else ():
        beside = SCALE.search(one.name) and one.levels[0] in (f"{path}/", variable.levels[0]) and one.path != path
        if beside and one.kind == "numbers" and one.size in (1, *variable.shape):
            scale = file.numbers(one.path)
            if (scale != (0 if _OFFSET.search(one.name) else 1)).any():
                got = f"has counts in `{printable(path)}`, and beside them `{printable(one.path)}`"
                remedy = "Save the quantities themselves, as in counts * gain + offset; or rename it if it is no scale."
                raise source.error("hold the quantities that were measured", got, remedy)


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
    candidates = [one for one in file.variables.values() if (one.is_vector or one.is_matrix) and not is_time(file, one)]
    if not candidates:
        return ""
    first = max(candidates, key=lambda one: one.size)
    array = re.match(r"(.+?)\[\d+\]/", first.path)
    if array is not None and first.is_vector and said_beside(file, first)[0]:
        return printable(array[1])
    if first.is_vector:
        return ",".join(printable(one.path) for one in candidates if one.shape == first.shape and one.is_vector)[:200]
    turned = ".T" if first.shape[0] > first.shape[1] else ""
    return ",".join(f"{printable(first.path)}{turned}[{row}]" for row in range(2))


def said_beside(file: VariableFile, variable: Variable) -> tuple[str, str]:
    """The name and the unit of a vector in a struct of its own, by the texts beside it; empty where there are none."""
    beside = [one for one in file.variables.values() if one.levels[0] == variable.levels[0] and one is not variable]
    if not variable.levels[0] or any(one.kind == "numbers" and one.size > 1 for one in beside):
        return "", ""
    texts = {one.name.lower(): one.path for one in beside if one.kind in ("text", "a cell array")}
    found = []
    for words in (("name", "label", "channel", "title", "signal"), ("unit", "units")):
        path = next((texts[word] for word in words if word in texts), None)
        rows = (file.texts(path) or []) if path is not None else []
        found.append(rows[0].strip() if len(rows) == 1 else "")
    return found[0], found[1]


def is_time(file: VariableFile, variable: Variable) -> bool:
    """True for a vector that is called a time, by its own name or by the text beside it."""
    return variable.is_vector and (variable.name in TIME_NAMES or said_beside(file, variable)[0] in TIME_NAMES)


_WORDS = ("units", "quantities", "locations", "directions", "places")
KEYS = ("values", "sample_rate", "time", "channels", *_WORDS, "start", "period", "origin", "orbit")
"""The names that are ours."""


def table_by_name(
    source: Source, file: VariableFile, *, channels: Sequence[str] | None, ignore_time: bool, point: Mapping[str, float]
) -> Table:
    """The table in a file that holds `values` and `channels`, at the operating `point` that it states."""
    held = file.variables
    names = _texts(source, file, "channels")
    values = _values(source, file, len(names))
    words = {key: _texts(source, file, key, len(names)) if key in held else None for key in _WORDS}
    units = words["units"] or ([held["values"].unit] * len(names) if held["values"].unit else None)
    places = {key: words[f"{key}s"] for key in ("location", "direction", "place")}
    named = make_channels(source, names, units, quantity=words["quantities"], **places)
    orbit = None
    if "orbit" in held:
        orbit = _orbit(source, numbers(source, file, "orbit"), len(names))
    if channels is not None:
        chosen = channels_named(named, channels, argument="channels", of=source.of)
        values, named = values[chosen], tuple(named[row] for row in chosen)
        orbit = None if orbit is None else orbit[chosen]
    stated = None if "sample_rate" in held or "time" in held else stated_rate(source, file, held["values"])
    rate, note = (scalar(source, file, "sample_rate"), None) if stated is None else (stated.rate, stated.note)
    others = [path for path in held if path not in (*KEYS, *point) and (stated is None or path != stated.path)]
    notes = tuple(f"The file also holds `{printable(path)}`, which is not used." for path in others[:20])
    if len(others) > 20:
        notes += (f"It holds {len(others) - 20} more that are not used.",)
    time = None
    if "time" in held and ignore_time:
        notes += ("The times in the file were ignored.",)
    elif "time" in held:
        time = time_column(source, file, "time", values.shape[1])
    return Table(
        values=values,
        channels=named,
        time=time,
        orbit=orbit,
        notes=notes,
        sample_rate=rate,
        rate_note=note,
        start=scalar(source, file, "start"),
        period=scalar(source, file, "period"),
        origin=scalar(source, file, "origin"),
        point=point,
    )


def time_column(source: Source, file: VariableFile, path: str, n_samples: int) -> TimeColumn:
    """The times at `path`, a row or a column of them."""
    array = numbers(source, file, path)
    if array.size == max(array.shape, default=0):
        array = array.reshape(-1)
    if array.shape != (n_samples,):
        must = f"have `time` of shape (samples,) with {n_samples} samples, as in `values`"
        raise source.error(must, f"has shape {array.shape} there", "Save one time a sample [s].")
    unit = file.variables[path].unit
    scale = SECONDS.get(unit) if unit not in ("", "-") else 1.0
    if scale is None:
        must, got = "have its times in one of s, ms, us, ns, min, h", f"has `{printable(path)}` in {unit!r}"
        raise source.error(must, got, "Save the times as numbers in seconds, or pass `rate=` [Hz] to ignore them.")
    kept = array if array.dtype == np.float32 else array.astype(np.float64)
    return TimeColumn(values=kept, scale=scale, label=printable(path))


def scalar(source: Source, file: VariableFile, path: str) -> float | None:
    """The number at `path` [Hz] if it is a `sample_rate`, else [s]; None if there is none."""
    variable = file.variables.get(path)
    if variable is None:
        return None
    unit = "Hz" if variable.name == "sample_rate" else "s"
    if variable.unit not in ("", "-", unit):
        remedy = f"Save it in {unit}{', or pass `rate=` [Hz]' if unit == 'Hz' else ''}."
        raise source.error(f"have `{printable(path)}` in {unit}", f"has it in {variable.unit!r}", remedy)
    array = numbers(source, file, path)
    must_be_positive = variable.name in ("sample_rate", "period")
    number = float(array.reshape(())) if array.size == 1 and array.dtype.kind in "iuf" else np.nan
    if not np.isfinite(number) or (must_be_positive and number <= 0.0):
        got = f"{array.reshape(())[()]!s}" if array.size == 1 else describe(array)
        must = f"hold one finite{' positive' if must_be_positive else ''} number in `{variable.name}`"
        remedy = "Mend it, or leave it out and pass `rate=` [Hz]." if unit == "Hz" else "Mend it, or leave it out."
        raise source.error(must, f"has {got} there", remedy)
    return number


@dataclass(frozen=True, slots=True, kw_only=True)
class StatedRate:
    """A sampling rate [Hz], the path of the number that states it, and a sentence on that if its name is not ours."""

    rate: float
    path: str
    note: str | None


def stated_rate(source: Source, file: VariableFile, variable: Variable) -> StatedRate | None:
    """The rate that a number beside a variable states, on the variable itself or at its level or the nearest above."""
    for level in (f"{variable.path}/", *variable.levels):
        path = f"{level}sample_rate"
        rate = scalar(source, file, path)
        if rate is not None:
            return StatedRate(rate=rate, path=path, note=None)
        found = list(_rates(file, level))
        if found:
            apart = next((one for one in found if abs(one.rate / found[0].rate - 1.0) > 1e-6), None)
            if apart is not None:
                got = " and ".join(f"{one.rate:.12g} Hz in `{printable(one.path)}`" for one in (found[0], apart))
                raise source.error("state one rate", f"states {got}", "Pass `rate=` [Hz] to say which is right.")
            return found[0]
    return None


def _rates(file: VariableFile, level: str) -> Iterator[StatedRate]:
    """The rates that single numbers at a level state by their names, such as `fs` or `dt`."""
    for one in file.variables.values():
        if one.kind == "numbers" and one.size == 1 and one.levels[0] == level and says_rate(one.name):
            number = float(file.numbers(one.path).reshape(()).real)
            rate = rate_stated(one.name, number, one.unit) if 0.0 < number < np.inf else None
            if rate is not None and 0.0 < rate < np.inf:
                note = f"Sampling rate {rate:.12g} Hz: by `{printable(one.path)}` in the file."
                yield StatedRate(rate=rate, path=one.path, note=note)


def _orbit(source: Source, array: Floats, n_channels: int) -> Floats:
    if array.ndim != 2 or array.shape[0] != n_channels or not array.shape[1] or not np.isfinite(array).all():
        must = f"have `orbit` of shape (channels, phases) with {n_channels} channels, all finite"
        got = f"has shape {array.shape} there" + ("" if np.isfinite(array).all() else ", not all of it finite")
        raise source.error(must, got, "Save one period of the orbit a channel, or leave it out.")
    return np.asarray(array, np.float64)


def _values(source: Source, file: VariableFile, n_channels: int) -> Floats:
    require_numbers(source, file.variables["values"])
    shape = file.variables["values"].shape
    if len(shape) != 2 or shape[0] != n_channels:
        if len(shape) == 1 or (n_channels == 1 and shape[1:] == (1,)):
            remedy = file.dialect.row
        elif len(shape) == 2 and shape[1] == n_channels:
            remedy = file.dialect.turn
        else:
            remedy = "Save one record a file." if len(shape) != 2 else "Name every row of `values` in `channels`."
        must = f"have `values` of shape (channels, samples) with {n_channels} channels, as in `channels`"
        raise source.error(must, f"has shape {shape} there", remedy)
    with np.errstate(over="ignore"):  # a long double too large becomes infinite, and is refused as such
        return samples(source, file, "values").astype(np.float64, order="C", copy=False)


_NOT_HELD = ("a MATLAB object", "a link", "data of another file", "Python objects")
"""Kinds whose content a file does not give away: text cannot be made of it here."""


def _texts(source: Source, file: VariableFile, key: str, count: int | None = None) -> list[str]:
    variable = file.variables[key]
    texts = file.texts(key) if variable.kind in ("text", "a cell array") else None
    if not texts or (count is not None and len(texts) != count):
        what = (
            variable.words + (", numbers" if variable.kind == "numbers" else "") if texts is None else describe(texts)
        )
        must = f"hold one text a channel{'' if count is None else f' ({count})'} in `{key}`"
        got = f"has {variable.kind if variable.kind in _NOT_HELD else what} there"
        raise source.error(must, got, REMEDIES[variable.kind] if variable.kind in _NOT_HELD else file.dialect.texts)
    return texts
