"""Periodic matrices that are series: of harmonics, or through the samples of one period."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from floquid._arrays import Complexes, Floats, Integers
from floquid._checks import Rebuilt, frozen_array, input_error, wrong_value
from floquid._show import Brief
from floquid.floquet.matrices._matrix import (
    AbstractPeriodicMatrix,
    Change,
    as_array,
    checked_period,
    of_stack,
    refuse_repeated_end,
)

Interpolation: TypeAlias = Literal["fourier", "cubic", "linear"]


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
            must, got = "be those of a real matrix", "the coefficient of some -m is not the conjugate of that of m"
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

    @property
    def is_constant(self) -> bool:
        return np.shape(self.harmonics) == (1,)

    @property
    def fastest(self) -> int:
        # Above a millionth of its entry: the steps of an integration must see it, however slow Φ is.
        sizes = np.abs(np.asarray(self.coefficients))
        counts = (sizes > 1e-6 * sizes.max(axis=2, keepdims=True)).any(axis=(0, 1))
        return int(np.abs(np.asarray(self.harmonics)[counts]).max(initial=0))

    def series(self) -> HarmonicMatrix:
        return self

    def mapped(self, change: Change) -> HarmonicMatrix:
        return real_series(of_stack(change, np.asarray(self.coefficients)), np.asarray(self.harmonics), self.period)

    def shifted(self, value: Floats) -> HarmonicMatrix:
        return sum_of_series(self, constant_matrix(value, self.period), 1.0)


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
            raise wrong_value("interpolation", of, f"be {words}", kind)
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

    @property
    def is_constant(self) -> bool:
        return np.shape(self.values)[2] == 1

    def series(self) -> HarmonicMatrix | None:
        if self.interpolation != "fourier":
            return None
        values = np.asarray(self.values)
        n_samples = values.shape[2]
        upper = np.fft.rfft(values, axis=2) * line_weights(n_samples)
        upper[..., 1:] *= 0.5  # each line is shared by m and -m
        upper *= np.exp(-2j * np.pi * np.asarray(self.times)[0] / self.period * np.arange(upper.shape[2]))
        count = n_samples // 2
        return real_series(two_sided(upper), np.arange(-count, count + 1), self.period)

    def samples(self) -> SampledMatrix:
        return self

    def mapped(self, change: Change) -> SampledMatrix:
        return self._with(of_stack(change, np.asarray(self.values)), np.asarray(self.times), self.period)

    def sum_on_grid(self, other: SampledMatrix, sign: float) -> SampledMatrix | None:
        """The sum, or with `sign` -1 the difference; None where `other` has other times, or others between them."""
        times = np.asarray(self.times)
        if self.interpolation != other.interpolation or not np.array_equal(times, np.asarray(other.times)):
            return None
        return self._with(np.asarray(self.values) + sign * np.asarray(other.values), times, self.period)

    def _with(self, values: Floats, times: Floats, period: float) -> SampledMatrix:
        return SampledMatrix(values=values, period=period, times=times, interpolation=self.interpolation)


def real_series(values: NDArray[Any], harmonics: Integers, period: float) -> HarmonicMatrix:
    """The series whose upper half is given: the lower half is made its conjugate exactly, whatever rounding did."""
    half = len(harmonics) // 2
    upper = values[..., half:].astype(np.complex128)
    if harmonics[half] == 0:
        upper[..., 0] = upper[..., 0].real
    lower = upper[..., len(harmonics) % 2 :][..., ::-1].conj()
    return HarmonicMatrix(coefficients=np.concatenate([lower, upper], axis=2), harmonics=harmonics, period=period)


def constant_matrix(value: Floats, period: float) -> HarmonicMatrix:
    """A constant (rows, columns) as a periodic matrix."""
    return HarmonicMatrix(coefficients=np.asarray(value)[:, :, None], harmonics=[0], period=period)


def sum_of_series(first: HarmonicMatrix, second: HarmonicMatrix, sign: float) -> HarmonicMatrix:
    """The sum of two series of one period, or with `sign` -1 their difference."""
    lines = np.union1d(np.asarray(first.harmonics), np.asarray(second.harmonics))
    values = np.zeros((*first.shape, len(lines)), dtype=np.complex128)
    values[..., np.searchsorted(lines, first.harmonics)] += np.asarray(first.coefficients)
    values[..., np.searchsorted(lines, second.harmonics)] += sign * np.asarray(second.coefficients)
    return real_series(values, lines, first.period)


def product_of_series(first: HarmonicMatrix, second: HarmonicMatrix) -> HarmonicMatrix:
    """The product of two series of one period: their coefficients convolved."""
    sums = np.add.outer(np.asarray(second.harmonics), np.asarray(first.harmonics))
    lines, place = np.unique(sums, return_inverse=True)
    place = place.reshape(sums.shape)
    values = np.zeros((first.shape[0], second.shape[1], len(lines)), dtype=np.complex128)
    left, right = np.asarray(first.coefficients), np.asarray(second.coefficients)
    for index in range(right.shape[2]):  # within one line of the right, no two lines of the left have one sum
        values[..., place[index]] += np.einsum("ijm,jk->ikm", left, right[..., index])
    return real_series(values, lines, first.period)


def two_sided(upper: Complexes) -> Complexes:
    """Coefficients of -M..M of a real matrix from those of 0..M."""
    parts = [upper[..., :0:-1].conj(), upper[..., :1].real, upper[..., 1:]]
    return np.concatenate(parts, axis=-1, dtype=np.complex128)


def line_weights(n_samples: int) -> Floats:
    """Weights of the lines of `rfft` of `n_samples` in the real series through the samples (lines,)."""
    weights = np.full(n_samples // 2 + 1, 2.0 / n_samples)
    weights[0] = 1.0 / n_samples
    if n_samples % 2 == 0:
        weights[-1] = 1.0 / n_samples  # e^{iPωt/2} and its conjugate share the one term of the highest line
    return weights


def interpolant(
    values: Floats, times: Floats, period: float, kind: str, argument: tuple[str, str]
) -> Callable[[Floats], Floats]:
    """The values between the samples: times (...) -> (..., rows, columns). It can be sent to another process."""
    shortest = float(np.diff(times, append=times[0] + period).min())
    knots = np.append(times, times[0] + period)
    stack = np.moveaxis(np.concatenate([values, values[..., :1]], axis=2), 2, 0)
    try:
        with np.errstate(over="raise", invalid="raise"):
            if kind == "fourier" or values.shape[2] == 1:
                return partial(_series, np.fft.rfft(values, axis=2) * line_weights(values.shape[2]), times[0], period)
            from scipy.interpolate import CubicSpline, make_interp_spline

            if kind == "cubic":
                return CubicSpline(knots, stack, bc_type="periodic")  # a periodic spline continues itself
            line = make_interp_spline(knots, stack, k=1)
            line.extrapolate = "periodic"
            return line
    except (FloatingPointError, ValueError):  # scipy refuses differences that have overflowed
        got = f"reach {np.abs(values).max():.3g} at steps down to {shortest:.3g} s, where that overflows"
        remedy = "Leave out one of two times that are nearly one, or choose other units."
        raise input_error(*argument, "be such that what is between them can be worked out", got, remedy) from None


def series_at(lines: Complexes, harmonics: Integers, phases: Floats) -> Floats:
    """Re Σ of the lines (rows, columns, harmonics) times e^{2πi m φ}, at phases φ in periods (..., rows, columns)."""
    rows, columns, count = lines.shape
    angle = np.multiply.outer(np.mod(phases.ravel(), 1.0), 2.0 * np.pi * harmonics)
    flat = lines.reshape(-1, count).T
    return (np.cos(angle) @ flat.real - np.sin(angle) @ flat.imag).reshape(*phases.shape, rows, columns)


def _series(lines: Complexes, start: float, period: float, at: Floats) -> Floats:
    return series_at(lines, np.arange(lines.shape[2]), (at - start) / period)
