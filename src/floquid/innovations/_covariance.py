"""The gain of a stable predictor by Riccati's equation along the period, and the covariance of its innovations.

Random excitation that turns makes the covariance vary along a period.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import BLOCK, Complexes, Floats, Mask
from floquid._checks import Rebuilt
from floquid.fit import CHUNK, FEW_STEPS, IN_VAIN, LAGS
from floquid.innovations._mode import Mode
from floquid.innovations._predictor import Predictor, matrices, turning
from floquid.inputs import MOST_ROWS, Samples, sealed

SWEEPS = 200  # periods over which the equation is followed at most,
SETTLED = 1e-4  # until the gain of a period differs from that of the one before by less than this share
SMALL = 0.03  # the share of the largest harmonic of a gain below which one at an end is left out


def stable_gains(samples: Samples, modes: Sequence[Mode], covariance: Floats, highest: float) -> list[Mode]:
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
    # Without a harmonic at all a negative multiplier turns by half a fundamental.
    lowest = mode.reach[0] % 1.0 if mode.real else -highest
    wide = np.arange(lowest, max(highest, lowest) + 0.25)
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


def reweighed(samples: Samples, at: Predictor) -> Predictor:
    """The predictor with the covariance along a period that its innovations have."""
    return replace(at, whitening=whitening_of(samples, at.level))


@dataclass(frozen=True, eq=False)
class Whitening(Rebuilt):
    """W of samples (samples, channels, channels), formed where it is asked for by a slice or a mask."""

    angle: Complexes  # e^{iωt} (samples,)
    there: Mask  # Mask of the samples that were measured (samples,)
    # φ of each channel (columns, channels before it), and log d (columns,), of the columns of `_columns`
    shares: tuple[Floats, ...]
    deviations: tuple[Floats, ...]

    def __post_init__(self) -> None:
        sealed(self)

    def __getitem__(self, own: slice | Mask) -> Floats:
        if len(self.there) * len(self.shares) ** 2 < BLOCK:
            return self._all[own]
        return self._of(self.angle[own], self.there[own])

    @cached_property
    def _all(self) -> Floats:
        return self._of(self.angle, self.there)

    def _of(self, angle: Complexes, there: Mask) -> Floats:
        found = np.zeros((len(angle), len(self.shares), len(self.shares)))
        columns = _columns(angle, max(map(len, self.deviations)) // 2)
        for channel, (shares, deviations) in enumerate(zip(self.shares, self.deviations, strict=True)):
            inner = columns[: len(deviations)]
            size = np.exp(-deviations @ inner)
            found[:, channel, :channel] = -(inner.T @ shares) * size[:, None]
            found[:, channel, channel] = size
        found[~there] = np.eye(len(self.shares))
        return found


def _columns(angle: Complexes, harmonics: int) -> Floats:
    """One, and real and imaginary part of each harmonic (columns, samples)."""
    found, turned = np.ones((1 + 2 * harmonics, len(angle))), angle
    for place in range(1, 2 * harmonics, 2):
        found[place], found[place + 1] = turned.real, turned.imag
        turned = turned * angle
    return found


def whitening_of(samples: Samples, innovations: Floats) -> Whitening:
    r"""W of innovations (channels, samples): that of W e is constant along a period.

    .. math:: e_i = \sum_{j < i} \varphi_{ij}(t)\, e_j + d_i(t)\, \varepsilon_i, \qquad W = D^{-1} (1 - \Phi)

    φ and log d² have few harmonics, as many as the criterion of Schwarz (1978) has, and are those of maximum likelihood
    (Pourahmadi 1999). The geometric mean of each d is 1: the likelihood needs no more than the covariance of W e.
    W is 1 at samples that were not measured.
    """
    there, angle = samples.there, samples.turned(1.0)
    used = slice(None) if there.all() else there
    innovations, measured = innovations[:, used], angle[used]
    highest = int(np.pi / (samples.fundamental * samples.step))
    columns, fits = _columns(measured, 0), []
    for channel, own in enumerate(innovations):
        best, found_at, fit = np.inf, 0, (np.zeros((1, channel)), np.zeros(1))
        for harmonics in range(highest + 1):
            count = 1 + 2 * harmonics
            if harmonics > found_at + IN_VAIN or (harmonics and count * channel > MOST_ROWS * samples.count):
                break
            columns = columns if len(columns) >= count else _columns(measured, harmonics)
            shares, logs = _fitted(own, innovations[:channel], columns[:count])
            mean = float(np.mean(logs @ columns[:count]))
            criterion = samples.count * mean + (shares.size + count) * np.log(samples.count)
            if criterion < best:
                best, found_at = criterion, harmonics
                fit = shares, 0.5 * (logs - mean * (np.arange(count) == 0))
        fits.append(fit)
    shares, deviations = zip(*fits, strict=True)
    return Whitening(angle, there, shares, deviations)


def _fitted(own: Floats, others: Floats, columns: Floats) -> tuple[Floats, Floats]:
    """Shares of other signals (columns, others) in a signal, and the logarithm of the variance beside (columns,)."""
    logs, count = np.zeros(len(columns)), len(columns) * len(others)
    shares, length = np.zeros((len(columns), len(others))), max(BLOCK // max(count, 1), CHUNK)
    parts = [slice(first, first + length) for first in range(0, len(own), length)]
    for _ in range(2):
        gram, seen = np.zeros((count, count)), np.zeros(count)
        for part in parts:
            rows = (columns[:, None, part] * others[:, part]).reshape(count, len(own[part]))
            weighted = rows * np.exp(-logs @ columns[:, part])
            gram += weighted @ rows.T
            seen += weighted @ own[part]
        shares = np.linalg.solve(gram, seen).reshape(shares.shape)
        left = own.copy()
        for part in parts:
            left[part] -= np.einsum("jn,jn->n", shares.T @ columns[:, part], others[:, part])
        logs = _log_variance(left**2, columns)
    return np.asarray(shares, np.float64), np.asarray(logs, np.float64)


def _log_variance(squares: Floats, columns: Floats) -> Floats:
    """The logarithm of a variance that is a sum of columns, by squares (columns,)."""
    inverse, found = np.linalg.inv(columns @ columns.T), np.zeros(len(columns))
    found[0], logs = np.log(squares.mean()), np.log(squares + 1e-300)
    for _ in range(FEW_STEPS):
        found = found + inverse @ (columns @ np.expm1(logs - found @ columns))
    # At the maximum the mean of the squares over the variance is 1: the first column is one.
    found[0] += np.log(np.mean(squares * np.exp(-found @ columns)))
    return found


def colour(samples: Samples, found: Predictor) -> tuple[float, float]:
    """The share of the variance of innovations that is predictable, and the probability of so much in white ones."""
    # Colour that turns with the system is looked for as well as colour that does not (Ljung and Box 1978).
    from scipy.special import chdtrc

    white = found.white(found.innovations)
    turned = samples.turned(1)
    angles = [np.ones(samples.n_samples), 2.0**0.5 * turned.real, 2.0**0.5 * turned.imag]
    squares, count, there = 0.0, samples.count, samples.there
    for lag, angle in product(range(1, LAGS + 1), angles):
        pairs = samples.n_samples - int(np.sum(~(there[lag:] & there[:-lag])))
        both = (white[:, lag:] * angle[lag:]) @ white[:, :-lag].T / pairs
        squares += pairs * float(np.sum(both**2))
    degrees = LAGS * len(angles) * len(white) ** 2
    return (squares - degrees) / (count * len(white)), float(chdtrc(degrees, squares))


def white(samples: Samples, found: Predictor, alarm: float) -> bool:
    """True unless white innovations had so much colour with a probability of `alarm` at most: a mode is missing."""
    return colour(samples, found)[1] > alarm
