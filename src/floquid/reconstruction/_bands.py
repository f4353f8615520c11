"""Harmonics of the shapes that A(t) is built from, those that make its error least, and the effect of the others."""

from __future__ import annotations

import numpy as np

from floquid._arrays import Floats, Integers, Mask
from floquid.core import Estimates, PeriodicModel
from floquid.errors import IdentificationError
from floquid.fit import chi2_limit
from floquid.reconstruction._modal_matrix import Jacobian, Shapes, Terms, at_once, by_system, modal_at

FALSE_ALARM = 1e-3
"""The probability at which noise may pass for a harmonic, over all that are tried: one that is false is multiplied by
the square of its frequency in A(t), and one that is missing leaves out its own size alone."""

GAP = 3  # harmonics of no significance that a band may go on over, to one that the model keeps
INSTANTS = 16  # instants of the period at which the error is looked at
MOST = 8  # choices that are compared
UNSEEN = 2.0  # standard deviations that a harmonic which is left out may be larger than it was seen


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
    band = _grown(model, own, score, int(rows.sum()) * (1 if own.shared else own.blocks.shape[1]))
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
    """The sum of squares of each term over its deviations in some of the channels (terms,).

    Without such a harmonic it is a chi-square of two degrees of freedom a channel and hit. Where hits share their
    shapes, a hit tells no more than the one that tells most.
    """
    std, value = estimates.std()[:, rows], estimates.coefficients[:, rows]
    real = np.divide(value.real, std.real, out=np.zeros(value.shape), where=std.real > 0)
    turning = np.broadcast_to(estimates.turning[:, None, None] & (std.imag > 0), value.shape)
    imag = np.divide(value.imag, std.imag, out=np.zeros(value.shape), where=turning)
    by_hit = np.sum(real**2 + imag**2, axis=1)
    return by_hit.max(axis=1, initial=0.0) if estimates.shared else by_hit.sum(axis=1)


def _grown(model: PeriodicModel, estimates: Estimates, score: Floats, responses: int) -> Mask:
    """A contiguous band of each mode about its strongest term, as far as it rises above the noise (terms,)."""
    kept, band = model.kept_terms(estimates), np.zeros(len(score), bool)
    limit = chi2_limit(2 * responses, FALSE_ALARM / (2 * len(estimates.exponents)))
    for mode in range(len(estimates.exponents)):
        own = np.flatnonzero(estimates.modes == mode)
        own = own[np.argsort(estimates.harmonics[own])]
        start = int(np.argmax(score[own]))
        ends = [start, start]
        for side, step in ((0, -1), (1, 1)):
            while True:
                ahead = [ends[side] + step * k for k in range(1, GAP + 2)]
                ahead = [k for k in ahead if 0 <= k < len(own) and score[own[k]] > limit]
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
    r"""The size that the first harmonic left out on each side of a band may have (terms, channels, hits).

    .. math:: b = \min\Big(|B_L| \frac{\lVert B_L \rVert}{\lVert B_{L'} \rVert},\ |\hat B| + 2\sigma\Big)

    with L the outermost harmonic kept and L' the one before it, and norms over the noise: the series goes on falling as
    it does, but no higher than what was seen there allows. Where one harmonic alone is kept, what was seen there
    decides. `kept` are the terms that are kept (terms,), `rows` the channels of the states (channels,).
    """
    values = np.abs(estimates.coefficients)
    std = estimates.std()
    seen = values + UNSEEN * np.abs(std) / np.sqrt(2.0)
    # Over the noise: a noisy channel of little weight would make the series fall slowly.
    noise = np.sqrt(np.mean(np.abs(std) ** 2, axis=0))
    norm = np.sqrt(np.sum((values[:, rows] / noise[rows]) ** 2, axis=(1, 2)))
    sizes = np.zeros(values.shape)
    for mode in range(len(estimates.exponents)):
        own = np.flatnonzero(estimates.modes == mode)
        own = own[np.argsort(estimates.harmonics[own])]
        inside = np.flatnonzero(kept[own])
        if not len(inside):
            continue
        strongest = inside[np.argmax(norm[own[inside]])]
        for last, step in ((inside[0], -1), (inside[-1], 1)):
            following = last + step
            if not 0 <= following < len(own):
                continue
            limit = seen[own[following]]
            if last != strongest:
                falls = norm[own[last]] / norm[own[last - step]]
                limit = np.minimum(limit, values[own[last]] * min(falls, 1.0))
            sizes[own[following]] = limit
    return sizes


def spread_of(sizes: Floats, slopes: Jacobian) -> Floats:
    """The variance that coefficients of these sizes and of any phase add to the elements (times, states, states)."""
    squares = np.abs(slopes.by_coefficient) ** 2
    return 0.5 * (squares.reshape(*squares.shape[:3], -1) @ sizes.ravel() ** 2)
