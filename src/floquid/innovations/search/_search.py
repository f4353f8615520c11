"""Search for the modes of the innovations form: candidates one after another, bands of harmonics by tests."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from floquid._arrays import Complexes, Floats
from floquid.core import NearAxis
from floquid.errors import IdentificationError
from floquid.fit import FEW_STEPS, OFF, ROUNDS, chi2_limit
from floquid.innovations._covariance import SMALL, reweighed, stable_gains, white, whitening_of
from floquid.innovations._mode import Mode
from floquid.innovations._predictor import Predictor, predicted, rebuilt
from floquid.innovations._products import APART
from floquid.innovations._solve import climbed, solve
from floquid.innovations.search._bands import bent, centred, grown, narrowed
from floquid.innovations.search._fewer import GONE, better, least, needed, spared, stable
from floquid.innovations.search._near_axis import read_near_axis, with_near_blocks, with_real_ones
from floquid.inputs import (
    InputMode,
    Limits,
    Samples,
    bare_mode,
    candidates,
    chosen_together,
    fitted_freely,
    fitted_together,
    input_gain,
)
from floquid.inputs import solve as solve_driven
from floquid.search import LOOSE

STABLE = (0.5, 0.3, 0.2)
"""Shares of the looks at which a candidate comes up, from which on a search begins with it: until all is white."""

TRIED = 3  # candidates that are fitted one after another, those first that promise most: each takes long
SHRUNK = (1.0, 0.5, 0.2, 0.05)  # factors of the gains of new modes at which a predictor is tried

PARTNERS = (0.1, 0.3, 1.0)
"""Decays over a period, beyond that of a real multiplier that lasts, at which a second one is looked for."""


def searched(
    samples: Samples, first: Floats, limits: Limits, report: Callable[[str], None] = lambda _: None
) -> tuple[NearAxis[Predictor], bool]:
    """The predictor of the modes that rise above the noise, from outputs alone or with measured inputs."""
    outputs = _none(samples).noise
    inputs, known = (np.sqrt(np.mean(own**2, axis=1, keepdims=True)) for own in (samples.inputs, samples.known))
    of_one = replace(
        samples, values=samples.values / outputs, inputs=samples.inputs / inputs, known=samples.known / known
    )
    near, unfinished = _searched(of_one, first / outputs, limits.begun(), report)
    found = near.at
    modes = [
        replace(mode, shape=outputs * mode.shape, gains=mode.gains / np.concatenate([inputs, outputs]))
        for mode in found.modes
    ]
    # What was read near an axis may grow over the records, as long as its innovations do not.
    at = predicted(samples, modes, outputs * found.columns / known.T, found.initial, growing=True)
    if at is None:
        raise IdentificationError("Identification ended without a result: the predictor of the modes found diverges.")
    return replace(near, at=reweighed(samples, at)), unfinished


def _searched(
    samples: Samples, first: Floats, limits: Limits, report: Callable[[str], None]
) -> tuple[NearAxis[Predictor], bool]:
    driven = replace(samples, inputs=np.concatenate([samples.inputs, first]), hold="none")
    none = now = replace(_none(samples), whitening=whitening_of(samples, first))
    of_known, period = replace(driven, values=none.innovations), 2.0 * np.pi / samples.fundamental
    poles, shares = candidates(driven, none.innovations, held=len(samples.inputs) > 0)
    bare = [_bare(driven, pole, limits) for pole in poles.tolist()]
    counts = sorted({int(np.count_nonzero(shares >= share)) for share in STABLE})
    for begun in (bare[:count] for count in counts if count):
        chosen = chosen_together(of_known, begun, limits.most, acting=0)
        trial = _with(samples, of_known, none, chosen, limits)
        trial = None if trial is None else grown(samples, trial, limits)
        if trial is not None and better(trial, now, limits):
            now = trial
        if limits.over or (now.modes and white(samples, now, limits.mode_alarm)):
            break
    # Of modes that are gone within a period free matrices at each phase are a start, too.
    brief = all(-mode.exponent.real * period > GONE for mode in now.modes)
    if brief and not (limits.over or white(samples, now, limits.mode_alarm)):
        trial = _with(samples, of_known, none, _of_phases(driven, limits), limits)
        trial = None if trial is None else narrowed(samples, trial, limits)
        if trial is not None and trial.criterion > now.criterion:
            now = trial
    report(f"searching for modes: {len(now.modes)} found")
    while limits.room(now.modes) and not (limits.over or white(samples, now, limits.mode_alarm)):
        more = _with_one_more(samples, driven, now, poles, limits)
        if more is None:
            break
        now = grown(samples, more, limits, rounds=1)
        report(f"searching for modes: {len(now.modes)} found")
    report("searching for modes: looking for harmonics")
    now = grown(samples, reweighed(samples, now), limits)
    report(f"searching for modes: which of {len(now.modes)} are needed")
    now = needed(samples, now, limits)
    loose = replace(limits, harmonic_alarm=LOOSE)
    report(f"searching for modes: harmonics of {len(now.modes)}")
    now = narrowed(samples, grown(samples, reweighed(samples, now), loose, rounds=2), loose)
    report("searching for modes: telling pairs from real multipliers")
    now = with_real_ones(samples, now, loose)
    fewer = needed(samples, now, loose)
    while fewer is not now:
        now = with_real_ones(samples, fewer, loose)
        fewer = needed(samples, now, loose)
    now = _with_partners(samples, driven, now, loose)
    # Where two real multipliers meet a fit creeps, and one of their block does not.
    now = now if limits.over else with_near_blocks(samples, now, loose, pairs=False)
    now, unfinished = _to_the_end(samples, now, loose, report)
    now = centred(samples, now)
    return read_near_axis(samples, now if unfinished else with_near_blocks(samples, now, loose)), unfinished


def _to_the_end(
    samples: Samples, now: Predictor, limits: Limits, report: Callable[[str], None]
) -> tuple[Predictor, bool]:
    """The fit with a harmonic more at each end of the bands, and whether the time was over before."""
    for more_left in reversed(range(ROUNDS)):
        unfinished = limits.over
        report(f"fitting {len(now.modes)} modes")
        wide = rebuilt(samples, now, [mode.padded(1.0, limits.highest) for mode in now.modes]) or now
        start = reweighed(samples, wide)
        wide = solve(samples, start, rough=unfinished)  # a fit to the end may take as long again
        more = max(wide.n_parameters - now.n_parameters, 1)
        settled = wide.log_likelihood - start.log_likelihood < chi2_limit(more, limits.mode_alarm)
        if not more_left or (settled and (limits.over or not bent(samples, wide, limits))):
            break
        if unfinished := limits.over:
            break
        # Rough fits had stopped short of it: harmonics are to be looked for again.
        now = wide if settled else narrowed(samples, grown(samples, wide, limits, rounds=2), limits)
    return wide, unfinished


def _with_one_more(
    samples: Samples, driven: Samples, now: Predictor, before: Complexes, limits: Limits
) -> Predictor | None:
    """The predictor with the candidate that explains most of the innovations; None where noise does."""
    own = replace(driven, inputs=np.concatenate([samples.inputs, now.innovations]), values=now.innovations)
    poles = np.concatenate([candidates(own, now.innovations, held=len(samples.inputs) > 0)[0], before])
    ranked = [fitted_together(own, now.innovations, [_bare(own, pole, limits)], acting=0) for pole in poles.tolist()]
    ranked.sort(key=lambda one: -one[0])
    # Coloured excitation has several poles at one place, and candidates hold one: another beside it comes first.
    period, beside = 2.0 * np.pi / samples.fundamental, []
    for mode in now.modes:
        if -mode.exponent.real * period > GONE:
            pole = complex(APART[0] * mode.exponent.real, mode.axis * samples.fundamental + mode.exponent.imag)
            beside.append(fitted_together(own, now.innovations, [_bare(own, pole, limits)], acting=0))
    for gain, modes in [*beside, *ranked[:TRIED]]:
        products = 2 * modes[0].turns.size * (modes[0].gains.size + len(samples.records))
        if limits.over or gain < chi2_limit(len(now.innovations) * products, limits.mode_alarm):
            continue
        trial = _with(samples, own, now, modes, limits)
        trial = None if trial is None else climbed(samples, trial)
        if trial is not None and better(trial, now, limits):
            return trial
    return None


def _with_partners(samples: Samples, driven: Samples, now: Predictor, limits: Limits) -> Predictor:
    """With a real multiplier more beside one that lasts alone on its axis, where noise does not explain it."""
    # Real multipliers come in twos where a pair split. The one that decays faster is weak beside one that grows, and
    # what is left may look white without it, or beside a mode gone within a period that stands in for it; but the
    # deviation of the other is too small then.
    omega, period = samples.fundamental, 2.0 * np.pi / samples.fundamental
    real = [mode for mode in now.modes if mode.real]
    for half in (0.0, 0.5):
        near = [mode for mode in real if mode.axis == half]
        if len(near) != 1 or -near[0].exponent.real * period > GONE or not limits.room(now.modes) or limits.over:
            continue
        poles = [complex(near[0].exponent.real - share / period, half * omega) for share in PARTNERS]
        gone = [mode for mode in now.modes if -mode.exponent.real * period > GONE]
        for stand_in in (None, *gone):
            trial = _with_one_of(samples, driven, now, stand_in, poles, limits)
            if trial is not None and better(trial, now, limits):
                now = trial
                break
    return now


def _with_one_of(
    samples: Samples, driven: Samples, now: Predictor, without: Mode | None, poles: Sequence[complex], limits: Limits
) -> Predictor | None:
    """The fit with the best of some candidates more, in place of a mode where one is given; None where none is."""
    start: Predictor | None = now
    if without is not None:
        start = stable(samples, now, [mode for mode in now.modes if mode is not without], limits)
        start = None if start is None else solve(samples, start, rough=True)
    if start is None or limits.over:
        return None
    own = replace(driven, inputs=np.concatenate([samples.inputs, start.innovations]), values=start.innovations)
    trials = [fitted_together(own, start.innovations, [_bare(own, pole, limits)], acting=0) for pole in poles]
    trial = _with(samples, own, start, max(trials, key=lambda one: one[0])[1], limits)
    return None if trial is None else narrowed(samples, climbed(samples, trial), limits)


def _none(samples: Samples) -> Predictor:
    """Without modes: the known columns alone."""
    columns = np.asarray(np.linalg.lstsq(samples.known.T, samples.values.T, rcond=None)[0].T, np.float64)
    found = predicted(samples, [], columns, np.zeros((len(samples.records), 0)))
    assert found is not None
    return found


def _with(
    samples: Samples, driven: Samples, now: Predictor, more: Sequence[InputMode], limits: Limits
) -> Predictor | None:
    """The predictor with modes more, as fitted to the innovations of now; None where none is stable."""
    if not more:
        return None
    seen = solve_driven(driven, more, iterations=FEW_STEPS // 2)
    begun = []
    for number, mode in enumerate(seen.modes):
        gains = [
            input_gain(mode.exponent, turn, samples.fundamental, samples.step, "none")[0]
            for turn in mode.reach.tolist()
        ]
        begun.append(
            Mode(
                exponent=mode.exponent,
                real=mode.real,
                turns=mode.turns,
                shape=seen.shape(number).T,
                reach=mode.reach,
                gains=mode.gains * np.array(gains),
            ).scaled()
        )
    starts = [stable_gains(samples, [*now.modes, *begun], seen.left @ seen.left.T / samples.count, limits.highest)]
    starts += [[*now.modes, *(replace(mode, gains=share * mode.gains) for mode in begun)] for share in SHRUNK]
    for start in starts:
        trial = rebuilt(samples, now, start)
        if trial is not None and trial.log_likelihood > now.log_likelihood:
            trial = solve(samples, trial, rough=True, steps=FEW_STEPS // 3)
            # A fit creeps while modes make up for each other: those that noise explains go before it ends. Of one that
            # came alone it is told at the end.
            less = spared(samples, trial, limits) if len(more) > 1 else None
            if less is not None:
                enough = least(less, trial, limits)
                less = solve(samples, less, rough=True, least=enough)
                if less.log_likelihood >= enough:
                    return narrowed(samples, less, limits)
            return solve(samples, trial, rough=True)
    return None


def _bare(driven: Samples, exponent: complex, limits: Limits) -> InputMode:
    """A candidate with one harmonic on either side at most; a real multiplier where it is all but on an axis."""
    half, most = 0.5 * round(2.0 * exponent.imag / driven.fundamental), min(1.0, np.floor(limits.highest))
    if abs(exponent.imag - half * driven.fundamental) > OFF * abs(exponent.real):
        turns = np.arange(-most, most + 0.5)
        return bare_mode(driven, exponent, turns, turns)
    turns = np.arange(half % 1.0, most + 0.75)
    return bare_mode(driven, complex(exponent.real), turns, turns, real=True)


def _of_phases(driven: Samples, limits: Limits) -> list[InputMode]:
    """Modes of matrices at each phase that are free, with the harmonics that are not small."""
    # A mode that is gone within a period seldom is a candidate: each phase knows it by another decay.
    found, modes, highest = fitted_freely(driven, limits.order), [], limits.highest
    if found is None:
        return []
    for number, mode in enumerate(found.modes):
        shape = found.shape(number)
        bands = []
        for turns, size in ((mode.turns, np.abs(shape).max(axis=1)), (mode.reach, np.abs(mode.gains).max(axis=0))):
            large = turns[size > SMALL * size.max()]
            bands.append((turns >= max(large[0], -highest)) & (turns <= min(large[-1], highest)))
        seen, driving = bands
        if seen.any() and driving.any():
            own = replace(mode, turns=mode.turns[seen], reach=mode.reach[driving], gains=mode.gains[:, driving])
            modes.append(own)
    return modes
