"""Checks of the residual of a model: its level, lines, colour and spikes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from floquid._arrays import Complexes, Floats, Integers
from floquid.checks._check import REMAINDER, Evidence, strongest
from floquid.core import PeriodicModel, PhaseClock, Record
from floquid.findings import Finding, Severity, failure, warning
from floquid.fit import FAINT, LAGS, MISFIT, RARE, SURE, WITHIN, chi2_limit
from floquid.periodic import line_amplitudes, without_lines

if TYPE_CHECKING:
    from floquid.checks._decays import Decays
    from floquid.checks._excited import Parted

LOUD_TONE, LOUD_LINE = 1.0, 0.5
"""Amplitudes of a tone and of any other line, over the noise, that fail a model: the latter may be of a mode."""

ABOVE = 8.0  # least score of a tone over that of the lines beside it
BESIDE = 4  # harmonics on each side of a mode's band, and lines on each side of a tone, that are looked at
ROUNDING = 0.5  # residual over the noise below which the noise is no estimate but what the record is believed down to
COLOUR = 0.01  # the sum of squared autocorrelations that is let pass in any case: less is no colour worth a filter
STRONG_COLOUR = 0.25  # the same from which on a model fails: such colour may be what modes leave
HARMONIC = 0.01  # the share of the response in one harmonic beside a band that is let pass in any case
PIECE = 64  # lines of a spectrum over which its level is taken, and harmonics of the period looked at, at most


def tones(case: Decays, evidence: Evidence) -> tuple[Finding, ...]:
    """Finding on harmonics of the revolution in the residual; those that are found are taken off."""
    residuals: list[Floats] = case.left
    findings: tuple[Finding, ...] = ()
    turns = tones_of(case.highest, case.per_revolution)
    size, score = np.zeros((2, *case.noise.shape, len(turns)))
    for hit, rest in enumerate(residuals):
        amplitudes, squares = line_amplitudes(*_residual(case, hit, rest), np.zeros(len(turns)), turns)
        size[:, hit] = amplitudes / case.noise[:, hit, None]
        score[:, hit] = squares / case.noise[:, hit, None] ** 2
    there = (score > chi2_limit(2, RARE / score.size)) & (size > FAINT)
    candidates = np.flatnonzero(there.any(axis=(0, 1)))
    there[..., candidates] &= score[..., candidates] > ABOVE * _beside(case, residuals, turns[candidates])
    evidence.kept("tone", float(np.max(size * there, initial=0.0)), FAINT, failing=LOUD_TONE)
    which = strongest((size * there).max(axis=1))
    if which:
        at = [(channel, int(np.argmax((size * there)[channel, :, tone])), tone) for channel, tone in which]
        findings = evidence.against(
            "tone_left",
            "tone",
            share=_share(case, (size * there) ** 2),
            turns=[turns[tone] for *_, tone in at],
            per_revolution=case.per_revolution,
            sizes=[size[place] for place in at],
            **case.places([(channel, hit) for channel, hit, _ in at]),
        )
    for channel, hit in {(c, h) for c, h, _ in strongest(there)}:
        loud = turns[there[channel, hit]]
        residuals[hit][channel] = without_lines(*_residual(case, hit, residuals[hit]), np.zeros(len(loud)), loud)[
            channel
        ]
    evidence.arrays |= {"turns": turns, "tones": size}
    return findings


def _residual(case: Decays, hit: int, values: Floats) -> tuple[Record, PhaseClock, float]:
    """Residual of a hit, from its first sample on, as a record with its clock and period."""
    return replace(case.records[hit], values=values), case.clocks[hit], case.model.period


def _beside(case: Decays, residuals: list[Floats], turns: Floats) -> Floats:
    """The mean score a few lines of the record on either side of tones (channels, hits, tones)."""
    score = np.zeros((*case.noise.shape, len(turns)))
    for hit, rest in enumerate(residuals):
        angles = case.instants[hit][1]
        apart = 2.0 * np.pi / max(float(angles[-1] - angles[0]), 1e-300)
        # The nearest lines have their share of a tone that is between two of them.
        shifts = apart * np.array([*range(-BESIDE, -1), *range(2, BESIDE + 1)])
        near = np.abs(np.add.outer(turns, shifts)).ravel()
        _, squares = line_amplitudes(*_residual(case, hit, rest), np.zeros(len(near)), near)
        level = squares.reshape(len(rest), len(turns), len(shifts)).mean(axis=2)
        score[:, hit] = level / case.noise[:, hit, None] ** 2
    return score


def harmonics(case: Decays, evidence: Evidence) -> tuple[Finding, ...]:
    """Finding on harmonics of the modes beside their bands; those that are found are taken off."""
    model, residuals = case.model, case.left
    findings: tuple[Finding, ...] = ()
    modes, turns = lines_of(model, case.highest)
    score = np.zeros((*case.noise.shape, len(modes)))
    for hit, rest in enumerate(residuals):
        alive = case.alive(hit)
        if alive.stop:
            _, squares = line_amplitudes(*_residual(case, hit, rest[:, alive]), model.exponents[modes], turns)
            score[:, hit] = squares / case.noise[:, hit, None] ** 2
    evidence.arrays |= {"modes": modes, "harmonics": turns, "lines": np.sqrt(score)}
    if not len(modes):
        return ()
    joint, degrees = score.sum(axis=(0, 1)), 2 * case.responses
    # Weaker ones are left out of a fit on purpose.
    there = np.sqrt(joint) > np.sqrt(chi2_limit(degrees, SURE)) + WITHIN
    share = np.sqrt(np.maximum(joint - degrees, 0.0) / max(_energy(case), 1.0)) * there
    if not evidence.kept("harmonic", float(share.max()), HARMONIC, failing=REMAINDER):
        over = share > HARMONIC
        lines = [line for (line,) in strongest(share * over)]
        largest = np.argmax(score.reshape(-1, len(modes))[:, lines], axis=0)
        findings = evidence.against(
            "harmonic_left",
            share=float(np.sqrt(np.sum(share[over] ** 2))),
            harmonics=turns[lines],
            frequencies=model.frequencies_hz[modes[lines]],
            shares=share[lines],
            **case.places([divmod(int(place), model.n_hits) for place in largest]),
        )
        for hit, rest in enumerate(residuals):
            alive = case.alive(hit)
            located = _residual(case, hit, rest[:, alive])
            rest[:, alive] = without_lines(*located, model.exponents[modes[over]], turns[over])
    return findings


def _energy(case: Decays) -> float:
    """The sum of squares of the response over the noise, where it is alive."""
    total = 0.0
    for hit, record in enumerate(case.records):
        values = record.values[:, case.cycles[hit] >= 0] / case.noise[:, hit, None]
        total += float(np.nansum(values**2)) - float((~np.isnan(values)).sum())
    return total


def _share(case: Decays, squares: Floats) -> float:
    """The share of the response, in amplitude, of lines of squared sizes over the noise (channels, hits, lines)."""
    samples = np.array([int((cycles >= 0).sum()) for cycles in case.cycles])
    return float(np.sqrt(0.5 * np.sum(squares * samples[:, None]) / max(_energy(case), 1.0)))


def lines(case: Decays, evidence: Evidence) -> tuple[Finding, ...]:
    """Finding on lines that are none of those known, in the whole record and where the response is alive."""
    looks, findings = [], ()
    for hit, rest in enumerate(case.left):
        for end in sorted({rest.shape[1], case.alive(hit).stop} - {0}):
            score, where = peaks(rest[:, :end], case.noise[:, hit])
            numbers = np.maximum((~np.isnan(rest[:, :end])).sum(axis=1), 1)
            looks.append((hit, end // 2 + 1, score, 2.0 * np.sqrt(score / numbers), where))
    total = sum(number * len(score) for _, number, score, _, _ in looks)
    size, frequency = np.zeros(case.noise.shape), np.zeros(case.noise.shape)
    for hit, _, score, amplitude, where in looks:
        better = (score > np.log(total / RARE)) & (amplitude > FAINT) & (amplitude > size[:, hit])
        size[better, hit] = amplitude[better]
        frequency[better, hit] = where[better] * case.records[hit].sample_rate
    if not evidence.kept("line", float(size.max()), FAINT, failing=LOUD_LINE):
        channels, hits = np.transpose(at := strongest(size))
        sizes, share = size[channels, hits], _share(case, size[..., None] ** 2)
        of = frequency[channels, hits]
        findings = evidence.against("line_left", "line", share=share, frequencies=of, sizes=sizes, **case.places(at))
    evidence.hidden = size > 0
    return findings


@dataclass(frozen=True, slots=True, kw_only=True)
class Colour:
    """Colour of the most coloured response."""

    size: float
    limit: float
    failing: float
    numbers: Mapping[str, Any]  # what is said of it; empty where nothing is


def colour(case: Any, evidence: Evidence) -> tuple[Finding, ...]:
    """Finding on a residual that is not white."""
    measured: Colour = case.colour(evidence)
    evidence.kept("colour", measured.size, measured.limit, failing=measured.failing)
    return evidence.against("colour_left", "colour", **measured.numbers) if measured.numbers else ()


def colour_of(case: Decays, evidence: Evidence) -> Colour:
    """Excess of squared autocorrelations over those of white noise, of responses without a line of their own.

    Hits in phase that share their shapes are brief, and are judged together, by the products of all of them. The noise
    of values of splines has an excess of 0.03 where that of the samples is white.
    """
    excess, limit = np.zeros(case.noise.shape), np.zeros(case.noise.shape)
    rates, known = rates_of(case.model), 5.0 * COLOUR if case.in_phase else 0.0
    every = list(range(len(case.records)))
    for hits in [every] if case.in_phase and case.model.one_shape else [[hit] for hit in every]:
        rest = np.hstack([_parted(case.left[hit]) for hit in hits]) if hits[1:] else case.left[hits[0]]
        rate = case.records[hits[0]].sample_rate
        squares, numbers, lags = squared_correlations(rest, 1.0 / rate, rates, int(2.0 * case.highest) - 1)
        size = np.maximum(numbers - 2 * len(rates), 1)
        rounding = np.sqrt(np.nanmean(rest**2, axis=1)) < ROUNDING * case.noise[:, hits].mean(axis=1)
        excess[:, hits] = np.where(rounding, 0.0, squares - lags / size)[:, None]
        chance = (chi2_limit(lags, RARE / case.responses) - lags) / size
        limit[:, hits] = (np.maximum(chance, COLOUR) + known)[:, None]
    place = np.unravel_index(int(np.argmax(excess / limit)), excess.shape)
    bound = float(limit[place])
    which = strongest(np.where(evidence.hidden, 0.0, excess) * (excess > limit))
    evidence.arrays["colour"] = excess
    return Colour(
        size=float(excess[place]),
        limit=bound,
        failing=max(STRONG_COLOUR, bound),
        numbers={"squares": [excess[where] for where in which], **case.places(which)} if which else {},
    )


def _parted(rest: Floats) -> Floats:
    """A residual with as many missing samples behind it as there are lags: no product is of two hits."""
    return np.pad(rest, ((0, 0), (0, LAGS)), constant_values=np.nan)


def tones_of(highest: float, per_revolution: float) -> Floats:
    """The harmonics of the period at which a forced response would be, from zero on and below `highest`."""
    # Those of the revolution, j/ν with ν periods in one; all of the period where that is the longer of the two.
    parts = max(per_revolution, 1.0)
    most = int(min(PIECE * parts, np.ceil(highest * parts - 1e-6) - 1))
    return np.arange(max(most, 0) + 1) / parts


def lines_of(model: PeriodicModel, highest: float) -> tuple[Integers, Integers]:
    """The mode and the harmonic of each line beside the bands, those below `highest` fundamentals; a pair once."""
    kept = (model.coefficients != 0).any(axis=(1, 2))
    modes, harmonics = [], []
    for mode, row in enumerate(kept):
        alone = bool(model.unpaired[mode])
        if not row.any() or mode not in model.upper_modes:
            continue
        low, high = model.harmonics[row][[0, -1]]
        near = np.concatenate([np.arange(low - BESIDE, low), np.arange(high + 1, high + 1 + BESIDE)])
        # One that is as many lines from the other end as there are samples a period folds onto it.
        near = near[(near > high - 2.0 * highest + 0.5) & (near < low + 2.0 * highest - 0.5)]
        at = model.exponents[mode].imag / model.fundamental + near
        near = near[(np.abs(at) < highest) & ((at > 0) | ~np.full(at.shape, alone))]
        modes.append(np.full(len(near), mode))
        harmonics.append(near)
    empty = [np.zeros(0, np.int64)]
    return np.concatenate(modes or empty).astype(np.int64), np.concatenate(harmonics or empty).astype(np.int64)


def peaks(residual: Floats, noise: Floats) -> tuple[Floats, Floats]:
    """The highest line of the spectrum of each channel over its level there, and where it is, in turns a sample."""
    there = ~np.isnan(residual)
    lines = np.fft.rfft(np.where(there, residual, 0.0), axis=1)
    spectrum = lines.real**2 + lines.imag**2
    level = noise[:, None] ** 2 * np.maximum(there.sum(axis=1, keepdims=True), 1)
    pieces = spectrum.shape[1] // PIECE
    if pieces > 1:
        size = spectrum.shape[1] // pieces
        cut = spectrum[:, : pieces * size].reshape(len(residual), pieces, size)
        local = np.median(cut, axis=2) / np.log(2.0)
        level = np.maximum(level, local[:, np.minimum(np.arange(spectrum.shape[1]) // size, pieces - 1)])
    over = spectrum / level
    over[:, 0] = 0.0  # the mean is one of the tones
    if residual.shape[1] % 2 == 0:
        over[:, -1] *= 0.5  # half the sampling rate: one number, not two
    place = np.argmax(over, axis=1)
    return over[np.arange(len(residual)), place], place / residual.shape[1]


def squared_correlations(residual: Floats, step: float, rates: Complexes, most: int) -> tuple[Floats, Floats, int]:
    r"""The sum of squared autocorrelations of each channel (Ljung and Box 1978), the number of samples, and of lags.

    .. math:: Q = \sum_{k=1}^{K} \frac{n}{n_k} \Big(r_k + \frac{1}{n}\sum_j e^{s_j k \Delta t}\Big)^2

    A fit takes of white noise what looks like its columns e^{st}: at lag k it leaves the mean correlation
    -Σ_j e^{s_j kΔt}/n, which is taken off here: `rates` are s of every column of the model, conjugates too (columns,)
    [1/s]. `residual` is (channels, samples), `most` the highest lag; Q has the expectation K/n.
    """
    there = ~np.isnan(residual)
    filled = np.where(there, residual, 0.0)
    numbers = there.sum(axis=1)
    lags = int(max(min(LAGS, most, residual.shape[1] // 4), 1))
    power = np.maximum(np.sum(filled**2, axis=1), np.finfo(float).tiny)
    total = np.zeros(len(residual))
    for lag in range(1, lags + 1):
        pairs = np.sum(there[:, lag:] & there[:, :-lag], axis=1)
        expected = -np.exp(rates * lag * step).sum().real
        moment = np.sum(filled[:, lag:] * filled[:, :-lag], axis=1) / power
        total += numbers / np.maximum(pairs, 1) * (moment - expected / np.maximum(numbers, 1)) ** 2
    return total, numbers, lags


def rates_of(model: PeriodicModel) -> Complexes:
    """Rates s of every column that a model has (columns,) [1/s], growing ones seen from their end."""
    kept = (model.coefficients != 0).any(axis=(1, 2))
    rates = -np.abs(model.exponents.real) + 1j * model.exponents.imag
    return (rates[:, None] + 1j * model.fundamental * model.harmonics)[kept]


SPIKE, SPOILT = 12.0, 0.1
"""Deviations from which on a sample is no noise, and the share of the power in such that spoils a fit."""


def spikes(case: Any, _: Evidence) -> tuple[Finding, ...]:
    """Findings on spikes in the residual; warnings where a blow that nobody measured is excitation, and no fault."""
    findings = of_outliers(case.residual, case.own)
    return tuple(replace(finding, severity=Severity.WARNING) for finding in findings) if case.random else findings


def of_outliers(residual: Floats, parted: Parted) -> tuple[Finding, ...]:
    """Findings on samples, in what is left of each output (outputs, samples), that are no noise: spikes."""
    from scipy.special import ndtri

    findings = []
    for values, channel in zip(residual, parted.outputs, strict=True):
        # The median size of a normal number is its upper quartile.
        far = np.abs(values) > SPIKE * np.median(np.abs(values[parted.samples.there])) / ndtri(0.75)
        if far.any():
            share, first = float(np.sum(values[far] ** 2) / np.sum(values**2)), int(np.argmax(far))
            record = int(np.searchsorted(parted.samples.begins, first, side="right"))
            sample = first - parted.samples.begins[record - 1] + 1
            report, number = failure if share > SPOILT else warning, int(far.sum())
            numbers = {"number": number, "share": share, "record": record, "sample": sample}
            findings.append(report("outliers", channel=channel.name, **numbers))
    return tuple(findings)


FAILED = 3.0  # times the noise that a fit leaves from which on it is no model of the record: then it has no deviations


def misfit(case: Any, _: Evidence) -> tuple[Finding, ...]:
    """Finding on a fit that leaves more than noise, though not so much that it fails."""
    size = case.misfit
    return () if size is None or not MISFIT < size < FAILED else (warning("misfit", misfit=size),)


def level(case: Any, evidence: Evidence) -> tuple[Finding, ...]:
    """Note what the fit leaves over the level of its noise: a model that fails does not pass."""
    if case.misfit is not None:
        evidence.kept("misfit", case.misfit, FAILED)
    return ()
