"""One shape a mode for all hits, several of one multiplier, or shapes of each hit where these disagree."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import combinations

import numpy as np

from floquid._arrays import Complexes, Floats, Integers, Mask
from floquid.errors import IdentificationError
from floquid.fit import FARTHEST, FEW_STEPS, QUIET, REST, ROUNDS, SLOW, chi2_limit, is_vague
from floquid.periodic.least_squares import (
    PLAIN,
    Block,
    ModeParameters,
    OneShape,
    Residual,
    Solution,
    eliminated,
    least_noise,
    linearise,
    real_parts,
    residuals_of,
)
from floquid.periodic.search._folds import difference, folds, with_all_lines
from floquid.periodic.search._moves import without
from floquid.periodic.search._objective import Disagreement, SearchResult
from floquid.periodic.search._peaks import strongest
from floquid.search import GAP, LOOSE


def several_shapes(
    start: OneShape, agrees: Callable[[OneShape], bool], *, below: float = np.inf, most: float = np.inf
) -> tuple[list[int], OneShape | None]:
    """The fit of the fewest modes of one multiplier by which the hits agree, and the entry of `start` that each is.

    None where the hits do not, or residues free in each hit have no more numbers. Two hits have two shapes of anything.
    Where some have an exponent for each hit, it is one of those. A fit whose cost will not come `below` a value is
    given up, and none has more than `most` entries.
    """
    entries = list(start.apart) or np.flatnonzero(~start.entries.fixed).tolist()
    places = list(range(len(start.entries.exponents)))
    while len(places) < most:
        trials = [_repeated(start, [*places, entry]).with_states(steps=ROUNDS) for entry in entries]
        best = int(np.argmin([trial.cost for trial in trials]))
        places = [*places, entries[best]]
        if not _fewer(start, entries[best], places.count(entries[best])):
            return places, None
        fit = trials[best].with_states().solved(below=below)
        if not stays(fit, start.entries.exponents[places]):
            return places, None
        if agrees(fit):
            return places, fit
    return places, None


def _fewer(start: OneShape, entry: int, count: int) -> bool:
    """True where shapes, states and exponents of a `count` of modes are fewer numbers than residues of all hits."""
    size, hits = (1 if start.entries.real[entry] else 2), start.states.shape[1]
    shape = start.n_channels * int((start.modes[start.kept % len(start.modes)] == entry).sum())
    return count * (shape + size * (hits - 1)) + size * (count - 1) < hits * shape


def degrees_of(shared: OneShape, free: ModeParameters) -> int:
    """Numbers of residues and exponents of free entries beyond those of shapes, states and exponents."""
    modes = ~free.fixed[free.columns().modes]
    numbers = int(modes.sum() + (modes & free.sines()).sum())
    more = shared.n_rates - len(free.ties())
    return numbers * sum(len(block.rows) for block in shared.blocks) - shared.n_numbers - more


def stays(shared: OneShape, exponents: Complexes) -> bool:
    """True where no exponent is far from what it was."""
    away = np.abs(shared.entries.exponents - exponents) * 2.0 * np.pi / shared.entries.fundamental
    return bool((away < FARTHEST).all())


def groups_of(
    several: OneShape, places: Sequence[int], agrees: Callable[[OneShape], bool]
) -> tuple[tuple[int, ...], ...]:
    """The hits in two groups that each have one shape of a mode with two; empty where there are none.

    Hits of a machine that changed are so, and those that excite two modes in all proportions are not.
    """
    for entry in sorted({place for place in places if places.count(place) > 1}):
        first, second, *more = np.flatnonzero(np.array(places) == entry).tolist()
        parted = _parted(several, first, second)
        if not more and agrees(parted.solved()):
            return tuple(tuple(np.flatnonzero(parted.states[each]).tolist()) for each in (first, second))
    return ()


def _parted(several: OneShape, first: int, second: int) -> OneShape:
    """The start of a fit with each of two entries in the hits alone that are most like one of two hits."""
    block, part = several.blocks[0], several.reduced[0]
    size = np.sqrt(np.maximum(np.diag(part.gram)[: len(several.own)], 0.0))
    both = [
        size[several.modes == each, None] * several.complex_shapes[several.modes == each] for each in (first, second)
    ]
    shapes = np.stack(both, axis=-1)[:, block.rows] / block.noise[:, None]
    # What each hit has of both shapes, over the noise (2, hits), and what it has beside the shape of another hit.
    parts = np.linalg.qr(shapes.reshape(-1, 2))[1] @ several.states[[first, second]]
    products, squares = parts.conj().T @ parts, np.sum(np.abs(parts) ** 2, axis=0)
    off = squares - np.abs(products) ** 2 / np.maximum(squares, np.finfo(float).tiny)[:, None]
    ends = min(combinations(range(len(squares)), 2), key=lambda pair: float(off[list(pair)].min(axis=0).sum()))
    states, held, like = several.states.copy(), several.held.copy(), off[ends[0]] <= off[ends[1]]
    for entry, end, hits in zip((first, second), ends, (like, ~like), strict=True):
        states[entry], held[entry] = np.where(hits, products[end] / squares[end], 0.0), end
    return replace(several, states=states, held=held).with_states()


def unshared(start: OneShape, entry: int) -> float:
    """Difference of the free residues of an entry from one shape, over its response, in amplitude."""
    off = size = 0.0
    rows = np.flatnonzero(np.tile(start.modes == entry, 2))
    for block, reduced, values in zip(start.blocks, start.reduced, start.coefficients, strict=True):
        gram, own = reduced.gram[np.ix_(rows, rows)], values[start.own]
        apart, whole = real_parts(own - reduced.seen[start.own])[rows], real_parts(own)[rows]
        off += float(np.sum(apart * (gram @ apart) / block.noise**2))
        size += float(np.sum(whole * (gram @ whole) / block.noise**2))
    return float(np.sqrt(off / max(size, np.finfo(float).tiny)))


def carried(solution: Solution, places: Sequence[int]) -> Floats | None:
    """Additions to variances of a solution, for its entries at other places."""
    entries, further = solution.entries, solution.further
    if further is None:
        return None
    leading, pairs = np.flatnonzero(entries.leading), np.flatnonzero(entries.leading & ~entries.real)
    decays, turns, rest = np.split(further, [len(leading), len(leading) + len(pairs)])
    both = [dict(zip(of.tolist(), values, strict=True)) for of, values in ((leading, decays), (pairs, turns))]
    return np.concatenate([*([of[place] for place in places if place in of] for of in both), rest])


def _repeated(start: OneShape, places: list[int]) -> OneShape:
    """The start of a fit of the entries of these places; one that is there often has its strongest shapes."""
    states, held = start.states[places], start.held[places]
    for entry in {place for place in places if places.count(place) > 1}:
        copies = np.flatnonzero(np.array(places) == entry)
        # As many as there are hits can be told.
        each = np.linalg.svd(_residues(start, entry), full_matrices=False)[2][: len(copies)]
        states[copies[: len(each)]], held[copies[: len(each)]] = each, np.argmax(np.abs(each), axis=1)
    states = states / states[np.arange(len(held)), held][:, None]
    entries = start.entries.picked(places)
    apart = {place: start.apart[entry] for place, entry in enumerate(places) if entry in start.apart}
    return replace(start, entries=entries, states=states, held=held, apart=apart).at_exponents()


def _residues(start: OneShape, entry: int) -> Complexes:
    """The free residues of an entry over their noise (columns and channels, hits)."""
    columns = start.modes == entry
    seen = np.zeros((int(columns.sum()), start.n_channels, start.states.shape[1]), complex)
    for block, part in zip(start.blocks, start.reduced, strict=True):
        size = np.sqrt(np.maximum(np.diag(part.gram)[: len(start.own)], 0.0))[columns]
        seen[:, block.rows, block.hit] = size[:, None] * part.seen[start.own][columns] / block.noise
    rows = seen.reshape(-1, seen.shape[2])
    return np.concatenate([rows.real, rows.imag]) if start.entries.real[entry] else rows


def with_one_shape(
    result: SearchResult, false_alarm: float, floor: float, most: int, order: int | None = None
) -> SearchResult:
    r"""The result with one shape for all hits, if noise explains what that leaves more; else how much they differ.

    .. math:: \Delta\chi^2 \sim \chi^2_n, \qquad n = n_{\text{free residues}} - n_{\text{shapes}} - n_{\text{states}}

    Pairs near an axis keep free residues: their functions are no exponentials. Of modes that are brief, by what they
    decay over a period, and of those that share lines, harmonics that are left out bend exponents: those that all hits
    show together are added. Where the hits share several shapes of one multiplier, each is a mode, up to the `order`
    that is given.
    """
    entries = result.solution.entries
    hits = {block.hit for block in result.blocks}
    # Where exponents are far apart between hits, so are the shapes at one exponent of all.
    torn = any(each.torn for each in result.unlike)
    if len(hits) < 2 or torn or result.as_read or not (~entries.fixed).any():
        return result
    with suppress(IdentificationError, np.linalg.LinAlgError):
        start, bands = OneShape.at(result.blocks, entries, result.solution.linear), result.bands
        shared = start.solved()
        brief = np.abs(shared.entries.exponents.real) * 2.0 * np.pi > SLOW * entries.fundamental
        if brief.any() or folds(entries):
            shared = grown(shared, least_noise(result.blocks, result.solution, floor), most)
            bands = np.where(entries.fixed[:, None], bands, shared.entries.bands)
        probability = agreement(shared, result)
        if probability > false_alarm:  # the hits agree
            misfit = misfit_of_all(result.blocks, result.residuals)
            told = stays(shared, entries.exponents) and not _lost(shared, result.solution).any()
            return replace(result, one=shared, bands=bands, misfit=misfit) if told else result
        several = _with_several_shapes(start, result, probability, false_alarm, order)
        # Of hardly any noise, a weak nonlinearity is a disagreement, and no shapes that hits share explain it.
        quiet = all((block.noise < QUIET * block.largest).all() for block in result.blocks)
        return result if quiet and several.one is None else several
    return result


def _with_several_shapes(
    start: OneShape, result: SearchResult, probability: float, false_alarm: float, order: int | None
) -> SearchResult:
    """The result with several modes of one multiplier where all hits share their shapes; else how much they differ."""
    free = result.solution.entries

    def agrees(trial: OneShape) -> bool:
        return agreement(trial, result) > false_alarm

    shares = [0.0 if fixed else unshared(start, entry) for entry, fixed in enumerate(free.fixed)]
    places, several, groups = [*range(len(shares)), int(np.argmax(shares))], None, ()
    with suppress(IdentificationError, np.linalg.LinAlgError):  # that the hits disagree is known without
        places, several = several_shapes(start, agrees)
        groups = () if several is None else groups_of(several, places, agrees)
    beyond = several is not None and order is not None and several.entries.order > order
    if several is None or groups or result.unlike or beyond:
        entry = places[len(free.exponents)]
        value = complex(free.exponents[entry] + 1j * free.fundamental * free.offsets[entry])
        return replace(result, disagreement=Disagreement(value, shares[entry], probability, groups))
    twice = tuple(
        tuple(np.flatnonzero(np.array(places) == place).tolist())
        for place in sorted(set(places))
        if places.count(place) > 1
    )
    solution = replace(several.as_solution(), further=carried(result.solution, places))
    misfit, bands = misfit_of_all(result.blocks, result.residuals), result.bands[places]
    return replace(result, one=several, solution=solution, bands=bands, misfit=misfit, twice=twice)


def _lost(shared: OneShape, free: Solution) -> Mask:
    """Mask of the modes whose decay free residues determine, and one shape does not: those numbers fit another mode."""
    decay = shared.entries.exponents.real[shared.entries.leading]
    one, each = (np.sqrt(np.maximum(np.diag(of), 0.0))[: len(decay)] for of in (shared.of_rates(), free.covariance()))
    return is_vague(one, decay) & ~is_vague(each, decay)


def misfit_of_all(blocks: Sequence[Block], rest: Sequence[Residual]) -> float:
    """The rms of the residual of all hits over the level of its noise, the largest of all channels."""
    # Of a brief hit alone that level is known to a tenth.
    squares = np.zeros((2, 1 + max(int(block.rows.max()) for block in blocks)))
    for block, each in zip(blocks, rest, strict=True):
        squares[0, block.rows] += (block.noise / each.noise) ** 2
        squares[1, block.rows] += 1.0
    return float(np.sqrt(np.max(squares[0] / np.maximum(squares[1], 1.0))))


def grown(shared: OneShape, least: Sequence[Floats], most: int) -> OneShape:
    """The fit with the harmonics that noise does not explain, by the noise that it leaves, at least `least`."""
    bands = narrowed(shared, LOOSE)
    for _ in range(FEW_STEPS):
        padded = replace(shared.entries, bands=bands).padded(GAP + 1, most).bands
        wide = shared.with_bands(padded).solved(at_rest=REST, iterations=ROUNDS).with_noise(least)
        kept = narrowed(wide, LOOSE)
        if (kept[:, 0] >= bands[:, 0]).all() and (kept[:, 1] <= bands[:, 1]).all():
            break
        shared, bands = wide, kept
    return shared.with_bands(bands).solved(at_rest=REST).with_noise(least).solved()


def of_shapes(
    blocks: Sequence[Block], entries: ModeParameters, values: Sequence[Complexes], floor: float, most: int
) -> SearchResult:
    """The fit of one shape for all hits from coefficients of each block, with the harmonics above the noise.

    Hits that are over in a few periods do not determine residues of their own: none are fitted. The noise of each
    channel and hit is what the fit leaves, corrected for the numbers that it uses of them. Up to `most` fundamentals of
    the axis can be seen.
    """
    least = least_noise(blocks, linearise(blocks, entries.picked([])), floor)
    shared = OneShape.near(blocks, entries, eliminated(blocks, entries), values).with_states()
    for _ in range(ROUNDS):
        shared = shared.with_noise(least).solved(at_rest=REST)
    shared = grown(shared, least, most)
    solution = shared.as_solution()
    rest = residuals_of(shared.blocks, solution, floor)
    peak = strongest(shared.blocks, rest, 2.0 * np.pi / entries.fundamental)
    misfit = misfit_of_all(shared.blocks, rest)
    return SearchResult(shared.blocks, solution, shared.entries.bands, peak, tuple(rest), misfit, one=shared)


def agreement(shared: OneShape, free: SearchResult) -> float:
    """Probability that noise makes as much of a difference to the fit of free residues."""
    cost = sum(float(np.sum(squares / block.noise**2)) for block, squares in zip(free.blocks, shared.left, strict=True))
    return chance(cost - free.solution.cost, degrees_of(shared, free.solution.entries))


def chance(rise: float, degrees: int) -> float:
    """Probability that noise makes as much of a difference; one where none was made."""
    from scipy.special import chdtrc

    return float(chdtrc(degrees, max(rise, 0.0))) if degrees > 0 else 1.0


def narrowed(shared: OneShape, alarm: float) -> Integers:
    """The bands without the harmonics at their ends that noise explains with the probability `alarm`, one by one."""
    # Each is asked beside all that are left: of modes that share their lines, harmonics may be needed together.
    columns, bands = shared.entries.columns(), shared.entries.bands.copy()
    harmonics, inverse, shapes = columns.harmonics[shared.own], shared.inverse.copy(), shared.shapes.T.copy()
    bands[:, 0] = np.where(shared.entries.real, np.maximum(bands[:, 0], -(shared.entries.half_turns // 2)), bands[:, 0])
    while True:
        best = (1.0, 0, 0, np.zeros(0, np.int64))
        for entry in np.unique(shared.modes):
            low, high = bands[entry]
            for harmonic, side in ((low, 0), (high, 1)) if low < high else ():
                column = int(np.flatnonzero((shared.modes == entry) & (harmonics == harmonic))[0])
                rows = np.flatnonzero(np.isin(shared.kept, (column, len(shared.own) + column)))
                inner = inverse[:, rows][:, :, rows]
                cost = np.einsum("cr,cr->", shapes[:, rows], np.linalg.solve(inner, shapes[:, rows, None])[..., 0])
                share = float(cost) / chi2_limit(len(rows) * shared.n_channels, alarm)
                best = min(best, (share, int(entry), side, rows), key=lambda each: each[0])
        share, entry, side, rows = best
        if not len(rows):
            return bands
        taken = inverse[:, :, rows] @ np.linalg.inv(inverse[:, rows][:, :, rows])
        shapes = shapes - np.einsum("cnr,cr->cn", taken, shapes[:, rows])
        inverse = inverse - taken @ inverse[:, rows]
        bands[entry, side] += 1 if side == 0 else -1


def as_one_of_hits(result: SearchResult, other: OneShape | None, false_alarm: float) -> ModeParameters | None:
    """The modes with one in place of two near ones where hits share its shape, and each has an exponent of its own.

    None where no two are so, or where the `other` fit, of exponents that all hits share, needs no more modes. Free
    residues let each of two modes ring in the hits that decay like it. Modes that have a shape each stay.
    """
    if len({block.hit for block in result.blocks}) < 2:
        return None
    entries = result.solution.entries
    gone: list[int] = []
    for first, second, join, steps in _couples(result):
        if {first, second} & set(gone):
            continue
        with suppress(IdentificationError, np.linalg.LinAlgError):
            # Beside all others as they are: where the hits differ in these, too, they are two modes for one so far.
            fewer = without(join(result.solution.entries), [second])
            start = OneShape.at(result.blocks, fewer, eliminated(result.blocks, fewer))
            if _explained(start.with_exponents_of_hits(first - (second < first), steps), result, other, false_alarm):
                gone, entries = [*gone, second], join(entries)
    return without(entries, gone) if gone else None


def _couples(
    result: SearchResult,
) -> Iterator[tuple[int, int, Callable[[ModeParameters], ModeParameters], Complexes]]:
    """Two entries that are near, how the first stands for both, and first steps to its exponents in hits (hits,)."""
    free, energy = result.solution.entries, _energies(result)
    for fold in folds(free, wanders=any(block.wanders for block in result.blocks), share=1.0):
        gap = difference(free, fold.first, fold.second, fold.sign)[1]
        shares = energy[fold.second] / np.maximum(energy[[fold.first, fold.second]].sum(axis=0), np.finfo(float).tiny)
        yield fold.first, fold.second, partial(with_all_lines, fold=fold), gap * shares
    for even in np.flatnonzero(free.even).tolist():
        yield even, even + 1, partial(_as_plain, even=even), np.zeros(energy.shape[1], complex)


def _as_plain(entries: ModeParameters, even: int) -> ModeParameters:
    """The entries with a real multiplier for the even one of a pair near an axis."""
    of_pair = np.isin(np.arange(len(entries.exponents)), (even, even + 1))
    squares = np.where(of_pair, 0.0, entries.all_squares)
    return replace(entries, factors=np.where(of_pair, PLAIN, entries.factors), squares=squares)


def _energies(result: SearchResult) -> Floats:
    """The energy of each entry in each hit over the noise (entries, hits)."""
    columns = np.tile(result.solution.entries.columns().modes, 2)
    energy = np.zeros((len(result.solution.entries.exponents), 1 + max(block.hit for block in result.blocks)))
    for block, linear in zip(result.blocks, result.solution.linear, strict=True):
        squares = np.diag(linear.gram) * np.sum((linear.coefficients / block.noise) ** 2, axis=1)
        np.add.at(energy[:, block.hit], columns, squares)
    return energy


def _explained(start: OneShape, result: SearchResult, other: OneShape | None, false_alarm: float) -> bool:
    """True where fewer modes than the `other` fit has, with shapes that the hits share, explain the samples."""
    free = result.solution.entries
    most = len((free if other is None else other.entries).exponents) - 1
    degrees = degrees_of(start, free)
    limit = result.solution.cost + chi2_limit(max(degrees, 1), false_alarm)

    def agrees(trial: OneShape) -> bool:
        # A shape of one number is that of any mode.
        return degrees_of(trial, free) > 0 and agreement(trial, result) > false_alarm

    if degrees <= 0 or len(start.entries.exponents) > most:
        return False
    return agrees(start.solved(below=limit)) or several_shapes(start, agrees, below=limit, most=most)[1] is not None
