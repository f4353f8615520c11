"""Findings against a result: a period that is not the response's own, channels that are sums of others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress

import numpy as np

from floquid._arrays import Floats
from floquid._checks import input_error
from floquid.core import PeriodicModel, Record
from floquid.errors import FloquidError
from floquid.findings import Finding, warning
from floquid.fit import DEVIATIONS, EVIDENT, FAINT, QUIET, SIGNIFICANT
from floquid.lifting import Lifted, largest_values
from floquid.order import Choice
from floquid.periodic import TURNED, Fit, estimate_period, spacing, synchrony, unexplained
from floquid.pipeline._analysis import Analysis
from floquid.pipeline._sums import Sum, SumError, sum_among
from floquid.preparation import NO_NEWS, Prepared, in_phase, name_of
from floquid.sync import LARGEST_DRIFT

CHANCE = 0.1  # share of a fundamental that other modes cover from which on one is near them by chance too often
FOLDED = 10.0  # decays within which modes that fold onto one another may be one


def wrong_period_lifted(model: PeriodicModel, lifted: Lifted, prepared: Prepared) -> Finding | None:
    """Finding on a period other than that of the lifted response; None where it is that, or the fit must tell."""
    # A second multiplier hidden beside a real one turns in the residual as harmonics of a wrong period do.
    if prepared.shafts or in_phase(prepared.findings) or prepared.clocks[0].fitted or model.real.any():
        return None
    found = synchrony(model, lifted)
    if found is None or not found.broken:
        return None
    return _wrong(prepared, model.period, found.relative, found.std)


def wrong_period_fitted(
    fitted: Fit, lifted: Lifted, prepared: Prepared, report: Callable[[str], None] = lambda _: None
) -> Finding | None:
    """Finding on the period by the fit of the samples: harmonics of a mode, modes that a wrong one tore apart.

    A harmonic turns as the fundamental does, which is one more parameter; and modes of equal decay that lie apart by
    nearly whole fundamentals are harmonics of one. Where these say nothing sure, the period that the lines of the
    response alone tell decides.
    """
    if prepared.shafts or in_phase(prepared.findings) or prepared.clocks[0].fitted:
        return _against_pulses(fitted, prepared)
    model = fitted.model
    samples = max(record.n_samples for record in prepared.responses)
    cycles = max(record.duration for record in prepared.responses) / model.period
    alive = min(cycles, 1.0 / max(np.abs(model.exponents.real).min() * model.period, 1e-300))
    torn, vague = spacing(model, lifted), False
    if torn is not None and fitted.own_period is not None:
        # Harmonics that turn with the period given outweigh equal decays: of a machine with like dampers many are.
        relative, std = fitted.own_period
        apart = abs(torn.relative - relative) > SIGNIFICANT * np.hypot(torn.std, std)
        torn = None if apart and abs(relative) <= SIGNIFICANT * std else torn
    for relative, std in ([fitted.own_period] if fitted.own_period else []) + ([torn.sign] if torn else []):
        if abs(relative) <= SIGNIFICANT * std or abs(relative) * samples <= LARGEST_DRIFT:
            continue
        # A step of many radians is none that one linearisation can tell: modes were torn apart, or are none.
        if 2.0 * np.pi * abs(relative) * alive < TURNED or (torn is not None and (relative, std) == torn.sign):
            return _wrong(prepared, model.period, relative, std)
        vague = True
    if not (vague or _single(model) or _folded(model)):
        return None
    report("finding the period from the response alone")
    estimate = _period_alone(prepared.responses)
    if estimate is None:
        return None
    own, deviation = estimate
    share = max(own, model.period) / min(own, model.period)
    if abs(share / round(share) - 1.0) <= SIGNIFICANT * deviation / own:
        return None
    return _wrong(prepared, model.period, own / model.period - 1.0, deviation / model.period)


def _against_pulses(fitted: Fit, prepared: Prepared) -> Finding | None:
    """Finding on a fitted period by which pulses are off by more than the sample that they are known to."""
    first, period, std = prepared.clocks[0].period, fitted.model.period, fitted.period_std
    relative, samples = period / first - 1.0, max(record.n_samples for record in prepared.responses)
    # Two lines within half a sample of all pulses part by two samples over the record at most.
    if std is None or abs(relative) * samples <= 2.0 or abs(period - first) <= SIGNIFICANT * std:
        return None
    coarse = any(own.code == "speed_fitted" for own in prepared.findings)
    return _wrong(prepared, first, relative, std / first) if coarse else None


def _single(model: PeriodicModel) -> bool:
    """True where there are several modes and none has a second harmonic, as where a wrong period tore them apart."""
    several = (np.abs(model.coefficients).max(axis=(1, 2)) > 0).sum(axis=1) > 1
    return len(model.upper_modes) > 1 and not several.any()


def _folded(model: PeriodicModel) -> bool:
    """True where two modes of equal decay fold next to one another, as a wrong period tears one into."""
    std = model.exponent_std
    if std is None:
        return False
    values = model.exponents
    gap = values[:, None] - values[None, :]
    turns = np.rint(gap.imag / model.fundamental)
    width = FOLDED * np.abs(values.real)
    deviation = np.hypot(std.real[:, None], std.real[None, :])
    alike = (np.abs(gap.real) < DEVIATIONS * deviation) & (deviation < EVIDENT * np.abs(values.real))
    # Of many modes of equal decay, or as wide ones, some are near whole fundamentals apart by chance.
    covered = width * np.maximum(0.5 * (alike.sum(axis=1) - 1), 1.0)
    near = (np.abs(gap.imag - turns * model.fundamental) < width) & (covered < CHANCE * model.fundamental)
    itself = np.abs(values[:, None] - values[None, :].conj()) == 0
    pairs = near & alike & ~itself & ~np.eye(model.order, dtype=bool)
    return bool(2 * pairs.any(axis=1).sum() >= model.order)


def _period_alone(records: Sequence[Record]) -> tuple[float, float] | None:
    """The period that the response alone tells, and its deviation [s]; None where it does not."""
    with suppress(FloquidError):
        estimate = estimate_period(records)
        # A steady response tells the period of a force, which may have nothing to do with the system's.
        if estimate.period is not None and estimate.period_std is not None and estimate.orbit is None:
            return estimate.period, estimate.period_std
    return None


def _wrong(prepared: Prepared, period: float, relative: float, std: float) -> Finding:
    """Finding that the period given is not that of the response, and whether it was rounded."""
    rate = prepared.responses[0].sample_rate
    own, deviation = period * (1.0 + relative), period * std
    slip = abs(relative) * max(one.n_samples for one in prepared.responses)
    whole = max(round(own * rate), 1)
    rounded = abs(own - whole / rate) <= DEVIATIONS * deviation and abs(relative) >= DEVIATIONS * std
    return warning(
        "wrong_period", own=own, std=deviation, given=period, slip=slip, rate=rate, whole=whole if rounded else 0
    )


def order_too_low(order: int, choice: Choice) -> Finding | None:
    """Finding for more modes than the order that was given; None where there is none."""
    evidence = choice.evidence
    assert evidence is not None
    share = evidence.gain / evidence.gain_limit
    return warning("order_too_low", order=order, share=share) if share > 1.0 else None


def quiet(lifted: Lifted, share: float) -> bool:
    """True where the noise before any mode is fitted is below a share of the largest value of each channel."""
    return bool((lifted.noise < share * largest_values(lifted.responses.values, lifted.n_channels)).all())


COPIED = 0.04
"""Share of its noise that a channel has beside the others, below which it is a copy, up to rounding; above, sensors may
share what they do not measure."""


def of_sums(found: Analysis) -> tuple[Finding, ...]:
    """Finding on a channel that shares its noise with others; SumError if it has next to none of its own.

    Too low an order leaves modes in what is taken for noise, which are alike in channels that are independent: where
    the order was given, none is left out. Noise that the structure itself makes is shared, too. What a model that
    fails leaves is no noise at all. Raises InputError where a hit is a sum of others.
    """
    own = None if found.failed else _sum_of_others(found)
    if own is None:
        return ()
    records, channels = found.responses, found.responses[0].channels
    names = [name_of(c.name, hit, len(records)) for hit, r in enumerate(records, start=1) for c in r.channels]
    numbers = own.numbers(names)
    if found.settings.order is not None or own.beside >= COPIED:
        return (warning("sum_of_others", **numbers),)
    if all(row < len(channels) for row in (own.row, *own.others)):
        plain = own.numbers([name_of(channel.name, 1, 1) for channel in channels])
        raise SumError(channels[own.row].name, warning("sum_left_out", **plain))
    must, remedy = "be independent measurements", f"Leave it out with `channels=`: {NO_NEWS}"
    raise input_error("records", "identify", must, warning("copied_sum", **numbers).clause, remedy)


def _sum_of_others(analysis: Analysis) -> Sum | None:
    """A response (of channels · hits) that is a sum of others beside the noise."""
    records = analysis.responses
    left = unexplained(analysis.model, records, analysis.clocks)
    if len({record.sample_rate for record in records}) > 1:
        return None
    n = min(record.n_samples for record in records)
    rows, rests = (
        np.concatenate([own[:, :n] for own in several]) if several[1:] else several[0]
        for several in ([record.values for record in records], left)
    )
    there = np.isfinite(rests).all(axis=0)
    if there.sum() <= len(rows):
        return None
    if not there.all():
        rows, rests = rows[:, there], rests[:, there]
    noise = np.minimum(_noise_of(rests), _noise_of(rows))  # a wrong model leaves more than there is
    quiet = noise <= QUIET * np.abs(rows).max(axis=1)
    return None if quiet.any() else sum_among(rows, noise, FAINT)


def _noise_of(rests: Floats) -> Floats:
    """The noise of samples that may hold a response too (rows,)."""
    from scipy.special import ndtri

    # The median size of a normal number is its upper quartile.
    rough = np.array([np.median(np.abs(np.diff(row, 2))) for row in rests]) / (ndtri(0.75) * np.sqrt(6.0))
    return np.minimum(np.sqrt(np.einsum("rn,rn->r", rests, rests) / rests.shape[1]), rough)
