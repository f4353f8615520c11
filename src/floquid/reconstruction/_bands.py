"""Harmonics of the shapes that A(t) is built from, those that make its error least, and the effect of the others."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from floquid._arrays import Floats, Integers, Mask
from floquid.core import Estimates, PeriodicModel
from floquid.errors import IdentificationError
from floquid.fit import ROUNDING, chi2_limit, scaled_inverse, unit_scale
from floquid.reconstruction._modal_matrix import Jacobian, Shapes, Terms, at_once, by_system, modal_at

FALSE_ALARM = 1e-3
"""The probability at which noise may pass for a harmonic, over all that are tried: one that is false is multiplied by
the square of its frequency in A(t), and one that is missing leaves out its own size alone."""

GAP = 3  # harmonics of no significance that a band may go on over, to one that the model keeps
INSTANTS = 16  # instants of the period at which the error is looked at
MOST = 8  # choices that are compared
RATIOS, FIRST = (np.sqrt(ends[1:] * ends[:-1]) for ends in (np.geomspace(0.01, 0.9, 25), np.geomspace(0.01, 10.0, 25)))
"""Ratios by which a shape may fall from harmonic to harmonic, and sizes of the first step beside that fall.

The middles of steps that are even in the logarithm: a sum over their ends would count the outermost ones twice.
"""


def chosen(model: PeriodicModel, shapes: Shapes, terms: Terms) -> Mask:
    r"""The terms that A(t) is built from (terms,).

    From the strongest harmonic of each mode its band grows on either side while the next one rises above the noise in
    the channels of the states, at a probability of `FALSE_ALARM` over all that are tried. Of the nested choices from
    the strongest harmonics alone to all of these, the one with the least expected error of A(t) is taken (the focused
    information criterion, Claeskens and Hjort 2003),

    .. math:: R_c = \sum_{t,i,j} \big( \mathrm{var}\, A_c + \max(0,\ |A_c - A|^2 - \mathrm{var}(A_c - A)) \big)

    with A the largest choice, so that a harmonic counts by what it does to A(t), not to the response.
    """
    own = terms.estimates
    rows = (shapes.weights != 0).any(axis=(0, 1, 2))
    score = scores(own, rows)
    band = _grown(model, own, score)
    order = _nested(own, score, band)
    if not len(order):
        return band
    times = np.arange(INSTANTS) * model.period / INSTANTS
    largest = _modal(shapes, terms, band, times)
    if largest is None:
        return band
    best, least, choice = np.inf, band, band.copy()
    step = max(1, -(-len(order) // MOST))
    for number in range(0, len(order) + 1, step):
        candidate = choice.copy()
        candidate[order[:number]] = False
        found = _risk(shapes, terms, candidate, largest, band, times)
        if found < best:
            best, least = found, candidate
    return least


def scores(estimates: Estimates, rows: Mask) -> Floats:
    """The sum of squares of each term over its deviations in some of the channels, over its limit (terms,)."""
    # Without such a harmonic it is a chi-square of two degrees of freedom a channel and hit, which passes the limit by
    # chance at `FALSE_ALARM` over all that are tried. Terms whose rates differ by less than they decay are tested
    # together: of a pair near an axis, and of two exponents that are nearly one, the difference of two large
    # coefficients alone is known. Where hits share their shapes, a hit tells no more than the one that tells most.
    groups = _together(estimates)
    told, responses = _squares(estimates, rows, groups)
    level = FALSE_ALARM / (2 * max(len(estimates.exponents), 1))
    limits = {size: chi2_limit(responses * size, level) for size in {len(group) for group in groups}}
    return np.array([square / limits[len(group)] for square, group in zip(told, groups, strict=True)])


def _squares(estimates: Estimates, rows: Mask, groups: Sequence[Integers]) -> tuple[Floats, int]:
    """Squares of groups of terms over their deviations in some of the channels (groups,), and numbers of one term."""
    own, hits = np.flatnonzero(rows), estimates.blocks.shape[1]
    squares = np.zeros((len(groups), hits))
    for channel in own:
        for hit in range(hits):
            value, whole = estimates.coefficients[:, channel, hit], estimates.row_covariance(int(channel), hit)
            both = np.concatenate([value.real, value.imag])
            for number, group in enumerate(groups):
                part = np.concatenate([group, group + len(value)])
                part = part[np.diag(whole)[part] > 0.0]
                squares[number, hit] += both[part] @ scaled_inverse(whole[np.ix_(part, part)]) @ both[part]
    told = squares.max(axis=1, initial=0.0) if estimates.shared else squares.sum(axis=1)
    return told, 2 * len(own) * (1 if estimates.shared else hits)


def _together(estimates: Estimates) -> list[Integers]:
    """The terms, its own among them, whose rates a record hardly tells from that of each term, mirror images too."""
    rates, decays = estimates.rates, np.abs(estimates.exponents.real)[estimates.modes]
    straight, mirrored = (np.abs(np.subtract.outer(rates, other)) for other in (rates, rates.conj()))
    mirrored[:, estimates.real[estimates.modes]] = np.inf  # its mirror image is of its own mode, and no other number
    near = np.minimum(straight, mirrored) < np.minimum.outer(decays, decays)
    np.fill_diagonal(near, val=True)
    return [np.flatnonzero(own) for own in near]


def _grown(model: PeriodicModel, estimates: Estimates, score: Floats) -> Mask:
    """A contiguous band of each mode about its strongest term, as far as it rises above the noise (terms,)."""
    kept, band = model.kept_terms(estimates), np.zeros(len(score), bool)
    for mode in range(len(estimates.exponents)):
        own = np.flatnonzero(estimates.modes == mode)
        own = own[np.argsort(estimates.harmonics[own])]
        start = int(np.argmax(score[own]))
        ends = [start, start]
        for side, step in ((0, -1), (1, 1)):
            while True:
                ahead = [ends[side] + step * k for k in range(1, GAP + 2)]
                ahead = [k for k in ahead if 0 <= k < len(own) and score[own[k]] > 1.0]
                ahead = [k for k in ahead if abs(k - ends[side]) == 1 or kept[own[k]]]
                if not ahead:
                    break
                ends[side] = ahead[0]
        band[own[ends[0] : ends[1] + 1]] = True
    return band


def _nested(estimates: Estimates, score: Floats, band: Mask) -> Integers:
    """The terms that may be left out, in the order in which they are: the weakest end of a band first."""
    left, order = band.copy(), []
    while True:
        ends = []
        for mode in range(len(estimates.exponents)):
            own = np.flatnonzero((estimates.modes == mode) & left)
            harmonics = estimates.harmonics[own]
            strongest = harmonics[np.argmax(score[own])] if len(own) else 0
            if len(own):
                outer = own[[np.argmin(harmonics), np.argmax(harmonics)]]
                ends += [k for k in outer if estimates.harmonics[k] != strongest]
        if not ends:
            return np.array(order, np.int64)
        weakest = min(ends, key=lambda k: score[k])
        left[weakest] = False
        order.append(int(weakest))


def _modal(shapes: Shapes, terms: Terms, kept: Mask, times: Floats):
    own = terms.mask(kept, shapes)
    try:
        return own, modal_at(own, times)
    except (IdentificationError, np.linalg.LinAlgError):
        return None


def _risk(shapes: Shapes, terms: Terms, candidate: Mask, largest: tuple, band: Mask, times: Floats) -> float:
    """The expected sum of squared errors of A(t), the states in units of their sizes in the modes."""
    found = _modal(shapes, terms, candidate, times)
    if found is None:
        return np.inf
    own, modal = found
    whole, reference = largest
    size = np.sqrt(np.mean(np.abs(reference.modal) ** 2, axis=(0, 2)))
    units, total = np.outer(1.0 / size, size) ** 2, 0.0
    for t in at_once(own, times, terms):
        slopes = by_system(own, modal, times, t, terms)
        total += float(np.sum(units * slopes.variance(terms.estimates)))
        if (candidate != band).any():
            off = np.abs(modal.system[t] - reference.system[t]) ** 2
            noise = (slopes - by_system(whole, reference, times, t, terms)).variance(terms.estimates)
            total += float(np.maximum(np.sum(units * (off - noise), axis=(1, 2)), 0.0).sum())
    return total


def sizes_left_out(estimates: Estimates, kept: Mask, rows: Mask) -> Floats:
    r"""The size that the harmonics left out beyond a band may have (terms, channels, hits).

    On either side of its strongest harmonic, of size a, a shape falls by a ratio of its own (decision 0028),

    .. math:: B_k \sim N(0, v_k), \quad v_k = (a\, q\, r^k)^2, \qquad
              p(q, r) \propto \frac{1}{q\, r} \prod_k \frac{e^{-|\hat B_k|^2 / (v_k + \sigma_k^2)}}{v_k + \sigma_k^2}

    by all that was seen on that side in the channels of the states, kept or not, and of one left out

    .. math:: b_k^2 = E\left[ h\, \sigma_k^2 + h^2\, |\hat B_k|^2 \right], \qquad h = v_k / (v_k + \sigma_k^2)

    `kept` are the terms that are kept (terms,), `rows` the channels of the states (channels,).
    """
    own, sizes = np.flatnonzero(rows), np.zeros(estimates.coefficients.shape)
    seen, noise = (np.abs(values[:, own]) ** 2 for values in (estimates.coefficients, estimates.std()))
    noise = np.maximum(noise, ROUNDING**2 * seen.max(axis=0, initial=0.0) + np.finfo(float).tiny)
    for mode in range(len(estimates.exponents)):
        inside = np.flatnonzero(kept & (estimates.modes == mode))
        if not len(inside):
            continue
        strongest = inside[np.argmax((seen[inside] / noise[inside]).sum(axis=(1, 2)))]
        for side in (-1, 1):
            steps = side * (estimates.harmonics - estimates.harmonics[strongest])
            part = np.flatnonzero((estimates.modes == mode) & (steps > 0))
            beyond = steps[part] > steps[inside].max()
            if beyond.any():
                falls = (FIRST * RATIOS[:, None] ** steps[part, None, None]) ** 2
                found = _moments(seen[strongest], falls, seen[part], noise[part], shared=estimates.shared)
                sizes[np.ix_(part[beyond], own)] = np.sqrt(found[beyond])
    return sizes


def _moments(strongest: Floats, falls: Floats, seen: Floats, noise: Floats, *, shared: bool) -> Floats:
    """Squares that terms may have by what was seen of all, over ratios and first steps (terms, channels, hits)."""
    # Where hits share their shapes, a hit tells no more than the one that tells most.
    hits = range(strongest.shape[1])
    told = [int(np.argmax((strongest / noise.max(axis=0)).sum(axis=0)))] if shared else hits
    logs = 0.0
    for hit in told:
        total = falls[..., None] * strongest[:, hit] + noise[:, None, None, :, hit]
        logs = logs - np.sum(np.log(total) + seen[:, None, None, :, hit] / total, axis=(0, -1))
    weights = np.exp(logs - np.max(logs))
    weights /= weights.sum()
    found = np.empty(seen.shape)
    for hit in hits:
        large = falls[..., None] * strongest[:, hit]
        share = large / (large + noise[:, None, None, :, hit])
        square = share * noise[:, None, None, :, hit] + share**2 * seen[:, None, None, :, hit]
        found[..., hit] = np.einsum("rq,krqc->kc", weights, square)
    return found


def spread_of(sizes: Floats, slopes: Jacobian, estimates: Estimates) -> Floats:
    """The variance that coefficients of these sizes add to the elements of a matrix (times, states, columns)."""
    # They are of any phase, but correlated as their estimates are: large coefficients of two modes that are nearly one
    # cancel.
    found = np.zeros(slopes.by_rate.shape[:3])
    for channel, hit in np.argwhere(sizes.any(axis=0)).tolist():
        left = np.flatnonzero(sizes[:, channel, hit])
        part = np.concatenate([left, left + len(sizes)])
        whole = estimates.row_covariance(channel, hit)[np.ix_(part, part)]
        scale = unit_scale(whole)
        size = np.tile(sizes[left, channel, hit], 2) * np.where(np.diag(whole) > 0.0, np.sqrt(0.5), 0.0)
        moment = whole / np.outer(scale, scale) * np.outer(size, size)
        own = slopes.by_coefficient[..., left, channel, hit]
        both = np.concatenate([own.real, -own.imag], axis=-1)
        found += np.sum((both @ moment) * both, axis=-1)
    return np.maximum(found, 0.0)
