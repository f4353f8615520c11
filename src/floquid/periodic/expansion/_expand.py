"""From the residues of the lifted responses to periodic shapes (Allen 2009, eqs. 4-12)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from floquid._arrays import Complexes, Floats, Integers, Mask
from floquid._checks import input_error
from floquid.core import Estimates, PeriodicModel
from floquid.fit import HALF_DIGITS, covariance_root
from floquid.lifting import Lifted
from floquid.lti import ModalModel, OuterProducts
from floquid.periodic.expansion._kept_harmonics import select_bands
from floquid.search import GAP


def free_estimates(
    modal: ModalModel, lifted: Lifted, exponents: Complexes, partners: Integers, terms: list[tuple[int, int]]
) -> Estimates:
    r"""Estimates of the coefficients B = Σ_k κ_k R_k, κ_k = e^{-(λ + imω) t_k}/(P g), of free residues R.

    The residues at different phases err independently of one another, with covariance σ²S and pseudo-covariance σ²S',
    S' that of a mode with the conjugate of the other; the poles move them through `modal.residue_slope`, and the
    kernel κ too. `exponents` are on the branch that is meant (modes,) [1/s], `partners` the conjugate of each mode,
    itself where the multiplier is real, `terms` the modes and harmonics wanted, of the upper half and of real ones.
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
        spread, blocks = (
            np.einsum("ch,hrs->crs", lifted.noise**2, own.spread),
            np.repeat(np.arange(lifted.n_channels)[:, None], n_hits, axis=1),
        )
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


def assemble(
    modal: ModalModel, lifted: Lifted, *, false_alarm: float = 1e-6, harmonics: int | None = None
) -> PeriodicModel:
    r"""The periodic model behind a modal model of lifted responses.

    The delay between phase zero and each phase's first sample is taken off (eq. 9), the residues are expanded over the
    phases,

    .. math:: B_{r,m} = \frac1P \sum_k R_{k,r}\, e^{-(\lambda_r + i m \omega) t_k}

    (for whitened responses, over the filter's gain at λ_r + imω), each exponent is moved to the branch whose zeroth
    harmonic carries most of the shape's energy (channels weighted by the inverse of their noise), and of each mode a
    contiguous band of harmonics is kept (`select_bands`).
    Standard deviations are those of the maximum-likelihood fit: noise on the residues, and what the uncertainty of the
    poles does to them.

    Modes are by ascending |λ|, a conjugate after its partner. Raises InputError where the models do not belong
    together, or more harmonics are asked for than there are phases. So it does without `harmonics`, where the modal
    model has no deviations to choose them by.

    Parameters
    ----------
    modal
        The modal model of `lifted.responses`.
    lifted
        The lifted responses.
    false_alarm
        The probability that noise passes for a harmonic of any mode.
    harmonics
        Keep m = -harmonics … harmonics instead, whatever their significance.
    """
    _check(modal, lifted, harmonics)
    modal = _sorted(modal)
    expanded = _expand(modal, lifted)
    if harmonics is None:
        kept = select_bands(
            expanded.coefficients,
            expanded.std,
            expanded.harmonics,
            expanded.seeds,
            false_alarm=false_alarm,
            n_modes=sum(_partner(modal, r) >= r for r in range(modal.order)),
        )
    else:
        low, high = expanded.seeds[:, :1] - harmonics, expanded.seeds[:, 1:] + harmonics
        kept = (expanded.harmonics >= low) & (expanded.harmonics <= high)
        kept &= (expanded.coefficients != 0).any(axis=(1, 2)) | (expanded.harmonics == 0)
    order = _by_frequency(modal, expanded)
    estimates = _estimates(modal, lifted, expanded, kept, order) if _has_deviations(modal) and order else None
    kept = kept[order]
    used = kept.any(axis=0)
    mask = kept[:, None, None, used]
    return PeriodicModel(
        exponents=expanded.exponents[order],
        coefficients=expanded.coefficients[order][..., used] * mask,
        harmonics=expanded.harmonics[used],
        period=lifted.period,
        channels=lifted.channels,
        covariance=_reordered(modal, order).covariance,
        coefficient_std=expanded.std[order][..., used] * mask if _has_deviations(modal) else None,
        estimates=estimates,
        unselected=estimates,
        provenance=lifted.provenance,
    )


def physical_exponents(modal: ModalModel, lifted: Lifted) -> Complexes:
    r"""The exponents of a modal model, each on the branch whose zeroth harmonic carries most of the shape's energy.

    .. math:: \lambda_r = \frac{\ln \mu_r}{T} + i n_r \omega

    (Allen 2009, eqs. 4-6.) Channels are weighted by the inverse of their noise, conjugates are moved together, ties go
    to the larger \|Im λ\|. `assemble` reports the same ones.

    They are in the order of `modal` (modes,) [1/s]. `modal` is the modal model of the responses `lifted`. Raises
    InputError where the models do not belong together.
    """
    _check(modal, lifted, 0, "physical_exponents")
    exponents = np.array(modal.poles)
    for r in np.flatnonzero(modal.multipliers.imag >= 0):
        turn = _physical_turn(modal, lifted, int(r))
        exponents[r] += 2j * np.pi * turn / lifted.period
        partner = _partner(modal, int(r))
        if partner != r:
            exponents[partner] = exponents[r].conj()
    return exponents


def _estimates(modal: ModalModel, lifted: Lifted, expanded: Expansion, kept: Mask, order: list[int]) -> Estimates:
    """The coefficients of the bands and of several harmonics beside them, with their joint covariance."""
    partners = np.array([_partner(modal, r) for r in range(modal.order)])
    turns = np.abs(expanded.exponents.imag[:, None] * lifted.period / (2.0 * np.pi) + expanded.harmonics)
    terms = []
    for r in order:
        if partners[r] < r:
            continue
        ends = expanded.harmonics[kept[r]][[0, -1]] + (-GAP - 1, GAP + 1)
        near = (expanded.harmonics >= ends[0]) & (expanded.harmonics <= ends[1])
        inside = near & (turns[r] < 0.5 * lifted.n_phases - 1e-6)
        # On the Nyquist frequency only the sum of two harmonics is seen: it stands for a mode that has no other.
        near = inside if inside.any() else near & (share_of_nyquist(turns[r], lifted.n_phases) > 0)
        if partners[r] == r:
            near &= expanded.harmonics + expanded.exponents[r].imag * lifted.period / (2.0 * np.pi) > -HALF_DIGITS
        terms += [(r, int(m)) for m in expanded.harmonics[near]]
    return free_estimates(modal, lifted, expanded.exponents, partners, terms)


def _has_deviations(modal: ModalModel) -> bool:
    return not (modal.covariance is None or modal.residue_spread is None or modal.residue_slope is None)


def _check(modal: ModalModel, lifted: Lifted, harmonics: int | None, of: str = "assemble") -> None:
    """Refuse models that do not belong together and harmonics that cannot be had."""
    if modal.residues.shape[1:] != (lifted.n_channels * lifted.n_phases, lifted.n_hits):
        got = f"its residues have shape {modal.residues.shape} and the responses {lifted.responses.values.shape}"
        raise input_error("modal", of, "be a model of `lifted.responses`", got)
    if harmonics is not None and not 0 <= 2 * harmonics < lifted.n_phases:
        must, got = f"be at least 0 and less than half the {lifted.n_phases} samples a period", f"is {harmonics}"
        raise input_error("harmonics", "assemble", must, got, "Ask for fewer harmonics, or sample faster.")
    if harmonics is None and not _has_deviations(modal):
        got = "is None: which harmonics rise above the noise cannot be told"
        remedy = (
            "Pass the number of harmonics to keep on each side, or let maximum likelihood finish the poles. Pass "
            "`identifier=MaximumLikelihood(initial=...)`, or era-ml, lscf-ml, poly-ml by name."
        )
        raise input_error("harmonics", "assemble", "be given when the modal model has no deviations", got, remedy)


@dataclass(frozen=True, slots=True)
class Expansion:
    """All coefficients of every mode on the branch reported, and the band that a real response needs at least.

    Of each mode, the harmonics up to the Nyquist frequency are filled, |Im λ/ω + m| ≤ P/2; the others are zero.
    """

    exponents: Complexes
    coefficients: Complexes
    std: Complexes
    harmonics: Integers
    seeds: Integers
    partners: Integers
    """The conjugate of each mode, itself where the multiplier is real (modes,)."""

    @property
    def real(self) -> Mask:
        """Mask of the real multipliers (modes,)."""
        return self.partners == np.arange(len(self.partners))

    @property
    def upper(self) -> Integers:
        """One mode of each pair, and the real ones."""
        return np.flatnonzero(self.partners >= np.arange(len(self.partners)))


def expansion(modal: ModalModel, lifted: Lifted) -> Expansion:
    """All harmonics of each mode of lifted responses, with their deviations, each conjugate after its partner."""
    return _expand(_sorted(modal), lifted)


def _sorted(modal: ModalModel) -> ModalModel:
    """Each conjugate right after the mode of positive imaginary part."""
    upper = [r for r in range(modal.order) if modal.multipliers[r].imag >= 0]
    order = [i for r in upper for i in ([r] if modal.multipliers[r].imag == 0 else [r, _partner(modal, r)])]
    return _reordered(modal, order)


def _reordered(modal: ModalModel, order: list[int]) -> ModalModel:
    stacked = np.concatenate([order, np.array(order, int) + modal.order]).astype(int)
    pick = np.ix_(range(modal.residues.shape[2]), order, order)
    return replace(
        modal,
        multipliers=modal.multipliers[order],
        residues=modal.residues[order],
        covariance=None if modal.covariance is None else modal.covariance[np.ix_(stacked, stacked)],
        residue_spread=None if modal.residue_spread is None else modal.residue_spread[pick],
        residue_slope=None if modal.residue_slope is None else modal.residue_slope[pick],
        products=None if modal.products is None else modal.products.picked(order),
    )


def _partner(modal: ModalModel, index: int) -> int:
    """The position of the conjugate of one multiplier (its own when it is real)."""
    distance = np.abs(modal.multipliers - modal.multipliers[index].conj())
    beside = index + int(np.sign(modal.multipliers[index].imag))
    if 0 <= beside < modal.order and distance[beside] <= distance.min():
        return beside
    return int(np.argmin(distance))


def _expand(modal: ModalModel, lifted: Lifted) -> Expansion:
    harmonics = np.arange(-lifted.n_phases, lifted.n_phases + 1)
    shape = (modal.order, lifted.n_channels, lifted.n_hits, len(harmonics))
    exponents = np.array(modal.poles)
    coefficients, std = np.zeros((2, *shape), complex)
    seeds = np.zeros((modal.order, 2), np.int64)
    for r in range(modal.order):
        partner = _partner(modal, r)
        if partner < r:
            exponents[r] = exponents[partner].conj()
            coefficients[r] = coefficients[partner, ..., ::-1].conj()
            std[r] = std[partner, ..., ::-1]
            continue
        turn = _physical_turn(modal, lifted, r)
        exponents[r] = modal.poles[r] + 1j * turn * 2.0 * np.pi / lifted.period
        share = share_of_nyquist(exponents[r].imag * lifted.period / (2.0 * np.pi) + harmonics, lifted.n_phases)
        seen = share > 0
        values, deviation = _coefficients(modal, lifted, r, exponents[r], harmonics[seen])
        coefficients[r][..., seen], std[r][..., seen] = values * share[seen], deviation * share[seen]
        if partner == r:
            # A real multiplier's shape is its own conjugate: harmonic m belongs with this mirror image of it.
            mirror = -2 * turn - (1 if modal.multipliers[r].real < 0 else 0)
            seeds[r] = min(0, mirror), max(0, mirror)
    partners = np.array([_partner(modal, r) for r in range(modal.order)], np.int64)
    return Expansion(exponents, coefficients, std, harmonics, seeds, partners)


def _physical_turn(modal: ModalModel, lifted: Lifted, mode: int) -> int:
    """The whole number of fundamentals from the principal pole to the branch whose zeroth harmonic is largest."""
    half = lifted.n_phases // 2
    turns = np.arange(-half, half + 1)
    rates = modal.poles[mode] + 1j * turns * 2 * np.pi / lifted.period
    kernel = np.exp(-np.multiply.outer(rates, lifted.phase_times))
    residues = lifted.by_channel(modal.residues[mode]) / lifted.noise[:, None, :]
    shapes = np.einsum("mk,ckh->chm", kernel, residues) / lifted.gain(rates)[:, None]
    energy = np.sum(np.abs(shapes) ** 2, axis=(0, 1))
    imag = modal.poles[mode].imag * lifted.period / (2 * np.pi) + turns
    return int(turns[strongest_branch(energy, imag, lifted.n_phases)])


def strongest_branch(energy: Floats, turns: Floats, n_phases: int) -> int:
    """The place of the largest `energy` at `turns` a period below the Nyquist frequency; of ties the fastest turn."""
    energy = np.where(share_of_nyquist(turns, n_phases) > 0, energy, 0.0)
    ties = np.flatnonzero(energy > (1.0 - 1e-6) * energy.max())
    return int(ties[np.argmax(np.abs(turns[ties]) + 1e-9 * np.sign(turns[ties]))])


def _coefficients(
    modal: ModalModel, lifted: Lifted, mode: int, exponent: complex, harmonics: Integers
) -> tuple[Complexes, Complexes]:
    """The coefficients of one mode and their standard deviations, both (channels, hits, harmonics)."""
    times, phases = lifted.phase_times, lifted.n_phases
    rates = exponent + 1j * harmonics * 2 * np.pi / lifted.period
    kernel = np.exp(-np.multiply.outer(rates, times)) / phases
    gain = lifted.gain(rates)
    residues = lifted.by_channel(modal.residues)
    coefficients = np.einsum("mk,ckh->chm", kernel, residues[mode]) / gain[:, None]
    if modal.residue_spread is None or modal.residue_slope is None or modal.covariance is None:
        return coefficients, np.zeros_like(coefficients)  # `_has_deviations` is false: they are not handed on
    partner = _partner(modal, mode)
    strength = np.sum(np.abs(kernel) ** 2, axis=1) / np.abs(gain[:, None]) ** 2
    pseudo = np.sum(kernel**2, axis=1) / gain[:, None] ** 2
    whole = _of_residues(modal, lifted, mode, mode).real * strength
    skew = np.real(_of_residues(modal, lifted, mode, partner) * pseudo)
    # What an error of the poles does: through the residues of every mode, and through this mode's own delay and gain.
    moved = np.einsum("mk,rckh->rchm", kernel, residues) * -modal.residue_slope[:, mode, :].T[:, None, :, None]
    moved[mode] -= np.einsum("mk,k,ckh->chm", kernel, times / lifted.period, residues[mode])
    moved /= gain[:, None]
    moved[mode] -= coefficients * (lifted.gain(rates, slope=True) / gain)[:, None] / lifted.period
    moved = moved * lifted.period
    root = covariance_root(modal.covariance)
    along_real = np.tensordot(root, np.concatenate([moved.real, -moved.imag]), axes=(0, 0))
    along_imag = np.tensordot(root, np.concatenate([moved.imag, moved.real]), axes=(0, 0))
    real = np.sqrt(np.maximum(0.5 * (whole + skew), 0.0) + np.sum(along_real**2, axis=0))
    imag = np.sqrt(np.maximum(0.5 * (whole - skew), 0.0) + np.sum(along_imag**2, axis=0))
    return coefficients, real + 1j * imag


def _of_residues(modal: ModalModel, lifted: Lifted, mode: int, other: int) -> Complexes:
    """Covariance of the residues of two modes for known poles (channels, hits, 1)."""
    if modal.products is None:
        assert modal.residue_spread is not None
        return (lifted.noise**2 * modal.residue_spread[:, mode, other])[:, :, None]
    shares = modal.products.shares
    of_shape = lifted.noise**2 @ modal.products.spread[:, mode, other]
    return (of_shape[:, None] * shares[mode] * shares[other].conj())[:, :, None]


def _by_frequency(modal: ModalModel, expansion: Expansion) -> list[int]:
    """Modes by ascending |λ|, the positive imaginary part before its conjugate."""
    size = np.abs(expansion.exponents)
    keys = []
    for r in range(modal.order):
        partner = _partner(modal, r)
        keys.append((size[r], min(r, partner), -expansion.exponents[r].imag))
    return sorted(range(modal.order), key=lambda r: keys[r])
