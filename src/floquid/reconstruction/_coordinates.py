"""Coordinates of the states: what each channel counts in each state, as a function of the rate s = λ + imω."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Complexes, Floats
from floquid._checks import input_error
from floquid.core import Channel, PeriodicModel
from floquid.errors import IdentificationError

OF = "reconstruct"
DERIVATIVES = {"displacement": 0, "velocity": 1, "acceleration": 2}  # derivative of a displacement that a quantity is


@dataclass(frozen=True, slots=True)
class Part:
    """A channel as a part of a state: gain · sᵖ e^{sτ} times its coefficient."""

    channel: int
    gain: float = 1.0
    power: int = 0
    delay: float = 0.0  # τ: how much later the channel is seen [s]

    def weight(self, rates: NDArray[Any]) -> NDArray[Any]:
        """The factor at each rate."""
        return self.gain * rates**self.power * np.exp(rates * self.delay)

    def slope(self, rates: NDArray[Any]) -> NDArray[Any]:
        """Slope of the gain by the rate."""
        by_power = self.power * rates ** (self.power - 1) if self.power else np.zeros_like(rates)
        return self.gain * np.exp(rates * self.delay) * (by_power + self.delay * rates**self.power)


@dataclass(frozen=True, slots=True)
class State:
    """One state: the sum of its parts, or their average where each is an estimate of the same motion.

    An average is weighted by the noise of its parts, that of a channel times |s|ᵖ: at each rate the quantity counts
    most that says most there.
    """

    name: str
    parts: tuple[Part, ...]
    noise: tuple[float, ...] = ()  # the deviation of the channel of each part of an average; empty for a sum

    def derivative(self) -> State:
        """The rate of change of this state."""
        parts = tuple(Part(part.channel, part.gain, part.power + 1, part.delay) for part in self.parts)
        return State(f"d/dt {self.name}", parts, self.noise)

    def weights(self, rates: Complexes, count: int) -> tuple[NDArray, NDArray]:
        """Factors of `count` channels (..., channels), and their slopes by the rate."""
        weights, slopes = np.zeros((2, *rates.shape, count), complex)
        own = [part.weight(rates) for part in self.parts]
        if len(self.noise) < 2:
            for part, weight in zip(self.parts, own, strict=True):
                weights[..., part.channel] += weight
                slopes[..., part.channel] += part.slope(rates)
            return weights, slopes
        precision = np.array([1.0 / (np.abs(weight) * std) ** 2 for weight, std in zip(own, self.noise, strict=True)])
        shares = precision / precision.sum(axis=0)
        relative = np.zeros(rates.shape, complex)
        for part, weight, share in zip(self.parts, own, shares, strict=True):
            weights[..., part.channel] += share * weight
            # The parts agree on the state x, so that δx = Σ share (w'/w) x δs, whatever the shares do.
            relative += share * part.slope(rates) / weight
        return weights, relative[..., None] * weights


@dataclass(frozen=True, slots=True)
class Coordinates:
    """The states, in order."""

    states: tuple[State, ...]
    n_channels: int
    form: str  # "second-order", "first-order" or "delayed"
    words: str  # the states in words
    mixing: Floats | None = None
    """Weights of the displacements in each channel, of states from all channels (channels, displacements)."""
    chosen: tuple[int, ...] = ()  # the channels that are the displacements themselves then, up to noise
    loose: Complexes | None = None
    """Slopes of E by the coefficients of the model (displacements, displacements, modes, channels, hits, harmonics): by
    the errors of `mixing` the displacements are (1 + E) times those of the chosen channels."""

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the states."""
        return tuple(state.name for state in self.states)

    @property
    def said(self) -> str:
        """The names of the states that are no derivatives of others."""
        half = len(self.states) // 2 if self.form == "second-order" else len(self.states)
        return ", ".join(self.names[:half])

    def weights(self, rates: Complexes) -> tuple[Complexes, Complexes]:
        """Weights of the channels (modes, harmonics, states, channels), and their slopes by the rate."""
        both = [state.weights(rates, self.n_channels) for state in self.states]
        return np.stack([one for one, _ in both], axis=-2), np.stack([other for _, other in both], axis=-2)


def derivative_of(channel: Channel, of: str = OF) -> int:
    """The derivative of a displacement that a channel measures."""
    if channel.quantity not in DERIVATIVES:
        must = "name channels of displacement, velocity or acceleration"
        got = f"channel {channel.name!r} measures {channel.quantity} [{channel.unit}]"
        raise input_error("states", of, must, got, "Choose motions, or give the channel its quantity.")
    return DERIVATIVES[str(channel.quantity)]


def refuse_rest(model: PeriodicModel, states: Sequence[State]) -> None:
    """Refuse to divide by a rate of zero."""
    rates = model.exponents[:, None] + 1j * model.harmonics * model.fundamental
    if any(part.power < 0 for state in states for part in state.parts) and (rates == 0).any():
        raise IdentificationError(
            "A mode has a harmonic at zero frequency and no decay: its displacement is not in the record."
        )


def channel_noise(model: PeriodicModel) -> Floats:
    """The noise of each channel, or its size where no noise is known (channels,)."""
    reference = model.coefficients if model.coefficient_std is None else model.coefficient_std
    size = np.sqrt(np.max(np.abs(reference) ** 2, axis=(0, 2, 3)))
    return np.where(size > 0, size, 1.0)
