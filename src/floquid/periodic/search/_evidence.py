"""What speaks for the modes that a search found, and against them."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from floquid.core import PeriodicModel
from floquid.periodic.least_squares import shapes, upper
from floquid.periodic.search._result import SearchResult

LOUD = 2.0
"""Times what noise has from which on a peak that is left is a doubt."""

NEAR = 0.1
"""How near a sum of two exponents must be to a third, over its decay, to be taken for it."""

FAR = 0.6
"""The same where a record is known to be nonlinear."""

DOUBLE = 0.5
"""Decays that two modes must be apart, modulo the fundamental, to be surely two."""

CHANCE = 0.01
"""The tolerance, over the fundamental, beyond which a sum agrees by chance too often to say anything."""

CERTAIN = 5.0
"""The same in standard deviations."""

LOPSIDED = 1.3
"""The loudest band over the quietest, in amplitude, below which colour does little harm."""

COLOURED = 1e-4
"""The probability at which white noise may pass for coloured."""

ENOUGH_LINES = 12
"""Lines of a band, at least, for its level to be looked at."""

SPREAD = 0.82
"""The variance of the logarithm of the median level of a band of white noise, times its lines: 1/(2 ln 2)² for lines
that are independent, more under a window, which makes neighbouring lines alike."""


def evidence(found: SearchResult) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Sentences for the modes, and sentences against them."""
    entries, peak = found.solution.entries, found.peak
    count = int((~entries.fixed).sum())
    words = "One mode is" if count == 1 else f"{count} modes, a pair counted once, are"
    found_how = f"{words} needed: noise explains none of them, nor do the harmonics of another."
    against = (*clusters(found), *doubles(found), *combinations(found))
    share = peak.gain / peak.limit
    where = f"{abs(peak.exponent.imag) / (2.0 * np.pi):.4g} Hz"
    text = f"The strongest peak that is left, at {where}, is {share:.2f} of the highest that noise alone mostly has"
    if share > LOUD:
        doubt = f"{text}: what is left is not all noise (a nonlinearity, a drifting amplitude, another tone)."
        return (found_how,), (doubt, *against)
    return (found_how, f"{text}."), against


def coloured(found: SearchResult) -> tuple[str, ...]:
    r"""A sentence where the residual is not white along the record, so that deviations are not those stated.

    .. math:: \sum_{c,h} \sum_{b} \frac{n_b}{v} (\ln s_{c,h,b} - \overline{\ln s_{c,h}})^2 \sim \chi^2

    with s the median level of a band of n lines apart from the exponentials fitted, v/n the variance of its logarithm.
    """
    from scipy.special import chdtrc

    score, degrees, worst = 0.0, 0, (1.0, 0.0, 0.0)
    rates = found.solution.entries.columns().rates
    for residual in found.residuals:
        levels, lines = residual.between(rates)
        own = np.flatnonzero(lines >= ENOUGH_LINES)
        if len(own) < 2:
            continue
        logs, weights = np.log(levels[:, own]), lines[own]
        mean = (logs @ weights / weights.sum())[:, None]
        score += float(np.sum((logs - mean) ** 2 @ weights)) / SPREAD
        degrees += len(logs) * (len(own) - 1)
        row = int(np.argmax(np.ptp(logs, axis=1)))
        ends = own[[int(np.argmax(logs[row])), int(np.argmin(logs[row]))]]
        centres = (ends + 0.5) / len(lines) * (0.5 / residual.step)
        worst = max(worst, (float(np.exp(np.ptp(logs[row]))), *centres.tolist()))
    ratio, loud, quiet = worst
    if degrees == 0 or ratio < LOPSIDED or chdtrc(degrees, score) > COLOURED:
        return ()
    sentence = (
        f"The noise is not white along the record: about {loud:.4g} Hz it is {ratio:.3g} times that about "
        f"{quiet:.4g} Hz. It is taken for white: the intervals of modes are too short where it is loud, and too long "
        "where it is quiet; a weak mode where it is loud may be noise."
    )
    return (sentence,)


def clusters(found: SearchResult) -> tuple[str, ...]:
    """Modes whose harmonics do not have one exponent, a sentence each."""
    entries = found.solution.entries
    return tuple(
        f"The mode at {abs(entries.exponents[entry].imag) / (2.0 * np.pi):.4g} Hz is most likely a cluster of several "
        "that fold onto one another: its harmonics ask for different exponents. Its deviation covers them."
        for entry in found.clusters
    )


def doubles(found: SearchResult) -> tuple[str, ...]:
    """Modes that fold onto one another nearer than they decay, a sentence each: they may be one."""
    entries = found.solution.entries
    free = np.flatnonzero(~entries.fixed)
    omega, sentences = entries.fundamental, []
    values = entries.exponents[free] + 1j * omega * entries.offsets[free]
    for k, value in enumerate(values):
        for other in values[k + 1 :]:
            gaps = [value - other, value - other.conjugate()]
            gaps = [complex(gap.real, gap.imag - omega * round(gap.imag / omega)) for gap in gaps]
            if min(abs(gap) for gap in gaps) < DOUBLE * min(abs(value.real), abs(other.real)):
                names = f"{abs(value.imag) / (2.0 * np.pi):.4g} Hz and {abs(other.imag) / (2.0 * np.pi):.4g} Hz"
                sentences.append(
                    f"The modes at {names} are whole numbers of fundamentals apart within {DOUBLE:g} of their decay: "
                    "they may be one mode with harmonics that its band leaves out."
                )
    return tuple(sentences)


def combinations(found: SearchResult) -> tuple[str, ...]:
    """Modes of a search that a nonlinearity makes of others, a sentence each."""
    entries = found.solution.entries
    free = np.flatnonzero(~entries.fixed)
    values = entries.exponents[free] + 1j * entries.fundamental * entries.offsets[free]
    return _products(values, _deviations(found, free), _sizes(found, free), entries.fundamental)


def combinations_of(model: PeriodicModel, noise: NDArray[np.float64], *, nonlinear: bool = False) -> tuple[str, ...]:
    r"""Modes of a model that a nonlinearity makes of others, a sentence each.

    .. math:: \lambda_c = \lambda_a + \lambda_b + i m \omega

    Parameters
    ----------
    model
        The periodic model.
    noise
        The deviation of the noise (channels, hits) [units of the channels].
    nonlinear
        Whether the record is known not to be one of modes alone: then sums are looked for from farther away, since
        several may have come out as one.

    Returns
    -------
    tuple of str
        The sentences.
    """
    chosen, std = upper(model), model.exponent_std
    if std is None or not chosen:
        return ()
    size = np.abs(model.coefficients[chosen] / noise[:, :, None]).max(axis=(1, 2, 3))
    worst = np.maximum(std.real, std.imag)[chosen]
    near, chance = (FAR, 2.0 * CHANCE) if nonlinear else (NEAR, CHANCE)
    return _products(model.exponents[chosen], worst, size, model.fundamental, near=near, chance=chance)


def _products(
    values: NDArray[np.complex128],
    std: NDArray[np.float64],
    size: NDArray[np.float64],
    omega: float,
    *,
    near: float = NEAR,
    chance: float = CHANCE,
) -> tuple[str, ...]:
    r"""Exponents that are sums of those of two larger modes.

    .. math:: \lambda_c = \lambda_a + \lambda_b + i m \omega

    a and b being modes or conjugates of modes: the product of two multipliers, as a quadratic term about a large orbit
    leaves it.
    """
    sentences = []
    for c, value in enumerate(values):
        larger = np.flatnonzero(size > size[c])
        signed = [(a, sign) for a in larger for sign in (1, -1)]
        for (a, one), (b, other) in combinations_with_replacement(signed, 2):
            total = (values[a] if one > 0 else values[a].conj()) + (values[b] if other > 0 else values[b].conj())
            gap = value - total
            gap = complex(gap.real, gap.imag - omega * round(gap.imag / omega))
            tolerance = max(CERTAIN * float(np.hypot(std[c], std[a] + std[b])), near * abs(value.real))
            if abs(gap) < tolerance < chance * omega:
                names = " and ".join(f"{abs(values[k].imag) / (2.0 * np.pi):.4g} Hz" for k in sorted({int(a), int(b)}))
                sentences.append(
                    f"The mode at {abs(value.imag) / (2.0 * np.pi):.4g} Hz is most likely no mode: its multiplier is a "
                    f"product of those at {names}, which a nonlinearity makes."
                )
                break
    return tuple(sentences)


def _sizes(found: SearchResult, free: NDArray[np.int64]) -> NDArray[np.float64]:
    """The largest coefficient of each mode over the noise (modes,)."""
    both = shapes(found.blocks, found.solution)
    noise = np.full(both.coefficients.shape[1:3], np.inf)
    for block in found.blocks:
        noise[block.rows, block.hit] = block.noise
    return np.abs(both.coefficients[free] / noise[:, :, None]).max(axis=(1, 2, 3))


def _deviations(found: SearchResult, free: NDArray[np.int64]) -> NDArray[np.float64]:
    """The larger deviation of the parts of each exponent by noise alone (modes,)."""
    entries = found.solution.entries
    std = np.sqrt(np.maximum(np.diag(replace(found.solution, further=None).covariance()), 0.0))
    turns = np.zeros(len(free))
    pairs = ~entries.real[free]
    turns[pairs] = std[len(free) : len(free) + int(pairs.sum())]
    return np.maximum(std[: len(free)], turns)
