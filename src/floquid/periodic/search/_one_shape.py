"""One shape for all hits after a search with residues free in each: taken where the hits agree."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from floquid._arrays import Complexes, Floats, Integers, Mask
from floquid.errors import IdentificationError
from floquid.fit import FEW_STEPS, QUIET, REST, ROUNDS, SLOW, chi2_limit, is_vague
from floquid.periodic.least_squares import (
    Block,
    ModeParameters,
    OneShape,
    Residual,
    Solution,
    eliminated,
    least_noise,
    linearise,
    residuals_of,
)
from floquid.periodic.search._folds import folds
from floquid.periodic.search._objective import Disagreement, SearchResult
from floquid.periodic.search._peaks import strongest
from floquid.periodic.search._several_shapes import (
    carried,
    degrees_of,
    difference,
    groups_of,
    several_shapes,
    stays,
)
from floquid.search import GAP, LOOSE


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
    if len(hits) < 2 or result.as_read or not (~entries.fixed).any():
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
        # Where exponents are far apart between hits, so are the shapes at one exponent of all.
        if any(each.torn for each in result.unlike):
            return result
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

    shares = [0.0 if fixed else difference(start, entry) for entry, fixed in enumerate(free.fixed)]
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
