"""Periodic shapes over the period."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floquid._arrays import Complexes, Floats, Indices
from floquid._checks import Sealed, index, integer
from floquid.core import PeriodicModel


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ShapeCurves(Sealed):
    """The shape of a mode in every channel over one period.

    Parameters
    ----------
    turns
        The phase, 0 to 1 (points,) [periods].
    values
        The shape (channels, points) [units of the channels].
    std
        Its deviations, that of the real part as the real part, that of the imaginary part as the imaginary part
        (channels, points); None if not estimated.
    """

    turns: Floats
    values: Complexes
    std: Complexes | None


def shape_curves(model: PeriodicModel, mode: int, hit: int = 0, points: int = 91) -> ShapeCurves:
    r"""The shape of a mode over one period, both ends included.

    .. math:: R(t) = \sum_m B_m\, e^{im\omega t}

    (Allen 2009, eq. 11.) It is as the `model` has it, neither scaled nor turned, at `points` instants; `mode` and `hit`
    count from 0. Raises InputError where there is no such mode or hit.
    """
    of = "shape_curves"
    index(mode, "mode", of, model.order)
    index(hit, "hit", of, model.n_hits)
    turns = np.linspace(0.0, 1.0, integer(points, "points", of, at_least=2))
    times = turns * model.period
    std = model.shape_std(times, [mode])
    return ShapeCurves(
        turns=turns, values=model.shapes(times)[mode, :, hit], std=None if std is None else std[0, :, hit]
    )


def closed_period(times: Floats, period: float) -> tuple[Indices, Floats]:
    """The order of instants, and the instants in it: the first once more where they end within a period of it.

    `times` (times,) and the `period` are in the same unit; both results are (times,) or one more.
    """
    order = np.argsort(times)
    ordered = times[order]
    if ordered[-1] < ordered[0] + period * (1.0 - 1e-9):
        return np.append(order, order[0]), np.append(ordered, ordered[0] + period)
    return order, ordered
