"""The model of a fit in innovations form, with the deviations of all that it holds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from floquid._checks import Rebuilt
from floquid.core import Channel, PeriodicModel, Provenance, with_deviations
from floquid.fit import Normal, wald_rise
from floquid.innovations._mode import Mode
from floquid.innovations._predictor import Predictor, gradient, predicted
from floquid.innovations._solve import inverse_of, normal_of, places
from floquid.inputs import (
    InputMode,
    Samples,
    Term,
    TransferFunctions,
    assembled,
    input_gain,
    listed,
    modal_transfer,
    sealed,
    terms_of,
)

NUDGE = 1e-3
"""The share of its deviation by which a parameter is moved for a derivative."""

SHIFT = 1e-9
"""The share of ω by which that is moved."""


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
    def normal(self) -> Normal:
        """The linearisation at the maximum."""
        return normal_of(self.samples, self.at)

    @cached_property
    def parameters(self) -> NDArray[np.float64]:
        """Covariance of all parameters, zero along the scales of the states (parameters, parameters)."""
        return inverse_of(self.normal)

    def short(self, number: int) -> float:
        """How far the exponent of a mode is from the maximum of the likelihood to first order, in deviations."""
        rows = np.arange(self.places[number].start, self.places[number].start + self.at.modes[number].rows)
        std = np.sqrt(np.diag(self.parameters)[rows])
        step = self.parameters[rows] @ self.normal.gradient
        return float(np.max(np.abs(step) / np.maximum(std, np.finfo(float).tiny)))

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
        mode = self.at.modes[number]
        turns = np.arange(len(mode.turns)) != int(np.argmax(np.sum(np.abs(mode.shape / self.at.noise) ** 2, axis=0)))
        return self._squares(number, shape=np.tile(turns, len(mode.shape)))

    def seen(self, number: int) -> tuple[float, int]:
        """Squared deviations of a shape from zero, and how many numbers it has."""
        return self._squares(number, shape=np.ones(self.at.modes[number].shape.size, bool))

    def reached(self, number: int) -> tuple[float, int]:
        """Squared deviations of the gains of the measured inputs from zero, and how many numbers those are."""
        mode = self.at.modes[number]
        return self._squares(number, gains=np.arange(mode.gains.size) < len(self.samples.inputs) * len(mode.reach))

    def _squares(
        self, number: int, *, gains: NDArray[np.bool_] | None = None, shape: NDArray[np.bool_] | None = None
    ) -> tuple[float, int]:
        mode, place = self.at.modes[number], self.places[number]
        gains = np.zeros(mode.gains.size, bool) if gains is None else gains
        shape = np.zeros(mode.shape.size, bool) if shape is None else shape
        mask = np.concatenate([np.zeros(mode.rows, bool), gains, gains, shape, shape])
        own = mode.parameters[mask]
        return (wald_rise(own, self.parameters[place, place][np.ix_(mask, mask)]), len(own)) if len(own) else (0.0, 0)


def _as_input_mode(mode: Mode, samples: Samples, initial: NDArray[np.complex128]) -> InputMode:
    """A mode as one with measured inputs alone, b those that act over time; the innovations are left out."""
    step, omega = samples.step, samples.fundamental
    scale = [input_gain(mode.exponent, turn, omega, step, samples.hold)[0] for turn in mode.reach.tolist()]
    return InputMode(
        exponent=mode.exponent,
        real=mode.real,
        reach=mode.reach,
        gains=mode.gains[: len(samples.inputs)] / np.array(scale),
        turns=mode.turns,
        initial=initial,
        sizes=np.ones(len(samples.inputs)),
    )


def terms_of_mode(mode: Mode, samples: Samples) -> list[Term]:
    """A mode of a fit as modes of a model: a pair as two."""
    return terms_of(_as_input_mode(mode, samples, np.zeros(0, complex)), mode.shape, samples.fundamental)


def period_step(fit: Fit) -> tuple[float, float]:
    """(Own period - period given)/period given, as the response has it, to first order, and its deviation."""
    omega = fit.samples.fundamental
    return _step(fit, [replace(fit.samples, fundamental=omega * (1.0 + sign * SHIFT)) for sign in (1.0, -1.0)])


def phase_step(fit: Fit, number: int) -> tuple[float, float]:
    """The share of a period by which a record is later than its clock says, to first order, and its deviation."""
    samples, period = fit.samples, 2.0 * np.pi / fit.samples.fundamental
    return _step(fit, [samples.later(number, sign * SHIFT * period) for sign in (1.0, -1.0)])


def _step(fit: Fit, moved: Sequence[Samples]) -> tuple[float, float]:
    """The step of what was moved by `SHIFT` to either side, to first order, and its deviation."""
    samples, at = fit.samples, fit.at
    ends = [predicted(own, at.modes, at.columns, at.initial, growing=True) for own in moved]
    # A fit that was ended early may be the last that does not diverge, and have neighbours on one side alone.
    sides = sum(end is not None for end in ends)
    if not sides:
        return 0.0, float(np.inf)
    later, earlier = (at.innovations if end is None else end.innovations for end in ends)
    slope = (later - earlier) / (sides * SHIFT)
    pulled = gradient(samples, at, slope)
    white = at.white(slope)
    information = float(np.sum(white**2) - pulled @ fit.parameters @ pulled)
    if not information > 0.0:  # of one harmonic alone no period is told
        return 0.0, float(np.inf)
    step = float(np.sum(white * at.white(at.innovations))) / information
    return step, information**-0.5


def sized(fit: Fit) -> Fit:
    """The fit with states of rms 1, the largest coefficient of each real and positive."""
    modes, initial, states, row = [], fit.at.initial.copy(), fit.at.states.copy(), 0
    for number, mode in enumerate(fit.at.modes):
        largest = mode.shape.ravel()[np.argmax(np.abs(mode.shape / fit.at.noise))]
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


def _deviations(fit: Fit, number: int) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Deviations of b (inputs, reach) and of the shape (channels, turns) of a mode, its largest coefficient held."""
    mode, samples = fit.at.modes[number], fit.samples
    spread = fit.parameters[fit.places[number], fit.places[number]]
    largest = int(np.argmax(np.abs(mode.shape / fit.at.noise)))
    held = mode.shape.flat[largest]

    def values(at: Mode) -> NDArray[np.complex128]:
        by = at.shape.flat[largest] / held
        by = abs(by) if mode.real else by
        gains = _as_input_mode(at, samples, np.zeros(0, complex)).gains
        return np.concatenate([gains.ravel() * by, at.shape.ravel() / by])

    slopes = []
    for parameter, std in enumerate(np.sqrt(np.maximum(np.diag(spread), 0.0))):
        step = np.zeros(len(spread))
        step[parameter] = NUDGE * std
        slopes.append((values(mode.moved(step)) - values(mode.moved(-step))) / (2.0 * step[parameter] or 1.0))
    by = np.array([[own.real, own.imag] for own in slopes])
    real, imag = np.sqrt(np.maximum(np.einsum("pcq,pr,rcq->cq", by, spread, by), 0.0))
    both, count = real + 1j * imag, len(samples.inputs) * len(mode.reach)
    return both[:count].reshape(-1, len(mode.reach)), both[count:].reshape(mode.shape.shape)


def model_of(
    fit: Fit,
    channels: Sequence[Channel],
    inputs: Sequence[Channel],
    provenance: Provenance,
    as_read: Mapping[int, complex] | None = None,
) -> PeriodicModel:
    """The periodic model of a fit, each mode with its conjugate, with deviations; the states have an rms of 1.

    Deviations of exponents near an axis are those `as_read`, by the numbers of their modes, where they are given.
    """
    fit, parts, row = sized(fit), [], 0
    for number, mode in enumerate(fit.at.modes):
        gain_std, shape_std = _deviations(fit, number)
        rows = np.zeros((2, len(fit.parameters)))
        rows[range(mode.rows), range(fit.places[number].start, fit.places[number].start + mode.rows)] = 1.0
        initial = np.zeros(len(fit.samples.records), complex)
        initial.real = fit.at.initial[:, row]
        if not mode.real:
            initial.imag = fit.at.initial[:, row + 1]
        row += mode.rows
        own = _as_input_mode(mode, fit.samples, initial)
        both = (mode.shape, shape_std)
        parts.append(listed(own, both, gain_std, rows, fit.samples.fundamental, fit.samples.first_times))
    turns = np.zeros(int(fit.acting > 0), np.int64)
    direct = fit.at.columns[:, fit.at.columns.shape[1] - len(inputs) :, None].astype(complex)[..., : len(turns)]
    period = 2.0 * np.pi / fit.samples.fundamental
    model = assembled(parts, fit.parameters, period, channels, inputs, (turns, direct), provenance)
    if not as_read:
        return model
    std = [as_read.get(k, complex(np.nan, np.nan)) for k, mode in enumerate(fit.at.modes) for _ in range(mode.rows)]
    assert model.covariance is not None
    return replace(model, covariance=with_deviations(model.covariance, np.array(std)))


def transfer_of(
    fit: Fit,
    channels: Sequence[Channel],
    inputs: Sequence[Channel],
    frequencies_hz: NDArray[np.float64],
    harmonics: NDArray[np.int64],
    *,
    sampled: bool = False,
) -> TransferFunctions:
    """The harmonic transfer functions of a fit in innovations form with their deviations, to first order."""
    omega = 2.0 * np.pi * frequencies_hz
    samples, omega_0 = fit.samples, fit.samples.fundamental
    shape = (len(harmonics), len(channels), len(inputs), len(omega))
    held = (fit.samples.step, fit.samples.hold) if sampled else None

    def transferred(mode: Mode) -> NDArray[np.complex128]:
        parts = [
            modal_transfer(exponent, omega_0, (turns, c), (reach, b), harmonics, omega, held)
            for exponent, turns, c, reach, b in terms_of_mode(mode, samples)
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
            step[index] = NUDGE * spread[parameter]
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
        step=fit.samples.step if sampled else None,
    )
