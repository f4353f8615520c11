"""Modes that are needed, at a limit of the search, not determined, likely none, or a line of the revolution."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from floquid._arrays import Complexes, Mask
from floquid.checks._check import REMAINDER, Evidence, is_undetermined, strongest
from floquid.core import PeriodicModel
from floquid.findings import Finding, failure, note, warning
from floquid.fit import DEVIATIONS, EVIDENT, ROUNDING, SURE, chi2_limit
from floquid.inputs import nearly_one
from floquid.periodic import CONFIDENT

if TYPE_CHECKING:
    from floquid.checks._decays import Decays


def needed(case: Any, _: Evidence) -> tuple[Finding, ...]:
    """Finding on the mode that would be missed least, by the squared deviations of its shape from zero."""
    seen = case.seen()
    if not seen:
        return ()
    rises = [squares / chi2_limit(degrees, case.limits.mode_alarm) for squares, degrees in seen]
    least = int(np.argmin(rises))
    hertz = abs(case.model.exponents[case.model.upper_modes[least]]) / (2.0 * np.pi)
    return (note("all_needed", number=len(rises), frequency=hertz, rise=rises[least]),)


def limits(case: Any, _: Evidence) -> tuple[Finding, ...]:
    """Finding on a search that ended at the most modes that it may find."""
    number = len(case.fit.at.modes)
    return (warning("search_ended", number=number),) if number >= case.limits.modes else ()


def bands(case: Any, _: Evidence) -> tuple[Finding, ...]:
    """Findings on bands that end at the highest harmonics looked for."""
    findings, highest = [], int(case.limits.highest)
    if case.most is not None and _clear(case.model, highest):
        if nearly_one(case.own.samples, case.fit.at):  # a copy of the mode makes up for harmonics beyond the limit
            findings.append(failure("inputs_copies", most=highest))
        elif highest == case.most:
            findings.append(warning("inputs_harmonics", most=case.most))
    return tuple(findings)


def _clear(model: PeriodicModel, highest: int) -> bool:
    """True where one of the highest harmonics that are looked for is clear of noise."""
    assert model.coefficient_std is not None
    assert model.inputs is not None
    assert model.inputs.coefficient_std is not None
    for values, std, turns in (
        (model.coefficients, model.coefficient_std, model.harmonics),
        (model.inputs.coefficients, model.inputs.coefficient_std, model.inputs.harmonics),
    ):
        ends = np.abs(turns) >= highest
        if (np.abs(values[..., ends]) > DEVIATIONS * np.abs(std[..., ends])).any():
            return True
    return False


MOST_PERIODS = 6
"""Periods of a revolution up to which lines of the revolution are looked for where nobody says how many it holds."""

SHARP = 1.5e-4
"""The deviation of a frequency over the fundamental below which a mode at a line fails.

One in a hundred undamped modes is as near to some line by chance.
"""


def steady(case: Any, evidence: Evidence) -> tuple[Finding, ...]:
    """Findings on modes that do not decay at a fraction of the fundamental, as lines of a revolution are."""
    if not case.turning or case.model.exponent_std is None:
        return ()
    longest = max(record.duration for record in case.own.records)
    unreached = [own for one in evidence.findings if one.code == "unreached" for own in one.numbers["frequencies"]]
    return lines_of_revolution(case.model, longest, unreached, case.own.periods_per_revolution)


def lines_of_revolution(
    model: PeriodicModel, longest: float, unreached: Sequence[float], periods_of_turn: float
) -> tuple[Finding, ...]:
    """Findings on modes that do not decay at a fraction of the fundamental, as lines of a revolution are."""
    std = model.exponent_std
    assert std is not None
    still = np.abs(model.exponents.real) < DEVIATIONS * std.real
    still &= np.abs(model.exponents.real) * longest < 1.0
    determined = std.imag < CONFIDENT * model.fundamental
    # The frequency of a real multiplier is none measured; no input reaches what drives the system itself.
    apart = np.isclose(np.abs(model.exponents)[:, None], 2.0 * np.pi * np.array(unreached), rtol=1e-9).any(axis=1)
    known = (std.imag < SHARP * model.fundamental) & (~model.real | apart)
    turns, findings = model.exponents.imag / model.fundamental, []
    for count in range(2, MOST_PERIODS + 1):
        near = np.rint(turns * count).astype(np.int64)
        off = np.abs(turns * count - near) * model.fundamental / count
        at = still & determined & (np.gcd(near, count) == 1)
        at &= off <= DEVIATIONS * std.imag + ROUNDING * model.fundamental
        if at.any():
            hertz = np.unique(np.abs(model.exponents.imag[at])) / (2.0 * np.pi)
            report = failure if known[at].any() else warning
            real = bool(model.real[at].any())
            # Where the revolution was said they are weak, and were left out: their numbers in it.
            lines = np.unique(np.rint(np.abs(turns[at]) * periods_of_turn)).astype(int).tolist()
            forced = lines if periods_of_turn % count == 0.0 else []
            findings.append(report("line_as_mode", frequencies=hertz.tolist(), periods=count, real=real, forced=forced))
    return tuple(findings)


NEIGHBOURS = 0.75
"""The distance of two modes modulo the fundamental, over the sum of their decays, within which one that changes is
taken for both: what a cubic term makes of a mode decays three times as fast, at half of that sum."""

WANDERING = 5.0
"""Distance on a shaft whose speed wanders: a frequency that follows it has lines as far beside as that is fast."""


def undetermined_of(model: PeriodicModel) -> tuple[Finding, ...]:
    """Finding on decays that are not determined; none of a model that fails, which has no deviations."""
    std = model.exponent_std
    vague = std is not None and is_undetermined(std.real, model.exponents.real, model.period).any()
    return (failure("undetermined"),) if vague else ()


def _halved(model: PeriodicModel, std: Complexes) -> bool:
    """True where half of the modes have a partner of equal decay at an odd number of half fundamentals."""
    gap = model.exponents[:, None] - model.exponents[None, :]
    deviation = np.hypot(std.real[:, None], std.real[None, :]), np.hypot(std.imag[:, None], std.imag[None, :])
    halves = 2.0 * gap.imag / model.fundamental
    odd = 2.0 * np.rint((halves - 1.0) / 2.0) + 1.0
    apart = 0.5 * np.abs(halves - odd) * model.fundamental < DEVIATIONS * deviation[1]
    apart &= deviation[1] < CONFIDENT * model.fundamental
    alike = (np.abs(gap.real) < DEVIATIONS * deviation[0]) & (deviation[0] < EVIDENT * np.abs(model.exponents.real))
    # A mode and its own conjugate are no two modes.
    itself = np.abs(model.exponents[:, None] - model.exponents[None, :].conj()) == 0
    return bool(2 * (apart & alike & ~itself).any(axis=1).sum() >= max(model.order, 1))


def _still(model: PeriodicModel, std: Complexes) -> list[Finding]:
    """Components that are most likely a forced response, of one period or of two."""
    steady = np.maximum(std.real, std.imag) < CONFIDENT * model.fundamental
    steady &= np.abs(model.exponents.real) < DEVIATIONS * std.real + ROUNDING * model.fundamental
    turn, within = np.abs(np.angle(model.multipliers)), DEVIATIONS * std.imag * model.period + ROUNDING
    findings = [warning("multiplier_one")] if (steady & (turn < within)).any() else []
    return findings + ([warning("multiplier_minus_one")] if (steady & (np.pi - turn < within)).any() else [])


def _moving(model: PeriodicModel, near: float) -> list[Finding]:
    """Pairs of modes of one shape in a row that are nearer to each other than they decay: one mode that changes."""
    from scipy.sparse.csgraph import connected_components

    findings, modes = [], [int(mode) for mode in model.upper_modes if not model.unpaired[mode]]
    exponents = model.exponents[modes]
    gaps = exponents - exponents[:, None]
    turns = np.rint(gaps.imag / model.fundamental).astype(int)
    decays = np.abs(exponents.real)
    apart = np.abs(gaps - 1j * turns * model.fundamental)
    # Of a cubic spring the third decays five times as fast as the first: the second lies between.
    groups = connected_components(apart <= near * (decays + decays[:, None]), directed=False)[1]
    scale = np.abs(model.coefficients).max(axis=(0, 2, 3), initial=0.0)[:, None, None]
    shapes = (model.coefficients / np.where(scale > 0.0, scale, 1.0))[modes]
    for lower, upper in zip(*np.triu_indices(len(modes), 1), strict=True):
        if groups[lower] != groups[upper]:
            continue
        # e^{i turns θ} goes from the exponent to the shape.
        moved = np.roll(shapes[upper], turns[lower, upper], axis=-1)
        power = float(np.sum(np.abs(shapes[lower]) ** 2) * np.sum(np.abs(moved) ** 2))
        # A shape of one coefficient is that of any other.
        telling = min(np.count_nonzero(shapes[lower]), np.count_nonzero(moved)) > 1
        if telling and abs(np.vdot(shapes[lower], moved)) ** 2 > (1.0 - REMAINDER) * power:
            first, second = model.frequencies_hz[[modes[lower], modes[upper]]]
            findings.append(warning("one_that_moves", first=first, second=second))
    return findings


def repeats_of(model: PeriodicModel) -> int:
    """The number of times that the system repeats in a period: the common divisor of the distances of its lines."""
    std = model.coefficient_std
    if std is None:
        return 1
    parts = ((model.coefficients.real, std.real), (model.coefficients.imag, std.imag))
    squares = sum(np.divide(part, noise, out=np.zeros_like(part), where=noise > 0.0) ** 2 for part, noise in parts)
    seen = np.sum(squares, axis=(1, 2)) > chi2_limit(2 * std.shape[1] * std.shape[2], SURE)
    distances = [np.diff(model.harmonics[seen[mode]]) for mode in model.upper_modes]
    if sum(len(own) > 0 for own in distances) < 2:
        return 1
    return int(np.gcd.reduce(np.concatenate(distances)))


def doubts_of(model: PeriodicModel, *, wanders: bool = False) -> tuple[Finding, ...]:
    """Findings on the modes of a model: hardly determined, without decay, of another period, growing."""
    findings, std = [], model.exponent_std
    if std is not None:
        weak = int((np.maximum(std.real, std.imag) > CONFIDENT * model.fundamental).sum())
        if weak:
            findings.append(warning("weakly_determined", number=weak, order=model.order, limit=CONFIDENT))
        findings += _still(model, std)
    if model.order and not ((np.abs(model.coefficients).max(axis=(1, 2)) > 0).sum(axis=1) > 1).any():
        findings.append(warning("no_second_harmonic"))
    elif (times := repeats_of(model)) > 1:
        findings.append(warning("period_multiple", given=model.period, times=times))
    findings += _moving(model, WANDERING if wanders else NEIGHBOURS)
    if std is not None and _halved(model, std):
        findings.append(warning("period_halved"))
    growing = model.exponents.real > (DEVIATIONS * std.real if std is not None else 0.0)
    if growing.any():
        findings.append(warning("growing", number=int(growing.sum()), order=model.order))
    return tuple(findings)


def _negative(model: PeriodicModel) -> Mask:
    r"""Modes with a negative multiplier (modes,).

    Of a real system these are an even number, as :math:`\det\Phi(T) = e^{\int_0^T \mathrm{tr} A\, dt} > 0`.
    """
    return model.real & (model.multipliers.real < 0.0)


def partners(case: Any, _: Evidence) -> tuple[Finding, ...]:
    """Finding on an odd number of negative multipliers."""
    number = int(_negative(case.model).sum())
    return (warning("partner_missing", number=number),) if number % 2 else ()


def weak_modes(case: Decays, evidence: Evidence) -> tuple[Finding, ...]:
    r"""Each mode's power in the records over the noise, against what a fit makes of noise alone.

    .. math:: \frac{1}{\ell_r} \sum_{c,h} \frac{1}{\sigma_{c,h}^2}
              \sum_m |B_{r,c,h,m}|^2 \sum_k 2\, e^{2 \Re \lambda_r t_k}, \qquad \ell_r = \chi^2_{p_r, \alpha / n}

    a conjugate pair once, p its parameters and n the samples of the records. The products of two harmonics are left
    out: they add up to nothing over a period. The least is `mode`, and has to be 1. Negative multipliers come in twos:
    of an even number the strongest speaks for all.
    """
    from scipy.special import chdtri

    model, modes = case.model, np.flatnonzero(case.model.exponents.imag >= 0)
    if not len(modes):
        return ()
    powers = np.array([_power(case, int(mode)) for mode in modes])
    kept = (model.coefficients[modes] != 0).any(axis=(1, 2)).sum(axis=1)
    looks = sum(record.n_samples for record in case.records)
    limits = chdtri(2 * case.responses * np.maximum(kept, 1) + 2, SURE / looks)
    shares = powers / limits
    negative = _negative(model)[modes]
    if negative.sum() % 2 == 0:
        shares[negative] = shares[negative].max(initial=0.0)
    if evidence.kept("mode", float(shares.min()), 1.0, at_least=True):
        return ()
    below = [k for (k,) in strongest(np.where(shares < 1.0, 2.0 - shares, 0.0))]
    return evidence.against("mode_weak", "mode", frequencies=model.frequencies_hz[modes[below]], shares=shares[below])


def _power(case: Decays, mode: int) -> float:
    """The power of a mode, with its conjugate, in all records over the noise."""
    model, total = case.model, 0.0
    value = model.exponents[mode]
    for hit, (record, (times, _)) in enumerate(zip(case.records, case.instants, strict=True)):
        # A growing mode is counted from its end, so that nothing overflows.
        origin = times[-1] if value.real > 0 else times[0]
        there: Mask = ~np.isnan(record.values)
        decay = there @ np.exp(2.0 * value.real * (times - origin))
        sizes = np.abs(model.coefficients[mode, :, hit] * np.exp(value.real * origin)) / case.noise[:, hit, None]
        total += float(np.sum(sizes**2, axis=1) @ decay)
    return total if model.unpaired[mode] else 2.0 * total
