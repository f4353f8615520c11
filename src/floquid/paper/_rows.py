"""All rows of the table."""

from __future__ import annotations

from floquid.paper._experiment import Reproduction
from floquid.paper._numbers import Number
from floquid.paper._rows_response import rows_of_response
from floquid.paper._rows_setup import rows_of_setup
from floquid.paper._rows_system import rows_of_system


def numbers(reproduction: Reproduction) -> tuple[Number, ...]:
    """Every number of section 3 of Allen 2009, ours beside it, with the corrections.

    Parameters
    ----------
    reproduction
        What `reproduce` gave.

    Returns
    -------
    tuple of Number
        In the paper's order.
    """
    return (*rows_of_setup(reproduction), *rows_of_response(reproduction), *rows_of_system(reproduction))
