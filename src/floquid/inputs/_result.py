"""The model of a fit with inputs, with the deviations of all that it holds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from floquid._checks import Rebuilt
from floquid.core import Channel, ModelInputs, PeriodicModel, Provenance, with_deviations
from floquid.inputs._modes import InputMode
from floquid.inputs._samples import Samples
from floquid.inputs._solver import Linearisation, covariance, slopes_of, state_slopes
from floquid.inputs._transfer import TransferFunctions, modal_transfer

Term = tuple[complex, NDArray[np.int64], NDArray[np.complex128], NDArray[np.int64], NDArray[np.complex128]]
"""λ, the harmonics m, c (outputs, harmonics), the harmonics l, b (inputs, harmonics)."""


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

    def spread_over(self, number: int, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Rows of numbers, one a parameter of a mode free or not, among the free ones of all (rows, parameters)."""
        found = np.zeros((len(values), len(self.parameters)))
        place, free = self.places[number]
        found[:, place] = values[:, free]
        return found


def sealed(one: Any) -> None:
    """Make the arrays of an object read-only: from here on they are a result."""
    for field in fields(one):
        value = getattr(one, field.name)
        for array in value if isinstance(value, tuple) else (value,):
            if isinstance(array, np.ndarray):
                array.flags.writeable = False


def model_of(
    found: Uncertainty,
    channels: Sequence[Channel],
    inputs: Sequence[Channel],
    provenance: Provenance,
    as_read: Mapping[int, complex] | None = None,
) -> PeriodicModel:
    """The periodic model of a fit, each mode with its conjugate, with deviations.

    Deviations of exponents near an axis are those `as_read`, by the numbers of their modes, where they are given.
    """
    at, read = found.at, as_read or {}
    std = [read.get(k, complex(np.nan, np.nan)) for k, mode in enumerate(at.modes) for _ in range(2 - mode.real)]
    turns = _all_of([np.array([-turn, turn], np.int64) for turn in map(int, at.direct)])
    model = assembled(
        [_part_of(found, number) for number in range(len(at.modes))],
        found.parameters,
        2.0 * np.pi / found.samples.fundamental,
        channels,
        inputs,
        (turns, _direct(at, len(channels), len(inputs), turns)),
        provenance,
    )
    assert model.covariance is not None
    return replace(model, covariance=with_deviations(model.covariance, np.array(std))) if read else model


def assembled(
    parts: Sequence[Part],
    spread: NDArray[np.float64],
    period: float,
    channels: Sequence[Channel],
    inputs: Sequence[Channel],
    direct: tuple[NDArray[np.int64], NDArray[np.complex128]],
    provenance: Provenance,
) -> PeriodicModel:
    """The periodic model of modes, of pairs both, with the covariance of all parameters (parameters, parameters).

    `direct` are the harmonics n and D (outputs, inputs, harmonics). Without inputs the model has none.
    """
    order = sum(1 if part.real else 2 for part in parts)
    harmonics = _all_of([sign * part.harmonics for part in parts for sign in (1, -1)])
    reach = _all_of([sign * part.reach for part in parts for sign in (1, -1)])
    coefficients = np.zeros((order, len(channels), 1, len(harmonics)), complex)
    coefficient_std = np.zeros_like(coefficients)
    gains = np.zeros((order, len(inputs), len(reach)), complex)
    gain_std = np.zeros_like(gains)
    initial = np.zeros((order, len(parts[0].initial) if parts else 0), complex)
    exponents, rows = np.zeros(order, complex), np.zeros((2 * order, len(spread)))
    place = 0
    for part in parts:
        for conjugate in (False,) if part.real else (False, True):
            sign = -1 if conjugate else 1
            where = np.searchsorted(harmonics, sign * part.harmonics)
            coefficients[place][:, 0, where] = part.coefficients.conj() if conjugate else part.coefficients
            coefficient_std[place][:, 0, where] = part.coefficient_std
            where = np.searchsorted(reach, sign * part.reach)
            gains[place][:, where] = part.gains.conj() if conjugate else part.gains
            gain_std[place][:, where] = part.gain_std
            exponents[place] = part.exponent.conjugate() if conjugate else part.exponent
            initial[place] = part.initial.conj() if conjugate else part.initial
            rows[place], rows[order + place] = part.rows[0], sign * part.rows[1]
            place += 1
    own = None
    if inputs:
        own = ModelInputs(
            channels=tuple(inputs),
            coefficients=gains,
            harmonics=reach,
            coefficient_std=gain_std,
            direct=direct[1],
            direct_harmonics=direct[0],
            initial=initial,
        )
    return PeriodicModel(
        exponents=exponents,
        coefficients=coefficients,
        harmonics=harmonics,
        period=period,
        channels=channels,
        covariance=rows @ spread @ rows.T,
        coefficient_std=coefficient_std,
        provenance=provenance,
        inputs=own,
    )


def _all_of(parts: Sequence[NDArray[np.int64]]) -> NDArray[np.int64]:
    """Every whole number from the least to the largest of some (numbers,)."""
    both = np.concatenate([np.zeros(0, np.int64), *parts])
    return np.arange(both.min(), both.max() + 1) if len(both) else both


def _direct(at: Linearisation, channels: int, inputs: int, turns: NDArray[np.int64]) -> NDArray[np.complex128]:
    """D (channels, inputs, harmonics) of the columns of the direct term."""
    found = np.zeros((channels, inputs, len(turns)), complex)
    place = at.slices()[-1][0].stop if at.modes else 0
    for turn in at.direct:
        real = at.coefficients[place : place + inputs].T
        place += inputs
        if not turn:
            found[:, :, turns == 0] += real[:, :, None]
            continue
        value = 0.5 * (real + 1j * at.coefficients[place : place + inputs].T)
        place += inputs
        found[:, :, turns == turn] += value[:, :, None]
        found[:, :, turns == -turn] += value.conj()[:, :, None]
    return found


def _part_of(found: Uncertainty, number: int) -> Part:
    """A mode of the fit as a model lists it."""
    at, mode = found.at, found.at.modes[number]
    shape, (columns, turning) = at.shape(number).T, at.slices()[number]
    size, width = mode.gains.size, len(mode.free)
    unit = np.eye(width)
    std = np.zeros(shape.shape, complex)
    for channel in range(len(shape)):
        by = np.zeros((columns.stop - columns.start, len(at.columns)))
        by[:, columns] = np.eye(len(by))
        both = np.sqrt(found.variance(channel, np.zeros((len(by), len(found.parameters))), by))
        std[channel] = both[: len(turning)]
        std[channel, turning] += 1j * both[len(turning) :]
    place, free = found.places[number]
    spread = np.zeros(width)
    spread[free] = np.sqrt(np.diag(found.parameters)[place])
    later = 1 + size if mode.real else 1 + width // 2
    gain_std = (spread[1 : 1 + size] + 1j * spread[later : later + size]).reshape(mode.gains.shape)
    imag = (
        np.zeros((1, len(found.parameters)))
        if mode.real
        else found.spread_over(number, unit[width // 2 : width // 2 + 1])
    )
    rows = np.concatenate([found.spread_over(number, unit[:1]), imag])
    samples = found.samples
    return listed(mode, (shape, std), gain_std, rows, samples.fundamental, samples.first_times)


@dataclass(frozen=True, eq=False)
class Part:
    """One mode as a model lists it: a pair once, a real multiplier with all its harmonics."""

    real: bool
    exponent: complex
    rows: NDArray[np.float64]
    """Derivatives of Re λ and Im λ by the parameters of the fit (2, parameters)."""
    harmonics: NDArray[np.int64]
    coefficients: NDArray[np.complex128]
    coefficient_std: NDArray[np.complex128]
    reach: NDArray[np.int64]
    gains: NDArray[np.complex128]
    gain_std: NDArray[np.complex128]
    initial: NDArray[np.complex128]


def listed(
    mode: InputMode,
    shape: tuple[NDArray[np.complex128], NDArray[np.complex128]],
    gain_std: NDArray[np.complex128],
    rows: NDArray[np.float64],
    fundamental: float,
    begins: NDArray[np.float64],
) -> Part:
    """A mode as a model lists it, of amplitudes 2 c and their deviations (outputs, turns), and those of its gains.

    `begins` are the times at which the records begin.
    """
    initial, std = mode.initial, 0.5 * shape[1]
    exponent, harmonics, coefficients, reach, gains = terms_of(mode, shape[0], fundamental)[0]
    if mode.real:
        begin = mode.turns[0] % 1.0
        std = _mirrored(mode.turns, shape[1], -begin, deviations=True)[1]
        gain_std = _mirrored(mode.reach, gain_std, begin, deviations=True)[1]
        initial = initial * np.exp(1j * begin * fundamental * begins)
    return Part(mode.real, exponent, rows, harmonics, coefficients, std, reach, gains, gain_std, initial)


def _mirrored(
    turns: NDArray[np.float64], values: NDArray[np.complex128], shift: float, *, deviations: bool = False
) -> tuple[NDArray[np.int64], NDArray[np.complex128]]:
    """Harmonics of a real signal's amplitudes (rows, turns), those below zero too, all moved by a shift."""
    down = turns > 0.0
    own = np.where(down, 0.5, 1.0) * values
    both = np.concatenate([-turns[down][::-1], turns]) + shift
    below = own[:, down][:, ::-1]
    found = np.concatenate([below if deviations else below.conj(), own], axis=1)
    return np.rint(both).astype(np.int64), found


def terms_of(mode: InputMode, shape: NDArray[np.complex128], fundamental: float) -> list[Term]:
    """A mode of a fit as modes of a model, with amplitudes 2 c (outputs, turns): a pair as two."""
    if mode.real:
        begin = mode.turns[0] % 1.0
        seen, reached = _mirrored(mode.turns, shape, -begin), _mirrored(mode.reach, mode.gains, begin)
        return [(mode.exponent.real + 1j * begin * fundamental, *seen, *reached)]
    turns, reach = mode.turns.astype(np.int64), mode.reach.astype(np.int64)
    return [
        (mode.exponent, turns, 0.5 * shape, reach, mode.gains),
        (
            mode.exponent.conjugate(),
            -turns[::-1],
            0.5 * shape.conj()[:, ::-1],
            -reach[::-1],
            mode.gains.conj()[:, ::-1],
        ),
    ]


def transfer_of(
    found: Uncertainty,
    channels: Sequence[Channel],
    inputs: Sequence[Channel],
    frequencies_hz: NDArray[np.float64],
    harmonics: NDArray[np.int64],
    *,
    sampled: bool = False,
) -> TransferFunctions:
    """The harmonic transfer functions of a fit with their deviations, to first order in all of its parameters."""
    at, omega = found.at, 2.0 * np.pi * frequencies_hz
    fundamental, columns = found.samples.fundamental, len(at.columns)
    shape = (len(harmonics), len(inputs), len(omega))
    values = np.zeros((len(harmonics), len(channels), len(inputs), len(omega)), complex)
    by_parameters = np.zeros((len(found.parameters), len(channels), *shape), complex)
    by_columns = np.zeros((columns, *shape), complex)
    held = (found.samples.step, found.samples.hold) if sampled else None

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
            unit[0, column - place.start if later < 0 else np.flatnonzero(turning)[later]] = 1.0 if later < 0 else 1j
            by_columns[column] = transferred(mode, unit)[:, 0]
        where, free = found.places[number]
        for parameter, index in zip(range(where.start, where.stop), np.flatnonzero(free), strict=True):
            step = np.zeros(len(free))
            step[index] = 1e-3 * np.sqrt(found.parameters[parameter, parameter])
            moved = transferred(mode.moved(step), own) - transferred(mode.moved(-step), own)
            by_parameters[parameter] = np.moveaxis(moved, 1, 0) / (2.0 * step[index])
    _add_direct(at, harmonics, values, by_columns, len(inputs))
    std = np.zeros_like(values)
    for channel in range(len(channels)):
        flat = np.asarray(by_parameters[:, channel].reshape(len(by_parameters), -1).T, np.complex128)
        linear = np.asarray(by_columns.reshape(columns, -1).T, np.complex128)
        real = found.variance(channel, flat.real, linear.real)
        imag = found.variance(channel, flat.imag, linear.imag)
        std[:, channel] = (np.sqrt(real) + 1j * np.sqrt(imag)).reshape(shape)
    return TransferFunctions(
        frequencies_hz=frequencies_hz,
        harmonics=harmonics,
        values=values,
        std=std,
        outputs=tuple(channels),
        inputs=tuple(inputs),
        step=found.samples.step if sampled else None,
    )


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
