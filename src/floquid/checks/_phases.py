"""Records that are not at the phase of the first."""

from __future__ import annotations

from typing import Any

from floquid.checks._check import Evidence
from floquid.findings import Finding, failure
from floquid.innovations import turned_records

LIMIT = 5.0  # deviations from which on a period, or a phase, is another one than that given


def phases(case: Any, _: Evidence) -> tuple[Finding, ...]:
    """Findings on records after the first that are at another phase.

    By half a period the slope along the phase is none: that is told by how their products turn.
    """
    steps = case.phase_steps()
    turned = turned_records(case.samples) if steps else []
    return (
        *(failure("records_phase", record=number + 1) for number in turned),
        *(
            failure("records_phase", record=number + 1, deviations=abs(step) / std)
            for number, (step, std) in enumerate(steps, start=1)
            if number not in turned and abs(step) > LIMIT * std
        ),
    )
