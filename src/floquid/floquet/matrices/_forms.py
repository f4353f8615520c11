"""Periodic matrices: a function of time, samples, harmonics or constant pieces, of one period."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from floquid._arrays import Floats
from floquid._checks import Rebuilt, frozen_array, input_error, positive
from floquid._show import Brief
from floquid.floquet.matrices._given import as_array, checked_breaks, checked_period, refuse_repeated_end
from floquid.floquet.matrices._interpolation import interpolant, series_at
from floquid.floquet.matrices._matrix import AbstractPeriodicMatrix

Interpolation: TypeAlias = Literal["fourier", "cubic", "linear"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FunctionMatrix(Rebuilt, AbstractPeriodicMatrix):
    """M(t) as a callable.

    Raises InputError where the period is not positive, a break lies outside the first period, or the function does not
    return finite real matrices of one shape.

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
    narrowest: float = 1.0 / 64.0
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
class HarmonicMatrix(Brief, AbstractPeriodicMatrix):
    r"""M(t) as a finite Fourier series.

    .. math:: M(t) = \sum_m M_m\, e^{i m \omega t}, \qquad \omega = 2\pi/T, \qquad M_{-m} = \overline{M_m}

    Raises InputError where a harmonic has no conjugate partner, or the coefficients are not those of a real matrix.

    Parameters
    ----------
    coefficients
        The matrices M_m (rows, columns, harmonics).
    harmonics
        The integers m, each once, ascending, -m with every m (harmonics,).
    period
        The period T [s].
    """

    coefficients: ArrayLike
    harmonics: ArrayLike
    period: float  # type: ignore[assignment]

    def __post_init__(self) -> None:
        of = "HarmonicMatrix"
        object.__setattr__(self, "period", checked_period(self.period, of))
        harmonics = frozen_array(self.harmonics, "harmonics", of, dtype=np.int64, axes=("harmonics",))
        if not harmonics.size or (np.diff(harmonics) <= 0).any() or (harmonics != -harmonics[::-1]).any():
            must = "ascend and hold -m with every m"
            raise input_error("harmonics", of, must, f"are {harmonics.tolist()}", "Such as [-1, 0, 1].")
        values = frozen_array(
            self.coefficients,
            "coefficients",
            of,
            dtype=np.complex128,
            axes=("rows", "columns", len(harmonics)),
            remedy="Harmonics are the last axis.",
        )
        if not values.size:
            raise input_error("coefficients", of, "hold a matrix", f"has shape {values.shape}")
        if np.abs(values - values[..., ::-1].conj()).max() > 1e-12 * np.abs(values).max():
            must = "be those of a real matrix"
            got = "the coefficient of some -m is not the conjugate of that of m"
            raise input_error("coefficients", of, must, got, "Give both, or use `HarmonicMatrix.from_cosines`.")
        object.__setattr__(self, "harmonics", harmonics)
        object.__setattr__(self, "coefficients", values)

    @property
    def shape(self) -> tuple[int, int]:
        rows, columns, _ = np.shape(self.coefficients)
        return rows, columns

    @classmethod
    def from_cosines(
        cls, mean: ArrayLike, cosines: ArrayLike, sines: ArrayLike, *, period: float, harmonics: ArrayLike | None = None
    ) -> HarmonicMatrix:
        r"""The series in exponentials, from one in cosines and sines.

        .. math:: M(t) = M_0 + \sum_m \left(C_m \cos m\omega t + S_m \sin m\omega t\right)

        Raises InputError where the shapes do not agree, or the harmonics do not ascend from at least 1.

        Parameters
        ----------
        mean
            M_0 (rows, columns).
        cosines, sines
            C_m and S_m (rows, columns, harmonics).
        period
            The period T [s].
        harmonics
            The positive integers m, ascending (harmonics,); 1, 2, ... by default.
        """
        of = "HarmonicMatrix.from_cosines"
        constant = frozen_array(mean, "mean", of, axes=("rows", "columns"))
        even = frozen_array(cosines, "cosines", of, axes=(*constant.shape, "harmonics"))
        odd = frozen_array(sines, "sines", of, axes=even.shape)
        order = np.arange(1, even.shape[2] + 1) if harmonics is None else harmonics
        lines = frozen_array(order, "harmonics", of, dtype=np.int64, axes=(even.shape[2],))
        if lines.size and (lines[0] < 1 or (np.diff(lines) <= 0).any()):
            raise input_error("harmonics", of, "ascend from at least 1", f"are {lines.tolist()}", "The mean has m = 0.")
        upper = 0.5 * (even - 1j * odd)
        return cls(
            coefficients=np.concatenate([upper[..., ::-1].conj(), constant[..., None], upper], axis=2),
            harmonics=np.concatenate([-lines[::-1], [0], lines]),
            period=period,
        )

    def at(self, times: ArrayLike) -> Floats:
        harmonics = np.asarray(self.harmonics)
        half = len(harmonics) // 2  # the upper half says all: the series is real
        upper = np.asarray(self.coefficients)[..., half:] * np.where(harmonics[half:] == 0, 1.0, 2.0)
        return series_at(upper, harmonics[half:], np.asarray(times, dtype=np.float64) / self.period)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SampledMatrix(Rebuilt, AbstractPeriodicMatrix):
    """M(t) from its samples in one period.

    Raises InputError where the times do not ascend within one period, "fourier" is asked of unequal steps, or what is
    between the samples overflows.

    Parameters
    ----------
    values
        The samples (rows, columns, samples).
    period
        The period T [s].
    times
        The instants of the samples, ascending in [0, T) (samples,) [s]; by default equal steps from 0.
    interpolation
        "fourier", the trigonometric polynomial of lowest degree through samples in equal steps, which is exact when
        they resolve M(t); "cubic", the periodic spline of continuous curvature; "linear". By default "fourier" for
        equal steps and "cubic" for others.
    argument
        What messages call the samples: the argument, and the callable they were given to.
    """

    values: ArrayLike
    period: float  # type: ignore[assignment]
    times: ArrayLike | None = None
    interpolation: Interpolation | None = None
    argument: tuple[str, str] = field(default=("values", "SampledMatrix"), repr=False)
    _interpolant: Callable[[Floats], Floats] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        name, of = self.argument
        object.__setattr__(self, "period", checked_period(self.period, of))
        flat = as_array(self.values, name, of).ndim == 2
        remedy = "A constant matrix is one sample: pass `A[:, :, None]`." if flat else "Samples are the last axis."
        values = frozen_array(self.values, name, of, axes=("rows", "columns", "samples"), remedy=remedy)
        if not values.size:
            raise input_error(name, of, "hold a sample at least", f"has shape {values.shape}")
        n_samples = values.shape[2]
        even = self.period * np.arange(n_samples) / n_samples
        times = frozen_array(even if self.times is None else self.times, "times", of, axes=(n_samples,))
        if times[0] < 0.0 or times[-1] >= self.period or (np.diff(times) <= 0.0).any():
            must = f"ascend within [0, {self.period:g}) [s]"
            remedy = "Fold them into one period and sort them; leave out the repeated end."
            raise input_error("times", of, must, f"run from {times[0]:g} to {times[-1]:g}", remedy)
        equal = bool(np.abs(times - times[0] - even).max() <= 1e-9 * self.period)
        if self.times is None:
            refuse_repeated_end(values, name, of)
        kind = self.interpolation or ("fourier" if equal else "cubic")
        if kind not in get_args(Interpolation):
            words = " or ".join(f'"{word}"' for word in get_args(Interpolation))
            raise input_error("interpolation", of, f"be {words}", f"is {kind!r}")
        if kind == "fourier" and not equal:
            must = 'be "cubic" or "linear" for samples at unequal steps'
            raise input_error("interpolation", of, must, 'is "fourier"')
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "interpolation", kind)
        object.__setattr__(self, "_interpolant", interpolant(values, times, self.period, kind, self.argument))

    @property
    def shape(self) -> tuple[int, int]:
        rows, columns, _ = np.shape(self.values)
        return rows, columns

    @property
    def breaks(self) -> Floats:
        """The knots of a spline (breaks,) [s]; none of a trigonometric polynomial."""
        return np.empty(0) if self.interpolation == "fourier" else np.asarray(self.times)

    def at(self, times: ArrayLike) -> Floats:
        return self._interpolant(np.asarray(times, dtype=np.float64))


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
