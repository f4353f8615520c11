r"""The fit of one shape for all hits: the residues of a mode are its shape times its state in each hit.

.. math:: B_{r,m,c,h} = c_{r,m,c}\, a_{r,h}

All that is needed are the sums of the fit with residues free in each hit, at the same exponents: its cost is quadratic
in the coefficients. Shapes are eliminated, exponents and states are parameters; of each mode the state in its
strongest hit stays as it is. Columns that are fixed, as a forced response, are free in each hit and eliminated first.
The exponent of an entry may differ between hits.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from floquid._arrays import Complexes, Floats, Indices, Integers
from floquid.fit import ROUNDS, STEPS, Ends, Normal, Steps, levenberg_marquardt, scaled_inverse
from floquid.periodic.least_squares._parameters import ModeParameters
from floquid.periodic.least_squares._sample_block import Block
from floquid.periodic.least_squares._solver import (
    AT_REST,
    LONGEST_STEP,
    ROUNDING,
    Linear,
    Reduced,
    Solution,
    complex_parts,
    eliminated,
    real_parts,
    reduced,
    times,
    weighted,
)


@dataclass(frozen=True, eq=False)
class OneShape:
    """A fit of one shape a mode: exponents, the states of each hit, and the shapes that are least squares by them."""

    blocks: tuple[Block, ...]  # The samples, with their noise
    entries: ModeParameters  # The modes, and what is fixed beside them
    linear: tuple[Linear, ...]  # The fit with residues free in each hit at these exponents, a block each
    states: Complexes  # The state of each entry in each hit, of growing modes at its end; zero stays (entries, hits)
    held: Integers  # The hit in which the state of each entry stays (entries,)
    apart: Mapping[int, Complexes] = field(default_factory=dict)  # Of entries with an exponent for each hit (hits,)

    @staticmethod
    def at(blocks: Sequence[Block], entries: ModeParameters, linear: Sequence[Linear]) -> OneShape:
        """The states of least cost at these exponents, from those nearest to free residues."""
        values = [complex_parts(part.coefficients) for part in linear]
        return OneShape.near(blocks, entries, linear, values).with_states()

    @staticmethod
    def near(
        blocks: Sequence[Block], entries: ModeParameters, linear: Sequence[Linear], values: Sequence[Complexes]
    ) -> OneShape:
        """The states nearest to coefficients of each block: of a mode the leading singular vector over the hits."""
        columns, hits = entries.columns(), 1 + max(block.hit for block in blocks)
        channels = 1 + max(int(block.rows.max()) for block in blocks)
        seen = np.zeros((len(columns.modes), channels, hits), complex)
        for block, part, each in zip(blocks, linear, values, strict=True):
            size = np.sqrt(np.maximum(np.diag(part.gram)[: len(columns.modes)], 0.0))
            seen[:, block.rows, block.hit] = size[:, None] * each / block.noise
        states = np.ones((len(entries.exponents), hits), complex)
        for entry in np.flatnonzero(~entries.fixed):
            rows = seen[columns.modes == entry].reshape(-1, hits)
            rows = np.concatenate([rows.real, rows.imag]) if entries.real[entry] else rows
            states[entry] = np.linalg.svd(rows, full_matrices=False)[2][0]
        held = np.argmax(np.abs(states), axis=1)
        states = states / states[np.arange(len(held)), held][:, None]
        return OneShape(tuple(blocks), entries, tuple(linear), states, held)

    def period_step(self) -> tuple[float, float] | None:
        """(own period - T)/T by one step with the fundamental as a parameter, and its deviation; None if untold."""
        entries = replace(self.entries, free_period=True)
        wider = replace(self, entries=entries)
        covariance, last, omega = wider.normal_inverse, wider.n_rates - 1, entries.fundamental
        if not 0.0 < covariance[last, last] < omega**2:
            return None
        return -float(covariance[last] @ wider.normal.gradient) / omega, float(np.sqrt(covariance[last, last])) / omega

    @cached_property
    def own(self) -> Indices:
        """The columns of modes."""
        return np.flatnonzero(~self.entries.fixed[self.entries.columns().modes])

    @cached_property
    def modes(self) -> Indices:
        """The entry of each of them (columns,)."""
        return self.entries.columns().modes[self.own]

    @cached_property
    def kept(self) -> Indices:
        """Positions among the real parts, then the imaginary parts of shapes: those that are numbers."""
        return np.flatnonzero(np.concatenate([np.ones(len(self.own), bool), self.entries.sines()[self.own]]))

    @cached_property
    def reduced(self) -> tuple[Reduced, ...]:
        """The sums of each block without its fixed columns."""
        return tuple(reduced(linear, self.entries, self.own) for linear in self.linear)

    @cached_property
    def turns(self) -> list[Floats]:
        """The states of each block's hit as a matrix on shapes (2 columns, numbers of a shape)."""
        return [times(self.states[self.modes, block.hit])[:, self.kept] for block in self.blocks]

    @cached_property
    def information(self) -> Floats:
        """The Gram matrix of the shape of each channel (channels, numbers, numbers)."""
        total = np.zeros((self.n_channels, len(self.kept), len(self.kept)))
        for block, part, turn in zip(self.blocks, self.reduced, self.turns, strict=True):
            total[block.rows] += (turn.T @ part.gram @ turn) / block.noise[:, None, None] ** 2
        return total

    @cached_property
    def inverse(self) -> Floats:
        """Inverse of the information (channels, numbers, numbers)."""
        return np.array([scaled_inverse(matrix, ROUNDING) for matrix in self.information])

    @property
    def n_channels(self) -> int:
        """The number of channels."""
        return 1 + max(int(block.rows.max()) for block in self.blocks)

    @cached_property
    def shapes(self) -> Floats:
        """The shapes, least squares by the states (numbers, channels)."""
        total = np.zeros((len(self.kept), self.n_channels))
        for block, part, turn in zip(self.blocks, self.reduced, self.turns, strict=True):
            total[:, block.rows] += turn.T @ part.gram @ real_parts(part.seen[self.own]) / block.noise**2
        return np.einsum("cij,jc->ic", self.inverse, total)

    @cached_property
    def complex_shapes(self) -> Complexes:
        """Shapes as complex numbers (columns, channels)."""
        whole = np.zeros((2 * len(self.own), self.n_channels))
        whole[self.kept] = self.shapes
        return whole[: len(self.own)] + 1j * whole[len(self.own) :]

    @cached_property
    def coefficients(self) -> list[Complexes]:
        """The coefficients of all columns in each block, those of fixed ones by least squares (all, rows)."""
        coefficients = []
        for block, part, turn in zip(self.blocks, self.reduced, self.turns, strict=True):
            values, seen = part.seen.copy(), part.seen[self.own]
            parts = turn @ self.shapes[:, block.rows]
            values[self.own] = parts[: len(self.own)] + 1j * parts[len(self.own) :]
            beside = np.setdiff1d(np.arange(len(values)), self.own)
            shift = part.back @ real_parts(values[self.own] - seen)
            values[beside] -= shift[: len(beside)] + 1j * shift[len(beside) :]
            coefficients.append(values)
        return coefficients

    @cached_property
    def left(self) -> list[Floats]:
        """The sum of squares left of each block (rows,)."""
        squares = []
        for linear, part, values in zip(self.linear, self.reduced, self.coefficients, strict=True):
            off = real_parts(values[self.own] - part.seen[self.own])
            squares.append(linear.left + np.sum(off * (part.gram @ off), axis=0))
        return squares

    @property
    def cost(self) -> float:
        """χ²: the sum of squares over the noise."""
        return float(
            sum(np.sum(squares / block.noise**2) for block, squares in zip(self.blocks, self.left, strict=True))
        )

    @cached_property
    def free(self) -> Indices:
        """Real parts, then imaginary parts of states, flat by entry and hit: those that are parameters."""
        entries, hits = self.states.shape
        moves = np.broadcast_to(~self.entries.fixed[:, None], (entries, hits)).copy()
        moves[np.arange(entries), self.held] = False
        moves &= self.states != 0.0  # an entry that is in some hits alone stays so
        return np.flatnonzero(np.concatenate([moves.ravel(), (moves & ~self.entries.real[:, None]).ravel()]))

    @cached_property
    def whole(self) -> tuple[Floats, Floats, Floats]:
        """Gauss-Newton matrix and gradient of exponents and all states, and their products with shapes."""
        parameters = self.entries.parameters()
        n, hits = len(self.entries.sines()), self.states.shape[1]
        rate = np.where(parameters.turns[:, None], 1j, 1.0) * parameters.weights[:, :n]
        columns = self.entries.columns().modes
        alone = [np.where(columns == entry, 1j if turns else 1.0, 0.0) for entry, _, turns in self._alone]
        rate = np.concatenate([rate, np.reshape(alone, (-1, n))])
        hit = np.concatenate([np.full(len(parameters.turns), -1), [at for _, at, _ in self._alone]])
        count, size = len(rate), self.states.size
        matrix = np.zeros((count + 2 * size,) * 2)
        gradient = np.zeros(count + 2 * size)
        mixed = np.zeros((self.n_channels, len(self.kept), count + 2 * size))
        entry = np.flatnonzero(~self.entries.fixed)
        member = (self.modes == entry[:, None]).astype(float)
        for block, free_block, turn, values in zip(
            self.blocks, self.reduced, self.turns, self.coefficients, strict=True
        ):
            weight = 1.0 / block.noise**2
            place = np.concatenate(
                [np.arange(count), *(count + part * size + entry * hits + block.hit for part in (0, 1))]
            )
            moved = np.where((hit == -1) | (hit == block.hit), rate.T, 0.0).T[:, :, None] * values
            by_rate = np.concatenate([moved.real, moved.imag], axis=1)  # (parameters, 2 all, rows)
            shape = member[:, :, None] * self.complex_shapes[:, block.rows]
            by_state = np.concatenate(
                [np.concatenate([part.real, part.imag], axis=1) for part in (shape, 1j * shape)]
            )  # (2 states, 2 columns, rows)
            off = real_parts(values[self.own] - free_block.seen[self.own])
            late = free_block.late - free_block.mixed.T @ off
            pull = np.concatenate(
                [
                    np.einsum("pkc,kc,c->p", by_rate, late, weight),
                    -np.einsum("akc,kc,c->a", by_state, free_block.gram @ off, weight),
                ]
            )
            on_columns = np.concatenate(
                [
                    np.einsum("ik,pkc->pic", free_block.mixed, by_rate),
                    np.einsum("ik,akc->aic", free_block.gram, by_state),
                ]
            )
            by_weight = on_columns * weight
            rates = np.einsum("pkc,qkc->pq", np.einsum("kl,pkc->plc", free_block.slopes, by_rate) * weight, by_rate)
            cross = np.einsum("pic,aic->pa", by_weight[:count], by_state)
            states = np.einsum("pic,aic->pa", by_weight[count:], by_state)
            matrix[np.ix_(place, place)] += np.block([[rates, cross], [cross.T, states]])
            gradient[place] += pull
            mixed[np.ix_(block.rows, np.arange(len(self.kept)), place)] += np.einsum("in,pic->cnp", turn, by_weight)
        return matrix, gradient, mixed

    @property
    def n_rates(self) -> int:
        """Parameters that move exponents."""
        return len(self.whole[1]) - 2 * self.states.size

    @cached_property
    def parameters(self) -> Indices:
        """Positions of the parameters among exponents and all states."""
        return np.concatenate([np.arange(self.n_rates), self.n_rates + self.free])

    @cached_property
    def normal(self) -> Normal:
        """Normal equations of the parameters, shapes eliminated."""
        matrix, gradient, mixed = self.whole
        chosen = self.parameters
        taken = np.einsum("cnp,cnm,cmq->pq", mixed[..., chosen], self.inverse, mixed[..., chosen], optimize=True)
        return Normal(matrix=matrix[np.ix_(chosen, chosen)] - taken, gradient=gradient[chosen])

    def with_states(self, *, steps: int = STEPS) -> OneShape:
        """The states of least cost at these exponents, or nearer to them by some `steps`."""
        rates = self.n_rates

        def normal(at: OneShape) -> Normal:
            whole = at.normal
            return Normal(matrix=whole.matrix[rates:, rates:], gradient=whole.gradient[rates:])

        def moved(at: OneShape, step: Floats) -> OneShape:
            return replace(at, states=at._stepped(step))

        return levenberg_marquardt(self, Steps(normal=normal, moved=moved), Ends(steps=steps, gain=1.0))

    def _stepped(self, step: Floats) -> Complexes:
        parts = np.zeros(2 * self.states.size)
        parts[self.free] = step
        real, imag = np.split(parts, 2)
        return self.states + (real + 1j * imag).reshape(self.states.shape)

    def moved(self, step: Floats) -> OneShape | None:
        """After a step in the parameters; None where a mode would be another one."""
        entries = self.entries.moved(step[: self.n_rates])
        states, apart = self._stepped(step[self.n_rates :]), {entry: of.copy() for entry, of in self.apart.items()}
        for (entry, hit, turns), by in zip(
            self._alone, step[self.n_rates - len(self._alone) : self.n_rates], strict=True
        ):
            apart[entry][hit] += 1j * by if turns else by
        after = replace(self, entries=entries, states=states, apart=apart)
        for block in self.blocks:
            growth = np.exp((_growing(after.of_hit(block.hit)) - _growing(self.of_hit(block.hit))) * block.last)
            states[:, block.hit] *= growth if block is self._first(block.hit) else 1.0
        return after.at_exponents(tuple(own.coefficients for own in self.linear))

    def of_hit(self, hit: int) -> ModeParameters:
        """The modes at the exponents that they have in a `hit`."""
        exponents = self.entries.exponents.copy()
        for entry, steps in self.apart.items():
            exponents[entry] += steps[hit]
        return replace(self.entries, exponents=exponents)

    def at_exponents(self, start: tuple[Floats, ...] | None = None) -> OneShape:
        """The fit with the sums of its samples at its exponents, `start` being first values of coefficients."""
        if not self.apart:
            return replace(self, linear=tuple(eliminated(self.blocks, self.entries, start)))
        linear = []
        for place, block in enumerate(self.blocks):
            first = None if start is None else start[place : place + 1]
            linear += eliminated([block], self.of_hit(block.hit), first)
        return replace(self, linear=tuple(linear))

    def with_exponents_of_hits(self, entry: int, steps: Complexes) -> OneShape:
        """The fit in which an entry has an exponent for each hit, first ones by `steps` from that of all (hits,)."""
        return replace(self, apart={entry: steps}).at_exponents().with_states()

    @cached_property
    def _alone(self) -> list[tuple[int, int, bool]]:
        """Parameters of exponents in one hit alone, beside the one whose state stays: entry, hit, and what it is."""
        return [
            (entry, hit, turns)
            for entry in self.apart
            for hit in np.flatnonzero(self.states[entry] != 0.0).tolist()
            if hit != self.held[entry]
            for turns in ((False,) if self.entries.real[entry] else (False, True))
        ]

    def _first(self, hit: int) -> Block:
        return next(block for block in self.blocks if block.hit == hit)

    def solved(self, *, at_rest: float = AT_REST, iterations: int = STEPS, below: float = np.inf) -> OneShape:
        """The least squares near this point; given up where the cost will not come `below` a value."""
        period = 2.0 * np.pi / self.entries.fundamental

        def enough(at: OneShape, gains: list[float]) -> bool:
            # The first steps may gain little: they are not yet the rate at which the cost falls.
            return len(gains) > ROUNDS and at.cost - (iterations - len(gains)) * gains[-1] > below

        def limited(at: OneShape, step: Floats, _normal: Normal, _damping: float) -> Floats:
            longest = np.abs(step[: at.n_rates]).max(initial=0.0) * period
            return step * min(1.0, LONGEST_STEP / (longest + np.finfo(float).tiny))

        steps = Steps(normal=lambda now: now.normal, moved=OneShape.moved, limited=limited, enough=enough)
        return levenberg_marquardt(self, steps, Ends(steps=iterations, deviations=at_rest))

    @cached_property
    def covariance(self) -> Floats:
        """Covariance of exponents and all states (n, n), zero where one is no parameter."""
        covariance = np.zeros((len(self.whole[1]),) * 2)
        covariance[np.ix_(self.parameters, self.parameters)] = self.normal_inverse
        return covariance

    @cached_property
    def normal_inverse(self) -> Floats:
        """Covariance of the parameters (parameters, parameters)."""
        return scaled_inverse(self.normal.matrix, floor=True)

    def of_rates(self, further: Floats | None = None) -> Floats:
        """Covariance of the parameters that move exponents; `further` is added to their variances."""
        covariance = self.covariance[: self.n_rates, : self.n_rates]
        return covariance if further is None else covariance + np.diag(further)

    @property
    def used(self) -> list[Floats]:
        """Numbers that the fit takes of each block (rows,): leverage of shapes, and a share of states and exponents."""
        states, rates = np.where(self.entries.real, 1, 2)[~self.entries.fixed].sum(), self.n_rates
        whole = sum(len(block.rows) for block in self.blocks)
        beside = 2 * (len(self.entries.sines()) - len(self.own))
        numbers = []
        for block, part, turn in zip(self.blocks, self.reduced, self.turns, strict=True):
            gram = turn.T @ part.gram @ turn
            lever = np.einsum("cij,ji->c", self.inverse[block.rows], gram) / block.noise**2
            numbers.append(lever + states / self.n_channels + rates / whole + beside)
        return numbers

    def with_noise(self, least: Sequence[Floats]) -> OneShape:
        """Fit with the noise of its own residual, at least `least` of each block (rows,)."""
        blocks = []
        for block, squares, used, low in zip(self.blocks, self.left, self.used, least, strict=True):
            noise = np.sqrt(np.maximum(squares, 0.0) / np.maximum(block.n_samples - used, 1.0))
            blocks.append(block.with_noise(np.maximum(noise, low)))
        return replace(self, blocks=tuple(blocks))

    def as_solution(self) -> Solution:
        """The linearisation with residues free in each hit, with the coefficients of this fit."""
        solution = weighted(self.blocks, self.entries, self.linear)
        linear = tuple(
            replace(each, coefficients=real_parts(values.conj()), left=squares)
            for each, values, squares in zip(self.linear, self.coefficients, self.left, strict=True)
        )
        return replace(solution, linear=linear, cost=self.cost)

    def with_bands(self, bands: Integers) -> OneShape:
        """Exponents and states with other bands of harmonics."""
        entries = replace(self.entries, bands=bands)
        return replace(self, entries=entries).at_exponents()

    @property
    def n_numbers(self) -> int:
        """Numbers of all shapes and states."""
        return len(self.kept) * self.n_channels + len(self.free)


def _growing(entries: ModeParameters) -> Complexes:
    return np.where(entries.exponents.real > 0.0, entries.exponents, 0.0)
