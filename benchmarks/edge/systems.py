"""Systems whose multipliers lock onto the real axis: a parameter each, and the edges of a lock."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from floquid import floquet
from floquid.systems import JeffcottRotor

Matrix = Callable[[NDArray[np.float64]], NDArray[np.float64]]

NODES = 6
"""Nodes of an integral over a sample."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Family:
    """A(t) by one parameter, with a bracket of an edge of a lock.

    `system` gives A(t) and the period; on one end of `bracket` two multipliers are real, on the other end conjugate.
    """

    name: str
    system: Callable[[float], tuple[floquet.AbstractPeriodicMatrix, Callable | None]]
    bracket: tuple[float, float]
    phases: int = 16
    cycles: int = 80

    def locked(self, parameter: float) -> int:
        """Count the real multipliers."""
        matrix, _ = self.system(parameter)
        multipliers = np.exp(floquet.exponents(matrix) * matrix.period)
        return int(np.sum(np.abs(multipliers.imag) < 1e-9 * np.abs(multipliers)))

    def edge(self) -> float:
        """The parameter at which the count of real multipliers changes, by bisection."""
        low, high = self.bracket
        below = self.locked(low)
        if below == self.locked(high):
            raise ValueError(f"{self.name}: no edge between {low} and {high}")
        for _ in range(45):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self.locked(middle) == below else (low, middle)
        return 0.5 * (low + high)

    def response(self, parameter: float, start: NDArray[np.float64]) -> NDArray[np.float64]:
        """The response (channels, samples) from an initial state, without noise."""
        return self.forced(parameter, start, np.zeros(self.phases * self.cycles))

    def forced(self, parameter: float, start: NDArray[np.float64], force: NDArray[np.float64]) -> NDArray[np.float64]:
        r"""The response (channels, samples) to a force on the first velocity that is held over a sample (samples,).

        .. math:: x_{k+1} = \Phi(t_{k+1}, t_k) x_k + \int_{t_k}^{t_{k+1}} \Phi(t_{k+1}, t) b\, dt\, u_k

        The integral is by Gauss and Legendre's nodes.
        """
        matrix, outputs = self.system(parameter)
        nodes, weights = np.polynomial.legendre.leggauss(NODES)
        inner = np.concatenate([[0.0], 0.5 * (nodes + 1.0)])
        times = (np.arange(self.phases)[:, None] + inner).ravel() * matrix.period / self.phases
        steps = floquet.transition(matrix, None, np.append(times, matrix.period))
        parts, ends = steps[:-1].reshape(self.phases, NODES + 1, *steps.shape[1:]), steps[NODES + 1 :: NODES + 1]
        unit = np.eye(len(start))[len(start) // 2]
        ahead = np.array([end @ np.linalg.inv(begin[0]) for begin, end in zip(parts, ends, strict=True)])
        half = 0.5 * matrix.period / self.phases
        driven = [
            half * sum(w * end @ np.linalg.solve(part, unit) for w, part in zip(weights, own[1:], strict=True))
            for own, end in zip(parts, ends, strict=True)
        ]
        states = [start]
        for number, value in enumerate(force[:-1]):
            phase = number % self.phases
            states.append(ahead[phase] @ states[-1] + driven[phase] * value)
        if outputs is None:
            return np.array(states)[:, : len(start) // 2].T
        instants = np.arange(len(states)) * matrix.period / self.phases
        return np.einsum("nij,nj->in", outputs(instants), np.array(states))


def _second_order(stiffness: Callable, damping: NDArray[np.float64], period: float) -> floquet.FunctionMatrix:
    """A(t) of x'' + D x' + K(t) x = 0."""
    size = len(damping)

    def entries(times: NDArray[np.float64]) -> NDArray[np.float64]:
        t = np.asarray(times, float)
        found = np.zeros((*t.shape, 2 * size, 2 * size))
        found[..., :size, size:] = np.eye(size)
        found[..., size:, size:] = -damping
        found[..., size:, :size] = -stiffness(t)
        return found

    return floquet.FunctionMatrix(function=entries, period=period, vectorised=True)


def mathieu(depth: float) -> tuple[floquet.AbstractPeriodicMatrix, None]:
    """Damped Mathieu's equation beside half the fundamental, by the depth of its modulation."""
    return _second_order(
        lambda t: (1.0072 + 2.0 * depth * np.cos(2.0 * t))[..., None, None], np.array([[0.03]]), np.pi
    ), None


def meissner(stiffness: float) -> tuple[floquet.AbstractPeriodicMatrix, None]:
    """Meissner's spring, stiff for a third of the period, by its mean stiffness."""
    pieces = [[[0.0, 1.0], [0.1 * sign - stiffness, -0.02]] for sign in (1.0, -1.0)]
    return floquet.PiecewiseMatrix(
        values=np.moveaxis(np.array(pieces), 0, 2), edges=[0.0, np.pi / 3.0], period=np.pi
    ), None


def rotor(speed: float) -> tuple[floquet.AbstractPeriodicMatrix, Callable]:
    """The paper's rotor by its speed."""
    own = JeffcottRotor(speed=speed, damping=0.02)
    return floquet.FunctionMatrix(function=own.system, period=own.period, vectorised=True), own.outputs


def column(load: float) -> tuple[floquet.AbstractPeriodicMatrix, None]:
    """A column of two degrees of freedom under a pulsating load, by the size of the load."""
    constant, geometric = np.array([[1.0, 0.1], [0.1, 3.2]]), np.array([[1.0, 0.3], [0.3, 2.0]])
    damping = np.array([[0.04, 0.0], [0.0, 0.06]])
    return _second_order(
        lambda t: constant - load * np.cos(1.98 * t)[..., None, None] * geometric, damping, 2.0 * np.pi / 1.98
    ), None


FAMILIES = (
    Family(name="mathieu", system=mathieu, bracket=(0.002, 0.02)),
    Family(name="meissner_low", system=meissner, bracket=(0.95, 1.03)),
    Family(name="meissner_high", system=meissner, bracket=(0.9, 0.97)),
    Family(name="rotor_low", system=rotor, bracket=(0.70, 0.735), phases=32),
    Family(name="rotor_high", system=rotor, bracket=(0.735, 0.78), phases=32),
    Family(name="column", system=column, bracket=(0.005, 0.1)),
)
