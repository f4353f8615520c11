"""The end of a text table: whether its last row or number is whole where the file was cut short."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence

_NUMBER = re.compile(r"[-+]?(\d*)([.,]?)(\d*)((?:[eEdD][-+]?|[-+])(\d*))?")


def is_cut(cell: str, others: Sequence[str]) -> bool:
    """True where a `cell` at the end of a file without a line end may have lost digits, by the `others` of its column.

    Of a column of fractions each has some digits behind the point: fewer than in any other are too few. So are fewer in
    an exponent, and none where others have one. Whole numbers have no such form: one that is as long as the longest is
    whole.
    """
    forms = [match.groups(default="") for other in others if (match := _NUMBER.fullmatch(other)) and other]
    found = _NUMBER.fullmatch(cell)
    if not forms or not cell or found is None:
        return False
    whole, _, fraction, power, exponent = found.groups(default="")
    exponents = [len(form[4]) for form in forms if form[3]]
    if len(exponent) < min(exponents, default=int(power != "")):
        return True
    if any(form[1] for form in forms):
        return len(fraction) < min(len(form[2]) for form in forms)
    return not exponents and len(whole) < max(len(form[0]) for form in forms)


def cut_note(line: int) -> str:
    """The words on a file that was cut short in a `line`."""
    return f"The file ends amid line {line}: it was read up to there."


class WholeLines:
    """Lines of cells parted by blanks, without the last one where cells or digits are missing; `notes` then say so.

    Parameters
    ----------
    lines
        The lines with their numbers.
    """

    def __init__(self, lines: Iterable[tuple[int, str]]) -> None:
        self._lines = lines
        self.notes: tuple[str, ...] = ()

    def __iter__(self) -> Iterator[tuple[int, str]]:
        before, number, line = "", 0, ""
        for following in self._lines:
            if line:
                yield number, line
                before = line
            number, line = following
        cells, usual = line.split(), before.split()
        missing = len(usual) - len(cells)
        if not line.endswith("\n") and (missing > 0 or (usual and missing == 0 and is_cut(cells[-1], usual[-1:]))):
            self.notes = (cut_note(number),)
        elif line:
            yield number, line
