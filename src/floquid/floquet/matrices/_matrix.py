"""The type that every form of a periodic matrix has, checks of what the forms are given, and units that balance one."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from floquid._arrays import Floats
from floquid._checks import frozen_array, input_error, positive, wrong_value

if TYPE_CHECKING:
    from floquid.floquet.matrices._series import HarmonicMatrix, SampledMatrix

_STEPS, _MOVED = 50, 1e-9


def binary_units(matrix: Floats) -> Floats:
    """The diagonal of D, powers of two, for which the rows and columns of D⁻¹ M D are of like norm (n,)."""
    from scipy.linalg import matrix_balance

    if not matrix.any():
        return np.ones(len(matrix))
    with np.errstate(invalid="ignore"):  # it makes integers of the units too, where it looks for permutations
        return matrix_balance(matrix, permute=False, separate=True)[1][0]


def balanced_units(matrix: Floats) -> Floats:
    """The diagonal of D for which the rows and columns of D⁻¹ M D are of equal norm, beside the diagonal (n,)."""
    from scipy.sparse.csgraph import connected_components

    scale = binary_units(matrix)
    rest = matrix * (scale[None, :] / scale[:, None])
    np.fill_diagonal(rest, 0.0)
    _, part = connected_components(rest != 0.0, connection="strong")
    rest[part[:, None] != part[None, :]] = 0.0
    weights = rest**2 / max(float((rest**2).max()), 1e-300)
    # The sum of squares is convex in the logarithms u of D (Osborne 1960), and its minimum is what is looked for: by
    # Newton's method, each step cut to a factor e. Where one part of the states drives another and is not driven by
    # it, there is no minimum between the two, and their units are left to each other as they are.
    u = np.zeros(len(scale))
    for _ in range(_STEPS):
        w = weights * np.exp(2.0 * (u[None, :] - u[:, None]))
        slope = w.sum(axis=0) - w.sum(axis=1)
        bend = 2.0 * (np.diag(w.sum(axis=0) + w.sum(axis=1)) - w - w.T)
        step = -np.linalg.lstsq(bend, slope, rcond=1e-12)[0]
        largest = float(np.abs(step).max())
        u = u + step / max(1.0, largest)
        if largest < _MOVED:
            break
    return scale * np.exp(u - u.mean())


def balance(samples: Floats) -> tuple[Floats, float]:
    """Units of the states that balance A (n,), powers of two, and the largest row sum in them."""
    largest = np.abs(samples).max(axis=0)
    scale = binary_units(largest)
    return scale, float((largest * scale / scale[:, None]).sum(axis=1).max())


SAME = 1e-12
"""Share of a period within which two periods, or two instants, are one: sums of 10 000 equal parts stray by 3e-13."""

Change: TypeAlias = Callable[[NDArray[Any]], NDArray[Any]]
"""A linear change of every matrix of a stack (..., rows, columns)."""


class Elements(NamedTuple):
    """A periodic matrix as a series of Legendre polynomials in each of some intervals."""

    left: Floats  # where each begins (elements,) [s]
    width: Floats  # how long each is (elements,) [s]
    series: Floats  # the coefficients (elements, degrees, rows, columns)


def merged(times: Floats, period: float) -> Floats:
    """Instants of one period, ascending, each once: those nearer than `SAME` of the period are one instant."""
    ordered = np.unique(np.minimum(times, np.nextafter(period, 0.0)))
    if ordered.size < 2:
        return ordered
    kept = ordered[np.append(True, np.diff(ordered) > SAME * period)]
    # The end of the period is its beginning.
    return kept[:-1] if kept.size > 1 and period - kept[-1] + kept[0] <= SAME * period else kept


def of_stack(change: Change, values: NDArray[Any]) -> NDArray[Any]:
    """Matrices (rows, columns, stack) after a `change` of each."""
    return np.moveaxis(change(np.moveaxis(values, 2, 0)), 0, 2)


def _changed(change: Change, matrix: AbstractPeriodicMatrix, times: Floats) -> Floats:
    """The values after a change: no closure, so that what holds it can be pickled."""
    return change(matrix.at(times))


def _operations():
    """The room: an algebra is circular by nature, and this late import is the one that runs back."""
    from floquid.floquet import matrices

    return matrices


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
    def breaks(self) -> Floats:
        """Instants in [0, T) at which the matrix or a derivative jumps (breaks,) [s]."""
        return np.empty(0)

    @abstractmethod
    def at(self, times: ArrayLike) -> Floats:
        """The values at `times` [s] of any shape (..., rows, columns)."""

    @property
    def is_constant(self) -> bool:
        """True of a form that has one value only."""
        return False

    @property
    def is_function(self) -> bool:
        """True where calls of a function alone tell the values: it may have another period, or jump unseen."""
        return False

    @property
    def narrowest(self) -> float:
        """The shortest feature that must be seen, as a fraction of the period."""
        return 1.0

    @property
    def fastest(self) -> int:
        """The highest harmonic that counts in any entry; 0 where the form has none."""
        return 0

    def series(self) -> HarmonicMatrix | None:
        """The Fourier series, where the form is one exactly."""
        return None

    def samples(self) -> SampledMatrix | None:
        """The matrix itself, where it is given by samples."""
        return None

    def pieces(self) -> Elements | None:
        """The constant pieces, where the form has them."""
        return None

    def mapped(self, change: Change) -> AbstractPeriodicMatrix:
        """The matrix after a linear `change` of every value, in the same form."""
        return self._function(partial(_changed, change, self), self.period, self.breaks)

    def shifted(self, value: Floats) -> AbstractPeriodicMatrix:
        """The matrix plus a constant `value` (rows, columns), in the same form."""
        return self.mapped(partial(np.add, value))  # a spline through shifted samples is the shifted spline

    def _function(self, function: Callable[..., Floats], period: float, breaks: Floats) -> AbstractPeriodicMatrix:
        return _operations().FunctionMatrix(function=function, period=period, breaks=breaks, vectorised=True)

    def __call__(self, times: ArrayLike) -> Floats:
        return self.at(times)

    # numpy must not broadcast over the operands itself.
    __array_ufunc__ = None

    def __add__(self, other: Any) -> AbstractPeriodicMatrix:
        return _operations().added(self, other, 1.0)

    __radd__ = __add__

    def __sub__(self, other: Any) -> AbstractPeriodicMatrix:
        return _operations().added(self, other, -1.0)

    def __rsub__(self, other: Any) -> AbstractPeriodicMatrix:
        return -self + other

    def __neg__(self) -> AbstractPeriodicMatrix:
        return self * -1.0

    def __mul__(self, factor: Any) -> AbstractPeriodicMatrix:
        return _operations().scaled(self, factor)

    __rmul__ = __mul__

    def __truediv__(self, divisor: Any) -> AbstractPeriodicMatrix:
        return self * (1.0 / divisor)

    def __matmul__(self, other: Any) -> AbstractPeriodicMatrix:
        return _operations().product(self, other)

    def __rmatmul__(self, other: Any) -> AbstractPeriodicMatrix:
        return _operations().product(other, self)

    @property
    def T(self) -> AbstractPeriodicMatrix:  # noqa: N802 - as numpy has it
        """The transpose."""
        return self.mapped(np.matrix_transpose)


GOLDEN = 0.3819660112501051  # off every simple fraction of the period, where jumps and zeros like to sit


def checked_period(period: float, of: str) -> float:
    """The period, whose fundamental is finite too."""
    length = positive(period, "period", of, unit="s")
    if not np.isfinite(4096.0 / length):
        raise input_error("period", of, "be long enough for a fundamental", f"is {length:g} s", "Check its unit.")
    return length


def checked_tolerance(tolerance: float, of: str, largest: float = 1e-3) -> float:
    """The tolerance, from 1e-14 to the `largest` that passes."""
    accuracy = positive(tolerance, "tolerance", of)
    if not 1e-14 <= accuracy <= largest:
        raise input_error("tolerance", of, f"lie in [1e-14, {largest:.0e}]".replace("e-0", "e-"), f"is {accuracy:g}")
    return accuracy


def as_array(value: ArrayLike, argument: str, of: str) -> NDArray[Any]:
    """The value given as an array, of whatever it holds."""
    try:
        return np.asarray(value)
    except ValueError:
        got = "has rows of unequal length"
        raise input_error(argument, of, "be an array", got, "Give each row as many numbers.") from None


def checked_breaks(breaks: ArrayLike, period: float, of: str) -> Floats:
    """The breaks sorted, each once, all in [0, period)."""
    instants = np.unique(frozen_array(breaks, "breaks", of, axes=("breaks",)))
    if instants.size and not (instants[0] >= 0.0 and instants[-1] < period):
        got = f"runs from {instants[0]:g} to {instants[-1]:g}"
        raise input_error("breaks", of, f"lie in [0, {period:g}) [s]", got, "Give each jump once, in the first period.")
    instants.flags.writeable = False
    return instants


def refuse_repeated_end(values: Floats, name: str, of: str) -> None:
    """Refuse samples whose last is the first again, as `linspace(0, T, P + 1)` makes them."""
    n_samples = values.shape[2]
    largest = np.abs(values).max(axis=2)
    parts = (values, values[..., :-1])
    with np.errstate(over="ignore", invalid="ignore"):  # what overflows here is refused where the harmonics are made
        if n_samples < 5 or (np.abs(values[..., -1] - values[..., 0]) > 1e-12 * largest).any():
            return
        tails = [np.abs(np.fft.rfft(v, axis=2))[..., 3 * v.shape[2] // 8 :].max(axis=2) for v in parts]
        repeats = tails[0] > 100.0 * tails[1] + 1e-9 * largest
    if repeats.any():
        must = "hold each phase of the period once"
        remedy = "Leave out the repeated end, `A[:, :, :-1]`; or give `times` to `SampledMatrix`."
        raise input_error(name, of, must, f"ends with its first sample again, the {n_samples}th", remedy)


def named(names: Sequence[str] | None, count: int, letter: str, argument: str, of: str) -> tuple[str, ...]:
    """Distinct names, as many as they have to be; by default the letter and a number."""
    if names is None:
        return tuple(f"{letter}{i}" for i in range(1, count + 1))
    if isinstance(names, str) or not all(isinstance(name, str) and name for name in names):
        raise wrong_value(argument, of, "be a list of names", names)
    if len(names) != count:
        raise input_error(argument, of, f"have {count} names", f"has {len(names)}")
    doubled = [name for name in dict.fromkeys(names) if list(names).count(name) > 1]
    if doubled:
        raise input_error(argument, of, "have distinct names", f"has {doubled[0]!r} twice", "Rename one of them.")
    return tuple(names)


def refuse_other_period(matrix: AbstractPeriodicMatrix, of: str) -> None:
    """Refuse a callable that is another matrix one period later."""
    times = probe_times(matrix.period)
    distance = np.abs(times[:, None] - np.asarray(matrix.breaks)[None, :])
    times = times[(distance > 1e-6 * matrix.period).all(axis=1)]
    now, later = matrix.at(times), matrix.at(times + matrix.period)
    differences = np.abs(later - now)
    # Entry by entry, whatever their units, and not below what rounding makes of entries that come and go.
    rounding = 1e-13 * np.abs(now).max()
    if now.shape[1] == now.shape[2]:
        scale, size = balance(now)
        rounding = 1e-13 * size * scale[:, None] / scale
    allowed = 1e-8 * np.abs(now).max(axis=0) + rounding
    over = (differences > allowed).any(axis=(1, 2))
    if over.any():
        worst, change = int(over.argmax()), differences.max(axis=(1, 2))
        got = f"A differs by {change[worst]:.3g} between t = {times[worst]:g} and one period of {matrix.period:g} later"
        remedy = (
            "Half a revolution is a period only in the fixed frame: check the period and the coordinates. Values in "
            "single precision are no periodic matrix: compute them in double."
        )
        raise input_error("period", of, "be a period of A(t)", got, remedy)


def probe_times(period: float, count: int = 16) -> Floats:
    """Instants spread over the period (times,) [s]."""
    return period * (np.arange(count) + GOLDEN) / count
