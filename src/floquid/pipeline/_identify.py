"""The whole chain: records → poles → periodic model → state matrix, with every intermediate kept."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from floquid._checks import input_error
from floquid.core import Cycles, Estimates, Record
from floquid.errors import IdentificationError
from floquid.lifting import lift
from floquid.lti import fit_residues
from floquid.order import Choice, judge
from floquid.periodic import assemble, combinations_of, estimate_at, finish, periodicity
from floquid.pipeline._analysis import Analysis
from floquid.pipeline._doubts import ambiguity, below_modes, driven, misfit, quiet, too_low, warnings, wrong_period
from floquid.pipeline._find_poles import UnsettledError, find_poles
from floquid.pipeline._independent import COPIED, sum_of_others
from floquid.pipeline._measured import NOT_WHOLE, measured, why_measured
from floquid.pipeline._prepare import Prepared, blas_threads, prepare, settings_of
from floquid.pipeline._refuse import NO_NEWS, refuse_few
from floquid.pipeline._rounded import rounded
from floquid.pipeline._settings import Settings
from floquid.pipeline._state import state_of
from floquid.pipeline._validated import validated
from floquid.sync import segment

FLOORS = (1e-4, 1e-3)
"""Shares of a channel's largest value down to which a record that has hardly any noise is believed, one after another,
where what modes leave is no noise."""


def identify(
    records: Record | Sequence[Record],
    settings: Settings | None = None,
    *,
    report: Callable[[str], None] = lambda _: None,
    **options: object,
) -> Analysis:
    """Identify a linear time-periodic system from its free response.

    Cut into periods, lift (eqs. 7-10), find the poles by maximum likelihood with the order tested, take off the delay,
    expand in harmonics (eqs. 4-12), and, when `states` are named, rebuild A(t) (eqs. 13-21 of Allen 2009, as
    corrected).

    Parameters
    ----------
    records
        One record, or one a hit on the same system.
    settings
        The options; or give them by name.
    report
        Is told what is being done, a phrase a stage.
    **options
        Fields of `Settings`.

    Returns
    -------
    Analysis
        The result and every intermediate.

    Raises
    ------
    InputError
        A record or an option is not possible.
    IdentificationError
        No mode rises above the noise, the record is too short, or the result would look right and be wrong.
    """
    chosen = settings_of(settings, options, "identify")
    if chosen.estimate_period:
        _refuse_identifier(chosen)  # before the search for the period, which takes long
    prepared = prepare(records, chosen, report=report)
    faults = prepared.faults
    with blas_threads(prepared.records):
        try:
            found = _identified(prepared, report)
        except IdentificationError as error:
            raise IdentificationError("\n  ".join([str(error), *faults])) from None
        found = replace(found, warnings=(*faults, *_of_sums(found), *found.warnings))
        return validated(found, report=report) if chosen.validate else found


def _of_sums(found: Analysis) -> tuple[str, ...]:
    """What is said of a channel that shares its noise with others; refused if it has next to none of its own.

    Too low an order leaves modes in what is taken for noise, which are alike in channels that are independent: where
    the order was given, nothing is refused. Noise that the structure itself makes is shared, too.
    """
    words, beside = sum_of_others(found)
    if not words:
        return ()
    if found.settings.order is None and beside < COPIED:
        must, remedy = "be independent measurements", f"Leave it out with `channels` (`--channels`): {NO_NEWS}"
        raise input_error("records", "identify", must, words, remedy)
    return (f"{words[0].upper()}{words[1:]}: deviations are too small. Leave it out.",)


def _identified(prepared: Prepared, report: Callable[[str], None]) -> Analysis:
    """The chain from records with their clock on."""
    used, chosen, said = prepared.records, prepared.settings, prepared.findings
    why = why_measured(used, chosen)
    if why:
        _refuse_identifier(chosen)
        if why == NOT_WHOLE and not chosen.trust_period and (words := rounded(used, chosen, report)):
            raise IdentificationError(words)
        return measured(replace(prepared, findings=(*said, f"Fitted as sampled, not lifted: {why}.")), report)
    report("cutting into periods")
    cycles = segment(used)
    _refuse_impossible(chosen, cycles)
    report("estimating the noise")
    lifted = lift(cycles, floor=chosen.noise_floor)
    found_by_default = chosen.identifier is None and chosen.order is None and chosen.constrained
    believed = False
    floors = [chosen.noise_floor, *(floor for floor in FLOORS if found_by_default and quiet(lifted))]
    while True:
        try:
            lifted, modal, choice = find_poles(lifted, chosen, report)
            break
        except UnsettledError:
            if len(floors) == 1:
                raise
            floors, believed = floors[1:], True
            chosen = replace(chosen, noise_floor=floors[0])
            lifted = lift(cycles, floor=floors[0])
    if believed:
        said += (below_modes(floors[0]),)
    if chosen.forced == "auto" and found_by_default and driven(modal):
        why = "a component that neither grows nor decays, which is a forced response"
        said += (f"Fitted as sampled, not lifted: {why}.",)
        return measured(replace(prepared, settings=chosen, findings=said), report)
    report("expanding the shapes in harmonics")
    model = assemble(modal, lifted, false_alarm=chosen.harmonic_false_alarm, harmonics=chosen.harmonics)
    missing = "" if chosen.order is None else too_low(chosen.order, judge(lifted.responses, modal))
    # Modes that are missing turn in what is left as a wrong period would.
    doubt = "" if missing else wrong_period(model, lifted)
    if doubt and not chosen.trust_period:
        raise IdentificationError(
            f"{doubt}\n  Correct the period; if it is no whole number of samples, resample the record. If you know the "
            "period to be right, pass `trust_period=True` (`--trust-period`)."
        )
    bent, ended = "", None
    if chosen.constrained and model.covariance is not None:
        report("holding the residues to their harmonics")
        ended = finish(
            model,
            lifted,
            false_alarm=chosen.harmonic_false_alarm,
            mode_false_alarm=chosen.mode_false_alarm,
            choose=chosen.harmonics is None,
            search=chosen.order is None and chosen.identifier is None,
            report=report,
        )
        model, bent = ended.model, misfit(ended)
        if ended.reasons is not None:
            modal = fit_residues(model.multipliers, lifted.responses)
            choice = Choice(order=model.order, model=modal, reasons=ended.reasons, doubts=ended.doubts)

    def again(exponents: NDArray[np.complex128]) -> Estimates:
        return estimate_at(model, exponents, lifted=lifted)

    state, refinement = state_of(model, chosen, again, report)
    return Analysis(
        settings=chosen,
        records=used,
        cycles=cycles,
        lifted=lifted,
        modal=modal,
        model=model,
        state=state,
        refinement=refinement,
        choice=choice,
        held=ended is not None and ended.held,
        periodicity=None if model.unselected is None else periodicity(model, lifted=lifted),
        synchronisation=said,
        warnings=tuple(word for word in (missing, doubt, bent) if word)
        + ambiguity(choice)
        + (combinations_of(model, lifted.noise, nonlinear=believed) if ended is None or ended.reasons is None else ())
        + warnings(model),
    )


def _refuse_identifier(settings: Settings) -> None:
    """Refuse an identifier of lifted responses for records that are fitted as they were sampled."""
    if settings.identifier is not None:
        must, got = "be None for records that are fitted as they were sampled", f"is {settings.identifier!r:.60}"
        remedy = "Leave it out: modes are found in the spectrum of what is left, and fitted by maximum likelihood."
        raise input_error("identifier", "identify", must, got, remedy)


def _refuse_impossible(settings: Settings, cycles: Sequence[Cycles]) -> None:
    """Refuse what cannot end well before any long work."""
    of, periods, phases = "identify", max(c.n_cycles for c in cycles), cycles[0].n_phases
    refuse_few(min(c.n_cycles for c in cycles))
    if getattr(settings.identifier, "band", None) is not None:
        must = "look at the whole band, since what is left out would count as noise"
        got = f"has band={settings.identifier.band}"  # pyright: ignore[reportOptionalMemberAccess, reportAttributeAccessIssue]
        raise input_error("identifier", of, must, got, "Use the identifier's own `extract` on lifted responses.")
    if settings.order is not None and settings.order >= periods:
        got = f"is {settings.order}"
        raise input_error("order", of, f"be less than the {periods} periods of the record", got, "Ask for fewer poles.")
    if settings.harmonics is not None and 2 * settings.harmonics >= phases:
        must = f"be less than half the {phases} samples a period"
        raise input_error("harmonics", of, must, f"is {settings.harmonics}", "Ask for fewer, or sample faster.")
