"""Phrases that the words of several findings are made of."""

from __future__ import annotations

from collections.abc import Sequence
from math import floor, log10

LISTED = 1  # places of one kind that are named, the worst first: each takes two lines of a terminal


def listed(parts: Sequence[str]) -> str:
    """First few of some parts, and the number of the rest."""
    more = len(parts) - LISTED
    return "; ".join(parts[:LISTED]) + (f"; and {more} more" if more > 0 else "")


def both(parts: Sequence[str]) -> str:
    """Names in a row: «a, b and c»."""
    return " and ".join([", ".join(parts[:-1]), parts[-1]]) if len(parts) > 1 else "".join(parts)


def response(channel: str, hit: int) -> str:
    """The response of a channel to a hit, counted from one; 0 where there is one hit alone."""
    return f"{channel} (hit {hit})" if hit else channel


def valued(size: str, unit: str) -> str:
    """A size with its unit; without one the size alone."""
    return size if unit == "-" else f"{size} {unit}"


def hertz(frequencies: Sequence[float]) -> str:
    """Frequencies in a row: «1.2 and 3.4 Hz»."""
    return f"{both([f'{frequency:.4g}' for frequency in frequencies])} Hz"


def resolved(value: float, least: int, gap: float) -> str:
    """A value with `least` digits, or with as many as a difference of `gap` needs to show."""
    more = floor(log10(abs(value))) - floor(log10(gap)) + 2 if value and gap else 0
    return f"{value:.{max(least, more)}g}"
