"""The gain of a predictor that is stable, by Riccati's equation along the period."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from floquid.innovations._mode import Mode
from floquid.innovations._predictor import matrices, turning
from floquid.inputs import Samples

SWEEPS = 200  # periods over which the equation is followed at most,
SETTLED = 1e-4  # until the gain of a period differs from that of the one before by less than this share
SMALL = 0.03  # the share of the largest harmonic of a gain below which one at an end is left out


def stable_gains(
    samples: Samples, modes: Sequence[Mode], covariance: NDArray[np.float64], highest: float
) -> list[Mode]:
    r"""Modes with the gains of the stable predictor of the same spectrum, innovations of a covariance driving them.

    .. math:: P_{k+1} = \Lambda P_k \Lambda^T + K R K^T - \tilde K_k S_k \tilde K_k^T, \quad
              S_k = C P_k C^T + R, \quad \tilde K_k = (\Lambda P_k C^T + K R) S_k^{-1}

    A gain K that is fitted may leave a predictor Λ - KC that grows; from the covariance of the state the equation goes
    to the one that does not (Anderson and Moore 1979, chapter 9). Its harmonics are those that are not small.
    """
    from scipy.linalg import solve_discrete_lyapunov

    phases = min(round(2.0 * np.pi / (samples.fundamental * samples.step)), samples.records[0].stop)
    system, gains, seen, _ = matrices(samples.part(slice(0, phases)), modes)
    driven = np.einsum("kij,jl->kil", gains, covariance)
    added = driven @ gains.swapaxes(1, 2)
    # What grows has no variance of its own: that of its mirror image is a start.
    decays = np.concatenate([np.full(mode.rows, np.exp(mode.exponent.real * samples.step)) for mode in modes])
    variance = solve_discrete_lyapunov(system / np.maximum(decays, 1.0)[:, None] ** 2, added.mean(axis=0))
    # States of half harmonics come back with the other sign.
    turned = np.concatenate([np.full(mode.rows, 1.0 - 4.0 * (mode.turns[0] % 1.0)) for mode in modes])
    found, before = np.zeros_like(gains), np.zeros_like(gains)
    for _ in range(SWEEPS):
        for number in range(phases):
            across = system @ variance @ seen[number].T + driven[number]
            spread = seen[number] @ variance @ seen[number].T + covariance
            found[number] = np.linalg.solve(spread, across.T).T
            variance = system @ variance @ system.T + added[number] - found[number] @ across.T
            variance = 0.5 * (variance + variance.T)
        variance *= np.outer(turned, turned)
        if np.abs(found - before).max() < SETTLED * np.abs(found).max():
            break
        before = found.copy()
    place, new = 0, []
    for mode in modes:
        rows = found[:, place] if mode.real else found[:, place] + 1j * found[:, place + 1]
        new.append(_expanded(samples, mode, rows, min(highest, (phases - 1) // 2)))
        place += mode.rows
    return new


def _expanded(samples: Samples, mode: Mode, gains: NDArray, highest: float) -> Mode:
    """A mode with gains of the innovations along a period in harmonics (samples, channels)."""
    ends = (mode.reach[0] % 1.0 if mode.real else -highest, highest)
    wide = np.arange(ends[0], ends[1] + 0.25)
    basis = turning(samples.part(slice(0, len(gains))), wide).T
    if mode.real:
        both = np.linalg.lstsq(np.concatenate([basis.real, -basis.imag], axis=1), gains, rcond=None)[0]
        harmonics = both[: len(wide)] + 1j * both[len(wide) :]
    else:
        harmonics = np.linalg.lstsq(basis, gains, rcond=None)[0]
    size = np.abs(harmonics).max(axis=1)
    large = wide[size > SMALL * size.max()]
    # Of a pair taken for real multipliers the band may go on beyond what the samples tell.
    first, last = max(min(large[0], mode.reach[0]), wide[0]), min(max(large[-1], mode.reach[-1]), wide[-1])
    mode = mode.widened(mode.turns, np.arange(first, last + 0.25))
    kept = (wide >= first) & (wide <= last)
    mode.gains[-harmonics.shape[1] :] = harmonics[kept].T
    return mode.scaled()
