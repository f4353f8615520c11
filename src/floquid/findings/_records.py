"""Words of findings on records and on the angle of a shaft."""

from __future__ import annotations

from collections.abc import Callable

from floquid._checks import counted
from floquid.findings._phrases import valued


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
    "beyond_angle": _beyond,
}
"""By code."""
