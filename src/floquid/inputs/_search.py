"""Search for modes with inputs: some together, those of the residual one after another, without what noise explains."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from floquid.fit import chi2_limit
from floquid.inputs._bands import ROUGH, centred, grown, narrowed, with_reach
from floquid.inputs._joint import chosen_together, fitted_together
from floquid.inputs._modes import InputMode
from floquid.inputs._real import with_real_ones
from floquid.inputs._samples import Samples
from floquid.inputs._scores import Limits, Scores, driven_by_noise
from floquid.inputs._solver import LAGS, Linearisation, solve
from floquid.inputs._start import bare_mode, candidates

TRIED = 4
"""Candidates that are fitted beside the modes before the search ends."""

REACH = 1
"""Harmonics of inputs and outputs on either side of the largest that a candidate has at first."""

START = (1, 2)
"""Harmonics of input and output on either side that a candidate has."""

DOUBTFUL = 5.0
"""The squared deviations of a mode's shape over the limit, from which on no fit without it is tried."""

HOPELESS = 20.0
"""The loss by leaving a mode out, over the limit, from which on no harmonics of others are grown to make it up."""

FIRST = 3
"""Rounds in which bands grow before modes that are needless have gone."""

FEW = 4
"""Modes to begin with up to which a doubtful search, not white or with a real multiplier, is made from one, too."""

TOO_NEAR = 0.5
"""The distance of two modes over their decay below which they may be one."""

WIDE = 15
"""Harmonics of the inputs of one mode from which on a mode may be missing beside it."""

NARROW = 4
"""The highest harmonic of modes that are looked for first, then."""

STABLE = 0.35
"""The share of the looks at which a candidate comes up from which on a search begins with it."""

ROUNDS = 6
"""Fits at most, one after another, with real multipliers for a pair of the modes that are found."""

OFFSET = 1e4
"""The size of a response over what moves in it from which on its offset goes first: squares of it round the rest."""

LOOSE = 0.02
"""The probability at which noise may pass for a harmonic that is fitted: one that is missing does more harm."""


def searched(samples: Samples, limits: Limits, report: Callable[[str], None] = lambda _: None) -> Linearisation:
    """The modes that rise above the noise, with the harmonics by which inputs reach them and outputs see them."""
    offset = np.abs(samples.values).max(axis=1) > OFFSET * samples.swing
    poles, shares = candidates(samples, samples.moving if offset.any() else samples.values)
    turns = np.arange(-REACH, REACH + 1.0)
    bare = [bare_mode(samples, exponent, turns, turns) for exponent in poles[shares >= STABLE].tolist()]
    first = chosen_together(samples, bare, limits.modes)
    now = _found(samples, first, limits, report)
    doubtful = samples.n_samples * now.colour > chi2_limit(LAGS, limits.mode_alarm) or any(m.real for m in now.modes)
    if len(first) > 1 and len(now.modes) > 1 and (_crowded(samples, now) or (len(first) <= FEW and doubtful)):
        # Two poles may stand for one mode of strong harmonics: begin with one, too.
        other = _found(samples, first[:1], replace(limits, modes=min(limits.modes, FEW)), report)
        now = max(now, other, key=lambda own: own.criterion)
    if _wide(now):
        # Very many harmonics may stand for a mode: let modes in before them.
        few = replace(limits, highest=min(limits.highest, NARROW))
        other = _found(samples, first, few, report)
        now = max(now, other, key=lambda own: own.criterion)
    if not now.modes:
        return now
    loose = replace(limits, harmonic_alarm=LOOSE)
    before: Linearisation | None = None
    report(f"searching for modes: harmonics of {len(now.modes)}")
    while now is not before:  # with all their harmonics some modes are others, or needless
        before = narrowed(samples, grown(samples, now, loose, rounds=2), loose)
        now = without_needless(samples, with_real_ones(samples, before, loose, rounds=ROUNDS), loose)
    modes = [centred(samples, mode, now, number) for number, mode in enumerate(now.modes)]
    return solve(samples, [_padded(mode, limits) for mode in modes], now.direct)


def _crowded(samples: Samples, now: Linearisation) -> bool:
    """True where modes of a fit are nearly one, or inputs reach one by very many harmonics."""
    return nearly_one(samples, now) or _wide(now)


def _wide(now: Linearisation) -> bool:
    """True where inputs reach a mode by very many harmonics."""
    return any(len(mode.reach) > WIDE for mode in now.modes)


def nearly_one(samples: Samples, now: Linearisation) -> bool:
    """True where two modes of a fit differ by less than they decay, apart from a multiple of the fundamental."""
    omega, found = samples.fundamental, [mode.exponent for mode in now.modes]
    for number, one in enumerate(found):
        for other in found[:number]:
            gaps = [one - other, one - other.conjugate()]
            near = min(abs(gap - 1j * omega * round(gap.imag / omega)) for gap in gaps)
            if near < TOO_NEAR * min(abs(one.real), abs(other.real)):
                return True
    return False


def _found(
    samples: Samples, first: Sequence[InputMode], limits: Limits, report: Callable[[str], None]
) -> Linearisation:
    """The modes that a search ends with that begins with some."""
    now = grown(samples, solve(samples, first, iterations=ROUGH, rough=True), limits, rounds=FIRST)
    now = narrowed(samples, without_needless(samples, now, limits), limits)
    refused: list[complex] = []
    now = with_real_ones(samples, grown(samples, now, limits), limits, refused)
    report(f"searching for modes: {len(now.modes)} found")
    while len(now.modes) < limits.modes:
        more = _with_one_more(samples, now, limits)
        if more is None:
            break
        now = with_real_ones(samples, narrowed(samples, more, limits), limits, refused)
        report(f"searching for modes: {len(now.modes)} found")
    less = without_needless(samples, now, limits)
    # Beside fewer modes a pair that was no real multiplier may be one.
    return with_real_ones(samples, less, limits, refused if less is now else None)


def _padded(mode: InputMode, limits: Limits) -> InputMode:
    """A mode with one harmonic more at each end of its bands: what is left out has no deviation."""
    ends = mode.turns[-1:] + 1.0 if mode.real else np.array([mode.turns[0] - 1.0, mode.turns[-1] + 1.0])
    turns = np.sort(np.concatenate([mode.turns, ends[np.abs(ends) <= limits.highest]]))
    for turn in mode.reach[-1:] + 1.0 if mode.real else np.array([mode.reach[0] - 1.0, mode.reach[-1] + 1.0]):
        if abs(turn) <= limits.highest:
            mode = with_reach(mode, float(turn))
    return replace(mode, turns=turns)


def _with_one_more(samples: Samples, now: Linearisation, limits: Limits) -> Linearisation | None:
    """The fit with the candidate that explains most of the residual; None where noise does."""
    reach, turns = (np.arange(-most, most + 1.0) for most in START)
    ranked = [
        fitted_together(samples, now.left, [bare_mode(samples, exponent, reach, turns)])
        for exponent in candidates(samples, now.left)[0].tolist()
    ]
    ranked.sort(key=lambda one: -one[0])
    tried: list[complex] = []
    noise = driven_by_noise(Scores(samples, now), limits) if now.modes else -np.inf
    for _, (mode,) in ranked:
        if any(abs(mode.exponent - other) < 0.5 * abs(other.real) for other in tried):
            continue
        tried.append(mode.exponent)
        with suppress(np.linalg.LinAlgError):
            trial = solve(samples, (*now.modes, mode), now.direct, iterations=ROUGH, rough=True)
            trial = grown(samples, trial, limits)
            more = trial.n_parameters - now.n_parameters
            gained = trial.log_likelihood - now.log_likelihood
            sure = gained > chi2_limit(max(more, 1), limits.mode_alarm)
            if sure and trial.criterion - now.criterion > noise:
                return trial
        if len(tried) == (TRIED if noise == -np.inf else 1):
            break
    return None


def without_needless(samples: Samples, now: Linearisation, limits: Limits) -> Linearisation:
    """Without modes that noise explains once all others are fitted again with the harmonics that they then need."""
    refused: set[complex] = set()
    while len(now.modes) > 1:
        weights, rises = Scores(samples, now).of_modes(), []
        for number, mode in enumerate(now.modes):
            own = now.n_parameters / len(now.modes)
            if mode.exponent in refused or weights[number] > DOUBTFUL * chi2_limit(int(own) + 1, limits.mode_alarm):
                continue
            less = [other for k, other in enumerate(now.modes) if k != number]
            trial = solve(samples, less, now.direct, iterations=ROUGH, rough=True)
            rises.append((now.log_likelihood - trial.log_likelihood, number, trial))
        if not rises:
            return now
        rise, number, trial = min(rises, key=lambda one: one[:2])
        limit = chi2_limit(max(now.n_parameters - trial.n_parameters, 1), limits.mode_alarm)
        if rise > HOPELESS * limit:
            return now
        trial = grown(samples, trial, limits)
        limit = chi2_limit(max(now.n_parameters - trial.n_parameters, 1), limits.mode_alarm)
        more = now.criterion - trial.criterion
        if now.log_likelihood - trial.log_likelihood > limit and more > driven_by_noise(Scores(samples, trial), limits):
            refused.add(now.modes[number].exponent)
        else:
            now = trial
    return now
