"""Checks of the drive: inputs to modes, their instants, noise on them, and powers of the response."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Floats
from floquid.checks._check import Evidence
from floquid.core import PeriodicModel
from floquid.findings import Finding, failure, warning
from floquid.fit import DEVIATIONS, RARE, SURE, WITHIN, chi2_limit, is_vague, wald_rise
from floquid.innovations import GONE
from floquid.inputs import Samples, Scores, Uncertainty, answering, gain_of, solve

if TYPE_CHECKING:
    from floquid.checks._excited import Parted

BENT = 1e-9  # the probability at which noise may pass for powers of the response: these have longer tails than noise
MORE = 2.0  # least gain by squares and cubes over that by driving noise, which lets them gain by chance
UNTOLD = DEVIATIONS**2  # the criterion of a fit of one size over another below which the record does not tell them


def driving(case: Any, _: Evidence) -> tuple[Finding, ...]:
    """Findings on inputs at other instants, and on what drives the modes beside the inputs."""
    # Inputs at other instants leave what noise and squares do, so that these are looked for with the instants found.
    findings, moved = _instants(case.fit, case.tested)
    return (*_beside(moved or case.tested), *findings)


def _beside(scores: Scores) -> tuple[Finding, ...]:
    """Finding on noise, or powers of the response, that drives the modes: each leaves some of what the other leaves."""
    # Where squares are there they gain several times what noise does, more than they do by chance.
    by_noise, (by_powers, degrees) = scores.by_noise(), _by_powers(scores)
    noisy = MORE * by_noise > by_powers.max(initial=0.0) - degrees
    return (() if noisy else _nonlinear(by_powers, degrees)) or _driven(by_noise)


def _moved(samples: Samples, lag: int) -> Floats:
    """The inputs some samples ago, zero where there were none (inputs, samples)."""

    def of(values: NDArray) -> NDArray:
        moved, count = np.zeros_like(values), values.shape[1]
        if abs(lag) < count:
            moved[:, max(lag, 0) : count + min(lag, 0)] = values[:, max(-lag, 0) : count - max(lag, 0)]
        return moved

    return samples.each(samples.inputs, of)


def _instants(fit: Uncertainty, scores: Scores) -> tuple[tuple[Finding, ...], Scores | None]:
    """Finding on inputs that come late or early, or between the samples in another way than `hold` says."""
    # With it, where that is so, the scores of the fit with inputs as they were then.
    # Gains take up a delay except in the first samples of each response. A direct term takes those up, or modes that
    # die at once: with the instants of the inputs none of that is needed. Else a fit to first order tells what no other
    # needs to be.
    samples, current = scores.samples, scores.now
    modes = [
        mode
        for mode, (place, _) in zip(current.modes, fit.places, strict=True)
        if not is_vague(fit.parameters[place.start, place.start] ** 0.5, mode.exponent.real)
        and -mode.exponent.real * samples.step < GONE
    ]
    if not modes:
        return (), None
    plainly, others = not current.direct and len(modes) == len(current.modes), {}
    for delay, alternative in _others(samples):
        answers = [answering(samples, mode, alternative, delay) for mode in modes]
        if not (plainly and gain_of(scores, alternative, answers) < -UNTOLD):
            others[delay] = alternative, solve(alternative, answers)
    if not others:
        return (), None

    # A direct term comes in by noise, too: as it was said, but without it, is one of those compared.
    plain = current.criterion if plainly else solve(samples, modes).criterion
    delay, (moved, fitted) = max(others.items(), key=lambda other: other[1][1].criterion)
    if fitted.criterion > max(plain + UNTOLD, current.criterion):
        finding = failure("inputs_instants", delay=delay, hold=moved.hold, given=samples.hold)
        return (finding,), Scores(moved, fitted, rough=False)
    least, smooth = max(plain, current.criterion) - UNTOLD, _smooth(samples)
    near = [delay for delay, (_, fitted) in others.items() if fitted.criterion >= least and (delay or smooth)]
    if current.direct and smooth:
        # A direct term at the harmonics of C(t) makes inputs that are held and those that run straight one model.
        moved = _held_otherwise(samples)
        answers = [answering(samples, mode, moved, 0) for mode in current.modes]
        if solve(moved, answers, current.direct).criterion >= current.criterion - UNTOLD:
            near.append(0)
    findings = {}
    for delay in near:
        share = max(abs(np.expm1(mode.exponent * (delay or 0.5) * samples.step)) for mode in modes)
        kind = "instants" if delay else "hold"
        if kind not in findings or share > findings[kind].numbers["share"]:
            hold = samples.hold if delay else _held_otherwise(samples).hold
            findings[kind] = warning("inputs_untold", delay=delay, hold=hold, given=samples.hold, share=share)
    return tuple(findings.values()), None


def _smooth(samples: Samples) -> bool:
    """True where an input is correlated from sample to sample, as a measured one is; white inputs are held."""
    inputs = samples.each(samples.inputs, lambda values: values - values.mean(axis=1, keepdims=True))
    products = samples.each(
        inputs, lambda values: np.append(values[:, 1:] * values[:, :-1], np.zeros_like(values[:, :1]), axis=1)
    )
    chance = DEVIATIONS / samples.n_samples**0.5
    return bool(np.any(products.sum(axis=1) > chance * np.sum(inputs**2, axis=1)))


def _others(samples: Samples) -> Iterator[tuple[int, Samples]]:
    """Samples whose inputs act at other instants, with the delay in samples: zero of another hold."""
    for delay in (1, -1):
        yield delay, replace(samples, inputs=_moved(samples, delay))
    yield 0, _held_otherwise(samples)


def _held_otherwise(samples: Samples) -> Samples:
    """Samples of another hold: inputs that are held and those that act at the samples alone are one fit."""
    return replace(samples, hold="zero" if samples.hold == "first" else "first")


def _driven(gain: float) -> tuple[Finding, ...]:
    """Finding on what drives the system beside the inputs: what is left follows through the modes from what was left.

    Noise w on an input u acts as a force -w that nobody measured (Söderström 2007).
    """
    for report, level in ((failure, SURE), (warning, RARE)):
        if gain >= (limit := chi2_limit(1, level)):
            return (report("inputs_noise", squares=gain, limit=limit, sure=level == SURE),)
    return ()


def _by_powers(scores: Scores) -> tuple[Floats, int]:
    """Gains by squares and cubes of the response as inputs of each mode (Billings and Voon 1983) (modes,)."""
    # With them, how many numbers that is of one mode.
    # Less what is linear beside the response that repeats with the period: that is of harmonics of a linear system, and
    # those that were too weak to be kept would pass for squares.
    samples, current = scores.samples, scores.now
    known = current.columns.count - len(samples.known)
    repeated, beside = (
        current.columns.response(current.coefficients, part) for part in (slice(known, None), slice(known))
    )
    size = beside.std(axis=1, keepdims=True)
    size = np.where(size > 0.0, size, 1.0)
    repeated, beside = ((part - part.mean(axis=1, keepdims=True)) / size for part in (repeated, beside))
    powers = np.concatenate([beside**2, beside**2 * (beside + 3.0 * repeated)])
    powers -= powers.mean(axis=1, keepdims=True)
    asked = [(number, mode.axis) for number, mode in enumerate(current.modes)]
    return scores.by_inputs(asked, powers), 2 * len(powers)


def _nonlinear(gains: Floats, degrees: int) -> tuple[Finding, ...]:
    """Finding on squares and cubes of the response that drive the modes as inputs would."""
    limit = chi2_limit(degrees, BENT / max(len(gains), 1))
    if gains.max(initial=0.0) < limit:
        return ()
    return (failure("inputs_nonlinear", squares=float(gains.max()), limit=limit),)


def reach(case: Any, _: Evidence) -> tuple[Finding, ...]:
    """Findings on modes that no input reaches, and on inputs that were measured from later on alone."""
    findings = _unreached(case.fit)
    ringing = any(not finding.numbers["line"] for finding in findings)
    return (*findings, *(_began(case.own) if case.coloured or ringing else ()))


def _unreached(fit: Uncertainty) -> tuple[Finding, ...]:
    """Findings on modes that no input reaches as far as the record shows: what does not decay there is a line."""
    longest = max(record.stop - record.start for record in fit.samples.records) * fit.samples.step
    hertz: dict[bool, list[float]] = {True: [], False: []}
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
            hertz[bool(abs(exponent.real) * longest < 1.0)].append(abs(exponent) / (2.0 * np.pi))
    return tuple(
        (failure if line else warning)("unreached", frequencies=own, line=line) for line, own in hertz.items() if own
    )


def _began(parted: Parted) -> tuple[Finding, ...]:
    """Findings on inputs that begin later than a record, as where they were measured from then on alone."""
    # What drove the system before is taken for modes that ring from the begin, which no input reaches.
    samples, findings = parted.samples, []
    for number, part in enumerate(samples.records, start=1):
        moves = samples.inputs[:, part] != samples.inputs[:, part.start, None]
        quiet = moves.argmax(axis=1)
        # One that is silent most of the time is blows.
        busy = [bool(np.median(row[first:])) for row, first in zip(moves, quiet, strict=True)]
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
    fixed = np.where(std == 0.0, size, 0.0).max(axis=-1) > WITHIN * std.max(axis=-1)
    determined = np.any(((size > WITHIN * std) & (std > 0.0)).any(axis=-1) | fixed, axis=0)
    names = [inputs.channels[row].name for row in np.flatnonzero(~determined)]
    return (warning("inputs_poor", channels=names),) if names else ()
