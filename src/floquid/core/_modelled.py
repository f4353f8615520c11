"""The periodic model of estimates, each mode with its conjugate, with the deviations of all that it holds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from floquid._arrays import Complexes, Floats, Integers, Mask
from floquid.core._axis import with_deviations
from floquid.core._channel import Channel
from floquid.core._estimates import Estimates
from floquid.core._model_inputs import ModelInputs
from floquid.core._periodic_model import PeriodicModel
from floquid.core._provenance import Provenance
from floquid.errors import IdentificationError


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Driven:
    """Effects of measured inputs beside driving the modes: D, and the states at the start of each record."""

    channels: Sequence[Channel]  # One `Channel` an input
    # D (outputs, inputs, direct harmonics), and the integers n, ascending (direct harmonics,)
    direct: Complexes
    direct_harmonics: Integers
    initial: Complexes  # z at the first sample of each record (modes of the estimates, records)
    begins: Floats  # t there (records,) [s]


def modelled(
    estimates: Estimates,
    *,
    channels: Sequence[Channel],
    provenance: Provenance,
    kept: Mask | None = None,
    unselected: Estimates | None = None,
    driven: Driven | None = None,
    as_read: Mapping[int, complex] | None = None,
) -> PeriodicModel:
    """The periodic model of estimates, modes in their order, each pair followed by its conjugate.

    Raises IdentificationError where a mode has no deviation.

    Parameters
    ----------
    estimates
        Exponents and coefficients with their joint covariance.
    channels, provenance
        Those of the records.
    kept
        Mask of the terms that the model keeps (terms,): all others are zero in it. None for all.
    unselected
        The same fit with more harmonics.
    driven
        What measured inputs do beside driving the modes; None where none were measured.
    as_read
        Deviations of exponents near an axis, by the modes of the estimates.
    """
    entries = np.repeat(np.arange(len(estimates.exponents)), np.where(estimates.real, 1, 2))
    back = np.append(False, entries[1:] == entries[:-1])[: len(entries)]
    slopes = np.where(back[:, None], estimates.exponent_slopes[entries].conj(), estimates.exponent_slopes[entries])
    by = np.concatenate([slopes.real, slopes.imag])
    covariance = by @ estimates.covariance @ by.T
    if not (np.isfinite(covariance).all() and (np.diag(covariance) >= 0.0).all()):
        raise IdentificationError("A mode is not determined at all: with its residues held, it has no deviation.")
    if as_read:
        covariance = with_deviations(
            covariance, np.array([as_read.get(k, complex(np.nan, np.nan)) for k in entries.tolist()])
        )
    exponents = estimates.exponents[entries]
    harmonics, coefficients, std = _shapes(estimates, kept, entries)
    return PeriodicModel(
        exponents=np.where(back, exponents.conj(), exponents),
        coefficients=coefficients,
        harmonics=harmonics,
        period=2.0 * np.pi / estimates.fundamental,
        channels=channels,
        covariance=covariance,
        coefficient_std=std,
        estimates=estimates,
        unselected=unselected,
        provenance=provenance,
        inputs=None if driven is None else _inputs(estimates, driven, entries, back),
    )


def _shapes(estimates: Estimates, kept: Mask | None, own: Integers) -> tuple[Integers, Complexes, Complexes]:
    """The harmonics of a model, its coefficients and their deviations (modes, channels, hits, harmonics)."""
    used = np.ones(len(estimates.modes), bool) if kept is None else kept
    modes, straight = estimates.modes[used], estimates.harmonics[used]
    real = estimates.real[modes]
    mirror = -straight - estimates.half_turns[modes]
    harmonics = np.unique(np.concatenate([[0], straight, mirror]))
    coefficients, std = np.zeros((2, len(own), *estimates.blocks.shape, len(harmonics)), complex)
    first, last = np.searchsorted(own, modes), np.searchsorted(own, modes, side="right") - 1
    there, beyond = np.searchsorted(harmonics, straight), np.searchsorted(harmonics, mirror)
    turns = estimates.turning[used] | ~real
    for place, values, reflected in (
        (coefficients, estimates.coefficients[used], estimates.coefficients[used].conj()),
        (std, estimates.std()[used], estimates.std()[used]),
    ):
        by_term = np.moveaxis(place, 3, 1)
        by_term[last[turns], beyond[turns]] = reflected[turns]
        by_term[first, there] = values
    return harmonics, coefficients, std


def _inputs(estimates: Estimates, driven: Driven, own: Integers, back: Mask) -> ModelInputs:
    """The inputs of a model, conjugates included."""
    gains = estimates.gains
    assert gains is not None
    harmonics = np.unique(np.concatenate([[0], gains.harmonics, -gains.harmonics]))
    both = np.zeros((2, len(gains.coefficients), len(driven.channels), len(harmonics)), complex)
    both[..., np.searchsorted(harmonics, gains.harmonics)] = gains.coefficients, gains.std(estimates.covariance)
    values, std = both[:, own]
    values[back], std[back] = values[back][..., ::-1].conj(), std[back][..., ::-1]
    initial = driven.initial[own]
    return ModelInputs(
        channels=tuple(driven.channels),
        coefficients=values,
        harmonics=harmonics,
        coefficient_std=std,
        direct=driven.direct,
        direct_harmonics=driven.direct_harmonics,
        initial=np.where(back[:, None], initial.conj(), initial),
        begins=driven.begins,
    )
