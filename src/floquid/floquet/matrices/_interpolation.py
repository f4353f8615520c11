"""Interpolation between the samples of a matrix."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from floquid._arrays import Complexes, Floats, Integers
from floquid._checks import input_error


def line_weights(n_samples: int) -> Floats:
    """Weights of the lines of `rfft` of `n_samples` in the real series through the samples (lines,)."""
    weights = np.full(n_samples // 2 + 1, 2.0 / n_samples)
    weights[0] = 1.0 / n_samples
    if n_samples % 2 == 0:
        weights[-1] = 1.0 / n_samples  # e^{iPωt/2} and its conjugate share the one term of the highest line
    return weights


def interpolant(
    values: Floats, times: Floats, period: float, kind: str, argument: tuple[str, str] = ("values", "SampledMatrix")
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
                return CubicSpline(knots, stack, bc_type="periodic")  # it goes on periodically
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
