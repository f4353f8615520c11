"""What is validated, after the filter that makes its noise white; and what is found on the way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from floquid._checks import finite, frozen_array, input_error
from floquid.core import ConstantPeriod, PeriodicModel, Record
from floquid.periodic import instants
from floquid.sync import ShaftAngle
from floquid.validation._held_out import cycles_of, only
from floquid.validation._left import filtered, gains
from floquid.validation._types import Criterion


@dataclass(slots=True)
class Findings:
    """What is gathered on the way."""

    metrics: dict[str, float] = field(default_factory=dict)
    criteria: dict[str, Criterion] = field(default_factory=dict)
    reasons: list[str] = field(default_factory=list)

    def add(self, name: str, value: float, limit: float, *, at_least: bool = False) -> bool:
        """A number and its limit; whether it keeps to it."""
        self.criteria[name] = Criterion(limit=limit, at_least=at_least)
        if not np.isfinite(value):
            self.reasons.append(f"{name} could not be computed: the numbers of the record or the model overflow.")
            return True
        self.metrics[name] = float(value)
        return self.criteria[name].met(value)

    def missing(self, names: dict[str, float], why: str) -> None:
        """Numbers that could not be computed."""
        self.criteria.update({name: Criterion(limit=limit) for name, limit in names.items()})
        self.reasons.append(why)


@dataclass(frozen=True, slots=True)
class Case:
    """What is validated: the model and the free response, after the filter that makes its noise white."""

    model: PeriodicModel
    records: tuple[Record, ...]
    clocks: tuple[ConstantPeriod | ShaftAngle, ...]
    noise: NDArray[np.float64]
    instants: tuple[tuple[NDArray[np.float64], NDArray[np.float64]], ...]
    cycles: tuple[NDArray[np.int64], ...]
    highest: float
    """Half of the lowest sampling rate, in fundamentals."""
    per_revolution: float
    false_alarm: float

    @property
    def responses(self) -> int:
        """Channels times hits."""
        return self.noise.size

    def alive_records(self) -> list[Record]:
        """The records, but for what comes after their response has died."""
        return [only(record, own >= 0) for record, own in zip(self.records, self.cycles, strict=True)]

    def alive(self, hit: int) -> slice:
        """The samples of a record up to the last in which its response is alive."""
        return slice(0, int(np.max(np.flatnonzero(self.cycles[hit] >= 0), initial=-1)) + 1)


def case_of(
    model: PeriodicModel,
    records: Sequence[Record],
    clocks: Sequence[ConstantPeriod | ShaftAngle],
    noise: ArrayLike,
    whitening: ArrayLike | None,
    periods_per_revolution: float,
    false_alarm: float,
) -> Case:
    """The arguments, checked, and after the filter."""
    of = "validate"
    spread = frozen_array(noise, "noise", of, axes=model.coefficients.shape[1:3])
    if not (spread > 0.0).all():
        raise input_error("noise", of, "be positive", f"has {spread.min():g}", "Give each channel its noise.")
    if not 0.0 < finite(false_alarm, "false_alarm", of) < 1.0:
        raise input_error("false_alarm", of, "lie between 0 and 1", f"is {false_alarm:g}")
    if len(clocks) != len(records) or len(records) != model.n_hits:
        got = f"there are {len(records)} records and {len(clocks)} clocks, and the model has {model.n_hits} hits"
        raise input_error("records", of, "be one a hit of the model, each with a clock", got)
    used = tuple(records)
    if whitening is not None:
        taps = frozen_array(whitening, "whitening", of, axes=(len(model.channels), "taps"))
        model, used = _whitened(model, used, clocks, taps)
    shafts = [clock for clock in clocks if isinstance(clock, ShaftAngle)]
    both = tuple(instants(r, c, model.fundamental) for r, c in zip(used, clocks, strict=True))
    return Case(
        model=model,
        records=used,
        clocks=tuple(clocks),
        noise=spread,
        instants=both,
        cycles=tuple(cycles_of(model, both, spread)),
        highest=0.5 * min(record.sample_rate for record in used) * model.period,
        per_revolution=shafts[0].periods_per_revolution if shafts else periods_per_revolution,
        false_alarm=false_alarm,
    )


def _whitened(
    model: PeriodicModel,
    records: tuple[Record, ...],
    clocks: Sequence[ConstantPeriod | ShaftAngle],
    taps: NDArray[np.float64],
) -> tuple[PeriodicModel, tuple[Record, ...]]:
    """Records after the filters, from where they have their past on, and the model of those."""
    step, order = 1.0 / records[0].sample_rate, taps.shape[1] - 1
    rates = model.exponents[:, None] + 1j * model.fundamental * model.harmonics
    gain = gains(taps, rates, step).transpose(1, 0, 2)[:, :, None, :]
    coefficients, after = model.coefficients * gain, []
    for hit, (record, clock) in enumerate(zip(records, clocks, strict=True)):
        values = filtered(record.values, taps)[:, order:]
        values.flags.writeable = False
        later = replace(record, values=values, start=record.start + order / record.sample_rate)
        # What is left out may hold the instant of phase zero from which the model counts.
        passed = instants(record, clock, model.fundamental)[0][order] - instants(later, clock, model.fundamental)[0][0]
        coefficients[:, :, hit] *= np.exp(model.exponents * passed)[:, None, None]
        after.append(later)
    through = PeriodicModel(
        exponents=model.exponents,
        coefficients=coefficients,
        harmonics=model.harmonics,
        period=model.period,
        channels=model.channels,
        covariance=model.covariance,
        provenance=model.provenance,
    )
    return through, tuple(after)
