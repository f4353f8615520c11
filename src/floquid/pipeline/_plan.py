"""What the draws of a bootstrap need: the model, what it makes of each record, and how records were fitted."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from floquid.core import ConstantPeriod, PeriodicModel, Record
from floquid.lifting import Lifted
from floquid.lti import ModalModel
from floquid.periodic import instants
from floquid.pipeline._analysis import Analysis
from floquid.pipeline._prepare import prepared_of
from floquid.pipeline._settings import Settings
from floquid.pipeline._state import states_of
from floquid.reconstruction import choices, text_of
from floquid.sync import ShaftAngle

CHUNK = 4096
"""Samples of the response that are made at a time."""


@dataclass(frozen=True, slots=True)
class Plan:
    """All that a draw needs beside its seed."""

    model: PeriodicModel
    """What is drawn from, without its joint covariance."""
    fitted: PeriodicModel
    """The same with every harmonic that was fitted, also those that the model does not keep: where fits start."""
    built: PeriodicModel
    """The same with the harmonics alone that A(t) was built from."""
    states: tuple[str, ...]
    """What the states of A(t) are; none where there is no A(t)."""
    settings: Settings
    """Without states where there is no A(t); with the structure and the delay that were found."""
    clean: tuple[NDArray[np.float64], ...]
    """What all that was fitted makes of each record (channels, samples), NaN where a sample is missing."""
    noise: NDArray[np.float64]
    """(channels, hits)."""
    whole: bool
    estimated: bool
    """Whether the model has the joint covariance of its coefficients, as what draws give should then have."""
    free_period: bool = False
    """Whether the period is fitted too."""
    lifted: Lifted | None = None
    """The responses, where they were lifted."""
    modal: ModalModel | None = None
    """The modal model, where residues were left free."""
    whitening: NDArray[np.float64] | None = None
    """The filter of each channel that makes its noise white; `noise` is that after it."""
    records: tuple[Record, ...] = ()
    """The records, where they were fitted as sampled: with their clocks' channels for `whole`, without otherwise."""
    rows: tuple[tuple[int, ...], ...] = ()
    """The rows of `records` that are responses."""
    clocks: tuple[ConstantPeriod | ShaftAngle, ...] = ()


def plan_of(analysis: Analysis, whole: bool) -> Plan:
    """What the draws need."""
    model = analysis.model
    bare = replace(model, covariance=None, estimates=None, unselected=None)
    # Free residues have no harmonics to hold: then the poles are refined, and the shapes expanded again.
    free = analysis.fit is None and not analysis.held
    common: dict[str, Any] = {
        "model": bare,
        "fitted": bare if free or model.estimates is None else _fitted(model),
        **_choices(analysis, bare),
        "noise": analysis.noise,
        "whitening": analysis.whitening,
        "whole": whole,
        "estimated": model.estimates is not None,
    }
    # All that was fitted is drawn from: of a weak mode, what is not kept may be much of what the record says.
    if analysis.fit is None:
        clean = []
        for hit, cycles in enumerate(analysis.cycles):
            samples = np.arange(cycles.n_cycles * cycles.n_phases)
            times = (cycles.first_phase + samples / cycles.n_phases) * model.period
            clean.append(_response(common["fitted"], hit, times, model.fundamental * times))
        return Plan(
            **common,
            clean=tuple(clean),
            lifted=analysis.lifted,
            modal=analysis.modal if free else None,
        )
    return _as_sampled(analysis, common)


def _as_sampled(analysis: Analysis, common: dict[str, Any]) -> Plan:
    """The plan for records that were fitted as they were sampled."""
    model, whole, fit = analysis.model, common["whole"], analysis.fit
    assert fit is not None
    prepared = prepared_of(analysis)
    responses, clocks = prepared.responses, prepared.clocks
    clean = []
    for hit, (record, clock) in enumerate(zip(responses, clocks, strict=True)):
        own = _response(common["fitted"], hit, *instants(record, clock, model.fundamental))
        if whole:
            # The forced response as it was found, wherever the speed took it.
            own += record.values - fit.free[hit].values
        clean.append(np.where(np.isnan(record.values), np.nan, own))
    rows = []
    for record, response in zip(prepared.records, responses, strict=True):
        names = {channel.name for channel in response.channels}
        rows.append(tuple(row for row, channel in enumerate(record.channels) if channel.name in names))
    records = prepared.records if whole else responses
    return Plan(
        **common,
        clean=tuple(clean),
        records=records,
        rows=tuple(rows),
        clocks=clocks,
        free_period=fit.period_std is not None,
    )


def without_states(settings: Settings) -> Settings:
    """The settings without A(t)."""
    return replace(settings, states=(), form="second-order", delay=None, structure="", output_error=False)


def _choices(analysis: Analysis, bare: PeriodicModel) -> dict[str, Any]:
    """The settings that draws are made with, and what A(t) was built from."""
    settings, model, state = analysis.settings, analysis.model, analysis.state
    if state is None:
        return {"built": bare, "states": (), "settings": without_states(settings)}
    found: dict[str, Any] = {"built": bare, "states": state.states, "settings": settings}
    if analysis.refinement is not None:
        return found | {"settings": replace(settings, structure=text_of(analysis.refinement.structure))}
    names = states_of(model.channels, settings)
    delay, terms = choices(model, names, form=settings.form, delay=settings.delay)  # type: ignore[arg-type]
    if terms is not None and settings.harmonics is None:
        assert model.estimates is not None
        found["built"] = _fitted(replace(model, estimates=model.estimates.picked(terms=terms)))
    return found | {"settings": replace(settings, delay=delay)}


def _response(
    model: PeriodicModel, hit: int, times: NDArray[np.float64], angles: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The free response of one hit (channels, samples) at times after phase zero [s] and phase angles [rad]."""
    found = np.empty((len(model.channels), len(times)))
    weights = model.coefficients[:, :, hit].transpose(1, 0, 2).reshape(len(model.channels), -1)
    for first in range(0, len(times), CHUNK):
        part = slice(first, first + CHUNK)
        decays = np.exp(np.multiply.outer(model.exponents, times[part]))
        turned = np.exp(1j * np.multiply.outer(model.harmonics, angles[part]))
        found[:, part] = (weights @ (decays[:, None] * turned).reshape(weights.shape[1], -1)).real
    return found


def _fitted(model: PeriodicModel) -> PeriodicModel:
    """The model with every coefficient that was fitted, significant or not."""
    estimates = model.estimates
    assert estimates is not None
    turns = estimates.half_turns[estimates.modes]
    # Of a real multiplier harmonic -κ - m is the conjugate of m; of a pair the conjugate mode has it at -m.
    mirror = np.where(estimates.real[estimates.modes], -turns, 0) - estimates.harmonics
    width = int(max(np.abs(estimates.harmonics).max(), np.abs(mirror).max(), np.abs(model.harmonics).max()))
    coefficients = np.zeros((*model.coefficients.shape[:3], 2 * width + 1), complex)
    places = model.modes_of(estimates)
    partner = np.abs(np.subtract.outer(model.exponents, model.exponents.conj())).argmin(axis=1)
    for term, mode in enumerate(estimates.modes):
        value, place = estimates.coefficients[term], int(places[mode])
        coefficients[place, ..., estimates.harmonics[term] + width] = value
        other = place if estimates.real[mode] else int(partner[place])
        if other != place or estimates.turning[term]:
            coefficients[other, ..., mirror[term] + width] = value.conj()
    return PeriodicModel(
        exponents=model.exponents,
        coefficients=coefficients,
        harmonics=np.arange(-width, width + 1),
        period=model.period,
        channels=model.channels,
    )
