r"""Search of a residual: the poles that would take most out of it, on a grid of angle and decay.

A pole of decay d and angle θ correlates with a residual R as z = Σ_n e^{-dn} e^{-iθn} R_n, and takes

.. math:: \frac{2 (a \sum_j |z_j|^2 - \operatorname{Re} \bar b \sum_j z_j^2)}{a^2 - |b|^2}

out of it (a pair; a real pole Σ z²/a), a and b being the sums of squares |e|² and e² of its own column less what the
poles that are there take. Both sums over responses are transforms of diagonals of R Rᵀ: along the diagonals for |z|²,
across them for z².
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import as_strided

from floquid._arrays import BLOCK, Complexes, Floats
from floquid.lti._exponentials import real_powers
from floquid.lti._factor import Factor
from floquid.lti._poles import NEGATIVE, PAIR, POSITIVE, PoleSet


def candidates(poles: PoleSet, factors: Sequence[Factor]) -> list[tuple[PoleSet, float]]:
    """The pair and the two real poles that would take most out of the residual, with what they would take."""
    longest = max(len(f.values) for f in factors)
    lines = 1 << int(np.ceil(np.log2(2 * longest)))
    angles = 2.0 * np.pi * np.arange(lines // 2 + 1) / lines
    decays = np.concatenate([[0.0], np.geomspace(0.3 / longest, 1.0, 8)])
    gains = sum(_gains(poles, block, decays, lines) for block in factors)
    best: dict[int, tuple[float, complex]] = {}
    for decay, gain in zip(decays, np.atleast_2d(gains), strict=True):
        tops = {
            PAIR: int(np.argmax(gain[1:-1])) + 1 if len(gain) > 2 else None,
            POSITIVE: 0,
            NEGATIVE: len(gain) - 1,
        }
        for kind, line in tops.items():
            if line is not None and gain[line] > best.get(kind, (0.0, 0j))[0]:
                best[kind] = (float(gain[line]), complex(-decay, angles[line]))
    order = sorted(best.items(), key=lambda item: -item[1][0])
    return [(PoleSet.of(np.array([s]), np.array([kind])), gain) for kind, (gain, s) in order]


def _gains(poles: PoleSet, block: Factor, decays: Floats, lines: int) -> Floats:
    """Reduction of the residual by a pole of each decay at each line of the grid (decays, lines/2 + 1)."""
    samples = len(block.values)
    k, half = np.arange(samples), np.arange(lines // 2 + 1)
    envelopes = np.exp(-np.multiply.outer(decays, k))
    q, _ = np.linalg.qr(real_powers(poles, samples)) if len(poles) else (np.zeros((samples, 0)), None)
    residual = block.values - q @ (q.T @ block.values)
    power, pseudo = _by_diagonals(residual, envelopes, decays, lines)
    taken, crossed = _by_columns(q, envelopes, decays, lines)
    squares = envelopes**2
    straight = squares.sum(axis=1)[:, None] - taken
    # The envelope's transform at twice the angle, folded back into the grid.
    double = np.fft.rfft(squares, lines, axis=1)
    twice = 2 * half % lines
    folded = np.minimum(twice, lines - twice)
    crossed = np.where(twice <= lines // 2, double[:, folded], double[:, folded].conj()) - crossed
    whole = squares.sum(axis=1)[:, None]
    determinant = straight**2 - np.abs(crossed) ** 2
    pair = 2.0 * (straight * power - (crossed.conj() * pseudo).real)
    gain = np.divide(pair, determinant, out=np.zeros_like(pair), where=determinant > 1e-6 * whole**2)
    ends = [0, lines // 2]
    seen = straight[:, ends] > 1e-6 * whole
    gain[:, ends] = np.divide(power[:, ends], straight[:, ends], out=np.zeros((len(decays), 2)), where=seen)
    return gain


def _by_columns(values: Floats, envelopes: Floats, decays: Floats, lines: int) -> tuple[Floats, Complexes]:
    """Σ_j |z_j|² and Σ_j z_j² (decays, lines/2 + 1), each column transformed."""
    power = np.zeros((len(decays), lines // 2 + 1))
    pseudo = np.zeros(power.shape, complex)
    step = max(1, BLOCK // lines)
    for number, envelope in enumerate(envelopes):
        for start in range(0, values.shape[1], step):
            z = np.fft.rfft(values[:, start : start + step].T * envelope, lines, axis=1)
            power[number] += np.einsum("jl,jl->l", z.real, z.real) + np.einsum("jl,jl->l", z.imag, z.imag)
            pseudo[number] += np.einsum("jl,jl->l", z, z)
    return power, pseudo


def _by_diagonals(values: Floats, envelopes: Floats, decays: Floats, lines: int) -> tuple[Floats, Complexes]:
    """Σ_j |z_j|² and Σ_j z_j² from the Gram matrix.

    e^{-d(n + m)} is constant across the diagonals, e^{-2dn} e^{-dl} along them.
    """
    samples = len(values)
    along, across = np.zeros((len(decays), samples)), np.zeros(2 * samples - 1)
    # Half of the Gram matrix is enough, some rows at a time.
    step = max(1, BLOCK // (2 * samples))
    for start in range(0, samples, step):
        gram = values[start : start + step] @ values[start:].T
        rows, wide = gram.shape
        padded = np.zeros((rows, 2 * wide))
        padded[:, :wide] = gram
        padded[:, :rows] = np.triu(gram[:, :rows])
        # Rows one entry longer are turned: a column then is a lag; rows one entry shorter: a column then is a sum.
        row, column = padded.strides
        upper = as_strided(padded, (rows, wide), (row + column, column))
        along[:, :wide] += envelopes[:, start : start + rows] ** 2 @ upper
        lags = 2 * wide - 1
        across[2 * start :] += 2.0 * padded.ravel()[: rows * lags].reshape(rows, lags).sum(axis=0)
        across[2 * start : 2 * (start + rows) : 2] -= np.diagonal(gram)
    along *= envelopes
    power = 2.0 * np.fft.rfft(along, lines, axis=1).real - along[:, :1]
    weights = np.exp(-np.multiply.outer(decays, np.arange(2 * samples - 1)))
    return power, np.fft.rfft(weights * across, lines, axis=1)
