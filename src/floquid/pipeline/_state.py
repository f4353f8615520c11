"""From the model to A(t), as the settings ask for it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from floquid.core import Estimates, PeriodicModel
from floquid.errors import IdentificationError
from floquid.preparation import Settings, states_of
from floquid.reconstruction import Refinement, StateModel, reconstruct, refine, structure_of

Again = Callable[[NDArray[np.complex128]], Estimates]


def state_of(
    model: PeriodicModel,
    settings: Settings,
    again: Again,
    report: Callable[[str], None],
    *,
    held: bool = False,
    refuse: float | None = None,
) -> tuple[StateModel | None, Refinement | None]:
    """A(t) in the states of the settings, and its fit where it has a structure; None where these are not asked for.

    `again` linearises the records anew at exponents (`floquid.periodic.estimate_at`); with `held`, the free A(t) is
    built from the harmonics of the model in any case.

    Raises InputError where the states cannot span the modes, IdentificationError where the structure contradicts the
    data, or there is nothing that it could be fitted to.
    """
    if not settings.states:
        return None, None
    names = states_of(model.channels, settings)
    report("rebuilding the state matrix")
    if not settings.structure:
        free = reconstruct(
            model,
            names,
            form=settings.form,  # type: ignore[arg-type]
            delay=settings.delay,
            harmonics="auto" if settings.harmonics is None and not held else "model",
            times=settings.system_times,
        )
        return free, None
    if model.unselected is None and model.estimates is None:
        raise IdentificationError(
            "A(t) with a structure needs the joint covariance of the coefficients, and this fit has none.\n  Use "
            "maximum likelihood with `constrained=True`, the defaults, or leave `structure=` out."
        )
    found = refine(
        model,
        names,
        structure_of(settings.structure),
        times=settings.system_times,
        again=again if settings.output_error else None,
        report=report,
        **({} if refuse is None else {"refuse": refuse}),
    )
    return found.state, found
