"""Periodic systems of the literature whose Floquet exponents are known exactly or to many digits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from floquid._arrays import Complexes, Floats
from floquid._checks import Rebuilt
from floquid.floquet import AbstractPeriodicMatrix, FunctionMatrix, PiecewiseMatrix

Entries: TypeAlias = Callable[[Floats], list[list[object]]]
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
    exponents: Complexes
    error: float = 0.0

    def __post_init__(self) -> None:
        self._freeze(dtype=np.complex128, exponents=("modes",))


def literature() -> tuple[ReferenceSystem, ...]:
    """Systems whose exponents are printed or follow in closed form: tests of anything that computes them.

    Those with a zero `error` are exact; the others were computed once by an adaptive Runge-Kutta integrator at a
    relative tolerance of 1e-11 or better.
    """
    once, printed = "integrated at 1e-11", 5.1e-11
    hover = -6.0 / 16.0 + 1j * np.sqrt(1.0 - (6.0 / 16.0) ** 2)
    lossy, near = f"x'' + 0.1x' + 0.5(1 - 0.4 cos 2t)x = 0; {once}", f"x'' + 0.005x' + (4 + b cos t)x = 0; {once}"
    pair = [-0.0025 + 0.0003351501j, -0.0025 - 0.0003351501j]
    forward = f"flapping, linear aerodynamics, no reversed flow; {once}"
    pi, turn = np.pi, 2.0 * np.pi
    known: list[tuple[str, str, Entries | PiecewiseMatrix, float, list[complex], float]] = [
        ("Zhou and Hagiwara", "Zhou and Hagiwara; exact", zhou_hagiwara, pi, [-1, -2], 0.0),
        ("the same, half the period", "as above; exact", zhou_hagiwara, pi / 2.0, [-1 + 2j, -2 + 2j], 0.0),
        ("Vinograd", "Vinograd; exact", vinograd, pi / 3.0, [2, -13], 0.0),
        ("Colaneri", "Colaneri; exact", colaneri, turn, [0, -24], 0.0),
        ("Bittanti and Colaneri", "Bittanti and Colaneri; exact", triangular, turn, [-1, -3], 0.0),
        ("Meissner, ζ = 0", f"Meissner; {once}", meissner(0.0), pi, [0.0413797447 + 1j, -0.0413797447 + 1j], printed),
        (
            "Meissner, ζ = 0.2",
            f"Meissner; {once}",
            meissner(0.2),
            pi,
            [-0.1479830793 + 1j, -0.2520169207 + 1j],
            printed,
        ),
        (
            "Mathieu, a = 1, q = 0.1",
            f"Mathieu; {once}",
            mathieu(1.0, 0.1),
            pi,
            [0.0499415702 + 1j, -0.0499415702 + 1j],
            printed,
        ),
        (
            "Mathieu, a = 2, q = 0.5",
            f"Mathieu; {once}",
            mathieu(2.0, 0.5),
            pi,
            [0.6304914303j, -0.6304914303j],
            printed,
        ),
        ("Mathieu, a = 3, q = 1", f"Mathieu; {once}", mathieu(3.0, 1.0), pi, [0.3284189108j, -0.3284189108j], printed),
        ("lossy Mathieu", lossy, lossy_mathieu, pi, [-0.05 + 0.7124490252j, -0.05 - 0.7124490252j], printed),
        ("near-degenerate, b = 0.2", near, near_degenerate(0.2), turn, pair, printed),
        ("near-degenerate, b = -0.2", near, near_degenerate(-0.2), turn, pair, printed),
        (
            "blade in hover, γ = 6",
            "flapping, linear aerodynamics; exact",
            flapping(6.0, 0.0),
            turn,
            [hover, hover.conjugate()],
            0.0,
        ),
        (
            "blade, γ = 6, μ = 0.3",
            forward,
            flapping(6.0, 0.3),
            turn,
            [-0.375 + 0.0796775j, -0.375 - 0.0796775j],
            5.1e-8,
        ),
        ("blade, γ = 12, μ = 0.3", forward, flapping(12.0, 0.3), turn, [-0.8896271 + 0.5j, -0.6103729 + 0.5j], 5.1e-8),
    ]
    return tuple(
        ReferenceSystem(
            name=name,
            source=source,
            system=rows if isinstance(rows, PiecewiseMatrix) else stacked(rows, period),
            exponents=np.array(exponents, dtype=np.complex128),
            error=error,
        )
        for name, source, rows, period, exponents, error in known
    )


def zhou_hagiwara(t: Floats) -> list[list[object]]:
    """The rows of A(t) of Zhou and Hagiwara."""
    s2, c2, s4 = np.sin(2 * t) ** 2, np.cos(2 * t) ** 2, np.sin(4 * t)
    return [[-1 - s2, 2 - 0.5 * s4], [-2 - 0.5 * s4, -1 - c2]]


def vinograd(t: Floats) -> list[list[object]]:
    """The rows of A(t) of Vinograd, whose frozen eigenvalues are -1 and -10 at every instant."""
    s, c = np.sin(6 * t), np.cos(6 * t)
    return [[-1 - 9 * c**2 + 12 * s * c, 12 * c**2 + 9 * s * c], [-12 * s**2 + 9 * s * c, -1 - 9 * s**2 - 12 * s * c]]


def colaneri(t: Floats) -> list[list[object]]:
    """The rows of A(t) of Colaneri, whose multipliers are 1 and e^{-48π}."""
    return [[0.0, 1.0], [-10 * np.cos(t), -24 - 10 * np.sin(t)]]


def triangular(t: Floats) -> list[list[object]]:
    """The rows of A(t) of Bittanti and Colaneri."""
    return [[-1 + np.sin(t), 0.0], [1 - np.cos(t), -3.0]]


def lossy_mathieu(t: Floats) -> list[list[object]]:
    """The rows of A(t) of x'' + 0.1x' + 0.5(1 - 0.4 cos 2t)x = 0."""
    return [[0.0, 1.0], [-0.5 * (1 - 0.4 * np.cos(2 * t)), -0.1]]


def mathieu(a: float, q: float) -> Entries:
    """The rows of A(t) of x'' + (a - 2q cos 2t)x = 0."""
    return lambda t: [[0.0, 1.0], [2 * q * np.cos(2 * t) - a, 0.0]]


def near_degenerate(b: float) -> Entries:
    """The rows of A(t) of x'' + 0.005x' + (4 + b cos t)x = 0."""
    return lambda t: [[0.0, 1.0], [-4 - b * np.cos(t), -0.005]]


def flapping(gamma: float, mu: float) -> Entries:
    """The rows of A(ψ) of a blade that flaps, by Lock number γ and advance ratio μ."""

    def rows(t: Floats) -> list[list[object]]:
        damping = gamma / 8 * (1 + 4 / 3 * mu * np.sin(t))
        stiffness = 1 + gamma / 8 * (4 / 3 * mu * np.cos(t) + mu**2 * np.sin(2 * t))
        return [[0.0, 1.0], [-stiffness, -damping]]

    return rows


def meissner(zeta: float) -> PiecewiseMatrix:
    """A(t) of x'' + 2ζx' + (1 - 0.2ψ)x = 0, ψ = 1 in the first third of T = π, else -1."""
    pieces = [[[0.0, 1.0], [0.2 * sign - 1.0, -2 * zeta]] for sign in (1.0, -1.0)]
    return PiecewiseMatrix(values=np.moveaxis(np.array(pieces), 0, 2), edges=[0.0, np.pi / 3.0], period=np.pi)


def stacked(rows: Entries, period: float) -> FunctionMatrix:
    """A(t) from its rows."""

    def system(times: Floats) -> Floats:
        entries = [
            [np.broadcast_to(np.asarray(entry, np.float64), times.shape) for entry in row] for row in rows(times)
        ]
        return np.stack([np.stack(row, axis=-1) for row in entries], axis=-2)

    return FunctionMatrix(function=system, period=period, vectorised=True)
