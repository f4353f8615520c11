"""Transition matrix, multipliers and exponents of a known A(t), by factors of short intervals."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Complexes, Floats, Indices
from floquid._checks import finite, frozen_array, input_error
from floquid.floquet.matrices import Prepared, StateMatrix, checked_tolerance, periodic, prepare
from floquid.floquet.monodromy_matrix._collocation import MOST, Factors, divided, factorise, gauss, stages
from floquid.floquet.monodromy_matrix._periodic_schur import multipliers_of, product_logarithms

TOLERANCE = 1e-12  # relative error of a factor of Φ that is aimed at by default
_LOST = 1e-7  # of the sum of the exponents' sizes: largest miss of Liouville's formula that passes


def transition(
    system: StateMatrix,
    period: float | None,
    times: ArrayLike,
    *,
    start: float = 0.0,
    breaks: ArrayLike = (),
    tolerance: float = TOLERANCE,
) -> Floats:
    r"""The state transition matrix Φ(t, t₀) at `times` (times, n, n).

    .. math:: \dot\Phi(t, t_0) = A(t)\,\Phi(t, t_0), \qquad \Phi(t_0, t_0) = I

    Allen 2009, eq. (3), by Gauss collocation of order 12 or 16 (Hairer, Lubich and Wanner, Geometric Numerical
    Integration, II.1.3) on intervals halved until each reaches the tolerance. A callable that is smooth is first
    resolved into its harmonics from 64 or more samples at equal steps; one that is not is evaluated within each
    interval. What happens within less than 1/64 of the period may pass unseen unless it stands between `breaks`: see
    `FunctionMatrix.narrowest`.

    Raises InputError where `system` is not a finite real (n, n) of that period, or A(t) cannot be integrated. So it
    does where `times` does not ascend from `start`, or a break lies outside the first period.

    Parameters
    ----------
    system
        A(t): a periodic matrix (`FunctionMatrix`, `HarmonicMatrix`, `SampledMatrix`, `PiecewiseMatrix`); a callable,
        t [s] -> (n, n) [1/s]; or its samples (n, n, phases) at the phases 0, 1/P, ..., (P - 1)/P of the period,
        between which it is the trigonometric polynomial through them. Samples must resolve A(t): what lies above P/2
        harmonics is folded, unseen.
    period
        The period T of A(t) [s]; None for a periodic matrix, which knows its own.
    times
        Instants t, ascending, none before `start` (times,) [s].
    start
        The instant t₀ [s].
    breaks
        Instants in [0, period) at which a callable jumps (breaks,) [s]; no step crosses one. A jump that is not named
        is found if the samples see it, at the cost of some fifty halvings.
    tolerance
        The relative error of each factor of Φ, both of its large and of its small directions, from 1e-14 to 1e-3.
    """
    of = "floquet.transition"
    prepared = checked(system, period, breaks, tolerance, of)
    instants = frozen_array(times, "times", of, axes=("times",))
    begin = finite(start, "start", of, unit="s")
    if instants.size and (instants[0] < begin or (np.diff(instants) < 0).any()):
        must, got = f"ascend from `start` = {begin:g} [s]", f"begins at {instants[0]:g} and may go back"
        raise input_error("times", of, must, got, "Backwards in time use Φ(t, t₀) = Φ(t₀, t)⁻¹.")
    found = factors(prepared, np.concatenate([[begin], instants]), tolerance, of)
    out = np.empty((len(instants), *prepared.matrix.shape))
    phi, place = np.eye(len(prepared.scale)), 0
    with np.errstate(over="ignore", invalid="ignore"):
        for gap in range(len(instants)):
            while place < len(found.owner) and found.owner[place] == gap:
                phi = found.matrices[place] @ phi
                place += 1
            out[gap] = phi
    if not np.isfinite(out).all():
        must = "end before Φ leaves the range of floating point"
        remedy = "Take a shorter interval; `floquet.exponents` never multiplies the factors out."
        raise input_error("times", of, must, f"Φ overflows before t = {instants[-1]:g}", remedy)
    return out


def monodromy(
    system: StateMatrix,
    period: float | None = None,
    *,
    start: float = 0.0,
    breaks: ArrayLike = (),
    tolerance: float = TOLERANCE,
) -> Floats:
    """The monodromy matrix Φ(t₀ + T, t₀) (n, n): the transition over one period.

    Arguments (`system`, `period`, `start`, `breaks`, `tolerance`) and errors are those of `transition`.
    """
    of = "floquet.monodromy"
    begin = finite(start, "start", of, unit="s")
    prepared = checked(system, period, breaks, tolerance, of)
    found = factors(prepared, np.array([begin, begin + prepared.matrix.period]), tolerance, of)
    with np.errstate(over="ignore", invalid="ignore"):
        phi = found.matrices[0]
        for factor in found.matrices[1:]:
            phi = factor @ phi
    if not np.isfinite(phi).all():
        must = "have a monodromy matrix within the range of floating point"
        remedy = "`floquet.exponents` finds the exponents from its factors, which it never multiplies out."
        raise input_error("system", of, must, "it overflows", remedy)
    return phi


def checked(system: StateMatrix, period: float | None, breaks: ArrayLike, tolerance: float, of: str) -> Prepared:
    """A(t) ready to be integrated to `tolerance`, both checked."""
    accuracy = checked_tolerance(tolerance, of)
    return prepare(periodic(system, period, breaks, of), accuracy, of)


def factors(prepared: Prepared, instants: Floats, tolerance: float, of: str) -> Factors:
    """The transition matrices of short intervals between successive instants, whose gap is their owner."""
    matrix = prepared.matrix
    gaps, left, right = intervals(prepared, instants, of)
    found = factorise(
        lambda _, times: matrix.at(times),
        gaps,
        left,
        right,
        scale=prepared.scale,
        tolerance=tolerance,
        smooth=prepared.smooth,
    )
    if not found.finished:
        worst = found.left[int(np.argmin(found.right - found.left))]
        must = f"be integrable to a relative error of {tolerance:g}"
        remedy = (
            "Name the instants at which A(t) jumps in `breaks`, take out states that decay at once, or raise "
            "`tolerance`."
        )
        raise input_error("system", of, must, f"the steps near t = {worst:g} shrink without end", remedy)
    return found


def intervals(prepared: Prepared, instants: Floats, of: str) -> tuple[Indices, Floats, Floats]:
    """First intervals between the instants: gap (intervals,), left and right ends, none across a break."""
    matrix = prepared.matrix
    period, breaks = matrix.period, np.asarray(matrix.breaks)
    ends = instants
    if breaks.size and instants.size > 1:
        turns = np.arange(np.floor(instants[0] / period), np.ceil(instants[-1] / period) + 1.0)
        jumps = np.add.outer(turns * period, breaks).ravel()
        inside = jumps[(jumps > instants[0]) & (jumps < instants[-1])]
        ends = np.unique(np.concatenate([instants, inside]))
    left, right = ends[:-1], ends[1:]
    if (right <= left).any():
        real = right > left
        left, right = left[real], right[real]
    n_nodes = stages(len(prepared.scale))
    longest = min(0.5 * period, n_nodes / (1.5 * prepared.size)) if prepared.size else 0.5 * period
    if not prepared.smooth:
        longest = min(longest, n_nodes * matrix.narrowest * period)
    longest = min(longest, n_nodes * period / (4.0 * max(1, matrix.fastest)))
    wanted = np.maximum(1.0, np.ceil((right - left) / longest - 1e-9))
    if not wanted.sum() <= MOST:
        raise input_error(
            "system",
            of,
            f"be integrable in {MOST} steps",
            f"it is as large as {prepared.size:.3g} 1/s over {instants[-1] - instants[0]:.3g} s, which takes "
            f"{wanted.sum():.2g}",
            "Check its unit and that of the period. Take out states that decay at once, or use a shorter interval, or "
            "`floquet.hill`, which takes no steps.",
        )
    parts = wanted.astype(np.intp)
    _, lefts, rights = divided(left, right, parts)
    gap = np.searchsorted(instants, 0.5 * (lefts + rights), side="right") - 1
    return gap, lefts, rights


def multipliers(
    system: StateMatrix, period: float | None = None, *, breaks: ArrayLike = (), tolerance: float = TOLERANCE
) -> Complexes:
    r"""The Floquet multipliers (n,), the eigenvalues of the monodromy matrix.

    .. math:: \mu_r = \mathrm{eig}\,\Phi(T, 0) = e^{\lambda_r T}

    Arguments (`system`, `period`, `breaks`, `tolerance`), order and errors are those of `exponents`. One below 1e-308
    is zero and one above 1e308 infinite: `exponents` has all.
    """
    return multipliers_of(_logarithms(system, period, breaks, tolerance, "floquet.multipliers")[0])


def exponents(
    system: StateMatrix, period: float | None = None, *, breaks: ArrayLike = (), tolerance: float = TOLERANCE
) -> Complexes:
    r"""The Floquet exponents on the principal branch (n,) [1/s].

    .. math:: \lambda_r = \frac{\ln \mu_r}{T}, \qquad -\omega/2 < \mathrm{Im}\,\lambda_r \le \omega/2, \qquad
              \omega = 2\pi/T

    A real negative multiplier has Im λ = +ω/2. Sorted by \|Im λ\|, then by falling real part, the positive imaginary
    part of a conjugate pair first.

    Allen 2009, eq. (4). The period is split into factors, each well conditioned, and the eigenvalues are those of
    their product without its being formed (periodic Schur form: Bojanczyk, Golub and Van Dooren 1992). The multipliers
    may be as far apart as they like: each is good to about `tolerance` times the number of factors of itself, times
    its condition. Two that are nearly equal and share a shape are good to the root of that; `modes` tells.

    `system`, `period`, `breaks` and `tolerance` are as in `transition`. Raises InputError as in `transition`; or the
    sum of the exponents misses the mean trace of A(t), which it must equal by Liouville's formula.
    """
    found, length = _logarithms(system, period, breaks, tolerance, "floquet.exponents")
    return found / length


def balanced(found: Factors, prepared: Prepared) -> Floats:
    """The factors in balanced units (factors, n, n)."""
    return found.matrices * prepared.scale / prepared.scale[:, None]


def refuse_lost(logs: Complexes, found: Factors, prepared: Prepared, of: str) -> None:
    """Refuse exponents whose sum is not the mean trace of A(t)."""
    integral = trace_integral(found, prepared)
    growth = float(logs.real.sum())
    # Each factor's own rounding counts, and so do sizes that cancel in the sum.
    size = 1.0 + np.abs(logs.real).sum() + prepared.size * prepared.matrix.period
    if not abs(growth - integral) <= _LOST * size:
        period = prepared.matrix.period
        got = f"their exponents sum to {growth / period:.6g} where the mean trace of A(t) is {integral / period:.6g}"
        remedy = "Take the states that decay at once out of A(t), or lower `tolerance`."
        raise input_error("system", of, "have multipliers that can be told from rounding", got, remedy)


def trace_integral(found: Factors, prepared: Prepared) -> float:
    """The integral of the trace of A over a period."""
    matrix = prepared.matrix
    if (series := matrix.series()) is not None:
        mean = np.asarray(series.coefficients)[..., np.asarray(series.harmonics) == 0].sum(axis=2)
        return float(np.trace(mean).real) * matrix.period
    rule = gauss(stages(len(prepared.scale)))
    width = found.right - found.left
    values = matrix.at(found.left[:, None] + width[:, None] * rule.nodes)
    return float(width @ np.trace(values, axis1=2, axis2=3) @ rule.weights)


def _logarithms(
    system: StateMatrix, period: float | None, breaks: ArrayLike, tolerance: float, of: str
) -> tuple[Complexes, float]:
    """The sorted logarithms of the multipliers, and the period."""
    prepared = checked(system, period, breaks, tolerance, of)
    found = factors(prepared, np.array([0.0, prepared.matrix.period]), tolerance, of)
    logs = product_logarithms(balanced(found, prepared))
    refuse_lost(logs, found, prepared, of)
    return logs, prepared.matrix.period
