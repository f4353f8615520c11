"""Free responses as a `Point`: `periodic.least_squares`, amplitudes eliminated, the noise known."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from tests.contracts.likelihoods._point import Data, Group, Mode, Normal

from floquid import Record
from floquid.core import ConstantPeriod
from floquid.lifting import lift, whitened
from floquid.periodic.least_squares import (
    Block,
    LiftedBlock,
    ModeParameters,
    Solution,
    complex_of,
    estimates_of,
    filtered_blocks,
    linearise,
    record_blocks,
    solve,
)
from floquid.sync import segment


@dataclass(frozen=True)
class Decays:
    """Blocks of samples, and the fit at some exponents."""

    data: Data
    blocks: Sequence[Block]
    now: Solution

    @classmethod
    def at(cls, data: Data, modes: Sequence[Mode], blocks_of: Callable[[Data], Sequence[Block]]) -> Decays:
        blocks = blocks_of(data)
        return cls(data, blocks, linearise(blocks, entries_of(modes, data.omega)))

    @cached_property
    def modes(self) -> tuple[Mode, ...]:
        """Shapes of the first hit, its state at its first sample 1."""
        entries, found = self.now.entries, estimates_of(self.blocks, self.now)
        modes = []
        for number, exponent in enumerate(entries.exponents):
            own = found.modes == number
            seen = found.harmonics[own] + entries.offsets[number]
            # A block counts its times from the last phase zero.
            whole = 1j * seen * self.data.omega * (self.data.starts[0] - self.first)
            start = np.exp(exponent * self.first - whole) * found.multiplicity[own]
            shape = (found.coefficients[own, :, 0] * start[:, None]).T
            modes.append(Mode(exponent=complex(exponent), seen=seen, shape=shape, real=bool(entries.real[number])))
        return tuple(modes)

    @property
    def first(self) -> float:
        """The time of the first sample after a phase zero [s]: a filter takes none off the amplitudes."""
        return self.data.starts[0] % (2.0 * np.pi / self.data.omega)

    @property
    def log_likelihood(self) -> float:
        return -self.now.cost

    @property
    def n_parameters(self) -> int:
        columns = len(self.now.entries.sines()) + int(self.now.entries.sines().sum())
        return len(self.now.gradient) + columns * sum(len(block.rows) for block in self.blocks)

    @property
    def residual(self) -> np.ndarray:
        columns, hits = self.now.entries.columns(), []
        for hit, values in enumerate(self.data.values):
            hits.append(np.full(values.shape, np.nan))
            for block, linear in zip(self.blocks, self.now.linear, strict=True):
                if block.hit == hit:
                    times, left = block.residual(columns, complex_of(linear.coefficients))
                    place = np.rint((times - times[0]) / self.data.step).astype(int)
                    hits[hit][np.ix_(block.rows, place)] = left / block.noise[:, None]
        return np.concatenate(hits, axis=1)

    @property
    def covariance(self) -> np.ndarray:
        return self.now.covariance()

    def normal(self) -> Normal:
        names = [(mode, "decay", 0) for mode in range(len(self.now.entries.real))]
        names += [(mode, "frequency", 0) for mode in np.flatnonzero(~self.now.entries.real).tolist()]
        return Normal(tuple(names), self.now.gradient, self.now.gauss_newton)

    def moved(self, step: np.ndarray) -> Decays:
        return replace(self, now=linearise(self.blocks, self.now.entries.moved(step)))

    def with_modes(self, modes: Sequence[Mode]) -> Decays:
        return replace(self, now=linearise(self.blocks, entries_of(modes, self.data.omega)))

    def refit(self) -> Decays:
        return replace(self, now=solve(self.blocks, self.now, at_rest=1e-7))

    def score(self, group: Group) -> float:
        modes = list(self.modes)
        modes[group[0]] = modes[group[0]].having(*group[1:])
        wider = self.with_modes(modes)
        return wider.log_likelihood - self.log_likelihood + wider.normal().step() @ wider.now.gradient

    def wald(self, group: Group) -> float:
        own = estimates_of(self.blocks, self.now)
        turns = own.harmonics + self.now.entries.offsets[own.modes]
        row = np.flatnonzero((own.modes == group[0]) & (turns == group[2]))
        places = list(np.ndindex(*own.blocks.shape))
        values = own.coefficients[row[0]].ravel().view(float)
        slopes = own.slopes[row[0]].reshape(len(places), -1)
        slopes = np.stack([slopes.real, slopes.imag], axis=1).reshape(len(values), -1)
        whole, both = slopes @ own.covariance @ slopes.T, np.append(row, row + len(own.modes))
        for k, place in enumerate(places):
            whole[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] += own.noise_covariance(*place)[np.ix_(both, both)]
        return float(values @ np.linalg.solve(whole, values))


def entries_of(modes: Sequence[Mode], omega: float) -> ModeParameters:
    offsets = [float(mode.seen[0] % 1.0) for mode in modes]
    bands = [(round(mode.seen[0] - off), round(mode.seen[-1] - off)) for mode, off in zip(modes, offsets, strict=True)]
    real = [mode.real for mode in modes]
    return ModeParameters.made([mode.exponent for mode in modes], bands, omega, real=real, offsets=offsets)


def records_of(data: Data) -> tuple[list[Record], list[ConstantPeriod]]:
    clock = ConstantPeriod(period=2.0 * np.pi / data.omega)
    names = [f"c{number}" for number in range(len(data.noise))]
    made = [
        Record(values=values, sample_rate=1.0 / data.step, start=start, channels=names, clock=clock)
        for values, start in zip(data.values, data.starts, strict=True)
    ]
    return made, [clock] * len(made)


def lifted(data: Data, taps: np.ndarray | None = None) -> Sequence[Block]:
    """Whole periods, one block a hit; after a filter."""
    found = lift(segment(records_of(data)[0]))
    found = found if taps is None else whitened(found, np.tile(taps, (len(data.noise), 1)))
    return LiftedBlock.all_of(found.with_noise(np.tile(data.noise[:, None], (1, len(data.values)))))


def sampled(data: Data, taps: np.ndarray | None = None) -> Sequence[Block]:
    """Samples as they are, those missing left out; after a filter."""
    blocks = [block.with_noise(data.noise[block.rows]) for block in record_blocks(*records_of(data), 1.0)[0]]
    found = blocks if taps is None else filtered_blocks(blocks, np.tile(taps, (len(data.noise), 1)))
    assert found is not None
    return found
