r"""Blocks of lifted responses, one a hit.

On lifted samples t = τ_p + nT, and z_j = e^{(λ_e + i(m + q)ω)τ_p} (μ_e e^{2πiq})^n since e^{imωT} = 1: every sum over
samples of products of columns is a sum of products of a sum over cycles, one a pair of modes, and a sum over phases,
one a pair of columns. No column is ever formed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Complexes, Floats, Integers, Mask
from floquid._checks import input_error
from floquid.core import PhaseClock, Record
from floquid.fit import HALF_DIGITS
from floquid.lifting import Lifted
from floquid.lti import TimeResponses
from floquid.periodic.least_squares._sample_block import (
    EXPONENTIAL,
    FOLLOWS,
    TREND,
    Block,
    Columns,
    Sums,
    Terms,
    entry_function,
    real_products,
)


@dataclass(frozen=True, slots=True)
class LiftedBlock(Block):
    """One hit of lifted responses."""

    lifted: Lifted
    hit: int
    rows: Integers
    noise: Floats
    known: Floats | None = None
    """An orthonormal basis Q of what is known beside the modes, over the cycles (cycles, known): with another amplitude
    at each phase it is projected off, which commutes with the sums over phases."""
    free: Floats | None = None  # the responses with that taken off (rows, phases, cycles)

    @staticmethod
    def all_of(lifted: Lifted, known: Sequence[Floats] | None = None) -> tuple[LiftedBlock, ...]:
        """One block a hit, with what is known of each beside the modes (cycles, known)."""
        rows = np.arange(lifted.n_channels)
        blocks = [LiftedBlock(lifted, hit, rows, lifted.noise[:, hit]) for hit in range(lifted.n_hits)]
        if known is None:
            return tuple(blocks)
        return tuple(
            replace(block, known=q, free=block._values() - (block._values() @ q) @ q.T)  # noqa: SLF001  # its own class
            for block, q in zip(blocks, known, strict=True)
        )

    @property
    def n_cycles(self) -> int:
        """Cycles of this hit."""
        return int(self.lifted.responses.lengths[self.hit])

    @property
    def n_samples(self) -> int:
        """Samples of each channel, those that tell the noise alone too, less the amplitudes of what is known."""
        later = 0 if self.lifted.later_cycles is None else int(self.lifted.later_cycles[self.hit])
        return (self.n_cycles + later - (0 if self.known is None else self.known.shape[1])) * self.lifted.n_phases

    @property
    def last(self) -> float:
        """The start of the last cycle [s]: growing columns are counted from there."""
        return (self.n_cycles - 1) * self.lifted.period

    @property
    def largest(self) -> Floats:
        """The largest size of a sample (rows,)."""
        return np.abs(self._values()).max(axis=(1, 2))

    def with_noise(self, noise: Floats) -> LiftedBlock:
        """Samples with other noise (rows,)."""
        return replace(self, noise=noise)

    def gain(self, rates: Complexes, *, slope: bool = False) -> Complexes:
        """Gain of the whitening filter at e^{st}, or its slope (rows, rates)."""
        return self.lifted.gain(rates, slope=slope)

    def residual(self, columns: Columns, coefficients: Complexes) -> tuple[NDArray, NDArray]:
        """Times (samples,) [s] and what the model leaves at each (rows, samples)."""
        starts, cycles, phases, terms, outer = self._factors(columns)
        parts = _parts(self._off_known(cycles))
        times = np.add.outer(starts, self.lifted.phase_times).ravel()
        shapes = _shapes(coefficients[terms.of], phases, outer, cycles.shape[1])
        values = self._values()
        residual = np.empty((len(values), values[0].size))
        for left, row, block in zip(residual, shapes, values, strict=True):
            left[:] = (block - row @ parts.T).T.ravel()
        return times, residual

    def sums(self, columns: Columns, coefficients: Complexes) -> Sums:
        """The sums of the scaled columns, and of what the model 2 Re Σ B_j z_j leaves."""
        starts, cycles, phases, terms, outer = self._factors(columns)
        times, parts = self.lifted.phase_times, _parts(cycles)
        # Real and imaginary parts beside each other, and the same times nT: one real product a channel.
        weights, own_parts = np.concatenate([parts, starts[:, None] * parts], axis=1), _parts(self._off_known(cycles))
        met = np.empty((len(self.rows), self.lifted.n_phases, weights.shape[1]))
        later = self.lifted.later_squares
        squares = np.zeros(len(self.rows)) if later is None else later[self.rows, self.hit]
        shapes = _shapes(coefficients[terms.of], phases, outer, cycles.shape[1])
        for row, block in enumerate(self._values()):
            residual = block - shapes[row] @ own_parts.T
            squares[row] += np.einsum("pn,pn->", residual, residual)
            np.matmul(residual, weights, out=met[row])
        real, imag, late_real, late_imag = (part[:, :, outer] for part in np.split(met, 4, axis=2))
        plain, late = real + 1j * imag, late_real + 1j * late_imag
        seen = np.einsum("pj,cpj->jc", phases.conj(), plain)
        late = np.einsum("pj,cpj->jc", phases.conj(), late + times[:, None] * plain)
        # What is known takes its share of the columns, and of the columns times nT.
        late_cycles = starts[:, None] * cycles
        whole, late_whole = self._off_known(cycles), self._off_known(late_cycles)
        straight = _products(
            (cycles.conj(), late_cycles.conj()), (whole, late_whole), phases.conj(), phases, times, outer
        )
        crossed = _products((cycles, late_cycles), (whole, late_whole), phases, phases, times, outer)
        gram, mixed, slopes = (real_products(*both) for both in zip(straight, crossed, strict=True))
        return terms.gathered(Sums(gram, mixed, slopes, _real_data(seen), _real_data(late), squares))

    def _values(self) -> Floats:
        """(rows, phases, cycles)."""
        if self.free is not None:
            return self.free
        shape = (len(self.rows), self.lifted.n_phases, self.n_cycles)
        return self.lifted.responses.values[:, self.hit, : self.n_cycles].reshape(shape)

    def _off_known(self, cycles: Complexes) -> Complexes:
        """Functions of the cycle less what is known of them (cycles, …)."""
        return cycles if self.known is None else cycles - self.known @ (self.known.T @ cycles)

    def _factors(self, columns: Columns) -> tuple[NDArray, NDArray, NDArray, Terms, Integers]:
        """Starts of cycles, functions of the cycle (cycles, functions) and of the phase (phases, terms), and terms."""
        if ((columns.factors >= TREND) & (columns.factors <= FOLLOWS[-1])).any():
            raise input_error("entries", "LiftedBlock", "be exponentials", "one is not", "Fit the record itself.")
        starts = np.asarray(np.arange(self.n_cycles) * self.lifted.period, np.float64)
        terms = Terms.made(columns)
        functions, outer = terms.outer()
        cycles = np.empty((len(starts), len(functions)), complex)
        for place, (entry, kind) in enumerate(functions):
            turning = 1j * columns.fundamental * columns.offsets[entry]
            if kind == EXPONENTIAL:
                exponent = columns.exponents[entry]
                cycles[:, place] = np.exp(
                    (exponent + turning) * starts - (starts[-1] * exponent if exponent.real > 0 else 0.0)
                )
            else:
                cycles[:, place] = entry_function(columns, entry, kind, starts, growth=starts[-1])
                cycles[:, place] *= np.exp(turning * starts)
        times = self.lifted.phase_times
        decays = np.where(columns.paired, 0.0, columns.exponents)
        rates = decays[columns.modes] + 1j * columns.fundamental * columns.turns
        phases = np.exp(np.multiply.outer(times, rates))[:, terms.of]
        return starts, cycles, phases if terms.plain else phases * terms.at(terms.second, times), terms, outer


def _parts(cycles: Complexes) -> Floats:
    """Real parts, then the negative imaginary parts (cycles, 2 entries)."""
    return np.concatenate([cycles.real, -cycles.imag], axis=1)


def _shapes(coefficients: Complexes, phases: Complexes, outer: Integers, count: int) -> Floats:
    """2 Re B z over the phases, then 2 Im, in sum for each function of the cycle (rows, phases, 2 functions)."""
    member = np.equal.outer(outer, np.arange(count)).astype(float)
    terms = 2.0 * coefficients.T[:, None, :] * phases
    return np.concatenate([terms.real @ member, terms.imag @ member], axis=2)


def _products(
    first: tuple[Complexes, Complexes],
    second: tuple[Complexes, Complexes],
    left_factor: Complexes,
    right_factor: Complexes,
    times: Floats,
    outer: Integers,
) -> tuple[Complexes, ...]:
    """Σ (first one) (second other), with t at the second, with t at both (terms, terms)."""
    long = {(p, q): (first[p].T @ second[q])[outer][:, outer] for p in (0, 1) for q in (0, 1)}
    short = [(left_factor * (times**k)[:, None]).T @ right_factor for k in range(3)]
    return (
        long[0, 0] * short[0],
        long[0, 0] * short[1] + long[0, 1] * short[0],
        long[0, 0] * short[2] + (long[0, 1] + long[1, 0]) * short[1] + long[1, 1] * short[0],
    )


def _real_data(seen: Complexes) -> Floats:
    return np.concatenate([seen.real, -seen.imag])


@dataclass(frozen=True, slots=True)
class KeptCycles(LiftedBlock):
    """One hit, without the cycles that are left out."""

    kept: Mask = field(kw_only=True)  # mask of the cycles that are there (cycles,)

    @property
    def n_cycles(self) -> int:
        """Cycles, those left out too."""
        return len(self.kept)

    @property
    def n_samples(self) -> int:
        """Samples of each channel that are there."""
        return int(self.kept.sum()) * self.lifted.n_phases

    @staticmethod
    def of(record: Record, clock: PhaseClock, period: float, hit: int) -> KeptCycles | None:
        """The block of a record; None where it is not whole cycles of whole samples that are left out."""
        exact = record.sample_rate * period
        phases = round(exact)
        cycles = record.n_samples // max(phases, 1)
        if clock.measured or cycles < 1 or abs(exact - phases) * cycles > HALF_DIGITS:
            return None
        whole, residual = np.split(record.values, [cycles * phases], axis=1)
        cut = whole.reshape(record.n_channels, cycles, phases)
        missing = np.isnan(cut)
        if not (np.isnan(residual).all() and (missing == missing[:1, :, :1]).all()) or missing.all():
            return None
        kept = ~missing[0, :, 0]
        values = cut[:, kept].transpose(0, 2, 1).reshape(-1, 1, int(kept.sum()))
        values.flags.writeable = False
        lifted = Lifted(
            responses=TimeResponses(values=values, dt=period),
            channels=record.channels,
            n_phases=phases,
            first_phase=clock.phase(record.start) * clock.period / period,
            provenance=record.provenance,
        )
        rows = np.arange(record.n_channels)
        return KeptCycles(lifted, hit, rows, np.ones(len(rows)), kept=kept)

    def _values(self) -> Floats:
        """Values of the cycles that are there (rows, phases, cycles)."""
        return self.lifted.responses.values[:, 0].reshape(len(self.rows), self.lifted.n_phases, -1)

    def _factors(self, columns: Columns) -> tuple[NDArray, NDArray, NDArray, Terms, Integers]:
        """Factors of the cycles that are there."""
        starts, cycles, phases, terms, outer = LiftedBlock._factors(self, columns)  # noqa: SLF001  # super() is not to be had with slots
        return starts[self.kept], cycles[self.kept], phases, terms, outer
