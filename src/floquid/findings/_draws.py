"""Words of findings on records drawn from a result."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from floquid.findings._phrases import both

QUANTITIES = {
    "exponents": "exponents",
    "multipliers": "multipliers",
    "frequencies_hz": "frequencies",
    "damping_ratios": "damping ratios",
    "coefficients": "Fourier coefficients",
    "period": "period",
    "system": "A(t)",
    "transition": "Φ(t, t0)",
    "inputs": "B(t)",
}
"""Words for the quantities."""

Counts = Sequence[int]


def _wrong(
    names: Sequence[str],
    wrong: Counts,
    elements: Counts,
    least: Sequence[float],
    most: Sequence[float],
    right: Sequence[str],
    error: float,
) -> str:
    said = [
        f"{QUANTITIES[name]} ({few} of {many} elements, the draws spread {low:.3g} to {high:.3g} times as much)"
        for name, few, many, low, high in zip(names, wrong, elements, least, most, strict=True)
    ]
    rest = f" They hold for {', '.join(QUANTITIES[name] for name in right)}." if right else ""
    return f"The asymptotic deviations do not hold for {'; '.join(said)}; {_known(error)}.{rest}"


def _known(error: float) -> str:
    return f"each ratio is known to {100.0 * error:.2g} %"


def _wide(names: Sequence[str], ratios: Sequence[float], misfit: bool) -> str:
    said = [f"{QUANTITIES[name]} ({r:.3g} times as large in the median)" for name, r in zip(names, ratios, strict=True)]
    beside = "what is left beside noise" if misfit else "what is left out of the model may do"
    return (
        f"The deviations of {both(said)} are larger than the draws spread, as they should be: they also count "
        f"{beside}, which no draw shows."
    )


def _bias(names: Sequence[str], large: Counts, elements: Counts, most: Sequence[float]) -> str:
    said = [
        f"{QUANTITIES[name]} ({few} of {many} elements, by up to {size:.2g} deviations)"
        for name, few, many, size in zip(names, large, elements, most, strict=True)
    ]
    return f"There is a bias in {'; '.join(said)}."


def _failed(failed: int, draws: int, numbers: Counts, errors: Sequence[str]) -> str:
    reasons = " ".join(f"{number}: {words}" for number, words in zip(numbers, errors, strict=True))
    return f"{failed} of {draws} draws failed, and the spread of the others may be too small. {reasons}"


def _orders(draws: int, same: int, orders: Counts, numbers: Counts) -> str:
    others = ", ".join(f"{order} in {number}" for order, number in zip(orders, numbers, strict=True))
    return f"Of {draws} draws the order came out the same in {same}. Orders: {others}."


DRAWS: dict[str, str | Callable[..., str]] = {
    "no_deviations": "The fit gave no asymptotic deviations to compare with: those of the draws are all there is.",
    "deviations_hold": lambda tested, draws, error: (
        f"The asymptotic deviations hold: of {tested} the {draws} draws contradict none ({_known(error)})."
    ),
    "deviations_wrong": _wrong,
    "deviations_wide": _wide,
    "bias": _bias,
    "draws_failed": _failed,
    "draws_orders": _orders,
}
"""By code."""
