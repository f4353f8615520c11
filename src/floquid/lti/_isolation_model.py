"""The modal model of isolated modes, with deviations: those of the estimating equations that going round solves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from floquid._numerics import positive_part
from floquid.lti._coupled import KNOWN, LEAST_INFORMATION, Bands, Coupled, bands_of, complex_columns
from floquid.lti._exponentials import complex_residues
from floquid.lti._isolation import Isolated, growth, residues
from floquid.lti._poles import PAIR
from floquid.lti._spectrum import Block, composites
from floquid.lti._types import ModalModel, Outcome, TimeResponses


def isolated_model(
    now: Isolated, data: TimeResponses, blocks: Sequence[Block], outcome: Outcome, widths: float
) -> ModalModel:
    r"""The model of isolated modes.

    Its deviations are those of the equations that going round solves (`Coupled`): the covariance of the poles is
    J⁻¹ cov(g) J⁻ᵀ. The noise on the residues inflates J, and its expectation is taken off.
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
    bands = bands_of(now.modes, blocks, widths)
    whole = [[slice(0, len(block.values))] * len(now.modes) for block in blocks]
    # Of modes hardly told apart the bands' equations may not be definite; those of all lines are, and differ little.
    found = _with_deviations(model, now, data, blocks, bands) or _with_deviations(model, now, data, blocks, whole)
    return replace(found or model, composites=composites(data, model))


def _with_deviations(
    model: ModalModel, now: Isolated, data: TimeResponses, blocks: Sequence[Block], near: Bands
) -> ModalModel | None:
    """The model with its covariance and what noise does to its residues; None where two poles are one to rounding."""
    poles, n = now.poles(), model.order
    if not n:
        return None
    whole, noise, scatter = np.zeros((3, n, n))
    spread, slope = np.zeros((2, data.n_inputs, n, n), complex)
    for number, block in enumerate(blocks):
        coupled = Coupled.of(now.modes, block, near[number], KNOWN)
        if coupled is None:
            return None
        parts = coupled.slopes(now.modes, number)
        whole, noise = whole + parts[0], noise + parts[1]
        scatter += coupled.scatter_of_equations(coupled.strength(now.modes, number))
        scale = np.array([growth(s, block) if s.real > 0 else 1.0 for s in poles.full()])
        solve = scale[:, None] * complex_residues(poles, coupled.solve)
        spread[block.inputs] = solve @ solve.conj().T
        slope[block.inputs] = solve @ (complex_columns(poles, coupled.moved) / scale)
    if not (np.diag(whole) > LEAST_INFORMATION).all():
        return None
    information = positive_part(whole, whole - noise)
    size = np.sqrt(np.maximum(np.diag(information), np.finfo(float).tiny))
    both = np.outer(size, size)
    inverse = np.linalg.pinv(information / both, rcond=1e-14, hermitian=True)
    unit = inverse @ (scatter / both) @ inverse / both
    stacked = np.concatenate([poles.parameter_map().real, poles.parameter_map().imag])
    covariance = stacked @ (0.5 * (unit + unit.T)) @ stacked.T / data.dt**2
    return replace(model, covariance=covariance, residue_spread=spread, residue_slope=slope)
