"""The fit of free responses, its deviations where it leaves more than noise, and A(t) as the settings ask for it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from floquid import innovations
from floquid._arrays import Complexes
from floquid._show import Brief
from floquid.checks import FAILED
from floquid.core import Cycles, Estimates, PeriodicModel, Record
from floquid.errors import FloquidError, IdentificationError
from floquid.findings import Finding, failure, warning
from floquid.fit import SIGNIFICANT
from floquid.inputs import Uncertainty
from floquid.lifting import Lifted
from floquid.lti import ModalModel
from floquid.order import Choice
from floquid.periodic import Fit, ForcedResponse, Periodicity
from floquid.preparation import Settings, own_names, states_of
from floquid.reconstruction import Refinement, StateModel, reconstruct, refine, structure_of

if TYPE_CHECKING:
    from floquid.pipeline._analysis import Analysis


Driven: TypeAlias = Uncertainty | innovations.Fit
"""A fit of records whose excitation goes on: to measured inputs, or in innovations form."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Decay(Brief):
    """The fit of free responses, and what is seen of them when they are lifted.

    Parameters
    ----------
    fit
        The fit: its model, the forced response beside it, and the free response that is left.
    cycles, lifted, modal
        The free response cut into periods, resampled to whole samples a period where it has none; lifted (and whitened
        along the record where the noise is coloured); and the modal model of the lifted responses.
    choice
        What speaks for the order found and against it; None where the order was given.
    periodicity
        Whether the response is that of a periodic system at all; None where it could not be tested.
    """

    fit: Fit
    cycles: tuple[Cycles, ...]
    lifted: Lifted
    modal: ModalModel
    choice: Choice | None = None
    periodicity: Periodicity | None = None


def fails(found: Fit) -> bool:
    """True where the residual is too many times the noise for a model of the record."""
    return found.misfit is not None and found.misfit >= FAILED


def widening(misfit: float | None, records: Sequence[Record]) -> float:
    """Factor of the deviations from the misfit: 1 where only noise is left, or nothing is known."""
    if misfit is None:
        return 1.0
    fewest = min(int(np.isfinite(record.values).sum(axis=1).min()) for record in records)
    return misfit if misfit > 1.0 + SIGNIFICANT / np.sqrt(max(fewest, 1)) else 1.0


def widening_of(analysis: Analysis) -> float:
    """Factor by which the deviations of an analysis were widened."""
    return widening(analysis.misfit, analysis.responses)


def with_misfit(found: Fit) -> Fit:
    """The fit with deviations wider by its misfit, or with none where the model fails.

    What is left is no noise then, and moves the exponents by more than noise of its size: a deviation would be made up.
    """
    factor, forced = widening(found.misfit, found.free), found.forced
    if factor == 1.0:
        return found
    if fails(found):
        return replace(
            found,
            model=replace(found.model, covariance=None, coefficient_std=None, estimates=None, unselected=None),
            forced=None if forced is None else replace(forced, coefficient_std=None, offset_std=None, drift_std=None),
            period_std=None,
            own_period=None,
        )
    own = found.own_period
    return replace(
        found,
        model=_wider(found.model, factor),
        forced=None if forced is None else _wider_forced(forced, factor),
        period_std=None if found.period_std is None else factor * found.period_std,
        own_period=None if own is None else (own[0], factor * own[1]),
    )


def widened(estimates: Estimates, factor: float) -> Estimates:
    """Estimates with deviations larger by a factor: of the parameters, and of the noise of each row."""
    if factor == 1.0:
        return estimates
    return replace(estimates, covariance=factor**2 * estimates.covariance, spread=factor**2 * estimates.spread)


def model_failure(found: Fit, settings: Settings) -> Finding | None:
    """Finding that the model fails, with what to try; None where it does not."""
    if not fails(found):
        return None
    return failure(
        "model_fails",
        misfit=found.misfit,
        order=settings.order is not None,
        harmonics=settings.harmonics is not None,
        forced=settings.forced == "none",
    )


def _wider(model: PeriodicModel, factor: float) -> PeriodicModel:
    """The model with deviations larger by a factor, its joint covariance likewise."""
    estimates, unselected = (
        None if own is None else widened(own, factor) for own in (model.estimates, model.unselected)
    )
    return replace(
        model,
        covariance=None if model.covariance is None else factor**2 * model.covariance,
        coefficient_std=None if model.coefficient_std is None else factor * model.coefficient_std,
        estimates=estimates,
        unselected=unselected,
    )


def _wider_forced(forced: ForcedResponse, factor: float) -> ForcedResponse:
    """The forced response with deviations larger by a factor."""
    names = ("coefficient_std", "offset_std", "drift_std")
    own = {name: getattr(forced, name) for name in names}
    wider: dict[str, Any] = {name: None if std is None else factor * std for name, std in own.items()}
    return replace(forced, **wider)


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
