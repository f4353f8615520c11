"""The model of a fit with inputs, with the deviations of all that it holds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from floquid.core import Channel, ModelInputs, PeriodicModel, Provenance
from floquid.inputs._modes import InputMode
from floquid.inputs._parts import Part, parts_of, terms_of
from floquid.inputs._solver import Linearisation
from floquid.inputs._transfer import TransferFunctions, modal_transfer
from floquid.inputs._uncertainty import Uncertainty


def model_of(
    found: Uncertainty, channels: Sequence[Channel], inputs: Sequence[Channel], provenance: Provenance
) -> PeriodicModel:
    """The periodic model of a fit, each mode with its conjugate, with deviations."""
    at = found.at
    turns = _all_of([np.array([-turn, turn], np.int64) for turn in map(int, at.direct)])
    return assembled(
        [part for number in range(len(at.modes)) for part in parts_of(found, number)],
        found.parameters,
        2.0 * np.pi / found.samples.fundamental,
        channels,
        inputs,
        (turns, _direct(at, len(channels), len(inputs), turns)),
        provenance,
    )


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
    exponents, rows, more = np.zeros(order, complex), np.zeros((2 * order, len(spread))), np.zeros(2 * order)
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
            more[[place, order + place]] = part.more
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
        covariance=rows @ spread @ rows.T + np.diag(more),
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
        place = at.slices()[number][0]
        for column in range(place.start, place.stop):
            unit = replace(at, coefficients=np.eye(columns)[:, [column]]).shape(number).T
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
