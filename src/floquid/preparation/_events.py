"""Records whose periods lie between events, in phase as of one period, and the orbit that all of them are about."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from floquid._arrays import Complexes, Floats
from floquid.core import Cycles, Record
from floquid.findings import Finding, note
from floquid.fit import ROUNDS
from floquid.lifting import FLOOR
from floquid.lti import Ensemble, TimeResponses, pooled_noise
from floquid.preparation._settings import Settings
from floquid.sync import between_events, refuse_unlike, rejoin


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
        orbit = common_orbit(cycles, settings.mode_false_alarm)
        cycles = tuple(replace(hit, values=hit.values - orbit[:, :, None]) for hit in cycles)
        findings.append(note("common_orbit", records=len(cycles), periods=len(lengths)))
        forced = "none"
    used = [
        replace(rejoin(replace(hit, periods=np.full(hit.n_cycles, period))), point=record.point)
        for hit, record in zip(cycles, records, strict=True)
    ]
    return tuple(used), replace(settings, events=None, forced=forced), tuple(findings)


def common_orbit(cycles: Sequence[Cycles], false_alarm: float) -> Floats:
    r"""The orbit that all records are about, beside decays of their own (channels, phases).

    .. math:: y_{r}[k] = o + \sum_j \psi_j\, l_{r,j}\, \mu_j^k

    Differences of successive periods have no orbit: they give the multipliers μ and the states l μ^k, beside which o is
    the constant of a linear regression over all periods of all records. The modes are then fitted without that orbit,
    and the orbit is taken again. Without a mode it is the mean.
    """
    values = [np.concatenate(list(hit.values)) for hit in cycles]  # (channels · phases, periods)
    channels, phases, _ = cycles[0].values.shape
    orbit, order = np.concatenate(values, axis=1).mean(axis=1), None
    identifier, several = Ensemble(false_alarm=false_alarm), [own for own in values if own.shape[1] > 1]
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
