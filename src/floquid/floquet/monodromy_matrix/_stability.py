"""The verdict on stability in words, the distance of two spectra, and the states that a mode is made of."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from enum import Enum
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Floats
from floquid._checks import Rebuilt, frozen_array, positive
from floquid.floquet.monodromy_matrix._modes import FloquetModes, left_vectors
from floquid.floquet.monodromy_matrix._transition import TOLERANCE

_SAFE = 100.0  # errors of an exponent within which its real part is called zero
_REAL = 1e-9  # of ω: how near to a multiple of ω/2 the imaginary part of a real multiplier's exponent is
_PHASES = 64  # of the period over which the share of a state is averaged


class Verdict(Enum):
    """End of the free response."""

    STABLE = "asymptotically stable"
    MARGINAL = "marginal within the accuracy of the exponents"
    UNSTABLE = "unstable"


@final
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stability(Rebuilt):
    """The verdict on the stability of a periodic system, with its reasons.

    Parameters
    ----------
    verdict
        The verdict.
    growth
        The largest Re λ [1/s].
    margins
        What each Re λ is known to (modes,) [1/s]: within it, it is called zero.
    reasons
        Of a stable system its slowest decay, of another each mode that does not decay and how it grows, in sentences.
    """

    verdict: Verdict
    growth: float
    margins: Floats
    reasons: tuple[str, ...]


def stability(modes: FloquetModes, *, tolerance: float = TOLERANCE, errors: ArrayLike | None = None) -> Stability:
    r"""The verdict on the stability of x' = A(t) x, from its exponents.

    .. math:: \max_r \mathrm{Re}\,\lambda_r < 0

    A real part has a sign where it is larger than a hundred times the tolerance of the factors times the condition of
    the exponent, over the period; of exponents that share a shape, the root of that.

    `modes` is what `modes` found, `tolerance` that with which they were found, and `errors` what else each exponent is
    known to (modes,) [1/s], as from `compare`. Raises InputError where the tolerance is not positive, or the errors are
    not as many as the modes.
    """
    of = "floquet.stability"
    relative = _SAFE * positive(tolerance, "tolerance", of) * np.maximum(modes.condition, 1.0)
    for group in modes.defective:
        relative[list(group)] = (_SAFE * tolerance) ** (1.0 / len(group))
    margins = np.minimum(relative, 1.0) / modes.period
    if errors is not None:
        margins = np.maximum(margins, frozen_array(errors, "errors", of, axes=(modes.order,)))
    margins.flags.writeable = False
    real = modes.exponents.real
    shown = np.array([r in upper_modes(modes) for r in range(modes.order)])
    grows = np.flatnonzero((real > margins) & shown)
    rests = np.flatnonzero((np.abs(real) <= margins) & shown)
    if grows.size:
        verdict = Verdict.UNSTABLE
        worst_first = grows[np.argsort(-real[grows], kind="stable")].tolist()
        reasons = tuple(f"{_named(modes, r)} doubles in {_span(modes, r)}: {_way(modes, r)}." for r in worst_first)
    elif rests.size:
        verdict = Verdict.MARGINAL
        found = Counter(_resting(modes, r, float(margins[r])) for r in rests.tolist())
        reasons = tuple(f"{words} There are {n} such." if n > 1 else words for words, n in found.items())
    else:
        verdict, slowest = Verdict.STABLE, int(np.flatnonzero(shown)[np.argmax(real[shown])])
        reasons = (f"{_named(modes, slowest)} decays most slowly: by half in {_span(modes, slowest)}.",)
    return Stability(verdict=verdict, growth=modes.growth, margins=margins, reasons=reasons)


def compare(modes: FloquetModes, exponents: ArrayLike) -> Floats:
    """The distance of each mode's exponent from that of another route (modes,) [1/s].

    The `exponents` of that route, on any branch (modes,) [1/s], are paired with those of `modes` by assignment, modulo
    iω. Of a group that shares a shape the means are compared: each alone is right only to a root of its error, by any
    route.

    Raises InputError where they are not as many as the modes.
    """
    from scipy.optimize import linear_sum_assignment

    others = frozen_array(exponents, "exponents", "floquet.compare", axes=(modes.order,), dtype=np.complex128)
    apart = modes.exponents[:, None] - others
    apart -= 1j * modes.fundamental * np.round(apart.imag / modes.fundamental)
    rows, columns = linear_sum_assignment(np.abs(apart))
    difference = apart[rows, columns]
    for group in modes.defective:
        difference[list(group)] = difference[list(group)].mean()
    return np.abs(difference)


def upper_modes(modes: FloquetModes) -> list[int]:
    """The indices of one mode of each conjugate pair, and of each that is its own conjugate, ascending, of `modes`."""
    return [r for r in range(modes.order) if modes.exponents[r].imag > 0.0 or multiplier_is_real(modes, r)]


def multiplier_is_real(modes: FloquetModes, mode: int) -> bool:
    """True if `mode`, an index of `modes`, is its own conjugate: Im λ is a whole multiple of ω/2."""
    halves = 2.0 * complex(modes.exponents[mode]).imag / modes.fundamental
    return bool(abs(halves - np.round(halves)) <= 2.0 * _REAL)


def state_participation(modes: FloquetModes) -> Floats:
    r"""The share of each state in each of the `modes` (modes, states), whatever the units; each row sums to one.

    .. math:: s_{r,k} \propto \frac{1}{T} \int_0^T \left|p_{r,k}(t)\, q_{r,k}(t)\right| dt, \qquad
              \sum_k p_{r,k}\, q_{s,k} = \delta_{rs}

    The participation factors of Pérez-Arriaga, Verghese and Schweppe 1982, as means over the period.
    """
    shapes = np.moveaxis(modes.shapes(np.arange(_PHASES) * modes.period / _PHASES), 2, 0)  # (phases, modes, states)
    largest = np.abs(shapes).max(axis=(0, 1), keepdims=True)
    shapes = shapes / np.where(largest > 0.0, largest, 1.0)  # so that no unit decides what is small
    shapes /= np.linalg.norm(shapes, axis=2, keepdims=True)
    shares = (np.abs(shapes) * np.abs(np.swapaxes(left_vectors(shapes), 1, 2))).mean(axis=0)
    return shares / shares.sum(axis=1, keepdims=True)


def _named(modes: FloquetModes, mode: int, *, rests: bool = False) -> str:
    """The mode by its exponent: «The pair λ = -0.002 ± 0.87i 1/s»."""
    value = modes.exponents[mode]
    real = f"{value.real:+.1e}" if rests and value.real else f"{value.real:.6g}"
    if not multiplier_is_real(modes, mode):
        return f"The pair λ = {real} ± {abs(value.imag):.6g}i 1/s"
    return f"λ = {real}" + (f" + {abs(value.imag):.6g}i" if value.imag else "") + " 1/s"


def _span(modes: FloquetModes, mode: int) -> str:
    """The time in which the mode halves or doubles."""
    time = np.log(2.0) / abs(modes.exponents[mode].real)
    return f"{time:.4g} s ({time / modes.period:.4g} periods)"


def _way(modes: FloquetModes, mode: int) -> str:
    """Kind of motion of the mode: divergence, locked to the period, or flutter, with its frequency."""
    imaginary = abs(float(modes.exponents[mode].imag))
    frequency = imaginary / (2.0 * np.pi)
    if not multiplier_is_real(modes, mode):
        return f"flutter at {frequency:.5g} Hz (a conjugate pair of multipliers)"
    halves = round(2.0 * imaginary / modes.fundamental)
    if not halves:
        return "divergence (a real positive multiplier)"
    if halves % 2 == 0:
        return f"locked at {halves // 2} per period, {frequency:.5g} Hz (a real positive multiplier)"
    times = "half" if halves == 1 else f"{halves}/2"
    return f"locked at {times} per period, {frequency:.5g} Hz (a real negative multiplier)"


def _resting(modes: FloquetModes, mode: int, margin: float) -> str:
    name = _named(modes, mode, rests=True)
    words = f"{name} neither grows nor decays by more than {margin:.2g} 1/s, which cannot be told from 0"
    if any(mode in group for group in modes.defective):
        words += "; it shares its shape with another, and the response may grow as t"
    return f"{words}."
