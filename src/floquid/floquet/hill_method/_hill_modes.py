"""The modes that Hill's method finds."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Complexes, Floats, Indices, Integers, Mask
from floquid._checks import Rebuilt, input_error, positive
from floquid.floquet.hill_method._eigenpairs import Problem, Truncated
from floquid.floquet.hill_method._hill_matrix import modulo
from floquid.floquet.hill_method._smoothing import Smoothed
from floquid.floquet.matrices import of_function

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
    shapes = _normalised(shapes)[owner]
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
    """Principal exponents, the multiples of iω taken off; whose shape each has, and whether conjugate.

    A(t) is real, so that the exponents are conjugate in pairs modulo iω, or are their own conjugates: real, or on the
    edge of the strip (a real negative multiplier). The truncation is exact in this except for its own error.
    """
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


def _normalised(shapes: Complexes) -> Complexes:
    """Mean square one; the largest coefficient real and positive."""
    flat = shapes.reshape(len(shapes), -1)
    largest = flat[np.arange(len(flat)), np.abs(flat).argmax(axis=1)]
    factor = np.abs(largest) / largest / np.linalg.norm(flat, axis=1)
    return shapes * factor[:, None, None]


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
