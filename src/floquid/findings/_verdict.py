"""Words of findings on the verdict on a model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import TypeAlias

from floquid.findings._phrases import listed, response

Names: TypeAlias = Sequence[str]
Numbers: TypeAlias = Sequence[float]


def _tones(turns: Numbers, per_revolution: float, channels: Names, hits: Sequence[int], sizes: Numbers) -> str:
    parts = [
        f"{_tone(turn * per_revolution)} left in {response(channel, hit)}: {size:.3g} times its noise"
        for turn, channel, hit, size in zip(turns, channels, hits, sizes, strict=True)
    ]
    return f"{listed(parts)}. It is a forced response: fit it beside the modes with `forced=`, or take it off."


def _tone(per_revolution: float) -> str:
    """One harmonic of the revolution."""
    if per_revolution == 0.0:
        return "an offset"
    return f"{Fraction(per_revolution).limit_denominator(999)} per revolution"


def _harmonics(
    harmonics: Sequence[int], frequencies: Numbers, shares: Numbers, channels: Names, hits: Sequence[int]
) -> str:
    parts = [
        f"harmonic {harmonic:+d} of the mode at {frequency:.4g} Hz left, {share:.2g} of the response, most in "
        f"{response(channel, hit)}"
        for harmonic, frequency, share, channel, hit in zip(harmonics, frequencies, shares, channels, hits, strict=True)
    ]
    remedy = (
        "Keep more harmonics (`harmonics=`), or let them be chosen; where many are left, modes are missing or wrong."
    )
    return f"{listed(parts)}. {remedy}"


def _lines(frequencies: Numbers, channels: Names, hits: Sequence[int], sizes: Numbers) -> str:
    parts = [
        f"a line at {frequency:.5g} Hz left in {response(channel, hit)}: {size:.3g} times its noise"
        for frequency, channel, hit, size in zip(frequencies, channels, hits, sizes, strict=True)
    ]
    return (
        f"{listed(parts)}. It is no harmonic of the revolution, and none of those looked at of a mode: a mode that is "
        "missing (`order=`), harmonics beyond those kept (`harmonics=`), a period that is not the response's own, or "
        "interference."
    )


def _colour(
    squares: Numbers = (), channels: Names = (), hits: Sequence[int] = (), predictable: float | None = None
) -> str:
    where = [response(channel, hit) for channel, hit in zip(channels, hits, strict=True)] or ["the worst output"]
    parts = [f"{place} (squared correlations sum to {size:.3g})" for place, size in zip(where, squares, strict=False)]
    if predictable is not None:
        parts = [f"the outputs ({predictable:.1%} of the variance is predictable)"]
    return (
        f"the residual is not white but has broadband colour in {listed(parts)}. Deviations are too small or too large "
        "there. Look for modes or harmonics that are missing, for filters and drifts of the sensors, for what drives "
        "the system unmeasured, and for a period that is not the response's own."
    )


def _held_out_fit(fit: float, channel: str, hit: int, least: float) -> str:
    return (
        f"the model predicts {fit:.1%} of the response in cycles that it was not fitted to, least in "
        f"{response(channel, hit)} ({least:.1%}). It is not a model of this response: look for missing modes and "
        "harmonics, and check the period."
    )


def _held_out_error(ratio: float, channel: str, hit: int, part: str) -> str:
    return (
        f"samples that were left out of a fit are predicted with {ratio:.3g} times the expected error in "
        f"{response(channel, hit)}, most in the {part} of its response. Look there for clipping, other samples that "
        "are not the response's, a nonlinearity (leave the first periods out with `skip=`), another excitation, or "
        "modes and harmonics that are missing."
    )


def _system(pair: tuple[tuple[float, float], tuple[float, float]] | None, trace: bool, composition: float) -> str:
    found, own = (None, None) if pair is None else (complex(*one) for one in pair)
    broken = [] if pair is None else [f"a multiplier of A(t) is {found:.6g} where the model has {own:.6g}"]
    broken += ["the mean of tr A is not the sum of the exponents"] * trace
    broken += [f"Φ(t, t0) is off by {composition:.2g} of its size"] * bool(composition)
    return (
        f"A(t), integrated over a period, is another system: {'; '.join(broken)}. Ask for more instants "
        "(`system_times=`), other states, or more harmonics."
    )


def _weak_modes(frequencies: Numbers, shares: Numbers) -> str:
    parts = [f"the mode at {f:.4g} Hz has {share:.2g} of" for f, share in zip(frequencies, shares, strict=True)]
    return (
        f"{listed(parts)} the power that a fit finds in noise alone at most. Ask for a lower order (`order=`), or let "
        "it be found."
    )


_UNCHECKED = "A(t) could not be checked: {}. Ask for instants evenly over one period."

VERDICT: dict[str, str | Callable[..., str]] = {
    "not_checked": "The model could not be checked: {error}.",
    "overflow": "{name} could not be computed: the numbers of the record or the model overflow.",
    "held_out_too_few": "Cycles held out could not be predicted: the response is alive in too few cycles to leave some "
    "out. Record longer, or with less noise.",
    "held_out_singular": "Cycles held out could not be predicted: the model cannot be fitted to a part of them "
    "({error}). Ask for fewer modes.",
    "held_out_grows": "Samples that were left out of a fit are not predicted by it: what it predicts grows without "
    "bound. There may be fewer modes, or a disturbance that the record has once.",
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
