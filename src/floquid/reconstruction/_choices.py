"""The choices that `reconstruct` makes itself: to build the same again, of another model of the same modes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from floquid.core import PeriodicModel
from floquid.reconstruction._bands import chosen
from floquid.reconstruction._modal_matrix import shapes_of, terms_of
from floquid.reconstruction._reconstruct import Form, coordinates_of
from floquid.reconstruction._states import Names


def choices(
    model: PeriodicModel, states: Names, *, form: Form = "second-order", delay: float | None = None
) -> tuple[float | None, NDArray[np.bool_] | None]:
    """The delay, and the terms of the estimates, that A(t) is built from with `harmonics="auto"`.

    Parameters
    ----------
    model, states, form, delay
        As `reconstruct` takes them.

    Returns
    -------
    delay
        Of "delayed" [s]; None where no state is one.
    terms
        A mask over the terms of `model.estimates` (terms,); None without estimates.

    Raises
    ------
    InputError
        As `reconstruct`.
    """
    coordinates = coordinates_of(model, states, form, delay)
    later = [part.delay for state in coordinates.states for part in state.parts if part.delay > 0.0]
    found = min(later, default=None) if form == "delayed" else None
    if model.estimates is None:
        return found, None
    own = model.estimates
    return found, chosen(model, shapes_of(model, coordinates, own), terms_of(model, own))
