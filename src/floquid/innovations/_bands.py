"""Bands of harmonics of the innovations form: grown and narrowed by tests."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from floquid.innovations._predictor import Mode, Predictor, predicted, rebuilt
from floquid.innovations._solve import Normal, normal_of, places, solve
from floquid.inputs import Limits, Samples, limit_of

ROUNDS = 10
"""Rounds in which bands may grow."""

STRIDE = 2
"""Harmonics beyond the end of a band that are looked at."""


def grown(samples: Samples, now: Predictor, limits: Limits, rounds: int = ROUNDS) -> Predictor:
    """The predictor with the harmonics beside its bands whose scores rise above the noise.

    While modes are missing few rounds are enough: bands would grow to make up for them.
    """
    for _ in range(rounds if now.modes else 0):
        padded = rebuilt(samples, now, [mode.padded(STRIDE, limits.highest) for mode in now.modes])
        assert padded is not None
        normal = normal_of(samples, padded, rough=True)
        bands = [
            tuple(np.isin(new, old) for new, old in ((wide.turns, own.turns), (wide.reach, own.reach)))
            for wide, own in zip(padded.modes, now.modes, strict=True)
        ]
        fitted = ~np.concatenate(
            [_mask(mode, *(~own for own in band)) for mode, band in zip(padded.modes, bands, strict=True)]
        )
        fitted = np.concatenate([fitted, np.ones(len(normal.gradient) - len(fitted), bool)])
        inverse = normal.inverse(fitted)
        modes, grew = [], False
        for mode, band, place in zip(padded.modes, bands, places(padded.modes), strict=True):
            kept = [own.copy() for own in band]
            for which in (0, 1):
                for k in np.flatnonzero(~band[which]):
                    one = [np.zeros_like(own) for own in band]
                    one[which][k] = True
                    rows = place.start + np.flatnonzero(_mask(mode, *one))
                    if _score(normal, inverse, rows) > limit_of(len(rows), limits.harmonic_alarm):
                        inner = np.flatnonzero(band[which])
                        kept[which][min(k, inner[0]) : max(k, inner[-1]) + 1] = True
                        grew = True
            modes.append(mode.widened(mode.turns[kept[0]], mode.reach[kept[1]]))
        if not grew:
            return now
        start = rebuilt(samples, now, modes)
        assert start is not None
        now = centred(samples, solve(samples, start, rough=True))
    return now


def narrowed(samples: Samples, now: Predictor, limits: Limits) -> Predictor:
    """Without the harmonics at the ends of bands that noise explains."""
    for _ in range(ROUNDS if now.modes else 0):
        inverse, modes = normal_of(samples, now, rough=True).inverse(), []
        for mode, place in zip(now.modes, places(now.modes), strict=True):
            spread = inverse[place, place]
            turns, reach = np.ones(len(mode.turns), bool), np.ones(len(mode.reach), bool)
            for band, which in ((turns, 0), (reach, 1)):
                for end in (-1,) if mode.real else (0, -1):
                    while band.sum() > 1:
                        one = np.zeros_like(band)
                        one[np.flatnonzero(band)[end]] = True
                        gone = [np.zeros_like(turns), np.zeros_like(reach)]
                        gone[which] = ~band | one
                        if weight(mode, spread, gone) > limit_of(
                            2 * int(gone[which].sum()) * _rows(mode, which), limits.harmonic_alarm
                        ):
                            break
                        band &= ~one
            modes.append(mode.widened(mode.turns[turns], mode.reach[reach]))
        if all(
            len(a.turns) == len(b.turns) and len(a.reach) == len(b.reach) for a, b in zip(modes, now.modes, strict=True)
        ):
            return now
        trial = rebuilt(samples, now, modes)
        if trial is None:
            return now
        trial = solve(samples, trial, rough=True)
        if now.log_likelihood - trial.log_likelihood > limit_of(
            now.n_parameters - trial.n_parameters, limits.mode_alarm
        ):
            return now
        now = trial
    return now


def _mask(mode: Mode, turns: NDArray[np.bool_], reach: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The parameters of some harmonics of the shape (turns,) and of the gains (reach,) among all of a mode."""
    gains, shape = np.tile(reach, len(mode.gains)), np.tile(turns, len(mode.shape))
    return np.concatenate([np.zeros(mode.rows, bool), gains, gains, shape, shape])


def _score(normal: Normal, inverse: NDArray[np.float64], rows: NDArray[np.int64]) -> float:
    """The gain in twice the logarithm of the likelihood by parameters that are zero now (score test)."""
    mixed = normal.matrix[rows]
    left = mixed[:, rows] - mixed @ inverse @ mixed.T
    pull = normal.gradient[rows] - mixed @ inverse @ normal.gradient
    size = np.sqrt(np.maximum(np.diag(mixed[:, rows]), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(left / np.outer(size, size))
    good = values > 1e-6
    return float(np.sum((vectors[:, good].T @ (pull / size)) ** 2 / values[good]))


def _rows(mode: Mode, which: int) -> int:
    return len(mode.gains) if which else len(mode.shape)


def weight(mode: Mode, spread: NDArray[np.float64], gone: list[NDArray[np.bool_]]) -> float:
    """How far the parameters of some harmonics are from zero, in squared deviations."""
    mask = _mask(mode, *gone)
    parts = [np.zeros(mode.rows)]
    for values in (mode.gains, mode.shape):
        parts += [values.real.ravel(), values.imag.ravel()]
    size = np.sqrt(np.maximum(np.diag(spread)[mask], np.finfo(float).tiny))
    own = np.concatenate(parts)[mask] / size
    return float(own @ np.linalg.pinv(spread[np.ix_(mask, mask)] / np.outer(size, size), hermitian=True) @ own)


def anchored(now: Predictor) -> NDArray[np.bool_]:
    """The parameters less the largest gain of each mode, which says what its scale is (parameters,)."""
    free = []
    for mode in now.modes:
        own = np.ones(sum(mode.sizes), bool)
        largest = mode.rows + int(np.argmax(np.abs(mode.gains)))
        own[[largest] if mode.real else [largest, largest + mode.gains.size]] = False
        free.append(own)
    return np.concatenate([*free, np.ones(now.columns.size + now.initial.size, bool)])


def centred(samples: Samples, now: Predictor) -> Predictor:
    """Each pair on the branch whose zeroth harmonic is seen most, its frequency not negative."""
    noise = np.sqrt(np.diag(now.covariance))[:, None]
    modes, initial = [], now.initial.copy()
    begins, row = samples.times[list(samples.begins[:-1])], 0
    for mode in now.modes:
        if not mode.real:
            turn = float(mode.turns[int(np.argmax(np.sum(np.abs(mode.shape / noise) ** 2, axis=0)))])
            omega = samples.fundamental
            state = (initial[:, row] + 1j * initial[:, row + 1]) * np.exp(1j * turn * omega * begins)
            mode = replace(
                mode,
                exponent=mode.exponent + 1j * turn * omega,
                turns=mode.turns - turn,
                reach=mode.reach + turn,
                gains=mode.gains * np.exp(1j * turn * omega * samples.step),
            )
            if mode.exponent.imag < 0.0:
                state = state.conj()
                mode = replace(
                    mode,
                    exponent=mode.exponent.conjugate(),
                    turns=-mode.turns[::-1],
                    shape=mode.shape[:, ::-1].conj(),
                    reach=-mode.reach[::-1],
                    gains=mode.gains[:, ::-1].conj(),
                )
            initial[:, row], initial[:, row + 1] = state.real, state.imag
        modes.append(mode)
        row += mode.rows
    found = predicted(samples, modes, now.columns, initial)
    return now if found is None else found
