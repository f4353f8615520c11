r"""Matrices at each phase, all of them free, for few samples a period: harmonics then go on to the Nyquist frequency.

.. math:: x_{k+1} = A_j x_k + B_j u_k, \qquad y_k = C_j x_k + D_j u_k + e_k, \qquad j = k \bmod P

Each phase has a basis of its own: P n² directions of the parameters change nothing (Verhaegen and Yu 1995).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from floquid._checks import Rebuilt
from floquid.fit import CHUNK, FEW_STEPS, REST, ROUNDING, Ends, Normal, Steps, levenberg_marquardt
from floquid.inputs._samples import LEAKAGE, Samples


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Phases(Rebuilt):
    """A discrete periodic system by its matrices at each phase, and its fit to samples.

    Parameters
    ----------
    at
        The phase j of each sample (samples,).
    system, reached
        A (phases, states, states) and B (phases, states, inputs).
    seen, direct
        C (phases, channels, states) and D (phases, channels, inputs), zero if `acting` is false.
    initial, known
        The first state of each record (records, states), and the coefficients of the known columns (channels, columns).
    acting
        True where D is free.
    """

    at: NDArray[np.int64]
    system: NDArray[np.float64]
    reached: NDArray[np.float64]
    seen: NDArray[np.float64]
    direct: NDArray[np.float64]
    initial: NDArray[np.float64]
    known: NDArray[np.float64]
    acting: bool

    @property
    def parts(self) -> tuple[NDArray[np.float64], ...]:
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

    def moved(self, step: NDArray[np.float64]) -> Phases:
        """With all parameters moved by a step (parameters,)."""
        new = [
            own + step[a:b].reshape(own.shape) for own, (a, b) in zip(self.parts, pairwise(self.starts), strict=True)
        ]
        names = ("system", "reached", "seen", "direct", "initial", "known")
        rest = {"at": self.at, "acting": self.acting}
        return Phases(**dict(zip(names, new, strict=True)), **rest)


def phases_of(samples: Samples) -> NDArray[np.int64] | None:
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


def response_of(samples: Samples, own: Phases) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
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


def likelihood(samples: Samples, left: NDArray[np.float64]) -> float:
    """Twice the logarithm of the likelihood of a residual (channels, samples) at its own noise, up to a constant."""
    if not np.isfinite(left).all():
        return -np.inf
    return -float(samples.count * np.sum(np.log(np.sum(left**2, axis=1) / samples.count + 1e-300)))


def normal_equations(
    samples: Samples, own: Phases, states: NDArray[np.float64], left: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
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
    states: NDArray[np.float64]
    left: NDArray[np.float64]
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
