"""A file of variables with names of its own: its channels are named by their paths.

`run/acc/x` is a vector of samples, the variable x in the group or struct run/acc (`run.acc.x` will do for a struct).
`data[2]` is row 2 of a matrix (channels, samples), counted from 0, and `data.T[2]` is its column 2, for a matrix
(samples, channels). `data` and `data.T` are all rows, or all columns. A row is never taken for a column by guess. Where
texts stand beside a matrix, as many as it has channels, they are the names of these, and name them.

`Y[1]/Data` is the field Data in element 1 of a struct array, counted from 0; `Y(2)/Data` is the same as MATLAB counts.
`Y` are the vectors in all its elements, each called by the text beside it, such as Y[1]/Name.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from floquid._arrays import Floats
from floquid._checks import input_error
from floquid.core import point_of
from floquid.errors import InputError
from floquid.io import Source
from floquid.readers.variables._by_name import (
    KEYS,
    SCALE,
    TIME_NAMES,
    Variable,
    VariableFile,
    example,
    is_time,
    listing,
    printable,
    require_numbers,
    said_beside,
    samples,
    stated_rate,
    table_by_name,
    time_column,
)
from floquid.tables import Table, TimeColumn, make_channel, says_rate

_LABELS = re.compile("label|channel|name|sensor", re.IGNORECASE)
"""Name of a variable that holds the names of channels, where several might."""

_COUNTED = re.compile(r"\((\d{1,9})\)(?=[/.])")  # an element of a struct array as MATLAB counts them

_PATH = re.compile(r"(?P<path>.+?)(?P<turned>\.T)?(?:\[(?P<row>\d{1,9})\])?")


@dataclass(frozen=True, slots=True, kw_only=True)
class _Row:
    """Row `row` of a variable, turned round or not, under the `name` it is asked by; None is a vector, or all rows."""

    name: str
    variable: Variable
    turned: bool = False
    row: int | None = None


def table_of_variables(
    source: Source, file: VariableFile, *, channels: Sequence[str] | None, ignore_time: bool
) -> Table:
    """The table in a file of variables: by our names if it has them, else by the paths in `channels`."""
    if {"values", "channels"} <= file.variables.keys():
        point = _point_beside(file, file.variables["values"])
        return table_by_name(source, file, channels=channels, ignore_time=ignore_time, point=point)
    return _table_by_path(source, file, channels=channels, ignore_time=ignore_time)


def _table_by_path(source: Source, file: VariableFile, *, channels: Sequence[str] | None, ignore_time: bool) -> Table:
    """The table of the variables that `channels` names by their paths."""
    if channels is None:
        missing = "channels" if "values" in file.variables else "values"
        such = example(file)
        named = f"Name them by `channels=`, as in {such}; without times beside them pass `rate=` [Hz], too. "
        got = f"has no `{missing}` and none is named. It holds:\n{listing(file) or '    nothing'}"
        raise source.error("say which variables are its channels", got, f"{named if such else ''}{file.dialect.save}")
    beside = _times(file)
    rows = [row for word in channels for row in _rows(source, file, beside, _parse(source, file, word))]
    _check_rows(source, rows)
    values = _values(source, file, rows)
    rate, note = _rate(source, file, rows, ignore_time=ignore_time)
    near = {one.path: one for row in rows for one in _nearest(beside, row.variable)}
    named = {row.variable.path: row.name for row in rows}
    times = [one for one in near.values() if one.size == values.shape[1] and one.path not in named]
    if near and not times and rate is None and not ignore_time:
        raise _no_times(source, next(iter(near.values())), named, values.shape[1])
    time = _time(source, file, times) if times and not ignore_time else None
    notes: tuple[str, ...] = ()
    if time is not None:
        notes += (f"Times from `{time.label}`, beside the channels.",)
    elif times:
        notes += ("The times in the file were ignored.",)
    if any(row.row is not None for row in rows):
        notes += ("Rows and columns of a matrix are counted from 0.",)
    if any("]/" in row.name for row in rows):
        notes += ("Elements of a struct array in brackets are counted from 0: Y[0] is MATLAB's Y(1).",)
    return Table(
        values=values,
        channels=tuple(
            make_channel(source, name=row.name, unit=row.variable.unit or said_beside(file, row.variable)[1] or "-")
            for row in rows
        ),
        time=time,
        sample_rate=rate,
        rate_note=note,
        labels=_label_lists(file, rows),
        point=_point_beside(file, rows[0].variable),
        notes=notes,
    )


def _parse(source: Source, file: VariableFile, word: object) -> _Row:
    """The longest path that is in the file comes first: a variable may be called T, or have brackets in its name."""
    text = word.strip() if isinstance(word, str) else ""
    match = _PATH.fullmatch(text)
    if match is not None:
        row = None if match["row"] is None else int(match["row"])
        turned = match["turned"] or ""
        unbracketed = f"{match['path']}{turned}"
        for path, is_turned, its_row in ((text, False, None), (unbracketed, False, row), (match["path"], True, row)):
            variable = _variable_at(file, path.strip("/"))
            if variable is not None and (turned or not is_turned):
                text = text if its_row is None else f"{text[: text.rindex('[')]}[{its_row}]"
                return _Row(name=text, variable=variable, turned=is_turned, row=its_row)
    own = [
        _Row(name=text, variable=one, turned=turned, row=labels.index(text))
        for one in file.variables.values()
        for turned in (False, True)
        if one.is_matrix and text in (labels := _labels(file, one, turned=turned))
    ]
    vectors = (one for one in file.variables.values() if one.is_vector and text)
    own += [_Row(name=text, variable=one) for one in vectors if said_beside(file, one)[0] == text]
    if len(own) == 1:
        return own[0]
    must = "name variables of the file by their paths (it has no `values` and `channels` of ours)"
    got = f"has {word!r}, which is not in {source.path}. It holds:\n{listing(file) or '    nothing'}"
    remedy = "A vector is named by its path, as in run/acc/x; row 2 of a matrix is data[2], and its column 2 data.T[2]."
    raise input_error("channels", source.of, must, got, remedy)


def _variable_at(file: VariableFile, path: str) -> Variable | None:
    """The variable at a path, with dots or with MATLAB's numbers of elements, too; the only element needs none."""
    zeroed = _COUNTED.sub(lambda match: f"[{int(match[1]) - 1}]", path)
    for known in (path, path.replace(".", "/"), zeroed, zeroed.replace(".", "/")):
        for shorter in (known, known.replace("[0]/", "/")):
            if shorter in file.variables:
                return file.variables[shorter]
        if any(one.startswith(f"{known}[0]/") for one in file.variables):
            return Variable(path=known, shape=(), kind="a struct array")  # which has no dataset of its own in HDF5
    return None


def _label_lists(file: VariableFile, rows: Sequence[_Row]) -> dict[str, list[str]]:
    """Names for the rows by every text variable that has one for each row of the matrices they are of, by its path."""
    counts = {row.variable.shape[:: -1 if row.turned else 1][0] for row in rows if row.row is not None}
    found: dict[str, list[str]] = {}
    for one in file.variables.values() if len(counts) < 2 else ():
        texts = file.texts(one.path) if one.kind in ("a cell array", "text") else None
        if texts and len(texts) in (counts or {len(rows)}):
            places = range(len(rows)) if not counts else [row.row for row in rows]
            pairs = zip(places, rows, strict=True)
            found[one.path] = [row.name if place is None else texts[place].strip() for place, row in pairs]
    return found


def _labels(file: VariableFile, matrix: Variable, *, turned: bool) -> list[str]:
    """The texts beside a matrix, one a row, or one a column of it turned; empty where there are none, or several."""
    count = matrix.shape[::-1][0] if turned else matrix.shape[0]
    found = {}
    for one in file.variables.values():
        if one.kind in ("a cell array", "text") and one.levels[0] == matrix.levels[0] and count in one.shape:
            texts = [text.strip() for text in file.texts(one.path) or []]
            if len(texts) == len(set(texts)) == count and all(texts):
                found[one.name] = texts
    told = [name for name in found if _LABELS.search(name)] if len(found) > 1 else list(found)
    return found[told[0]] if len(told) == 1 else []


def _rows(source: Source, file: VariableFile, beside: Mapping[str, list[Variable]], choice: _Row) -> Iterator[_Row]:
    """The channels that one word names: a vector, one or all rows of a matrix, or the vectors of a struct array."""
    variable = choice.variable
    if variable.kind == "a struct array" and choice.row is None:
        inside = re.compile(rf"{re.escape(variable.path)}\[\d+\]/[^/]+")
        vectors = [one for one in file.variables.values() if one.is_vector and inside.fullmatch(one.path)]
        labels = [said_beside(file, one)[0] or one.path for one in vectors]
        chosen = [(label, one) for label, one in zip(labels, vectors, strict=True) if label not in TIME_NAMES]
        if chosen:
            for label, one in chosen:
                yield _Row(name=one.path if labels.count(label) > 1 else label, variable=one)
            return
    require_numbers(source, variable)
    if variable.is_vector and choice.row is None:
        yield replace(choice, turned=False, row=None)
        return
    shape = variable.shape[::-1] if choice.turned else variable.shape
    if len(shape) != 2 or variable.size < 2:
        got = f"has {choice.name!r}, which is {variable.words} in {source.path}"
        remedy = "Leave out the [ ] and the .T of a vector, and single numbers; save an array of more axes as matrices."
        raise input_error("channels", source.of, "name vectors of samples, or rows of matrices", got, remedy)
    if choice.row is not None and choice.row >= shape[0]:
        must = f"name one of the rows 0 to {shape[0] - 1} (counted from 0)"
        got = f"has {choice.name!r} of {variable.words} in {source.path}"
        raise input_error("channels", source.of, must, got, "Choose one of them.")
    if variable.is_vector and shape[0] == 1:  # the only row of a row is all of it
        yield replace(choice, turned=False, row=None)
        return
    _check_direction(source, beside, choice, shape)
    if choice.row is not None:
        yield choice
        return
    labels = _labels(file, variable, turned=choice.turned) or [f"{choice.name}[{row}]" for row in range(shape[0])]
    yield from (replace(choice, name=label, row=row) for row, label in enumerate(labels))


def _check_direction(
    source: Source, beside: Mapping[str, list[Variable]], choice: _Row, shape: tuple[int, ...]
) -> None:
    """Refuse columns of samples that are named as rows: by the times beside them, or by there being more rows."""
    n_rows, n_samples = shape
    lengths = {one.size for one in _nearest(beside, choice.variable)}
    if n_samples in lengths or (n_rows not in lengths and n_rows <= n_samples):
        return
    bare = re.sub(r"\[\d+\]$", "", choice.name)
    other = bare.removesuffix(".T") if choice.turned else f"{bare}.T"
    raise input_error(
        "channels",
        source.of,
        "name rows of samples",
        f"has {choice.name!r} in {source.path}, a row of {n_samples} samples among {n_rows}"
        + (f", and the times beside it are {n_rows}" if n_rows in lengths else ""),
        f"If time runs the other way write {other!r}, or {other + '[0]'!r} for the first. Where there really are more "
        "channels than samples, put a vector `time` of one time a sample beside them.",
    )


def _check_rows(source: Source, rows: Sequence[_Row]) -> None:
    """Refuse channels that are one, or that differ in length."""
    seen: dict[object, str] = {}
    for row in rows:
        for key in (row.name, (row.variable.path, row.turned, row.row)):
            if key in seen:
                must, got = "name each variable once", f"has {seen[key]!r} and {row.name!r}, which are one"
                if row.name == seen[key]:
                    must, got = "name each channel once", f"has {row.name!r} twice"
                raise input_error("channels", source.of, must, f"{got} in {source.path}", "Leave one of them out.")
            seen[key] = row.name
    first = rows[0]
    for row in rows:
        if _length(row) != _length(first):
            got = f"has {first.name!r} of {_length(first)} samples and {row.name!r} of {_length(row)} in {source.path}"
            remedy = "Choose channels of one measurement; resample first what was sampled at another rate."
            raise input_error("channels", source.of, "name channels of one length, sampled together", got, remedy)


def _length(row: _Row) -> int:
    if row.row is None:
        return row.variable.size
    return row.variable.shape[0 if row.turned else 1]


def _values(source: Source, file: VariableFile, rows: Sequence[_Row]) -> Floats:
    """The samples (channels, samples), each variable read once."""
    values = np.empty((0, 0))
    places: dict[str, list[int]] = {}
    for place, row in enumerate(rows):
        places.setdefault(row.variable.path, []).append(place)
    with np.errstate(over="ignore"):  # a long double too large becomes infinite, and is refused as such
        for path, wanted in places.items():
            array = samples(source, file, path)
            if not values.size:  # not before: that there is so much of it has now been checked
                values = np.empty((len(rows), _length(rows[0])))
            for place in wanted:
                row = rows[place]
                matrix = array.T if row.turned else array
                values[place] = array.reshape(-1) if row.row is None else matrix[row.row]
    return values


def _times(file: VariableFile) -> dict[str, list[Variable]]:
    """The vectors of times in the file, by the level that they are at."""
    found: dict[str, list[Variable]] = {}
    for one in file.variables.values():
        if is_time(file, one):  # one in a struct of its own is a time of the level above
            found.setdefault(one.levels[one.name not in TIME_NAMES], []).append(one)
    return found


def _nearest(beside: Mapping[str, list[Variable]], variable: Variable) -> list[Variable]:
    """The vectors of times at the level of `variable`, or else at the nearest level above it that has one."""
    return next((beside[level] for level in variable.levels if level in beside), [])


def _no_times(source: Source, time: Variable, named: Mapping[str, str], n_samples: int) -> InputError:
    """Times that are there but cannot be those of the channels."""
    if time.path in named:
        got = f"has {named[time.path]!r}, which are the times by their name in {source.path}"
        must = "leave out the times"
        return input_error("channels", source.of, must, got, "If they are none, pass `rate=` [Hz], too.")
    must = "have one time a sample beside its channels"
    got = f"has {time.size} in `{printable(time.path)}` for {n_samples} samples"
    return source.error(must, got, "Save the times of these samples, or pass `rate=` [Hz] to ignore them.")


def _time(source: Source, file: VariableFile, times: Sequence[Variable]) -> TimeColumn:
    """The times of the channels, which must be the same wherever they are."""
    columns = [time_column(source, file, one.path, one.size) for one in times]
    for column in columns:
        if column.scale != columns[0].scale or not np.array_equal(column.values, columns[0].values, equal_nan=True):
            must = "have one vector of times for the channels named"
            remedy = "Choose channels of one measurement, or pass `rate=` [Hz] to ignore the times."
            raise source.error(must, f"has others in `{columns[0].label}` than in `{column.label}`", remedy)
    return columns[0] if times[0].unit not in ("", "-") else replace(columns[0], scale=None)


def _rate(
    source: Source, file: VariableFile, rows: Sequence[_Row], *, ignore_time: bool
) -> tuple[float | None, str | None]:
    """The rate that numbers beside the channels state, and a sentence on it."""
    if ignore_time:
        return None, None
    found = {}
    for variable in {row.variable.path: row.variable for row in rows}.values():
        stated = stated_rate(source, file, variable)
        if stated is not None:
            found.setdefault(stated.rate, stated)
    if len(found) > 1:
        stated = " and ".join(f"{one.rate:.12g} Hz in `{printable(one.path)}`" for one in list(found.values())[:2])
        must = "state one rate for the channels named"
        raise source.error(must, f"states {stated}", "Choose channels of one measurement, or pass `rate=` [Hz].")
    return next(((one.rate, one.note) for one in found.values()), (None, None))


def _point_beside(file: VariableFile, variable: Variable) -> dict[str, float]:
    """The single finite numbers at the level of a `variable` and above, by name, without rates, times and scales."""
    found: dict[str, float] = {}
    for level in variable.levels:
        for one in file.variables.values():
            if one.levels[0] == level and one.name not in found and _is_quantity(one):
                with np.errstate(over="ignore"):  # a long double too large becomes infinite
                    found[one.name] = float(file.numbers(one.path).reshape(()))
    return point_of(found)


def _is_quantity(variable: Variable) -> bool:
    """True for a single number whose name says no rate, time, scale or word of ours."""
    name = variable.name
    known = name in (*KEYS, *TIME_NAMES) or says_rate(name) or SCALE.search(name)
    return variable.kind == "numbers" and variable.size == 1 and not known
