"""The verdict on a fit with inputs: what was done, what the record does not tell, what stands against the model."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from floquid.core import PeriodicModel
from floquid.findings import Finding, failure, note, warning
from floquid.innovations import turned_records
from floquid.inputs import (
    Limits,
    Linearisation,
    Samples,
    Scores,
    Uncertainty,
    answering,
    gain_of,
    limit_of,
    nearly_one,
    period_step,
    phase_step,
    solve,
)
from floquid.pipeline.excited._analysis import HELD_OUT
from floquid.pipeline.excited._prepare import Parted

SIGNIFICANT = 5.0
"""Deviations from which on the period is another one than that given."""

SLIP = 0.05
"""Periods by which one may be off over a record, and its own be told to first order: inputs then meet its phase yet."""

COLOURED, WRONG = 0.1, 0.3
"""The sum of squared correlations from which on what is left is no white noise, and the model is not what left it."""

VAGUE = 0.5
"""The deviation of the decay of a real multiplier over it, from which on it is not determined,"""

ROUGHLY = 0.1
"""where that is more than this over a period [nepers]."""

SPIKE, SPOILT, QUARTILE = 12.0, 0.1, 0.6745
"""Deviations from which on a sample is no noise, the share of the power in such that spoils a fit, and the median
size of a normal number, from which the deviation is taken."""

POOR = 2.0
"""Deviations that some b of an input must be from zero, or it is not known how the input reaches the modes."""

REACHED = 1e-6
"""The probability at which noise may pass for a way from the inputs to a mode."""

SURE = 1e-9
"""The probability at which noise may pass for something that is told."""

NOISE = 1e-6
"""The probability at which noise of sensors may pass for noise that drives the system."""

HINT = 1e-3
"""The probability, were scores normal, at which it may pass for a little of such noise: six of 700 records do."""

NEAR, MANY = 2.0, 300
"""The factor within which a gain is near a limit, and the draws that tell it then."""

MORE = 2.0
"""What squares and cubes must gain, over what noise that drives the system does: it lets them gain by chance."""

OPEN = 2.0
"""Deviations within which a pair is on the axis, and two real multipliers are one."""

UNTOLD = 15.0
"""The criterion of a fit of one size over another below which the record does not tell them: Φ(-√15) is 10⁻⁴/2."""

SMOOTH = 0.15
"""The correlation of an input from sample to sample above which it may run on between them: 0.25 behind a filter."""

HOPELESS = -50.0
"""The gain to first order below which other instants are not fitted."""

STEPS = 10
"""Steps of the fit with other instants."""

TAKING_UP = 0.3
"""The deviation of a decay over it, from which on a mode may stand for inputs at other instants."""

AT_ONCE = 1.0
"""The decay from sample to sample from which on it may, too [nepers]."""


def verdict(
    own: Parted, fit: Uncertainty, model: PeriodicModel, held_out: NDArray[np.float64], limits: Limits, most: int | None
) -> tuple[Finding, ...]:
    """All findings on a model whose harmonics were looked for up to `most`, or None: it has all, from each phase."""
    samples, scores = own.samples, Scores(own.samples, fit.at, rough=False)
    phases = round(2.0 * np.pi / (samples.fundamental * samples.step))
    # Noise and squares leave what the other does, too: squares gain several times what noise does where they are there.
    by_noise, by_powers = _by_noise(scores), _by_powers(scores)
    poor, (instants, other) = undriven(model), _instants(fit, scores)
    noisy = MORE * by_noise > by_powers.max(initial=0.0)
    return (
        *done_beside(own),
        *([note("inputs_free", phases=phases)] if most is None else []),
        *(poor or ([needed(model, limits, _seen(scores))] if most is not None else [])),
        *_unreached(fit),
        # Inputs at other instants leave what noise and squares do, and noise on them what others explain, too.
        *(_driven(_by_noise(other) if other else by_noise) if other or noisy else _nonlinear(scores, by_powers)),
        *instants,
        *_kinds(model),
        *_against(fit.at, held_out),
        *of_outliers(fit.at.left, own),
        *_ended(samples, fit.at, model, limits, most),
        *(() if own.shafts else of_period(samples, *period_step(scores))),
        *of_phases(samples, [phase_step(scores, number) for number in range(1, len(own.records))]),
    )


def at_limit(found: Linearisation, limits: Limits) -> bool:
    """True where a search found no mode, or one with as many harmonics as are looked for."""
    widest = max((max(abs(mode.turns).max(), abs(mode.reach).max()) for mode in found.modes), default=np.inf)
    return bool(widest >= limits.highest)


def done_beside(own: Parted) -> tuple[Finding, ...]:
    """Findings on what was fitted beside the modes."""
    names = [channel.name for channel in own.inputs]
    done = [note("inputs", channels=names, hold=own.samples.hold)] if names else []
    used = {own_channel.name for own_channel in (*own.outputs, *own.inputs)}
    forces = {c.name for record in own.records for c in record.channels if c.quantity == "force"}
    done += [note("no_response", channel=name, quantity="force") for name in sorted(forces - used)]
    return (*done, *own.findings, *(finding for shaft in own.shafts for finding in shaft.findings))


def _seen(scores: Scores) -> list[tuple[float, int]]:
    """Squared deviations of the shape of each mode from zero, and how many numbers it has."""
    columns, channels = scores.now.slices(), len(scores.left)
    sizes = [channels * (own.stop - own.start) for own, _ in columns]
    return list(zip(scores.of_modes().tolist(), sizes, strict=True))


def needed(model: PeriodicModel, limits: Limits, seen: Sequence[tuple[float, int]]) -> Finding:
    """Finding on the mode that would be missed least, of (squared deviations of a shape from zero, numbers in it) each.

    The modes are those of the model in their order, of each conjugate pair one.
    """
    rises = [squares / limit_of(degrees, limits.mode_alarm) for squares, degrees in seen]
    least = int(np.argmin(rises))
    hertz = abs(model.exponents[model.upper_modes[least]]) / (2.0 * np.pi)
    return note("excited_order", modes=len(rises), frequency=hertz, rise=rises[least])


def _unreached(fit: Uncertainty) -> tuple[Finding, ...]:
    """Findings on modes that no input reaches as far as the record shows: what does not decay there is a line."""
    from scipy.special import chdtri

    found, longest = [], max(own.stop - own.start for own in fit.samples.records) * fit.samples.step
    for number, mode in enumerate(fit.at.modes):
        place, free = fit.places[number]
        size, starts = mode.gains.size, len(mode.initial)
        own = np.concatenate([mode.gains.real.ravel(), mode.gains.imag.ravel()])
        # The imaginary part of a real multiplier's turn zero is no parameter.
        there = np.concatenate([np.ones(size, bool), np.tile(mode.reach > 0.0, len(mode.gains)) | (not mode.real)])
        later = 1 + size if mode.real else 2 + size + starts
        rows = np.concatenate([np.arange(1, 1 + size), np.arange(later, later + size)])[there]
        flat = own[there]
        if not free[rows].all():
            continue  # its scale is that of an input: that one reaches it
        index = place.start + np.cumsum(free)[rows] - 1
        spread = fit.parameters[np.ix_(index, index)]
        if float(flat @ np.linalg.pinv(spread, hermitian=True) @ flat) < chdtri(len(index), REACHED):
            half = mode.turns[0] % 1.0 if mode.real else 0.0  # of a negative multiplier
            exponent = mode.exponent + 1j * half * fit.samples.fundamental
            line = abs(exponent.real) * longest < 1.0
            told, code = (failure, "unreached_line") if line else (warning, "unreached")
            found.append(told(code, frequency=abs(exponent) / (2.0 * np.pi)))
    return tuple(found)


def undriven(model: PeriodicModel) -> tuple[Finding, ...]:
    """Finding on inputs of which no b is told from none: they act at too few phases of the period, or frequencies."""
    own = model.inputs
    if own is None or own.coefficient_std is None:
        return ()
    size, std = np.abs(own.coefficients), np.abs(own.coefficient_std)
    # The b that is the scale of a mode has no deviation: it is told if the others of that mode are known by it.
    fixed = np.where(std == 0.0, size, 0.0).max(axis=-1) > POOR * std.max(axis=-1)
    told = np.any(((size > POOR * std) & (std > 0.0)).any(axis=-1) | fixed, axis=0)
    names = [own.channels[row].name for row in np.flatnonzero(~told)]
    return (warning("inputs_poor", channels=names),) if names else ()


def of_period(samples: Samples, step: float, std: float, slip: float = SLIP) -> tuple[Finding, ...]:
    """Finding on a period that is not that of the response: (own - given)/given and its deviation, to first order."""
    if abs(step) <= SIGNIFICANT * std:
        return ()
    given = 2.0 * np.pi / samples.fundamental
    longest = max(own.stop - own.start for own in samples.records) * samples.step / given
    if abs(step) * longest > slip:
        return (failure("inputs_period_far", given=given, deviations=abs(step) / std),)
    return (failure("inputs_period", own=given * (1.0 + step), std=given * std, given=given),)


def of_outliers(left: NDArray[np.float64], own: Parted) -> tuple[Finding, ...]:
    """Findings on samples, in what is left of each output (outputs, samples), that are no noise: spikes."""
    found = []
    for values, channel in zip(left, own.outputs, strict=True):
        far = np.abs(values) > SPIKE * np.median(np.abs(values)) / QUARTILE
        if far.any():
            share, first = float(np.sum(values[far] ** 2) / np.sum(values**2)), int(np.argmax(far))
            record = int(np.searchsorted(own.samples.begins, first, side="right"))
            sample = first - own.samples.begins[record - 1] + 1
            told, number = failure if share > SPOILT else warning, int(far.sum())
            numbers = {"number": number, "share": share, "record": record, "sample": sample}
            found.append(told("outliers", channel=channel.name, **numbers))
    return tuple(found)


def of_phases(samples: Samples, steps: Sequence[tuple[float, float]]) -> tuple[Finding, ...]:
    """Findings on records after the first that are at another phase: steps in periods and their deviations, of each.

    By half a period the slope along the phase is none: that is told by how their products turn.
    """
    turned = turned_records(samples) if steps else []
    return (
        *(failure("records_turned", record=number + 1) for number in turned),
        *(
            failure("records_phase", record=number + 1, deviations=abs(step) / std)
            for number, (step, std) in enumerate(steps, start=1)
            if number not in turned and abs(step) > SIGNIFICANT * std
        ),
    )


def _ended(
    samples: Samples, found: Linearisation, model: PeriodicModel, limits: Limits, most: int | None
) -> tuple[Finding, ...]:
    """Findings on limits at which the search ended, and on modes that the record does not determine."""
    ended = [warning("inputs_modes", most=limits.modes)] if len(found.modes) >= limits.modes else []
    if undetermined(model):
        ended.append(failure("inputs_undetermined"))
    if most is not None and at_limit(found, limits):
        if nearly_one(samples, found):  # harmonics beyond the limit are made up for by a copy of the mode
            ended.append(failure("inputs_copies", most=limits.highest))
        elif limits.highest == most:
            ended.append(warning("inputs_harmonics", most=most))
    return tuple(ended)


def undetermined(model: PeriodicModel) -> bool:
    """True where a mode's decay is not known within a period, or that of a real multiplier hardly at all.

    Real multipliers that make up for one another, or for a pair, are of that kind; one of slow decay is not.
    """
    assert model.exponent_std is not None
    spread = model.exponent_std.real
    vague = (spread > VAGUE * np.abs(model.exponents.real)) & (model.period * spread > ROUGHLY)
    return bool((model.period * spread > 1.0).any() or (model.real & vague).any())


def _kinds(model: PeriodicModel) -> tuple[Finding, ...]:
    """Finding on pairs that may be two real multipliers, and on two of these that may be a pair."""
    assert model.exponent_std is not None
    spread, omega = model.exponent_std, model.fundamental
    halves = 0.5 * np.rint(2.0 * model.exponents.imag / omega)
    open_ = ~model.real & (np.abs(model.exponents.imag - halves * omega) < OPEN * spread.imag)
    for one, other in combinations(np.flatnonzero(model.real), 2):
        gap = abs(model.exponents[one].real - model.exponents[other].real)
        if (halves[one] - halves[other]) % 1.0 == 0.0 and gap < OPEN * np.hypot(spread.real[one], spread.real[other]):
            open_[[one, other]] = True
    if not open_.any():
        return ()
    hertz = np.unique(np.abs(model.exponents[open_])) / (2.0 * np.pi)
    return (warning("inputs_kind", frequencies=hertz.tolist()),)


def _against(found: Linearisation, held_out: NDArray[np.float64]) -> tuple[Finding, ...]:
    """Findings against the model: samples left out that it does not predict, and colour in what it leaves."""
    against = []
    if (held_out >= HELD_OUT).any():
        against.append(warning("inputs_held_out", error=float(np.nanmax(held_out))))
    if found.colour > COLOURED:
        told = failure if found.colour > WRONG else warning
        against.append(told("inputs_colour", squares=found.colour))
    return tuple(against)


def _moved(samples: Samples, lag: int) -> NDArray[np.float64]:
    """The inputs some samples ago, zero where there were none (inputs, samples)."""

    def of(own: NDArray) -> NDArray:
        found, count = np.zeros_like(own), own.shape[1]
        if abs(lag) < count:
            found[:, max(lag, 0) : count + min(lag, 0)] = own[:, max(-lag, 0) : count - max(lag, 0)]
        return found

    return samples.each(samples.inputs, of)


def _instants(fit: Uncertainty, scores: Scores) -> tuple[tuple[Finding, ...], Scores | None]:
    """Finding on inputs that come late or early, or between the samples in another way than `hold` says.

    With it, where that is so, the scores of the fit with inputs as they were then.

    Gains take up a delay but for the first samples of each response. For those a direct term stands, or modes that die
    at once: with the right instants none of that is needed. Else a fit to first order tells what no other needs to be.
    """
    samples, now = scores.samples, scores.now
    modes = [
        mode
        for mode, (place, _) in zip(now.modes, fit.places, strict=True)
        if fit.parameters[place.start, place.start] ** 0.5 < TAKING_UP * abs(mode.exponent.real)
        and -mode.exponent.real * samples.step < AT_ONCE
    ]
    if not modes:
        return (), None
    plainly, others = not now.direct and len(modes) == len(now.modes), {}
    for (delay, hold), other in _others(samples):
        alike = [answering(samples, mode, other, delay) for mode in modes]
        if not (plainly and gain_of(scores, other, alike) < HOPELESS):
            others[delay, hold] = other, solve(other, alike, iterations=STEPS)
    if not others:
        return (), None

    # A direct term comes in by noise, too: as it was said, but without it, is one of those compared.
    plain = now.criterion if plainly else solve(samples, modes, iterations=STEPS).criterion
    delay, hold = max(others, key=lambda key: others[key][1].criterion)
    if others[delay, hold][1].criterion > max(plain + UNTOLD, now.criterion):
        told = failure("inputs_instants", delay=delay, hold=hold, given=samples.hold)
        return (told,), Scores(*others[delay, hold], rough=False)
    least, smooth = max(plain, now.criterion) - UNTOLD, _smooth(samples)
    near = [(own, other) for (own, other), (_, found) in others.items() if found.criterion >= least and (own or smooth)]
    if samples.hold != "first":  # inputs that are held and those that act at the samples alone are one fit
        near = [(own, other) for own, other in near if own or other == "first"]
    if now.direct and smooth and samples.hold != "none":
        # A direct term at the harmonics of C(t) makes inputs that are held and those that run straight one model.
        other = "first" if samples.hold == "zero" else "zero"
        moved = replace(samples, hold=other)
        answers = [answering(samples, mode, moved, 0) for mode in now.modes]
        if solve(moved, answers, now.direct, iterations=STEPS).criterion >= now.criterion - UNTOLD:
            near.append((0, other))
    if not near:
        return (), None
    shares = {key: max(abs(np.expm1(mode.exponent * (key[0] or 0.5) * samples.step)) for mode in modes) for key in near}
    delay, hold = max(shares, key=lambda key: shares[key])
    return (warning("inputs_untold", delay=delay, hold=hold, given=samples.hold, share=shares[delay, hold]),), None


def _smooth(samples: Samples) -> bool:
    """Whether an input goes on from sample to sample, as what was measured does: white ones are held."""
    inputs = samples.inputs - samples.inputs.mean(axis=1, keepdims=True)
    return bool(np.any(np.sum(inputs[:, 1:] * inputs[:, :-1], axis=1) > SMOOTH * np.sum(inputs**2, axis=1)))


def _others(samples: Samples) -> Iterator[tuple[tuple[int, str], Samples]]:
    """Samples of which the inputs act at other instants, with the delay in samples and the hold."""
    for delay in (1, -1):
        yield (delay, samples.hold), replace(samples, inputs=_moved(samples, delay))
    for hold in ("zero", "first", "none"):
        if hold != samples.hold:
            yield (0, hold), replace(samples, hold=hold)


def _by_noise(scores: Scores) -> float:
    """The gain by noise that drives the modes: near its limits by so many draws that these do not decide."""
    gain = scores.by_noise()
    return scores.by_noise(MANY) if limit_of(1, HINT) / NEAR < gain < limit_of(1, NOISE) * NEAR else gain


def _driven(gain: float) -> tuple[Finding, ...]:
    """Finding on what drives the system beside the inputs: what is left follows through the modes from what was left.

    Noise w on an input u acts as a force -w that nobody measured (Söderström 2007).
    """
    limits = limit_of(1, HINT), limit_of(1, NOISE)
    if gain >= limits[1]:
        return (failure("inputs_noise", squares=gain, limit=limits[1]),)
    return (warning("inputs_some_noise", squares=gain, limit=limits[0]),) if gain >= limits[0] else ()


def _by_powers(scores: Scores) -> NDArray[np.float64]:
    """Gains by squares and cubes of the response as inputs of each mode (Billings and Voon 1983) (modes,).

    Less what is linear beside the response that repeats with the period: that is of harmonics of a linear system, and
    those that were too weak to be kept would pass for squares.
    """
    samples, now = scores.samples, scores.now
    known = len(now.columns) - len(samples.known)
    repeated, beside = (now.coefficients[own].T @ now.columns[own] for own in (slice(known, None), slice(known)))
    size = beside.std(axis=1, keepdims=True)
    size = np.where(size > 0.0, size, 1.0)
    repeated, beside = ((own - own.mean(axis=1, keepdims=True)) / size for own in (repeated, beside))
    powers = np.concatenate([beside**2, beside**2 * (beside + 3.0 * repeated)])
    powers -= powers.mean(axis=1, keepdims=True)
    return scores.by_inputs([(number, mode.lowest) for number, mode in enumerate(now.modes)], powers)


def _nonlinear(scores: Scores, gains: NDArray[np.float64]) -> tuple[Finding, ...]:
    """Finding on squares and cubes of the response that drive the modes as inputs would."""
    limit = limit_of(4 * len(scores.now.left), SURE / max(len(gains), 1))
    if gains.max(initial=0.0) < limit:
        return ()
    return (failure("inputs_nonlinear", squares=float(gains.max()), limit=limit),)
