"""What may be given as A(t), and what is asked of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from floquid._checks import frozen_array, input_error, positive

StateMatrix: TypeAlias = Callable[[float], ArrayLike] | ArrayLike
"""A(t) as a callable, t [s] -> (n, n) [1/s], or as its samples (n, n, phases) at t = 0, T/P, ..., (P - 1)T/P."""

_N_PROBES = 16
_PROBE_OFFSET = 0.381966  # off every simple fraction of the period, where jumps and zeros like to sit


class PeriodicMatrix:
    """A(t) of period T, checked: its values at some probes, and its value at any time.

    Raises
    ------
    InputError
        A(t) is not a real, finite, square matrix, or does not repeat itself after `period`.
    """

    __slots__ = ("at", "breaks", "n", "period", "probes")

    at: Callable[[float], NDArray[np.float64]]
    breaks: NDArray[np.float64]
    n: int
    period: float
    probes: NDArray[np.float64]

    def __init__(self, system: StateMatrix, period: float, breaks: ArrayLike, of: str) -> None:
        self.period = positive(period, "period", of, unit="s")
        self.breaks = np.unique(frozen_array(breaks, "breaks", of, axes=("breaks",)))
        if self.breaks.size and not (self.breaks[0] >= 0.0 and self.breaks[-1] < self.period):
            raise input_error(
                "breaks",
                of,
                f"lie in [0, {self.period:g}) [s]",
                f"runs from {self.breaks[0]:g} to {self.breaks[-1]:g}",
                "Give each jump once, in the first period.",
            )
        self.at = _checked(system, of) if callable(system) else _interpolant(system, self.period, of)
        times = self.period * (np.arange(_N_PROBES) + _PROBE_OFFSET) / _N_PROBES
        self.probes = np.stack([self.at(time) for time in times])
        self.n = self.probes.shape[-1]
        self._refuse_other_period(times, of)

    def _refuse_other_period(self, times: NDArray[np.float64], of: str) -> None:
        later = np.stack([self.at(time) for time in times + self.period])
        distance = np.abs(times[:, None] - self.breaks[None, :])
        clear = (distance > 1e-6 * self.period).all(axis=1)
        change = np.abs(later - self.probes).max(axis=(1, 2))[clear]
        scale = np.abs(self.probes).max()
        if change.size and change.max() > 1e-8 * scale:
            worst = int(change.argmax())
            raise input_error(
                "period",
                of,
                "be a period of A(t)",
                f"A differs by {change[worst]:.3g} between t = {times[clear][worst]:g} and one period of "
                f"{self.period:g} later",
                "Half a revolution is a period only in the fixed frame: check the period and the coordinates.",
            )


def _checked(system: Callable[[float], ArrayLike], of: str) -> Callable[[float], NDArray[np.float64]]:
    """The callable with its values checked to be real, finite, square and of one size."""
    shape = np.shape(system(0.0))
    if len(shape) != 2 or shape[0] != shape[1] or not shape[0]:
        raise input_error("system", of, "return a square matrix (n, n)", f"returns shape {shape} at t = 0")

    def at(time: float) -> NDArray[np.float64]:
        value = system(time)
        return frozen_array(value, "system", of, axes=shape, remedy=f"This is its value at t = {time:g}.")

    return at


def _interpolant(samples: ArrayLike, period: float, of: str) -> Callable[[float], NDArray[np.float64]]:
    """The trigonometric polynomial of lowest degree through the samples (n, n, phases)."""
    remedy = "A constant matrix is one sample: pass `A[:, :, None]`." if np.ndim(samples) == 2 else ""
    values = frozen_array(
        samples,
        "system",
        of,
        axes=("n", "n", "phases"),
        remedy=remedy or "Or pass a callable, t -> (n, n).",
    )
    if values.shape[0] != values.shape[1] or not values.size:
        stack = values.shape[1] == values.shape[2]
        raise input_error(
            "system",
            of,
            "have shape (n, n, phases)",
            f"has shape {values.shape}",
            "Phase is the last axis: pass `np.moveaxis(A, 0, -1)`." if stack else "",
        )
    n_phases = values.shape[2]
    weights = np.full(n_phases // 2 + 1, 2.0)
    weights[0] = 1.0
    if n_phases % 2 == 0:
        weights[-1] = 1.0  # e^{iPωt/2} and its conjugate share the one term of the highest line
    harmonics = np.fft.rfft(values, axis=2) * (weights / n_phases)
    rates = 2j * np.pi / period * np.arange(len(weights))

    def at(time: float) -> NDArray[np.float64]:
        return (harmonics @ np.exp(rates * time)).real

    return at
