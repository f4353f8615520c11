"""What every identifier does with the order it is asked for."""

from __future__ import annotations

from floquid._checks import input_error, integer
from floquid.lti._identifier import AbstractIdentifier
from floquid.lti._types import Outcome, TimeResponses


def checked_order(order: int | None, identifier: AbstractIdentifier, data: TimeResponses) -> int | None:
    """The order if the data could hold it.

    Parameters
    ----------
    order
        What `extract` was given.
    identifier
        Whose `extract` it is.
    data
        The responses.

    Returns
    -------
    int or None
        `order`.

    Raises
    ------
    InputError
        It is not a positive integer below the number of samples, or None where the algorithm cannot decide.
    """
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


def reached(order: int | None, found: int) -> Outcome:
    """The outcome of an order asked for and the one got."""
    return Outcome.SUCCESS if order is None or found == order else Outcome.ORDER_UNREACHED
