"""Periodic systems of the literature whose Floquet exponents are known exactly or to many digits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from floquid._checks import Rebuilt, frozen_array
from floquid.floquet import AbstractPeriodicMatrix, FunctionMatrix, PiecewiseMatrix

Entries: TypeAlias = Callable[[NDArray[np.float64]], list[list[object]]]
"""Times (times,) -> the rows of A there, each entry a number or (times,)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReferenceSystem(Rebuilt):
    """A(t) with its exponents.

    Parameters
    ----------
    name
        What it is called.
    source
        Where it comes from, and how the exponents are known.
    system
        A(t), of the period for which the exponents are given.
    exponents
        λ (modes,) [1/s], modulo iω.
    error
        Half a unit of the last digit given [1/s]; zero where the exponents are exact.
    """

    name: str
    source: str
    system: AbstractPeriodicMatrix
    exponents: NDArray[np.complex128]
    error: float = 0.0

    def __post_init__(self) -> None:
        values = frozen_array(self.exponents, "exponents", "ReferenceSystem", dtype=np.complex128, axes=("modes",))
        object.__setattr__(self, "exponents", values)


def literature() -> tuple[ReferenceSystem, ...]:
    """Systems whose exponents are printed or follow in closed form: tests of anything that computes them.

    Those with a zero `error` are exact; the others were computed once by an adaptive Runge-Kutta integrator at a
    relative tolerance of 1e-11 or better.
    """
    half = np.pi / 2.0
    hover = np.array([-6.0 / 16.0 + 1j * np.sqrt(1.0 - (6.0 / 16.0) ** 2)])
    integrated = "integrated at 1e-11"
    return (
        _known("Zhou and Hagiwara", "Zhou and Hagiwara; exact", zhou_hagiwara, np.pi, [-1, -2]),
        _known("the same, half the period", "as above; exact", zhou_hagiwara, half, [-1 + 2j, -2 + 2j]),
        _known("Vinograd", "Vinograd; exact", vinograd, np.pi / 3.0, [2, -13]),
        _known("Colaneri", "Colaneri; exact", colaneri, 2.0 * np.pi, [0, -24]),
        _known("Bittanti and Colaneri", "Bittanti and Colaneri; exact", triangular, 2.0 * np.pi, [-1, -3]),
        *(
            ReferenceSystem(
                name=f"Meissner, ζ = {zeta:g}",
                source=f"Meissner; {integrated}",
                system=meissner(zeta),
                exponents=np.array(exponents),
                error=5.1e-11,
            )
            for zeta, exponents in (
                (0.0, [0.0413797447 + 1j, -0.0413797447 + 1j]),
                (0.2, [-0.1479830793 + 1j, -0.2520169207 + 1j]),
            )
        ),
        *(
            _known(f"Mathieu, a = {a:g}, q = {q:g}", f"Mathieu; {integrated}", mathieu(a, q), np.pi, e, 5.1e-11)
            for a, q, e in (
                (1.0, 0.1, [0.0499415702 + 1j, -0.0499415702 + 1j]),
                (2.0, 0.5, [0.6304914303j, -0.6304914303j]),
                (3.0, 1.0, [0.3284189108j, -0.3284189108j]),
            )
        ),
        _known(
            "lossy Mathieu",
            f"x'' + 0.1x' + 0.5(1 - 0.4 cos 2t)x = 0; {integrated}",
            lossy_mathieu,
            np.pi,
            [-0.05 + 0.7124490252j, -0.05 - 0.7124490252j],
            5.1e-11,
        ),
        *(
            _known(
                f"near-degenerate, b = {b:g}",
                f"x'' + 0.005x' + (4 + b cos t)x = 0; {integrated}",
                near_degenerate(b),
                2.0 * np.pi,
                [-0.0025 + 0.0003351501j, -0.0025 - 0.0003351501j],
                5.1e-11,
            )
            for b in (0.2, -0.2)
        ),
        _known(
            "blade in hover, γ = 6",
            "flapping, linear aerodynamics; exact",
            flapping(6.0, 0.0),
            2.0 * np.pi,
            [hover[0], hover[0].conjugate()],
        ),
        *(
            _known(
                f"blade, γ = {gamma:g}, μ = 0.3",
                f"flapping, linear aerodynamics, no reversed flow; {integrated}",
                flapping(gamma, 0.3),
                2.0 * np.pi,
                e,
                5.1e-8,
            )
            for gamma, e in (
                (6.0, [-0.375 + 0.0796775j, -0.375 - 0.0796775j]),
                (12.0, [-0.8896271 + 0.5j, -0.6103729 + 0.5j]),
            )
        ),
    )


def zhou_hagiwara(t: NDArray[np.float64]) -> list[list[object]]:
    """The rows of A(t) of Zhou and Hagiwara."""
    s2, c2, s4 = np.sin(2 * t) ** 2, np.cos(2 * t) ** 2, np.sin(4 * t)
    return [[-1 - s2, 2 - 0.5 * s4], [-2 - 0.5 * s4, -1 - c2]]


def vinograd(t: NDArray[np.float64]) -> list[list[object]]:
    """The rows of A(t) of Vinograd, whose frozen eigenvalues are -1 and -10 at every instant."""
    s, c = np.sin(6 * t), np.cos(6 * t)
    return [[-1 - 9 * c**2 + 12 * s * c, 12 * c**2 + 9 * s * c], [-12 * s**2 + 9 * s * c, -1 - 9 * s**2 - 12 * s * c]]


def colaneri(t: NDArray[np.float64]) -> list[list[object]]:
    """The rows of A(t) of Colaneri, whose multipliers are 1 and e^{-48π}."""
    return [[0.0, 1.0], [-10 * np.cos(t), -24 - 10 * np.sin(t)]]


def triangular(t: NDArray[np.float64]) -> list[list[object]]:
    """The rows of A(t) of Bittanti and Colaneri."""
    return [[-1 + np.sin(t), 0.0], [1 - np.cos(t), -3.0]]


def lossy_mathieu(t: NDArray[np.float64]) -> list[list[object]]:
    """The rows of A(t) of x'' + 0.1x' + 0.5(1 - 0.4 cos 2t)x = 0."""
    return [[0.0, 1.0], [-0.5 * (1 - 0.4 * np.cos(2 * t)), -0.1]]


def mathieu(a: float, q: float, zeta: float = 0.0) -> Entries:
    """The rows of A(t) of x'' + 2ζx' + (a - 2q cos 2t)x = 0."""
    return lambda t: [[0.0, 1.0], [2 * q * np.cos(2 * t) - a, -2 * zeta]]


def near_degenerate(b: float) -> Entries:
    """The rows of A(t) of x'' + 0.005x' + (4 + b cos t)x = 0."""
    return lambda t: [[0.0, 1.0], [-4 - b * np.cos(t), -0.005]]


def flapping(gamma: float, mu: float) -> Entries:
    """The rows of A(ψ) of a blade that flaps, by Lock number γ and advance ratio μ."""

    def rows(t: NDArray[np.float64]) -> list[list[object]]:
        damping = gamma / 8 * (1 + 4 / 3 * mu * np.sin(t))
        stiffness = 1 + gamma / 8 * (4 / 3 * mu * np.cos(t) + mu**2 * np.sin(2 * t))
        return [[0.0, 1.0], [-stiffness, -damping]]

    return rows


def meissner(zeta: float, a: float = 1.0, q: float = 0.1) -> PiecewiseMatrix:
    """A(t) of x'' + 2ζx' + (a - 2qψ)x = 0, ψ = 1 in the first third of T = π, else -1."""
    pieces = [[[0.0, 1.0], [2 * q * sign - a, -2 * zeta]] for sign in (1.0, -1.0)]
    return PiecewiseMatrix(values=np.moveaxis(np.array(pieces), 0, 2), edges=[0.0, np.pi / 3.0], period=np.pi)


def stacked(rows: Entries) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    """A(t) as a callable of arrays of times (times,) -> (times, n, n)."""

    def system(times: NDArray[np.float64]) -> NDArray[np.float64]:
        entries = [[np.broadcast_to(np.asarray(entry, dtype=np.float64), times.shape) for entry in row]
                   for row in rows(times)]  # fmt: skip
        return np.stack([np.stack(row, axis=-1) for row in entries], axis=-2)

    return system


def _known(
    name: str, source: str, rows: Entries, period: float, exponents: object, error: float = 0.0
) -> ReferenceSystem:
    return ReferenceSystem(
        name=name,
        source=source,
        system=FunctionMatrix(function=stacked(rows), period=period, vectorised=True),
        exponents=np.asarray(exponents, dtype=np.complex128),
        error=error,
    )
