"""One protocol for the four likelihoods, and what may be done to modes and records without changing the physics.

Twice the logarithm of the likelihood is L: near a maximum L = L_0 + 2 gᵀs - sᵀMs for a step s of the parameters, so
that a fit gains gᵀM⁻¹g and M⁻¹ is the covariance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

Name = tuple[int, str, int]
"""The mode, the kind of parameter ("decay", "frequency", "gain", "initial", "shape", "known"), and its number."""

Group = tuple[int, str, float]
"""The mode, "seen" or "driven", and the harmonic."""


@dataclass(frozen=True, kw_only=True)
class Mode:
    r"""One mode, the same for all four: a likelihood ignores what it eliminates.

    .. math:: \dot z = \lambda z + \sum_l g_l e^{il\omega t} u, \qquad y = \Re \sum_m s_m e^{im\omega t} z

    Arrays are seen (turns,), shape (channels, turns), driven (reach,), gains (inputs, reach), initial (records,).
    """

    exponent: complex
    seen: NDArray[np.float64]
    shape: NDArray[np.complex128]
    driven: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    gains: NDArray[np.complex128] = field(default_factory=lambda: np.zeros((0, 0), complex))
    initial: NDArray[np.complex128] = field(default_factory=lambda: np.zeros(0, complex))
    real: bool = False

    def renamed(self, by: int, omega: float, starts: Sequence[float], delay: float) -> Mode:
        """The same mode at λ + i·by·ω; a real multiplier has no other name. A drive may act `delay` later."""
        if self.real:
            return self
        return replace(
            self,
            exponent=self.exponent + 1j * by * omega,
            seen=self.seen - by,
            driven=self.driven + by,
            gains=self.gains * np.exp(1j * by * omega * delay),
            initial=self.initial * np.exp(1j * by * omega * np.array(starts)[: len(self.initial)]),
        )

    def conjugated(self) -> Mode:
        """The same pair by its other exponent."""
        if self.real:
            return self
        return replace(
            self,
            exponent=self.exponent.conjugate(),
            seen=-self.seen[::-1],
            shape=self.shape[:, ::-1].conj(),
            driven=-self.driven[::-1],
            gains=self.gains[:, ::-1].conj(),
            initial=self.initial.conj(),
        )

    def rotated(self, later: float, omega: float) -> Mode:
        """The same mode with time counted from `later` seconds earlier."""
        shape, gains = (np.exp(-1j * band * omega * later) for band in (self.seen, self.driven))
        return replace(self, shape=self.shape * shape, gains=self.gains * gains)

    def scaled(self, outputs: NDArray, drives: NDArray) -> Mode:
        """The same mode with outputs and what drives it in other units."""
        return replace(self, shape=self.shape * outputs[:, None], gains=self.gains / drives[: len(self.gains), None])

    def without(self, side: str, harmonic: float) -> Mode:
        """The mode less one harmonic of its shape ("seen") or of its gains ("driven")."""
        names = ("seen", "shape") if side == "seen" else ("driven", "gains")
        band, values = (getattr(self, name) for name in names)
        kept = band != harmonic
        return replace(self, **{names[0]: band[kept], names[1]: values[:, kept]})

    def having(self, side: str, harmonic: float) -> Mode:
        """The mode with one harmonic more, of no amplitude yet."""
        names = ("seen", "shape") if side == "seen" else ("driven", "gains")
        band, values = (getattr(self, name) for name in names)
        place = int(np.searchsorted(band, harmonic))
        return replace(
            self, **{names[0]: np.insert(band, place, harmonic), names[1]: np.insert(values, place, 0.0, axis=1)}
        )


@dataclass(frozen=True)
class Normal:
    """Gradient and Gauss-Newton matrix of the parameters named, half the slope and half the curvature of L."""

    names: tuple[Name, ...]
    gradient: NDArray[np.float64]
    matrix: NDArray[np.float64]

    def step(self, fixed: Sequence[int] = ()) -> NDArray[np.float64]:
        """The Gauss-Newton step, some parameters held."""
        free = np.setdiff1d(np.arange(len(self.gradient)), fixed)
        found, scale = np.zeros(len(self.gradient)), np.sqrt(np.diag(self.matrix)[free])
        scaled = self.matrix[np.ix_(free, free)] / np.outer(scale, scale)
        found[free] = np.linalg.lstsq(scaled, self.gradient[free] / scale, rcond=1e-11)[0] / scale
        return found


class Point(Protocol):
    """What a record says of given modes."""

    @property
    def modes(self) -> tuple[Mode, ...]:
        """The modes, with what was eliminated put in."""

    @property
    def log_likelihood(self) -> float:
        """Twice the logarithm of the likelihood up to a constant: more is better."""

    @property
    def n_parameters(self) -> int:
        """Real numbers that the fit chooses."""

    @property
    def residual(self) -> NDArray[np.float64]:
        """The residual over its deviation (channels, samples), NaN where nothing was measured."""

    @property
    def covariance(self) -> NDArray[np.float64]:
        """Covariance of the parameters of `normal`, as the library has it."""

    def normal(self) -> Normal:
        """Gradient and Gauss-Newton matrix."""

    def moved(self, step: NDArray[np.float64]) -> Self | None:
        """The point a step away; None where it diverges."""

    def with_modes(self, modes: Sequence[Mode]) -> Self:
        """The point of the same record at other modes."""

    def refit(self) -> Self:
        """The maximum of the likelihood near."""

    def score(self, group: Group) -> float:
        """The gain to first order by one harmonic more."""

    def wald(self, group: Group) -> float:
        """The loss to first order by one harmonic less."""


@dataclass(frozen=True, kw_only=True)
class Data:
    """Records in time: outputs (channels, samples) and inputs (inputs, samples) of each, and its first time [s]."""

    values: tuple[NDArray[np.float64], ...]
    inputs: tuple[NDArray[np.float64], ...]
    starts: tuple[float, ...]
    step: float
    omega: float
    noise: NDArray[np.float64]

    def scaled(self, outputs: NDArray, inputs: NDArray) -> Data:
        """In other units."""
        return replace(
            self,
            values=tuple(outputs[:, None] * own for own in self.values),
            inputs=tuple(inputs[:, None] * own for own in self.inputs),
            noise=self.noise * outputs,
        )

    def ordered(self, channels: Sequence[int]) -> Data:
        """With the channels in another order."""
        own = np.array(channels)
        return replace(self, values=tuple(values[own] for values in self.values), noise=self.noise[own])

    def later(self, seconds: float) -> Data:
        """With time zero so much earlier."""
        return replace(self, starts=tuple(start + seconds for start in self.starts))

    def split(self, sample: int) -> Data:
        """The first record as two, the second beginning at a sample."""
        cut = [
            tuple(own[0][:, part] for part in (slice(sample), slice(sample, None)))
            for own in (self.values, self.inputs)
        ]
        starts = (self.starts[0], self.starts[0] + sample * self.step, *self.starts[1:])
        return replace(self, values=cut[0] + self.values[1:], inputs=cut[1] + self.inputs[1:], starts=starts)

    def with_silence(self) -> Data:
        """With one input more that does nothing."""
        return replace(self, inputs=tuple(np.vstack([own, np.zeros(own.shape[1])]) for own in self.inputs))
