"""A comparison: pairs of modes with their differences, what is missing, and how likely all differences are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from floquid._arrays import Floats
from floquid._checks import Rebuilt, Sealed
from floquid._show import Drawings, Drawn, Told
from floquid.comparison._parameters import Updated
from floquid.core import PeriodicModel
from floquid.views import with_error

RARE = 0.01  # the probability below which differences are told to be more than the deviations explain


def mode_labels(here: ComparedPoint) -> tuple[list[str], list[str]]:
    """The numbers of the modes of both sides of a point, for the rows and columns of its similarities."""
    sides = (here.model_a, here.modes_a), (here.model_b, here.modes_b)
    of_a, of_b = (["/".join(str(mode_number(model, mode)) for mode in own) for own in each] for model, each in sides)
    return of_a, of_b


def mode_number(model: PeriodicModel, mode: int) -> int:
    """The number of a `mode` of a `model` in tables, where each pair is one row, from 1."""
    return model.upper_modes.index(mode) + 1


def pair_row(found: Comparison, pair: Pair) -> tuple[str, ...]:
    """Cells of a `pair` of a comparison `found`: numbers, f, Δf, its share, Δζ, ΔRe λ, z and mac."""
    point = found.points[pair.point]
    numbers = mode_number(point.model_a, pair.a), mode_number(point.model_b, pair.b)
    cells = ["" if point.value is None else f"{point.value:g}"] if found.over else []
    cells += [str(number) for number in numbers]
    a, b = pair.exponent_a, pair.exponent_b
    if np.isfinite(pair.difference.imag):
        size, std = abs(a), pair.std
        apart = (size - abs(b)) / (2.0 * np.pi)
        error = float(np.hypot(a.real * std.real, a.imag * std.imag)) / size / (2.0 * np.pi)
        first, second = pair.damping_ratios
        damping = float(np.hypot(a.imag**2 * std.real, a.real * a.imag * std.imag)) / size**3
        cells += [f"{size / (2.0 * np.pi):.6g}", with_error(apart, error), f"{100.0 * apart / size * 2.0 * np.pi:+.2g}"]
        cells += [with_error(100.0 * (first - second), 100.0 * damping)]
    else:
        cells += [f"{abs(a.imag) / (2.0 * np.pi):.6g}", "locked", "", ""]
    cells += [with_error(pair.difference.real, pair.std.real)]
    cells += ["" if np.isnan(pair.z) else f"{pair.z:.3g}", "" if np.isnan(pair.mac) else f"{pair.mac:.4f}"]
    return (*cells, "" if pair.counted else "weak")


def headings(found: Comparison) -> tuple[str, ...]:
    """Headings of the cells of `pair_row` in a comparison `found`."""
    over = (found.over,) if found.over else ()
    return (*over, "a", "b", "f [Hz]", "Δf [Hz]", "Δf [%]", "Δζ [%]", "ΔRe λ [1/s]", "z", "mac", "")


def verdict(found: Comparison) -> str:
    """One sentence on all differences of a comparison `found` together."""
    if not found.independent:
        return "No χ²: both sides are identified from one record, so their errors are not independent."
    if found.chi2 is None or found.p is None:
        if not found.pairs:
            return "No χ²: no mode of a is like one of b."
        known = all(np.isnan(pair.z) for pair in found.pairs)
        return "No χ²: " + ("neither side has deviations." if known else "no pair with deviations counts.")
    figures = f"χ² = {found.chi2:.4g} of {found.dof}, {_probability(found.p)}"
    if found.p >= RARE:
        return f"{figures}: the deviations explain the differences."
    worst = found.worst
    assert worst is not None
    number = mode_number(found.points[worst.point].model_a, worst.a)
    where = "" if found.over is None else f" at {found.over} = {found.points[worst.point].value:g}"
    return (
        f"{figures}: the differences are more than the deviations explain, most in mode {number} of a{where} "
        f"({worst.z:.3g} deviations)."
    )


def missing_words(found: Comparison) -> list[str]:
    """Sentences on the modes of a comparison `found` that one side alone has, a mode each."""
    words = []
    for name, other, missing in (("b", "a", found.missing_in_b), ("a", "b", found.missing_in_a)):
        for number, mode in missing:
            point = found.points[number]
            model = point.model_a if other == "a" else point.model_b
            where = "" if found.over is None else f" at {found.over} = {point.value:g}"
            lam = model.exponents[mode]
            hertz = abs(lam) / (2.0 * np.pi)
            told = f"Missing in {name}: mode {mode_number(model, mode)} of {other}{where}, "
            words.append(told + f"f = {hertz:.5g} Hz, Re λ = {lam.real:.4g} 1/s.")
    return words


def update_words(found: Updated) -> list[str]:
    """Sentences on a fit `found`: what is not determined, and how far the model misses."""
    words = [f"Not determined by these data: the direction {direction}." for direction in found.unidentifiable]
    if found.p is None:
        words.append(f"χ² = {found.chi2:.4g} with no degree of freedom left: nothing tells whether the model fits.")
        return words
    figures = f"χ² = {found.chi2:.4g} of {found.dof}, " + _probability(found.p)
    if found.p >= RARE:
        words.append(f"{figures}: the model fits.")
        return words
    worst = max(found.misfits, key=lambda misfit: misfit.z)
    words.append(
        f"{figures}: the model misses by {worst.z:.3g} deviations, most in the mode at {worst.frequency_hz:.4g} Hz of "
        f"result {worst.point + 1}. "
        "Deviations of the parameters are not widened by that."
    )
    return words


def _probability(p: float) -> str:
    return "p < 1e-300" if p < 1e-300 else f"p = {p:.2g}"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pair(Rebuilt):
    """One mode of both sides.

    Parameters
    ----------
    point
        The number of the point.
    a, b
        The modes of the models, counted from 0. Of two real multipliers of a lock each has its own row; a pair beside
        such two has one row, with the one of both that decays less.
    exponent_a, exponent_b
        λ on the branch that a reports [1/s].
    difference, std
        λ of a less λ of b, and its deviation by both sides together, part by part [1/s]; the imaginary part is NaN of
        real multipliers, and of a pair beside two of them.
    z
        The difference over its deviations, √(d' C⁻¹ d); NaN where neither side has any.
    mac
        The similarity of both shapes, 0 to 1; NaN where fewer than two channels are common.
    mac_noise
        The 1 - mac that the noise of the shapes makes on average.
    counted
        False of a weak mode and of a result that fails: they are shown, and are not in χ².
    """

    point: int
    a: int
    b: int
    exponent_a: complex
    exponent_b: complex
    difference: complex
    std: complex
    z: float
    mac: float
    mac_noise: float
    counted: bool

    @property
    def frequencies_hz(self) -> tuple[float, float]:
        """|Im λ|/2π of a and b [Hz]."""
        return abs(self.exponent_a.imag) / (2.0 * np.pi), abs(self.exponent_b.imag) / (2.0 * np.pi)

    @property
    def damping_ratios(self) -> tuple[float, float]:
        """-Re λ/|λ| of a and b; NaN where λ is zero."""
        a, b = (-z.real / abs(z) if z else float("nan") for z in (self.exponent_a, self.exponent_b))
        return a, b


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ComparedPoint(Sealed):
    """The modes of both sides at one point.

    Parameters
    ----------
    value
        The operating point, None of one point without.
    model_a, model_b
        The models as one hit.
    modes_a, modes_b
        Modes of the rows and columns of `macs`: one of each pair, both of a couple.
    macs
        The similarity of each mode of a with each of b, NaN without shapes (modes of a, modes of b).
    turn
        By how much of a period phase zero of b is later than that of a, as the shapes say; it was moved so far.
    """

    value: float | None
    model_a: PeriodicModel
    model_b: PeriodicModel
    modes_a: tuple[tuple[int, ...], ...]
    modes_b: tuple[tuple[int, ...], ...]
    macs: Floats
    turn: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Comparison(Told, Drawn, Rebuilt):
    r"""Two sets of modes held against one another.

    .. math:: \chi^2 = d^T (\Sigma_a + \Sigma_b)^{-1} d

    with d the differences of all exponents that are paired and counted, and Σ the covariances of both sides, zero of a
    known system.

    Parameters
    ----------
    a, b
        What was compared, in words.
    over
        The quantity of the operating point; None of one point.
    points
        The modes of both sides, point by point.
    pairs
        The modes that both have.
    missing_in_a, missing_in_b
        A point and a mode of the other side that this side has not.
    chi2, dof, p
        χ², the number of its parts, and the probability that χ² is as large by the deviations alone; None, 0 and None
        where nothing is counted.
    independent
        False where both sides are identified from samples of one record: no χ² holds then.
    warnings
        What a reader must know, a sentence each.
    """

    kind: ClassVar[str] = "comparison"  # by it the functions for a result are found
    a: str
    b: str
    over: str | None
    points: tuple[ComparedPoint, ...]
    pairs: tuple[Pair, ...]
    missing_in_a: tuple[tuple[int, int], ...]
    missing_in_b: tuple[tuple[int, int], ...]
    chi2: float | None
    dof: int
    p: float | None
    independent: bool = True
    warnings: tuple[str, ...] = ()

    @property
    def worst(self) -> Pair | None:
        """The pair with the largest z among those that count, else of all; None without any."""
        return max(self.pairs, key=lambda pair: (pair.counted, float(np.nan_to_num(pair.z))), default=None)

    def _figures(self) -> Drawings:
        return {"comparison": (self, {})}
