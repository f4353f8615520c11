"""Hill's method: exponents and modes from the state equation in harmonics, without any integration over time."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Complexes, Floats, Indices, Integers, Mask
from floquid._checks import Rebuilt, input_error, integer, positive
from floquid.floquet.hill_method._eigenpairs import (
    Problem,
    Smoothed,
    Truncated,
    effect_of_edges,
    modulo,
    smoothed,
    swinging_along,
    truncated,
)
from floquid.floquet.hill_method._inverse import KnownModes, beside
from floquid.floquet.matrices import (
    AbstractPeriodicMatrix,
    Reach,
    StateMatrix,
    binary_units,
    checked_tolerance,
    fourier,
    of_function,
    periodic,
    reach,
    refuse_other_period,
)

_ON_AXIS = 1e-9  # of max(|λ|, ω): an exponent whose real part is less cannot be told from an undamped one


class HillOutcome(Enum):
    """Ends of a truncated harmonic problem; the value says what it means and what to do."""

    CONVERGED = "the exponents have settled"
    TRUNCATED = (
        "the truncation is too low. Where A(t) jumps, name the instants in `breaks`; where it is smooth, give more "
        "harmonics (`n_harmonics`); or use `floquet.exponents`, which integrates."
    )
    ROUNDED = (
        "the exponents are ill conditioned, and no truncation makes them settle. They nearly coincide and share a "
        "shape, as on a boundary of stability."
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HillModes(Rebuilt):
    r"""The modes of x' = A(t) x from Hill's truncated harmonic problem.

    .. math:: x(t) = e^{\lambda_r t} \sum_m c_{r,m}\, e^{i m \omega t}

    Parameters
    ----------
    exponents
        λ on the principal strip -ω/2 < Im λ ≤ ω/2 (modes,) [1/s]: by \|Im λ\|, then by falling real part, the
        positive imaginary part of a conjugate pair first.
    coefficients
        c_{r,m} of shapes of mean square one (modes, n, harmonics).
    harmonics
        m, ascending (harmonics,). They reach beyond the truncation by as much as an exponent's best copy lies off the
        principal strip.
    period
        T [s].
    n_harmonics
        The truncation N.
    change
        What each exponent is known to (modes,) [1/s]: its change from the truncation before, or how far it is from
        another that may be one with it up to rounding.
    condition
        Of each exponent as an eigenvalue of the truncated problem, 1 at best (modes,).
    outcome
        How it ended.
    """

    exponents: Complexes
    coefficients: Complexes
    harmonics: Integers
    period: float
    n_harmonics: int
    change: Floats
    condition: Floats
    outcome: HillOutcome

    def __post_init__(self) -> None:
        self._freeze(dtype=np.int64, harmonics=("harmonics",))
        self._freeze(dtype=np.complex128, exponents=("modes",))
        n = len(self.exponents)
        self._freeze(dtype=np.complex128, coefficients=(n, "n", len(self.harmonics)))
        object.__setattr__(self, "period", positive(self.period, "period", "HillModes", unit="s"))
        self._freeze(finite=False, change=(n,), condition=(n,))

    @property
    def converged(self) -> bool:
        """True if no exponent changed by more than the tolerance."""
        return self.outcome is HillOutcome.CONVERGED

    @property
    def fundamental(self) -> float:
        """ω = 2π/T [rad/s]."""
        return 2.0 * np.pi / self.period

    @property
    def multipliers(self) -> Complexes:
        """e^{λT} (modes,); one below 1e-308 is zero."""
        with np.errstate(over="ignore", under="ignore"):
            size = np.exp(self.exponents.real * self.period)
        angle = self.exponents.imag * self.period
        real = np.isin(self.exponents.imag, (0.0, 0.5 * self.fundamental))
        return size * np.where(real, np.sign(np.cos(angle)), np.exp(1j * angle))

    def shapes(self, times: ArrayLike) -> Complexes:
        """The periodic shapes at `times` [s] (modes, n, times)."""
        instants = np.atleast_1d(np.asarray(times, dtype=np.float64))
        return self.coefficients @ np.exp(1j * self.fundamental * np.multiply.outer(self.harmonics, instants))


def assemble(
    modes: Truncated,
    problem: Problem,
    change: Floats,
    scale: Floats,
    period: float,
    outcome: HillOutcome,
    smooth: Smoothed | None,
) -> HillModes:
    """The modes on the principal strip, conjugates exactly so, in the units and coordinates of the states."""
    fundamental = problem.fundamental
    doubt = modes.rounding(problem) + np.minimum(change, 1e-10 * fundamental)
    exponents, turns, owner, conjugate = _principal(modes, doubt, fundamental)
    reach = problem.n_harmonics + int(np.abs(turns).max())
    shapes = np.zeros((len(exponents), problem.n_states, 2 * reach + 1), dtype=np.complex128)
    for shape, vector, turn in zip(shapes, modes.vectors, turns, strict=True):
        begin = reach - problem.n_harmonics + turn
        shape[:, begin : begin + vector.shape[1]] = vector * scale[:, None]
    harmonics = np.arange(-reach, reach + 1)
    if smooth is not None:
        shapes = _in_states(shapes, harmonics, smooth, period)
    flat = shapes.reshape(len(shapes), -1)
    largest = flat[np.arange(len(flat)), np.abs(flat).argmax(axis=1)]
    shapes = (shapes * (np.abs(largest) / largest / np.linalg.norm(flat, axis=1))[:, None, None])[owner]
    shapes[conjugate] = shapes[conjugate][..., ::-1].conj()
    order = np.lexsort((-exponents.imag, -exponents.real, np.abs(exponents.imag)))
    return HillModes(
        exponents=exponents[order],
        coefficients=shapes[order],
        harmonics=harmonics,
        period=period,
        n_harmonics=problem.n_harmonics,
        change=change[order],
        condition=modes.condition[order],
        outcome=outcome,
    )


def _principal(modes: Truncated, doubt: Floats, fundamental: float) -> tuple[Complexes, Integers, Indices, Mask]:
    """Principal exponents, the multiples of iω taken off; whose shape each has, and whether conjugate."""
    # A(t) is real, so that the exponents are conjugate in pairs modulo iω, or are their own conjugates: real, or on the
    # edge of the strip (a real negative multiplier). The truncation is exact in this except for its own error.
    from scipy.optimize import linear_sum_assignment

    raw = modes.exponents
    apart = np.abs(modulo(np.subtract.outer(raw, raw.conj()), fundamental))
    partner = np.arange(len(raw))
    rest = np.flatnonzero(np.diag(apart) > 2.0 * doubt)
    partner[rest] = rest[linear_sum_assignment(apart[np.ix_(rest, rest)])[1]]
    turns = np.ceil(raw.imag / fundamental - 0.5).astype(np.int64)
    halves = np.round(2.0 * raw.imag / fundamental).astype(np.int64)
    own = partner == np.arange(len(raw))
    turns[own] = halves[own] // 2
    out = raw - 1j * fundamental * turns
    out[own] = out[own].real + 0.5j * fundamental * (halves[own] % 2)
    owner, conjugate = np.arange(len(raw)), np.zeros(len(raw), dtype=bool)
    for index in np.flatnonzero(~own & (out.imag > 0.0)):
        other = partner[index]
        if partner[other] == index and out[other].imag < 0.0:
            keep, follow = (index, other) if modes.leak[index] <= modes.leak[other] else (other, index)
            out[follow] = out[keep].conjugate()
            owner[follow], conjugate[follow] = keep, True
    return out, turns, owner, conjugate


def _in_states(shapes: Complexes, harmonics: Integers, smooth: Smoothed, period: float) -> Complexes:
    """The harmonics of P(t) z(t), right for each although those of P go on for ever."""

    def values(times: Floats) -> Complexes:
        waves = np.exp(2j * np.pi / period * np.multiply.outer(harmonics, times))
        inner = np.moveaxis(shapes @ waves, 2, 0)  # (times, modes, n)
        return np.einsum("tij,tmj->tmi", smooth.change(times), inner).reshape(len(times), -1)

    return of_function(values, smooth.cuts, period, int(harmonics[-1])).reshape(shapes.shape)


def refuse_undamped(modes: HillModes, omega: Floats, of: str) -> None:
    """Refuse lines that meet an exponent on the imaginary axis, modulo iω."""
    known = np.minimum(modes.change, np.sqrt(_ON_AXIS) * modes.fundamental)
    # Within this a real part cannot be told from zero.
    doubt = _ON_AXIS * np.maximum(np.abs(modes.exponents), modes.fundamental) + known
    rests = np.abs(modes.exponents.real) <= doubt
    apart = np.abs(modulo(np.subtract.outer(1j * omega, modes.exponents), modes.fundamental))
    met = rests & (apart <= np.sqrt(_ON_AXIS) * modes.fundamental + known)
    if met.any():
        line, mode = np.argwhere(met)[0]
        must = "keep off the undamped exponents, modulo the fundamental"
        got = f"{omega[line]:g} rad/s meets Im λ = {modes.exponents[mode].imag:.6g} rad/s"
        raise input_error("omega", of, must, got, "There the response grows without end.")


_LARGEST = 4500  # rows of the truncated matrix: what a plain computer holds, a minute or two
_SMALL = 1000  # rows to which a few states are taken: beyond, harmonics die away too slowly to be waited for
_PER_STATE = 41  # rows a state that are allowed to many states: 20 harmonics
_ILL = 10.0  # condition of an exponent worth the cure
_AFFORDED = 2200  # rows to which any number of states is taken where A(t) has far lines
STEPS = 4  # steps as long as the highest strong line that are allowed for


class _Step(NamedTuple):
    """A truncation and how far its exponents are from those of the one before."""

    problem: Problem
    modes: Truncated
    change: Floats


def hill(
    system: StateMatrix,
    period: float | None = None,
    *,
    breaks: ArrayLike = (),
    n_harmonics: int | None = None,
    tolerance: float = 1e-10,
    raises: bool = True,
    known: KnownModes | None = None,
) -> HillModes:
    r"""The Floquet modes from Hill's truncated harmonic problem.

    .. math:: \lambda\, p_k = \sum_{m=-N}^{N} A_{k-m}\, p_m - i k \omega\, p_k, \qquad
              x(t) = e^{\lambda t} \sum_m p_m e^{i m \omega t}

    Each exponent is among the eigenvalues about 2 N + 1 times, as λ + i m ω. The copy is taken that leaks least over
    the edges of the truncation and is best centred in it; conjugates are taken together. N starts from the highest
    harmonic of A(t) and grows by half, or by the highest strong harmonic. It stops where no exponent changes by more
    than the tolerance, little leaks over the edges, and their sum is the mean trace of A(t). An A(t) that jumps is seen
    from coordinates in which it is smooth first, which leaves the exponents as they are; so its breaks must be named.

    Hill 1886; in state form Wereley 1990. Zhou, Hagiwara and Araki 2004 show that the truncation converges.
    Selection by the shape rather than by Im λ: Moore 2005; Bentvelsen and Lazarus 2018.

    Raises InputError where `system` is not a finite real (n, n) of that period; the truncation is too large; or the
    exponents have not settled and `raises` is true.

    Parameters
    ----------
    system
        A(t): a periodic matrix; a callable, t [s] -> (n, n) [1/s]; or its samples (n, n, phases).
    period
        The period T of A(t) [s]; None for a periodic matrix, which knows its own.
    breaks
        Instants in [0, period) at which a callable jumps (breaks,) [s].
    n_harmonics
        The truncation N; found where not given.
    tolerance
        Of max(\|λ\|, ω): the largest change from one truncation to the next that passes, from 1e-14 to 1e-2.
    raises
        Whether it is an error that the truncation does not suffice; else see `outcome` and `change`. Exponents that
        settle to rounding alone, as multiple ones do, are none: `outcome` says so and `change` by how much.
    known
        Modes by another route, as `floquet.modes` gives them. Hill's exponents are found beside them by inverse
        iteration, in a small part of the time. The truncated problem is solved where that does not settle them, where
        A(t) jumps, and where `n_harmonics` is given.
    """
    of = "floquet.hill"
    accuracy = checked_tolerance(tolerance, of, largest=1e-2)
    matrix = periodic(system, period, breaks, of)
    n_states = matrix.shape[0]
    wanted = None if n_harmonics is None else integer(n_harmonics, "n_harmonics", of, at_least=1)
    if (2 * (wanted or 3) + 1) * n_states > _LARGEST:
        got = f"{wanted or 3} harmonics of {n_states} states are {(2 * (wanted or 3) + 1) * n_states}"
        remedy = "Reduce the states, or use `floquet.exponents`, whose cost does not grow with the harmonics."
        raise input_error("n_harmonics", of, f"keep (2 N + 1) n within {_LARGEST}", got, remedy)
    if matrix.is_function:
        refuse_other_period(matrix, of)
    smooth = smoothed(matrix)
    seen = matrix if smooth is None else smooth.matrix
    scale = binary_units(np.abs(fourier(seen, 16)).sum(axis=2))
    lines = reach(seen, accuracy, scale)
    if known is not None and wanted is None and (near := beside(seen, scale, lines, known, accuracy)) is not None:
        return assemble(near.modes, near.problem, near.change, scale, matrix.period, HillOutcome.CONVERGED, None)
    truncations = _growing(n_states, lines)
    if wanted is not None:  # held against a smaller one
        truncations = [wanted - max(1, wanted // 3, lines.strong if 2 * lines.strong <= wanted else 0), wanted]
    step, outcome = _settle(seen, scale, truncations, lines, accuracy)
    if step is None:
        must = f"have {n_states} modes that a truncation at {truncations[-1]} harmonics can tell"
        raise input_error("system", of, must, "they cannot be told from their copies", _REMEDY)
    found = assemble(step.modes, step.problem, step.change, scale, matrix.period, outcome, smooth)
    if raises and outcome is HillOutcome.TRUNCATED:
        must = f"have exponents that settle to {accuracy:g} of max(|λ|, ω)"
        got = (
            f"they still change by {found.change.max():.3g} 1/s, or A(t) has harmonics (up to {lines.highest}) "
            f"that were not met, at {found.n_harmonics} harmonics: {outcome.value}"
        )
        raise input_error("system", of, must, got, "Raise `tolerance`, or pass `raises=False` and look at `change`.")
    return found


_REMEDY = "Name the instants at which a callable jumps in `breaks`, or use `floquet.exponents`, which integrates."


def _settle(
    matrix: AbstractPeriodicMatrix, scale: Floats, truncations: list[int], lines: Reach, tolerance: float
) -> tuple[_Step | None, HillOutcome]:
    """The last truncation needed."""
    fundamental = 2.0 * np.pi / matrix.period
    before: _Step | None = None
    for n_harmonics in truncations:
        coefficients = fourier(matrix, 2 * n_harmonics) * (scale / scale[:, None])[:, :, None]
        problem = Problem(coefficients, fundamental)
        modes = truncated(problem)
        if modes is None:
            before = None
            continue
        allowed = tolerance * np.maximum(np.abs(modes.exponents), fundamental)
        modes = _refined(problem, modes, allowed)
        change = np.full(len(modes.exponents), np.inf)
        if before is not None:
            change = _changes(modes.exponents, before.modes.exponents, fundamental)
        step = _Step(problem, modes, change)
        # A truncation that meets no line which that before did not meet has settled nothing.
        far = before is not None and n_harmonics - before.problem.n_harmonics >= lines.strong
        before = step
        if not (far and n_harmonics >= lines.highest):
            continue
        known = np.maximum(allowed, 2.0 * modes.rounding(problem))
        missed = abs(float(modes.exponents.real.sum()) - problem.growth)
        if (np.maximum(change, effect_of_edges(problem, modes)) > known).any() or missed > known.sum():
            continue
        change = np.maximum(change, modes.split(problem))
        return step._replace(change=change), HillOutcome.CONVERGED if (change <= allowed).all() else HillOutcome.ROUNDED
    return before, HillOutcome.TRUNCATED


def _refined(problem: Problem, modes: Truncated, allowed: Floats) -> Truncated:
    """The modes with those that are ill conditioned in harmonics found again, where that can be cured."""
    rounding = modes.rounding(problem)
    curable = (rounding > 0.1 * allowed) & (modes.condition > _ILL)
    out = Truncated(*(part.copy() for part in modes))  # type: ignore[arg-type]
    for index in np.flatnonzero(curable):
        again = swinging_along(problem, modes, int(index))
        if abs(again.exponents[0] - modes.exponents[index]) <= 10.0 * rounding[index]:
            for part, new in zip(out, again, strict=True):
                part[index] = new[0]
    return out


def _changes(now: Complexes, before: Complexes, fundamental: float) -> Floats:
    """Distance of each exponent from its own of the truncation before, modulo iω."""
    from scipy.optimize import linear_sum_assignment

    apart = np.abs(modulo(np.subtract.outer(now, before), fundamental))
    rows, columns = linear_sum_assignment(apart)
    return apart[rows, columns]


def most_harmonics(n: int, rows: int) -> int:
    """The largest truncation of n states within `rows`, fewer where the states are few."""
    return (min(rows, max(_SMALL, _PER_STATE * n)) // n - 1) // 2


def _growing(n: int, lines: Reach) -> list[int]:
    """Truncations from the harmonics that A(t) has, each half as large again at least, up to the largest allowed."""
    most = most_harmonics(n, _LARGEST)
    first = max(3, lines.highest, lines.strong + 1 if lines.strong < 5 else 0)
    # Far lines need truncations as far apart, two at least, even where rows are dear.
    step, afforded = max(2, lines.strong), (_AFFORDED // n - 1) // 2
    if lines.ends and first + step <= afforded:
        most = max(most, min(first + STEPS * step, afforded))
    out = [min(first, most)]
    while out[-1] < most:
        grown = min(most, out[-1] + max(2, out[-1] // 2, lines.strong))
        if len(out) > 1 and grown - out[-1] < lines.strong:
            break
        out.append(grown)
    return out if len(out) > 1 else [out[0] - 1, out[0]]
