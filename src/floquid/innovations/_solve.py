"""Maximum likelihood of the innovations form by Gauss and Newton's steps, one linearisation for step and tests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from floquid._checks import Rebuilt
from floquid.innovations._predictor import Mode, Predictor, predicted, slopes
from floquid.inputs import Samples

LONGEST_STEP = 0.3
"""The most that an exponent may move in a step, over one period."""

ROUNDING = 1e-11
"""The share of the largest below which a direction of the parameters is rounding: the scale of a state is one."""

FINE = (20, 1e-3)
"""Steps at most, and the gain in twice the logarithm of the likelihood that ends them."""

ROUGH = (4, 0.5)
"""Those of a fit that is not the last."""


@dataclass(frozen=True, eq=False)
class Normal(Rebuilt):
    """Gauss-Newton matrix and gradient of a predictor, its innovations whitened.

    Parameters
    ----------
    matrix, gradient
        JᵀR⁻¹J (parameters, parameters) and -JᵀR⁻¹e (parameters,).
    """

    matrix: NDArray[np.float64]
    gradient: NDArray[np.float64]

    @cached_property
    def scale(self) -> NDArray[np.float64]:
        """The root of the diagonal; 1 of what does nothing (parameters,)."""
        own = np.sqrt(np.diag(self.matrix))
        return np.where(own > 1e-150, own, 1.0)

    @cached_property
    def scaled(self) -> NDArray[np.float64]:
        """The matrix of parameters over their scale (parameters, parameters)."""
        return self.matrix / np.outer(self.scale, self.scale)

    def inverse(self, free: NDArray[np.bool_] | None = None) -> NDArray[np.float64]:
        """Pseudo-inverse over the free parameters, zero elsewhere (parameters, parameters)."""
        own = np.flatnonzero(np.ones(len(self.scale), bool) if free is None else free)
        values, vectors = np.linalg.eigh(self.scaled[np.ix_(own, own)])
        good = values > ROUNDING * values[-1]
        found = np.zeros_like(self.matrix)
        found[np.ix_(own, own)] = (vectors[:, good] / values[good]) @ vectors[:, good].T
        return found / np.outer(self.scale, self.scale)


def normal_of(samples: Samples, at: Predictor, *, rough: bool = False, of: NDArray | None = None) -> Normal:
    """The linearisation of a predictor by all of its parameters, zero ones as well.

    The gradient is that of the innovations, or of other signals in their place (channels, samples).
    """
    root = np.asarray(np.linalg.inv(np.linalg.cholesky(at.covariance)), np.float64)
    white = root @ (at.innovations if of is None else of)
    matrix, gradient = np.zeros((0, 0)), np.zeros(0)
    for own, part in slopes(samples, at, root, rough=rough):
        flat = part.reshape(-1, part.shape[2])
        more, pull = flat.T @ flat, flat.T @ white[:, own].T.ravel().astype(part.dtype)
        matrix, gradient = (
            (matrix + more, gradient - pull) if len(matrix) else (more.astype(float), -pull.astype(float))
        )
    return Normal(matrix, gradient)


def solve(samples: Samples, start: Predictor, *, rough: bool = False) -> Predictor:
    """The maximum of the likelihood near a start (Levenberg-Marquardt); a rough one in single precision."""
    iterations, at_rest = ROUGH if rough else FINE
    now, damping = start, 1e-6
    period = 2.0 * np.pi / samples.fundamental
    for _ in range(iterations):
        normal = normal_of(samples, now, rough=rough)
        values, vectors = np.linalg.eigh(normal.scaled)
        aim = vectors.T @ (normal.gradient / normal.scale)
        good = values > (1e-6 if rough else ROUNDING) * values[-1]
        gained = -np.inf
        while damping < 1e6:
            step = vectors[:, good] @ (aim[good] / (values[good] + damping)) / normal.scale
            trial = moved(samples, now, step, period)
            gained = -np.inf if trial is None else trial.log_likelihood - now.log_likelihood
            if gained >= -1e-9:
                break
            damping = max(10.0 * damping, 1e-4)
        else:
            return now
        assert trial is not None
        now, damping = trial, max(0.1 * damping, 1e-9)
        if gained < at_rest:
            break
    return now


def moved(samples: Samples, at: Predictor, step: NDArray[np.float64], period: float) -> Predictor | None:
    """The predictor a step away, no exponent moving further than `LONGEST_STEP`; None where it diverges."""
    steps = split(at, step)
    moves = [np.linalg.norm(own[: mode.rows]) for mode, own in zip(at.modes, steps[0], strict=True)]
    longest = max(moves, default=0.0)
    share = min(1.0, LONGEST_STEP / max(longest * period, 1e-300))
    modes = [mode.moved(np.asarray(share * own, np.float64)) for mode, own in zip(at.modes, steps[0], strict=True)]
    return predicted(samples, modes, at.columns + share * steps[1], at.initial + share * steps[2])


def split(at: Predictor, values: NDArray) -> tuple[list[NDArray], NDArray, NDArray]:
    """Numbers of all parameters (parameters,): of each mode, of the known columns, of the first states."""
    ends = np.cumsum([*(sum(mode.sizes) for mode in at.modes), at.columns.size])
    *modes, columns, initial = np.split(values, ends)
    return modes, columns.reshape(at.columns.shape), initial.reshape(at.initial.shape)


def places(modes: Sequence[Mode]) -> list[slice]:
    """The place of the parameters of each mode among all."""
    ends = np.cumsum([0, *(sum(mode.sizes) for mode in modes)])
    return [slice(int(a), int(b)) for a, b in pairwise(ends)]
