"""Sums of one block for the fit of one shape for all hits: columns that are fixed are eliminated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floquid._arrays import Complexes, Floats, Indices
from floquid.fit import scaled_inverse
from floquid.periodic.least_squares._parameters import ModeParameters
from floquid.periodic.least_squares._solver import ROUNDING, Linear


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


def smaller(linear: Linear, ridge: float) -> Floats:
    """Coefficients with a share of each column's size added to the Gram matrix (2 columns, rows)."""
    if ridge == 0.0:
        return linear.coefficients
    size = np.diag(linear.gram)
    wider = linear.gram + ridge * np.diag(np.where(size > 0.0, size, 1.0))
    return np.asarray(np.linalg.solve(wider, linear.gram @ linear.coefficients), np.float64)


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
