"""Modes that are lines of a revolution."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from floquid.checks._check import Evidence
from floquid.core import PeriodicModel
from floquid.findings import Finding, failure, warning

MOST_PERIODS = 6
"""Periods of a revolution up to which lines of the revolution are looked for where nobody says how many it holds."""

STILL = 3.0
"""Deviations within which a mode does not decay, and within which it is at a line."""

SHARP = 1e-3
"""The deviation of a frequency over the fundamental below which a mode at a line warns."""

SURE = 1.5e-4
"""That below which it fails: one in a hundred modes that do not decay is as near to some line by chance."""

ROUNDING = 1e-9
"""What is rounding of a frequency, over the fundamental."""


def steady(case: Any, found: Evidence) -> tuple[Finding, ...]:
    """Findings on modes that do not decay at a fraction of the fundamental, as lines of a revolution are."""
    if not case.turning or case.model.exponent_std is None:
        return ()
    longest = max(record.duration for record in case.own.records)
    unreached = [own.numbers["frequency"] for own in found.findings if own.code == "unreached"]
    return lines_of_revolution(case.model, longest, unreached, case.own.periods_per_revolution)


def lines_of_revolution(
    model: PeriodicModel, longest: float, unreached: Sequence[float], periods_of_turn: float
) -> tuple[Finding, ...]:
    """Findings on modes that do not decay at a fraction of the fundamental, as lines of a revolution are."""
    std = model.exponent_std
    assert std is not None
    still = np.abs(model.exponents.real) < STILL * std.real
    still &= np.abs(model.exponents.real) * longest < 1.0
    sharp = std.imag < SHARP * model.fundamental
    # The frequency of a real multiplier is none measured; no input reaches what drives the system itself.
    apart = np.isclose(np.abs(model.exponents)[:, None], 2.0 * np.pi * np.array(unreached), rtol=1e-9).any(axis=1)
    known = (std.imag < SURE * model.fundamental) & (~model.real | apart)
    turns, found = model.exponents.imag / model.fundamental, []
    for count in range(2, MOST_PERIODS + 1):
        near = np.rint(turns * count).astype(np.int64)
        off = np.abs(turns * count - near) * model.fundamental / count
        at = still & sharp & (np.gcd(near, count) == 1) & (off <= STILL * std.imag + ROUNDING * model.fundamental)
        if at.any():
            hertz = np.unique(np.abs(model.exponents.imag[at])) / (2.0 * np.pi)
            told = failure if known[at].any() else warning
            real = bool(model.real[at].any())
            # Where the revolution was said they are weak, and were left out: their numbers in it.
            lines = np.unique(np.rint(np.abs(turns[at]) * periods_of_turn)).astype(int).tolist()
            forced = lines if periods_of_turn % count == 0.0 else []
            found.append(told("line_as_mode", frequencies=hertz.tolist(), periods=count, real=real, forced=forced))
    return tuple(found)
