"""Periodic shapes over the period."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from floquid._checks import Rebuilt, frozen_array, integer
from floquid.core import PeriodicModel
from floquid.views._modes import below


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ShapeCurves(Rebuilt):
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

    turns: NDArray[np.float64]
    values: NDArray[np.complex128]
    std: NDArray[np.complex128] | None

    def __post_init__(self) -> None:
        of, put = "ShapeCurves", object.__setattr__
        put(self, "turns", frozen_array(self.turns, "turns", of, axes=("points",)))
        axes = ("channels", len(self.turns))
        put(self, "values", frozen_array(self.values, "values", of, axes=axes, dtype=np.complex128))
        if self.std is not None:
            put(self, "std", frozen_array(self.std, "std", of, axes=self.values.shape, dtype=np.complex128))


def shape_curves(model: PeriodicModel, mode: int, hit: int = 0, points: int = 91) -> ShapeCurves:
    r"""The shape of a mode over one period, both ends included.

    .. math:: R(t) = \sum_m B_m\, e^{im\omega t}

    (Allen 2009, eq. 11.)

    Parameters
    ----------
    model
        The model.
    mode, hit
        Which, from 0.
    points
        The number of phases.

    Returns
    -------
    ShapeCurves
        As the model has it: neither scaled nor turned.

    Raises
    ------
    InputError
        There is no such mode or hit.
    """
    of = "shape_curves"
    below(mode, model.order, "mode", of)
    below(hit, model.n_hits, "hit", of)
    turns = np.linspace(0.0, 1.0, integer(points, "points", of, at_least=2))
    times = turns * model.period
    std = model.shape_std(times, [mode])
    return ShapeCurves(
        turns=turns,
        values=model.shapes(times)[mode, :, hit],
        std=None if std is None else std[0, :, hit],
    )
