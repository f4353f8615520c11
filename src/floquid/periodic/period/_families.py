"""Families of the lines of a response: λ + imω of one mode, and their average."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from floquid._arrays import Complexes, Floats, Integers
from floquid.core import PeriodicModel, Provenance, Record
from floquid.fit import DEVIATIONS, SURE, chi2_limit
from floquid.periodic.least_squares import ModeParameters, RecordBlock, linearise, model_of
from floquid.periodic.period._spectral_lines import Lines, after_phase_zero, beside


@dataclass(frozen=True, slots=True)
class Group:
    """Lines of one mode: which, on which half of the plane, and at which harmonic; the strongest is the first."""

    lines: tuple[int, ...]
    signs: tuple[int, ...]
    harmonics: tuple[int, ...]
    half_turns: int | None = None  # κ where the multiplier is real, its lines being at (m + κ/2)ω; else None

    def joined(self, line: int, sign: int, harmonic: int) -> Group:
        """With one more line."""
        return Group((*self.lines, line), (*self.signs, sign), (*self.harmonics, harmonic), half_turns=self.half_turns)


@dataclass(frozen=True, slots=True)
class Average:
    """Modes from the lines of each, by least squares with the inverse covariance as weight."""

    exponents: Complexes
    """λ of each group on the branch of its strongest line; of a real multiplier the decay alone (groups,)."""
    fundamental: float
    covariance: Floats  # of the decays, of the frequencies of pairs, and of the fundamental where that was free
    misfit: float  # a chi-square of `degrees` degrees of freedom
    degrees: int
    log_volume: float
    """ln of √(|cov θ|/|cov lines|)/√(2π)^degrees: the density of the lines at the average, less the misfit."""


def grouped(lines: Lines, fundamental: float, std: float = 0.0) -> list[Group]:
    """Families of lines, the strongest first: each line with the family that it is nearest to at ω ± `std` [rad/s]."""
    limit = chi2_limit(2, SURE)
    groups: list[Group] = []
    for line in np.argsort(-lines.strength, kind="stable"):
        best, least = None, limit
        for place, group in enumerate(groups):
            for sign in (1, -1) if group.half_turns is None else (1,):
                harmonic, distance = _distance(lines, group.lines[0], int(line), sign, fundamental, std)
                if distance < least and harmonic not in group.harmonics:
                    best, least = (place, sign, harmonic), distance
        if best is None:
            half = _half_turns(lines, int(line), fundamental, std)
            groups.append(Group((int(line),), (1,), (0,), half_turns=half))
        else:
            groups[best[0]] = groups[best[0]].joined(int(line), best[1], best[2])
    return groups


def _half_turns(lines: Lines, line: int, fundamental: float, std: float) -> int | None:
    """κ where a line is at κω/2 within its deviation; else None."""
    value = lines.exponents[line].imag
    half = round(2.0 * value / fundamental)
    off = abs(value - 0.5 * half * fundamental)
    return half if off <= DEVIATIONS * float(np.hypot(lines.std[line].imag, 0.5 * half * std)) else None


def _distance(lines: Lines, seed: int, line: int, sign: int, fundamental: float, std: float) -> tuple[int, float]:
    """The harmonic that a line would be, and the chi-square of its distance from there."""
    n, cov = len(lines.exponents), lines.covariance
    first, second = lines.exponents[seed], lines.exponents[line]
    turns = round((sign * second.imag - first.imag) / fundamental)
    decay, turn = second.real - first.real, sign * second.imag - first.imag - turns * fundamental
    a = cov[seed, seed] + cov[line, line] - 2.0 * cov[seed, line]
    c = cov[n + seed, n + seed] + cov[n + line, n + line] - 2.0 * sign * cov[n + seed, n + line] + (turns * std) ** 2
    b = cov[seed, n + seed] + sign * cov[line, n + line] - sign * cov[seed, n + line] - cov[line, n + seed]
    determinant = a * c - b * b
    if not determinant > 0.0:
        return turns, np.inf
    return turns, float((c * decay * decay - 2.0 * b * decay * turn + a * turn * turn) / determinant)


def averaged(lines: Lines, groups: Sequence[Group], fundamental: float, *, free: bool) -> Average:
    """The exponent of each family, and the fundamental [rad/s] where it is `free`: found from all the spacings, too."""
    n, families = len(lines.exponents), len(groups)
    pairs = [place for place, group in enumerate(groups) if group.half_turns is None]
    design, known = np.zeros((2 * n, families + len(pairs))), np.zeros(2 * n)
    turns = np.zeros(2 * n)
    for place, group in enumerate(groups):
        for line, sign, harmonic in zip(group.lines, group.signs, group.harmonics, strict=True):
            design[line, place] = 1.0
            turns[n + line] = sign * harmonic + 0.5 * (group.half_turns or 0)
            if group.half_turns is None:
                design[n + line, families + pairs.index(place)] = sign
    if free:
        design = np.concatenate([design, turns[:, None]], axis=1)
    else:
        known = turns * fundamental
    seen = np.concatenate([lines.exponents.real, lines.exponents.imag]) - known
    kept = np.diag(lines.covariance) > 0
    # A line at rest says that its family is at rest there, exactly: no number of its own.
    scale = np.sqrt(np.diag(lines.covariance)[kept])
    white = np.linalg.cholesky(lines.covariance[np.ix_(kept, kept)] / np.outer(scale, scale))
    rows = np.linalg.solve(white, design[kept] / scale[:, None])
    data = np.linalg.solve(white, seen[kept] / scale)
    value, _, rank, sizes = np.linalg.lstsq(rows, data, rcond=1e-12)
    inverse = np.linalg.pinv(rows, rcond=1e-12)
    residual = data - rows @ value
    exponents = value[:families].astype(complex)
    exponents[pairs] += 1j * value[families : families + len(pairs)]
    degrees = int(kept.sum()) - int(rank)
    volume = -float(np.sum(np.log(sizes[:rank]))) - float(np.sum(np.log(np.diag(white)))) - float(np.sum(np.log(scale)))
    return Average(
        exponents=exponents,
        fundamental=float(value[-1]) if free else fundamental,
        covariance=inverse @ inverse.T,
        misfit=float(residual @ residual),
        degrees=degrees,
        log_volume=volume - 0.5 * degrees * float(np.log(2.0 * np.pi)),
    )


def entries_of(groups: Sequence[Group], average: Average) -> ModeParameters:
    """The families as entries of a fit, with the harmonics from the lowest to the highest seen."""
    half = [group.half_turns for group in groups]
    bands = [
        (min(group.harmonics) if k is None else -(k // 2) - k % 2, max(group.harmonics))
        for group, k in zip(groups, half, strict=True)
    ]
    return ModeParameters.made(
        average.exponents,
        bands,
        average.fundamental,
        real=[k is not None for k in half],
        offsets=[0.5 * (k or 0) for k in half],
    )


def model_at(
    records: Sequence[Record],
    raw: Sequence[RecordBlock],
    entries: ModeParameters,
    covariance: Floats,
    others: Complexes,
    bands: Integers,
    noise: Floats,
) -> PeriodicModel:
    """The periodic model of modes whose exponents and their covariance are known, its amplitudes by least squares."""
    omega = entries.fundamental
    both = entries.joined(ModeParameters.made(others, (0, 0), omega, real=others.imag == 0.0, fixed=True)).joined(
        beside(omega)
    )
    blocks = after_phase_zero(raw, records, 2.0 * np.pi / omega)
    blocks = tuple(block.with_noise(noise[block.rows, block.hit]) for block in blocks)
    scale = np.sqrt(np.diag(covariance))
    information = np.linalg.inv(covariance / np.outer(scale, scale)) / np.outer(scale, scale)
    solution = replace(linearise(blocks, both), information=information, gauss_newton=information)
    kept = np.concatenate([bands, both.bands[len(bands) :]])
    provenance = Provenance.merge(tuple(record.provenance for record in records))
    return model_of(blocks, solution, kept, channels=records[0].channels, provenance=provenance, most=None)
