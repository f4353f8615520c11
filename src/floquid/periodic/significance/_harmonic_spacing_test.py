"""Score test of the spacing of harmonics: where harmonics would be, or modes of their own that fold onto another."""

from __future__ import annotations

import numpy as np

from floquid._arrays import Floats, Indices
from floquid.core import Estimates
from floquid.lifting import Lifted
from floquid.periodic.least_squares import LiftedBlock, ModeParameters, linearise

NOWHERE = 1e-200  # the information on a line, over that on the best known, below which there is none


def spacing_probability(whole: Estimates, lifted: Lifted, lines: Indices) -> float:
    r"""The probability of the responses if harmonics lie whole numbers of fundamentals from their modes; 1 without any.

    .. math:: Q = g^T J^{-1} g - (A^T g)^T (A^T J A)^{-1} A^T g \sim \chi^2

    Rao's score test: g and J are the slopes of the cost and their covariance by the rates λ + imω of modes and of the
    harmonics looked at (`lines`, positions among the terms), each a line of its own; A moves these with their modes, as
    one exponent does. All other terms are there and move with their modes in both. A mode of a constant system that
    folds next to another is mostly not at the same place to a small part of its decay.
    """
    from scipy.special import chdtrc

    if not len(lines):
        return 1.0
    # Every term takes part: one that is left out would pull at the places of the others.
    count = len(whole.exponents)
    rates = linearise(LiftedBlock.all_of(lifted), ModeParameters.of_terms(whole)).by_column
    modes = (whole.modes[:, None] == np.arange(count)) * whole.turning[:, None].astype(float)
    alone = (np.arange(len(whole.modes))[:, None] == lines).astype(float)
    looked_at = alone.any(axis=1, keepdims=True)
    free, tied = (
        _gain(both.T @ rates.gradient, both.T @ rates.gauss_newton @ both)
        for both in (np.kron(np.eye(2), each) for each in (np.concatenate([modes * ~looked_at, alone], axis=1), modes))
    )
    return float(chdtrc(2 * len(lines), max(free - tied, 0.0)))


def _gain(gradient: Floats, matrix: Floats) -> float:
    sizes = np.diag(matrix)
    # A line that is nowhere to be seen takes nothing.
    scale = np.where(sizes > NOWHERE * sizes.max(), sizes, np.inf) ** -0.5
    return float(gradient * scale @ np.linalg.lstsq(matrix * np.outer(scale, scale), gradient * scale, rcond=1e-12)[0])
