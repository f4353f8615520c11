"""The poles of lifted responses, with the noise estimated from what they leave."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import EllipsisType

import numpy as np
from numpy.typing import NDArray

from floquid.errors import IdentificationError
from floquid.findings import failure, warning
from floquid.fit import REST, ROUNDS
from floquid.lifting import Lifted, whitened, whitening_filter
from floquid.lti import AbstractIdentifier, MaximumLikelihood, ModalModel, Outcome, fit_residues
from floquid.order import Choice, judge
from floquid.pipeline.free._noise_colour import ALL_PEAKED, dies_away, first_filter, under_a_peak
from floquid.preparation import Settings

ENOUGH_CYCLES = 3  # cycles a pole that a hit must hold for a noise estimate of its own


class UnsettledError(IdentificationError):
    """The residual is no noise: its estimate does not settle, or there are modes without an end."""


def find_poles(
    lifted: Lifted,
    settings: Settings,
    report: Callable[[str], None] = lambda _: None,
    *,
    taps: NDArray[np.float64] | EllipsisType | None = ...,
) -> tuple[Lifted, ModalModel, Choice | None]:
    """Poles and noise together: the noise is taken again from the residual until it stays, and the order is weighed.

    Where the residual of generous poles is coloured along the record, it is whitened (`whitened`) before the search.
    The residual of the poles found is judged again.

    The responses come back with the noise that the fit leaves, whitened where it was coloured along the record; the
    choice of the order is None where the settings fix it. Raises IdentificationError where no mode rises above the
    noise, or the order or the noise cannot be told.

    `lifted` are the responses, with a first estimate of their noise, `settings` the options, and `report` is told of
    each stage. `taps` are the filters that whiten what generous poles leave of the responses (channels, taps), None
    where that is white; found here by default.
    """
    raw, taps = lifted, first_filter(lifted) if isinstance(taps, EllipsisType) else taps
    if settings.order is not None and settings.order >= lifted.responses.lengths.max() - 1:
        taps = None  # the filter takes a period, and the order needs them all
    looks = 0
    while True:
        if taps is not None:
            report(f"the noise is coloured along the record: whitened by {taps.shape[1] - 1} taps")
        lifted, modal = _settled(raw if taps is None else whitened(raw, taps), settings, report)
        looks += 1
        if settings.order is not None:
            # What a given order leaves may be modes: only generous poles tell the colour of the noise then.
            break
        still = whitening_filter(lifted, modal) is not None
        if looks == ROUNDS or not still:
            break
        taps = whitening_filter(raw, fit_residues(modal.multipliers, raw.responses))
    if settings.order is not None:
        return lifted, modal, None
    report("weighing the order")
    choice = judge(lifted.responses, modal)
    peaked = under_a_peak(lifted, modal)
    if peaked.all() and settings.identifier is None and not dies_away(raw):
        raise IdentificationError(ALL_PEAKED)
    if peaked.any():
        choice = replace(choice, findings=(*choice.findings, warning("under_a_peak")))
    return lifted, modal, choice


def _settled(lifted: Lifted, settings: Settings, report: Callable[[str], None]) -> tuple[Lifted, ModalModel]:
    """The poles, and the responses with the noise that they leave."""
    identifier = settings.identifier or MaximumLikelihood(false_alarm=settings.mode_false_alarm)
    modal: ModalModel | None = None
    for _ in range(ROUNDS):
        refined = modal is not None
        state = identifier.prepare(lifted.responses)
        if modal is not None:
            modal = identifier.refine(state, modal)
        else:
            report("searching for modes")
            order = settings.order or _order_for(identifier, lifted, settings, report)
            modal = identifier.extract(state, order, report=lambda text: report(f"searching for modes: {text}"))
        if modal.outcome is not Outcome.SUCCESS:
            words = f"{failure(modal.outcome.value).clause}."
            if modal.outcome is Outcome.ORDER_UNREACHED:
                words = (
                    f"order {settings.order} cannot be reached; the nearest is {modal.order}. The data hold no more "
                    "poles, or a conjugate pair, which counts as two, would be halved. Ask for that order, or let it "
                    "be found."
                )
            kind = UnsettledError if modal.outcome is Outcome.NOT_WHITE else IdentificationError
            raise kind(f"Identification ended without a result: {words}")
        noise = _noise_left(lifted, modal)
        again = lifted.with_noise(noise)
        change = np.abs(np.log(again.noise / lifted.noise)).max()
        lifted = again
        if change > REST:
            modal = None
        elif refined:
            break
    if modal is None:
        raise UnsettledError(
            "Identification ended without a result: the noise cannot be told from the response, its estimate does not "
            "settle as modes are fitted. Look at the record: are its samples clipped, or rounded to a few levels?"
            f"{_order_to_blame(settings.order, int(lifted.responses.lengths.max()))}"
        )
    return lifted, modal


def _order_to_blame(order: int | None, n_cycles: int) -> str:
    """The question whether the order asked for keeps the noise from being told."""
    if order is None:
        return ""
    if n_cycles < ENOUGH_CYCLES * order:
        return f" Or is the order asked for, {order}, too high for {n_cycles} whole periods, which it all but fits?"
    return f" Or is the order asked for, {order}, too low?"


def _order_for(
    identifier: AbstractIdentifier, lifted: Lifted, settings: Settings, report: Callable[[str], None]
) -> int | None:
    """The order for an algorithm that cannot decide it: that of maximum likelihood started from it."""
    if identifier.decides:
        return None
    likelihood = MaximumLikelihood(false_alarm=settings.mode_false_alarm, initial=identifier)
    found = likelihood.extract(likelihood.prepare(lifted.responses), report=report)
    if found.outcome is not Outcome.SUCCESS:
        raise IdentificationError(f"Identification ended without a result: {failure(found.outcome.value).clause}.")
    return found.order


def _noise_left(lifted: Lifted, modal: ModalModel) -> NDArray[np.float64]:
    """The noise in what the fit leaves (channels, hits).

    A hit with hardly more cycles than there are poles leaves nothing to judge its noise by, and would be weighted by
    chance: beside longer ones it is refused.
    """
    assert modal.residual_std is not None
    lengths = lifted.responses.lengths
    long = lengths >= ENOUGH_CYCLES * modal.order
    if long.any() and not long.all():
        short = int(np.argmin(lengths))
        raise IdentificationError(
            f"Hit {short + 1} holds {lengths[short]} whole periods, fewer than {ENOUGH_CYCLES} for each of "
            f"{modal.order} poles. Its noise cannot be estimated beside that of longer hits. Leave it out."
        )
    return np.sqrt(np.mean(lifted.by_channel(modal.residual_std**2), axis=1))
