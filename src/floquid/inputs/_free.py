r"""Matrices at each phase, all of them free, and their Floquet modes: harmonics go on to the Nyquist frequency.

.. math:: x_{k+1} = A_j x_k + B_j u_k, \qquad y_k = C_j x_k + D_j u_k + e_k, \qquad j = k \bmod P

Each phase has a basis of its own: P n² directions of the parameters change nothing (Verhaegen and Yu 1995).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Complexes, Floats, Integers
from floquid._checks import Rebuilt
from floquid.fit import (
    CHUNK,
    FEW_STEPS,
    IN_VAIN,
    LAGS,
    REST,
    ROUNDING,
    Ends,
    Normal,
    Steps,
    levenberg_marquardt,
    scaled_inverse,
    schwarz,
)
from floquid.inputs._modes import InputMode, input_gain
from floquid.inputs._samples import LEAKAGE, Samples
from floquid.inputs._solver import Linearisation, solve
from floquid.inputs._start import MOST_ROWS, bare_mode


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Phases(Rebuilt):
    """A discrete periodic system by its matrices at each phase, and its fit to samples."""

    at: Integers  # The phase j of each sample (samples,)
    system: Floats  # A (phases, states, states)
    reached: Floats  # B (phases, states, inputs)
    # C (phases, channels, states) and D (phases, channels, inputs), zero if `acting` is false
    seen: Floats
    direct: Floats
    # The first state of each record (records, states), and the coefficients of the known columns (channels, columns)
    initial: Floats
    known: Floats
    acting: bool  # True where D is free

    @property
    def parts(self) -> tuple[Floats, ...]:
        """All parameters, in the order in which derivatives are."""
        return (self.system, self.reached, self.seen, self.direct, self.initial, self.known)

    @property
    def starts(self) -> list[int]:
        """The place of each of the parts among all parameters, and the number of all."""
        return np.cumsum([0, *(own.size for own in self.parts)]).tolist()

    @property
    def n_parameters(self) -> int:
        """Real numbers that are free: bases are none."""
        return self.starts[-1] - self.system.size - (0 if self.acting else self.direct.size)

    def moved(self, step: Floats) -> Phases:
        """With all parameters moved by a step (parameters,)."""
        new = [
            own + step[a:b].reshape(own.shape) for own, (a, b) in zip(self.parts, pairwise(self.starts), strict=True)
        ]
        names = ("system", "reached", "seen", "direct", "initial", "known")
        rest = {"at": self.at, "acting": self.acting}
        return Phases(**dict(zip(names, new, strict=True)), **rest)


def phases_of(samples: Samples) -> Integers | None:
    """The phase of each sample (samples,), zero at the first; None where samples do not meet the same ones again."""
    turned = (samples.times - samples.times[0]) / samples.step
    count = 2.0 * np.pi / (samples.fundamental * samples.step)
    if (
        count < 2.0
        or abs(count - round(count)) * turned.max() / count > LEAKAGE
        or np.abs(turned - np.rint(turned)).max() > LEAKAGE
    ):
        return None
    return np.rint(turned).astype(np.int64) % round(count)


def response_of(samples: Samples, own: Phases) -> tuple[Floats, Floats]:
    """States (samples, states) and the residual (channels, samples)."""
    states = np.empty((samples.n_samples, own.system.shape[1]))
    driven = np.einsum("kni,ik->kn", own.reached[own.at], samples.inputs)
    with np.errstate(over="ignore", invalid="ignore"):
        for state, record in zip(own.initial, samples.records, strict=True):
            for now, j, more in zip(states[record], own.at[record].tolist(), driven[record], strict=True):
                now[:] = state
                state = own.system[j] @ state + more
        fitted = np.einsum("kcn,kn->ck", own.seen[own.at], states) + own.known @ samples.known
    acting = np.einsum("kci,ik->ck", own.direct[own.at], samples.inputs)
    return states, samples.kept(samples.values - fitted - acting)


def likelihood(samples: Samples, left: Floats) -> float:
    """Twice the logarithm of the likelihood of a residual (channels, samples) at its own noise, up to a constant."""
    with np.errstate(over="ignore", invalid="ignore"):  # of what grows beyond all bounds, which is as unlikely
        squares = np.sum(left**2, axis=1)
    if not np.isfinite(squares).all():
        return -np.inf
    return -float(samples.count * np.sum(np.log(squares / samples.count + 1e-300)))


def normal_equations(samples: Samples, own: Phases, states: Floats, left: Floats) -> tuple[Floats, Floats]:
    """Gauss-Newton matrix and gradient of all parameters, of all channels over their noise."""
    n, width, channels = states.shape[1], own.starts[-1], len(left)
    of_system, of_inputs, of_seen, of_direct, of_initial, of_known, _ = own.starts
    weights = 1.0 / (np.sqrt(np.sum(left**2, axis=1) / samples.count) + 1e-300)
    matrix, gradient = np.zeros((width, width)), np.zeros(width)
    slopes = np.empty((CHUNK + 1, n, width))
    lines = np.arange(n)
    for number, record in enumerate(samples.records):
        slopes[0] = 0.0
        slopes[0, lines, of_initial + number * n + lines] = 1.0
        for begin in range(record.start, record.stop, CHUNK):
            part = slice(begin, min(begin + CHUNK, record.stop))
            count, at, inputs = part.stop - part.start, own.at[part], samples.inputs[:, part].T
            forced, rows = slopes[1 : count + 1], np.arange(count)[:, None, None]
            forced[:] = 0.0
            for first, signals in ((of_system, states[part]), (of_inputs, inputs)):
                many = signals.shape[1]
                place = first + (at[:, None, None] * n + lines[:, None]) * many + np.arange(many)
                forced[rows, lines[:, None], place] = signals[:, None]
            for before, after, j in zip(slopes[:count], forced, at.tolist(), strict=True):
                after += own.system[j] @ before
            found, each = own.seen[at] @ slopes[:count], np.arange(channels)[:, None]
            for first, signals in ((of_seen, states[part]), (of_direct, inputs if own.acting else inputs[:, :0])):
                many = signals.shape[1]
                place = first + (at[:, None, None] * channels + each) * many + np.arange(many)
                found[rows, each, place] += signals[:, None]
            columns = samples.known[:, part].T
            found[rows, each, of_known + each * columns.shape[1] + np.arange(columns.shape[1])] += columns[:, None]
            flat = (found * (weights * samples.there[part, None])[..., None]).reshape(-1, width)
            matrix += flat.T @ flat
            gradient += flat.T @ (left[:, part] * weights[:, None]).T.ravel()
            slopes[0] = slopes[count]
    return matrix, gradient


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """Matrices with the states (samples, states) and the residual (channels, samples) of their response."""

    phases: Phases
    states: Floats
    left: Floats
    cost: float

    @staticmethod
    def of(samples: Samples, own: Phases) -> _Fit:
        states, left = response_of(samples, own)
        return _Fit(own, states, left, -likelihood(samples, left))


def polished(samples: Samples, own: Phases, steps: int = FEW_STEPS) -> tuple[Phases, float]:
    """The least squares near some matrices, with twice the logarithm of its likelihood (Levenberg-Marquardt)."""

    def normal(at: _Fit) -> Normal:
        matrix, gradient = normal_equations(samples, at.phases, at.states, at.left)
        size = np.diag(matrix)
        scale = np.sqrt(np.where(size > ROUNDING**2 * size.max(), size, np.inf))
        return Normal(matrix=matrix, gradient=gradient, given=scale, least=ROUNDING)

    found = _Fit.of(samples, own)
    if np.isfinite(found.cost):
        of = Steps(normal=normal, moved=lambda at, step: _Fit.of(samples, at.phases.moved(step)))
        found = levenberg_marquardt(found, of, Ends(steps=steps, gain=REST))
    return found.phases, -found.cost


def fitted_freely(samples: Samples, order: int | None = None) -> Linearisation | None:
    """The modes of matrices free at each phase, of the best order by the criterion of Schwarz (1978); None without."""
    at = phases_of(samples)
    if at is None or samples.hold == "first":
        return None
    bases, found, worse = _observability(samples, at), [], 0
    most = min((len(own) for own in bases), default=0) - len(samples.values)
    for number in range(order or 1, min(order or most, most) + 1):
        starts = [_started(samples, at, bases, number, acting) for acting in (False, True)]
        if starts[0].starts[-1] > CHUNK or worse == IN_VAIN:
            break
        trials = [(_criterion(samples, own, likelihood(samples, response_of(samples, own)[1])), own) for own in starts]
        best = min((one for one, _ in found), default=np.inf)
        found.append(min(trials, key=lambda one: one[0]))
        worse = 0 if found[-1][0] < best else worse + 1
    # A start is near the least squares, not there: the order below may be as good as the best.
    first = int(np.argmin([one for one, _ in found])) if found else 0
    done = [polished(samples, own) for _, own in found[max(first - 1, 0) : first + 1]]
    if not done:
        return None
    best, gain = min(done, key=lambda one: _criterion(samples, *one))
    return _as_modes(samples, best) if np.isfinite(gain) else None


def _criterion(samples: Samples, own: Phases, gain: float) -> float:
    return -schwarz(gain, own.n_parameters, samples.count)


def _observability(samples: Samples, at: Integers) -> list[Floats]:
    """Left singular vectors times the roots of the values, of what the past does to the future, at each phase.

    A column is a period: the past inputs and outputs are instruments (Verhaegen and Yu 1995, past outputs MOESP).
    Empty where there are too few periods.
    """
    values = samples.bridged(samples.values)
    signals = np.concatenate([samples.inputs, values - values.mean(axis=1, keepdims=True)])
    signals /= np.maximum(signals.std(axis=1, keepdims=True), 1e-300)
    count, phases = len(signals), int(at.max()) + 1
    periods = samples.n_samples / phases
    depth = min(int(0.5 * MOST_ROWS * periods / count), LAGS)
    found = []
    for phase in range(phases if depth > 1 else 0):
        begins = [np.flatnonzero(at[own] == phase) + own.start for own in samples.stretches]
        inside = [
            one[(one >= own.start + depth) & (one + depth <= own.stop)]
            for one, own in zip(begins, samples.stretches, strict=True)
        ]
        lags = np.concatenate(inside)[:, None] + np.arange(-depth, depth)
        block = signals[:, lags]  # (signals, periods, lags)
        inputs = len(samples.inputs)
        future, past = block[:, :, depth:], block[:, :, :depth]
        rows = [np.moveaxis(one, 2, 0).reshape(-1, len(lags)) for one in (future[:inputs], past, future[inputs:])]
        lower = np.asarray(np.linalg.qr(np.concatenate(rows).T, mode="r")).T
        first = len(rows[0])
        last = first + len(rows[1])
        left, values, _ = np.linalg.svd(lower[last:, first:last], full_matrices=False)
        found.append(left * np.sqrt(values))
    return found


def _started(samples: Samples, at: Integers, bases: list[Floats], order: int, acting: bool) -> Phases:
    """Matrices of an order: A and C by shifts of the bases of each phase and the next, the rest by least squares."""
    channels, inputs, phases = len(samples.values), len(samples.inputs), len(bases)
    cut = [own[:, :order] for own in bases]
    system = np.array(
        [
            np.linalg.lstsq(after[:-channels], before[channels:], rcond=None)[0]
            for before, after in zip(cut, [*cut[1:], cut[0]], strict=True)
        ]
    )
    whole = np.eye(order)
    for own in system:
        whole = own @ whole
    growth = np.abs(np.linalg.eigvals(whole)).max() ** (1.0 / phases)
    start = Phases(
        at=at,
        system=np.asarray(system * min(1.0, 1.0 / growth), np.float64),
        reached=np.zeros((phases, order, inputs)),
        seen=np.array([own[:channels] for own in cut]) * samples.values.std(axis=1)[:, None],
        direct=np.zeros((phases, channels, inputs)),
        initial=np.zeros((len(samples.records), order)),
        known=np.zeros((channels, len(samples.known))),
        acting=acting,
    )
    # All but A and C is linear: the first step from nothing is the least squares.
    matrix, gradient = normal_equations(samples, start, *response_of(samples, start))
    _, of_inputs, of_seen, of_direct, *_ = start.starts
    free = np.r_[of_inputs:of_seen, of_direct : start.starts[-1]]
    step = np.zeros(start.starts[-1])
    step[free] = scaled_inverse(matrix[np.ix_(free, free)], ROUNDING) @ gradient[free]
    return start.moved(step)


def _as_modes(samples: Samples, own: Phases) -> Linearisation:
    """The fit of the Floquet modes of some matrices, with as many harmonics as there are phases."""
    phases, order, _ = own.reached.shape
    whole = np.eye(order)
    for matrix in own.system:
        whole = matrix @ whole
    multipliers, vectors = (np.asarray(own, np.complex128) for own in np.linalg.eig(whole))
    upper = np.flatnonzero(multipliers.imag >= 0.0)
    logs = np.log(np.maximum(np.abs(multipliers), ROUNDING)) + 1j * np.angle(multipliers) * (multipliers.imag != 0.0)
    shapes = np.array([_along(own.system, one, start) for one, start in zip(logs / phases, vectors.T, strict=True)])
    turns = np.arange(-((phases - 1) // 2), phases // 2 + 1.0)
    times = samples.times[0] + samples.step * np.arange(phases)
    # Each pair on the branch on which its zeroth harmonic is seen most.
    size = samples.values.std(axis=1)
    angles = np.exp(1j * samples.fundamental * np.outer(turns, times))
    for number in upper[multipliers[upper].imag > 0.0].tolist():
        seen = np.einsum("jcn,jn->jc", own.seen, shapes[number, :-1]) / size
        best = turns[np.argmax(np.sum(np.abs(angles.conj() @ seen) ** 2, axis=1))]
        turned = np.exp(-1j * best * samples.fundamental * np.append(times, times[0]))
        shapes[number] *= turned[:, None]
        logs[number] += 2j * np.pi * best
    for number in np.flatnonzero(multipliers.imag < 0.0).tolist():
        shapes[number] = shapes[number - 1].conj()  # the first of a pair comes first
    # Left vectors: the rows of the inverse (phases + 1, modes, states).
    left = np.asarray(np.linalg.inv(np.moveaxis(shapes, 0, 2)), np.complex128)
    driven = np.asarray(np.einsum("jrn,jni->jri", left[1:], own.reached), np.complex128)
    modes = [
        _mode(samples, own, complex(multipliers[k]), complex(logs[k]), driven[:, k], left[:-1, k], times)
        for k in upper.tolist()
    ]
    direct = tuple(np.arange(phases // 2 + 1.0).tolist()) if own.acting else ()
    return solve(samples, modes, direct)


def _along(system: Floats, rate: complex, start: NDArray) -> Complexes:
    """A Floquet vector at each phase and at the first one again, its growth taken off (phases + 1, states)."""
    found = [start.astype(complex)]
    for matrix in system:
        found.append(matrix @ found[-1] * np.exp(-rate))
    return np.array(found)


def _mode(
    samples: Samples, own: Phases, multiplier: complex, log: complex, driven: Complexes, left: Complexes, times: Floats
) -> InputMode:
    """One mode by what the inputs add to its state at each phase (phases, inputs), and its left vectors there."""
    phases, omega = len(times), samples.fundamental
    real = multiplier.imag == 0.0
    if real:
        turns = np.arange(0.5 if multiplier.real < 0.0 else 0.0, 0.5 * phases + 0.25)
    else:
        turns = np.arange(-((phases - 1) // 2), phases // 2 + 1.0)
    exponent = log / (phases * samples.step)
    bare = bare_mode(samples, exponent, turns, turns, real=real)
    share = np.where(real & (turns > 0.0) & (turns < 0.5 * phases), 2.0, 1.0) / phases
    lines = share[:, None] * (np.exp(-1j * omega * np.outer(turns, times)) @ driven)
    adds = np.array([input_gain(exponent, turn, omega, samples.step, samples.hold)[0] for turn in turns.tolist()])
    # Of half harmonics the sign may be that of another period: the first states are linear, one step mends it.
    initial = [left[own.at[begin]] @ state for state, begin in zip(own.initial, samples.begins[:-1], strict=True)]
    return replace(bare, gains=(lines / adds[:, None]).T, initial=np.array(initial)).scaled()
