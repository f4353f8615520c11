"""Slip of a record against its period, stretch by stretch."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from floquid._arrays import Complexes, Floats, Integers, Mask
from floquid._checks import Sealed
from floquid.checks import ALIVE
from floquid.core import PeriodicModel
from floquid.fit import filter_gain, filtered
from floquid.periodic import instants, unexplained
from floquid.pipeline import Analysis
from floquid.views._exponents import families
from floquid.views._names import check_analysis
from floquid.views._spectra import Response, response_of

STRETCHES, FEWEST = 12, 4  # stretches that a record is cut into at most, and cycles that each has at least
LARGEST = 2**13  # samples of a stretch that are looked at, at most: those in its middle
LINES = 6  # how many of the strongest lines have their own phase
STEPS, AT_REST = 20, 1e-7  # Gauss-Newton steps at most, and the step [rad], of the deviation, below which it is at rest

LONGEST = 0.5
"""The longest step of the slip [rad over the highest harmonic]: phases turn no further than the linear part holds."""

TOLD = 0.5  # the deviation [rad] from which on a phase is not told
TURNS = 1e-9  # turns a period from which on a line turns at all

SEEN = 1e-9
"""The share of the slope's energy that no factor of a mode takes up, below which a stretch does not tell the slip."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Synchronisation(Sealed):
    r"""By how much the response is ahead of the phase that the clock gives it, in stretches of the record.

    Parameters
    ----------
    times
        The middle of each stretch (stretches,) [s], on the record's own time axis.
    cycles
        The same in periods since phase zero (stretches,) [-].
    slip
        By how much the response is ahead (stretches,) [rad], 2π a period; NaN where a stretch does not tell. A straight
        line means another period, a curve a speed that wanders.
    slip_std
        Its deviation (stretches,) [rad].
    relative, relative_std
        (own period - period used)/period used of the straight line through the slips, and its deviation; NaN where
        fewer than two stretches tell.
    offset
        Where that straight line is at phase zero [rad]; NaN as above.
    misfit
        The sum of squares that the straight line leaves, over its degrees of freedom [-]: 1 where only noise is left;
        NaN where fewer than three stretches tell.
    modes, harmonics
        The strongest lines (lines,): mode of the model, and harmonic.
    phases
        The phase of each line against the model's (lines, stretches) [rad]: what the slip turns by the harmonic, and an
        error of the exponent for all lines of a mode alike.
    phases_std
        Its deviation (lines, stretches) [rad].
    """

    times: Floats
    cycles: Floats
    slip: Floats
    slip_std: Floats
    relative: float
    relative_std: float
    offset: float
    misfit: float
    modes: Integers
    harmonics: Integers
    phases: Floats
    phases_std: Floats

    @property
    def told(self) -> Mask:
        """Mask of the stretches that determine the slip (stretches,)."""
        return np.isfinite(self.slip)

    def parts_in_a_million(self) -> str:
        """The relative difference of the periods and its deviation, to the digits that the deviation warrants."""
        value, std = 1e6 * self.relative, 1e6 * self.relative_std
        digits = max(0, 1 - int(np.floor(np.log10(std)))) if std > 0 else 3
        return f"{value:+.{digits}f} ± {std:.{digits}f}".replace("-", "−")


def synchronisation(analysis: Analysis, hit: int = 0) -> Synchronisation:
    r"""Slip of a record against the period, or the tachometer, that it was identified with.

    In each stretch of the record the model is fitted anew with a factor for each mode and a slip of the phase,

    .. math:: \min_{a, \delta} \sum_{c,k} \frac{1}{\sigma_c^2} \Big( y_c(t_k) -
              \Re \sum_r a_r \sum_m B_{r,c,m}\, e^{\lambda_r t_k + i m (\theta(t_k) + \delta)} \Big)^2

    so that an error of an exponent, which turns all lines of a mode alike, is none of the slip. Only a mode of two
    harmonics or more tells it. Where the response has died there are no stretches; a model that fails tells nothing.

    `analysis` is what `identify` found; `hit` counts from 0. Raises InputError where there is none.
    """
    check_analysis(analysis, "synchronisation", hit=hit)
    own = response_of(analysis, hit, list(range(len(analysis.model.channels))))
    times, angles = instants(own.record, own.clock, own.model.fundamental)
    pieces, lines = _stretches(own, angles), [] if analysis.failed else _strongest(analysis)
    values, gain, noise = _filtered(analysis, own, hit)
    slip, slip_std = np.full((2, len(pieces)), np.nan)
    phases, phases_std = np.full((2, len(lines), len(pieces)), np.nan)
    last = 0.0
    for number, piece in enumerate([] if analysis.failed else pieces):
        seen = Stretch.of(own.model, times[piece], angles[piece], values[:, piece], gain, noise)
        slip[number], slip_std[number] = seen.slip(last)
        phases[:, number], phases_std[:, number] = seen.phases(lines)
        last = slip[number] if np.isfinite(slip[number]) else last
    middle = np.array([0.5 * (piece.start + piece.stop - 1) for piece in pieces])
    turns = np.interp(middle, np.arange(len(times)), angles) / (2.0 * np.pi)
    line = _line(2.0 * np.pi * turns, slip, slip_std)
    modes, harmonics = np.array(lines, np.int64).reshape(-1, 2).T
    return Synchronisation(
        times=own.record.start + middle / own.record.sample_rate,
        cycles=turns,
        slip=slip,
        slip_std=slip_std,
        phases=phases,
        phases_std=phases_std,
        **dict(zip(("relative", "relative_std", "offset", "misfit"), line, strict=True)),
        modes=modes,
        harmonics=harmonics,
    )


def _stretches(own: Response, angles: Floats) -> list[slice]:
    """The samples of each stretch: equal numbers of whole cycles of what is alive of the record."""
    (left,) = unexplained(own.model, [own.record], [own.clock])
    power = np.nan_to_num(((own.record.values - left) / own.noise[:, None]) ** 2)
    cycle = np.floor((angles - angles[0]) / (2.0 * np.pi) + 1e-9).astype(np.int64)
    number = int((angles[-1] - angles[0]) / (2.0 * np.pi) * (1.0 + 1.0 / max(len(angles) - 1, 1)) + 1e-9)
    held = np.array([np.bincount(cycle, row, number + 1)[:number] for row in power])
    mean = held / np.maximum(np.bincount(cycle, minlength=number + 1)[:number], 1)
    alive = np.flatnonzero(mean.max(axis=0) > ALIVE**2)
    if not len(alive):
        return []
    first, end = int(alive[0]), int(alive[-1]) + 1
    count = int(np.clip((end - first) // FEWEST, 1, STRETCHES))
    edges = np.searchsorted(cycle, np.linspace(first, end, count + 1).astype(int))
    pieces = []
    for start, stop in pairwise(edges):
        spare = max(int(stop - start) - LARGEST, 0) // 2
        pieces.append(slice(int(start) + spare, int(stop) - spare))
    return pieces


def _filtered(analysis: Analysis, own: Response, hit: int) -> tuple[Floats, Complexes, Floats]:
    """The record after the filter that makes its noise white, what that does to each line, and the noise then."""
    model, values = own.model, own.record.values
    # Where the speed wanders, the filter makes other lines of each: there the noise is taken as it is.
    taps = None if analysis.shafts else analysis.whitening
    rates = model.exponents[:, None] + 1j * model.fundamental * model.harmonics
    if taps is None:
        return values, np.ones((len(values), *rates.shape), np.complex128), own.noise
    after = np.full(values.shape, np.nan)
    after[:, taps.shape[1] - 1 :] = filtered(values, taps)
    delays = np.arange(taps.shape[1]) / own.record.sample_rate
    return after, filter_gain(taps, delays, rates), analysis.noise[:, hit]


def _strongest(analysis: Analysis) -> list[tuple[int, int]]:
    """The mode and harmonic of the strongest lines, by mode."""
    model = analysis.model
    weighted = np.abs(model.coefficients) / analysis.noise[None, :, :, None]
    energies = np.sum(weighted**2, axis=(1, 2))
    listed = [
        (float(energies[family.mode, np.searchsorted(model.harmonics, m)]), family.mode, int(m))
        for family in families(analysis)
        for m in family.harmonics
    ]
    return sorted((mode, m) for _, mode, m in sorted(listed, reverse=True)[:LINES])


def _line(x: Floats, slip: Floats, std: Floats) -> tuple[float, float, float, float]:
    """Relative difference of periods, its deviation, the line's value at zero, and what it leaves."""
    told = np.isfinite(slip)
    if told.sum() < 2:
        return np.nan, np.nan, np.nan, np.nan
    x, y, weight = x[told], slip[told], 1.0 / std[told] ** 2
    middle = float(weight @ x / weight.sum())
    information = float(weight @ (x - middle) ** 2)
    slope, level = float(weight @ ((x - middle) * y)) / information, float(weight @ y / weight.sum())
    left = float(weight @ (y - level - slope * (x - middle)) ** 2)
    misfit = left / (told.sum() - 2) if told.sum() > 2 else np.nan
    return -slope, information**-0.5, level - slope * middle, misfit


@dataclass(frozen=True, slots=True)
class Stretch:
    """Samples of all channels over their noise, and the lines of the model there."""

    values: Floats  # (channels, samples), zero where a sample is missing
    there: Mask  # (channels, samples)
    waves: Complexes  # e^{λt + imθ} of each line, from the stretch's middle on (lines, samples)
    sizes: Complexes  # what each line has in each channel, in the middle, over the noise (lines, channels)
    turns: Floats  # how often each line turns in a period, beside what its mode turns (lines,)
    places: Integers  # which factor each line has (lines,)
    mirrored: Mask  # which lines have a mirror image among the lines (lines,)
    names: list[tuple[int, int]]  # the mode and the harmonic of each line

    @classmethod
    def of(
        cls, model: PeriodicModel, times: Floats, angles: Floats, values: Floats, gain: Complexes, noise: Floats
    ) -> Stretch:
        """The samples at `times` [s] and `angles` [rad]; `gain` is a filter's (channels, modes, harmonics)."""
        middle = len(times) // 2
        rates, sizes, turns, places, mirrored, names = [], [], [], [], [], []
        for place, mode in enumerate(model.upper_modes):
            lam, real = model.exponents[mode], model.real[mode]
            half = lam.imag / model.fundamental if real else 0.0
            # What locks to the period turns in the angle alone.
            rate = complex(lam.real, 0.0) if real else complex(lam)
            for index in np.flatnonzero((model.coefficients[mode, :, 0] != 0).any(axis=0)):
                m = float(model.harmonics[index]) + half
                own = model.coefficients[mode, :, 0, index] * gain[:, mode, index] / noise
                rates.append(rate)
                turns.append(m)
                sizes.append(own * (1.0 if real else 2.0) * np.exp(rate * times[middle] + 1j * m * angles[middle]))
                places.append(place)
                mirrored.append(real and abs(m) > TURNS)
                names.append((mode, int(model.harmonics[index])))
        alone = np.exp(np.multiply.outer(np.array(rates), times - times[middle]))
        waves = alone * np.exp(1j * np.multiply.outer(np.array(turns), angles - angles[middle]))
        return cls(
            values=np.nan_to_num(values / noise[:, None]),
            there=~np.isnan(values),
            waves=waves,
            sizes=np.array(sizes),
            turns=np.array(turns),
            places=np.array(places, np.int64),
            mirrored=np.array(mirrored, bool),
            names=names,
        )

    def slip(self, start: float) -> tuple[float, float]:
        """By how much the response is ahead [rad], and its deviation; NaN where that is not told."""
        count = int(self.places.max()) + 1
        factors: Complexes = np.ones(count, np.complex128)
        slip, std = start, np.nan
        belongs = (self.places[:, None] == np.arange(count)).astype(float)
        reach = LONGEST / max(float(np.abs(self.turns).max()), 1.0)
        for _ in range(STEPS):
            own = self.sizes * np.exp(1j * self.turns * slip)[:, None]
            # The response of each mode, (modes, channels, samples).
            parts = np.einsum("lr,lc,lk->rck", belongs, own, self.waves, optimize=True)
            turned = factors[self.places, None] * 1j * self.turns[:, None] * own
            parts = np.asarray(parts, np.complex128)
            columns = np.concatenate([parts.real, -parts.imag, (turned.T @ self.waves).real[None]]) * self.there
            left = (self.values - np.einsum("r,rck->ck", factors, parts).real) * self.there
            flat = columns.reshape(len(columns), -1)
            information, gradient = flat @ flat.T, flat @ left.ravel()
            # A factor that the stretch does not tell stays near that of the whole record.
            information[:-1, :-1] += np.eye(2 * count)
            gradient[:-1] -= np.concatenate([factors.real - 1.0, factors.imag])
            taken = np.linalg.solve(information[:-1, :-1], information[:-1, -1])
            alone = information[-1, -1] - information[-1, :-1] @ taken
            if not alone > SEEN * information[-1, -1]:
                return np.nan, np.nan
            std = float(alone**-0.5)
            step = np.linalg.solve(information, gradient)
            short = min(1.0, reach / max(abs(step[-1]), 1e-300))
            factors += short * (step[:count] + 1j * step[count:-1])
            slip += float(short * step[-1])
            if abs(step[-1]) < AT_REST * std:
                break
        return (slip, std) if std < TOLD else (np.nan, np.nan)

    def phases(self, lines: list[tuple[int, int]]) -> tuple[Floats, Floats]:
        """The phase of lines against the model, all others as the model has them, and its deviation (lines,) [rad]."""
        left = (self.values - (self.sizes.T @ self.waves).real) * self.there
        found, std = np.full((2, len(lines)), np.nan)
        for number, name in enumerate(lines):
            line = self.names.index(name)
            wave = (2.0 if self.mirrored[line] else 1.0) * self.sizes[line][:, None] * self.waves[line] * self.there
            energy = float(np.sum(np.abs(wave) ** 2))
            if energy * TOLD**2 <= 2.0:
                continue
            factor = 1.0 + 2.0 * np.sum(wave.conj() * left) / energy
            deviation = np.sqrt(2.0 / energy) / max(abs(factor), 1e-300)
            if deviation < TOLD:
                found[number], std[number] = np.angle(factor), deviation
        return found, std
