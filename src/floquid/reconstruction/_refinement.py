"""The result of fitting a structured equation of motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from floquid._checks import Rebuilt, frozen_array
from floquid.reconstruction._state_model import StateModel
from floquid.reconstruction._structure import AbstractStructure


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Refinement(Rebuilt):
    """A state matrix of given structure, fitted to all that a record says.

    Parameters
    ----------
    state
        Φ and A(t) with their deviations.
    structure
        The structure.
    parameters
        Its parameters (parameters,), in the units of the blocks.
    names
        What each parameter is: stiffness[0,1] cos 2 (parameters,).
    covariance
        Of the parameters (parameters, parameters).
    exponents
        The Floquet exponents of A(t), as the response model lists them (modes,) [1/s].
    exponent_std
        Their deviations (modes,) [1/s].
    chi_square, degrees
        What is left between the structure and the free model, and its degrees of freedom.
    p_value
        The probability of as much or more under the right structure.
    reasons
        How the structure was found, a sentence each; empty where it was given.
    """

    state: StateModel
    structure: AbstractStructure
    parameters: NDArray[np.float64]
    names: tuple[str, ...]
    covariance: NDArray[np.float64]
    exponents: NDArray[np.complex128]
    exponent_std: NDArray[np.complex128]
    chi_square: float
    degrees: int
    p_value: float
    reasons: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        of, n = "Refinement", len(self.names)
        for name, axes, dtype in (
            ("parameters", (n,), np.float64),
            ("covariance", (n, n), np.float64),
            ("exponents", ("modes",), np.complex128),
            ("exponent_std", (len(self.exponents),), np.complex128),
        ):
            object.__setattr__(self, name, frozen_array(getattr(self, name), name, of, axes=axes, dtype=dtype))

    @property
    def std(self) -> NDArray[np.float64]:
        """The deviations of the parameters (parameters,)."""
        return np.sqrt(np.diag(self.covariance))
