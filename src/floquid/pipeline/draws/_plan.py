"""Plan of a bootstrap of free responses, and the modes of a draw in the order of those drawn from."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from floquid._arrays import Complexes, Floats
from floquid.core import ConstantPeriod, PeriodicModel, PhaseClock, Record
from floquid.fit import CHUNK, HALF_DIGITS
from floquid.lifting import Lifted
from floquid.lti import ModalModel
from floquid.periodic import instants
from floquid.pipeline._analysis import Analysis
from floquid.pipeline.free import by_cycles, samples_of, why_sampled
from floquid.preparation import Settings, states_of
from floquid.reconstruction import choices, text_of


@dataclass(frozen=True, slots=True)
class Plan:
    """All that a draw needs beside its seed."""

    model: PeriodicModel  # the model drawn from, without its joint covariance
    fitted: PeriodicModel
    """Model with every harmonic that was fitted, also those that it does not keep: where fits start."""
    built: PeriodicModel  # the same with the harmonics alone that A(t) was built from
    states: tuple[str, ...]  # names of the states of A(t); none where there is no A(t)
    settings: Settings  # without states where there is no A(t); with the structure and the delay that were found
    clean: tuple[Floats, ...]
    """Response of all that was fitted in each record (channels, samples), NaN where a sample is missing."""
    noise: Floats  # (channels, hits)
    whole: bool
    estimated: bool
    """True where the model has the joint covariance of its coefficients, as those of draws should then have."""
    free_period: bool  # true where the period is fitted too
    one_shape: bool  # true where all hits share the shapes of the modes
    lifted: Lifted | None
    """The lifted responses, where they hold all that was fitted: then a fit of them is the cheaper one."""
    modal: ModalModel | None  # the modal model, where residues were left free
    whitening: Floats | None  # filter of each channel that makes its noise white; `noise` is that after it
    records: tuple[Record, ...]
    """The records that draws take the place of: with their clocks' channels for `whole`, without otherwise."""
    rows: tuple[tuple[int, ...], ...]  # the rows of `records` that are responses
    clocks: tuple[PhaseClock, ...]  # clock of each record


def plan_of(analysis: Analysis, whole: bool) -> Plan:
    """The plan of an analysis of free responses."""
    decay = analysis.decay
    assert decay is not None
    model, fit, shafts = analysis.model, decay.fit, analysis.shafts
    bare = replace(model, covariance=None, estimates=None, unselected=None)
    # Free residues have no harmonics to hold: then the poles are refined, and the shapes expanded again. All that was
    # fitted is drawn from: of a weak mode, what is not kept may be much of what the record says.
    fitted = bare if not fit.constrained or model.estimates is None else _fitted(model)
    measured = samples_of(analysis.records, shafts) if whole and fit.constrained else fit.free
    clean = []
    for hit, (record, clock, seen) in enumerate(zip(fit.free, analysis.clocks, measured, strict=True)):
        own = _response(fitted, hit, *instants(record, clock, model.fundamental))
        # The forced response as it was found, wherever the speed took it; NaN where a sample is missing.
        clean.append(own + (seen.values - record.values))
    records = analysis.records if whole and why_sampled(fit, shafts) else fit.free
    # Draws of the modes alone would not know a period that the steady response told.
    steady = not whole and fit.forced is not None and len(fit.forced.harmonics) > 0
    free_period, clocks = fit.period_std is not None and not steady, analysis.clocks
    if fit.period_std is not None and steady:
        # Phases count from where they did by the first value.
        zeros = (clock.phase_zero(own.start) for clock, own in zip(clocks, fit.free, strict=True))
        clocks = tuple(ConstantPeriod(period=model.period, origin=zero) for zero in zeros)
    names = {channel.name for channel in model.channels}
    return Plan(
        model=bare,
        fitted=fitted,
        **choices_of(analysis, bare),
        clean=tuple(clean),
        noise=fit.noise,
        whole=whole,
        estimated=model.estimates is not None,
        free_period=free_period,
        one_shape=model.one_shape,
        lifted=analysis.lifted if by_cycles(fit, shafts) else None,
        modal=None if fit.constrained else analysis.modal,
        whitening=fit.whitening,
        records=records,
        rows=tuple(tuple(row for row, c in enumerate(record.channels) if c.name in names) for record in records),
        clocks=clocks,
    )


def without_states(settings: Settings) -> Settings:
    """The settings without A(t)."""
    return replace(settings, states=(), form="second-order", delay=None, structure="", output_error=False)


def choices_of(analysis: Analysis, bare: PeriodicModel) -> dict[str, Any]:
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


def _response(model: PeriodicModel, hit: int, times: Floats, angles: Floats) -> Floats:
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


def aligned(model: PeriodicModel, found: PeriodicModel) -> tuple[Complexes, Complexes]:
    """The exponents and coefficients found, in the order, on the branches and with the harmonics of `model`."""
    exponents = np.zeros(model.order, complex)
    coefficients = np.zeros(model.coefficients.shape, complex)
    kept = (model.coefficients != 0).any(axis=(1, 2))
    for one, own, by in pairs(model, found):
        exponents[own] = found.exponents[one] - 1j * found.fundamental * by
        _, there, here = np.intersect1d(found.harmonics + by, model.harmonics[kept[own]], return_indices=True)
        value = found.coefficients[one][..., there] * _scale(model, own, found, one, by)
        coefficients[own][..., np.flatnonzero(kept[own])[here]] = value
    return exponents, coefficients


def _scale(model: PeriodicModel, mode: int, found: PeriodicModel, one: int, turns: int) -> complex:
    """The factor that gives a mode found the scale of a mode of `model`, whose state is free in records with inputs."""
    known = np.abs(model.coefficients[mode])
    std = known if model.coefficient_std is None else np.abs(model.coefficient_std[mode])
    for channel, hit, place in np.argwhere((std <= HALF_DIGITS * known) & (known > 0.0)).tolist():
        at = np.flatnonzero(found.harmonics + turns == model.harmonics[place])
        if len(at) and found.coefficients[one, channel, hit, at[0]]:
            return complex(model.coefficients[mode, channel, hit, place] / found.coefficients[one, channel, hit, at[0]])
    if model.inputs is None or found.inputs is None:
        return 1.0
    ours, theirs = model.inputs, found.inputs
    for source, place in np.argwhere(np.abs(ours.coefficients[mode] - 1.0) < HALF_DIGITS).tolist():
        at = np.flatnonzero(theirs.harmonics - turns == ours.harmonics[place])
        return complex(theirs.coefficients[one, source, at[0]]) if len(at) else 1.0
    for record in np.flatnonzero(np.abs(ours.initial[mode] - 1.0) < HALF_DIGITS).tolist():
        return complex(theirs.initial[one, record])
    return 1.0


def pairs(model: PeriodicModel, found: PeriodicModel) -> Iterator[tuple[int, int, int]]:
    """Each mode found, the mode of `model` that it is, and by how many fundamentals its exponent is above that."""
    from scipy.optimize import linear_sum_assignment

    apart = np.subtract.outer(found.exponents, model.exponents)
    turns = np.rint(np.imag(apart) / model.fundamental).astype(np.int64)
    theirs, ours = linear_sum_assignment(np.abs(apart - 1j * model.fundamental * turns))
    for one, own in zip(theirs.tolist(), ours.tolist(), strict=True):
        yield one, own, int(turns[one, own])


def selected(built: PeriodicModel, found: PeriodicModel) -> PeriodicModel:
    """The model found with the coefficients alone that A(t) was built from.

    What is fitted beyond them stays in the estimates, as there. The choice is held as the bands are: where what is
    drawn from has a coefficient near the limit, the noise of the record is in it already, and in a draw once more.
    """
    kept = (built.coefficients != 0).any(axis=(1, 2))
    mask = np.zeros((found.order, len(found.harmonics)), bool)
    for one, own, by in pairs(built, found):
        mask[one] = np.isin(found.harmonics + by, built.harmonics[kept[own]])
    wide = mask[:, None, None]
    std = found.coefficient_std
    return replace(
        found,
        coefficients=found.coefficients * wide,
        coefficient_std=None if std is None else std * wide,
    )
