"""Modes of a draw in the order of those drawn from, and what A(t) of it is built from."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from floquid._arrays import Complexes
from floquid.core import PeriodicModel
from floquid.fit import HALF_DIGITS
from floquid.pipeline._analysis import Analysis
from floquid.preparation import Settings, states_of
from floquid.reconstruction import choices, text_of


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
        found["built"] = with_all_fitted(replace(model, estimates=model.estimates.picked(terms=terms)))
    return found | {"settings": replace(settings, delay=delay)}


def with_all_fitted(model: PeriodicModel) -> PeriodicModel:
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
