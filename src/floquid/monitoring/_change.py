"""The instant of a change: the likelihood of a step or a ramp from each record on, the coefficients fitted again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from floquid._arrays import Floats, Integers, Mask
from floquid._checks import counted, input_error
from floquid.fit import RARE, chi2_limit, scaled_inverse
from floquid.monitoring._baseline import Baseline, fit_baseline
from floquid.monitoring._work import OF, Work, file_of, inverses, regress, squared_distances, terms_of

ENDS: dict[Literal["step", "ramp"], float] = {"step": 7.35, "ramp": 3.84}
"""Twice the logarithm of the likelihood by which the 95 % interval falls below its largest: of a step that of a jump
(Hansen 2000, p. 582), of a ramp that of a smooth parameter (χ² of one)."""


@dataclass(frozen=True, slots=True)
class Found:
    """A change: the first record, its 95 % interval, the kind, the size of each feature's and its covariance."""

    index: int
    interval: tuple[int, int]
    kind: Literal["step", "ramp"]
    gain: float
    size: Floats
    covariance: Floats


def change_of(values: Floats, spread: Floats, columns: Floats, later: Mask, rate: float) -> Found | None:
    r"""The change of features (records, features) that is most likely, among the records that are `later` (records,).

    .. math:: x_i = B d_i + \phi_i \Delta + e_i, \qquad \phi_i = 1 \text{ or } i - k + 1 \text{ where } i \ge k

    with B and Δ free: the gain in twice the log-likelihood at each k is the score's, Δ̂ = M⁻¹ b. None where noise gives
    the best of them at the `rate`. A ramp's Δ is told as it is at the last record.
    """
    used: Mask = np.asarray(np.isfinite(values).any(axis=1))
    places: Integers = np.flatnonzero(used & later)
    if len(places) < 1:
        return None
    features = values.shape[1]
    regression = regress(values[used], spread[used], columns[used])
    weights = inverses(spread, values)
    weights[~used] = 0.0
    scores = np.einsum("iab,ib->ia", weights, np.nan_to_num(values - regression.predicted(columns)))
    crossed = np.einsum("iab,ij->iabj", weights, columns).reshape(len(values), features, -1)
    clock = np.arange(len(values), dtype=np.float64)
    on = np.where(later, 1.0, 0.0)

    def from_each(rows: Floats, power: int) -> Floats:
        """Sums of rows times a power of their number over all later ones from each record on."""
        shape = (-1,) + (1,) * (rows.ndim - 1)
        return np.cumsum((rows * (on * clock**power).reshape(shape))[::-1], axis=0)[::-1]

    sums = {name: [from_each(rows, k) for k in (0, 1, 2)] for name, rows in
            (("score", scores), ("cross", crossed), ("weight", weights))}  # fmt: skip
    limit = chi2_limit(features, rate / (2.0 * len(places)))
    best: dict[str, tuple[Floats, Floats, Floats]] = {}
    for kind in ENDS:
        gains, sizes = np.full(len(places), -np.inf), np.zeros((len(places), features))
        covariances = np.zeros((len(places), features, features))
        for row, k in enumerate(places.tolist()):
            start = k - 1.0
            if kind == "step":
                score, cross, own = (sums[name][0][k] for name in ("score", "cross", "weight"))
            else:
                if row == len(places) - 1:
                    continue
                score, cross = (sums[name][1][k] - start * sums[name][0][k] for name in ("score", "cross"))
                zeroth, first, second = (power[k] for power in sums["weight"])
                own = second - 2.0 * start * first + start**2 * zeroth
            inverse = scaled_inverse(own - cross @ regression.covariance @ cross.T)
            gains[row], sizes[row], covariances[row] = score @ inverse @ score, inverse @ score, inverse
        best[kind] = gains, sizes, covariances
    kind = "ramp" if best["ramp"][0].max() > best["step"][0].max() else "step"
    gains, sizes, covariances = best[kind]
    if gains.max() < limit:
        return None
    at = int(gains.argmax())
    inside = places[gains > gains[at] - ENDS[kind]]
    length = float(places[-1] - places[at] + 1) if kind == "ramp" else 1.0
    # Before the first there may be records that are not used: it may have begun at the one after the last that is.
    before = np.flatnonzero(used[: inside[0]])
    begin = int(before[-1]) + 1 if len(before) else int(inside[0])
    return Found(
        index=int(places[at]), interval=(begin, int(inside[-1])), kind=kind, gain=float(gains[at]),
        size=length * sizes[at], covariance=length**2 * covariances[at],
    )  # fmt: skip


ORDERS = 4000  # of the records, with which theirs is compared: of a probability of 0.1 % four are as extreme


def check_size(records: int, covariates: int, degree: int) -> None:
    columns = len(terms_of(covariates, degree))
    if records < 2 * columns:
        must = f"have {2 * columns} records with a result at least, twice its {counted(columns, 'column')}"
        remedy = "Lower the degree, leave a covariate out, or take more records into the baseline."
        raise input_error("baseline", OF, must, f"has {records}", remedy)


def check_quiet(
    work: Work, base: Baseline, values: Floats, covariance: Floats, conditions: Floats, errors: Floats, inside: Mask
) -> None:
    """Refuse a baseline in which a record stands out, or that changes."""
    places = np.flatnonzero(inside)
    columns = base.columns(conditions)
    residual = values - base.regression.predicted(columns)
    own = base.spread(covariance[inside], conditions[inside], errors[inside])
    inner = own - base.regression.uncertainty(columns[inside])
    t2, degrees = squared_distances(residual[inside], inner)
    worst = int(np.argmax(t2 / np.maximum(degrees, 1)))
    kept = np.delete(places, worst)
    remedy = "Leave it out of the baseline, or add the covariate that explains it."
    if len(kept) > len(base.asked):
        less = fit_baseline(values[kept], covariance[kept], conditions[kept], errors[kept], work.degree)
        one = places[[worst]]
        there = less.columns(conditions[one])
        spread = less.spread(covariance[one], conditions[one], errors[one]) + less.regression.uncertainty(there)
        distance, degree = squared_distances(values[one] - less.regression.predicted(there), spread)
        limit = less.limit(int(degree[0]), RARE / len(places))
        if distance[0] > limit and (less.leverage(conditions[one]) <= 1.0).all():
            got = f"record {places[worst]} ({file_of(work.points[places[worst]])}) has T² = {distance[0]:.4g}"
            raise input_error("baseline", OF, f"be quiet, with T² of each record below {limit:.4g}", got, remedy)
    free = float(degrees.sum() - base.regression.coefficients.size)
    total = float(squared_distances(residual[inside], own)[0].sum())
    limit = chi2_limit(free, RARE) if free > 0.0 else np.inf
    if total > limit:
        got = (
            f"has {t2.sum() / len(places):.4g}, most at record {places[worst]} ({file_of(work.points[places[worst]])})"
        )
        raise input_error("baseline", OF, f"have a mean T² below {limit / len(places):.4g}", got, remedy)
    if base.scatter.any() and not _goes_with_order(residual[inside], base.scatter, np.nanmean(own, axis=0)):
        return
    later = np.arange(len(places)) >= len(base.asked)
    found = change_of(values[inside], own - base.scatter, columns[inside], later, RARE)
    if found is not None:
        at = places[found.index]
        must, got = "be of a machine that does not change", f"changes from record {at} ({file_of(work.points[at])}) on"
        raise input_error("baseline", OF, must, got, "End the baseline before, or add the covariate that explains it.")


def _goes_with_order(residual: Floats, scatter: Floats, whole: Floats) -> bool:
    """True where the scatter of residuals (records, features) goes with their order."""
    scale = np.sqrt(np.diag(whole))
    axis = np.linalg.eigh(scatter / np.outer(scale, scale))[1][:, -1]
    part = np.nan_to_num(residual / scale) @ np.linalg.solve(whole / np.outer(scale, scale), axis)
    part = part - part.mean()
    number = np.arange(len(part))
    since = np.maximum(number - number[:-1, None], 0.0)
    forms = np.concatenate([since, since > 0.0])
    forms -= forms.mean(axis=1, keepdims=True)
    forms /= np.linalg.norm(forms, axis=1, keepdims=True)
    orders = np.random.default_rng(0).permuted(np.repeat(part[None], ORDERS, axis=0), axis=1)
    seen, others = np.abs(forms @ part).max(), np.abs(orders @ forms.T).max(axis=1)
    return bool(np.mean(others >= seen) < RARE)
