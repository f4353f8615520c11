"""Fits of the samples for a special purpose: one shape of brief hits, the period of a steady response, one step."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Floats
from floquid._checks import frozen_array, input_error
from floquid.core import Estimates, PeriodicModel, PhaseClock, Record
from floquid.errors import IdentificationError
from floquid.fit import ROUNDING, SURE
from floquid.lifting import Lifted
from floquid.periodic._fit_records import Fit, Samples, result_of
from floquid.periodic._forced_part import ForcedResponse, forced_base, forced_turns
from floquid.periodic._refit import noise_of_records, scaled
from floquid.periodic._start import Known
from floquid.periodic.least_squares import (
    PLAIN,
    TREND,
    Block,
    LiftedBlock,
    ModeParameters,
    estimates_of,
    linearise,
    parts_of,
    record_blocks,
    shapes,
    through,
)
from floquid.periodic.search import Point, of_shapes, priced


def fit_shapes(
    records: Sequence[Record],
    clocks: Sequence[PhaseClock],
    model: PeriodicModel,
    lifted: Lifted,
    *,
    noise_floor: float = 1e-10,
    report: Callable[[str], None] = lambda _: None,
) -> Fit:
    r"""Modes of brief hits with one shape for all of them, and a state in each.

    .. math:: y_{c,h}(t) = 2 \Re \sum_r a_{r,h} \sum_{m \in M_r} c_{r,m,c}\, e^{(\lambda_r + i m \omega) t}

    Of many hits that are over in a few periods, residues of its own ask of each hit more than it holds: P H numbers a
    mode and channel, where P shapes and H states do.

    Raises IdentificationError where a mode is not determined.

    Parameters
    ----------
    records, clocks
        One record a hit, and what ties each to the phase.
    model
        Where to start: outer products of shape and hit, with the bands of harmonics.
    lifted
        The same records lifted, with their noise.
    noise_floor
        The share of the largest free response that the noise is taken to be at least.
    report
        Is told of the stage.
    """
    report("fitting one shape for all hits")
    samples = Samples.of(records, clocks, lifted, None, 1.0)
    entries = ModeParameters.of(model)
    values = [2.0 * scaled(model, entries, block) for block in samples.final]
    result = of_shapes(samples.final, entries, values, noise_floor, samples.most)
    noise = np.zeros(lifted.noise.shape)
    for block in result.blocks:
        noise[block.rows, block.hit] = block.noise
    common = {"free_period": False, "noise_floor": noise_floor, "ended": (), "noise": noise}
    return result_of(result, records, clocks, samples, lifted.whitening, **common)


def steady_period(
    records: Sequence[Record],
    clocks: Sequence[PhaseClock],
    start: ModeParameters,
    known: Known,
    *,
    forced: str | Sequence[int] = "auto",
    periods_per_revolution: float = 1.0,
) -> float:
    r"""Period [s] by which the steady response of records keeps its phase, in a fit beside modes.

    .. math:: \frac{2\pi}{T} = \omega
              + \frac{\sum_{c,h,j} j\, \Im(\bar F_{c,h,j} \dot F_{c,h,j}) / s_{c,h}^2}
                     {\sum_{c,h,j} j^2 |F_{c,h,j}|^2 / s_{c,h}^2}

    with F the harmonics j a period, which may change linearly with time, F' what they change by in a second, s the
    noise, and ω that of the `clocks`. Without a steady response it is their period. To first order in the slip over the
    record: once more with the period found is better yet.

    Raises InputError where records or clocks do not belong together, or the forced response cannot be what is asked
    for.

    Parameters
    ----------
    records
        One record, or one a hit on the same system, of equal channels.
    clocks
        The constant period of each, the same of all.
    start
        The modes beside (`groups`).
    known
        The forced response that was found in the lifted responses.
    forced
        The harmonics of the revolution in it, as `fit` takes them.
    periods_per_revolution
        Periods of the system in a revolution of the shaft.
    """
    samples = Samples.of(records, clocks, None, known, periods_per_revolution)
    chosen = forced_turns(forced, known, samples.half, samples.nu)
    base = forced_base(chosen, samples.fundamental, wanders=False, turning=True)
    prices = priced(samples.final, base, ROUNDING, mode_alarm=SURE, harmonic_alarm=SURE)
    begin = replace(start, fundamental=samples.fundamental)
    return 2.0 * np.pi / _turned(Point.at(samples.final, *prices, base.joined(begin)).settled())


def _turned(point: Point) -> float:
    """Fundamental [rad/s] with which the steady response of a fit that lets it change keeps its phase."""
    entries, both = point.entries, shapes(point.blocks, point.solution)
    values, above, below = both.coefficients[..., both.harmonics == 0][..., 0], 0.0, 0.0
    for entry in np.flatnonzero(entries.fixed & (entries.factors == TREND) & (entries.offsets != 0.0)):
        turn = entries.offsets[entry]
        plain = int(np.flatnonzero(entries.fixed & (entries.factors == PLAIN) & (entries.offsets == turn))[0])
        for block in point.blocks:
            own, change = values[plain, block.rows, block.hit], values[entry, block.rows, block.hit] / block.half
            above += turn * float(np.sum((own.conj() * change).imag / block.noise**2))
            below += turn**2 * float(np.sum(np.abs(own) ** 2 / block.noise**2))
    return entries.fundamental + (above / below if below else 0.0)


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
