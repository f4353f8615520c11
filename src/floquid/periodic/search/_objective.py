r"""The objective of every decision of a search, and the fit of one structure by it.

.. math:: J = \sum_{c,h} N_h \ln\big(R_{c,h}/N_h + \epsilon_{c,h}^2\big) + \text{price}

with R what the modes leave of a channel and hit. The noise is profiled out: no estimate of it has to settle, and fits
with other modes can be compared. Weights N/R inside Gauss-Newton are a majorisation, so that J falls at every step.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from floquid._arrays import Floats, Integers, Mask
from floquid.fit import FEW_STEPS, LONGEST_STEP, REST, Ends, Normal, Steps, chi2_limit, levenberg_marquardt
from floquid.periodic.least_squares import (
    ASUNDER,
    Block,
    Linear,
    ModeParameters,
    OneShape,
    Residual,
    Solution,
    eliminated,
    normal,
    weighted,
)
from floquid.periodic.search._folds import Fold, folds, shared_harmonics
from floquid.periodic.search._peaks import Peak
from floquid.search import HOPE, SAME, Move

OVERFLOW = 0.25 * np.log(
    np.finfo(float).max
)  # the growth over a record, in nepers, whose square's square no number holds
FASTEST = 12.0  # the decay or growth over a period, in nepers, beyond which a column is a glitch and no mode


@dataclass(frozen=True, slots=True)
class Price:
    """Price of the units of a structure: the gain that noise exceeds with the probabilities that the user allows."""

    mode_alarm: float  # the probability that noise passes for an exponent
    harmonic_alarm: float  # the probability that noise passes for a harmonic, of a mode or forced
    rows: int  # channels of all hits
    blur: float = 0.0  # residual on one line from errors of the shaft's angle, over the noise
    wanders: bool = False  # whether the speed does: branches of one mode are then other responses

    def mode(self, *, real: bool) -> float:
        """Price of an exponent."""
        return chi2_limit(1 if real else 2, self.mode_alarm) + self.blur

    def harmonics(self, sines: Mask) -> Floats:
        """Price of each column, one with a sine or one without (columns,)."""
        both = [chi2_limit(self.rows * parts, self.harmonic_alarm) for parts in (1, 2)]
        return np.where(sines, both[1], both[0])

    def of(self, entries: ModeParameters) -> float:
        """Price of a structure; of steady columns those of harmonics."""
        free = ~entries.fixed
        exponents = sum(self.mode(real=bool(real)) for real in entries.real[free])
        harmonics = self.harmonics(entries.sines()).sum()
        return float(exponents + harmonics) - self.spared(folds(entries, wanders=self.wanders), entries.bands)

    def spared(self, near: Sequence[Fold], bands: Integers) -> float:
        """Limits of harmonics that a mode shares with another, one by one, less that of all as one unit."""
        # Each alone is below its own limit where both decay alike, and an exponent of its own for what is left out of
        # them would be cheaper.
        count = shared_harmonics(near, bands)
        return sum(number * self.together(1) - self.together(number) for number in count if number > 1)

    def together(self, number: int) -> float:
        """Price of some harmonics of pairs as one unit."""
        return chi2_limit(2 * self.rows * number, self.harmonic_alarm)


@dataclass(frozen=True, slots=True)
class Point:
    """A structure fitted to blocks: its linearisation by the weights that it leaves, and J."""

    blocks: tuple[Block, ...]
    floors: tuple[Floats, ...]  # the least noise of each block (rows,)
    price: Price
    solution: Solution
    misfit: float  # J without the price
    unfinished: bool = False  # whether the budget of time was over before J was least

    @property
    def entries(self) -> ModeParameters:
        """The structure."""
        return self.solution.entries

    @property
    def cost(self) -> float:
        """J without the price: structures that are fitted do not change."""
        return self.misfit

    @property
    def value(self) -> float:
        """J."""
        return self.misfit + self.price.of(self.entries)

    @staticmethod
    def at(blocks: Sequence[Block], floors: Sequence[Floats], price: Price, entries: ModeParameters) -> Point:
        """The point of blocks at these exponents."""
        return _weighted(tuple(blocks), tuple(floors), price, entries, eliminated(blocks, entries))

    def moved(self, step: Floats) -> Point | None:
        """After a step in the parameters; None where a column has no samples to be seen in."""
        entries = self.entries.moved(step)
        apart = np.sqrt(np.abs(entries.all_squares).max(initial=0.0))
        if apart * self.period > ASUNDER or np.abs(entries.exponents.real).max(initial=0.0) * self.period > FASTEST:
            return None
        if entries.exponents.real.max(initial=0.0) * max(block.last for block in self.blocks) > OVERFLOW:
            return None
        start = tuple(linear.coefficients for linear in self.solution.linear)
        return _weighted(self.blocks, self.floors, self.price, entries, eliminated(self.blocks, entries, start))

    def with_entries(self, entries: ModeParameters) -> Point:
        """Take other modes for the samples."""
        linear = eliminated(self.blocks, entries, carried(self.solution, entries))
        return _weighted(self.blocks, self.floors, self.price, entries, linear)

    def of_hit(self, hit: int, entries: ModeParameters) -> Point:
        """Take other modes for the samples of one hit alone."""
        there = [number for number, block in enumerate(self.blocks) if block.hit == hit]
        blocks, floors = [self.blocks[number] for number in there], [self.floors[number] for number in there]
        return Point.at(blocks, floors, self.price, entries)

    def renamed(self, entries: ModeParameters) -> Point:
        """Rename the entries of the fit: columns stay the same functions in the same order."""
        return replace(self, solution=replace(self.solution, entries=entries))

    @property
    def period(self) -> float:
        """The period [s]."""
        return 2.0 * np.pi / self.entries.fundamental

    @property
    def n_modes(self) -> int:
        """Modes of the structure, a pair counted once."""
        return int((~self.entries.fixed).sum())

    def name(self, structure: ModeParameters | None = None) -> tuple:
        """Name of this structure or of another: one for all branches of a mode unless the speed wanders."""
        entries = self.entries if structure is None else structure
        omega = entries.fundamental
        low = entries.exponents + 1j * omega * (entries.bands[:, 0] + entries.offsets)
        branches = np.rint(entries.exponents.imag / omega) if self.wanders else np.zeros(len(low))
        widths = entries.bands[:, 1] - entries.bands[:, 0]
        decays, turns = np.rint(np.array([low.real, low.imag]) * self.period / SAME)
        names = np.stack([entries.real, decays, turns, widths, branches], axis=1)
        steady = np.stack([np.round(low.imag * self.period, 6), entries.factors], axis=1)
        held = entries.fixed
        return tuple(sorted(map(tuple, names[~held].tolist()))), tuple(sorted(map(tuple, steady[held].tolist())))

    def tried(self, move: Move[ModeParameters]) -> Point:
        """The fit of another structure; given up where J will not come below this one."""
        return self.with_entries(move.structure).settled(below=self.value)

    def ended(self, *, unfinished: bool) -> Point:
        """Mark the point as the last of a descent."""
        return replace(self, unfinished=unfinished)

    @property
    def at_floor(self) -> bool:
        """True where all that is left is below the least noise: rounding, of whatever shape."""
        return all(
            bool((block.noise**2 < 2.0 * low**2).all()) for block, low in zip(self.blocks, self.floors, strict=True)
        )

    @property
    def wanders(self) -> bool:
        """True where the speed wanders."""
        return any(block.wanders for block in self.blocks)

    def settled(self, *, below: float = np.inf, steps: int = FEW_STEPS, rest: float = REST) -> Point:
        """The least J near this point; given up where J will not come below a value."""

        def enough(point: Point, gains: list[float]) -> bool:
            # The first steps may gain little: they are not yet the rate at which J falls.
            slow = len(gains) > 2 and point.value - (steps + 1 - len(gains)) * gains[-1] > below
            return slow or point.value - HOPE * point.promised > below

        if below < np.inf and enough(self, []):
            return self
        of = Steps(
            normal=lambda now: normal(now.solution),
            moved=Point.moved,
            limited=_limited,
            enough=enough if below < np.inf else None,
        )
        return levenberg_marquardt(self, of, Ends(steps=steps, gain=rest))

    @property
    def promised(self) -> float:
        """The fall of J by a full step, to first order."""
        total = sum(block.n_samples * len(block.rows) for block in self.blocks)
        gain = normal(self.solution).promised(self.solution.gradient) / total
        return -total * float(np.log1p(-min(gain, 0.999)))


def _limited(point: Point, step: Floats, _normal: Normal, _damping: float) -> Floats:
    return step * min(1.0, LONGEST_STEP / (point.entries.longest(step) + np.finfo(float).tiny))


def carried(solution: Solution, entries: ModeParameters) -> tuple[Floats, ...]:
    """First values of the coefficients of other entries: those of the columns of nearest rate."""
    old, new = solution.entries.columns(), entries.columns()
    if not (len(old.modes) and len(new.modes)):
        return tuple(np.zeros((2 * len(new.modes), linear.coefficients.shape[1])) for linear in solution.linear)
    apart = np.abs(np.subtract.outer(new.rates, old.rates))
    apart[new.factors[new.modes][:, None] != old.factors[old.modes]] = np.inf
    nearest = np.argmin(apart, axis=1)
    known = apart[np.arange(len(nearest)), nearest] * 2.0 * np.pi < SAME * entries.fundamental
    # Of columns that are nearest to the same one, the first has its coefficients.
    known &= np.isin(np.arange(len(nearest)), np.unique(np.where(known, nearest, -1), return_index=True)[1])
    place = np.concatenate([nearest, nearest + len(old.modes)])
    return tuple(np.where(np.tile(known, 2)[:, None], linear.coefficients[place], 0.0) for linear in solution.linear)


def _weighted(
    blocks: tuple[Block, ...],
    floors: tuple[Floats, ...],
    price: Price,
    entries: ModeParameters,
    linear: Sequence[Linear],
) -> Point:
    """The point of coefficients, weighted by the residual."""
    level = [part.left / b.n_samples + low**2 for b, part, low in zip(blocks, linear, floors, strict=True)]
    # Columns that are all but one another leave rounding, below zero where it is more than the noise.
    level = [np.where(variance > 0.0, variance, np.inf) for variance in level]
    blocks = tuple(block.with_noise(np.sqrt(variance)) for block, variance in zip(blocks, level, strict=True))
    misfit = sum(b.n_samples * float(np.log(variance).sum()) for b, variance in zip(blocks, level, strict=True))
    return Point(blocks, floors, price, weighted(blocks, entries, linear), misfit)


@dataclass(frozen=True, slots=True)
class Disagreement:
    """Hits that do not share their shapes: the mode that differs most, and its difference over its response."""

    exponent: complex
    share: float
    probability: float
    groups: tuple[tuple[int, ...], ...]  # the hits of each shape where there are two


@dataclass(frozen=True, slots=True)
class Unlike:
    """An entry whose exponent differs between hits: two of them, by what each moves it alone."""

    entry: int
    moved: tuple[tuple[int, complex], tuple[int, complex]]  # hit, and the step from the exponent of all
    probability: float  # by which noise makes as much of a difference between all hits
    torn: bool = False  # whether the exponents of the hits are so far apart that one of all is none


@dataclass(frozen=True, slots=True)
class SearchResult:
    """The blocks with the noise of the residual, the fit, the bands that are reported, and the strongest peak left."""

    blocks: tuple[Block, ...]
    solution: Solution
    bands: Integers
    peak: Peak
    residuals: tuple[Residual, ...]  # residual of each block
    misfit: float = 1.0  # the rms of the residual over the level of its noise, the largest of all channels and hits
    clusters: tuple[int, ...] = ()  # the entries whose harmonics do not have one exponent
    as_read: dict[int, complex] = field(default_factory=dict)  # deviations of exponents near an axis, by entry
    apart: dict[int, float] = field(default_factory=dict)  # of pairs of open kind how far apart both exponents may be
    one: OneShape | None = None  # the same fit with one shape for all hits, where they agree
    disagreement: Disagreement | None = None  # of the hits, where they do not
    unlike: tuple[Unlike, ...] = ()  # modes whose exponent differs between hits
    twice: tuple[tuple[int, ...], ...] = ()  # entries of one multiplier whose shapes the hits share


def placed(result: SearchResult, places: Mapping[int, int]) -> SearchResult:
    """The result with what it tells of entries at their new `places`; those without one are gone."""
    clusters = tuple(places[entry] for entry in result.clusters if entry in places)
    unlike = tuple(replace(each, entry=places[each.entry]) for each in result.unlike if each.entry in places)
    return replace(result, clusters=clusters, unlike=unlike)


def kept_with(result: SearchResult, kept: Mask, solution: Solution) -> SearchResult:
    """The result with some entries, and their fit: fixed ones are no parameters, what was added to variances stays."""
    places = {int(entry): place for place, entry in enumerate(np.flatnonzero(kept))}
    solution = replace(solution, further=result.solution.further)
    return replace(placed(result, places), solution=solution, bands=result.bands[kept])
