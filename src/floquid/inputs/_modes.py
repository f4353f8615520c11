"""Modes with the way that inputs reach them, and their states driven by the inputs measured."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from floquid._checks import Rebuilt
from floquid.inputs._samples import Hold, Samples

SERIES = 1e-4
"""Below this a quotient of differences is taken from its series."""

RUNAWAY = 20.0
"""The growth of a mode over a record [nepers] beyond which its state is run backwards, from the end of the record."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class InputMode(Rebuilt):
    r"""One mode: a pair of conjugates, or a real multiplier, as far as it is no linear parameter.

    .. math:: \dot z = \lambda z + \sum_{i,l} b_{i,l}\, e^{i l \omega t} u_i, \qquad
              y = 2 \Re \sum_m c_m e^{i m \omega t} z

    Of a real multiplier λ is real, z and the input are real parts, and l and m count from a half if it is negative.

    Parameters
    ----------
    exponent
        λ [1/s].
    real
        True for a real multiplier.
    reach
        The harmonics l, ascending (reach,); of a real multiplier from 0 or ½ on.
    gains
        b (inputs, reach).
    turns
        The harmonics m, ascending (turns,); of a real multiplier from 0 or ½ on.
    initial
        z at the first sample of each record (records,); at the last one of a mode that grows beyond all bounds.
    sizes
        The state that a gain of 1 makes of each input, about (inputs,): b counts by it beside z at the begin.
    """

    exponent: complex
    real: bool
    reach: NDArray[np.float64]
    gains: NDArray[np.complex128]
    turns: NDArray[np.float64]
    initial: NDArray[np.complex128]
    sizes: NDArray[np.float64]

    @property
    def strengths(self) -> NDArray[np.float64]:
        """Factors by which b and z at the begin are compared, whatever the units of the inputs (parts,)."""
        return np.concatenate([np.repeat(self.sizes, len(self.reach)), np.ones(len(self.initial))])

    @property
    def free(self) -> NDArray[np.bool_]:
        """Mask of the parameters that are free, the scale of the state fixed by its largest part (parameters,).

        Parameters are the real parts of λ, b and z at the begin, then the imaginary ones; of a real multiplier those
        of λ and z have none.
        """
        size, starts = self.gains.size, len(self.initial)
        flat = np.concatenate([self.gains.ravel(), self.initial])
        if not self.real:
            fixed = 1 + int(np.argmax(np.abs(flat) * self.strengths))
            mask = np.ones(1 + size + starts, bool)
            mask[fixed] = False
            return np.tile(mask, 2)
        turning = np.tile(self.reach > 0.0, len(self.gains))
        mask = np.concatenate([[True], np.ones(size, bool), turning, np.ones(starts, bool)])
        flat = flat * self.strengths
        parts = np.concatenate([flat.real[:size], flat.imag[:size] * turning, flat.real[size:]])
        mask[1 + int(np.argmax(np.abs(parts)))] = False
        return mask

    @property
    def lowest(self) -> float:
        """The least harmonic that there is: zero, or ½ of a negative multiplier."""
        return 0.5 if self.real and self.reach[0] else 0.0

    def moved(self, step: NDArray[np.float64]) -> InputMode:
        """With the parameters moved by a step (parameters,)."""
        size = self.gains.size
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
        )

    def with_band(self, band: str, harmonics: ArrayLike) -> InputMode:
        """With other harmonics of the outputs ("turns") or of the inputs ("reach"), new ones of no gain yet."""
        wanted = np.asarray(harmonics, float)
        if band == "turns":
            return replace(self, turns=wanted)
        gains = np.zeros((len(self.gains), len(wanted)), complex)
        gains[:, np.isin(wanted, self.reach)] = self.gains[:, np.isin(self.reach, wanted)]
        return replace(self, reach=wanted, gains=gains)

    def scaled(self) -> InputMode:
        """With the part of b and z that is largest made 1."""
        flat = np.concatenate([self.gains.ravel(), self.initial])
        largest = flat[np.argmax(np.abs(flat) * self.strengths)]
        by = abs(largest) if self.real else largest
        return replace(self, gains=self.gains / by, initial=self.initial / by) if by else self


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
    if abs(rate) < SERIES:
        later = 0.5 + rate / 3.0 + rate**2 / 8.0
    else:
        later = (np.exp(rate) * (rate - 1.0) + 1.0) / rate**2
    return step * decay * (whole - later), step * decay * later * np.exp(-1j * turn * omega * step)


def answering(samples: Samples, mode: InputMode, other: Samples, delay: int) -> InputMode:
    """A mode with b such that it answers to other inputs as to these, but for the first samples of each answer.

    The other inputs are these some samples later, or with another hold.
    """
    decay, ratios = np.exp(mode.exponent * samples.step), []
    for turn in mode.reach.tolist():
        both = [input_gain(mode.exponent, turn, own.fundamental, own.step, own.hold) for own in (samples, other)]
        said, acts = (now + decay * then for now, then in both)
        ratios.append(said / acts * np.exp((mode.exponent - 1j * turn * samples.fundamental) * delay * samples.step))
    return replace(mode, gains=mode.gains * np.array(ratios))


def state_of(samples: Samples, mode: InputMode) -> NDArray:
    """The state of a mode, driven by the inputs from its initial value on (samples,); real of a real multiplier."""
    drive = mode.gains.ravel() @ _drives(samples, mode, mode.exponent)
    initial, decay = mode.initial, complex(np.exp(mode.exponent * samples.step))
    if mode.real:
        return _recursion(samples, decay.real, drive.real) + initial.real @ _begun(samples, mode)
    return _recursion(samples, decay, drive) + initial @ _begun(samples, mode)


def reached_by(samples: Samples, mode: InputMode) -> NDArray:
    """The state by each part of b and z at the begin alone (parts, samples): of a real multiplier by Re b, Im b, z."""
    drives, decay = _drives(samples, mode, mode.exponent), complex(np.exp(mode.exponent * samples.step))
    if mode.real:
        # A real state has the real part of each drive by the real part of b, less the imaginary one by the other.
        parts = np.concatenate([drives.real, -drives.imag])
        return np.concatenate([_recursion(samples, decay.real, parts), _begun(samples, mode)])
    return np.concatenate([_recursion(samples, decay, drives), _begun(samples, mode)])


def slopes_of_state(samples: Samples, mode: InputMode, state: NDArray) -> NDArray:
    """Derivatives of a mode's state by λ and by the parts of `reached_by` (1 + parts, samples)."""
    nudge = 1e-6 / samples.step
    up, down = (_drives(samples, mode, mode.exponent + sign * nudge) for sign in (1.0, -1.0))
    drive = mode.gains.ravel() @ (up - down) / (2.0 * nudge)
    decay = complex(np.exp(mode.exponent * samples.step))
    if mode.real:
        late = _recursion(samples, decay.real, samples.step * decay.real * state + drive.real)
    else:
        late = _recursion(samples, decay, samples.step * decay * state + drive)
    return np.concatenate([late[None], reached_by(samples, mode)])


def followed(samples: Samples, mode: InputMode, drive: NDArray[np.complex128]) -> NDArray:
    """The state of a mode that a signal drives from each sample to the next one, from zero (samples,)."""
    decay = complex(np.exp(mode.exponent * samples.step))
    return _recursion(samples, decay.real, drive.real) if mode.real else _recursion(samples, decay, drive)


def runs_away(samples: Samples, exponent: complex) -> bool:
    """True of a mode that a feedback must hold: by itself it would grow beyond what a record could hold."""
    return exponent.real * samples.step * max(own.stop - own.start for own in samples.records) > RUNAWAY


def _begun(samples: Samples, mode: InputMode) -> NDArray:
    """e^{λt} from the begin of each record (records, samples), or from its end."""
    rate = mode.exponent.real if mode.real else mode.exponent
    found = np.zeros((len(samples.records), samples.n_samples), type(rate))
    for number, own in enumerate(samples.records):
        count = own.stop - own.start
        origin = count - 1 if runs_away(samples, mode.exponent) else 0
        found[number, own] = np.exp(rate * samples.step * (np.arange(count) - origin))
    return found


def _drives(samples: Samples, mode: InputMode, exponent: complex) -> NDArray[np.complex128]:
    """What each modulated input adds to the state at the next sample (inputs · reach, samples)."""
    found = []
    for own in samples.inputs:
        for turn in mode.reach.tolist():
            now, then = input_gain(exponent, turn, samples.fundamental, samples.step, samples.hold)
            turned = samples.turned(turn) * own
            # The sample after the last of a record drives nothing that is there.
            found.append(now * turned + (then * np.append(turned[1:], 0.0) if then else 0.0))
    return np.asarray(found, np.complex128).reshape(-1, samples.n_samples)


def _recursion(samples: Samples, decay: complex, drives: NDArray) -> NDArray:
    """State z with z[k + 1] = decay z[k] + drive[k] from zero in each record (…, samples).

    Where it runs away it ends with zero: of all solutions that one is bounded where the inputs hold the mode.
    """
    if not runs_away(samples, np.log(decay) / samples.step):

        def forwards(own: NDArray) -> NDArray:
            return _summed(decay, np.concatenate([np.zeros_like(own[..., :1]), own[..., :-1]], axis=-1))

        return samples.each(drives, forwards)

    def backwards(own: NDArray) -> NDArray:
        behind = np.concatenate([np.zeros_like(own[..., :1]), own[..., -2::-1]], axis=-1)
        return _summed(1.0 / decay, behind / -decay)[..., ::-1]

    return samples.each(drives, backwards)


def _summed(decay: complex, added: NDArray) -> NDArray:
    """The sums z[k] = decay z[k - 1] + added[k] from zero (…, samples).

    By a triangular band: `scipy.signal.lfilter` takes twice as long, and a second to load.
    """
    from scipy.linalg import get_lapack_funcs

    if not added.size:  # without a right-hand side LAPACK writes beyond the array: no input, or none that reaches
        return np.zeros_like(added)
    (solve,) = get_lapack_funcs(("tbtrs",), (added,))
    band = np.full((2, added.shape[-1]), -decay, order="F")
    return solve(band, added.reshape(-1, added.shape[-1]).T, uplo="L", diag="U")[0].T.reshape(added.shape)
