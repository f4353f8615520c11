"""Lines of the spectrum of a response, and their families: λ + imω of one mode, and their average."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Complexes, Floats, Integers, Mask
from floquid.core import ConstantPeriod, PeriodicModel, Provenance, Record
from floquid.fit import DEVIATIONS, SLOW, SURE, chi2_limit
from floquid.periodic.least_squares import (
    TREND,
    Block,
    GappyBlock,
    ModeParameters,
    RecordBlock,
    Solution,
    forced_entries,
    linearise,
    model_of,
    noise_left,
    record_blocks,
    shapes,
    solve,
    weighted,
)
from floquid.periodic.search import lines

FALSE_ALARM = 1e-9  # the probability that noise alone makes the strongest of all lines that are looked for
PIECES = 64  # pieces of a record whose power is looked at, to see where the response has died
DEAD = 1.2  # power over that of the end of the record at which a piece is taken for noise
ALIVE = 4.0  # power over that of the end that the first piece has where a record may be cut at all


@dataclass(frozen=True, slots=True)
class Lines:
    """Lines of a real response, a conjugate pair once, on the upper half of the plane."""

    exponents: Complexes  # (lines,) [1/s]
    real: Mask  # mask of the lines without a frequency (lines,)
    covariance: Floats  # of decays, then of angular frequencies (2 lines, 2 lines); zero where a line does not turn
    strength: Floats  # the norm of each amplitude over the noise (lines,)
    undamped: Mask  # mask of the pure tones, as far as the record tells (lines,)
    noise: Floats  # the deviation of what is left (channels, hits)

    @property
    def std(self) -> Complexes:
        """Deviations of decays and angular frequencies (lines,)."""
        std = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        return std[: len(self.exponents)] + 1j * std[len(self.exponents) :]

    def picked(self, which: NDArray) -> Lines:
        """Some of the lines."""
        places = np.arange(len(self.exponents))[which]
        both = np.concatenate([places, places + len(self.exponents)])
        return Lines(
            self.exponents[places],
            self.real[places],
            self.covariance[np.ix_(both, both)],
            self.strength[places],
            self.undamped[places],
            self.noise,
        )


def raw_blocks(records: Sequence[Record]) -> tuple[RecordBlock, ...]:
    """Blocks of the records, with times after the first sample of each."""
    period = 0.5 / max((record.sample_rate for record in records), default=1.0)
    clocks = [ConstantPeriod(period=period, origin=record.start) for record in records]
    return tuple(_of_samples_there(block) for block in record_blocks(records, clocks, 1.0)[0])


def _of_samples_there(block: RecordBlock) -> RecordBlock:
    """The samples that are there at their own times: a block with holes can be neither shifted nor shortened."""
    if not isinstance(block, GappyBlock):
        return block
    times, values = block.times[block.taken], block.values[:, block.taken]
    return RecordBlock(times=times, values=values, hit=block.hit, rows=block.rows, noise=block.noise, ends=block.ends)


def after_phase_zero(
    blocks: Sequence[RecordBlock], records: Sequence[Record], period: float
) -> tuple[RecordBlock, ...]:
    """Blocks with times after the instant of phase zero at or before the first sample of each record."""
    # The origin of phase is the one of the record's clock, where that is a constant period, or time zero.
    shifts = [ConstantPeriod(period=period, origin=own.origin).phase(own.start) * period for own in records]
    return tuple(replace(block, times=block.times + shifts[block.hit]) for block in blocks)


def beside(fundamental: float) -> ModeParameters:
    """Entries that are fitted beside lines in any case: offset and drift."""
    return forced_entries([0.0], fundamental).joined(forced_entries([0.0], fundamental, factor=TREND))


def with_noise_left(blocks: Sequence[Block], solution: Solution) -> tuple[Block, ...]:
    """The blocks with the noise that a fit leaves."""
    noise = noise_left(blocks, solution)
    return tuple(block.with_noise(noise[block.rows, block.hit]) for block in blocks)


def find_lines(blocks: Sequence[RecordBlock], report: Callable[[str], None]) -> Lines:
    """Lines found one after another in the spectrum of the residual, all fitted jointly, where the response lives."""
    blocks = [_alive(block) for block in blocks]
    point = lines(blocks, beside(_fundamental(blocks)), FALSE_ALARM, report)
    noisy = with_noise_left(point.blocks, point.solution)
    return _lines_of(noisy, solve(noisy, weighted(noisy, point.entries, point.solution.linear), hold=True))


def _fundamental(blocks: Sequence[RecordBlock]) -> float:
    """A fundamental so high that no line is a harmonic of another."""
    return 4.0 * np.pi / min(float(np.diff(block.times).min()) for block in blocks)


def _alive(block: RecordBlock) -> RecordBlock:
    """A block without its end where the response has died in noise."""
    n = block.n_samples // PIECES
    if n < 2:
        return block
    pieces = block.values[:, : n * PIECES].reshape(len(block.rows), PIECES, n).var(axis=2)
    floor = np.median(pieces[:, -PIECES // 4 :], axis=1, keepdims=True)
    over = (pieces / np.maximum(floor, np.finfo(float).tiny)).max(axis=0)
    alive = np.flatnonzero(over > DEAD + 4.0 * np.sqrt(2.0 / n))
    if over[0] < ALIVE or not len(alive):
        return block
    end = min(int(1.25 * (alive[-1] + 1) * n) + 1, block.n_samples)
    return replace(block, times=block.times[:end], values=block.values[:, :end])


def _strengths(blocks: Sequence[Block], solution: Solution) -> Floats:
    """The norm of the amplitude of each line over the noise (lines,)."""
    both = shapes(blocks, solution)
    place = int(np.flatnonzero(both.harmonics == 0)[0])
    values = both.coefficients[~solution.entries.fixed][..., place]
    noise = np.full(values.shape[1:], np.inf)
    for block in blocks:
        noise[block.rows, block.hit] = block.noise
    return np.sqrt(np.sum(np.abs(values / noise) ** 2, axis=(1, 2)))


def _lines_of(blocks: Sequence[Block], solution: Solution) -> Lines:
    """The lines of a fit."""
    entries = solution.entries
    free = np.flatnonzero(~entries.fixed)
    n, values, real = len(free), entries.exponents[free], entries.real[free]
    place = np.concatenate([np.arange(n), n + np.flatnonzero(~real)])
    covariance = np.zeros((2 * n, 2 * n))
    covariance[np.ix_(place, place)] = solution.covariance()
    span = max(block.last for block in blocks)
    std = np.sqrt(np.maximum(np.diag(covariance)[:n], 0.0))
    # A line below the axis is the conjugate of one above it.
    flip = np.where(values.imag < 0, -1.0, 1.0)
    signs = np.concatenate([np.ones(n), flip])
    return Lines(
        exponents=values.real + 1j * np.abs(values.imag),
        real=real,
        covariance=covariance * np.outer(signs, signs),
        strength=_strengths(blocks, solution),
        undamped=(np.abs(values.real) < DEVIATIONS * std) & (np.abs(values.real) * span < SLOW),
        noise=noise_left(blocks, solution),
    )


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
    covariance: Floats  # of the decays, of the frequencies of pairs, and of the fundamental
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


def averaged(lines: Lines, groups: Sequence[Group]) -> Average:
    """The exponent of each family, and the fundamental [rad/s], found from all the spacings."""
    n, families = len(lines.exponents), len(groups)
    pairs = [place for place, group in enumerate(groups) if group.half_turns is None]
    design = np.zeros((2 * n, families + len(pairs) + 1))
    for place, group in enumerate(groups):
        for line, sign, harmonic in zip(group.lines, group.signs, group.harmonics, strict=True):
            design[line, place] = 1.0
            design[n + line, -1] = sign * harmonic + 0.5 * (group.half_turns or 0)
            if group.half_turns is None:
                design[n + line, families + pairs.index(place)] = sign
    seen = np.concatenate([lines.exponents.real, lines.exponents.imag])
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
        fundamental=float(value[-1]),
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
