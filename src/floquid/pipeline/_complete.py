"""What `identify` gives: the fit with the views that are derived from it, A(t), and what a reader must be told."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from floquid.core import ConstantPeriod, Cycles, Estimates, PeriodicModel, Record
from floquid.errors import IdentificationError
from floquid.lifting import Lifted, lift, whitened
from floquid.lti import fit_residues
from floquid.order import Choice
from floquid.periodic import Fit, combinations_of, estimate_at, periodicity
from floquid.pipeline._analysis import Analysis
from floquid.pipeline._colour import ALL_PEAKED, PEAKED
from floquid.pipeline._deviations import failure, poles_alone, widened, widening, with_misfit
from floquid.pipeline._doubts import STILL, ambiguity, below_modes, misfit, warnings, wrong_angles
from floquid.pipeline._prepare import Prepared, unsteady
from floquid.pipeline._settings import Settings
from floquid.pipeline._start import BRIDGED, Lifting, Start, filled, steady_clock
from floquid.pipeline._state import state_of
from floquid.sync import ShaftAngle, rejoin, resample, segment


def completed(
    prepared: Prepared,
    cutting: Lifting,
    start: Start,
    free: PeriodicModel | None,
    fitted: Fit | None,
    settings: Settings,
    doubts: tuple[str, str],
    report: Callable[[str], None],
) -> Analysis:
    """The analysis of a fit; of the model with free residues where there is none.

    Parameters
    ----------
    prepared
        The responses and their clocks.
    cutting, start
        The lifted responses, and their poles.
    free
        The model whose residues are free at each phase.
    fitted
        The fit of the samples; None leaves that model.
    settings
        The options as used.
    doubts
        What speaks against the order given, and against the period.
    report
        Is told of each stage.

    Returns
    -------
    Analysis
        Without a verdict.
    """
    missing, doubt = doubts
    fails = "" if fitted is None else failure(fitted, settings)
    if fails and settings.states and settings.structure:
        raise IdentificationError(f"{fails}\n  A state matrix with a structure cannot be fitted to it.")
    fitted = None if fitted is None else with_misfit(fitted)
    model = free if fitted is None else fitted.model
    assert model is not None
    said = prepared.findings + (() if start.floor is None else (below_modes(start.floor),))
    unlike = fitted is not None and (not cutting.synchronous or fitted.forced is not None)
    measured = fitted if unlike else None
    cycles, lifted, records = cutting.cycles, start.lifted, prepared.records
    if fitted is not None and not unlike:
        # Whatever follows is weighted by the noise that the fit of the samples leaves, as that fit is.
        lifted = start.whole.with_noise(fitted.noise)
        model = replace(model, provenance=lifted.provenance)
    elif fitted is not None:
        report("resampling the free response")
        cycles, lifted = _lifted_again(prepared, cutting, fitted, settings)
        records = tuple(rejoin(hit) for hit in cycles)
        model = replace(model, provenance=lifted.provenance)
        if model.order >= max(hit.n_cycles for hit in cycles) - 1:
            raise IdentificationError(
                f"The record holds {max(hit.n_cycles for hit in cycles)} whole periods, too few for the {model.order} "
                "poles that were found in it. Record longer, or check the period."
            )
    elif fitted is not None:
        lifted = lifted.with_noise(fitted.noise)
    choice, modal = start.choice, start.modal
    changed = modal is None or (fitted is not None and (unlike or not _alike(model, free)))
    if changed:
        modal = fit_residues(model.multipliers, lifted.responses)
    assert modal is not None
    if fails:
        modal = poles_alone(modal)
        choice = None if choice is None else replace(choice, model=modal)
    if fitted is not None and changed and settings.order is None:
        peaked = tuple(doubt for doubt in (() if choice is None else choice.doubts) if doubt == PEAKED)
        choice = Choice(order=model.order, model=modal, reasons=fitted.reasons, doubts=(*peaked, *fitted.doubts))

    _refuse_peaks(model, choice, settings)

    def again(exponents: NDArray[np.complex128]) -> Estimates:
        factor = 1.0 if fitted is None else widening(fitted.misfit, fitted.free)
        if measured is None:
            return widened(estimate_at(model, exponents, lifted=lifted), factor)
        return widened(by_samples(replace(measured, model=model), prepared.clocks, exponents), factor)

    state, refinement = state_of(model, settings, again, report)
    shafts = prepared.shafts
    uneven = tuple(unsteady(shaft) for shaft in shafts if not shaft.steady)
    blurred = wrong_angles(fitted, shafts, prepared.responses) if shafts and fitted is not None else ""
    bent = "" if fitted is None else misfit(fitted)
    tested = None
    if model.unselected is not None:
        # Resampling moves lines by more than their deviations.
        tested = periodicity(model) if unlike else periodicity(model, lifted=lifted)
    return Analysis(
        settings=settings,
        records=records,
        cycles=cycles,
        lifted=lifted,
        modal=modal,
        model=model,
        state=state,
        refinement=refinement,
        choice=choice,
        fit=measured,
        measured=whole_periods(prepared, cutting) if unlike else (),
        shafts=shafts,
        held=fitted is not None,
        misfit=None if fitted is None else fitted.misfit,
        periodicity=tested,
        synchronisation=(*said, *(() if measured is None else _said_of(measured, _out_of_step(prepared, cutting)))),
        warnings=tuple(" ".join(word.split()) for word in (fails, missing, doubt, bent, *uneven, blurred) if word)
        + ambiguity(choice)
        + (() if changed else combinations_of(model, lifted.noise, nonlinear=start.floor is not None))
        + warnings(model),
    )


def by_samples(
    found: Fit, clocks: Sequence[ConstantPeriod | ShaftAngle], exponents: NDArray[np.complex128]
) -> Estimates:
    """The estimates of a fit, its samples linearised anew at given exponents."""
    return estimate_at(
        found.model,
        exponents,
        records=found.free,
        clocks=clocks,
        noise=found.noise,
        whitening=found.whitening,
        forced=found.forced,
    )


def _refuse_peaks(model: PeriodicModel, choice: Choice | None, settings: Settings) -> None:
    """Refuse modes of which none is known to decay, where the noise has a peak.

    Raises
    ------
    IdentificationError
        There is no other mode.
    """
    std = model.exponent_std
    if choice is None or std is None or settings.identifier is not None or PEAKED not in choice.doubts:
        return
    if (np.abs(model.exponents.real) < STILL * std.real).all():
        raise IdentificationError(ALL_PEAKED)


def _alike(model: PeriodicModel, other: PeriodicModel | None) -> bool:
    """Whether two models have the same poles but for the accuracy of one of them."""
    if other is None or model.order != other.order:
        return False
    gaps = np.abs(model.multipliers[:, None] - other.multipliers[None, :])
    reach = 0.5 * np.abs(np.log(np.abs(other.multipliers))) + 1e-3
    return bool((gaps.min(axis=0, initial=np.inf) < reach).all())


def whole_periods(prepared: Prepared, cutting: Lifting) -> tuple[Record, ...]:
    """The samples that are fitted, as they were measured: those of whole periods where records are cut into them."""
    if not cutting.synchronous:
        return prepared.records
    found = []
    for record, clock, hit in zip(prepared.records, prepared.clocks, cutting.cycles, strict=True):
        assert isinstance(clock, ConstantPeriod)
        before = round(((hit.first_phase - clock.phase(record.start)) % 1.0) * hit.n_phases) % hit.n_phases
        samples = slice(before, before + hit.n_cycles * hit.n_phases)
        found.append(
            replace(record, values=record.values[:, samples], start=record.start + before / record.sample_rate)
        )
    return tuple(found)


def _lifted_again(
    prepared: Prepared, cutting: Lifting, fitted: Fit, settings: Settings
) -> tuple[tuple[Cycles, ...], Lifted]:
    """The free response lifted, resampled to whole samples a period if it has none: for the eye, not for the fit."""
    if cutting.synchronous:
        cycles = segment(fitted.free)
        lifted, taps = lift(cycles, floor=settings.noise_floor), fitted.whitening
        if taps is not None and taps.shape[1] <= lifted.n_phases:
            lifted = whitened(lifted, taps)
        return cycles, lifted.with_noise(fitted.noise)
    period = fitted.model.period
    pairs = zip(_clocks(prepared, fitted), fitted.free, strict=True)
    steady = [steady_clock(clock, record, period) for clock, record in pairs]
    bridged = filled(fitted.free, [BRIDGED * period] * len(steady))
    cycles = resample(bridged, steady)
    return cycles, lift(cycles, floor=settings.noise_floor)


def _clocks(prepared: Prepared, fitted: Fit) -> tuple:
    """What ties each free response to the phase."""
    own = tuple(record.clock for record in fitted.free)
    return prepared.clocks if prepared.shafts or any(clock is None for clock in own) else own


def _out_of_step(prepared: Prepared, cutting: Lifting) -> str:
    """Why records are not whole samples a period as they are; empty where they are."""
    if cutting.synchronous:
        return ""
    if prepared.shafts:
        return "a shaft angle that is measured"
    if prepared.settings.estimate_period:
        return "a period that is fitted too"
    if any(np.isnan(record.values).any() for record in prepared.responses):
        return "missing samples"
    return "a period that is no whole number of samples"


def _said_of(found: Fit, why: str) -> tuple[str, ...]:
    """Why the samples were fitted at their own times, if they were, and the forced response."""
    forced = found.forced
    said = [f"Fitted as sampled: {why}."] if why else []
    if forced is None:
        return tuple(said)
    if len(forced.harmonics):
        largest = forced.amplitudes.max(axis=1) / found.noise[:, :1]
        parts = [
            f"{j} a revolution (up to {largest[:, k].max():.3g} times the noise)"
            for k, j in enumerate(forced.harmonics)
        ]
        follows = ", let follow the speed" if forced.speed_dependent else ""
        said.append(f"A forced response was fitted beside the modes{follows}: {', '.join(parts)}.")
    else:
        said.append("No harmonic of the revolution rises above the noise beside the modes.")
    if forced.offset.any():
        said.append("An offset of the channels was fitted beside the modes.")
    if forced.drift.any():
        said.append("A drift of the channels, linear in time, was fitted beside the modes.")
    return tuple(said)
