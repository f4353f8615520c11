"""What speaks against a result: a period that is not the response's own, and what a reader must be told."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from floquid.core import PeriodicModel, Record
from floquid.errors import FloquidError
from floquid.lifting import Lifted, largest_values
from floquid.lti import ModalModel
from floquid.order import Choice
from floquid.periodic import NEGLIGIBLE_SLIP, SIGNIFICANT, Finished, Fit, estimate_period, spacing, synchrony

MISFIT = 6.0
"""Standard deviations of what held residues leave at which they are doubted."""

QUIET = 1e-4
"""The noise over the largest value below which a record says more than modes: a weak nonlinearity, for one."""

STILL = 4.0
"""Standard deviations within which a multiplier is 1 or -1."""

SURE = 1e-3
"""The deviation of its logarithm, over the number of poles, below which that says something."""

CONFIDENT = 2e-3
"""A mode counts as well determined when both parts of its exponent have a deviation below this share of ω."""


def wrong_period(model: PeriodicModel, lifted: Lifted) -> str:
    """What is wrong with a period other than that of the response; empty when nothing is."""
    found = synchrony(model, lifted)
    if found is None or not found.broken:
        return ""
    own = model.period * (1.0 + found.relative)
    return (
        f"The response does not repeat with the period given: its own is {own:.10g} ± "
        f"{model.period * found.std:.1g} s, not {model.period:.10g} s; over the record the phase slips by "
        f"{found.slip:.3g} samples. Exponents and shapes would look right and be wrong."
    )


def wrong_measured_period(found: Fit, lifted: Lifted, records: Sequence[Record]) -> str:
    """The same for records fitted as they were sampled.

    Where modes look torn apart, or anything else speaks against them, the period is found from the response alone.
    """
    model, rate = found.model, records[0].sample_rate
    torn = spacing(model, lifted)
    relative, std = (torn.relative, torn.std) if torn is not None else (found.own_period or (0.0, np.inf))
    slip = abs(relative) * int(lifted.responses.lengths.max()) * model.period * rate
    own, broken = "another", abs(relative) > SIGNIFICANT * std and slip > NEGLIGIBLE_SLIP
    single = not ((np.abs(model.coefficients).max(axis=(1, 2)) > 0).sum(axis=1) > 1).any()
    if broken or found.doubts or single:
        try:
            estimate = estimate_period(records)
        except FloquidError:
            estimate = None
        if estimate is not None and estimate.period is not None and estimate.period_std is not None:
            share = max(estimate.period, model.period) / min(estimate.period, model.period)
            limit = SIGNIFICANT * estimate.period_std / estimate.period
            broken = abs(share / round(share) - 1.0) > limit
            own = f"{estimate.period:.10g} ± {estimate.period_std:.1g} s"
    if not broken:
        return ""
    return (
        f"The response does not repeat with the period given, {model.period:.10g} s: its own is {own}. Exponents and "
        "shapes would look right and be wrong.\n  Correct the period, the sampling rate or the time column; "
        "`estimate_period=True` (`--estimate-period`) finds the period from the response. If you know the period to be "
        "right, pass `trust_period=True` (`--trust-period`)."
    )


def too_low(order: int, choice: Choice) -> str:
    """What speaks for more modes than an order that was given; empty when nothing does."""
    evidence = choice.evidence
    assert evidence is not None
    if evidence.gain <= evidence.gain_limit:
        return ""
    share = evidence.gain / evidence.gain_limit
    return (
        f"The order given, {order}, is too low: a further mode would take {share:.3g} times out of the misfit what "
        "noise explains, so that the others are bent by more than their deviations say. Let the order be found, or ask "
        "for a higher one."
    )


def misfit(ended: Finished) -> str:
    """What speaks against residues that were held to their harmonics; empty when nothing does."""
    if ended.misfit <= MISFIT:
        return ""
    return (
        f"Residues held to their harmonics leave more than noise ({ended.misfit:.3g} standard deviations): harmonics "
        "are missing, or a mode is several that fold onto one another, and exponents are bent by more than their "
        "deviations say. Allow more harmonics, or finish with `constrained=False` (`--no-constrained`)."
    )


def quiet(lifted: Lifted) -> bool:
    """Whether the noise seen before any mode is fitted is so small that what modes leave is no noise."""
    return bool((lifted.noise < QUIET * largest_values(lifted.responses.values, lifted.n_channels)).all())


def below_modes(floor: float) -> str:
    """What is said where a record with hardly any noise is no sum of modes down to that noise."""
    return (
        f"There is hardly any noise, and what modes leave is none: a nonlinearity, most likely. The record is believed "
        f"down to {floor:g} of the largest value of each channel (`noise_floor`)."
    )


def driven(modal: ModalModel) -> bool:
    """Whether a pole is that of a forced response: a multiplier of 1 or of -1, as sure as one can be."""
    if modal.covariance is None:
        return False
    order = modal.order
    std = np.sqrt(np.diag(modal.covariance)) * modal.dt
    logs = modal.poles * modal.dt
    still = np.abs(logs.real) < STILL * std[:order] + 1e-12
    turn = np.minimum(np.abs(logs.imag), np.abs(np.pi - np.abs(logs.imag)))
    sure = std[:order] * modal.order < SURE
    return bool((still & (turn < STILL * std[order:] + 1e-12) & sure).any())


def ambiguity(choice: Choice | None) -> tuple[str, ...]:
    """What makes the order ambiguous, if anything does."""
    if choice is None or not choice.ambiguous:
        return ()
    return (f"The order, {choice.order}, is ambiguous: {' '.join(choice.doubts)}",)


def _halved(model: PeriodicModel, std: NDArray[np.complex128]) -> bool:
    """Whether half of the modes have a partner of equal decay at an odd number of half fundamentals."""
    gap = model.exponents[:, None] - model.exponents[None, :]
    deviation = np.hypot(std.real[:, None], std.real[None, :]), np.hypot(std.imag[:, None], std.imag[None, :])
    halves = 2.0 * gap.imag / model.fundamental
    odd = 2.0 * np.rint((halves - 1.0) / 2.0) + 1.0
    apart = np.abs(halves - odd) * model.fundamental < 10.0 * deviation[1]
    apart &= deviation[1] < 1e-3 * model.fundamental
    alike = (np.abs(gap.real) < 5.0 * deviation[0]) & (deviation[0] < 0.1 * np.abs(model.exponents.real))
    # A mode and its own conjugate are no two modes.
    itself = np.abs(model.exponents[:, None] - model.exponents[None, :].conj()) == 0
    return bool(2 * (apart & alike & ~itself).any(axis=1).sum() >= max(model.order, 1))


def warnings(model: PeriodicModel) -> tuple[str, ...]:
    """What a reader of the result must know."""
    words = []
    std = model.exponent_std
    if std is not None:
        weak = np.maximum(std.real, std.imag) > CONFIDENT * model.fundamental
        count = int(weak.sum())
        if count:
            words.append(
                f"{count} of {model.order} exponents are weakly determined (deviation above {CONFIDENT:g} of the "
                "fundamental): each may stand for several modes that this record cannot tell apart."
            )
        still = np.abs(np.angle(model.multipliers)) < 3.0 * std.imag * model.period + 1e-12
        still &= np.maximum(std.real, std.imag) < CONFIDENT * model.fundamental
        still &= np.abs(model.exponents.real) < 4.0 * std.real + 1e-9 * model.fundamental
        if still.any():
            words.append(
                "A component with a multiplier of 1 neither grows nor decays: it is most likely the forced periodic "
                "response (imbalance, an offset), not a mode."
            )
    if model.order and not ((np.abs(model.coefficients).max(axis=(1, 2)) > 0).sum(axis=1) > 1).any():
        words.append(
            "No mode has a second harmonic above the noise: the system looks constant, or the period is wrong and tore "
            "each harmonic into a mode of its own."
        )
    if std is not None and _halved(model, std):
        words.append(
            "Modes come in pairs of equal decay, half a fundamental apart: the true period is most likely twice the "
            "one given, and each mode is listed twice."
        )
    growing = model.exponents.real > (4.0 * std.real if std is not None else 0.0)
    if growing.any():
        words.append(
            f"{int(growing.sum())} of {model.order} exponents grow: the system is unstable, or it is being driven."
        )
    return tuple(words)
