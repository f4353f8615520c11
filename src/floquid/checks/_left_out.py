"""Samples that are left out of a fit, and predicted by it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Floats, Integers
from floquid.checks._check import FALSE_ALARM, Evidence, strongest
from floquid.checks._folds import HeldOut
from floquid.errors import FloquidError
from floquid.findings import Finding, failure
from floquid.inputs import Samples

LEAST_FIT = 0.95  # the share of the response that has to be predicted on cycles held out

ERROR = 1.05
"""The prediction error over noise and its own deviation that is let pass in any case; a tenth more over a stretch."""

FAILING = 1.4
"""How many times its limit the same is where a model fails, twice over a stretch; where the excitation goes on, over
what is expected."""

KEPT = 0.75
"""The share of each record, from when its inputs move on, that a model is fitted to for the check on the rest."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LeftOut:
    """Errors of a prediction of samples that were left out of a fit."""

    arrays: Mapping[str, Floats]  # `held_out_error`, and `fit` of free responses, for the reader (channels, hits)
    sizes: Mapping[str, tuple[float, float, float | None]]  # by name: an error, its limit, from where on a model fails
    numbers: Mapping[str, Any]  # where the largest is, and its size
    fit: float | None = None  # the share of the response that is predicted
    least: Mapping[str, Any] | None = None  # where that is least


def left_out(case: Any, found: Evidence) -> tuple[Finding, ...]:
    """Findings on samples that were left out of a fit and are not predicted by it."""
    try:
        own, why = case.left_out(), failure("held_out_too_few")
    except (FloquidError, np.linalg.LinAlgError) as error:
        own, why = None, failure("held_out_singular", error=str(error).rstrip("."))
    if own is None:
        return found.missing(case.predicted, why)
    found.arrays |= own.arrays
    if any(np.isinf(value) for value, *_ in own.sizes.values()):
        return found.missing(case.predicted, failure("held_out_grows"))
    said: tuple[Finding, ...] = ()
    if own.fit is not None and not found.kept("fit", own.fit, LEAST_FIT, at_least=True):
        said = found.against("held_out_fit", "fit", fit=own.fit, **own.least)
    kept = [found.kept(name, value, limit, failing=most) for name, (value, limit, most) in own.sizes.items()]
    if not all(kept):
        share = 0.0 if own.fit is None else 1.0 - found.metrics.get("fit", 0.0)
        said += found.against("held_out_error", *own.sizes, share=share, **own.numbers)
    return said


def of_cycles(case: Any, sums: HeldOut) -> LeftOut:
    """Errors of cycles of free responses that were left out, of sums of their squares."""
    from scipy.special import chdtri

    nothing = np.full(case.noise.shape, np.nan)
    alarm = FALSE_ALARM / case.responses
    numbers, own = sums.numbers.sum(axis=2), sums.own.sum(axis=2)
    most = chdtri(np.maximum(numbers, 1), alarm)
    beyond, response = np.maximum(own - most, 0.0), sums.response.sum(axis=2) - numbers
    seen = response > np.maximum(most - numbers, 0.0)
    fit = np.where(seen, 1.0 - np.sqrt(beyond / np.where(seen, response, 1.0)), np.nan)
    total = response[seen].sum()
    worst = (strongest(np.where(seen, 1.0 - fit, 0.0)) or [(0, 0)])[0]
    whole = _worst(own, numbers, alarm, ERROR)
    along = _worst(sums.own, sums.numbers, alarm / sums.numbers.shape[2], 1.0 + 2.0 * (ERROR - 1.0))
    channel, hit, stretch = along[2]
    part = ("first", "middle", "last")[min(3 * stretch // sums.numbers.shape[2], 2)]
    error = np.sqrt(np.divide(sums.squares.sum(axis=2), numbers, out=nothing.copy(), where=numbers > 0))
    return LeftOut(
        arrays={"fit": fit, "held_out_error": error},
        sizes={
            "held_out_error": (*whole[:2], FAILING * whole[1]),
            "held_out_stretch": (*along[:2], 2.0 * along[1]),
        },
        numbers={"ratio": along[0], "part": f"{part} part", **case.place(channel, hit)},
        fit=float(1.0 - np.sqrt(beyond[seen].sum() / total)) if total else 1.0,
        least={"least": fit[worst], **case.place(*worst)},
    )


def _worst(own: Floats, numbers: Integers, alarm: float, least: float) -> tuple[float, float, tuple[int, ...]]:
    """The root of a mean square that most exceeds its limit, the limit, and where it is."""
    from scipy.special import chdtri

    size = np.maximum(numbers, 1)
    ratio = np.sqrt(np.maximum(own, 0.0) / size)
    limit = np.maximum(np.sqrt(chdtri(size, alarm) / size), least)
    place = tuple(int(i) for i in np.unravel_index(int(np.argmax(ratio / limit)), ratio.shape))
    return float(ratio[place]), float(limit[place]), place


def quiet_for(inputs: NDArray[np.float64]) -> int:
    """Samples at the begin of a record in which no input moves; none where none ever does."""
    return int((inputs != inputs[:, :1]).any(axis=0).argmax())


def first_part(samples: Samples) -> tuple[Samples, NDArray[np.bool_]]:
    """The first three quarters of each record, and their mask over the samples of all (samples,).

    What is at its begin before any input moves is none of the four: a model needs inputs.
    """
    kept = []
    for one in samples.records:
        quiet = quiet_for(samples.inputs[:, one])
        kept.append(slice(one.start, one.start + quiet + int(KEPT * (one.stop - one.start - quiet))))
    mask = np.zeros(samples.n_samples, bool)
    for one in kept:
        mask[one] = True
    part = replace(
        samples,
        values=samples.values[:, mask],
        inputs=samples.inputs[:, mask],
        begins=(0, *np.cumsum([one.stop - one.start for one in kept]).tolist()),
        times=samples.times[mask],
        known=samples.known[:, mask],
    )
    return part, mask
