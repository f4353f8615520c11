"""Periodic matrices: a function of time, samples, harmonics or constant pieces, of one period."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from floquid._checks import frozen_array, input_error, positive

Interpolation: TypeAlias = Literal["fourier", "cubic", "linear"]


class AbstractPeriodicMatrix(ABC):
    """A real matrix M(t) = M(t + T): what all its forms answer."""

    __slots__ = ()

    @property
    @abstractmethod
    def period(self) -> float:
        """The period T [s]."""

    @property
    @abstractmethod
    def shape(self) -> tuple[int, int]:
        """The numbers of rows and columns."""

    @property
    def breaks(self) -> NDArray[np.float64]:
        """Instants in [0, T) at which the matrix or a derivative jumps (breaks,) [s]."""
        return np.empty(0)

    @abstractmethod
    def at(self, times: ArrayLike) -> NDArray[np.float64]:
        """The values at `times` [s] of any shape (..., rows, columns)."""

    def __call__(self, times: ArrayLike) -> NDArray[np.float64]:
        return self.at(times)

    # The arithmetic is in `_arithmetic`, which knows the forms; numpy must not broadcast over the operands itself.
    __array_ufunc__ = None

    def __add__(self, other: Any) -> AbstractPeriodicMatrix:
        from floquid.floquet._arithmetic import added

        return added(self, other, 1.0)

    __radd__ = __add__

    def __sub__(self, other: Any) -> AbstractPeriodicMatrix:
        from floquid.floquet._arithmetic import added

        return added(self, other, -1.0)

    def __rsub__(self, other: Any) -> AbstractPeriodicMatrix:
        return -self + other

    def __neg__(self) -> AbstractPeriodicMatrix:
        return self * -1.0

    def __mul__(self, factor: Any) -> AbstractPeriodicMatrix:
        from floquid.floquet._arithmetic import scaled

        return scaled(self, factor)

    __rmul__ = __mul__

    def __matmul__(self, other: Any) -> AbstractPeriodicMatrix:
        from floquid.floquet._arithmetic import product

        return product(self, other)

    def __rmatmul__(self, other: Any) -> AbstractPeriodicMatrix:
        from floquid.floquet._arithmetic import product

        return product(other, self)

    @property
    def T(self) -> AbstractPeriodicMatrix:  # noqa: N802 - as numpy has it
        """The transpose."""
        from floquid.floquet._arithmetic import transposed

        return transposed(self)

    def to_harmonics(self, n_harmonics: int | None = None, *, tolerance: float = 1e-12) -> HarmonicMatrix:
        """The Fourier series.

        Parameters
        ----------
        n_harmonics
            The highest harmonic kept; what lies above is left out, however much it is. By default as many as it takes
            for the rest to fall below `tolerance`.
        tolerance
            What the harmonics left out may come to, as a share of each entry of the matrix.

        Returns
        -------
        HarmonicMatrix
            The series.

        Raises
        ------
        InputError
            The harmonics do not fall below `tolerance` within 512, as at a jump, and `n_harmonics` is not given.
        """
        from floquid.floquet._conversion import to_harmonics

        return to_harmonics(self, n_harmonics, tolerance)

    def to_samples(self, n_samples: int) -> SampledMatrix:
        """Samples at equal steps from t = 0, with the trigonometric polynomial between them.

        Parameters
        ----------
        n_samples
            Samples in the period; harmonics from half of it up are folded, unseen. At a jump the sample is the value
            after it.

        Returns
        -------
        SampledMatrix
            The samples.
        """
        from floquid.floquet._conversion import to_samples

        return to_samples(self, n_samples)

    def to_pieces(self, n_pieces: int) -> PiecewiseMatrix:
        r"""Equal pieces from t = 0, in each of which the matrix is its mean there.

        .. math:: M_i = \frac{P}{T} \int_{iT/P}^{(i + 1)T/P} M(t)\, dt

        The mean, rather than the value in the middle, keeps the integral over the period, so that of A(t) the product
        of the multipliers stays what it is. Exponents are right to second order in the length of a piece.

        Parameters
        ----------
        n_pieces
            Pieces in the period, P.

        Returns
        -------
        PiecewiseMatrix
            The pieces.

        Raises
        ------
        InputError
            The means are not found, as of a function that jumps where it names no break.
        """
        from floquid.floquet._conversion import to_pieces

        return to_pieces(self, n_pieces)

    def repeated(self, count: int) -> AbstractPeriodicMatrix:
        """The same matrix declared over `count` of its periods.

        Parameters
        ----------
        count
            Periods in the new one.

        Returns
        -------
        AbstractPeriodicMatrix
            The matrix, in the same form.
        """
        from floquid.floquet._periods import repeated

        return repeated(self, count)

    def reduced(self) -> AbstractPeriodicMatrix:
        """The same matrix declared over its smallest period.

        That is the period over k for the largest k, up to 1000, with which the matrix repeats itself to 1e-10 of its
        largest value: by its harmonics if it has them, else at 32 instants and between any two of its breaks. What is
        constant has no smallest period and stays as it is. Half or a third of a revolution is often the period of
        what two or three blades do to quantities of the fixed frame alone; a matrix that holds quantities of a single
        blade has the whole revolution, and is not reduced.

        Returns
        -------
        AbstractPeriodicMatrix
            The matrix, in the same form; of trigonometric samples that k does not divide, the harmonics.
        """
        from floquid.floquet._periods import reduced

        return reduced(self)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FunctionMatrix(AbstractPeriodicMatrix):
    """M(t) as a callable.

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

    Raises
    ------
    InputError
        The period is not positive, a break lies outside the first period, or the function does not return finite
        real matrices of one shape.
    """

    function: Callable[..., ArrayLike]
    period: float  # type: ignore[assignment]
    breaks: ArrayLike = ()  # type: ignore[assignment]
    vectorised: bool = False
    shape: tuple[int, int] = field(init=False)  # type: ignore[assignment]
    argument: tuple[str, str] = field(default=("function", "FunctionMatrix"), repr=False)
    """What messages call it: the argument and the callable it was given to."""

    def __post_init__(self) -> None:
        name, of = self.argument
        if not callable(self.function):
            raise input_error(name, of, "be a callable, t [s] -> (rows, columns)", f"is {type(self.function).__name__}")
        object.__setattr__(self, "period", positive(self.period, "period", of, unit="s"))
        object.__setattr__(self, "breaks", checked_breaks(self.breaks, self.period, of))
        first = np.shape(self.function(np.zeros(1)))[1:] if self.vectorised else np.shape(self.function(0.0))
        if len(first) != 2 or not all(first):
            stack = "(times, rows, columns) for times (times,)" if self.vectorised else "(rows, columns)"
            raise input_error(name, of, f"return a matrix {stack}", f"returns shape {first} at t = 0")
        object.__setattr__(self, "shape", first)

    def at(self, times: ArrayLike) -> NDArray[np.float64]:
        """The values at `times` [s] of any shape (..., rows, columns)."""
        instants = np.asarray(times, dtype=np.float64)
        flat = instants.ravel()
        if self.vectorised:
            values = self._checked(self.function(flat), (len(flat), *self.shape))
        else:
            values = np.empty((len(flat), *self.shape))
            for index, time in enumerate(flat.tolist()):
                value = np.asarray(self.function(time))
                if value.shape != self.shape or value.dtype.kind not in "fiu":
                    value = self._checked(value, self.shape, time)
                values[index] = value
        if not np.isfinite(values).all():
            worst = flat[int(np.argmin(np.isfinite(values).all(axis=(1, 2))))]
            self._checked(values, values.shape, worst)
        return values.reshape(*instants.shape, *self.shape)

    def _checked(self, value: ArrayLike, shape: tuple[int, ...], time: float | None = None) -> NDArray[np.float64]:
        remedy = "" if time is None else f"This is its value at t = {time:g}."
        return frozen_array(value, *self.argument, axes=shape, finite=time is not None, remedy=remedy)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HarmonicMatrix(AbstractPeriodicMatrix):
    r"""M(t) as a finite Fourier series.

    .. math:: M(t) = \sum_m M_m\, e^{i m \omega t}, \qquad \omega = 2\pi/T, \qquad M_{-m} = \overline{M_m}

    Parameters
    ----------
    coefficients
        The matrices M_m (rows, columns, harmonics).
    harmonics
        The integers m, each once, ascending, -m with every m (harmonics,).
    period
        The period T [s].

    Raises
    ------
    InputError
        A harmonic has no conjugate partner, or the coefficients are not those of a real matrix.
    """

    coefficients: ArrayLike
    harmonics: ArrayLike
    period: float  # type: ignore[assignment]

    def __post_init__(self) -> None:
        of = "HarmonicMatrix"
        object.__setattr__(self, "period", positive(self.period, "period", of, unit="s"))
        harmonics = frozen_array(self.harmonics, "harmonics", of, dtype=np.int64, axes=("harmonics",))
        if not harmonics.size or (np.diff(harmonics) <= 0).any() or (harmonics != -harmonics[::-1]).any():
            raise input_error(
                "harmonics", of, "ascend and hold -m with every m", f"are {harmonics.tolist()}", "Such as [-1, 0, 1]."
            )
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
            raise input_error(
                "coefficients",
                of,
                "be those of a real matrix",
                "the coefficient of some -m is not the conjugate of that of m",
                "Give both, or use `HarmonicMatrix.from_cosines`.",
            )
        object.__setattr__(self, "harmonics", harmonics)
        object.__setattr__(self, "coefficients", values)

    @property
    def shape(self) -> tuple[int, int]:
        """The numbers of rows and columns."""
        rows, columns, _ = np.shape(self.coefficients)
        return rows, columns

    @classmethod
    def from_cosines(
        cls, mean: ArrayLike, cosines: ArrayLike, sines: ArrayLike, *, period: float, harmonics: ArrayLike | None = None
    ) -> HarmonicMatrix:
        r"""The series in cosines and sines.

        .. math:: M(t) = M_0 + \sum_m \left(C_m \cos m\omega t + S_m \sin m\omega t\right)

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

        Returns
        -------
        HarmonicMatrix
            The same series in exponentials.

        Raises
        ------
        InputError
            The shapes do not agree, or the harmonics do not ascend from at least 1.
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

    def at(self, times: ArrayLike) -> NDArray[np.float64]:
        """The values at `times` [s] of any shape (..., rows, columns)."""
        instants = np.asarray(times, dtype=np.float64)
        values, harmonics = np.asarray(self.coefficients), np.asarray(self.harmonics)
        half = len(harmonics) // 2  # the upper half says all: the series is real
        angle = np.multiply.outer(np.mod(instants.ravel() / self.period, 1.0), 2.0 * np.pi * harmonics[half:])
        weight = np.where(harmonics[half:] == 0, 1.0, 2.0)
        upper = (values[..., half:] * weight).reshape(-1, len(weight)).T
        series = np.cos(angle) @ upper.real - np.sin(angle) @ upper.imag
        return series.reshape(*instants.shape, *self.shape)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SampledMatrix(AbstractPeriodicMatrix):
    """M(t) from its samples in one period.

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

    Raises
    ------
    InputError
        The times do not ascend within one period, or "fourier" is asked of unequal steps.
    """

    values: ArrayLike
    period: float  # type: ignore[assignment]
    times: ArrayLike | None = None
    interpolation: Interpolation | None = None
    argument: tuple[str, str] = field(default=("values", "SampledMatrix"), repr=False)
    """What messages call it: the argument and the callable it was given to."""
    _interpolant: Callable[[NDArray[np.float64]], NDArray[np.float64]] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        name, of = self.argument
        object.__setattr__(self, "period", positive(self.period, "period", of, unit="s"))
        flat = np.ndim(self.values) == 2
        remedy = "A constant matrix is one sample: pass `A[:, :, None]`." if flat else "Samples are the last axis."
        values = frozen_array(self.values, name, of, axes=("rows", "columns", "samples"), remedy=remedy)
        if not values.size:
            raise input_error(name, of, "hold a sample at least", f"has shape {values.shape}")
        n_samples = values.shape[2]
        even = self.period * np.arange(n_samples) / n_samples
        times = frozen_array(even if self.times is None else self.times, "times", of, axes=(n_samples,))
        if times[0] < 0.0 or times[-1] >= self.period or (np.diff(times) <= 0.0).any():
            raise input_error(
                "times",
                of,
                f"ascend within [0, {self.period:g}) [s]",
                f"run from {times[0]:g} to {times[-1]:g}",
                "Fold them into one period and sort them; leave out the repeated end.",
            )
        equal = bool(np.abs(times - times[0] - even).max() <= 1e-9 * self.period)
        kind = self.interpolation or ("fourier" if equal else "cubic")
        if kind not in get_args(Interpolation):
            words = " or ".join(f'"{word}"' for word in get_args(Interpolation))
            raise input_error("interpolation", of, f"be {words}", f"is {kind!r}")
        if kind == "fourier" and not equal:
            raise input_error(
                "interpolation", of, 'be "cubic" or "linear" for samples at unequal steps', 'is "fourier"'
            )
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "interpolation", kind)
        object.__setattr__(self, "_interpolant", _interpolant(values, times, self.period, kind))

    @property
    def shape(self) -> tuple[int, int]:
        """The numbers of rows and columns."""
        rows, columns, _ = np.shape(self.values)
        return rows, columns

    @property
    def breaks(self) -> NDArray[np.float64]:
        """The knots of a spline (breaks,) [s]; none of a trigonometric polynomial."""
        return np.empty(0) if self.interpolation == "fourier" else np.asarray(self.times)

    def at(self, times: ArrayLike) -> NDArray[np.float64]:
        """The values at `times` [s] of any shape (..., rows, columns)."""
        return self._interpolant(np.asarray(times, dtype=np.float64))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PiecewiseMatrix(AbstractPeriodicMatrix):
    """M(t), constant in pieces: `values[:, :, i]` from `edges[i]` to the next edge, the last piece on to the first.

    Parameters
    ----------
    values
        The matrices (rows, columns, pieces).
    edges
        Where each piece begins, ascending in [0, T) (pieces,) [s].
    period
        The period T [s].

    Raises
    ------
    InputError
        The edges do not ascend within one period, or are not as many as the matrices.
    """

    values: ArrayLike
    edges: ArrayLike
    period: float  # type: ignore[assignment]

    def __post_init__(self) -> None:
        of = "PiecewiseMatrix"
        object.__setattr__(self, "period", positive(self.period, "period", of, unit="s"))
        values = frozen_array(self.values, "values", of, axes=("rows", "columns", "pieces"))
        if not values.size:
            raise input_error("values", of, "hold a piece at least", f"has shape {values.shape}")
        edges = frozen_array(self.edges, "edges", of, axes=(values.shape[2],), remedy="Give one for each piece.")
        if edges[0] < 0.0 or edges[-1] >= self.period or (np.diff(edges) <= 0.0).any():
            raise input_error(
                "edges", of, f"ascend within [0, {self.period:g}) [s]", f"run from {edges[0]:g} to {edges[-1]:g}"
            )
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "edges", edges)

    @property
    def shape(self) -> tuple[int, int]:
        """The numbers of rows and columns."""
        rows, columns, _ = np.shape(self.values)
        return rows, columns

    @property
    def breaks(self) -> NDArray[np.float64]:
        """The edges (pieces,) [s]; none of a single piece."""
        edges = np.asarray(self.edges)
        return edges if len(edges) > 1 else np.empty(0)

    def at(self, times: ArrayLike) -> NDArray[np.float64]:
        """The values at `times` [s] of any shape (..., rows, columns)."""
        folded = np.mod(np.asarray(times, dtype=np.float64), self.period)
        piece = np.searchsorted(np.asarray(self.edges), folded, side="right") - 1  # -1 is the last piece, as it must
        return np.moveaxis(np.asarray(self.values), 2, 0)[piece]


def checked_breaks(breaks: ArrayLike, period: float, of: str) -> NDArray[np.float64]:
    """The breaks sorted, each once, all in [0, period)."""
    instants = np.unique(frozen_array(breaks, "breaks", of, axes=("breaks",)))
    if instants.size and not (instants[0] >= 0.0 and instants[-1] < period):
        raise input_error(
            "breaks",
            of,
            f"lie in [0, {period:g}) [s]",
            f"runs from {instants[0]:g} to {instants[-1]:g}",
            "Give each jump once, in the first period.",
        )
    instants.flags.writeable = False
    return instants


def line_weights(n_samples: int) -> NDArray[np.float64]:
    """What the lines of `rfft` of `n_samples` count for in the real series through the samples (lines,)."""
    weights = np.full(n_samples // 2 + 1, 2.0 / n_samples)
    weights[0] = 1.0 / n_samples
    if n_samples % 2 == 0:
        weights[-1] = 1.0 / n_samples  # e^{iPωt/2} and its conjugate share the one term of the highest line
    return weights


def _interpolant(
    values: NDArray[np.float64], times: NDArray[np.float64], period: float, kind: str
) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    """The values between the samples: times (...) -> (..., rows, columns)."""
    rows, columns, n_samples = values.shape
    if n_samples == 1:
        return lambda at: np.broadcast_to(values[..., 0], (*at.shape, rows, columns)).copy()
    if kind == "fourier":
        lines = (np.fft.rfft(values, axis=2) * line_weights(n_samples)).reshape(-1, n_samples // 2 + 1).T

        def series(at: NDArray[np.float64]) -> NDArray[np.float64]:
            angle = np.multiply.outer(
                np.mod((at.ravel() - times[0]) / period, 1.0), 2.0 * np.pi * np.arange(len(lines))
            )
            out = np.cos(angle) @ lines.real - np.sin(angle) @ lines.imag
            return out.reshape(*at.shape, rows, columns)

        return series
    from scipy.interpolate import CubicSpline, make_interp_spline

    knots = np.append(times, times[0] + period)
    closed = np.concatenate([values, values[..., :1]], axis=2)
    stack = np.moveaxis(closed, 2, 0)
    spline = CubicSpline(knots, stack, bc_type="periodic") if kind == "cubic" else make_interp_spline(knots, stack, k=1)
    return lambda at: np.asarray(spline(times[0] + np.mod(at - times[0], period)))
