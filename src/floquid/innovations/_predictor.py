r"""The one-step predictor of a periodic system in innovations form, and its derivatives by all parameters.

.. math:: s_{k+1} = \Lambda s_k + B_k u_k + K_k e_k, \qquad e_k = y_k - C_k s_k - q\, w_k

Λ is block diagonal, of the modes; B, K and C turn with the period; w are known columns: a mean, harmonics, a direct
term (Ljung 1999, section 4.3; Verhaegen and Yu 1995 of periodic systems).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from floquid._arrays import BLOCK, Complexes, Floats, Mask
from floquid._checks import Rebuilt
from floquid.fit import LAGS, schwarz
from floquid.innovations._mode import Mode
from floquid.inputs import RUNAWAY, Samples

LARGEST = 1e3  # innovations over the response from which on the predictor diverges
MEMORY = 64  # samples after a gap at which it is taken for forgotten, beside its own length


class Weights(Protocol):
    """Matrices of samples, of some of these by a slice or a mask (samples, channels, channels)."""

    def __getitem__(self, own: slice | Mask, /) -> Floats: ...


@dataclass(frozen=True, eq=False)
class Predictor(Rebuilt):
    """Modes, coefficients of the known columns and first states, with the innovations that they leave."""

    modes: tuple[Mode, ...]  # The modes
    columns: Floats  # Coefficients of the known columns (channels, columns)
    initial: Floats  # The state at the first sample of each record (records, states)
    innovations: Floats  # e (channels, samples)
    states: Floats  # s (samples, states)
    # W of some samples (samples, channels, channels): the covariance of e varies, that of W e is R. The geometric mean
    # of its determinants is 1.
    whitening: Weights
    count: int  # Samples that were measured; at others e is zero: the state goes on without an innovation
    # T (samples, channels, channels), by which innovations after gaps are as small as others; None without gaps
    scales: Floats | None = None

    @cached_property
    def kept(self) -> dict[str, Any]:
        """Gradient and linearisations, by name, once they are formed: steps, scores and weights share them."""
        return {}

    @property
    def level(self) -> Floats:
        """Innovations, those after gaps made as small as others (channels, samples)."""
        e = self.innovations
        return e if self.scales is None else np.einsum("kij,jk->ik", self.scales, e)

    @property
    def noise(self) -> Floats:
        """The rms of the innovations (channels, 1)."""
        return np.sqrt(np.sum(self.level**2, axis=1, keepdims=True) / self.count)

    @cached_property
    def covariance(self) -> Floats:
        """R, of W e (channels, channels)."""
        white = _weighted(self.whitening.__getitem__, self.level)
        return white @ white.T / self.count

    @cached_property
    def _factor(self) -> Floats:
        return np.asarray(np.linalg.inv(np.linalg.cholesky(self.covariance)), np.float64)

    def root(self, own: slice = slice(None)) -> Floats:
        """Factor that makes innovations white and of variance 1, of some samples (samples, channels, channels)."""
        root = np.asarray(self._factor @ self.whitening[own], np.float64)
        return root if self.scales is None else root @ self.scales[own]

    def white(self, signals: Floats) -> Floats:
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


def _weighted(of: Callable[[slice], Floats], signals: Floats) -> Floats:
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
    columns: Floats,
    initial: Floats,
    whitening: Weights | None = None,
    *,
    growing: bool = False,
    scales: Floats | None = None,
) -> Predictor | None:
    """The predictor with its innovations, of one covariance if not given; None where it diverges.

    With `growing` it may have grown over the records, as long as its innovations have not: nothing is fitted then.
    What makes up for gaps is given, or that of these modes.
    """
    limit = LARGEST * np.abs(samples.values).max()
    states, innovations = np.empty((samples.n_samples, initial.shape[1])), np.empty(samples.values.shape)
    ends = np.empty((len(initial), initial.shape[1], initial.shape[1]))
    with np.errstate(all="ignore"):
        for place, (state, parts) in enumerate(zip(initial, samples.parts(numbers_of(samples, modes)), strict=True)):
            ends[place] = np.eye(len(state))
            for own in parts:
                part = samples.part(own)
                system, gains, seen, drive = matrices(part, modes)
                gains, beside = part.gained(gains), part.values - columns @ part.known
                drive = drive + np.einsum("kni,ik->kn", gains, beside)
                own_states, whole = carried_on(state, system - gains @ seen, drive)
                states[own], state = own_states[:-1], own_states[-1]
                ends[place] = whole @ ends[place]
                innovations[:, own] = part.kept(beside - np.einsum("kin,kn->ik", seen, states[own]))
        # One that grows may leave innovations that are small: its derivatives would be none. Eigenvalues have no scale
        # of states.
        stays = growing or (np.isfinite(ends).all() and np.abs(np.linalg.eigvals(ends)).max(initial=0.0) <= RUNAWAY)
    if not (stays and np.abs(innovations).max() <= limit):
        return None
    if whitening is None:
        whitening = np.broadcast_to(np.eye(len(samples.values)), (samples.n_samples, *[len(samples.values)] * 2))
    if scales is None and samples.gaps:
        scales = scales_of(samples, matrices(samples, modes)[:3], innovations)
    return Predictor(tuple(modes), columns, initial, innovations, states, whitening, samples.count, scales)


def responding(samples: Samples, at: Predictor, innovations: Floats) -> Floats:
    """Outputs of the modes of a predictor with other innovations (channels, samples), from its first states on."""
    found = at.columns @ samples.known + innovations
    for state, parts in zip(at.initial, samples.parts(numbers_of(samples, at.modes)), strict=True):
        for own in parts:
            system, gains, seen, drive = matrices(samples.part(own), at.modes)
            drive = drive + np.einsum("kni,ik->kn", gains, innovations[:, own])
            states, _ = carried_on(state, np.broadcast_to(system, (len(drive), *system.shape)), drive)
            found[:, own] += np.einsum("kin,kn->ik", seen, states[:-1])
            state = states[-1]
    return found


def numbers_of(samples: Samples, modes: Sequence[Mode]) -> int:
    """Numbers of each sample that the matrices of these modes have, and what is made of them."""
    return 2 * (sum(mode.rows for mode in modes) + len(samples.values)) ** 2


def carried_on(first: Floats, transitions: Floats, drive: Floats) -> tuple[Floats, Floats]:
    """States of x_{k+1} = T_k x_k + f_k from the first one on (samples + 1, states), and the product of all T."""
    # Blocks of samples go side by side: each is run from zero for what it adds and what it carries over, the states at
    # their begins follow one from the other, and each is run again from its own.
    size, length = len(first), max(int(0.5 * (len(drive) + 1) ** 0.5), 1)
    count = len(drive) // length
    even = count * length
    ahead, driven = (part[:even].reshape(count, length, *part.shape[1:]) for part in (transitions, drive))
    states, whole = np.empty((len(drive) + 1, size)), np.eye(size)
    blocks, carried = states[:even].reshape(count, length, size), np.zeros((count, size, size + 1))
    carried[:, :, :size] = whole
    for step in range(length):
        carried = ahead[:, step] @ carried
        carried[..., size] += driven[:, step]
    state = first
    for block, over in zip(blocks, carried, strict=True):
        block[0] = state
        state, whole = over[:, :size] @ state + over[:, size], over[:, :size] @ whole
    for step in range(length - 1):
        blocks[:, step + 1] = np.einsum("bij,bj->bi", ahead[:, step], blocks[:, step]) + driven[:, step]
    states[even] = state
    for place in range(even, len(drive)):
        states[place + 1] = transitions[place] @ states[place] + drive[place]
        whole = transitions[place] @ whole
    return states, whole


def rebuilt(samples: Samples, now: Predictor, modes: Sequence[Mode]) -> Predictor | None:
    """The predictor of other modes, those of now first; states that are new begin at zero."""
    size = sum(mode.rows for mode in modes)
    initial = np.zeros((len(samples.records), size))
    width = min(size, now.initial.shape[1])
    initial[:, :width] = now.initial[:, :width]
    return predicted(samples, modes, now.columns, initial, now.whitening)


def matrices(samples: Samples, modes: Sequence[Mode]) -> tuple[Floats, Floats, Floats, Floats]:
    """Λ (states, states), K (samples, states, channels), C (samples, channels, states), Bu (samples, states)."""
    count, size = samples.n_samples, sum(mode.rows for mode in modes)
    inputs, channels = len(samples.inputs), len(samples.values)
    # One product for all modes, of what turns with the period and coefficients, real parts and imaginary ones.
    turns = np.unique(np.concatenate([np.zeros(1), *(band for mode in modes for band in (mode.turns, mode.reach))]))
    gains, seen = (np.zeros((len(turns), *shape), complex) for shape in ((size, inputs + channels), (channels, size)))
    system, place = np.zeros((size, size)), 0
    for mode in modes:
        own = slice(place, place + mode.rows)
        system[own, own] = mode.transition(samples.step)
        gain, shape = _by_state(mode, mode.gains, -1j), _by_state(mode, mode.shape, 1j)
        gains[np.searchsorted(turns, mode.reach), own] = gain.transpose(2, 0, 1)
        seen[np.searchsorted(turns, mode.turns), :, own] = shape.transpose(2, 1, 0)
        place += mode.rows
    angle = turning(samples, turns)
    basis = np.concatenate([angle.real, -angle.imag]).T
    along, shapes = (
        (basis @ np.concatenate([part.real, part.imag]).reshape(len(basis[0]), -1)).reshape(count, *part.shape[1:])
        for part in (gains, seen)
    )
    return system, along[..., inputs:], shapes, np.einsum("kri,ik->kr", along[..., :inputs], samples.inputs)


def _by_state(mode: Mode, values: Complexes, second: complex) -> Complexes:
    """Gains or a shape of each real state (rows, signals, turns); that of a pair's second one is `second` times it."""
    if mode.real:
        return values.reshape(mode.rows, -1, values.shape[1])
    return np.array([values, second * values])


def turning(samples: Samples, turns: Floats) -> Complexes:
    """e^{imωt} of some harmonics (turns, samples)."""
    return np.array([samples.turned(turn) for turn in turns.tolist()]).reshape(len(turns), -1)


def scales_of(samples: Samples, matrices: tuple[Floats, Floats, Floats], innovations: Floats) -> Floats:
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


def _calm(samples: Samples, innovations: Floats) -> Floats:
    """The covariance of innovations far from gaps, of all where hardly any are."""
    used = samples.there.copy()
    for begin, end in samples.gaps:
        used[begin : end + LAGS] = False
    own = innovations[:, used if used.sum() > LAGS * len(innovations) else samples.there]
    return own @ own.T / own.shape[1]
