"""Results of a scan over orders."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from floquid._arrays import Floats, Integers
from floquid._checks import Rebuilt, frozen_array, input_error, integer, positive
from floquid._show import Drawings, Drawn, Told
from floquid.lti import ModalModel


class Stability(IntEnum):
    """Agreement of a pole with one of the next lower order; each level holds those before it."""

    NEW = 0
    FREQUENCY = 1
    DAMPING = 2
    SHAPE = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Tolerances:
    """Tolerances within which poles of neighbouring orders count as one.

    Raises InputError where a tolerance is not between 0 and 1.

    Parameters
    ----------
    frequency
        The largest difference of the frequencies, as a share of the sampling frequency (of lifted responses: of the
        fundamental). Not of the frequency itself: where the band folds, zero is no special place.
    damping
        The largest relative difference of the decays; also the share of its decay that the frequency of a heavily
        damped mode may differ by, in radians.
    decay
        The difference of decays that counts as none [neper/sample], for modes with hardly any damping.
    shape
        The least MAC of the noise-weighted residues.
    """

    frequency: float = 0.002
    damping: float = 0.05
    decay: float = 5e-4
    shape: float = 0.95

    def __post_init__(self) -> None:
        for name in ("frequency", "damping", "decay", "shape"):
            value = positive(getattr(self, name), name, "Tolerances")
            if value >= 1.0:
                raise input_error(name, "Tolerances", "lie between 0 and 1", f"is {value:g}")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Criteria(Rebuilt):
    """Fit of each order, whatever found its poles: the residues are those that leave least.

    Parameters
    ----------
    cost
        The sum of squares left, over the noise (orders,) [-].
    left
        The share of the data's sum of squares over the noise that is left (orders,) [-].
    aic, bic
        Akaike's and the Bayesian information criterion (orders,) [-]; lower is better.
    degrees
        The numbers fitted less the parameters of the fit (orders,); the cost of a right model is about as large.
    """

    cost: Floats
    left: Floats
    aic: Floats
    bic: Floats
    degrees: Integers

    def __post_init__(self) -> None:
        self._freeze(cost=("orders",))
        orders = (len(self.cost),)
        self._freeze(left=orders, aic=orders, bic=orders)
        self._freeze(dtype=np.int64, degrees=orders)

    @property
    def misfit(self) -> Floats:
        """The cost over its degrees of freedom (orders,) [-]: 1 where white noise alone is left; NaN without any."""
        return np.divide(self.cost, self.degrees, out=np.full(len(self.cost), np.nan), where=self.degrees > 0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Indicators(Rebuilt):
    """Indications of the number of modes before any model is fitted.

    Parameters
    ----------
    angles
        The lines (lines,) [rad/sample], 0 to π.
    dt
        The sampling interval [s].
    cmif
        The singular values of the spectral matrix at each line, descending (lines, curves), over the largest that white
        noise alone is expected to have [-].
    smoothing
        How many adjacent lines are looked at together.
    composite
        The mean magnitude of the spectra over the noise (lines,) [-]; white noise alone has `lti.WHITE`.
    residual
        The same of what a model leaves (lines,); None without a model.
    singular_values
        Of the responses over their noise, with `delays` samples in turn as rows of their own, descending (values,) [-].
    noise_edge
        The largest singular value that white noise alone has [-].
    delays
        The number of delays; with 1, the squares are the eigenvalues of the Gram matrix of the responses.
    """

    angles: Floats
    dt: float
    cmif: Floats
    smoothing: int
    composite: Floats
    residual: Floats | None = None
    singular_values: Floats
    noise_edge: float
    delays: int

    def __post_init__(self) -> None:
        of = "Indicators"
        self._freeze(angles=("lines",), singular_values=("values",))
        lines = len(self.angles)
        self._freeze(cmif=(lines, "curves"), composite=(lines,), residual=(lines,))
        for name, unit in (("dt", "s"), ("noise_edge", "")):
            object.__setattr__(self, name, positive(getattr(self, name), name, of, unit=unit))
        integer(self.smoothing, "smoothing", of, at_least=1)
        integer(self.delays, "delays", of, at_least=1)

    @property
    def n_above(self) -> int:
        """Number of singular values above the noise: the least number of poles."""
        return int((self.singular_values > self.noise_edge).sum())


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OrderScan(Told, Drawn, Rebuilt):
    """The models of several orders, and which of their poles stay from one to the next.

    Parameters
    ----------
    orders
        The orders asked for, ascending (orders,).
    models
        The model of each; its `outcome` says whether the order was reached. The residues are those of the principal
        responses (`lti.compress`), in units of the noise; `lti.fit_residues` gives those of the responses themselves.
    stable
        For each order the `Stability` of each of its poles (modes,), against the next lower order that was reached.
    criteria
        How well each order fits.
    indicators
        What can be seen without a model.
    tolerances
        When poles counted as one.
    """

    orders: tuple[int, ...]
    models: tuple[ModalModel, ...]
    stable: tuple[Integers, ...]
    criteria: Criteria
    indicators: Indicators
    tolerances: Tolerances

    def __post_init__(self) -> None:
        of, number = "OrderScan", len(self.orders)
        for name in ("models", "stable", "criteria"):
            held = len(self.criteria.cost) if name == "criteria" else len(getattr(self, name))
            if held != number:
                raise input_error(name, of, f"hold one entry for each of the {number} orders", f"holds {held}")
        levels = tuple(
            frozen_array(flags, "stable", of, axes=(model.order,), dtype=np.int64)
            for flags, model in zip(self.stable, self.models, strict=True)
        )
        object.__setattr__(self, "stable", levels)

    def _figures(self) -> Drawings:
        return {"stabilisation": (self, {}), "indicators": (self.indicators, {})}

    @property
    def n_stable(self) -> Integers:
        """The number of poles of each order that agree in frequency, damping and shape (orders,)."""
        return np.array([int((flags == Stability.SHAPE).sum()) for flags in self.stable], dtype=np.int64)
