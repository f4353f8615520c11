"""Search for the modes of the innovations form: candidates one after another, bands of harmonics by tests."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from floquid.innovations._bands import grown, narrowed, weight
from floquid.innovations._predictor import Mode, Predictor, predicted, rebuilt
from floquid.innovations._real import with_real_ones
from floquid.innovations._solve import normal_of, places, solve
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

SHRUNK = (1.0, 0.7, 0.4, 0.2, 0.05)
"""Factors of the gains of the innovations at which a predictor is tried."""

REAL = 1e-9
"""The share of ω within which the frequency of a candidate is that of a real multiplier."""

DOUBTFUL = 5.0
"""The squared deviations of a mode's gains over the limit, from which on no fit without it is tried."""

HOPELESS = 5.0
"""The loss by leaving a mode out, over the limit, from which on no harmonics of others are grown to make it up."""

LOOSE = 1e-2
"""The probability at which noise may pass for a harmonic at the end: one that is missing does more harm."""


def searched(
    samples: Samples,
    first: NDArray[np.float64],
    limits: Limits,
    report: Callable[[str], None] = lambda _: None,
) -> Predictor:
    """The predictor of the modes that rise above the noise, from outputs alone or with measured inputs.

    It begins with first innovations (channels, samples). Units do not matter: all is done on signals of rms 1.
    """
    outputs = np.sqrt(np.diag(_none(samples).covariance))[:, None]
    inputs, known = (np.sqrt(np.mean(own**2, axis=1, keepdims=True)) for own in (samples.inputs, samples.known))
    of_one = replace(
        samples, values=samples.values / outputs, inputs=samples.inputs / inputs, known=samples.known / known
    )
    found = _searched(of_one, first / outputs, limits, report)
    modes = [
        replace(mode, shape=outputs * mode.shape, gains=mode.gains / np.concatenate([inputs, outputs]))
        for mode in found.modes
    ]
    at = predicted(samples, modes, outputs * found.columns / known.T, found.initial)
    assert at is not None
    return at


def _searched(samples: Samples, first: NDArray[np.float64], limits: Limits, report: Callable[[str], None]) -> Predictor:
    driven = replace(samples, inputs=np.concatenate([samples.inputs, first]), hold="none")
    now = _none(samples)
    poles, shares = candidates(driven, now.innovations)
    begun = {max(int(np.count_nonzero(shares >= stable)), 1) for stable in STABLE}
    trials = {count: _with(samples, driven, now, poles[:count].tolist(), limits) for count in sorted(begun)}
    tried, failed = min(begun), 0
    for count, trial in trials.items():
        trial = None if trial is None else grown(samples, trial, limits, rounds=1)
        if trial is not None and _better(trial, now, limits):
            now, tried = trial, count
    report(f"searching for modes: {len(now.modes)} found")
    for exponent in poles[tried:][shares[tried:] >= LEAST].tolist():
        own = replace(driven, inputs=np.concatenate([samples.inputs, now.innovations]))
        trial = _with(samples, own, now, [exponent], limits)
        if trial is not None and _better(trial, now, limits):
            now, failed = grown(samples, trial, limits, rounds=1), 0
            report(f"searching for modes: {len(now.modes)} found")
        else:
            failed += trial is not None
        if failed == TRIED or len(now.modes) >= limits.modes:
            break
    now = _needed(samples, grown(samples, now, limits), limits)
    now = with_real_ones(samples, now, limits)
    loose = replace(limits, harmonic_alarm=LOOSE)
    now = narrowed(samples, grown(samples, now, loose, rounds=2), loose)
    return solve(samples, rebuilt(samples, now, [mode.padded(1.0, limits.highest) for mode in now.modes]) or now)


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
    return sure and trial.criterion < now.criterion


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
        trial = rebuilt(samples, now, [*now.modes, *shrunk])
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


def _needed(samples: Samples, now: Predictor, limits: Limits) -> Predictor:
    """Without modes that noise explains once all others are fitted again."""
    while len(now.modes) > 1:
        inverse, trials = normal_of(samples, now, rough=True).inverse(), []
        for number, (mode, place) in enumerate(zip(now.modes, places(now.modes), strict=True)):
            everywhere = [np.zeros(len(mode.turns), bool), np.ones(len(mode.reach), bool)]
            if weight(mode, inverse[place, place], everywhere) > DOUBTFUL * limit_of(
                2 * mode.gains.size, limits.mode_alarm
            ):
                continue
            modes = [mode for k, mode in enumerate(now.modes) if k != number]
            trial = rebuilt(samples, replace(now, initial=np.zeros((len(samples.records), 0))), modes)
            if trial is not None:
                trials.append(solve(samples, trial, rough=True))
        if not trials:
            return now
        best = max(trials, key=lambda own: own.log_likelihood)
        limit = limit_of(now.n_parameters - best.n_parameters, limits.mode_alarm)
        if now.log_likelihood - best.log_likelihood > HOPELESS * limit:
            return now
        best = grown(samples, best, limits)
        if _better(now, best, limits):
            return now
        now = best
    return now
