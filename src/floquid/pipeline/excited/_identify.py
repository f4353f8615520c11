"""The chain for records with measured inputs: samples → modes and the way inputs reach them → verdict."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from floquid._checks import input_error
from floquid.checks import Driven, Excited, Parted, findings_of, judged
from floquid.core import PeriodicModel, Provenance
from floquid.errors import IdentificationError
from floquid.findings import Finding, Severity, note, warning
from floquid.inputs import Limits, Linearisation, Uncertainty, fitted_freely, read_near_axis, searched
from floquid.pipeline._analysis import Analysis
from floquid.pipeline._deviations import Driven as Fitted
from floquid.pipeline._deviations import with_state
from floquid.preparation import Prepared, Settings

OF = "identify"

HIGHEST = 24
"""Harmonics of inputs and outputs at most."""


def identified_driven(prepared: Prepared, report: Callable[[str], None]) -> Analysis:
    r"""Identify from the response to measured inputs, of records with their clocks on.

    .. math:: \dot z_r = \lambda_r z_r + \sum_{i,l} b_{r,i,l}\, e^{i l \omega t} u_i, \qquad
              y = \sum_r \sum_m c_{r,m}\, e^{i m \omega t} z_r + \sum_{i,n} D_{i,n}\, e^{i n \omega t} u_i + e

    with e white in each output. Candidates for λ come from a subspace method on modulated inputs, those together that
    come up most, then others from what is left; harmonics, modes and real multipliers are decided by tests; all is
    finished by maximum likelihood. The state at the start of each record is free: a decay after a measured blow is the
    same fit.

    Raises InputError where the records, the inputs or the clock are not possible, IdentificationError where the inputs
    say nothing of the system, or no mode rises above the noise.
    """
    own, settings = prepared.parted, prepared.settings
    assert own is not None
    samples = own.samples
    phases = 2.0 * np.pi / (samples.fundamental * samples.step)
    if settings.harmonics is not None and 2 * settings.harmonics >= phases:
        must = f"be less than half the {phases:.6g} samples a period"
        raise input_error("harmonics", OF, must, f"is {settings.harmonics}", "Ask for fewer, or sample faster.")
    limits = limits_of(settings, phases)
    report("searching for modes")
    found, unfinished = searched(samples, limits, report)
    free = None
    if settings.harmonics is None and at_limit(found, limits) and limits.highest < HIGHEST:
        report("fitting matrices at each phase")
        # The criterion of Schwarz (1978) chooses
        one = fitted_freely(samples, settings.order)
        free = one if one is not None and one.criterion > found.criterion else None
        found = free or found
    late = (warning("out_of_time", seconds=settings.seconds),) if unfinished else ()
    if not found.modes and late:
        raise IdentificationError(f"Identification ended without a result: {late[0].clause}.")
    if not found.modes:
        raise IdentificationError(
            "Identification ended without a result: no mode rises above the noise, driven by the inputs or ringing at "
            "first. Drive it harder or for longer, or check which channels are `inputs`."
        )
    report("estimating deviations")
    near = read_near_axis(samples, found)
    found = near.at
    fit = Uncertainty(samples, found)
    provenance = Provenance.merge(tuple(record.provenance for record in own.records))
    model = fit.model(own.outputs, own.inputs, provenance, near.as_read)
    most = None if free else HIGHEST
    phases_free = (note("inputs_free", phases=round(phases)),) if free else ()
    analysis = unchecked(prepared, model, fit, (*phases_free, *near.findings), late)
    turning = settings.forced == "auto"
    return finished(analysis, Driven(own=own, model=model, limits=limits, fit=fit, most=most, turning=turning), report)


def limits_of(settings: Settings, phases: float) -> Limits:
    """Limits of a search in records of some samples a period, which hold as many harmonics of a pair."""
    most = min(HIGHEST, 0.5 * max(int(phases + 1e-6) - 1, 0))
    return Limits(
        mode_alarm=settings.mode_false_alarm,
        harmonic_alarm=settings.harmonic_false_alarm,
        seconds=settings.seconds,
        order=settings.order,
        highest=most if settings.harmonics is None else settings.harmonics,
    )


def unchecked(
    prepared: Prepared, model: PeriodicModel, fit: Fitted, told: Sequence[Finding], late: Sequence[Finding]
) -> Analysis:
    """The result before any check: what was done, what is told of the fit, and whether time was over."""
    own, settings = prepared.parted, prepared.settings
    assert own is not None
    missed = (
        ()
        if settings.order in (None, model.order)
        else (warning("other_order", order=settings.order, found=model.order),)
    )
    return Analysis(
        settings=settings,
        records=own.records,
        model=model,
        driven=fit,
        shafts=own.shafts,
        findings=(*prepared.findings, *done_beside(own), *told, *missed, *late),
    )


def at_limit(found: Linearisation, limits: Limits) -> bool:
    """True where a search found no mode, or one with as many harmonics as are looked for."""
    widest = max((max(abs(mode.turns).max(), abs(mode.reach).max()) for mode in found.modes), default=np.inf)
    return bool(widest > limits.highest - 1.0)


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
    assert analysis.driven is not None
    again = analysis.driven.estimates_at
    return with_state(replace(analysis, validation=verdict, findings=found), again, report)
