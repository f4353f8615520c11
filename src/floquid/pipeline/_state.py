"""From the model to A(t), as the settings ask for it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from floquid._arrays import Complexes
from floquid.core import Estimates, PeriodicModel
from floquid.errors import FloquidError, IdentificationError
from floquid.findings import warning
from floquid.pipeline._analysis import Analysis
from floquid.preparation import Settings, own_names, states_of
from floquid.reconstruction import Refinement, StateModel, reconstruct, refine, structure_of

Again = Callable[[Complexes], Estimates]


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


def with_state(analysis: Analysis, again: Again, report: Callable[[str], None]) -> Analysis:
    """The result with A(t) in the states of its settings; a finding says why where there is none."""
    settings = analysis.settings
    if not settings.states:
        return analysis
    if analysis.failed and settings.structure:
        why = "A structure is fitted by the deviations of the model, and one that fails has none to quote."
        return replace(analysis, findings=(*analysis.findings, warning("states_unfit", reason=why)))
    try:
        with own_names("identify"):
            state, refinement = state_of(analysis.model, settings, again, report)
    except FloquidError as error:  # how many states the modes need was not known before the search
        missing = warning("states_unfit", reason=str(error).splitlines()[0])
        return replace(analysis, findings=(*analysis.findings, missing))
    if analysis.failed and state is not None:  # what the model leaves is no noise
        state = state.without_deviations()
    return replace(analysis, state=state, refinement=refinement)
