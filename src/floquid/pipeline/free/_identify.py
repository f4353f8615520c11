"""The chain for free responses: lifted samples → poles → periodic model → verdict."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from floquid.core import ConstantPeriod, PeriodicModel, Record
from floquid.errors import IdentificationError
from floquid.findings import Finding, failure, warning
from floquid.fit import chi2_limit
from floquid.lifting import Lifted, floor_of
from floquid.lti import Outcome
from floquid.order import judge
from floquid.periodic import (
    Fit,
    ModeParameters,
    OrderError,
    assemble,
    distinct_multipliers,
    fit,
    fit_shapes,
    groups,
    held_shapes,
    steady_period,
    unexplained,
)
from floquid.pipeline._analysis import Analysis
from floquid.pipeline.free._complete import completed, free_residues, samples_of, validated
from floquid.pipeline.free._doubts import of_sums, order_too_low, wrong_period_fitted, wrong_period_lifted
from floquid.pipeline.free._find_poles import UnsettledError
from floquid.pipeline.free._start import Lifting, Start, cut, start_of
from floquid.pipeline.free._starts import (
    OPENINGS,
    criterion,
    determined,
    explains,
    fitted_ringing,
    later_samples,
    poles,
)
from floquid.preparation import Prepared, Settings, clocks_of, from_sample


def identified_free(prepared: Prepared, report: Callable[[str], None]) -> Analysis:
    """Identify from free responses, with the verdict on the model if it is asked for."""
    found = _identified(prepared, report)
    found = replace(found, findings=(*of_sums(found), *found.findings))
    return validated(found, report=report) if prepared.settings.validate else found


def _identified(prepared: Prepared, report: Callable[[str], None]) -> Analysis:
    """The chain from the responses with their clocks on."""
    prepared = with_steady_period(prepared, report)
    best, left_out = _best(prepared, report), 0
    chosen, alarm = prepared.settings, prepared.settings.mode_false_alarm
    free, until, said = chosen.skip is None and chosen.all_found, time.process_time() + chosen.seconds, list[Finding]()
    # A record that is believed down to a share of its largest value is nowhere linear: no period would be the last.
    while free and best.start.floor is None and promised(best.fitted, prepared) > 0.0:
        if time.process_time() > until:
            said.append(warning("out_of_time", seconds=chosen.seconds))
            break
        report("leaving the first period out")
        shorter, alone = without_first(prepared)
        try:
            trial = _best(shorter, report)
        except IdentificationError:
            break
        if criterion(trial.fitted, alarm, alone) >= criterion(best.fitted, alarm):
            break
        prepared, best, left_out = shorter, trial, left_out + 1
    if best.wrong_period is not None and not chosen.trust_period:
        raise IdentificationError(
            f"{best.wrong_period}\n  Correct the period, the sampling rate or the time column; `estimate_period=True` "
            "finds the period from the response. If you know the period to be right, pass `trust_period=True`."
        )
    if left_out:
        said.append(warning("begins_later", periods=left_out))
    prepared = replace(prepared, findings=(*prepared.findings, *said))
    return completed(prepared, best.start, best.model, best.fitted, best.settings, best.doubts, report)


def _best(prepared: Prepared, report: Callable[[str], None]) -> Candidate:
    """The best fit from the first start that leads to a model."""
    report("cutting into periods")
    cutting = cut(prepared)
    report("estimating the noise")
    refusal: IdentificationError | None = None
    rejected: list[Candidate] = []
    for opening in OPENINGS:
        usual = opening is poles
        fits, found = _fits if usual else _brief_fits, list[Candidate]()
        try:
            for start in opening(prepared, cutting, report):
                for candidate in fits(prepared, cutting, start, report):
                    good = usual or (explains(candidate.fitted, candidate.start) and not candidate.wrong_period)
                    (found if good else rejected).append(candidate)
        except IdentificationError as error:
            refusal = error if usual else refusal
        if found:
            return found[0] if usual else min(found, key=lambda own: _as_reported(own, prepared))
    assert refusal is not None
    rejected = [own for own in rejected if own.fitted.model.exponent_std is not None]
    if not rejected or not isinstance(refusal, UnsettledError):
        raise refusal
    best = min(rejected, key=lambda own: _as_reported(own, prepared))
    return replace(best, missing=(*best.missing, failure("noise_unsettled")))


def _as_reported(own: Candidate, prepared: Prepared) -> float:
    r"""Criterion of a fit by what its model leaves, once harmonics that noise explains one by one are left out.

    .. math:: J + \sum_{c,h} N_h \log \max \Big(1, \frac{\mathrm{RSS}_{c,h}}{N_h s_{c,h}^2}\Big)
    """
    fitted = own.fitted
    value = criterion(fitted, prepared.settings.mode_false_alarm)
    if fitted.whitening is not None:
        return value
    rests = unexplained(fitted.model, fitted.free, clocks_of(fitted.free, prepared.shafts))
    for hit, (rest, later) in enumerate(zip(rests, later_samples(fitted), strict=True)):
        share = np.nanmean(rest**2, axis=1) / fitted.noise[:, hit] ** 2
        number = rest.shape[1] + later
        share = share if not later else (rest.shape[1] * share + later) / number
        value += number * float(np.log(np.maximum(share, 1.0)).sum())
    return value


@dataclass(frozen=True, slots=True)
class Candidate:
    """A fit, what it started from, and what speaks against it."""

    start: Start
    model: PeriodicModel | None
    fitted: Fit
    settings: Settings
    missing: tuple[Finding, ...] = ()  # findings on modes that the order given leaves out
    wrong_period: Finding | None = None

    @property
    def doubts(self) -> tuple[Finding, ...]:
        """All that speaks against it."""
        late = self.start.modal is not None and self.start.modal.outcome is Outcome.OUT_OF_TIME
        ended = failure(Outcome.OUT_OF_TIME.value) if late else None
        return (*self.missing, *(own for own in (self.wrong_period, ended) if own is not None))


def _brief_fits(
    prepared: Prepared, cutting: Lifting, start: Start, report: Callable[[str], None]
) -> Iterator[Candidate]:
    """The fits of a start of a brief record: outer products of shape and hit, and that of the samples.

    The samples tell the order better than the few cycles of a brief decay: fits of samples come without a
    choice by cycles. That of the samples has its own harmonics in each hit: it is left out where shapes at each phase
    are fewer numbers than the narrowest that vary.
    """
    settings, model, costly = prepared.settings, None, False
    by_samples = replace(start, choice=None)
    if start.modal is not None:
        report("expanding the shapes in harmonics")
        modal, width = held_shapes(start.modal, start.lifted, false_alarm=settings.harmonic_false_alarm)
        model = assemble(modal, start.lifted, harmonics=width)
        yield Candidate(start, model, free_residues(prepared, cutting, start, model), settings)
        if not start.known and not prepared.shafts and start.lifted.n_hits >= model.order:
            with suppress(IdentificationError, np.linalg.LinAlgError):
                yield Candidate(by_samples, model, _of_shapes(prepared, start, model, report), settings)
        lifted = start.lifted
        # Three harmonics are the fewest that vary.
        costly = lifted.n_channels * (3 * lifted.n_hits - lifted.n_phases) > lifted.n_hits
    if not costly or not determined(model):
        fitted = _fitted(prepared, cutting, start, model, settings, True, report)
        wrong = wrong_period_fitted(fitted, start.lifted, prepared, report)
        yield Candidate(by_samples, model, fitted, settings, wrong_period=wrong)


def _of_shapes(prepared: Prepared, start: Start, model: PeriodicModel, report: Callable[[str], None]) -> Fit:
    """The fit of the samples with one shape for all hits, started at outer products."""
    settings = prepared.settings
    records = samples_of(prepared.records, prepared.shafts)
    return fit_shapes(
        records,
        clocks_of(records, prepared.shafts),
        model,
        start.whole,
        noise_floor=floor_of((row for record in records for row in record.values), settings.noise_floor),
        report=report,
    )


def _fits(prepared: Prepared, cutting: Lifting, start: Start, report: Callable[[str], None]) -> Iterator[Candidate]:
    """The fit of the samples from poles of lifted responses, or these with residues free at each phase."""
    settings = prepared.settings
    settings = settings if start.floor is None else replace(settings, noise_floor=start.floor)
    model, missing, wrong = None, [], None
    if start.modal is not None:
        report("expanding the shapes in harmonics")
        model = assemble(
            start.modal, start.lifted, false_alarm=settings.harmonic_false_alarm, harmonics=settings.harmonics
        )
        if settings.order is not None:
            own = order_too_low(settings.order, judge(start.lifted.responses, start.modal))
            missing = [] if own is None else [own]
        # Modes that are missing turn in what is left as a wrong period would.
        wrong = None if missing else wrong_period_lifted(model, start.lifted, prepared)
    fitted, twice = None, False
    if model is not None and start.modal is not None and start.modal.outer_products:
        twice = distinct_multipliers(model) < model.order
    constrained = model is None or (settings.constrained and model.covariance is not None)
    if constrained and (settings.trust_period or not wrong):
        # Of a period that is trusted against the response, harmonics come apart: they are no modes to be looked for.
        search = model is None or (settings.all_found and not wrong)
        if search or not twice:
            try:
                fitted = _fitted(prepared, cutting, start, model, settings, search, report)
            except OrderError:
                if model is None or model.order != settings.order:
                    raise
                # Poles that are none run away where residues are constrained.
                missing.append(warning("order_not_held"))
        if fitted is not None and fitted.constrained and not (wrong or missing):
            wrong = wrong_period_fitted(fitted, start.lifted, prepared, report)
    if fitted is None:
        assert model is not None
        fitted = free_residues(prepared, cutting, start, model)
    yield Candidate(start, model, fitted, settings, tuple(missing), wrong)


def _fitted(
    prepared: Prepared,
    cutting: Lifting,
    start: Start,
    model: PeriodicModel | None,
    settings: Settings,
    search: bool,
    report: Callable[[str], None],
) -> Fit:
    """The fit of the samples, started at the poles of the lifted responses."""
    report("constraining the residues to their harmonics")
    begin = start.begin
    if start.modal is not None and model is not None:
        begin = groups(start.modal, start.lifted) if search else ModeParameters.of(model)
    records = samples_of(prepared.records, prepared.shafts)
    floor = floor_of((row for record in records for row in record.values), settings.noise_floor)

    def fit_of(records: Sequence[Record], lifted: Lifted | None) -> Fit:
        return fit(
            records,
            clocks_of(records, prepared.shafts),
            start=begin,
            known=start.known,
            lifted=lifted,
            forced=settings.forced_harmonics,
            periods_per_revolution=settings.periods_per_revolution,
            order=settings.order,
            harmonics=settings.harmonics,
            free_period=prepared.clocks[0].fitted,
            search=search,
            noise_floor=floor,
            mode_false_alarm=settings.mode_false_alarm,
            harmonic_false_alarm=settings.harmonic_false_alarm,
            seconds=settings.seconds,
            report=report,
        )

    return fitted_ringing(start, records, fit_of) if cutting.synchronous else fit_of(records, None)


STANDS_OUT = 2.0  # the fall that the first period promises over that of the second, at least


def promised(fitted: Fit, prepared: Prepared) -> float:
    r"""Fall of the criterion where the first period of each hit has values of its own, these modes staying.

    .. math:: \sum_{c,h} N_h \log \frac{\mathrm{RSS}_{c,h}}{\mathrm{RSS}_{c,h} - \mathrm{RSS}^{(1)}_{c,h}} - \chi^2_n

    with n the number of their samples: what noise exceeds with the probability allowed for a mode is no fall, nor is
    what is below the least noise. None is promised where the second period adds half as much: such a residual decays
    on, and no period would be the last to be left out.
    """
    first, both = (_fall(fitted, prepared, periods) for periods in (1, 2))
    return min(first, first - STANDS_OUT * (both - first))


def _fall(fitted: Fit, prepared: Prepared, periods: int) -> float:
    """Fall of the criterion where the first periods of each hit have values of their own."""
    clocks, settings = clocks_of(fitted.free, prepared.shafts), prepared.settings
    floor = floor_of((row for record in fitted.free for row in record.values), settings.noise_floor)
    gain, numbers = 0.0, 0
    rests = unexplained(fitted.model, fitted.free, clocks)
    for hit, (record, left, later) in enumerate(zip(fitted.free, rests, later_samples(fitted), strict=True)):
        first = int(np.ceil(periods * fitted.model.period * record.sample_rate))
        squares, samples = np.nan_to_num(left) ** 2, np.isfinite(left).sum(axis=1)
        least = samples * (floor * np.nanmax(np.abs(record.values), axis=1)) ** 2
        least = least + later * fitted.noise[:, hit] ** 2
        whole, rest = (least + part.sum(axis=1) for part in (squares, squares[:, first:]))
        gain += float((samples + later) @ np.log(whole / rest))
        numbers += int(np.isfinite(left[:, :first]).sum())
    return gain - chi2_limit(max(numbers, 1), settings.mode_false_alarm)


def with_steady_period(prepared: Prepared, report: Callable[[str], None]) -> Prepared:
    """The records with a better first value of the period than that of coarse pulses, by the steady response.

    Cut at a period that is a little off, what repeats slips, and leaves poles that are no modes. One that pulses speak
    against is none: something else is near a line of the revolution.
    """
    settings, told = prepared.settings, prepared
    samples = max(record.n_samples for record in prepared.responses)
    if settings.estimate_period or not prepared.clocks[0].fitted:
        return prepared
    report("finding the period of the steady response")
    for _ in range(2):  # the slip that is left after the first time is less than a hundredth of it
        cutting = cut(prepared)
        trends = tuple(np.linspace(-1.0, 1.0, hit.n_cycles)[None] for hit in cutting.cycles)
        try:
            start = start_of(prepared, replace(cutting, speeds=trends), report)
        except IdentificationError:  # said again where it is the end
            return prepared
        if start.modal is None or not start.known:
            return prepared
        period = steady_period(
            prepared.responses,
            prepared.clocks,
            groups(start.modal, start.lifted),
            start.known,
            forced=settings.forced_harmonics,
            periods_per_revolution=settings.periods_per_revolution,
        )
        if abs(period / told.clocks[0].period - 1.0) * samples > 2.0:
            return told
        # Their phase is right in the middle of each record, where their origin is.
        clocks = tuple(ConstantPeriod(period=period, origin=own.origin, fitted=True) for own in prepared.responses)
        records = tuple(map(Record.with_clock, prepared.responses, clocks))
        prepared = replace(prepared, records=records, responses=records, clocks=clocks)
    return prepared


def without_first(prepared: Prepared) -> tuple[Prepared, int]:
    """The records without their first period, and the samples of a hit left out."""
    pairs = zip(prepared.clocks, prepared.responses, strict=True)
    samples = max(int(np.ceil(clock.period * record.sample_rate)) for clock, record in pairs)
    records, responses = (from_sample(own, samples) for own in (prepared.records, prepared.responses))
    return replace(prepared, records=records, responses=responses), samples
