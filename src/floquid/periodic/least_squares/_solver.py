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

from floquid._arrays import Complexes, Floats, Indices, Integers, Mask
from floquid.errors import IdentificationError
from floquid.fit import (
    AT_REST,
    FARTHEST,
    LONGEST_STEP,
    ROUNDING,
    ROUNDS,
    STEPS,
    Ends,
    Normal,
    Steps,
    levenberg_marquardt,
    positive_part,
    sandwich,
    scaled_inverse,
)
from floquid.periodic.least_squares._parameters import ModeParameters
from floquid.periodic.least_squares._sample_block import ODD_SLOPE, Block, Columns, Sums, complex_of

ASUNDER = np.pi  # the most that half the difference of a pair near an axis may be, over one period: halfway to the next

GAINED = 100.0  # gain of a step of the coefficients, over the residual, up to which no digits that matter are lost

SAFE = 1e-8  # the share of a column beyond others down to which a Cholesky factor keeps what eigenvalues lose

NOTHING = ROUNDING**2
"""The information on a parameter, over that on the best known, below which nothing is known of it: a square."""


@dataclass(frozen=True, slots=True)
class Linear:
    """Linear part of one block: coefficients α Re z + β Im z (2 columns, rows), and matrices."""

    coefficients: Floats
    gram: Floats  # products of the columns (2 columns, 2 columns)
    inverse: Floats  # inverse of the Gram matrix (2 columns, 2 columns); zero where a column has no sine
    mixed: Floats  # products of the columns with the functions of their derivatives (2 columns, 2 functions)
    curvature: Floats  # products of those functions, less what the columns take of them (2 functions, 2 functions)
    slope: Floats  # products of those functions with the residual (2 functions, channels)
    left: Floats  # the sum of squares left (channels,)


@dataclass(frozen=True, slots=True)
class ByColumn:
    """Gradient and matrices if each column had an exponent of its own: `ModeParameters.rows`.

    Whatever ties these together (one exponent a mode, a split mode, the period) is a matrix A of parameters by them:
    its gradient is A g and its Gauss-Newton matrix A J Aᵀ, so that one linearisation answers all such questions.
    """

    gradient: Floats  # (rows,)
    gauss_newton: Floats  # (rows, rows)
    noise: Floats  # part of it that noise on the coefficients adds (rows, rows)

    def tied(self, ties: Floats) -> tuple[Floats, Floats, Floats]:
        """Gradient, Gauss-Newton matrix and information of parameters `ties` (parameters, rows)."""
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
        """Covariance of the real parameters (parameters, parameters): the sandwich of information and scatter."""
        size = np.diag(self.information)
        determined = np.flatnonzero(size > NOTHING * size.max(initial=0.0))
        inner = np.ix_(determined, determined)
        # What nothing is known of may be anything, up to another branch.
        covariance = np.diag(np.full(len(size), self.entries.fundamental**2))
        covariance[inner] = sandwich(self.information[inner], self.gauss_newton[inner])
        lost = ~(np.diag(covariance) >= 0.0) | ~np.isfinite(covariance).all(axis=1)
        covariance[lost], covariance[:, lost] = 0.0, 0.0
        covariance[lost, lost] = self.entries.fundamental**2
        return covariance if self.further is None else covariance + np.diag(self.further)


def linearise(blocks: Sequence[Block], entries: ModeParameters, start: tuple[Floats, ...] | None = None) -> Solution:
    """Cost, gradient and matrices of the fit at these exponents, the coefficients eliminated."""
    return weighted(blocks, entries, eliminated(blocks, entries, start))


def eliminated(
    blocks: Sequence[Block], entries: ModeParameters, start: tuple[Floats, ...] | None = None
) -> list[Linear]:
    """Linear part of each block at these exponents."""
    columns, sines = entries.with_slopes(), entries.sines()
    first = [None] * len(blocks) if start is None else start
    return [_linear(block, columns, sines, first_values) for block, first_values in zip(blocks, first, strict=True)]


def weighted(blocks: Sequence[Block], entries: ModeParameters, linear: Sequence[Linear]) -> Solution:
    """Cost, gradient and matrices from the linear part of each block, which noise does not enter: no sample is read."""
    n = len(entries.sines())
    size = len(entries.rows.columns)
    cost, gradient, scatter, noise = 0.0, np.zeros(size), np.zeros((size, size)), np.zeros((size, size))
    rows = entries.rows
    place, signs = rows.of_coefficients(n)
    for block, part in zip(blocks, linear, strict=True):
        weight = 1.0 / block.noise**2
        cost += float(part.left @ weight)
        slopes, width = part.slope * weight, len(part.slope) // 2
        functions = np.stack([rows.functions, width + rows.functions], axis=1)
        gradient += np.einsum("rpc,rpc,rp->r", part.coefficients[place], slopes[functions], signs)
        scatter += folded(part.curvature, (part.coefficients * weight) @ part.coefficients.T, functions, place, signs)
        noise += len(block.rows) * folded(part.curvature, part.inverse, functions, place, signs)
    by_column = ByColumn(gradient, scatter, noise)
    return Solution(entries, tuple(linear), cost, *by_column.tied(entries.ties()), by_column)


def folded(curvature: Floats, moments: Floats, functions: Integers, place: Integers, signs: Floats) -> Floats:
    """Products of rows (rows, rows) from those of functions of time and the moments of coefficients."""
    products = np.zeros((len(place), len(place)))
    for i, j in np.ndindex(2, 2):
        both = curvature[functions[:, i][:, None], functions[:, j]] * moments[place[:, i][:, None], place[:, j]]
        products += signs[:, i][:, None] * signs[:, j] * both
    return products


def solve(
    blocks: Sequence[Block],
    start: ModeParameters | Solution,
    *,
    at_rest: float = AT_REST,
    hold: bool | Mask = False,
    iterations: int = STEPS,
) -> Solution:
    """The least squares near these exponents: Levenberg-Marquardt on the projected cost.

    It ends when a step is below `at_rest` standard deviations. With `hold`, of all entries or of some, a mode whose
    exponent runs away is put back and held there.

    Raises IdentificationError where, without `hold`, an exponent moves by more than `FARTHEST`.
    """
    solution = start if isinstance(start, Solution) else linearise(blocks, start)
    begin, period = solution.entries, 2.0 * np.pi / solution.entries.fundamental

    def moved(at: Solution, step: Floats) -> Solution | None:
        trial = at.entries.moved(step)
        if np.sqrt(np.abs(trial.all_squares).max(initial=0.0)) * period > ASUNDER:
            return None
        return linearise(blocks, trial, tuple(part.coefficients for part in at.linear))

    def limited(at: Solution, step: Floats, _normal: Normal, _damping: float) -> Floats:
        return step * min(1.0, LONGEST_STEP / (at.entries.longest(step) + np.finfo(float).tiny))

    def away(at: Solution) -> Floats:
        return np.abs(at.entries.exponents - begin.exponents) * period

    steps = Steps(normal=normal, moved=moved, limited=limited, enough=lambda at, _: bool((away(at) > FARTHEST).any()))
    while True:
        solution = levenberg_marquardt(solution, steps, Ends(steps=iterations, deviations=at_rest))
        gone = away(solution) > FARTHEST
        if not gone.any():
            return solution
        if not np.all(hold | ~gone):
            raise IdentificationError(
                f"The fit with shared harmonics moves an exponent by {away(solution).max():.2g} a period from its "
                "start: a mode hardly rises above the noise. Leave it out (`order=`), or pass `constrained=False`."
            )
        exponents = np.where(gone, begin.exponents, solution.entries.exponents)
        put_back = replace(solution.entries, exponents=exponents, fixed=solution.entries.fixed | gone)
        solution = linearise(blocks, put_back, tuple(part.coefficients for part in solution.linear))


def normal(at: Solution) -> Normal:
    """The normal equations; a parameter with almost no information stays."""
    size = np.diag(at.information)
    there = size > NOTHING * size.max(initial=0.0)
    return Normal(matrix=at.information, gradient=at.gradient, given=np.sqrt(np.where(there, size, np.inf)))


def _linear(block: Block, columns: Columns, sines: Mask, start: Floats | None) -> Linear:
    """One block: coefficients by normal equations, and again for what those leave, so that no digits are lost."""
    kept = np.concatenate([np.ones(len(sines), bool), sines])
    n, whole, size = len(sines), len(columns.modes), 2 * len(sines)
    # Columns beyond those of the fit are derivatives: they stand beside the columns times t.
    fitted = np.concatenate([np.arange(n), whole + np.arange(n)])
    coefficients, full = (
        np.zeros((size, len(block.rows))) if start is None else start,
        np.zeros((2 * whole, len(block.rows))),
    )
    passes, round_ = (1 if start is not None else 2), 0
    while True:
        round_ += 1
        full[fitted] = coefficients
        sums = block.sums(columns, complex_of(full))
        gram, mixed, slopes, late = _by_functions(sums, columns, fitted)
        inverse = np.zeros((size, size))
        inverse[np.ix_(kept, kept)], safe = _inverse(gram[np.ix_(kept, kept)], _sizes(gram, columns)[kept])
        step = inverse @ sums.seen[fitted]
        gained = np.sum(step * sums.seen[fitted], axis=0)
        coefficients = coefficients + step
        exact = safe and (gained <= GAINED * (sums.left - gained)).all()
        if round_ == ROUNDS or (round_ >= passes and exact):
            break
    return Linear(
        coefficients=coefficients,
        gram=gram,
        inverse=inverse,
        mixed=mixed,
        curvature=slopes - mixed.T @ inverse @ mixed,
        slope=late - mixed.T @ step,
        left=sums.left - gained,
    )


def _by_functions(sums: Sums, columns: Columns, fitted: Integers) -> tuple[Floats, Floats, Floats, Floats]:
    """Products of the columns, with the functions of their derivatives, of those, and of those with the residual."""
    whole = len(columns.modes)
    if len(fitted) == 2 * whole:
        return sums.gram, sums.mixed, sums.slopes, sums.late
    # Of each half, the columns times t, and of derivatives by q the columns themselves.
    beyond = columns.factors[columns.modes] == ODD_SLOPE
    timed = np.tile(~beyond, 2)
    mixed = np.where(timed, sums.mixed[fitted], sums.gram[fitted])
    once = np.where(timed, sums.mixed, sums.gram)  # products of the columns with the functions
    slopes = np.where(timed[:, None], np.where(timed, sums.slopes, sums.mixed.T), once)
    residual = np.where(timed[:, None], sums.late, sums.seen)
    return sums.gram[np.ix_(fitted, fitted)], mixed, slopes, residual


def _sizes(gram: Floats, columns: Columns) -> Floats:
    """Sums of squares of the cosines and sines, of a forced response the larger of both for both (2 columns,)."""
    size = np.diag(gram)
    half = len(size) // 2
    forced = np.tile(columns.exponents[columns.modes[:half]] == 0.0, 2)
    return np.where(forced, np.maximum(size, np.roll(size, half)), size)


def _inverse(matrix: Floats, size: Floats) -> tuple[Floats, bool]:
    """The inverse of a Gram matrix, directions that are rounding left out; and whether its columns are well apart."""
    if not len(matrix):
        return matrix, True
    scale = np.sqrt(np.where(size > np.finfo(float).tiny, size, 1.0))
    scaled = matrix / np.outer(scale, scale)
    try:
        lower = np.linalg.cholesky(scaled)
        if np.diag(lower).min() ** 2 > SAFE:
            root = np.linalg.inv(lower)
            return root.T @ root / np.outer(scale, scale), True
    except np.linalg.LinAlgError:
        pass
    return scaled_inverse(matrix, ROUNDING, scale=scale), False


@dataclass(frozen=True, slots=True)
class Reduced:
    """Sums of one block with its fixed columns eliminated; numbers are real parts, then imaginary parts."""

    gram: Floats  # products of the columns (2 columns, 2 columns)
    mixed: Floats  # products of the columns with all columns times t (2 columns, 2 all)
    slopes: Floats  # products of all columns times t (2 all, 2 all)
    late: Floats  # products of those with the residual of free residues (2 all, rows)
    seen: Complexes  # coefficients of free residues (all, rows)
    back: Floats  # coefficients of the fixed columns by those of the others (2 fixed, 2 columns)


def complex_parts(coefficients: Floats) -> Complexes:
    """α - iβ (columns, rows)."""
    n = len(coefficients) // 2
    return coefficients[:n] - 1j * coefficients[n:]


def real_parts(values: Complexes) -> Floats:
    """Real parts, then imaginary parts (2 n, …)."""
    return np.concatenate([values.real, values.imag])


def times(states: Complexes) -> Floats:
    """The product with complex numbers, as a matrix on real parts, then imaginary parts (2 n, 2 n)."""
    real, imag = np.diag(states.real), np.diag(states.imag)
    return np.block([[real, -imag], [imag, real]])


def reduced(linear: Linear, entries: ModeParameters, free: Indices) -> Reduced:
    """The sums of a block, its fixed columns eliminated."""
    n, sines = len(entries.sines()), entries.sines()
    signs = np.repeat([1.0, -1.0], n)
    turn = signs[:, None] * signs
    gram, mixed = turn * linear.gram, turn * linear.mixed
    slopes = turn * (linear.curvature + linear.mixed.T @ linear.inverse @ linear.mixed)
    late = signs[:, None] * linear.slope
    beside = np.setdiff1d(np.arange(n), free)
    here, there = np.concatenate([free, n + free]), np.concatenate([beside, n + beside])
    inverse = np.zeros((len(there),) * 2)
    kept = np.flatnonzero(np.concatenate([np.ones(len(beside), bool), sines[beside]]))
    inverse[np.ix_(kept, kept)] = scaled_inverse(gram[np.ix_(there, there)][np.ix_(kept, kept)], ROUNDING)
    back = inverse @ gram[np.ix_(there, here)]
    return Reduced(
        gram=gram[np.ix_(here, here)] - gram[np.ix_(here, there)] @ back,
        mixed=mixed[here] - back.T @ mixed[there],
        slopes=slopes - mixed[there].T @ inverse @ mixed[there],
        late=late,
        seen=complex_parts(linear.coefficients),
        back=back,
    )
