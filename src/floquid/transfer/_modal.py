r"""Modes fitted to harmonic transfer functions that were measured: least squares weighted by their variance.

.. math:: \min \sum_{m,o,i,k} \frac{|G_{m,o,i}(\Omega_k) - \hat G_{m,o,i}(\Omega_k)|^2}{\mathrm{var}\, G}, \qquad
          \hat G_m(\Omega) = \sum_r \sum_l \frac{c_{r,m-l}\, b_{r,l}}{i (\Omega + l \omega) - \lambda_r} + D_m + \ldots

with conjugates, of samples with its discrete counterpart, and with what a transient adds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Complexes, Floats, Mask
from floquid._checks import Rebuilt
from floquid.fit import (
    AT_REST,
    HALF_DIGITS,
    ROUNDING,
    STEPS,
    Ends,
    Normal,
    Steps,
    half_of,
    levenberg_marquardt,
    near_axis,
    off_axis,
    scaled_inverse,
    score_gain,
)
from floquid.inputs import Grid, InputMode, steps_of, terms_of, turning


@dataclass(frozen=True, kw_only=True, eq=False)
class Lines(Grid):
    """Transfer functions measured, and how they came about."""

    # G and its deviations, that of the real part as the real part (harmonics, outputs, inputs, frequencies), NaN where
    # it was not measured
    values: Complexes
    std: Complexes
    # What one unit in the spectrum of the response of each record adds to G (records, inputs, frequencies), and the
    # times at which the records begin [s]
    echoes: tuple[Complexes, Floats]
    alive: bool = False  # True where the transient is fitted from the first on, False where it is tried at last

    @cached_property
    def there(self) -> Mask:
        """Mask of what was measured (harmonics, outputs, inputs, frequencies)."""
        return np.asarray(np.isfinite(self.values) & (self.std.real > 0.0) & (self.std.imag > 0.0))

    def weighed(self, values: Complexes, output: int) -> Floats:
        """Real and imaginary parts of what was measured of one output over their deviations (…, 2 · values)."""
        there = self.there[:, output]
        own, std = values[..., there], self.std[:, output][there]
        return np.concatenate([own.real / std.real, own.imag / std.imag], axis=-1)

    def response(self, mode: InputMode, shape: Complexes) -> Complexes:
        """The part of one mode of amplitudes 2 c (outputs, turns) (harmonics, outputs, inputs, frequencies)."""
        found = super().response(mode, shape)
        weights, begins = self.echoes
        first = mode.initial
        if self.held is None or not len(first):
            return found
        if mode.real:
            first = first.real * np.exp(1j * (mode.turns[0] % 1.0) * self.fundamental * begins)
        for (exponent, turns, c, _, _), initial in zip(
            terms_of(mode, shape, self.fundamental), (first, first.conj()), strict=False
        ):
            # Σ e^{-iΩt} e^{λ(t - t_0)} over whole repeats; what is left at their end is in the amplitude.
            shift = (self.harmonics[:, None] - turns)[..., None] * self.fundamental
            turned = np.exp(-1j * (self.omega + shift)[..., None] * begins)
            rung = turned / (1.0 - np.exp((exponent - 1j * (self.omega + shift)) * self.held[0]))[..., None]
            found += np.einsum("on,mnfp,p,pif->moif", c, rung, initial, weights)
        return found


@dataclass(frozen=True, slots=True, eq=False)
class Modal(Rebuilt):
    """Modes with amplitudes 2 c (outputs, turns) each, and D (outputs, inputs) at harmonics from 0 on."""

    modes: tuple[InputMode, ...]
    shapes: tuple[Complexes, ...]
    direct: tuple[Complexes, ...] = ()

    def transfer(self, lines: Lines) -> Complexes:
        """G (harmonics, outputs, inputs, frequencies)."""
        return lines.transfer(self.modes, self.shapes, dict(enumerate(self.direct)), lines.values.shape[1:3])

    def moved(self, step: Floats) -> Modal:
        """With the free numbers of the modes moved by a step."""
        steps = steps_of(self.modes, step)
        return replace(self, modes=tuple(mode.moved(own) for mode, own in zip(self.modes, steps, strict=True)))

    def with_amplitudes(self, numbers: NDArray) -> Modal:
        """With the amplitudes of all outputs (outputs, numbers), in the order of `Grid.units`."""
        shapes, direct, place = [], [], 0
        for mode in self.modes:
            imag, count = turning(mode), len(mode.turns)
            shape = numbers[:, place : place + count].astype(complex)
            shape[:, imag] += 1j * numbers[:, place + count : place + count + int(imag.sum())]
            place += count + int(imag.sum())
            shapes.append(shape)
        for turn, own in enumerate(self.direct):
            inputs = own.shape[1]
            value = numbers[:, place : place + inputs].astype(complex)
            if turn:  # amplitudes are 2 D
                value = 0.5 * (value + 1j * numbers[:, place + inputs : place + 2 * inputs])
            place += inputs * (2 if turn else 1)
            direct.append(value)
        return Modal(self.modes, tuple(shapes), tuple(direct))

    def scaled(self) -> Modal:
        """With the largest gain of each mode 1."""
        modes, shapes = [], []
        for mode, shape in zip(self.modes, self.shapes, strict=True):
            own = mode.scaled()
            place = np.unravel_index(int(np.argmax(np.abs(own.gains))), own.gains.shape)
            modes.append(own)
            shapes.append(shape * mode.gains[place] / own.gains[place])
        return Modal(tuple(modes), tuple(shapes), self.direct)


@dataclass(frozen=True, eq=False)
class Fitted(Rebuilt):
    """Modes with the amplitudes that fit G best, and what is left of each output over its deviations."""

    lines: Lines
    modal: Modal
    columns: tuple[Floats, ...]
    """Derivatives by the amplitudes of each output, weighed (numbers, rows)."""
    bases: tuple[Floats, ...]
    """Orthonormal columns that span them (rows, …)."""
    left: tuple[Floats, ...]

    @property
    def cost(self) -> float:
        """χ²: the squares of the residual."""
        return float(sum(own @ own for own in self.left))

    @property
    def n_parameters(self) -> int:
        """Numbers that the fit chooses."""
        return sum(int(mode.free.sum()) for mode in self.modal.modes) + sum(map(len, self.columns))

    @cached_property
    def slopes(self) -> list[Floats]:
        """Derivatives of each output by the free numbers of the modes, weighed (numbers, rows)."""
        modes, shape = self.modal.modes, (-1, *self.lines.values.shape)
        slopes = self.lines.slopes(modes, self.modal.shapes, [mode.free for mode in modes])
        slopes = np.array(slopes, complex).reshape(shape)
        return [self.lines.weighed(slopes[:, :, output], output) for output in range(len(self.left))]

    @cached_property
    def apart(self) -> Floats:
        """Slopes less their part along the amplitudes (numbers, rows of all outputs)."""
        return np.concatenate([own - (own @ q) @ q.T for own, q in zip(self.slopes, self.bases, strict=True)], axis=1)

    @cached_property
    def parameters(self) -> Floats:
        """Covariance of the free numbers of the modes (numbers, numbers)."""
        return _inverse(self.apart)

    def covariance(self) -> Floats:
        """Joint covariance of the free numbers of the modes and of the amplitudes of one output after another."""
        inverses, by = [_inverse(own) for own in self.columns], [np.eye(len(self.parameters))]
        for inverse, own, slope in zip(inverses, self.columns, self.slopes, strict=True):
            by.append(-inverse @ own @ slope.T)
        found, place = np.concatenate(by) @ self.parameters @ np.concatenate(by).T, len(self.parameters)
        for inverse in inverses:
            found[place : place + len(inverse), place : place + len(inverse)] += inverse
            place += len(inverse)
        return found


def _inverse(rows: Floats) -> Floats:
    """The inverse of the products of some rows, directions that are rounding left out of none."""
    return scaled_inverse(rows @ rows.T, ROUNDING, floor=True)


def eliminated(lines: Lines, modal: Modal) -> Fitted:
    """Modes as they are with the amplitudes, and D, that fit G best."""
    units, numbers, parts = lines.units(modal.modes, range(len(modal.direct)), lines.values.shape[2]), [], []
    for output in range(lines.values.shape[1]):
        columns = lines.weighed(units, output)
        # A step too far overflows: what is there explains nothing, and the step is taken back.
        columns = np.where(np.isfinite(columns).all(axis=1, keepdims=True), columns, 0.0)
        size = np.linalg.norm(columns, axis=1)
        size = np.where(size > 0.0, size, 1.0)
        basis, triangle = np.linalg.qr((columns / size[:, None]).T)
        left, values, right = np.linalg.svd(triangle)
        good = values > HALF_DIGITS * values.max(initial=1.0)
        basis = basis @ left[:, : len(values)][:, good]
        given = lines.weighed(lines.values[:, output], output)
        along = basis.T @ given
        numbers.append(right[: len(values)][good].T @ (along / values[good]) / size)
        parts.append((columns, basis, given - basis @ along))
    columns, bases, left = zip(*parts, strict=True)
    return Fitted(lines, modal.with_amplitudes(np.array(numbers)), columns, bases, left)


def fitted(lines: Lines, start: Modal, iterations: int = STEPS) -> Fitted:
    """The modes that fit G best in the weighted squares, from a start."""
    # Amplitudes are eliminated (variable projection of Golub and Pereyra 1973, with Kaufman's derivative of 1975).

    def normal(at: Fitted) -> Normal:
        return Normal(matrix=at.apart @ at.apart.T, gradient=at.apart @ np.concatenate(at.left))

    steps = Steps(normal=normal, moved=lambda at, step: eliminated(lines, at.modal.moved(step)))
    with np.errstate(over="ignore", invalid="ignore"):
        return levenberg_marquardt(eliminated(lines, start.scaled()), steps, Ends(steps=iterations, deviations=AT_REST))


def promised(now: Fitted) -> float:
    """χ² after one step of Gauss and Newton."""
    return now.cost - score_gain(now.apart @ np.concatenate(now.left), now.apart @ now.apart.T, HALF_DIGITS)


OFF_AXIS = 20.0  # deviations off the axis from which on a multiplier is not tried as a real one
SAME = 0.05  # the distance of two exponents over their decay below which they are one


def near_real(
    modes: Sequence[InputMode],
    parameters: Callable[[], Floats],
    omega: float,
    refused: list[complex],
    within: float = OFF_AXIS,
) -> Iterator[list[int]]:
    """Pairs, by number, for which one real multiplier or two are to be tried: those of one sign together first."""
    spread, place = None, 0
    near: dict[float, list[int]] = {}
    for number, mode in enumerate(modes):
        imag, place = place + int(mode.free.sum()) // 2, place + int(mode.free.sum())
        if not near_axis(mode, omega):
            continue
        if any(abs(mode.exponent - other) < SAME * abs(other.real) for other in refused):
            continue
        spread = parameters() if spread is None else spread
        if off_axis(mode, omega) <= within * spread[imag, imag] ** 0.5:
            near.setdefault(half_of(mode, omega) % 1.0, []).append(number)
    for pairs in near.values():
        yield from [pairs, *([[one] for one in pairs] if len(pairs) > 1 else [])]
        refused += [modes[number].exponent for number in pairs]


def real_for(pairs: Sequence[InputMode], omega: float) -> tuple[list[tuple[float, ...]], NDArray, NDArray]:
    """Starts in place of pairs near the axis: exponents of one real multiplier, of two, and their turns and reach."""
    turns, reach = [], []
    for mode in pairs:
        half = half_of(mode, omega)
        turns.append(np.arange(half % 1.0, np.abs(mode.turns + half).max() + 0.5))
        reach.append(np.arange(half % 1.0, np.abs(mode.reach - half).max() + 0.5))
    decays = [mode.exponent.real for mode in pairs]
    ends = (0.7 * decays[0], 1.4 * decays[0]) if len(decays) == 1 else (max(decays), min(decays))
    return [(float(np.mean(decays)),), ends], max(turns, key=len), max(reach, key=len)
