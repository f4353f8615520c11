"""The result of monitoring: charts over records, the instant of a change, and how periodic each record is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floquid._arrays import Floats, Mask
from floquid._checks import Rebuilt, Sealed
from floquid._show import Drawings, Drawn, Told


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
