"""Records whose excitation goes on, as checks ask them: measured inputs, and outputs alone."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property
from types import ModuleType
from typing import Any, ClassVar

import numpy as np

from floquid import innovations, inputs
from floquid._arrays import Floats
from floquid.checks._check import Evidence, Subject
from floquid.checks._driving import undriven
from floquid.checks._excitation import excitation_of
from floquid.checks._left_out import FAILING, LeftOut, first_part, without_last
from floquid.checks._modes import undetermined_of
from floquid.checks._period import Off, shaken
from floquid.checks._residual import STRONG_COLOUR, Colour
from floquid.core import Channel, PeriodicModel, Record
from floquid.findings import Finding
from floquid.fit import NOT_WHITE, SIGNIFICANT, SURE
from floquid.inputs import Limits, Samples, Scores, Uncertainty, linearise, numbers_of, slopes_in_parts, slopes_of
from floquid.sync import ShaftAngle

PREDICTABLE = 0.03
"""The share of the variance of the innovations that is predictable from those before, from which on a model fails."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Parted:
    """Samples of records whose excitation goes on, and their channels."""

    records: tuple[Record, ...]
    samples: Samples  # outputs and inputs, one record after another
    outputs: tuple[Channel, ...]
    inputs: tuple[Channel, ...]
    turns: tuple[float, ...]  # harmonics of the period that are fitted beside the modes, those of the revolution too
    shafts: tuple[ShaftAngle, ...]  # none where the period is constant
    periods_per_revolution: float  # as the clock of the record has them, or the settings
    findings: tuple[Finding, ...]  # on these harmonics


@dataclass(frozen=True, kw_only=True)
class Excited(Subject):
    """A model and the records whose excitation goes on, with the limits of its search."""

    of_verdict: ClassVar = frozenset(("left out",))
    predicted: ClassVar = {"held_out_error": FAILING}
    chain: ClassVar[ModuleType]  # the room that has its score tests
    slip: ClassVar[float]  # periods by which one may be off over a record, and its own be told to first order
    random: ClassVar[bool] = False  # True where nobody measured all that drives the system

    own: Parted
    model: PeriodicModel
    limits: Limits
    turning: bool = True  # lines of the revolution are looked for

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of outputs, and of columns of the noise: one."""
        return len(self.own.outputs), 1

    @property
    def tested(self) -> Any:
        """Score tests of the fit, or the fit that makes them itself."""
        raise NotImplementedError

    def errors(self) -> Floats:
        """The rms error on the last quarter of each record, by a fit to the rest, over what is expected (outputs,)."""
        raise NotImplementedError

    def period_off(self) -> Off | None:
        """The step of the period by its score; None where a shaft tells it."""
        if self.own.shafts:
            return None
        step, std = self.chain.period_step(self.tested)
        if abs(step) <= SIGNIFICANT * std:
            return None
        longest = max(record.stop - record.start for record in self.own.samples.records) * self.own.samples.step
        near = abs(step) * longest / self.model.period <= self.slip
        return Off(relative=step, std=std, deviations=abs(step) / std, limit=SIGNIFICANT, near=near)

    def phase_steps(self) -> list[tuple[float, float]]:
        """The step of the phase of each record after the first, in periods, and its deviation."""
        return [self.chain.phase_step(self.tested, number) for number in range(1, len(self.own.records))]

    def undriven(self) -> tuple[Finding, ...]:
        """Finding on inputs whose way to the modes is not determined."""
        return undriven(self.model)

    def left_out(self) -> LeftOut:
        """The last quarter of each record, predicted by a fit to the rest."""
        errors = self.errors()
        worst = int(np.argmax(errors))
        size, channel = float(errors[worst]), self.own.outputs[worst].name
        return LeftOut(
            arrays={"held_out_error": np.where(np.isfinite(errors), errors, np.nan)[:, None]},
            sizes={"held_out_error": (size, FAILING, None)},
            numbers={"ratio": size, "part": "last quarter", "channel": channel, "hit": 0},
        )


@dataclass(frozen=True, kw_only=True)
class Driven(Excited):
    """A model and the response to measured inputs; `most` are the harmonics looked for, None where it has all."""

    chain: ClassVar = inputs
    slip: ClassVar = 0.05  # inputs then meet their phase yet

    fit: Uncertainty
    most: int | None = None

    @cached_property
    def tested(self) -> Scores:
        """Score tests of the fit."""
        return Scores(self.own.samples, self.fit.at, rough=False)

    @property
    def residual(self) -> Floats:
        """The residual of each output (outputs, samples)."""
        return self.fit.at.left

    @property
    def coloured(self) -> bool:
        """True where the residual is not white."""
        return self.fit.at.colour > NOT_WHITE

    def vague_angles(self) -> tuple[Finding, ...]:
        """Findings on errors of the angle, over the variance of the residual."""
        at = self.fit.at
        return shaken(self.own, at.coefficients[-len(self.own.samples.known) :].T, at.noise) if self.own.shafts else ()

    def seen(self) -> list[tuple[float, int]]:
        """Squared deviations of the shape of each mode from zero, and how many numbers it has; none of free phases."""
        if self.most is None:
            return []
        columns, channels = self.tested.now.slices(), len(self.tested.left)
        sizes = [channels * (columns_of_mode.stop - columns_of_mode.start) for columns_of_mode, _ in columns]
        return list(zip(self.tested.of_modes.tolist(), sizes, strict=True))

    def colour(self, _: Evidence) -> Colour:
        """The most correlations of one output."""
        size = float(self.fit.at.colour)
        numbers = {"squares": [size]} if self.coloured else {}
        return Colour(size=size, limit=NOT_WHITE, failing=STRONG_COLOUR, numbers=numbers)

    def undetermined(self) -> tuple[Finding, ...]:
        """Finding on decays that are not determined."""
        return undetermined_of(self.model)

    def errors(self) -> Floats:
        r"""The rms error on the last quarter of each record, by a fit to the rest, over what is expected (outputs,).

        Expected are the noise, and what the deviations of that fit make of the prediction:

        .. math:: \frac{1}{n} r^T (\sigma^2 + J P J^T)^{-1} r
        """
        whole, fitted_model = self.own.samples, self.fit.at
        first, fitted = without_last(whole)
        part = Uncertainty(first, inputs.solve(first, fitted_model.modes, fitted_model.direct))
        whole_at = linearise(whole, part.at.modes, part.at.direct)
        whole_at = replace(whole_at, coefficients=part.at.coefficients)
        beyond, outputs = ~fitted & whole.there, range(len(part.at.noise))
        roots = [part.errors.root(output) for output in outputs]
        # An error of one parameter goes through all samples: it counts once.
        squares, pulls = np.zeros(len(outputs)), [np.zeros(own.shape[1]) for own in roots]
        inner = [np.zeros((len(own), len(own))) for own in pulls]
        for piece in slopes_in_parts(whole, whole_at.modes, whole_at.states, numbers_of(whole_at)):
            here, used = piece.alone, beyond[piece.own]
            columns = whole_at.columns.of(here.samples, piece.own)
            for output in outputs if used.any() else ():
                slopes = slopes_of(here.samples, whole_at, output, here.rows)
                untold = np.concatenate([slopes, columns])[:, used].T @ roots[output]
                residual = whole.values[output, piece.own] - whole_at.coefficients[:, output] @ columns
                squares[output] += float(np.sum(residual[used] ** 2))
                pulls[output] += untold.T @ residual[used]
                inner[output] += untold.T @ untold
        errors = []
        for square, pull, matrix, noise in zip(squares, pulls, inner, part.at.noise, strict=True):
            left = square - pull @ np.linalg.solve(matrix + noise**2 * np.eye(len(pull)), pull)
            errors.append(float(np.sqrt(max(left, 0.0) / noise**2 / beyond.sum())))
        return np.array(errors)


@dataclass(frozen=True, kw_only=True)
class Ambient(Excited):
    """A model and outputs alone, of excitation that nobody measured, beside measured inputs or without.

    `other` is a frequency far from that given with which the response seems to repeat [rad/s], zero where none;
    `as_read` are modes that were read from one block.
    """

    chain: ClassVar = innovations
    slip: ClassVar = 0.3  # no input has to meet its phase
    random: ClassVar = True

    fit: innovations.Fit
    other: float = 0.0
    as_read: Collection[int] = ()

    @property
    def residual(self) -> Floats:
        """The innovations of each output (outputs, samples)."""
        return self.fit.at.level

    @property
    def tested(self) -> innovations.Fit:
        """The fit."""
        return self.fit

    def vague_angles(self) -> tuple[Finding, ...]:
        """Findings on errors of the angle, over the variance of the innovations."""
        size = self.fit.at.noise[:, 0]
        return shaken(self.own, self.fit.at.columns, size) if self.own.shafts else ()

    def seen(self) -> list[tuple[float, int]]:
        """Squared deviations of the shape of each mode from zero, and how many numbers it has."""
        return [self.fit.seen(number) for number in range(len(self.fit.at.modes))]

    def colour(self, _: Evidence) -> Colour:
        """The share of the innovations that is predictable, where chance does not explain it."""
        share, chance = innovations.colour(self.own.samples, self.fit.at)
        numbers = {"predictable": share} if chance < SURE else {}
        return Colour(size=share, limit=PREDICTABLE, failing=PREDICTABLE, numbers=numbers)

    def excitation(self) -> tuple[Finding, ...]:
        """Findings on modes that may be the excitation's own, or none."""
        std = self.model.exponent_std
        assert std is not None
        relative = std.real / np.abs(self.model.exponents.real)
        duration = self.own.samples.count * self.own.samples.step
        return excitation_of(self.fit, self.model, relative, duration, self.as_read)

    def errors(self) -> Floats:
        """The rms of the innovations over that of the part fitted, on the last quarter of each record (outputs,)."""
        samples, fitted_model = self.own.samples, self.fit.at
        part, mask = first_part(samples)
        start = innovations.predicted(
            part, fitted_model.modes, fitted_model.columns, fitted_model.initial, fitted_model.whitening[mask]
        )
        whole = None
        fitted = None if start is None else innovations.solve(part, start, rough=True)
        if fitted is not None:
            whole = innovations.predicted(samples, fitted.modes, fitted.columns, fitted.initial, growing=True)
        if fitted is None or whole is None:
            return np.full(len(samples.values), np.inf)
        beyond = whole.level[:, ~mask & samples.there]
        return np.asarray(np.sqrt(np.mean(beyond**2, axis=1)) / fitted.noise[:, 0], np.float64)
