"""Words of findings on records and their samples."""

from __future__ import annotations

from collections.abc import Callable


def _valued(value: float, unit: str) -> str:
    return f"{value:.6g}" if unit == "-" else f"{value:.6g} {unit}"


def _clipped(channel: str, unit: str, levels: tuple[float, ...], samples: int, share: float) -> str:
    at = " and ".join(_valued(level, unit) for level in levels)
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
        f"channel {channel!r} stands still at {_valued(level, unit)} from {first:.6g} to {last:.6g} s, {samples} "
        "samples."
    ),
    "missing_samples": _missing,
    "wraps_round": _wrapped,
    "impact": _impact,
}
"""By code."""
