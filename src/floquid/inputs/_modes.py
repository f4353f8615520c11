r"""Modes with the way that inputs reach them, and their states driven by the inputs measured.

Two real states are one number a + b j with j² = q, whatever the sign of q:

.. math:: \dot z = (\sigma + j) z, \qquad f(\sigma + j) = \tfrac12 (f_+ + f_-) + \frac{f_+ - f_-}{2 \sqrt q}\, j,
          \qquad f_\pm = f(\sigma \pm \sqrt q)

Both parts are entire in q: a pair of conjugates, a defective multiplier and two real multipliers are one formula.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import factorial
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from floquid._arrays import Complexes, Floats, Mask
from floquid._checks import Rebuilt
from floquid.core import Hold
from floquid.fit import ROUNDING
from floquid.inputs._samples import Samples
from floquid.search import longer

LEAST = ROUNDING ** (1.0 / 3.0)
"""q over the squared decay below which parts are interpolated in q: a difference loses ROUNDING/q, interpolation q²."""

Function: TypeAlias = Callable[[complex], NDArray]


def parts_of(function: Function, square: float, decay: float) -> NDArray:
    """Parts of a function of j (2, …) from its values at ±√q; it varies on a `decay` [1/s]."""
    return _through_zero(lambda own: _parts(function, own), square, decay)


def slopes_along_square(function: Function, slope: Function, square: float, decay: float) -> NDArray:
    r"""Derivatives of both parts by q (2, …), by the slope of the function along j.

    .. math:: \frac{\partial f_1}{\partial q} = \tfrac12 f'_2, \qquad
              \frac{\partial f_2}{\partial q} = \frac{f'_1 - f_2}{2 q}
    """

    def slopes(own: float) -> NDArray:
        even, odd = _parts(slope, own)
        return 0.5 * np.stack([odd, (even - _parts(function, own)[1]) / own])

    return _through_zero(slopes, square, decay)


def by_root(values: NDArray, square: float) -> NDArray:
    """The product with j of both parts (2, …)."""
    return np.stack([square * values[1], values[0]])


def _parts(function: Function, square: float) -> NDArray:
    root = complex(np.sqrt(complex(square)))
    up, down = function(root), function(-root)
    return 0.5 * np.stack([up + down, (up - down) / root])


def _through_zero(of: Callable[[float], NDArray], square: float, decay: float) -> NDArray:
    """A function of q, near zero from its values on either side."""
    least = LEAST * decay**2
    if abs(square) >= least:
        return of(square)
    share = 0.5 + 0.5 * square / least
    return share * of(least) + (1.0 - share) * of(-least)


LINEAR = np.array([(n + 1.0) / factorial(n + 2) for n in reversed(range(14))])
"""The series of a linear input, the highest power first: to double precision below ½, where differences cancel."""

RUNAWAY = 3.0
"""The growth of a mode over a record [nepers] beyond which it is followed backwards, from the end of the record.

Forwards the errors of inputs and innovations grow with it: a mode that a feedback holds would be no candidate.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class InputMode(Rebuilt):
    r"""One mode without its linear parameters: a pair of conjugates, a real multiplier, or a block of two states.

    .. math:: \dot z = \lambda z + \sum_{i,l} b_{i,l}\, e^{i l \omega t} u_i, \qquad
              y = 2 \Re \sum_m c_m e^{i m \omega t} z

    Of a real multiplier λ is real, z and the input are real parts, and l and m count from a half if it is negative.
    A block has two real states, :math:`\dot z = (\sigma + j) z + \ldots` with :math:`j^2 = q`, and b and c of both:
    the pair :math:`\sigma \pm i \sqrt{-q}` about the axis, or two real multipliers :math:`\sigma \pm \sqrt q`.
    """

    exponent: complex  # λ [1/s]; of a block σ
    real: bool  # True for real states: a real multiplier, or a block
    reach: Floats  # The harmonics l, ascending (reach,); of real states from 0 or ½ on
    gains: Complexes  # b (inputs, reach); of a block those of the second state follow (2 inputs, reach)
    turns: Floats  # The harmonics m, ascending (turns,); of real states from 0 or ½ on
    # z at the first sample of each record (records,), at the last one of a mode that is followed `backwards`. Of a
    # block those of the second state follow (2 records,).
    initial: Complexes
    # The state that a gain of 1 makes of each input, about (inputs,): b counts by it beside z at the start
    sizes: Floats
    square: float | None = None  # q of a block [1/s²]; None of another mode
    # True of a mode that grows, whose state is followed from the end of each record: a fit keeps to its way
    backwards: bool = False

    @property
    def states(self) -> int:
        """The number of states, that of a pair counted once."""
        return 1 if self.square is None else 2

    @property
    def strengths(self) -> Floats:
        """Factors by which b and z at the start are compared, whatever the units of the inputs (parts,)."""
        sizes = np.repeat(np.tile(self.sizes, self.states), len(self.reach))
        return np.concatenate([sizes, np.ones(len(self.initial))])

    @property
    def free(self) -> Mask:
        """Mask of the parameters that are free, the scale of the state fixed by its largest part (parameters,)."""
        # Parameters are the real parts of λ, b and z at the start, then the imaginary ones; of a real multiplier those
        # of λ and z have none. A block has σ, the real and the imaginary parts of b, z at the start, and q.
        size, starts = self.gains.size, len(self.initial)
        flat = np.concatenate([self.gains.ravel(), self.initial])
        if not self.real:
            fixed = 1 + int(np.argmax(np.abs(flat) * self.strengths))
            mask = np.ones(1 + size + starts, bool)
            mask[fixed] = False
            return np.tile(mask, 2)
        elements, largest = self._elements
        mask, each = np.ones(elements.shape, bool), size // self.states
        mask[:, each : 2 * each] = self._turning
        mask[:, largest] = False
        parts = [own.ravel() for own in np.split(mask, [each, 2 * each], axis=1)]
        return np.concatenate([[True], *parts, np.ones(self.states - 1, bool)])

    @property
    def _elements(self) -> tuple[Floats, int]:
        """Numbers a, of a block a and b, of Re b, Im b and z at the start (states, elements), and which is largest."""
        parts = (self.gains.real, self.gains.imag, self.initial.real)
        elements = np.concatenate([own.reshape(self.states, -1) for own in parts], axis=1)
        first = np.split(self.strengths, [self.gains.size])
        sizes, ones = (own[: len(own) // self.states] for own in first)
        weights = np.concatenate([sizes, sizes * self._turning, ones])
        # If a² - q b² is zero, it drives one of two multipliers alone: a block cannot be divided by it.
        squares = elements[0] ** 2 - (self.square or 0.0) * elements[-1] ** 2
        return elements, int(np.argmax(np.abs(squares) * weights**2))

    @property
    def _turning(self) -> Mask:
        """Mask of b of real states with an imaginary part, of each state (inputs · reach,)."""
        return np.tile(self.reach > 0.0, len(self.gains) // self.states)

    @property
    def axis(self) -> float:
        """The least harmonic that there is: zero, or ½ of a negative multiplier."""
        return 0.5 if self.real and self.reach[0] else 0.0

    def moved(self, step: Floats) -> InputMode:
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

    def distance(self, step: Floats, least: float) -> float:
        """Distance that a step (parameters,) moves the exponents [1/s]; of a block at q = 0 as at √|q| = `least`."""
        if self.square is None:
            return float(abs(step[0] + (0j if self.real else 1j * step[len(step) // 2])))
        return float(abs(step[0]) + abs(step[-1]) / (2.0 * max(np.sqrt(abs(self.square)), least)))

    def at(self, root: complex) -> InputMode:
        """The mode of one exponent, as it drives a complex state, of a block where j is `root`."""
        gains, initial = (first + root * second for first, second in map(halves, (self.gains, self.initial)))
        exponent = self.exponent.real + root
        return replace(self, exponent=exponent, real=False, gains=gains, initial=initial, square=None)

    def with_band(self, band: str, harmonics: ArrayLike) -> InputMode:
        """With other harmonics of the outputs ("turns") or of the inputs ("reach"), new ones of no gain yet."""
        wanted = np.asarray(harmonics, float)
        if band == "turns":
            return replace(self, turns=wanted)
        gains = np.zeros((len(self.gains), len(wanted)), complex)
        gains[:, np.isin(wanted, self.reach)] = self.gains[:, np.isin(self.reach, wanted)]
        return replace(self, reach=wanted, gains=gains)

    def padded(self, band: str, by: float, highest: float) -> InputMode:
        """With some harmonics more at each end of a band."""
        return self.with_band(band, longer(getattr(self, band), by, highest, self.real))

    def turned(self, by: float, omega: float, begins: Floats) -> InputMode:
        """A pair moved to another branch, λ + i·by·ω; its states are at `begins` [s]."""
        return replace(
            self,
            exponent=self.exponent + 1j * by * omega,
            turns=self.turns - by,
            reach=self.reach + by,
            initial=self.initial * np.exp(1j * by * omega * begins),
        )

    def conjugated(self) -> InputMode:
        """Name a pair by the conjugate of its exponent."""
        return replace(
            self,
            exponent=self.exponent.conjugate(),
            turns=-self.turns[::-1],
            reach=-self.reach[::-1],
            gains=self.gains[:, ::-1].conj(),
            initial=self.initial.conj(),
        )

    def scaled(self) -> InputMode:
        """With the part of b and z that is largest made 1."""
        if self.square is not None:
            elements, largest = self._elements
            return self._divided(*elements[:, largest].tolist())
        flat = np.concatenate([self.gains.ravel(), self.initial])
        largest = flat[np.argmax(np.abs(flat) * self.strengths)]
        by = abs(largest) if self.real else largest
        return replace(self, gains=self.gains / by, initial=self.initial / by) if by else self

    def _divided(self, a: float, b: float) -> InputMode:
        """A block with its states divided by a + b j: the same block."""
        assert self.square is not None
        norm, both = (a**2 - self.square * b**2) or 1.0, []
        for first, second in map(halves, (self.gains, self.initial)):
            both.append(np.concatenate([a * first - self.square * b * second, a * second - b * first]) / norm)
        return replace(self, gains=both[0], initial=both[1])


def halves(values: NDArray) -> list[NDArray]:
    """Parts of numbers that belong to each state of a block."""
    return np.split(values, 2)


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
    whole = np.expm1(rate) / rate if rate else 1.0
    if hold == "zero":
        return step * decay * whole, 0j
    small = abs(rate) < 0.5
    later = complex(np.polyval(LINEAR, rate)) if small else (np.exp(rate) * (rate - 1.0) + 1.0) / rate**2
    return step * decay * (whole - later), step * decay * later * np.exp(-1j * turn * omega * step)


def state_of(samples: Samples, mode: InputMode) -> NDArray:
    """The state of a mode, driven by the inputs from its initial value on (samples,); real of a real multiplier."""
    found = np.empty((mode.states, samples.n_samples), float if mode.real else complex)
    for parts, state in zip(
        samples.parts(4 * (1 + len(mode.reach))), mode.initial.reshape(mode.states, -1).T, strict=True
    ):
        for own in parts[::-1] if mode.backwards else parts:
            wide = joined(own, parts)
            found[:, wide] = state_in(samples.part(wide), replace(mode, initial=state))
            state = np.asarray(found[:, wide.start if mode.backwards else wide.stop - 1], np.complex128)
    return found if mode.states > 1 else found[0]


def joined(own: slice, parts: Sequence[slice]) -> slice:
    """One of the parts of a record with the first sample of the next, to which it carries the state."""
    return slice(own.start, min(own.stop + 1, parts[-1].stop))


def state_in(samples: Samples, mode: InputMode) -> NDArray:
    """The state of a mode in one record ([2,] samples)."""
    if mode.square is not None:
        return of_both(samples, mode, lambda own: state_in(samples, own)).real
    drive = driven_by(samples, mode, shares_of(samples, mode, mode.exponent))
    initial = mode.initial.real if mode.real else mode.initial
    return followed(samples, mode, drive) + initial @ begun_by(samples, mode)


def of_both(samples: Samples, mode: InputMode, of: Callable[[InputMode], NDArray]) -> NDArray:
    """Parts of a function of a block's mode of one exponent (2, …)."""
    assert mode.square is not None
    return parts_of(lambda root: of(mode.at(root)), mode.square, varying(samples, mode))


def varying(samples: Samples, mode: InputMode) -> float:
    """The rate on which the response of a block varies: its decay, or over the longest record [1/s]."""
    longest = samples.step * max(own.stop - own.start for own in samples.records)
    return max(abs(mode.exponent.real), 1.0 / longest)


def runs_away(samples: Samples, exponent: complex) -> bool:
    """True of a mode that grows by so much over a record that its state is followed backwards."""
    return exponent.real * samples.step * max(own.stop - own.start for own in samples.records) > RUNAWAY


def directed(samples: Samples, mode: InputMode) -> InputMode:
    """A mode as it is followed in these records: backwards where it runs away."""
    other = replace(mode, backwards=runs_away(samples, mode.exponent))
    if other.backwards == mode.backwards:
        return mode
    initial = state_of(samples, mode)[..., ends_of(samples, other)]
    return replace(other, initial=np.asarray(np.ravel(initial), np.complex128))


def ends_of(samples: Samples, mode: InputMode) -> list[int]:
    """The sample of each record from which the state of a mode is followed."""
    return [own.stop - 1 if mode.backwards else own.start for own in samples.records]


def begun_by(samples: Samples, mode: InputMode) -> NDArray:
    """e^{λt} from the begin of each record (records, samples), or from its end."""
    rate = samples.step * (mode.exponent.real if mode.real else mode.exponent)
    found = np.zeros((len(samples.records), samples.n_samples), type(rate))
    for number, own in enumerate(samples.records):
        length = own.stop - own.start
        found[number, own] = powers(-rate, length)[::-1] if mode.backwards else powers(rate, length)
    return found


def powers(rate: complex, count: int) -> NDArray:
    """e^{rate k} (count,)."""
    # By products of few exponentials: each takes as long as fifty products.
    inner = max(int(count**0.5), 1)
    steps = np.exp(rate * inner * np.arange(-(-count // inner)))
    return np.multiply.outer(steps, np.exp(rate * np.arange(inner))).ravel()[:count]


def shares_of(samples: Samples, mode: InputMode, exponent: complex) -> Complexes:
    """Shares of each modulated input in the next state, by its sample and by the next one (reach, 2)."""
    of = samples.fundamental, samples.step, samples.hold
    return np.array([input_gain(exponent, turn, *of) for turn in mode.reach.tolist()], np.complex128).reshape(-1, 2)


def driven_by(samples: Samples, mode: InputMode, shares: Complexes) -> Complexes:
    """Sum the effects of all modulated inputs, by their shares and b, on the state at the next sample (samples,)."""
    sums = np.zeros((2, samples.n_samples), complex)
    for turn, gains, own in zip(mode.reach.tolist(), mode.gains.T, shares, strict=True):
        turned = (gains @ samples.inputs) * samples.turned(turn)
        sums[0] += own[0] * turned
        if own[1]:
            sums[1] += own[1] * turned
    sums[0, :-1] += sums[1, 1:]
    return sums[0]


def followed(samples: Samples, mode: InputMode, drives: NDArray) -> NDArray:
    """State z with z[k + 1] = e^{λ step} z[k] + drive[k] from zero in each record, real ones by Re drive (…, samples).

    Of one that is followed backwards it ends with zero: that is bounded where the inputs hold the mode.
    """
    decay: complex = np.exp(mode.exponent * samples.step)
    if mode.real:
        decay, drives = decay.real, drives.real
    if not mode.backwards:

        def forwards(own: NDArray) -> NDArray:
            return _summed(decay, np.concatenate([np.zeros_like(own[..., :1]), own[..., :-1]], axis=-1))

        return samples.each(drives, forwards)

    def backwards(own: NDArray) -> NDArray:
        behind = np.concatenate([np.zeros_like(own[..., :1]), own[..., -2::-1]], axis=-1)
        return _summed(1.0 / decay, behind / -decay)[..., ::-1]

    return samples.each(drives, backwards)


def _summed(decay: complex, added: NDArray) -> NDArray:
    """The sums z[k] = decay z[k - 1] + added[k] from zero (…, samples)."""
    # By a triangular band: `scipy.signal.lfilter` takes twice as long, and a second to load.
    from scipy.linalg import get_lapack_funcs

    if not added.size:  # without a right-hand side LAPACK writes beyond the array: no input, or none that reaches
        return np.zeros_like(added)
    (solve,) = get_lapack_funcs(("tbtrs",), (added,))
    band = np.full((2, added.shape[-1]), -decay, order="F")
    return solve(band, added.reshape(-1, added.shape[-1]).T, uplo="L", diag="U")[0].T.reshape(added.shape)
