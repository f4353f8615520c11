"""All channels as states: displacements that are weighted sums of more channels than there are states."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from floquid._checks import input_error
from floquid.core import PeriodicModel
from floquid.errors import IdentificationError
from floquid.reconstruction._coordinates import Coordinates, Part, State, channel_noise, derivative_of, refuse_rest

NO_CHANCE = 1e-6
"""The probability of what is left at which the channels are no constant combinations of the displacements."""


def combined(model: PeriodicModel, count: int) -> Coordinates:
    r"""Displacements u from all channels, of which each is a constant combination of them.

    .. math:: B_{c} = s^{p_c} \sum_i V_{ci} u_i, \qquad u = (V^T \Sigma^{-1} V)^{-1} V^T \Sigma^{-1} (s^{-p} B)

    with Σ the noise of the channels and V their leading singular vectors, so scaled that the `count` channels that are
    farthest from dependent are u themselves, but for noise.

    Raises
    ------
    InputError
        There are fewer channels than displacements, or a channel is no motion.
    IdentificationError
        The channels are no constant combinations of so few displacements.
    """
    from scipy.linalg import qr

    powers = np.array([derivative_of(channel) for channel in model.channels])
    if len(powers) < count:
        must, got = f"be at least {count} channels: half as many as there are modes", f"there are {len(powers)}"
        raise input_error("states", "reconstruct", must, got, 'Pass `form="delayed"` (`--form delayed`).')
    noise = channel_noise(model)
    if len(powers) == count:
        mixing, chosen, loose = np.eye(count), np.arange(count), None
    else:
        table, units, degrees, left = _table(model, powers, noise, count)
        vectors = np.linalg.svd(table, full_matrices=False)[0][:, :count]
        _refuse_more(left, degrees, count)
        order = qr(vectors.T, pivoting=True)[-1]
        chosen = np.sort(order[:count])
        spread = noise[:, None] * vectors
        mixing = spread @ np.linalg.inv(spread[chosen])
        loose = None if units is None else _loose(table, units, vectors, noise, chosen, mixing)
    weighted = mixing / noise[:, None] ** 2
    weights = np.linalg.solve(mixing.T @ weighted, weighted.T)
    states = []
    for i, row in enumerate(chosen):
        parts = tuple(Part(c, float(weights[i, c]), -int(powers[c])) for c in range(len(powers)) if weights[i, c])
        states.append(State(f"{model.channels[row].name}*", parts))
    refuse_rest(model, states)
    sums = "; ".join(
        f"{state.name} = " + " + ".join(f"{part.gain:.4g} {model.channels[part.channel].name}" for part in state.parts)
        for state in states
    )
    words = f"second-order form from all channels, weighted by their noise ({sums})"
    derived = tuple(state.derivative() for state in states)
    rows = tuple(int(row) for row in chosen)
    return Coordinates((*states, *derived), len(powers), "second-order", words, mixing, rows, loose)


def _loose(
    table: NDArray[np.float64],
    units: NDArray[np.complex128],
    vectors: NDArray[np.float64],
    noise: NDArray[np.float64],
    chosen: NDArray[Any],
    mixing: NDArray[np.float64],
) -> NDArray[np.complex128]:
    r"""Slopes of the error that the errors of V make in the displacements.

    .. math:: E = N_c\, (\Pi_\perp\, \delta M\, U^+)_c

    with M = N⁻¹VU the table, Π⊥ the projector off its columns, and c the chosen rows. A number of the table is the real
    or the imaginary part of a coefficient times its `units` (channels, modes, hits, harmonics).
    """
    across = noise[chosen][:, None] * (np.eye(len(vectors)) - vectors @ vectors.T)[chosen]
    back = np.linalg.pinv(np.linalg.lstsq(mixing / noise[:, None], table, rcond=None)[0])
    real, imag = np.split(back, 2)
    there = (units != 0).any(axis=0)
    slopes = np.zeros((len(chosen), len(chosen), *units.shape), complex)
    slopes[..., there] = np.einsum("ic,cq,qj->ijcq", across, units[:, there], real - 1j * imag)
    return np.moveaxis(slopes, 2, 3)


def _table(
    model: PeriodicModel, powers: NDArray[np.int64], noise: NDArray[np.float64], count: int
) -> tuple[NDArray[np.float64], NDArray[np.complex128] | None, int, float]:
    """Displacement coefficients over their noise (channels, numbers), and what that makes of each coefficient.

    With degrees and chi-square of what is left. Without deviations they are as they are.
    """
    rates = model.exponents[:, None] + 1j * model.harmonics * model.fundamental
    factors = np.where(rates[None] == 0, 1.0, rates[None]) ** -powers[:, None, None] / noise[:, None, None]
    values = np.moveaxis(model.coefficients, 1, 0)
    upper = model.exponents.imag >= 0
    if model.coefficient_std is None or not model.coefficient_std.any():
        flat = (values * factors[:, :, None, :])[:, upper].reshape(len(powers), -1)
        return np.concatenate([flat.real, flat.imag], axis=1), None, 0, 0.0
    std = np.moveaxis(model.coefficient_std, 1, 0) * np.abs(factors[:, :, None, :])
    size = np.sqrt(0.5 * np.mean(std.real**2 + std.imag**2, axis=0))
    there = (size > 0) & upper[:, None, None]
    units = factors[:, :, None, :] * np.divide(1.0, size, out=np.zeros_like(size), where=there)
    flat = (values * units)[:, there]
    table = np.concatenate([flat.real, flat.imag], axis=1)
    singular = np.linalg.svd(table, compute_uv=False)
    degrees = (table.shape[0] - count) * max(table.shape[1] - count, 0)
    return table, units, degrees, float(np.sum(singular[count:] ** 2))


def _refuse_more(left: float, degrees: int, count: int) -> None:
    from scipy.special import chdtrc

    if degrees and chdtrc(degrees, left) < NO_CHANCE:
        raise IdentificationError(
            f"The channels are no constant combinations of {count} displacements (what is left is a chi-square of "
            f"{left:.4g} for {degrees} degrees of freedom): what they see varies with the period. Choose {count} of "
            "them with `states`."
        )
