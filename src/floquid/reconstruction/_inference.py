r"""Inference from a fitted structure: A(t), Φ and exponents with deviations, and the next wider structures.

Wider structures are seen to first order about the fit: what the choice could hide. With θ the unknowns of a wider
structure, δ its best step from the fit, C and C₀ their covariance in the wider and in the chosen structure, and χ² the
gain of that step with n numbers more,

.. math:: E\,(\theta - \theta_0)(\theta - \theta_0)^T = C_0 + E(1 - B)\,(C - C_0) + E(1 - B)^2\, \delta \delta^T

with the share of noise B of `hidden_share`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from floquid.core import Estimates
from floquid.errors import IdentificationError
from floquid.findings import Finding, note, warning
from floquid.reconstruction._invariance import Point, Problem, at, covariance_of
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
    """Variances of A and Φ (times, n, n) and of both parts of the exponents (2, modes), of those of the unknowns."""
    n = len(basis.names)
    # An estimated period moves the exponents too.
    moving = len(point.parameters) + int(estimates.fundamental_std > 0.0)
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


@dataclass(frozen=True, slots=True)
class Hidden:
    """Addition of a wider structure to the second moments about the fit of the chosen one."""

    basis: Basis
    point: Point  # the fit, as one of the wider structure
    moment: Array  # of its unknowns (unknowns, unknowns)
    of_parameters: Array  # of the parameters of the chosen structure (parameters, parameters)


def hidden_in(problem: Problem, name: str, chosen: Point, basis: Basis) -> tuple[Hidden | None, Finding]:
    """Addition of the wider structure of a problem to the fit of the chosen one, which has this basis; and its test."""
    # None where the estimates do not determine the wider structure.
    from scipy.special import chdtrc

    wide, n, more = problem.basis, len(basis.names), len(problem.basis.names) - len(basis.names)
    turns = 2.0 * np.pi * np.arange(64) / 64
    (known, own), (start, every) = basis.in_time(turns), wide.in_time(turns)
    own, every = own.reshape(n, -1).T, every.reshape(n + more, -1).T
    inside = np.linalg.lstsq(every, own, rcond=None)[0]
    first = np.linalg.lstsq(every, own @ chosen.parameters[:n] + (known - start).ravel(), rcond=None)[0]
    parameters = np.concatenate([first, chosen.parameters[n:]])
    try:
        point = at(problem, parameters, chosen.amplitudes, chosen.fundamental, chosen.modes, chosen.others)
        covariance = covariance_of(point)
    except (IdentificationError, np.linalg.LinAlgError):
        return None, warning("structure_conditional", name=name)
    # The unknowns of the chosen structure in those of the wider one: gains, ω and amplitudes are the same.
    embedded = np.zeros((point.slopes.shape[1], chosen.slopes.shape[1]))
    embedded[: n + more, :n], embedded[n + more :, n:] = inside, np.eye(chosen.slopes.shape[1] - n)
    scale = np.linalg.norm(point.slopes, axis=0)
    step = np.linalg.lstsq(point.slopes / scale, point.rest, rcond=None)[0] / scale
    gain = float(np.sum((point.slopes @ step) ** 2))
    share, share_of_square = hidden_share(gain, more)
    beyond = covariance - embedded @ covariance_of(chosen) @ embedded.T
    moment = share * beyond + share_of_square * np.outer(step, step)
    seen = np.linalg.lstsq(own, every, rcond=None)[0]
    count = len(parameters)
    nearest = np.zeros((len(chosen.parameters), count))
    nearest[:n, : n + more], nearest[n:, n + more :] = seen, np.eye(count - n - more)
    finding = note("structure_tested", name=name, gain=gain, more=more, p_value=float(chdtrc(more, gain)))
    return Hidden(wide, point, moment, nearest @ moment[:count, :count] @ nearest.T), finding


SHARES = np.linspace(0.0, 1.0, 2001)[1:]  # values of B that are summed over


def hidden_share(square: float, numbers: int) -> tuple[float, float]:
    """E(1 - B) and E(1 - B)² after a χ² of some numbers."""
    logs = 0.5 * (numbers - 1.0) * np.log(SHARES) - 0.5 * square * SHARES
    weights = np.exp(logs - logs.max())
    weights /= weights.sum()
    return float(weights @ (1.0 - SHARES)), float(weights @ (1.0 - SHARES) ** 2)
