r"""Pairs near an axis, and two real multipliers of one sign, by their mean and squared half-difference.

.. math:: \lambda = \sigma \pm \sqrt q + \tfrac{i \kappa \omega}{2}

Either kind is singular where the other begins: σ and q are determined there (`inputs/_block`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from floquid.core import WITHIN, kind_open, read_axis
from floquid.findings import Finding
from floquid.fit import DEVIATIONS, chi2_limit
from floquid.inputs._modes import InputMode, runs_away
from floquid.inputs._samples import Samples
from floquid.inputs._solver import Linearisation, covariance, linearise, solve
from floquid.inputs.search._bands import centred

OFF = 0.02
"""The least √|q| over the decay with which a block begins: b of the second state of a pair is over it."""

NARROWEST = 1e-3
"""The distance off an axis, over the fundamental, that counts as near however little a pair decays."""

WORSE = 1e-3
"""The probability at which noise may make a block worse than what it stands for."""


@dataclass(frozen=True, slots=True)
class NearAxis:
    """A fit of ordinary modes, deviations of exponents as they were read, by numbers of modes, and notes on kinds."""

    at: Linearisation
    as_read: Mapping[int, complex]
    findings: tuple[Finding, ...]


def read_near_axis(samples: Samples, now: Linearisation) -> NearAxis:
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
        with suppress(np.linalg.LinAlgError):
            now = _as_block(samples, now, numbers) or now


def half_of(mode: InputMode, omega: float) -> float:
    """The multiple of half the fundamental that a mode is nearest to, in fundamentals."""
    return mode.lowest if mode.real else 0.5 * round(2.0 * mode.exponent.imag / omega)


def near_axis(mode: InputMode, omega: float) -> bool:
    """True of a pair that is no further off an axis than it decays: it may be one real multiplier, or two."""
    away = abs(mode.exponent.imag - half_of(mode, omega) * omega)
    return not mode.real and away <= max(abs(mode.exponent.real), NARROWEST * omega)


def _couples(samples: Samples, now: Linearisation) -> Iterator[list[int]]:
    """Numbers of modes that may be of either kind: each pair near an axis, and two real multipliers of one sign."""
    modes, omega = now.modes, samples.fundamental
    places = np.cumsum([0, *(mode.free.sum() for mode in modes)])
    spread = covariance(samples, now) if modes else np.zeros((0, 0))
    reals: dict[float, list[int]] = {}
    for number, mode in enumerate(modes):
        if mode.square is not None or runs_away(samples, mode.exponent):
            continue
        if mode.real:
            reals.setdefault(mode.lowest, []).append(number)
            continue
        imag = (places[number] + places[number + 1]) // 2
        # The deviations of q from zero are half those of its root.
        if abs(mode.exponent.imag - half_of(mode, omega) * omega) < 2.0 * DEVIATIONS * spread[imag, imag] ** 0.5:
            yield [number]
    for alike in reals.values():
        alike.sort(key=lambda k: modes[k].exponent.real)
        yield from sorted(
            map(list, pairwise(alike)), key=lambda two: float(np.ptp([modes[k].exponent.real for k in two]))
        )[:1]


def _as_block(samples: Samples, now: Linearisation, numbers: Sequence[int]) -> Linearisation | None:
    """The fit with a block for one pair or two real multipliers; None where either kind for itself is regular."""
    own = [now.modes[number] for number in numbers]
    block = block_of_pair(samples, own[0]) if len(own) == 1 else block_of_reals(own, samples.fundamental)
    modes = [mode for k, mode in enumerate(now.modes) if k not in numbers]
    trial = solve(samples, [*modes, block], now.direct)
    std, square = float(np.sqrt(covariance(samples, trial)[-1, -1])), trial.modes[-1].square
    assert square is not None
    # With its deviation off, a pair would be nearer to the next axis: its q is not determined.
    if not np.sqrt(max(-square, 0.0) + std) < 0.25 * samples.fundamental:
        return None
    # Harmonics that neither kind has cost more than a q that is not open gains.
    away = DEVIATIONS if trial.n_parameters <= now.n_parameters else WITHIN
    if abs(square) > away * std and (square > 0.0) == own[0].real:
        return None
    # It holds what they hold: where it fits worse its fit has not ended.
    return trial if now.log_likelihood - trial.log_likelihood < chi2_limit(1, WORSE) else None


def _read_apart(samples: Samples, now: Linearisation) -> NearAxis:
    """The fit with ordinary modes for each block, behind all others."""
    if all(mode.square is None for mode in now.modes):
        return NearAxis(now, {}, ())
    spread, place = covariance(samples, now), 0
    modes, as_read, findings = [mode for mode in now.modes if mode.square is None], {}, []
    for mode in now.modes:
        place += int(mode.free.sum())
        if mode.square is None:
            continue
        ends = [place - int(mode.free.sum()), place - 1]
        half = round(2.0 * mode.lowest)
        read = read_axis(mode.exponent.real, mode.square, spread[np.ix_(ends, ends)], half, samples.fundamental)
        parts = ordinary(samples, replace(mode, square=read.square))
        if read.apart is not None:
            findings.append(kind_open(mode.exponent.real + 1j * mode.lowest * samples.fundamental, read.apart))
        as_read |= {len(modes) + k: complex(read.std[k]) for k in range(len(parts))}
        modes += parts
    at = linearise(samples, modes, now.direct)
    at = linearise(samples, [centred(samples, mode, at, k).scaled() for k, mode in enumerate(at.modes)], now.direct)
    return NearAxis(at, as_read, tuple(findings))


def block_of_pair(samples: Samples, mode: InputMode) -> InputMode:
    """The block of a pair, about the axis that it is nearest to: its states are z and its derivative along q."""
    omega, half = samples.fundamental, half_of(mode, samples.fundamental)
    away = mode.exponent.imag - half * omega
    away = float(np.copysign(max(abs(away), OFF * abs(mode.exponent.real), 1e-9 * omega), away))
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
    apart = max(0.5 * gap, OFF * abs(decay), 1e-9 * omega)
    turns, reach = (
        np.arange(one.lowest, max(getattr(mode, name)[-1] for mode in modes) + 0.5) for name in ("turns", "reach")
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
    root, low, omega = float(np.sqrt(abs(mode.square))), mode.lowest, samples.fundamental
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


def _folded(
    turns: NDArray[np.float64], values: NDArray[np.complex128]
) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
    """Harmonics from zero or ½ on, and amplitudes there (rows, harmonics), of the real part of a complex signal."""
    found = np.arange(turns[0] % 1.0, np.abs(turns).max() + 0.5)
    amplitudes = np.zeros((len(values), len(found)), complex)
    for turn, value in zip(turns.tolist(), values.T, strict=True):
        amplitudes[:, round(abs(turn) - found[0])] += value.conj() if turn < 0.0 else value if turn else value.real
    return found, amplitudes
