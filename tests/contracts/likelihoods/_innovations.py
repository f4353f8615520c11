"""Outputs alone, or beside measured inputs, as a `Point`: `innovations`, nothing eliminated but the covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from tests.contracts.likelihoods._driven import samples_in
from tests.contracts.likelihoods._point import Data, Group, Mode, Normal

from floquid.fit import wald_rise
from floquid.innovations import Mode as OwnMode
from floquid.innovations import Predictor, predicted, solve
from floquid.innovations._solve import inverse_of, moved, normal_of, places
from floquid.innovations.search._bands import _mask, _score, anchored
from floquid.inputs import Samples


@dataclass(frozen=True)
class Innovations:
    """Samples, and the predictor of some modes."""

    data: Data
    samples: Samples
    now: Predictor

    @classmethod
    def at(cls, data: Data, modes: Sequence[Mode]) -> Innovations:
        samples = samples_in(data, "none")
        return cls(data, samples, predictor(samples, modes, np.zeros((len(data.noise), 1))))

    @property
    def modes(self) -> tuple[Mode, ...]:
        found, row = [], 0
        for mode in self.now.modes:
            initial = self.now.initial[:, row] + (0j if mode.real else 1j * self.now.initial[:, row + 1])
            row += mode.rows
            found.append(Mode(exponent=mode.exponent, real=mode.real, seen=mode.turns, shape=mode.shape,
                              driven=mode.reach, gains=mode.gains, initial=initial))  # fmt: skip
        return tuple(found)

    @property
    def log_likelihood(self) -> float:
        return self.now.log_likelihood

    @property
    def n_parameters(self) -> int:
        return self.now.n_parameters

    @property
    def residual(self) -> np.ndarray:
        return self.now.white(self.now.innovations)

    @property
    def free(self) -> np.ndarray:
        """The parameters but for the scale of each state."""
        return anchored(self.now)

    @property
    def covariance(self) -> np.ndarray:
        free = self.free
        return inverse_of(normal_of(self.samples, self.now), free)[np.ix_(free, free)]

    def normal(self) -> Normal:
        found, names = normal_of(self.samples, self.now), []
        for number, mode in enumerate(self.now.modes):
            names += [(number, "decay", 0), (number, "frequency", 0)][: mode.rows]
            names += [(number, "gain", k % mode.gains.size) for k in range(2 * mode.gains.size)]
            names += [(number, "shape", k % mode.shape.size) for k in range(2 * mode.shape.size)]
        names += [(0, "known", k) for k in range(self.now.columns.size)]
        names += [(0, "initial", k) for k in range(self.now.initial.size)]
        kept = np.flatnonzero(self.free)
        return Normal(tuple(names[k] for k in kept), found.gradient[kept], found.matrix[np.ix_(kept, kept)])

    def moved(self, step: np.ndarray) -> Innovations | None:
        whole = np.zeros(len(self.free))
        whole[self.free] = step
        found = moved(self.samples, self.now, whole, 1e-9)
        return None if found is None else replace(self, now=found)

    def with_modes(self, modes: Sequence[Mode]) -> Innovations:
        return replace(self, now=predictor(self.samples, modes, self.now.columns))

    def refit(self) -> Innovations:
        return replace(self, now=solve(self.samples, solve(self.samples, self.now)))

    def score(self, group: Group) -> float:
        modes = list(self.modes)
        modes[group[0]] = modes[group[0]].having(*group[1:])
        wider = self.with_modes(modes)
        normal, rows = normal_of(wider.samples, wider.now), wider.rows(group)
        free = wider.free
        free[rows] = False
        return _score(normal, inverse_of(normal, free), rows)

    def wald(self, group: Group) -> float:
        values = np.concatenate([mode.parameters for mode in self.now.modes])
        rows, spread = self.rows(group), inverse_of(normal_of(self.samples, self.now), self.free)
        return wald_rise(values[rows], spread[np.ix_(rows, rows)])

    def rows(self, group: Group) -> np.ndarray:
        """The parameters of a harmonic."""
        number, side, harmonic = group
        mode = self.now.modes[number]
        turns, reach = mode.turns == harmonic, mode.reach == harmonic
        mask = _mask(mode, turns & (side == "seen"), reach & (side == "driven"))
        return places(self.now.modes)[number].start + np.flatnonzero(mask)


def predictor(samples: Samples, modes: Sequence[Mode], columns: np.ndarray) -> Predictor:
    parts = [part for mode in modes for part in (mode.initial.real, mode.initial.imag)[: 1 if mode.real else 2]]
    own = [
        OwnMode(exponent=mode.exponent, real=mode.real, turns=mode.seen, shape=mode.shape, reach=mode.driven,
                gains=mode.gains)
        for mode in modes
    ]  # fmt: skip
    found = predicted(samples, own, columns, np.array(parts).T)
    assert found is not None
    return found
