"""One linearisation file of OpenFAST (`.lin`): what it says of the rotor and the states, and its matrices A, B, C, D.

The layout is that of the writers in FAST 8 and OpenFAST 1 to 5 (`WrLinFile_txt_Head`, `WrLinFile_txt_Table` and
`WrPartialMatrix`): a header of `key: value` lines, tables under «Order of …», and blocks under «A: 20 x 20». Old
tables lack the columns «Rotating Frame?» and «Derivative Order»; the operating point of an orientation is three
numbers with commas; a number that did not fit its format is a row of asterisks, or has lost its E (1.0-101).
"""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, final

import numpy as np

from floquid._arrays import Floats
from floquid._checks import Rebuilt, input_error
from floquid._show import Brief
from floquid.errors import InputError
from floquid.io import readable_file

_AGAIN = "Let OpenFAST write the file again, or copy it again in full."
_NUMBER = re.compile(r"([+-]?(?:\d{1,40}\.?\d{0,40}|\.\d{1,40}))(?:[EeDdQq]([+-]?\d{1,4})|([+-]\d{2,4}))?")
_BLOCK = re.compile(r"\s*([A-Za-z_]\w*)\s*:\s*(\d{1,9})\s*x\s*(\d{1,9})\s*", re.IGNORECASE)
_OTHER_BLOCK = re.compile(r"\s*(?![ABCD]\s*:)[A-Za-z_][\w ]*:")


@final
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LinSignals(Brief):
    """States, inputs or outputs of a linearisation, by what the file says of each.

    Parameters
    ----------
    names
        The descriptions, without the unit (signals,). They need not differ: some releases repeat them.
    units
        The units, "" where the file has none (signals,).
    rotating
        Which of them are in the rotating frame (signals,); None in files too old to say.
    derivative_orders
        The highest order of derivative in the equation each belongs to: 2 for displacements and velocities, 1 for a
        state alone, 0 for what is no state (signals,); None in files too old to say.
    """

    names: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    rotating: tuple[bool, ...] | None = None
    derivative_orders: tuple[int, ...] | None = None

    def without(self, index: int) -> LinSignals:
        """All of them but the one at `index`."""
        kept: dict[str, tuple[Any, ...] | None] = {}
        for field in fields(self):
            values = getattr(self, field.name)
            kept[field.name] = None if values is None else values[:index] + values[index + 1 :]
        return replace(self, **kept)


@final
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LinFile(Rebuilt):
    """A linearisation file, as it says it; None for what it does not say.

    Parameters
    ----------
    path
        The file.
    description
        The title of the model.
    time
        The instant of the linearisation [s].
    rotor_speed
        The speed of the rotor [rad/s].
    azimuth
        The azimuth of the rotor, as stated [rad].
    wind_speed
        The wind speed [m/s].
    states, inputs, outputs
        What the rows and columns of the matrices are.
    state_values, state_rates
        The operating point x (n,) and its rate of change (n,); NaN for a number that did not fit its format.
    A, B, C, D
        The matrices (n, n), (n, inputs), (outputs, n), (outputs, inputs).
    """

    path: Path
    description: str
    time: float | None
    rotor_speed: float | None
    azimuth: float | None
    wind_speed: float | None
    states: LinSignals
    inputs: LinSignals
    outputs: LinSignals
    state_values: Floats
    state_rates: Floats | None
    A: Floats | None
    B: Floats | None
    C: Floats | None
    D: Floats | None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Text:
    """The lines of a file that is being read by the callable `of`, whose argument named it."""

    file: Path
    lines: list[str]
    of: str
    argument: str

    def error(self, index: int | None, got: str, remedy: str = _AGAIN) -> InputError:
        """The message that names the file and the line (`index` counts from 0)."""
        where = f"{self.file}" if index is None else f"line {index + 1} of {self.file}"
        return input_error(self.argument, self.of, "name linearisation files of OpenFAST", f"{where} {got}", remedy)

    def starting(self, title: str) -> int | None:
        """The first line that begins with `title` (in small letters)."""
        return next((i for i, line in enumerate(self.lines) if line.strip().lower().startswith(title)), None)


def read_lin(path: object, *, of: str = "floquet.read_lin", argument: str = "path") -> LinFile:
    """One linearisation file of OpenFAST.

    `path` is the file; messages name the callable `of` and its `argument`. Raises InputError where there is no such
    file, it is no linearisation file, or it ends early. So it does where a line is not the one due there. The message
    names the file and the line.
    """
    text = _open(path, of, argument)
    header = _header(text)
    sizes = {kind: _count(text, header, kind) for kind in ("continuous states", "inputs", "outputs")}
    states, state_values = _table(text, "order of continuous states:", sizes["continuous states"])
    n_rates = sizes["continuous states"] if text.starting("order of continuous state derivatives:") is not None else 0
    _, state_rates = _table(text, "order of continuous state derivatives:", n_rates)
    # Before the matrices, whose sizes are those of these tables: a header may lie.
    inputs, outputs = (_table(text, f"order of {kind}:", sizes[kind])[0] for kind in ("inputs", "outputs"))
    matrices = _matrices(text, *sizes.values())
    return LinFile(
        path=text.file,
        description=header.get("description from the fast input file", (0, ""))[1],
        time=_quantity(text, header, "simulation time", "s"),
        rotor_speed=_quantity(text, header, "rotor speed", "rad/s"),
        azimuth=_quantity(text, header, "azimuth", "rad"),
        wind_speed=_quantity(text, header, "wind speed", "m/s"),
        states=states,
        inputs=inputs,
        outputs=outputs,
        state_values=state_values,
        state_rates=state_rates if n_rates else None,
        **{name: matrices.get(name) for name in "ABCD"},
    )


def number(token: str) -> float | None:
    """The number that Fortran wrote, NaN if it is one or asterisks, None if `token` is no number."""
    match = _NUMBER.fullmatch(token)
    if match:
        return float(f"{match[1]}e{match[2] or match[3] or 0}")
    word = token.lower().lstrip("+-")
    if word in ("inf", "infinity"):
        return -np.inf if token.startswith("-") else np.inf
    return np.nan if word == "nan" or (token and not token.strip("*")) else None


def _open(path: object, of: str, argument: str) -> _Text:
    file = readable_file(path, of=of, argument=argument)
    must = "name linearisation files of OpenFAST"
    try:
        content = file.read_bytes()
    except OSError as error:
        got = f"{file} cannot be read ({error.strerror or error})"
        raise input_error(argument, of, must, got, "Check the disk and its permissions.") from None
    if b"\0" in content:
        raise input_error(argument, of, must, f"{file} is not a text (it holds NUL bytes)", "Name `.lin` files.")
    try:
        decoded = content.decode("utf-8")
    except UnicodeDecodeError:
        decoded = content.decode("latin-1")
    lines = decoded.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    return _Text(file=file, lines=lines, of=of, argument=argument)


def _header(text: _Text) -> dict[str, tuple[int, str]]:
    """The lines `key: value` above the first table, by their keys in small letters: line index and value."""
    end = text.starting("order of ")
    header: dict[str, tuple[int, str]] = {}
    for index, line in enumerate(text.lines[: min(200, len(text.lines) if end is None else end)]):
        key, colon, value = line.partition(":")
        if colon:
            header.setdefault(" ".join(key.lower().split()), (index, value.strip()))
    if "number of continuous states" not in header:
        got = "has no line «Number of continuous states:» above its first table"
        raise text.error(None, got, "Name `.lin` files that OpenFAST wrote (FAST 8.16 or later).")
    return header


def _count(text: _Text, header: dict[str, tuple[int, str]], kind: str) -> int:
    index, value = header.get(f"number of {kind}", (0, "0"))
    if not re.fullmatch(r"\d{1,9}", value):
        raise text.error(index, f"must end in the number of {kind}, but ends in {value[:40]!r}")
    return int(value)


def _quantity(text: _Text, header: dict[str, tuple[int, str]], key: str, unit: str) -> float | None:
    """The number under `key` in the unit due; None where there is none, or it did not fit its format."""
    if key not in header:
        return None
    index, value = header[key]
    words = value.split()
    read = number(words[0]) if words else None
    if read is None or words[1:] not in ([], [unit]):
        raise text.error(index, f"must state the {key} in {unit}, but states {value[:40]!r}")
    return float(read) if np.isfinite(read) else None


def _table(text: _Text, title: str, count: int) -> tuple[LinSignals, Floats]:
    """The `count` rows of the table under `title`: what the signals are, and their operating points."""
    if not count:
        return LinSignals(), np.empty(0)
    start = text.starting(title)
    if start is None:
        raise text.error(None, f"announces {count} and has no table «{title.capitalize()[:-1]}»")
    head = text.lines[start + 1].lower() if start + 1 < len(text.lines) else ""
    if "operating point" not in head:
        raise text.error(start + 1, "must be the head of a table, with the column «Operating Point»")
    flagged, ordered = "rotating frame?" in head, "derivative order" in head
    names, units, rotating, orders, values = [], [], [], [], np.empty(min(count, len(text.lines)))
    for row in range(count):
        index = start + 3 + row
        words = text.lines[index].split() if index < len(text.lines) else []
        if not words:
            raise text.error(index, f"must be row {row + 1} of {count} of «{title.capitalize()[:-1]}», but is missing")
        values[row], words = _operating_point(text, index, words)
        if flagged:
            if not words or words[0] not in ("T", "F"):
                raise text.error(index, "must say T or F under «Rotating Frame?»")
            rotating.append(words.pop(0) == "T")
        if ordered:
            if not words or not re.fullmatch(r"\d{1,3}", words[0]):
                raise text.error(index, "must have an integer under «Derivative Order»")
            orders.append(int(words.pop(0)))
        # «ED Rotor thrust, (kN)»: a last part of several words is no unit.
        description = " ".join(words)
        name, comma, unit = description.rpartition(", ")
        bare = not comma or " " in unit or not unit
        names.append(description if bare else name)
        units.append("" if bare else unit[1:-1] if unit.startswith("(") and unit.endswith(")") else unit)
    after = start + 3 + count
    if after < len(text.lines) and text.lines[after].strip():
        raise text.error(after, f"must be blank, after the {count} rows that the header announces")
    signals = LinSignals(
        names=tuple(names),
        units=tuple(units),
        rotating=tuple(rotating) if flagged else None,
        derivative_orders=tuple(orders) if ordered else None,
    )
    return signals, values


def _operating_point(text: _Text, index: int, words: list[str]) -> tuple[float, list[str]]:
    """The operating point of a row (NaN for the three numbers of an orientation), and the words after it."""
    last = 1
    while last < len(words) and words[last].endswith(","):
        last += 1
    values = [number(word.rstrip(",")) for word in words[1 : last + 1]]
    if words[0].strip("*0123456789") or not values or None in values:
        raise text.error(index, "must begin with the number of the row and its operating point")
    point = values[0] if len(values) == 1 and values[0] is not None else np.nan
    return float(point), words[last + 1 :]


def _matrices(text: _Text, n_states: int, n_inputs: int, n_outputs: int) -> dict[str, Floats]:
    """The blocks A, B, C and D under «Linearized state matrices:» that are there and not empty."""
    shapes = {
        "A": (n_states, n_states),
        "B": (n_states, n_inputs),
        "C": (n_outputs, n_states),
        "D": (n_outputs, n_inputs),
    }
    found: dict[str, Floats] = {}
    start = text.starting("linearized state matrices")
    index = len(text.lines) if start is None else start + 1
    while index < len(text.lines):
        line = text.lines[index]
        block = _BLOCK.fullmatch(line)
        if block:
            name, rows, columns = block[1], int(block[2]), int(block[3])
            if name in shapes:
                if name in found or (rows, columns) != shapes[name]:
                    due = f"{shapes[name][0]} x {shapes[name][1]}, once, by the numbers in the header"
                    raise text.error(index, f"announces {name}: {rows} x {columns}, which must be {due}")
                if rows and columns:
                    found[name] = _block(text, name, index + 1, rows, columns)
            index += 1 + rows
        elif not line.strip():
            index += 1
        elif _OTHER_BLOCK.match(line):
            index += 1
            while index < len(text.lines) and number((text.lines[index].split() or ["-"])[0]) is not None:
                index += 1
        else:
            raise text.error(index, f"is neither blank nor the head of a matrix: {line.strip()[:40]!r}")
    return found


def _block(text: _Text, name: str, start: int, rows: int, columns: int) -> Floats:
    """The matrix whose rows are the lines from `start` on; a fault is named by its row and column."""
    if start + rows == len(text.lines):
        raise text.error(start + rows - 1, f"ends without a line end, maybe inside a number of {name}")
    lines = text.lines[start : start + rows]
    if len(lines) == rows and all(line.strip() for line in lines):
        with suppress(ValueError):  # a number as only Fortran writes it, or a fault, which the slow way finds
            values = np.loadtxt(lines, dtype=np.float64, comments=None, ndmin=2)
            if values.shape == (rows, columns) and np.isfinite(values).all():
                return values
    out: list[list[float]] = []
    for row in range(rows):
        words = lines[row].split() if row < len(lines) else []
        if len(words) != columns:
            got = f"has {len(words)} numbers, where row {row + 1} of {name} has {columns}"
            raise text.error(min(start + row, len(text.lines) - 1), got)
        out.append([])
        for column, word in enumerate(words):
            value = number(word)
            if value is None or not np.isfinite(value):
                got = f"has {word[:40]!r} in row {row + 1}, column {column + 1} of {name}, which is no number"
                remedy = "Asterisks are numbers too wide for the format: give `OutFmt` of the FAST input more digits."
                raise text.error(start + row, got, remedy if "*" in word else _AGAIN)
            out[-1].append(value)
    return np.array(out)
