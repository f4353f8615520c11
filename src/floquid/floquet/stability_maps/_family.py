"""Systems A(t; p) over many values of their parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Floats
from floquid._checks import frozen_array, input_error, positive
from floquid.floquet.matrices import as_array, balance, checked_tolerance

PROBED = 16  # instants at which a system is compared with itself one period later, and sized
PROBES = np.array([0.381966, 0.190983, 0.737])  # fractions of a period, off every simple one


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Family:
    """A(t; p) and its period T(p), checked; picklable if its callables are."""

    system: Callable[..., ArrayLike]
    period: float | Callable[..., ArrayLike]
    names: tuple[str, ...]
    vectorised: bool
    breaks: Floats  # fractions of the period in [0, 1) at which A jumps (breaks,)
    tolerance: float
    narrowest: float  # the shortest feature of A that must be seen, in periods
    scale: Floats
    """Units of the states (n,), powers of two: fixed, so that no point depends on those beside it."""

    of: str

    def periods(self, points: Floats) -> Floats:
        """T(p) (points,) [s] at the parameter values (points, parameters)."""
        if not callable(self.period):
            return np.full(len(points), self.period)
        if self.vectorised:
            value: Any = np.asarray(self.period(*points.T))
        else:
            value = np.asarray([self.period(*row) for row in points.tolist()])
        if value.dtype.kind not in "fiu" or value.shape not in {(), (len(points),)}:
            must = "return one real number [s] for each value of the parameters"
            raise input_error("period", self.of, must, f"returns {value.dtype} of shape {value.shape}")
        periods = np.broadcast_to(value.astype(np.float64), len(points))
        bad = ~(np.isfinite(periods) & (periods > 0.0))
        if bad.any():
            where = self.words(points[int(bad.argmax())])
            raise input_error("period", self.of, "be positive [s]", f"is {periods[bad][0]:g} at {where}")
        return periods

    def at(self, points: Floats, times: Floats) -> Floats:
        """A (points, times, n, n) at times (points, times) [s]."""
        n = len(self.scale)
        shape = (*times.shape, n, n)
        if self.vectorised:
            raw = np.asarray(self.system(times, *points.T[:, :, None]))
            if raw.dtype.kind not in "fiu" or raw.shape[-2:] != shape[-2:] or raw.shape != shape[-raw.ndim :]:
                must = f"return real matrices {shape} for times {times.shape} and parameters {(len(points), 1)}"
                remedy = "Let times and parameters broadcast, or pass `vectorised=False`."
                raise input_error("system", self.of, must, f"returns {raw.dtype} of shape {raw.shape}", remedy)
            values = np.broadcast_to(raw, shape).astype(np.float64, copy=False)
        else:
            values = np.empty(shape)
            for row, point, instants in zip(values, points.tolist(), times.tolist(), strict=True):
                for place, instant in enumerate(instants):
                    value = np.asarray(self.system(instant, *point))
                    if value.shape != (n, n) or value.dtype.kind not in "fiu":
                        got = f"returns {value.dtype} of shape {value.shape} at {self.words(point)}"
                        raise input_error("system", self.of, f"return a real matrix {(n, n)}", got)
                    row[place] = value
        if not np.isfinite(values).all():
            where = self.words(points[int(np.argmin(np.isfinite(values).all(axis=(1, 2, 3))))])
            raise input_error("system", self.of, "be finite", f"is not at {where}")
        return values

    def words(self, point: Sequence[float] | Floats) -> str:
        """The parameter values of a point, for a message."""
        return ", ".join(f"{name} = {value:g}" for name, value in zip(self.names, point, strict=True))


def family(
    system: Callable[..., ArrayLike],
    period: float | Callable[..., ArrayLike],
    points: Floats,
    names: tuple[str, ...],
    *,
    vectorised: bool,
    breaks: ArrayLike,
    tolerance: float,
    narrowest: float,
    of: str,
) -> Family:
    """The family, checked at the middle one of its points (points, parameters)."""
    if not callable(system):
        must = "be a callable, t [s] and the parameters -> (n, n)"
        raise input_error("system", of, must, f"is {type(system).__name__}", "One system has `floquet.exponents`.")
    if not callable(period):
        period = positive(period, "period", of, unit="s")
    jumps = np.unique(frozen_array(breaks, "breaks", of, axes=("breaks",)))
    if jumps.size and not (jumps[0] >= 0.0 and jumps[-1] < 1.0):
        got = f"runs from {jumps[0]:g} to {jumps[-1]:g}"
        raise input_error("breaks", of, "lie in [0, 1)", got, "In fractions of the period.")
    accuracy = checked_tolerance(tolerance, of)
    if not 1e-4 <= positive(narrowest, "narrowest", of) <= 0.125:
        raise input_error("narrowest", of, "lie in [1e-4, 1/8], in periods", f"is {narrowest:g}")
    middle = points[len(points) // 2 : len(points) // 2 + 1]
    first = system(np.zeros((1, 1)), *middle.T[:, :, None]) if vectorised else system(0.0, *middle[0].tolist())
    shape = as_array(first, "system", of).shape
    if len(shape) < 2 or shape[-1] != shape[-2] or not shape[-1] or (len(shape) > 2 and not vectorised):
        stack = "(..., n, n) for times and parameters that broadcast" if vectorised else "(n, n)"
        raise input_error("system", of, f"return a square matrix {stack}", f"returns shape {shape}")
    rough = Family(
        system=system,
        period=period,
        names=names,
        vectorised=vectorised,
        breaks=jumps,
        tolerance=accuracy,
        narrowest=narrowest,
        scale=np.ones(shape[-1]),
        of=of,
    )
    times = rough.periods(middle)[:, None] * (np.arange(PROBED) + PROBES[0]) / PROBED
    return replace(rough, scale=balance(rough.at(middle, times)[0])[0])
