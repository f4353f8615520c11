"""Methods of the literature that are no subspace: delayed states over a period, and those of one degree of freedom."""

from __future__ import annotations

import numpy as np
from benchmarks.methods.subspace import by_periods
from numpy.typing import NDArray
from scipy.signal import hilbert, savgol_filter

from floquid.floquet import FunctionMatrix, exponents

HARMONICS = 2
"""Of the coefficients of an equation of motion."""

SMOOTH = (9, 5)
"""Samples and degree of the polynomials that signals are differentiated by."""


def delayed(values: NDArray[np.float64], phases: int, order: int) -> NDArray[np.complex128]:
    """Multipliers by least squares of a state of delayed outputs over a period, z_{j+1} = M z_j (Wang and Peters 1998).

    Samples of all channels spread over the period, twice the order of them, less all but their leading directions.
    """
    count = -(-2 * order // len(values))
    state = by_periods(values, phases, phases)[:, :, [k * phases // count for k in range(count)]]
    flat = np.moveaxis(state, 2, 0).reshape(-1, state.shape[1])
    flat = np.linalg.svd(flat, full_matrices=False)[0][:, :order].T @ flat
    return np.linalg.eigvals(np.linalg.lstsq(flat[:, :-1].T, flat[:, 1:].T, rcond=None)[0].T).astype(complex)


def of_equation(coefficients: NDArray[np.float64], period: float) -> NDArray[np.complex128]:
    """Exponents of x'' + k(t) x + c(t) x' = 0 of the Fourier coefficients of k and of c (2, 1 + 2 harmonics)."""

    def system(times: NDArray[np.float64]) -> NDArray[np.float64]:
        found = np.zeros((*np.shape(times), 2, 2))
        found[..., 0, 1] = 1.0
        found[..., 1, :] = -np.moveaxis(coefficients @ turning(times, period), 0, -1)
        return found

    return exponents(FunctionMatrix(function=system, period=period, vectorised=True))


def turning(times: NDArray[np.float64], period: float) -> NDArray[np.float64]:
    """1, cos mωt and sin mωt (1 + 2 harmonics, times)."""
    angle = 2.0 * np.pi * np.multiply.outer(np.arange(1, HARMONICS + 1), times) / period
    return np.concatenate([np.ones((1, *np.shape(times))), np.cos(angle), np.sin(angle)])


def derivatives(values: NDArray[np.float64], step: float) -> list[NDArray[np.float64]]:
    """A signal and its first two derivatives (samples,)."""
    return [savgol_filter(values, *SMOOTH, deriv=order, delta=step) for order in range(3)]


def restoring_force(values: NDArray[np.float64], step: float, period: float) -> NDArray[np.complex128]:
    """x'' = -f(x, x', φ) with f linear in x and x' and their coefficients turning (Masri and Caughey 1979)."""
    position, rate, acceleration = derivatives(values[0], step)
    turns = turning(step * np.arange(len(position)), period)
    columns = np.concatenate([turns * position, turns * rate])
    found = np.linalg.lstsq(columns.T, -acceleration, rcond=None)[0]
    return of_equation(found.reshape(2, -1), period)


def free_vibration(values: NDArray[np.float64], step: float, period: float) -> NDArray[np.complex128]:
    """Instantaneous stiffness and damping of the analytic signal A e^{iψ} (Feldman 1994).

    k = ψ'² - A''/A + 2 A'²/A² + A' ψ''/(A ψ'), c = -2 A'/A - ψ''/ψ', as Fourier series of the phase, weighted by A.
    """
    signal = hilbert(values[0])
    size, rate, second = derivatives(np.abs(signal), step)
    _, turn, more = derivatives(np.unwrap(np.angle(signal)), step)
    loss = rate / size
    stiffness = turn**2 - second / size + 2.0 * loss**2 + loss * more / turn
    damping = -2.0 * loss - more / turn
    turns = turning(step * np.arange(len(size)), period)
    edge = len(size) // 40  # the analytic signal of a record that is cut is wrong at its ends
    own = slice(edge, len(size) // 2)
    found = [
        np.linalg.lstsq((turns * size)[:, own].T, (one * size)[own], rcond=None)[0] for one in (stiffness, damping)
    ]
    return of_equation(np.array(found), period)
