"""Starts of the fit of the samples after the poles of lifted responses: for records that are over in a few periods."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from floquid._arrays import Complexes, Integers
from floquid.core import PeriodicModel, Record
from floquid.fit import MISFIT, SURE, chi2_limit, is_vague
from floquid.lifting import Lifted, largest_values, unlift
from floquid.lti import ERA, SHORT, Ensemble, TimeResponses, brief, pooled_noise
from floquid.periodic import Fit, ModeParameters
from floquid.pipeline.free._find_poles import ENOUGH_CYCLES, find_poles
from floquid.pipeline.free._start import Lifting, Start, start_of, without_forced
from floquid.preparation import Prepared
from floquid.sync import rejoin

AVERAGED = (2, 4)  # orders of the time-invariant system that a few brief hits are taken for at first


Opening = Callable[[Prepared, Lifting, Callable[[str], None]], Iterator[Start]]
"""Starts of modes, the best first. Raises IdentificationError where there is none."""


def poles(prepared: Prepared, cutting: Lifting, report: Callable[[str], None]) -> Iterator[Start]:
    """Poles of lifted responses, residues free in each hit: half as many as there are periods above the noise."""
    yield start_of(prepared, cutting, report)


def ensembles(prepared: Prepared, cutting: Lifting, report: Callable[[str], None]) -> Iterator[Start]:
    """Poles of the monodromy matrix that takes the samples of each period to those of the next, in brief records."""
    whole = brief_responses(prepared, cutting)
    if whole is None:
        return
    raw, known, _ = without_forced(whole, prepared, cutting)
    identifier = Ensemble(false_alarm=prepared.settings.mode_false_alarm)
    chosen = replace(prepared.settings, identifier=identifier)
    found, modal, choice = find_poles(raw, chosen, report, taps=None)
    whole = whole.with_noise(found.noise) if known else found
    yield Start(whole=whole, lifted=found, raw=raw, known=known, modal=modal, choice=choice)


def averaged(prepared: Prepared, cutting: Lifting, report: Callable[[str], None]) -> Iterator[Start]:
    """Poles of the samples of brief records as those of a time-invariant system, by rising order."""
    whole = brief_responses(prepared, cutting)
    if whole is None:
        return
    lifted, known, _ = without_forced(whole, prepared, cutting)
    records = [rejoin(hit) for hit in unlift(lifted)]
    lengths = [record.n_samples for record in records]
    values = np.zeros((lifted.n_channels, len(records), max(lengths)))
    for hit, record in enumerate(records):
        values[:, hit, : lengths[hit]] = record.values
    step = 1.0 / records[0].sample_rate
    era, fundamental = ERA(), 2.0 * np.pi / lifted.period
    state = era.prepare(TimeResponses(values=values, dt=step, noise=lifted.noise, lengths=lengths))
    for order in AVERAGED:
        report(f"a time-invariant system of order {order}")
        found = era.extract(state, order).poles
        upper = found[found.imag >= 0.0]
        exponents = upper.real + 1j * np.maximum(upper.imag, 0.05 * np.abs(upper.real))
        bands = np.tile([-1, 1], (len(upper), 1))  # the narrowest that vary: of a weak parametric excitation
        begin = ModeParameters.made(exponents, bands, fundamental)
        yield Start(whole=whole, lifted=lifted, raw=lifted, known=known, modal=None, choice=None, begin=begin)


OPENINGS: tuple[Opening, ...] = (ensembles, poles, averaged)


def by_default(prepared: Prepared, cutting: Lifting) -> bool:
    """True where neither order, harmonics nor algorithm are chosen, and samples are whole a period."""
    return prepared.settings.constrained and prepared.settings.all_found and cutting.synchronous


def brief_responses(prepared: Prepared, cutting: Lifting) -> Lifted | None:
    """The responses with pooled noise, where all is found by default and few periods tell a pole."""
    if not by_default(prepared, cutting):
        return None
    whole = with_pooled_noise(cutting.lifted)
    return whole if brief(whole.responses, ENOUGH_CYCLES) else None


def with_pooled_noise(lifted: Lifted) -> Lifted:
    """The responses with the noise of each channel: of a hit alone where it is long, or as all tell it together."""
    values, lengths = lifted.by_channel(np.moveaxis(lifted.responses.values, 2, 0)), lifted.responses.lengths
    blocks = (
        [values[:length, channel, :, hit].T for hit, length in enumerate(lengths)]
        for channel in range(lifted.n_channels)
    )
    return lifted.with_noise(pooled_noise(blocks))


def determined(model: PeriodicModel | None) -> bool:
    """True where the decays of all modes are known to a share of themselves."""
    if model is None or model.exponent_std is None:
        return False
    return not is_vague(model.exponent_std.real, model.exponents.real).any()


def lasting(fitted: Fit) -> bool:
    r"""True where each mode rises above the noise after its first period.

    .. math:: \sum_{c,h} \frac{1}{\sigma_{c,h}^2} \sum_m |B_{m,c,h}|^2 \sum_{t_k \ge T} 2\, e^{2 \Re \lambda t_k}

    Within one period a shape with enough harmonics stands for any exponent.
    """
    model, weights = fitted.model, 1.0 / fitted.noise**2
    limit = chi2_limit(2 * weights.size, SURE)
    for mode in model.upper_modes:
        rate, power = float(model.exponents[mode].real), 0.0
        for hit, record in enumerate(fitted.free):
            first = int(np.ceil(model.period * record.sample_rate))
            left = np.exp(2.0 * rate * np.arange(first, record.n_samples) / record.sample_rate).sum()
            power += 2.0 * left * float(weights[:, hit] @ np.sum(np.abs(model.coefficients[mode, :, hit]) ** 2, axis=1))
        if power < limit:
            return False
    return True


def explains(fitted: Fit, start: Start) -> bool:
    """True where a fit leaves noise, and determines its modes."""
    left = fitted.misfit
    if left is None:
        left = float(np.sqrt(np.mean((fitted.noise / start.raw.noise) ** 2)))
    return determined(fitted.model) and left < MISFIT and (lasting(fitted) or not fitted.model.one_shape)


def criterion(fitted: Fit, alarm: float, alone: int = 0) -> float:
    r"""Criterion of a fit: what it leaves, and a price for its modes.

    .. math:: J = \sum_{c,h} N_h \log \frac{\mathrm{RSS}_{c,h}}{N_h} - N \log (1 - q/N),
              \qquad q = \sum_r \chi^2_{n_r}(\alpha)

    with n_r the numbers of a mode: its coefficients in all channels and hits, or those of an outer product of shape
    and hit where hits share shapes. Where residues are free at each phase, a shape has a number a phase. Samples before
    those fitted, `alone` in each hit, are numbers that fit exactly. Those behind them count as noise. Of N samples,
    numbers that noise gives q off the sum of squares over its variance leave it 1 - q/N.
    """
    from scipy.special import chdtri

    model = fitted.model
    lengths = np.array([record.n_samples for record in fitted.free]) + later_samples(fitted)
    channels, hits = fitted.noise.shape
    sizes = np.array([1 if model.real[mode] else 2 for mode in model.upper_modes])
    if fitted.constrained:
        kept = (model.coefficients != 0).any(axis=(1, 2))[list(model.upper_modes)].sum(axis=1)
        numbers = sizes * (kept * channels + hits if model.one_shape else kept * channels * hits + 1)
    else:
        phases = round(model.period * fitted.free[0].sample_rate)
        numbers = sizes * (channels * phases + hits)
    used, whole = numbers.sum() / (channels * hits), lengths + alone
    squares = fitted.noise**2 * np.maximum(1.0 - used / lengths, 1.0 / lengths) * lengths / whole
    price = np.sum(chdtri(numbers, alarm)) + (chdtri(channels * hits * alone, alarm) if alone else 0.0)
    number = channels * whole.sum()
    if price >= number:
        return np.inf
    return float(np.sum(whole * np.log(squares)) - number * np.log1p(-price / number))


TIME_CONSTANTS = 12.0
"""Time constants of the slowest mode [-] that are fitted at least: later cycles have 1e-8 of what tells its decay."""


def ringing(multipliers: Complexes, lifted: Lifted) -> int:
    r"""Number of cycles in which modes of these multipliers are above the noise of lifted responses.

    .. math:: n = \frac{\max\big(12,\; 2 \ln \max_{c,h} a_{c,h}/\sigma_{c,h}\big)}{-\max_r \ln |\mu_r|}

    with a the largest value of a channel and hit and σ its noise: twice its logarithm, so that the response is as far
    below the noise as it was above. All cycles where a mode does not decay, and of a record that is short.
    """
    longest = int(lifted.responses.lengths.max())
    slowest = float(np.log(np.abs(multipliers).max(initial=0.0) + np.finfo(float).tiny))
    if longest <= SHORT or slowest >= 0.0:
        return longest
    above = float((largest_values(lifted.responses.values, lifted.n_channels) / lifted.noise).max())
    cycles = max(TIME_CONSTANTS, 2.0 * float(np.log(above))) / -slowest
    return min(longest, max(SHORT, int(np.ceil(min(cycles, longest)))))


def fitted_ringing(start: Start, records: Sequence[Record], fit: Callable[[Sequence[Record], Lifted], Fit]) -> Fit:
    """The fit of the cycles in which the modes of `start` ring, and half as many more."""
    lifted = start.whole
    whole = cycles = int(lifted.responses.lengths.max())
    if start.modal is not None and not start.known:
        cycles = ringing(start.modal.multipliers, lifted)
        cycles = min(whole, cycles + cycles // 2) if cycles < whole else whole
    while cycles < whole:
        fitted = fit(_first(records, start, cycles), lifted.first(cycles))
        longer = whole if _goes_on(fitted) else ringing(fitted.model.multipliers, lifted)
        if longer <= cycles:
            return replace(fitted, later=lifted.responses.lengths - np.minimum(lifted.responses.lengths, cycles))
        cycles = min(whole, 2 * longer)
    return fit(records, lifted)


def later_samples(fitted: Fit) -> Integers:
    """The samples of each hit behind those that were fitted (hits,); zeros where all were."""
    if fitted.later is None:
        return np.zeros(len(fitted.free), np.int64)
    return fitted.later * round(fitted.model.period * fitted.free[0].sample_rate)


def _first(records: Sequence[Record], start: Start, cycles: int) -> tuple[Record, ...]:
    """The samples of the first lifted cycles, with those that the filter begins with."""
    before = int((start.raw.responses.lengths - start.whole.responses.lengths).max())
    samples, cut = (cycles + before) * start.raw.n_phases, []
    for record in records:
        values = record.values[:, :samples].copy()
        values.flags.writeable = False
        cut.append(replace(record, values=values))
    return tuple(cut)


def _goes_on(fitted: Fit) -> bool:
    """True where there is something beside the modes that does not decay."""
    forced = fitted.forced
    steady = forced is not None and bool(len(forced.harmonics) or forced.offset.any() or forced.drift.any())
    return steady or any(own.code == "interference" for own in fitted.findings)
