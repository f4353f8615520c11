"""The chain for records with measured inputs: samples → modes and the way inputs reach them → verdict."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from floquid._checks import input_error
from floquid.checks import Validation
from floquid.core import Provenance, Record
from floquid.errors import IdentificationError
from floquid.findings import warning
from floquid.inputs import (
    Limits,
    Linearisation,
    Uncertainty,
    fitted_freely,
    linearise,
    read_near_axis,
    searched,
    slopes_of,
    solve,
    state_slopes,
)
from floquid.pipeline._analysis import Analysis
from floquid.pipeline._settings import Settings
from floquid.pipeline.excited._again import first_part
from floquid.pipeline.excited._finish import HELD_OUT, finished, validation_of
from floquid.pipeline.excited._prepare import OF, Parted, parted
from floquid.pipeline.excited._verdict import at_limit, verdict
from floquid.pipeline.preparation import refuse_driven

HIGHEST = 24
"""Harmonics of inputs and outputs at most."""

MOST_UNTOLD = 3.0
"""What deviations of the fit to a part may make of the prediction, over the noise: more is no model to predict with."""


def identified_driven(records: Sequence[Record], settings: Settings, report: Callable[[str], None]) -> Analysis:
    r"""Identify from the response to measured inputs, of records with their clocks on.

    .. math:: \dot z_r = \lambda_r z_r + \sum_{i,l} b_{r,i,l}\, e^{i l \omega t} u_i, \qquad
              y = \sum_r \sum_m c_{r,m}\, e^{i m \omega t} z_r + \sum_{i,n} D_{i,n}\, e^{i n \omega t} u_i + e

    with e white in each output. Candidates for λ come from a subspace method on modulated inputs, those together that
    come up most, then others from what is left; harmonics, modes and real multipliers are decided by tests; all is
    finished by maximum likelihood. The state at the begin of each record is free: a decay after a measured blow is the
    same fit.

    Raises InputError where the records, the inputs or the clock are not possible, IdentificationError where the inputs
    say nothing of the system, or no mode rises above the noise.
    """
    report("parting inputs and outputs")
    own = parted(records, settings)
    refuse_driven(records, settings)
    samples = own.samples
    phases = 2.0 * np.pi / (samples.fundamental * samples.step)
    if settings.harmonics is not None and 2 * settings.harmonics >= phases:
        must = f"be less than half the {phases:.6g} samples a period"
        raise input_error("harmonics", OF, must, f"is {settings.harmonics}", "Ask for fewer, or sample faster.")
    limits = Limits(
        mode_alarm=settings.mode_false_alarm,
        harmonic_alarm=settings.harmonic_false_alarm,
        seconds=settings.seconds,
        highest=max(min(HIGHEST, int(0.5 * phases) - 1), 0) if settings.harmonics is None else settings.harmonics,
    )
    report("searching for modes")
    found, unfinished = searched(samples, limits, report)
    free = None
    if settings.harmonics is None and at_limit(found, limits) and limits.highest < HIGHEST:
        report("fitting matrices at each phase")
        free = _if_better(fitted_freely(samples), found)
        found = free or found
    late = (warning("out_of_time", seconds=settings.seconds),) if unfinished else ()
    if not found.modes and late:
        raise IdentificationError(f"Identification ended without a result: {late[0].clause}.")
    if not found.modes:
        raise IdentificationError(
            "Identification ended without a result: no mode that the inputs reach, or that rings at the begin, rises "
            "above the noise. Drive it harder or for longer, or check which channels are `inputs`."
        )
    report("estimating deviations")
    near = read_near_axis(samples, found)
    found = near.at
    fit = Uncertainty(samples, found)
    provenance = Provenance.merge(tuple(record.provenance for record in records))
    model = fit.model(own.outputs, own.inputs, provenance, near.as_read)
    validation = None
    if settings.validate:
        report("predicting samples left out")
        validation = _validated(own, found)
    analysis = Analysis(
        settings=settings,
        records=own.records,
        model=model,
        driven=fit,
        shafts=own.shafts,
        validation=validation,
        findings=(*verdict(own, fit, model, limits, None if free else HIGHEST), *near.findings, *late),
    )
    return finished(analysis, own.periods_per_revolution, report)


def _if_better(one: Linearisation | None, other: Linearisation) -> Linearisation | None:
    """A fit if the criterion of Schwarz (1978) prefers it to another; None if not."""
    if one is None:
        return None
    return one if one.criterion > other.criterion else None


def _validated(own: Parted, found: Linearisation) -> Validation:
    """The verdict from samples left out."""
    errors = _held_out(own, found)
    against = [warning("inputs_held_out", error=float(errors.max()))] if (errors >= HELD_OUT).any() else []
    return validation_of(errors, against)


def _held_out(own: Parted, found: Linearisation) -> NDArray[np.float64]:
    """The rms error over what is expected, on the last quarter of each record, by a fit to the rest (outputs,).

    Expected are the noise, and what the deviations of that fit make of the prediction.
    """
    whole = own.samples
    first, fitted = first_part(whole)
    part = Uncertainty(first, solve(first, found.modes, found.direct))
    whole_at = linearise(whole, part.at.modes, part.at.direct)
    states = state_slopes(whole, whole_at)
    beyond = ~fitted
    columns, errors = whole_at.columns[:, beyond], []
    for channel, noise in enumerate(part.at.noise):
        left = whole.values[channel, beyond] - part.at.coefficients[:, channel] @ columns
        at = replace(whole_at, coefficients=part.at.coefficients)
        by_parameters = slopes_of(whole, at, channel, states)[:, beyond]
        # What the part does not tell of the model is no error of it.
        expected = noise**2 + np.minimum(
            part.errors.variance(channel, by_parameters.T, columns.T), MOST_UNTOLD * noise**2
        )
        errors.append(float(np.sqrt(np.mean(left**2 / expected))))
    return np.array(errors)
