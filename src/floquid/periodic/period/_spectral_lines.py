"""The lines of records: their responses as those of one LTI system, each exponential alone (Allen 2009, eq. 12)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Complexes, Floats, Mask
from floquid._checks import input_error
from floquid.core import ConstantPeriod, Record
from floquid.errors import IdentificationError
from floquid.findings import failure
from floquid.fit import DEVIATIONS, SLOW, chi2_limit
from floquid.lti import AbstractIdentifier, TimeResponses
from floquid.periodic.least_squares import (
    TREND,
    Block,
    GappyBlock,
    ModeParameters,
    RecordBlock,
    Solution,
    forced_entries,
    linearise,
    noise_left,
    record_blocks,
    residuals_of,
    shapes,
    solve,
    weighted,
)
from floquid.periodic.search import lines

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


def find_lines(
    blocks: Sequence[RecordBlock],
    *,
    shortened: bool = False,
    false_alarm: float = 1e-9,
    report: Callable[[str], None] = lambda _: None,
) -> Lines:
    """Lines found one after another in the spectrum of the residual, all fitted jointly."""
    if shortened:
        blocks = [_alive(block) for block in blocks]
    point = lines(blocks, beside(_fundamental(blocks)), false_alarm, report)
    noisy = with_noise_left(point.blocks, point.solution)
    return _lines_of(noisy, solve(noisy, weighted(noisy, point.entries, point.solution.linear), hold=True))


def lines_by(
    identifier: AbstractIdentifier,
    records: Sequence[Record],
    blocks: Sequence[RecordBlock],
    *,
    order: int | None,
    false_alarm: float = 1e-9,
    report: Callable[[str], None] = lambda _: None,
) -> Lines:
    """Lines by an identifier of LTI systems; one without covariance starts the least squares of its poles."""
    if any(np.isnan(r.values).any() for r in records) or len({r.sample_rate for r in records}) > 1:
        must = "have all samples, at one rate, with an `identifier`"
        raise input_error("records", "fse", must, "they do not", "Leave `identifier` out: the search copes with that.")
    fundamental = _fundamental(blocks)
    base = beside(fundamental)
    lengths = np.array([r.n_samples for r in records])
    values = np.zeros((records[0].n_channels, len(records), int(lengths.max())))
    noise = np.ones(values.shape[:2])
    for block, residual in zip(blocks, residuals_of(blocks, linearise(blocks, base)), strict=True):
        values[block.rows, block.hit, : block.n_samples] = block.values
        noise[block.rows, block.hit] = np.maximum(residual.noise, np.finfo(float).tiny)
    data = TimeResponses(values=values, dt=1.0 / records[0].sample_rate, noise=noise, lengths=lengths)
    model = identifier.extract(identifier.prepare(data), order, report=report)
    poles = model.poles
    upper = np.flatnonzero((poles.imag > 0) | (model.multipliers.imag == 0) & (model.multipliers.real > 0))
    upper = upper[poles[upper].imag < np.pi / data.dt * (1.0 - 1e-9)]
    if not len(upper):
        raise IdentificationError(
            f"Identification ended without a result: {type(identifier).__name__} finds no pole: "
            f"{failure(model.outcome.value).clause}."
        )
    real = poles[upper].imag == 0
    entries = ModeParameters.made(
        np.where(real, poles[upper].real, poles[upper]), (0, 0), fundamental, real=real
    ).joined(base)
    noisy = tuple(block.with_noise(noise[block.rows, block.hit]) for block in blocks)
    if model.covariance is None:
        solution = _clear(noisy, entries, false_alarm)
        return _lines_of(with_noise_left(noisy, solution), solution)
    solution = linearise(noisy, entries)
    both = np.concatenate([upper, upper + model.order])
    return replace(
        _lines_of(with_noise_left(noisy, solution), solution), covariance=model.covariance[np.ix_(both, both)]
    )


def _clear(blocks: Sequence[Block], entries: ModeParameters, false_alarm: float) -> Solution:
    """The least squares without lines that noise explains, or that run away: a routine of fixed order has some."""
    while True:
        free = np.flatnonzero(~entries.fixed)
        try:
            solution, ran_away = solve(blocks, entries), False
        except IdentificationError:
            solution, ran_away = linearise(blocks, entries), True
        noisy = with_noise_left(blocks, solution)
        size, responses = _strengths(noisy, linearise(noisy, solution.entries), relative=True)
        if not len(free) or not (ran_away or size.min() ** 2 < chi2_limit(2 * responses + 2, false_alarm)):
            return solution
        entries = solution.entries.picked(np.delete(np.arange(len(entries.exponents)), free[np.argmin(size)]))


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


def _strengths(blocks: Sequence[Block], solution: Solution, *, relative: bool = False) -> tuple[Floats, int]:
    """The norm of the amplitude of each line over the noise, or over its own deviation; and the responses seen."""
    both = shapes(blocks, solution)
    place = int(np.flatnonzero(both.harmonics == 0)[0])
    free = ~solution.entries.fixed
    values, std = both.coefficients[free][..., place], both.std[free][..., place]
    if relative:
        parts = [np.divide(v, s, out=np.zeros(v.shape), where=s > 0) for v, s in ((values.real, std.real),)]
        parts.append(np.divide(values.imag, std.imag, out=np.zeros(values.shape), where=std.imag > 0))
        return np.sqrt(sum(np.sum(part**2, axis=(1, 2)) for part in parts)), values[0].size if len(values) else 1
    noise = np.full(values.shape[1:], np.inf)
    for block in blocks:
        noise[block.rows, block.hit] = block.noise
    return np.sqrt(np.sum(np.abs(values / noise) ** 2, axis=(1, 2))), noise.size


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
        strength=_strengths(blocks, solution)[0],
        undamped=(np.abs(values.real) < DEVIATIONS * std) & (np.abs(values.real) * span < SLOW),
        noise=noise_left(blocks, solution),
    )
