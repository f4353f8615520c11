"""Parameters of a user's model before and after they are fitted to results."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from floquid._arrays import Floats
from floquid._checks import Rebuilt, finite, input_error, positive
from floquid._show import Brief, Told

SHARE = 0.3  # of a value, or half of its prior: the deviation from which on nothing was learnt of it


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter(Brief):
    """A parameter of a model before it is fitted.

    Raises InputError where a number is not possible, or the value is zero and there is no prior: nothing tells its
    size.

    Parameters
    ----------
    value
        Where the search starts.
    prior_std
        The deviation of what is known before, about `value`; None where only results count.
    bounds
        The least and the largest value.
    """

    value: float = field(kw_only=False)
    prior_std: float | None = None
    bounds: tuple[float, float] = (-np.inf, np.inf)

    def __post_init__(self) -> None:
        of = "Parameter"
        value = finite(self.value, "value", of)
        object.__setattr__(self, "value", value)
        if self.prior_std is not None:
            object.__setattr__(self, "prior_std", positive(self.prior_std, "prior_std", of))
        elif value == 0.0:
            remedy = "Pass prior_std, how far from zero it may be, or fit another parameter in its place."
            raise input_error("value", of, "have a size, or a prior_std", "is 0", remedy)
        low, high = self.bounds
        if not low <= value <= high:
            raise input_error("value", of, f"lie within its bounds, {low:g} to {high:g}", f"is {value:g}")

    @property
    def limit(self) -> float:
        """The deviation from which on the results do not determine it: half the prior, or 30 % of the value."""
        return SHARE * abs(self.value) if self.prior_std is None else 0.5 * self.prior_std


@dataclass(frozen=True, slots=True, kw_only=True)
class Direction(Rebuilt):
    """A combination of parameters that the results do not determine.

    Parameters
    ----------
    weights
        The step of each parameter along it, those of a tenth of the largest and more, in units of its `limit`.
    std
        Its deviation in such units, above one; infinite where the exponents do not depend on it.
    """

    weights: Mapping[str, float]
    std: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "weights", MappingProxyType(dict(self.weights)))

    def __str__(self) -> str:
        return ", ".join(f"{name} {weight:+.2f}" for name, weight in self.weights.items())


@dataclass(frozen=True, slots=True, kw_only=True)
class Misfit(Rebuilt):
    """The difference that is left of one pair of modes.

    Parameters
    ----------
    point, mode
        The number of the result, and that of its mode, both counted from 0.
    frequency_hz
        The frequency of that mode [Hz].
    z
        The difference over its deviations.
    """

    point: int
    mode: int
    frequency_hz: float
    z: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Updated(Told, Rebuilt):
    r"""Parameters of a model fitted to exponents.

    .. math:: \chi^2 = \sum_{points} d^T \Sigma^{-1} d

    with d the differences of measured exponents and those of the model, Σ the covariance of the measured ones.

    Parameters
    ----------
    values
        The parameters by name; NaN of one that the results do not determine.
    start
        Where the search began, by name.
    covariance
        Their covariance, in the order of `values` (parameters, parameters); NaN where not determined. It is that of the
        errors of the results, not scaled by the misfit.
    chi2, dof, p
        χ² at the end, the number of data, priors counted, less that of determined directions, and the probability that
        χ² is as large by the deviations alone; None where no degree of freedom is left.
    unidentifiable
        Combinations of parameters that the results do not determine: they stay where they began.
    steps
        Steps of the search.
    is_converged
        True where the last step was small beside the deviations.
    used
        Values of all parameters at the end, those that are not determined too, by name.
    misfits
        The difference that is left of each pair.
    warnings
        What a reader must know, a sentence each.
    """

    kind: ClassVar[str] = "update"  # by it the functions for a result are found
    values: Mapping[str, float]
    start: Mapping[str, float]
    covariance: Floats
    chi2: float
    dof: int
    p: float | None
    unidentifiable: tuple[Direction, ...]
    steps: int
    is_converged: bool
    used: Mapping[str, float]
    misfits: tuple[Misfit, ...]
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("values", "start", "used"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))
        count = len(self.values)
        self._freeze(finite=False, covariance=(count, count))

    @property
    def std(self) -> dict[str, float]:
        """The deviations of the parameters by name; NaN of one that is not determined."""
        return dict(zip(self.values, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    @property
    def correlation(self) -> Floats:
        """The correlations of the parameters, in the order of `values` (parameters, parameters)."""
        std = np.sqrt(np.diag(self.covariance))
        return self.covariance / np.outer(std, std)
