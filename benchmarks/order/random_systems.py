"""Linear time-periodic systems with known truth, what they may be drawn from, and their records."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from benchmarks.order.findable import Findable, findable
from numpy.typing import NDArray

from floquid._checks import Rebuilt, frozen_array, input_error, integer
from floquid.core import ConstantPeriod, Cycles, PeriodicModel, Record
from floquid.lti import TimeResponses

CLASSES = ("close pair", "weak mode", "real exponent", "half-per-rev", "coloured noise", "several hits", "no noise")
"""Kinds of difficulty in a random system, several at once."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Ranges:
    """Ranges that `random_system` draws from: (least, most) of each quantity, and the share of each class.

    Parameters
    ----------
    modes
        The number of modes; a conjugate pair is one, and so is a real multiplier. Uniform in the logarithm.
    outputs
        Channels times phases, at most as many as asked for. Uniform in the logarithm.
    channels
        The number of channels. Uniform in the logarithm.
    cycles
        The periods of a record, never fewer than four for each pole. Uniform in the logarithm.
    hits
        The number of records of the systems in the class of several hits.
    decay
        The logarithmic decrement a period, -Re λ T. Uniform in the logarithm.
    strength
        The size of a mode that is not weak. Uniform in the logarithm.
    noise
        The deviation of the noise as a share of the largest free response in the channel. Uniform in the logarithm.
    separation
        The distance of a close pair in half-power widths (twice the decay). Uniform in the logarithm.
    width_ratio
        The ratio of the widths of a close pair.
    weakness
        The size of a weak mode as a share of what it would be otherwise. Uniform in the logarithm.
    correlation
        The time in which the correlation of coloured noise falls to 1/e, in periods. Uniform in the logarithm.
    pairs, weak, real, half, coloured, several, exact
        The share of systems with a close pair, one or two weak modes, a real exponent, a real negative multiplier
        (half-per-rev), coloured noise, several hits, and no noise but rounding: in the order of `CLASSES`.
    """

    modes: tuple[int, int] = (1, 20)
    outputs: tuple[int, int] = (1, 400)
    channels: tuple[int, int] = (1, 8)
    cycles: tuple[int, int] = (30, 1000)
    hits: tuple[int, int] = (2, 2)
    decay: tuple[float, float] = (0.005, 0.3)
    strength: tuple[float, float] = (0.3, 1.0)
    noise: tuple[float, float] = (0.001, 0.2)
    separation: tuple[float, float] = (0.1, 4.0)
    width_ratio: tuple[float, float] = (0.8, 1.25)
    weakness: tuple[float, float] = (0.003, 0.1)
    correlation: tuple[float, float] = (0.1, 3.0)
    pairs: float = 0.3
    weak: float = 0.3
    real: float = 0.2
    half: float = 0.2
    coloured: float = 0.15
    several: float = 0.3
    exact: float = 0.05

    def __post_init__(self) -> None:
        for name in ("modes", "outputs", "channels", "cycles", "hits"):
            for value in self._both(name):
                integer(value, name, "Ranges", at_least=1)
        for name in ("decay", "strength", "noise", "separation", "width_ratio", "weakness", "correlation"):
            if not self._both(name)[0] > 0.0:
                raise input_error(name, "Ranges", "be positive", f"is {getattr(self, name)!r}")
        for name in ("pairs", "weak", "real", "half", "coloured", "several", "exact"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise input_error(name, "Ranges", "lie between 0 and 1", f"is {getattr(self, name)!r}")

    def _both(self, name: str) -> tuple[float, float]:
        pair = getattr(self, name)
        if not isinstance(pair, tuple) or len(pair) != 2 or not pair[0] <= pair[1]:
            raise input_error(name, "Ranges", "be (least, most)", f"is {pair!r}", "Give a value twice to fix it.")
        return pair


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RandomSystem(Rebuilt):
    """A known system, the records to be had of it, and their noise.

    Parameters
    ----------
    truth
        The system: exponents, and Fourier coefficients of each hit.
    n_phases
        Samples a period.
    lengths
        The periods of each hit (hits,).
    noise
        The standard deviation of the noise (channels, hits) [units of the channels]; of rounding where there is none.
    correlation
        Of successive samples of the noise, a first-order autoregression within each channel; 0 for white noise.
    classes
        What is special about it, names out of `CLASSES`; empty for a plain system.
    seed
        The seed that it was drawn from, and of its noise.
    """

    truth: PeriodicModel
    n_phases: int
    lengths: NDArray[np.int64]
    noise: NDArray[np.float64]
    correlation: float = 0.0
    classes: tuple[str, ...] = field(default=())
    seed: int = 0

    def __post_init__(self) -> None:
        of, put = "RandomSystem", object.__setattr__
        shape = (len(self.truth.channels), self.truth.n_hits)
        put(self, "lengths", frozen_array(self.lengths, "lengths", of, axes=shape[1:], dtype=np.int64))
        put(self, "noise", frozen_array(self.noise, "noise", of, axes=shape))

    @property
    def multipliers(self) -> NDArray[np.complex128]:
        """The multipliers (modes,), those of real kinds exactly real."""
        mu = self.truth.multipliers
        return np.where(np.abs(mu.imag) < 1e-9 * np.abs(mu), mu.real, mu)

    @property
    def residues(self) -> NDArray[np.complex128]:
        """The residues of the lifted responses (modes, channels · phases, hits)."""
        return _residues(self.truth.exponents, self.truth.coefficients, self)

    def clean(self) -> list[NDArray[np.float64]]:
        """The responses without noise, one array (channels, samples) a hit."""
        residues = self.residues
        out = []
        for hit, length in enumerate(self.lengths):
            powers = np.exp(np.multiply.outer(self.truth.exponents * self.truth.period, np.arange(length)))
            values = (residues[:, :, hit].T @ powers).real.reshape(-1, self.n_phases, length)
            out.append(values.transpose(0, 2, 1).reshape(len(values), -1))
        return out

    def records(self, draw: int = 0) -> list[Record]:
        """One record a hit, with the noise of this `draw`."""
        generator = np.random.default_rng([self.seed, draw, 1])
        rate = self.n_phases / self.truth.period
        made = []
        for hit, values in enumerate(self.clean()):
            noise = _coloured(generator.standard_normal(values.shape), self.correlation)
            made.append(
                Record(
                    values=values + self.noise[:, hit, None] * noise,
                    sample_rate=rate,
                    channels=self.truth.channels,
                    clock=ConstantPeriod(period=self.truth.period),
                )
            )
        return made

    def cycles(self, draw: int = 0) -> tuple[Cycles, ...]:
        """The same samples, cut into periods, with the noise of this `draw`."""
        from floquid.sync import segment

        return segment(self.records(draw))

    def responses(self, draw: int = 0) -> TimeResponses:
        """The same samples as lifted responses (channels · phases, hits, cycles) of known noise of this `draw`."""
        values = np.zeros((self.noise.shape[0] * self.n_phases, len(self.lengths), int(self.lengths.max())))
        for hit, cycles in enumerate(self.cycles(draw)):
            values[:, hit, : cycles.n_cycles] = cycles.values.reshape(-1, cycles.n_cycles)
        noise = np.repeat(self.noise, self.n_phases, axis=0)
        return TimeResponses(values=values, dt=self.truth.period, noise=noise, lengths=self.lengths)

    def findable(self) -> tuple[Findable, ...]:
        """The information on each mode in the responses: for white noise, and for coloured noise in its own colour too.

        Noise that is an autoregression is white after the filter that undoes it, and the filter leaves exponents as
        they are: it multiplies each harmonic by 1 - a e^{-(λ + imω) Δt}.
        """
        period, spread = self.truth.period, np.repeat(self.noise, self.n_phases, axis=0)
        found = [findable(self.multipliers, self.residues, spread, self.lengths, period)]
        if self.correlation:
            rate = self.truth.exponents[:, None] + 1j * self.truth.fundamental * self.truth.harmonics
            gain = 1.0 - self.correlation * np.exp(-rate * period / self.n_phases)
            filtered = _residues(self.truth.exponents, self.truth.coefficients * gain[:, None, None, :], self)
            spread = spread * np.sqrt(1.0 - self.correlation**2)
            found.append(findable(self.multipliers, filtered, spread, self.lengths, period))
        return tuple(found)


def _residues(
    exponents: NDArray[np.complex128], coefficients: NDArray[np.complex128], system: RandomSystem
) -> NDArray[np.complex128]:
    """The residues of lifted responses (modes, channels · phases, hits)."""
    truth = system.truth
    times = np.arange(system.n_phases) / system.n_phases * truth.period
    rate = exponents[:, None] + 1j * truth.fundamental * truth.harmonics
    shapes = np.einsum("rchm,rmp->rcph", coefficients, np.exp(rate[:, :, None] * times))
    return shapes.reshape(len(exponents), -1, coefficients.shape[2])


def _coloured(white: NDArray[np.float64], correlation: float) -> NDArray[np.float64]:
    """A stationary first-order autoregression of unit variance from white noise (channels, samples)."""
    if not correlation:
        return white
    from scipy.signal import lfilter

    scale = np.sqrt(1.0 - correlation**2)
    first = correlation / scale * white[:, :1]
    out = lfilter([scale], [1.0, -correlation], white, axis=1, zi=scale * first)[0]
    return np.asarray(out, dtype=np.float64)
