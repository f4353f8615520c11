"""What a model leaves, as numbers, limits and sentences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from floquid.core import ConstantPeriod, Record
from floquid.periodic import line_amplitudes, unexplained, without_lines
from floquid.sync import ShaftAngle
from floquid.validation._case import Case, Findings
from floquid.validation._left import colour, lines_of, peaks, rates_of, tones_of
from floquid.validation._verdict import Names, listed, sentence, strongest

TONE = 0.1
"""The amplitude of a tone, over the noise, that is let pass in any case."""

LINES_BESIDE = (-5.0, -3.0, 3.0, 5.0)
"""Lines of the record beside a tone, to hold it against."""

ABOVE = 8.0
"""What a tone has over those lines."""

COLOUR = 0.01
"""The sum of squared autocorrelations that is let pass in any case: less is no colour worth a filter."""

ROUNDING = 0.5
"""What is left, over the noise, below which the noise is no estimate but what the record is believed down to."""

LEFT_OUT = 1e-8
"""The probability at which noise passes for a harmonic where it is let be none: weaker ones are left out on purpose."""

HARMONIC = 0.01
"""The share of the response in one harmonic beside a band that is let pass in any case."""

MARGIN = 2.0
"""Standard deviations by which a harmonic has to rise above that."""


def left_by(case: Case, found: Findings) -> dict[str, NDArray]:
    """What the model leaves: tones, harmonics, other lines, colour; arrays for the reader."""
    left = [np.array(own) for own in unexplained(case.model, case.records, case.clocks)]
    tones = _tones(case, left, found)
    lines = _harmonics(case, left, found)
    hidden = _peaks(case, left, found)
    return {**tones, **lines, "colour": _colour(case, left, hidden, found)}


def _tones(case: Case, left: list[NDArray[np.float64]], found: Findings) -> dict[str, NDArray]:
    """Harmonics of the revolution; those that are found are taken off."""
    from scipy.special import chdtri

    turns, names = tones_of(case.highest, case.per_revolution), Names(case.model)
    size, score = np.zeros((2, *case.noise.shape, len(turns)))
    for hit, rest in enumerate(left):
        amplitudes, squares = line_amplitudes(*_residual(case, hit, rest), np.zeros(len(turns)), turns)
        size[:, hit] = amplitudes / case.noise[:, hit, None]
        score[:, hit] = squares / case.noise[:, hit, None] ** 2
    there = (score > chdtri(2, case.false_alarm / score.size)) & (size > TONE)
    candidates = np.flatnonzero(there.any(axis=(0, 1)))
    there[..., candidates] &= score[..., candidates] > ABOVE * _beside(case, left, turns[candidates])
    found.add("tone", float(np.max(size * there, initial=0.0)), TONE)
    which = strongest((size * there).max(axis=1))
    if which:
        parts = []
        for channel, tone in which:
            hit = int(np.argmax((size * there)[channel, :, tone]))
            words = f"{names.tone(turns[tone], case.per_revolution)} left in {names.channel(channel, hit)}"
            parts.append(f"{words}: {size[channel, hit, tone]:.3g} times its noise")
        remedy = "It is a forced response: fit it beside the modes with `forced` (`--forced`), or take it off."
        found.reasons.append(sentence(listed(parts), remedy))
    for channel, hit in {(c, h) for c, h, _ in strongest(there)}:
        own = turns[there[channel, hit]]
        left[hit][channel] = without_lines(*_residual(case, hit, left[hit]), np.zeros(len(own)), own)[channel]
    return {"turns": turns, "tones": size}


def _residual(case: Case, hit: int, left: NDArray[np.float64]) -> tuple[Record, ConstantPeriod | ShaftAngle, float]:
    """What is left of a hit, from its first sample on, as a record with its clock and period."""
    return replace(case.records[hit], values=left), case.clocks[hit], case.model.period


def _beside(case: Case, left: list[NDArray[np.float64]], turns: NDArray[np.float64]) -> NDArray[np.float64]:
    """The mean score a few lines of the record on either side of tones (channels, hits, tones).

    A tone is narrower than that; what a missing mode leaves is not.
    """
    score = np.zeros((*case.noise.shape, len(turns)))
    for hit, rest in enumerate(left):
        angles = case.instants[hit][1]
        apart = 2.0 * np.pi / max(float(angles[-1] - angles[0]), 1e-300)
        shifts = apart * np.array(LINES_BESIDE)
        near = np.abs(np.add.outer(turns, shifts)).ravel()
        _, squares = line_amplitudes(*_residual(case, hit, rest), np.zeros(len(near)), near)
        score[:, hit] = (
            squares.reshape(len(rest), len(turns), len(LINES_BESIDE)).mean(axis=2) / case.noise[:, hit, None] ** 2
        )
    return score


def _harmonics(case: Case, left: list[NDArray[np.float64]], found: Findings) -> dict[str, NDArray]:
    """Harmonics of the modes beside their bands; those that are found are taken off."""
    from scipy.special import chdtri

    model, names = case.model, Names(case.model)
    modes, harmonics = lines_of(model, case.highest)
    score = np.zeros((*case.noise.shape, len(modes)))
    for hit, rest in enumerate(left):
        alive = case.alive(hit)
        if alive.stop:
            _, squares = line_amplitudes(*_residual(case, hit, rest[:, alive]), model.exponents[modes], harmonics)
            score[:, hit] = squares / case.noise[:, hit, None] ** 2
    if not len(modes):
        return {"modes": modes, "harmonics": harmonics, "lines": score}
    joint, degrees = score.sum(axis=(0, 1)), 2 * case.responses
    there = np.sqrt(joint) > np.sqrt(chdtri(degrees, LEFT_OUT)) + MARGIN
    share = np.sqrt(np.maximum(joint - degrees, 0.0) / max(_energy(case), 1.0)) * there
    if not found.add("harmonic", float(share.max()), HARMONIC):
        over, parts = share > HARMONIC, []
        for (line,) in strongest(share * over):
            channel, hit = (int(i) for i in np.unravel_index(int(np.argmax(score[:, :, line])), case.noise.shape))
            words = f"harmonic {harmonics[line]:+d} of {names.mode(int(modes[line]))} left, {share[line]:.2g} of the"
            parts.append(f"{words} response, most in {names.channel(channel, hit)}")
        remedy = (
            "Keep more harmonics (`harmonics`), or let them be chosen; where many are left, modes are missing or wrong."
        )
        found.reasons.append(sentence(listed(parts), remedy))
        for hit, rest in enumerate(left):
            alive = case.alive(hit)
            own = _residual(case, hit, rest[:, alive])
            rest[:, alive] = without_lines(*own, model.exponents[modes[over]], harmonics[over])
    return {"modes": modes, "harmonics": harmonics, "lines": np.sqrt(score)}


def _energy(case: Case) -> float:
    """The sum of squares of the response over the noise, where it is alive."""
    total = 0.0
    for hit, record in enumerate(case.records):
        values = record.values[:, case.cycles[hit] >= 0] / case.noise[:, hit, None]
        total += float(np.nansum(values**2)) - float((~np.isnan(values)).sum())
    return total


def _peaks(case: Case, left: list[NDArray[np.float64]], found: Findings) -> NDArray[np.bool_]:
    """Lines that are none of those known, in the whole record and where the response is alive (channels, hits)."""
    names, looks = Names(case.model), []
    for hit, rest in enumerate(left):
        for end in sorted({rest.shape[1], case.alive(hit).stop} - {0}):
            score, where = peaks(rest[:, :end], case.noise[:, hit])
            numbers = np.maximum((~np.isnan(rest[:, :end])).sum(axis=1), 1)
            looks.append((hit, end // 2 + 1, score, 2.0 * np.sqrt(score / numbers), where))
    total = sum(lines * len(score) for _, lines, score, _, _ in looks)
    size, frequency = np.zeros(case.noise.shape), np.zeros(case.noise.shape)
    for hit, _, score, amplitude, where in looks:
        better = (score > np.log(total / case.false_alarm)) & (amplitude > TONE) & (amplitude > size[:, hit])
        size[better, hit] = amplitude[better]
        frequency[better, hit] = where[better] * case.records[hit].sample_rate
    if not found.add("line", float(size.max()), TONE):
        parts = [
            f"a line at {frequency[place]:.5g} Hz left in {names.channel(*place)}: {size[place]:.3g} times its noise"
            for place in strongest(size)
        ]
        remedy = (
            "It is no harmonic of the revolution, and none of those looked at of a mode: a mode that is missing "
            "(`order`, `--order`), harmonics beyond those kept (`harmonics`, `--harmonics`), a period that is not the "
            "response's own, or interference."
        )
        found.reasons.append(sentence(listed(parts), remedy))
    return size > 0


def _colour(
    case: Case, left: list[NDArray[np.float64]], hidden: NDArray[np.bool_], found: Findings
) -> NDArray[np.float64]:
    """What noise that is not white has beyond white noise (channels, hits)."""
    from scipy.special import chdtri

    model, names = case.model, Names(case.model)
    excess, limit = np.zeros(case.noise.shape), np.zeros(case.noise.shape)
    rates = rates_of(model)
    for hit, rest in enumerate(left):
        rate = case.records[hit].sample_rate
        squares, numbers, lags = colour(rest, 1.0 / rate, rates, int(2.0 * case.highest) - 1)
        size = np.maximum(numbers - 2 * len(rates), 1)
        rounding = np.sqrt(np.nanmean(rest**2, axis=1)) < ROUNDING * case.noise[:, hit]
        excess[:, hit] = np.where(rounding, 0.0, squares - lags / size)
        limit[:, hit] = np.maximum((chdtri(lags, case.false_alarm / case.responses) - lags) / size, COLOUR)
    place = np.unravel_index(int(np.argmax(excess / limit)), excess.shape)
    found.add("colour", float(excess[place]), float(limit[place]))
    over = np.where(hidden, 0.0, excess) * (excess > limit)
    which = strongest(over)
    if which:
        parts = [f"{names.channel(*where)} (squared correlations sum to {excess[where]:.3g})" for where in which]
        found.reasons.append(
            sentence(
                f"what is left is not white but broadband colour in {listed(parts)}",
                "Deviations are too small or too large there: look for modes that are missing, filters and drifts of "
                "the sensors, or a period that is not the response's own.",
            )
        )
    return excess
