"""The contract of every modal identification: the costly part once, then a model at any order."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar, Self

from floquid._checks import input_error, integer
from floquid.lti._types import ModalModel, Outcome, TimeResponses

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
