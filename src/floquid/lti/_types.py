"""Input and output of a modal identification, and the contract of every one. Anonymous: no channels, no periods."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from types import MappingProxyType
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Complexes, Floats, Integers
from floquid._checks import Rebuilt, frozen_array, input_error, integer, positive

PRODUCTS = "outer products"  # among the `stats` of a model whose residues were fitted as such


class Outcome(Enum):
    """Ends of an identification; the value is the code of a finding that says what it means and what to do."""

    SUCCESS = "poles_found"
    NO_MODE = "no_mode"
    TOO_FEW_SAMPLES = "too_few_samples"
    NOT_WHITE = "modes_without_end"
    ORDER_UNREACHED = "order_unreached"
    OUT_OF_TIME = "poles_without_end"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TimeResponses(Rebuilt):
    """Free responses of one LTI system, sampled together.

    Raises InputError where a shape is not possible, a value is not finite, or a standard deviation is not positive.

    Parameters
    ----------
    values
        The responses (outputs, inputs, samples); an input is an initial condition. Samples beyond an input's length
        are not looked at.
    dt
        The sampling interval [s].
    noise
        The standard deviation of the white noise on each response (outputs, inputs); 1 where not given.
    lengths
        The number of samples of each input (inputs,); all of them where not given.
    taken
        Functions of time that were taken off every response, so that no noise is left along them (samples, functions);
        None where nothing was.
    """

    values: Floats
    dt: float
    noise: Floats
    lengths: Integers
    taken: Floats | None

    def __init__(
        self,
        *,
        values: ArrayLike,
        dt: float,
        noise: ArrayLike | None = None,
        lengths: ArrayLike | None = None,
        taken: ArrayLike | None = None,
    ) -> None:
        of = "TimeResponses"
        array = frozen_array(values, "values", of, axes=("outputs", "inputs", "samples"))
        outputs, inputs, samples = array.shape
        if array.size == 0:
            raise input_error("values", of, "hold at least one output, input and sample", f"has shape {array.shape}")
        std = frozen_array(np.ones((outputs, inputs)) if noise is None else noise, "noise", of, axes=(outputs, inputs))
        if not (std > 0).all():
            got = f"has {std.min():g}"
            raise input_error("noise", of, "be positive", got, "Leave out responses that are constant.")
        ends = np.full(inputs, samples) if lengths is None else lengths
        ends = frozen_array(ends, "lengths", of, axes=(inputs,), dtype=np.int64)
        if (ends < 1).any() or (ends > samples).any():
            raise input_error("lengths", of, f"lie in 1 to {samples}", f"is {ends.tolist()}")
        put = object.__setattr__
        put(self, "values", array)
        put(self, "dt", positive(dt, "dt", of, unit="s"))
        put(self, "noise", std)
        put(self, "lengths", ends)
        off = None if taken is None else frozen_array(taken, "taken", of, axes=(samples, "functions"))
        put(self, "taken", off)

    @property
    def n_outputs(self) -> int:
        """The number of outputs."""
        return self.values.shape[0]

    @property
    def n_inputs(self) -> int:
        """The number of inputs (initial conditions)."""
        return self.values.shape[1]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Composites(Rebuilt):
    """Mean magnitudes of the spectra of all responses over their noise; on white noise alone, `WHITE`.

    Parameters
    ----------
    angles
        The lines (lines,) [rad/sample], 0 to π.
    data, model, difference
        The composites of the data, of the model and of what the model leaves (lines,) [-].
    """

    angles: Floats
    data: Floats
    model: Floats
    difference: Floats

    def __post_init__(self) -> None:
        self._freeze(angles=("lines",))
        lines = (len(self.angles),)
        self._freeze(data=lines, model=lines, difference=lines)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OuterProducts(Rebuilt):
    r"""Residues as outer products of shapes, one of all inputs, and participations; and the errors of both.

    .. math:: R_{r,o,i} = \psi_{ro}\, l_{ri}, \qquad \mathrm{cov}\, \psi_o = \sum_i \sigma_{oi}^2 S_i, \qquad
              \delta\psi = -\sum_i H_i\, \mathrm{diag}(\delta l_i)\, \psi

    with σ the noise of each output and input, S for known poles and participations. Errors of a shape are the same in
    all inputs, and not independent as those of free residues are.

    Parameters
    ----------
    shares
        l (modes, inputs).
    spread
        S (inputs, modes, modes).
    slope
        H (inputs, modes, modes).
    covariance
        Of the poles [1/s] and the shares, each real parts, then imaginary parts: poles first, then each input
        (2 modes (1 + inputs), 2 modes (1 + inputs)).
    """

    shares: Complexes
    spread: Complexes
    slope: Complexes
    covariance: Floats

    def __post_init__(self) -> None:
        self._freeze(dtype=np.complex128, shares=("modes", "inputs"))
        modes, inputs = self.shares.shape
        self._freeze(dtype=np.complex128, spread=(inputs, modes, modes), slope=(inputs, modes, modes))
        self._freeze(covariance=(2 * modes * (1 + inputs),) * 2)

    def picked(self, order: Sequence[int]) -> OuterProducts:
        """Modes in another order."""
        modes, inputs = self.shares.shape
        pick = np.ix_(range(inputs), order, order)
        places = np.add.outer(modes * np.arange(2 * (1 + inputs)), order).ravel()
        covariance = self.covariance[np.ix_(places, places)]
        return OuterProducts(
            shares=self.shares[order], spread=self.spread[pick], slope=self.slope[pick], covariance=covariance
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModalModel(Rebuilt):
    r"""Poles and residues of a free response sampled at `dt`.

    .. math:: y_{oi}[k] = \sum_r R_{r,o,i}\, \mu_r^k, \qquad \mu_r = e^{\lambda_r\, dt}

    The multipliers are the estimate: a real negative one is exactly real. `poles` are their principal logarithms.

    Parameters
    ----------
    multipliers
        μ (modes,), conjugates next to each other and counted one by one.
    residues
        R (modes, outputs, inputs) [units of the responses].
    dt
        The sampling interval [s].
    covariance
        Of the poles (2 modes, 2 modes): real parts, then imaginary parts [1/s²]; None if not estimated.
    residue_spread
        E⁺E⁺ᴴ (inputs, modes, modes): the covariance of the residues for unit noise and known poles. That of output o
        and input i is `noise[o, i]**2 * residue_spread[i]`. None if not estimated.
    residue_slope
        G (inputs, modes, modes): an error δs of ln μ moves the residues by -G diag(δs) R. None if not estimated.
    residual_std
        The standard deviation of what is left (outputs, inputs), corrected for the parameters used.
    outcome
        How the identification ended.
    stats
        Numbers about the fit.
    composites
        The composites of the data, of the model and of their difference, where the algorithm works with them.
    products
        Shapes and participations with their errors, where residues were fitted as outer products; a file does not keep
        them.
    """

    multipliers: Complexes
    residues: Complexes
    dt: float
    covariance: Floats | None = None
    residue_spread: Complexes | None = None
    residue_slope: Complexes | None = None
    residual_std: Floats | None = None
    outcome: Outcome = Outcome.SUCCESS
    stats: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    composites: Composites | None = None
    products: OuterProducts | None = None

    def __post_init__(self) -> None:
        self._freeze(dtype=np.complex128, multipliers=("modes",))
        n, put = self.order, object.__setattr__
        square = ("inputs", n, n)
        self._freeze(
            dtype=np.complex128, residues=(n, "outputs", "inputs"), residue_spread=square, residue_slope=square
        )
        self._freeze(covariance=(2 * n, 2 * n), residual_std=("outputs", "inputs"))
        put(self, "dt", positive(self.dt, "dt", "ModalModel", unit="s"))
        put(self, "stats", MappingProxyType(dict(self.stats)))

    @property
    def outer_products(self) -> bool:
        """True where the residues were fitted as outer products of shape and input, so that poles may be equal."""
        return PRODUCTS in self.stats

    @property
    def order(self) -> int:
        """The number of poles, one by one."""
        return len(self.multipliers)

    @property
    def poles(self) -> Complexes:
        """The principal poles ln μ / dt (modes,) [1/s], -π/dt < Im ≤ π/dt."""
        return np.asarray(np.log(self.multipliers) / self.dt, dtype=np.complex128)


Report = Callable[[str], None]  # a function that is told of each stage


def silent(_: str) -> None:
    """Tell nobody."""


class AbstractIdentifier(ABC):
    """One algorithm with its options as fields. Implementations are final, frozen and stateless.

    Attributes
    ----------
    decides
        True where the algorithm finds the order; one that does not refuses `extract(state, None)`.
    """

    __slots__ = ()
    decides: ClassVar[bool]

    @abstractmethod
    def prepare(self, data: TimeResponses) -> Any:
        """Do what does not depend on the order, once for the responses `data`.

        What it returns is of a type of the algorithm's own, and is what `extract` and `refine` start from.
        """

    @abstractmethod
    def extract(self, state: Any, order: int | None = None, *, report: Report = silent) -> ModalModel:
        """The model of one order.

        Its `outcome` says how it ended. Raises InputError where `order` is not a positive integer below the number of
        samples, or None where the algorithm cannot decide. `state` is what `prepare` returned; `report` is told of each
        stage. `order` is the number of poles, conjugates one by one; None lets an algorithm that decides find it.
        """

    def of_order(self, order: int) -> Self:
        """The algorithm with options that follow from an `order` to be scanned and were not given; itself if none."""
        del order
        return self

    def bounded(self, seconds: float) -> Self:
        """The algorithm with a search of `seconds` of a processor [s] at most; itself if it has none."""
        del seconds
        return self

    def refine(self, state: Any, model: ModalModel) -> ModalModel:
        """The model, of the data in `state`, of the same order as `model` and nearest to it.

        The data or their noise may be others than those of `model`. An algorithm that cannot start anywhere extracts
        a model of its order: this method does so, for algorithms without one of their own.
        """
        return self.extract(state, model.order) if model.order else model


def checked_order(order: int | None, identifier: AbstractIdentifier, data: TimeResponses) -> int | None:
    """The `order` that the `extract` of an `identifier` was given, if `data` could hold it; else an `InputError`."""
    name, samples = type(identifier).__name__, int(data.lengths.max())
    of = f"{name}.extract"
    if order is None:
        if not identifier.decides:
            remedy = f"Pass a number, or wrap it: MaximumLikelihood(initial={name}()) finds the order by test."
            raise input_error("order", of, "be a number of poles: this algorithm cannot decide it", "is None", remedy)
        return None
    if integer(order, "order", of, at_least=1) >= samples:
        remedy = "Record more samples, or ask for fewer poles."
        raise input_error("order", of, f"be less than the {samples} samples", f"is {order}", remedy)
    return order


def given_order(order: int | None, identifier: AbstractIdentifier, data: TimeResponses) -> int:
    """The order as `checked_order`, for an algorithm that cannot decide it."""
    number = checked_order(order, identifier, data)
    assert number is not None
    return number


def reached(order: int | None, found: int) -> Outcome:
    """The outcome of an order asked for and the one got."""
    return Outcome.SUCCESS if order is None or found == order else Outcome.ORDER_UNREACHED
