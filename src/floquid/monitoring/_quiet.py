"""A baseline that can be relied on: enough records, none that stands out, and no change."""

from __future__ import annotations

import numpy as np

from floquid._arrays import Floats, Mask
from floquid._checks import counted, input_error
from floquid.fit import RARE, chi2_limit
from floquid.monitoring._baseline import Baseline, fit_baseline
from floquid.monitoring._change import change_of
from floquid.monitoring._least_squares import squared_distances, terms_of
from floquid.monitoring._work import OF, Work, file_of

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
    """Refuse a baseline in which a record stands out, or that changes.

    A record is compared with the others, at 0.1 % over their number; the mean of T² with its 99.9 % limit.
    """
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
        got = f"changes from record {at} ({file_of(work.points[at])}) on"
        remedy = "End the baseline before, or add the covariate that explains it."
        raise input_error("baseline", OF, "be of a machine that does not change", got, remedy)


def _goes_with_order(residual: Floats, scatter: Floats, whole: Floats) -> bool:
    """True where the scatter of residuals (records, features) goes with their order.

    Of the part along the largest scatter, over the deviations of the `whole`, steps and ramps from each record on are
    correlated with it; the largest correlation is compared with those of the records in other orders.
    """
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
