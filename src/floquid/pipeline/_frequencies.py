"""Frequencies at which transfer functions of a model are given where none are named."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Floats
from floquid._checks import frozen_array
from floquid.core import PeriodicModel, Record

POINTS = 400
"""Frequencies where none are named, evenly spaced, beside those at resonances."""

BESIDE = (-3.0, -1.0, -0.5, 0.0, 0.5, 1.0, 3.0)
"""Frequencies beside a resonance, in half-widths of it."""


def frequencies_of(asked: ArrayLike | None, model: PeriodicModel, records: tuple[Record, ...], of: str) -> Floats:
    """Frequencies of transfer functions [Hz]: those asked for, or some to beyond the highest mode (frequencies,)."""
    if asked is None:
        highest = max(2.0 * model.frequencies_hz.max(initial=0.0), 1.0 / model.period)
        most = min(highest, 0.5 * min(record.sample_rate for record in records))
        even, peaks = np.linspace(most / POINTS, most, POINTS), _peaks(model)
        asked = np.unique(np.concatenate([even, peaks[(peaks > 0.0) & (peaks < most)]]))
    return frozen_array(np.atleast_1d(np.asarray(asked, float)), "frequencies_hz", of, axes=("frequencies",))


def _peaks(model: PeriodicModel) -> Floats:
    """Frequencies of the inputs at and beside the resonances of the modes [Hz], by every harmonic that reaches them.

    An even grid misses the top of those that are narrower than its steps.
    """
    own = model.inputs
    assert own is not None
    reached = (own.coefficients != 0.0).any(axis=1)
    rates = model.exponents.imag[:, None] - own.harmonics * model.fundamental
    beside = np.multiply.outer(np.abs(model.exponents.real), BESIDE)
    return (rates[:, :, None] + beside[:, None, :])[reached].ravel() / (2.0 * np.pi)
