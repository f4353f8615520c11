r"""Pairs near an axis, and two real multipliers of one sign, by their mean and squared half-difference.

The equation, and which of them become blocks (`inputs/_modes`), are in `fit/_near_axis`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from floquid._arrays import Complexes, Floats, Integers
from floquid.core import NearAxis, read_blocks
from floquid.fit import begun_off, block_stands, couples, half_of, with_blocks
from floquid.inputs._modes import InputMode, runs_away
from floquid.inputs._samples import Samples
from floquid.inputs._solver import Linearisation, covariance, linearise, solve
from floquid.inputs.search._bands import centred


def read_near_axis(samples: Samples, now: Linearisation) -> NearAxis[Linearisation]:
    """The fit with exponents near an axis read from their mean and squared half-difference, where these are regular."""
    # Each pair, and the two real multipliers of one sign that are nearest to each other, are fitted as a block once.
    # Ordinary modes take the place of each block, behind all others.
    now = with_blocks(now, lambda own: _couples(samples, own), lambda own, numbers: _as_block(samples, own, numbers))
    blocks = {}
    if any(mode.square is not None for mode in now.modes):
        blocks = read_blocks(now.modes, covariance(samples, now), _places(now.modes), samples.fundamental)
    modes = [mode for mode in now.modes if mode.square is None]
    for number, read in blocks.items():
        modes += ordinary(samples, replace(now.modes[number], square=read.square))
    at = now
    if blocks:
        at = linearise(samples, modes, now.direct)
        at = linearise(samples, [centred(samples, mode, at, k).scaled() for k, mode in enumerate(at.modes)], at.direct)
    return NearAxis.of(at, blocks, now.modes, samples.fundamental)


def _places(modes: Sequence[InputMode]) -> Integers:
    """The free parameters that are the real and the imaginary part of each exponent, or σ and q (modes, 2)."""
    ends = np.cumsum([0, *(mode.free.sum() for mode in modes)])
    seconds = [
        (first + last) // 2 if mode.square is None else last - 1
        for mode, first, last in zip(modes, ends, ends[1:], strict=False)
    ]
    return np.stack([ends[:-1], np.array(seconds, np.int64)], axis=1)


def _couples(samples: Samples, now: Linearisation) -> Iterator[list[int]]:
    """Numbers of modes that may be of either kind, all of them within bounds in the record."""
    spread = covariance(samples, now) if now.modes else np.zeros((0, 0))
    for numbers in couples(now.modes, spread, _places(now.modes), samples.fundamental):
        if not any(runs_away(samples, now.modes[number].exponent) for number in numbers):
            yield numbers


def _as_block(samples: Samples, now: Linearisation, numbers: Sequence[int]) -> Linearisation | None:
    """The fit with a block for one pair or two real multipliers; None where either kind for itself is regular."""
    own = [now.modes[number] for number in numbers]
    rest = [mode for k, mode in enumerate(now.modes) if k not in numbers]
    with suppress(np.linalg.LinAlgError):
        block = block_of_pair(samples, own[0]) if len(own) == 1 else block_of_reals(own, samples.fundamental)
        trial = solve(samples, [*rest, block], now.direct)
        variance = float(covariance(samples, trial)[-1, -1])
        return trial if block_stands(trial, now, variance, samples.fundamental, real=own[0].real) else None
    return None


def block_of_pair(samples: Samples, mode: InputMode) -> InputMode:
    """The block of a pair, about the axis that it is nearest to: its states are z and its derivative along q."""
    omega, half = samples.fundamental, half_of(mode, samples.fundamental)
    away = mode.exponent.imag - half * omega
    away = begun_off(away, mode.exponent.real, omega)
    reach, first = _folded(mode.reach - half, mode.gains)
    _, second = _folded(mode.reach - half, -1j * mode.gains / away)
    initial = mode.initial * np.exp(-1j * half * omega * samples.first_times)
    return replace(
        mode,
        exponent=complex(mode.exponent.real),
        real=True,
        reach=reach,
        gains=np.concatenate([first, second]),
        turns=np.arange(half % 1.0, np.abs(mode.turns + half).max() + 0.5),
        initial=np.concatenate([initial.real, initial.imag / away]).astype(complex),
        square=-(away**2),
    ).scaled()


def block_of_reals(modes: Sequence[InputMode], omega: float) -> InputMode:
    """The block of two real multipliers of one sign, with harmonics as wide."""
    other, one = sorted(modes, key=lambda mode: mode.exponent.real)
    decay, gap = 0.5 * (one.exponent.real + other.exponent.real), one.exponent.real - other.exponent.real
    apart = begun_off(0.5 * gap, decay, omega)
    turns, reach = (
        np.arange(one.axis, max(getattr(mode, name)[-1] for mode in modes) + 0.5) for name in ("turns", "reach")
    )
    gains = [np.pad(mode.gains, ((0, 0), (0, len(reach) - len(mode.reach)))) for mode in (one, other)]
    # The sign of a state is free: alike, their difference is small, as it is where they meet.
    sign = -1.0 if np.sum((gains[0] * gains[1].conj()).real) < 0.0 else 1.0
    both = [(gains[0], sign * gains[1]), (one.initial, sign * other.initial)]
    first, second = (np.concatenate([0.5 * (a + b), 0.5 * (a - b) / apart]) for a, b in both)
    return replace(
        one, exponent=complex(decay), reach=reach, gains=first, turns=turns, initial=second, square=apart**2
    ).scaled()


def ordinary(samples: Samples, mode: InputMode) -> list[InputMode]:
    """The pair, or the two real multipliers, that a block is."""
    assert mode.square is not None
    root, low, omega = float(np.sqrt(abs(mode.square))), mode.axis, samples.fundamental
    if mode.square > 0.0:
        return [replace(mode.at(way), real=True).scaled() for way in (root, -root)]
    up, down = mode.at(1j * root), mode.at(-1j * root)
    # The real part of each signal is half of it and half of its conjugate.
    turns, reach = (np.arange(-band[-1], band[-1] + 0.5) for band in (mode.turns, mode.reach))
    gains = np.zeros((len(up.gains), len(reach)), complex)
    gains[:, -len(mode.reach) :] += 0.5 * up.gains
    gains[:, len(mode.reach) - 1 :: -1] += 0.5 * down.gains.conj()
    initial = up.initial * np.exp(1j * low * omega * samples.first_times)
    exponent = up.exponent + 1j * low * omega
    return [replace(up, exponent=exponent, reach=reach + low, gains=gains, turns=turns - low, initial=initial).scaled()]


def _folded(turns: Floats, values: Complexes) -> tuple[Floats, Complexes]:
    """Harmonics from zero or ½ on, and amplitudes there (rows, harmonics), of the real part of a complex signal."""
    found = np.arange(turns[0] % 1.0, np.abs(turns).max() + 0.5)
    amplitudes = np.zeros((len(values), len(found)), complex)
    for turn, value in zip(turns.tolist(), values.T, strict=True):
        amplitudes[:, round(abs(turn) - found[0])] += value.conj() if turn < 0.0 else value if turn else value.real
    return found, amplitudes
