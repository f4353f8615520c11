"""Checks of the drive: inputs to modes, their instants, noise on them, and powers of the response."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from floquid.checks._check import Evidence
from floquid.core import PeriodicModel
from floquid.findings import Finding, failure, warning
from floquid.fit import SURE, chi2_limit, wald_rise
from floquid.inputs import Samples, Scores, Uncertainty, answering, gain_of, solve

if TYPE_CHECKING:
    from floquid.checks._excited import Parted

BENT = 1e-9
"""The probability at which noise may pass for powers of the inputs: these have longer tails than noise."""

HINT = 1e-3
"""The probability, were scores normal, at which it may pass for a little of such noise: six of 700 records do."""

NEAR, MANY = 2.0, 300
"""The factor within which a gain is near a limit, and the draws that tell it then."""

POWERS = 4
"""Numbers by which squares and cubes of one channel drive a mode."""

MORE = 2.0
"""Least gain by squares and cubes over that by driving noise, which lets them gain by chance."""

UNTOLD = 15.0
"""The criterion of a fit of one size over another below which the record does not tell them: Φ(-√15) is 10⁻⁴/2."""

SMOOTH = 0.15
"""The correlation of an input from sample to sample above which it may run on between them: 0.25 behind a filter."""

HOPELESS = -50.0
"""The gain to first order below which other instants are not fitted."""

ALIKE = 0.1
"""The criterion of a fit over another within which they are one: fits end where a step gains a hundredth of it."""

STEPS = 10
"""Steps of the fit with other instants."""

TAKING_UP = 0.3
"""The deviation of a decay over it, from which on a mode may stand for inputs at other instants."""

AT_ONCE = 1.0
"""The decay from sample to sample from which on it may, too [nepers]."""


def driving(case: Any, _: Evidence) -> tuple[Finding, ...]:
    """Findings on inputs at other instants, and on what drives the modes beside the inputs.

    Inputs at other instants leave what noise and squares do, so that these are looked for with the right instants.
    """
    instants, right = _instants(case.fit, case.tested)
    return (*_beside(right or case.tested), *instants)


def _beside(scores: Scores) -> tuple[Finding, ...]:
    """Finding on noise, or powers of the response, that drives the modes: each leaves some of what the other leaves.

    Where squares are there they gain several times what noise does, more than they do by chance.
    """
    by_noise, by_powers = _by_noise(scores), _by_powers(scores)
    noisy = MORE * by_noise > by_powers.max(initial=0.0) - POWERS * len(scores.now.left)
    return (() if noisy else _nonlinear(scores, by_powers)) or _driven(by_noise)


def _moved(samples: Samples, lag: int) -> NDArray[np.float64]:
    """The inputs some samples ago, zero where there were none (inputs, samples)."""

    def of(values: NDArray) -> NDArray:
        moved, count = np.zeros_like(values), values.shape[1]
        if abs(lag) < count:
            moved[:, max(lag, 0) : count + min(lag, 0)] = values[:, max(-lag, 0) : count - max(lag, 0)]
        return moved

    return samples.each(samples.inputs, of)


def _instants(fit: Uncertainty, scores: Scores) -> tuple[tuple[Finding, ...], Scores | None]:
    """Finding on inputs that come late or early, or between the samples in another way than `hold` says.

    With it, where that is so, the scores of the fit with inputs as they were then.

    Gains take up a delay except in the first samples of each response. A direct term takes those up, or modes that die
    at once: with the right instants none of that is needed. Else a fit to first order tells what no other needs to be.
    """
    samples, current = scores.samples, scores.now
    modes = [
        mode
        for mode, (place, _) in zip(current.modes, fit.places, strict=True)
        if fit.parameters[place.start, place.start] ** 0.5 < TAKING_UP * abs(mode.exponent.real)
        and -mode.exponent.real * samples.step < AT_ONCE
    ]
    if not modes:
        return (), None
    plainly, others = not current.direct and len(modes) == len(current.modes), {}
    for (delay, hold), alternative in _others(samples):
        alike = [answering(samples, mode, alternative, delay) for mode in modes]
        if not (plainly and gain_of(scores, alternative, alike) < HOPELESS):
            others[delay, hold] = alternative, solve(alternative, alike, iterations=STEPS)
    if not others:
        return (), None

    # A direct term comes in by noise, too: as it was said, but without it, is one of those compared.
    plain = current.criterion if plainly else solve(samples, modes, iterations=STEPS).criterion
    # Inputs that are held and those that act at the samples alone are one fit: the first of them is named.
    best = max(fitted.criterion for _, fitted in others.values())
    delay, hold = next(key for key, (_, fitted) in others.items() if fitted.criterion > best - ALIKE)
    if others[delay, hold][1].criterion > max(plain + UNTOLD, current.criterion):
        finding = failure("inputs_instants", delay=delay, hold=hold, given=samples.hold)
        return (finding,), Scores(*others[delay, hold], rough=False)
    least, smooth = max(plain, current.criterion) - UNTOLD, _smooth(samples)
    near = [
        (lag, alternative)
        for (lag, alternative), (_, fitted) in others.items()
        if fitted.criterion >= least and (lag or smooth)
    ]
    if samples.hold != "first":  # inputs that are held and those that act at the samples alone are one fit
        near = [(lag, alternative) for lag, alternative in near if lag or alternative == "first"]
    if current.direct and smooth:
        # A direct term at the harmonics of C(t) makes inputs that are held and those that run straight one model.
        alternative = "zero" if samples.hold == "first" else "first"
        moved = replace(samples, hold=alternative)
        answers = [answering(samples, mode, moved, 0) for mode in current.modes]
        if solve(moved, answers, current.direct, iterations=STEPS).criterion >= current.criterion - UNTOLD:
            near.append((0, alternative))
    findings = {}
    for lag, alternative in near:
        share = max(abs(np.expm1(mode.exponent * (lag or 0.5) * samples.step)) for mode in modes)
        kind = "instants" if lag else "hold"
        if kind not in findings or share > findings[kind].numbers["share"]:
            findings[kind] = warning("inputs_untold", delay=lag, hold=alternative, given=samples.hold, share=share)
    return tuple(findings.values()), None


def _smooth(samples: Samples) -> bool:
    """True where an input is correlated from sample to sample, as a measured one is; white inputs are held."""
    inputs = samples.each(samples.inputs, lambda values: values - values.mean(axis=1, keepdims=True))
    products = samples.each(
        inputs, lambda values: np.append(values[:, 1:] * values[:, :-1], np.zeros_like(values[:, :1]), axis=1)
    )
    return bool(np.any(products.sum(axis=1) > SMOOTH * np.sum(inputs**2, axis=1)))


def _others(samples: Samples) -> Iterator[tuple[tuple[int, str], Samples]]:
    """Samples whose inputs act at other instants, with the delay in samples and the hold."""
    for delay in (1, -1):
        yield (delay, samples.hold), replace(samples, inputs=_moved(samples, delay))
    for hold in ("zero", "first", "none"):
        if hold != samples.hold:
            yield (0, hold), replace(samples, hold=hold)


def _by_noise(scores: Scores) -> float:
    """Gain by noise that drives the modes: near its limits by `MANY` draws, so that chance does not decide."""
    gain = scores.by_noise()
    return scores.by_noise(MANY) if chi2_limit(1, HINT) / NEAR < gain < chi2_limit(1, SURE) * NEAR else gain


def _driven(gain: float) -> tuple[Finding, ...]:
    """Finding on what drives the system beside the inputs: what is left follows through the modes from what was left.

    Noise w on an input u acts as a force -w that nobody measured (Söderström 2007).
    """
    limits = chi2_limit(1, HINT), chi2_limit(1, SURE)
    if gain >= limits[1]:
        return (failure("inputs_noise", squares=gain, limit=limits[1], sure=True),)
    return (warning("inputs_noise", squares=gain, limit=limits[0], sure=False),) if gain >= limits[0] else ()


def _by_powers(scores: Scores) -> NDArray[np.float64]:
    """Gains by squares and cubes of the response as inputs of each mode (Billings and Voon 1983) (modes,).

    Less what is linear beside the response that repeats with the period: that is of harmonics of a linear system, and
    those that were too weak to be kept would pass for squares.
    """
    samples, current = scores.samples, scores.now
    known = len(current.columns) - len(samples.known)
    repeated, beside = (
        current.coefficients[part].T @ current.columns[part] for part in (slice(known, None), slice(known))
    )
    size = beside.std(axis=1, keepdims=True)
    size = np.where(size > 0.0, size, 1.0)
    repeated, beside = ((part - part.mean(axis=1, keepdims=True)) / size for part in (repeated, beside))
    powers = np.concatenate([beside**2, beside**2 * (beside + 3.0 * repeated)])
    powers -= powers.mean(axis=1, keepdims=True)
    return scores.by_inputs([(number, mode.axis) for number, mode in enumerate(current.modes)], powers)


def _nonlinear(scores: Scores, gains: NDArray[np.float64]) -> tuple[Finding, ...]:
    """Finding on squares and cubes of the response that drive the modes as inputs would."""
    limit = chi2_limit(POWERS * len(scores.now.left), BENT / max(len(gains), 1))
    if gains.max(initial=0.0) < limit:
        return ()
    return (failure("inputs_nonlinear", squares=float(gains.max()), limit=limit),)


POOR = 2.0
"""Deviations that some b of an input must be from zero, or it is not known how the input reaches the modes."""

BUSY = 0.5
"""The share of samples at which an input that began late moves from then on: one that is silent often is blows."""


def reach(case: Any, _: Evidence) -> tuple[Finding, ...]:
    """Findings on modes that no input reaches, and on inputs that were measured from later on alone."""
    findings = _unreached(case.fit)
    ringing = any(not finding.numbers["line"] for finding in findings)
    return (*findings, *(_began(case.own) if case.coloured or ringing else ()))


def _unreached(fit: Uncertainty) -> tuple[Finding, ...]:
    """Findings on modes that no input reaches as far as the record shows: what does not decay there is a line."""
    findings, longest = [], max(record.stop - record.start for record in fit.samples.records) * fit.samples.step
    for number, mode in enumerate(fit.at.modes):
        place, free = fit.places[number]
        size, starts = mode.gains.size, len(mode.initial)
        gains = np.concatenate([mode.gains.real.ravel(), mode.gains.imag.ravel()])
        # The imaginary part of a real multiplier's turn zero is no parameter.
        there = np.concatenate([np.ones(size, bool), np.tile(mode.reach > 0.0, len(mode.gains)) | (not mode.real)])
        later = 1 + size if mode.real else 2 + size + starts
        rows = np.concatenate([np.arange(1, 1 + size), np.arange(later, later + size)])[there]
        flat = gains[there]
        if not free[rows].all():
            continue  # its scale is that of an input: that one reaches it
        index = place.start + np.cumsum(free)[rows] - 1
        spread = fit.parameters[np.ix_(index, index)]
        if wald_rise(flat, spread) < chi2_limit(len(index), SURE):
            half = mode.turns[0] % 1.0 if mode.real else 0.0  # of a negative multiplier
            exponent = mode.exponent + 1j * half * fit.samples.fundamental
            line = abs(exponent.real) * longest < 1.0
            report, hertz = failure if line else warning, abs(exponent) / (2.0 * np.pi)
            findings.append(report("unreached", frequency=hertz, line=line))
    return tuple(findings)


def _began(parted: Parted) -> tuple[Finding, ...]:
    """Findings on inputs that begin later than a record, as where they were measured from then on alone.

    What drove the system before is taken for modes that ring from the begin, which no input reaches.
    """
    samples, findings = parted.samples, []
    for number, part in enumerate(samples.records, start=1):
        moves = samples.inputs[:, part] != samples.inputs[:, part.start, None]
        quiet = moves.argmax(axis=1)
        busy = [bool(row[first:].mean() > BUSY) for row, first in zip(moves, quiet, strict=True)]
        late = np.flatnonzero(busy & (quiet * samples.step * samples.fundamental > 2.0 * np.pi))
        if len(late):
            names, seconds = [parted.inputs[row].name for row in late], float(quiet[late].max()) * samples.step
            findings.append(failure("inputs_began", channels=names, record=number, seconds=seconds))
    return tuple(findings)


def undriven(model: PeriodicModel) -> tuple[Finding, ...]:
    """Finding on inputs whose b is not determined: they act at too few phases of the period, or frequencies."""
    inputs = model.inputs
    if inputs is None or inputs.coefficient_std is None:
        return ()
    size, std = np.abs(inputs.coefficients), np.abs(inputs.coefficient_std)
    # The b that is the scale of a mode has no deviation: it is told if the others of that mode are known by it.
    fixed = np.where(std == 0.0, size, 0.0).max(axis=-1) > POOR * std.max(axis=-1)
    determined = np.any(((size > POOR * std) & (std > 0.0)).any(axis=-1) | fixed, axis=0)
    names = [inputs.channels[row].name for row in np.flatnonzero(~determined)]
    return (warning("inputs_poor", channels=names),) if names else ()
