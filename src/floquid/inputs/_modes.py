"""Modes with the way that inputs reach them: pairs of conjugates, real multipliers, and blocks of two real states."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import factorial

import numpy as np
from numpy.typing import NDArray

from floquid._checks import Rebuilt
from floquid.inputs._block import product
from floquid.inputs._samples import Hold

SERIES = 1e-4
"""Below this a quotient of differences is taken from its series."""

LONG_SERIES = 0.5
"""Below this that of a linear input is, by as many terms as double precision needs: differences cancel twice."""

LINEAR = np.array([(n + 1.0) / factorial(n + 2) for n in reversed(range(14))])
"""The coefficients of that series, the highest power first."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class InputMode(Rebuilt):
    r"""One mode, without its linear parameters: a pair of conjugates, a real multiplier, or a block of two states.

    .. math:: \dot z = \lambda z + \sum_{i,l} b_{i,l}\, e^{i l \omega t} u_i, \qquad
              y = 2 \Re \sum_m c_m e^{i m \omega t} z

    Of a real multiplier λ is real, z and the input are real parts, and l and m count from a half if it is negative.
    A block has two real states, :math:`\dot z = (\sigma + j) z + \ldots` with :math:`j^2 = q`, and b and c of both:
    the pair :math:`\sigma \pm i \sqrt{-q}` about the axis, or two real multipliers :math:`\sigma \pm \sqrt q`.

    Parameters
    ----------
    exponent
        λ [1/s]; of a block σ.
    real
        True for real states: a real multiplier, or a block.
    reach
        The harmonics l, ascending (reach,); of real states from 0 or ½ on.
    gains
        b (inputs, reach); of a block those of the second state follow (2 inputs, reach).
    turns
        The harmonics m, ascending (turns,); of real states from 0 or ½ on.
    initial
        z at the first sample of each record (records,); at the last one of a mode that grows beyond all bounds. Of a
        block those of the second state follow (2 records,).
    sizes
        The state that a gain of 1 makes of each input, about (inputs,): b counts by it beside z at the begin.
    square
        q of a block [1/s²]; None of another mode.
    """

    exponent: complex
    real: bool
    reach: NDArray[np.float64]
    gains: NDArray[np.complex128]
    turns: NDArray[np.float64]
    initial: NDArray[np.complex128]
    sizes: NDArray[np.float64]
    square: float | None = None

    @property
    def states(self) -> int:
        """The number of states, that of a pair counted once."""
        return 1 if self.square is None else 2

    def exponents(self, omega: float) -> list[complex]:
        """The exponents, of a pair that of the state, about the axis that they are counted from [1/s]."""
        if self.square is None:
            return [self.exponent + 1j * self.lowest * omega]
        root, mean = complex(np.sqrt(complex(self.square))), self.exponent + 1j * self.lowest * omega
        return [mean + root, mean - root]

    @property
    def growth(self) -> float:
        """The real part of the exponent, of the larger one of a block [1/s]."""
        return self.exponent.real + float(np.sqrt(max(self.square or 0.0, 0.0)))

    @property
    def mixed(self) -> NDArray[np.float64]:
        """The covariance of both states of a block, up to a factor, by white noise on the first one (2, 2)."""
        assert self.square is not None
        mean = self.exponent.real
        # Of a growing one, which has none, something of the same size.
        return np.array([[2.0 * mean**2 + abs(self.square), -mean], [-mean, 1.0]])

    @property
    def strengths(self) -> NDArray[np.float64]:
        """Factors by which b and z at the begin are compared, whatever the units of the inputs (parts,)."""
        sizes = np.repeat(np.tile(self.sizes, self.states), len(self.reach))
        return np.concatenate([sizes, np.ones(len(self.initial))])

    @property
    def held(self) -> NDArray[np.int64]:
        """The parameters that fix the scale of the state (held,): its largest part, of a block both numbers of it."""
        size, starts = self.gains.size, len(self.initial)
        flat = np.concatenate([self.gains.ravel(), self.initial]) * self.strengths
        if not self.real:
            fixed = 1 + int(np.argmax(np.abs(flat)))
            return np.array([fixed, fixed + 1 + size + starts])
        turning = np.tile(self.reach > 0.0, len(self.gains))
        parts = np.concatenate([flat.real[:size], flat.imag[:size] * turning, flat.real[size:]])
        if self.square is None:
            return np.array([1 + int(np.argmax(np.abs(parts)))])
        first = np.concatenate([np.arange(size // 2), size + np.arange(size // 2), 2 * size + np.arange(starts // 2)])
        second = first + np.repeat([size // 2, starts // 2], [size, starts // 2])
        # An element of which a² - q b² is zero cannot be divided by: it drives one of two multipliers alone.
        largest = int(np.argmax(np.abs(parts[first] ** 2 - self.square * parts[second] ** 2)))
        return 1 + np.array([first[largest], second[largest]])

    @property
    def free(self) -> NDArray[np.bool_]:
        """Mask of the parameters that are free, the scale of the state fixed (parameters,).

        Parameters are the real parts of λ, b and z at the begin, then the imaginary ones; of a real multiplier those
        of λ and z have none. A block has σ, the real and the imaginary parts of b, z at the begin, and q.
        """
        size, starts = self.gains.size, len(self.initial)
        if not self.real:
            mask = np.ones(2 * (1 + size + starts), bool)
        else:
            turning = np.tile(self.reach > 0.0, len(self.gains))
            last = np.ones(starts + self.states - 1, bool)
            mask = np.concatenate([[True], np.ones(size, bool), turning, last])
        mask[self.held] = False
        return mask

    @property
    def lowest(self) -> float:
        """The least harmonic that there is: zero, or ½ of a negative multiplier."""
        return 0.5 if self.real and self.reach[0] else 0.0

    def moved(self, step: NDArray[np.float64]) -> InputMode:
        """With the parameters moved by a step (parameters,)."""
        size, square = self.gains.size, self.square
        if square is not None:
            square, step = square + float(step[-1]), step[:-1]
        if self.real:
            step = np.concatenate(
                [step[: 1 + size], step[1 + 2 * size :], [0.0], step[1 + size : 1 + 2 * size], 0.0 * self.initial.real]
            )
        both = step[: len(step) // 2] + 1j * step[len(step) // 2 :]
        return replace(
            self,
            exponent=self.exponent + complex(both[0]),
            gains=self.gains + both[1 : 1 + size].reshape(self.gains.shape),
            initial=self.initial + both[1 + size :],
            square=square,
        )

    def distance(self, step: NDArray[np.float64], least: float) -> float:
        """How far a step (parameters,) moves the exponents [1/s]; of a block at q = 0 as at √|q| = `least`."""
        if self.square is None:
            return float(abs(step[0] + (0j if self.real else 1j * step[len(step) // 2])))
        return float(abs(step[0]) + abs(step[-1]) / (2.0 * max(np.sqrt(abs(self.square)), least)))

    def scaled(self) -> InputMode:
        """With the part of b and z that is largest made 1."""
        flat = np.concatenate([self.gains.ravel(), self.initial])
        if self.square is not None:
            size = self.gains.size
            parts = np.concatenate([flat.real[:size], flat.imag[:size], flat.real[size:]])
            a, b = parts[self.held - 1].tolist()
            norm = a**2 - self.square * b**2
            return self.multiplied((a / norm, -b / norm)) if norm else self
        largest = flat[np.argmax(np.abs(flat) * self.strengths)]
        by = abs(largest) if self.real else largest
        return replace(self, gains=self.gains / by, initial=self.initial / by) if by else self

    def multiplied(self, by: tuple[float, float]) -> InputMode:
        """A block with its states multiplied by an element a + b j: the same block."""
        assert self.square is not None
        inputs, records = len(self.gains) // 2, len(self.initial) // 2
        gains = product(by, (self.gains[:inputs], self.gains[inputs:]), self.square)
        initial = product(by, (self.initial[:records], self.initial[records:]), self.square)
        return replace(self, gains=np.concatenate(gains), initial=np.concatenate(initial))


def input_gain(exponent: complex, turn: float, omega: float, step: float, hold: Hold) -> tuple[complex, complex]:
    r"""The share of e^{ilωt}u at a sample, and at the next one, in the state a step later.

    .. math:: \int_0^h e^{\lambda (h - \tau)} e^{i l \omega \tau} p(\tau)\, d\tau

    p is 1 of an input that is held, 1 - τ/h and τ/h of one that is linear between its samples, and an impulse of one
    that acts at the samples alone. The second share belongs to the input at the next sample, e^{ilω(t + h)} taken off.
    """
    if hold == "none":
        return np.exp(exponent * step) * step, 0j
    rate = (1j * turn * omega - exponent) * step
    decay = np.exp(exponent * step)
    whole = 1.0 + rate / 2.0 + rate**2 / 6.0 + rate**3 / 24.0 if abs(rate) < SERIES else np.expm1(rate) / rate
    if hold == "zero":
        return step * decay * whole, 0j
    if abs(rate) < LONG_SERIES:
        later = complex(np.polyval(LINEAR, rate))
    else:
        later = (np.exp(rate) * (rate - 1.0) + 1.0) / rate**2
    return step * decay * (whole - later), step * decay * later * np.exp(-1j * turn * omega * step)
