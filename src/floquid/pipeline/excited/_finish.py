"""The end of an identification where the excitation goes on: the checks, and A(t)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from floquid.checks import Excited, Parted, findings_of, judged
from floquid.core import PeriodicModel
from floquid.errors import FloquidError
from floquid.findings import Finding, Severity, note, warning
from floquid.pipeline._analysis import Analysis
from floquid.pipeline._state import state_of

PERIOD = ("wrong_period", "period_twice")
"""Findings that the period is not that of the response: warnings where it is trusted."""

WORTHLESS = "held_out_grows"
"""The finding of samples left out by which the model itself fails: its prediction grows without bound."""


def done_beside(own: Parted) -> tuple[Finding, ...]:
    """Findings on what was fitted beside the modes."""
    names = [channel.name for channel in own.inputs]
    done = [note("inputs", channels=names, hold=own.samples.hold)] if names else []
    used = {own_channel.name for own_channel in (*own.outputs, *own.inputs)}
    forces = {c.name for record in own.records for c in record.channels if c.quantity == "force"}
    done += [note("no_response", channel=name, quantity="force") for name in sorted(forces - used)]
    said = (finding for shaft in own.shafts for finding in shaft.findings if finding.code != "angle_alike")
    return (*done, *own.findings, *said)


def order_missed(model: PeriodicModel, order: int | None) -> tuple[Finding, ...]:
    """Finding on a model of another number of poles than was asked for."""
    return () if order in (None, model.order) else (warning("other_order", order=order, found=model.order),)


def finished(analysis: Analysis, subject: Excited, report: Callable[[str], None]) -> Analysis:
    """The result with its checks, and with A(t) in the states of its settings where it has some."""
    found, verdict, settings = findings_of(subject), None, analysis.settings
    if settings.validate:
        report("predicting samples left out")
        verdict = judged(subject)
        fatal = tuple(own for own in verdict.findings if own.code == WORTHLESS)
        found, verdict = (*found, *fatal), replace(verdict, findings=() if fatal else verdict.findings)
    found = (*analysis.findings, *found)
    if settings.trust_period:
        found = tuple(replace(own, severity=Severity.WARNING) if own.code in PERIOD else own for own in found)
    return with_state(replace(analysis, validation=verdict, findings=found), report)


def with_state(analysis: Analysis, report: Callable[[str], None]) -> Analysis:
    """The result with A(t) in the states of its settings; a finding says why where there is none."""
    settings = analysis.settings
    if not settings.states:
        return analysis
    if analysis.failed and settings.structure:
        why = "A structure is fitted by the deviations of the model, and one that fails has none to quote."
        return replace(analysis, findings=(*analysis.findings, warning("states_unfit", reason=why)))
    assert analysis.driven is not None
    try:
        state, refinement = state_of(analysis.model, settings, analysis.driven.estimates_at, report)
    except FloquidError as error:  # how many states the modes need was not known before the search
        missing = warning("states_unfit", reason=str(error).splitlines()[0])
        return replace(analysis, findings=(*analysis.findings, missing))
    if analysis.failed and state is not None:  # what the model leaves is no noise
        state = state.without_deviations()
    return replace(analysis, state=state, refinement=refinement)
