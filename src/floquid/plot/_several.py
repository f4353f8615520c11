"""What figures of one or several analyses, and of the angle of a shaft, have in common."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from floquid._checks import input_error, integer
from floquid.plot._style import BLUE, GREEN, PURPLE, VERMILION, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Thing = TypeVar("Thing")


@dataclass(frozen=True, slots=True)
class Look:
    """How the points and the line of one of several results are drawn: a dot sits inside a ring where two agree."""

    points: dict[str, Any]
    line: dict[str, Any]


_RING = {"linestyle": "none", "marker": "o", "markerfacecolor": "none", "markersize": 5.0, "markeredgewidth": 0.9}
_DOT = {"linestyle": "none", "marker": "o", "markersize": 2.8, "markeredgewidth": 0.0}
_CROSS = {"linestyle": "none", "marker": "x", "markersize": 5.0, "markeredgewidth": 0.8}
_PLUS = {"linestyle": "none", "marker": "+", "markersize": 7.0, "markeredgewidth": 0.8}

LOOKS = tuple(
    Look({**points, "color": color}, {"color": color, "linestyle": dashes, "linewidth": width})
    for points, color, dashes, width in (
        (_RING, BLUE, "-", 1.4),
        (_DOT, VERMILION, "--", 0.9),
        (_CROSS, GREEN, "-.", 0.9),
        (_PLUS, PURPLE, ":", 1.2),
    )
)
"""Told apart by form as well as by colour."""


ACROSS, HANDLE = 100, 9
"""How many characters a row of a legend holds, and how many the space of a handle and the gaps about it take."""


def several(things: Thing | Mapping[str, Thing], kind: type[Thing], argument: str, of: str) -> dict[str, Thing]:
    """One thing under an empty name, or the things by name.

    Raises
    ------
    InputError
        It is neither, or there are none or more than can be told apart.
    """
    if isinstance(things, kind):
        return {"": things}
    if (
        not isinstance(things, Mapping)
        or not 1 <= len(things) <= len(LOOKS)
        or not all(isinstance(thing, kind) for thing in things.values())
    ):
        word = kind.__name__
        must = f"be {'an' if word[0] in 'AEIO' else 'a'} {word}, or up to {len(LOOKS)} of them by name"
        raise input_error(argument, of, must, f"is {things!r:.60}", f'Pass e.g. {{"one": {word.lower()}}}.')
    return {str(name): thing for name, thing in things.items()}


def entitled(name: str, words: str) -> str:
    """An entry of a legend: the words, and whose they are."""
    return f"{plain(name)}, {words}" if name else words


def degrees_a_period(periods_per_revolution: int | None, of: str) -> float:
    """How far the phase, or the shaft, turns in a period [deg]."""
    if periods_per_revolution is None:
        return 360.0
    return 360.0 / integer(periods_per_revolution, "periods_per_revolution", of, at_least=1)


def label_angle(axes: Axes, periods_per_revolution: int | None, of: str, steps: int = 8) -> None:
    """Label the lower axis of `axes`, with so many steps: the phase of the period, or the angle of the shaft."""
    end = degrees_a_period(periods_per_revolution, of)
    name = "phase of the period" if periods_per_revolution is None else "shaft angle"
    axes.set(xlabel=f"{name} [deg]", xlim=(-end / 60.0, end * 61.0 / 60.0), xticks=np.linspace(0.0, end, steps + 1))
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")


def legend_of_all(figure: Figure) -> None:
    """Give the figure the legend of all its axes, each entry once, above them, in as few rows as its width allows."""
    entries: dict[str, Any] = {}
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    columns = columns_that_fit(list(entries))
    figure.legend(list(entries.values()), list(entries), loc="outside upper center", ncols=columns)


def columns_that_fit(labels: list[str], across: int = ACROSS) -> int:
    """In how many columns a legend fits a width of so many characters, in as few rows as it can."""
    rows = 1
    while rows < len(labels) and _characters(labels, -(-len(labels) // rows)) > across:
        rows += 1
    return -(-len(labels) // rows)


def _characters(labels: list[str], columns: int) -> int:
    """The width of a legend in characters: it is filled column by column, the first ones longer by one if need be."""
    each, longer = divmod(len(labels), columns)
    ends = np.cumsum([each + (column < longer) for column in range(columns)])
    return sum(HANDLE + max(map(len, labels[end - each - (k < longer) : end])) for k, end in enumerate(ends))
