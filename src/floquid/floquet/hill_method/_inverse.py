"""Hill's exponents beside modes that are known, by inverse iteration where their shapes are the coordinates."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from floquid._arrays import Complexes, Floats, Integers
from floquid.floquet.hill_method._eigenpairs import Problem, Truncated
from floquid.floquet.matrices import AbstractPeriodicMatrix, Reach, fourier

_EPS = float(np.finfo(float).eps)


class KnownModes(Protocol):
    """Modes found by another route."""

    @property
    def exponents(self) -> Complexes:
        """λ (modes,) [1/s]."""
        ...

    @property
    def coefficients(self) -> Complexes:
        """Harmonics of the shapes (modes, n, harmonics)."""
        ...

    @property
    def harmonics(self) -> Integers:
        """The harmonics, ascending from -N to N (harmonics,)."""
        ...


class Beside(NamedTuple):
    """The modes of Hill's problem beside known ones, and what their exponents are known to (modes,) [1/s]."""

    problem: Problem
    modes: Truncated
    change: Floats


def beside(
    matrix: AbstractPeriodicMatrix, scale: Floats, lines: Reach, known: KnownModes, tolerance: float
) -> Beside | None:
    r"""Modes of Hill's problem beside those of another route; None where those are too far to settle it, or too few.

    With the known shapes P(t) as coordinates, x = P z, Hill's problem is that of a matrix close to a diagonal one:

    .. math:: z' = (\Lambda + E(t))\, z, \qquad E = P^{-1} (A P - P' - P \Lambda)

    One step of inverse iteration at λ_r from its unit vector gives λ_r + E_rr, the mean over the period. Every E_rk
    takes part in the next step by its product with E_kr over the distance of λ_k, which is the change that is known.
    All must be within the tolerance, and the sum of the exponents the mean trace. Nothing is integrated: known
    exponents that are wrong show in E_rr, and shapes that are wrong in all of E.
    """
    n, reach, fundamental = matrix.shape[0], int(np.abs(known.harmonics).max()), 2.0 * np.pi / matrix.period
    if np.size(matrix.breaks) or not lines.ends or known.coefficients.shape[:2] != (n, n):
        return None
    count = 1 << int(2 * (reach + lines.highest) + 1).bit_length()  # A P - P' - P Λ has no harmonic beyond these
    times = matrix.period * np.arange(count) / count
    shapes = known.coefficients / scale[:, None]
    shapes = shapes / np.linalg.norm(shapes, axis=(1, 2), keepdims=True)
    waves = np.exp(1j * fundamental * np.multiply.outer(known.harmonics, times))
    at = (shapes @ waves).transpose(2, 1, 0)  # P(t) (times, n, modes)
    slopes = ((shapes * (1j * fundamental * known.harmonics)) @ waves).transpose(2, 1, 0)
    balanced = matrix.at(times) * (scale / scale[:, None])
    with np.errstate(all="ignore"):
        try:
            back = np.linalg.inv(at)
        except np.linalg.LinAlgError:
            return None
        error = np.fft.fft(back @ (balanced @ at - slopes - at * known.exponents), axis=0) / count
        shift = np.einsum("rr->r", error[0])
        # Distances of λ_r from λ_k + i m ω, the copies of every other mode (lines, modes, modes).
        m = np.fft.fftfreq(count, 1.0 / count)
        apart = np.subtract.outer(known.exponents, known.exponents) - 1j * fundamental * m[:, None, None]
        pairs = np.abs(error) * np.abs(np.roll(error[::-1], 1, axis=0)).transpose(0, 2, 1)
        pairs[0][np.diag_indices(n)] = 0.0  # λ_r itself
        change = np.where(pairs > 0.0, pairs / np.abs(apart), 0.0).sum(axis=(0, 2))
        condition = np.sqrt((np.abs(back) ** 2).sum(axis=2).mean(axis=0) * (np.abs(at) ** 2).sum(axis=1).mean(axis=0))
    problem = Problem(fourier(matrix, 2 * reach) * (scale / scale[:, None])[:, :, None], fundamental)
    found = Truncated(known.exponents + shift, shapes, np.zeros(n), condition)
    change = change + _EPS * condition * problem.norm
    allowed = tolerance * np.maximum(np.abs(found.exponents), fundamental)
    missed = abs(float(found.exponents.real.sum()) - problem.growth)
    if not (change <= allowed).all() or missed > allowed.sum() or (found.split(problem) > allowed).any():
        return None
    return Beside(problem, found, change)
