"""Harmonics of the shapes that A(t) is built from, those that make its error least, and the effect of the others."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from floquid._arrays import Floats, Integers, Mask
from floquid.core import Estimates, PeriodicModel
from floquid.errors import IdentificationError
from floquid.fit import chi2_limit, scaled_inverse, unit_scale
from floquid.reconstruction._hidden import hidden_share
from floquid.reconstruction._modal_matrix import Jacobian, Shapes, Terms, at_once, by_system, modal_at
from floquid.reconstruction._structure import HIDDEN

FALSE_ALARM = 1e-3
"""The probability at which noise may pass for a harmonic, over all that are tried: one that is false is multiplied by
the square of its frequency in A(t), and one that is missing leaves out its own size alone."""

GAP = 3  # harmonics of no significance that a band may go on over, to one that the model keeps
INSTANTS = 16  # instants of the period at which the error is looked at
MOST = 8  # choices that are compared


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
    r"""The size that the first harmonics left out on each side of a band may have (terms, channels, hits).

    .. math:: b^2 = E(1 - B)\, \sigma^2 + E(1 - B)^2\, |\hat B|^2

    by what was seen there, as `hidden_share` has it, in all channels of the states together. `kept` are the terms that
    are kept (terms,), `rows` the channels of the states (channels,).
    """
    beyond = []
    for mode in range(len(estimates.exponents)):
        own = np.flatnonzero(estimates.modes == mode)
        inside = estimates.harmonics[own[kept[own]]]
        if len(inside):
            off = np.maximum(inside.min() - estimates.harmonics[own], estimates.harmonics[own] - inside.max())
            beyond += own[(off > 0) & (off <= HIDDEN)].tolist()
    sizes, std = np.zeros(estimates.coefficients.shape), estimates.std()
    squares, numbers = _squares(estimates, rows, [np.array([term]) for term in beyond])
    for term, square in zip(beyond, squares.tolist(), strict=True):
        share, share_of_square = hidden_share(square, numbers)
        seen, noise = np.abs(estimates.coefficients[term]), np.abs(std[term])
        sizes[term] = np.sqrt(share * noise**2 + share_of_square * seen**2)
    return sizes


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
