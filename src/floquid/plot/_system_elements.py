"""Elements of A(t) over a period."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from floquid._checks import input_error, positive, timed_matrices
from floquid.core import Channel
from floquid.fit import WITHIN
from floquid.plot._style import (
    LOOKS,
    Into,
    degrees_a_period,
    drawing,
    entitled,
    grid_of,
    label_angle,
    label_values,
    several,
)
from floquid.reconstruction import StateModel
from floquid.views import Ink, closed_period, element_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def system_elements(
    state: StateModel | Mapping[str, StateModel],
    elements: Sequence[tuple[int, int]] | None = None,
    truth: tuple[ArrayLike, ArrayLike] | None = None,
    *,
    period: float | None = None,
    channels: Sequence[Channel] = (),
    periods_per_revolution: int | None = None,
    ax: Into = None,
) -> Figure:
    """Chosen elements of A(t) over the period: circles, with the truth as lines where it is known.

    Bands are 1.96 standard deviations each way, where those are estimated: at each instant alone, 95 % of such
    intervals hold the true value.

    One panel an element. Raises InputError where an element is not in A, the truth does not fit, or the period is
    needed and not given.

    Parameters
    ----------
    state
        The state model, or several in the same states by name.
    elements
        Rows and columns, counted from 1 as in A(3,1); when not given, the first two stiffnesses and the first damping
        of the first equation of motion: A(3,1), A(3,2) and A(3,3) for four states.
    truth
        Instants after phase zero (times,) [s], and the true A at each (times, n, n).
    period
        The period [s]; when not given, the instants are taken to be equally spaced over one, as `reconstruct` has them.
    channels
        The channels of the record: with them, states in different units get the right unit on the axis.
    periods_per_revolution
        Draw against the angle of the shaft, which turns once in this many periods; not given, against the phase.
    ax
        The axes to draw into, one for each element; a new figure when not given.
    """
    of = "system_elements"
    named = several(state, StateModel, "state", of)
    first = next(iter(named.values()))
    n = len(first.states)
    for name, other in named.items():
        if other.states != first.states:
            raise input_error("state", of, "hold models in the same states", f"{name!r} has {other.states}")
    chosen = _default(n) if elements is None else [_element(entry, n, of) for entry in elements]
    if not chosen:
        raise input_error("elements", of, "name at least one element", "is empty")
    length = _period(first, of) if period is None else positive(period, "period", of, unit="s")
    known = None if truth is None else timed_matrices(truth, of, n)
    degrees = degrees_a_period(periods_per_revolution, of) / length
    with drawing(1.0 + 1.5 * len(chosen), ax, of, panels=grid_of(len(chosen)), sharex=True) as (figure, panels):
        for axes, (i, j) in zip(panels, chosen, strict=True):
            if known is not None:
                axes.plot(known[0] * degrees, known[1][:, i - 1, j - 1], color=Ink.BLACK, label="truth")
            _draw_estimates(axes, named, i - 1, j - 1, degrees, length)
            axes.margins(y=0.12)
            largest = float(np.abs(axes.dataLim.intervaly).max())
            label_values(axes, f"A({i},{j})", element_unit(first, i - 1, j - 1, channels), largest)
        label_angle(panels[-1], periods_per_revolution, of)
    return figure


def _draw_estimates(axes: Axes, named: dict[str, StateModel], i: int, j: int, degrees: float, period: float) -> None:
    """One element of A in each model, with bands of its deviations where they are known."""
    bands = [name for name, state in named.items() if state.system_std is not None]
    for look, (name, state) in zip(LOOKS, named.items(), strict=False):
        axes.plot(state.times * degrees, state.system[:, i, j], **look.points, label=entitled(name, "estimated"))
        if state.system_std is None:
            continue
        order, times = closed_period(state.times, period)
        middle, width = state.system[order, i, j], WITHIN * state.system_std[order, i, j]
        band = {"color": look.line["color"], "alpha": 0.25, "linewidth": 0.0}
        label = "95 % intervals" if name == bands[-1] else None
        axes.fill_between(times * degrees, middle - width, middle + width, **band, label=label)


def _default(n: int) -> list[tuple[int, int]]:
    """The first two stiffnesses and the first damping of the first equation of motion."""
    row = n // 2 + 1
    return list(dict.fromkeys([(row, 1), (row, min(2, n)), (row, row)])) if n > 1 else [(1, 1)]


def _element(entry: tuple[int, int], n: int, of: str) -> tuple[int, int]:
    valid = isinstance(entry, Sequence) and len(entry) == 2 and all(isinstance(k, (int, np.integer)) for k in entry)
    if not valid or not all(1 <= k <= n for k in entry):
        must = f"hold (row, column) pairs from 1 to {n}"
        raise input_error("elements", of, must, f"has {entry!r}", "Counting starts at 1: A(1,1).")
    return int(entry[0]), int(entry[1])


def _period(state: StateModel, of: str) -> float:
    """The period over which the instants are equally spaced."""
    steps = np.diff(state.times)
    if not len(steps) or np.ptp(steps) > 1e-6 * abs(steps[0]):
        must = "be given when the instants are not equally spaced over a period"
        raise input_error("period", of, must, "is None", "Pass period=model.period.")
    return float(steps.mean() * len(state.times))
