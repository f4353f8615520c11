"""Search for the modes of the innovations form: candidates one after another, bands of harmonics by tests."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from floquid.innovations._autoregression import first_innovations
from floquid.innovations._predictor import Mode, Predictor, as_complex, predicted
from floquid.innovations._solve import Normal, normal_of, places, solve
from floquid.inputs import (
    InputMode,
    Limits,
    Samples,
    bare_mode,
    candidates,
    fitted_together,
    input_gain,
    limit_of,
    linearise,
)

STABLE = (0.8, 0.5)
"""Shares of the looks at which a candidate comes up from which on a search begins with it: the better of both."""

LEAST = 0.1
"""The share from which on it is tried later."""

TRIED = 4
"""Candidates that are fitted beside the modes in vain before the search ends."""

ROUNDS = 10
"""Rounds in which bands may grow."""

STRIDE = 2
"""Harmonics beyond the end of a band that are looked at."""

SHRUNK = (1.0, 0.7, 0.4, 0.2, 0.05)
"""Factors of the gains of the innovations at which a predictor is tried."""

REAL = 1e-9
"""The share of ω within which the frequency of a candidate is that of a real multiplier."""

OFF_AXIS = 20.0
"""Deviations off the axis from which on a multiplier is not tried as a real one."""

NEAR = 0.05
"""The distance from the axis over the decay up to which it is tried whatever its deviation."""

APART = (0.8, 1.25)
"""Factors of the decay at which two real multipliers begin."""

DOUBTFUL = 5.0
"""The squared deviations of a mode's gains over the limit, from which on no fit without it is tried."""

HOPELESS = 5.0
"""The loss by leaving a mode out, over the limit, from which on no harmonics of others are grown to make it up."""

LOOSE = 1e-2
"""The probability at which noise may pass for a harmonic at the end: one that is missing does more harm."""


def searched(
    samples: Samples, limits: Limits, report: Callable[[str], None] = lambda _: None, *, acting: int = 0
) -> Predictor:
    """The predictor of the modes that rise above the noise, from outputs alone or with measured inputs.

    The first inputs, `acting` of them, are known columns as well: they act on the outputs at once.
    """
    report("taking first innovations from an autoregression")
    first = first_innovations(samples, acting)
    driven = replace(samples, inputs=np.concatenate([samples.inputs, first]), hold="none")
    now = _none(samples)
    poles, shares = candidates(driven, now.innovations)
    begun = {max(int(np.count_nonzero(shares >= stable)), 1) for stable in STABLE}
    trials = {count: _with(samples, driven, now, poles[:count].tolist(), limits) for count in sorted(begun)}
    tried, failed = min(begun), 0
    for count, trial in trials.items():
        trial = None if trial is None else _grown(samples, trial, limits, rounds=1)
        if trial is not None and _better(trial, now, limits):
            now, tried = trial, count
    report(f"searching for modes: {len(now.modes)} found")
    for exponent in poles[tried:][shares[tried:] >= LEAST].tolist():
        own = replace(driven, inputs=np.concatenate([samples.inputs, now.innovations]))
        trial = _with(samples, own, now, [exponent], limits)
        if trial is not None and _better(trial, now, limits):
            now, failed = _grown(samples, trial, limits, rounds=1), 0
            report(f"searching for modes: {len(now.modes)} found")
        else:
            failed += trial is not None
        if failed == TRIED or len(now.modes) >= limits.modes:
            break
    now = _needed(samples, _grown(samples, now, limits), limits)
    now = _with_real_ones(samples, now, limits)
    loose = replace(limits, harmonic_alarm=LOOSE)
    now = _narrowed(samples, _grown(samples, now, loose, rounds=2), loose)
    return solve(samples, _rebuilt(samples, now, [mode.padded(1.0, limits.highest) for mode in now.modes]) or now)


def _none(samples: Samples) -> Predictor:
    """Without modes: the known columns alone."""
    columns = np.asarray(np.linalg.lstsq(samples.known.T, samples.values.T, rcond=None)[0].T, np.float64)
    found = predicted(samples, [], columns, np.zeros((len(samples.records), 0)))
    assert found is not None
    return found


def _better(trial: Predictor, now: Predictor, limits: Limits) -> bool:
    """True where noise does not explain what a fit with more gains, by its probability and by the criterion."""
    more = max(trial.n_parameters - now.n_parameters, 1)
    sure = trial.log_likelihood - now.log_likelihood > limit_of(more, limits.mode_alarm)
    return sure and _criterion(trial) < _criterion(now)


def _with(
    samples: Samples, driven: Samples, now: Predictor, exponents: list[complex], limits: Limits
) -> Predictor | None:
    """The predictor with modes of some exponents more, driven by the innovations of now; None where none is stable."""
    if not exponents:
        return None
    bare = [_bare(driven, exponent) for exponent in exponents]
    gain, driven_modes = fitted_together(driven, now.innovations, bare, acting=0)
    products = sum(2 * len(own.turns) * (own.gains.size + len(samples.records)) for own in bare)
    if gain < limit_of(len(now.innovations) * products, limits.mode_alarm):
        return None
    seen = linearise(replace(driven, values=now.innovations), driven_modes)
    modes = []
    for number, mode in enumerate(driven_modes):
        shape = seen.shape(number)
        gains = [
            input_gain(mode.exponent, turn, samples.fundamental, samples.step, "none")[0]
            for turn in mode.reach.tolist()
        ]
        modes.append(
            Mode(
                exponent=mode.exponent,
                real=mode.real,
                turns=mode.turns,
                shape=shape.T,
                reach=mode.reach,
                gains=mode.gains * np.array(gains),
            ).scaled()
        )
    for share in SHRUNK:
        shrunk = [replace(mode, gains=share * mode.gains) for mode in modes]
        trial = _rebuilt(samples, now, [*now.modes, *shrunk])
        if trial is not None:
            return solve(samples, trial, rough=True)
    return None


def _bare(driven: Samples, exponent: complex) -> InputMode:
    """A candidate with one harmonic on either side; a real multiplier where its frequency is one's."""
    half = 0.5 * round(2.0 * exponent.imag / driven.fundamental)
    if abs(exponent.imag - half * driven.fundamental) > REAL * driven.fundamental:
        turns = np.arange(-1.0, 2.0)
        return bare_mode(driven, exponent, turns, turns)
    turns = np.arange(half % 1.0, 2.0)
    return bare_mode(driven, complex(exponent.real), turns, turns, real=True)


def _with_real_ones(samples: Samples, now: Predictor, limits: Limits) -> Predictor:
    """With pairs near the axis of real multipliers taken for one such, or for two, where that explains as much."""
    normal, omega = normal_of(samples, now, rough=True), samples.fundamental
    spread = np.sqrt(np.maximum(np.diag(normal.inverse()), 0.0))
    for number, (mode, place) in enumerate(zip(now.modes, places(now.modes), strict=True)):
        half = 0.5 * round(2.0 * mode.exponent.imag / omega)
        away = abs(mode.exponent.imag - half * omega)
        if mode.real or away > max(NEAR * abs(mode.exponent.real), OFF_AXIS * spread[place.start + 1]):
            continue
        rest = [own for k, own in enumerate(now.modes) if k != number]
        for count in (1, 2):
            bare = replace(now, initial=np.zeros((len(samples.records), 0)))
            trial = _rebuilt(samples, bare, [*rest, *_as_real(samples, now, mode, half, count)])
            trial = None if trial is None else _grown(samples, solve(samples, trial, rough=True), limits)
            if trial is not None and _criterion(trial) < _criterion(now):
                return _with_real_ones(samples, trial, limits)
    return now


def _as_real(samples: Samples, now: Predictor, mode: Mode, half: float, count: int) -> list[Mode]:
    """One real multiplier, or two, for a pair on their axis, by the first products of shape and gains of its states.

    With z = a + ib, y is Re(s) a - Im(s) b, and Re(g) drives a, Im(g) drives b.
    """
    noise = np.sqrt(np.diag(now.covariance))[:, None]
    drives = np.concatenate([np.sqrt(np.mean(samples.inputs**2, axis=1))[:, None], noise])
    gains = mode.gains * np.exp(-1j * half * samples.fundamental * samples.step) * drives
    turns, shapes = _folded(mode.turns + half, np.array([1.0, 1j])[:, None, None] * mode.shape / noise)
    reach, driven = _folded(mode.reach - half, np.array([1.0, -1j])[:, None, None] * gains)
    seen, reached = (
        np.array([np.concatenate([one.real.ravel(), one.imag.ravel()]) for one in own]) for own in (shapes, driven)
    )
    left, values, right = np.linalg.svd(seen.T @ reached, full_matrices=False)
    return [
        Mode(
            exponent=complex(factor * mode.exponent.real),
            real=True,
            turns=turns,
            shape=as_complex(values[k] * left[:, k]).reshape(shapes[0].shape) * noise,
            reach=reach,
            gains=as_complex(right[k]).reshape(driven[0].shape) / drives,
        )
        for k, factor in enumerate(APART if count == 2 else (1.0,))
    ]


def _folded(turns: NDArray[np.float64], values: NDArray) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
    """Harmonics from zero on, and amplitudes whose real part is that of some of both signs (..., turns)."""
    found = np.unique(np.abs(turns))
    folded = np.zeros((*values.shape[:-1], len(found)), complex)
    for turn, own in zip(turns, np.moveaxis(values, -1, 0), strict=True):
        folded[..., np.searchsorted(found, abs(turn))] += own.conj() if turn < 0.0 else own if turn > 0.0 else own.real
    return found, folded


def _criterion(own: Predictor) -> float:
    """The criterion of Schwarz (1978)."""
    return own.n_parameters * np.log(own.innovations.shape[1]) - own.log_likelihood


def _rebuilt(samples: Samples, now: Predictor, modes: list[Mode]) -> Predictor | None:
    """The predictor of other modes, those of now first; states that are new begin at zero."""
    size = sum(mode.rows for mode in modes)
    initial = np.zeros((len(samples.records), size))
    width = min(size, now.initial.shape[1])
    initial[:, :width] = now.initial[:, :width]
    return predicted(samples, modes, now.columns, initial)


def _grown(samples: Samples, now: Predictor, limits: Limits, rounds: int = ROUNDS) -> Predictor:
    """The predictor with the harmonics beside its bands whose scores rise above the noise.

    While modes are missing few rounds are enough: bands would grow to make up for them.
    """
    for _ in range(rounds if now.modes else 0):
        padded = _rebuilt(samples, now, [mode.padded(STRIDE, limits.highest) for mode in now.modes])
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
        start = _rebuilt(samples, now, modes)
        assert start is not None
        now = _centred(samples, solve(samples, start, rough=True))
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


def _narrowed(samples: Samples, now: Predictor, limits: Limits) -> Predictor:
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
                        if _weight(mode, spread, gone) > limit_of(
                            2 * int(gone[which].sum()) * _rows(mode, which), limits.harmonic_alarm
                        ):
                            break
                        band &= ~one
            modes.append(mode.widened(mode.turns[turns], mode.reach[reach]))
        if all(
            len(a.turns) == len(b.turns) and len(a.reach) == len(b.reach) for a, b in zip(modes, now.modes, strict=True)
        ):
            return now
        trial = _rebuilt(samples, now, modes)
        if trial is None:
            return now
        trial = solve(samples, trial, rough=True)
        if now.log_likelihood - trial.log_likelihood > limit_of(
            now.n_parameters - trial.n_parameters, limits.mode_alarm
        ):
            return now
        now = trial
    return now


def _rows(mode: Mode, which: int) -> int:
    return len(mode.gains) if which else len(mode.shape)


def _weight(mode: Mode, spread: NDArray[np.float64], gone: list[NDArray[np.bool_]]) -> float:
    """How far the parameters of some harmonics are from zero, in squared deviations."""
    mask = _mask(mode, *gone)
    parts = [np.zeros(mode.rows)]
    for values in (mode.gains, mode.shape):
        parts += [values.real.ravel(), values.imag.ravel()]
    own = np.concatenate(parts)[mask]
    return float(own @ np.linalg.pinv(spread[np.ix_(mask, mask)], hermitian=True) @ own)


def _needed(samples: Samples, now: Predictor, limits: Limits) -> Predictor:
    """Without modes that noise explains once all others are fitted again."""
    while len(now.modes) > 1:
        inverse, trials = normal_of(samples, now, rough=True).inverse(), []
        for number, (mode, place) in enumerate(zip(now.modes, places(now.modes), strict=True)):
            everywhere = [np.zeros(len(mode.turns), bool), np.ones(len(mode.reach), bool)]
            if _weight(mode, inverse[place, place], everywhere) > DOUBTFUL * limit_of(
                2 * mode.gains.size, limits.mode_alarm
            ):
                continue
            modes = [mode for k, mode in enumerate(now.modes) if k != number]
            trial = _rebuilt(samples, replace(now, initial=np.zeros((len(samples.records), 0))), modes)
            if trial is not None:
                trials.append(solve(samples, trial, rough=True))
        if not trials:
            return now
        best = max(trials, key=lambda own: own.log_likelihood)
        limit = limit_of(now.n_parameters - best.n_parameters, limits.mode_alarm)
        if now.log_likelihood - best.log_likelihood > HOPELESS * limit:
            return now
        best = _grown(samples, best, limits)
        if _better(now, best, limits):
            return now
        now = best
    return now


def _centred(samples: Samples, now: Predictor) -> Predictor:
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
