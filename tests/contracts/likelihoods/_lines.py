"""Transfer functions measured line by line as a `Point`: `transfer`, amplitudes eliminated, deviations known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from tests.contracts.likelihoods._input_modes import input_mode, moved_modes, names_of, plain_mode
from tests.contracts.likelihoods._point import Group, Mode, Normal

from floquid.transfer import Modal
from floquid.transfer._modal import Fitted, Lines, eliminated, fitted, promised, turning
from floquid.transfer._search import HELD


@dataclass(frozen=True)
class LineData:
    """Lines, and what may be done to them."""

    lines: Lines

    @property
    def omega(self) -> float:
        return self.lines.fundamental

    @property
    def step(self) -> float:
        return 2.0 * np.pi / self.omega / 16.0

    @property
    def starts(self) -> tuple[float, ...]:
        return tuple(self.lines.echoes[1])

    def with_values(self, of, echoes=None) -> LineData:
        own = self.lines
        return LineData(replace(own, values=of(own.values), std=of(own.std), echoes=echoes or own.echoes))

    def scaled(self, outputs: np.ndarray, inputs: np.ndarray) -> LineData:
        weights, begins = self.lines.echoes
        return self.with_values(
            lambda own: own * outputs[:, None, None] / inputs[:, None], (weights / inputs[:, None], begins)
        )

    def ordered(self, channels: Sequence[int]) -> LineData:
        return self.with_values(lambda own: own[:, np.array(channels)])

    def later(self, seconds: float) -> LineData:
        """Ω is the input's: G_m turns by mω, and what rang at the begin by Ω besides."""
        own, (weights, begins) = self.lines, self.lines.echoes
        turned = np.exp(-1j * own.harmonics * own.fundamental * seconds)[:, None, None, None]
        echoes = weights * np.exp(1j * own.omega * seconds), begins + seconds
        return LineData(replace(own, values=own.values * turned, echoes=echoes))

    def split(self, _: int) -> LineData:
        """Each line measured twice, with twice the variance."""
        own, (weights, begins) = self.lines, self.lines.echoes
        values, std = (np.concatenate([part, part], axis=-1) for part in (own.values, 2.0**0.5 * own.std))
        echoes = np.concatenate([weights, weights], axis=-1), begins
        return LineData(replace(own, values=values, std=std, omega=np.tile(own.omega, 2), echoes=echoes))

    def with_silence(self) -> LineData:
        """With an input that has no power: its G was not measured."""
        weights, begins = self.lines.echoes
        echoes = np.concatenate([weights, np.zeros_like(weights[:, :1])], axis=1), begins
        return self.with_values(lambda own: np.concatenate([own, np.full_like(own[:, :, :1], np.nan)], axis=2), echoes)


@dataclass(frozen=True)
class LinePoint:
    """Lines, and the fit at some modes."""

    data: LineData
    now: Fitted

    @classmethod
    def at(cls, data: LineData, modes: Sequence[Mode]) -> LinePoint:
        return cls(data, eliminated(data.lines, modal_of(data.lines, modes)))

    @property
    def modes(self) -> tuple[Mode, ...]:
        modal = self.now.modal
        return tuple(plain_mode(mode, shape) for mode, shape in zip(modal.modes, modal.shapes, strict=True))

    @property
    def log_likelihood(self) -> float:
        return -self.now.cost

    @property
    def n_parameters(self) -> int:
        return self.now.n_parameters

    @property
    def residual(self) -> np.ndarray:
        return np.array(self.now.left)

    @property
    def covariance(self) -> np.ndarray:
        return self.now.parameters

    def normal(self) -> Normal:
        apart = self.now.apart
        return Normal(names_of(self.now.modal.modes), apart @ np.concatenate(self.now.left), apart @ apart.T)

    def moved(self, step: np.ndarray) -> LinePoint:
        modes = tuple(moved_modes(self.now.modal.modes, step))
        return replace(self, now=eliminated(self.data.lines, replace(self.now.modal, modes=modes)))

    def with_modes(self, modes: Sequence[Mode]) -> LinePoint:
        return LinePoint.at(self.data, modes)

    def refit(self) -> LinePoint:
        return replace(self, now=fitted(self.data.lines, self.now.modal))

    def score(self, group: Group) -> float:
        modes = list(self.modes)
        modes[group[0]] = modes[group[0]].having(*group[1:])
        return self.now.cost - promised(self.with_modes(modes).now)

    def wald(self, group: Group) -> float:
        number, side, harmonic = group
        modal, mode = self.now.modal, self.now.modal.modes[number]
        spread, free, place = self.now.covariance(), len(self.now.parameters), 0
        if side == "driven":
            names = names_of(modal.modes)
            which = int(np.flatnonzero(mode.reach == harmonic)[0])
            rows = [
                k for k, own in enumerate(names) if own[:2] == (number, "gain") and own[2] % len(mode.reach) == which
            ]
            values = np.concatenate([mode.gains[:, which].real, mode.gains[:, which].imag])
        else:
            place = free + sum(len(own.turns) + int(turning(own).sum()) for own in modal.modes[:number])
            first = place + int(np.flatnonzero(mode.turns == harmonic)[0])
            both, width = np.array([first, first + len(mode.turns)]), len(self.now.columns[0])
            rows = np.concatenate([both + width * output for output in range(len(self.now.left))])
            shape = modal.shapes[number][:, mode.turns == harmonic]
            values = np.concatenate([shape.real, shape.imag], axis=1).ravel()
        return float(values @ np.linalg.solve(spread[np.ix_(rows, rows)], values))


def modal_of(lines: Lines, modes: Sequence[Mode]) -> Modal:
    direct = (np.zeros(lines.values.shape[1:3], complex),)
    sizes = np.full(lines.values.shape[2], HELD)
    return Modal(tuple(input_mode(mode, sizes) for mode in modes), tuple(mode.shape for mode in modes), direct)
