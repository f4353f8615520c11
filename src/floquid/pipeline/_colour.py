"""Whether the noise is coloured along the record, before any mode is known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from floquid.lifting import Lifted, whitening_filter
from floquid.lti import ERA, ModalModel

GENEROUS = 64
"""Poles that take any response with them and leave nothing but noise; at most one in three periods."""

SLOW = 2.0 * np.pi
"""The decay over the record, as a logarithm, below which a mode may be noise."""

PEAK = 0.03
"""The gain of a filter, over its root sum of squares, below which the noise has a peak."""

PEAKED = "A mode that hardly decays over the record lies where the noise has a peak: it may be noise."


def first_filter(lifted: Lifted) -> NDArray[np.float64] | None:
    """The filters that whiten what generous poles leave; None where that is white."""
    era = ERA()
    order = max(1, min(GENEROUS, int(lifted.responses.lengths.max()) // 3))
    return whitening_filter(lifted, era.extract(era.prepare(lifted.responses), order))


def under_a_peak(lifted: Lifted, modal: ModalModel) -> bool:
    """Whether a mode that hardly decays over the record lies where the noise that was whitened has a peak.

    What a filter leaves of a narrow peak, or of a drift, looks like such a mode. Looked at is the harmonic that is
    largest after the filter, in the channel where it is.
    """
    if lifted.whitening is None:
        return False
    half = lifted.n_phases // 2
    turns = 2j * np.pi / lifted.period * np.arange(-half, half + 1)
    size = np.linalg.norm(lifted.whitening, axis=1)
    for pole, residues in zip(modal.poles, modal.residues, strict=True):
        if abs(pole.real) * lifted.period * int(lifted.responses.lengths.max()) >= SLOW:
            continue
        shapes = lifted.by_channel(residues) / lifted.noise[:, None, :]
        found = np.einsum("mk,ckh->cm", np.exp(-np.multiply.outer(pole + turns, lifted.phase_times)), shapes)
        channel, harmonic = np.unravel_index(int(np.argmax(np.abs(found))), found.shape)
        if np.abs(lifted.gain(pole + turns)[channel, harmonic]) < PEAK * size[channel]:
            return True
    return False
