"""Conversions between a block of two real states and the pair, or the two real multipliers, that it stands for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from floquid.inputs._modes import InputMode
from floquid.inputs._samples import Samples

OFF = 0.02
"""The least √|q| over the decay with which a block begins: b of the second state of a pair is over it."""

NEAREST = 1e-5
"""The least √|q| over ω of modes made of a block: their shapes are over it, and q off by 1e-10 ω² changes nothing."""


def half_of(mode: InputMode, omega: float) -> float:
    """The multiple of half the fundamental that a mode is nearest to, in fundamentals."""
    return mode.lowest if mode.real else 0.5 * round(2.0 * mode.exponent.imag / omega)


def block_of_pair(samples: Samples, mode: InputMode) -> InputMode:
    """The block of a pair, about the axis that it is nearest to: its states are z and its derivative along q."""
    omega, half = samples.fundamental, half_of(mode, samples.fundamental)
    decay, away = abs(mode.exponent.real), mode.exponent.imag - half * omega
    away = float(np.copysign(max(abs(away), OFF * decay, NEAREST * omega), away))
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


def block_of_reals(one: InputMode, other: InputMode, omega: float) -> InputMode:
    """The block of two real multipliers of one sign, with harmonics as wide."""
    if one.exponent.real < other.exponent.real:
        one, other = other, one
    decay = 0.5 * (one.exponent.real + other.exponent.real)
    apart = max(0.5 * (one.exponent.real - other.exponent.real), OFF * abs(decay), NEAREST * omega)
    wide, long = max((one, other), key=lambda own: len(own.reach)), max((one, other), key=lambda own: len(own.turns))
    reach, turns = wide.reach, long.turns
    gains = [np.pad(mode.gains, ((0, 0), (0, len(reach) - len(mode.reach)))) for mode in (one, other)]
    # The sign of a state is free: alike, their difference is small, as it is where they meet.
    sign = -1.0 if np.sum((gains[0] * gains[1].conj()).real) < 0.0 else 1.0
    both = [(gains[0], sign * gains[1]), (one.initial, sign * other.initial)]
    first, second = (np.concatenate([0.5 * (a + b), 0.5 * (a - b) / apart]) for a, b in both)
    return replace(
        one, exponent=complex(decay), reach=reach, gains=first, turns=turns, initial=second, square=apart**2
    ).scaled()


def ordinary(
    mode: InputMode, shape: NDArray[np.complex128], fundamental: float, begins: NDArray[np.float64]
) -> list[tuple[InputMode, NDArray[np.complex128]]]:
    """The pair, or the two real multipliers, that a block is, with amplitudes 2 c of (outputs, turns of both states).

    `begins` are the times at which the records begin.
    """
    assert mode.square is not None
    low, inputs, records = mode.lowest, len(mode.gains) // 2, len(mode.initial) // 2
    root = max(float(np.sqrt(abs(mode.square))), NEAREST * fundamental)
    shapes = shape[:, : len(mode.turns)], shape[:, len(mode.turns) :]
    gains, initial = (mode.gains[:inputs], mode.gains[inputs:]), (mode.initial[:records], mode.initial[records:])
    if mode.square >= 0.0:
        return [
            (
                replace(
                    mode,
                    exponent=mode.exponent + way,
                    gains=gains[0] + way * gains[1],
                    initial=initial[0] + way * initial[1],
                    square=None,
                ),
                0.5 * (shapes[0] + shapes[1] / way),
            )
            for way in (root, -root)
        ]
    (turns, *seen), (reach, *driven) = (
        (mirrored(band, parts[0], shift)[0], *(mirrored(band, part, shift)[1] for part in parts))
        for band, parts, shift in ((mode.turns, shapes, -low), (mode.reach, gains, low))
    )
    pair = replace(
        mode,
        exponent=mode.exponent + 1j * (root + low * fundamental),
        real=False,
        reach=reach.astype(float),
        gains=driven[0] + 1j * root * driven[1],
        turns=turns.astype(float),
        initial=(initial[0] + 1j * root * initial[1]) * np.exp(1j * low * fundamental * begins),
        square=None,
    )
    return [(pair, seen[0] - 1j * seen[1] / root)]


def mirrored(
    turns: NDArray[np.float64], values: NDArray[np.complex128], shift: float, *, deviations: bool = False
) -> tuple[NDArray[np.int64], NDArray[np.complex128]]:
    """Harmonics of a real signal's amplitudes (rows, turns), those below zero too, all moved by a shift."""
    down = turns > 0.0
    own = np.where(down, 0.5, 1.0) * values
    both = np.concatenate([-turns[down][::-1], turns]) + shift
    below = own[:, down][:, ::-1]
    found = np.concatenate([below if deviations else below.conj(), own], axis=1)
    return np.rint(both).astype(np.int64), found


def _folded(
    turns: NDArray[np.float64], values: NDArray[np.complex128]
) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
    """Harmonics from zero or ½ on, and amplitudes there (rows, harmonics), of the real part of a complex signal."""
    found = np.arange(turns[0] % 1.0, np.abs(turns).max() + 0.5)
    amplitudes = np.zeros((len(values), len(found)), complex)
    for turn, value in zip(turns.tolist(), values.T, strict=True):
        amplitudes[:, round(abs(turn) - found[0])] += value.conj() if turn < 0.0 else value if turn else value.real
    return found, amplitudes
