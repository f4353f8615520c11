"""How well a record keeps step with its period, stretch by stretch."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from floquid._checks import Rebuilt, frozen_array
from floquid.periodic import instants, unexplained
from floquid.pipeline import Analysis
from floquid.views._families import families
from floquid.views._modes import checked
from floquid.views._stretch import Stretch
from floquid.views._synthesis import Response, response_of

STRETCHES, FEWEST = 12, 4
"""Stretches that a record is cut into at most, and cycles that each has at least."""

ALIVE = 0.2
"""The rms of the response in a cycle, over the noise, below which it tells nothing."""

LARGEST = 2**13
"""Samples of a stretch that are looked at, at most: those in its middle."""

LINES = 6
"""How many of the strongest lines have their own phase."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Synchronisation(Rebuilt):
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

    times: NDArray[np.float64]
    cycles: NDArray[np.float64]
    slip: NDArray[np.float64]
    slip_std: NDArray[np.float64]
    relative: float
    relative_std: float
    offset: float
    misfit: float
    modes: NDArray[np.int64]
    harmonics: NDArray[np.int64]
    phases: NDArray[np.float64]
    phases_std: NDArray[np.float64]

    def __post_init__(self) -> None:
        of, put = "Synchronisation", object.__setattr__
        put(self, "times", frozen_array(self.times, "times", of, axes=("stretches",)))
        for name in ("cycles", "slip", "slip_std"):
            put(self, name, frozen_array(getattr(self, name), name, of, axes=(len(self.times),), missing=True))
        put(self, "modes", frozen_array(self.modes, "modes", of, axes=("lines",), dtype=np.int64))
        put(self, "harmonics", frozen_array(self.harmonics, "harmonics", of, axes=(len(self.modes),), dtype=np.int64))
        for name in ("phases", "phases_std"):
            axes = (len(self.modes), len(self.times))
            put(self, name, frozen_array(getattr(self, name), name, of, axes=axes, missing=True))

    @property
    def told(self) -> NDArray[np.bool_]:
        """Which stretches tell the slip (stretches,)."""
        return np.isfinite(self.slip)


def synchronisation(analysis: Analysis, hit: int = 0) -> Synchronisation:
    r"""How well a record keeps step with the period, or the tachometer, that it was identified with.

    In each stretch of the record the model is fitted anew with a factor for each mode and a slip of the phase,

    .. math:: \min_{a, \delta} \sum_{c,k} \frac{1}{\sigma_c^2} \Big( y_c(t_k) -
              \Re \sum_r a_r \sum_m B_{r,c,m}\, e^{\lambda_r t_k + i m (\theta(t_k) + \delta)} \Big)^2

    so that an error of an exponent, which turns all lines of a mode alike, is none of the slip. Only a mode of two
    harmonics or more tells it. Where the response has died there are no stretches; a model that fails tells nothing.

    Parameters
    ----------
    analysis
        What `identify` found.
    hit
        Which of the hits, from 0.

    Returns
    -------
    Synchronisation
        The slip, stretch by stretch, and the phases of the strongest lines.

    Raises
    ------
    InputError
        There is no such hit.
    """
    checked(analysis, "synchronisation", hit=hit)
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
    relative, relative_std, offset, misfit = _line(2.0 * np.pi * turns, slip, slip_std)
    return Synchronisation(
        times=own.record.start + middle / own.record.sample_rate,
        cycles=turns,
        slip=slip,
        slip_std=slip_std,
        relative=relative,
        relative_std=relative_std,
        offset=offset,
        misfit=misfit,
        modes=np.array([mode for mode, _ in lines], np.int64),
        harmonics=np.array([m for _, m in lines], np.int64),
        phases=phases,
        phases_std=phases_std,
    )


def _stretches(own: Response, angles: NDArray[np.float64]) -> list[slice]:
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


def _filtered(
    analysis: Analysis, own: Response, hit: int
) -> tuple[NDArray[np.float64], NDArray[np.complex128], NDArray[np.float64]]:
    """The record after the filter that makes its noise white, what that does to each line, and the noise then.

    The gain is (channels, modes, harmonics); the samples that have no past are missing.
    """
    model, values = own.model, own.record.values
    # Where the speed wanders, the filter makes other lines of each: there the noise is taken as it is.
    taps = None if analysis.shafts else analysis.whitening
    rates = model.exponents[:, None] + 1j * model.fundamental * model.harmonics
    if taps is None:
        return values, np.ones((len(values), *rates.shape), np.complex128), own.noise
    after = np.array([np.convolve(row, own_taps)[: len(row)] for row, own_taps in zip(values, taps, strict=True)])
    after[:, : taps.shape[1] - 1] = np.nan
    delays = np.arange(taps.shape[1]) / own.record.sample_rate
    gain = np.asarray(np.tensordot(taps, np.exp(-np.multiply.outer(delays, rates)), 1), np.complex128)
    return np.asarray(after, np.float64), gain, analysis.noise[:, hit]


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


def _line(
    x: NDArray[np.float64], slip: NDArray[np.float64], std: NDArray[np.float64]
) -> tuple[float, float, float, float]:
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
