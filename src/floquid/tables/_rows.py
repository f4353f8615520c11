"""The rows of a table that are on one even time axis.

Loggers write channels of several rates on the union of their times: each has a lattice of its own, and empty cells in
the rows of the others.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from floquid._arrays import Floats, Mask
from floquid.core import Channel
from floquid.errors import InputError
from floquid.io import Source
from floquid.tables._time_axis import TimeAxis, TimeColumn, repair

_STRAY = 3  # rows that a lattice may stray from even places among those of others; samples lost by chance stray farther


def repair_rows(time: TimeColumn, channels: Sequence[Channel], values: Floats, source: Source) -> TimeAxis:
    """The even time axis behind a column of `time`: of all rows, or of those that hold `values` (channels, rows)."""
    there = ~np.isnan(values)
    if there.all():
        return repair(time, source)
    groups = _sampled_together(channels, there)
    apart = [rows for rows, _ in groups if _is_apart(rows, alone=len(groups) == 1)]
    try:
        whole = repair(time, source)
        if not apart or any(_of(time, rows, source).positions is not None for rows in apart):
            return whole
    except InputError:
        if all(rows.all() for rows, _ in groups):
            raise
    try:
        axes = [_of(time, rows, source) for rows, _ in groups]
    except InputError:
        return repair(time, source)  # as it was, or refused as it was
    if len(axes) == 1:
        rows = groups[0][0]
        note = f"{rows.sum()} of {rows.size} rows hold the channels asked for: the others are at times between theirs."
        return replace(axes[0], rows=rows, notes=(*axes[0].notes, note))
    words = [
        f"{', '.join(names[:3])}{', …' if len(names) > 3 else ''} at {axis.sample_rate:.6g} Hz"
        for (_, names), axis in zip(groups, axes, strict=True)
    ]
    got = f"has each on times of its own in `{time.label}`: {'; '.join(words[:6])}{'; …' if len(words) > 6 else ''}"
    first = ",".join(groups[0][1][:3])
    remedy = f"Read those of one rate by `channels=`, for example {first}, or resample the file onto even times."
    raise source.error("have its channels sampled together", got, remedy)


def _of(time: TimeColumn, rows: Mask, source: Source) -> TimeAxis:
    """The time axis behind these `rows` alone."""
    return repair(replace(time, values=time.values[rows]), source)


def _sampled_together(channels: Sequence[Channel], there: Mask) -> list[tuple[Mask, list[str]]]:
    """The rows and the names of channels that have samples in nearly the same rows; of `there` (channels, rows)."""
    groups: list[tuple[Mask, list[str]]] = []
    for channel, rows in zip(channels, there, strict=True):
        if not rows.any():
            continue
        for place, (others, names) in enumerate(groups):
            if (rows & others).sum() > 0.9 * max(rows.sum(), others.sum()):
                groups[place] = (rows | others, [*names, channel.name])
                break
        else:
            groups.append((rows, [channel.name]))
    return groups


def _is_apart(rows: Mask, *, alone: bool) -> bool:
    """True where many rows lie between those with samples, evenly, and not one number of them each, or `alone`."""
    places = np.flatnonzero(rows)
    steps = np.diff(places)
    if int((steps - 1).sum()) < max(10, 0.1 * len(steps)) or not (alone or np.ptp(steps) > 0):
        return False
    return bool(np.abs(places - np.linspace(places[0], places[-1], len(places))).max() <= _STRAY)


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
    return f"Line {line} has no line end and may be cut short: the file was read up to there."


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
