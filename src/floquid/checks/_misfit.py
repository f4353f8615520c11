"""What a fit of free responses leaves over the level of its noise."""

from __future__ import annotations

from typing import Any

from floquid.checks._check import Evidence
from floquid.findings import Finding, warning

MISFIT = 1.3  # times the noise that a fit may leave
FAILED = 3.0  # times the noise that a fit leaves from which on it is no model of the record: then it has no deviations


def misfit(case: Any, _: Evidence) -> tuple[Finding, ...]:
    """Finding on a fit that leaves more than noise, though not so much that it fails."""
    size = case.misfit
    return () if size is None or not MISFIT < size < FAILED else (warning("misfit", misfit=size),)


def level(case: Any, found: Evidence) -> tuple[Finding, ...]:
    """Note what the fit leaves over the level of its noise: a model that fails does not pass."""
    if case.misfit is not None:
        found.kept("misfit", case.misfit, FAILED)
    return ()
