"""A(t) in the forms that it may be given in, and in that for integration: harmonics where it is smooth."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Complexes, Floats
from floquid._checks import frozen_array, input_error, positive
from floquid.floquet.matrices._forms import FunctionMatrix
from floquid.floquet.matrices._matrix import (
    GOLDEN,
    AbstractPeriodicMatrix,
    as_array,
    balance,
    probe_times,
    refuse_other_period,
)
from floquid.floquet.matrices._series import HarmonicMatrix, SampledMatrix, line_weights

StateMatrix: TypeAlias = AbstractPeriodicMatrix | Callable[[float], ArrayLike] | ArrayLike
"""A(t): a periodic matrix, a callable t [s] -> (n, n) [1/s], or samples (n, n, phases) at t = 0, T/P, ..."""

LAST = 512  # samples of a period, at least, that are tried until its harmonics have died away


class Prepared(NamedTuple):
    """A(t) ready to be integrated."""

    matrix: AbstractPeriodicMatrix
    smooth: bool  # true if it is smooth between its breaks for certain
    scale: Floats  # units of the states (n,) in which A is best balanced
    size: float  # its largest row sum in these units [1/s]


def periodic(system: StateMatrix, period: float | None, breaks: ArrayLike, of: str) -> AbstractPeriodicMatrix:
    """A(t), in whatever form it was given, as a square periodic matrix of its period, or refused."""
    if isinstance(system, AbstractPeriodicMatrix):
        if period is not None and positive(period, "period", of, unit="s") != system.period:
            must = f"be left out or be that of the matrix, {system.period:g} s"
            got = f"is {period:g} s"
            raise input_error("period", of, must, got, "To declare another period use `repeated` or `reduced`.")
        if np.size(breaks):
            must = "be left out beside a periodic matrix"
            raise input_error("breaks", of, must, "is given", "The matrix has its own.")
        matrix = system
    elif period is None:
        raise input_error("period", of, "be given for a callable or samples", "is None", "In seconds: 2π/ω.")
    elif callable(system):
        matrix = FunctionMatrix(function=system, period=period, breaks=breaks, argument=("system", of))
    else:
        matrix = _sampled(system, period, breaks, of)
    if matrix.shape[0] != matrix.shape[1]:
        raise input_error("system", of, "be a square matrix (n, n)", f"is one of {matrix.shape}")
    return matrix


def prepare(matrix: AbstractPeriodicMatrix, tolerance: float, of: str) -> Prepared:
    """A(t) in harmonics if they die away below `tolerance` of it, else as it is; refused if it has another period."""
    if matrix.is_function:
        found = None if np.size(matrix.breaks) else resolve(matrix, tolerance)
        if found is None:
            refuse_other_period(matrix, of)
            samples = matrix.at(probe_times(matrix.period))
            scale, size = balance(samples)
            return Prepared(matrix, smooth=False, scale=scale, size=size)
        return found
    samples = matrix.at(probe_times(matrix.period))
    scale, size = balance(samples)
    return Prepared(matrix, smooth=True, scale=scale, size=size)


def resolve(matrix: AbstractPeriodicMatrix, tolerance: float) -> Prepared | None:
    """The harmonics of a matrix, the upper below `tolerance` of its size; None if they have no end within reach."""
    period = matrix.period
    n = first = 2 * int(np.ceil(0.5 / matrix.narrowest))
    probes = period * (1.0 + np.array([GOLDEN, 0.5 * GOLDEN]))
    samples = matrix.at(np.concatenate([period * np.arange(n) / n, probes]))
    samples, later = samples[:n], samples[n:]
    while True:
        scale, size = balance(samples)
        lines = np.fft.rfft(samples, axis=0) * line_weights(n)[:, None, None]
        upper = np.abs(lines[7 * n // 16 :]).sum(axis=0) * scale / scale[:, None]
        if upper.max() <= tolerance * size:
            found = _harmonic(_ended(lines, scale, size), period)
            missed = np.abs(later - found.at(probes)).max(axis=0) * scale / scale[:, None]
            if missed.max() <= 10.0 * max(tolerance, 1e-13) * size:
                return Prepared(found, smooth=True, scale=scale, size=size)
        if n >= max(LAST, 4 * first) or (n >= 48 and upper.max() > 0.3 * np.abs(lines).max()):
            return None
        between = matrix.at(period * (np.arange(n) + 0.5) / n)
        samples = np.stack([samples, between], axis=1).reshape(2 * n, *samples.shape[1:])
        n *= 2


def _ended(lines: Complexes, scale: Floats, size: float) -> Complexes:
    """The lines up to the last that is above rounding, and one more."""
    counts = (np.abs(lines) * scale / scale[:, None]).max(axis=(1, 2)) > 1e-17 * size
    last = int(np.flatnonzero(counts)[-1]) if counts.any() else 0
    return lines[: min(len(lines), last + 2)]


def _sampled(system: ArrayLike, period: float, breaks: ArrayLike, of: str) -> SampledMatrix:
    if np.size(breaks):
        must = "be left out beside samples"
        raise input_error("breaks", of, must, "is given", "For jumps give a callable or a PiecewiseMatrix.")
    shape = as_array(system, "system", of).shape
    if len(shape) == 3 and shape[0] != shape[1] and shape[1] == shape[2]:
        remedy = "Phase is the last axis: pass `np.moveaxis(A, 0, -1)`."
        raise input_error("system", of, "have shape (n, n, phases)", f"has shape {shape}", remedy)
    remedy = "A constant matrix is one sample: pass `A[:, :, None]`." if len(shape) == 2 else "Or pass a callable."
    values = frozen_array(system, "system", of, axes=("n", "n", "phases"), remedy=remedy)
    if values.shape[0] != values.shape[1] or not values.size:
        raise input_error("system", of, "have shape (n, n, phases)", f"has shape {values.shape}")
    return SampledMatrix(values=values, period=period, argument=("system", of))


def _harmonic(lines: Complexes, period: float) -> HarmonicMatrix:
    """The series of the lines of `rfft`, already weighted, the last of them left out."""
    upper = np.moveaxis(lines[1:-1], 0, 2) / 2.0
    return HarmonicMatrix(
        coefficients=np.concatenate([upper[..., ::-1].conj(), lines[0].real[..., None], upper], axis=2),
        harmonics=np.arange(1 - len(lines) + 1, len(lines) - 1),
        period=period,
    )
