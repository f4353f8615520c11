"""The period of the response against that of the model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from floquid.checks._check import Evidence
from floquid.findings import Finding


@dataclass(frozen=True, slots=True, kw_only=True)
class Off:
    """Difference of the response's own period from that of the model.

    Parameters
    ----------
    relative, std
        (own - given)/given to first order, and its deviation; None where it is not to be quoted.
    deviations, limit
        Deviations between the two, and those that are let pass.
    near
        True where the step is so small that first order tells the own period.
    """

    relative: float
    std: float | None
    deviations: float
    limit: float
    near: bool = True


def period(case: Any, found: Evidence) -> tuple[Finding, ...]:
    """Finding on a period that is not that of the response."""
    off: Off | None = case.period_off()
    if off is None or found.kept("period", off.deviations, off.limit):
        return ()
    given, numbers = case.model.period, dict[str, Any](deviations=off.deviations)
    if off.near:
        numbers |= {"own": given * (1.0 + off.relative), "std": None if off.std is None else given * off.std}
    return found.against("wrong_period", "period", given=given, **numbers)
