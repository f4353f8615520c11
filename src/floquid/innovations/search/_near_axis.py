r"""Pairs near an axis, and two real multipliers of one sign, by mean and squared half-difference; one for a pair.

The equation, and which of them become blocks, are in `fit/_near_axis`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from floquid._arrays import Complexes, Floats, Integers
from floquid.core import NearAxis, read_blocks
from floquid.fit import begun_off, block_stands, couples, half_of, near_axis, with_blocks
from floquid.innovations._mode import Mode
from floquid.innovations._predictor import Predictor, predicted
from floquid.innovations._products import as_real, folded
from floquid.innovations._solve import inverse_of, moved, normal_of, places, roughly, solve
from floquid.innovations.search._bands import anchored, centred, grown, narrowed
from floquid.innovations.search._fewer import least, stable
from floquid.inputs import Limits, Samples


def with_near_blocks(samples: Samples, now: Predictor, limits: Limits, *, pairs: bool = True) -> Predictor:
    """The fit with the two real multipliers nearest to each other, and each pair near an axis, as a block."""
    omega = samples.fundamental

    def may_be(own: Predictor) -> Iterator[list[int]]:
        found = couples(own.modes, inverse_of(roughly(samples, own)), _exponents(own.modes), omega)
        return (numbers for numbers in found if pairs or len(numbers) == 2)

    return with_blocks(now, may_be, lambda own, numbers: _as_block(samples, own, numbers, limits))


def read_near_axis(samples: Samples, now: Predictor) -> NearAxis[Predictor]:
    """The fit with the exponents of its blocks read from their mean and squared half-difference."""
    # Ordinary modes take the place of each block, behind all others.
    omega = samples.fundamental
    if all(mode.square is None for mode in now.modes):
        return NearAxis(now, {}, ())
    spread, rows, at_blocks = inverse_of(normal_of(samples, now)), _rows(now.modes), _exponents(now.modes)
    blocks, step = read_blocks(now.modes, spread, at_blocks, omega), np.zeros(len(spread))
    for number, read in blocks.items():
        at, square = at_blocks[number, 1], now.modes[number].square
        assert square is not None
        # All else moves to where it is best beside that q.
        step += spread[:, at] * (read.square - square) / max(spread[at, at], 1e-300)
    off = moved(samples, now, step, 2.0 * np.pi / omega) or now
    plain = [k for k in range(len(now.modes)) if k not in blocks]
    modes, initial = [off.modes[k] for k in plain], [off.initial[:, rows[k]] for k in plain]
    for number in blocks:
        parts, states = ordinary(samples, off.modes[number], off.initial[:, rows[number]])
        modes += parts
        initial.append(states)
    found = predicted(samples, modes, off.columns, np.concatenate(initial, axis=1), now.whitening, growing=True)
    return NearAxis.of(now if found is None else centred(samples, found), blocks, now.modes, omega)


def _exponents(modes: Sequence[Mode]) -> Integers:
    """The parameters that are the real and the imaginary part of each exponent, or σ and q (modes, 2)."""
    firsts = np.array([place.start for place in places(modes)], np.int64)
    return firsts[:, None] + np.array([[0, mode.rows - 1] for mode in modes], np.int64).reshape(-1, 2)


def _as_block(samples: Samples, now: Predictor, numbers: Sequence[int], limits: Limits) -> Predictor | None:
    """The fit with a block for one pair or two real multipliers; None where either kind for itself is regular."""
    own, omega = [now.modes[number] for number in numbers], samples.fundamental
    start = _begun(samples, now, numbers)
    if start is None:
        # The gains of a pair all but on its axis cancel: its first products are those of two real multipliers.
        rest = [mode for k, mode in enumerate(now.modes) if k not in numbers]
        reals = as_real(samples, now, own, half_of(own[0], omega), 2)
        reals_at = stable(samples, now, [*rest, *reals], limits) if len(reals) == 2 else None
        start = None if reals_at is None else _begun(samples, reals_at, [len(rest), len(rest) + 1])
    if start is None:
        return None
    trial = solve(samples, start)
    place = _exponents(trial.modes)[-1, 1]
    variance = float(inverse_of(normal_of(samples, trial))[place, place])
    return trial if block_stands(trial, now, variance, omega, real=own[0].real) else None


def _begun(samples: Samples, now: Predictor, numbers: Sequence[int]) -> Predictor | None:
    """The predictor with a block for one pair or two real multipliers, behind all others; None where it diverges."""
    rows = _rows(now.modes)
    states = [now.initial[:, rows[number]] for number in numbers]
    if len(numbers) == 1:
        block, begun = block_of_pair(samples, now.modes[numbers[0]], states[0])
    else:
        block, begun = block_of_reals([now.modes[number] for number in numbers], states, samples.fundamental)
    rest = [k for k in range(len(now.modes)) if k not in numbers]
    initial = np.concatenate([*(now.initial[:, rows[k]] for k in rest), begun], axis=1)
    return predicted(samples, [*(now.modes[k] for k in rest), block], now.columns, initial, now.whitening)


def block_of_pair(samples: Samples, mode: Mode, initial: Floats) -> tuple[Mode, Floats]:
    """The block of a pair, about the axis that it is nearest to, and its states at the starts of the records."""
    # Its states are the real part of z, and the imaginary one over the distance from the axis.
    omega, half = samples.fundamental, half_of(mode, samples.fundamental)
    away = mode.exponent.imag - half * omega
    away = begun_off(away, mode.exponent.real, omega)
    turned = mode.turned(-half, omega, samples.step)
    reach, gains = folded(samples, turned.reach, np.concatenate([turned.gains, -1j / away * turned.gains]))
    turns, shape = folded(samples, turned.turns, np.concatenate([turned.shape, 1j * away * turned.shape]))
    block = Mode(
        exponent=complex(mode.exponent.real),
        real=True,
        turns=turns,
        shape=shape,
        reach=reach,
        gains=gains,
        square=-(away**2),
    )
    state = (initial[:, 0] + 1j * initial[:, 1]) * np.exp(-1j * half * omega * samples.first_times)
    bands = (np.arange(half % 1.0, band[-1] + 0.5) for band in (turns, reach))
    return divided(block.widened(*bands), np.stack([state.real, state.imag / away], axis=1))


def block_of_reals(modes: Sequence[Mode], states: Sequence[Floats], omega: float) -> tuple[Mode, Floats]:
    """The block of two real multipliers of one sign, with harmonics as wide, and its states at the starts."""
    decays = np.array([mode.exponent.real for mode in modes])
    (one, other), (first, second) = ([own[k] for k in np.argsort(-decays)] for own in (modes, states))
    apart = begun_off(0.5 * float(np.ptp(decays)), float(decays.mean()), omega)
    turns, reach = (
        np.arange(one.axis, max(getattr(mode, name)[-1] for mode in modes) + 0.5) for name in ("turns", "reach")
    )
    one, other = one.widened(turns, reach), other.widened(turns, reach)
    # The size and the sign of a state are free: alike, their difference is small, as it is where they meet.
    by = np.linalg.norm(one.gains) / max(float(np.linalg.norm(other.gains)), 1e-300)
    by = -by if np.sum((one.gains * other.gains.conj()).real) < 0.0 else by
    gains, shape, second = (one.gains, by * other.gains), (one.shape, other.shape / by), by * second
    block = replace(
        one,
        exponent=complex(decays.mean()),
        gains=np.concatenate([0.5 * (gains[0] + gains[1]), 0.5 * (gains[0] - gains[1]) / apart]),
        shape=np.concatenate([shape[0] + shape[1], apart * (shape[0] - shape[1])]),
        square=apart**2,
    )
    return divided(block, np.concatenate([0.5 * (first + second), 0.5 * (first - second) / apart], axis=1))


def divided(block: Mode, initial: Floats) -> tuple[Mode, Floats]:
    """A block and its states, both divided by the gain that is largest: the same block."""
    # What the second state has over the first is all but a multiple of what that has, where a pair is near its axis.
    assert block.square is not None
    (first, second), (seen, beside) = np.split(block.gains, 2), np.split(block.shape, 2)
    parts = np.array([np.concatenate([own.real.ravel(), own.imag.ravel()]) for own in (first, second)])
    # If this is zero, it drives one of two multipliers alone: a block cannot be divided by it.
    norms = parts[0] ** 2 - block.square * parts[1] ** 2
    largest = int(np.argmax(np.abs(norms)))
    (a, b), norm = parts[:, largest], norms[largest] or 1.0
    gains = (a * first - block.square * b * second, a * second - b * first)
    states = (a * initial[:, 0] - block.square * b * initial[:, 1], a * initial[:, 1] - b * initial[:, 0])
    shape = (a * seen + b * beside, a * beside + block.square * b * seen)
    block = replace(block, gains=np.asarray(np.concatenate(gains) / norm, np.complex128), shape=np.concatenate(shape))
    return block, np.stack(states, axis=1) / norm


def ordinary(samples: Samples, mode: Mode, initial: Floats) -> tuple[list[Mode], Floats]:
    """The pair, or the two real multipliers, that a block is, and their states at the starts of the records."""
    assert mode.square is not None
    root, omega = float(np.sqrt(abs(mode.square))), samples.fundamental
    gains, shape = np.split(mode.gains, 2), np.split(mode.shape, 2)
    if mode.square > 0.0:
        both = [
            replace(
                mode,
                exponent=mode.exponent + way,
                gains=gains[0] + way * gains[1],
                shape=0.5 * (shape[0] + shape[1] / way),
                square=None,
            )
            for way in (root, -root)
        ]
        return both, np.stack([initial[:, 0] + way * initial[:, 1] for way in (root, -root)], axis=1)
    turns, wide = _both_sides(mode.turns, [shape[0], -1j / root * shape[1]])
    reach, driven = _both_sides(mode.reach, [gains[0], 1j * root * gains[1]])
    pair = Mode(exponent=mode.exponent + 1j * root, real=False, turns=turns, shape=wide, reach=reach, gains=driven)
    pair = pair.turned(mode.axis, omega, samples.step)
    state = (initial[:, 0] + 1j * root * initial[:, 1]) * np.exp(1j * mode.axis * omega * samples.first_times)
    return [pair], np.stack([state.real, state.imag], axis=1)


def _both_sides(band: Floats, parts: Sequence[Complexes]) -> tuple[Floats, Complexes]:
    """Harmonics of both signs, and amplitudes of a real function and of one times i there (rows, harmonics)."""
    wide = np.arange(-band[-1], band[-1] + 0.5)
    found = np.zeros((len(parts[0]), len(wide)), complex)
    for number, part in enumerate(parts):
        found[:, -len(band) :] += 0.5 * part
        # The real part of a signal is half of it and half of its conjugate.
        found[:, len(band) - 1 :: -1] += 0.5 * (part.conj() if not number else -part.conj())
    return wide, found


def _rows(modes: Sequence[Mode]) -> list[slice]:
    """The states of each mode among all."""
    ends = np.cumsum([0, *(mode.rows for mode in modes)]).tolist()
    return [slice(*both) for both in pairwise(ends)]


def with_real_ones(samples: Samples, now: Predictor, limits: Limits) -> Predictor:
    """With one real multiplier for each pair near an axis where the criterion prefers that: a state less."""
    spread = np.diag(inverse_of(roughly(samples, now), anchored(now)))
    omega = samples.fundamental
    for number, (mode, place) in enumerate(zip(now.modes, places(now.modes), strict=True)):
        std = float(max(spread[place.start + mode.rows - 1], 0.0) ** 0.5)
        if limits.over or not near_axis(mode, omega, std):
            continue
        rest = [other for k, other in enumerate(now.modes) if k != number]
        # A real multiplier needs harmonics that the pair did without.
        real = [one.padded(1.0, limits.highest) for one in as_real(samples, now, [mode], half_of(mode, omega), 1)]
        trial = stable(samples, now, [*rest, *real], limits)
        if trial is None:
            continue
        enough = least(trial, now, limits)
        trial = solve(samples, trial, rough=True, least=enough)
        if trial.log_likelihood >= enough:
            trial = narrowed(samples, grown(samples, trial, limits), limits)
        if trial.criterion > now.criterion:
            return with_real_ones(samples, trial, limits)
    return now
