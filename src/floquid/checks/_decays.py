"""Free responses as checks ask them: the model and the records after the filter that makes their noise white."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Floats, Integers
from floquid._checks import frozen_array, input_error, noise_array
from floquid.checks._check import Evidence, Subject
from floquid.checks._left_out import ERROR, LEAST_FIT, LeftOut, cycles_of, held_out, of_cycles, only
from floquid.checks._modes import doubts_of, undetermined_of
from floquid.checks._period import Off, beside_harmonics, blurred
from floquid.checks._residual import Colour, colour_of
from floquid.core import PeriodicModel, PhaseClock, Record
from floquid.errors import FloquidError
from floquid.findings import Finding
from floquid.fit import SIGNIFICANT, filter_gain, filtered
from floquid.periodic import TURNED, ForcedResponse, instants, own_period, unexplained
from floquid.reconstruction import StateModel
from floquid.sync import LARGEST_DRIFT


@dataclass(frozen=True, kw_only=True)
class Decays(Subject):
    """A model and the free responses that it is of; for a verdict, after the filter that makes their noise white."""

    of_verdict: ClassVar = frozenset(
        ("period", "weak modes", "tones", "harmonics", "lines", "colour", "left out", "A(t)", "remainder", "level")
    )

    predicted: ClassVar = {"fit": LEAST_FIT, "held_out_error": ERROR, "held_out_stretch": ERROR}

    model: PeriodicModel
    records: tuple[Record, ...]
    clocks: tuple[PhaseClock, ...] = ()
    noise: Floats
    per_revolution: float = 1.0
    forced: ForcedResponse | None = None
    misfit: float | None = None
    state: StateModel | None = None
    in_phase: bool = False  # whether the samples are values of splines in phase

    @cached_property
    def instants(self) -> tuple[tuple[Floats, Floats], ...]:
        """Times and angles of the samples of each record."""
        both = zip(self.records, self.clocks, strict=True)
        return tuple(instants(record, clock, self.model.fundamental) for record, clock in both)

    @cached_property
    def cycles(self) -> tuple[Integers, ...]:
        """The cycle of each sample of each record; -1 where its response is dead."""
        return tuple(cycles_of(self.model, self.instants, self.noise))

    @property
    def measured(self) -> bool:
        """True where the angle of a shaft ties records to the phase."""
        return any(clock.measured for clock in self.clocks)

    @property
    def highest(self) -> float:
        """Half of the lowest sampling rate, in fundamentals."""
        return 0.5 * min(record.sample_rate for record in self.records) * self.model.period

    @cached_property
    def left(self) -> list[Floats]:
        """The residual of each record, from which each check takes the lines off that it finds."""
        return list(unexplained(self.model, self.records, self.clocks))

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
    def shape(self) -> tuple[int, int]:
        """Numbers of channels and of hits."""
        return len(self.model.channels), self.model.n_hits

    @property
    def responses(self) -> int:
        """Channels times hits."""
        return self.noise.size

    def alive(self, hit: int) -> slice:
        """The samples of a record up to the last in which its response is alive."""
        return slice(0, int(np.max(np.flatnonzero(self.cycles[hit] >= 0), initial=-1)) + 1)

    def period_off(self) -> Off | None:
        """The period that the harmonics of the response turn with, against that of the model."""
        relative_and_std = None
        if not (self.measured or self.in_phase):
            with suppress(FloquidError, np.linalg.LinAlgError):
                records = [only(own, numbers >= 0) for own, numbers in zip(self.records, self.cycles, strict=True)]
                relative_and_std = own_period(self.model, records, self.clocks, noise=self.noise)
        if relative_and_std is None:
            return None  # a shaft or events that tell the period, or a response without harmonics
        relative, std = relative_and_std
        cycles = max(int(numbers.max()) + 1 for numbers in self.cycles)
        slip = abs(relative) * cycles * 2.0 * self.highest
        alive = min(cycles, 1.0 / max(np.abs(self.model.exponents.real).min() * self.model.period, 1e-300))
        if 2.0 * np.pi * abs(relative) * alive > TURNED:
            return None  # a step of many radians is none that one linearisation can tell
        # A model that fails has no deviations: then what it leaves says nothing of that of the period either.
        known = self.model.covariance is not None
        deviations = abs(relative) / std if slip > LARGEST_DRIFT else 0.0
        return Off(relative=relative, std=std if known else None, deviations=deviations, limit=SIGNIFICANT)

    def vague_angles(self) -> tuple[Finding, ...]:
        """Finding on what errors of the angle make of the response."""
        return blurred(self) if self.measured else beside_harmonics(self)

    def doubts(self) -> tuple[Finding, ...]:
        """Findings on modes that are likely none, or hardly determined."""
        return doubts_of(self.model, wanders=any(clock.wander > 0.0 for clock in self.clocks))

    def undetermined(self) -> tuple[Finding, ...]:
        """Finding on decays that are not determined."""
        return undetermined_of(self.model)

    def colour(self, evidence: Evidence) -> Colour:
        """The response with most colour over its limit."""
        return colour_of(self, evidence)

    def left_out(self) -> LeftOut | None:
        """Cycles left out of a fit and predicted; None where there are too few."""
        sums = held_out(self.model, self.records, self.clocks, self.cycles, self.noise)
        return None if sums is None else of_cycles(self, sums)


def decays_of(
    model: PeriodicModel,
    records: Sequence[Record],
    clocks: Sequence[PhaseClock],
    noise: ArrayLike,
    whitening: ArrayLike | None,
    periods_per_revolution: float,
    **more: Any,
) -> Decays:
    """Model and records after the filter, the arguments checked; `more` are further fields."""
    of = "validate"
    spread = noise_array(noise, of, model.coefficients.shape[1:3])
    if len(clocks) != len(records) or len(records) != model.n_hits:
        got = f"there are {len(records)} records and {len(clocks)} clocks, and the model has {model.n_hits} hits"
        raise input_error("records", of, "be one a hit of the model, each with a clock", got)
    used = tuple(records)
    if whitening is not None:
        taps = frozen_array(whitening, "whitening", of, axes=(len(model.channels), "taps"))
        model, used = _whitened(model, used, clocks, taps)
    said = clocks[0].periods_per_revolution if clocks else None
    return Decays(
        model=model,
        records=used,
        clocks=tuple(clocks),
        noise=spread,
        per_revolution=said or periods_per_revolution,
        **more,
    )


def _whitened(
    model: PeriodicModel, records: tuple[Record, ...], clocks: Sequence[PhaseClock], taps: Floats
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
