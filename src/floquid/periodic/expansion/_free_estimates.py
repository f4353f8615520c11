"""Harmonics of a shape above the noise, and coefficients free at each phase with their covariance."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from floquid._arrays import Complexes, Floats, Integers, Mask
from floquid.core import Estimates, PeriodicModel
from floquid.fit import HALF_DIGITS, chi2_limit
from floquid.lifting import Lifted
from floquid.lti import ModalModel, OuterProducts
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


def free_estimates(
    modal: ModalModel, lifted: Lifted, exponents: Complexes, partners: Integers, terms: list[tuple[int, int]]
) -> Estimates:
    r"""Estimates of the coefficients B = Σ_k κ_k R_k, κ_k = e^{-(λ + imω) t_k}/(P g), of free residues R.

    The residues at different phases err independently of one another, with covariance σ²S and pseudo-covariance σ²S',
    S' that of a mode with the conjugate of the other; the poles move them through `modal.residue_slope`, and the
    kernel κ too. `exponents` are on the branch that is meant (modes,) [1/s], `partners` the conjugate of each mode,
    itself where the multiplier is real, `terms` the modes and harmonics wanted, of the upper half and of real ones.

    Of outer products the errors are those of a shape, the same in all hits, and of the participations.
    """
    assert modal.covariance is not None
    assert modal.residue_spread is not None
    assert modal.residue_slope is not None
    distinct = list(dict.fromkeys(mode for mode, _ in terms))
    modes, harmonics = (np.array(column, np.int64) for column in zip(*terms, strict=True))
    times, omega = lifted.phase_times, 2.0 * np.pi / lifted.period
    rates = exponents[modes] + 1j * harmonics * omega
    share = share_of_nyquist(rates.imag / omega, lifted.n_phases) / lifted.n_phases
    kernel = np.asarray(share[:, None] * np.exp(-np.multiply.outer(rates, times)), np.complex128)
    gain = lifted.gain(rates)
    residues = lifted.by_channel(modal.residues)
    values = np.einsum("tk,tckh->tch", kernel, residues[modes]) / gain.T[:, :, None]
    # By each pole: through the residues of every mode, and through a mode's own kernel and gain.
    moved = np.einsum("tk,rckh->rtch", kernel, residues)
    moved = moved * -np.moveaxis(modal.residue_slope[:, modes, :], (0, 1, 2), (2, 1, 0))[:, :, None, :]
    turned = np.einsum("tk,k,tckh->tch", kernel, times / lifted.period, residues[modes])
    moved[modes, np.arange(len(terms))] -= turned
    moved = moved / gain.T[:, :, None]
    relative = (lifted.gain(rates, slope=True) / gain).T / lifted.period
    moved[modes, np.arange(len(terms))] -= values * relative[:, :, None]
    moved = moved * lifted.period
    real = np.array([partners[mode] == mode for mode in distinct])

    def by_parts(by_modes: Complexes) -> Complexes:
        """Slopes by the real parts of distinct modes, then by their imaginary parts, from those by all modes."""
        straight, mirrored = by_modes[distinct], by_modes[[partners[mode] for mode in distinct]]
        both = np.where(real[:, None, None, None], straight, straight + mirrored)
        across = np.where(real[:, None, None, None], 0.0, 1j * (straight - mirrored))
        return np.concatenate([both, across])

    slopes, n_hits, count = by_parts(moved), lifted.n_hits, len(distinct)
    parts, known = np.concatenate([distinct, np.add(distinct, modal.order)]), modal.covariance
    spread, blocks = modal.residue_spread, np.tile(np.arange(n_hits), (lifted.n_channels, 1))
    scales = lifted.noise / gain.T[:, :, None]
    if modal.products is not None:
        own, known = modal.products, modal.products.covariance
        shapes = np.einsum("tk,rck->rtc", kernel, lifted.by_channel(_shapes(modal, own)[..., None])[..., 0]) / gain.T
        slopes = np.concatenate([slopes, *(by_parts(moved) for moved in _by_shares(own, shapes, modes))])
        parts = np.add.outer(2 * modal.order * np.arange(1 + n_hits), parts).ravel()
        spread, blocks = np.einsum("ch,hrs->crs", lifted.noise**2, own.spread), np.indices(blocks.shape)[0]
        scales = own.shares[modes][:, None] / gain.T[:, :, None]
    covariance = known[np.ix_(parts, parts)]
    covariance[count : 2 * count][real], covariance[:, count : 2 * count][:, real] = 0.0, 0.0
    # The fundamental stands behind the exponents; a participation that is 1 by definition is no parameter.
    kept = np.concatenate([np.arange(2 * count), 2 * count + np.flatnonzero(np.diag(covariance)[2 * count :] > 0.0)])
    covariance = np.insert(np.insert(covariance[np.ix_(kept, kept)], 2 * count, 0.0, axis=0), 2 * count, 0.0, axis=1)
    slopes = np.moveaxis(np.insert(slopes[kept], 2 * count, 0.0, axis=0), 0, -1)
    place = {mode: number for number, mode in enumerate(distinct)}
    return Estimates(
        exponents=exponents[distinct],
        real=real,
        fundamental=omega,
        modes=np.array([place[int(mode)] for mode in modes], np.int64),
        harmonics=harmonics,
        coefficients=values,
        covariance=covariance,
        slopes=slopes,
        spread=np.array([_spread(each, kernel, modes, partners) for each in spread]),
        blocks=blocks,
        scales=scales,
        shared=modal.products is not None,
    )


def _shapes(modal: ModalModel, own: OuterProducts) -> Complexes:
    """The shapes of outer products (modes, outputs)."""
    modes, largest = np.arange(modal.order), np.abs(own.shares).argmax(axis=1)
    return modal.residues[modes, :, largest] / own.shares[modes, largest][:, None]


def _by_shares(own: OuterProducts, shapes: Complexes, modes: Integers) -> Iterator[Complexes]:
    """Slopes of coefficients by the participations in each hit (modes, terms, channels, hits).

    `shapes` are the lines of the shape of each mode that the kernel of each term makes (modes, terms, channels).
    """
    terms = np.arange(len(modes))
    for hit, slope in enumerate(own.slope):
        moved = -np.einsum("tr,rtc,th->rtch", slope[modes], shapes, own.shares[modes])
        moved[modes, terms, :, hit] += shapes[modes, terms]
        yield moved


def share_of_nyquist(turns: Floats, n_phases: int) -> Floats:
    """1 below the Nyquist frequency of P/2 turns a period, 0 above; on it two harmonics are one, and each has half."""
    beyond = np.abs(turns) - 0.5 * n_phases
    return np.where(np.abs(beyond) < HALF_DIGITS, 0.5, np.where(beyond < 0, 1.0, 0.0))


def _spread(spread: Complexes, kernel: Complexes, modes: Integers, partners: Integers) -> Floats:
    """The covariance of real parts, then imaginary parts, at unit noise (2 terms, 2 terms)."""
    straight = spread[np.ix_(modes, modes)] * (kernel @ kernel.conj().T)
    crossed = spread[np.ix_(modes, partners[modes])] * (kernel @ kernel.T)
    upper = 0.5 * (straight + crossed).real
    lower = 0.5 * (straight - crossed).real
    side = 0.5 * (crossed - straight).imag
    return np.block([[upper, side], [side.T, lower]])
