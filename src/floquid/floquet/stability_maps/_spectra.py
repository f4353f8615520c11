"""Systems A(t; p) over many values of their parameters: exponents and growth, in batches."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from floquid._arrays import Complexes, Floats, Indices, Integers
from floquid._checks import frozen_array, input_error, positive
from floquid.floquet.matrices import LAST, as_array, balance, checked_tolerance, line_weights
from floquid.floquet.monodromy_matrix import MOST, divided, factorise, inverse, stages

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


ROUNDING = 4.0 * np.finfo(float).eps  # the share of an entry of A below which a harmonic of it is rounding
_INTERVALS = 20_000  # of the points that are integrated in one go
_DEFECTIVE = 4  # multipliers that may coalesce into one block: how far rounding may carry them is capped by it


class Spectra(NamedTuple):
    """Exponents, growth and eigenvectors at each of the points."""

    exponents: Complexes  # on the principal branch, ascending in their real parts (points, n) [1/s]
    growth: Floats  # the largest real part (points,) [1/s]
    certain: Floats  # the same with the error of each exponent taken off (points,) [1/s]
    multiplier: Complexes  # the largest multiplier (points,)
    vectors: NDArray[np.complex64]  # eigenvectors of Φ(T), ascending in the angles of their multipliers (points, n, n)


def spectra(of: Family, points: Floats) -> Spectra:
    """The spectra at the points (points, parameters); each as if it were alone."""
    periods = of.periods(points)
    return _eigen(of, *_products(of, points, periods), periods)


def _products(of: Family, points: Floats, periods: Floats) -> tuple[Floats, Integers, Floats]:
    """Φ(T) / 2^power (points, n, n), in balanced units; the power; the errors' gain (points,)."""
    n = len(of.scale)
    product = np.empty((len(points), n, n))
    power, gain = np.zeros(len(points), dtype=np.int64), np.empty(len(points))
    rest = np.arange(len(points))
    if not of.breaks.size:
        for group, series, size in _resolved(of, points, periods):
            product[group], power[group], gain[group] = _monodromy(
                of, points[group], size, _evaluator(series), smooth=True
            )
            rest = np.setdiff1d(rest, group, assume_unique=True)
    if rest.size:
        values, spans = points[rest], periods[rest]
        sizes = _sizes(of, _repeating(of, values, spans)) * spans

        def direct(owner: Indices, fractions: Floats) -> Floats:
            return of.at(values[owner], fractions * spans[owner, None]) * spans[owner, None, None, None]

        product[rest], power[rest], gain[rest] = _monodromy(of, values, sizes, direct, smooth=False)
    return product, power, gain


def _resolved(of: Family, points: Floats, periods: Floats) -> list[tuple[Indices, Floats, Floats]]:
    """Groups of points whose harmonics die away: their indices, the series of T A in fractions of T, and its size."""
    groups = []
    first = 2 * int(np.ceil(0.5 / of.narrowest))
    index, count = np.arange(len(points)), first
    samples = of.at(points, periods[:, None] * np.arange(count) / count)
    while index.size:
        spans = periods[index]
        sizes = _sizes(of, samples)
        lines = np.fft.rfft(samples, axis=1) * line_weights(count)[:, None, None]
        lines[:, 1:-1] = lines[:, 1:-1].conj()
        ratio = of.scale / of.scale[:, None]
        upper = (np.abs(lines[:, 7 * count // 16 :]).sum(axis=1) * ratio).max(axis=(1, 2))
        good = np.flatnonzero(upper <= of.tolerance * sizes)
        if good.size:
            kept = lines[good, :-1]
            series = np.concatenate([kept.real, kept[:, 1:].imag], axis=1).reshape(len(good), count - 1, -1)
            later = of.at(points[index[good]], spans[good, None] * (1.0 + PROBES[:2]))
            between = (_basis(PROBES[:2], count // 2) @ series).reshape(later.shape)
            missed = (np.abs(later - between).max(axis=1) * ratio).max(axis=(1, 2))
            right = missed <= 10.0 * max(of.tolerance, 1e-13) * sizes[good]
            good = good[right]
            if good.size:
                groups.append((index[good], series[right] * spans[good, None, None], sizes[good] * spans[good]))
        hopeless = (count >= 64) & (upper > 0.3 * np.abs(lines).max(axis=(1, 2, 3)))
        left = np.setdiff1d(np.flatnonzero(~hopeless), good, assume_unique=True)
        if count >= max(LAST, 4 * first) or not left.size:
            break
        index = index[left]
        between = of.at(points[index], periods[index, None] * (np.arange(count) + 0.5) / count)
        samples = np.stack([samples[left], between], axis=2).reshape(len(index), 2 * count, *between.shape[2:])
        count *= 2
    return groups


def _basis(fractions: Floats, n_lines: int) -> Floats:
    """1, cos and sin of the harmonics below `n_lines` (..., 2 n_lines - 1) at fractions (...) of the period."""
    angle = 2.0 * np.pi * fractions
    turn = np.empty((*fractions.shape, n_lines), dtype=np.complex128)
    turn[..., 0] = 1.0
    turn[..., 1:] = (np.cos(angle) + 1j * np.sin(angle))[..., None]
    np.cumprod(turn, axis=-1, out=turn)
    return np.concatenate([turn.real, turn[..., 1:].imag], axis=-1)


def _evaluator(series: Floats) -> Callable[..., Floats]:
    """A from its series, without the last harmonics where these are rounding in every entry."""
    whole, n = (series.shape[1] + 1) // 2, int(np.sqrt(series.shape[2]))
    size = np.abs(series)
    seen = (size > ROUNDING * size.max(axis=1, keepdims=True)).any(axis=(0, 2))
    seen[1:whole] |= seen[whole:]
    n_lines = int(np.flatnonzero(seen[:whole])[-1]) + 1 if seen.any() else 1
    series = np.concatenate([series[:, :n_lines], series[:, whole : whole + n_lines - 1]], axis=1)

    def evaluate(owner: Indices, fractions: Floats) -> Floats:
        return (_basis(fractions, n_lines) @ series[owner]).reshape(*fractions.shape, n, n)

    return evaluate


def _repeating(of: Family, points: Floats, periods: Floats) -> Floats:
    """A at some instants (points, times, n, n), the same one period later."""
    fractions = (np.arange(PROBED) + PROBES[0]) / PROBED
    away = np.abs(fractions[:, None] - of.breaks).min(axis=1, initial=1.0) > 1e-6
    now = of.at(points, periods[:, None] * fractions)
    later = of.at(points, periods[:, None] * (1.0 + fractions[away][:2]))
    differences = np.abs(later - now[:, away][:, :2]).max(axis=1, initial=0.0)
    # Entry by entry, whatever their units, and not below what rounding makes of entries that come and go.
    rounding = 1e-13 * _sizes(of, now)[:, None, None] * of.scale[:, None] / of.scale
    wrong = (differences > 1e-8 * np.abs(now).max(axis=1) + rounding).any(axis=(1, 2))
    change = differences.max(axis=(1, 2))
    if wrong.any():
        at = int(wrong.argmax())
        got = f"A differs by {change[at]:.3g} one period of {periods[at]:g} later, at {of.words(points[at])}"
        remedy = "A period that depends on the parameters is a callable of them."
        raise input_error("period", of.of, "be a period of A(t)", got, remedy)
    return now


def _sizes(of: Family, samples: Floats) -> Floats:
    """Largest row sums of A over the period, in the units of the family (points,) [1/s]."""
    return (np.abs(samples).max(axis=1) * of.scale / of.scale[:, None]).sum(axis=2).max(axis=1)


def _monodromy(
    of: Family, points: Floats, sizes: Floats, evaluate: Callable[..., Floats], *, smooth: bool
) -> tuple[Floats, Integers, Floats]:
    """Φ(T) / 2^power, in balanced units (points, n, n); the power, the errors' gain (points,)."""
    n = len(of.scale)
    ends = np.concatenate([[0.0], of.breaks[of.breaks > 0.0], [1.0]])
    longest = np.minimum(0.5, stages(n) / (3.0 * np.maximum(sizes, 1e-300)))
    steps = np.maximum(1, np.ceil(np.diff(ends) / longest[:, None] - 1e-9))
    if steps.sum(axis=1).max() > MOST:
        worst = int(steps.sum(axis=1).argmax())
        got = f"needs more than {MOST} steps a period at {of.words(points[worst])}"
        raise input_error("system", of.of, "be integrable", got, "Take out states that decay at once; check the units.")
    parts = steps.astype(np.intp).ravel()
    whole, left, right = divided(np.tile(ends[:-1], len(points)), np.tile(ends[1:], len(points)), parts)
    owner = whole // (len(ends) - 1)
    product, power = np.empty((len(points), n, n)), np.zeros(len(points), dtype=np.int64)
    gain = np.empty(len(points))
    share = np.cumsum(np.bincount(owner)) // (_INTERVALS if smooth else _INTERVALS // 20)
    for number in np.unique(share):
        at = share[owner] == number
        found = factorise(
            evaluate, owner[at], left[at], right[at], scale=of.scale, tolerance=of.tolerance, smooth=smooth
        )
        if not found.finished:
            worst = int(np.argmin(found.right - found.left))
            where = f"{of.words(points[found.owner[worst]])}, near {found.left[worst]:g} of the period"
            must = f"be integrable to a relative error of {of.tolerance:g}"
            remedy = "Name the fractions of the period at which A(t) jumps in `breaks`, or raise `tolerance`."
            raise input_error("system", of.of, must, f"the steps shrink without end at {where}", remedy)
        those, within = np.unique(found.owner, return_inverse=True)
        balanced = found.matrices * of.scale / of.scale[:, None]
        product[those], power[those], gain[those] = _product(within, balanced)
    return product, power, gain


def _product(owner: Indices, matrices: Floats) -> tuple[Floats, Integers, Floats]:
    r"""The product of each owner's factors, later ones on the left, kept in range by powers of two, as `_monodromy`.

    The gain is how far an error of the factors, relative to each, reaches: with K factors,

    .. math:: \sqrt K\, \max_k \lVert F_K \cdots F_{k+1} \rVert\, \lVert F_k \cdots F_1 \rVert
    """
    count = np.bincount(owner)
    first = np.cumsum(count) - count
    product, power, before = _chain(matrices, first, count, 1)
    _, _, after = _chain(matrices.swapaxes(1, 2), first + count - 1, count, -1)
    place = np.arange(before.shape[1])
    rest = count[:, None] - 2 - place
    behind = np.where(rest >= 0, np.take_along_axis(after, np.maximum(rest, 0), axis=1), 0.0)
    reach = np.where(rest >= -1, before + behind, -np.inf).max(axis=1)
    with np.errstate(over="ignore"):
        return product, power, np.sqrt(count) * np.exp2(reach - power)


def _chain(matrices: Floats, first: Indices, count: Indices, step: int) -> tuple[Floats, Integers, Floats]:
    """The product of every `step`-th matrix from the first, its power of two, and log2 ‖·‖ after each one."""
    n = matrices.shape[1]
    product, power = np.broadcast_to(np.eye(n), (len(first), n, n)).copy(), np.zeros(len(first), dtype=np.int64)
    sizes = np.zeros((len(first), int(count.max())))
    for place in range(sizes.shape[1]):
        more = np.flatnonzero(count > place)
        grown = matrices[first[more] + step * place] @ product[more]
        fraction, shift = np.frexp(np.abs(grown).max(axis=(1, 2)))
        product[more] = np.ldexp(grown, -shift[:, None, None])
        power[more] += shift
        sizes[more, place] = power[more] + np.log2(n * np.maximum(fraction, 1e-300))
    return product, power, sizes


def _eigen(of: Family, product: Floats, power: Integers, gain: Floats, periods: Floats) -> Spectra:
    r"""The multipliers of Φ and how far its error may carry each: its condition, up to the worst of a Jordan block.

    .. math:: |\delta\mu_i| \le \lVert w_i \rVert\, \lVert v_i \rVert\, \lVert \delta\Phi \rVert

    with v_i and w_i the right and left eigenvectors, w_i v_i = 1 (Golub and Van Loan, Matrix Computations, 7.2.2).
    """
    n = len(of.scale)
    values, vectors = np.linalg.eig(product)
    values, vectors = values.astype(np.complex128), vectors.astype(np.complex128)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        condition = np.linalg.norm(inverse(vectors), axis=2)
        error = of.tolerance * gain[:, None] / np.abs(values)
        error = np.fmin(error * condition, np.maximum(error ** (1.0 / min(n, _DEFECTIVE)), error))
        logs = np.log(np.abs(values)) + np.log(2.0) * power[:, None]
        angles = np.angle(values)
        angles[angles <= -np.pi] = np.pi
        best = logs.argmax(axis=1)
        rows = np.arange(len(product))
        certain = (logs - np.where(np.isneginf(logs), 0.0, error)).max(axis=1) / periods
        multiplier = np.exp(logs[rows, best]) * np.exp(1j * angles[rows, best])
    multiplier.imag[values.imag[rows, best] == 0.0] = 0.0
    exponents = np.empty(values.shape, dtype=np.complex128)
    exponents.real, exponents.imag = logs / periods[:, None], angles / periods[:, None]
    order = np.lexsort((-exponents.imag, exponents.real), axis=1)
    turned = np.lexsort((logs, angles), axis=1)
    return Spectra(
        exponents=np.take_along_axis(exponents, order, axis=1),
        growth=logs[rows, best] / periods,
        certain=certain,
        multiplier=multiplier,
        vectors=np.take_along_axis(vectors, turned[:, None, :], axis=2).astype(np.complex64),
    )


def joined(parts: Sequence[Spectra]) -> Spectra:
    """The spectra one after another."""
    return Spectra._make(np.concatenate(column) for column in zip(*parts, strict=True))
