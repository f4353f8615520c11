"""Words of findings on records, on the angle of a shaft, and on the period."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from floquid._checks import counted
from floquid.findings._phrases import both, valued


def _clipped(channel: str, unit: str, levels: tuple[float, ...], samples: int, share: float) -> str:
    at = " and ".join(valued(f"{level:.6g}", unit) for level in levels)
    return f"channel {channel!r} is clipped at {at}: {samples} samples, {100.0 * share:.3g} %."


def _missing(channels: tuple[str, ...], first: float, last: float, samples: int, of: int) -> str:
    who = f"channel {channels[0]!r} misses"
    if len(channels) > 1:
        names = ", ".join(repr(name) for name in channels)
        who = f"all {of} channels miss" if len(channels) == of else f"channels {names} miss"
    if samples == 1:
        return f"{who} 1 sample at {first:.6g} s."
    return f"{who} {samples} samples from {first:.6g} to {last:.6g} s."


def _wrapped(channel: str, bits: int, jumps: int) -> str:
    times = "once" if jumps == 1 else f"{jumps} times"
    return f"channel {channel!r} wraps round: it jumps by {2**bits} counts, its whole range, {times}."


def _impact(start: float, end: float, strength: float, double: bool, channel: str | None) -> str:
    where = "in the response" if channel is None else f"in the force {channel!r}"
    lasting = f" over by {end:.6g} s" if end > start else ""
    more = "; more than one blow (a double hit or a bounce)" if double else ""
    return f"impact at {start:.6g} s{lasting}, seen {where}, {100.0 * strength:.3g} % of the strongest{more}."


RECORDS: dict[str, str | Callable[..., str]] = {
    "clipped": _clipped,
    "stands_still": lambda channel, unit, level, first, last, samples: (
        f"channel {channel!r} stands still at {valued(f'{level:.6g}', unit)} from {first:.6g} to {last:.6g} s, "
        f"{samples} samples."
    ),
    "missing_samples": _missing,
    "wraps_round": _wrapped,
    "impact": _impact,
    "between_events": lambda records, periods, period, spread, phases: (
        f"A period is what lies between two events: {periods} in {counted(records, 'record')}, {period:.4g} s in the "
        f"mean, and {100.0 * spread:.2g} % (rms) about it. Decays run in periods, {phases} samples each, and are given "
        "in seconds of the mean period."
    ),
    "common_orbit": lambda records, periods: (
        f"The orbit that the {periods} periods of {counted(records, 'record')} are about was fitted beside the decays "
        "and taken off."
    ),
}
"""By code."""


CUT = "Cut the record to a part of steady speed."  # remedy where no periodic model holds


def _absent(absent: tuple[int, ...], lines: int) -> str:
    which = ", ".join(str(line) for line in absent[:6]) + (f" and {len(absent) - 6} more" if absent[6:] else "")
    word = "lines" if absent[1:] else "line"
    return f"No pulse comes from {word} {which} of {lines}. Phase zero is the first line after the gap."


def _bridged(first: float, last: float, revolutions: float, more: int) -> str:
    others = f"; there are {more} more such gaps" if more else ""
    where = f"{first:.6g} and {last:.6g} s, {revolutions:.3g} revolutions"
    return f"The angle was not measured between {where}: a smooth curve bridges them{others}."


def _beyond(before: float, after: float) -> str:
    parts = [f"{many:.3g} revolutions {where} it" for many, where in ((before, "before"), (after, "after")) if many]
    by = " and ".join(parts)
    return f"The record goes beyond the measured angle, by {by}: the speed is taken as constant there."


SHAFT: dict[str, str | Callable[..., str]] = {
    "speed_runs": lambda percent, hz: (
        f"The speed {'rises' if percent > 0.0 else 'falls'} by {abs(percent):.3g} % of its mean of {hz:.6g} Hz over "
        f"the record. Exponents change with it, so no periodic model holds. {CUT}"
    ),
    "speed_wanders": "The speed wanders by {percent:.2g} % (rms) about {hz:.6g} Hz, more than {limit:g} %: no periodic "
    f"model holds. {CUT}",
    "speed_usable": "The speed wanders by {percent:.2g} % (rms) about {hz:.6g} Hz. Above {limit:g} % take care: "
    "exponents themselves depend on speed.",
    "speed_steady": "The speed wanders by {percent:.2g} % (rms) about {hz:.6g} Hz: steady enough for a periodic model.",
    "speed_constant": "The speed is constant at {hz:.6g} Hz, to the accuracy of its measurement.",
    "speed_fitted": "Each pulse gives the angle of the shaft to {degrees:.2g} deg. Within that the speed is steady, so "
    "the period was fitted to the response.",
    "backwards": "The azimuth falls: the shaft turns backwards, and that way is counted as positive.",
    "pulses_guessed": "The number of lost pulses between {first:.6g} and {last:.6g} s is a guess: the speeds before "
    "and after differ.",
    "few_revolutions": "There are fewer than three revolutions: the {lines} lines are taken as evenly spaced.",
    "no_mark": "No line is marked: phase zero is at the first pulse, not at a known angle.",
    "absent_lines": _absent,
    "pulses_missing": "{number} {what} missing beside {used}: the angle was counted on over them.",
    "pulses_doubled": "{number} {what} left out: more than there are lines.",
    "pulses_rejected": "{number} {what} left out: far off the angle of the others.",
    "angle_bridged": _bridged,
    "uneven_lines": "The {lines} lines are unevenly spaced, by up to {degrees:.3g} deg or {percent:.3g} % of their "
    "spacing: learned from the pulses and taken out.",
    "rough_angle": "The residual of the angle scatters by {degrees:.3g} deg: the sensor is poor, or the speed changes "
    "within a revolution.",
    "angle_alike": "The residual of the angle is correlated ({correlation:.2g}) from pulse to pulse, so its deviations "
    "are too small. The speed changes faster than the curve can follow, or the sensor's error depends on the angle.",
    "angle_known": "The angle of the shaft is known to ±{degrees:.2g}°. That error makes {percent:.2g} % of what turns "
    "once with the shaft: where this is above the noise, it hides modes, or makes some. Sample the pulses faster, "
    "widen them, or use more of them a revolution.",
    "beyond_angle": _beyond,
}
"""By code."""


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
