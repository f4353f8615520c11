"""The end of the chain: whether the model can be believed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from floquid.checks import Criterion, Validation, validate
from floquid.errors import FloquidError
from floquid.findings import failure
from floquid.pipeline._analysis import Analysis
from floquid.pipeline._decay import FAILED


def validated(analysis: Analysis, *, report: Callable[[str], None] = lambda _: None) -> Analysis:
    """The same analysis with the verdict on its model, and on its A(t) where it has one.

    A verdict that cannot be had is one against the model, and says why. `analysis` is what `identify` found, or `load`
    read; `report` is told of each stage.
    """
    forced = analysis.forced
    nu = analysis.settings.periods_per_revolution if forced is None else forced.revolution / analysis.model.period
    try:
        verdict = validate(
            analysis.model,
            analysis.responses,
            analysis.clocks,
            noise=analysis.noise,
            state=analysis.state,
            whitening=analysis.whitening,
            periods_per_revolution=nu,
            report=report,
        )
    except (FloquidError, np.linalg.LinAlgError) as error:
        nothing = np.full(analysis.noise.shape, np.nan)
        verdict = Validation(
            metrics={},
            criteria={},
            passed=False,
            findings=(failure("not_checked", error=str(error).rstrip(".")),),
            fit=nothing,
            held_out_error=nothing,
            colour=nothing,
            tones=np.zeros((*analysis.noise.shape, 0)),
            lines=np.zeros((*analysis.noise.shape, 0)),
        )
    return replace(analysis, validation=_with_misfit(verdict, analysis))


def _with_misfit(verdict: Validation, analysis: Analysis) -> Validation:
    """The verdict with what the fit leaves as one more number: a model that fails does not pass, whatever else does."""
    if analysis.misfit is None:
        return verdict
    return replace(
        verdict,
        metrics={**verdict.metrics, "misfit": analysis.misfit},
        criteria={**verdict.criteria, "misfit": Criterion(limit=FAILED)},
        passed=verdict.passed and not analysis.failed,
    )
