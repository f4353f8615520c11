"""The model of a fit in innovations form, with the deviations of all that it holds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from floquid._checks import Rebuilt
from floquid.core import Channel, ModelInputs, PeriodicModel, Provenance
from floquid.innovations._predictor import Mode, Predictor
from floquid.innovations._solve import normal_of, places
from floquid.inputs import Samples, TransferFunctions, input_gain, mirrored, modal_transfer, sealed


@dataclass(frozen=True, eq=False)
class Fit(Rebuilt):
    """A fit in innovations form with the joint covariance of its parameters.

    Parameters
    ----------
    samples
        What was fitted.
    at
        The predictor at the maximum of the likelihood.
    acting
        Inputs that act on the outputs at once: the last of the known columns.
    """

    samples: Samples
    at: Predictor
    acting: int = 0

    def __post_init__(self) -> None:
        for one in (self.samples, self.at, *self.at.modes):
            sealed(one)

    @cached_property
    def parameters(self) -> NDArray[np.float64]:
        """Covariance of all parameters, zero along the scales of the states (parameters, parameters)."""
        return normal_of(self.samples, self.at).inverse()

    @cached_property
    def places(self) -> list[slice]:
        """The place of the parameters of each mode."""
        return places(self.at.modes)

    def rms(self, number: int) -> float:
        """The rms of the state of a mode over the records."""
        first = sum(mode.rows for mode in self.at.modes[:number])
        own = self.at.states[:, first : first + self.at.modes[number].rows]
        return float(np.sqrt(np.mean(np.sum(own**2, axis=1))))

    def varying(self, number: int) -> tuple[float, int]:
        """Squared deviations of the harmonics of a shape, but for the largest, from zero, and how many those are."""
        mode, place = self.at.modes[number], self.places[number]
        turns = np.arange(len(mode.turns)) != int(np.argmax(np.sum(np.abs(mode.shape) ** 2, axis=0)))
        mask = np.concatenate([np.zeros(mode.rows + 2 * mode.gains.size, bool), np.tile(turns, 2 * len(mode.shape))])
        own = np.concatenate([mode.shape.real.ravel(), mode.shape.imag.ravel()])[mask[-2 * mode.shape.size :]]
        if not len(own):
            return 0.0, 0
        spread = self.parameters[place, place][np.ix_(mask, mask)]
        return float(own @ np.linalg.pinv(spread, hermitian=True) @ own), len(own)


def terms_of(
    mode: Mode, samples: Samples
) -> list[tuple[complex, NDArray[np.int64], NDArray, NDArray[np.int64], NDArray]]:
    """A mode as modes of a model, a pair as two: λ, harmonics m, c, harmonics l, b of the inputs over time."""
    inputs = len(samples.inputs)
    step, omega = samples.step, samples.fundamental
    scale = [input_gain(mode.exponent, turn, omega, step, samples.hold)[0] for turn in mode.reach.tolist()]
    gains = mode.gains[:inputs] / np.array(scale)
    if mode.real:
        begin = mode.turns[0] % 1.0
        seen, reached = mirrored(mode.turns, mode.shape, -begin), mirrored(mode.reach, gains, begin)
        return [(mode.exponent.real + 1j * begin * omega, *seen, *reached)]
    turns, reach = mode.turns.astype(np.int64), mode.reach.astype(np.int64)
    return [
        (mode.exponent, turns, 0.5 * mode.shape, reach, gains),
        (
            mode.exponent.conjugate(),
            -turns[::-1],
            0.5 * mode.shape.conj()[:, ::-1],
            -reach[::-1],
            gains.conj()[:, ::-1],
        ),
    ]


def sized(fit: Fit) -> Fit:
    """The fit with states of rms 1, the largest coefficient of each real and positive."""
    modes, initial, states, row = [], fit.at.initial.copy(), fit.at.states.copy(), 0
    noise = np.sqrt(np.diag(fit.at.covariance))[:, None]
    for number, mode in enumerate(fit.at.modes):
        largest = mode.shape.ravel()[np.argmax(np.abs(mode.shape / noise))]
        by = complex(fit.rms(number)) if mode.real else fit.rms(number) * np.conj(largest) / abs(largest)
        modes.append(replace(mode, shape=mode.shape * by, gains=mode.gains / by))
        for values in (initial, states):
            if mode.real:
                values[:, row] /= by.real
            else:
                both = (values[:, row] + 1j * values[:, row + 1]) / by
                values[:, row], values[:, row + 1] = both.real, both.imag
        row += mode.rows
    return replace(fit, at=replace(fit.at, modes=tuple(modes), initial=initial, states=states))


def _moves(mode: Mode, noise: NDArray[np.float64]) -> NDArray[np.float64]:
    """Derivatives of gains and shape, the largest coefficient held, by all of both (2 (gains + shape), alike)."""
    count, size = mode.gains.size, mode.gains.size + mode.shape.size
    largest = count + int(np.argmax(np.abs(mode.shape / noise)))
    flat = np.concatenate([mode.gains.ravel(), mode.shape.ravel()])
    sign = np.where(np.arange(size) < count, 1.0, -1.0)
    # s → s / (1 + δ), g → g (1 + δ), with δ the relative step of the largest coefficient.
    found = np.eye(2 * size)
    by = sign * flat / flat[largest]
    if mode.real:
        unit = flat[largest] / abs(flat[largest])
        by = sign * flat / abs(flat[largest])
        found[:size, largest] += by.real * unit.real
        found[:size, size + largest] += by.real * unit.imag
        found[size:, largest] += by.imag * unit.real
        found[size:, size + largest] += by.imag * unit.imag
    else:
        found[:size, largest] += by.real
        found[:size, size + largest] -= by.imag
        found[size:, largest] += by.imag
        found[size:, size + largest] += by.real
    return found


def deviations(fit: Fit, number: int) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Deviations of the gains and the shape of a mode, its largest coefficient held, as the values are shaped."""
    mode = fit.at.modes[number]
    own = fit.parameters[fit.places[number], fit.places[number]][mode.rows :, mode.rows :]
    gains, shape = mode.gains.size, mode.shape.size
    # From the order of `Mode.moved` to real parts of both, then imaginary parts.
    order = np.concatenate(
        [
            np.arange(gains),
            2 * gains + np.arange(shape),
            gains + np.arange(gains),
            2 * gains + shape + np.arange(shape),
        ]
    )
    moves = _moves(mode, np.sqrt(np.diag(fit.at.covariance))[:, None])
    spread = np.sqrt(np.maximum(np.diag(moves @ own[np.ix_(order, order)] @ moves.T), 0.0))
    both = spread[: gains + shape] + 1j * spread[gains + shape :]
    return both[:gains].reshape(mode.gains.shape), both[gains:].reshape(mode.shape.shape)


def model_of(fit: Fit, channels: Sequence[Channel], inputs: Sequence[Channel], provenance: Provenance) -> PeriodicModel:
    """The periodic model of a fit, each mode with its conjugate, with deviations; the states have an rms of 1."""
    fit, width = sized(fit), len(fit.parameters)
    samples, omega = fit.samples, fit.samples.fundamental
    parts = []
    for number, mode in enumerate(fit.at.modes):
        gain_std, shape_std = deviations(fit, number)
        place = fit.places[number].start
        rows = np.zeros((2, width))
        rows[0, place] = 1.0
        if not mode.real:
            rows[1, place + 1] = 1.0
        scale = [abs(input_gain(mode.exponent, turn, omega, samples.step, samples.hold)[0]) for turn in mode.reach]
        gain_std = gain_std[: len(inputs)] / np.array(scale)
        if mode.real:
            begin = mode.turns[0] % 1.0
            spreads = [
                (
                    mirrored(mode.turns, shape_std, -begin, deviations=True)[1],
                    mirrored(mode.reach, gain_std, begin, deviations=True)[1],
                )
            ]
        else:
            spreads = [(0.5 * shape_std, gain_std), (0.5 * shape_std[:, ::-1], gain_std[:, ::-1])]
        for sign, term, spread in zip((1.0, -1.0), terms_of(mode, samples), spreads, strict=False):
            parts.append((*term, *spread, rows * [[1.0], [sign]]))
    harmonics, reach = _all_of([part[1] for part in parts]), _all_of([part[3] for part in parts])
    count = len(parts)
    coefficients = np.zeros((count, len(channels), 1, len(harmonics)), complex)
    gains = np.zeros((count, len(inputs), len(reach)), complex)
    coefficient_std, gain_std = np.zeros_like(coefficients), np.zeros_like(gains)
    for k, (_, turns, c, driven, b, c_std, b_std, _) in enumerate(parts):
        seen, reached = np.searchsorted(harmonics, turns), np.searchsorted(reach, driven)
        coefficients[k][:, 0, seen], coefficient_std[k][:, 0, seen] = c, c_std
        gains[k][:, reached], gain_std[k][:, reached] = b, b_std
    rows = np.concatenate([np.array([part[7][0] for part in parts]), np.array([part[7][1] for part in parts])])
    own = None
    if inputs:
        own = ModelInputs(
            channels=tuple(inputs),
            coefficients=gains,
            harmonics=reach,
            coefficient_std=gain_std,
            direct=fit.at.columns[:, -len(inputs) :, None][..., : int(fit.acting > 0)].astype(complex),
            direct_harmonics=np.zeros(int(fit.acting > 0), np.int64),
            initial=_initial(fit),
        )
    return PeriodicModel(
        exponents=np.array([part[0] for part in parts]),
        coefficients=coefficients,
        harmonics=harmonics,
        period=2.0 * np.pi / omega,
        channels=channels,
        covariance=rows @ fit.parameters @ rows.T,
        coefficient_std=coefficient_std,
        provenance=provenance,
        inputs=own,
    )


def _initial(fit: Fit) -> NDArray[np.complex128]:
    """The state of each mode of a model at the first sample of each record (modes, records)."""
    found, row = [], 0
    begins = fit.samples.times[list(fit.samples.begins[:-1])]
    for mode in fit.at.modes:
        own = fit.at.initial[:, row] + (0j if mode.real else 1j * fit.at.initial[:, row + mode.rows - 1])
        if mode.real:
            found.append(own * np.exp(1j * (mode.turns[0] % 1.0) * fit.samples.fundamental * begins))
        else:
            found += [own, own.conj()]
        row += mode.rows
    return np.array(found)


def _all_of(parts: Sequence[NDArray[np.int64]]) -> NDArray[np.int64]:
    """Every whole number from the least to the largest of some (numbers,)."""
    both = np.concatenate(parts)
    return np.arange(both.min(), both.max() + 1)


def transfer_of(
    fit: Fit,
    channels: Sequence[Channel],
    inputs: Sequence[Channel],
    frequencies_hz: NDArray[np.float64],
    harmonics: NDArray[np.int64],
) -> TransferFunctions:
    """The harmonic transfer functions of a fit in innovations form with their deviations, to first order."""
    omega = 2.0 * np.pi * frequencies_hz
    samples = fit.samples
    shape = (len(harmonics), len(channels), len(inputs), len(omega))

    def transferred(mode: Mode) -> NDArray[np.complex128]:
        parts = [
            modal_transfer(exponent, samples.fundamental, (turns, c), (reach, b), harmonics, omega)
            for exponent, turns, c, reach, b in terms_of(mode, samples)
        ]
        return np.sum(parts, axis=0)

    values = np.zeros(shape, complex)
    slopes = np.zeros((len(fit.parameters), *shape), complex)
    spread = np.sqrt(np.maximum(np.diag(fit.parameters), 0.0))
    for mode, place in zip(fit.at.modes, fit.places, strict=True):
        values += transferred(mode)
        for index, parameter in enumerate(range(place.start, place.stop)):
            if spread[parameter] == 0.0:
                continue
            step = np.zeros(place.stop - place.start)
            step[index] = 1e-3 * spread[parameter]
            slopes[parameter] = (transferred(mode.moved(step)) - transferred(mode.moved(-step))) / (2.0 * step[index])
    columns = fit.at.columns.shape[1]
    first = fit.places[-1].stop
    for output in range(len(channels)):
        for source in range(fit.acting):
            column = columns - len(inputs) + source
            values[harmonics == 0, output, source] += fit.at.columns[output, column]
            slopes[first + output * columns + column, harmonics == 0, output, source] = 1.0
    flat = slopes.reshape(len(slopes), -1)
    real, imag = (
        np.sqrt(np.einsum("pq,pr,rq->q", np.asarray(own, float), fit.parameters, own, optimize=True))
        for own in (np.real(flat), np.imag(flat))
    )
    return TransferFunctions(
        frequencies_hz=frequencies_hz,
        harmonics=harmonics,
        values=values,
        std=(real + 1j * imag).reshape(shape),
        outputs=tuple(channels),
        inputs=tuple(inputs),
    )
