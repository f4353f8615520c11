"""Responses to measured inputs as a `Point`: `inputs`, shapes and the direct term eliminated, the noise profiled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from tests.contracts.likelihoods._input_modes import input_mode, moved_modes, names_of, plain_mode
from tests.contracts.likelihoods._point import Data, Group, Mode, Normal

from floquid.inputs import Linearisation, Samples, Scores, linearise, samples_of, solve
from floquid.inputs._solver import columns_of, covariance, normal_equations
from floquid.inputs.search._bands import _input_weight, _weight

DIRECT = (0.0,)


@dataclass(frozen=True)
class Driven:
    """Samples with their inputs, and the fit at some modes."""

    data: Data
    samples: Samples
    now: Linearisation

    @classmethod
    def at(cls, data: Data, modes: Sequence[Mode]) -> Driven:
        samples = samples_in(data, "zero")
        return cls(data, samples, linearise(samples, [input_mode(mode, samples.input_size) for mode in modes], DIRECT))

    @property
    def modes(self) -> tuple[Mode, ...]:
        return tuple(plain_mode(mode, self.now.shape(k).T) for k, mode in enumerate(self.now.modes))

    @property
    def log_likelihood(self) -> float:
        return self.now.log_likelihood

    @property
    def n_parameters(self) -> int:
        return self.now.n_parameters

    @property
    def residual(self) -> np.ndarray:
        return self.now.left / self.now.noise[:, None]

    @property
    def covariance(self) -> np.ndarray:
        return covariance(self.samples, self.now)

    def normal(self) -> Normal:
        """The deviations of the noise are unbiased there: those of the likelihood are the rms of the residual."""
        count = self.samples.n_samples
        share = count / (count - self.now.rank)
        matrix, gradient, _ = normal_equations(self.samples, self.now)
        return Normal(names_of(self.now.modes), share * gradient, share * matrix)

    def moved(self, step: np.ndarray) -> Driven:
        return replace(self, now=linearise(self.samples, moved_modes(self.now.modes, step), DIRECT))

    def with_modes(self, modes: Sequence[Mode]) -> Driven:
        return Driven.at(self.data, modes)

    def refit(self) -> Driven:
        return replace(self, now=solve(self.samples, self.now.modes, DIRECT, iterations=60, at_rest=1e-7))

    def score(self, group: Group) -> float:
        """Of one record in single precision, as the search has it; of two in double."""
        scores = Scores(self.samples, self.now, rough=len(self.data.starts) == 1)
        number, side, harmonic = group
        if side == "driven":
            return float(scores.by_inputs([(number, harmonic)])[0])
        alone = replace(self.now.modes[number], turns=np.array([harmonic]))
        state = self.now.states[number]
        return float(scores.by_columns([lambda part, own: columns_of(part, alone, state[..., own])])[0])

    def wald(self, group: Group) -> float:
        number, side, harmonic = group
        mode, (columns, turning) = self.now.modes[number], self.now.slices()[number]
        if side == "seen":
            return _weight(self.now, columns, turning, np.flatnonzero(mode.turns == harmonic))
        first = sum(int(own.free.sum()) for own in self.now.modes[:number])
        block = slice(first, first + int(mode.free.sum()))
        return _input_weight(mode, self.covariance[block, block], np.flatnonzero(mode.reach == harmonic))


def samples_in(data: Data, hold: str) -> Samples:
    """Samples with one offset for all records: a split adds no column."""
    found = samples_of(data.values, data.inputs, data.starts, step=data.step, fundamental=data.omega, hold=hold)
    return replace(found, known=np.ones((1, found.n_samples)))
