r"""The least squares of modes with inputs: λ, b and the initial states, what is linear eliminated.

.. math:: \min \sum_c \frac{1}{\sigma_c^2} \sum_k \Big(y_c(t_k) - 2 \Re \sum_r \sum_m c_{r,m,c}\, e^{i m \omega t_k}
          z_r(t_k) - \sum_{i,n} D_{c,i,n}\, e^{i n \omega t_k} u_i(t_k) - \ldots\Big)^2

c, D and the offsets are linear, and the same columns serve all channels (Golub and Pereyra 1973; Kaufman 1975).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from floquid._checks import Rebuilt
from floquid.fit import (
    AT_REST,
    LAGS,
    LONGEST_STEP,
    ROUNDING,
    STEPS,
    Ends,
    Normal,
    Steps,
    inverse_root,
    levenberg_marquardt,
    scaled_inverse,
    schwarz,
)
from floquid.inputs._modes import InputMode, directed, slopes_of_state, state_of
from floquid.inputs._samples import Samples

EXACT = 1e-5
"""The share of a channel's swing that its noise is taken to be at least: no instrument is better, no hold is exact."""


@dataclass(frozen=True, slots=True, eq=False)
class Linearisation(Rebuilt):
    """The fit at some modes: what is linear, what is left, and the slopes by the parameters."""

    # The modes, and the harmonics of the direct term of each input, ascending (harmonics,)
    modes: tuple[InputMode, ...]
    direct: tuple[float, ...]
    states: tuple[NDArray, ...]  # The state of each mode
    # The columns that are linear (columns, samples): of each mode, of the direct term, and those known
    columns: NDArray[np.float64]
    inverse: NDArray[np.float64]  # The inverse of their Gram matrix (columns, columns)
    coefficients: NDArray[np.float64]  # Those of each channel (columns, channels)
    left: NDArray[np.float64]  # The residual (channels, samples)
    noise: NDArray[np.float64]  # Its deviation (channels,)
    rank: int  # Directions that the columns span: one that is a sum of others, or nothing, takes no noise
    count: int  # Samples that were measured; at others the columns and the residual are zero

    @property
    def log_likelihood(self) -> float:
        """Twice the logarithm of the likelihood at its own noise, up to a constant."""
        count, squares = self.count, np.sum(self.left**2, axis=1) / self.count
        held = self.noise**2 * max(count - self.rank, 1) / count
        return -float(count * np.sum(np.log(held) + squares / held - 1.0))

    @property
    def n_parameters(self) -> int:
        """Real numbers that the fit chooses."""
        return int(sum(mode.free.sum() for mode in self.modes)) + self.coefficients.size

    @property
    def heard(self) -> NDArray[np.bool_]:
        """Mask of channels whose residual is noise: below the least noise it has the colour of rounding."""
        return np.sum(self.left**2, axis=1) / self.count > 0.5 * self.noise**2

    @property
    def colour(self) -> float:
        """The sum of squared correlations of what is left, of the channel that has most (Box and Pierce 1970)."""
        spectrum = np.abs(np.fft.rfft(self.left, 2 * self.left.shape[1], axis=1)) ** 2
        lags = np.fft.irfft(spectrum, axis=1)[:, : LAGS + 1]
        return float(np.max(np.sum((lags[:, 1:] / lags[:, :1]) ** 2, axis=1)[self.heard], initial=0.0))

    @property
    def cost(self) -> float:
        """Minus twice the logarithm of the likelihood, which steps make least."""
        return -self.log_likelihood

    @property
    def criterion(self) -> float:
        """The criterion of Schwarz (1978): more is better."""
        return schwarz(self.log_likelihood, self.n_parameters, self.count)

    def slices(self) -> list[tuple[slice, NDArray[np.bool_]]]:
        """Place of the columns of each mode, and mask of its turns that have an imaginary part (turns,)."""
        found, place = [], 0
        for mode in self.modes:
            turning = np.ones(len(mode.turns), bool) if not mode.real else mode.turns > 0.0
            stop = place + mode.states * (len(turning) + int(turning.sum()))
            found.append((slice(place, stop), turning))
            place = stop
        return found

    def shape(self, mode: int) -> NDArray[np.complex128]:
        """2 c of a mode, of real states at turn zero c (turns, channels); of a block the second state's follow."""
        own, turning = self.slices()[mode]
        both = self.coefficients[own].reshape(self.modes[mode].states, -1, self.coefficients.shape[1])
        found = both[:, : len(turning)].astype(complex)
        found[:, turning] += 1j * both[:, len(turning) :]
        return found.reshape(-1, both.shape[-1])


def linearise(samples: Samples, modes: Sequence[InputMode], direct: Sequence[float] = ()) -> Linearisation:
    """The columns of these modes, the coefficients that fit them to the samples, and what is left."""
    states = tuple(state_of(samples, mode) for mode in modes)
    parts = [columns_of(samples, mode, own) for mode, own in zip(modes, states, strict=True)]
    parts += [samples.kept(_modulated(samples.turned(turn), samples.inputs, turn > 0.0)) for turn in direct]
    columns = np.concatenate([*parts, samples.known])
    root = inverse_root(columns @ columns.T, ROUNDING)
    inverse, rank = root @ root.T, root.shape[1]
    coefficients = inverse @ (columns @ samples.values.T)
    left = samples.values - coefficients.T @ columns
    # A second pass takes what rounding left.
    again = inverse @ (columns @ left.T)
    coefficients, left = coefficients + again, left - again.T @ columns
    noise = np.sqrt(np.sum(left**2, axis=1) / max(samples.count - rank, 1))
    least = max(samples.floor, ROUNDING) * np.abs(samples.values).max(axis=1)
    floor = np.maximum(EXACT * samples.swing, least) + np.finfo(float).tiny
    noise = np.maximum(noise, floor)
    count = samples.count
    return Linearisation(tuple(modes), tuple(direct), states, columns, inverse, coefficients, left, noise, rank, count)


def columns_of(samples: Samples, mode: InputMode, state: NDArray) -> NDArray[np.float64]:
    """Columns of a mode with this state: real parts at each turn, then the imaginary ones (columns, samples)."""
    # Of a block those of the second state follow.
    angles = np.array([samples.turned(turn) for turn in mode.turns.tolist()])
    turning = np.ones(len(mode.turns), bool) if not mode.real else mode.turns > 0.0
    turned = [angles * own for own in state.reshape(mode.states, -1)]
    return samples.kept(np.concatenate([part for own in turned for part in (own.real, -own.imag[turning])]))


def _modulated(turned: NDArray[np.complex128], inputs: NDArray[np.float64], turning: bool) -> NDArray[np.float64]:
    both = turned * inputs
    return np.concatenate([both.real, -both.imag]) if turning else both.real


def state_slopes(samples: Samples, at: Linearisation) -> list[NDArray]:
    """Derivatives of the state of each mode by its parameters (parts, samples), complex parts once."""
    return [slopes_of_state(samples, mode, own) for mode, own in zip(at.modes, at.states, strict=True)]


def carried(samples: Samples, shape: NDArray[np.complex128], turns: Sequence[float]) -> NDArray[np.complex128]:
    """The shape of a mode over the samples: amplitudes (…, turns) at harmonics (…, samples)."""
    return samples.kept(shape @ np.array([samples.turned(turn) for turn in turns]))


def slopes_of(
    samples: Samples, at: Linearisation, channel: int, states: Sequence[NDArray], weight: float = 1.0
) -> NDArray:
    """Derivatives of a channel's response by the free parameters, c and D held (parameters, samples), times a weight.

    Of the precision that the derivatives of the states have.
    """
    masks = [mode.free for mode in at.modes]
    precision = np.float32 if all(own.dtype in (np.float32, np.complex64) for own in states) else np.float64
    found, place = np.empty((sum(int(own.sum()) for own in masks), samples.n_samples), precision), 0
    for number, (mode, slopes, free) in enumerate(zip(at.modes, states, masks, strict=True)):
        shape = at.shape(number)[:, channel].reshape(mode.states, -1)
        whole = (weight * carried(samples, shape, mode.turns.tolist())).astype(np.result_type(precision, 1j))
        moved = whole * slopes.reshape(len(slopes), mode.states, -1)
        moved = moved[:, 0] if mode.states == 1 else moved.sum(axis=1)
        halves = (
            [(moved.real, free)] if mode.real else [(moved.real, free[: len(moved)]), (-moved.imag, free[len(moved) :])]
        )
        for part, own in halves:
            stop = place + int(own.sum())
            np.compress(own, part, axis=0, out=found[place:stop])
            place = stop
    return found


def normal_equations(
    samples: Samples, at: Linearisation, *, rough: bool = False
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Gauss-Newton matrix and gradient of the free parameters, of all channels over their noise."""
    # A rough one is made in single precision, slopes as multiples of their size.
    states, columns, left = state_slopes(samples, at), at.columns, at.left / at.noise[:, None]
    sizes = [np.sqrt(np.mean(np.abs(own.reshape(len(own), -1)) ** 2, axis=1)) + 1e-300 for own in states]
    scale = np.concatenate(
        [(own if mode.real else np.tile(own, 2))[mode.free] for mode, own in zip(at.modes, sizes, strict=True)]
    )
    of_columns = np.sqrt(np.einsum("kk->k", at.inverse))
    of_columns = np.where(of_columns > 0.0, of_columns, 1.0)  # of an input that is silent there is nothing
    number = np.float32 if rough else np.float64
    states = [
        (own.T / size).T.astype(np.result_type(number, 1j) if np.iscomplexobj(own) else number)
        for own, size in zip(states, sizes, strict=True)
    ]
    columns = (columns * of_columns[:, None]).astype(number)
    inverse = at.inverse / np.outer(of_columns, of_columns)
    matrix, gradient = np.zeros((len(scale), len(scale))), np.zeros(len(scale))
    for channel in range(len(samples.values)):
        slopes = slopes_of(samples, at, channel, states, 1.0 / at.noise[channel])
        along = (slopes @ columns.T).astype(float)
        matrix += slopes @ slopes.T - along @ inverse @ along.T
        gradient += slopes @ left[channel].astype(number)
    return matrix * np.outer(scale, scale), gradient * scale


def solve(
    samples: Samples,
    modes: Sequence[InputMode],
    direct: Sequence[float] = (),
    *,
    iterations: int = STEPS,
    at_rest: float = AT_REST,
    rough: bool = False,
    below: float = np.inf,
) -> Linearisation:
    """The least squares near these modes: Levenberg-Marquardt, until a step gains less than `at_rest`.

    Rough steps are made in single precision. A fit ends where its cost is `below` a value, or will not come there.
    """
    now = linearise(samples, [directed(samples, mode).scaled() for mode in modes], direct)
    period = 2.0 * np.pi / samples.fundamental
    if not modes:
        return now

    def normal(at: Linearisation) -> Normal:
        matrix, gradient = normal_equations(samples, at, rough=rough)
        return Normal(matrix=matrix, gradient=gradient, given=scale_of(samples, at, matrix))

    def enough(at: Linearisation, gains: list[float]) -> bool:
        # The first steps may gain little: they are not yet the rate at which the cost falls.
        return len(gains) > 2 and not below < at.cost < below + (iterations - len(gains)) * gains[-1]

    steps = Steps(
        normal=normal,
        moved=lambda at, step: linearise(
            samples, [mode.moved(own).scaled() for mode, own in zip(at.modes, _parts(at, step), strict=True)], at.direct
        ),
        limited=lambda at, step, _normal, _damping: _limited(at, step, period),
        enough=enough if below < np.inf else None,
    )
    return levenberg_marquardt(now, steps, Ends(steps=iterations, gain=at_rest))


def scale_of(samples: Samples, at: Linearisation, matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """The root of the diagonal of a matrix of products; of what is rounding, that of rounding (parameters,)."""
    # Parameters are compared by what they do to the state over its own size: inputs have units of their own.
    units = []
    for mode, state in zip(at.modes, at.states, strict=True):
        own, gains = mode.strengths / np.sqrt(np.mean(np.abs(state) ** 2) + 1e-300), mode.gains.size
        period = 2.0 * np.pi / samples.fundamental
        own = np.concatenate([[period], own])
        both = np.concatenate([own[: 1 + gains], own[1:]]) if mode.real else np.tile(own, 2)
        both = both if mode.square is None else np.append(both, period / max(abs(mode.exponent.real), 1e-300))
        units.append(both[mode.free])
    weights = np.concatenate([np.zeros(0), *units])
    weights[weights == 0.0] = 1.0  # of an input that is silent
    own = np.diag(matrix) / weights**2
    return np.sqrt(np.maximum(own, ROUNDING * own.max(initial=0.0) + 1e-300)) * weights


def _parts(at: Linearisation, step: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """A step of the free parameters as one of all parameters of each mode."""
    steps, place = [], 0
    for mode in at.modes:
        own = np.zeros(len(mode.free))
        own[mode.free] = step[place : place + int(mode.free.sum())]
        place += int(mode.free.sum())
        steps.append(own)
    return steps


def _limited(at: Linearisation, step: NDArray[np.float64], period: float) -> NDArray[np.float64]:
    """A step on which no exponent moves further than `LONGEST_STEP`."""
    longest = max(
        mode.distance(own, LONGEST_STEP / period) * period for mode, own in zip(at.modes, _parts(at, step), strict=True)
    )
    return step * min(1.0, LONGEST_STEP / max(longest, 1e-300))


def covariance(samples: Samples, at: Linearisation) -> NDArray[np.float64]:
    """Covariance of the free parameters (parameters, parameters); what the record says nothing of is infinite."""
    matrix, _ = normal_equations(samples, at)
    return scaled_inverse(matrix, floor=True, scale=scale_of(samples, at, matrix))
