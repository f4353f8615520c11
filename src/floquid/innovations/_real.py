"""Pairs on the axis of real multipliers, taken for such."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from floquid.innovations._bands import grown
from floquid.innovations._predictor import Mode, Predictor, as_complex, rebuilt
from floquid.innovations._solve import normal_of, places, solve
from floquid.inputs import Limits, Samples

OFF_AXIS = 20.0
"""Deviations off the axis from which on a multiplier is not tried as a real one."""

NEAR = 0.05
"""The distance from the axis over the decay up to which it is tried whatever its deviation."""

APART = (0.8, 1.25)
"""Factors of the decay at which two real multipliers begin."""


def with_real_ones(samples: Samples, now: Predictor, limits: Limits) -> Predictor:
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
            trial = rebuilt(samples, bare, [*rest, *_as_real(samples, now, mode, half, count)])
            trial = None if trial is None else grown(samples, solve(samples, trial, rough=True), limits)
            if trial is not None and trial.criterion < now.criterion:
                return with_real_ones(samples, trial, limits)
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
