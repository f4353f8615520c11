"""The checks put together: numbers, limits, a verdict."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Floats, Integers, Mask
from floquid.checks._decays import FALSE_ALARM, REMAINDER, Case, Checks, case_of, strongest
from floquid.checks._folds import held_out
from floquid.checks._integrated import consistency
from floquid.checks._residual import left_by
from floquid.checks._types import Validation
from floquid.core import ConstantPeriod, PeriodicModel, Record
from floquid.errors import FloquidError
from floquid.findings import Finding, failure
from floquid.periodic import NEGLIGIBLE_SLIP, SIGNIFICANT, TURNED, own_period
from floquid.reconstruction import StateModel
from floquid.sync import ShaftAngle

LEAST_FIT = 0.95  # the share of the response that has to be predicted on cycles held out

ERROR = 1.05
"""The prediction error over noise and its own deviation that is let pass in any case; a tenth more over a stretch."""

FAILING = 1.4  # how many times its limit the same is where a model fails; twice over a stretch

PHI = 1e-3
"""The relative difference between Φ and A(t) integrated that is let pass: interpolation between instants makes one."""

EXPLAINED = 1e-9  # the probability at which noise passes for a mode, over all lines and decays that it is looked for at
LOOKS = 8  # decays that a mode may have been looked for at, on each line


def validate(
    model: PeriodicModel,
    records: Sequence[Record],
    clocks: Sequence[ConstantPeriod | ShaftAngle],
    *,
    noise: ArrayLike,
    state: StateModel | None = None,
    whitening: ArrayLike | None = None,
    periods_per_revolution: float = 1.0,
    report: Callable[[str], None] = lambda _: None,
) -> Validation:
    r"""The verdict on a model: cycles held out, what is left of the record, and A(t) integrated.

    Of each channel and hit, over the cycles in which the response is alive, held out in turn and predicted,

    .. math:: \mathrm{fit} = 1 - \sqrt{\frac{\max(\sum e\,r - \sigma^2 \chi^2_{n,\alpha},\, 0)}{\sum y^2 - n\sigma^2}}

    with e the error of prediction and r what the fit to all cycles leaves: Σ e r is the error with the prediction's own
    variance taken off, and all of it that noise explains counts as none. What the model leaves of the record is
    searched for tones at harmonics of the revolution, for harmonics of each mode beside its band, for other lines, and
    for colour (Ljung and Box 1978). Each mode is held against what a fit makes of noise alone. A(t) is integrated over
    two periods and held against the model's multipliers.

    Raises InputError where an argument is not possible, or does not belong to the model.

    Parameters
    ----------
    model, records, clocks
        The model, the free response as it was sampled, one record a hit with NaN for missing samples, and the clock of
        each.
    noise
        The deviation of the noise (channels, hits) [units of the channels]; with `whitening`, after the filter.
    state
        A(t) and Φ; None leaves them out.
    whitening
        The filter of each channel that makes its noise white (channels, taps); None where it is.
    periods_per_revolution
        Periods of the system in a revolution of the shaft, where no clock says it.
    report
        Called with a sentence on each stage.
    """
    case = case_of(model, records, clocks, noise, whitening, periods_per_revolution)
    report("checking the model on cycles left out")
    found = Checks()
    _period(case, found)
    strength(case, found)
    # What names a cause comes before what shows the effect.
    arrays = left_by(case, found)
    fit, error = _held_out(case, found)
    if state is not None:
        _state(model, state, found)
    found.kept("remainder", found.remainder, REMAINDER)
    found_all = set(found.metrics) == set(found.criteria)
    passed = found_all and not any(own.failed(found.metrics[name]) for name, own in found.criteria.items())
    return Validation(
        metrics=found.metrics,
        criteria=found.criteria,
        passed=passed,
        findings=tuple(found.findings),
        fit=fit,
        held_out_error=error,
        **arrays,
    )


def _held_out(case: Case, found: Checks) -> tuple[Floats, Floats]:
    """The fit, and the rms error over the noise (channels, hits)."""
    from scipy.special import chdtri

    nothing = np.full(case.noise.shape, np.nan)
    criteria = {"fit": LEAST_FIT, "held_out_error": ERROR, "held_out_stretch": ERROR}
    try:
        sums = held_out(case.model, case.records, case.clocks, case.cycles, case.noise)
        why = failure("held_out_too_few")
    except (FloquidError, np.linalg.LinAlgError) as error:
        sums, why = None, failure("held_out_singular", error=str(error).rstrip("."))
    if sums is None:
        found.missing(criteria, why)
        return nothing, nothing
    alarm = FALSE_ALARM / case.responses
    numbers, own = sums.numbers.sum(axis=2), sums.own.sum(axis=2)
    most = chdtri(np.maximum(numbers, 1), alarm)
    beyond, response = np.maximum(own - most, 0.0), sums.response.sum(axis=2) - numbers
    seen = response > np.maximum(most - numbers, 0.0)
    fit = np.where(seen, 1.0 - np.sqrt(beyond / np.where(seen, response, 1.0)), np.nan)
    total = response[seen].sum()
    if not found.kept("fit", 1.0 - np.sqrt(beyond[seen].sum() / total) if total else 1.0, LEAST_FIT, at_least=True):
        worst = strongest(np.where(seen, 1.0 - fit, 0.0))[0]
        place = case.place(*worst)
        found.fail("held_out_fit", "fit", fit=found.metrics["fit"], least=fit[worst], **place)
    whole = _worst(own, numbers, alarm, ERROR)
    along = _worst(sums.own, sums.numbers, alarm / sums.numbers.shape[2], 1.0 + 2.0 * (ERROR - 1.0))
    clear = found.kept("held_out_error", *whole[:2], failing=FAILING * whole[1])
    if not (found.kept("held_out_stretch", *along[:2], failing=2.0 * along[1]) and clear):
        channel, hit, stretch = along[2]
        part = ("first", "middle", "last")[min(3 * stretch // sums.numbers.shape[2], 2)]
        names, share = ("held_out_error", "held_out_stretch"), 1.0 - found.metrics.get("fit", 0.0)
        found.fail("held_out_error", *names, share=share, ratio=along[0], part=part, **case.place(channel, hit))
    error = np.sqrt(np.divide(sums.squares.sum(axis=2), numbers, out=nothing.copy(), where=numbers > 0))
    return fit, error


def _period(case: Case, found: Checks) -> None:
    """The period that the harmonics of the response turn with, against that of the model."""
    own = None
    if all(isinstance(clock, ConstantPeriod) for clock in case.clocks):
        with suppress(FloquidError, np.linalg.LinAlgError):
            own = own_period(case.model, case.alive_records(), case.clocks, noise=case.noise)
    if own is None:
        return  # a shaft that tells the period, or a response without harmonics
    relative, std = own
    cycles = max(int(own.max()) + 1 for own in case.cycles)
    slip = abs(relative) * cycles * 2.0 * case.highest
    alive = min(cycles, 1.0 / max(np.abs(case.model.exponents.real).min() * case.model.period, 1e-300))
    if 2.0 * np.pi * abs(relative) * alive > TURNED:
        return  # a step of many radians is none that one linearisation can tell
    if not found.kept("period", abs(relative) / std if slip > NEGLIGIBLE_SLIP else 0.0, SIGNIFICANT):
        given = case.model.period
        # A model that fails has no deviations: then what it leaves says nothing of that of the period either.
        deviation = None if case.model.covariance is None else given * std
        found.fail("own_period", "period", period=given * (1.0 + relative), std=deviation, given=given)


def _worst(own: Floats, numbers: Integers, alarm: float, least: float) -> tuple[float, float, tuple[int, ...]]:
    """The root of a mean square that most exceeds its limit, the limit, and where it is."""
    from scipy.special import chdtri

    size = np.maximum(numbers, 1)
    ratio = np.sqrt(np.maximum(own, 0.0) / size)
    limit = np.maximum(np.sqrt(chdtri(size, alarm) / size), least)
    place = tuple(int(i) for i in np.unravel_index(int(np.argmax(ratio / limit)), ratio.shape))
    return float(ratio[place]), float(limit[place]), place


def _state(model: PeriodicModel, state: StateModel, found: Checks) -> None:
    """A(t), integrated."""
    own = consistency(model, state)
    if isinstance(own, Finding):
        found.missing({"multipliers": 1.0, "liouville": 1.0, "composition": PHI}, own)
        return
    multipliers = found.kept("multipliers", own.multipliers, 1.0)
    trace = found.kept("liouville", own.liouville, 1.0)
    composition = found.kept("composition", own.composition, PHI)
    if not (multipliers and trace and composition):
        found.fail(
            "system_other",
            "multipliers",
            "liouville",
            "composition",
            pair=None if multipliers else own.pair,
            trace=not trace,
            composition=None if composition else own.composition,
        )


def strength(case: Case, found: Checks) -> None:
    r"""Each mode's power in the records over the noise, against what a fit makes of noise alone.

    .. math:: \frac{1}{\ell_r} \sum_{c,h} \frac{1}{\sigma_{c,h}^2}
              \sum_m |B_{r,c,h,m}|^2 \sum_k 2\, e^{2 \Re \lambda_r t_k}, \qquad \ell_r = \chi^2_{p_r, \alpha / n}

    a conjugate pair once, p its parameters and n the lines of the records, each looked at with several decays. The
    products of two harmonics are left out: they add up to nothing over a period. The least is `mode`, and has to be 1.
    """
    from scipy.special import chdtri

    model, own = case.model, np.flatnonzero(case.model.exponents.imag >= 0)
    if not len(own):
        return
    powers = np.array([_power(case, int(mode)) for mode in own])
    kept = (model.coefficients[own] != 0).any(axis=(1, 2)).sum(axis=1)
    looks = LOOKS * sum(record.n_samples for record in case.records)
    limits = chdtri(2 * case.responses * np.maximum(kept, 1) + 2, EXPLAINED / looks)
    shares = powers / limits
    if found.kept("mode", float(shares.min()), 1.0, at_least=True):
        return
    below = [k for (k,) in strongest(np.where(shares < 1.0, 2.0 - shares, 0.0))]
    found.fail("mode_weak", "mode", frequencies=model.frequencies_hz[own[below]], shares=shares[below])


def _power(case: Case, mode: int) -> float:
    """The power of a mode, with its conjugate, in all records over the noise."""
    model, total = case.model, 0.0
    value = model.exponents[mode]
    for hit, (record, (times, _)) in enumerate(zip(case.records, case.instants, strict=True)):
        # A growing mode is counted from its end, so that nothing overflows.
        origin = times[-1] if value.real > 0 else times[0]
        there: Mask = ~np.isnan(record.values)
        decay = there @ np.exp(2.0 * value.real * (times - origin))
        sizes = np.abs(model.coefficients[mode, :, hit] * np.exp(value.real * origin)) / case.noise[:, hit, None]
        total += float(np.sum(sizes**2, axis=1) @ decay)
    return total if model.unpaired[mode] else 2.0 * total
