"""How much of a record is worth looking at: samples in which the response has died hold nothing but noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from floquid.lti._poles import PoleSet
from floquid.lti._types import TimeResponses

SHORT = 600
"""Samples up to which a record is looked at whole."""


def energetic_length(energy: NDArray[np.float64], data: TimeResponses, *, margin: float = 1.5) -> int:
    """The samples to look at first: all of a short record; of a long one, those before the energy meets its floor.

    The floor is the least mean energy over a twentieth of the record. A mode that goes on below it is found later, from
    the poles: see `horizon`.
    """
    whole = len(energy)
    if whole <= SHORT:
        return whole
    width = whole // 20
    blocks = energy[: width * 20].reshape(20, width).mean(axis=1)
    columns = data.n_outputs * data.n_inputs
    quiet = blocks < blocks.min() * (1.0 + 6.0 * np.sqrt(2.0 / (width * columns))) * 1.02
    loud = np.flatnonzero(~quiet)
    return min(whole, max(SHORT, int(np.ceil(margin * width * (loud[-1] + 1))))) if len(loud) else whole


def horizon(poles: PoleSet, whole: int, time_constants: float) -> int:
    """The samples in which the slowest pole decays by `time_constants`; at most `whole`."""
    slowest = poles.s.real.max() if len(poles) else 0.0
    return whole if slowest >= 0 else min(whole, int(np.ceil(time_constants / -slowest)))


def search_window(samples: int) -> int:
    """The length of the Hankel window: half of the longest block, so that a short one holds most poles; at most 200."""
    return max(2, min(200, samples // 2))
