"""The result of monitoring: charts over records, the instant of a change, and how periodic each record is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from floquid._arrays import Floats, Mask
from floquid._checks import Rebuilt, Sealed, counted
from floquid._show import Drawings, Drawn, Told
from floquid.views import shortened, with_error

HERTZ = "rad/s"
LONGEST = 40
"""Characters of the name of a file in a sentence or a row."""

LEAST = 1e-3
"""A chart over its limit below which nothing is shown."""

CHARTED = (
    "T²: how far the modes of a record are from the baseline, in deviations squared; average: the same of a running "
    "average, which sees slow changes. Above its limit a record is an alarm."
)
"""The columns of charts, for people."""


def over_limits(charts: Charts) -> dict[str, Floats]:
    """Each of the `charts` over its limit by its name (records,); NaN of a record that it does not have."""
    pairs = {
        "T²": (charts.t2, charts.t2_limit),
        "moving average": (charts.ewma, charts.ewma_limit),
        "along the direction": (charts.directed, charts.directed_limit),
    }
    return {name: np.maximum(values / limits, LEAST) for name, (values, limits) in pairs.items()}


def beside_baseline(charts: Charts) -> dict[str, tuple[str, list[tuple[str, Floats, Floats]]]]:
    """Frequencies and decays of `charts` less the baseline: a label, and name, values and deviations of each mode."""
    found = {}
    for word, scale, label in (
        ("frequency", 2.0 * np.pi, "f - baseline [Hz]"),
        ("decay", 1.0, "Re λ - baseline [1/s]"),
    ):
        kept = [(k, name.rpartition(" ")[0]) for k, name in enumerate(charts.features) if name.endswith(word)]
        values, std = charts.residual / scale, charts.residual_std / scale
        found[word] = label, [(name, values[:, k], std[:, k]) for k, name in kept]
    return found


def amount_label(amounts: Amounts) -> str:
    """The axis of `amounts` in percent."""
    return "of the change looked for [%]" if amounts.along else "sidebands [% of the response]"


def spans_of(found: Monitor) -> tuple[list[tuple[float, float]], list[tuple[float, float]]]:
    """Stretches of the baseline, and the interval of the instant of a change, in the order that `found` has."""
    places = np.flatnonzero(found.baseline)
    runs = np.split(places, np.flatnonzero(np.diff(places) > 1) + 1) if len(places) else []
    healthy = [(float(found.x[run[0]]), float(found.x[run[-1]])) for run in runs]
    if found.change is None:
        return healthy, []
    low, high = (float(found.x[k]) for k in found.change.interval)
    margin = 0.2 * float(np.median(np.diff(found.x))) if len(found.x) > 1 else 0.0
    return healthy, [(low - margin, high + margin)]


def feature_change(part: Part) -> str:
    """The change of a feature in a `part` of a change: frequencies in Hz, decays in 1/s, with the deviation."""
    scale, unit = (2.0 * np.pi, "Hz") if part.unit == HERTZ else (1.0, part.unit)
    sign = "+" if part.size >= 0.0 else ""
    return f"{part.feature} {sign}{with_error(part.size / scale, part.std / scale)} {unit}"


def change_words(found: Monitor) -> tuple[str, ...]:
    """The change that `found` holds, a sentence each: when, of what kind, and what carries it; empty without one."""
    change = found.change
    if change is None:
        return ()
    low, high = change.interval
    kind = "at once" if change.kind == "step" else "more and more"
    span = f"record {low}" if low == high else f"records {low} to {high}"
    return (
        f"It changes {kind} from record {change.index} ({_file(found, change.index)}) on; 95 % interval: {span}.",
        f"Carried by {', '.join(feature_change(part) for part in change.carried_by)}.",
    )


def sentences(found: Monitor) -> tuple[str, ...]:
    """The findings of `found`, a sentence each: the baseline, alarms, the change, and how periodic the records are."""
    out = []
    charts, later = found.charts, ~found.baseline
    if charts is not None:
        depends = [term for term in charts.terms if term != "constant"]
        words = f"depends on {', '.join(depends)}" if depends else "depends on no covariate"
        out.append(f"Baseline: {counted(int(found.baseline.sum()), 'record')}; it {words}.")
        out += _modes(charts, found.baseline)
        alarms, first = int(found.alarm.sum()), found.first_alarm
        looked = int(np.count_nonzero(later & np.isfinite(charts.t2)))
        if first is None:
            out.append(f"No alarm in {counted(looked, 'later record')}.")
        else:
            words = f"{counted(alarms, 'alarm')} in {counted(looked, 'later record')}"
            out.append(f"{words}, the first at record {first} ({_file(found, first)}).")
    return (*out, *change_words(found), *_periodic(found))


def _modes(charts: Charts, baseline: Mask) -> list[str]:
    """A sentence on which mode is which, by the frequencies of the baseline."""
    told = []
    for k, name in enumerate(charts.features):
        if name.endswith(" frequency"):
            hertz = np.nanmedian(np.abs(charts.values[baseline, k])) / (2.0 * np.pi)
            told.append(f"{name.removesuffix(' frequency')} at {hertz:.4g} Hz")
    return [f"In it are {', '.join(told)}."] if told else []


def _file(found: Monitor, record: int) -> str:
    return shortened(found.files[record], LONGEST) or "no file"


def _periodic(found: Monitor) -> tuple[str, ...]:
    """Sentences on the periodic amount and its trend."""
    amounts = found.amounts
    if amounts is None or not np.isfinite(amounts.value).any():
        return ()
    last = int(np.flatnonzero(np.isfinite(amounts.value))[-1])
    value, low, high = (100.0 * own[last] for own in (amounts.value, amounts.low, amounts.high))
    if amounts.along:
        share = with_error(value, 100.0 * amounts.std[last])
        words = f"Sidebands in record {last} have {share} % of the change that is looked for"
    else:
        most = f", most in {amounts.carried_by[last]}" if low > 0.0 else ""
        interval = f"95 %: {low:.3g} to {high:.3g}"
        words = f"Sidebands in record {last}: {value:.3g} % of the response ({interval}){most}"
    trend, out = amounts.trend, [f"{words}."]
    if trend is not None:
        way = "They grow" if trend.slope > 0.0 else "They fall"
        if amounts.along:
            way = "It grows" if trend.slope > 0.0 else "It falls"
        said = f"{way} over the records" if trend.p_value < 0.01 else "No trend over the records"
        out.append(f"{said} (p = {trend.p_value:.2g}).")
    return tuple(out)


def record_heads(found: Monitor) -> list[str]:
    """Names of the columns of `record_rows` of `found`."""
    names = ["record", "file"]
    if found.charts is not None:
        names += ["T² / limit", "average / limit"]
        names += ["directed / limit"] if np.isfinite(found.charts.directed).any() else []
    if found.amounts is not None:
        amount = "of the change" if found.amounts.along else "sidebands"
        names.append(f"{amount} [%] (95 % interval)")
    return [*names, ""]


def record_rows(found: Monitor) -> list[tuple[str, ...]]:
    """Rows of all records of `found`: number, file, T², average, amount, and what is to be said of it."""
    rows: list[tuple[str, ...]] = []
    for k, file in enumerate(found.files):
        charts, amounts = found.charts, found.amounts
        cells = [str(k), shortened(file, LONGEST)]
        if charts is not None:
            cells += [_of(charts.t2[k], charts.t2_limit[k]), _of(charts.ewma[k], charts.ewma_limit[k])]
            if np.isfinite(charts.directed).any():
                cells.append(_of(charts.directed[k], charts.directed_limit[k]))
        if amounts is not None:
            value, low, high = 100.0 * amounts.value[k], 100.0 * amounts.low[k], 100.0 * amounts.high[k]
            cells.append(f"{value:.3g} ({low:.2g} to {high:.2g})" if np.isfinite(value) else "")
        words = ["baseline"] if found.baseline[k] else ["ALARM"] if found.alarm[k] else []
        if charts is not None and charts.extrapolated[k]:
            words.append(f"extrapolated, leverage {charts.leverage[k]:.2g}")
        words += [found.reasons[k] or ""] if found.reasons[k] else []
        rows.append((*cells, ", ".join(words)))
    return rows


def _of(value: float, limit: float) -> str:
    return f"{float(f'{value:.3g}'):g} of {float(f'{limit:.3g}'):g}" if np.isfinite(value) else ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Part(Rebuilt):
    """The change of one feature.

    Parameters
    ----------
    feature, unit
        Its name, such as "mode 2 frequency", and its unit.
    size, std
        Its change, of a ramp until the last record, and its deviation [unit].
    """

    feature: str
    unit: str
    size: float
    std: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Change(Rebuilt):
    """The instant of a change.

    Parameters
    ----------
    index, interval
        The first record that differs, counted from 0, and the first and last of its 95 % interval.
    kind
        "step" or "ramp", by their likelihood.
    gain
        The gain in twice the logarithm of the likelihood.
    carried_by
        The features that change by more than three deviations, the clearest first; the clearest alone where none does.
    """

    index: int
    interval: tuple[int, int]
    kind: str
    gain: float
    carried_by: tuple[Part, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Trend(Rebuilt):
    """The trend of the periodic amount over the records.

    Parameters
    ----------
    slope, std
        Of the amount along a template, or of the share of energy without one, for each unit of what it goes over.
    p_value
        The probability of such a slope, of either sign, without a trend.
    """

    slope: float
    std: float
    p_value: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Charts(Sealed):
    """Charts of exponents over records; NaN where a record has none.

    Parameters
    ----------
    features, units
        Names of the tracked quantities, parts of the exponents of modes, and their units.
    values, std
        The features and their deviations (records, features) [units].
    residual, residual_std
        The features less what the baseline says of their covariates, and deviations (records, features) [units].
    t2, t2_limit
        Squared distances T² from the baseline, and their limits (records,).
    ewma, ewma_limit
        Squared distances of moving averages, and their limits (records,).
    directed, directed_limit
        The one-sided average along a direction in deviations, and its limit (records,); NaN without a direction.
    leverage
        Leverage of the covariates of each record by the baseline (records,).
    extrapolated
        True outside the range of a covariate in the baseline (records,).
    terms
        The functions of covariates that the features depend on.
    scatter_directions
        The number of directions in which the baseline scatters beyond the deviations.
    """

    features: tuple[str, ...]
    units: tuple[str, ...]
    values: Floats
    std: Floats
    residual: Floats
    residual_std: Floats
    t2: Floats
    t2_limit: Floats
    ewma: Floats
    ewma_limit: Floats
    directed: Floats
    directed_limit: Floats
    leverage: Floats
    extrapolated: Mask
    terms: tuple[str, ...]
    scatter_directions: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Amounts(Sealed):
    """Periodic amounts of records; NaN where sidebands are not known.

    Parameters
    ----------
    value, std, low, high
        The amount, its deviation and its 95 % interval (records,): the root of the share of energy in sidebands. Along
        a template it is in units of the labelled record, less what the baseline says of the covariates.
    along
        True along a template.
    carried_by
        The mode and harmonic with most of it at each record; empty along a template.
    average, average_limit
        The one-sided moving average along a template in deviations, and its limit (records,).
    trend
        The trend over the records; None of less than three.
    """

    value: Floats
    std: Floats
    low: Floats
    high: Floats
    along: bool
    carried_by: tuple[str, ...]
    average: Floats
    average_limit: Floats
    trend: Trend | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Monitor(Told, Drawn, Sealed):
    """Records of one machine, compared with a baseline of it.

    Parameters
    ----------
    files
        Where each record comes from.
    over, x
        The quantity over which records are drawn, "record" for their number, and its values (records,).
    covariates, conditions
        Names of the covariates, and their values (records, covariates).
    baseline
        True of the records of the baseline (records,).
    rate
        The rate of false alarms of each chart at each record.
    charts
        Charts of the exponents; None without a baseline.
    amounts
        How periodic the records are; None where no record has sidebands.
    alarm
        True where a chart is beyond its limit (records,).
    change
        The instant of a change; None without one.
    reasons
        Why a record has no charts; None where all is well.
    warnings
        What else a reader must know.
    """

    kind: ClassVar[str] = "monitor"  # by it the functions for a result are found
    files: tuple[str, ...]
    over: str
    x: Floats
    covariates: tuple[str, ...]
    conditions: Floats
    baseline: Mask
    rate: float
    charts: Charts | None
    amounts: Amounts | None
    alarm: Mask
    change: Change | None
    reasons: tuple[str | None, ...]
    warnings: tuple[str, ...] = ()

    def _figures(self) -> Drawings:
        names = ["monitor"] if self.charts is not None else []
        names += ["periodic_amount"] if self.amounts is not None else []
        return dict.fromkeys(names, (self, {}))

    @property
    def first_alarm(self) -> int | None:
        """The first record with an alarm, counted from 0."""
        return int(np.argmax(self.alarm)) if self.alarm.any() else None
