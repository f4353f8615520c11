"""Preparation of records for every consumer: the responses and their clocks, as the settings ask for them."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from functools import cache
from math import tau
from typing import TYPE_CHECKING, Unpack

import numpy as np

from floquid._arrays import Complexes, Floats
from floquid._show import Brief
from floquid.checks import Parted
from floquid.core import ConstantPeriod, Cycles, PhaseClock, Record
from floquid.errors import IdentificationError
from floquid.findings import Finding, note, texts, warning
from floquid.fit import ROUNDS
from floquid.lifting import FLOOR
from floquid.lti import Ensemble, TimeResponses, pooled_noise
from floquid.periodic import estimate_period
from floquid.preparation._before import (
    begun,
    faults_of,
    hits_of,
    later,
    mended,
    missing_of,
    parted,
    repaired,
    responses_of,
    without_orbit,
)
from floquid.preparation._clocks import (
    check_states,
    clocked,
    clocks_of,
    refuse_no_clock,
    shafts_of,
    steadied,
    without_clock,
)
from floquid.preparation._excited import parted as parted_of
from floquid.preparation._excited import refuse_others
from floquid.preparation._forces import forces_of, refuse_driven, refuse_random
from floquid.preparation._options import Options, takes_settings
from floquid.preparation._refuse import (
    own_names,
    refuse_copies,
    refuse_period,
    refuse_short,
    refuse_sizes,
    refuse_unusable,
)
from floquid.preparation._settings import Settings, settings_of
from floquid.sync import ShaftAngle, between_events, refuse_unlike, rejoin


def by_events(
    records: tuple[Record, ...], settings: Settings, of: str
) -> tuple[tuple[Record, ...], Settings, tuple[Finding, ...]]:
    """The records in phase as of one constant period, without their common orbit, the settings for them, and notes.

    The period is the mean over all records. Of one record or two the orbit is left to the fit, as a forced response.
    Records without events are returned as they are.
    """
    if not any(record.clock is not None and record.clock.cycles for record in records):
        return records, settings, ()
    refuse_unlike(records, of)
    cycles = between_events(records)
    lengths = np.concatenate([hit.periods for hit in cycles])
    period, findings = float(lengths.mean()), []
    numbers = {"periods": len(lengths), "period": period, "spread": float(lengths.std() / period)}
    findings.append(note("between_events", records=len(cycles), phases=cycles[0].n_phases, **numbers))
    forced = settings.forced
    if forced == "auto" and len(cycles) > 2 and not any(np.isnan(hit.values).any() for hit in cycles):
        orbit = common_orbit(cycles, settings.mode_false_alarm, settings.seconds)
        cycles = tuple(replace(hit, values=hit.values - orbit[:, :, None]) for hit in cycles)
        findings.append(note("common_orbit", records=len(cycles), periods=len(lengths)))
        forced = "none"
    used = [
        replace(rejoin(replace(hit, periods=np.full(hit.n_cycles, period))), point=record.point)
        for hit, record in zip(cycles, records, strict=True)
    ]
    return tuple(used), replace(settings, events=None, forced=forced), tuple(findings)


def common_orbit(cycles: Sequence[Cycles], false_alarm: float, seconds: float = np.inf) -> Floats:
    r"""The orbit that all records are about, beside decays of their own (channels, phases).

    .. math:: y_{r}[k] = o + \sum_j \psi_j\, l_{r,j}\, \mu_j^k

    Differences of successive periods have no orbit: they give the multipliers μ and the states l μ^k, beside which o is
    the constant of a linear regression over all periods of all records. The modes are then fitted without that orbit,
    and the orbit is taken again. Without a mode it is the mean.
    """
    values = [np.concatenate(list(hit.values)) for hit in cycles]  # (channels · phases, periods)
    channels, phases, _ = cycles[0].values.shape
    orbit, order = np.concatenate(values, axis=1).mean(axis=1), None
    identifier = Ensemble(false_alarm=false_alarm, seconds=seconds)
    several = [own for own in values if own.shape[1] > 1]
    for look in range(ROUNDS if several else 0):
        part = [own - orbit[:, None] for own in several] if look else [np.diff(own) for own in several]
        data = _responses(part, channels)
        model = identifier.extract(identifier.prepare(data), order)
        order = model.order
        if not order:
            break
        lengths = [own.shape[1] for own in several]
        columns = [np.ones(sum(lengths)), *_states(model.multipliers, model.residues, lengths)]
        whole = np.concatenate(several, axis=1)
        orbit = np.linalg.lstsq(np.array(columns).T, whole.T, rcond=None)[0][0]
    return orbit.reshape(channels, phases)


def _states(multipliers: Complexes, residues: Complexes, lengths: Sequence[int]) -> Floats:
    """Real and imaginary parts of the state of each mode in all periods of all records (2 modes, periods)."""
    largest = np.abs(residues).max(axis=2).argmax(axis=1)  # the output where a mode is seen best
    first = residues[np.arange(len(multipliers)), largest]
    steps = np.arange(max(lengths))
    each = [first[:, [hit]] * multipliers[:, None] ** steps[:length] for hit, length in enumerate(lengths)]
    states = np.concatenate(each, axis=1)[multipliers.imag >= 0.0]
    return np.concatenate([states.real, states[np.abs(states.imag).max(axis=1) > 0.0].imag])


def _responses(values: Sequence[Floats], channels: int) -> TimeResponses:
    """The periods of all records (outputs, periods), one a hit, with the noise of each channel."""
    lengths = [own.shape[1] for own in values]
    padded = np.zeros((len(values[0]), len(values), max(lengths)))
    for hit, own in enumerate(values):
        padded[:, hit, : lengths[hit]] = own
    phases = len(padded) // channels
    noise = pooled_noise([[own[row * phases : (row + 1) * phases] for own in values] for row in range(channels)])
    floor = np.abs(padded).max() * FLOOR
    return TimeResponses(
        values=padded, dt=1.0, noise=np.repeat(np.maximum(noise, floor), phases, axis=0), lengths=lengths
    )


if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

LARGE = 20_000_000  # samples in all from which linear algebra may use all threads
NEAR = 1.5  # largest factor between the period and a first value of it


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prepared(Brief):
    """Records as they are used, whoever uses them: which channels are responses, and what ties them to the phase.

    Parameters
    ----------
    settings
        The options.
    records
        The records after hits were cut out, the first periods and the orbit taken off and channels chosen, each with
        its clock, and with the channel of the clock if it has one.
    responses
        The same without the channel of the clock.
    clocks
        What ties each response to the phase: a constant period, or the angle of the shaft.
    shafts
        The angle of the shaft in each record; empty where the period is constant.
    findings
        What was done to the records, and how well the angle of the shaft is known.
    faults
        What is wrong with samples.
    parted
        The outputs and inputs where the excitation goes on; None of free responses.
    """

    settings: Settings
    records: tuple[Record, ...]
    responses: tuple[Record, ...]
    clocks: tuple[PhaseClock, ...]
    shafts: tuple[ShaftAngle, ...] = ()
    findings: tuple[Finding, ...] = ()
    faults: tuple[Finding, ...] = ()
    parted: Parted | None = None


@takes_settings
def prepare(
    records: Record | Sequence[Record],
    settings: Settings | None = None,
    *,
    report: Callable[[str], None] = lambda _: None,
    of: str = "identify",
    **options: Unpack[Options],
) -> Prepared:
    """The responses and their clocks, of records and settings: what `identify`, `lifted` and `floquid scan` start from.

    The clock of the settings is put on, hits are cut out or first periods left out, and so are channels that are no
    responses. The orbit of the file is subtracted, and the period or the angle of the shaft is found. What cannot end
    well is refused before any long work.

    `records`, `settings`, `report` and `options` are those of `identify`; `of` is the callable that was asked, for
    messages. Raises InputError where a record or an option is not possible. Raises IdentificationError where the record
    is too short, or its period or shaft angle is unknown or not constant enough.
    """
    chosen = settings_of(settings, options, of)
    refuse_others(chosen, of)
    with own_names(of):
        used = clocked(records, chosen, of)
        if chosen.kind != "free":
            return _excited(used, chosen, report, of)
        faults = faults_of(used, repair=chosen.repair)
        try:
            found = _tied(*_free(used, chosen, of), report, of)
        except IdentificationError as error:
            raise IdentificationError("\n  ".join([str(error), *texts(faults)])) from None
    return replace(found, faults=faults)


def blas_threads(records: Sequence[Record | TimeResponses]) -> AbstractContextManager[object]:
    """Linear algebra in one thread, unless the records are large.

    The matrices are many and small: threads inside BLAS would wait for each other, on a busy machine for seconds.
    """
    few = sum(record.values.size for record in records) < LARGE
    return _thread_pools("scipy.linalg" in sys.modules).limit(limits=1 if few else None, user_api="blas")


@cache
def _thread_pools(scipy: bool) -> ThreadpoolController:  # noqa: ARG001  # scipy has a BLAS of its own
    """The thread pools of the libraries that are loaded: to look for them takes two milliseconds."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


def uneven_speed(shafts: Sequence[ShaftAngle]) -> tuple[Finding, ...]:
    """Findings on shafts at whose speed a periodic model does not hold."""
    uneven = [shaft for shaft in shafts if not shaft.steady]
    return tuple(warning("uneven_speed", reasons=shaft.reasons, hz=shaft.mean_speed / tau) for shaft in uneven)


def _excited(records: tuple[Record, ...], settings: Settings, report: Callable[[str], None], of: str) -> Prepared:
    """The outputs and inputs of records whose excitation goes on, mended, and what was done."""
    refuse_sizes(records, of)
    records, begun_at = begun(records, settings)
    records, faults = mended(records, settings)
    with blas_threads(records):
        report("parting inputs and outputs")
        own = parted_of(records, settings, of)
    if settings.kind == "inputs":
        refuse_driven(records, settings)
    return Prepared(
        settings=settings,
        records=own.records,
        responses=tuple(record.select([channel.name for channel in own.outputs]) for record in own.records),
        clocks=clocks_of(own.records, own.shafts),
        shafts=own.shafts,
        findings=(*begun_at, *faults),
        parted=own,
    )


def _free(
    records: tuple[Record, ...], settings: Settings, of: str
) -> tuple[tuple[Record, ...], Settings, tuple[Finding, ...]]:
    """The free responses that the records hold, cut and without other channels, the settings, and what was done."""
    if not settings.estimate_period:
        refuse_period(records, of)
    elif settings.period is not None:
        refuse_period(records, of, near=NEAR)
    forces = forces_of(records, settings)
    said = missing_of(records)
    refuse_unusable(records, of)
    if settings.repair:
        if not settings.find_hits:
            refuse_driven(records, settings)
        records, more = repaired(records)
        said += more
    records, settings, more = by_events(records, settings, of)
    said += more
    if settings.find_hits:
        records, more = hits_of(records, settings)
        said += more
    elif settings.skip:
        records, more = later(records, settings.skip)
        said += more
    elif settings.repair:
        records, more = parted(records, settings)
        said += more
    records, more = responses_of(records, settings)
    said += more
    if settings.repair and not settings.estimate_period:
        refuse_random(records, forces)
    if settings.orbit:
        records, more = without_orbit(records)
        said += more
    return records, settings, said


def _tied(
    records: tuple[Record, ...], settings: Settings, said: tuple[Finding, ...], report: Callable[[str], None], of: str
) -> Prepared:
    """The responses with what ties them to the phase; what cannot be used is refused."""
    if not settings.estimate_period:
        refuse_no_clock(records, of)
    responses = tuple(without_clock(record) for record in records)
    refuse_unlike(responses, of)
    refuse_copies(responses, of)
    check_states(responses[0].channels, settings)
    if settings.estimate_period:
        with blas_threads(responses):
            responses, more = _with_own_period(responses, settings.period, report)
        records, said = responses, (*said, *more)
    shafts = shafts_of(records, report, of)
    clocks = clocks_of(records, shafts)
    refuse_short(responses, clocks)
    uneven = uneven_speed(shafts)
    if uneven and not settings.trust_period:
        raise IdentificationError(str(uneven[0]))
    said = (*said, *dict.fromkeys(own for shaft in shafts for own in shaft.findings))
    steady = steadied(records, shafts)
    if steady is not None:
        degrees = shafts[0].jitter * shafts[0].mean_speed * 360.0 / tau
        said = (*said, note("speed_fitted", degrees=degrees))
        settings = replace(settings, periods_per_revolution=shafts[0].periods_per_revolution)
        records = responses = (steady,)
        shafts, clocks = (), clocks_of(records, ())
    return Prepared(
        settings=settings, records=records, responses=responses, clocks=clocks, shafts=shafts, findings=said
    )


def _with_own_period(
    records: tuple[Record, ...], about: float | None, report: Callable[[str], None]
) -> tuple[tuple[Record, ...], tuple[Finding, ...]]:
    """The records with the period that the response has, near `about` where that is given, and how it is known."""
    report("finding the period")
    shortest, longest, where = None, None, ""
    if about is not None:
        shortest, longest = about / NEAR, about * NEAR
        where = f" between {shortest:.6g} and {longest:.6g} s"
    found = estimate_period(records, shortest=shortest, longest=longest, report=report)
    if not found.told or found.period is None:
        wrong = "another first value (`period=`)" if about else "the period (`period=`)"
        raise IdentificationError(
            f"The response does not tell its period{where}. {' '.join(found.reasons)}\n  Give {wrong}, a tachometer "
            "(`tach=`), or a record with more cycles or less noise."
        )
    clocks = (ConstantPeriod(period=found.period, origin=record.start, fitted=True) for record in records)
    return tuple(map(Record.with_clock, records, clocks)), found.findings
