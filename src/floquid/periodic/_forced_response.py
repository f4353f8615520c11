"""The periodic forced response beside the free one: imbalance, gravity, tower shadow, a limit cycle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Complexes, Floats, Integers
from floquid._checks import Rebuilt, positive
from floquid.core import Channel


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ForcedResponse(Rebuilt):
    r"""The periodic response to what drives the system once a revolution and at its harmonics.

    .. math:: y_f(t) = b + d\,(t - \bar t) + 2 \Re \sum_{j > 0} F_j\, e^{i j \varphi(t)}

    with φ the angle of the shaft, or 2πt over the revolution where that is constant, zero at phase zero, and t̄ the
    middle of the record.

    Parameters
    ----------
    harmonics
        The harmonics j of the revolution, ascending (harmonics,).
    coefficients
        F (channels, hits, harmonics) [units of the channels].
    coefficient_std
        Their deviations, that of the real part as the real part (channels, hits, harmonics); None if not estimated, as
        the deviations of the others are then.
    offset, offset_std
        b and its deviation (channels, hits) [units of the channels]; zero where there is none.
    drift, drift_std
        d and its deviation (channels, hits) [units of the channels/s]; zero where there is none.
    revolution
        The revolution [s], its mean where the speed wanders.
    channels
        One `Channel` a row.
    speed_dependent
        Whether F was let follow the speed: then F is that at the mean speed.
    """

    harmonics: Integers
    coefficients: Complexes
    coefficient_std: Complexes | None
    offset: Floats
    offset_std: Floats | None
    drift: Floats
    drift_std: Floats | None
    revolution: float
    channels: tuple[Channel, ...]
    speed_dependent: bool = False

    def __post_init__(self) -> None:
        self._freeze(dtype=np.int64, harmonics=("harmonics",))
        self._freeze(dtype=np.complex128, coefficients=(len(self.channels), "hits", len(self.harmonics)))
        shape, rows = self.coefficients.shape, self.coefficients.shape[:2]
        self._freeze(dtype=np.complex128, coefficient_std=shape)
        self._freeze(offset=rows, offset_std=rows, drift=rows, drift_std=rows)
        object.__setattr__(self, "revolution", positive(self.revolution, "revolution", "ForcedResponse", unit="s"))

    @property
    def amplitudes(self) -> Floats:
        """2|F|, the amplitude of each harmonic (channels, hits, harmonics) [units of the channels]."""
        return 2.0 * np.abs(self.coefficients)

    def response(self, angles: ArrayLike) -> Floats:
        """The periodic part, offset included, at angles of the shaft [rad] (channels, hits, angles)."""
        turned = np.exp(1j * np.multiply.outer(self.harmonics, np.atleast_1d(np.asarray(angles, float))))
        return self.offset[:, :, None] + 2.0 * (self.coefficients @ turned).real
