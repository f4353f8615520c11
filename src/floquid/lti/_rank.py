"""How many outer products the residues of a pole hold, beside noise of any colour."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from floquid.lti._noise import product_noise
from floquid.lti._select import rise_limit
from floquid.lti._types import ModalModel, TimeResponses


@dataclass(frozen=True, slots=True)
class Noise:
    """What the noise of a free fit is beside independent white noise of the deviations stated.

    `power` (modes,) is the noise at the frequency of each pole, over its mean; `independent` the share of the responses
    that it is worth.
    """

    power: NDArray[np.float64]
    independent: float = 1.0
    size: float = 1.0
    """Its mean square, which `power` holds too."""

    @property
    def colour(self) -> NDArray[np.float64]:
        """The noise at the frequency of each pole over that of white noise of its size (modes,)."""
        return self.power / self.size

    @staticmethod
    def white(model: ModalModel) -> Noise:
        """White noise."""
        return Noise(np.ones(model.order))

    @staticmethod
    def whitened_by(taps: NDArray[np.float64] | None, model: ModalModel, independent: float, variance: float) -> Noise:
        """The noise that a filter makes white, 1/|A|² on the unit circle."""
        turn = np.angle(model.multipliers)
        taps = np.ones(1) if taps is None else taps
        gain = np.abs(np.exp(-1j * np.multiply.outer(turn, np.arange(len(taps)))) @ taps) ** 2
        size = max(variance, 1.0)
        return Noise(size / np.maximum(gain, 1e-6), independent, size)

    def limit(self, entry: int, degrees: float, false_alarm: float) -> float:
        """The sum of squares that noise exceeds at the frequency of a pole."""
        share = self.independent
        return float(self.power[entry]) * rise_limit(false_alarm, max(degrees * share, 1.0), 1e9) / share


def ranks(model: ModalModel, data: TimeResponses, false_alarm: float, noise: Noise | None = None) -> NDArray[np.int64]:
    """How many outer products the residues of each pole of a free fit hold beyond noise (modes,).

    A singular value of the residues, over the noise that they carry, is kept when those from it on hold more than a
    chi-square of their degrees of freedom does at the false-alarm probability.
    """
    assert model.residue_spread is not None
    outputs, inputs = data.n_outputs, data.n_inputs
    # A factor a response would undo the products; what a factor an output and an input leaves unequal is averaged.
    scale = product_noise(data.noise)
    unequal = (data.noise / scale) ** 2
    worth = float(unequal.sum() ** 2 / np.sum(unequal**2) / unequal.size)
    noise = noise or Noise.white(model)
    found = np.ones(model.order, np.int64)
    for r in range(model.order):
        carried = scale * np.sqrt(model.residue_spread[:, r, r].real)
        values = np.linalg.svd(model.residues[r] / carried, compute_uv=False)
        parts = 1 if model.multipliers[r].imag == 0 else 2
        for rank in range(1, min(outputs, inputs)):
            degrees = parts * (outputs - rank) * (inputs - rank)
            left = parts * float(np.sum(values[rank:] ** 2)) / float(unequal.mean())
            if left * worth < noise.limit(r, degrees * worth, false_alarm):
                break
            found[r] = rank + 1
    return found
