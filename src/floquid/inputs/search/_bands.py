r"""The objective of a search with inputs, and bands of harmonics as its moves: what scores add, what a test leaves out.

.. math:: J = \sum_c N \ln (R_c/N) + \text{price}

with R what the modes leave of an output. The noise is profiled out, so that fits with other modes can be compared.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from floquid._arrays import Floats, Integers, Mask
from floquid.fit import FEW_STEPS, REST, wald_rise
from floquid.inputs._modes import InputMode, ends_of
from floquid.inputs._samples import Samples
from floquid.inputs._solver import Linearisation, columns_of, solve
from floquid.inputs.search._scores import Scores, by_noise_beyond
from floquid.inputs.search._structure import Limits, Price, Structure
from floquid.search import GAP, HOPE, SAME, Move


@dataclass(frozen=True, eq=False)
class Point:
    """A structure fitted to samples, and J."""

    samples: Samples
    limits: Limits
    at: Linearisation
    bands: Callable[[Point], Iterable[Move[Structure]]]  # moves of bands, by which a trial with other modes is helped
    unfinished: bool = False

    @property
    def structure(self) -> Structure:
        """Modes and harmonics of the direct term."""
        return Structure(self.at.modes, self.at.direct)

    @cached_property
    def price(self) -> Price:
        """Price of structures."""
        return Price(self.limits, len(self.samples.values), len(self.samples.inputs), len(self.samples.records))

    @cached_property
    def value(self) -> float:
        """J."""
        return self.at.cost + self.price.of(self.structure)

    @property
    def settling(self) -> Move[Structure]:
        """The move that goes on with the fit."""
        return Move(-self.scores.promised, "settle", self.structure, again=True)

    @property
    def n_modes(self) -> int:
        """Modes, a pair counted once."""
        return len(self.at.modes)

    @cached_property
    def scores(self) -> Scores:
        """Scores by one linearisation."""
        return Scores(self.samples, self.at)

    def name(self, structure: Structure | None = None) -> tuple:
        """Name of this structure or of another, one for all branches."""
        structure = self.structure if structure is None else structure
        omega, names = self.samples.fundamental, []
        for mode in structure.modes:
            low = mode.exponent + 1j * omega * mode.turns[0]
            decay, turn = (round(part * 2.0 * np.pi / omega / SAME) for part in (low.real, low.imag))
            reached = float(mode.reach[0] + mode.turns[0])
            names.append((mode.real, decay, turn, len(mode.turns), reached, len(mode.reach)))
        return tuple(sorted(names)), structure.direct

    def settled(self, structure: Structure, *, below: float = np.inf) -> Point:
        """The least J near a structure; given up where it will not come below a value."""
        structure = structure.within(self.limits.highest)
        below -= self.price.of(structure)
        at = solve(
            self.samples, structure.modes, structure.direct, iterations=FEW_STEPS, at_rest=REST, rough=True, below=below
        )
        return replace(self, at=at)

    def tried(self, move: Move[Structure]) -> Point:
        """The fit of another structure, other modes with the bands that they then need; given up without hope."""
        trial = self.settled(move.structure, below=np.inf if move.again else self.value - move.least)
        other = [mode.real for mode in move.structure.modes] != [mode.real for mode in self.at.modes]
        while (other or move.helped) and trial.value >= self.value:
            best = min(self.bands(trial), key=lambda each: each.change, default=None)
            if best is None or trial.value + HOPE * best.change > self.value:
                break
            more = trial.settled(best.structure)
            if more.value >= trial.value:
                break
            trial = more
        return trial

    def ended(self, *, unfinished: bool) -> Point:
        """Mark the point as the last of a descent."""
        return replace(self, unfinished=unfinished)


@dataclass(frozen=True, slots=True)
class Edit:
    """Harmonics more or less at one end of a band, and the change of J that is predicted."""

    change: float
    mode: int  # its number; -1 of the direct term
    band: str  # "turns" or "reach"
    harmonics: tuple[float, ...]
    more: bool


def growths(point: Point, *, alone: bool = True) -> Iterator[Move[Structure]]:
    """Harmonics beyond the ends of all bands at once, unless `alone` with those that go, then the best alone."""
    edits = list(_growths(point))
    if not edits:
        return
    least = max(1e-3, by_noise_beyond(point.scores, point.limits, -sum(each.change for each in edits)))
    best = min(edits, key=lambda each: each.change)
    fewer = [] if alone else list(_shrinkages(point))
    # What is gained by those that go does not count for the others, which noise may have made.
    gone = -sum(each.change for each in fewer)
    for name, own, more in (("bands", [*edits, *fewer], gone), ("grow", edits, 0.0), ("grow one", [best], 0.0)):
        move = _move(point, own, name, least + more)
        if (move.change + more) * HOPE < -least:
            yield move


def far_growths(point: Point) -> Iterator[Move[Structure]]:
    """Harmonics of the outputs anywhere beyond the end of one band: weak ones may lie before strong ones."""
    # Those of the inputs are not looked for there: far ones make up for noise that drives the modes.
    edits = list(_growths(point, ("turns",), int(2 * point.limits.highest)))
    if edits:
        best = min(edits, key=lambda each: each.change)
        least = max(1e-3, by_noise_beyond(point.scores, point.limits, -best.change))
        yield _move(point, [best], "grow far", least)


def shrinkages(point: Point) -> Iterator[Move[Structure]]:
    """Harmonics less at the ends of all bands at once, and of each band alone."""
    edits = list(_shrinkages(point))
    if len(edits) > 1:
        yield _move(point, edits, "shrink", 1e-3)
    for each in edits:
        yield _move(point, [each], "shrink one", 1e-3)


def helpful(point: Point) -> Iterator[Move[Structure]]:
    """Bands either way, by which a trial with other modes is helped."""
    yield from growths(point)
    yield from shrinkages(point)


def _move(point: Point, edits: Iterable[Edit], name: str, least: float) -> Move[Structure]:
    modes, direct, total = list(point.at.modes), set(point.at.direct), 0.0
    for edit in edits:
        total += edit.change
        if edit.mode < 0:
            direct = direct | set(edit.harmonics) if edit.more else direct - set(edit.harmonics)
            continue
        own = set(getattr(modes[edit.mode], edit.band).tolist())
        band = own | set(edit.harmonics) if edit.more else own - set(edit.harmonics)
        modes[edit.mode] = modes[edit.mode].with_band(edit.band, sorted(band))
    modes = [centred(point.samples, mode, point.at, number) for number, mode in enumerate(modes)]
    return Move(total, name, Structure(tuple(modes), tuple(sorted(direct))), least)


def _growths(point: Point, bands: Sequence[str] = ("turns", "reach"), most: int = GAP) -> Iterator[Edit]:
    """Harmonics beyond the ends of bands that scores show, as far as they pay for those between."""
    at, price = point.at, point.price
    ends = []
    for number, mode in enumerate(at.modes):
        for band in bands:
            own = getattr(mode, band)
            for end, way in [(own[-1], 1.0)] if mode.real else [(own[0], -1.0), (own[-1], 1.0)]:
                beyond = end + way * np.arange(1.0, most + 1.0)
                ends.append((number, band, beyond[np.abs(beyond) <= point.limits.highest].tolist()))
    columns = [
        partial(_seen_at, at, number, turn) for number, band, beyond in ends if band == "turns" for turn in beyond
    ]
    turn = float(len(at.direct))
    if turn <= point.limits.highest:
        columns.append(partial(_direct_at, turn))
    seen = point.scores.by_columns(columns).tolist()
    asked = [(number, turn) for number, band, beyond in ends if band == "reach" for turn in beyond]
    driven = point.scores.by_inputs(asked).tolist()
    if turn <= point.limits.highest and price.direct(turn) < seen[-1]:
        yield Edit(price.direct(turn) - seen[-1], -1, "", (turn,), True)
    for number, band, beyond in ends:
        gains, of = (seen, price.seen) if band == "turns" else (driven, price.driven)
        own, gains[: len(beyond)] = gains[: len(beyond)], []
        changes = np.cumsum(
            [of(turn, real=at.modes[number].real) - gain for turn, gain in zip(beyond, own, strict=True)]
        )
        if len(changes) and changes.min() < 0.0:
            best = int(np.argmin(changes))
            yield Edit(float(changes[best]), number, band, tuple(beyond[: best + 1]), True)


def _seen_at(at: Linearisation, number: int, turn: float, samples: Samples, own: slice) -> Floats:
    """Columns of a harmonic of the outputs that a mode may have, in a part of the samples."""
    return columns_of(samples, replace(at.modes[number], turns=np.array([turn])), at.states[number][..., own])


def _direct_at(turn: float, samples: Samples, _: slice) -> Floats:
    """Columns of a harmonic of the direct term, in a part of the samples."""
    both = samples.kept(samples.turned(turn) * samples.inputs)
    return np.concatenate([both.real, both.imag]) if turn else both.real


def _shrinkages(point: Point) -> Iterator[Edit]:
    """Harmonics at the ends of bands that cost more than noise without them would."""
    at, price, place = point.at, point.price, 0
    root = point.scores.spread_root
    for number, mode in enumerate(at.modes):
        block = root[place : place + int(mode.free.sum())]
        place += len(block)
        columns, turning = at.slices()[number]
        spread = block @ block.T
        weights: tuple[tuple[str, Callable[[Integers], float], Callable[..., float]], ...] = (
            ("turns", lambda which, own=(columns, turning): _weight(at, *own, which), price.seen),
            ("reach", lambda which, own=(mode, spread): _input_weight(*own, which), price.driven),
        )
        for band, weight, of in weights:
            yield from _tails(number, mode, band, weight, of)
    if at.direct:
        count = len(point.samples.inputs) * (2 if at.direct[-1] else 1)
        stop = (at.slices()[-1][0].stop if at.modes else 0) + len(point.samples.inputs) * (2 * len(at.direct) - 1)
        index = np.arange(stop - count, stop)
        rise = wald_rise(at.coefficients[index] / at.noise, at.inverse[np.ix_(index, index)])
        if rise < price.direct(at.direct[-1]):
            yield Edit(rise - price.direct(at.direct[-1]), -1, "", at.direct[-1:], False)


def _tails(
    number: int, mode: InputMode, band: str, weight: Callable[[Integers], float], of: Callable[..., float]
) -> Iterator[Edit]:
    """The tails of a band that are best left out, one at each end."""
    harmonics = getattr(mode, band)
    kept, count = len(harmonics), len(harmonics)
    for order in (np.arange(count)[::-1], np.arange(0 if mode.real else count)):
        best, length, paid = 0.0, 0, 0.0
        for many in range(1, min(kept, len(order) + 1)):
            paid += of(float(harmonics[order[many - 1]]), real=mode.real)
            change = weight(np.sort(order[:many])) - paid
            if change >= 0.0:
                break
            if change < best:
                best, length = change, many
        if length:
            kept -= length
            yield Edit(best, number, band, tuple(harmonics[order[:length]].tolist()), False)


def centred(samples: Samples, mode: InputMode, now: Linearisation, number: int) -> InputMode:
    """A mode on the branch whose zeroth harmonic is seen most; a pair with a frequency that is not negative."""
    if mode.real:
        return mode
    own, shape = now.modes[number], np.abs(now.shape(number)) / now.noise
    energy = np.sum(shape**2, axis=1)
    turn = float(own.turns[int(np.argmax(energy))])
    mode = mode.turned(turn, samples.fundamental, samples.times[ends_of(samples, mode)])
    return mode if mode.exponent.imag >= 0.0 else mode.conjugated()


def _weight(now: Linearisation, columns: slice, turning: Mask, which: Integers) -> float:
    """Squared deviations of the coefficients of some harmonics from zero, of all channels."""
    later = len(turning) + np.cumsum(turning) - 1
    index = columns.start + np.concatenate([which, later[which[turning[which]]]])
    own = now.coefficients[index] / now.noise
    # A direction that another column has, too, is none: the block may be singular.
    return wald_rise(own, now.inverse[np.ix_(index, index)])


def _input_weight(mode: InputMode, spread: Floats, which: Integers) -> float:
    """Squared deviations of the gains of some harmonics of the inputs from zero."""
    # Infinite where one is the scale of the mode.
    free, size, starts = mode.free, mode.gains.size, len(mode.initial)
    at = 1 + (which[:, None] + len(mode.reach) * np.arange(len(mode.gains))).ravel()
    flat, index = mode.gains.ravel()[at - 1], np.concatenate([at, at + size if mode.real else at + 1 + size + starts])
    own = np.concatenate([flat.real, flat.imag])
    if not free[index].all() and not mode.real:
        return np.inf
    own, index = own[free[index]], index[free[index]]
    place = np.cumsum(free)[index] - 1
    return wald_rise(own, spread[np.ix_(place, place)]) if len(own) else np.inf
