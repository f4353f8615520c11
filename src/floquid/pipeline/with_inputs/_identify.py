"""The chain for records with measured inputs: samples → modes and the way inputs reach them → verdict."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from floquid._checks import input_error
from floquid.core import PeriodicModel, Provenance, Record
from floquid.errors import IdentificationError
from floquid.findings import Finding, failure, note, warning
from floquid.inputs import (
    Limits,
    Linearisation,
    Samples,
    Scores,
    Uncertainty,
    fitted_freely,
    limit_of,
    linearise,
    model_of,
    nearly_one,
    period_step,
    samples_of,
    searched,
    slopes_of,
    solve,
    state_slopes,
)
from floquid.pipeline._settings import Settings
from floquid.pipeline.preparation import blas_threads, clocked, own_names, refuse_driven, settings_of
from floquid.pipeline.with_inputs._again import KEPT
from floquid.pipeline.with_inputs._analysis import HELD_OUT, DrivenAnalysis
from floquid.pipeline.with_inputs._doubts import doubts
from floquid.pipeline.with_inputs._prepare import OF, Parted, parted, refuse_others

HIGHEST = 24
"""Harmonics of inputs and outputs at most."""

MOST_UNTOLD = 3.0
"""What deviations of the fit to a part may make of the prediction, over the noise: more is no model to predict with."""

SIGNIFICANT = 5.0
"""Deviations from which on the period is another one than that given."""

COLOURED, WRONG = 0.1, 0.3
"""The sum of squared correlations from which on what is left is no white noise, and the model is not what left it."""

VAGUE = 0.5
"""The deviation of the decay of a real multiplier over it, from which on it is not determined,"""

ROUGHLY = 0.1
"""where that is more than this over a period [nepers]."""

REACHED = 1e-6
"""The probability at which noise may pass for a way from the inputs to a mode."""


def identify_driven(
    records: Record | Sequence[Record],
    settings: Settings | None = None,
    *,
    report: Callable[[str], None] = lambda _: None,
    **options: object,
) -> DrivenAnalysis:
    r"""Identify a linear time-periodic system from its response to measured inputs.

    .. math:: \dot z_r = \lambda_r z_r + \sum_{i,l} b_{r,i,l}\, e^{i l \omega t} u_i, \qquad
              y = \sum_r \sum_m c_{r,m}\, e^{i m \omega t} z_r + \sum_{i,n} D_{i,n}\, e^{i n \omega t} u_i + e

    with e white in each output. Candidates for λ come from a subspace method on modulated inputs, those together that
    come up most, then others from what is left; harmonics, modes and real multipliers are decided by tests; all is
    finished by maximum likelihood. The state at the begin of each record is free: a decay after a measured blow is the
    same fit.

    Parameters
    ----------
    records
        One record, or several of the same channels, inputs among them.
    settings
        The options, with `inputs` and `hold`; or give them by name.
    report
        Is told what is being done, a phrase a stage.
    **options
        Fields of `Settings`: `period` or a clock, `channels`, `inputs`, `hold`, `harmonics`, `forced`, `validate` and
        the probabilities of false alarm. Others are refused.

    Returns
    -------
    DrivenAnalysis
        The model with its inputs, deviations of all of it, and the verdict.

    Raises
    ------
    InputError
        The records, the inputs or the clock are not possible.
    IdentificationError
        The inputs say nothing of the system, or no mode rises above the noise.
    """
    chosen = settings_of(settings, options, OF)
    if not chosen.inputs:
        remedy = 'Name the channels that drive the system: `inputs=["force"]`. Of free responses use `identify`.'
        raise input_error("inputs", OF, "name a channel", "is empty", remedy)
    refuse_others(chosen, OF)
    with own_names(OF):
        used = clocked(records, chosen, OF)
        with blas_threads(used):
            return _identified(used, chosen, report)


def _identified(records: Sequence[Record], settings: Settings, report: Callable[[str], None]) -> DrivenAnalysis:
    """The chain from the records with their clocks on."""
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
        highest=max(min(HIGHEST, int(0.5 * phases) - 1), 0) if settings.harmonics is None else settings.harmonics,
    )
    report("searching for modes")
    found = searched(samples, limits, report)
    free = None
    if settings.harmonics is None and _at_limit(found, limits) and limits.highest < HIGHEST:
        report("fitting matrices at each phase")
        free = _if_better(fitted_freely(samples), found)
        found = free or found
    if not found.modes:
        raise IdentificationError(
            "Identification ended without a result: no mode that the inputs reach, or that rings at the begin, rises "
            "above the noise. Drive it harder or for longer, or check which channels are `inputs`."
        )
    report("estimating deviations")
    fit = Uncertainty(samples, found)
    provenance = Provenance.merge(tuple(record.provenance for record in records))
    model = model_of(fit, own.outputs, own.inputs, provenance)
    held_out = np.full(len(own.outputs), np.nan)
    if settings.validate:
        report("predicting samples left out")
        held_out = _held_out(own, found)
    scores = Scores(samples, found, rough=False)
    return DrivenAnalysis(
        settings=settings,
        records=own.records,
        model=model,
        fit=fit,
        noise=found.noise[:, None],
        held_out=held_out,
        findings=(
            *done_beside(own),
            *([note("inputs_free", phases=round(phases))] if free else [needed(model, limits, _seen(scores))]),
            *_unreached(fit),
            *doubts(fit, scores),
            *_against(found, held_out),
            *_ended(samples, found, model, limits, every=free is not None),
            *(() if own.shafts else _period(scores)),
        ),
    )


def _at_limit(found: Linearisation, limits: Limits) -> bool:
    """True where a search found no mode, or one with as many harmonics as are looked for."""
    widest = max((max(abs(mode.turns).max(), abs(mode.reach).max()) for mode in found.modes), default=np.inf)
    return bool(widest >= limits.highest)


def _if_better(one: Linearisation | None, other: Linearisation) -> Linearisation | None:
    """A fit if the criterion of Schwarz (1978) prefers it to another; None if not."""
    if one is None:
        return None
    return one if one.criterion > other.criterion else None


def _held_out(own: Parted, found: Linearisation) -> NDArray[np.float64]:
    """The rms error over what is expected, on the last quarter of each record, by a fit to the rest (outputs,).

    Expected are the noise, and what the deviations of that fit make of the prediction.
    """
    whole = own.samples
    kept = [slice(one.start, one.start + int(KEPT * (one.stop - one.start))) for one in whole.records]
    first = samples_of(
        [whole.values[:, one] for one in kept],
        [whole.inputs[:, one] for one in kept],
        [whole.times[one] for one in kept],
        step=whole.step,
        fundamental=whole.fundamental,
        hold=whole.hold,
        turns=own.turns,
    )
    part = Uncertainty(first, solve(first, found.modes, found.direct))
    whole_at = linearise(whole, part.at.modes, part.at.direct)
    states = state_slopes(whole, whole_at)
    beyond = np.ones(whole.n_samples, bool)
    for one in kept:
        beyond[one] = False
    columns, errors = whole_at.columns[:, beyond], []
    for channel, noise in enumerate(part.at.noise):
        left = whole.values[channel, beyond] - part.at.coefficients[:, channel] @ columns
        at = replace(whole_at, coefficients=part.at.coefficients)
        by_parameters = slopes_of(whole, at, channel, states)[:, beyond]
        # What the part does not tell of the model is no error of it.
        expected = noise**2 + np.minimum(part.variance(channel, by_parameters.T, columns.T), MOST_UNTOLD * noise**2)
        errors.append(float(np.sqrt(np.mean(left**2 / expected))))
    return np.array(errors)


def done_beside(own: Parted) -> tuple[Finding, ...]:
    """Findings on what was fitted beside the modes."""
    names = [channel.name for channel in own.inputs]
    done = [note("inputs", channels=names, hold=own.samples.hold)] if names else []
    used = {own_channel.name for own_channel in (*own.outputs, *own.inputs)}
    forces = {c.name for record in own.records for c in record.channels if c.quantity == "force"}
    done += [note("no_response", channel=name, quantity="force") for name in sorted(forces - used)]
    steady = [note("steady_beside_inputs", harmonics=own.turns)] if own.turns else []
    return (*done, *steady, *(finding for shaft in own.shafts for finding in shaft.findings))


def _seen(scores: Scores) -> list[tuple[float, int]]:
    """Squared deviations of the shape of each mode from zero, and how many numbers it has."""
    columns, channels = scores.now.slices(), len(scores.left)
    sizes = [channels * (own.stop - own.start) for own, _ in columns]
    return list(zip(scores.of_modes().tolist(), sizes, strict=True))


def needed(model: PeriodicModel, limits: Limits, seen: Sequence[tuple[float, int]]) -> Finding:
    """Finding on the mode that would be missed least, of (squared deviations of a shape from zero, numbers in it) each.

    The modes are those of the model in their order, of each conjugate pair one.
    """
    rises = [squares / limit_of(degrees, limits.mode_alarm) for squares, degrees in seen]
    least = int(np.argmin(rises))
    hertz = abs(model.exponents[model.upper_modes[least]]) / (2.0 * np.pi)
    return note("excited_order", modes=len(rises), frequency=hertz, rise=rises[least])


def _unreached(fit: Uncertainty) -> tuple[Finding, ...]:
    """Findings on modes that ring from the begin alone: no input reaches them as far as the record shows."""
    from scipy.special import chdtri

    found = []
    for number, mode in enumerate(fit.at.modes):
        place, free = fit.places[number]
        size, starts = mode.gains.size, len(mode.initial)
        own = np.concatenate([mode.gains.real.ravel(), mode.gains.imag.ravel()])
        # The imaginary part of a real multiplier's turn zero is no parameter.
        there = np.concatenate([np.ones(size, bool), np.tile(mode.reach > 0.0, len(mode.gains)) | (not mode.real)])
        later = 1 + size if mode.real else 2 + size + starts
        rows = np.concatenate([np.arange(1, 1 + size), np.arange(later, later + size)])[there]
        flat = own[there]
        if not free[rows].all():
            continue  # its scale is that of an input: that one reaches it
        index = place.start + np.cumsum(free)[rows] - 1
        spread = fit.parameters[np.ix_(index, index)]
        if float(flat @ np.linalg.pinv(spread, hermitian=True) @ flat) < chdtri(len(index), REACHED):
            found.append(warning("unreached", frequency=abs(mode.exponent) / (2.0 * np.pi)))
    return tuple(found)


def _period(scores: Scores) -> tuple[Finding, ...]:
    """Finding on a period that is not that of the response, to first order."""
    step, std = period_step(scores)
    if abs(step) <= SIGNIFICANT * std:
        return ()
    given = 2.0 * np.pi / scores.samples.fundamental
    return (failure("inputs_period", own=given * (1.0 + step), std=given * std, given=given),)


def _ended(
    samples: Samples, found: Linearisation, model: PeriodicModel, limits: Limits, *, every: bool
) -> tuple[Finding, ...]:
    """Findings on limits at which the search ended, and on modes that the record does not determine.

    Of modes with `every` harmonic there is none is missing.
    """
    ended = [warning("inputs_modes", most=limits.modes)] if len(found.modes) >= limits.modes else []
    if undetermined(model):
        ended.append(failure("inputs_undetermined"))
    if _at_limit(found, limits) and not every:
        if nearly_one(samples, found):  # harmonics beyond the limit are made up for by a copy of the mode
            ended.append(failure("inputs_copies", most=limits.highest))
        elif limits.highest == HIGHEST:
            ended.append(warning("inputs_harmonics", most=HIGHEST))
    return tuple(ended)


def undetermined(model: PeriodicModel) -> bool:
    """True where a mode's decay is not known within a period, or that of a real multiplier hardly at all.

    Real multipliers that make up for one another, or for a pair, are of that kind; one of slow decay is not.
    """
    assert model.exponent_std is not None
    spread = model.exponent_std.real
    vague = (spread > VAGUE * np.abs(model.exponents.real)) & (model.period * spread > ROUGHLY)
    return bool((model.period * spread > 1.0).any() or (model.real & vague).any())


def _against(found: Linearisation, held_out: NDArray[np.float64]) -> tuple[Finding, ...]:
    """Findings against the model: samples left out that it does not predict, and colour in what it leaves."""
    against = []
    if (held_out >= HELD_OUT).any():
        against.append(warning("inputs_held_out", error=float(np.nanmax(held_out))))
    if found.colour > COLOURED:
        told = failure if found.colour > WRONG else warning
        against.append(told("inputs_colour", squares=found.colour))
    return tuple(against)
