r"""Pairs near an axis, and two real multipliers of one sign, by their mean and squared half-difference.

.. math:: \lambda = \sigma \pm \sqrt q + \tfrac{i \kappa \omega}{2}

Either kind is singular where the other begins: σ and q are determined there.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from floquid.core import WITHIN, kind_open, read_axis
from floquid.findings import Finding
from floquid.fit import DEVIATIONS, chi2_limit
from floquid.innovations._bands import centred
from floquid.innovations._fewer import stable
from floquid.innovations._mode import Mode
from floquid.innovations._predictor import Predictor, predicted
from floquid.innovations._products import as_real, folded
from floquid.innovations._solve import inverse_of, moved, normal_of, places, solve
from floquid.inputs import Limits, Samples

OFF = 0.02
"""The least √|q| over the decay with which a block begins: what the second state of a pair has is over it."""

WORSE = 1e-3
"""The probability at which noise may make a block worse than what it stands for."""


@dataclass(frozen=True, slots=True)
class NearAxis:
    """A fit of ordinary modes, deviations of exponents as they were read, by numbers of modes, and notes on kinds."""

    at: Predictor
    as_read: Mapping[int, complex]
    findings: tuple[Finding, ...]


def read_near_axis(samples: Samples, now: Predictor, limits: Limits) -> NearAxis:
    """The fit with exponents near an axis read from their mean and squared half-difference, where these are regular.

    Each pair, and the two real multipliers of one sign that are nearest to each other, are fitted as a block once.
    """
    tried: set[tuple[complex, ...]] = set()
    while True:
        for numbers in _couples(samples, now):
            key = tuple(now.modes[number].exponent for number in numbers)
            if key not in tried:
                break
        else:
            return _read_apart(samples, now)
        tried.add(key)
        now = _as_block(samples, now, numbers, limits) or now


def half_of(mode: Mode, omega: float) -> float:
    """The multiple of half the fundamental that a mode is nearest to, in fundamentals."""
    return mode.axis if mode.real else 0.5 * round(2.0 * mode.exponent.imag / omega)


def near_axis(mode: Mode, variances: NDArray[np.float64], omega: float) -> bool:
    """True of a pair that its decay, or its deviation, does not tell from the axis: it may be of real multipliers."""
    away = abs(mode.exponent.imag - half_of(mode, omega) * omega)
    # The deviations of q from zero are half those of its root.
    std = float(max(variances[mode.rows - 1], 0.0) ** 0.5)
    return not mode.real and away <= max(abs(mode.exponent.real), 2.0 * DEVIATIONS * std)


def _couples(samples: Samples, now: Predictor) -> Iterator[list[int]]:
    """Numbers of modes that may be of either kind: each pair near an axis, and two real multipliers of one sign."""
    spread, begins = inverse_of(normal_of(samples, now)), [place.start for place in places(now.modes)]
    reals: dict[float, list[int]] = {}
    for number, (mode, begin) in enumerate(zip(now.modes, begins, strict=True)):
        if mode.square is not None:
            continue
        if mode.real:
            reals.setdefault(mode.axis, []).append(number)
        elif near_axis(mode, np.diag(spread)[begin:], samples.fundamental):
            yield [number]
    for alike in reals.values():
        alike.sort(key=lambda k: now.modes[k].exponent.real)
        nearest = min(pairwise(alike), key=lambda two: _gap(now, two), default=())
        rows = [begins[number] for number in nearest]
        if rows and not _each_for_itself(_gap(now, nearest), spread[np.ix_(rows, rows)]):
            yield list(nearest)


def _gap(now: Predictor, two: Sequence[int]) -> float:
    return float(np.ptp([now.modes[number].exponent.real for number in two]))


def _each_for_itself(gap: float, covariance: NDArray[np.float64]) -> bool:
    """True of two real multipliers that are told apart, and less correlated than their mean and difference (2, 2).

    One that is seen well beside one that is hardly seen has a deviation of its own. Where they meet they are one.
    """
    by = np.array([[0.5, 0.5], [1.0, -1.0]])
    turned = by @ covariance @ by.T
    own, mixed = (
        abs(float(each[0, 1])) / max(float(np.sqrt(each[0, 0] * each[1, 1])), 1e-300) for each in (covariance, turned)
    )
    return own < mixed and gap > WITHIN * float(np.sqrt(turned[1, 1]))


def _as_block(samples: Samples, now: Predictor, numbers: Sequence[int], limits: Limits) -> Predictor | None:
    """The fit with a block for one pair or two real multipliers; None where either kind for itself is regular."""
    own = [now.modes[number] for number in numbers]
    start = _begun(samples, now, numbers)
    if start is None:
        # The gains of a pair all but on its axis cancel: its first products are those of two real multipliers.
        rest = [mode for k, mode in enumerate(now.modes) if k not in numbers]
        reals = as_real(samples, now, own, half_of(own[0], samples.fundamental), 2)
        reals_at = stable(samples, now, [*rest, *reals], limits) if len(reals) == 2 else None
        start = None if reals_at is None else _begun(samples, reals_at, [len(rest), len(rest) + 1])
    if start is None:
        return None
    trial = solve(samples, start)
    place, square = places(trial.modes)[-1].start, trial.modes[-1].square
    std = float(np.sqrt(max(inverse_of(normal_of(samples, trial))[place + 1, place + 1], 0.0)))
    assert square is not None
    # Where its deviation reaches the next axis, q is not determined.
    if not np.sqrt(std) < 0.25 * samples.fundamental:
        return None
    # Harmonics that neither kind has cost more than a q that is not open gains.
    away = DEVIATIONS if trial.n_parameters <= now.n_parameters else WITHIN
    if abs(square) > away * std and (square > 0.0) == own[0].real:
        return None
    # It holds what they hold: where it fits worse its fit has not ended.
    return trial if now.log_likelihood - trial.log_likelihood < chi2_limit(1, WORSE) else None


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


def _read_apart(samples: Samples, now: Predictor) -> NearAxis:
    """The fit with ordinary modes for each block, behind all others."""
    if all(mode.square is None for mode in now.modes):
        return NearAxis(now, {}, ())
    spread, rows = inverse_of(normal_of(samples, now)), _rows(now.modes)
    read, step, omega = {}, np.zeros(len(spread)), samples.fundamental
    for number, (mode, place) in enumerate(zip(now.modes, places(now.modes), strict=True)):
        if mode.square is not None:
            own, at = spread[place.start : place.start + 2, place.start : place.start + 2], place.start + 1
            read[number] = read_axis(mode.exponent.real, mode.square, own, round(2.0 * mode.axis), omega)
            # All else moves to where it is best beside that q.
            step += spread[:, at] * (read[number].square - mode.square) / max(spread[at, at], 1e-300)
    off = moved(samples, now, step, 2.0 * np.pi / omega) or now
    plain = [k for k, mode in enumerate(now.modes) if mode.square is None]
    modes, initial = [off.modes[k] for k in plain], [off.initial[:, rows[k]] for k in plain]
    as_read, findings = {}, []
    for number, reading in read.items():
        mode = off.modes[number]
        if reading.apart is not None:
            findings.append(kind_open(mode.exponent.real + 1j * mode.axis * omega, reading.apart))
        parts, states = ordinary(samples, mode, off.initial[:, rows[number]])
        as_read |= {len(modes) + k: complex(reading.std[k]) for k in range(len(parts))}
        modes += parts
        initial.append(states)
    at = predicted(samples, modes, off.columns, np.concatenate(initial, axis=1), now.whitening, growing=True)
    return NearAxis(now if at is None else centred(samples, at), as_read, tuple(findings))


def block_of_pair(samples: Samples, mode: Mode, initial: NDArray[np.float64]) -> tuple[Mode, NDArray[np.float64]]:
    """The block of a pair, about the axis that it is nearest to, and its states at the begins of the records.

    Its states are the real part of z, and the imaginary one over the distance from the axis.
    """
    omega, half = samples.fundamental, half_of(mode, samples.fundamental)
    away = mode.exponent.imag - half * omega
    away = float(np.copysign(max(abs(away), OFF * abs(mode.exponent.real), 1e-9 * omega), away))
    turned = mode.turned(-half, omega, samples.step)
    reach, gains = folded(turned.reach, np.concatenate([turned.gains, -1j / away * turned.gains]))
    turns, shape = folded(turned.turns, np.concatenate([turned.shape, 1j * away * turned.shape]))
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


def block_of_reals(
    modes: Sequence[Mode], states: Sequence[NDArray[np.float64]], omega: float
) -> tuple[Mode, NDArray[np.float64]]:
    """The block of two real multipliers of one sign, with harmonics as wide, and its states at the begins."""
    decays = np.array([mode.exponent.real for mode in modes])
    (one, other), (first, second) = ([own[k] for k in np.argsort(-decays)] for own in (modes, states))
    apart = float(max(0.5 * np.ptp(decays), OFF * abs(decays.mean()), 1e-9 * omega))
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


def divided(block: Mode, initial: NDArray[np.float64]) -> tuple[Mode, NDArray[np.float64]]:
    """A block and its states, both divided by the gain that is largest: the same block.

    What the second state has over the first is all but a multiple of what that has, where a pair is near its axis.
    """
    assert block.square is not None
    (first, second), (seen, beside) = np.split(block.gains, 2), np.split(block.shape, 2)
    parts = np.array([np.concatenate([own.real.ravel(), own.imag.ravel()]) for own in (first, second)])
    # One of which this is zero drives one of two multipliers alone: a block cannot be divided by it.
    norms = parts[0] ** 2 - block.square * parts[1] ** 2
    largest = int(np.argmax(np.abs(norms)))
    (a, b), norm = parts[:, largest], norms[largest] or 1.0
    gains = (a * first - block.square * b * second, a * second - b * first)
    states = (a * initial[:, 0] - block.square * b * initial[:, 1], a * initial[:, 1] - b * initial[:, 0])
    shape = (a * seen + b * beside, a * beside + block.square * b * seen)
    block = replace(block, gains=np.asarray(np.concatenate(gains) / norm, np.complex128), shape=np.concatenate(shape))
    return block, np.stack(states, axis=1) / norm


def ordinary(samples: Samples, mode: Mode, initial: NDArray[np.float64]) -> tuple[list[Mode], NDArray[np.float64]]:
    """The pair, or the two real multipliers, that a block is, and their states at the begins of the records."""
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


def _both_sides(
    band: NDArray[np.float64], parts: Sequence[NDArray[np.complex128]]
) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
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
