"""The fundamental of a steady response from the lines that do not decay: those of a limit cycle, or of a force."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from floquid._arrays import Integers
from floquid.errors import IdentificationError
from floquid.fit import DEVIATIONS, SLOW
from floquid.periodic.least_squares import RecordBlock, forced_entries, linearise, solve
from floquid.periodic.period._spectral_lines import Lines, beside, with_noise_left

PARTS = 12  # the highest harmonic that the lowest line of an orbit may be

RESOLVED, PEAKED = 0.02, 0.1
"""The least and the largest error of a line's frequency by what is beside it, over the resolution of the record."""

CERTAIN = float(np.log(1e2))  # odds of the fundamental against chance from which on it counts as seen, as a logarithm


HIGHEST = 64  # the highest harmonic of an orbit that is fitted for its period


@dataclass(frozen=True, slots=True)
class OrbitLines:
    """A fundamental whose multiples are lines that do not decay."""

    fundamental: float  # [rad/s]
    std: float  # its deviation [rad/s]
    harmonics: tuple[int, ...]  # the multiples that are there, ascending (lines,)
    symmetric: bool
    """True where the second half of the orbit is the first one with the opposite sign, and nothing that decays says
    that the system tells the halves apart."""


def orbit_of(blocks: Sequence[RecordBlock], lines: Lines, least: float, most: float) -> OrbitLines | None:
    """The fundamental of what does not decay in records, fitted to all its harmonics; None where nothing tells it."""
    duration = max(block.last - float(block.times[0]) for block in blocks)
    steady = ~lines.real & (lines.undamped | (np.abs(lines.exponents.real) * duration < SLOW))
    orbit = _seen(lines.picked(steady), lines.picked(~steady), least, most, duration)
    if orbit is not None:
        with suppress(IdentificationError, np.linalg.LinAlgError):
            return _refined(blocks, orbit)
    return None


def _seen(tones: Lines, lines: Lines, least: float, most: float, duration: float) -> OrbitLines | None:
    r"""The fundamental from `least` to `most` [rad/s] with tones as its multiples; None where chance explains that.

    Of ω that makes each of two or more frequencies fᵢ a multiple mᵢ, the largest, by weighted least squares; by chance
    one is as near with the probability 2.5 σᵢ/ω. An orbit x(t + T/2) = -x(t) has odd harmonics alone, and a system
    that is symmetric, f(-x) = -f(x), has half of its period: harmonics of a mode then are even numbers of ω apart.
    Over a record of `duration` [s], the `lines` that decay may say otherwise.
    """
    turns = np.abs(tones.exponents.imag)
    # Where lines that decay are not told apart, the deviations of all are lost: a line is where its peak is.
    sigma = np.clip(tones.std.imag, RESOLVED * 2.0 * np.pi / duration, PEAKED * 2.0 * np.pi / duration)
    best: tuple[float, float, float, Integers] | None = None
    for base in range(len(turns)):
        for part in range(1, PARTS + 1):
            omega = float(turns[base]) / part
            multiples = np.rint(turns / omega).astype(np.int64) if omega > 0.0 else np.zeros(len(turns), np.int64)
            off = np.abs(turns - multiples * omega) / np.hypot(sigma, multiples / part * sigma[base])
            members = np.flatnonzero((off < DEVIATIONS) & (multiples > 0))
            if len(members) < 2 or np.gcd.reduce(multiples[members]) > 1:
                continue
            weights = 1.0 / sigma[members] ** 2
            size = float(np.sum(weights * multiples[members] ** 2))
            omega = float(np.sum(weights * multiples[members] * turns[members])) / size
            others = members[members != base]
            odds = float(np.sum(np.log(omega / (2.5 * sigma[others])))) - np.log(PARTS * len(turns))
            if least <= omega <= most and odds > CERTAIN and (best is None or odds > best[0]):
                best = odds, omega, size**-0.5, multiples[members]
    if best is None:
        return None
    _, omega, std, multiples = best
    symmetric = bool((multiples % 2 == 1).all()) and not _told_apart(lines, omega, duration)
    return OrbitLines(omega, std, tuple(sorted(set(multiples.tolist()))), symmetric)


def _refined(blocks: Sequence[RecordBlock], orbit: OrbitLines) -> OrbitLines:
    """The orbit with the fundamental of all harmonics that the sampling shows, fitted where most has decayed.

    That is the second half of each record: what decays is no multiple, and would move lines that are far above it.
    """
    highest = np.pi / max(float(np.median(np.diff(block.times))) for block in blocks)
    step = 2 if all(m % 2 for m in orbit.harmonics) else 1
    most = max(int(min(HIGHEST, 0.999 * highest / orbit.fundamental)), orbit.harmonics[-1])
    entries = forced_entries(range(1, most + 1, step), orbit.fundamental).joined(beside(orbit.fundamental))
    later = [
        replace(block, times=block.times[half:], values=block.values[:, half:])
        for block in blocks
        for half in [block.n_samples // 2]
    ]
    noisy = with_noise_left(later, linearise(later, entries))
    solution = solve(noisy, replace(entries, free_period=True))
    noisy = with_noise_left(noisy, solution)
    solution = solve(noisy, solution.entries)
    return replace(orbit, fundamental=solution.entries.fundamental, std=float(np.sqrt(solution.covariance()[-1, -1])))


def _told_apart(lines: Lines, omega: float, duration: float) -> bool:
    """True where two lines of one decay are an odd number of fundamentals apart, one perhaps mirrored at zero."""
    values, std = lines.exponents, lines.std
    gap = np.abs(values.real[:, None] - values.real[None, :])
    alike = (gap < DEVIATIONS * np.hypot(std.real[:, None], std.real[None, :])) & ~np.eye(len(values), dtype=bool)
    wide = np.hypot(np.hypot(std.imag[:, None], std.imag[None, :]), RESOLVED * 2.0 * np.pi / duration)
    for sign in (1.0, -1.0):
        turns = np.abs(values.imag[:, None] - sign * values.imag[None, :]) / omega
        odd = np.rint(turns).astype(np.int64) % 2 == 1
        if (
            alike
            & odd
            & (np.abs(turns - np.rint(turns)) * omega < DEVIATIONS * wide)
            & (DEVIATIONS * wide < 0.1 * omega)
        ).any():
            return True
    return False
