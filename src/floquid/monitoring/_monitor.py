"""Records of one machine against a baseline of it, from results to charts, the instant of a change and amounts."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Floats, Mask
from floquid._checks import counted, input_error, integer, positive
from floquid._show import late
from floquid.fit import RARE, WITHIN, chi2_limit
from floquid.monitoring._amounts import Aligned, aligned, amounts_along, amounts_without_model, trend_of
from floquid.monitoring._baseline import Baseline, Chart, chart, fit_baseline
from floquid.monitoring._change import change_of
from floquid.monitoring._least_squares import squared_distances, terms_of
from floquid.monitoring._types import Amounts, Change, Charts, Monitor, Part
from floquid.surveys import Matches, Point, Survey, match_records, matches_of, point_of

OF = "monitor"
USUAL = ("speed_rpm", "temperature")
"""Covariates by default, those that the records have."""

MEMORY = 0.25  # share of the newest record in a moving average: shifts of one deviation are seen soonest (Lowry 1992)
CLEAR = 3.0  # deviations by which a feature counts among those that carry a change
COMMON = 0.5  # share of the baseline's records that a mode must be found in
DIGITS = 9  # significant digits of a covariate beyond which its resolution is that of floating point


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
        A result of the machine with a damage to look for, or the change of the features by it (features,): one-sided
        charts look along it. A result also is the template of a periodic amount.
    over
        The quantity by which records are ordered and drawn, "days" say; None for their order as given.
    """
    of_rate = positive(rate, "rate", OF)
    if of_rate >= 0.5:
        raise input_error("rate", OF, "lie below 0.5", f"is {of_rate:g}", "It is the share of false alarms: 0.001.")
    given = results.points if isinstance(results, Survey) else tuple(_point(one) for one in results)
    if not given:
        raise input_error("results", OF, "hold a result", "none was given", "Pass what `identify` gave of each record.")
    points, order = _ordered(given, over)
    healthy = _mask(baseline, len(points))
    labelled = None if direction is None or _is_array(direction) else _point(direction)
    names = _covariates(points, healthy, covariates)
    conditions = np.array([[point.values.get(name, np.nan) for name in names] for point in points])
    conditions = conditions.reshape(len(points), len(names))
    if isinstance(results, Survey):
        matches = _reordered(matches_of(results), order)
        if labelled is not None:
            got = "is a result, and `results` is a survey"
            raise input_error("direction", OF, "be features here", got, "Pass the results themselves, not the survey.")
    else:
        every = points if labelled is None else (*points, labelled)
        near = np.zeros((len(every), len(names)))
        near[: len(points)] = _standard(conditions, healthy)
        if labelled is not None:
            own = np.array([[labelled.values.get(name, np.nan) for name in names]])
            near[-1] = _standard(np.concatenate([conditions, own]), np.append(healthy, False))[-1]
        matches = match_records(every, np.append(healthy, False) if labelled is not None else healthy, near)
    work = _Work(
        points=points, labelled=labelled, matches=matches, healthy=healthy, names=names, conditions=conditions,
        degree=integer(degree, "degree", OF, at_least=0), rate=of_rate, given=baseline is not None,
        along=np.asarray(direction, float) if _is_array(direction) else None,
        x=np.array([point.values[over] for point in points]) if over else np.arange(float(len(points))),
    )  # fmt: skip
    return _monitored(work, over or "record")


@dataclass(frozen=True, slots=True, kw_only=True)
class _Work:
    """What is compared with what."""

    points: tuple[Point, ...]
    labelled: Point | None
    matches: Matches
    healthy: Mask
    names: tuple[str, ...]
    conditions: Floats
    degree: int
    rate: float
    given: bool
    along: Floats | None
    x: Floats


@dataclass(frozen=True, slots=True, kw_only=True)
class _Features:
    """Parts of exponents (records, features), with their covariance at each record."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Floats
    covariance: Floats


def _point(one: Any) -> Point:
    loaded = late("store", "load")(one) if isinstance(one, (str, PathLike)) else one
    return point_of(loaded, sidebands=True)


def _is_array(direction: Any) -> bool:
    return isinstance(direction, (np.ndarray, list, tuple))


def _ordered(points: Sequence[Point], over: str | None) -> tuple[tuple[Point, ...], np.ndarray]:
    """The points in the order of a quantity, and their places before."""
    if over is None:
        return tuple(points), np.arange(len(points))
    missing = [k for k, point in enumerate(points) if over not in point.values]
    if missing:
        got = f"record {missing[0]} ({_file(points[missing[0]])}) has none"
        raise input_error("over", OF, f"be a quantity of every record, and not {over}", got, "Leave `over` out.")
    order = np.argsort([point.values[over] for point in points], kind="stable")
    return tuple(points[k] for k in order), order


def _reordered(matches: Matches, order: np.ndarray) -> Matches:
    return Matches(**{name: getattr(matches, name)[order] for name in ("exponents", "modes", "shifts", "mirrored")})


def _file(point: Point) -> str:
    return "; ".join(point.files) or "no file"


def _mask(baseline: slice | ArrayLike | None, count: int) -> Mask:
    """The records of the baseline; all without one."""
    out = np.zeros(count, bool)
    if baseline is None:
        return ~out
    chosen: Any = baseline if isinstance(baseline, slice) else np.asarray(baseline)
    try:
        out[chosen] = True
    except (IndexError, TypeError, ValueError):
        out[:] = False
    if not out.any():
        must, got = f"name some of the {counted(count, 'record')}", f"is {baseline!r:.60}"
        raise input_error("baseline", OF, must, got, "Such as slice(0, 30), or 0:30 for the command.")
    return out


def _covariates(points: Sequence[Point], healthy: Mask, covariates: Sequence[str] | None) -> tuple[str, ...]:
    """Names of the covariates, each known of every record of the baseline that has a result."""
    inside = [k for k in np.flatnonzero(healthy).tolist() if points[k].model is not None]
    if covariates is None:
        return tuple(name for name in USUAL if inside and all(name in points[k].values for k in inside))
    for name in covariates:
        missing = [k for k in inside if name not in points[k].values]
        if missing:
            known = sorted({word for k in inside for word in points[k].values}) or ["none"]
            must = f"be quantities of every record of the baseline, and {name}"
            got = f"is none of record {missing[0]} ({_file(points[missing[0]])}), which has {', '.join(known)}"
            raise input_error("covariates", OF, must, got, "Add it by --table or --point, or leave it out.")
    return tuple(covariates)


def _standard(conditions: Floats, healthy: Mask) -> Floats:
    """Covariates over their range in the baseline, by which near records are found; zero where one is missing."""
    own = conditions[healthy]
    known = np.isfinite(own).all(axis=1)
    if not known.any():
        return np.zeros_like(conditions)
    spread = np.ptp(own[known], axis=0)
    return np.nan_to_num((conditions - own[known].mean(axis=0)) / np.where(spread > 0.0, spread, 1.0))


def _errors(points: Sequence[Point], names: Sequence[str], conditions: Floats) -> Floats:
    """Deviations of the covariates (records, covariates): given as `name_std`, else of their resolution, res/√12."""
    out = np.zeros(conditions.shape)
    for column, name in enumerate(names):
        known = conditions[np.isfinite(conditions[:, column]), column]
        size = max(float(np.abs(known).max(initial=0.0)), 1e-300)
        top = int(np.floor(np.log10(size)))
        steps = [10.0**k for k in range(top, top - DIGITS, -1)]
        fits = [step for step in steps if np.allclose(np.rint(known / step) * step, known, rtol=0.0, atol=1e-6 * step)]
        given = [point.values.get(f"{name}_std", np.nan) for point in points]
        resolution = fits[0] / np.sqrt(12.0) if fits and np.ptp(known) > 0.0 else 0.0
        out[:, column] = np.where(np.isfinite(given), given, resolution)
    return out


def _monitored(work: _Work, over: str) -> Monitor:
    """The result, by one thread: the matrices are many and small."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(limits=1, user_api="blas"):
        points, count = work.points, len(work.points)
        warnings: list[str] = []
        reasons: list[str | None] = [_reason(point) for point in points]
        charts, change, alarm = None, None, np.zeros(count, bool)
        if work.given:
            charts, change, alarm = _charted(work, reasons, warnings)
        amounts = _amounts(work)
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


def _features(work: _Work, warnings: list[str]) -> _Features:
    """Parts of the exponents of modes that most of the baseline has; those without deviations are none."""
    every = work.points if work.labelled is None else (*work.points, work.labelled)
    exponents, covariance = work.matches.exponents, work.matches.covariance(every)
    count, inside = exponents.shape[1], np.flatnonzero(work.healthy)
    usable = [k for k in inside.tolist() if np.isfinite(exponents[k]).any()]
    share = np.isfinite(exponents[usable]).mean(axis=0) if usable else np.zeros(count)
    names, units, parts = [], [], []
    for mode in np.flatnonzero(share >= COMMON).tolist():
        number = int(np.count_nonzero(share[: mode + 1] >= COMMON))
        for part, word, unit in ((mode, "decay", "1/s"), (mode + count, "frequency", "rad/s")):
            if np.nanmin(covariance[usable, part, part]) > 0.0:
                names.append(f"mode {number} {word}")
                units.append(unit)
                parts.append(part)
    rare = [mode for mode in range(count) if 0.0 < share[mode] < COMMON]
    if rare:
        least = ", ".join(f"{np.nanmedian(np.abs(exponents[usable][:, k].imag)) / (2.0 * np.pi):.4g}" for k in rare)
        warnings.append(f"Modes in less than half of the baseline are left out: {least} Hz.")
    if not parts:
        got = f"have none in common, with {counted(len(usable), 'result')} that can be used"
        raise input_error("results", OF, "have modes with deviations in the baseline", got, "See the reasons of each.")
    both = np.concatenate([exponents.real, exponents.imag], axis=1)[:, parts]
    return _Features(
        names=tuple(names), units=tuple(units), values=both, covariance=covariance[:, parts][:, :, parts]
    )  # fmt: skip


def _charted(
    work: _Work, reasons: list[str | None], warnings: list[str]
) -> tuple[Charts, Change | None, Mask]:  # fmt: skip
    """Charts of the exponents, the instant of a change, and alarms."""
    features, count = _features(work, warnings), len(work.points)
    values = features.values[:count].copy()
    covariance = features.covariance[:count]
    missing = ~np.isfinite(work.conditions)
    for row in np.flatnonzero(missing.any(axis=1)):
        reasons[row] = reasons[row] or f"{work.names[int(missing[row].argmax())]} is missing."
        values[row] = np.nan
    empty = np.flatnonzero(~np.isfinite(values).any(axis=1))
    for row in empty.tolist():
        reasons[row] = reasons[row] or "No mode of the baseline is found in it."
    lost = np.isfinite(values).any(axis=1) & ~np.isfinite(values).all(axis=1)
    _tell_missing(values, work.healthy, features.names, warnings)
    for row in np.flatnonzero(lost).tolist():
        gone = sorted({features.names[k].rpartition(" ")[0] for k in np.flatnonzero(~np.isfinite(values[row]))})
        reasons[row] = reasons[row] or f"Missing: {', '.join(gone)}."
    inside = work.healthy & np.isfinite(values).any(axis=1)
    std = _errors(work.points, work.names, work.conditions)
    steady = np.ptp(work.conditions[inside], axis=0) <= 0.0 if inside.any() else np.zeros(len(work.names), bool)
    for name in (name for name, same in zip(work.names, steady, strict=True) if same):
        warnings.append(f"{name} is the same in all of the baseline: records at other values raise no alarm.")
    varying = np.flatnonzero(~steady)
    _check_size(int(inside.sum()), len(varying), work.degree)
    conditions, errors = np.nan_to_num(work.conditions[:, varying]), np.nan_to_num(std[:, varying])
    base = fit_baseline(values[inside], covariance[inside], conditions[inside], errors[inside], work.degree)
    spread = base.spread(np.nan_to_num(covariance), conditions, errors)
    columns = base.columns(conditions)
    residual = values - base.regression.predicted(columns)
    _check_quiet(work, base, values, covariance, conditions, errors, inside)
    if base.scatter.any():
        seen = f"in {counted(base.rank, 'direction')}" if base.rank else "in all directions alike"
        warnings.append(f"The baseline scatters more than its deviations say, {seen}: the charts allow for it.")
    elsewhere = (work.conditions[:, steady] != work.conditions[inside][:1, steady]).any(axis=1)
    leverage = np.where(elsewhere, np.inf, base.leverage(conditions))
    extrapolated = (base.extrapolated(conditions) | elsewhere) & np.isfinite(values).any(axis=1)
    far = ~work.healthy & (leverage > 1.0) & np.isfinite(values).any(axis=1)
    if far.any():
        many = counted(int(far.sum()), "record")
        warnings.append(f"{many} so far outside the baseline's covariates that no alarm is raised (leverage above 1).")
    direction = _direction(work, features, base, varying)
    made = {}
    for name, rows in (("baseline", inside), ("later", ~work.healthy & ~far)):
        places = np.flatnonzero(rows)
        own = chart(base, residual[places], spread[places], columns[places], inside=name == "baseline",
                    memory=MEMORY, direction=direction)  # fmt: skip
        made[name] = places, own
    t2, ewma, directed, limits, averaged = _joined(made, base, work.rate, count)
    for row in np.flatnonzero(far).tolist():
        alone = residual[[row]], spread[[row]] + base.regression.uncertainty(columns[[row]])
        t2[row] = squared_distances(*alone)[0][0]
        limits[row] = base.limit(int(np.isfinite(residual[row]).sum()), work.rate)
    directed_limit = np.where(np.isfinite(directed), _one_sided(base, work.rate), np.nan)
    with np.errstate(invalid="ignore"):
        alarm = ~work.healthy & ~far & ((t2 > limits) | (ewma > averaged) | (directed > directed_limit))
    change = None
    if alarm.any():
        usable = np.where((inside | (~work.healthy & ~far))[:, None], values, np.nan)
        change = _change(usable, spread, columns, ~work.healthy, work.rate, features)
        if change is None:
            warnings.append("Alarms, and no lasting change: no step or ramp is likely enough.")
    charts = Charts(
        features=features.names, units=features.units, values=values, residual=residual,
        std=np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)),
        residual_std=np.sqrt(np.diagonal(spread + base.regression.uncertainty(columns), axis1=1, axis2=2)),
        t2=t2, t2_limit=limits, ewma=ewma, ewma_limit=averaged, directed=directed, directed_limit=directed_limit,
        leverage=leverage, extrapolated=extrapolated, scatter_directions=base.rank,
        terms=tuple(_term(term, [work.names[k] for k in varying]) for term in base.terms),
    )  # fmt: skip
    return charts, change, alarm


def _joined(
    made: dict[str, tuple[np.ndarray, Chart]], base: Baseline, rate: float, count: int
) -> tuple[Floats, ...]:  # fmt: skip
    """Charts of the baseline and of later records in one, with their limits: T², averages, directed, both limits."""
    t2, ewma, directed, limits, averaged = np.full((5, count), np.nan)
    for places, own in made.values():
        t2[places], ewma[places], directed[places] = own.t2, own.ewma, own.directed
        for row, place in enumerate(places.tolist()):
            limits[place] = base.limit(int(own.degrees[row]), rate) if own.degrees[row] else np.nan
            averaged[place] = base.limit(int(own.averaged[row]), rate) if np.isfinite(own.ewma[row]) else np.nan
    return t2, ewma, directed, limits, averaged


def _one_sided(base: Baseline, rate: float) -> float:
    """The deviations that one direction exceeds at a rate: Student's where the scatter was estimated."""
    from scipy.special import ndtri, stdtrit

    return float(stdtrit(base.degrees, 1.0 - rate) if base.rank else ndtri(1.0 - rate))


def _term(term: tuple[int, ...], names: Sequence[str]) -> str:
    return " × ".join(names[k] for k in term) or "constant"


def _tell_missing(values: Floats, healthy: Mask, names: Sequence[str], warnings: list[str]) -> None:
    """Tell of modes that are missing more often than in the baseline: that is a change that no chart shows."""
    later = ~healthy & np.isfinite(values).any(axis=1)
    for column, name in enumerate(names):
        if not name.endswith("decay") or not later.any():
            continue
        before, after = (int((~np.isfinite(values[rows, column])).sum()) for rows in (healthy, later))
        share, total = (before + 1.0) / (healthy.sum() + 2.0), int(later.sum())
        if after > total * share + 4.0 * np.sqrt(total * share * (1.0 - share)):
            mode = name.rpartition(" ")[0]
            warnings.append(f"{mode} is missing in {after} of {total} later records, and in {before} of the baseline.")


def _check_size(records: int, covariates: int, degree: int) -> None:
    columns = len(terms_of(covariates, degree))
    if records < 2 * columns:
        must = f"have {2 * columns} records with a result at least, twice its {counted(columns, 'column')}"
        remedy = "Lower the degree, leave a covariate out, or take more records into the baseline."
        raise input_error("baseline", OF, must, f"has {records}", remedy)


def _check_quiet(
    work: _Work, base: Baseline, values: Floats, covariance: Floats, conditions: Floats, errors: Floats, inside: Mask
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
            got = f"record {places[worst]} ({_file(work.points[places[worst]])}) has T² = {distance[0]:.4g}"
            raise input_error("baseline", OF, f"be quiet, with T² of each record below {limit:.4g}", got, remedy)
    free = degrees.sum() - base.regression.coefficients.size
    limit = chi2_limit(float(free), RARE)
    if t2.sum() > limit and free > 0:
        got = f"has {t2.sum() / len(places):.4g}, most at record {places[worst]} ({_file(work.points[places[worst]])})"
        raise input_error("baseline", OF, f"have a mean T² below {limit / len(places):.4g}", got, remedy)
    if not base.scatter.any():
        later = np.zeros(len(places), bool)
        later[len(base.asked) :] = True
        found = change_of(values[inside], own, columns[inside], later, RARE)
        if found is not None:
            at = places[found.index]
            got = f"changes from record {at} ({_file(work.points[at])}) on"
            raise input_error("baseline", OF, "be of a machine that does not change", got, "End the baseline before.")


def _direction(work: _Work, features: _Features, base: Baseline, varying: np.ndarray) -> Floats | None:
    """The change of the features by a damage (features,)."""
    if work.along is not None:
        if work.along.shape != (len(features.names),) or not work.along.any():
            must = f"hold the changes of the {len(features.names)} features ({', '.join(features.names)})"
            raise input_error("direction", OF, must, f"has the shape {work.along.shape}")
        return work.along
    if work.labelled is None:
        return None
    own = np.array([[work.labelled.values.get(work.names[k], np.nan) for k in varying]])
    if not np.isfinite(own).all() or not np.isfinite(features.values[-1]).any():
        must, got = "have the covariates and modes of the baseline", f"{_file(work.labelled)} has not"
        raise input_error("direction", OF, must, got, "Identify it as the other records, with its operating point.")
    return np.nan_to_num(features.values[-1] - base.regression.predicted(base.columns(own))[0])


def _change(
    values: Floats, spread: Floats, columns: Floats, later: Mask, rate: float, features: _Features
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


def _amounts(work: _Work) -> Amounts | None:
    """How periodic each record is: along the labelled record, or without a model."""
    every = work.points if work.labelled is None else (*work.points, work.labelled)
    healthy = np.append(work.healthy, False) if work.labelled is not None else work.healthy
    found, tracks = aligned(every, work.matches, healthy)
    records = found[: len(work.points)]
    if not any(own is not None for own in records):
        return None
    if work.labelled is not None and work.given:
        last = found[-1]
        if last is not None:
            return _along(work, records, last)
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


def _along(work: _Work, records: Sequence[Aligned | None], labelled: Aligned) -> Amounts:
    """Amounts along a labelled record less what the baseline says of the covariates, with a one-sided chart."""
    seen, deviation = amounts_along(records, labelled, work.healthy)
    known = np.isfinite(seen) & np.isfinite(work.conditions).all(axis=1)
    inside = work.healthy & known
    values, covariance = np.where(known, seen, np.nan)[:, None], np.nan_to_num(deviation**2)[:, None, None]
    varying = np.flatnonzero(np.ptp(work.conditions[inside], axis=0) > 0.0) if inside.any() else np.zeros(0, int)
    _check_size(int(inside.sum()), len(varying), work.degree)
    conditions = np.nan_to_num(work.conditions[:, varying])
    errors = np.nan_to_num(_errors(work.points, work.names, work.conditions)[:, varying])
    base = fit_baseline(values[inside], covariance[inside], conditions[inside], errors[inside], work.degree)
    columns = base.columns(conditions)
    spread = base.spread(covariance, conditions, errors)
    residual = values - base.regression.predicted(columns)
    average = np.full(len(records), np.nan)
    later = np.flatnonzero(~work.healthy & known & (base.leverage(conditions) <= 1.0))
    one = chart(base, residual[later], spread[later], columns[later], inside=False, memory=MEMORY, direction=np.ones(1))
    average[later] = one.directed
    std = np.where(known, np.sqrt((spread + base.regression.uncertainty(columns))[:, 0, 0]), np.nan)
    value = residual[:, 0]
    return Amounts(
        value=value, std=std, low=value - WITHIN * std, high=value + WITHIN * std, along=True, carried_by=(),
        average=average, average_limit=np.where(np.isfinite(average), _one_sided(base, work.rate), np.nan),
        trend=trend_of(work.x, value, std),
    )  # fmt: skip


