"""The end of the chain: whether the model can be believed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from floquid.checks import Evidence, validate
from floquid.errors import FloquidError
from floquid.findings import failure
from floquid.pipeline._analysis import Analysis


def validated(analysis: Analysis, *, report: Callable[[str], None] = lambda _: None) -> Analysis:
    """Analysis with the verdict on its model, and on its A(t) where it has one.

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
            misfit=analysis.misfit,
            report=report,
        )
    except (FloquidError, np.linalg.LinAlgError) as error:
        why = failure("not_checked", error=str(error).rstrip("."))
        verdict = Evidence(findings=[why]).verdict(analysis.noise.shape)
    return replace(analysis, validation=replace(verdict, passed=verdict.passed and not analysis.failed))
