"""Bands of harmonics of the innovations form: grown and narrowed by tests."""

from __future__ import annotations

from itertools import product

import numpy as np

from floquid._arrays import Floats, Integers, Mask
from floquid.fit import DEVIATIONS, FEW_STEPS, HALF_DIGITS, Normal, chi2_limit, scaled_inverse, score_gain, wald_rise
from floquid.innovations._mode import Mode
from floquid.innovations._predictor import Predictor, predicted, rebuilt
from floquid.innovations._solve import inverse_of, moved, places, roughly, solve
from floquid.inputs import Limits, Samples
from floquid.search import GAP

STRIDE = 2  # harmonics beyond the end of a band that are looked at: each costs a state


def grown(samples: Samples, now: Predictor, limits: Limits, rounds: int = FEW_STEPS) -> Predictor:
    """The predictor with the harmonics beside its bands whose scores rise above the noise."""
    # While modes are missing few rounds are enough: bands would grow to make up for them.
    for _ in range(rounds if now.modes else 0):
        if limits.over:
            break
        padded, bands, fitted = _wider(samples, now, STRIDE, limits)
        normal = roughly(samples, padded)
        inverse = inverse_of(normal, fitted & anchored(padded))
        modes, grew = [], False
        for mode, band, place in zip(padded.modes, bands, places(padded.modes), strict=True):
            kept = [own.copy() for own in band]
            for which in (0, 1):
                for k in np.flatnonzero(~band[which]):
                    one = [np.zeros_like(own) for own in band]
                    one[which][k] = True
                    rows = place.start + np.flatnonzero(_mask(mode, *one))
                    if _score(normal, inverse, rows) > chi2_limit(len(rows), limits.harmonic_alarm):
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


def bent(samples: Samples, now: Predictor, limits: Limits) -> bool:
    """True where harmonics beside the bands would move an exponent, and further than noise does (Hausman 1978)."""
    # Each is small, and together they still bend modes that are nearly one.
    padded, _, fitted = _wider(samples, now, GAP, limits)
    normal, own = roughly(samples, padded), np.flatnonzero(fitted)
    whole, without = inverse_of(normal), np.zeros_like(normal.matrix)
    without[np.ix_(own, own)] = inverse_of(
        Normal(matrix=normal.matrix[np.ix_(own, own)], gradient=normal.gradient[own])
    )
    starts = zip(places(padded.modes), padded.modes, strict=True)
    exponents = np.array([at.start + row for at, mode in starts for row in range(mode.rows)], np.int64)
    variance = np.diag(without)[exponents]
    more = np.maximum(np.diag(whole)[exponents] - variance, 0.0)
    moved_by = ((whole - without)[exponents] @ normal.gradient) ** 2
    return bool((moved_by > np.maximum(variance, DEVIATIONS**2 * more)).any())


def _wider(
    samples: Samples, now: Predictor, by: float, limits: Limits
) -> tuple[Predictor, list[tuple[Mask, Mask]], Mask]:
    """The predictor with harmonics more that are zero, those of each band that are old, and all such parameters."""
    padded = rebuilt(samples, now, [mode.padded(by, limits.highest) for mode in now.modes])
    assert padded is not None
    bands = [
        (np.isin(wide.turns, own.turns), np.isin(wide.reach, own.reach))
        for wide, own in zip(padded.modes, now.modes, strict=True)
    ]
    fitted = [~_mask(mode, *(~own for own in band)) for mode, band in zip(padded.modes, bands, strict=True)]
    return padded, bands, np.concatenate([*fitted, np.ones(padded.columns.size + padded.initial.size, bool)])


def narrowed(samples: Samples, now: Predictor, limits: Limits) -> Predictor:
    """Without the harmonics at the ends of bands that noise explains together, the least of all ends first."""
    # Half as many go at once where a linearisation does not hold as far as that: of modes that are nearly one.
    period, most = 2.0 * np.pi / samples.fundamental, sum(len(mode.turns) + len(mode.reach) for mode in now.modes)
    spread: Floats | None = None
    while most and not limits.over:
        spread = inverse_of(roughly(samples, now), anchored(now)) if spread is None else spread
        bands, step = _narrower(now, spread, limits, most)
        gone = sum(int(np.sum(~kept)) for band in bands for kept in band)
        if not gone:
            break
        start = moved(samples, now, step, period)
        if start is None and gone > 1:
            most = gone // 2
            continue
        start = start or now
        less = [
            mode.widened(mode.turns[turns], mode.reach[reach])
            for mode, (turns, reach) in zip(start.modes, bands, strict=True)
        ]
        trial = rebuilt(samples, start, less)
        if trial is not None:
            enough = now.log_likelihood - chi2_limit(now.n_parameters - trial.n_parameters, limits.mode_alarm)
            trial = solve(samples, trial, rough=True, least=enough)
            if trial.log_likelihood >= enough:
                now, spread = trial, None
                continue
        most = gone // 2
    return now


def _narrower(now: Predictor, spread: Floats, limits: Limits, most: int) -> tuple[list[tuple[Mask, Mask]], Floats]:
    """The harmonics of shape and gains that are kept, and the step to what all are without the others."""
    free = anchored(now)
    before = np.concatenate([*(mode.parameters for mode in now.modes), np.zeros(now.columns.size + now.initial.size)])
    own, lost, count, gone = before.copy(), 0.0, 0, 0
    bands = [(np.ones(len(mode.turns), bool), np.ones(len(mode.reach), bool)) for mode in now.modes]
    while True:
        found = []
        for mode, band, place in zip(now.modes, bands, places(now.modes), strict=True):
            for which, end in product((0, 1), (-1,) if mode.real else (0, -1)):
                if band[which].sum() > 1:
                    one = [np.zeros_like(kept) for kept in band]
                    last = np.flatnonzero(band[which])[end]
                    one[which][last] = True
                    rows = place.start + np.flatnonzero(_mask(mode, *one))
                    weight = wald_rise(own[rows], spread[np.ix_(rows, rows)]) if free[rows].all() else np.inf
                    found.append((weight, rows, band[which], last))
        best = min(found, key=lambda one: one[0], default=None)
        if best is None or gone == most or lost + best[0] > chi2_limit(count + len(best[1]), limits.harmonic_alarm):
            return bands, own - before
        weight, rows, kept, last = best
        kept[last] = False
        lost, count, gone = lost + weight, count + len(rows), gone + 1
        by = spread[:, rows] @ scaled_inverse(spread[np.ix_(rows, rows)])
        own, spread = own - by @ own[rows], spread - by @ spread[rows]
        own[rows] = 0.0


def _mask(mode: Mode, turns: Mask, reach: Mask) -> Mask:
    """The parameters of some harmonics of the shape (turns,) and of the gains (reach,) among all of a mode."""
    gains, shape = np.tile(reach, len(mode.gains)), np.tile(turns, len(mode.shape))
    return np.concatenate([np.zeros(mode.rows, bool), gains, gains, shape, shape])


def _score(normal: Normal, inverse: Floats, rows: Integers) -> float:
    """The gain in twice the logarithm of the likelihood by parameters that are zero now (score test)."""
    mixed = normal.matrix[rows]
    left = mixed[:, rows] - mixed @ inverse @ mixed.T
    pull = normal.gradient[rows] - mixed @ inverse @ normal.gradient
    return score_gain(pull, left, HALF_DIGITS, before=np.diag(mixed[:, rows]))


def anchored(now: Predictor) -> Mask:
    """Parameters without the largest gain of each mode, which says what its scale is, and those of no effect."""
    free = []
    for mode in now.modes:
        parts = [np.ones(mode.rows, bool)]
        for values, band in ((mode.gains, mode.reach), (mode.shape, mode.turns)):
            # The imaginary part of a real multiplier at harmonic zero has no effect.
            parts += [np.ones(values.size, bool), np.tile((band > 0.0) | (not mode.real), len(values))]
        own = np.concatenate(parts)
        # The scale of a pair is a complex number, of a block one of two parts: as many as each has states.
        n, gains = mode.gains.size, np.arange(2 * mode.gains.size)
        if mode.square is not None:
            gains = gains.reshape(2, 2, n // 2).swapaxes(0, 1).reshape(2, n)
        elif not mode.real:
            gains = gains.reshape(2, n)
        gains = np.atleast_2d(gains)
        first, *second = mode.parameters[mode.rows :][gains] * own[mode.rows :][gains]
        size = first**2 if not second else first**2 - (-1.0 if mode.square is None else mode.square) * second[0] ** 2
        own[mode.rows + gains[:, int(np.argmax(np.abs(size)))]] = False
        free.append(own)
    return np.concatenate([*free, np.ones(now.columns.size + now.initial.size, bool)])


def centred(samples: Samples, now: Predictor) -> Predictor:
    """Each pair on the branch whose zeroth harmonic is seen most, its frequency not negative."""
    modes, initial = [], now.initial.copy()
    begins, row = samples.times[list(samples.begins[:-1])], 0
    for mode in now.modes:
        if not mode.real:
            turn = float(mode.turns[int(np.argmax(np.sum(np.abs(mode.shape / now.noise) ** 2, axis=0)))])
            omega = samples.fundamental
            state = (initial[:, row] + 1j * initial[:, row + 1]) * np.exp(1j * turn * omega * begins)
            mode = mode.turned(turn, omega, samples.step)
            if mode.exponent.imag < 0.0:
                state, mode = state.conj(), mode.conjugate()
            initial[:, row], initial[:, row + 1] = state.real, state.imag
        modes.append(mode)
        row += mode.rows
    found = predicted(samples, modes, now.columns, initial, now.whitening)
    return now if found is None else found
