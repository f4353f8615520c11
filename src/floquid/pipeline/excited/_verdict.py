"""The verdict on a fit with inputs: what was done, what the record does not tell, what stands against the model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from floquid.core import PeriodicModel
from floquid.errors import IdentificationError
from floquid.findings import Finding, failure, note, warning
from floquid.fit import DEVIATIONS, SURE, chi2_limit, wald_rise
from floquid.innovations import Predictor, colour, turned_records
from floquid.inputs import (
    Limits,
    Linearisation,
    Samples,
    Scores,
    Uncertainty,
    nearly_one,
    period_step,
    phase_step,
)
from floquid.pipeline.excited._driving import of_driving
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

SHAKEN, BLURRED = 0.5, 2.0
"""Shares of the variance of what is left that errors of the shaft's angle may make, and up to which a model stands."""

BUSY = 0.5
"""The share of samples at which an input that began late moves from then on: one that is silent often is blows."""


def verdict(
    own: Parted, fit: Uncertainty, model: PeriodicModel, limits: Limits, most: int | None
) -> tuple[Finding, ...]:
    """All findings on a model whose harmonics were looked for up to `most`, or None: it has all, from each phase."""
    samples, scores = own.samples, Scores(own.samples, fit.at, rough=False)
    phases = round(2.0 * np.pi / (samples.fundamental * samples.step))
    poor = undriven(model)
    return (
        *done_beside(own),
        *([note("inputs_free", phases=phases)] if most is None else []),
        *(poor or ([needed(model, limits, _seen(scores))] if most is not None else [])),
        # A wrong period or phase is the cause of much else: it comes first.
        *(() if own.shafts else of_period(samples, *period_step(scores))),
        *of_angle(own, fit.at.coefficients[-len(samples.known) :].T, fit.at.noise),
        *of_phases(samples, [phase_step(scores, number) for number in range(1, len(own.records))]),
        *(unreached := _unreached(fit)),
        *(_began(own) if fit.at.colour > COLOURED or any(one.code == "unreached" for one in unreached) else ()),
        *of_driving(fit, scores),
        *_against(fit.at),
        *of_outliers(fit.at.left, own),
        *_ended(samples, fit.at, model, limits, most),
    )


def at_limit(found: Linearisation, limits: Limits) -> bool:
    """True where a search found no mode, or one with as many harmonics as are looked for."""
    widest = max((max(abs(mode.turns).max(), abs(mode.reach).max()) for mode in found.modes), default=np.inf)
    return bool(widest >= limits.highest)


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


def done_beside(own: Parted) -> tuple[Finding, ...]:
    """Findings on what was fitted beside the modes."""
    names = [channel.name for channel in own.inputs]
    done = [note("inputs", channels=names, hold=own.samples.hold)] if names else []
    used = {own_channel.name for own_channel in (*own.outputs, *own.inputs)}
    forces = {c.name for record in own.records for c in record.channels if c.quantity == "force"}
    done += [note("no_response", channel=name, quantity="force") for name in sorted(forces - used)]
    said = (finding for shaft in own.shafts for finding in shaft.findings if finding.code != "angle_alike")
    return (*done, *own.findings, *said)


def of_angle(own: Parted, columns: NDArray[np.float64], noise: NDArray[np.float64]) -> tuple[Finding, ...]:
    r"""Findings on what the error of the shaft's angle makes of the response, over the variance of what is left.

    .. math:: \max_c \frac{\sigma_\theta^2}{s_c^2} \Big(\frac12 \sum_j (j\, a_{c,j})^2 + \sigma_c^2\Big)

    with a the amplitudes of the harmonics j of the steady response, of `columns` (channels, known), σ the deviations of
    the angle of the system and of the rest of the response, and s the `noise` (channels,).
    """
    if not own.shafts:
        return ()
    samples, several = own.samples, own.periods_per_revolution
    columns = columns[:, : len(samples.known)]  # inputs that act at once may follow
    parts = columns[:, len(samples.records) :].reshape(len(columns), len(own.turns), 2)
    steady = 0.5 * np.sum((np.array(own.turns)[:, None] * parts) ** 2, axis=(1, 2))
    power = float(np.max((steady + np.var(samples.values - columns @ samples.known, axis=1)) / noise**2))
    found = []
    for shaft, record in zip(own.shafts, own.records, strict=True):
        std = several * float(np.sqrt(np.mean(shaft.angle_std(np.clip(record.times, shaft.first, shaft.last)) ** 2)))
        if (share := std**2 * power) > SHAKEN:
            told = failure if share > BLURRED else warning
            found.append(told("excited_angle", degrees=float(np.degrees(std / several)), share=share))
        left = several**2 * float(np.mean(shaft.residuals[shaft.kept] ** 2))
        found += [finding for finding in shaft.findings if finding.code == "angle_alike" and left * power > SHAKEN]
    return tuple(found)


def _seen(scores: Scores) -> list[tuple[float, int]]:
    """Squared deviations of the shape of each mode from zero, and how many numbers it has."""
    columns, channels = scores.now.slices(), len(scores.left)
    sizes = [channels * (own.stop - own.start) for own, _ in columns]
    return list(zip(scores.of_modes.tolist(), sizes, strict=True))


def needed(model: PeriodicModel, limits: Limits, seen: Sequence[tuple[float, int]]) -> Finding:
    """Finding on the mode that would be missed least, of (squared deviations of a shape from zero, numbers in it) each.

    The modes are those of the model in their order, of each conjugate pair one.
    """
    rises = [squares / chi2_limit(degrees, limits.mode_alarm) for squares, degrees in seen]
    least = int(np.argmin(rises))
    hertz = abs(model.exponents[model.upper_modes[least]]) / (2.0 * np.pi)
    return note("excited_order", modes=len(rises), frequency=hertz, rise=rises[least])


def _unreached(fit: Uncertainty) -> tuple[Finding, ...]:
    """Findings on modes that no input reaches as far as the record shows: what does not decay there is a line."""
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
        if wald_rise(flat, spread) < chi2_limit(len(index), SURE):
            half = mode.turns[0] % 1.0 if mode.real else 0.0  # of a negative multiplier
            exponent = mode.exponent + 1j * half * fit.samples.fundamental
            line = abs(exponent.real) * longest < 1.0
            told, code = (failure, "unreached_line") if line else (warning, "unreached")
            found.append(told(code, frequency=abs(exponent) / (2.0 * np.pi)))
    return tuple(found)


def _began(own: Parted) -> tuple[Finding, ...]:
    """Findings on inputs that begin later than a record, as where they were measured from then on alone.

    What drove the system before is taken for modes that ring from the begin, which no input reaches.
    """
    samples, found = own.samples, []
    for number, part in enumerate(samples.records, start=1):
        moves = samples.inputs[:, part] != samples.inputs[:, part.start, None]
        quiet = moves.argmax(axis=1)
        busy = [bool(row[first:].mean() > BUSY) for row, first in zip(moves, quiet, strict=True)]
        late = np.flatnonzero(busy & (quiet * samples.step * samples.fundamental > 2.0 * np.pi))
        if len(late):
            names, seconds = [own.inputs[row].name for row in late], float(quiet[late].max()) * samples.step
            found.append(failure("inputs_began", channels=names, record=number, seconds=seconds))
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
    if most is not None and _clear(model, limits.highest):
        if nearly_one(samples, found):  # harmonics beyond the limit are made up for by a copy of the mode
            ended.append(failure("inputs_copies", most=limits.highest))
        elif limits.highest == most:
            ended.append(warning("inputs_harmonics", most=most))
    return tuple(ended)


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


def undetermined(model: PeriodicModel) -> bool:
    """True where a mode's decay is not known within a period, or that of a real multiplier hardly at all.

    Real multipliers that make up for one another, or for a pair, are of that kind; one of slow decay is not.
    """
    assert model.exponent_std is not None
    spread = model.exponent_std.real
    vague = (spread > VAGUE * np.abs(model.exponents.real)) & (model.period * spread > ROUGHLY)
    return bool((model.period * spread > 1.0).any() or (model.real & vague).any())


def _against(found: Linearisation) -> tuple[Finding, ...]:
    """Finding on colour in what the model leaves."""
    if found.colour <= COLOURED:
        return ()
    told = failure if found.colour > WRONG else warning
    return (told("inputs_colour", squares=found.colour),)
