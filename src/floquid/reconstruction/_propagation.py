"""A(t), Φ(t, t0) and the exponents of a fitted structure: how they move with its parameters."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from floquid.core import Estimates
from floquid.reconstruction._invariance import Point
from floquid.reconstruction._modal_matrix import condition_of
from floquid.reconstruction._structure import Basis

Array = NDArray[Any]


def transition_of(estimates: Estimates, basis: Basis, point: Point, times: Array) -> tuple[Array, Array]:
    """Φ (times, n, n), and the condition of Ψ (times,)."""
    transition, _, condition = _transition(estimates, basis, point, times)
    return transition, condition


def variances(
    estimates: Estimates, basis: Basis, point: Point, moment: Array, times: Array
) -> tuple[Array, Array, Array]:
    """Variances of A and Φ (times, n, n) and of both parts of the exponents (2, modes), of those of the unknowns.

    `moment` (unknowns, unknowns) is the covariance of the unknowns of the point, or what comes to it.
    """
    n = len(basis.names)
    # An estimated period moves the exponents too.
    moving = len(point.parameters) + int(estimates.fundamental_variance > 0)
    by_mode = np.array([slope.exponent[:moving] for slope in point.mode_slopes])
    _, by_system = basis.in_time(point.fundamental * times)
    _, by_transition, _ = _transition(estimates, basis, point, times)

    def spread(slopes: Array, own: Array) -> Array:
        # Rounding may leave a little less than nothing of what comes to a covariance.
        return np.maximum(np.sum(slopes * np.tensordot(own, slopes, axes=1), axis=0), 0.0)

    shared = moment[:moving, :moving]
    exponents = np.array([spread(part.T, shared) for part in (np.real(by_mode), np.imag(by_mode))])
    return spread(by_system, moment[:n, :n]), spread(by_transition, moment[:n, :n]), exponents


def _transition(estimates: Estimates, basis: Basis, point: Point, times: Array) -> tuple[Array, Array, Array]:
    """Φ (times, n, n), its slopes by the parameters (parameters, times, n, n), and the condition of Ψ."""
    d, n = basis.degree, len(basis.names)
    columns, rates, moved, drift = [], [], [], []
    for mode, slope, real in zip(point.modes, point.mode_slopes, estimates.real, strict=True):
        harmonics = np.arange(len(mode.coefficients)) - len(mode.coefficients) // 2
        s = mode.exponent + 1j * point.fundamental * harmonics
        turned = np.exp(1j * point.fundamental * np.multiply.outer(times, harmonics))
        powers = [s**p for p in range(d)]
        column = np.concatenate([turned @ (power[:, None] * mode.coefficients) for power in powers], axis=1)
        change = []
        for p, power in enumerate(powers):
            by = power[:, None] * slope.coefficients[:n]
            if p:
                by = by + p * s[:, None] ** (p - 1) * slope.exponent[:n, None, None] * mode.coefficients
            change.append(np.einsum("tm,qmi->qti", turned, by))
        stacked = np.concatenate(change, axis=2)
        columns.append(column)
        rates.append(mode.exponent)
        moved.append(stacked)
        drift.append(slope.exponent[:n])
        if not real:
            for found in (columns, rates, moved, drift):
                found.append(np.conj(found[-1]))
    modal = np.stack(columns, axis=2)
    later = times - times[0]
    growth = np.exp(np.multiply.outer(later, rates))
    first = np.linalg.inv(modal[0])
    phi = (modal * growth[:, None, :]) @ first
    by_modal, by_rate = np.stack(moved, axis=3), np.array(drift).T
    change = by_modal * growth[None, :, None, :]
    change = change + modal[None] * (growth * later[:, None])[None, :, None, :] * by_rate[:, None, None, :]
    slopes = change @ first - phi[None] @ (by_modal[:, :1] @ first)
    return phi.real, slopes.real, condition_of(modal)
