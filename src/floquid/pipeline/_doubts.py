"""Findings against a result: a period that is not the response's own, and what a reader must be told."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from floquid.core import PeriodicModel, Record
from floquid.errors import FloquidError
from floquid.findings import Finding, warning
from floquid.fit import DEVIATIONS
from floquid.lifting import Lifted, largest_values
from floquid.order import Choice
from floquid.periodic import (
    CONFIDENT,
    NEGLIGIBLE_SLIP,
    SIGNIFICANT,
    TURNED,
    Fit,
    estimate_period,
    spacing,
    synchrony,
)
from floquid.pipeline._decay import FAILED
from floquid.pipeline.preparation import Prepared
from floquid.sync import ShaftAngle

QUIET = 1e-4  # the noise over the largest value below which a record says more than modes: a weak nonlinearity, for one
STILL = 4.0  # standard deviations within which a multiplier is 1 or -1
BLURRED = 400.0  # misfit that errors of the angle may add, spread over the lines about each harmonic
MISFIT = 1.3  # times the noise that a fit may leave
SEVERAL = 6  # exponents from which on modes without a second harmonic may be harmonics that a wrong period tore apart
EVIDENT = 0.1  # equal decays say something where the deviation of their difference is below this share of the decay
CHANCE = 0.1  # fundamentals within which two modes are near whole ones apart by chance too often to say anything
FOLDED = 10.0  # decays within which modes that fold onto one another may be one
NEIGHBOURS = 0.75
"""The distance of two modes modulo the fundamental, over the sum of their decays, within which one that changes is
taken for both: what a cubic term makes of a mode decays three times as fast, at half of that sum."""

WANDERING = 5.0
"""The same on a shaft whose speed wanders: a frequency that follows it has lines as far beside as that is fast."""

SAME_SHAPE = 0.95  # the squared correlation of two shapes from which on they are one
TELLING = 3  # coefficients in a shape, at least, for it to say anything


def wrong_period_lifted(model: PeriodicModel, lifted: Lifted, prepared: Prepared) -> Finding | None:
    """Finding on a period other than that of the lifted response; None where it is that, or the fit must tell."""
    # A second multiplier hidden beside a real one turns in the residual as harmonics of a wrong period do.
    if prepared.shafts or prepared.settings.estimate_period or model.real.any():
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
    if prepared.shafts or prepared.settings.estimate_period:
        return None
    model = fitted.model
    samples = max(record.n_samples for record in prepared.responses)
    cycles = max(record.duration for record in prepared.responses) / model.period
    alive = min(cycles, 1.0 / max(np.abs(model.exponents.real).min() * model.period, 1e-300))
    torn, vague = spacing(model, lifted), False
    for relative, std in ([fitted.own_period] if fitted.own_period else []) + ([torn.sign] if torn else []):
        if abs(relative) <= SIGNIFICANT * std or abs(relative) * samples <= NEGLIGIBLE_SLIP:
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


def _single(model: PeriodicModel) -> bool:
    """True where there are several modes and none has a second harmonic, as where a wrong period tore them apart."""
    several = (np.abs(model.coefficients).max(axis=(1, 2)) > 0).sum(axis=1) > 1
    return model.order >= SEVERAL and not several.any()


def _folded(model: PeriodicModel) -> bool:
    """True where two modes of equal decay fold next to one another, as a wrong period tears one into."""
    std = model.exponent_std
    if std is None:
        return False
    values = model.exponents
    gap = values[:, None] - values[None, :]
    turns = np.rint(gap.imag / model.fundamental)
    width = FOLDED * np.abs(values.real)
    # Of modes as wide as that, some are near whole fundamentals apart by chance.
    near = (np.abs(gap.imag - turns * model.fundamental) < width) & (width < CHANCE * model.fundamental)
    deviation = np.hypot(std.real[:, None], std.real[None, :])
    alike = (np.abs(gap.real) < 5.0 * deviation) & (deviation < EVIDENT * np.abs(values.real))
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


def vague_angle(found: Fit, shafts: Sequence[ShaftAngle], records: Sequence[Record]) -> Finding | None:
    r"""Finding on what the error of the shaft's angle makes of the response; None where noise hides it.

    .. math:: \sum_{c,h} \frac{\sigma_{\theta,h}^2}{s_{c,h}^2} \Big( \frac{N_h}{2} \sum_j (j\, a_{c,h,j})^2
              + \sum_r \sum_n e^{2 \Re \lambda_r t_n} \sum_m |m B_{r,c,h,m}|^2 \Big)

    with a the amplitudes of the harmonics j of the forced response, B the coefficients of the modes, σ the deviation of
    the angle [rad], and s the noise.
    """
    forced, model = found.forced, found.model
    energy, degrees = 0.0, 0.0
    for hit, (shaft, record) in enumerate(zip(shafts, records, strict=True)):
        std = float(np.sqrt(np.mean(shaft.angle_std(np.clip(record.times, shaft.first, shaft.last)) ** 2)))
        noise = found.noise[:, hit, None]
        if forced is not None:
            shares = forced.harmonics * forced.amplitudes[:, hit] / noise
            energy += 0.5 * record.n_samples * std**2 * float(np.sum(shares**2))
        step = np.minimum(2.0 * model.exponents.real / record.sample_rate, -np.finfo(float).tiny)
        lasting = np.expm1(record.n_samples * step) / np.expm1(step)
        turned = np.abs(model.harmonics * model.coefficients[:, :, hit] / noise) ** 2
        energy += std**2 * float(lasting @ turned.sum(axis=(1, 2)))
        degrees = max(degrees, float(np.degrees(std)))
    return None if energy < BLURRED else warning("vague_angle", degrees=degrees, energy=energy)


def order_too_low(order: int, choice: Choice) -> Finding | None:
    """Finding for more modes than the order that was given; None where there is none."""
    evidence = choice.evidence
    assert evidence is not None
    share = evidence.gain / evidence.gain_limit
    return warning("order_too_low", order=order, share=share) if share > 1.0 else None


def misfit(found: Fit) -> Finding | None:
    """Finding on a fit that leaves more than noise, though not so much that it fails; None on others."""
    if found.misfit is None or not MISFIT < found.misfit < FAILED:
        return None
    return warning("misfit", misfit=found.misfit)


def quiet(lifted: Lifted) -> bool:
    """True where the noise before any mode is fitted is so small that what modes leave is no noise."""
    return bool((lifted.noise < QUIET * largest_values(lifted.responses.values, lifted.n_channels)).all())


def ambiguity(choice: Choice | None) -> tuple[Finding, ...]:
    """Finding that the order is ambiguous, if it is."""
    if choice is None or not choice.ambiguous:
        return ()
    return (warning("order_ambiguous", order=choice.order, doubts=choice.doubts),)


def _halved(model: PeriodicModel, std: NDArray[np.complex128]) -> bool:
    """True where half of the modes have a partner of equal decay at an odd number of half fundamentals."""
    gap = model.exponents[:, None] - model.exponents[None, :]
    deviation = np.hypot(std.real[:, None], std.real[None, :]), np.hypot(std.imag[:, None], std.imag[None, :])
    halves = 2.0 * gap.imag / model.fundamental
    odd = 2.0 * np.rint((halves - 1.0) / 2.0) + 1.0
    apart = np.abs(halves - odd) * model.fundamental < 10.0 * deviation[1]
    apart &= deviation[1] < 1e-3 * model.fundamental
    alike = (np.abs(gap.real) < 5.0 * deviation[0]) & (deviation[0] < 0.1 * np.abs(model.exponents.real))
    # A mode and its own conjugate are no two modes.
    itself = np.abs(model.exponents[:, None] - model.exponents[None, :].conj()) == 0
    return bool(2 * (apart & alike & ~itself).any(axis=1).sum() >= max(model.order, 1))


def _still(model: PeriodicModel, std: NDArray[np.complex128]) -> list[Finding]:
    """Components that are most likely a forced response, of one period or of two."""
    steady = np.maximum(std.real, std.imag) < CONFIDENT * model.fundamental
    steady &= np.abs(model.exponents.real) < 4.0 * std.real + 1e-9 * model.fundamental
    turn, within = np.abs(np.angle(model.multipliers)), 3.0 * std.imag * model.period + 1e-12
    found = [warning("multiplier_one")] if (steady & (turn < within)).any() else []
    return found + ([warning("multiplier_minus_one")] if (steady & (np.pi - turn < within)).any() else [])


def _moving(model: PeriodicModel, near: float) -> list[Finding]:
    """Pairs of modes of one shape that are nearer to each other than they decay: one mode that changes."""
    found, own = [], [int(mode) for mode in model.upper_modes if not model.unpaired[mode]]
    scale = np.abs(model.coefficients).max(axis=(0, 2, 3), initial=0.0)[:, None, None]
    shapes = model.coefficients / np.where(scale > 0.0, scale, 1.0)
    for place, one in enumerate(own):
        for other in own[place + 1 :]:
            gap = model.exponents[other] - model.exponents[one]
            turns = round(gap.imag / model.fundamental)
            apart = abs(complex(gap.real, gap.imag - turns * model.fundamental))
            if apart > near * abs(model.exponents[[one, other]].real).sum():
                continue
            # e^{i turns θ} goes from the exponent to the shape.
            moved = np.roll(shapes[other], turns, axis=-1)
            power = float(np.sum(np.abs(shapes[one]) ** 2) * np.sum(np.abs(moved) ** 2))
            telling = min(np.count_nonzero(shapes[one]), np.count_nonzero(moved)) >= TELLING
            if telling and abs(np.vdot(shapes[one], moved)) ** 2 > SAME_SHAPE * power:
                first, second = model.frequencies_hz[[one, other]]
                found.append(warning("one_that_moves", first=first, second=second))
    return found


def doubts_of(model: PeriodicModel, *, wanders: bool = False) -> tuple[Finding, ...]:
    """Findings on the modes of a model: hardly determined, without decay, of another period, growing."""
    found, std = [], model.exponent_std
    if std is not None:
        weak = int((np.maximum(std.real, std.imag) > CONFIDENT * model.fundamental).sum())
        if weak:
            found.append(warning("weakly_determined", number=weak, order=model.order, limit=CONFIDENT))
        found += _still(model, std)
    if model.order and not ((np.abs(model.coefficients).max(axis=(1, 2)) > 0).sum(axis=1) > 1).any():
        found.append(warning("no_second_harmonic"))
    found += _moving(model, WANDERING if wanders else NEIGHBOURS)
    if std is not None and _halved(model, std):
        found.append(warning("period_halved"))
    growing = model.exponents.real > (4.0 * std.real if std is not None else 0.0)
    if growing.any():
        found.append(warning("growing", number=int(growing.sum()), order=model.order))
    return tuple(found)
