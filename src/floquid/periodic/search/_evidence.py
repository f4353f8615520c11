"""Findings for and against the modes of a search."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations_with_replacement

import numpy as np

from floquid._arrays import Complexes, Floats, Integers
from floquid.core import PeriodicModel, kind_open
from floquid.findings import Finding, failure, note, warning
from floquid.fit import CHUNK, DEVIATIONS, EVIDENT, SIGNIFICANT, SURE, WITHIN
from floquid.periodic.least_squares import shapes
from floquid.periodic.search._objective import SearchResult
from floquid.search import NEAR

LOUD = 2.0  # times what noise has from which on a peak that is left is a doubt
ENOUGH_LINES = 12  # lines of a band, at least, for its level to be looked at

SPREAD = 0.82
"""The variance of the logarithm of the median level of a band of white noise, times its lines: 1/(2 ln 2)² for lines
that are independent, more under a window, which makes neighbouring lines alike."""


def evidence(result: SearchResult) -> tuple[Finding, ...]:
    """Findings for and against the modes of a search."""
    entries, peak = result.solution.entries, result.peak
    values = entries.exponents + 1j * entries.fundamental * entries.offsets
    share = peak.gain / peak.limit
    loud = bool(share > LOUD)
    highest = (warning if loud else note)("strongest_peak", frequency=_hertz(peak.exponent), share=share, loud=loud)
    return (
        note("all_needed", number=int((~entries.fixed).sum())),
        highest,
        *clusters(result),
        *two_of_one_multiplier(result),
        *doubles(result),
        *near_axis(result),
        *combinations(result),
        *(() if result.one is None else (note("one_shape", hits=result.one.states.shape[1]),)),
        *(note("several_shapes", frequency=_hertz(values[each[0]]), number=len(each)) for each in result.twice),
    )


def disagreement(result: SearchResult) -> tuple[Finding, ...]:
    """Warnings on hits that do not share the exponent of a mode, or the shapes; empty where they do, or not known."""
    entries, off = result.solution.entries, result.disagreement
    found = []
    for each in result.unlike:
        value = entries.exponents[each.entry] + 1j * entries.fundamental * entries.offsets[each.entry]
        hits, alone = zip(*((hit + 1, complex(value + step)) for hit, step in each.moved), strict=True)
        decays, frequencies = [-one.real for one in alone], [_hertz(one) for one in alone]
        found.append(
            (failure if each.torn else warning)(
                "hits_unlike",
                frequency=_hertz(complex(value)),
                hits=list(hits),
                decays=decays,
                frequencies=frequencies,
                probability=each.probability,
                torn=each.torn,
            )
        )
    if off is None or found:
        return tuple(found)
    shares = {"frequency": _hertz(off.exponent), "share": off.share, "probability": off.probability}
    return (warning("hits_disagree", **shares, groups=[[hit + 1 for hit in hits] for hits in off.groups]),)


def _hertz(exponent: complex) -> float:
    """The frequency of an exponent [Hz]."""
    return abs(float(exponent.imag)) / (2.0 * np.pi)


def coloured(result: SearchResult) -> tuple[Finding, ...]:
    r"""Finding that the residual is not white along the record, so that deviations are not those stated; else empty.

    .. math:: \sum_{c,h} \sum_{b} \frac{n_b}{v} (\ln s_{c,h,b} - \overline{\ln s_{c,h}})^2 \sim \chi^2

    with s the median level of a band of n lines apart from the exponentials fitted, v/n the variance of its logarithm.
    """
    from scipy.special import chdtrc

    score, degrees, worst = 0.0, 0, (1.0, 0.0, 0.0)
    rates = result.solution.entries.columns().rates
    for residual in result.residuals:
        levels, lines = residual.between(rates)
        bands = np.flatnonzero(lines >= ENOUGH_LINES)
        if len(bands) < 2:
            continue
        logs, weights = np.log(levels[:, bands]), lines[bands]
        mean = (logs @ weights / weights.sum())[:, None]
        score += float(np.sum((logs - mean) ** 2 @ weights)) / SPREAD
        degrees += len(logs) * (len(bands) - 1)
        row = int(np.argmax(np.ptp(logs, axis=1)))
        ends = bands[[int(np.argmax(logs[row])), int(np.argmin(logs[row]))]]
        centres = (ends + 0.5) / len(lines) * (0.5 / residual.step)
        worst = max(worst, (float(np.exp(np.ptp(logs[row]))), *centres.tolist()))
    ratio, loud, quiet = worst
    if degrees == 0 or chdtrc(degrees, score) > SURE:
        return ()
    return (warning("coloured_noise", ratio=ratio, loud=loud, quiet=quiet),)


def clusters(result: SearchResult) -> tuple[Finding, ...]:
    """Modes whose harmonics do not have one exponent."""
    exponents = result.solution.entries.exponents
    return tuple(warning("cluster", frequency=_hertz(exponents[entry])) for entry in result.clusters)


def two_of_one_multiplier(result: SearchResult) -> tuple[Finding, ...]:
    """Doubt of the order where hits do not share the shape of a mode: two modes of one multiplier have two shapes."""
    off, entries = result.disagreement, result.solution.entries
    if off is None:
        return ()
    # At one exponent of all, the shape of a mode whose exponent differs between hits differs as well.
    values = [
        complex(entries.exponents[each.entry] + 1j * entries.fundamental * entries.offsets[each.entry])
        for each in result.unlike
    ]
    return (warning("two_of_one_multiplier", frequency=_hertz([*values, off.exponent][0])),)


def near_axis(result: SearchResult) -> tuple[Finding, ...]:
    """Pairs near an axis of either kind, and real multipliers beside which noise may hide a second one."""
    entries, findings = result.solution.entries, []
    values = entries.exponents + 1j * entries.fundamental * entries.offsets
    for place, apart in result.apart.items():
        findings.append(kind_open(complex(values[place]), apart))
    for entry in entries.alone:
        numbers = {"decay": -float(values[entry].real), "apart": _hidden(result, entry)}
        findings.append(note("hidden_partner", frequency=_hertz(complex(values[entry])), **numbers))
    return tuple(findings)


def _hidden(result: SearchResult, entry: int) -> float:
    r"""Distance from a real multiplier, on either side, of two that look like one, as far as noise hides them [1/s].

    Their mean stands for the first moment of both, and noise hides the second:

    .. math:: e^{\sigma t} (1 + \tfrac12 q t^2), \qquad q < 1.96 \operatorname{std} q

    as the deviation of σ tells that of q: both are of t and t² beside what comes before.
    """
    solution, entries = result.solution, result.solution.entries
    place = int(np.sum(entries.leading[:entry]))
    std = float(np.sqrt(max(solution.covariance()[place, place], 0.0)))
    times = np.linspace(0.0, max(block.last for block in result.blocks), CHUNK)
    decaying = np.exp(entries.exponents[entry].real * times)[:, None]
    seen = np.linalg.qr(decaying * np.vander(times, 3, increasing=True)).R
    return float(np.sqrt(WITHIN * 2.0 * abs(seen[1, 1] / seen[2, 2]) * std))


def doubles(result: SearchResult) -> tuple[Finding, ...]:
    """Modes that fold onto one another nearer than they decay: they may be one.

    Not two real multipliers of unlike decays: harmonics of one mode decay alike. And not modes of one multiplier whose
    shapes the hits share.
    """
    entries = result.solution.entries
    free = np.flatnonzero(~entries.fixed)
    omega, near, std = entries.fundamental, [], _deviations(result, free)
    values = entries.exponents[free] + 1j * omega * entries.offsets[free]
    both = {place for place in result.as_read if entries.real[place] and place + 1 in result.as_read}
    for k, value in enumerate(values):
        for later, second in enumerate(values[k + 1 + (free[k] in both) :], start=k + 1 + (free[k] in both)):
            both_real = entries.real[free[k]] and entries.real[free[later]]
            if any({free[k], free[later]} <= set(each) for each in result.twice):
                continue
            if both_real and abs(value.real - second.real) > SIGNIFICANT * (std[k] + std[later]):
                continue
            gaps = [value - second, value - second.conjugate()]
            gaps = [complex(gap.real, gap.imag - omega * round(gap.imag / omega)) for gap in gaps]
            if min(abs(gap) for gap in gaps) < NEAR * min(abs(value.real), abs(second.real)):
                near.append(warning("double", first=_hertz(value), second=_hertz(second), decays=NEAR))
    return tuple(near)


def combinations(result: SearchResult) -> tuple[Finding, ...]:
    """Modes of a search that a nonlinearity makes of others."""
    entries = result.solution.entries
    free = np.flatnonzero(~entries.fixed)
    values = entries.exponents[free] + 1j * entries.fundamental * entries.offsets[free]
    return _products(values, _deviations(result, free), _sizes(result, free), entries.fundamental)


def combinations_of(model: PeriodicModel, noise: Floats, *, nonlinear: bool = False) -> tuple[Finding, ...]:
    r"""Modes of a model that a nonlinearity makes of others.

    .. math:: \lambda_c = \lambda_a + \lambda_b + i m \omega

    `noise` are the deviations of the noise (channels, hits) [units of the channels] of the periodic `model`. Where a
    record is known not to be one of modes alone (`nonlinear`), sums are looked for from farther away: several may have
    come out as one. Returns one finding a mode.
    """
    chosen, std = list(model.upper_modes), model.exponent_std
    if std is None or not chosen:
        return ()
    size = np.abs(model.coefficients[chosen] / noise[:, :, None]).max(axis=(1, 2, 3))
    worst = np.maximum(std.real, std.imag)[chosen]
    near = NEAR if nonlinear else EVIDENT
    return _products(model.exponents[chosen], worst, size, model.fundamental, near=near)


def _products(
    values: Complexes, std: Floats, size: Floats, omega: float, *, near: float = EVIDENT
) -> tuple[Finding, ...]:
    r"""Exponents that are sums of those of two larger modes.

    .. math:: \lambda_c = \lambda_a + \lambda_b + i m \omega

    a and b being modes or conjugates of modes: the product of two multipliers, as a quadratic term about a large orbit
    leaves it.
    """
    products = []
    for c, value in enumerate(values):
        larger = np.flatnonzero(size > size[c])
        signed = [(a, sign) for a in larger for sign in (1, -1)]
        sums = list(combinations_with_replacement(signed, 2))
        for (a, first_sign), (b, second_sign) in sums:
            total = (values[a] if first_sign > 0 else values[a].conj()) + (
                values[b] if second_sign > 0 else values[b].conj()
            )
            gap = value - total
            gap = complex(gap.real, gap.imag - omega * round(gap.imag / omega))
            tolerance = max(DEVIATIONS * float(np.hypot(std[c], std[a] + std[b])), near * abs(value.real))
            # By chance less than one of all sums is so near.
            if abs(gap) < tolerance < 0.5 * omega / len(sums):
                of = [_hertz(values[k]) for k in sorted({int(a), int(b)})]
                products.append(warning("product", frequency=_hertz(value), of=of))
                break
    return tuple(products)


def _sizes(result: SearchResult, free: Integers) -> Floats:
    """The largest coefficient of each mode over the noise (modes,)."""
    both = shapes(result.blocks, result.solution)
    noise = np.full(both.coefficients.shape[1:3], np.inf)
    for block in result.blocks:
        noise[block.rows, block.hit] = block.noise
    return np.abs(both.coefficients[free] / noise[:, :, None]).max(axis=(1, 2, 3))


def _deviations(result: SearchResult, free: Integers) -> Floats:
    """The larger deviation of the parts of each exponent by noise alone (modes,)."""
    entries = result.solution.entries
    std = np.sqrt(np.maximum(np.diag(replace(result.solution, further=None).covariance()), 0.0))
    turns = np.zeros(len(free))
    pairs = ~entries.real[free]
    turns[pairs] = std[len(free) : len(free) + int(pairs.sum())]
    return np.maximum(std[: len(free)], turns)
