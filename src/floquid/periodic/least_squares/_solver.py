r"""The constrained fit: exponents with their residues held to the harmonics that are there (Allen 2009, eqs. 11-12).

.. math:: \min_{\lambda, B} \sum_{c,h} \frac{1}{\sigma_{c,h}^2} \sum_k
          \Big(y_{c,h}(t_k) - 2 \Re \sum_r \sum_{m \in M_r} B_{r,c,h,m}\, e^{(\lambda_r + i m \omega) t_k}\Big)^2

Lifting leaves the residue at each phase free: P numbers a mode and channel, where the shape has a few. Held to a band
of harmonics, the same record says more of every exponent, and most of one that is weak, fast or aliased next to
another.

The coefficients are eliminated (Golub and Pereyra 1973; Kaufman's Gauss-Newton matrix), and their own noise is taken
off that matrix, as in `lti`. All that is needed of the data are sums of products with columns (`_sample_block`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from floquid._arrays import Floats, Mask
from floquid._numerics import positive_part, sandwich
from floquid.errors import IdentificationError
from floquid.periodic.least_squares._parameters import ModeParameters, turned
from floquid.periodic.least_squares._sample_block import Block, Columns, complex_of

ITERATIONS = 40  # steps at most
LONGEST_STEP = 0.2  # the most that an exponent may move in a step, over one period
FARTHEST = 0.5  # the most that an exponent may move in all, over one period: the multiplier then is another one
AT_REST = 1e-4  # standard deviations that the last step may have
PASSES = 3  # corrections of the coefficients of one set of exponents, at most
GAINED = 100.0  # gain of a step of the coefficients, over the residual, up to which no digits that matter are lost
LITTLE = 1e-3  # the same where columns are all but alike
GONE = 1e-200  # the sum of squares below which a column has decayed before the first sample
ROUNDING = 1e-13  # the share of its own size below which a direction of the columns is rounding


SAFE = 1e-8  # the share of a column that the columns before it must leave for its inverse to be had without eigenvalues
NOTHING = 1e-18  # the information on a parameter, over that on the best known, below which nothing is known of it


@dataclass(frozen=True, slots=True)
class Linear:
    """Linear part of one block: coefficients α Re z + β Im z (2 columns, rows), and matrices."""

    coefficients: Floats
    gram: Floats  # products of the columns (2 columns, 2 columns)
    inverse: Floats  # inverse of the Gram matrix (2 columns, 2 columns); zero where a column has no sine
    mixed: Floats  # products of the slopes with the columns (2 columns, 2 columns)
    curvature: Floats  # products of the slopes, less what the columns take of them (2 columns, 2 columns)
    slope: Floats  # products of the slopes with what is left (2 columns, channels)
    left: Floats  # the sum of squares left (channels,)


@dataclass(frozen=True, slots=True)
class ByColumn:
    """Gradient and matrices if each column had an exponent of its own: the decays, then the frequencies.

    Whatever ties these together (one exponent a mode, a split mode, the period) is a matrix A of parameters by them:
    its gradient is A g and its Gauss-Newton matrix A J Aᵀ, so that one linearisation answers all such questions.
    """

    gradient: Floats  # (2 columns,)
    gauss_newton: Floats  # (2 columns, 2 columns)
    noise: Floats  # part of it that noise on the coefficients adds (2 columns, 2 columns)

    def tied(self, ties: Floats) -> tuple[Floats, Floats, Floats]:
        """Gradient, Gauss-Newton matrix and information of parameters `ties` (parameters, 2 columns)."""
        scatter = ties @ self.gauss_newton @ ties.T
        return ties @ self.gradient, scatter, positive_part(scatter, scatter - ties @ self.noise @ ties.T)


@dataclass(frozen=True, slots=True)
class Solution:
    """One fit: entries, what is linear of each block, and cost, gradient and matrices of the real parameters."""

    entries: ModeParameters
    linear: tuple[Linear, ...]
    cost: float
    gradient: Floats
    gauss_newton: Floats
    information: Floats
    by_column: ByColumn
    further: Floats | None = None
    """Addition to variances, of clusters and of modes next to their conjugate (parameters,); None for nothing."""

    def covariance(self) -> Floats:
        """Of the real parameters (parameters, parameters): the sandwich of information and scatter."""
        size = np.diag(self.information)
        told = np.flatnonzero(size > NOTHING * size.max(initial=0.0))
        own = np.ix_(told, told)
        # What nothing is known of may be anything, up to another branch.
        found = np.diag(np.full(len(size), self.entries.fundamental**2))
        found[own] = sandwich(self.information[own], self.gauss_newton[own])
        lost = ~(np.diag(found) >= 0.0) | ~np.isfinite(found).all(axis=1)
        found[lost], found[:, lost] = 0.0, 0.0
        found[lost, lost] = self.entries.fundamental**2
        return found if self.further is None else found + np.diag(self.further)


def linearise(blocks: Sequence[Block], entries: ModeParameters, start: tuple[Floats, ...] | None = None) -> Solution:
    """Cost, gradient and matrices of the fit at these exponents, the coefficients eliminated."""
    return weighted(blocks, entries, eliminated(blocks, entries, start))


def eliminated(
    blocks: Sequence[Block], entries: ModeParameters, start: tuple[Floats, ...] | None = None
) -> list[Linear]:
    """Linear part of each block at these exponents."""
    columns, sines = entries.columns(), entries.sines()
    first = [None] * len(blocks) if start is None else start
    return [_linear(block, columns, sines, own) for block, own in zip(blocks, first, strict=True)]


def weighted(blocks: Sequence[Block], entries: ModeParameters, linear: Sequence[Linear]) -> Solution:
    """Cost, gradient and matrices from the linear part of each block, which noise does not enter: no sample is read."""
    n = len(entries.sines())
    cost, gradient, scatter, noise = 0.0, np.zeros(2 * n), np.zeros((2 * n, 2 * n)), np.zeros((2 * n, 2 * n))
    for block, own in zip(blocks, linear, strict=True):
        weight = 1.0 / block.noise**2
        cost += float(own.left @ weight)
        slopes = own.slope * weight
        for part, moved in enumerate((own.coefficients, turned(own.coefficients))):
            along = np.einsum("kc,kc->k", moved, slopes)
            gradient[part * n : (part + 1) * n] += along[:n] + along[n:]
        scatter += _folded(own.curvature, (own.coefficients * weight) @ own.coefficients.T)
        noise += len(block.rows) * _folded(own.curvature, own.inverse)
    by_column = ByColumn(gradient, scatter, noise)
    return Solution(entries, tuple(linear), cost, *by_column.tied(entries.ties()), by_column)


def _folded(curvature: Floats, moments: Floats) -> Floats:
    """Products of the columns' slopes by decay and by frequency (2 columns, 2 columns), of coefficients' moments."""
    half = turned(moments)
    rows = [[moments, turned(moments.T).T], [half, turned(half.T).T]]
    n = len(curvature) // 2
    found = np.empty((2, n, 2, n))
    for (i, j), part in zip(np.ndindex(2, 2), (own for row in rows for own in row), strict=True):
        found[i, :, j] = (curvature * part).reshape(2, n, 2, n).sum(axis=(0, 2))
    return found.reshape(2 * n, 2 * n)


def solve(
    blocks: Sequence[Block],
    start: ModeParameters | Solution,
    *,
    at_rest: float = AT_REST,
    hold: bool = False,
    iterations: int = ITERATIONS,
) -> Solution:
    """The least squares near these exponents: Levenberg-Marquardt on the projected cost.

    It ends when a step is below `at_rest` standard deviations. With `hold`, a mode whose exponent runs away is put back
    and held there.

    Raises IdentificationError where, without `hold`, an exponent moves by more than `FARTHEST`.
    """
    now = start if isinstance(start, Solution) else linearise(blocks, start)
    begin, damping, period = now.entries, 1e-6, 2.0 * np.pi / now.entries.fundamental
    for _ in range(iterations):
        if not len(now.gradient):
            break
        scale = np.sqrt(np.diag(now.information))
        scale[scale**2 <= NOTHING * scale.max() ** 2] = np.inf
        system = now.information / np.outer(scale, scale)
        while damping < 1e8:
            step = np.linalg.solve(system + damping * np.eye(len(scale)), now.gradient / scale) / scale
            step *= min(1.0, LONGEST_STEP / (np.abs(step).max() * period + np.finfo(float).tiny))
            trial = linearise(blocks, now.entries.moved(step), tuple(own.coefficients for own in now.linear))
            if trial.cost <= now.cost * (1.0 + 1e-12):
                break
            damping = max(10.0 * damping, 1e-4)
        else:
            return now
        done = np.abs(step * np.where(np.isfinite(scale), scale, 0.0)).max() < at_rest
        now, damping = trial, max(0.1 * damping, 1e-12)
        moved = np.abs(now.entries.exponents - begin.exponents) * period
        if moved.max() > FARTHEST:
            if not hold:
                raise IdentificationError(
                    "Holding the residues to their harmonics moves an exponent away from where lifting found it, by "
                    f"{moved.max():.2g} a period: a mode hardly rises above the noise. Leave it out (`order=`), or "
                    "finish without (`constrained=False`)."
                )
            away = moved > FARTHEST
            exponents = np.where(away, begin.exponents, now.entries.exponents)
            put_back = replace(now.entries, exponents=exponents, fixed=now.entries.fixed | away)
            now, done = linearise(blocks, put_back, tuple(own.coefficients for own in now.linear)), False
        if done:
            break
    return now


def _linear(block: Block, columns: Columns, sines: Mask, start: Floats | None) -> Linear:
    """One block: coefficients by normal equations, and again for what those leave, so that no digits are lost."""
    kept = np.concatenate([np.ones(len(sines), bool), sines])
    size = 2 * len(sines)
    coefficients = np.zeros((size, len(block.rows))) if start is None else start
    passes, round_ = (1 if start is not None else 2), 0
    while True:
        round_ += 1
        found = block.sums(columns, complex_of(coefficients))
        inverse = np.zeros((size, size))
        inverse[np.ix_(kept, kept)], safe = _inverse(found.gram[np.ix_(kept, kept)])
        step = inverse @ found.seen
        gained = np.sum(step * found.seen, axis=0)
        coefficients = coefficients + step
        enough = GAINED if safe else LITTLE
        if round_ == PASSES or (round_ >= passes and (gained <= enough * (found.left - gained)).all()):
            break
    return Linear(
        coefficients=coefficients,
        gram=found.gram,
        inverse=inverse,
        mixed=found.mixed,
        curvature=found.slopes - found.mixed @ inverse @ found.mixed.T,
        slope=found.late - found.mixed @ step,
        left=found.left - gained,
    )


def _inverse(matrix: Floats) -> tuple[Floats, bool]:
    """The inverse of a Gram matrix, directions that are rounding left out; and whether its columns are well apart."""
    if not len(matrix):
        return matrix, True
    size = np.diag(matrix)
    scale = np.sqrt(np.where(size > GONE, size, 1.0))
    scaled = matrix / np.outer(scale, scale)
    try:
        lower = np.linalg.cholesky(scaled)
        if np.diag(lower).min() ** 2 > SAFE:
            root = np.linalg.inv(lower)
            return root.T @ root / np.outer(scale, scale), True
    except np.linalg.LinAlgError:
        pass
    values, vectors = np.linalg.eigh(scaled)
    good = values > ROUNDING * values[-1]
    return (vectors[:, good] / values[good]) @ vectors[:, good].T / np.outer(scale, scale), False
