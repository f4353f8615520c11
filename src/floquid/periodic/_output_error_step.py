"""Linearisation of the record at exponents that something else has found: one output-error step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Floats
from floquid._checks import frozen_array, input_error
from floquid.core import Estimates, PeriodicModel, PhaseClock, Record
from floquid.errors import IdentificationError
from floquid.lifting import Lifted
from floquid.periodic._forced_part import ForcedResponse, forced_base
from floquid.periodic._refit import noise_of_records
from floquid.periodic.least_squares import (
    Block,
    LiftedBlock,
    ModeParameters,
    estimates_of,
    linearise,
    parts_of,
    record_blocks,
    through,
)

OF = "estimate_at"


def estimate_at(
    model: PeriodicModel,
    exponents: ArrayLike,
    *,
    lifted: Lifted | None = None,
    records: Sequence[Record] = (),
    clocks: Sequence[PhaseClock] = (),
    noise: ArrayLike | None = None,
    whitening: Floats | None = None,
    forced: ForcedResponse | None = None,
) -> Estimates:
    r"""The estimates of a model, the record linearised anew at given exponents.

    .. math:: \hat p = p_0 + I(p_0)^{-1} g(p_0), \qquad \hat B = B(p_0) + S(p_0)\, (\hat p - p_0)

    with p the exponents (and the period, where it was estimated), B the coefficients that are best at p₀, S their
    slopes, and g and I the gradient and the information of the projected cost: one Gauss-Newton step (Golub and Pereyra
    1973, with Kaufman's matrix). What is fitted to these estimates with their covariance as weight is one output-error
    step, by which a two-step fit loses no efficiency (Söderström and Stoica 1989). They have the same modes and terms
    as those of the model.

    Raises InputError where the model has no estimates, or responses and model do not belong together;
    IdentificationError where the record does not determine the exponents there.

    Parameters
    ----------
    model
        The model. Modes, bands and period are those of its `unselected` estimates, or of its `estimates`.
    exponents
        p₀, in the order of the modes of these estimates (modes of the estimates,) [1/s].
    lifted
        The lifted responses that the model was identified from, with their noise.
    records, clocks
        Or the free responses as they were sampled, one record a hit, and what ties each to the phase.
    noise
        With records: the deviation of the noise (channels, hits) [units of the channels]; with `whitening`, after the
        filter.
    whitening
        With records: the filter of each channel along the record that makes its noise white (channels, taps).
    forced
        With records: the forced response that was taken off them, whose deviations are shared.
    """
    known = model.unselected if model.unselected is not None else model.estimates
    if known is None:
        must, got = "have the joint covariance of its coefficients (`estimates`)", "has none"
        raise input_error("model", OF, must, got, "Identify with maximum likelihood and `constrained=True`.")
    start = frozen_array(exponents, "exponents", OF, axes=(len(known.exponents),), dtype=np.complex128)
    entries = replace(ModeParameters.of_terms(known, start), free_period=known.fundamental_std > 0.0)
    if lifted is not None:
        blocks: Sequence[Block] = LiftedBlock.all_of(lifted)
    else:
        blocks = through(_record_blocks(records, clocks, noise, known), whitening)
        entries = entries.joined(_forced(forced, known.fundamental))
    if {(row, block.hit) for block in blocks for row in block.rows.tolist()} != set(np.ndindex(*known.blocks.shape)):
        raise _others(known)
    solution = linearise(blocks, entries)
    try:
        here = estimates_of(blocks, solution)
        step = parts_of(entries) @ np.linalg.solve(solution.information, solution.gradient)
    except np.linalg.LinAlgError:
        raise IdentificationError("The record does not determine the exponents where it was linearised anew.") from None
    return here.moved(step).picked(modes=np.arange(len(start)))


def _record_blocks(
    records: Sequence[Record], clocks: Sequence[PhaseClock], noise: ArrayLike | None, known: Estimates
) -> list[Block]:
    """Blocks of samples with their noise."""
    spread = noise_of_records(noise, known.blocks.shape, OF)
    blocks, _, _ = record_blocks(records, clocks, 1.0)
    if any(block.rows.max() >= len(spread) or block.hit >= spread.shape[1] for block in blocks):
        raise _others(known)
    return [block.with_noise(spread[block.rows, block.hit]) for block in blocks]


def _others(known: Estimates) -> Exception:
    must = f"be {known.blocks.shape[1]} of {known.blocks.shape[0]} channels, as the model"
    return input_error("records", OF, must, "are not", "Pass the responses that the model was identified from.")


def _forced(forced: ForcedResponse | None, fundamental: float) -> ModeParameters:
    """Parts of a forced response that were fitted beside the modes."""
    if forced is None:
        return forced_base(None, fundamental, wanders=False)
    turns = (forced.harmonics / (forced.revolution * fundamental / (2.0 * np.pi))).tolist()
    offset = [0.0] if forced.offset.any() else []
    return forced_base(([*offset, *turns], bool(forced.drift.any())), fundamental, wanders=forced.speed_dependent)
