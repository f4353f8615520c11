"""Derivatives of the states of modes, formed of a part of the samples at a time: all of them take no more memory."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Complexes
from floquid.fit import ROUNDING
from floquid.inputs._modes import (
    InputMode,
    begun_by,
    by_root,
    driven_by,
    followed,
    halves,
    joined,
    of_both,
    shares_of,
    slopes_along_square,
    state_in,
    varying,
)
from floquid.inputs._samples import Samples


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """Samples that follow one another in a record, and the first of the next part, with derivatives of states."""

    own: slice  # its samples among all, without that of the next part
    record: int  # its record
    samples: Samples  # with that of the next part
    rows: list[NDArray]  # of each mode, as `Followed.rows` has them

    @property
    def joined(self) -> slice:
        """The samples among all, with that of the next part."""
        return slice(self.own.start, self.own.start + self.samples.n_samples)

    @property
    def alone(self) -> Part:
        """Without the sample of the next part."""
        inner = slice(0, self.own.stop - self.own.start)
        if inner.stop == self.samples.n_samples:
            return self
        return replace(self, samples=self.samples.part(inner), rows=[rows[..., inner] for rows in self.rows])


class Followed:
    """Derivatives of a mode's state by λ, b and its first values, followed from part to part of the records."""

    def __init__(
        self, samples: Samples, mode: InputMode, state: NDArray | None, parts: Sequence[Sequence[slice]]
    ) -> None:
        """Follow those by b and the first values alone where no state is given: they do not depend on it."""
        self._mode, self._records = mode, len(parts)
        self._state = None if state is None else state.reshape(mode.states, -1)
        self._carried: dict[int, NDArray] = {}  # those at the sample from which a part is followed, by its first one
        if mode.backwards:
            for record, cuts in enumerate(parts):
                for own in cuts[:0:-1]:
                    rows = self.rows(samples.part(joined(own, cuts)), own.start, record)
                    self._carried[cuts[cuts.index(own) - 1].start] = rows[..., 0]

    def rows(self, part: Samples, start: int, record: int) -> NDArray:
        """The derivatives in a part that begins with a sample of a record ([2,] samples)."""
        mode, width = self._mode, self._mode.states
        if self._state is None:
            rows, behind = reached_by(part, replace(mode, initial=np.ones(width, complex))), 0
        else:
            own = self._state[:, start : start + part.n_samples]
            alone = replace(mode, initial=np.asarray(own[:, -1 if mode.backwards else 0], np.complex128))
            rows, behind = slopes_of_state(part, alone, own if width > 1 else own[0]), int(width > 1)
        # The response to first values of this part alone carries on all derivatives from those with which it begins.
        first = len(rows) - width - behind
        begun, size = rows[first : first + width].copy(), first + width * self._records
        carried = self._carried.get(start)
        if carried is None:
            carried = np.zeros((size + behind, *rows.shape[1:-1]), rows.dtype)
            for state in range(width):
                carried[(first + state * self._records + record, *(state,) * (width - 1))] = 1.0
        else:
            firsts = carried[first:size]
            firsts[np.abs(firsts) < ROUNDING] = 0.0
        rows[first : first + width] = 0.0
        found = rows if self._records == 1 else np.insert(rows, [first + width] * (size - first - width), 0.0, axis=0)
        for row, own in zip(found, carried.reshape(-1, width), strict=True):
            if own.any():
                row += own[0] * begun[0] if width == 1 else np.tensordot(own, begun, 1)
        if not mode.backwards:
            self._carried[start + part.n_samples - 1] = found[..., -1].copy()
        return found


def slopes_in_parts(
    samples: Samples, modes: Sequence[InputMode], states: Sequence[NDArray | None], numbers: int
) -> Iterator[Part]:
    """Derivatives of the states of modes, part by part of the samples."""
    parts = samples.parts(numbers)
    followed = [Followed(samples, mode, state, parts) for mode, state in zip(modes, states, strict=True)]
    for record, cuts in enumerate(parts):
        for own in cuts:
            wide = samples.part(joined(own, cuts))
            yield Part(own, record, wide, [each.rows(wide, own.start, record) for each in followed])


def reached_by(samples: Samples, mode: InputMode) -> NDArray:
    """The state by each part of b and z at the start alone (parts, samples): of a real multiplier by Re b, Im b, z.

    Of a block both states, in that order (parts, 2, samples).
    """
    if mode.square is not None:
        # A state by the second part of b is j times that by the first.
        alone, size = of_both(samples, mode, lambda own: reached_by(samples, own)), mode.gains.size // 2
        both = np.concatenate([alone[:, :size], by_root(alone[:, :size], mode.square)], axis=1)
        begun = np.concatenate([alone[:, size:], by_root(alone[:, size:], mode.square)], axis=1)
        return np.moveaxis(np.concatenate([both.real, -both.imag, begun.real], axis=1), 0, 1)
    drives = _drives(samples, mode)
    # A real state has the real part of each drive by the real part of b, less the imaginary one by the other.
    parts = np.concatenate([drives.real, -drives.imag]) if mode.real else drives
    return np.concatenate([followed(samples, mode, parts), begun_by(samples, mode)])


def slopes_of_state(samples: Samples, mode: InputMode, state: NDArray) -> NDArray:
    """Derivatives of a mode's state by λ and by the parts of `reached_by` (1 + parts, samples).

    Of a block those of both states by σ, the parts and q (2 + parts, 2, samples).
    """
    if mode.square is not None:
        return _slopes_of_block(samples, mode)
    return np.concatenate([_late(samples, mode, state)[None], reached_by(samples, mode)])


def _slopes_of_block(samples: Samples, mode: InputMode) -> NDArray:
    assert mode.square is not None
    gains, initial = (halves(own)[1] for own in (mode.gains, mode.initial))

    def late(own: InputMode) -> NDArray:
        return _late(samples, own, state_in(samples, own))

    def along(own: InputMode) -> NDArray:
        return late(own) + state_in(samples, replace(own, gains=gains, initial=initial))

    by_square = slopes_along_square(
        lambda root: state_in(samples, mode.at(root)),
        lambda root: along(mode.at(root)),
        mode.square,
        varying(samples, mode),
    )
    return np.concatenate([of_both(samples, mode, late).real[None], reached_by(samples, mode), by_square.real[None]])


def _late(samples: Samples, mode: InputMode, state: NDArray) -> NDArray:
    """The derivative of a mode's state by λ (samples,)."""
    nudge = 1e-6 / samples.step
    up, down = (shares_of(samples, mode, mode.exponent + sign * nudge) for sign in (1.0, -1.0))
    drive = driven_by(samples, mode, (up - down) / (2.0 * nudge))
    decay = complex(np.exp(mode.exponent * samples.step))
    return followed(samples, mode, samples.step * decay * state + drive)


def _drives(samples: Samples, mode: InputMode) -> Complexes:
    """Effect of each modulated input on the state at the next sample (inputs · reach, samples)."""
    found = np.empty((len(samples.inputs), len(mode.reach), samples.n_samples), complex)
    for place, (turn, (now, then)) in enumerate(
        zip(mode.reach.tolist(), shares_of(samples, mode, mode.exponent), strict=True)
    ):
        turned = samples.turned(turn) * samples.inputs
        np.multiply(turned, now, out=found[:, place])
        if then:  # the sample after the last of a record drives nothing that is there
            found[:, place, :-1] += then * turned[:, 1:]
    return found.reshape(-1, samples.n_samples)
