"""The joint covariance of a fit with inputs."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from floquid._checks import Rebuilt
from floquid.inputs._samples import Samples
from floquid.inputs._solver import Linearisation, covariance, slopes_of, state_slopes


@dataclass(frozen=True, eq=False)
class Uncertainty(Rebuilt):
    """Joint covariance of a fit: of its free parameters, and of what is linear in each channel.

    An error of coefficients is that of the parameters by slopes, and that of the channel's own noise.
    """

    samples: Samples
    at: Linearisation

    def __post_init__(self) -> None:
        for one in (self.samples, self.at, *self.at.modes):
            sealed(one)

    @cached_property
    def parameters(self) -> NDArray[np.float64]:
        """Covariance of the free parameters (parameters, parameters)."""
        return covariance(self.samples, self.at)

    @cached_property
    def slopes(self) -> NDArray[np.float64]:
        """Derivatives of the linear coefficients by the free parameters (channels, columns, parameters)."""
        states = state_slopes(self.samples, self.at)
        return np.array(
            [
                -self.at.inverse @ (self.at.columns @ slopes_of(self.samples, self.at, channel, states).T)
                for channel in range(len(self.samples.values))
            ]
        )

    def variance(self, channel: int, by_parameters: NDArray, by_columns: NDArray) -> NDArray[np.float64]:
        """The variance of real quantities of one channel, by (quantities, parameters) and (quantities, columns)."""
        whole = by_parameters + by_columns @ self.slopes[channel]
        own = np.sum((by_columns @ self.at.inverse) * by_columns, axis=1) * self.at.noise[channel] ** 2
        return np.maximum(np.sum((whole @ self.parameters) * whole, axis=1) + own, 0.0)

    @cached_property
    def places(self) -> list[tuple[slice, NDArray[np.bool_]]]:
        """Of each mode, the place of its parameters, and the mask of those that are free."""
        found, place = [], 0
        for mode in self.at.modes:
            stop = place + int(mode.free.sum())
            found.append((slice(place, stop), mode.free))
            place = stop
        return found

    def spread_over(self, number: int, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Rows of numbers, one a parameter of a mode free or not, among the free ones of all (rows, parameters)."""
        found = np.zeros((len(values), len(self.parameters)))
        place, free = self.places[number]
        found[:, place] = values[:, free]
        return found


def sealed(one: Any) -> None:
    """Make the arrays of an object read-only: from here on they are a result."""
    for field in fields(one):
        value = getattr(one, field.name)
        for array in value if isinstance(value, tuple) else (value,):
            if isinstance(array, np.ndarray):
                array.flags.writeable = False
