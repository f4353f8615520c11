"""Records of one machine against a baseline of it, from results to charts, the instant of a change and amounts."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Floats, Indices, Mask
from floquid._checks import counted, input_error, integer, kind_of, positive
from floquid.fit import WITHIN
from floquid.monitoring._amounts import aligned, amounts_along, amounts_without_model, template_of, trend_of
from floquid.monitoring._baseline import (
    Baseline,
    Chart,
    Features,
    chart,
    common,
    direction_of,
    features_of,
    fit_baseline,
    one_sided,
    tell_missing,
)
from floquid.monitoring._change import change_of, check_quiet, check_size
from floquid.monitoring._types import Amounts, Change, Charts, Monitor, Part
from floquid.monitoring._work import (
    OF,
    SAME,
    Work,
    as_record,
    conditions_of,
    covariates_of,
    errors_of,
    is_array,
    labelled_of,
    mask_of,
    ordered,
    reordered,
    squared_distances,
    standard,
)
from floquid.surveys import Point, Survey, match_records, matches_of

MEMORY = 0.25  # share of the newest record in a moving average: shifts of one deviation are seen soonest (Lowry 1992)
CLEAR = 3.0  # deviations by which a feature counts among those that carry a change


def monitor(
    results: Iterable[Any] | Survey,
    *,
    baseline: slice | ArrayLike | None,
    covariates: Sequence[str] | None = None,
    degree: int = 2,
    rate: float = 1e-3,
    direction: Any = None,
    over: str | None = None,
) -> Monitor:
    r"""Compare records of one machine with a baseline of it: charts, the instant of a change, how periodic each is.

    Features x are the parts of the exponents of the modes, matched by their shapes. The baseline gives them over the
    covariates c by generalised least squares with the deviations S that each result has,

    .. math:: x_i = B\, d(c_i) + e_i, \qquad \mathrm{cov}\, e_i = S_i + Q +
              \frac{\partial B d}{\partial c}\, \mathrm{var}(c_i)\, \frac{\partial B d}{\partial c}^T

    with those of 1, c, c² and products that tests ask for, and a scatter Q that is zero unless it is seen. Charts are

    .. math:: T_i^2 = r_i^T (\mathrm{cov}\, e_i + J_i C J_i^T)^{-1} r_i, \qquad
              \epsilon_i = \tfrac{3}{4} \epsilon_{i-1} + \tfrac{1}{4} r_i

    and the same of ε with the covariance that it has. The instant of a change comes from the likelihood of a step or a
    ramp. A mode that is missing, weak or locked makes its features missing. Errors of covariates are those of their
    resolution, or points have them by name, as `temperature_std`.

    Sources: Lowry et al., Technometrics 34 (1992) 46; Hansen, Econometrica 68 (2000) 575. Raises InputError where the
    baseline has fewer records than twice its columns, is not quiet itself, or a covariate is missing in it. Not for
    machines whose modes lock and unlock over the covariates.

    Parameters
    ----------
    results
        What `identify` found of each record, files of such, or points, in their order in time; or a survey.
    baseline
        The records of the healthy machine: a slice, a mask, or numbers from 0; None for amounts alone.
    covariates
        Quantities of the operating point that features may depend on; by default speed_rpm and temperature, of those
        that the baseline has.
    degree
        The largest degree of the functions of covariates.
    rate
        False alarms of each chart at each record.
    direction
        The damage to look for, along which one-sided charts look: a result of a damaged machine, results or modes of
        known systems (healthy, damaged), or an array of the changes of the features (features,). All but the array say
        what it does to sidebands, too.
    over
        The quantity by which records are ordered and drawn, "days" say; None for their order as given.
    """
    of_rate = positive(rate, "rate", OF)
    if of_rate >= 0.5:
        raise input_error("rate", OF, "lie below 0.5", f"is {of_rate:g}", "It is the share of false alarms: 0.001.")
    whole: Any = results
    survey = whole if kind_of(whole) == "survey" else None
    given = tuple(map(as_record, whole)) if survey is None else survey.points
    if not given:
        raise input_error("results", OF, "hold a result", "none was given", "Pass what `identify` gave of each record.")
    points, order = ordered(given, over)
    healthy = mask_of(baseline, len(points))
    labelled = labelled_of(direction)
    names = covariates_of(points, healthy, covariates)
    if survey is not None:
        matches = reordered(matches_of(survey), order)
        if labelled:
            got = "is a result, and `results` is a survey"
            raise input_error("direction", OF, "be features here", got, "Pass the results themselves, not the survey.")
    else:
        every = (*points, *labelled)
        inside = np.arange(len(every)) < len(points)
        inside[: len(points)] = healthy
        matches = match_records(every, inside, standard(conditions_of(every, names), inside), OF)
    warnings: list[str] = []
    work = Work(
        points=points, labelled=labelled, matches=common(matches, healthy, warnings), healthy=healthy, names=names,
        conditions=conditions_of(points, names),
        degree=integer(degree, "degree", OF, at_least=0), rate=of_rate, given=baseline is not None,
        along=np.asarray(direction, float) if is_array(direction) else None,
        x=np.array([point.values[over] for point in points]) if over else np.arange(float(len(points))),
    )  # fmt: skip
    return _monitored(work, over or "record", warnings)


def _monitored(work: Work, over: str, warnings: list[str]) -> Monitor:
    """The result, by one thread: the matrices are many and small."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(limits=1, user_api="blas"):
        points, count = work.points, len(work.points)
        reasons: list[str | None] = [_reason(point) for point in points]
        charts, change, alarm = None, None, np.zeros(count, bool)
        if work.given:
            charts, change, alarm = _charted(work, reasons, warnings)
        amounts = amounts_of(work, warnings)
        if amounts is not None:
            with np.errstate(invalid="ignore"):
                alarm |= ~work.healthy & (amounts.average > amounts.average_limit)
        elif any(point.model is not None for point in points):
            warnings.append("No record has the estimates of its sidebands: how periodic it is, is not known.")
        return Monitor(
            files=tuple("; ".join(point.files) for point in points), over=over, x=work.x, covariates=work.names,
            conditions=work.conditions, baseline=work.healthy if work.given else np.zeros(count, bool),
            rate=work.rate, charts=charts, amounts=amounts, alarm=alarm, change=change, reasons=tuple(reasons),
            warnings=tuple(warnings),
        )  # fmt: skip


def _reason(point: Point) -> str | None:
    if point.model is None:
        return f"No result: {point.reason}"
    return None if point.reason is None else f"The model fails: {point.reason}"


def _charted(work: Work, reasons: list[str | None], warnings: list[str]) -> tuple[Charts, Change | None, Mask]:
    """Charts of the exponents, the instant of a change, and alarms."""
    features, count = features_of(work), len(work.points)
    covariance = features.covariance[:count]
    values = _values(work, features, reasons, warnings)
    there, missing = np.isfinite(values).any(axis=1), np.nan_to_num(covariance)
    inside = work.healthy & there
    conditions, errors, elsewhere = _conditions(work, inside, warnings)
    check_size(int(inside.sum()), conditions.shape[1], work.degree)
    base = fit_baseline(values[inside], covariance[inside], conditions[inside], errors[inside], work.degree)
    check_quiet(work, base, values, covariance, conditions, errors, inside)
    spread, columns = base.spread(missing, conditions, errors), base.columns(conditions)
    residual = values - base.regression.predicted(columns)
    leverage = np.where(elsewhere, np.inf, base.leverage(conditions))
    far = ~work.healthy & (leverage > 1.0) & there
    _tell(base, int(far.sum()), warnings)
    direction = direction_of(work, features, base)
    made = []
    for rows in (inside, ~work.healthy & ~far):
        places = np.flatnonzero(rows)
        of = residual[places], spread[places], columns[places]
        made.append((places, chart(base, *of, inside=rows is inside, memory=MEMORY, direction=direction)))
    uncertain = spread + base.regression.uncertainty(columns)
    t2, ewma, directed, limits, averaged = _joined(made, base, work.rate, count)
    t2[far] = squared_distances(residual[far], uncertain[far])[0]
    limits[far] = [base.limit(int(known), work.rate) for known in np.isfinite(residual[far]).sum(axis=1)]
    directed_limit = np.where(np.isfinite(directed), one_sided(base, work.rate), np.nan)
    with np.errstate(invalid="ignore"):
        alarm = ~work.healthy & ~far & ((t2 > limits) | (ewma > averaged) | (directed > directed_limit))
    change = None
    if alarm.any():
        used = (inside | (~work.healthy & ~far))[:, None]
        change = _change(np.where(used, values, np.nan), spread, columns, ~work.healthy, work.rate, features)
        if change is None:
            warnings.append("Alarms, and no lasting change: no step or ramp is likely enough.")
    names = [name for name, kept in zip(work.names, work.varying(inside), strict=True) if kept]
    charts = Charts(
        features=features.names, units=features.units, values=values, residual=residual,
        std=np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)),
        residual_std=np.where(np.isfinite(values), np.sqrt(np.diagonal(uncertain, axis1=1, axis2=2)), np.nan),
        t2=t2, t2_limit=limits, ewma=ewma, ewma_limit=averaged, directed=directed, directed_limit=directed_limit,
        leverage=np.where(there, leverage, np.nan), extrapolated=(base.extrapolated(conditions) | elsewhere) & there,
        terms=tuple(" × ".join(names[k] for k in term) or "constant" for term in base.terms),
        scatter_directions=base.rank,
    )  # fmt: skip
    return charts, change, alarm


def _values(work: Work, features: Features, reasons: list[str | None], warnings: list[str]) -> Floats:
    """The features of the records, those without covariates left out, with reasons for what is missing."""
    values = features.values[: len(work.points)].copy()
    missing = ~np.isfinite(work.conditions)
    values[missing.any(axis=1)] = np.nan
    known = np.isfinite(values)
    for row in np.flatnonzero(~known.all(axis=1)).tolist():
        gone = sorted({features.names[k].rpartition(" ")[0] for k in np.flatnonzero(~known[row])})
        words = f"Missing: {', '.join(gone)}." if known[row].any() else "No mode of the baseline is found in it."
        if missing[row].any():
            words = f"{work.names[int(missing[row].argmax())]} is missing."
        reasons[row] = reasons[row] or words
    tell_missing(values, work.healthy, features.names, warnings)
    return values


def _conditions(work: Work, inside: Mask, warnings: list[str]) -> tuple[Floats, Floats, Mask]:
    """Covariates that vary in the baseline, their errors, and records at other values of those that do not."""
    varying = work.varying(inside)
    same = np.flatnonzero(~varying)
    if len(same):
        names = ", ".join(work.names[k] for k in same)
        warnings.append(f"Constant in the baseline: {names}. Records at other values raise no alarm.")
    usual = work.conditions[inside][:1, same]
    off = np.abs(work.conditions[:, same] - usual) - SAME * np.abs(usual)
    elsewhere: Mask = np.asarray((off > 0.0).any(axis=1))
    errors = errors_of(work.points, work.names, work.conditions)
    return np.nan_to_num(work.conditions[:, varying]), np.nan_to_num(errors[:, varying]), elsewhere


def _tell(base: Baseline, far: int, warnings: list[str]) -> None:
    if base.scatter.any():
        seen = f"in {counted(base.rank, 'direction')}" if base.rank else "in all directions alike"
        warnings.append(f"The baseline scatters more than its deviations say, {seen}: the charts allow for it.")
    if far:
        warnings.append(f"{counted(far, 'record')} outside the covariates of the baseline by so much that none alarms.")


def _joined(made: list[tuple[Indices, Chart]], base: Baseline, rate: float, count: int) -> tuple[Floats, ...]:
    """Charts of the baseline and of later records in one, with their limits: T², averages, directed, both limits."""
    t2, ewma, directed, limits, averaged = np.full((5, count), np.nan)
    for places, own in made:
        t2[places], ewma[places], directed[places] = own.t2, own.ewma, own.directed
        for row, place in enumerate(places.tolist()):
            limits[place] = base.limit(int(own.degrees[row]), rate) if own.degrees[row] else np.nan
            averaged[place] = base.limit(int(own.averaged[row]), rate) if np.isfinite(own.ewma[row]) else np.nan
    return t2, ewma, directed, limits, averaged


def _change(
    values: Floats, spread: Floats, columns: Floats, later: Mask, rate: float, features: Features
) -> Change | None:  # fmt: skip
    found = change_of(values, spread, columns, later, rate)
    if found is None:
        return None
    std = np.sqrt(np.maximum(np.diag(found.covariance), 0.0))
    clear = np.abs(found.size) / np.where(std > 0.0, std, np.inf)
    order = np.argsort(-clear)
    kept = [k for k in order.tolist() if clear[k] > CLEAR] or order[:1].tolist()
    parts = tuple(
        Part(feature=features.names[k], unit=features.units[k], size=float(found.size[k]), std=float(std[k]))
        for k in kept
    )
    return Change(index=found.index, interval=found.interval, kind=found.kind, gain=found.gain, carried_by=parts)


def amounts_of(work: Work, warnings: list[str]) -> Amounts | None:
    """Amounts of periodicity of the records: along what is looked for, or without a model."""
    inside = np.arange(len(work.every)) < len(work.points)
    inside[: len(work.points)] = work.healthy
    found = aligned(work.every, work.matches, inside)
    records, labelled = found[: len(work.points)], [own for own in found[len(work.points) :] if own is not None]
    if not any(own is not None for own in records):
        return None
    if work.labelled and work.given:
        if len(labelled) == len(work.labelled) and (template := template_of(records, labelled, work.healthy)):
            return _along(work, *amounts_along(records, template))
        warnings.append("The sidebands of what is looked for do not rise above their noise: amounts are without it.")
    made = amounts_without_model(records)
    nothing = np.full(len(records), np.nan)
    rows = [[np.nan] * 4 if own is None else [own.value, own.std, *own.interval] for own in made]
    value, std, low, high = np.array(rows).T
    names = []
    for k, own in enumerate(made):
        track = -1 if own is None else work.matches.modes[k].tolist().index(own.mode)
        names.append("" if own is None else f"mode {track + 1}, harmonic {own.harmonic:+d}")
    energy = np.array([np.nan if own is None else own.energy for own in made])
    return Amounts(
        value=value, std=std, low=low, high=high, along=False, carried_by=tuple(names), average=nothing,
        average_limit=nothing, trend=trend_of(work.x, energy, None),
    )  # fmt: skip


def _along(work: Work, seen: Floats, deviation: Floats) -> Amounts:
    """Amounts (records,) less what the baseline says of the covariates, with a one-sided chart."""
    known = np.isfinite(seen) & np.isfinite(work.conditions).all(axis=1)
    inside = work.healthy & known
    values, covariance = np.where(known, seen, np.nan)[:, None], np.nan_to_num(deviation**2)[:, None, None]
    conditions, errors, elsewhere = _conditions(work, inside, [])
    check_size(int(inside.sum()), conditions.shape[1], work.degree)
    base = fit_baseline(values[inside], covariance[inside], conditions[inside], errors[inside], work.degree)
    columns = base.columns(conditions)
    spread = base.spread(covariance, conditions, errors)
    residual = values - base.regression.predicted(columns)
    average = np.full(len(work.points), np.nan)
    later = np.flatnonzero(~work.healthy & known & ~elsewhere & (base.leverage(conditions) <= 1.0))
    one = chart(base, residual[later], spread[later], columns[later], inside=False, memory=MEMORY, direction=np.ones(1))
    average[later] = one.directed
    std = np.where(known, np.sqrt((spread + base.regression.uncertainty(columns))[:, 0, 0]), np.nan)
    value = residual[:, 0]
    return Amounts(
        value=value, std=std, low=value - WITHIN * std, high=value + WITHIN * std, along=True, carried_by=(),
        average=average, average_limit=np.where(np.isfinite(average), one_sided(base, work.rate), np.nan),
        trend=trend_of(work.x, value, std),
    )  # fmt: skip
