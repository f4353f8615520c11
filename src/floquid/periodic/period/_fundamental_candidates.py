"""Fundamentals that lines may have: of those that decay their spacings, of those that do not their divisors."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from floquid._arrays import Floats, Integers
from floquid.errors import IdentificationError
from floquid.fit import DEVIATIONS, EVIDENT, SLOW, SURE, chi2_limit
from floquid.periodic.least_squares import RecordBlock, forced_entries, linearise, solve
from floquid.periodic.period._fse import Group, averaged, grouped
from floquid.periodic.period._spectral_lines import Lines, beside, with_noise_left

PARTS = 12  # a spacing, or a line of an orbit, is taken for this many fundamentals at most


@dataclass(frozen=True, slots=True)
class Spacing:
    """A fundamental, with the families that it makes of the lines, and what speaks for it."""

    fundamental: float
    std: float
    groups: tuple[Group, ...]
    misfit: float
    degrees: int
    evidence: float  # the logarithm of the odds against lines that have nothing to do with one another
    certainty: float  # the same of their frequencies alone, equal decays being taken for granted
    tones: int  # undamped lines at multiples of half the fundamental

    @property
    def partition(self) -> frozenset[frozenset[int]]:
        """Groups of lines that belong together."""
        return frozenset(frozenset(group.lines) for group in self.groups)

    @property
    def spacings(self) -> int:
        """Lines that are harmonics of a stronger one."""
        return sum(len(group.lines) - 1 for group in self.groups)


def spacings_of(lines: Lines, tones: Lines, least: float, most: float) -> list[Spacing]:
    r"""Fundamentals from `least` to `most` [rad/s] that lines which decay may be spaced by, the best first.

    Each difference and each sum of the frequencies of two lines of equal decay may be 1 … `PARTS` fundamentals. With
    C the covariance of the lines, and θ the decay and frequency of each family and ω, the odds of a fundamental are

    .. math:: \frac{p(\text{lines} \mid \omega)}{p(\text{lines})} = \frac{1}{\omega \ln(\omega_1/\omega_0)}
              \sqrt{\frac{|C_\theta|}{|C|}}\, \frac{e^{-\chi^2/2}}{(2\pi)^{n/2}}
              \prod_{\text{harmonics}} \frac{3}{\pi^2 m^2}\, \frac{W D}{R}

    n the degrees of freedom of χ²: a line that is no harmonic could have come out anywhere below the highest, W, with
    any decay up to D, twice that of the family; one that is a harmonic of one of the R families is the more likely the
    nearer it is to its strongest line. The smaller ω, the less it says that all spacings are multiples of it: of ω,
    ω/2, ω/3 … the largest has the highest odds.
    """
    values, variances = _fundamentals(lines, least, most)
    judged: dict[tuple[Group, ...], Spacing | None] = {}
    for value, variance in zip(values, variances, strict=True):
        # A real multiplier is no special case here: its lines are harmonics of one another all the same.
        groups = grouped(lines, float(value), float(np.sqrt(variance)))
        key = tuple(replace(group, half_turns=None) for group in groups)
        if key not in judged:
            judged[key] = _judged(lines, tones, key, float(value), float(np.log(most / least)))
    kept = [spacing for spacing in judged.values() if spacing is not None and least <= spacing.fundamental <= most]
    return sorted(kept, key=lambda spacing: -spacing.evidence)


def _fundamentals(lines: Lines, least: float, most: float) -> tuple[Floats, Floats]:
    """Spacings of lines of equal decay and parts of these [rad/s], with their variances."""
    n, cov, limit = len(lines.exponents), lines.covariance, chi2_limit(1, SURE)
    values, variances = [], []
    for a, b in combinations(range(n), 2):
        gap = lines.exponents[a].real - lines.exponents[b].real
        if gap**2 > limit * (cov[a, a] + cov[b, b] - 2.0 * cov[a, b]):
            continue
        for sign in (1.0, -1.0):
            value = abs(lines.exponents[a].imag - sign * lines.exponents[b].imag)
            variance = cov[n + a, n + a] + cov[n + b, n + b] - 2.0 * sign * cov[n + a, n + b]
            for part in range(1, PARTS + 1):
                # Spacings that are not resolved are those of two lines of one peak.
                if least <= value / part <= most and value / part > 10.0 * np.sqrt(variance):
                    values.append(value / part)
                    variances.append(variance / part**2)
    return np.array(values), np.array(variances)


def _judged(lines: Lines, tones: Lines, groups: tuple[Group, ...], fundamental: float, range_: float) -> Spacing | None:
    """Evidence for families of lines spaced by about a fundamental; None where there is no family."""
    n = len(lines.exponents)
    merged = [(group, line) for group in groups for line in group.lines[1:]]
    if not merged:
        return None
    try:
        average = averaged(lines, groups, fundamental, free=True)
    except np.linalg.LinAlgError:
        return None  # lines that the record cannot tell apart
    omega = average.fundamental
    if not omega > 0.0:
        return None
    spread = float(np.sqrt(average.covariance[-1, -1]))
    tone, count = _on_tones(tones, omega, spread)
    far = np.array([m for group in groups for m in group.harmonics[1:]], float)
    width = float(lines.exponents.imag.max())
    prior = float(np.sum(np.log(3.0 * width / (np.pi**2 * far**2 * len(groups))))) - np.log(omega * range_) + tone
    decays = sum(np.log(2.0 * abs(lines.exponents[group.lines[0]].real)) for group, _ in merged)
    turning = lines.covariance.copy()
    turning[:n] = 0.0
    turning[:, :n] = 0.0
    alone = averaged(replace(lines, covariance=turning), groups, fundamental, free=True)
    return Spacing(
        fundamental=omega,
        std=spread,
        groups=groups,
        misfit=average.misfit,
        degrees=average.degrees,
        evidence=float(average.log_volume - 0.5 * average.misfit + prior + decays),
        certainty=float(alone.log_volume - 0.5 * alone.misfit + prior),
        tones=count,
    )


def _on_tones(tones: Lines, omega: float, std: float) -> tuple[float, int]:
    """Addition to the odds by tones at multiples of half the fundamental, and their number."""
    added, count = 0.0, 0
    for value, deviation in zip(np.abs(tones.exponents.imag), tones.std.imag, strict=True):
        half = round(2.0 * value / omega)
        sigma = float(np.hypot(deviation, 0.5 * half * std))
        off = (value - 0.5 * half * omega) / sigma if sigma > 0.0 else np.inf
        if half and abs(off) < DEVIATIONS:
            added += max(float(np.log(0.5 * omega / (sigma * np.sqrt(2.0 * np.pi)))) - 0.5 * off**2, 0.0)
            count += 1
    return added, count


CERTAIN = float(np.log(1e2))  # odds of the fundamental against chance from which on it counts as seen, as a logarithm


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
    sigma = np.full(len(turns), EVIDENT * 2.0 * np.pi / duration)
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
    """The orbit with the fundamental of all harmonics up to the highest seen, fitted where most has decayed."""
    # That is the second half of each record: what decays is no multiple, and would move lines that are far above it.
    step = 2 if all(m % 2 for m in orbit.harmonics) else 1
    entries = forced_entries(range(1, orbit.harmonics[-1] + 1, step), orbit.fundamental).joined(
        beside(orbit.fundamental)
    )
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
    wide = np.hypot(np.hypot(std.imag[:, None], std.imag[None, :]), EVIDENT * 2.0 * np.pi / duration)
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
