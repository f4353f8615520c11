"""Derivatives of the innovations of a long record at samples here and there, carried from each to the next at once."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from floquid.fit import ROUNDING
from floquid.innovations._derivatives import forces, held_signals, width_of
from floquid.innovations._predictor import MEMORY, Predictor, matrices, numbers_of
from floquid.inputs import Samples


def thinned(samples: Samples, at: Predictor, stride: int) -> Iterator[tuple[NDArray[np.int64], NDArray[np.float64]]]:
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


def _carried(
    ahead: NDArray[np.float64], edges: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """The samples of each block from its last on, and the transitions from the next of each to the end of the block.

    (blocks, samples), (blocks, samples, states, states): zero where a block is shorter. Last those over whole blocks.
    """
    longest = int(np.diff(edges).max())
    behind = edges[1:, None] - 1 - np.arange(longest)
    inside, behind = (behind >= edges[:-1, None])[..., None, None], np.maximum(behind, 0)
    carried = np.empty((*behind.shape, *ahead.shape[1:]))
    whole = np.broadcast_to(np.eye(len(ahead[0])), (len(behind), *ahead.shape[1:]))
    for step in range(longest):
        carried[:, step] = whole * inside[:, step]
        whole = np.where(inside[:, step], whole @ ahead[behind[:, step]], whole)
    return behind, carried, whole
