"""The end of an identification where the excitation goes on: the verdict, modes that are lines, and A(t)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from floquid._arrays import Floats
from floquid.checks import Criterion, Validation
from floquid.errors import FloquidError
from floquid.findings import Finding, Severity, failure, warning
from floquid.pipeline._analysis import Analysis
from floquid.pipeline._state import state_of
from floquid.pipeline.excited._lines import MOST_PERIODS

HELD_OUT = 1.4
"""The error of prediction on samples left out, over the noise, from which on a model does not pass."""

PERIOD = ("inputs_period", "inputs_period_far", "ambient_period", "ambient_repeats", "ambient_twice")
"""Findings that the period is not that of the response: warnings where it is trusted."""

STILL = 3.0
"""Deviations within which a mode does not decay, and within which it is at a line."""

SHARP = 1e-3
"""The deviation of a frequency over the fundamental below which a mode at a line warns."""

SURE = 1.5e-4
"""That below which it fails: one in a hundred modes that do not decay is as near to some line by chance."""

ROUNDING = 1e-9
"""What is rounding of a frequency, over the fundamental."""


def validation_of(errors: Floats, findings: Sequence[Finding]) -> Validation:
    """The verdict from the error of prediction on samples left out, over that expected (outputs,).

    It is infinite where the prediction grows without bound. `findings` speak against the model by it.
    """
    nothing, worst = np.full((len(errors), 1), np.nan), float(errors.max())
    return Validation(
        metrics={"held_out_error": worst} if np.isfinite(worst) else {},
        criteria={"held_out_error": Criterion(limit=HELD_OUT)},
        passed=bool((errors < HELD_OUT).all()),
        findings=tuple(findings),
        fit=nothing,
        held_out_error=np.where(np.isfinite(errors), errors, np.nan)[:, None],
        colour=nothing,
        tones=np.zeros((len(errors), 1, 0)),
        lines=np.zeros((len(errors), 1, 0)),
    )


def finished(analysis: Analysis, periods_of_turn: float, report: Callable[[str], None]) -> Analysis:
    """The result with findings on modes that are lines, and A(t) in the states of its settings where it has some.

    `periods_of_turn` are the periods of a revolution as far as they were said.
    """
    analysis = replace(analysis, findings=(*analysis.findings, *_lines_found(analysis, periods_of_turn)))
    if analysis.settings.trust_period:
        told = [replace(own, severity=Severity.WARNING) if own.code in PERIOD else own for own in analysis.findings]
        analysis = replace(analysis, findings=tuple(told))
    if not analysis.settings.states:
        return analysis
    if analysis.failed and analysis.settings.structure:
        why = "A structure is fitted by the deviations of the model, and one that fails has none to quote."
        return replace(analysis, findings=(*analysis.findings, warning("states_unfit", reason=why)))
    assert analysis.driven is not None
    try:
        state, refinement = state_of(analysis.model, analysis.settings, analysis.driven.estimates_at, report)
    except FloquidError as error:  # how many states the modes need was not known before the search
        missing = warning("states_unfit", reason=str(error).splitlines()[0])
        return replace(analysis, findings=(*analysis.findings, missing))
    if analysis.failed and state is not None:  # what the model leaves is no noise
        state = state.without_deviations()
    return replace(analysis, state=state, refinement=refinement)


def _lines_found(analysis: Analysis, periods_of_turn: float) -> tuple[Finding, ...]:
    """Findings on modes that do not decay at a fraction of the fundamental, as lines of a revolution are."""
    model = analysis.model
    std = model.exponent_std
    if std is None or analysis.settings.forced != "auto":
        return ()
    still = np.abs(model.exponents.real) < STILL * std.real
    still &= np.abs(model.exponents.real) * max(record.duration for record in analysis.records) < 1.0
    sharp = std.imag < SHARP * model.fundamental
    # The frequency of a real multiplier is none measured; no input reaches what drives the system itself.
    unreached = [own.numbers["frequency"] for own in analysis.findings if own.code.startswith("unreached")]
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
