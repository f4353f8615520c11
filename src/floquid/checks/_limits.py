"""Limits at which a search ended, and modes that the record does not determine."""

from __future__ import annotations

from typing import Any

import numpy as np

from floquid.checks._check import Evidence
from floquid.core import PeriodicModel
from floquid.findings import Finding, failure, note, warning
from floquid.fit import DEVIATIONS, chi2_limit
from floquid.inputs import nearly_one

VAGUE = 0.5
"""The deviation of the decay of a real multiplier over it, from which on it is not determined,"""

ROUGHLY = 0.1
"""where that is more than this over a period [nepers]."""


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
    found, highest = [], case.limits.highest
    if case.most is not None and _clear(case.model, highest):
        if nearly_one(case.samples, case.fit.at):  # harmonics beyond the limit are made up for by a copy of the mode
            found.append(failure("inputs_copies", most=highest))
        elif highest == case.most:
            found.append(warning("inputs_harmonics", most=case.most))
    return tuple(found)


def determined(case: Any, _: Evidence) -> tuple[Finding, ...]:
    """Finding on decays that the record does not determine."""
    return case.undetermined()


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


def is_undetermined(model: PeriodicModel) -> bool:
    """True where a mode's decay is not known within a period, or that of a real multiplier hardly at all.

    Real multipliers that make up for one another, or for a pair, are of that kind; one of slow decay is not.
    """
    assert model.exponent_std is not None
    spread = model.exponent_std.real
    vague = (spread > VAGUE * np.abs(model.exponents.real)) & (model.period * spread > ROUGHLY)
    return bool((model.period * spread > 1.0).any() or (model.real & vague).any())
