"""The model of a fit with inputs, with the deviations of all that it holds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from floquid._checks import Rebuilt
from floquid.core import Channel, Estimates, PeriodicModel, Provenance, modelled
from floquid.inputs._estimates import Errors, driven_of, estimates_of, selection_of, terms_of
from floquid.inputs._modes import InputMode
from floquid.inputs._samples import Samples
from floquid.inputs._solver import (
    Linearisation,
    covariance,
    linearise,
    normal_equations,
    slopes_of,
    solve,
    state_slopes,
)
from floquid.inputs._transfer import TransferFunctions, modal_transfer
from floquid.inputs.search import read_near_axis


@dataclass(frozen=True, eq=False)
class Uncertainty(Rebuilt):
    """Joint covariance of a fit: of its free parameters, and of what is linear in each channel.

    An error of coefficients is that of the parameters by slopes, and that of the channel's own noise.
    """

    samples: Samples
    at: Linearisation

    def __post_init__(self) -> None:
        for one in (self.samples, self.at, *self.at.modes):
            sealed(one)

    @cached_property
    def parameters(self) -> NDArray[np.float64]:
        """Covariance of the free parameters (parameters, parameters)."""
        return covariance(self.samples, self.at)

    @cached_property
    def slopes(self) -> NDArray[np.float64]:
        """Derivatives of the linear coefficients by the free parameters (channels, columns, parameters)."""
        states = state_slopes(self.samples, self.at)
        return np.array(
            [
                -self.at.inverse @ (self.at.columns @ slopes_of(self.samples, self.at, channel, states).T)
                for channel in range(len(self.samples.values))
            ]
        )

    def model(
        self,
        channels: Sequence[Channel],
        inputs: Sequence[Channel],
        provenance: Provenance,
        as_read: Mapping[int, complex] | None = None,
    ) -> PeriodicModel:
        """The periodic model of a fit, each mode with its conjugate, with deviations.

        Deviations of exponents near an axis are those `as_read`, by the numbers of their modes, where they are given.
        """
        at, samples = self.at, self.samples
        place, direct = at.slices()[-1][0].stop if at.modes else 0, {}
        for turn in map(int, at.direct):
            own = at.coefficients[place : place + (1 + (turn > 0)) * len(inputs)].T
            place += own.shape[1]
            direct[turn] = 0.5 * (own[:, : len(inputs)] + 1j * own[:, len(inputs) :]) if turn else own.astype(complex)
        firsts = [record.start for record in samples.records]
        modes = [
            replace(mode, initial=np.asarray(state[firsts], np.complex128))
            for mode, state in zip(at.modes, at.states, strict=True)
        ]
        return modelled(
            self.estimates,
            channels=channels,
            provenance=provenance,
            driven=driven_of(modes, inputs, direct, len(channels), samples.fundamental, samples.first_times),
            as_read=as_read,
        )

    def estimates_at(self, exponents: NDArray[np.complex128]) -> Estimates:
        """The estimates of a fit, linearised anew at exponents (modes,) [1/s].

        One step of Gauss and Newton from there, as `floquid.periodic.estimate_at` has it.
        """
        pairs = zip(self.at.modes, exponents.tolist(), strict=True)
        modes = [replace(mode, exponent=complex(value.real) if mode.real else value) for mode, value in pairs]
        here = Uncertainty(self.samples, linearise(self.samples, modes, self.at.direct))
        step = here.parameters @ normal_equations(here.samples, here.at)[1]
        return here.estimates.moved(selection_of(here.at.modes) @ step)

    def transfer(
        self,
        channels: Sequence[Channel],
        inputs: Sequence[Channel],
        frequencies_hz: NDArray[np.float64],
        harmonics: NDArray[np.int64],
        *,
        sampled: bool = False,
    ) -> TransferFunctions:
        """The harmonic transfer functions of a fit with their deviations, to first order in all of its parameters."""
        at, omega = self.at, 2.0 * np.pi * frequencies_hz
        fundamental, columns = self.samples.fundamental, len(at.columns)
        shape = (len(harmonics), len(inputs), len(omega))
        values = np.zeros((len(harmonics), len(channels), len(inputs), len(omega)), complex)
        by_parameters = np.zeros((len(self.parameters), len(channels), *shape), complex)
        by_columns = np.zeros((columns, *shape), complex)
        held = (self.samples.step, self.samples.hold) if sampled else None

        def transferred(mode: InputMode, amplitudes: NDArray[np.complex128]) -> NDArray[np.complex128]:
            parts = [
                modal_transfer(exponent, fundamental, (turns, c), (reach, b), harmonics, omega, held)
                for exponent, turns, c, reach, b in terms_of(mode, amplitudes, fundamental)
            ]
            return np.sum(parts, axis=0)

        for number, mode in enumerate(at.modes):
            own = at.shape(number).T
            values += transferred(mode, own)
            place, turning = at.slices()[number]
            for column in range(place.start, place.stop):
                unit = np.zeros((1, len(mode.turns)), complex)
                later = column - place.start - len(turning)
                unit[0, column - place.start if later < 0 else np.flatnonzero(turning)[later]] = (
                    1.0 if later < 0 else 1j
                )
                by_columns[column] = transferred(mode, unit)[:, 0]
            where, free = self.places[number]
            for parameter, index in zip(range(where.start, where.stop), np.flatnonzero(free), strict=True):
                step = np.zeros(len(free))
                step[index] = 1e-3 * np.sqrt(self.parameters[parameter, parameter])
                moved = transferred(mode.moved(step), own) - transferred(mode.moved(-step), own)
                by_parameters[parameter] = np.moveaxis(moved, 1, 0) / (2.0 * step[index])
        _add_direct(at, harmonics, values, by_columns, len(inputs))
        std = np.zeros_like(values)
        for channel in range(len(channels)):
            flat = np.asarray(by_parameters[:, channel].reshape(len(by_parameters), -1).T, np.complex128)
            linear = np.asarray(by_columns.reshape(columns, -1).T, np.complex128)
            real = self.variance(channel, flat.real, linear.real)
            imag = self.variance(channel, flat.imag, linear.imag)
            std[:, channel] = (np.sqrt(real) + 1j * np.sqrt(imag)).reshape(shape)
        return TransferFunctions(
            frequencies_hz=frequencies_hz,
            harmonics=harmonics,
            values=values,
            std=std,
            outputs=tuple(channels),
            inputs=tuple(inputs),
            step=self.samples.step if sampled else None,
        )

    def drawn(self, generator: np.random.Generator) -> NDArray[np.float64]:
        """Outputs made of the fit, with noise of its size (outputs, samples)."""
        clean = self.at.coefficients.T @ self.at.columns
        return np.asarray(clean + self.at.noise[:, None] * generator.standard_normal(clean.shape))

    def refitted(self, values: NDArray[np.float64]) -> Uncertainty:
        """Fit these modes and harmonics to other outputs (outputs, samples) at the same inputs."""
        samples = replace(self.samples, values=values)
        return Uncertainty(samples, read_near_axis(samples, solve(samples, self.at.modes, self.at.direct)).at)

    def variance(self, channel: int, by_parameters: NDArray, by_columns: NDArray) -> NDArray[np.float64]:
        """The variance of real quantities of one channel, by (quantities, parameters) and (quantities, columns)."""
        whole = by_parameters + by_columns @ self.slopes[channel]
        own = np.sum((by_columns @ self.at.inverse) * by_columns, axis=1) * self.at.noise[channel] ** 2
        return np.maximum(np.sum((whole @ self.parameters) * whole, axis=1) + own, 0.0)

    @cached_property
    def places(self) -> list[tuple[slice, NDArray[np.bool_]]]:
        """Of each mode, the place of its parameters, and the mask of those that are free."""
        found, place = [], 0
        for mode in self.at.modes:
            stop = place + int(mode.free.sum())
            found.append((slice(place, stop), mode.free))
            place = stop
        return found

    @cached_property
    def estimates(self) -> Estimates:
        """Exponents, shapes and gains with their joint covariance."""
        at = self.at
        errors = Errors(
            parameters=self.parameters,
            slopes=self.slopes,
            spread=at.inverse[None],
            blocks=np.zeros(len(at.noise), np.int64),
            scales=at.noise,
        )
        shapes = [at.shape(number).T for number in range(len(at.modes))]
        return estimates_of(at.modes, shapes, errors, self.samples.fundamental)


def sealed(one: Any) -> None:
    """Make the arrays of an object read-only: from here on they are a result."""
    for field in fields(one):
        value = getattr(one, field.name)
        for array in value if isinstance(value, tuple) else (value,):
            if isinstance(array, np.ndarray):
                array.flags.writeable = False


def _add_direct(
    at: Linearisation, harmonics: NDArray[np.int64], values: NDArray, by_columns: NDArray, inputs: int
) -> None:
    """The direct term in transfer functions, and in their derivatives by its columns."""
    place = at.slices()[-1][0].stop if at.modes else 0
    for turn in at.direct:
        for unit in (1.0, 1j) if turn else (1.0,):
            for number in range(inputs):
                for sign, value in ((1, unit), (-1, np.conj(unit))) if turn else ((1, unit),):
                    share = (0.5 if turn else 1.0) * value
                    rows = harmonics == sign * int(turn)
                    by_columns[place, rows, number] += share
                    values[rows, :, number] += share * at.coefficients[place][None, :, None]
                place += 1
