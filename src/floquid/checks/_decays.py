"""The model and the records after the filter that makes their noise white, and what is gathered on the way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Floats, Integers
from floquid._checks import frozen_array, input_error, noise_array
from floquid.checks._folds import cycles_of, only
from floquid.checks._types import Criterion
from floquid.core import ConstantPeriod, PeriodicModel, Record
from floquid.findings import Finding, failure, warning
from floquid.fit import filter_gain, filtered
from floquid.periodic import instants
from floquid.sync import ShaftAngle

FALSE_ALARM = 1e-3  # the probability at which noise may fail one of the checks, over all responses and lines together
REMAINDER = 0.05  # the share of the response, in amplitude, that a model may leave beyond the noise and still pass


@dataclass(slots=True)
class Checks:
    """The numbers, their limits and the findings, gathered on the way."""

    metrics: dict[str, float] = field(default_factory=dict)
    criteria: dict[str, Criterion] = field(default_factory=dict)
    findings: list[Finding] = field(default_factory=list)
    remainder: float = 0.0

    def kept(
        self, name: str, value: float, limit: float, *, at_least: bool = False, failing: float | None = None
    ) -> bool:
        """True where a number keeps to its limit, both noted; also where it is none, which is a finding of its own."""
        self.criteria[name] = Criterion(limit=limit, at_least=at_least, failing=failing)
        if not np.isfinite(value):
            self.findings.append(failure("overflow", name=name))
            return True
        self.metrics[name] = float(value)
        return self.criteria[name].met(value)

    def fail(self, code: str, *names: str, share: float = 0.0, **numbers: Any) -> None:
        """Note what is left, by the checks of these names and of the response, in amplitude; a failure if too much."""
        self.remainder = max(self.remainder, share)
        known = [name for name in names if name in self.metrics]
        failed = share > REMAINDER or any(self.criteria[name].failed(self.metrics[name]) for name in known)
        self.findings.append((failure if failed else warning)(code, **numbers))

    def missing(self, names: dict[str, float], why: Finding) -> None:
        """Note numbers that could not be computed, and why."""
        self.criteria.update({name: Criterion(limit=limit) for name, limit in names.items()})
        self.findings.append(why)


@dataclass(frozen=True, slots=True)
class Case:
    """Model and free response to be validated, after the filter that makes its noise white."""

    model: PeriodicModel
    records: tuple[Record, ...]
    clocks: tuple[ConstantPeriod | ShaftAngle, ...]
    noise: Floats
    instants: tuple[tuple[Floats, Floats], ...]
    cycles: tuple[Integers, ...]
    highest: float  # half of the lowest sampling rate, in fundamentals
    per_revolution: float

    def places(self, places: Sequence[tuple[int, ...]]) -> dict[str, list[Any]]:
        """The names of the channels and the numbers of the hits of responses; 0 where there is one hit alone."""
        several = self.model.n_hits > 1
        return {
            "channels": [self.model.channels[channel].name for channel, _ in places],
            "hits": [hit + 1 if several else 0 for _, hit in places],
        }

    def place(self, channel: int, hit: int) -> dict[str, Any]:
        """Name the channel and the hit of one response."""
        named = self.places([(channel, hit)])
        return {"channel": named["channels"][0], "hit": named["hits"][0]}

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
) -> Case:
    """The arguments, checked, and after the filter."""
    of = "validate"
    spread = noise_array(noise, of, model.coefficients.shape[1:3])
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
    )


def _whitened(
    model: PeriodicModel, records: tuple[Record, ...], clocks: Sequence[ConstantPeriod | ShaftAngle], taps: Floats
) -> tuple[PeriodicModel, tuple[Record, ...]]:
    """Records after the filters, from where they have their past on, and the model of those."""
    order, delays = taps.shape[1] - 1, np.arange(taps.shape[1]) * (1.0 / records[0].sample_rate)
    rates = model.exponents[:, None] + 1j * model.fundamental * model.harmonics
    gain = filter_gain(taps, delays, rates).transpose(1, 0, 2)[:, :, None, :]
    coefficients, after = model.coefficients * gain, []
    for hit, (record, clock) in enumerate(zip(records, clocks, strict=True)):
        values = filtered(record.values, taps)
        values.flags.writeable = False
        later = replace(record, values=values, start=record.start + order / record.sample_rate)
        # What is left out may hold the instant of phase zero from which the model counts.
        passed = instants(record, clock, model.fundamental)[0][order] - instants(later, clock, model.fundamental)[0][0]
        coefficients[:, :, hit] *= np.exp(model.exponents * passed)[:, None, None]
        after.append(later)
    return replace(model, coefficients=coefficients, coefficient_std=None), tuple(after)


def strongest(sizes: np.ndarray) -> list[tuple[int, ...]]:
    """The indices of what is above zero, the largest first."""
    found = np.argwhere(sizes > 0)
    order = np.argsort(-1.0 * sizes[tuple(found.T)], kind="stable")
    return [tuple(int(i) for i in found[k]) for k in order]
