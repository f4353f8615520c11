"""Maximum likelihood of the innovations form by Gauss and Newton's steps, one linearisation for step and tests.

A long record has its derivatives at samples here and there, carried from each to the next at once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from itertools import pairwise
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import BLOCK, Floats, Integers, Mask
from floquid.fit import (
    AT_REST,
    FEW_STEPS,
    IN_VAIN,
    LONGEST_STEP,
    RARE,
    REST,
    ROUNDING,
    ROUNDS,
    STEPS,
    Ends,
    Normal,
    Steps,
    chi2_limit,
    levenberg_marquardt,
    scaled_inverse,
)
from floquid.innovations._autoregression import MOST
from floquid.innovations._derivatives import forces, gradient, held_signals, slopes, width_of
from floquid.innovations._mode import Mode
from floquid.innovations._predictor import MEMORY, Predictor, matrices, numbers_of, predicted
from floquid.inputs import Samples

OF_STEPS = 2.0 * MOST
"""Parameters over rows of a matrix that makes steps alone: what chance moves secants mend."""


def thinned(samples: Samples, at: Predictor, stride: int) -> Iterator[tuple[Integers, Floats]]:
    r"""Samples, one of some `stride`, and the derivatives of white innovations there, in parts.

    .. math:: \partial s_{k+n} = \Phi_{k+n,k}\, \partial s_k + \sum_{j=k}^{k+n-1} \Phi_{k+n,j+1} f_j

    f_j, which a parameter adds to the state after a sample, is made of few signals: they serve for all states at once.
    Derivatives (samples, channels, parameters) are weighed by the root of n: their squares add up to what those of all
    samples are in the mean.
    """
    size, width, channels = at.initial.shape[1], width_of(at), len(samples.values)
    # Distances vary by chance, the same each time: at even ones a line may stand still from each to the next.
    generator, near = np.random.default_rng(0), stride // 2
    for place, parts in enumerate(samples.parts(numbers_of(samples, at.modes))):
        state, first = np.zeros((size, width)), width - at.initial.size + place * size
        state[:, first : first + size] = np.eye(size)
        for own in parts:
            part = samples.part(own)
            lengths = generator.integers(stride - near, stride + near + 1, part.n_samples // (stride - near) + 1)
            # A first state is soon forgotten: each sample counts there.
            edges = np.cumsum(np.concatenate([[0], np.ones(MEMORY * (own is parts[0]), np.int64), lengths]))
            edges = np.append(edges[edges < part.n_samples], part.n_samples)
            system, gains, seen, _ = matrices(part, at.modes)
            gains, white = part.gained(gains), -part.gained(at.root(own))[edges[:-1]]
            behind, carried, whole = _carried(system - gains @ seen, edges)
            by_channel = -(carried @ gains[behind]).transpose(0, 2, 3, 1)
            by_channel = by_channel.reshape(len(behind), size * channels, behind.shape[1])
            by_state = np.ascontiguousarray(carried.transpose(3, 0, 2, 1))
            slopes, beside = (np.zeros((len(behind), rows, width)) for rows in (size, channels))
            for row, columns, signals in forces(part, at, own):
                slopes[:, :, columns] += by_state[row] @ signals[behind]
            for start, signals in held_signals(part, at, own):
                columns, held = slice(start, start + channels * len(signals)), signals.T
                slopes[:, :, columns] = (by_channel @ held[behind]).reshape(len(behind), size, -1)
                each = white[..., None] * held[edges[:-1], None, None]
                beside[:, :, columns] = each.reshape(len(behind), channels, -1)
            for forced, transition in zip(slopes, whole, strict=True):
                after = transition @ state + forced
                forced[:], state = state, after  # now the slopes at the first sample of the block
            begun = state[:, width - at.initial.size :]
            begun[np.abs(begun) < ROUNDING] = 0.0
            beside += (white @ seen[edges[:-1]]) @ slopes
            beside *= np.sqrt(np.diff(edges))[:, None, None]
            yield own.start + edges[:-1], beside


def _carried(ahead: Floats, edges: Integers) -> tuple[Integers, Floats, Floats]:
    """The samples of each block from its last on, and the transitions from the next of each to the end of the block."""
    longest = int(np.diff(edges).max())
    behind = edges[1:, None] - 1 - np.arange(longest)
    inside, behind = (behind >= edges[:-1, None])[..., None, None], np.maximum(behind, 0)
    carried = np.empty((*behind.shape, *ahead.shape[1:]))
    whole = np.broadcast_to(np.eye(len(ahead[0])), (len(behind), *ahead.shape[1:]))
    for step in range(longest):
        carried[:, step] = whole * inside[:, step]
        whole = np.where(inside[:, step], whole @ ahead[behind[:, step]], whole)
    return behind, carried, whole


T = TypeVar("T")


def normal_of(samples: Samples, at: Predictor) -> Normal:
    """The linearisation of a predictor by all of its parameters, zero ones as well."""
    return _once(at, "normal", lambda: _summed(samples, at, (part for _, part in slopes(samples, at, at.root))))


def roughly(samples: Samples, at: Predictor, share: float = MOST) -> Normal:
    """The linearisation for steps and tests of a search, of few of many samples: parameters over rows are a share."""
    # Of m rows chance moves a test by √(2/m), and a step of p parameters by √(p/m). Samples next to each other say
    # nearly the same of a mode that lasts.
    width = max(width_of(at), 1)
    stride = samples.count * len(samples.values) // int(max(width / share, BLOCK / width))
    if stride <= 1:
        return normal_of(samples, at)
    return _once(at, f"rough {share}", lambda: _summed(samples, at, (part for _, part in thinned(samples, at, stride))))


@np.errstate(over="ignore", invalid="ignore")  # of a start that all but diverges: no step is found then
def _summed(samples: Samples, at: Predictor, parts: Iterable[Floats]) -> Normal:
    matrix = np.zeros((width_of(at), width_of(at)))
    for part in parts:
        flat = part.reshape(-1, part.shape[2])
        matrix += flat.T @ flat
    return Normal(matrix=matrix, gradient=pull_of(samples, at))


def pull_of(samples: Samples, at: Predictor) -> Floats:
    """Half the steepest descent from a predictor (parameters,)."""
    return _once(at, "pull", lambda: gradient(samples, at, at.innovations))


def _once(at: Predictor, name: str, formed: Callable[[], T]) -> T:
    if name not in at.kept:
        at.kept[name] = formed()
    return at.kept[name]


def inverse_of(normal: Normal, free: Mask | None = None) -> Floats:
    """The covariance of the free parameters, zero elsewhere (parameters, parameters); NaN where it overflowed.

    Of all parameters it has none along the scales of states, which are no information. Of `free` ones, that have these
    held, directions that are rounding have a large variance: else a mode that noise explains is sure of itself.
    """
    if not np.isfinite(normal.matrix).all():
        return np.full_like(normal.matrix, np.nan)
    own = np.flatnonzero(np.ones(len(normal.gradient), bool) if free is None else free)
    found = np.zeros_like(normal.matrix)
    found[np.ix_(own, own)] = scaled_inverse(normal.matrix[np.ix_(own, own)], floor=free is not None)
    return found


def solve(
    samples: Samples, start: Predictor, *, rough: bool = False, least: float = -np.inf, steps: int = STEPS
) -> Predictor:
    """The maximum of the likelihood near a start (Levenberg-Marquardt), or the point after `steps`."""
    # The gradient alone costs next to nothing. A fit that is of no use below a least logarithm of the likelihood (twice
    # that) is given up where it will not come as far. What makes up for gaps is held during a fit, which is made anew
    # until that gains nothing more.
    best = start
    for _ in range(ROUNDS if samples.gaps else 0):
        found = _solve(samples, best, rough=rough, least=least, steps=steps)
        anew = predicted(samples, found.modes, found.columns, found.initial, found.whitening)
        gain = -np.inf if anew is None else anew.log_likelihood - best.log_likelihood
        best = best if anew is None or gain < 0.0 else anew
        if gain < REST:
            break
    return best if samples.gaps else _solve(samples, start, rough=rough, least=least, steps=steps)


def _solve(samples: Samples, start: Predictor, *, rough: bool, least: float, steps: int) -> Predictor:
    """The maximum of the likelihood near a start, what makes up for gaps held."""
    (most, at_rest), period = (FEW_STEPS, REST) if rough else (STEPS, AT_REST), 2.0 * np.pi / samples.fundamental
    iterations = min(most, steps)

    def hopeless(at: Predictor, gains: list[float]) -> bool:
        if len(gains) < 2 or gains[-1] >= gains[-2]:
            return False
        return at.log_likelihood + (iterations - len(gains)) * gains[-2] < least

    of = Steps(
        normal=lambda at: roughly(samples, at, OF_STEPS if rough else MOST),
        moved=lambda at, step: moved(samples, at, step, period),
        limited=lambda at, step, normal, damping: held(at, step, partial(normal.covariance, damping), period),
        gradient=lambda at: pull_of(samples, at),
        enough=hopeless,
    )
    return levenberg_marquardt(start, of, Ends(steps=iterations, gain=at_rest, patience=IN_VAIN))


def held(at: Predictor, whole: Floats, covariance: Callable[[Mask], Floats], period: float) -> Floats:
    """A step on which no exponent moves further than `LONGEST_STEP`, all else the best for those held there."""
    own = [slice(place.start, place.start + mode.rows) for mode, place in zip(at.modes, places(at.modes), strict=True)]
    step, fixed = whole, np.zeros(len(whole), bool)
    while True:
        size, longest = max(
            ((_travel(mode, step[rows], period), rows) for mode, rows in zip(at.modes, own, strict=True)),
            key=lambda both: both[0],
            default=(0.0, slice(0)),
        )
        if size <= 1.001 * LONGEST_STEP:
            return step
        to = np.where(fixed, step, whole)
        to[longest], fixed[longest] = step[longest] * LONGEST_STEP / size, True
        mixed = covariance(fixed)
        step = whole - mixed @ np.linalg.lstsq(mixed[fixed], (whole - to)[fixed], rcond=None)[0]
        step[fixed] = to[fixed]


def climbed(samples: Samples, now: Predictor) -> Predictor:
    """A rough fit that goes on while it gains: a pole beside one that is there begins with next to nothing."""
    for _ in range(ROUNDS):
        before, now = now, solve(samples, now, rough=True)
        if now.log_likelihood - before.log_likelihood < chi2_limit(1, RARE):
            break
    return now


def moved(samples: Samples, at: Predictor, step: Floats, period: float) -> Predictor | None:
    """The predictor a step away, no exponent moving further than `LONGEST_STEP`; None where it diverges."""
    steps = split(at, step)
    moves = [_travel(mode, own[: mode.rows], period) for mode, own in zip(at.modes, steps[0], strict=True)]
    share = min(1.0, LONGEST_STEP / max(*moves, 0.0, 1e-300))
    modes = [mode.moved(np.asarray(share * own, np.float64)) for mode, own in zip(at.modes, steps[0], strict=True)]
    return predicted(
        samples, modes, at.columns + share * steps[1], at.initial + share * steps[2], at.whitening, scales=at.scales
    )


def _travel(mode: Mode, step: Floats, period: float) -> float:
    """Length of a step of λ, or of σ and q, over a period."""
    return float(np.linalg.norm(step * (period if mode.square is None else np.array([period, period**2]))))


def split(at: Predictor, values: NDArray) -> tuple[list[NDArray], NDArray, NDArray]:
    """Numbers of all parameters (parameters,): of each mode, of the known columns, of the first states."""
    ends = np.cumsum([*(sum(mode.sizes) for mode in at.modes), at.columns.size])
    *modes, columns, initial = np.split(values, ends)
    return modes, columns.reshape(at.columns.shape), initial.reshape(at.initial.shape)


def places(modes: Sequence[Mode]) -> list[slice]:
    """The place of the parameters of each mode among all."""
    ends = np.cumsum([0, *(sum(mode.sizes) for mode in modes)])
    return [slice(int(a), int(b)) for a, b in pairwise(ends)]
