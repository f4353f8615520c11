"""From the residues of the lifted responses to periodic shapes (Allen 2009, eqs. 4-12)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from floquid._arrays import Complexes, Floats, Integers, Mask
from floquid._checks import input_error
from floquid.core import Estimates, PeriodicModel
from floquid.fit import HALF_DIGITS, covariance_root
from floquid.lifting import Lifted
from floquid.lti import ModalModel
from floquid.periodic.expansion._free_estimates import free_estimates, select_bands, share_of_nyquist
from floquid.search import GAP


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
