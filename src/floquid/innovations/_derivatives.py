"""Derivatives of the innovations of a predictor by all parameters, and the gradient by its adjoint."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Floats
from floquid.fit import CHUNK, ROUNDING
from floquid.innovations._mode import Mode
from floquid.innovations._predictor import Predictor, carried_on, matrices, numbers_of, turning
from floquid.inputs import Samples


def slopes(samples: Samples, at: Predictor, root: Callable[[slice], Floats]) -> Iterator[tuple[slice, Floats]]:
    """Derivatives of W e by all parameters (samples, channels, parameters), in parts."""
    size, width, channels = at.initial.shape[1], width_of(at), len(samples.values)
    states = np.zeros((CHUNK + 1, size + channels, width))
    for place, parts in enumerate(samples.parts(numbers_of(samples, at.modes))):
        states[0, :size] = 0.0
        first = width - at.initial.size + place * size
        states[0, :size, first : first + size] = np.eye(size)
        for own, part, ahead, white in _chunks(samples, at, root, parts):
            count = own.stop - own.start
            for start, signals in held_signals(part, at, own):
                for channel in range(channels):
                    where = slice(start + channel * len(signals), start + (channel + 1) * len(signals))
                    states[:count, size + channel, where] = signals.T
            forced = states[1 : count + 1, :size]
            forced[:] = 0.0
            for row, columns, signals in forces(part, at, own):
                forced[:, row, columns] = signals
            for before, after, transition in zip(states[:count], forced, ahead, strict=True):
                after += transition @ before
            yield own, white @ states[:count]
            begun = states[count, :size, width - at.initial.size :]
            begun[np.abs(begun) < ROUNDING] = 0.0
            states[0, :size] = states[count, :size]


def width_of(at: Predictor) -> int:
    """The number of all parameters, those that are no information as well."""
    return sum(sum(mode.sizes) for mode in at.modes) + at.columns.size + at.initial.size


def _chunks(
    samples: Samples, at: Predictor, root: Callable[[slice], Floats], parts: Sequence[slice]
) -> Iterator[tuple[slice, Samples, Floats, Floats]]:
    """Few samples of a record at a time, with the matrices that carry derivatives on, and those that weigh them."""
    # Below the derivatives of the states are those of what each channel holds beside them: one product serves for both.
    for wide in parts:
        whole = samples.part(wide)
        system, gains, seen, _ = matrices(whole, at.modes)
        gains, weights = whole.gained(gains), whole.gained(root(wide))
        ahead = np.concatenate([system - gains @ seen, -gains], axis=2)
        white = -np.concatenate([weights @ seen, weights], axis=2)
        for first in range(0, whole.n_samples, CHUNK):
            inner = slice(first, min(first + CHUNK, whole.n_samples))
            own = slice(wide.start + inner.start, wide.start + inner.stop)
            yield own, whole.part(inner), ahead[inner], white[inner]


def held_signals(part: Samples, at: Predictor, own: slice) -> Iterator[tuple[int, Floats]]:
    """Signals that each channel holds a share of in a part, and the place of the shares (signals, samples)."""
    # Shares of the first channel come first.
    place = row = 0
    for mode in at.modes:
        place += mode.rows + 2 * mode.gains.size
        states = _states(mode, at.states[own, row : row + mode.rows])
        for number, state in enumerate(states):
            carried = turning(part, mode.turns) * state
            first = place + number * (mode.shape.size // len(states))
            yield first, carried.real
            yield first + mode.shape.size, -carried.imag
        place += 2 * mode.shape.size
        row += mode.rows
    yield place, part.known


def _states(mode: Mode, rows: Floats) -> list[NDArray]:
    """The state of a pair as one that is complex, real ones each for itself, of rows (samples, rows)."""
    return list(rows.T) if mode.real else [rows[:, 0] + 1j * rows[:, 1]]


def forces(part: Samples, at: Predictor, own: slice) -> Iterator[tuple[int, slice, Floats]]:
    """Signals that exponents and gains add to the next state in a part: its row, the parameters, (samples, those)."""
    drives = np.concatenate([part.inputs, at.innovations[:, own]])
    place = row = 0
    for mode in at.modes:
        late = np.einsum("pij,kj->ikp", mode.transition_slopes(part.step), at.states[own, row : row + mode.rows])
        for number in range(mode.rows):
            yield row + number, slice(place, place + mode.rows), late[number]
        place += mode.rows
        driven = (drives[:, None] * turning(part, mode.reach)).reshape(-1, part.n_samples).T
        # A pair has a state that is complex; a block has gains of each of its states.
        for number, shares in enumerate(np.eye(mode.rows) if mode.real else np.array([[1.0], [-1j]])):
            each = (shares[:, None] * driven[:, None]).reshape(part.n_samples, -1)
            columns = slice(place, place + 2 * mode.gains.size)
            yield row + number, columns, np.concatenate([each.real, -each.imag], axis=1)
        place += 2 * (mode.gains.size + mode.shape.size)
        row += mode.rows


def gradient(samples: Samples, at: Predictor, of: Floats) -> Floats:
    """-JᵀR⁻¹v by all parameters, of the innovations or of other signals v (channels, samples) (parameters,)."""
    # The adjoint of the predictor runs backwards once, whatever the number of parameters.
    found, begun = [np.zeros(sum(mode.sizes)) for mode in at.modes], np.zeros(at.initial.shape)
    by_columns = np.zeros(at.columns.shape)
    for place, parts in enumerate(samples.parts(numbers_of(samples, at.modes))):
        adjoint = np.zeros((1, at.initial.shape[1]))
        for own in parts[::-1]:
            part, root = samples.part(own), at.root(own)
            system, gains, seen, _ = matrices(part, at.modes)
            gains = part.gained(gains)
            weighted = np.einsum("kji,jk->ik", root, np.einsum("kij,jk->ik", root, of[:, own]))
            pull = -np.einsum("kin,ik->kn", seen, weighted)
            back = (system - gains @ seen)[::-1].swapaxes(1, 2)
            adjoint = carried_on(adjoint[0], back, pull[::-1])[0][::-1]
            shares = weighted + np.einsum("kni,kn->ik", gains, adjoint[1:])
            _pulled(found, part, at, own, adjoint[1:], shares)
            by_columns += shares @ part.known.T
        begun[place] = -adjoint[0]
    return np.concatenate([*found, by_columns.ravel(), begun.ravel()])


def _pulled(found: Sequence[Floats], part: Samples, at: Predictor, own: slice, behind: Floats, shares: Floats) -> None:
    """Add a part's share to the gradient by the parameters of each mode, by the adjoint (samples, states)."""
    drives, row = np.concatenate([part.inputs, at.innovations[:, own]]), 0
    for mode, gradient_of_mode in zip(at.modes, found, strict=True):
        rows = slice(row, row + mode.rows)
        slopes = mode.transition_slopes(part.step)
        by_exponent = -np.einsum("pij,ij->p", slopes, behind[:, rows].T @ at.states[own, rows])
        states, pulls = _states(mode, at.states[own, rows]), _states(mode, behind[:, rows])
        driven = -np.ravel([(drives * pull.conj()) @ turning(part, mode.reach).T for pull in pulls])
        seen_by = np.ravel([shares @ (turning(part, mode.turns) * state).T for state in states])
        gradient_of_mode += np.concatenate([by_exponent, driven.real, -driven.imag, seen_by.real, -seen_by.imag])
        row += mode.rows
