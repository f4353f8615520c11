"""A comparison in words: rows of its table, the verdict, and what is missing, for the terminal and files."""

from __future__ import annotations

import numpy as np

from floquid.comparison._parameters import Updated
from floquid.comparison._types import Comparison, Pair
from floquid.core import PeriodicModel
from floquid.views import with_error

RARE = 0.01  # the probability below which differences are told to be more than the deviations explain


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
