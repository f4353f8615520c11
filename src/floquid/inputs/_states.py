"""States of modes, driven by the inputs measured, and their derivatives by the parameters of the modes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from floquid.inputs._block import by_root, of_block, summed_block, transition
from floquid.inputs._modes import InputMode, input_gain
from floquid.inputs._samples import Samples

RUNAWAY = 20.0
"""The growth of a mode over a record [nepers] beyond which its state is run backwards, from the end of the record."""


def answering(samples: Samples, mode: InputMode, other: Samples, delay: int) -> InputMode:
    """A mode with b such that it answers to other inputs as to these, but for the first samples of each answer.

    The other inputs are these some samples later, or with another hold.
    """

    def ratios(exponent: complex) -> NDArray[np.complex128]:
        decay, found = np.exp(exponent * samples.step), []
        for turn in mode.reach.tolist():
            both = [input_gain(exponent, turn, own.fundamental, own.step, own.hold) for own in (samples, other)]
            said, acts = (now + decay * then for now, then in both)
            found.append(said / acts * np.exp((exponent - 1j * turn * samples.fundamental) * delay * samples.step))
        return np.array(found)

    if mode.square is None:
        return replace(mode, gains=mode.gains * ratios(mode.exponent))
    by, count = of_block(ratios, mode.exponent.real, mode.square, samples.step), len(mode.gains) // 2
    first, second = mode.gains[:count], mode.gains[count:]
    both = (by[0] * first + mode.square * by[1] * second, by[0] * second + by[1] * first)
    return replace(mode, gains=np.concatenate(both))


def state_of(samples: Samples, mode: InputMode) -> NDArray:
    """The state of a mode, driven by the inputs from its initial value on (samples,); real of a real multiplier.

    Of a block both (2, samples).
    """
    if mode.square is not None:
        states = _recursion_of(samples, mode, _block_drive(samples, mode))
        return states + np.tensordot(mode.initial.real, _begun_blocks(samples, mode), 1)
    drive = mode.gains.ravel() @ _drives(samples, mode, mode.exponent)
    initial, decay = mode.initial, complex(np.exp(mode.exponent * samples.step))
    if mode.real:
        return _recursion(samples, decay.real, drive.real) + initial.real @ _begun(samples, mode)
    return _recursion(samples, decay, drive) + initial @ _begun(samples, mode)


def reached_by(samples: Samples, mode: InputMode) -> NDArray:
    """The state by each part of b and z at the begin alone (parts, samples): of a real multiplier by Re b, Im b, z.

    Of a block both states, in that order (parts, 2, samples).
    """
    if mode.square is not None:
        drives = np.stack(_block_drives(samples, mode, mode.exponent.real, mode.square), axis=1)
        # A state by the second part of b is j times that by the first.
        both = [_recursion_of(samples, mode, parts) for parts in (drives.real, -drives.imag)]
        both = [np.concatenate([own, by_root(own, mode.square)]) for own in both]
        return np.concatenate([*both, _begun_blocks(samples, mode)])
    drives, decay = _drives(samples, mode, mode.exponent), complex(np.exp(mode.exponent * samples.step))
    if mode.real:
        # A real state has the real part of each drive by the real part of b, less the imaginary one by the other.
        parts = np.concatenate([drives.real, -drives.imag])
        return np.concatenate([_recursion(samples, decay.real, parts), _begun(samples, mode)])
    return np.concatenate([_recursion(samples, decay, drives), _begun(samples, mode)])


def slopes_of_state(samples: Samples, mode: InputMode, state: NDArray) -> NDArray:
    """Derivatives of a mode's state by λ and by the parts of `reached_by` (1 + parts, samples).

    Of a block those of both states by σ, the parts and q (2 + parts, 2, samples).
    """
    nudge = 1e-6 / samples.step
    if mode.square is not None:
        along_square = 10.0 * nudge / samples.step
        late, apart = (_block_slope(samples, mode, state, by) for by in ((nudge, 0.0), (0.0, along_square)))
        return np.concatenate([late[None], reached_by(samples, mode), apart[None]])
    up, down = (_drives(samples, mode, mode.exponent + sign * nudge) for sign in (1.0, -1.0))
    drive = mode.gains.ravel() @ (up - down) / (2.0 * nudge)
    decay = complex(np.exp(mode.exponent * samples.step))
    if mode.real:
        late = _recursion(samples, decay.real, samples.step * decay.real * state + drive.real)
    else:
        late = _recursion(samples, decay, samples.step * decay * state + drive)
    return np.concatenate([late[None], reached_by(samples, mode)])


def followed(samples: Samples, mode: InputMode, drive: NDArray[np.complex128]) -> NDArray:
    """The state of a mode that a signal drives from each sample to the next one, from zero (samples,).

    Of a block both, by two signals (2, samples).
    """
    if mode.square is not None:
        return _recursion_of(samples, mode, drive.real)
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


def _block_drives(
    samples: Samples, mode: InputMode, mean: float, square: float
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Both parts of what each modulated input adds to a block at the next sample (inputs · reach, samples)."""
    gains = [
        of_block(
            lambda rate, turn=turn: np.array(input_gain(rate, turn, samples.fundamental, samples.step, samples.hold)),
            mean,
            square,
            samples.step,
        )
        for turn in mode.reach.tolist()
    ]
    found: tuple[list[NDArray], list[NDArray]] = ([], [])
    for own in samples.inputs:
        for turn, parts in zip(mode.reach.tolist(), gains, strict=True):
            turned = samples.turned(turn) * own
            after = np.append(turned[1:], 0.0)
            for signals, (now, then) in zip(found, parts, strict=True):
                signals.append(now * turned + (then * after if then else 0.0))
    first, second = (np.asarray(own, np.complex128).reshape(-1, samples.n_samples) for own in found)
    return first, second


def _block_drive(samples: Samples, mode: InputMode) -> NDArray[np.float64]:
    """What all inputs add to both states of a block at the next sample (2, samples)."""
    assert mode.square is not None
    first, second = _block_drives(samples, mode, mode.exponent.real, mode.square)
    count = len(mode.gains) // 2
    one, other = mode.gains[:count].ravel(), mode.gains[count:].ravel()
    return np.array([(one @ first + mode.square * (other @ second)).real, (one @ second + other @ first).real])


def _block_slope(
    samples: Samples, mode: InputMode, state: NDArray[np.float64], by: tuple[float, float]
) -> NDArray[np.float64]:
    """The derivative of both states of a block along σ and q, by central differences of its maps (2, samples)."""
    assert mode.square is not None
    maps, drives = [], []
    for sign in (1.0, -1.0):
        mean, square = mode.exponent.real + sign * by[0], mode.square + sign * by[1]
        first, second = transition(mean, square, samples.step)
        maps.append(np.array([[first, square * second], [second, first]]))
        drives.append(_block_drive(samples, replace(mode, exponent=complex(mean), square=square)))
    size = 2.0 * (by[0] + by[1])
    return _recursion_of(samples, mode, ((maps[0] - maps[1]) @ state + drives[0] - drives[1]) / size)


def _begun_blocks(samples: Samples, mode: InputMode) -> NDArray[np.float64]:
    """States of a block from either state being 1 at the begin of each record (2 records, 2, samples)."""
    assert mode.square is not None
    found = np.zeros((len(samples.records), 2, samples.n_samples))
    root = np.sqrt(complex(mode.square))
    for number, own in enumerate(samples.records):
        times = samples.step * np.arange(own.stop - own.start)
        up, down = np.exp((mode.exponent.real + root) * times), np.exp((mode.exponent.real - root) * times)
        found[number, 0, own] = 0.5 * (up + down).real
        # Of small arguments the difference cancels, of large ones sinh overflows where the decay makes up for it.
        turned = root * times
        near = np.abs(turned) < 1.0
        turned = np.where(near & (turned != 0.0), turned, 1e-8)
        slow = times * np.exp(mode.exponent.real * times) * np.sinh(turned) / turned
        found[number, 1, own] = np.where(near, slow, 0.5 * (up - down) / (root or 1.0)).real
    return np.concatenate([found, by_root(found, mode.square)])


def _recursion_of(samples: Samples, mode: InputMode, drives: NDArray[np.float64]) -> NDArray[np.float64]:
    """States of a block from zero in each record, by what is added at each next sample (…, 2, samples)."""
    assert mode.square is not None
    square, decay = mode.square, transition(mode.exponent.real, mode.square, samples.step)

    def of(own: NDArray) -> NDArray:
        return summed_block(decay, square, np.concatenate([np.zeros_like(own[..., :1]), own[..., :-1]], axis=-1))

    return samples.each(drives, of)


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
