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
    free = degrees.sum() - base.regression.coefficients.size
    limit = chi2_limit(float(free), RARE)
    if t2.sum() > limit and free > 0:
        got = (
            f"has {t2.sum() / len(places):.4g}, most at record {places[worst]} ({file_of(work.points[places[worst]])})"
        )
        raise input_error("baseline", OF, f"have a mean T² below {limit / len(places):.4g}", got, remedy)
    if not base.scatter.any():
        later = np.zeros(len(places), bool)
        later[len(base.asked) :] = True
        found = change_of(values[inside], own, columns[inside], later, RARE)
        if found is not None:
            at = places[found.index]
            got = f"changes from record {at} ({file_of(work.points[at])}) on"
            raise input_error("baseline", OF, "be of a machine that does not change", got, "End the baseline before.")
