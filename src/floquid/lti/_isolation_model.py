"""The modal model of isolated modes, with deviations: those of the estimating equations that going round solves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from floquid.lti._exponentials import complex_residues, positive_part
from floquid.lti._isolation import Isolated, growth, residues
from floquid.lti._one_mode import Mode, band_lines, real_rows
from floquid.lti._poles import PAIR, PoleSet
from floquid.lti._spectrum import Block, composites, mode_columns
from floquid.lti._types import ModalModel, Outcome, TimeResponses

WORST = 1e10
"""The condition number of the coupled fits beyond which modes of equal poles leave no deviations to be had."""


def isolated_model(
    now: Isolated, data: TimeResponses, blocks: Sequence[Block], outcome: Outcome, widths: float
) -> ModalModel:
    r"""The model of isolated modes.

    At rest, mode r solves B_rᵀ W_r (d - Σ_q B_q c_q) = 0 for its residues and Σ (∂B_r c_r)ᵀ W_r (d - B c) = 0 for its
    pole, W_r the lines near its peak. The residues of all modes together are c = G⁻¹ H d with G_rq = B_rᵀ W_r B_q and
    H_r = B_rᵀ W_r, so that Q = I - B G⁻¹ H takes the residues out, and to first order

    .. math:: J\, \delta s = g, \quad J_{uv} = \sum c_r^T \dot B_u^T W_r Q \dot B_v c_q, \quad
              \operatorname{cov} g_{uv} = \sum c_r^T \dot B_u^T W_r Q Q^T W_q \dot B_v c_q,

    the covariance being J⁻¹ cov(g) J⁻ᵀ. The noise on the residues inflates J, and its expectation is taken off.
    """
    poles = now.poles()
    n = poles.order
    values = np.zeros((n, data.n_outputs, data.n_inputs), complex)
    for start, mode in zip(poles.starts(), now.modes, strict=True):
        values[start] = residues(mode, blocks, data.n_inputs)
        if mode.kind == PAIR:
            values[start + 1] = values[start].conj()
    left = np.zeros((data.n_outputs, data.n_inputs))
    for block, lines in zip(blocks, now.left, strict=True):
        free = max(block.samples - n, 1)
        left[:, block.inputs] = block.noise * np.sqrt(np.sum(np.abs(lines) ** 2, axis=0) / free)
    model = ModalModel(
        multipliers=poles.multipliers(),
        residues=values,
        dt=data.dt,
        residual_std=left,
        outcome=outcome,
        stats={"cost": now.cost, "rest": now.rest},
    )
    return _with_composites(_with_deviations(model, now, data, blocks, widths), data)


def _with_composites(model: ModalModel, data: TimeResponses) -> ModalModel:
    return replace(model, composites=composites(data, model))


def _with_deviations(
    model: ModalModel, now: Isolated, data: TimeResponses, blocks: Sequence[Block], widths: float
) -> ModalModel:
    """The model with its covariance and what noise does to its residues, unless two poles are one to rounding."""
    poles, n = now.poles(), model.order
    whole, noise, scatter = np.zeros((3, n, n))
    spread, slope = np.zeros((2, data.n_inputs, n, n), complex)
    for number, block in enumerate(blocks):
        coupled = _Coupled.of(now.modes, number, block, widths)
        if coupled is None:
            return model
        whole += coupled.slope_of_equations(coupled.strength)
        noise += coupled.slope_of_equations(coupled.responses * coupled.solve @ coupled.solve.T)
        scatter += coupled.scatter_of_equations()
        scale = np.array([growth(s, block) if s.real > 0 else 1.0 for s in poles.full()])
        solve = scale[:, None] * complex_residues(poles, coupled.solve)
        spread[block.inputs] = solve @ solve.conj().T
        slope[block.inputs] = solve @ (complex_columns(poles, coupled.moved) / scale)
    information = positive_part(0.5 * (whole + whole.T), 0.5 * (whole + whole.T - noise - noise.T))
    size = np.sqrt(np.maximum(np.diag(information), np.finfo(float).tiny))
    both = np.outer(size, size)
    inverse = np.linalg.pinv(information / both, rcond=1e-14, hermitian=True)
    unit = inverse @ (scatter / both) @ inverse / both
    stacked = np.concatenate([poles.parameter_map().real, poles.parameter_map().imag])
    covariance = stacked @ (0.5 * (unit + unit.T)) @ stacked.T / data.dt**2
    return replace(model, covariance=covariance, residue_spread=spread, residue_slope=slope)


def complex_columns(poles: PoleSet, real: NDArray[np.float64]) -> NDArray[np.complex128]:
    """The columns of μ^k and its conjugate (rows, order) from those of its real and imaginary part."""
    out = real + 0j
    for start, kind in zip(poles.starts(), poles.kind, strict=True):
        if kind == PAIR:
            out[:, start] = real[:, start] + 1j * real[:, start + 1]
            out[:, start + 1] = out[:, start].conj()
    return out


@dataclass(frozen=True, slots=True)
class _Coupled:
    """The equations of all modes in one block, rows of real numbers: see `isolated_model`.

    `moved` is k times the columns (rows, n); `solve` is G⁻¹H (n, rows); `taken` holds, for each parameter, the slice
    of its mode's columns, ∂B and V = Qᵀ W ∂B (rows, columns of the mode); `strength` is Σ c cᵀ (n, n).
    """

    moved: NDArray[np.float64]
    solve: NDArray[np.float64]
    taken: tuple[tuple[slice, NDArray[np.float64], NDArray[np.float64]], ...]
    strength: NDArray[np.float64]
    responses: int

    @staticmethod
    def of(modes: Sequence[Mode], number: int, block: Block, widths: float) -> _Coupled | None:
        """The equations of one block; None when two modes have the same columns."""
        if not modes:
            nothing = np.zeros((2 * len(block.values), 0))
            return _Coupled(nothing, nothing.T, (), np.zeros((0, 0)), 0)
        pairs = [mode_columns(m.s, m.kind, block.angles, block.samples, block.weights) for m in modes]
        columns = np.concatenate([real_rows(c) for c, _ in pairs], axis=1)
        moved = np.concatenate([real_rows(m) for _, m in pairs], axis=1)
        near = np.zeros(columns.shape, bool)
        starts = np.concatenate([[0], np.cumsum([mode.size for mode in modes])])
        own = [slice(int(a), int(b)) for a, b in pairwise(starts)]
        half = len(block.values)
        for mode, at in zip(modes, own, strict=True):
            lines = band_lines(mode.s, block, widths)
            near[lines, at], near[half + lines.start : half + lines.stop, at] = True, True
        weighted = np.where(near, columns, 0.0)
        coupling = weighted.T @ columns
        size = np.sqrt(np.diag(coupling))
        if np.linalg.cond(coupling / np.outer(size, size)) > WORST:
            return None
        solve = np.linalg.solve(coupling, weighted.T)
        taken = []
        for mode, at in zip(modes, own, strict=True):
            turns = [moved[:, at]]
            if mode.kind == PAIR:
                turns.append(np.stack([-turns[0][:, 1], turns[0][:, 0]], axis=1))
            for turn in turns:
                seen = np.where(near[:, at], turn, 0.0)
                taken.append((at, turn, seen - solve.T @ (columns.T @ seen)))
        coefficients = np.concatenate([mode.coefficients[number].reshape(mode.size, -1) for mode in modes])
        return _Coupled(moved, solve, tuple(taken), coefficients @ coefficients.T, coefficients.shape[1])

    def slope_of_equations(self, strength: NDArray[np.float64]) -> NDArray[np.float64]:
        """J (n, n) for residues of this Σ c cᵀ."""
        rows = [[np.sum((v.T @ w) * strength[a, b]) for b, w, _ in self.taken] for a, _, v in self.taken]
        return np.array(rows).reshape(len(rows), len(rows))

    def scatter_of_equations(self) -> NDArray[np.float64]:
        """The covariance of g (n, n) for unit noise."""
        rows = [[np.sum((v.T @ w) * self.strength[a, b]) for b, _, w in self.taken] for a, _, v in self.taken]
        return np.array(rows).reshape(len(rows), len(rows))
