"""The way that measured inputs reach the modes and the outputs of a model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from floquid._checks import Rebuilt, frozen_array
from floquid.core._channel import Channel
from floquid.core._record import as_channels


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModelInputs(Rebuilt):
    r"""Inputs of a periodic model: how they drive its modes, and what they do to the outputs at once.

    .. math:: \dot z_r = \lambda_r z_r + \sum_{i,l} b_{r,i,l}\, e^{i l \omega t} u_i, \qquad
              y_c = \sum_r \sum_m c_{r,c,m}\, e^{i m \omega t} z_r + \sum_{i,n} D_{c,i,n}\, e^{i n \omega t} u_i

    The scale of each z is free: of b and z at the first samples the part that is largest is 1.

    Parameters
    ----------
    channels
        One `Channel` an input.
    coefficients
        b (modes, inputs, harmonics) [1/s over the units of the inputs].
    harmonics
        The integers l, ascending (harmonics,).
    coefficient_std
        The deviations of b, that of the real part as the real part (modes, inputs, harmonics); None if not estimated.
    direct, direct_harmonics
        D (outputs, inputs, direct harmonics) [units of the outputs over those of the inputs], and the integers n,
        ascending (direct harmonics,); empty without a direct term.
    initial
        z at the first sample of each record (modes, records).

    Raises
    ------
    InputError
        A shape is not possible.
    """

    channels: tuple[Channel, ...]
    coefficients: NDArray[np.complex128]
    harmonics: NDArray[np.int64]
    coefficient_std: NDArray[np.complex128] | None = None
    direct: NDArray[np.complex128]
    direct_harmonics: NDArray[np.int64]
    initial: NDArray[np.complex128]

    def __post_init__(self) -> None:
        of, put = "ModelInputs", object.__setattr__
        named: Sequence[Channel] = as_channels(self.channels, of)
        put(self, "channels", named)
        put(self, "harmonics", frozen_array(self.harmonics, "harmonics", of, axes=("harmonics",), dtype=np.int64))
        own = frozen_array(self.direct_harmonics, "direct_harmonics", of, axes=("direct harmonics",), dtype=np.int64)
        put(self, "direct_harmonics", own)
        axes = ("modes", len(named), len(self.harmonics))
        put(self, "coefficients", frozen_array(self.coefficients, "coefficients", of, axes=axes, dtype=np.complex128))
        if self.coefficient_std is not None:
            std = frozen_array(
                self.coefficient_std, "coefficient_std", of, axes=self.coefficients.shape, dtype=np.complex128
            )
            put(self, "coefficient_std", std)
        axes = ("outputs", len(named), len(own))
        put(self, "direct", frozen_array(self.direct, "direct", of, axes=axes, dtype=np.complex128))
        axes = (len(self.coefficients), "records")
        put(self, "initial", frozen_array(self.initial, "initial", of, axes=axes, dtype=np.complex128))
