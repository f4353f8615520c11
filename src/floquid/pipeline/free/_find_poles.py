"""The poles of lifted responses, with the noise estimated from what they leave."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import EllipsisType

import numpy as np

from floquid._arrays import Floats, Mask
from floquid.errors import IdentificationError
from floquid.findings import failure, warning
from floquid.fit import QUIET, REST, ROUNDS, SURE, chi2_limit
from floquid.lifting import Lifted, whitened, whitening_filter
from floquid.lti import AbstractIdentifier, Ensemble, MaximumLikelihood, ModalModel, Outcome, fit_residues
from floquid.order import Choice, judge, judge_products
from floquid.periodic import generous_poles
from floquid.preparation import Settings

ENOUGH_CYCLES = 3  # cycles a pole that a hit must hold for a noise estimate of its own


class UnsettledError(IdentificationError):
    """The residual is no noise: its estimate does not settle, or there are modes without an end."""


def find_poles(
    lifted: Lifted,
    settings: Settings,
    report: Callable[[str], None] = lambda _: None,
    *,
    taps: Floats | EllipsisType | None = ...,
) -> tuple[Lifted, ModalModel, Choice | None]:
    """Poles and noise together: the noise is taken again from the residual until it stays, and the order is weighed.

    Where the residual of generous poles is coloured along the record, it is whitened (`whitened`) before the search.
    The residual of the poles found is judged again.

    The responses come back with the noise that the fit leaves, whitened where it was coloured along the record; the
    choice of the order is None where the settings fix it. Of a search whose time is over the poles so far are returned,
    and their outcome says so. Raises IdentificationError where no mode rises above the noise, or the order or the noise
    cannot be told.

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
        if settings.order is not None or modal.outcome is Outcome.OUT_OF_TIME:
            # What a given order leaves may be modes: only generous poles tell the colour of the noise then.
            break
        still = whitening_filter(lifted, modal) is not None
        if looks == ROUNDS or not still:
            break
        taps = whitening_filter(raw, fit_residues(modal.multipliers, raw.responses))
    if settings.order is not None:
        return lifted, modal, None
    report("weighing the order")
    if isinstance(settings.identifier, Ensemble):
        return lifted, modal, judge_products(lifted.responses, modal, settings.identifier)
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
    identifier = identifier.bounded(settings.seconds)
    modal: ModalModel | None = None
    for _ in range(ROUNDS):
        refined = modal is not None
        state = identifier.prepare(lifted.responses)
        if modal is not None:
            modal = identifier.refine(state, modal)
        else:
            report("searching for modes")
            order, outcome = settings.order, Outcome.SUCCESS
            if order is None and not identifier.decides:
                order, outcome = _order_for(identifier, lifted, settings, report)
            modal = identifier.extract(state, order, report=lambda text: report(f"searching for modes: {text}"))
            modal = modal if outcome is Outcome.SUCCESS else replace(modal, outcome=outcome)
        late = modal.outcome is Outcome.OUT_OF_TIME and modal.order > 0
        if modal.outcome is not Outcome.SUCCESS and not late:
            words = f"{failure(modal.outcome.value).clause}."
            if modal.outcome is Outcome.ORDER_UNREACHED:
                words = (
                    f"order {settings.order} cannot be reached; the nearest is {modal.order}. The data hold no more "
                    "poles, or a conjugate pair, which counts as two, would be halved. Ask for that order, or let it "
                    "be found."
                )
            endless = modal.outcome in (Outcome.NOT_WHITE, Outcome.TOO_FEW_SAMPLES)
            kind = UnsettledError if endless else IdentificationError
            raise kind(f"Identification ended without a result: {words}")
        noise = _noise_left(lifted, modal, pooled=isinstance(identifier, Ensemble))
        again = lifted.with_noise(noise)
        change = np.abs(np.log(again.noise / lifted.noise)).max()
        lifted = again
        if late or (refined and change <= REST):
            break
        modal = modal if change <= REST else None
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
) -> tuple[int, Outcome]:
    """The order for an algorithm that cannot decide it: that of maximum likelihood started from it, and its outcome."""
    likelihood = MaximumLikelihood(false_alarm=settings.mode_false_alarm, seconds=settings.seconds, initial=identifier)
    found = likelihood.extract(likelihood.prepare(lifted.responses), report=report)
    if found.outcome not in (Outcome.SUCCESS, Outcome.OUT_OF_TIME):
        raise IdentificationError(f"Identification ended without a result: {failure(found.outcome.value).clause}.")
    return found.order, found.outcome


def _noise_left(lifted: Lifted, modal: ModalModel, *, pooled: bool) -> Floats:
    """The noise in what the fit leaves (channels, hits).

    A hit with hardly more cycles than there are poles leaves nothing to judge its noise by, and would be weighted by
    chance: beside longer ones it is refused. `pooled`, it has the noise of all of them.
    """
    assert modal.residual_std is not None
    lengths = lifted.responses.lengths
    long = lengths >= ENOUGH_CYCLES * modal.order
    if pooled and not long.all():
        variances = lifted.by_channel(modal.residual_std**2).mean(axis=1)
        return np.sqrt(np.where(long, variances, np.average(variances, axis=1, weights=lengths)[:, None]))
    if long.any() and not long.all():
        short = int(np.argmin(lengths))
        raise IdentificationError(
            f"Hit {short + 1} holds {lengths[short]} whole periods, fewer than {ENOUGH_CYCLES} for each of "
            f"{modal.order} poles. Its noise cannot be estimated beside that of longer hits. Leave it out."
        )
    return np.sqrt(np.mean(lifted.by_channel(modal.residual_std**2), axis=1))


PEAK = 0.05  # the gain of a filter, over its root sum of squares, below which the noise has a peak


def first_filter(lifted: Lifted) -> Floats | None:
    """The filters that whiten what generous poles leave; None where that is white."""
    return whitening_filter(lifted, generous_poles(lifted))


ALL_PEAKED = (
    "Identification ended without a result: no mode rises above the noise. The candidates hardly decay and lie where "
    "the noise is loudest, as a drift or a peak of the noise does. Use a record with a clear free decay, or start it "
    "closer to the blow. To fit them anyway, give the order (`order=`)."
)


def dies_away(lifted: Lifted) -> bool:
    """True where a response ends far below where it began: a free decay does, noise and drift do not."""
    for hit, length in enumerate(lifted.responses.lengths.tolist()):
        values = lifted.by_channel(lifted.responses.values[:, hit, :length])
        begin = np.abs(values[:, :, : max(length // 4, 1)]).max(axis=(1, 2))
        end = np.sqrt(np.mean(values[:, :, -max(length // 3, 1) :] ** 2, axis=(1, 2)))
        if (begin > np.sqrt(chi2_limit(1, SURE / max(length * lifted.n_phases, 1))) * end).any():
            return True
    return False


def under_a_peak(lifted: Lifted, modal: ModalModel) -> Mask:
    """Mask of modes that hardly decay over the record and lie where the noise had a peak (modes,).

    What a filter leaves of a narrow peak, or of a drift, looks like such a mode. Looked at is the harmonic that is
    largest after the filter, in the channel where it is.
    """
    found = np.zeros(modal.order, bool)
    if lifted.whitening is None:
        return found
    half = lifted.n_phases // 2
    turns = 2j * np.pi / lifted.period * np.arange(-half, half + 1)
    size = np.linalg.norm(lifted.whitening, axis=1)
    for mode, (pole, residues) in enumerate(zip(modal.poles, modal.residues, strict=True)):
        if np.exp(-abs(pole.real) * lifted.period * int(lifted.responses.lengths.max())) < QUIET:
            continue  # it decays to nothing
        shapes = lifted.by_channel(residues) / lifted.noise[:, None, :]
        parts = np.einsum("mk,ckh->cm", np.exp(-np.multiply.outer(pole + turns, lifted.phase_times)), shapes)
        channel, harmonic = np.unravel_index(int(np.argmax(np.abs(parts))), parts.shape)
        found[mode] = np.abs(lifted.gain(pole + turns)[channel, harmonic]) < PEAK * size[channel]
    return found
