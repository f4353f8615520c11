"""A(t) in the forms that it may be given in, no series among them, and in that for integration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from floquid._arrays import Complexes, Floats
from floquid._checks import Rebuilt, frozen_array, input_error, positive
from floquid._show import Brief
from floquid.floquet.matrices._matrix import (
    GOLDEN,
    AbstractPeriodicMatrix,
    Change,
    Elements,
    as_array,
    balance,
    checked_breaks,
    checked_period,
    of_stack,
    probe_times,
    refuse_other_period,
)
from floquid.floquet.matrices._series import HarmonicMatrix, SampledMatrix, line_weights


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FunctionMatrix(Rebuilt, AbstractPeriodicMatrix):
    """M(t) as a callable.

    Raises InputError where the period is not positive or a break lies outside the first period. So it does where the
    function does not return finite real matrices of one shape.

    Parameters
    ----------
    function
        t [s] -> (rows, columns); or, when `vectorised`, times (times,) [s] -> (times, rows, columns).
    period
        The period T [s].
    breaks
        Instants in [0, T) at which the function or a derivative of it jumps (breaks,) [s]. There the value is taken
        from the side on which the step of an integration lies.
    vectorised
        Whether `function` takes an array of times, which is many times faster.
    narrowest
        The shortest feature of M(t), as a fraction of the period, that must be seen, from 1e-4 to 1/8: at least as many
        samples are taken. What is shorter, and not between `breaks`, may pass unseen; 1/16 is enough, and quicker, for
        what is known to be smooth.
    argument
        What messages call the function: the argument, and the callable it was given to.
    """

    function: Callable[..., ArrayLike]
    period: float  # type: ignore[assignment]
    breaks: ArrayLike = ()  # type: ignore[assignment]
    vectorised: bool = False
    narrowest: float = 1.0 / 64.0  # type: ignore[assignment]
    shape: tuple[int, int] = field(init=False)  # type: ignore[assignment]
    argument: tuple[str, str] = field(default=("function", "FunctionMatrix"), repr=False)
    _first: NDArray[Any] = field(init=False, repr=False)
    """The value at t = 0, which tells the shape, and need not be asked for again where calls are dear."""

    def __post_init__(self) -> None:
        name, of = self.argument
        if not callable(self.function):
            raise input_error(name, of, "be a callable, t [s] -> (rows, columns)", f"is {type(self.function).__name__}")
        object.__setattr__(self, "period", checked_period(self.period, of))
        object.__setattr__(self, "breaks", checked_breaks(self.breaks, self.period, of))
        if not 1e-4 <= positive(self.narrowest, "narrowest", of) <= 0.125:
            raise input_error("narrowest", of, "lie in [1e-4, 1/8], in periods", f"is {self.narrowest:g}")
        value = as_array(self.function(np.zeros(1) if self.vectorised else 0.0), name, of)
        first = value.shape[1:] if self.vectorised else value.shape
        if len(first) != 2 or not all(first):
            stack = "(times, rows, columns) for times (times,)" if self.vectorised else "(rows, columns)"
            raise input_error(name, of, f"return a matrix {stack}", f"returns shape {first} at t = 0")
        object.__setattr__(self, "shape", first)
        object.__setattr__(self, "_first", value)

    @property
    def is_function(self) -> bool:
        return True

    def at(self, times: ArrayLike) -> Floats:
        instants = np.asarray(times, dtype=np.float64)
        flat = instants.ravel()
        if self.vectorised:
            values = self._checked(self.function(flat), (len(flat), *self.shape))
        else:
            values = np.empty((len(flat), *self.shape))
            for index, time in enumerate(flat.tolist()):
                value = as_array(self.function(time), *self.argument) if time else self._first
                if value.shape != self.shape or value.dtype.kind not in "fiu":
                    value = self._checked(value, self.shape, time)
                values[index] = value
        if not np.isfinite(values).all():
            worst = flat[int(np.argmin(np.isfinite(values).all(axis=(1, 2))))]
            self._checked(values, values.shape, worst)
        return values.reshape(*instants.shape, *self.shape)

    def _checked(self, value: ArrayLike, shape: tuple[int, ...], time: float | None = None) -> Floats:
        remedy = "" if time is None else f"This is its value at t = {time:g}."
        return frozen_array(value, *self.argument, axes=shape, finite=time is not None, remedy=remedy)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PiecewiseMatrix(Brief, AbstractPeriodicMatrix):
    """M(t), constant in pieces: `values[:, :, i]` from `edges[i]` to the next edge, the last piece on to the first.

    Raises InputError where the edges do not ascend within one period, or are not as many as the matrices.

    Parameters
    ----------
    values
        The matrices (rows, columns, pieces).
    edges
        Where each piece begins, ascending in [0, T) (pieces,) [s].
    period
        The period T [s].
    """

    values: ArrayLike
    edges: ArrayLike
    period: float  # type: ignore[assignment]

    def __post_init__(self) -> None:
        of = "PiecewiseMatrix"
        object.__setattr__(self, "period", checked_period(self.period, of))
        values = frozen_array(self.values, "values", of, axes=("rows", "columns", "pieces"))
        if not values.size:
            raise input_error("values", of, "hold a piece at least", f"has shape {values.shape}")
        edges = frozen_array(self.edges, "edges", of, axes=(values.shape[2],), remedy="Give one for each piece.")
        if edges[0] < 0.0 or edges[-1] >= self.period or (np.diff(edges) <= 0.0).any():
            must = f"ascend within [0, {self.period:g}) [s]"
            raise input_error("edges", of, must, f"run from {edges[0]:g} to {edges[-1]:g}")
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "edges", edges)

    @property
    def shape(self) -> tuple[int, int]:
        rows, columns, _ = np.shape(self.values)
        return rows, columns

    @property
    def breaks(self) -> Floats:
        """The edges (pieces,) [s]; none of a single piece."""
        edges = np.asarray(self.edges)
        return edges if len(edges) > 1 else np.empty(0)

    def at(self, times: ArrayLike) -> Floats:
        folded = np.mod(np.asarray(times, dtype=np.float64), self.period)
        piece = np.searchsorted(np.asarray(self.edges), folded, side="right") - 1  # -1 is the last piece, as it must
        return np.moveaxis(np.asarray(self.values), 2, 0)[piece]

    @property
    def is_constant(self) -> bool:
        return len(np.asarray(self.edges)) == 1

    def pieces(self) -> Elements:
        edges = np.asarray(self.edges)
        width = np.append(edges[1:], edges[0] + self.period) - edges
        return Elements(edges, width, np.moveaxis(np.asarray(self.values), 2, 0)[:, None])

    def mapped(self, change: Change) -> PiecewiseMatrix:
        return PiecewiseMatrix(values=of_stack(change, np.asarray(self.values)), edges=self.edges, period=self.period)


def values_between(matrix: AbstractPeriodicMatrix, edges: Floats, period: float) -> Floats:
    """The values in the middle between each edge and the next one (rows, columns, edges)."""
    ends = np.append(edges[1:], edges[0] + period)
    return np.moveaxis(matrix.at(0.5 * (edges + ends)), 0, 2)


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
            must, got = f"be left out or be that of the matrix, {system.period:g} s", f"is {period:g} s"
            raise input_error("period", of, must, got, "A matrix has its own.")
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
