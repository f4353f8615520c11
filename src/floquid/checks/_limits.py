"""Modes that are needed, at a limit of the search, not determined, or a line of the revolution."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from floquid.checks._check import Evidence
from floquid.core import PeriodicModel
from floquid.findings import Finding, failure, note, warning
from floquid.fit import DEVIATIONS, ROUNDING, chi2_limit
from floquid.inputs import nearly_one
from floquid.periodic import CONFIDENT


def needed(case: Any, _: Evidence) -> tuple[Finding, ...]:
    """Finding on the mode that would be missed least, by the squared deviations of its shape from zero."""
    seen = case.seen()
    if not seen:
        return ()
    rises = [squares / chi2_limit(degrees, case.limits.mode_alarm) for squares, degrees in seen]
    least = int(np.argmin(rises))
    hertz = abs(case.model.exponents[case.model.upper_modes[least]]) / (2.0 * np.pi)
    return (note("all_needed", number=len(rises), frequency=hertz, rise=rises[least]),)


def limits(case: Any, _: Evidence) -> tuple[Finding, ...]:
    """Finding on a search that ended at the most modes that it may find."""
    number = len(case.fit.at.modes)
    return (warning("search_ended", number=number),) if number >= case.limits.modes else ()


def bands(case: Any, _: Evidence) -> tuple[Finding, ...]:
    """Findings on bands that end at the highest harmonics looked for."""
    findings, highest = [], case.limits.highest
    if case.most is not None and _clear(case.model, highest):
        if nearly_one(case.own.samples, case.fit.at):  # a copy of the mode makes up for harmonics beyond the limit
            findings.append(failure("inputs_copies", most=highest))
        elif highest == case.most:
            findings.append(warning("inputs_harmonics", most=case.most))
    return tuple(findings)


def _clear(model: PeriodicModel, highest: int) -> bool:
    """True where one of the highest harmonics that are looked for is clear of noise."""
    assert model.coefficient_std is not None
    assert model.inputs is not None
    assert model.inputs.coefficient_std is not None
    for values, std, turns in (
        (model.coefficients, model.coefficient_std, model.harmonics),
        (model.inputs.coefficients, model.inputs.coefficient_std, model.inputs.harmonics),
    ):
        ends = np.abs(turns) >= highest
        if (np.abs(values[..., ends]) > DEVIATIONS * np.abs(std[..., ends])).any():
            return True
    return False


MOST_PERIODS = 6
"""Periods of a revolution up to which lines of the revolution are looked for where nobody says how many it holds."""

SHARP = 1.5e-4
"""The deviation of a frequency over the fundamental below which a mode at a line fails.

One in a hundred undamped modes is as near to some line by chance.
"""


def steady(case: Any, evidence: Evidence) -> tuple[Finding, ...]:
    """Findings on modes that do not decay at a fraction of the fundamental, as lines of a revolution are."""
    if not case.turning or case.model.exponent_std is None:
        return ()
    longest = max(record.duration for record in case.own.records)
    unreached = [finding.numbers["frequency"] for finding in evidence.findings if finding.code == "unreached"]
    return lines_of_revolution(case.model, longest, unreached, case.own.periods_per_revolution)


def lines_of_revolution(
    model: PeriodicModel, longest: float, unreached: Sequence[float], periods_of_turn: float
) -> tuple[Finding, ...]:
    """Findings on modes that do not decay at a fraction of the fundamental, as lines of a revolution are."""
    std = model.exponent_std
    assert std is not None
    still = np.abs(model.exponents.real) < DEVIATIONS * std.real
    still &= np.abs(model.exponents.real) * longest < 1.0
    determined = std.imag < CONFIDENT * model.fundamental
    # The frequency of a real multiplier is none measured; no input reaches what drives the system itself.
    apart = np.isclose(np.abs(model.exponents)[:, None], 2.0 * np.pi * np.array(unreached), rtol=1e-9).any(axis=1)
    known = (std.imag < SHARP * model.fundamental) & (~model.real | apart)
    turns, findings = model.exponents.imag / model.fundamental, []
    for count in range(2, MOST_PERIODS + 1):
        near = np.rint(turns * count).astype(np.int64)
        off = np.abs(turns * count - near) * model.fundamental / count
        at = still & determined & (np.gcd(near, count) == 1)
        at &= off <= DEVIATIONS * std.imag + ROUNDING * model.fundamental
        if at.any():
            hertz = np.unique(np.abs(model.exponents.imag[at])) / (2.0 * np.pi)
            report = failure if known[at].any() else warning
            real = bool(model.real[at].any())
            # Where the revolution was said they are weak, and were left out: their numbers in it.
            lines = np.unique(np.rint(np.abs(turns[at]) * periods_of_turn)).astype(int).tolist()
            forced = lines if periods_of_turn % count == 0.0 else []
            findings.append(report("line_as_mode", frequencies=hertz.tolist(), periods=count, real=real, forced=forced))
    return tuple(findings)
