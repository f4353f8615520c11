"""Shapes over the path of a sensor that runs to and fro: what a scanning laser sees, as series of Chebyshev."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Complexes, Floats
from floquid._checks import Rebuilt, finite, frozen_array, input_error, wrong_value
from floquid.core import Channel, PeriodicModel, Shape, on_branch, turning_point
from floquid.pipeline import Analysis

OF = "path_shapes"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PathShapes(Rebuilt):
    r"""Poles and shapes over the path x = cos(ωt + φ) of a sensor that runs to and fro.

    .. math:: p_r(x) = \sum_n a_{r,c,n} T_n(x), \qquad
              a_0 = B_0, \quad a_n = B_n e^{-in\varphi} + B_{-n} e^{in\varphi}

    with the polynomials of Chebyshev T, cos nθ = T_n(cos θ), and the lines B of the symmetric branch. The factor of
    each shape is free, as in `PeriodicModel.shape`.

    Parameters
    ----------
    phase
        φ [rad]. Either end of the path may be x = 1: φ + π is as good, with -x for x.
    exponents, exponent_std
        λ (modes,) [1/s], one of each pair, its imaginary part that of the structure; deviations of real and imaginary
        parts, None if not estimated.
    coefficients, std
        a (modes, channels, orders) [units of the channels], and deviations of real and imaginary parts, None if not
        estimated.
    channels
        One `Channel` a sensor.
    """

    phase: float
    exponents: Complexes
    exponent_std: Complexes | None
    coefficients: Complexes
    std: Complexes | None
    channels: tuple[Channel, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "phase", finite(self.phase, "phase", "PathShapes", unit="rad"))
        self._freeze(dtype=np.complex128, exponents=("modes",))
        modes = len(self.exponents)
        self._freeze(dtype=np.complex128, exponent_std=(modes,), coefficients=(modes, len(self.channels), "orders"))
        self._freeze(dtype=np.complex128, std=self.coefficients.shape)

    def at(self, positions: ArrayLike) -> Complexes:
        """The shapes at `positions` x on the path, from -1 to 1 (modes, channels, positions).

        Raises InputError where a position is outside.
        """
        x = frozen_array(positions, "positions", "PathShapes.at", axes=("positions",))
        if (np.abs(x) > 1.0).any():
            got = f"has {x[np.abs(x).argmax()]:g}"
            raise input_error("positions", "PathShapes.at", "lie between -1 and 1, the ends of the path", got)
        return self.coefficients @ np.polynomial.chebyshev.chebvander(x, self.coefficients.shape[2] - 1).T


def path_shapes(result: Analysis | PeriodicModel) -> PathShapes:
    """Read poles and shapes of a structure from what a sensor saw that ran over it to and fro.

    `result` is what `identify` found, any result with a `model`, or that model, on any branch. Each mode is moved to
    the branch on which its shape is even about a turning point of the path (`turning_point`): that has the frequency
    of the structure. One of each pair is given, real multipliers are left out. Raises InputError where `result` is
    something else, or has a mode without such a branch.
    """
    model = getattr(result, "model", None)
    if not isinstance(model, PeriodicModel):
        raise wrong_value("result", OF, "be an Analysis or a PeriodicModel", result, "Pass what `identify` gave.")
    even = on_branch(model, "symmetric")
    phase, _ = turning_point(even)
    pairs = [mode for mode in even.upper_modes if not even.unpaired[mode]]
    orders = int(np.abs(even.harmonics).max(initial=0)) + 1
    found = [_of_path(even.shape(mode), phase, orders) for mode in pairs]
    values = np.array([values for values, _ in found]).reshape(len(pairs), len(even.channels), orders)
    deviations = [std for _, std in found if std is not None]
    exponent_std = even.exponent_std
    return PathShapes(
        phase=phase,
        exponents=even.exponents[pairs],
        exponent_std=None if exponent_std is None else exponent_std[pairs],
        coefficients=values,
        std=np.array(deviations).reshape(values.shape) if len(deviations) == len(pairs) else None,
        channels=even.channels,
    )


def _of_path(shape: Shape, phase: float, orders: int) -> tuple[Complexes, Complexes | None]:
    """The series of one shape (channels, orders), and its deviations."""
    by_line = np.zeros((orders, len(shape.harmonics)), complex)
    by_line[np.abs(shape.harmonics), np.arange(len(shape.harmonics))] = np.exp(-1j * phase * shape.harmonics)
    std: list[Floats] = []
    for unit in (1.0, 1j):  # Re(a/unit) of each channel alone
        by_values = np.einsum("cd,nm->cndm", np.eye(len(shape.channels)), by_line / unit)
        variance = shape.variance(by_values.reshape(-1, *shape.values.shape))
        if variance is None:
            return shape.values @ by_line.T, None
        std.append(np.sqrt(np.maximum(variance, 0.0)).reshape(len(shape.channels), orders))
    return shape.values @ by_line.T, np.asarray(std[0] + 1j * std[1], np.complex128)
