"""Merge modes that are nearly one, by their best products of shape and gains."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Complexes, Floats
from floquid.fit import HALF_DIGITS
from floquid.innovations._mode import Mode, as_complex
from floquid.innovations._predictor import Predictor
from floquid.inputs import Samples

APART = (0.8, 1.25)  # factors of the decay between which several real multipliers begin


def gap_of(first: Mode, second: Mode, omega: float) -> tuple[float, float, bool]:
    """The least distance of two exponents modulo iω [1/s], the turns between them, and whether of the conjugate."""
    at, there = (mode.exponent + 1j * omega * mode.axis for mode in (first, second))
    if first.real and second.real and first.axis != second.axis:
        return np.inf, 0.0, False
    found = []
    for other, exponent in enumerate((there, there.conjugate())):
        turn = round((at - exponent).imag / omega)
        found.append((abs(at - exponent - 1j * turn * omega), float(turn), bool(other)))
    return min(found)


def merged(samples: Samples, now: Predictor, modes: Sequence[Mode], count: int) -> list[Mode]:
    """Fewer pairs, or real states, in place of some modes, with the same products of shape and gains if they can."""
    # Real multipliers where one of the modes is such: a pair near their axis has the products of two.
    halves = [mode.axis for mode in modes if mode.real]
    if halves:
        return as_real(samples, now, modes, halves[0], count)
    omega, noise = samples.fundamental, now.noise
    turned = []
    for mode in modes:
        _, turn, other = gap_of(modes[0], mode, omega)
        turned.append((mode.conjugate() if other else mode).turned(turn, omega, samples.step))
    turns, reach = (
        np.arange(min(own[0] for own in bands), max(own[-1] for own in bands) + 0.5)
        for bands in ([mode.turns for mode in turned], [mode.reach for mode in turned])
    )
    turned = [mode.widened(turns, reach) for mode in turned]
    drives = _drives(samples, now)
    seen = np.array([np.ravel(mode.shape / noise) for mode in turned])
    reached = np.array([np.ravel(mode.gains * drives) for mode in turned])
    left, values, right = np.linalg.svd(seen.T @ reached, full_matrices=False)
    return [
        Mode(
            exponent=complex(np.mean([mode.exponent for mode in turned])),
            real=False,
            turns=turns,
            shape=(values[k] * left[:, k]).reshape(turned[0].shape.shape) * noise,
            reach=reach,
            gains=right[k].reshape(turned[0].gains.shape) / drives,
        ).scaled()
        for k in range(min(count, len(values)))
    ]


def as_real(samples: Samples, now: Predictor, modes: Sequence[Mode], half: float, count: int) -> list[Mode]:
    """Replace pairs near their axis by `count` real multipliers, by the first products of shape and gains."""
    # With z = a + ib of a pair, y is Re(s) a - Im(s) b, and Re(g) drives a, Im(g) drives b.
    omega, noise, drives = samples.fundamental, now.noise, _drives(samples, now)
    seen: list[tuple[Floats, NDArray]] = []
    driven: list[tuple[Floats, NDArray]] = []
    for mode in modes:
        shape, gains = mode.shape / noise, mode.gains * drives
        if mode.real:
            seen.append((mode.turns, shape))
            driven.append((mode.reach, gains))
            continue
        own = half + round(mode.exponent.imag / omega - half)
        gains = gains * np.exp(-1j * own * omega * samples.step)
        for part in (1.0, 1j):
            seen.append(folded(samples, mode.turns + own, part * shape))
            driven.append(folded(samples, mode.reach - own, gains / part))
    turns, reach = (np.arange(half % 1.0, max(band[-1] for band, _ in own) + 0.25) for own in (seen, driven))
    left, values, right = np.linalg.svd(_rows(seen, turns).T @ _rows(driven, reach), full_matrices=False)
    decay = float(np.mean([mode.exponent.real for mode in modes]))
    count = min(count, len(values))
    return [
        Mode(
            exponent=complex(factor * decay),
            real=True,
            turns=turns,
            shape=as_complex(values[k] * left[:, k]).reshape(len(noise), -1) * noise,
            reach=reach,
            gains=as_complex(right[k]).reshape(len(drives), -1) / drives,
        ).scaled()
        for k, factor in enumerate(np.geomspace(*APART, count) if count > 1 else (1.0,))
    ]


def _drives(samples: Samples, now: Predictor) -> Floats:
    """The rms of what drives a state: measured inputs, and innovations (inputs + channels, 1)."""
    return np.concatenate([np.sqrt(np.mean(samples.inputs**2, axis=1))[:, None], now.noise])


def _rows(parts: Sequence[tuple[Floats, NDArray]], band: Floats) -> Floats:
    """Amplitudes on a band of harmonics, real parts and then imaginary ones (parts, 2 · signals · harmonics)."""
    found = np.zeros((len(parts), len(parts[0][1]), len(band)), complex)
    for row, (turns, values) in zip(found, parts, strict=True):
        row[:, np.searchsorted(band, turns)] = values
    return np.concatenate([np.real(found), np.imag(found)], axis=1).reshape(len(parts), -1)


def folded(samples: Samples, turns: Floats, values: NDArray) -> tuple[Floats, Complexes]:
    """Harmonics from zero on, and amplitudes whose real part is that of some of both signs (..., turns)."""
    # Of a whole number of samples a period a harmonic beyond half of it is at the samples one within.
    phases = 2.0 * np.pi / (samples.fundamental * samples.step)
    count = round(phases)
    wraps = np.rint(turns / count) * (abs(phases - count) < HALF_DIGITS)
    values = values * np.exp(1j * count * wraps * samples.fundamental * samples.first_times[0])
    turns = turns - count * wraps
    found = np.unique(np.abs(turns))
    folded = np.zeros((*values.shape[:-1], len(found)), complex)
    for turn, own in zip(turns, np.moveaxis(values, -1, 0), strict=True):
        folded[..., np.searchsorted(found, abs(turn))] += own.conj() if turn < 0.0 else own if turn > 0.0 else own.real
    return found, folded
