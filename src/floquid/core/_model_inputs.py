"""The inputs of a periodic model, and words and limits of options that `Settings` checks."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np

from floquid._arrays import Complexes, Floats, Integers
from floquid._checks import Rebuilt
from floquid.core._channel import Channel
from floquid.core._record import as_channels


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModelInputs(Rebuilt):
    r"""Inputs of a periodic model: how they drive its modes, and what they do to the outputs at once.

    .. math:: \dot z_r = \lambda_r z_r + \sum_{i,l} b_{r,i,l}\, e^{i l \omega t} u_i, \qquad
              y_c = \sum_r \sum_m c_{r,c,m}\, e^{i m \omega t} z_r + \sum_{i,n} D_{c,i,n}\, e^{i n \omega t} u_i

    The scale of each z is free: of b and z at the first samples the part that is largest is 1. Raises InputError where
    a shape is not possible.

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
    initial, begins
        z at the first sample of each record (modes, records), and t there (records,) [s]; zero where not given.
    """

    channels: tuple[Channel, ...]
    coefficients: Complexes
    harmonics: Integers
    coefficient_std: Complexes | None = None
    direct: Complexes
    direct_harmonics: Integers
    initial: Complexes
    begins: Floats = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        object.__setattr__(self, "channels", as_channels(self.channels, "ModelInputs"))
        self._freeze(dtype=np.int64, harmonics=("harmonics",), direct_harmonics=("direct harmonics",))
        number = len(self.channels)
        self._freeze(dtype=np.complex128, coefficients=("modes", number, len(self.harmonics)))
        self._freeze(dtype=np.complex128, coefficient_std=self.coefficients.shape)
        self._freeze(dtype=np.complex128, direct=("outputs", number, len(self.direct_harmonics)))
        self._freeze(dtype=np.complex128, initial=(len(self.coefficients), "records"))
        if not len(self.begins):
            object.__setattr__(self, "begins", np.zeros(self.initial.shape[1]))
        self._freeze(begins=self.initial.shape[1:])


Hold: TypeAlias = Literal["zero", "first", "none"]
"""The input between its samples: held, linear, or acting at the samples alone."""

Form: TypeAlias = Literal["second-order", "first-order", "delayed"]
"""States of A(t) beside those that were named: their derivatives, none, or later samples of them."""

MOST_TIMES = 10_000
"""Instants of a period at most, where a number of them is asked for."""
