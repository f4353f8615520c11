"""The lines that each mode has in the spectrum of a record."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from floquid._checks import Rebuilt, frozen_array
from floquid.pipeline import Analysis
from floquid.views._modes import checked, is_real, upper_modes


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Family(Rebuilt):
    """The lines |Im λ + mω| of one mode.

    Parameters
    ----------
    mode
        Which mode of the model, from 0.
    harmonics
        The harmonics m kept (lines,).
    omega
        Their frequencies |Im λ + mω| (lines,) [rad/s].
    share
        What each has of the energy of the mode's coefficients, channels weighted by the inverse of their noise
        (lines,) [-]; the shares sum to 1.
    """

    mode: int
    harmonics: NDArray[np.int64]
    omega: NDArray[np.float64]
    share: NDArray[np.float64]

    def __post_init__(self) -> None:
        lines = len(self.harmonics)
        put = object.__setattr__
        put(self, "harmonics", frozen_array(self.harmonics, "harmonics", "Family", axes=("lines",), dtype=np.int64))
        for name in ("omega", "share"):
            put(self, name, frozen_array(getattr(self, name), name, "Family", axes=(lines,)))


def families(analysis: Analysis) -> tuple[Family, ...]:
    r"""The lines of each mode, conjugates left out.

    .. math:: \Omega_m = |\Im\lambda + m\omega|, \qquad s_m = \frac{E_m}{\sum_n E_n}, \qquad
              E_m = \sum_{c,h} \frac{|B_{c,h,m}|^2}{\sigma_{c,h}^2}

    (Allen 2009, eq. 12.) Of a real multiplier, two harmonics turn at each frequency, one forwards and one backwards:
    they are one line.

    Parameters
    ----------
    analysis
        What `identify` found.

    Returns
    -------
    tuple of Family
        One a mode, in the order of the model.

    Raises
    ------
    InputError
        `analysis` is none.
    """
    checked(analysis, "families")
    model = analysis.model
    weighted = np.abs(model.coefficients) / analysis.noise[None, :, :, None]
    energies = np.sum((weighted / max(float(weighted.max(initial=0.0)), 1e-300)) ** 2, axis=(1, 2))
    found = []
    for mode in upper_modes(model):
        rates = model.exponents[mode].imag + model.fundamental * model.harmonics
        kept = energies[mode] > 0.0
        if is_real(model, mode):
            kept &= rates > -1e-9 * model.fundamental
        share = energies[mode][kept]
        found.append(
            Family(
                mode=mode,
                harmonics=model.harmonics[kept],
                omega=np.abs(rates[kept]),
                share=share / max(float(share.sum()), 1e-300) if len(share) else share,
            )
        )
    return tuple(found)
