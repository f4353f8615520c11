r"""Number of poles: each must earn its place against the noise, with the others refitted.

The rule. With noise of unit variance, taking away a mode that is not there raises the least-squares cost by a chi-
square of as many degrees of freedom as the mode has parameters (2M + 2 for a conjugate pair over M responses, M + 1
for a real pole); with the noise estimated from few samples it is the numerator of an F ratio. A mode stays when the
rise, all other poles refitted, has a probability below `false_alarm` by chance; the residual is searched over
frequency and decay for a mode that would pass, until none does. Another identifier at several generous orders gives
the starts; the set with the lowest cost plus thresholds wins.

The search. A pole of decay d and angle θ correlates with a residual R as z = Σ_n e^{-dn} e^{-iθn} R_n, and takes

.. math:: \frac{2 (a \sum_j |z_j|^2 - \operatorname{Re} \bar b \sum_j z_j^2)}{a^2 - |b|^2}

out of it (a pair; a real pole Σ z²/a), a and b being the sums of squares |e|² and e² of its own column less what the
poles that are there take. Both sums over responses are transforms of diagonals of R Rᵀ: along the diagonals for |z|²,
across them for z².
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.lib.stride_tricks import as_strided

from floquid._arrays import BLOCK, Complexes, Floats
from floquid.fit import DEVIATIONS, MODES, SURE
from floquid.lti._exponentials import Fit, fit, polish, real_powers
from floquid.lti._factor import Factor
from floquid.lti._poles import NEGATIVE, PAIR, POSITIVE, PoleSet
from floquid.lti._significance import Removal, prune_linear, rise_limit
from floquid.lti._types import Outcome, Report, silent
from floquid.lti.likelihood._residual import Residual


def candidates(poles: PoleSet, factors: Sequence[Factor]) -> list[tuple[PoleSet, float]]:
    """The pair and the two real poles that would take most out of the residual, with what they would take."""
    longest = max(len(f.values) for f in factors)
    lines = 1 << int(np.ceil(np.log2(2 * longest)))
    angles = 2.0 * np.pi * np.arange(lines // 2 + 1) / lines
    decays = np.concatenate([[0.0], np.geomspace(0.3 / longest, 1.0, 8)])
    gains = sum(_gains(poles, block, decays, lines) for block in factors)
    best: dict[int, tuple[float, complex]] = {}
    for decay, gain in zip(decays, np.atleast_2d(gains), strict=True):
        tops = {PAIR: int(np.argmax(gain[1:-1])) + 1 if len(gain) > 2 else None, POSITIVE: 0, NEGATIVE: len(gain) - 1}
        for kind, line in tops.items():
            if line is not None and gain[line] > best.get(kind, (0.0, 0j))[0]:
                best[kind] = (float(gain[line]), complex(-decay, angles[line]))
    order = sorted(best.items(), key=lambda item: -item[1][0])
    return [(PoleSet.of(np.array([s]), np.array([kind])), gain) for kind, (gain, s) in order]


def _gains(poles: PoleSet, block: Factor, decays: Floats, lines: int) -> Floats:
    """Reduction of the residual by a pole of each decay at each line of the grid (decays, lines/2 + 1)."""
    samples = len(block.values)
    k, half = np.arange(samples), np.arange(lines // 2 + 1)
    envelopes = np.exp(-np.multiply.outer(decays, k))
    q, _ = np.linalg.qr(real_powers(poles, samples)) if len(poles) else (np.zeros((samples, 0)), None)
    residual = block.values - q @ (q.T @ block.values)
    power, pseudo = _by_diagonals(residual, envelopes, decays, lines)
    taken, crossed = _by_columns(q, envelopes, decays, lines)
    squares = envelopes**2
    straight = squares.sum(axis=1)[:, None] - taken
    # The envelope's transform at twice the angle, folded back into the grid.
    double = np.fft.rfft(squares, lines, axis=1)
    twice = 2 * half % lines
    folded = np.minimum(twice, lines - twice)
    crossed = np.where(twice <= lines // 2, double[:, folded], double[:, folded].conj()) - crossed
    whole = squares.sum(axis=1)[:, None]
    determinant = straight**2 - np.abs(crossed) ** 2
    pair = 2.0 * (straight * power - (crossed.conj() * pseudo).real)
    gain = np.divide(pair, determinant, out=np.zeros_like(pair), where=determinant > 1e-6 * whole**2)
    ends = [0, lines // 2]
    seen = straight[:, ends] > 1e-6 * whole
    gain[:, ends] = np.divide(power[:, ends], straight[:, ends], out=np.zeros((len(decays), 2)), where=seen)
    return gain


def _by_columns(values: Floats, envelopes: Floats, decays: Floats, lines: int) -> tuple[Floats, Complexes]:
    """Σ_j |z_j|² and Σ_j z_j² (decays, lines/2 + 1), each column transformed."""
    power = np.zeros((len(decays), lines // 2 + 1))
    pseudo = np.zeros(power.shape, complex)
    step = max(1, BLOCK // lines)
    for number, envelope in enumerate(envelopes):
        for start in range(0, values.shape[1], step):
            z = np.fft.rfft(values[:, start : start + step].T * envelope, lines, axis=1)
            power[number] += np.einsum("jl,jl->l", z.real, z.real) + np.einsum("jl,jl->l", z.imag, z.imag)
            pseudo[number] += np.einsum("jl,jl->l", z, z)
    return power, pseudo


def _by_diagonals(values: Floats, envelopes: Floats, decays: Floats, lines: int) -> tuple[Floats, Complexes]:
    """Σ_j |z_j|² and Σ_j z_j² from the Gram matrix."""
    # e^{-d(n + m)} is constant across the diagonals, e^{-2dn} e^{-dl} along them.
    samples = len(values)
    along, across = np.zeros((len(decays), samples)), np.zeros(2 * samples - 1)
    # Half of the Gram matrix is enough, some rows at a time.
    step = max(1, BLOCK // (2 * samples))
    for start in range(0, samples, step):
        gram = values[start : start + step] @ values[start:].T
        rows, wide = gram.shape
        padded = np.zeros((rows, 2 * wide))
        padded[:, :wide] = gram
        padded[:, :rows] = np.triu(gram[:, :rows])
        # Rows one entry longer are turned: a column then is a lag; rows one entry shorter: a column then is a sum.
        row, column = padded.strides
        upper = as_strided(padded, (rows, wide), (row + column, column))
        along[:, :wide] += envelopes[:, start : start + rows] ** 2 @ upper
        lags = 2 * wide - 1
        across[2 * start :] += 2.0 * padded.ravel()[: rows * lags].reshape(rows, lags).sum(axis=0)
        across[2 * start : 2 * (start + rows) : 2] -= np.diagonal(gram)
    along *= envelopes
    power = 2.0 * np.fft.rfft(along, lines, axis=1).real - along[:, :1]
    weights = np.exp(-np.multiply.outer(decays, np.arange(2 * samples - 1)))
    return power, np.fft.rfft(weights * across, lines, axis=1)


@dataclass(frozen=True, slots=True)
class Threshold:
    """The rise of the cost that a mode must make, for `columns` responses of `samples` numbers in all."""

    columns: int
    samples: int
    false_alarm: float
    independent: float = 1.0  # the share of the responses that the noise is worth (`Residual.independent`)
    variance: float = 1.0
    """The mean square of the noise; less than what was stated is not believed, since that may be a floor."""

    @staticmethod
    def for_(factors: Sequence[Factor], false_alarm: float, noise: Residual) -> Threshold:
        """The threshold for these blocks, beside noise like this."""
        columns, samples = sum(f.columns for f in factors), sum(f.columns * len(f.values) for f in factors)
        return Threshold(columns, samples, false_alarm, noise.independent, max(noise.variance, 1.0))

    def of(self, size: int) -> float:
        """The threshold for `size` poles counted one by one: each has its own residues and one parameter."""
        return self.at(self.false_alarm, size)

    def at(self, probability: float, size: int, *, own: float = 1.0) -> float:
        """The rise that noise exceeds with another probability, `own` parameters a pole beside the residues."""
        # Satterthwaite: a sum of dependent squares is a multiple of a chi-square of fewer degrees of freedom.
        share = self.independent
        degrees = size * (self.columns * share + own)
        return self.variance * rise_limit(probability, degrees, self.samples * share) / share

    def promising(self, size: int) -> float:
        """Reduction of the residual by a pole (1) or pair (2) on the grid from which on it is tried."""
        # A mode that just passes the test takes less where it lies between the lines of the grid.
        return min(self.at(SURE, size, own=0.0), self.of(size))

    def penalised(self, fit: Fit) -> float:
        """The cost plus the thresholds of all that was spent on it."""
        pairs = int((fit.poles.kind == PAIR).sum())
        return fit.cost + pairs * self.of(2) + (len(fit.poles) - pairs) * self.of(1)


def choose(
    factors: Sequence[Factor],
    start: Callable[[int], PoleSet],
    *,
    false_alarm: float,
    most: int,
    starts: Sequence[int],
    noise: Residual,
    until: float = np.inf,
    report: Report = silent,
) -> tuple[Fit, Outcome, Residual]:
    """The poles that the data support, fitted by maximum likelihood; how the search ended; and what is left.

    `noise` is what more poles than there are modes leave; it is judged again by what the poles found leave. When the
    processor time `until` [s] is over, the poles so far are given.

    A start of less than twice the order that it leads to is left for the next, which tells more; one of more needs no
    other beside it, since its poles all pass and nothing that would is left.
    """
    threshold = Threshold.for_(factors, false_alarm, noise)
    best, ended = fit(PoleSet.empty(), factors), False
    for order in starts:
        begin = prune_linear(start(order).plausible(), factors, (threshold.of(1), threshold.of(2)))
        if 2 * begin.order > order and order < starts[-1]:
            continue
        polished = polish(begin, factors)
        if begin.order > 2 * MODES and not Residual.of(polished.poles, factors).white():
            if order < starts[-1]:
                continue
            report(f"start of order {order}: {begin.order} poles, and what they leave is no noise")
            if not ended:
                return polished, Outcome.NOT_WHITE, noise
            return best, Outcome.SUCCESS, Residual.of(best.poles, factors)
        settled = _settle(polished, factors, threshold, most, until)
        report(f"start of order {order}: {settled.poles.order} poles kept")
        if not ended or threshold.penalised(settled) < threshold.penalised(best) - 1e-6 * abs(best.cost):
            best, ended = settled, True
        if 2 * settled.poles.order <= order or time.process_time() > until:
            break
    residual = Residual.of(best.poles, factors)
    again = Threshold.for_(factors, false_alarm, residual)
    if again.of(2) > 1.1 * threshold.of(2):
        report(f"the noise is worth {residual.independent:.0%} of the responses")
        best = _settle(best, factors, again, most, until)
        residual = Residual.of(best.poles, factors)
    return best, Outcome.OUT_OF_TIME if time.process_time() > until else Outcome.SUCCESS, residual


def possible(fit: Fit) -> bool:
    """True where all poles of a fit could be seen."""
    return len(fit.poles.plausible()) == len(fit.poles)


def _settle(fit: Fit, factors: Sequence[Factor], threshold: Threshold, most: int, until: float) -> Fit:
    """Prune, try the real axis and add from the residual, until nothing gets better or the time is over."""
    lowest = np.inf
    while True:
        before = fit.poles
        fit = _prune(fit, factors, threshold, until)
        if time.process_time() > until:
            return fit
        fit = _straighten(fit, factors, threshold)
        if fit.poles.order < most:
            fit = _add(fit, factors, threshold)
        score = threshold.penalised(fit)
        if fit.poles is before or score >= lowest:
            return fit
        lowest = score


def _prune(fit: Fit, factors: Sequence[Factor], threshold: Threshold, until: float) -> Fit:
    """Take away each entry whose absence, the others refitted, the noise could explain."""
    changed = True
    while changed and len(fit.poles) and time.process_time() < until:
        changed = False
        if not possible(fit):
            fit, changed = polish(fit.poles.plausible(), factors), True
            continue
        rises = Removal.of(fit.poles, factors).rises()
        for entry in np.argsort(rises):
            limit = threshold.of(int(fit.poles.sizes[entry]))
            enough = fit.cost + limit
            less = polish(fit.poles.without(int(entry)), factors, iterations=25, tolerance=1e-2, enough=enough)
            if less.cost - fit.cost < limit:
                fit, changed = polish(less, factors), True
                break
    return fit


def _straighten(fit: Fit, factors: Sequence[Factor], threshold: Threshold) -> Fit:
    """Turn a pair next to the real axis into one real pole, or into two that are told apart, where the data say so."""
    for entry in np.flatnonzero(fit.poles.kind == PAIR):
        s = fit.poles.s[entry]
        for kind, angle in ((POSITIVE, s.imag), (NEGATIVE, np.pi - s.imag)):
            if angle > 0.5 * abs(s.real) + 0.05:
                continue
            rest = fit.poles.without(int(entry))
            single = polish(rest.plus(real_poles(kind, s.real)), factors)
            if possible(single) and single.cost - fit.cost < threshold.of(2) - threshold.of(1):
                return single
            gap = max(angle, 0.2 * abs(s.real), 1e-3)
            two = polish(rest.plus(real_poles(kind, s.real - gap, s.real + gap)), factors)
            if possible(two) and two.cost - fit.cost < -(DEVIATIONS**2) and _told_apart(two, -2, -1):
                return two
    for kind in (POSITIVE, NEGATIVE):
        along = np.flatnonzero(fit.poles.kind == kind)
        along = along[np.argsort(fit.poles.s[along].real)]
        for first, second in pairwise(along):
            if _told_apart(fit, int(first), int(second)):
                continue
            middle = fit.poles.s[[first, second]].mean()
            turn = max(0.1 * abs(middle.real), 1e-3)
            pair = PoleSet.of(np.array([middle + (1j if kind == POSITIVE else -1j) * turn]), np.array([PAIR]))
            rest = fit.poles.keep(~np.isin(np.arange(len(fit.poles)), [first, second]))
            met = polish(rest.plus(pair), factors)
            if met.cost - fit.cost < DEVIATIONS**2:
                return met
    return fit


def real_poles(kind: int, *decays: float) -> PoleSet:
    """Real poles of one sign."""
    return PoleSet.of(np.array(decays) + 0j, np.full(len(decays), kind))


def _told_apart(fit: Fit, first: int, second: int) -> bool:
    """True where two real entries are `DEVIATIONS` standard deviations apart."""
    starts = fit.poles.starts()
    difference = np.zeros(fit.poles.order)
    difference[starts[first]], difference[starts[second]] = 1.0, -1.0
    gap = abs((fit.poles.s[first] - fit.poles.s[second]).real)
    return bool(gap > DEVIATIONS * np.sqrt(difference @ fit.covariance() @ difference))


def _add(fit: Fit, factors: Sequence[Factor], threshold: Threshold) -> Fit:
    """The fit with the mode that the residual holds most clearly, if it holds one."""
    for candidate, promised in candidates(fit.poles, factors):
        size = int(candidate.sizes[0])
        if promised < threshold.promising(size):
            continue
        more = polish(fit.poles.plus(candidate), factors, iterations=25, tolerance=1e-2)
        if possible(more) and fit.cost - more.cost > threshold.of(size):
            return polish(more, factors)
    return fit


def force_order(fit: Fit, factors: Sequence[Factor], order: int, false_alarm: float) -> Fit:
    """The fit brought to `order` poles where that can be done: the least significant leave, the clearest join."""
    threshold = Threshold.for_(factors, false_alarm, Residual.of(fit.poles, factors))
    while fit.poles.order > order:
        excess = Removal.of(fit.poles, factors).rises() - np.array([threshold.of(int(n)) for n in fit.poles.sizes])
        excess[fit.poles.sizes > fit.poles.order - order] = np.inf
        if not np.isfinite(excess).any():
            break
        fit = polish(fit.poles.without(int(np.argmin(excess))), factors)
    while fit.poles.order < order:
        room = order - fit.poles.order
        trials = [polish(fit.poles.plus(c), factors) for c, _ in candidates(fit.poles, factors) if c.order <= room]
        trials = [t for t in trials if possible(t) and t.cost < fit.cost]
        if not trials:
            break
        fit = min(trials, key=threshold.penalised)
    return fit
