"""Words of findings on the verdict on a model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import TypeAlias

from floquid.findings._phrases import both, listed, response

Names: TypeAlias = Sequence[str]
Numbers: TypeAlias = Sequence[float]


def _tones(turns: Numbers, per_revolution: float, channels: Names, hits: Sequence[int], sizes: Numbers) -> str:
    parts = [
        f"{_tone(turn * per_revolution)} in {response(channel, hit)}, {size:.3g} times its noise"
        for turn, channel, hit, size in zip(turns, channels, hits, sizes, strict=True)
    ]
    return (
        f"A forced response remains: {listed(parts)}. Fit it beside the modes (`forced=`), or take it off. If it was "
        "fitted, it changes over the record."
    )


def _tone(per_revolution: float) -> str:
    """One harmonic of the revolution."""
    if per_revolution == 0.0:
        return "an offset"
    return f"{Fraction(per_revolution).limit_denominator(999)} per revolution"


def _harmonics(
    harmonics: Sequence[int], frequencies: Numbers, shares: Numbers, channels: Names, hits: Sequence[int]
) -> str:
    parts = [
        f"harmonic {harmonic:+d} of the {frequency:.4g} Hz mode was not fitted ({100.0 * share:.2g} % of the response "
        f"of {response(channel, hit)})"
        for harmonic, frequency, share, channel, hit in zip(harmonics, frequencies, shares, channels, hits, strict=True)
    ]
    most = max(abs(harmonic) for harmonic in harmonics)
    return f"{listed(parts)}. Pass `harmonics={most}`; where many are missing, so are modes."


def _lines(frequencies: Numbers, channels: Names, hits: Sequence[int], sizes: Numbers) -> str:
    parts = [
        f"a peak at {frequency:.5g} Hz in {response(channel, hit)}, {size:.3g} times its noise, is not explained"
        for frequency, channel, hit, size in zip(frequencies, channels, hits, sizes, strict=True)
    ]
    return (
        f"{listed(parts)}. It is no harmonic of the revolution, and none that was tried of a mode. Likely a mode is "
        "missing: raise `order=`. Else more harmonics (`harmonics=`), another period, or interference."
    )


def _colour(
    squares: Numbers = (), channels: Names = (), hits: Sequence[int] = (), predictable: float | None = None
) -> str:
    places = [response(channel, hit) for channel, hit in zip(channels, hits, strict=True)] or ["the worst output"]
    parts = [f"{place}, squared correlations {size:.3g}" for place, size in zip(places, squares, strict=False)]
    if predictable is not None:
        parts = [f"the outputs, {predictable:.1%} of the variance being predictable"]
    return (
        f"the residual is not white noise in {listed(parts)}. Deviations there may be wrong. Likely: missing modes "
        "or harmonics, an unmeasured force, the period, or a sensor's filter or drift."
    )


def _held_out_fit(fit: float, channel: str, hit: int, least: float) -> str:
    return (
        f"the model predicts {fit:.1%} of the response in cycles left out of the fit, least in "
        f"{response(channel, hit)} ({least:.1%}). It is not a model of this response. Look for missing modes and "
        "harmonics, and check the period."
    )


def _held_out_error(ratio: float, channel: str, hit: int, part: str) -> str:
    return (
        f"samples left out of the fit are predicted with {ratio:.3g} times the expected error in "
        f"{response(channel, hit)}, most in the {part}. Likely: modes or harmonics are missing, "
        "samples are clipped, or another force acts. A nonlinearity is largest at first: leave periods out with "
        "`skip=`."
    )


def _system(pair: tuple[tuple[float, float], tuple[float, float]] | None, trace: bool, composition: float) -> str:
    of_system, of_model = (None, None) if pair is None else (complex(*value) for value in pair)
    broken = [] if pair is None else [f"a multiplier of A(t) is {of_system:.6g} where the model has {of_model:.6g}"]
    broken += ["the mean of tr A is not the sum of the exponents"] * trace
    broken += [f"Φ(t, t0) is off by {composition:.2g} of its size"] * bool(composition)
    return (
        f"A(t) integrated over a period differs from the model: {'; '.join(broken)}. Ask for more instants "
        "(`system_times=`), other states, or more harmonics."
    )


def _weak_modes(frequencies: Numbers, shares: Numbers) -> str:
    parts = [
        f"the mode at {f:.4g} Hz has {share:.2g} of the most power that a fit finds in noise alone"
        for f, share in zip(frequencies, shares, strict=True)
    ]
    return f"{listed(parts)}. Ask for a lower order (`order=`), or let it be found."


_UNCHECKED = "A(t) could not be checked: {}. Ask for instants evenly over one period."

VERDICT: dict[str, str | Callable[..., str]] = {
    "not_checked": "The model could not be checked: {error}.",
    "overflow": "{name} could not be computed: the numbers of the record or the model overflow.",
    "held_out_too_few": "No cycles could be left out for a test: the response lasts for too few. Record longer, or "
    "with less noise.",
    "held_out_singular": "No cycles could be left out for a test: the model cannot be fitted to a part of them "
    "({error}). Ask for fewer modes.",
    "held_out_grows": "The prediction of samples left out of the fit grows without bound. Ask for fewer modes, or look "
    "for a disturbance that the record has once.",
    "held_out_fit": _held_out_fit,
    "held_out_error": _held_out_error,
    "tone_left": _tones,
    "harmonic_left": _harmonics,
    "line_left": _lines,
    "colour_left": _colour,
    "mode_weak": _weak_modes,
    "system_states": _UNCHECKED.format("A(t) has {states} states and the model {modes} modes"),
    "system_instants": _UNCHECKED.format("the instants of A(t) are not spread evenly over one period"),
    "system_too_large": _UNCHECKED.format("A(t) is so large that it could not be integrated over a period"),
    "system_other": _system,
}
"""By code."""


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
