"""The periodic forced response beside the free one: imbalance, gravity, tower shadow, a limit cycle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Complexes, Floats, Integers
from floquid._checks import Rebuilt, frozen_array, positive
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
        of, put = "ForcedResponse", object.__setattr__
        put(self, "harmonics", frozen_array(self.harmonics, "harmonics", of, axes=("harmonics",), dtype=np.int64))
        shape = (len(self.channels), "hits", len(self.harmonics))
        put(self, "coefficients", frozen_array(self.coefficients, "coefficients", of, axes=shape, dtype=np.complex128))
        shape, rows = self.coefficients.shape, self.coefficients.shape[:2]
        if self.coefficient_std is not None:
            std = frozen_array(self.coefficient_std, "coefficient_std", of, axes=shape, dtype=np.complex128)
            put(self, "coefficient_std", std)
        for name in ("offset", "offset_std", "drift", "drift_std"):
            if getattr(self, name) is not None or not name.endswith("std"):
                put(self, name, frozen_array(getattr(self, name), name, of, axes=rows))
        put(self, "revolution", positive(self.revolution, "revolution", of, unit="s"))

    @property
    def amplitudes(self) -> Floats:
        """2|F|, the amplitude of each harmonic (channels, hits, harmonics) [units of the channels]."""
        return 2.0 * np.abs(self.coefficients)

    def response(self, angles: ArrayLike) -> Floats:
        """The periodic part, offset included, at angles of the shaft [rad] (channels, hits, angles)."""
        turned = np.exp(1j * np.multiply.outer(self.harmonics, np.atleast_1d(np.asarray(angles, float))))
        return self.offset[:, :, None] + 2.0 * (self.coefficients @ turned).real
