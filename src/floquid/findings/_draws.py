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
    parts = [
        f"{QUANTITIES[name]} ({few} of {many} elements; the draws spread {low:.3g} to {high:.3g} times as far)"
        for name, few, many, low, high in zip(names, wrong, elements, least, most, strict=True)
    ]
    rest = f" They hold for {', '.join(QUANTITIES[name] for name in right)}." if right else ""
    return f"The asymptotic deviations are wrong for {'; '.join(parts)}. {_accuracy(error)}{rest}"


def _accuracy(error: float) -> str:
    return f"Each ratio is accurate to {100.0 * error:.2g} %."


def _wide(names: Sequence[str], ratios: Sequence[float], misfit: bool) -> str:
    parts = [f"{QUANTITIES[name]} ({r:.3g} times, median)" for name, r in zip(names, ratios, strict=True)]
    beside = "the residual's excess over noise" if misfit else "parts that the model leaves out"
    return (
        f"The deviations exceed the spread of the draws for {both(parts)}. This is intended: they also count "
        f"{beside}, which no draw contains."
    )


def _bias(names: Sequence[str], large: Counts, elements: Counts, most: Sequence[float]) -> str:
    parts = [
        f"{QUANTITIES[name]} ({few} of {many} elements, up to {size:.2g} deviations)"
        for name, few, many, size in zip(names, large, elements, most, strict=True)
    ]
    return f"The estimates are biased: {'; '.join(parts)}."


def _failed(failed: int, draws: int, numbers: Counts, errors: Sequence[str]) -> str:
    reasons = " ".join(f"{number}: {words}" for number, words in zip(numbers, errors, strict=True))
    return f"{failed} of {draws} draws failed, so the spread may be too small. {reasons}"


def _orders(draws: int, same: int, orders: Counts, numbers: Counts) -> str:
    others = ", ".join(f"{order} in {number}" for order, number in zip(orders, numbers, strict=True))
    return f"{same} of {draws} draws gave the same order. Orders: {others}."


DRAWS: dict[str, str | Callable[..., str]] = {
    "no_deviations": "The fit gave no asymptotic deviations; only those of the draws exist.",
    "deviations_hold": lambda tested, draws, error: (
        f"The asymptotic deviations hold: {draws} draws contradict none of {tested}. {_accuracy(error)}"
    ),
    "deviations_wrong": _wrong,
    "deviations_wide": _wide,
    "bias": _bias,
    "draws_failed": _failed,
    "draws_orders": _orders,
}
"""By code."""
