"""The chain for outputs alone: excitation that goes on and that nobody measured, beside measured inputs or without."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from floquid._arrays import Floats, Mask
from floquid._checks import input_error
from floquid.checks import Ambient, Parted, first_part, without_last
from floquid.core import Provenance, Record
from floquid.errors import IdentificationError
from floquid.findings import Finding, failure, warning
from floquid.fit import HALF_DIGITS
from floquid.innovations import (
    CLEARLY,
    Fit,
    Mode,
    Predictor,
    colour,
    first_innovations,
    predicted,
    repetition,
    reweighed,
    searched,
    sized,
    solve,
)
from floquid.inputs import InputMode, Samples, Uncertainty, columns_at, linearise
from floquid.inputs import solve as solve_driven
from floquid.pipeline._analysis import Analysis
from floquid.pipeline.excited._identify import finished, limits_of, unchecked
from floquid.preparation import Prepared, Settings, blas_threads, parted

OF = "identify"


def identified_ambient(prepared: Prepared, report: Callable[[str], None]) -> Analysis:
    r"""Identify from the response to random excitation that nobody measured, of records with their clocks on.

    .. math:: z_{r,k+1} = e^{\lambda_r h} z_{r,k} + \kappa_r(t_k)\, e_k \;[+\; \beta_r(t_k)\, u_k], \qquad
              y_k = \sum_r \sum_m c_{r,m}\, e^{i m \omega t_k} z_{r,k} + e_k

    the innovations form, with e white: process noise and that of sensors together (Ljung 1999, section 4.3). First
    innovations are those of a long periodic autoregression (Hannan and Rissanen 1982); candidates for λ come from a
    subspace method with them as inputs, modes and harmonics are decided by tests, and all is finished by maximum
    likelihood. With `inputs` the same chain takes process noise and a closed loop into account.

    Raises InputError where the records, the inputs or the clock are not possible, IdentificationError where no mode
    rises above the noise.
    """
    own, settings = prepared.parted, prepared.settings
    assert own is not None
    if settings.inputs and settings.hold == "first":
        remedy = "In discrete time an input acts from its sample to the next: use hold='zero', and sample faster."
        raise input_error("hold", OF, "be 'zero' or 'none' with random excitation", "is 'first'", remedy)
    samples, acting = with_acting(own)
    phases = 2.0 * np.pi / (samples.fundamental * samples.step)
    other, repeats = (0.0, ()) if own.shafts else _other_period(samples, trusted=settings.trust_period)
    limits = limits_of(settings, phases)
    report("taking first innovations from an autoregression")
    first = first_innovations(samples, acting)
    _refuse_copies(first, own)
    report("searching for modes")
    near, unfinished = searched(samples, first, limits, report)
    found = near.at
    late = (warning("out_of_time", seconds=settings.seconds),) if unfinished else ()
    if not found.modes:
        raise no_mode(samples, found, limits.mode_alarm, late)
    report("estimating deviations")
    fit = _sized(Fit(samples, found, acting))
    provenance = Provenance.merge(tuple(record.provenance for record in own.records))
    model = fit.model(own.outputs, own.inputs, provenance, near.as_read)
    analysis = unchecked(prepared, model, fit, (*repeats, *near.findings), late)
    asked = {"own": own, "model": model, "limits": limits, "turning": settings.forced == "auto"}
    return finished(analysis, Ambient(**asked, fit=fit, other=other, as_read=near.as_read), report)


def _refuse_copies(first: Floats, own: Parted) -> None:
    """Refuse outputs that are sums of others: they have no innovations of their own."""
    spread = np.linalg.eigvalsh(np.corrcoef(first).reshape(len(first), -1))
    if spread[0] < HALF_DIGITS:
        names = ", ".join(repr(channel.name) for channel in own.outputs)
        raise IdentificationError(
            f"One of the outputs {names} is a copy or a sum of others, without noise of its own. Their innovations are "
            "not independent. Leave it out: `channels=`."
        )


def _other_period(samples: Samples, *, trusted: bool) -> tuple[float, tuple[Finding, ...]]:
    """The frequency far from that given with which the response seems to repeat [rad/s], zero where none."""
    found, given = repetition(samples), 2.0 * np.pi / samples.fundamental
    told: tuple[Finding, ...] = ()
    if found.own > found.limit and found.own > CLEARLY * found.given and abs(found.shift) > found.resolution:
        scores = (found.own, found.given, found.limit)
        told = (failure("wrong_period", own=given * (1.0 + found.shift), given=given, scores=scores),)
    elif found.even > 2.0 * found.limit and found.odd < found.limit:
        told = (failure("period_twice", given=given, even=found.even, odd=found.odd, limit=found.limit),)
    if told and not trusted:
        raise IdentificationError(f"{told[0]} If you know the period to be right, pass `trust_period=True`.")
    return found.other, told


def no_mode(samples: Samples, found: Predictor, alarm: float, late: Sequence[Finding]) -> IdentificationError:
    """The refusal of outputs alone without a mode: they are white, no mode fits their colour, or time was over."""
    begin, (share, chance) = "Identification ended without a result:", colour(samples, found)
    if chance > alarm:
        return IdentificationError(
            f"{begin} no mode rises above the noise. The response is white, or the record is too short: damping that "
            "is random excitation's alone needs hundreds of periods."
        )
    if late:
        return IdentificationError(f"{begin} {late[0].clause}.")
    return IdentificationError(
        f"{begin} the {len(samples.values)} outputs are not white (squared correlations sum to {share:.2g}), and no "
        "mode could be fitted to them. Name fewer outputs (`channels=`), or measure for longer."
    )


def driven_fit(
    records: Sequence[Record], settings: Settings, modes: Sequence[InputMode], direct: Sequence[float]
) -> Uncertainty:
    """The fit of measured inputs to their records at its modes and the harmonics of its direct term."""
    with blas_threads(records):  # as when it was identified: the same to the last digit
        samples = parted(records, settings).samples
        return Uncertainty(samples, linearise(samples, modes, direct))


def ambient_fit(
    records: Sequence[Record], settings: Settings, modes: Sequence[Mode], columns: Floats, initial: Floats
) -> Fit:
    """The fit of random excitation to its records at its modes, coefficients of known columns and first states."""
    with blas_threads(records):
        samples, acting = with_acting(parted(records, settings))
        at = predicted(samples, modes, columns, initial)
    if at is None:
        raise IdentificationError("The predictor of these modes diverges on these records.")
    fit = Fit(samples, reweighed(samples, at), acting)
    # Files from before the states of a fit were scaled hold others.
    near = all(abs(fit.rms(number) - 1.0) < HALF_DIGITS for number in range(len(modes)))
    return fit if near else sized(fit)


def _sized(fit: Fit) -> Fit:
    """The fit with states of rms 1, computed as it will be from a file."""
    scaled = sized(fit)
    at = predicted(fit.samples, scaled.at.modes, scaled.at.columns, scaled.at.initial)
    return scaled if at is None else replace(scaled, at=reweighed(fit.samples, at))


def predicted_rest(analysis: Analysis) -> tuple[Floats, Mask]:
    """The outputs by a fit to the first three quarters of each record alone (outputs, samples), and what that was of.

    Of outputs alone one sample ahead. Where nothing was left out (`validate`), by the fit to all samples. The mask is
    true where samples were fitted (samples,). NaN where nothing was measured.
    """
    fit: Any = analysis.driven
    samples = fit.samples
    part, mask = first_part(samples) if analysis.settings.validate else (samples, np.ones(samples.n_samples, bool))
    with blas_threads(analysis.records):
        if not analysis.ambient:
            own = fit.at if mask.all() else solve_driven(without_last(samples)[0], fit.at.modes, fit.at.direct)
            response = columns_at(samples, own.modes, own.direct).response(own.coefficients)
            return np.where(samples.there, response, np.nan), mask
        own, whole = fit.at, None
        start = None if mask.all() else predicted(part, own.modes, own.columns, own.initial, own.whitening[mask])
        if start is not None:
            own = solve(part, start, rough=True)
            whole = predicted(samples, own.modes, own.columns, own.initial, growing=True)
        innovations = (fit.at if whole is None else whole).innovations
        return np.where(
            samples.there, samples.values - innovations, np.nan
        ), mask if whole is not None else np.ones_like(mask)


def with_acting(own: Parted) -> tuple[Samples, int]:
    """The samples with the inputs that act at once as known columns, beside the offsets and the lines; how many do.

    A force acts on an acceleration at once. On other outputs it does not, and in a closed loop the input holds the
    innovation of the same sample.
    """
    acting = len(own.inputs) if any(channel.quantity == "acceleration" for channel in own.outputs) else 0
    samples = own.samples
    return replace(samples, known=np.concatenate([samples.known, samples.kept(samples.inputs[:acting])])), acting
