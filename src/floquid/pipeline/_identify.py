"""The whole chain: records → poles → periodic model → state matrix, with every intermediate kept."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray

from floquid._checks import input_error
from floquid.core import (
    AzimuthSignal,
    Clock,
    ConstantPeriod,
    Cycles,
    Estimates,
    Record,
    TachometerSignal,
)
from floquid.errors import IdentificationError
from floquid.lifting import lift
from floquid.lti import fit_residues
from floquid.order import Choice, judge
from floquid.periodic import assemble, combinations_of, estimate_at, finish, periodicity
from floquid.pipeline._analysis import Analysis
from floquid.pipeline._before import faults_of, hits_of, later, missing_of, responses_of, without_orbit
from floquid.pipeline._doubts import ambiguity, below_modes, driven, misfit, quiet, too_low, warnings, wrong_period
from floquid.pipeline._find_poles import UnsettledError, find_poles
from floquid.pipeline._independent import COPIED, NO_NEWS, refuse_copies, refuse_unusable, sum_of_others
from floquid.pipeline._measured import NOT_WHOLE, measured, why_measured
from floquid.pipeline._rounded import rounded
from floquid.pipeline._settings import Settings
from floquid.pipeline._state import check_states, state_of
from floquid.pipeline._validated import validated
from floquid.sync import segment

FLOORS = (1e-4, 1e-3)
"""Shares of a channel's largest value down to which a record that has hardly any noise is believed, one after another,
where what modes leave is no noise."""

LARGE = 20_000_000
"""Samples in all from which linear algebra may use all threads."""


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
    from threadpoolctl import threadpool_limits

    chosen = _settings(settings, options)
    used = _prepare(records, chosen)
    faults, said = faults_of(used), missing_of(used)
    if chosen.find_hits:
        used, words = hits_of(used, chosen)
        said += words
    elif chosen.skip:
        used, words = later(used, chosen.skip)
        said += words
    used, words = responses_of(used, chosen)
    said += words
    if chosen.orbit:
        used, words = without_orbit(used)
        said += words
    # The matrices are many and small: threads inside BLAS would wait for each other, on a busy machine for seconds.
    few = sum(record.values.size for record in used) < LARGE
    with threadpool_limits(limits=1 if few else None, user_api="blas"):
        try:
            found = _identified(used, chosen, report, said)
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


def _identified(
    used: tuple[Record, ...], chosen: Settings, report: Callable[[str], None], said: tuple[str, ...] = ()
) -> Analysis:
    """The chain from records with their clock on."""
    why = why_measured(used, chosen)
    refuse_unusable(used)
    refuse_copies(used)
    if why:
        _refuse_far(used, chosen)
        if why == NOT_WHOLE and not chosen.trust_period and (words := rounded(used, chosen, report)):
            raise IdentificationError(words)
        return measured(used, chosen, report, said=(*said, f"Fitted as sampled, not lifted: {why}."))
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
        return measured(used, chosen, report, said=(*said, f"Fitted as sampled, not lifted: {why}."))
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


def _settings(settings: Settings | None, options: dict[str, object]) -> Settings:
    known = [f.name for f in fields(Settings)]
    for name in options:
        if name not in known:
            raise input_error(
                name,
                "identify",
                "be a field of Settings",
                "there is none of that name",
                f"The fields are: {', '.join(known)}.",
            )
    return replace(settings or Settings(), **options)  # type: ignore[arg-type]


def _prepare(records: Record | Sequence[Record], settings: Settings) -> tuple[Record, ...]:
    """The records with the channels and the clock of the settings."""
    several = (records,) if isinstance(records, Record) else tuple(records) if isinstance(records, Iterable) else ()
    if not several or not all(isinstance(r, Record) for r in several):
        raise input_error(
            "records", "identify", "be a Record or a list of them", f"is {records!r:.60}", "Read files with `read`."
        )
    used = []
    for record in several:
        clock = _clock(record, settings)
        own = [clock.channel] if isinstance(clock, (TachometerSignal, AzimuthSignal)) else []
        if settings.channels:
            record = record.select([*settings.channels, *(name for name in own if name not in settings.channels)])
        used.append(record if clock is None else record.with_clock(clock))
    return tuple(used)


def _clock(record: Record, settings: Settings) -> Clock | None:
    """The clock that the settings name, or the record's own."""
    turns = settings.periods_per_revolution
    if settings.tach is not None:
        return TachometerSignal(
            channel=settings.tach,
            pulses_per_revolution=settings.pulses_per_revolution,
            periods_per_revolution=turns,
        )
    if settings.azimuth is not None:
        return AzimuthSignal(channel=settings.azimuth, periods_per_revolution=turns)
    if settings.period is not None:
        origin = record.clock.origin if isinstance(record.clock, ConstantPeriod) else 0.0
        return ConstantPeriod(period=settings.period, origin=origin)
    return record.clock


def _refuse_far(records: Sequence[Record], settings: Settings) -> None:
    """Refuse what cannot end well for records fitted as they were sampled."""
    names = [channel for channel in records[0].channels if channel.name not in (settings.tach, settings.azimuth)]
    check_states(names, settings)
    if settings.identifier is not None:
        must, got = "be None for records that are fitted as they were sampled", f"is {settings.identifier!r:.60}"
        remedy = "Leave it out: modes are found in the spectrum of what is left, and fitted by maximum likelihood."
        raise input_error("identifier", "identify", must, got, remedy)


def _refuse_impossible(settings: Settings, cycles: Sequence[Cycles]) -> None:
    """Refuse what cannot end well before any long work."""
    of, periods, phases = "identify", max(c.n_cycles for c in cycles), cycles[0].n_phases
    shortest = min(c.n_cycles for c in cycles)
    if shortest < 4:
        raise IdentificationError(
            f"The record holds {shortest} whole period{'s' if shortest > 1 else ''}: fewer than 4 cannot hold a mode "
            "and the noise beside it. Record longer, or check the period."
        )
    check_states(cycles[0].channels, settings)
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
