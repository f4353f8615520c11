r"""The least squares of modes with inputs: λ, b and the initial states, what is linear eliminated.

.. math:: \min \sum_c \frac{1}{\sigma_c^2} \sum_k \Big(y_c(t_k) - 2 \Re \sum_r \sum_m c_{r,m,c}\, e^{i m \omega t_k}
          z_r(t_k) - \sum_{i,n} D_{c,i,n}\, e^{i n \omega t_k} u_i(t_k) - \ldots\Big)^2

c, D and the offsets are linear, and the same columns serve all channels (Golub and Pereyra 1973; Kaufman 1975).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Complexes, Floats, Mask
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
from floquid.inputs._carried import Piece, carried, in_precision, of_all_channels
from floquid.inputs._modes import InputMode, directed, state_of
from floquid.inputs._samples import Samples
from floquid.inputs._slopes import slopes_in_parts

EXACT = 1e-5
"""The share of a channel's swing that its noise is taken to be at least: no instrument is better, no hold is exact."""


@dataclass(frozen=True, eq=False)
class Columns(Rebuilt):
    """The columns of a fit that are linear, formed of a part of the samples at a time."""

    samples: Samples
    # The modes with their states, and the harmonics of the direct term of each input, ascending (harmonics,)
    modes: tuple[InputMode, ...]
    states: tuple[NDArray, ...]
    direct: tuple[float, ...]

    @cached_property
    def count(self) -> int:
        """Columns: of each mode, of the direct term, and those known."""
        inputs = len(self.samples.inputs)
        of_direct = sum(inputs * (2 if turn > 0.0 else 1) for turn in self.direct)
        return (
            sum(mode.states * (len(mode.turns) + int(turning_of(mode).sum())) for mode in self.modes)
            + of_direct
            + len(self.samples.known)
        )

    def of(self, samples: Samples, own: slice) -> Floats:
        """Columns of a part of the samples (columns, samples): of each mode, of the direct term, and those known."""
        states = [state[..., own] for state in self.states]
        parts = [columns_of(samples, mode, state) for mode, state in zip(self.modes, states, strict=True)]
        parts += [samples.kept(_modulated(samples.turned(turn), samples.inputs, turn > 0.0)) for turn in self.direct]
        return np.concatenate([*parts, samples.known])

    def __iter__(self) -> Iterator[tuple[slice, Floats]]:
        """Parts of the samples, and the columns there (columns, samples)."""
        if self._all is not None:
            yield self._all
            return
        for own, part in self.samples.in_parts(4 * self.count):
            yield own, self.of(part, own)

    @cached_property
    def _all(self) -> tuple[slice, Floats] | None:
        """The columns of all samples where these make one part: they need not be formed again."""
        own = slice(0, self.samples.n_samples)
        return (own, self.of(self.samples, own)) if self.samples.parts(4 * self.count) == [[own]] else None

    def response(self, coefficients: Floats, own: slice = slice(None)) -> Floats:
        """The response by some of the columns (channels, samples) with coefficients of all (columns, channels)."""
        found = np.empty((coefficients.shape[1], self.samples.n_samples))
        for part, columns in self:
            found[:, part] = coefficients[own].T @ columns[own]
        return found


@dataclass(frozen=True, eq=False)
class Linearisation(Rebuilt):
    """The fit at some modes: what is linear, and what is left."""

    # The modes, and the harmonics of the direct term of each input, ascending (harmonics,)
    modes: tuple[InputMode, ...]
    direct: tuple[float, ...]
    states: tuple[NDArray, ...]  # The state of each mode
    columns: Columns  # The columns that are linear
    inverse: Floats  # The inverse of their Gram matrix (columns, columns)
    coefficients: Floats  # Those of each channel (columns, channels)
    left: Floats  # The residual (channels, samples)
    noise: Floats  # Its deviation (channels,)
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
    def heard(self) -> Mask:
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

    def slices(self) -> list[tuple[slice, Mask]]:
        """Place of the columns of each mode, and mask of its turns that have an imaginary part (turns,)."""
        found, place = [], 0
        for mode in self.modes:
            turning = turning_of(mode)
            stop = place + mode.states * (len(turning) + int(turning.sum()))
            found.append((slice(place, stop), turning))
            place = stop
        return found

    @cached_property
    def free(self) -> list[Mask]:
        """Masks of the parameters of each mode that are free."""
        return [mode.free for mode in self.modes]

    def shape(self, mode: int) -> Complexes:
        """2 c of a mode, of real states at turn zero c (turns, channels); of a block the second state's follow."""
        return self._shapes[mode]

    @cached_property
    def _shapes(self) -> list[Complexes]:
        return [self._shape(number) for number in range(len(self.modes))]

    def _shape(self, mode: int) -> Complexes:
        own, turning = self.slices()[mode]
        both = self.coefficients[own].reshape(self.modes[mode].states, -1, self.coefficients.shape[1])
        found = both[:, : len(turning)].astype(complex)
        found[:, turning] += 1j * both[:, len(turning) :]
        return found.reshape(-1, both.shape[-1])


def linearise(samples: Samples, modes: Sequence[InputMode], direct: Sequence[float] = ()) -> Linearisation:
    """The columns of these modes, the coefficients that fit them to the samples, and what is left."""
    columns = columns_at(samples, modes, direct)
    gram, seen = np.zeros((columns.count,) * 2), np.zeros((columns.count, len(samples.values)))
    for own, part in columns:
        gram += part @ part.T
        seen += part @ samples.values[:, own].T
    root = inverse_root(gram, ROUNDING)
    inverse, rank = root @ root.T, root.shape[1]
    coefficients, left = inverse @ seen, np.empty(samples.values.shape)
    again = np.zeros(seen.shape)
    for own, part in columns:
        left[:, own] = samples.values[:, own] - coefficients.T @ part
        again += part @ left[:, own].T
    # A second pass takes what rounding left.
    again = inverse @ again
    for own, part in columns:
        left[:, own] -= again.T @ part
    coefficients = coefficients + again
    noise = np.sqrt(np.sum(left**2, axis=1) / max(samples.count - rank, 1))
    least = max(samples.floor, ROUNDING) * np.abs(samples.values).max(axis=1)
    floor = np.maximum(EXACT * samples.swing, least) + np.finfo(float).tiny
    noise = np.maximum(noise, floor)
    count = samples.count
    modes, direct, states = columns.modes, columns.direct, columns.states
    return Linearisation(modes, direct, states, columns, inverse, coefficients, left, noise, rank, count)


def columns_at(samples: Samples, modes: Sequence[InputMode], direct: Sequence[float]) -> Columns:
    """The columns of modes and of harmonics of the direct term."""
    return Columns(samples, tuple(modes), tuple(state_of(samples, mode) for mode in modes), tuple(direct))


def columns_of(samples: Samples, mode: InputMode, state: NDArray) -> Floats:
    """Columns of a mode with this state: real parts at each turn, then the imaginary ones (columns, samples)."""
    # Of a block those of the second state follow.
    angles, turning = np.array([samples.turned(turn) for turn in mode.turns.tolist()]), turning_of(mode)
    turned = [angles * own for own in state.reshape(mode.states, -1)]
    return samples.kept(np.concatenate([part for own in turned for part in (own.real, -own.imag[turning])]))


def turning_of(mode: InputMode) -> Mask:
    """Mask of the turns of a mode that have an imaginary part (turns,)."""
    return np.ones(len(mode.turns), bool) if not mode.real else mode.turns > 0.0


def _modulated(turned: Complexes, inputs: Floats, turning: bool) -> Floats:
    both = turned * inputs
    return np.concatenate([both.real, -both.imag]) if turning else both.real


def slopes_of(
    samples: Samples, at: Linearisation, channel: int, states: Sequence[NDArray], weight: float = 1.0
) -> NDArray:
    """Derivatives of a channel's response by free parameters, c and D held (parameters, samples), times a weight."""
    masks = at.free
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


class Equations(NamedTuple):
    """Sums over the samples of products of the slopes, of all channels over their noise."""

    matrix: Floats  # Gauss-Newton matrix of the free parameters, c and D moving along
    gradient: Floats
    along: Floats  # slopes by columns (channels, parameters, columns)


def normal_equations(samples: Samples, at: Linearisation, *, rough: bool = False) -> Equations:
    """Gauss-Newton matrix and gradient of the free parameters, and what the columns take, over the noise."""
    # A rough one is made in single precision, slopes as multiples of about their size.
    sizes = [np.where(own > 0.0, own, 1.0) for own in sizes_of(samples, at)]
    each = [(own if len(own) == len(free) else np.tile(own, 2))[free] for free, own in zip(at.free, sizes, strict=True)]
    scale = np.concatenate([np.zeros(0), *each])
    of_columns = np.sqrt(np.einsum("kk->k", at.inverse))
    of_columns = np.where(of_columns > 0.0, of_columns, 1.0)  # of an input that is silent there is nothing
    number = np.float32 if rough else np.float64

    def pieces() -> Iterator[Piece]:
        for part in slopes_in_parts(samples, at.modes, at.states, numbers_of(at)):
            here = part.alone
            rows = [in_precision(own.T / size, number).T for own, size in zip(here.rows, sizes, strict=True)]
            columns = (at.columns.of(here.samples, part.own) * of_columns[:, None]).astype(number)
            yield Piece(here.samples, rows, columns, (at.left[:, part.own] / at.noise[:, None]).astype(number))

    # Slopes of each channel cost as many products as there are channels, and sums without them as two modes each.
    sums = of_all_channels if len(at.noise) > 2 * len(at.modes) > 0 else _by_channel
    matrix, gradient, along = sums(pieces(), at)
    inverse = at.inverse / np.outer(of_columns, of_columns)
    for taken in along:
        matrix -= taken @ inverse @ taken.T
    return Equations(matrix * np.outer(scale, scale), gradient * scale, along * scale[:, None] / of_columns)


def _by_channel(pieces: Iterator[Piece], at: Linearisation) -> tuple[Floats, Floats, Floats]:
    """Sums of products of slopes with one another, the residual and columns, from the slopes of each channel."""
    size = sum(int(own.sum()) for own in at.free)
    matrix, gradient = np.zeros((size, size)), np.zeros(size)
    along = np.zeros((len(at.noise), size, len(at.inverse)))
    for piece in pieces:
        for channel, taken in enumerate(along):
            slopes = slopes_of(piece.samples, at, channel, piece.rows, 1.0 / at.noise[channel])
            taken += slopes @ piece.columns.T
            matrix += slopes @ slopes.T
            gradient += slopes @ piece.left[channel]
    return matrix, gradient, along


def numbers_of(at: Linearisation) -> int:
    """Numbers of each sample that are held where slopes are formed."""
    return at.columns.count + 2 * sum(map(len, at.free))


def sizes_of(samples: Samples, at: Linearisation) -> list[Floats]:
    """About the size of each derivative of the state of each mode, zero of an input that is silent (parts,)."""
    found, period = [], 2.0 * np.pi / samples.fundamental
    for mode, state in zip(at.modes, at.states, strict=True):
        size = float(np.sqrt(np.mean(np.abs(state) ** 2)) + 1e-300)
        gains, begun = np.split(mode.strengths, [mode.gains.size])
        by_square = [] if mode.square is None else [period * size / max(abs(mode.exponent.real), 1e-300)]
        found.append(np.concatenate([[period * size], *[gains] * (2 if mode.real else 1), begun, by_square]))
    return found


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
        matrix, gradient, _ = normal_equations(samples, at, rough=rough)
        return Normal(matrix=matrix, gradient=gradient, given=scale_of(samples, at, matrix))

    def enough(at: Linearisation, gains: list[float]) -> bool:
        # The first steps may gain little: they are not yet the rate at which the cost falls.
        return len(gains) > 2 and not below < at.cost < below + (iterations - len(gains)) * gains[-1]

    steps = Steps(
        normal=normal,
        moved=lambda at, step: linearise(
            samples,
            [mode.moved(own).scaled() for mode, own in zip(at.modes, steps_of(at.modes, step), strict=True)],
            at.direct,
        ),
        limited=lambda at, step, _normal, _damping: _limited(at, step, period),
        enough=enough if below < np.inf else None,
    )
    return levenberg_marquardt(now, steps, Ends(steps=iterations, gain=at_rest))


def scale_of(samples: Samples, at: Linearisation, matrix: Floats) -> Floats:
    """The root of the diagonal of a matrix of products; of what is rounding, that of rounding (parameters,)."""
    # Parameters are compared by what they do to the state over its own size: inputs have units of their own.
    units = []
    for mode, state, own in zip(at.modes, at.states, sizes_of(samples, at), strict=True):
        both = own / (np.sqrt(np.mean(np.abs(state) ** 2)) + 1e-300)
        units.append((both if mode.real else np.tile(both, 2))[mode.free])
    weights = np.concatenate([np.zeros(0), *units])
    weights[weights == 0.0] = 1.0  # of an input that is silent
    own = np.diag(matrix) / weights**2
    return np.sqrt(np.maximum(own, ROUNDING * own.max(initial=0.0) + 1e-300)) * weights


def steps_of(modes: Sequence[InputMode], step: Floats) -> list[Floats]:
    """A step of the free parameters as one of all parameters of each of the `modes`."""
    steps, place = [], 0
    for mode in modes:
        own = np.zeros(len(mode.free))
        own[mode.free] = step[place : place + int(mode.free.sum())]
        place += int(mode.free.sum())
        steps.append(own)
    return steps


def _limited(at: Linearisation, step: Floats, period: float) -> Floats:
    """A step on which no exponent moves further than `LONGEST_STEP`."""
    longest = max(
        mode.distance(own, LONGEST_STEP / period) * period
        for mode, own in zip(at.modes, steps_of(at.modes, step), strict=True)
    )
    return step * min(1.0, LONGEST_STEP / max(longest, 1e-300))


def covariance(samples: Samples, at: Linearisation) -> Floats:
    """Covariance of the free parameters (parameters, parameters); what the record says nothing of is infinite."""
    return covariance_of(samples, at, normal_equations(samples, at).matrix)


def covariance_of(samples: Samples, at: Linearisation, matrix: Floats) -> Floats:
    """Covariance of the free parameters by their Gauss-Newton matrix (parameters, parameters)."""
    return scaled_inverse(matrix, floor=True, scale=scale_of(samples, at, matrix))
