"""Analysis of a fit: the views that are derived from it, A(t), the findings, and the verdict."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from floquid._arrays import Complexes
from floquid.checks import Decays, Evidence, findings_of, validate
from floquid.core import BRIDGED, ConstantPeriod, Cycles, Estimates, PeriodicModel, Record
from floquid.errors import FloquidError, IdentificationError
from floquid.findings import Finding, failure, note, warning
from floquid.fit import DEVIATIONS
from floquid.lifting import Lifted, lift, unlift, whitened
from floquid.lti import ModalModel, fit_residues
from floquid.order import Choice
from floquid.periodic import Fit, combinations_of, estimate_at, periodicity
from floquid.pipeline._analysis import Analysis
from floquid.pipeline._deviations import Again, Decay, model_failure, widened, widening, with_misfit, with_state
from floquid.pipeline.free._find_poles import ALL_PEAKED
from floquid.pipeline.free._start import FLOORS, Lifting, Start, filled, out_of_step
from floquid.preparation import Prepared, Settings, clocks_of, in_phase, uneven_speed, without_clock
from floquid.sync import ShaftAngle, rejoin, resample, segment


def completed(
    prepared: Prepared,
    start: Start,
    free: PeriodicModel | None,
    fitted: Fit,
    settings: Settings,
    doubts: tuple[Finding, ...],
    report: Callable[[str], None],
) -> Analysis:
    """The analysis of a fit, without a verdict."""
    fails = model_failure(fitted, settings)
    fitted, shafts = with_misfit(fitted), prepared.shafts
    whole = by_cycles(fitted, shafts)
    if not whole:
        report("resampling the free response")
    cycles, lifted = lifted_views(fitted, shafts, settings)
    model = replace(fitted.model, provenance=lifted.provenance)
    fitted = replace(fitted, model=model)
    most = max(hit.n_cycles for hit in cycles)
    held = sum(2 * len(own.numbers.get("frequencies", ())) for own in fitted.warnings if own.code == "undetermined")
    if model.order + held >= (most if whole else most - 1) and not model.one_shape:
        raise IdentificationError(
            f"The record holds {most} whole periods, too few for the {model.order + held} "
            "poles that were found in it. Record longer, or check the period."
        )
    choice, modal = start.choice, start.modal
    # A brief record's order is judged by its samples, where these were fitted.
    changed = modal is None or not whole or not _alike(model, free) or (choice is None and settings.order is None)
    if changed:
        modal = _modal(model, lifted, cycles)
    assert modal is not None
    if fails is not None:
        modal = replace(modal, covariance=None, residue_spread=None, residue_slope=None)
        choice = None if choice is None else replace(choice, model=modal)
    if changed and settings.order is None:
        choice = Choice(order=model.order, model=modal, findings=(*_peaked(choice), *fitted.findings))
    doubted = [] if choice is None or not choice.ambiguous else [choice]
    _refuse_peaks(model, choice, settings)
    tested = None
    if model.unselected is not None:
        # Resampling moves lines by more than their deviations.
        tested = periodicity(model, lifted=lifted if whole else None)
    found = Analysis(
        settings=settings,
        records=prepared.records,
        model=model,
        decay=Decay(fit=fitted, cycles=cycles, lifted=lifted, modal=modal, choice=choice, periodicity=tested),
        shafts=shafts,
        findings=(
            *prepared.findings,
            *_believed(start.floor),
            *_rings(fitted, cycles),
            *_done(fitted, why_sampled(fitted, shafts), settings.periods_per_revolution),
            *fitted.warnings,  # causes, before what comes of them
            *(own for own in (fails, *doubts, *uneven_speed(shafts)) if own is not None),
            *(warning("order_ambiguous", order=own.order, doubts=own.doubts) for own in doubted),
            *(() if changed else combinations_of(model, lifted.noise, nonlinear=start.floor is not None)),
            *findings_of(
                Decays(
                    model=model,
                    records=prepared.responses,
                    noise=fitted.noise,
                    clocks=prepared.clocks,
                    forced=fitted.forced,
                    misfit=fitted.misfit,
                )
            ),
        ),
    )
    return with_state(found, again_of(fitted, lifted, shafts), report)


def _modal(model: PeriodicModel, lifted: Lifted, cycles: Sequence[Cycles]) -> ModalModel:
    """Residues of the lifted responses at the model's multipliers; the model's own where these have too few cycles."""
    if model.order < int(lifted.responses.lengths.max()):
        return fit_residues(model.multipliers, lifted.responses)
    rates = model.exponents[:, None] + 1j * model.fundamental * model.harmonics
    passed = lifted.gain(rates).swapaxes(0, 1)[:, :, None] * model.coefficients
    times = lifted.phase_times[:, None] + model.period * np.array([hit.first_cycle for hit in cycles])
    residues = np.einsum("rchm,rmph->rcph", passed, np.exp(rates[:, :, None, None] * times))
    return ModalModel(
        multipliers=model.multipliers,
        residues=residues.reshape(model.order, -1, len(cycles)),
        dt=lifted.period,
        covariance=model.covariance,
    )


def free_residues(prepared: Prepared, cutting: Lifting, start: Start, model: PeriodicModel) -> Fit:
    """The model whose residues are free at each phase, as the fit of what it is a model of: the lifted responses."""
    records = samples_of(prepared.records, prepared.shafts)
    if not cutting.synchronous:
        records = tuple(rejoin(hit) for hit in cutting.cycles)
    pairs = zip(records, unlift(start.raw), strict=True)
    return Fit(
        model=model,
        forced=None,
        noise=start.lifted.noise,
        free=tuple(replace(record, values=rejoin(hit).values) for record, hit in pairs),
        period_std=None,
        own_period=None,
        constrained=False,
        whitening=start.lifted.whitening,
    )


def again_of(fitted: Fit, lifted: Lifted, shafts: tuple[ShaftAngle, ...]) -> Again:
    """Function that linearises a fit anew at given exponents: by its cycles if they hold all of it, else by samples."""
    data: dict[str, Any] = {"lifted": lifted}
    if not by_cycles(fitted, shafts):
        names = ("noise", "whitening", "forced")
        data = {"records": fitted.free, "clocks": clocks_of(fitted.free, shafts)}
        data |= {name: getattr(fitted, name) for name in names}
    factor = widening(fitted.misfit, fitted.free)

    def again(exponents: Complexes) -> Estimates:
        return widened(estimate_at(fitted.model, exponents, **data), factor)

    return again


def _peaked(choice: Choice | None) -> tuple[Finding, ...]:
    """Finding that a mode may be the peak of the noise, where the choice of the order has it."""
    return () if choice is None else tuple(own for own in choice.findings if own.code == "under_a_peak")


def _refuse_peaks(model: PeriodicModel, choice: Choice | None, settings: Settings) -> None:
    """Refuse modes where none is known to decay and the noise has a peak."""
    std = model.exponent_std
    if choice is None or std is None or settings.identifier is not None or not _peaked(choice):
        return
    if (np.abs(model.exponents.real) < DEVIATIONS * std.real).all():
        raise IdentificationError(ALL_PEAKED)


def _alike(model: PeriodicModel, other: PeriodicModel | None) -> bool:
    """True where two models have the same poles except for the accuracy of one of them."""
    if other is None or model.order != other.order:
        return False
    gaps = np.abs(model.multipliers[:, None] - other.multipliers[None, :])
    reach = 0.5 * np.abs(np.log(np.abs(other.multipliers))) + 1e-3
    return bool((gaps.min(axis=0, initial=np.inf) < reach).all())


def samples_of(records: Sequence[Record], shafts: tuple[ShaftAngle, ...]) -> tuple[Record, ...]:
    """The responses that are fitted, as they were measured.

    Where they are whole samples a period they are of whole periods; their clocks then have the phase of the cycles. Of
    the `records` used, with the angle of the shaft in each, `shafts`, none where periods are constant.
    """
    responses = tuple(without_clock(record) for record in records)
    clocks = clocks_of(responses, shafts)
    if out_of_step(responses, clocks):
        return responses
    found = []
    for record, clock, hit in zip(responses, clocks, segment(responses), strict=True):
        before = round(((hit.first_phase - clock.phase(record.start)) % 1.0) * hit.n_phases) % hit.n_phases
        start = record.start + before / record.sample_rate
        own = ConstantPeriod(period=clock.period, origin=start - hit.first_phase * clock.period)
        found.append(replace(rejoin(hit), start=start, clock=own))
    return tuple(found)


def lifted_views(fitted: Fit, shafts: tuple[ShaftAngle, ...], settings: Settings) -> tuple[tuple[Cycles, ...], Lifted]:
    """The free response of a fit cut into periods and lifted: its samples where they are whole a period, or resampled.

    The cycles are one a hit. Lifted they are through the filter, and with the noise, of the fit; without them where it
    is resampled, for the eye alone. Of the fit `fitted` by these `settings`, with the angle of the shaft in each
    record, `shafts`, none where periods are constant.
    """
    if why_sampled(fitted, shafts):
        period = fitted.model.period
        pairs = zip(clocks_of(fitted.free, shafts), fitted.free, strict=True)
        steady = [ConstantPeriod(period=period, origin=clock.phase_zero(record.start)) for clock, record in pairs]
        cycles = resample(filled(fitted.free, [BRIDGED * period] * len(steady)), steady)
        return cycles, lift(cycles, floor=settings.noise_floor)
    cut = zip(segment(fitted.free), fitted.free, strict=True)
    cycles = tuple(replace(hit, provenance=record.provenance) for hit, record in cut)
    lifted, taps = lift(cycles, floor=settings.noise_floor, noise=fitted.noise), fitted.whitening
    if taps is not None and taps.shape[1] <= lifted.n_phases:
        lifted = whitened(lifted, taps).with_noise(fitted.noise)
    return cycles, lifted


def why_sampled(fitted: Fit, shafts: tuple[ShaftAngle, ...]) -> str:
    """The code for why samples were fitted at their own times; empty where their cycles are cut out of them."""
    return out_of_step(fitted.free, clocks_of(fitted.free, shafts)) if fitted.constrained else ""


def by_cycles(fitted: Fit, shafts: tuple[ShaftAngle, ...]) -> bool:
    """True where the cycles hold all that was fitted: they are its samples, with no forced response beside them."""
    return fitted.forced is None and not why_sampled(fitted, shafts)


def _believed(floor: float | None) -> tuple[Finding, ...]:
    """The finding on a floor below which a record is not believed; a warning where modes that show may lie below."""
    if floor is None:
        return ()
    return ((warning if floor == max(FLOORS) else note)("believed_down_to", floor=floor),)


def _rings(fitted: Fit, cycles: Sequence[Cycles]) -> list[Finding]:
    """Finding that the modes of the longest hit are over before its end."""
    if fitted.later is None:
        return []
    last = int(np.argmax(fitted.later))
    return [note("rings", cycles=cycles[last].n_cycles, of=cycles[last].n_cycles + int(fitted.later[last]))]


def _done(found: Fit, why: str, given: float) -> list[Finding]:
    """Findings on the way the samples were fitted, and on the forced response beside the revolution given."""
    forced, done = found.forced, [note("as_sampled", why=why)] if why else []
    if forced is None:
        return done
    if len(forced.harmonics):
        largest = (forced.amplitudes.max(axis=1) / found.noise[:, :1]).max(axis=0)
        done.append(note("forced", orders=forced.harmonics, largest=largest, follows=forced.speed_dependent))
        if given == 1.0 and forced.revolution > 1.5 * found.model.period:
            done.append(note("orbit_of_two_periods"))
    else:
        done.append(note("no_forced"))
    parts = {"offset": forced.offset, "drift": forced.drift}
    return done + [note(code) for code, values in parts.items() if values.any()]


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
            in_phase=in_phase(analysis.findings),
            report=report,
        )
    except (FloquidError, np.linalg.LinAlgError) as error:
        why = failure("not_checked", error=str(error).rstrip("."))
        verdict = Evidence(findings=[why]).verdict(analysis.noise.shape)
    return replace(analysis, validation=replace(verdict, passed=verdict.passed and not analysis.failed))
