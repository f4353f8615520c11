"""Harmonics of a shape that rise above the noise."""

from __future__ import annotations

import numpy as np

from floquid._arrays import Complexes, Floats, Integers, Mask
from floquid.core import PeriodicModel
from floquid.fit import chi2_limit
from floquid.search import GAP


def select_bands(
    coefficients: Complexes,
    std: Complexes,
    harmonics: Integers,
    seeds: Integers,
    *,
    false_alarm: float,
    n_modes: int | None = None,
) -> Mask:
    r"""Keep, of each mode, the contiguous band of harmonics around its seed that rises above the noise.

    A harmonic is significant when, over all channels c and hits h,

    .. math:: \sum_{c,h} \left(\frac{\Re B}{\sigma_{\Re}}\right)^2 + \left(\frac{\Im B}{\sigma_{\Im}}\right)^2

    exceeds what chance gives at the level α', a chi-square of two degrees of freedom a term. The band is common to the
    channels, since a shape that is cut at different harmonics in different channels is no solution of one system. The
    band grows outward from the seed to each significant harmonic that is at most `GAP` insignificant ones away. Those
    between are kept too. A false alarm far out would be multiplied by the square of its frequency in A(t): hence
    contiguous, and a small probability.

    `false_alarm` is the probability α that any band of any mode goes on beyond its last harmonic that is there. Noise
    has to be met at one of the `GAP` + 1 harmonics next to an end. So n modes are 2n(`GAP` + 1) chances, each at the
    level of Šidák (1967):

    .. math:: \alpha' = 1 - (1 - \alpha)^{1/(2 n (\mathrm{GAP} + 1))}

    Returns what is kept (modes, harmonics).

    Parameters
    ----------
    coefficients, std
        Coefficients and their standard deviations (modes, channels, hits, harmonics).
    harmonics
        The integers m, ascending (harmonics,).
    seeds
        The lowest and the highest harmonic that a mode keeps in any case (modes, 2).
    false_alarm
        The probability α that noise passes for a harmonic anywhere.
    n_modes
        The number n of different modes, where conjugates are listed too; None where they are not.
    """
    count = len(coefficients) if n_modes is None else n_modes
    level = level_of_each(false_alarm, 2 * (GAP + 1) * count)
    return bands_at(coefficients, std, harmonics, seeds, level=level)


def level_of_each(false_alarm: float, tests: int) -> float:
    """The level of each of several tests that together have a probability of false alarm (Šidák 1967)."""
    return float(-np.expm1(np.log1p(-false_alarm) / max(tests, 1)))


def bands_at(coefficients: Complexes, std: Complexes, harmonics: Integers, seeds: Integers, *, level: float) -> Mask:
    """`select_bands` at a level for each harmonic."""
    terms = coefficients.shape[1] * coefficients.shape[2]
    limit = chi2_limit(2 * terms, level)
    score = _squares(coefficients.real, std.real, std.real > 0)
    # The imaginary part of a real mode's zeroth coefficient is exactly zero, and so is its deviation.
    score += _squares(coefficients.imag, std.imag, std.imag > 1e-9 * std.real)
    significant = score.sum(axis=(1, 2)) > limit
    kept = np.zeros(significant.shape, bool)
    for mode, row in enumerate(significant):
        low, high = np.searchsorted(harmonics, seeds[mode])
        high = min(int(high), len(harmonics) - 1)
        low = len(row) - 1 - _grow(row[::-1], len(row) - 1 - int(low))
        kept[mode, low : _grow(row, high) + 1] = True
    return kept


def _squares(values: Floats, std: Floats, counted: Mask) -> Floats:
    """The squares of values over their deviations; zero where they are not `counted`."""
    return np.divide(values, std, out=np.zeros(values.shape), where=counted) ** 2


def _grow(significant: Mask, end: int) -> int:
    """The last index reached from `end` on by steps over at most `GAP` insignificant entries."""
    while True:
        ahead = np.flatnonzero(significant[end + 1 : end + 2 + GAP])
        if not len(ahead):
            return end
        end += 1 + int(ahead[-1])


def participation(model: PeriodicModel, mode: int, weights: Floats) -> tuple[Integers, Floats]:
    r"""The harmonics that a mode keeps, and the share of each in the energy of its shape.

    .. math:: p_m = \sum_{c,h} w_{c,h}^2 |B_{m,c,h}|^2 \Big/ \sum_{m,c,h} w_{c,h}^2 |B_{m,c,h}|^2

    `mode` is the index of the mode in the `model`, and `weights` are one over the noise (channels, hits). Returns the
    integers m that are kept and the share p of each, both (harmonics,).
    """
    energy = np.sum(np.abs(model.coefficients[mode] * weights[:, :, None]) ** 2, axis=(0, 1))
    kept = energy > 0
    return model.harmonics[kept], energy[kept] / energy.sum()
