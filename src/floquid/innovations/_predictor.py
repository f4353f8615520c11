r"""The one-step predictor of a periodic system in innovations form, and its derivatives by all parameters.

.. math:: s_{k+1} = \Lambda s_k + B_k u_k + K_k e_k, \qquad e_k = y_k - C_k s_k - q\, w_k

Λ is block diagonal, of the modes; B, K and C turn with the period; w are known columns: a mean, harmonics, a direct
term (Ljung 1999, section 4.3; Verhaegen and Yu 1995 of periodic systems).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import BLOCK
from floquid._checks import Rebuilt
from floquid.fit import CHUNK, LAGS, ROUNDING, schwarz
from floquid.innovations._mode import Mode
from floquid.inputs import RUNAWAY, Samples

LARGEST = 1e3  # innovations over the response from which on the predictor diverges
MEMORY = 64  # samples after a gap at which it is taken for forgotten, beside its own length


class Weights(Protocol):
    """Matrices of samples, of some of these by a slice or a mask (samples, channels, channels)."""

    def __getitem__(self, own: slice | NDArray[np.bool_], /) -> NDArray[np.float64]: ...


@dataclass(frozen=True, eq=False)
class Predictor(Rebuilt):
    """Modes, coefficients of the known columns and first states, with the innovations that they leave."""

    modes: tuple[Mode, ...]  # The modes
    columns: NDArray[np.float64]  # Coefficients of the known columns (channels, columns)
    initial: NDArray[np.float64]  # The state at the first sample of each record (records, states)
    innovations: NDArray[np.float64]  # e (channels, samples)
    states: NDArray[np.float64]  # s (samples, states)
    # W of some samples (samples, channels, channels): the covariance of e varies, that of W e is R. The geometric mean
    # of its determinants is 1.
    whitening: Weights
    count: int  # Samples that were measured; at others e is zero: the state goes on without an innovation
    # T (samples, channels, channels), by which innovations after gaps are as small as others; None without gaps
    scales: NDArray[np.float64] | None = None

    @property
    def level(self) -> NDArray[np.float64]:
        """Innovations, those after gaps made as small as others (channels, samples)."""
        e = self.innovations
        return e if self.scales is None else np.einsum("kij,jk->ik", self.scales, e)

    @property
    def noise(self) -> NDArray[np.float64]:
        """The rms of the innovations (channels, 1)."""
        return np.sqrt(np.sum(self.level**2, axis=1, keepdims=True) / self.count)

    @cached_property
    def covariance(self) -> NDArray[np.float64]:
        """R, of W e (channels, channels)."""
        white = _weighted(self.whitening.__getitem__, self.level)
        return white @ white.T / self.count

    @cached_property
    def _factor(self) -> NDArray[np.float64]:
        return np.asarray(np.linalg.inv(np.linalg.cholesky(self.covariance)), np.float64)

    def root(self, own: slice = slice(None)) -> NDArray[np.float64]:
        """Factor that makes innovations white and of variance 1, of some samples (samples, channels, channels)."""
        root = np.asarray(self._factor @ self.whitening[own], np.float64)
        return root if self.scales is None else root @ self.scales[own]

    def white(self, signals: NDArray[np.float64]) -> NDArray[np.float64]:
        """Signals as weighted in the likelihood (channels, samples)."""
        return _weighted(self.root, signals)

    @property
    def log_likelihood(self) -> float:
        """Twice the logarithm of the likelihood at its own covariance, up to a constant."""
        made = 0.0 if self.scales is None else float(np.sum(np.linalg.slogdet(self.scales)[1]))
        return 2.0 * made - float(self.count * np.linalg.slogdet(self.covariance)[1])

    @property
    def cost(self) -> float:
        """Minus twice the logarithm of the likelihood, which steps make least."""
        return -self.log_likelihood

    @property
    def criterion(self) -> float:
        """The criterion of Schwarz (1978): more is better."""
        return schwarz(self.log_likelihood, self.n_parameters, self.count)

    @property
    def n_parameters(self) -> int:
        """Real numbers that are free: the scale of each state is none."""
        return self.columns.size + self.initial.size + sum(_free(mode) for mode in self.modes)


def _weighted(of: Callable[[slice], NDArray[np.float64]], signals: NDArray[np.float64]) -> NDArray[np.float64]:
    """The product of matrices of each sample, formed of some at a time, with signals (channels, samples)."""
    found, length = np.empty(signals.shape), max(BLOCK // len(signals) ** 2, 1)
    for first in range(0, signals.shape[1], length):
        own = slice(first, first + length)
        found[:, own] = np.einsum("kij,jk->ik", of(own), signals[:, own])
    return found


def _free(mode: Mode) -> int:
    fixed = np.count_nonzero(mode.turns == 0.0) * len(mode.shape) + np.count_nonzero(mode.reach == 0.0) * len(
        mode.gains
    )
    return sum(mode.sizes) - mode.rows - (int(fixed) if mode.real else 0)


def predicted(
    samples: Samples,
    modes: Sequence[Mode],
    columns: NDArray[np.float64],
    initial: NDArray[np.float64],
    whitening: Weights | None = None,
    *,
    growing: bool = False,
    scales: NDArray[np.float64] | None = None,
) -> Predictor | None:
    """The predictor with its innovations, of one covariance if not given; None where it diverges.

    With `growing` it may have grown over the records, as long as its innovations have not: nothing is fitted then.
    What makes up for gaps is given, or that of these modes.
    """
    limit = LARGEST * np.abs(samples.values).max()
    states, innovations = np.empty((samples.n_samples, initial.shape[1])), np.empty(samples.values.shape)
    ends = np.empty((len(initial), initial.shape[1], initial.shape[1]))
    with np.errstate(all="ignore"):
        for place, (state, parts) in enumerate(zip(initial, samples.parts(_numbers(samples, modes)), strict=True)):
            ends[place] = np.eye(len(state))
            for own in parts:
                part = samples.part(own)
                system, gains, seen, drive = matrices(part, modes)
                gains, beside = part.gained(gains), part.values - columns @ part.known
                drive = drive + np.einsum("kni,ik->kn", gains, beside)
                own_states, whole = _carried(state, system - gains @ seen, drive)
                states[own], state = own_states[:-1], own_states[-1]
                ends[place] = whole @ ends[place]
                innovations[:, own] = part.kept(beside - np.einsum("kin,kn->ik", seen, states[own]))
        # One that grows may leave innovations that are small: its derivatives would be none.
        grown = float(np.linalg.norm(ends, axis=(1, 2)).max(initial=0.0))
    if not (np.abs(innovations).max() <= limit and (growing or grown <= RUNAWAY)):
        return None
    if whitening is None:
        whitening = np.broadcast_to(np.eye(len(samples.values)), (samples.n_samples, *[len(samples.values)] * 2))
    if scales is None and samples.gaps:
        scales = scales_of(samples, matrices(samples, modes)[:3], innovations)
    return Predictor(tuple(modes), columns, initial, innovations, states, whitening, samples.count, scales)


def responding(samples: Samples, at: Predictor, innovations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Outputs of the modes of a predictor with other innovations (channels, samples), from its first states on."""
    found = at.columns @ samples.known + innovations
    for state, parts in zip(at.initial, samples.parts(_numbers(samples, at.modes)), strict=True):
        for own in parts:
            system, gains, seen, drive = matrices(samples.part(own), at.modes)
            drive = drive + np.einsum("kni,ik->kn", gains, innovations[:, own])
            states, _ = _carried(state, np.broadcast_to(system, (len(drive), *system.shape)), drive)
            found[:, own] += np.einsum("kin,kn->ik", seen, states[:-1])
            state = states[-1]
    return found


def _numbers(samples: Samples, modes: Sequence[Mode]) -> int:
    """Numbers of each sample that the matrices of these modes have, and what is made of them."""
    return 2 * (sum(mode.rows for mode in modes) + len(samples.values)) ** 2


def _carried(
    first: NDArray[np.float64], transitions: NDArray[np.float64], drive: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """States of x_{k+1} = T_k x_k + f_k from the first one on (samples + 1, states), and the product of all T."""
    # Blocks of samples go side by side: each is run from zero for what it adds and what it carries over, the states at
    # their begins follow one from the other, and each is run again from its own.
    count = len(drive) + 1
    length = max(int(0.5 * count**0.5), 1)
    begins = np.arange(0, count, length)
    added, carried = np.zeros((len(begins) - 1, len(first))), np.eye(len(first))
    for step in range(length):
        own = begins[:-1] + step
        added = np.einsum("bij,bj->bi", transitions[own], added) + drive[own]
        carried = transitions[own] @ carried
    states = np.empty((count, len(first)))
    states[0], whole = first, np.eye(len(first))
    for number, begin in enumerate(begins[:-1]):
        states[begin + length] = carried[number] @ states[begin] + added[number]
        whole = carried[number] @ whole
    for transition in transitions[begins[-1] :]:
        whole = transition @ whole
    for step in range(length - 1):
        own = begins + step
        own = own[own + 1 < count]
        states[own + 1] = np.einsum("bij,bj->bi", transitions[own], states[own]) + drive[own]
    return states, whole


def rebuilt(samples: Samples, now: Predictor, modes: Sequence[Mode]) -> Predictor | None:
    """The predictor of other modes, those of now first; states that are new begin at zero."""
    size = sum(mode.rows for mode in modes)
    initial = np.zeros((len(samples.records), size))
    width = min(size, now.initial.shape[1])
    initial[:, :width] = now.initial[:, :width]
    return predicted(samples, modes, now.columns, initial, now.whitening)


def matrices(
    samples: Samples, modes: Sequence[Mode]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Λ (states, states), K (samples, states, channels), C (samples, channels, states), Bu (samples, states)."""
    count, size = samples.n_samples, sum(mode.rows for mode in modes)
    channels, inputs = len(samples.values), len(samples.inputs)
    system = np.zeros((size, size))
    gains, seen = np.zeros((count, size, channels)), np.zeros((count, channels, size))
    drive, place = np.zeros((count, size)), 0
    for mode in modes:
        own = slice(place, place + mode.rows)
        gain = np.tensordot(turning(samples, mode.reach), mode.gains, (0, 1))
        shape = np.tensordot(turning(samples, mode.turns), mode.shape, (0, 1))
        gain = np.stack([gain.real] if mode.real else [gain.real, gain.imag], axis=1).reshape(count, mode.rows, -1)
        shape = np.stack([shape.real] if mode.real else [shape.real, -shape.imag], axis=1).reshape(count, mode.rows, -1)
        system[own, own] = mode.transition(samples.step)
        gains[:, own], seen[:, :, own] = gain[..., inputs:], shape.swapaxes(1, 2)
        drive[:, own] = np.einsum("kri,ik->kr", gain[..., :inputs], samples.inputs)
        place += mode.rows
    return system, gains, seen, drive


def turning(samples: Samples, turns: NDArray[np.float64]) -> NDArray[np.complex128]:
    """e^{imωt} of some harmonics (turns, samples)."""
    return np.array([samples.turned(turn) for turn in turns.tolist()]).reshape(len(turns), -1)


def slopes(
    samples: Samples, at: Predictor, root: Callable[[slice], NDArray[np.float64]]
) -> Iterator[tuple[slice, NDArray[np.float64]]]:
    """Derivatives of W e by all parameters (samples, channels, parameters), in parts.

    `root` is W of some samples (samples, channels, channels). Parameters are those of `Mode.moved` of each mode, the
    coefficients of the known columns by channel, and the first states of each record.
    """
    size, channels = at.initial.shape[1], len(samples.values)
    width = sum(sum(mode.sizes) for mode in at.modes) + at.columns.size + at.initial.size
    states = np.zeros((CHUNK + 1, size + channels, width))
    for place, parts in enumerate(samples.parts(_numbers(samples, at.modes))):
        states[0, :size] = 0.0
        first = width - at.initial.size + place * size
        states[0, :size, first : first + size] = np.eye(size)
        for own, part, ahead, white in _chunks(samples, at, root, parts):
            count = own.stop - own.start
            for start, signals in _signals(part, at, own):
                for channel in range(channels):
                    where = slice(start + channel * len(signals), start + (channel + 1) * len(signals))
                    states[:count, size + channel, where] = signals.T
            _force(states[1 : count + 1, :size], part, at, own)
            for before, after, transition in zip(states[:count], states[1 : count + 1, :size], ahead, strict=True):
                after += transition @ before
            yield own, white @ states[:count]
            begun = states[count, :size, width - at.initial.size :]
            begun[np.abs(begun) < ROUNDING] = 0.0
            states[0, :size] = states[count, :size]


def _chunks(
    samples: Samples, at: Predictor, root: Callable[[slice], NDArray[np.float64]], parts: Sequence[slice]
) -> Iterator[tuple[slice, Samples, NDArray[np.float64], NDArray[np.float64]]]:
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


def _signals(part: Samples, at: Predictor, own: slice) -> Iterator[tuple[int, NDArray[np.float64]]]:
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


def _states(mode: Mode, rows: NDArray[np.float64]) -> list[NDArray]:
    """The state of a pair as one that is complex, real ones each for itself, of rows (samples, rows)."""
    return list(rows.T) if mode.real else [rows[:, 0] + 1j * rows[:, 1]]


def _force(forcing: NDArray, part: Samples, at: Predictor, own: slice) -> None:
    """Put the derivatives of the next state by exponents and gains into an array (samples, states, parameters)."""
    forcing[:] = 0.0
    drives = np.concatenate([part.inputs, at.innovations[:, own]])
    place = row = 0
    for mode in at.modes:
        late = np.einsum("pij,kj->kip", mode.transition_slopes(part.step), at.states[own, row : row + mode.rows])
        forcing[:, row : row + mode.rows, place : place + mode.rows] = late
        place += mode.rows
        driven = (drives[:, None] * turning(part, mode.reach)).reshape(-1, late.shape[0]).T
        width, whole = driven.shape[1], mode.gains.size
        for number in range(whole // width):  # a block has gains of each of its states
            real = slice(place + number * width, place + number * width + width)
            imag = slice(real.start + whole, real.stop + whole)
            forcing[:, row + number, real], forcing[:, row + number, imag] = driven.real, -driven.imag
            if not mode.real:
                forcing[:, row + 1, real], forcing[:, row + 1, imag] = driven.imag, driven.real
        place += 2 * (whole + mode.shape.size)
        row += mode.rows


def gradient(samples: Samples, at: Predictor, of: NDArray[np.float64]) -> NDArray[np.float64]:
    """-JᵀR⁻¹v by all parameters, of the innovations or of other signals v (channels, samples) (parameters,)."""
    # The adjoint of the predictor runs backwards once, whatever the number of parameters.
    found, begun = [np.zeros(sum(mode.sizes)) for mode in at.modes], np.zeros(at.initial.shape)
    by_columns = np.zeros(at.columns.shape)
    for place, parts in enumerate(samples.parts(_numbers(samples, at.modes))):
        adjoint = np.zeros((1, at.initial.shape[1]))
        for own in parts[::-1]:
            part, root = samples.part(own), at.root(own)
            system, gains, seen, _ = matrices(part, at.modes)
            gains = part.gained(gains)
            weighted = np.einsum("kji,jk->ik", root, np.einsum("kij,jk->ik", root, of[:, own]))
            pull = -np.einsum("kin,ik->kn", seen, weighted)
            back = (system - gains @ seen)[::-1].swapaxes(1, 2)
            adjoint = _carried(adjoint[0], back, pull[::-1])[0][::-1]
            shares = weighted + np.einsum("kni,kn->ik", gains, adjoint[1:])
            _pulled(found, part, at, own, adjoint[1:], shares)
            by_columns += shares @ part.known.T
        begun[place] = -adjoint[0]
    return np.concatenate([*found, by_columns.ravel(), begun.ravel()])


def _pulled(
    found: Sequence[NDArray[np.float64]],
    part: Samples,
    at: Predictor,
    own: slice,
    behind: NDArray[np.float64],
    shares: NDArray[np.float64],
) -> None:
    """Add a part's share to the gradient by the parameters of each mode, by the adjoint (samples, states).

    `shares` are pulls on the signals that each channel holds (channels, samples).
    """
    drives, row = np.concatenate([part.inputs, at.innovations[:, own]]), 0
    for mode, gradient_of_mode in zip(at.modes, found, strict=True):
        rows = slice(row, row + mode.rows)
        slopes = mode.transition_slopes(part.step)
        by_exponent = -np.einsum("pij,kj,ki->p", slopes, at.states[own, rows], behind[:, rows], optimize=True)
        states, pulls = _states(mode, at.states[own, rows]), _states(mode, behind[:, rows])
        driven = -np.ravel([(drives * pull.conj()) @ turning(part, mode.reach).T for pull in pulls])
        seen_by = np.ravel([shares @ (turning(part, mode.turns) * state).T for state in states])
        gradient_of_mode += np.concatenate([by_exponent, driven.real, -driven.imag, seen_by.real, -seen_by.imag])
        row += mode.rows


def scales_of(
    samples: Samples,
    matrices: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]],
    innovations: NDArray[np.float64],
) -> NDArray[np.float64]:
    r"""T (samples, channels, channels) that makes innovations after gaps as small as others, of the form Λ, K and C.

    .. math:: P^+ = (\Lambda - K C) P (\Lambda - K C)^T, \qquad S = C P C^T + R, \qquad T S T^T = R

    with :math:`P^+ = \Lambda P \Lambda^T + K R K^T` where nothing was measured, which is a step without an innovation
    (Anderson and Moore 1979, section 4.1). P is zero far from gaps. Stretches of samples go side by side, each begun
    so far before that what a gap did there is forgotten.
    """
    system, gains, seen = matrices
    covariance = _calm(samples, innovations)
    spreads = np.broadcast_to(covariance, (samples.n_samples, *covariance.shape)).copy()
    length = MEMORY + max((b - a for a, b in samples.gaps), default=0)
    begins = np.concatenate([np.arange(own.start, own.stop, length) for own in samples.records])
    owner = np.searchsorted(samples.begins, begins, side="right")
    first, last = (np.asarray(samples.begins)[owner - by] for by in (1, 0))
    spread = np.zeros((len(begins), *system.shape))
    for step in range(2 * length):
        place = begins - length + step
        inside = (place >= first) & (place < last)
        place = np.where(inside, place, 0)
        if step >= length:
            own = seen[place] @ spread @ seen[place].swapaxes(1, 2)
            spreads[place[inside]] += own[inside]
        held = samples.there[place, None, None]
        ahead = system - held * (gains[place] @ seen[place])
        lost = ~held * gains[place]
        spread = ahead @ spread @ ahead.swapaxes(1, 2) + lost @ covariance @ lost.swapaxes(1, 2)
        spread *= inside[:, None, None]
    spreads = np.where(samples.there[:, None, None], spreads, covariance)
    return np.asarray(np.linalg.cholesky(covariance) @ np.linalg.inv(np.linalg.cholesky(spreads)), np.float64)


def _calm(samples: Samples, innovations: NDArray[np.float64]) -> NDArray[np.float64]:
    """The covariance of innovations far from gaps, of all where hardly any are."""
    used = samples.there.copy()
    for begin, end in samples.gaps:
        used[begin : end + LAGS] = False
    own = innovations[:, used if used.sum() > LAGS * len(innovations) else samples.there]
    return own @ own.T / own.shape[1]
