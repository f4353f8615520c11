"""Records whose excitation goes on, as checks ask them: measured inputs, and outputs alone."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from floquid import innovations, inputs
from floquid._arrays import Floats
from floquid.checks._angle import shaken
from floquid.checks._check import Evidence, Subject
from floquid.checks._excitation import excitation_of
from floquid.checks._left_out import FAILING, LeftOut, first_part, of_last_quarter
from floquid.checks._limits import is_undetermined
from floquid.checks._parted import Parted
from floquid.checks._period import Off
from floquid.checks._phases import LIMIT
from floquid.checks._residual import Colour
from floquid.core import PeriodicModel
from floquid.findings import Finding, failure
from floquid.fit import SURE
from floquid.inputs import Limits, Samples, Scores, Uncertainty, linearise, slopes_of, state_slopes

COLOURED, WRONG = 0.1, 0.3
"""The sum of squared correlations from which on what is left is no white noise, and the model is not what left it."""

PREDICTABLE = 0.03
"""The share of the variance of the innovations that is predictable from those before, from which on a model fails."""

MOST_UNTOLD = 3.0
"""What deviations of the fit to a part may make of the prediction, over the noise: more is no model to predict with."""


@dataclass(frozen=True, kw_only=True)
class Excited(Subject):
    """A model and the records whose excitation goes on.

    Parameters
    ----------
    own
        The samples, with their channels and shafts.
    model, limits
        The model, and the limits of its search.
    turning
        True where lines of the revolution are looked for.
    """

    of_verdict: ClassVar = frozenset(("left out",))
    predicted: ClassVar = {"held_out_error": FAILING}
    slip: ClassVar[float]
    """Periods by which one may be off over a record, and its own be told to first order."""
    random: ClassVar[bool] = False
    """True where nobody measured all that drives the system."""

    own: Parted
    model: PeriodicModel
    limits: Limits
    turning: bool = True

    @property
    def samples(self) -> Samples:
        """Outputs and inputs, one record after another."""
        return self.own.samples

    @property
    def shafts(self) -> Sequence:
        """The angle of the shaft in each record."""
        return self.own.shafts

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of outputs, and of columns of the noise: one."""
        return len(self.own.outputs), 1

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the outputs."""
        return tuple(channel.name for channel in self.own.outputs)

    def step(self) -> tuple[float, float]:
        """The relative difference of the own period, to first order, and its deviation."""
        raise NotImplementedError

    def errors(self) -> Floats:
        """The rms error on the last quarter of each record, by a fit to the rest, over what is expected (outputs,)."""
        raise NotImplementedError

    def period_off(self) -> Off | None:
        """The step of the period by its score; None where a shaft tells it."""
        if self.shafts:
            return None
        step, std = self.step()
        if abs(step) <= LIMIT * std:
            return None
        longest = max(own.stop - own.start for own in self.samples.records) * self.samples.step / self.model.period
        near = abs(step) * longest <= self.slip
        return Off(relative=step, std=std, deviations=abs(step) / std, limit=LIMIT, near=near)

    def left_out(self) -> LeftOut:
        """The last quarter of each record, predicted by a fit to the rest."""
        return of_last_quarter(self.errors(), self.names)


@dataclass(frozen=True, kw_only=True)
class Driven(Excited):
    """A model and the response to measured inputs; `most` are the harmonics looked for, None where it has all."""

    slip: ClassVar = 0.05  # inputs then meet their phase yet

    fit: Uncertainty
    most: int | None = None

    @cached_property
    def scores(self) -> Scores:
        """Score tests of the fit."""
        return Scores(self.samples, self.fit.at, rough=False)

    @property
    def residual(self) -> Floats:
        """The residual of each output (outputs, samples)."""
        return self.fit.at.left

    @property
    def coloured(self) -> bool:
        """True where the residual is not white."""
        return self.fit.at.colour > COLOURED

    def step(self) -> tuple[float, float]:
        """The step of the period by its score."""
        return inputs.period_step(self.scores)

    def phase_steps(self) -> list[tuple[float, float]]:
        """The step of the phase of each record after the first, in periods, and its deviation."""
        return [inputs.phase_step(self.scores, number) for number in range(1, len(self.own.records))]

    def vague_angles(self) -> tuple[Finding, ...]:
        """Findings on errors of the angle, over the variance of the residual."""
        at = self.fit.at
        return shaken(self.own, at.coefficients[-len(self.samples.known) :].T, at.noise)

    def seen(self) -> list[tuple[float, int]]:
        """Squared deviations of the shape of each mode from zero, and how many numbers it has; none of free phases."""
        if self.most is None:
            return []
        columns, channels = self.scores.now.slices(), len(self.scores.left)
        sizes = [channels * (own.stop - own.start) for own, _ in columns]
        return list(zip(self.scores.of_modes.tolist(), sizes, strict=True))

    def colour(self, _: Evidence) -> Colour:
        """The most correlations of one output."""
        size = float(self.fit.at.colour)
        return Colour(size=size, limit=COLOURED, failing=WRONG, numbers={"squares": [size]} if self.coloured else {})

    def undetermined(self) -> tuple[Finding, ...]:
        """Finding on decays that are not determined."""
        return (failure("undetermined"),) if is_undetermined(self.model) else ()

    def errors(self) -> Floats:
        """The rms error on the last quarter of each record, by a fit to the rest, over what is expected (outputs,).

        Expected are the noise, and what the deviations of that fit make of the prediction.
        """
        whole, found = self.samples, self.fit.at
        first, fitted = first_part(whole)
        part = Uncertainty(first, inputs.solve(first, found.modes, found.direct))
        whole_at = linearise(whole, part.at.modes, part.at.direct)
        states = state_slopes(whole, whole_at)
        beyond = ~fitted
        columns, errors = whole_at.columns[:, beyond], []
        for channel, noise in enumerate(part.at.noise):
            left = whole.values[channel, beyond] - part.at.coefficients[:, channel] @ columns
            at = replace(whole_at, coefficients=part.at.coefficients)
            by_parameters = slopes_of(whole, at, channel, states)[:, beyond]
            # What the part does not tell of the model is no error of it.
            expected = noise**2 + np.minimum(
                part.errors.variance(channel, by_parameters.T, columns.T), MOST_UNTOLD * noise**2
            )
            errors.append(float(np.sqrt(np.mean(left**2 / expected))))
        return np.array(errors)


@dataclass(frozen=True, kw_only=True)
class Ambient(Excited):
    """A model and outputs alone, of excitation that nobody measured, beside measured inputs or without.

    `other` is a frequency far from that given with which the response seems to repeat [rad/s], zero where none;
    `as_read` are modes that were read from one block.
    """

    slip: ClassVar = 0.3  # no input has to meet its phase
    random: ClassVar = True

    fit: innovations.Fit
    other: float = 0.0
    as_read: Collection[int] = ()

    @property
    def residual(self) -> Floats:
        """The innovations of each output (outputs, samples)."""
        return self.fit.at.innovations

    def step(self) -> tuple[float, float]:
        """The step of the period by its score."""
        return innovations.period_step(self.fit)

    def phase_steps(self) -> list[tuple[float, float]]:
        """The step of the phase of each record after the first, in periods, and its deviation."""
        return [innovations.phase_step(self.fit, number) for number in range(1, len(self.own.records))]

    def vague_angles(self) -> tuple[Finding, ...]:
        """Findings on errors of the angle, over the variance of the innovations."""
        return shaken(self.own, self.fit.at.columns, np.sqrt(np.mean(self.residual**2, axis=1)))

    def seen(self) -> list[tuple[float, int]]:
        """Squared deviations of the shape of each mode from zero, and how many numbers it has."""
        return [self.fit.seen(number) for number in range(len(self.fit.at.modes))]

    def colour(self, _: Evidence) -> Colour:
        """The share of the innovations that is predictable, where chance does not explain it."""
        share, chance = innovations.colour(self.samples, self.fit.at)
        numbers = {"predictable": share} if chance < SURE else {}
        return Colour(size=share, limit=PREDICTABLE, failing=PREDICTABLE, numbers=numbers)

    def excitation(self) -> tuple[Finding, ...]:
        """Findings on modes that may be the excitation's own, or none."""
        std = self.model.exponent_std
        assert std is not None
        relative = std.real / np.abs(self.model.exponents.real)
        duration = self.samples.n_samples * self.samples.step
        return excitation_of(self.fit, self.model, relative, duration, self.as_read)

    def errors(self) -> Floats:
        """The rms of the innovations over that of the part fitted, on the last quarter of each record (outputs,)."""
        samples, found = self.samples, self.fit.at
        part, mask = first_part(samples)
        start = innovations.predicted(part, found.modes, found.columns, found.initial, found.whitening[mask])
        whole = None
        fitted = None if start is None else innovations.solve(part, start, rough=True)
        if fitted is not None:
            whole = innovations.predicted(samples, fitted.modes, fitted.columns, fitted.initial, growing=True)
        if fitted is None or whole is None:
            return np.full(len(samples.values), np.inf)
        expected = np.sqrt(np.mean(fitted.innovations**2, axis=1))
        return np.asarray(np.sqrt(np.mean(whole.innovations[:, ~mask] ** 2, axis=1)) / expected, np.float64)
