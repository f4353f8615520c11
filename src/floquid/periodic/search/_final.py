"""The end of a search: bands a little wider, tones, the residual, and variances from errors of the model."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from floquid._arrays import Complexes, Floats, Integers
from floquid.fit import (
    AT_REST,
    DEVIATIONS,
    FARTHEST,
    HALF_DIGITS,
    RARE,
    ROUNDING,
    SLOW,
    STEPS,
    SURE,
    chi2_limit,
    is_vague,
    scaled_inverse,
)
from floquid.periodic.least_squares import (
    Block,
    ModeParameters,
    Solution,
    eliminated,
    folded,
    linearise,
    noise_of,
    shapes,
    solve,
    weighted,
)
from floquid.periodic.search._additions import residuals
from floquid.periodic.search._folds import folds, with_all_lines
from floquid.periodic.search._moves import energies
from floquid.periodic.search._near_axis import read_apart, with_axis_pairs
from floquid.periodic.search._objective import Point, SearchResult, Unlike
from floquid.periodic.search._peaks import strongest
from floquid.periodic.search._tests import Units, equality, spread_of_harmonics, untold, wide_of, within
from floquid.search import LOOSE


@dataclass(frozen=True, slots=True)
class BeyondNoise:
    """Modes that the samples contradict, and what is added to the variances of the parameters (parameters,)."""

    clusters: tuple[int, ...]  # the entries whose harmonics do not have one exponent
    unlike: tuple[Unlike, ...]  # modes whose exponent differs between hits
    further: Floats


def beyond_noise(point: Point, most: int, *, branches: bool) -> BeyondNoise:
    """Additions to the variances of a fit, by lines up to `most` fundamentals; those of `branches` after a search."""
    unlike, further = _unlike_hits(point)
    further = further + _left_out(point, most)
    if branches and point.wanders:
        further = further + _spread_of_branches(point)
    # Harmonics ask for different exponents where the hits do.
    clusters, more = ((), np.zeros(0)) if unlike else _clusters(point)
    return BeyondNoise(clusters, unlike, further + more if clusters else further)


def _parameters(entries: ModeParameters) -> dict[int, list[int]]:
    """The parameters of each entry that has some: its decay, and its frequency where it has one."""
    leading = np.flatnonzero(entries.leading)
    place = {int(entry): [k] for k, entry in enumerate(leading)}
    for k, entry in enumerate(leading[~entries.real[leading]]):
        place[int(entry)].append(len(leading) + k)
    return place


def _left_out(point: Point, most: int) -> Floats:
    r"""Variances of the errors of exponents from harmonics left out on lines that modes share.

    .. math:: \operatorname{var} \hat\lambda = I^{-1} J' P \Phi \, \operatorname{E}[a a'] \, \Phi' P J I^{-1}

    with Φ the columns left out, P what the columns of the fit leave of them, and a as large as noise lets them be. All
    other modes are fitted with one harmonic beyond those that are told: here that would not be determined.
    """
    entries, size = point.entries, len(point.solution.gradient)
    near = folds(entries, wanders=point.wanders)
    if not near:
        return np.zeros(size)
    wide = entries
    for fold in near * len(near):  # what the last one gives the first has, too
        wide = with_all_lines(wide, fold)
    those = np.isin(np.arange(len(wide.bands)), [mode for fold in near for mode in (fold.first, fold.second)])
    wide = replace(wide, bands=np.where(those[:, None], wide.padded(1, most).bands, wide.bands))
    columns, whole = wide.columns(), len(wide.with_slopes().modes)
    n, rows = len(columns.modes), entries.rows
    inner = entries.columns().modes
    inside = within(columns.modes, columns.harmonics, entries.bands)
    kept, out = np.flatnonzero(inside), np.flatnonzero(~inside)
    functions = np.concatenate([kept, np.arange(n, whole)])
    kept, out, functions = (np.concatenate([k, m + k]) for k, m in ((kept, n), (out, n), (functions, whole)))
    entry_of = np.tile(columns.modes, 2)[out]
    scatter, (place, signs) = np.zeros((len(rows.columns),) * 2), rows.of_coefficients(len(kept) // 2)
    parts = np.stack([rows.functions, len(functions) // 2 + rows.functions], axis=1)
    for block, linear, beside in zip(point.blocks, point.solution.linear, eliminated(point.blocks, wide), strict=True):
        back = linear.inverse @ beside.gram[np.ix_(kept, out)]
        mixed = beside.mixed[np.ix_(out, functions)] - back.T @ beside.mixed[np.ix_(kept, functions)]
        square = np.diag(beside.gram)[out]
        left = square - np.sum(back * beside.gram[np.ix_(kept, out)], axis=0)
        told = left > HALF_DIGITS * square
        values = linear.coefficients / block.noise
        # As much of each as noise lets it be, in the mean, but no more than the strongest harmonic of its mode.
        energy = np.sum(values**2, axis=1) * np.diag(linear.gram)
        strongest = np.array([energy[np.tile(inner == entry, 2)].max() for entry in range(len(entries.bands))])
        hidden = np.minimum(1.0 / left, strongest[entry_of] / (values.shape[1] * square))
        products = (mixed[told].T * hidden[told]) @ mixed[told]
        scatter += folded(products, values @ values.T, parts, place, signs)
    # Parameters that noise leaves open carry errors of rounding to all others.
    told = np.flatnonzero(np.diag(point.solution.covariance()) < entries.fundamental**2)
    ties, inverse = entries.ties()[told], scaled_inverse(point.solution.information[np.ix_(told, told)], ROUNDING)
    added = np.zeros(size)
    added[told] = np.diag(inverse @ ties @ scatter @ ties.T @ inverse)
    return added


def _unlike_hits(point: Point) -> tuple[tuple[Unlike, ...], Floats]:
    r"""Modes whose exponent differs between hits, and what that adds to variances (Birge 1932).

    .. math:: \chi^2 = \sum_h (\lambda_h - \bar\lambda)' C_h^{-1} (\lambda_h - \bar\lambda), \qquad
              \operatorname{var} \bar\lambda \to \frac{\chi^2}{n} \operatorname{var} \bar\lambda

    with λ_h from one step of the fit of each hit alone, in which all other exponents are free, too.
    """
    from scipy.special import chdtrc

    entries, further = point.entries, np.zeros(len(point.solution.gradient))
    hits = sorted({block.hit for block in point.blocks})
    if len(hits) < 2:
        return (), further
    steps, covariances = zip(*(_of_hit(point, hit) for hit in hits), strict=True)
    unlike, whole = [], np.diag(point.solution.covariance())
    for entry, places in _parameters(entries).items():
        inner = np.ix_(places, places)
        decay = float(entries.exponents[entry].real)
        variances = np.array([of[places[0], places[0]] for of in covariances])
        told = np.flatnonzero((variances > 0.0) & ~is_vague(np.sqrt(np.maximum(variances, 0.0)), decay))
        if len(told) < 2:
            continue
        weights = np.array([scaled_inverse(covariances[k][inner]) for k in told])
        values = np.array([steps[k][places] for k in told])
        mean = np.linalg.solve(weights.sum(axis=0), np.einsum("hij,hj->i", weights, values))
        each = np.einsum("hi,hij,hj->h", values - mean, weights, values - mean)
        degrees = len(places) * (len(told) - 1)
        probability = float(chdtrc(degrees, each.sum()))
        if probability < RARE:
            further[places] += (each.sum() / degrees - 1.0) * whole[places]
            farthest = int(np.argmax(each))
            ends = sorted([farthest, int(np.argmin(values @ weights[farthest] @ (values[farthest] - mean)))])
            first, second = ((hits[told[k]], _moved_alone(point, hits[told[k]], entry)) for k in ends)
            unlike.append(Unlike(entry, (first, second), probability))
    return tuple(unlike), further


def _of_hit(point: Point, hit: int) -> tuple[Floats, Floats]:
    """A step of the fit of one hit alone from the exponents of all (parameters,), and its covariance."""
    there = [k for k, block in enumerate(point.blocks) if block.hit == hit]
    alone = weighted([point.blocks[k] for k in there], point.entries, [point.solution.linear[k] for k in there])
    inverse = scaled_inverse(alone.information, ROUNDING, floor=True)
    return inverse @ alone.gradient, inverse @ alone.gauss_newton @ inverse


def _moved_alone(point: Point, hit: int, entry: int) -> complex:
    """Difference of an exponent that one hit alone has from that of all."""
    alone = point.of_hit(hit, point.entries).settled()
    return complex(alone.entries.exponents[entry] - point.entries.exponents[entry])


def _clusters(point: Point) -> tuple[tuple[int, ...], Floats]:
    """The modes whose harmonics do not have one exponent, and what is added to the variances of the parameters."""
    from scipy.special import chdtrc

    solution, entries, places = point.solution, point.entries, _parameters(point.entries)
    further = np.zeros(len(solution.gradient))
    if not places:
        return (), further
    # Columns that noise does not explain: the exponents of others say nothing.
    sure = Units(point, point).gains() > chi2_limit(2 * point.price.rows, SURE)
    clusters = []
    for entry in [entry for entry in places if not entries.real[entry]]:
        score, degrees = equality(solution, entry, sure)
        if degrees and chdtrc(degrees, score) < RARE:
            clusters.append(entry)
            further[places[entry]] += spread_of_harmonics(solution, entry, sure)
    return tuple(clusters), further


def _spread_of_branches(point: Point) -> Floats:
    r"""Addition to the variances at a speed that wanders: squared distances to branches that fit as well.

    .. math:: e^{\lambda t + i m \theta} = e^{(\lambda + i k \omega) t + i (m - k) \theta + i k (\theta - \omega t)}

    At a constant speed all k are one mode; else the misfit tells them apart, more or less.
    """
    entries, omega = point.entries, point.entries.fundamental
    further, start = np.zeros(len(point.solution.gradient)), tuple(p.coefficients for p in point.solution.linear)
    for entry, places in _parameters(entries).items():
        if entries.real[entry]:
            continue
        low, high = entries.bands[entry]
        tried: list[tuple[float, complex]] = []
        for m in range(low, high + 1):
            exponents, bands = entries.exponents.copy(), entries.bands.copy()
            exponents[entry] += 1j * m * omega
            bands[entry] -= m
            moved = replace(entries, exponents=exponents, bands=bands)
            trial = linearise(point.blocks, moved, start) if m else point.solution
            step = np.asarray(np.linalg.lstsq(trial.gauss_newton, trial.gradient, rcond=1e-12)[0], np.float64)
            tried.append((trial.cost - float(step @ trial.gradient), complex(moved.moved(step).exponents[entry])))
        least = min(cost for cost, _ in tried)
        likely: Complexes = np.array([value for cost, value in tried if cost < least + DEVIATIONS**2])
        gaps = likely - entries.exponents[entry]
        apart = np.abs(gaps.imag - omega * np.rint(gaps.imag / omega)).max()
        further[places] = np.abs(gaps.real).max() ** 2, apart**2
    return further


def finished(
    point: Point, floor: float, *, most: int, choose: bool = True, search: bool, steady: bool, free_period: bool
) -> SearchResult:
    """The final fit of a structure with its deviations and its residual."""
    point = named(point)
    bands = point.entries.bands
    point = _padded(point, most) if choose else point.settled(rest=AT_REST, steps=STEPS)
    if free_period:
        # Not before: with modes still missing, the period would go to where it takes what is theirs.
        point = point.with_entries(replace(point.entries, free_period=True)).settled(rest=AT_REST, steps=STEPS)
    if search:
        point, bands = with_axis_pairs(point, bands)
        point = _without_steady(point, bands) if steady else point
        point = _without_undetermined(point)
    noise = noise_of(point.blocks, point.solution, floor)
    blocks = tuple(block.with_noise(noise[block.rows, block.hit]) for block in point.blocks)
    solution = solve(blocks, weighted(blocks, point.entries, point.solution.linear), hold=True)
    point = replace(point, blocks=blocks, solution=solution)
    beyond = beyond_noise(point, most, branches=search)
    if beyond.further.any():
        solution = replace(solution, further=beyond.further)
    rest = residuals(point)
    peak = strongest(blocks, rest, point.period)
    shares = [noise[block.rows, block.hit] / each.noise for block, each in zip(blocks, rest, strict=True)]
    misfit = float(np.max(np.concatenate(shares)))
    return SearchResult(blocks, solution, bands, peak, tuple(rest), misfit, beyond.clusters, unlike=beyond.unlike)


def _padded(point: Point, most: int) -> Point:
    """The fit with bands on the safe side: weak harmonics, and one beyond each end."""
    entries = point.entries
    if not (~entries.fixed).any():
        return point
    loose = replace(point, price=replace(point.price, harmonic_alarm=LOOSE))
    _, bands = Units(loose, wide_of(point, most)).stepwise(grow=True, shrink=False)
    wide = replace(entries, bands=bands)
    # Weak harmonics that are left out bend the exponents.
    wide = replace(wide, bands=_uncrowded(wide, wide.padded(1, most).bands))
    for _ in range(2):
        with suppress(np.linalg.LinAlgError):
            trial = point.with_entries(wide).settled(rest=AT_REST, steps=STEPS)
            away = np.abs(trial.entries.exponents - entries.exponents) * point.period > FARTHEST
            if not away.any() and trial.misfit <= point.misfit:
                return trial
            # A weak mode runs away where it has more harmonics than it can be told to have.
            wide = replace(wide, bands=np.where(away[:, None], entries.bands, wide.bands))
    return point


def _uncrowded(entries: ModeParameters, padded: Integers) -> Integers:
    """Padded bands without harmonics on the lines of a mode that folds next to it: the two are not determined there."""
    free, padded = np.flatnonzero(~entries.fixed & ~entries.real), padded.copy()
    taken: dict[int, set[int]] = {int(entry): set() for entry in free}
    for fold in folds(entries):
        for entry, (low, high) in (
            (fold.first, fold.of_first(entries.bands[fold.second])),
            (fold.second, fold.of_second(entries.bands[fold.first])),
        ):
            taken[entry] |= set(range(int(low), int(high) + 1))
    for entry in free.tolist():
        low, high = entries.bands[entry]
        while low > padded[entry, 0] and low - 1 not in taken[entry]:
            low -= 1
        while high < padded[entry, 1] and high + 1 not in taken[entry]:
            high += 1
        padded[entry] = low, high
    return padded


def named(point: Point) -> Point:
    """Fit with each mode on the branch whose zeroth harmonic carries most of the energy of its shape."""
    if point.wanders:  # the branches are no names, and stay
        return point
    entries, turns = point.entries, _strongest_harmonics(point.blocks, point.solution)
    exponents, bands = entries.exponents + 1j * turns * entries.fundamental, entries.bands - turns[:, None]
    below = ~entries.fixed & (exponents.imag < 0.0)
    exponents[below], bands[below] = exponents[below].conj(), -bands[below, ::-1]
    renamed = replace(entries, exponents=exponents, bands=bands)
    return point.with_entries(renamed) if below.any() else point.renamed(renamed)


def read_as_modes(result: SearchResult) -> SearchResult:
    """The result with pairs near an axis read as ordinary modes, each mode on the branch of its strongest harmonic."""
    result = read_apart(result)
    if any(block.wanders for block in result.blocks):
        return result
    # By the last fit: with harmonics at the ends of bands, and two lines of a pair next to an axis, another may be it.
    entries, turns = result.solution.entries, _strongest_harmonics(result.blocks, result.solution)
    exponents, bands = entries.exponents + 1j * turns * entries.fundamental, entries.bands - turns[:, None]
    solution = replace(result.solution, entries=replace(entries, exponents=exponents, bands=bands))
    return replace(result, solution=solution, bands=result.bands - turns[:, None])


def _strongest_harmonics(blocks: Sequence[Block], solution: Solution) -> Integers:
    """The harmonic of each pair that carries most of the energy of its shape, zero for all else (entries,)."""
    # Channels are weighted by the inverse of their noise; ties go to the larger frequency.
    entries, both = solution.entries, shapes(blocks, solution)
    noise = np.full(both.coefficients.shape[1:3], np.inf)
    for block in blocks:
        noise[block.rows, block.hit] = block.noise
    energy = np.sum(np.abs(both.coefficients / noise[:, :, None]) ** 2, axis=(1, 2))
    chosen = np.zeros(len(entries.exponents), np.int64)
    for entry in np.flatnonzero(~entries.fixed & ~entries.real):
        ties = np.flatnonzero(energy[entry] > (1.0 - 1e-6) * energy[entry].max())
        turns = entries.exponents[entry].imag + both.harmonics[ties] * entries.fundamental
        chosen[entry] = both.harmonics[ties[np.argmax(np.abs(turns))]]
    return chosen


def _without_steady(point: Point, bands: Integers) -> Point:
    """With the pairs of one harmonic that do not decay held as steady tones: interference, and no modes."""
    # One that is stronger than every mode that decays stays a mode: a structure that hardly decays rings the longest.
    entries = point.entries
    free = np.flatnonzero(entries.leading)
    std = np.sqrt(np.maximum(np.diag(point.solution.covariance()), 0.0))[: len(free)]
    decay, duration = np.abs(entries.exponents[free].real), max(block.last for block in point.blocks)
    steady = (decay < DEVIATIONS * std) & (duration * (decay + 2.0 * std) < SLOW)
    steady &= ~entries.real[free] & (bands[free, 0] == bands[free, 1])
    energy = np.bincount(entries.columns().modes, energies(point), len(entries.exponents))[free]
    tones = free[steady & (energy <= energy[~steady].max(initial=0.0))]
    if not len(tones):
        return point
    fixed, exponents = entries.fixed.copy(), entries.exponents.copy()
    fixed[tones], exponents[tones] = True, 1j * exponents[tones].imag
    return point.with_entries(replace(entries, fixed=fixed, exponents=exponents)).settled(rest=AT_REST)


def _without_undetermined(point: Point) -> Point:
    """With the modes whose own information is next to none held: they would ruin the deviations of all others."""
    entries, weak = point.entries, untold(point)
    if not 0 < len(weak) < int(entries.leading.sum()):
        return point
    fixed = entries.fixed.copy()
    fixed[weak] = True
    fixed[weak[entries.real[weak]]] = False  # a real multiplier has no column of its own but as a mode
    return point.with_entries(replace(entries, fixed=fixed)).settled(rest=AT_REST)
