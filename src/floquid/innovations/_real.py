"""Pairs on the axis of real multipliers, taken for such."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from floquid.innovations._bands import grown, narrowed
from floquid.innovations._fewer import hopeless, stable
from floquid.innovations._mode import Mode, as_complex
from floquid.innovations._predictor import Predictor
from floquid.innovations._solve import normal_of, places, solve
from floquid.inputs import Limits, Samples

OFF_AXIS = 20.0
"""Deviations off the axis from which on a multiplier is not tried as a real one."""

NEAR = 0.05
"""The distance from the axis over the decay up to which it is tried whatever its deviation."""

NEITHER = 4.0
"""Deviations off the axis up to which a record does not tell a pair from two real multipliers."""

SAME = 2.0
"""Deviations within which exponents of both kinds are the same."""

KIND = 25.0
"""Twice the difference in the logarithm of the likelihood below which a record does not tell the kind."""

APART = (0.8, 1.25)
"""Factors of the decay at which two real multipliers begin."""


def with_real_ones(
    samples: Samples, now: Predictor, limits: Limits, before: Sequence[bool] = ()
) -> tuple[Predictor, list[bool]]:
    """With pairs near the axis of real multipliers taken for one such, or for two, by the criterion.

    With whether the record leaves undecided that a mode is one of two real multipliers, or the pair (modes,): where
    both kinds have the same exponents within their deviations it does not matter.
    """
    undecided = list(before) or [False] * len(now.modes)
    normal, omega = normal_of(samples, now, rough=True), samples.fundamental
    spread = np.sqrt(np.maximum(np.diag(normal.inverse()), 0.0))
    for number, (mode, place) in enumerate(zip(now.modes, places(now.modes), strict=True)):
        rest, turns = [own for k, own in enumerate(now.modes) if k != number], mode.exponent.imag / omega
        for half, count in product((0.5 * np.floor(2.0 * turns), 0.5 * np.ceil(2.0 * turns)), (1, 2)):
            away, std = abs(turns - half) * omega, spread[place.start + 1]
            if mode.real or away > max(NEAR * abs(mode.exponent.real), OFF_AXIS * std):
                continue
            # A real multiplier needs harmonics that the pair did without.
            some = [own.padded(1.0, limits.highest) for own in _as_real(samples, now, mode, half, count)]
            trial = stable(samples, now, [*rest, *some], limits)
            better, gained = False, -np.inf
            if trial is not None:
                trial = solve(samples, trial, rough=True)
                if count == 2 or not hopeless(trial, now, limits):
                    trial = narrowed(samples, grown(samples, trial, limits), limits)
                better, gained = trial.criterion < now.criterion, trial.log_likelihood - now.log_likelihood
            near, decays = away < NEITHER * std, [own.exponent.real for own in trial.modes[-2:]] if trial else []
            alike = [abs(own - mode.exponent.real) < SAME * spread[place.start] for own in decays]
            same = bool(decays) and all(alike) and away < SAME * std
            told = gained > KIND if better else gained < -KIND and not near
            if count == 2 and not told and not same:
                undecided[number] = True
            if trial is not None and better:
                others = [own for k, own in enumerate(undecided) if k != number]
                return with_real_ones(samples, trial, limits, [*others, *[undecided[number]] * count])
    return now, undecided


def _as_real(samples: Samples, now: Predictor, mode: Mode, half: float, count: int) -> list[Mode]:
    """One real multiplier, or two, for a pair on their axis, by the first products of shape and gains of its states.

    With z = a + ib, y is Re(s) a - Im(s) b, and Re(g) drives a, Im(g) drives b.
    """
    noise = now.noise
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
