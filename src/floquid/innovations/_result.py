"""The model of a fit in innovations form, with the deviations of all that it holds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from floquid._arrays import Complexes, Floats, Mask
from floquid.core import Estimates
from floquid.errors import IdentificationError
from floquid.fit import HALF_DIGITS, Normal, inverse_root, wald_rise
from floquid.innovations._derivatives import gradient
from floquid.innovations._mode import Mode
from floquid.innovations._predictor import Predictor, predicted, responding
from floquid.innovations._products import gap_of
from floquid.innovations._solve import inverse_of, normal_of, places, solve
from floquid.innovations.search import read_near_axis, with_near_blocks
from floquid.inputs import (
    DrivenFit,
    Errors,
    InputMode,
    Limits,
    Samples,
    TransferParts,
    estimates_of,
    input_gain,
    runs_away,
    sealed,
    selection_of,
)
from floquid.search import GAP

FitOf = TypeVar("FitOf", bound="Fit")


@dataclass(frozen=True, eq=False)
class Fit(DrivenFit):
    """A fit in innovations form with the joint covariance of its parameters."""

    samples: Samples  # What was fitted
    at: Predictor  # The predictor at the maximum of the likelihood
    acting: int = 0  # Inputs that act on the outputs at once: the last of the known columns

    def __post_init__(self) -> None:
        for one in (self.samples, self.at, *self.at.modes):
            sealed(one)

    @cached_property
    def normal(self) -> Normal:
        """The linearisation at the maximum: a part of that with harmonics more, which estimates need as well."""
        whole, masks = self.wide.normal, []
        for more, mode in zip(self.wide.at.modes, self.at.modes, strict=True):
            seen = np.tile(np.isin(more.turns, mode.turns), len(mode.shape))
            masks += [np.ones(mode.rows + 2 * mode.gains.size, bool), seen, seen]
        own = np.flatnonzero(np.concatenate([*masks, np.ones(self.at.columns.size + self.at.initial.size, bool)]))
        return Normal(matrix=whole.matrix[np.ix_(own, own)], gradient=whole.gradient[own])

    @cached_property
    def wide(self) -> Wide:
        """With several harmonics more of each shape, that are zero so far."""
        modes = (mode.seen_wider(GAP, self.samples.highest) for mode in self.at.modes)
        return Wide(self.samples, replace(self.at, modes=tuple(modes)), self.acting)

    @cached_property
    def parameters(self) -> Floats:
        """Covariance of all parameters, zero along the scales of the states (parameters, parameters)."""
        return inverse_of(self.normal)

    @property
    def input_modes(self) -> list[InputMode]:
        """The modes as those of measured inputs alone, with their states at the start of each record."""
        modes, row = [], 0
        for mode in self.at.modes:
            initial = self.at.initial[:, row].astype(complex)
            initial.imag = 0.0 if mode.real else self.at.initial[:, row + 1]
            row += mode.rows
            modes.append(_as_input_mode(mode, self.samples, initial))
        return modes

    @property
    def estimates(self) -> Estimates:
        """Exponents, shapes and gains of a fit that is `sized`, with their joint covariance."""
        return _estimates(self)

    def transfer_parts(self) -> TransferParts:
        """Modes with their shapes, errors, and masks of what is free, as transfer functions are made of them."""
        modes = self.input_modes
        joint = _joint(self, modes, held=True, acting=self.acting)
        return modes, [mode.shape for mode in self.at.modes], joint.errors, joint.free

    def estimates_at(self, exponents: Complexes) -> Estimates:
        """The estimates of a fit with several harmonics more of each mode, linearised at exponents (modes,) [1/s].

        One step of Gauss and Newton from there, as `floquid.periodic.estimate_at` has it.

        Raises IdentificationError where the predictor diverges there.
        """
        here, pairs = self.wide, zip(self.wide.at.modes, exponents.tolist(), strict=True)
        modes = [replace(mode, exponent=complex(value.real) if mode.real else value) for mode, value in pairs]
        if any(mode.exponent != own.exponent for mode, own in zip(modes, self.at.modes, strict=True)):
            at = predicted(self.samples, modes, self.at.columns, self.at.initial, self.at.whitening)
            if at is None:
                raise IdentificationError("The predictor diverges where the record was linearised anew.")
            here = sized(replace(here, at=at))
        step = here.parameters @ here.normal.gradient
        return _estimates(here, step, held=False)

    @property
    def stored(self) -> dict[str, tuple[Any, str]]:
        """Arrays by which a file makes the fit again, beside its modes, with their axes."""
        columns = self.at.columns, "channels, columns; that of the channel"
        return {"columns": columns, "initial": (self.at.initial, "records, states")}

    def direct(self, inputs: int) -> dict[int, Complexes]:
        """D (outputs, inputs) by its harmonic."""
        columns = self.at.columns
        return {0: columns[:, columns.shape[1] - inputs :].astype(complex)} if self.acting else {}

    def drawn(self, generator: np.random.Generator) -> Floats:
        """Outputs made of the fit, with innovations of its covariance (outputs, samples).

        Raises IdentificationError where a mode grows beyond all bounds in the record: that one was held by chance.
        """
        samples, at = self.samples, self.at
        if any(runs_away(samples, mode.exponent) for mode in at.modes):
            raise IdentificationError("A mode grows over the record by more than a record made of the model can show.")
        colour = np.linalg.inv(at.root())
        colour = colour if at.scales is None else at.scales @ colour
        white = generator.standard_normal((samples.n_samples, len(samples.values)))
        innovations = np.einsum("kij,kj->ik", colour, white)
        return responding(samples, at, innovations)

    def refitted(self, values: Floats) -> Fit:
        """Fit these modes and harmonics to other outputs (outputs, samples).

        Raises IdentificationError where their predictor diverges on them.
        """
        samples = replace(self.samples, values=self.samples.kept(values))
        start = predicted(samples, self.at.modes, self.at.columns, self.at.initial, self.at.whitening)
        if start is None:
            raise IdentificationError("The predictor of these modes diverges on these records.")
        limits = Limits(highest=int(max(np.abs(mode.turns).max() for mode in self.at.modes)))
        again = with_near_blocks(samples, solve(samples, start), limits)
        return sized(Fit(samples, read_near_axis(samples, again).at, self.acting))

    def short(self, number: int) -> float:
        """Distance of the exponent of a mode from the maximum of the likelihood to first order, in deviations."""
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
        """Squared deviations of the harmonics of a shape, except for the largest, from zero, and how many those are."""
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

    def beside(self, first: int, second: int) -> tuple[float, int, float]:
        """Squared deviations of a shape from all multiples of another's, how many numbers tell, and its share."""
        modes, omega = self.at.modes, self.samples.fundamental
        _, turn, other = gap_of(modes[first], modes[second], omega)
        axis, mixed = modes[first].axis, modes[first].real != modes[second].real
        parts: list[list[tuple[int, Floats, float]]] = []
        for number, way, off in ((first, 1.0, axis), (second, -1.0 if other else 1.0, axis - turn)):
            mode = modes[number]
            # The signal of a real multiplier is half of its harmonics and half of their conjugates: those of a pair.
            signs = (1.0, -1.0) if mixed and mode.real else (1.0,)
            parts.append([(number, way * (sign * mode.turns - mode.axis) + off, way * sign) for sign in signs])
        band = np.unique(np.concatenate([turns for own in parts for _, turns, _ in own]))
        one, two = (np.mean([self._on(band, *part) for part in own], axis=0) for own in parts)
        noise = np.tile(np.repeat(self.at.noise[:, 0], len(band)), 2)
        # Multiples by a + ib, or by a alone of two real multipliers: i times real parts and imaginary ones.
        half = len(noise) // 2
        along = [one] if modes[first].real and modes[second].real else [one, np.concatenate([-one[half:], one[:half]])]
        values = np.stack([own[:, -1] for own in along], axis=1)
        share = np.linalg.lstsq(values / noise[:, None], two[:, -1] / noise, rcond=None)[0]
        left = two - np.tensordot(share, along, axes=1)
        root = inverse_root(left[:, :-1] @ self.parameters @ left[:, :-1].T)
        values, told = root.T @ values, root.T @ left[:, -1]
        told = told - values @ np.linalg.lstsq(values, told, rcond=None)[0]
        energy = np.sum((np.stack([left[:, -1], two[:, -1]]) / noise) ** 2, axis=1)
        return float(told @ told), max(root.shape[1] - len(share), 1), float(energy[0] / energy[1])

    def _on(self, band: Floats, number: int, turns: Floats, sign: float) -> Floats:
        """Derivatives of a shape on a band by all parameters, and then its values: real parts, then imaginary ones."""
        mode, width = self.at.modes[number], len(self.parameters)
        found = np.zeros((2, len(mode.shape), len(band), width + 1))
        place = np.searchsorted(band, turns)
        first = self.places[number].stop - 2 * mode.shape.size + np.arange(2 * mode.shape.size)
        for part, (own, by) in enumerate(zip(first.reshape(2, *mode.shape.shape), (1.0, sign), strict=True)):
            for channel, parameters in enumerate(own):
                found[part, channel, place, parameters] = by
        found[0][:, place, -1], found[1][:, place, -1] = mode.shape.real, sign * mode.shape.imag
        return found.reshape(-1, width + 1)

    def _squares(self, number: int, *, gains: Mask | None = None, shape: Mask | None = None) -> tuple[float, int]:
        mode, place = self.at.modes[number], self.places[number]
        gains = np.zeros(mode.gains.size, bool) if gains is None else gains
        shape = np.zeros(mode.shape.size, bool) if shape is None else shape
        mask = np.concatenate([np.zeros(mode.rows, bool), gains, gains, shape, shape])
        own = mode.parameters[mask]
        return (wald_rise(own, self.parameters[place, place][np.ix_(mask, mask)]), len(own)) if len(own) else (0.0, 0)


class Wide(Fit):
    """A fit with harmonics more than those that were fitted, linearised for itself."""

    @cached_property
    def normal(self) -> Normal:
        """The linearisation by all that there are."""
        return normal_of(self.samples, self.at)


def _as_input_mode(mode: Mode, samples: Samples, initial: Complexes) -> InputMode:
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
        backwards=runs_away(samples, mode.exponent),
    )


def period_step(fit: Fit) -> tuple[float, float]:
    """(Own period - period given)/period given, as the response has it, to first order, and its deviation."""
    omega = fit.samples.fundamental
    return _step(fit, [replace(fit.samples, fundamental=omega * (1.0 + sign * HALF_DIGITS)) for sign in (1.0, -1.0)])


def phase_step(fit: Fit, number: int) -> tuple[float, float]:
    """The share of a period by which a record is later than its clock says, to first order, and its deviation."""
    samples, period = fit.samples, 2.0 * np.pi / fit.samples.fundamental
    return _step(fit, [samples.later(number, sign * HALF_DIGITS * period) for sign in (1.0, -1.0)])


def _step(fit: Fit, moved: Sequence[Samples]) -> tuple[float, float]:
    """The step of what was moved by half the digits to either side, to first order, and its deviation."""
    samples, at = fit.samples, fit.at
    ends = [predicted(own, at.modes, at.columns, at.initial, growing=True, scales=at.scales) for own in moved]
    # A fit that was ended early may be the last that does not diverge, and have neighbours on one side alone.
    sides = sum(end is not None for end in ends)
    if not sides:
        return 0.0, float(np.inf)
    later, earlier = (at.innovations if end is None else end.innovations for end in ends)
    slope = (later - earlier) / (sides * HALF_DIGITS)
    pulled = gradient(samples, at, slope)
    white = at.white(slope)
    information = float(np.sum(white**2) - pulled @ fit.parameters @ pulled)
    if not information > 0.0:  # of one harmonic alone no period is told
        return 0.0, float(np.inf)
    step = float(np.sum(white * at.white(at.innovations))) / information
    return step, information**-0.5


def sized(fit: FitOf) -> FitOf:
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


def _estimates(fit: Fit, step: Floats | None = None, *, held: bool = True) -> Estimates:
    """Exponents, shapes and gains with their joint covariance, of the modes of a fit as those of inputs alone."""
    modes = fit.input_modes
    joint = _joint(fit, modes, held=held)
    errors = joint.errors
    found = estimates_of(modes, [mode.shape for mode in fit.at.modes], errors, fit.samples.fundamental, joint.free)
    if step is None:
        return found
    others = np.zeros(len(errors.parameters) - len(joint.rows))
    moved = found.moved(selection_of(modes, joint.free, len(errors.parameters)) @ np.append(joint.rows @ step, others))
    half = np.concatenate([np.where((mode.turns > 0.0) | (not mode.real), 0.5, 1.0) for mode in modes])
    shapes = np.concatenate([(own @ step).T for own in joint.amplitudes])
    return replace(moved, coefficients=found.coefficients + (half[:, None] * shapes)[:, :, None])


@dataclass(frozen=True, slots=True)
class _Joint:
    """Errors of a fit as of one of measured inputs alone, and derivatives by all parameters of the fit, last."""

    errors: Errors
    free: list[Mask]  # masks of the numbers of each mode that are free
    rows: Floats  # of those numbers
    amplitudes: list[Complexes]  # of the shape of each mode (channels, turns)


def _joint(fit: Fit, modes: Sequence[InputMode], *, held: bool, acting: int = 0) -> _Joint:
    """Joint errors of the exponents, gains and shapes of the modes of a fit, and of D of the `acting` inputs."""
    known, seen, free, amplitudes = [np.zeros((0, len(fit.parameters)))], [], [], []
    for number, (mode, own) in enumerate(zip(fit.at.modes, modes, strict=True)):
        exponent, gains, shape = _slopes(fit, number, own, held=held)
        begun, turning = np.zeros(len(own.initial), bool), np.tile(mode.reach > 0.0, len(own.gains))
        if mode.real:
            known.append(np.concatenate([exponent.real[None], gains.real, gains.imag[turning]]))
            free.append(np.concatenate([[True], np.ones(len(gains), bool), turning, begun]))
        else:
            known.append(np.concatenate([exponent.real[None], gains.real, exponent.imag[None], gains.imag]))
            free.append(np.tile(np.concatenate([np.ones(1 + len(gains), bool), begun]), 2))
        turning = (mode.turns > 0.0) | (not mode.real)
        seen.append(np.concatenate([shape.real, shape.imag[:, turning]], axis=1))
        amplitudes.append(shape)
    width, columns = len(fit.parameters), fit.at.columns.shape[1]
    by_direct = np.zeros((len(fit.samples.values), acting, width))
    for (output, source, _), _ in np.ndenumerate(by_direct[..., :1]):
        by_direct[output, source, fit.places[-1].stop + (output + 1) * columns - acting + source] = 1.0
    rows = np.concatenate(known)
    by = np.concatenate([rows, np.concatenate([*seen, by_direct], axis=1).reshape(-1, rows.shape[1])])
    errors = Errors.of_joint(by @ fit.parameters @ by.T, len(rows), len(fit.samples.values))
    return _Joint(errors, free, rows, amplitudes)


def _slopes(fit: Fit, number: int, own: InputMode, *, held: bool) -> tuple[Complexes, Complexes, Complexes]:
    """Derivatives of λ, of b (inputs · reach) and of the shape (channels, turns) by all parameters of a fit, last."""
    mode, samples, place = fit.at.modes[number], fit.samples, fit.places[number]
    width, count, size = len(fit.parameters), own.gains.size, mode.shape.size
    exponent, gains, shape = (
        np.zeros(width, complex),
        np.zeros((count, width), complex),
        np.zeros((size, width), complex),
    )
    exponent[place.start : place.start + mode.rows] = (1.0, 1j)[: mode.rows]
    nudge, omega = 1e-6 / samples.step, samples.fundamental
    up, now, down = (
        np.array([input_gain(mode.exponent + by, turn, omega, samples.step, samples.hold)[0] for turn in mode.reach])
        for by in (nudge, 0.0, -nudge)
    )
    first = place.start + mode.rows + np.arange(count)
    each = np.tile(now, len(own.gains))
    gains[np.arange(count), first], gains[np.arange(count), first + mode.gains.size] = 1.0 / each, 1j / each
    gains -= np.outer((own.gains * (up - down) / (2.0 * nudge * now)).ravel(), exponent)
    last = place.stop - 2 * size + np.arange(size)
    shape[np.arange(size), last], shape[np.arange(size), last + size] = 1.0, 1j
    if not held:
        return exponent, gains, shape.reshape(*mode.shape.shape, width)
    largest = int(np.argmax(np.abs(mode.shape / fit.at.noise)))
    scale = shape[largest] / mode.shape.flat[largest]
    scale = scale.real if mode.real else scale
    shape -= np.outer(mode.shape.ravel(), scale)
    gains += np.outer(own.gains.ravel(), scale)
    return exponent, gains, shape.reshape(*mode.shape.shape, width)
