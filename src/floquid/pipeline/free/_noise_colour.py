"""Colour of the noise along the record, before any mode is known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from floquid.fit import SLOW, SURE, chi2_limit
from floquid.lifting import Lifted, whitening_filter
from floquid.lti import ModalModel
from floquid.periodic import generous_poles

PEAK = 0.05  # the gain of a filter, over its root sum of squares, below which the noise has a peak


def first_filter(lifted: Lifted) -> NDArray[np.float64] | None:
    """The filters that whiten what generous poles leave; None where that is white."""
    return whitening_filter(lifted, generous_poles(lifted))


ALL_PEAKED = (
    "Identification ended without a result: no mode rises above the noise. The candidates hardly decay and lie where "
    "the noise is loudest, as a drift or a peak of the noise does. Use a record with a clear free decay, or start it "
    "closer to the blow. To fit them anyway, give the order (`order=`)."
)


def dies_away(lifted: Lifted) -> bool:
    """True where a response ends far below where it began: a free decay does, noise and drift do not."""
    for hit, length in enumerate(lifted.responses.lengths.tolist()):
        values = lifted.by_channel(lifted.responses.values[:, hit, :length])
        begin = np.abs(values[:, :, : max(length // 4, 1)]).max(axis=(1, 2))
        end = np.sqrt(np.mean(values[:, :, -max(length // 3, 1) :] ** 2, axis=(1, 2)))
        if (begin > np.sqrt(chi2_limit(1, SURE / max(length * lifted.n_phases, 1))) * end).any():
            return True
    return False


def under_a_peak(lifted: Lifted, modal: ModalModel) -> NDArray[np.bool_]:
    """Mask of modes that hardly decay over the record and lie where the noise had a peak (modes,).

    What a filter leaves of a narrow peak, or of a drift, looks like such a mode. Looked at is the harmonic that is
    largest after the filter, in the channel where it is.
    """
    found = np.zeros(modal.order, bool)
    if lifted.whitening is None:
        return found
    half = lifted.n_phases // 2
    turns = 2j * np.pi / lifted.period * np.arange(-half, half + 1)
    size = np.linalg.norm(lifted.whitening, axis=1)
    for mode, (pole, residues) in enumerate(zip(modal.poles, modal.residues, strict=True)):
        if abs(pole.real) * lifted.period * int(lifted.responses.lengths.max()) >= SLOW:
            continue
        shapes = lifted.by_channel(residues) / lifted.noise[:, None, :]
        parts = np.einsum("mk,ckh->cm", np.exp(-np.multiply.outer(pole + turns, lifted.phase_times)), shapes)
        channel, harmonic = np.unravel_index(int(np.argmax(np.abs(parts))), parts.shape)
        found[mode] = np.abs(lifted.gain(pole + turns)[channel, harmonic]) < PEAK * size[channel]
    return found
