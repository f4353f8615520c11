"""Words of findings on the period: that the response has another one, and whether it is periodic at all."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from floquid.findings._phrases import both

WRONG = "Exponents and shapes would look right and be wrong."
REMEDY = f"{WRONG} Correct the period, or the rate, or measure the shaft."
SMALLEST = 1e-300  # probabilities below this are not told apart


def _wrong_period(
    given: float,
    own: float | None = None,
    std: float | None = None,
    deviations: float = 0.0,
    fraction: bool = False,
    scores: Sequence[float] = (),
    **rounded: Any,
) -> str:
    if own is None:
        return (
            f"The response does not repeat with the period given, {given:.10g} s: the residual goes with a change of "
            f"it ({deviations:.0f} deviations), too large to tell the right one. {REMEDY}"
        )
    size = f"{own:.10g} s" if std is None else f"{own:.10g} ± {std:.1g} s"
    size = f"about {own:.5g} s" if scores or fraction else size
    said = f"The response does not repeat with the period given: its own is {size}, not {given:.10g} s"
    if fraction:
        said = f"{said}; it repeats with its own or a fraction of it"
    if scores:
        seen, with_given, noise = scores
        said = f"{said} (squared scores of {seen:.3g} and {with_given:.3g}; noise alone stays below {noise:.3g})"
    return _rounded(said, given, **rounded) if rounded else f"{said}. {REMEDY}"


def _rounded(said: str, given: float, slip: float, rate: float, whole: int) -> str:
    """The sentence with the slip over the record, and with the remedy where the own period is whole samples."""
    said = f"{said}; over the record the phase slips by {slip:.3g} samples. {WRONG}"
    if not whole:
        return said
    return (
        f"{said} Its own is {whole} sampling intervals, a whole number: the period or the sampling interval of "
        f"{1.0 / rate:.6g} s was rounded. If the period is right, the sampling interval is {given / whole:.10g} s: "
        f"pass `rate={whole / given:.12g}`. If the rate is right, pass `period={whole / rate:.12g}`."
    )


def _twice(given: float, even: float, odd: float, limit: float) -> str:
    return (
        f"The response repeats twice within the {given:.6g} s given: even harmonics have squared scores of {even:.3g}, "
        f"odd ones of {odd:.3g}, which noise alone has (up to {limit:.3g}). Modes would be found more than once. Give "
        f"half of it: `period={0.5 * given:.10g}`; if a shaft that is out of balance turns once in two of these "
        "halves, give `periods_per_revolution=2` as well."
    )


def _phase(record: int, deviations: float | None = None) -> str:
    how = "is about half a period off" if deviations is None else f"is off by {deviations:.0f} deviations from"
    return (
        f"Record {record} {how} the phase of the first. Records must count from the same phase: give their begins on "
        "one time axis, the origin of the clock, or a tachometer."
    )


def _of_orbit(period: float, orbit: float, harmonics: Sequence[int], symmetric: bool) -> str:
    said = (
        f"The period is told by the lines that do not decay, at {both([str(m) for m in harmonics[:8]])} times "
        f"{1.0 / orbit:.6g} Hz: a limit cycle, or the response to a force; lines that decay do not tell it."
    )
    if not symmetric:
        return said
    return (
        f"{said} All are odd multiples: the orbit is half-wave symmetric, x(t + T/2) = -x(t), with T = {orbit:.7g} s. "
        f"A(t) of a symmetric system has half of its period, {period:.7g} s, which is taken; if the system is not "
        f"symmetric, give its own: `period={orbit:.10g}`."
    )


def _p(p: float) -> str:
    return f"p < {SMALLEST:g}" if p < SMALLEST else f"p = {p:.2g}"


def _periodic(p: float, harmonic: int, mode: int, channel: str) -> str:
    places = [f"at {harmonic} per period"] * bool(harmonic) + [f"in mode {mode}"] * bool(mode)
    places += [f"in channel {channel}"] * bool(channel)
    where = f"strongest {', '.join(places)}" if places else "no one harmonic, mode or channel stands out"
    return f"The response is periodic: {_p(p)}, {where}."


def _not_periodic(p: float, least: float, most: float, low: int, high: int, power: float) -> str:
    small, large = f"{100 * least:.2g} %", f"{100 * most:.2g} %"
    size = large if small == large else f"{small} (mode {low}) to {large} (mode {high})"
    seen = f"harmonics above {size} of the mode would have been, {100 * power:.3g} times in 100"
    return f"Nothing periodic is seen: {_p(p)}; {seen}."


def _untested(modes: Sequence[int], harmonics: Sequence[int]) -> str:
    cases = ", ".join(f"{m} of mode {mode}" for mode, m in zip(modes, harmonics, strict=True))
    return f"Not tested, being beyond what the sampling shows, not fitted, or on a mode: m = {cases}."


PERIOD: dict[str, str | Callable[..., str]] = {
    "wrong_period": _wrong_period,
    "no_second_harmonic": "No mode has a second harmonic above the noise: the system looks constant, or the period is "
    "wrong and tore each harmonic into a mode of its own.",
    "period_halved": "Modes come in pairs of equal decay, half a fundamental apart: the true period is most likely "
    "twice the one given, and each mode is listed twice.",
    "period_twice": _twice,
    "records_phase": _phase,
    "period_of_orbit": _of_orbit,
    "orbit_of_two_periods": "What does not decay repeats after two periods, with the opposite sign after one: a limit "
    "cycle or a forced orbit that is half-wave symmetric, or the imbalance of a shaft that turns once in two periods. "
    "It was fitted beside the modes, where a revolution is two periods.",
    "period_no_line": "Cannot tell: no line that decays rises above the noise.",
    "period_no_family": "Cannot tell: no two lines have one decay, as harmonics of a mode have: the response is that "
    "of a system that is constant, as far as it rises above the noise.",
    "period_one_spacing": "Cannot tell: one spacing alone is no period: two modes of a constant system with the same "
    "damping look the same.",
    "period_by_chance": "Cannot tell: spacings as noisy as these would agree by chance.",
    "period_other": "Cannot tell: spacings of {frequency:.6g} Hz explain the lines as well, with other lines belonging "
    "together.",
    "period_lost": "Cannot tell: the fit with one spacing for all families goes away from the lines.",
    "period_differs": "Cannot tell: fitted to the whole record the period is another than that of its lines.",
    "periodic": _periodic,
    "not_periodic": _not_periodic,
    "periodic_untestable": "Whether anything is periodic cannot be tested: no harmonic beside the zeroth is to be "
    "seen.",
    "periodic_untold": lambda p, spacing: (
        f"Whether anything is periodic cannot be told: there are harmonics ({_p(p)}), but not where harmonics are "
        f"(p = {spacing:.2g}). Most likely modes of a constant system fold onto one another, and were taken for one."
    ),
    "untested": _untested,
    "locked": lambda modes: (
        f"The multipliers of modes {', '.join(map(str, modes))} are real, as those of modes that periodicity locks; a "
        "constant system has that only by chance. It is no part of the test."
    ),
}
"""By code."""
