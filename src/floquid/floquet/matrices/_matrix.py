"""The type that every form of a periodic matrix has."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from floquid._arrays import Floats

if TYPE_CHECKING:
    from floquid.floquet.matrices._forms import PiecewiseMatrix
    from floquid.floquet.matrices._series import HarmonicMatrix, SampledMatrix

SAME = 1e-12  # relative difference within which two periods, or two instants of one period, are the same

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


def tiled(times: Floats, period: float, count: int, whole: float) -> Floats:
    """Instants of one period in `count` of them, which are together `whole` to within rounding."""
    every = np.add.outer(period * np.arange(count), times).ravel() * (whole / (count * period))
    return np.minimum(every, np.nextafter(whole, 0.0))


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

    def declared(self, count: int, period: float) -> AbstractPeriodicMatrix:
        """The matrix over `count` of its periods, together `period` to within rounding."""
        return self._function(self.at, period, tiled(self.breaks, self.period, count, period))

    def part(self, count: int) -> AbstractPeriodicMatrix:
        """The matrix over one of the `count` repetitions in its period."""
        period = self.period / count
        return self._function(self.at, period, merged(np.mod(self.breaks, period), period))

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
        return _operations().transposed(self)

    def to_harmonics(self, n_harmonics: int | None = None, *, tolerance: float = 1e-12) -> HarmonicMatrix:
        """The Fourier series.

        `n_harmonics` is the highest harmonic kept. By default the rest falls below `tolerance`, a share of each entry
        of the matrix. Raises InputError where the harmonics do not fall below `tolerance` within 512, as at a jump, and
        `n_harmonics` is not given; or a function does not repeat itself after its period.
        """
        return _operations().to_harmonics(self, n_harmonics, tolerance)

    def to_samples(self, n_samples: int) -> SampledMatrix:
        """The `n_samples` values at equal steps from t = 0, with the trigonometric polynomial between them.

        Harmonics from half of `n_samples` up are folded, unseen. At a jump the sample is the value after it.

        Raises InputError where a function does not repeat itself after its period.
        """
        return _operations().to_samples(self, n_samples)

    def to_pieces(self, n_pieces: int) -> PiecewiseMatrix:
        r"""The means over `n_pieces` equal pieces from t = 0.

        .. math:: M_i = \frac{P}{T} \int_{iT/P}^{(i + 1)T/P} M(t)\, dt

        The mean, rather than the value in the middle, keeps the integral over the period. So the product of the
        multipliers of A(t) stays. Exponents are right to second order in the length of a piece.

        Raises InputError where the means are not found, as of a function that jumps where it names no break; or a
        function does not repeat itself after its period.
        """
        return _operations().to_pieces(self, n_pieces)

    def repeated(self, count: int) -> AbstractPeriodicMatrix:
        """Matrix in the same form, declared over `count` of its periods."""
        return _operations().repeated(self, count)

    def reduced(self) -> AbstractPeriodicMatrix:
        """Matrix in the same form, declared over its smallest period.

        That is the period over k for the largest k, up to 1000, with which the matrix repeats itself to 1e-10 of its
        largest value: by its harmonics if it has them, else at 32 instants and between any two of its breaks. What is
        constant stays as it is; trigonometric samples that k does not divide become harmonics. Half or a third of a
        revolution is often the period of what two or three blades do to quantities of the fixed frame alone; a matrix
        that holds quantities of a single blade has the whole revolution, and is not reduced.
        """
        return _operations().reduced(self)
