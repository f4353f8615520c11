"""Words of findings on the period: that the response has another one, and whether it is periodic at all."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from floquid.findings._phrases import both

WRONG = "Exponents and shapes would look right and be wrong."
REMEDY = f"{WRONG} Correct the period or the rate, or measure the shaft."
SMALLEST = 1e-300  # below, a double has too few digits for a probability to be printed


def _wrong_period(
    given: float,
    own: float | None = None,
    std: float | None = None,
    deviations: float = 0.0,
    fraction: bool = False,
    scores: Sequence[float] = (),
    slip: float | None = None,
    rate: float = 0.0,
    whole: int = 0,
) -> str:
    if own is None:
        return (
            f"The response does not repeat with the period given, {given:.10g} s. The residual asks for another one by "
            f"{deviations:.0f} deviations, too far off to estimate. {REMEDY}"
        )
    size = f"{own:.10g} s" if std is None else f"{own:.10g} ± {std:.1g} s"
    size = f"about {own:.5g} s" if scores or fraction else size
    parts = f"{size}{' or a fraction of it' * fraction}, not {given:.10g} s"
    text = f"The response does not repeat with the period given: its own is {parts}."
    if scores:
        seen, with_given, noise = scores
        text += f" The squared scores are {seen:.3g} and {with_given:.3g}; noise alone stays below {noise:.3g}."
    if slip is None:
        return f"{text} {REMEDY}"
    text += f" Over the record the phase slips by {slip:.3g} samples. {WRONG}"
    return f"{text} {_rounded(given, rate, whole)}" if whole else text


def _rounded(given: float, rate: float, whole: int) -> str:
    """Remedy where the response's own period is a whole number of samples."""
    return (
        f"Its own period is {whole} samples exactly, so the period or the sampling interval of {1.0 / rate:.6g} s was "
        f"rounded. If the period is right, pass `rate={whole / given:.12g}`. If the rate is right, pass "
        f"`period={whole / rate:.12g}`."
    )


def _twice(given: float, even: float, odd: float, limit: float) -> str:
    return (
        f"The response repeats twice within the {given:.6g} s given. Even harmonics have squared scores of {even:.3g}, "
        f"odd ones {odd:.3g}, within the noise (limit {limit:.3g}). Modes would be found more than once. Pass half of "
        f"it: `period={0.5 * given:.10g}`. For a shaft that turns once in two of these, add "
        "`periods_per_revolution=2`."
    )


def _multiple(given: float, times: int) -> str:
    return (
        f"The system repeats {times} times within the {given:.6g} s given: lines of its modes are {times} harmonics "
        f"apart. Pass `period={given / times:.10g}`, or `periods_per_revolution={times}` with a shaft that turns once "
        f'in {given:.6g} s. For a sensor that runs to and fro keep the period, and pass `branch="symmetric"`.'
    )


def _phase(record: int, deviations: float | None = None) -> str:
    how = "by about half a period" if deviations is None else f"by {deviations:.0f} deviations"
    return (
        f"The phase of record {record} differs from that of the first {how}. Records must count from the same phase: "
        "give their beginnings on one time axis, the origin of the clock, or a tachometer."
    )


def _of_orbit(period: float, orbit: float, harmonics: Sequence[int], symmetric: bool) -> str:
    text = (
        "The period follows from lines that do not decay, a limit cycle or a response to a force, not from the modes. "
        f"They are {both([str(m) for m in harmonics[:8]])} times {1.0 / orbit:.6g} Hz."
    )
    if not symmetric:
        return text
    return (
        f"{text} All are odd multiples: the orbit is half-wave symmetric, x(t + T/2) = -x(t), with T = {orbit:.7g} s. "
        f"A(t) of a symmetric system has half of its period, {period:.7g} s, and that was used. If the system is not "
        f"symmetric, pass `period={orbit:.10g}`."
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
    return (
        f"Nothing periodic is seen: {_p(p)}. Harmonics above {size} of the mode would show {100 * power:.3g} times in "
        "100."
    )


def _untested(modes: Sequence[int], harmonics: Sequence[int]) -> str:
    cases = ", ".join(f"{m} of mode {mode}" for mode, m in zip(modes, harmonics, strict=True))
    return f"Not tested: m = {cases}. They are above the Nyquist frequency, not fitted, or on another mode."


PERIOD: dict[str, str | Callable[..., str]] = {
    "wrong_period": _wrong_period,
    "no_second_harmonic": "No mode has a second harmonic above the noise. The system looks constant, or the period is "
    "wrong and each harmonic became a mode.",
    "period_halved": "Modes come in pairs of equal decay, half a fundamental apart. Most likely the true period is "
    "twice the one given, and each mode is listed twice.",
    "period_twice": _twice,
    "period_multiple": _multiple,
    "branch_left": lambda frequency, share: (
        f"No turning point of a scan makes all shapes even: {100.0 * share:.0f} % of the energy of that at "
        f"{frequency:.6g} Hz is odd. Exponents are on the branches of their strongest lines."
    ),
    "branch_uneven": "The shapes are even about no turning point of a scan. They differ from their mirror images by "
    "more than their deviations (χ² {squares:.3g}, limit {limit:.3g}). If no sensor runs to and fro, pass "
    '`branch="strongest"`.',
    "branch_untested": "Whether the shapes are even about a turning point of a scan is not tested without deviations.",
    "records_phase": _phase,
    "period_of_orbit": _of_orbit,
    "orbit_of_two_periods": "The steady response repeats after two periods, with the opposite sign after one. It is a "
    "half-wave symmetric orbit, or the imbalance of a shaft that turns once in two periods. It was fitted beside the "
    "modes, with two periods a revolution.",
    "period_no_line": "No period found: no line that decays rises above the noise.",
    "period_no_family": "No period found: no two lines have the same decay, as harmonics of a mode have. The system "
    "looks constant.",
    "period_one_spacing": "No period found: there is only one spacing of lines. Two modes of a constant system with "
    "the same damping look the same.",
    "period_by_chance": "No period found: spacings as noisy as these would agree by chance.",
    "period_other": "No period found: spacings of {frequency:.6g} Hz explain the lines as well, in other families.",
    "period_lost": "No period found: a fit with one spacing for all families moves away from the lines.",
    "period_differs": "No period found: a fit to the whole record gives another period than its lines.",
    "periodic": _periodic,
    "not_periodic": _not_periodic,
    "periodic_untestable": "Periodicity was not tested: no harmonic rises above the noise beside the zeroth.",
    "periodic_untold": lambda p, spacing: (
        f"Periodicity is undecided: there are further lines ({_p(p)}), but not where harmonics are (p = {spacing:.2g})."
        " Most likely modes of a constant system fold onto one another and were taken for one."
    ),
    "untested": _untested,
    "locked": lambda modes: (
        f"The multipliers of modes {', '.join(map(str, modes))} are real, as periodicity makes them; a constant system "
        "has that only by chance. The test does not count it."
    ),
}
"""By code."""
