"""Residues of lifted responses on the fewest harmonics that explain them: for modes that die within a period or two."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from floquid._arrays import Complexes, Floats
from floquid.lifting import Lifted
from floquid.lti import ModalModel
from floquid.periodic.expansion import physical_exponents


def held_shapes(modal: ModalModel, lifted: Lifted, *, false_alarm: float) -> tuple[ModalModel, int]:
    r"""The modal model with residues held to harmonics, and the number of harmonics on each side.

    .. math:: R_{k,r} \approx \sum_{|m| \le M} B_{r,m}\, e^{(\lambda_r + i m \omega) t_k}

    by least squares, which weighs each phase by what the response is there. An expansion of R e^{-λt} alone weighs the
    end of the period like its beginning, where noise is e^{λT} times louder. M is the least that raises the cost by no
    more than noise explains.

    Parameters
    ----------
    modal
        The modal model of `lifted.responses`.
    lifted
        The lifted responses.
    false_alarm
        The probability that noise raises the cost by more than is let pass.
    """
    from scipy.special import chdtri

    exponents, most = physical_exponents(modal, lifted), (lifted.n_phases - 1) // 2
    for width in range(most):
        held = replace(modal, residues=_held(modal, lifted, exponents, width))
        moved = physical_exponents(held, lifted)
        if (moved != exponents).any():
            held = replace(modal, residues=_held(modal, lifted, moved, width))
        fewer = modal.order * lifted.n_channels * (lifted.n_phases - 2 * width - 1)
        if _rise(modal, held, lifted) < float(chdtri(fewer, false_alarm)):
            return held, width
    return modal, most


def _held(modal: ModalModel, lifted: Lifted, exponents: Complexes, width: int) -> Complexes:
    """Residues (modes, outputs, hits) with harmonics on each side of the branch of each mode."""
    omega, residues = 2.0 * np.pi / lifted.period, np.array(modal.residues)
    for mode, value in enumerate(exponents):
        low = high = 0
        if modal.multipliers[mode].imag == 0.0:
            # The shape of a real multiplier is its own conjugate, and so are its harmonics.
            mirror = -round(2.0 * value.imag / omega)
            low, high = min(0, mirror), max(0, mirror)
        rates = value + 1j * omega * np.arange(low - width, high + width + 1)
        columns, _ = np.linalg.qr(np.exp(np.multiply.outer(lifted.phase_times, rates)))
        shapes = lifted.by_channel(residues[mode])
        held = np.einsum("pm,qm,cqh->cph", columns, columns.conj(), shapes, optimize=True)
        held = held.reshape(residues[mode].shape)
        residues[mode] = held.real if modal.multipliers[mode].imag == 0.0 else held
    return residues


def _rise(modal: ModalModel, held: ModalModel, lifted: Lifted) -> float:
    """The squares of the difference of two models over the noise, over all samples."""
    total, change = 0.0, held.residues - modal.residues
    for hit, length in enumerate(lifted.responses.lengths.tolist()):
        powers = np.exp(np.multiply.outer(modal.poles * lifted.period, np.arange(length)))
        moved: Floats = (change[:, :, hit].T @ powers).real / lifted.responses.noise[:, hit, None]
        total += float(np.sum(moved**2))
    return total
