"""The layout of a text table: how its lines are parted, its names and units, and what is stated above the numbers.

Every program writes a head of its own: lines of words, units beside the names or below them, `#` before all of it. The
first two rows of numbers are looked for; the names are right above them, as many as the cells.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import takewhile, zip_longest

from floquid.errors import InputError
from floquid.io import Source
from floquid.tables import find_time, name_and_unit, rate_stated, says_rate

RECORD_LINE = "# floquid record: "  # begin of the line that says what a table has no place for
_MOST_ABOVE = 100  # lines of words above the numbers, at most

_DAY = r"\d{4}[-/]\d\d[-/]\d\d"
_DATE = re.compile(rf"{_DAY}(?:[T ]\d\d:\d\d(?::\d\d(?:[.,]\d+)?)?)? ?(?:Z|UTC|[+-]\d\d:?\d\d)?")
_EQUATION = re.compile(r".+=\s*[-+.\deE]+\s*[A-Za-z]*")
_VALUE = re.compile(r"([-+]?[\d.,]+(?:[eE][-+]?\d+)?)\s*([A-Za-z/]*)")
_UNITS = {"volt": "V", "volts": "V", "ampere": "A", "amps": "A", "second": "s", "seconds": "s", "sequence": "-"}
"""Units as analysers spell them out below the names; a sequence counts rows."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Parting:
    """The `mark` between cells, empty for blanks; and what to replace in each line first, a pattern and its text."""

    mark: str
    mend: tuple[re.Pattern[str], str] | None = None

    def mended(self, line: str) -> str:
        """A `line` with what the mark would part joined."""
        return line if self.mend is None else self.mend[0].sub(self.mend[1], line)

    def cells(self, line: str) -> list[str]:
        """The cells of one line, stripped."""
        line = self.mended(line)
        if not self.mark:
            return line.split()
        if '"' in line:
            return [cell.strip() for cell in next(csv.reader([line], delimiter=self.mark, skipinitialspace=True))]
        return [cell.strip() for cell in line.split(self.mark)]


_DAY_AND_TIME = re.compile(rf"(?i)({_DAY}|\bdate|\bdatum)\s*[,;\t]\s*(?=\d\d:\d\d|time|zeit|uhrzeit)")
_PARTINGS = (
    *(Parting(mark=mark) for mark in ",;\t"),
    Parting(mark=",", mend=(re.compile(r"(:\d\d),(?=\d+\s*,)"), r"\1.")),  # the fraction of a date
    Parting(mark=""),
    Parting(mark="", mend=(re.compile(rf"({_DAY})\s+(?=\d\d:\d\d)"), r"\1T")),
    *(Parting(mark=mark, mend=(_DAY_AND_TIME, r"\1 ")) for mark in ",;\t"),
)
"""The ways to part lines, the likeliest first; those that mend join a date that the mark would part."""

_OF_NAMES: tuple[Callable[[str], list[str]], ...] = (
    *(parting.cells for parting in _PARTINGS[:3]),
    str.split,
    lambda line: [cell.replace("\0", " ") for cell in re.sub(r"\s+(?=[\[(])", "\0", line).split()],
    lambda line: re.split(r"\s{2,}|\t", line.strip()),
)
"""The ways to part a line of names over rows parted by blanks: `time, x`, `Time (s) x (m)`, `Tip x   Tip y`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """The layout of a text table."""

    parting: Parting  # How its lines are parted
    # The name of each column with its unit in brackets, and the line that they are in; 0 where the file has none
    labels: tuple[str, ...]
    top: int
    # The line of the first row, and its cells. Lines count from 1.
    first: int
    row: tuple[str, ...]
    comments: tuple[str, ...] = ()  # The lines above it that begin with `#`
    # The sampling rate stated above it [Hz], and where; None and empty without one
    rate: float | None = None
    rate_note: str = ""
    notes: tuple[str, ...] = ()  # Sentences on what was read past

    def cells(self, line: str) -> list[str]:
        """The cells of a row, without empty ones behind its last column."""
        cells = self.parting.cells(line)
        while len(cells) > len(self.labels) and cells[-1] == "":
            cells.pop()
        return cells


@dataclass(frozen=True, slots=True, kw_only=True)
class _Names:
    """Names and the units below them, which may be empty, of the columns, and of what is stated behind these."""

    names: Sequence[str]
    units: Sequence[str]
    top: int
    above: int
    stated: Sequence[str] = ()


_Lines = Sequence[tuple[int, str]]


def find_layout(source: Source, lines: Iterator[tuple[int, str]], *, header: bool) -> Layout:
    """The layout of a text of these numbered `lines`; without a `header` its columns are called 1, 2, 3."""
    words, comments = _head(lines)
    if not words:
        raise source.error("hold a header row and samples", "holds nothing but comments", "Export it again.")
    bare: list[Layout] = []
    for parting in _PARTINGS:
        place, rows = _first_rows(words, parting)
        if not rows:
            continue
        number = words[place][0]
        remarks = [line for line in comments if line[0] < number]
        if found := _names_above(source, words[:place], remarks, parting, rows) if header else None:
            return _named(found, parting, (number, rows[0]), [*words[:place], *remarks])
        labels = tuple(str(column + 1) for column in range(len(rows[0])))
        bare.append(Layout(parting=parting, labels=labels, top=0, first=number, row=tuple(rows[0])))
    if bare and not header:
        return max(bare, key=lambda layout: len(layout.labels))
    return _on_trust(source, words, comments)


def _head(lines: Iterator[tuple[int, str]]) -> tuple[_Lines, _Lines]:
    """The first lines that are not blank, those of comments apart."""
    words: list[tuple[int, str]] = []
    comments: list[tuple[int, str]] = []
    for number, line in lines:
        if line.strip():
            (comments if is_comment(line) else words).append((number, line.rstrip("\n")))
        if len(words) > _MOST_ABOVE + 2:
            break
    return words, comments


def _first_rows(words: _Lines, parting: Parting) -> tuple[int, list[list[str]]]:
    """The place and the cells of the first two rows of numbers and dates, or of the last line alone; or none."""
    before: list[str] = []
    for place, (_, line) in enumerate(words):
        cells = parting.cells(line)
        is_row = any(cells) and all(is_number(cell) or is_date(cell) for cell in cells)
        if is_row and before and len(_filled(cells)) <= len(before) and len(_filled(before)) <= len(cells):
            return place - 1, [before, cells]
        before = cells if is_row else []
    return len(words) - 1, [before] if before else []


def _filled(cells: Sequence[str]) -> list[str]:
    """The cells up to the last that is not empty."""
    last = max((place for place, cell in enumerate(cells) if cell), default=-1)
    return list(cells[: last + 1])


def _names_above(
    source: Source, words: _Lines, comments: _Lines, parting: Parting, rows: Sequence[Sequence[str]]
) -> _Names | None:
    """The names right above the `rows`, or in a comment there; None where neither has as many as these have cells."""
    ways = [parting.cells] if parting.mark else _OF_NAMES
    own = _names_in(words, ways, rows)
    if own is not None:
        names, above = own.names, own.above
        parts = [name_and_unit(name) for name in names]
        if above and find_time(source, parts)[0] is None and not any(unit for _, unit in parts):
            raise _unclear(source, above, own.top)
        return own
    last = words[-1][0] if words else 0
    remarks = [(number, line.lstrip("#% ")) for number, line in comments if number > last and RECORD_LINE not in line]
    found = _names_in(remarks, ways, rows)
    if found is None:  # NumPy's `savetxt` writes a header as it is told, whatever parts the cells
        found = _names_in(remarks, _OF_NAMES, rows)
        if found is None or find_time(source, [name_and_unit(name) for name in found.names])[0] is None:
            return None
    return found if len(found.names) > 1 else None


def _names_in(
    lines: _Lines, ways: Sequence[Callable[[str], list[str]]], rows: Sequence[Sequence[str]]
) -> _Names | None:
    """The names, as many as the cells of the `rows`, in the last of the `lines`, or in the one before it over units."""
    if not lines:
        return None
    top, line = lines[-1]
    for part in ways:
        names = _filled(part(line))
        before = _filled(part(lines[-2][1])) if len(lines) > 1 else []
        units, above = [""] * len(names), 0
        if 0 < len(before) == len(names) and not _is_filled_number(before[0]):
            above = lines[-2][0]
            if _are_units(names, before):
                names, units, top, above = before, names, above, 0
            elif any(map(_is_filled_number, before)):
                above = 0
        alone = len(names) == 1 and re.search(r"[,;\t]", line)  # parted by another mark
        n_behind = sum(1 for _ in takewhile(_is_no_column, reversed(names)))
        for n_names in () if alone else (len(names) - n_behind, len(names)):
            fit = n_names and all(len(_filled(row)) <= n_names <= len(row) for row in rows)
            numbered = any(map(_is_filled_number, names[: 1 if any(units) else n_names]))
            if fit and not numbered:
                stated = [f"{n} = {u}" if u else n for n, u in zip(names[n_names:], units[n_names:], strict=True)]
                return _Names(names=names[:n_names], units=units[:n_names], top=top, above=above, stated=stated)
    return None


def _is_filled_number(cell: str) -> bool:
    return cell != "" and is_number(cell)


def _is_no_column(name: str) -> bool:
    """True of what stands behind the names and is none: `Increment` over its number, `Comment`, `tInc = 1e-6`."""
    return name.lower() in ("start", "comment") or says_rate(name) is not None or bool(_EQUATION.fullmatch(name))


def _are_units(cells: Sequence[str], names: Sequence[str]) -> bool:
    """True where each of the `cells` is a unit, known or in brackets; or a number below a name that states one."""
    return any(cells) and all(
        (is_number(cell) and (cell == "" or _is_no_column(name)))
        or cell.lower() in _UNITS
        or re.fullmatch(r"\(.*\)|\[.*\]", cell) is not None
        or name_and_unit(f"x ({cell})")[1] is not None
        for cell, name in zip(cells, names, strict=True)
    )


def _named(found: _Names, parting: Parting, first: tuple[int, Sequence[str]], head: _Lines) -> Layout:
    """The layout of rows with names, and what is stated in the lines above them."""
    below = [re.sub(r"^[\[(](.*)[\])]$", r"\1", unit).strip() for unit in found.units]
    above = [cells for _, line in head if (cells := parting.cells(line))[:1] == ["Y_Unit_Label"]]  # of LabVIEW
    labelled = ["", *(above[-1][1:] if above else [])][: len(below)]
    bare = [unit or label for unit, label in zip_longest(below, labelled, fillvalue="")]
    units = [_UNITS.get(unit.lower(), unit) for unit in bare]
    names = ["Sequence" if unit.lower() == "sequence" else n for n, unit in zip(found.names, bare, strict=True)]
    stated = {}
    for number, line in [*head, *((found.top, text) for text in found.stated)]:
        for key, rate in _rates_in(line, parting):
            stated[rate] = f"Sampling rate {rate:.12g} Hz: by `{key}` in line {number}."
    rate = next(iter(stated)) if len(stated) == 1 else None  # of several, none is known to be meant
    past = [number for number, line in head if number < found.top and not is_comment(line)]
    return Layout(
        parting=parting,
        labels=tuple(f"{name} [{unit}]" if unit else name for name, unit in zip(names, units, strict=True)),
        top=found.top,
        first=first[0],
        row=tuple(first[1]),
        comments=tuple(line for _, line in head if is_comment(line)),
        rate=rate,
        rate_note="" if rate is None else stated[rate],
        notes=(f"What is above the header, down to line {max(past)}, was read past.",) if past else (),
    )


def _rates_in(line: str, parting: Parting) -> Iterator[tuple[str, float]]:
    """The names and the rates [Hz] of what a `line` states, as `fs = 50`, or with a mark between: `Delta_X,0.02`."""
    text = line.lstrip("#% ")
    cells = [*(parting.cells(text) if parting.mark else [text]), "", ""]
    for place, cell in enumerate(cells[:-2]):
        key, value = (part.strip() for part in re.split("[=:]", f"{cell}=", maxsplit=1))
        value = value.removesuffix("=")
        unit = cells[place + (2 if not value else 1)]
        found = _VALUE.fullmatch(value or cells[place + 1])
        if found is None or not is_number(found[1]):
            continue
        number = float(found[1].replace(",", "."))
        rate = (
            rate_stated(key, number, found[2] or unit) or rate_stated(key, number, found[2]) if number > 0.0 else None
        )
        if rate is not None:
            yield key, rate


def _on_trust(source: Source, words: _Lines, comments: _Lines) -> Layout:
    """The layout by the first line alone, whose odd rows are named one by one; refused where it is no header."""
    number, head = words[0]
    if any(all(map(is_number, parting.cells(head))) for parting in _PARTINGS):
        must, got = "begin with a header row that names the columns", f"begins with numbers (line {number})"
        raise source.error(must, got, "Write a first line such as `time [s],x [m],y [m]`, or pass `header=False`.")
    for place, (_, line) in enumerate(words):
        for parting in _PARTINGS[:3]:
            cells = parting.cells(line)
            like = len(_filled(cells)) == len(_filled(parting.cells(head)))
            numbers = any(cells) and all(map(is_number, cells))
            if place > 1 and numbers:
                raise _unclear(source, number, words[place - 1][0])
            if place and (numbers or (like and any(cell and is_number(cell) for cell in cells))):
                return _by_line(words, comments)
    return _by_line(words, comments)


def _by_line(words: _Lines, comments: _Lines) -> Layout:
    """The layout with the first of the `words` as its header, parted as the second is."""
    (top, head), (first, line) = words[0], words[1] if len(words) > 1 else (words[0][0] + 1, "")
    counts = {p: len(_filled(p.cells(head))) for p in _PARTINGS[:3]}
    alike = {p: n for p, n in counts.items() if n > 1 and len(p.cells(head)) == len(p.cells(line))}
    parting = max(alike or counts, key=counts.__getitem__)
    return Layout(
        parting=parting,
        labels=tuple(_filled(parting.cells(head)) or [""]),
        top=top,
        first=first,
        row=tuple(parting.cells(line)),
        comments=tuple(text for number, text in comments if number < first),
    )


def _unclear(source: Source, first: int, last: int) -> InputError:
    must = "have one header, with a name for each column, right above its numbers"
    remedy = "Delete what is not the header, or put # before those lines; units stand in brackets, as in `x [m]`."
    return source.error(must, f"has other words in lines {first} to {last}", remedy)


def is_comment(line: str) -> bool:
    """True of a line that is none of a table: it begins with # or, as MATLAB's do, with %."""
    return line.lstrip()[:1] in ("#", "%")


def is_number(cell: str) -> bool:
    """True of the text of a number, also with a comma for its point, and of no text."""
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return cell == ""
    return True


def without_dates(line: str) -> str:
    """A `line` without its dates: what marks decimals in them says nothing of the numbers."""
    return _DATE.sub("", line)


def is_date(cell: str) -> bool:
    """True of a date of ISO 8601, the year first."""
    return _DATE.fullmatch(cell) is not None
