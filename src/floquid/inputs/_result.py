"""The model of a fit with inputs, with the deviations of all that it holds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, Protocol, TypeAlias

import numpy as np

from floquid._arrays import Complexes, Floats, Integers, Mask
from floquid._checks import Rebuilt
from floquid.core import Channel, Estimates, PeriodicModel, Provenance, modelled
from floquid.inputs._estimates import Errors, driven_of, estimates_of, selection_of
from floquid.inputs._modes import InputMode
from floquid.inputs._samples import Samples
from floquid.inputs._solver import Equations, Linearisation, covariance_of, linearise, normal_equations, solve
from floquid.inputs._transfer import Grid, TransferFunctions, transfer_of
from floquid.inputs.search import Passed, Scores, passed, read_near_axis, unmeasured
from floquid.search import GAP

TransferParts: TypeAlias = tuple[Sequence[InputMode], list[Complexes], Errors, Sequence[Mask] | None]
"""Modes, their shapes, errors, and masks of what is free (all where None)."""


class FitParts(Protocol):
    """Parts of a fit of either kind by which its model and its transfer functions are made."""

    @property
    def samples(self) -> Samples: ...
    @property
    def at(self) -> Any: ...
    @property
    def input_modes(self) -> list[InputMode]: ...
    @property
    def estimates(self) -> Estimates: ...
    def estimates_at(self, exponents: Complexes) -> Estimates: ...
    def direct(self, inputs: int) -> dict[int, Complexes]: ...
    def transfer_parts(self) -> TransferParts: ...


class DrivenFit(Rebuilt):
    """A fit of records whose excitation goes on: its model and transfer functions, by `estimates` and errors it has."""

    def model(
        self: FitParts,
        channels: Sequence[Channel],
        inputs: Sequence[Channel],
        provenance: Provenance,
        as_read: Mapping[int, complex] | None = None,
    ) -> PeriodicModel:
        """The periodic model of a fit, each mode with its conjugate, with deviations."""
        samples, size = self.samples, len(channels)
        return modelled(
            self.estimates,
            unselected=self.estimates_at(np.array([mode.exponent for mode in self.at.modes])),
            channels=channels,
            provenance=provenance,
            driven=driven_of(
                self.input_modes, inputs, self.direct(len(inputs)), size, samples.fundamental, samples.first_times
            ),
            as_read=as_read,
        )

    def transfer(
        self: FitParts,
        channels: Sequence[Channel],
        inputs: Sequence[Channel],
        frequencies_hz: Floats,
        harmonics: Integers,
        *,
        sampled: bool = False,
    ) -> TransferFunctions:
        """The harmonic transfer functions of a fit with their deviations, to first order in all of its parameters."""
        grid = Grid(
            omega=2.0 * np.pi * frequencies_hz,
            harmonics=harmonics,
            fundamental=self.samples.fundamental,
            held=(self.samples.step, self.samples.hold) if sampled else None,
        )
        modes, shapes, errors, free = self.transfer_parts()
        return transfer_of(grid, modes, shapes, self.direct(len(inputs)), errors, (channels, inputs), free)


@dataclass(frozen=True, eq=False)
class Uncertainty(DrivenFit):
    """Joint covariance of a fit: of its free parameters, and of what is linear in each channel.

    An error of coefficients is that of the parameters by slopes, and that of the channel's own noise.
    """

    samples: Samples
    at: Linearisation

    def __post_init__(self) -> None:
        for one in (self.samples, self.at, *self.at.modes):
            sealed(one)

    @cached_property
    def equations(self) -> Equations:
        """The normal equations of the fit."""
        return normal_equations(self.samples, self.at)

    @cached_property
    def of_white(self) -> Floats:
        """Covariance of the free parameters where noise is white: the inverse of their information."""
        return covariance_of(self.samples, self.at, self.equations.matrix)

    @cached_property
    def parameters(self) -> Floats:
        r"""Covariance of the free parameters (parameters, parameters), noise that drives the modes counted.

        .. math:: H^{-1} (H + \sum_r P_r\, G\, \Sigma_r\, G^T) H^{-1}

        with G the slopes of the parameters beside the columns (White 1982).
        """
        if not self._driven:
            return self.of_white
        more = (variance * own.of_parameters for variance, own in self._spreads)
        return self.of_white + self.of_white @ sum(more) @ self.of_white

    @cached_property
    def _scores(self) -> Scores:
        return Scores(self.samples, self.at, rough=False)

    @cached_property
    def _driven(self) -> list[tuple[int, float]]:
        """The modes that noise drives, and its variance."""
        return [(number, own) for number, own in enumerate(unmeasured(self._scores).tolist()) if own > 0.0]

    @cached_property
    def _spreads(self) -> list[tuple[float, Passed]]:
        """Variances of noise that drives modes, and products of the slopes and columns with what it leaves."""
        numbers, variances = zip(*self._driven, strict=True)
        return list(zip(variances, passed(self._scores, self.equations, numbers), strict=True))

    @cached_property
    def slopes(self) -> Floats:
        """Derivatives of the linear coefficients by the free parameters (channels, columns, parameters)."""
        return -self.at.inverse @ (self.equations.along * self.at.noise[:, None, None]).swapaxes(1, 2)

    @property
    def input_modes(self) -> list[InputMode]:
        """The modes with their states at the start of each record."""
        firsts = [record.start for record in self.samples.records]
        return [
            replace(mode, initial=np.asarray(state[firsts], np.complex128))
            for mode, state in zip(self.at.modes, self.at.states, strict=True)
        ]

    def transfer_parts(self) -> TransferParts:
        """Modes with their shapes and errors, as transfer functions are made of them."""
        return self.at.modes, self.shapes, self.errors, None

    def estimates_at(self, exponents: Complexes) -> Estimates:
        """The estimates of a fit with several harmonics more of each mode, linearised at exponents (modes,) [1/s]."""
        # One step of Gauss and Newton from there, as `floquid.periodic.estimate_at` has it.
        pairs, highest = zip(self.at.modes, exponents.tolist(), strict=True), self.samples.highest
        modes = [replace(mode, exponent=complex(value.real) if mode.real else value) for mode, value in pairs]
        modes = [mode.padded("turns", GAP, highest) for mode in modes]
        here = Uncertainty(self.samples, linearise(self.samples, modes, self.at.direct))
        step = here.of_white @ here.equations.gradient
        return here.estimates.moved(selection_of(here.at.modes) @ step)

    @property
    def stored(self) -> dict[str, tuple[Any, str]]:
        """Arrays by which a file makes the fit again, beside its modes, with their axes."""
        return {"direct": (self.at.direct, "harmonics")}

    def direct(self, inputs: int) -> dict[int, Complexes]:
        """D (outputs, inputs) by harmonics from 0 on."""
        place, found = self.at.slices()[-1][0].stop if self.at.modes else 0, {}
        for turn in map(int, self.at.direct):
            own = self.at.coefficients[place : place + (1 + (turn > 0)) * inputs].T
            place += own.shape[1]
            found[turn] = 0.5 * (own[:, :inputs] + 1j * own[:, inputs:]) if turn else own.astype(complex)
        return found

    def drawn(self, generator: np.random.Generator) -> Floats:
        """Outputs made of the fit, with noise of its size (outputs, samples)."""
        clean = self.at.columns.response(self.at.coefficients)
        return np.asarray(clean + self.at.noise[:, None] * generator.standard_normal(clean.shape))

    def refitted(self, values: Floats) -> Uncertainty:
        """Fit these modes and harmonics to other outputs (outputs, samples) at the same inputs."""
        samples = replace(self.samples, values=self.samples.kept(values))
        return Uncertainty(samples, read_near_axis(samples, solve(samples, self.at.modes, self.at.direct)).at)

    @cached_property
    def places(self) -> list[tuple[slice, Mask]]:
        """The place of the parameters of each mode, and the mask of those that are free."""
        found, place = [], 0
        for mode in self.at.modes:
            stop = place + int(mode.free.sum())
            found.append((slice(place, stop), mode.free))
            place = stop
        return found

    @cached_property
    def errors(self) -> Errors:
        """Errors of the free parameters, and of the columns of each output."""
        spread, outputs = self.at.inverse[None], len(self.at.noise)
        if self._driven:
            spread = np.array([self._of_columns(channel) for channel in range(outputs)])
        return Errors(
            parameters=self.parameters,
            slopes=self.slopes,
            spread=spread,
            blocks=np.arange(outputs) if self._driven else np.zeros(outputs, np.int64),
            scales=self.at.noise,
        )

    def _of_columns(self, channel: int) -> Floats:
        """Covariance of the coefficients of an output over its noise, beside that of the parameters."""
        more = sum(variance * own.of_columns[channel] for variance, own in self._spreads)
        return self.at.inverse + self.at.inverse @ more @ self.at.inverse

    @property
    def shapes(self) -> list[Complexes]:
        """Amplitudes 2 c of each mode (outputs, turns)."""
        return [self.at.shape(number).T for number in range(len(self.at.modes))]

    @cached_property
    def estimates(self) -> Estimates:
        """Exponents, shapes and gains with their joint covariance."""
        return estimates_of(self.at.modes, self.shapes, self.errors, self.samples.fundamental)


def sealed(one: Any) -> None:
    """Make the arrays of an object read-only: from here on they are a result."""
    for field in fields(one):
        value = getattr(one, field.name)
        for array in value if isinstance(value, tuple) else (value,):
            if isinstance(array, np.ndarray):
                array.flags.writeable = False
