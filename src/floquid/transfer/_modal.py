r"""Modes fitted to harmonic transfer functions that were measured: least squares weighted by their variance.

.. math:: \min \sum_{m,o,i,k} \frac{|G_{m,o,i}(\Omega_k) - \hat G_{m,o,i}(\Omega_k)|^2}{\mathrm{var}\, G}, \qquad
          \hat G_m(\Omega) = \sum_r \sum_l \frac{c_{r,m-l}\, b_{r,l}}{i (\Omega + l \omega) - \lambda_r} + D_m + \ldots

with conjugates, of samples with its discrete counterpart, and with what a transient adds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from floquid._checks import Rebuilt
from floquid.inputs import Hold, InputMode, modal_transfer, terms_of

NUDGE = 1e-5
"""The share of the decay by which an exponent is moved for a derivative."""

ITERATIONS = 60
"""Evaluations of a fit at most."""

ROUNDING = 1e-13
"""The share of the largest below which a direction of the normal matrix is rounding."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Lines(Rebuilt):
    """Transfer functions measured, and how they came about.

    Parameters
    ----------
    omega, harmonics
        Ω (frequencies,) [rad/s] and m (harmonics,).
    values, std
        G and its deviations, that of the real part as the real part (harmonics, outputs, inputs, frequencies), NaN
        where it was not measured.
    fundamental
        ω [rad/s].
    held
        The sampling interval and the hold where G is that of samples; None where it is that of continuous time.
    echoes
        What one unit in the spectrum of the response of each record adds to G (records, inputs, frequencies), and the
        times at which the records begin [s].
    alive
        True where what rings at the begin is fitted from the first on, False where it is tried at last.
    """

    omega: NDArray[np.float64]
    harmonics: NDArray[np.int64]
    values: NDArray[np.complex128]
    std: NDArray[np.complex128]
    fundamental: float
    held: tuple[float, Hold] | None
    echoes: tuple[NDArray[np.complex128], NDArray[np.float64]]
    alive: bool = False

    @cached_property
    def there(self) -> NDArray[np.bool_]:
        """Mask of what was measured (harmonics, outputs, inputs, frequencies)."""
        return np.asarray(np.isfinite(self.values) & (self.std.real > 0.0) & (self.std.imag > 0.0))

    def weighed(self, values: NDArray[np.complex128]) -> NDArray[np.float64]:
        """Real and imaginary parts of what was measured over their deviations (…, 2 · values)."""
        own, std = values[..., self.there], self.std[self.there]
        return np.concatenate([own.real / std.real, own.imag / std.imag], axis=-1)

    def response(self, mode: InputMode, shape: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """The part of one mode of amplitudes 2 c (outputs, turns) (harmonics, outputs, inputs, frequencies)."""
        found = np.zeros((len(self.harmonics), len(shape), len(mode.gains), len(self.omega)), complex)
        weights, begins = self.echoes
        first = mode.initial
        if mode.real and len(first):
            first = first.real * np.exp(1j * (mode.turns[0] % 1.0) * self.fundamental * begins)
        for (exponent, turns, c, reach, b), initial in zip(
            terms_of(mode, shape, self.fundamental), (first, first.conj()), strict=False
        ):
            found += modal_transfer(
                exponent, self.fundamental, (turns, c), (reach, b), self.harmonics, self.omega, self.held
            )
            if len(initial) and self.held is not None:
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
    shapes: tuple[NDArray[np.complex128], ...]
    direct: tuple[NDArray[np.complex128], ...] = ()

    def values(self, lines: Lines) -> NDArray[np.complex128]:
        """G (harmonics, outputs, inputs, frequencies)."""
        found = np.zeros(lines.values.shape, complex)
        for mode, shape in zip(self.modes, self.shapes, strict=True):
            found += lines.response(mode, shape)
        for turn, own in enumerate(self.direct):
            found[lines.harmonics == turn] += own[:, :, None]
            if turn:
                found[lines.harmonics == -turn] += own.conj()[:, :, None]
        return found

    def masks(self) -> list[NDArray[np.bool_]]:
        """Of each mode and of D, which numbers are free: those of the mode, Re and Im of the rest."""
        found = []
        for mode, shape in zip(self.modes, self.shapes, strict=True):
            turning = np.broadcast_to((mode.turns > 0.0) | (not mode.real), shape.shape).ravel()
            found.append(np.concatenate([mode.free, np.ones(shape.size, bool), turning]))
        return found + [np.repeat([True, turn > 0], own.size) for turn, own in enumerate(self.direct)]

    def moved(self, step: NDArray[np.float64]) -> Modal:
        """With the free numbers moved by a step."""
        modes, shapes, direct, place = [], [], [], 0
        for number, mask in enumerate(self.masks()):
            own = np.zeros(len(mask))
            own[mask] = step[place : place + int(mask.sum())]
            place += int(mask.sum())
            if number < len(self.modes):
                width, shape = len(self.modes[number].free), self.shapes[number]
                modes.append(self.modes[number].moved(own[:width]))
                shapes.append(shape + _complex(own[width:]).reshape(shape.shape))
            else:
                was = self.direct[number - len(self.modes)]
                direct.append(was + _complex(own).reshape(was.shape))
        return Modal(tuple(modes), tuple(shapes), tuple(direct))

    def slopes(self, lines: Lines, masks: Sequence[NDArray[np.bool_]]) -> NDArray[np.complex128]:
        """Derivatives of G by the numbers of some masks (numbers, harmonics, outputs, inputs, frequencies)."""
        found = []
        for mode, shape, mask in zip(self.modes, self.shapes, masks, strict=False):
            own = lines.response(mode, shape)
            for index in np.flatnonzero(mask[: len(mode.free)]):
                step = np.zeros(len(mode.free))
                if index in (0, len(mode.free) // 2 if not mode.real else 0):
                    step[index] = NUDGE * max(abs(mode.exponent.real), NUDGE * lines.fundamental)
                    up, down = (lines.response(mode.moved(sign * step), shape) for sign in (1.0, -1.0))
                    found.append((up - down) / (2.0 * step[index]))
                else:  # the rest is linear
                    step[index] = 1.0
                    found.append(lines.response(mode.moved(step), shape) - own)
            for unit in (1.0, 1j):
                for turn, output in ((t, o) for o in range(len(shape)) for t in range(len(mode.turns))):
                    if unit == 1.0 or mode.turns[turn] > 0.0 or not mode.real:
                        one = np.zeros((1, len(mode.turns)), complex)
                        one[0, turn] = unit
                        whole = np.zeros(lines.values.shape, complex)
                        whole[:, output] = lines.response(mode, one)[:, 0]
                        found.append(whole)
        found += self._direct_slopes(lines)
        return np.array(found)

    def _direct_slopes(self, lines: Lines) -> list[NDArray[np.complex128]]:
        found = []
        for turn, own in enumerate(self.direct):
            for unit in (1.0, 1j) if turn else (1.0,):
                for output, source in np.ndindex(own.shape):
                    whole = np.zeros(lines.values.shape, complex)
                    whole[lines.harmonics == turn, output, source] += unit
                    if turn:
                        whole[lines.harmonics == -turn, output, source] += np.conj(unit)
                    found.append(whole)
        return found

    def scaled(self) -> Modal:
        """With the largest gain of each mode 1."""
        modes, shapes = [], []
        for mode, shape in zip(self.modes, self.shapes, strict=True):
            own = mode.scaled()
            place = np.unravel_index(int(np.argmax(np.abs(own.gains))), own.gains.shape)
            modes.append(own)
            shapes.append(shape * mode.gains[place] / own.gains[place])
        return Modal(tuple(modes), tuple(shapes), self.direct)


def _complex(parts: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Numbers of their real parts, then their imaginary ones."""
    return np.asarray(parts[: len(parts) // 2] + 1j * parts[len(parts) // 2 :], np.complex128)


@dataclass(frozen=True, slots=True, eq=False)
class Fitted(Rebuilt):
    """A fit, its χ², and the covariance of its free numbers (numbers, numbers)."""

    modal: Modal
    chi_square: float
    covariance: NDArray[np.float64]

    @property
    def n_parameters(self) -> int:
        """Numbers that the fit chooses."""
        return len(self.covariance)


def fitted(lines: Lines, start: Modal, iterations: int = ITERATIONS) -> Fitted:
    """The modes that fit G best in the weighted squares, from a start (Levenberg and Marquardt)."""
    base = start.scaled()
    masks = base.masks()

    def left(step: NDArray[np.float64]) -> NDArray[np.float64]:
        return lines.weighed(base.moved(step).values(lines) - lines.values)

    def slopes(step: NDArray[np.float64]) -> NDArray[np.float64]:
        return lines.weighed(base.moved(step).slopes(lines, masks)).T

    count = int(sum(mask.sum() for mask in masks))
    with np.errstate(over="ignore", invalid="ignore"):
        # The stubs of scipy know no function for the Jacobian.
        jacobian: Any = slopes
        found = least_squares(left, np.zeros(count), jacobian, method="lm", x_scale="jac", max_nfev=iterations)
    columns = np.asarray(found.jac)
    size = np.sqrt(np.sum(columns**2, axis=0))
    size = np.where(size > 0.0, size, 1.0)
    values, vectors = np.linalg.eigh((columns / size).T @ (columns / size))
    root = vectors / np.sqrt(np.maximum(values, ROUNDING * values[-1])) / size[:, None]
    return Fitted(base.moved(found.x), 2.0 * float(found.cost), root @ root.T)


def promised(lines: Lines, modal: Modal) -> float:
    """What χ² falls by in one step of Gauss and Newton."""
    columns = lines.weighed(modal.slopes(lines, modal.masks()))
    size = np.linalg.norm(columns, axis=1, keepdims=True)
    columns = columns / np.where(size > 0.0, size, 1.0)
    left = lines.weighed(lines.values - modal.values(lines))
    values, vectors = np.linalg.eigh(columns @ columns.T)
    along = vectors.T @ (columns @ left)
    good = values > 1e3 * ROUNDING * values[-1]
    return float(np.sum(along[good] ** 2 / values[good]))


def with_amplitudes(lines: Lines, modes: Sequence[InputMode], residual: NDArray[np.complex128]) -> Modal:
    """Modes with the amplitudes that fit them to a residual best."""
    outputs = lines.values.shape[1]
    modal = Modal(tuple(modes), tuple(np.zeros((outputs, len(mode.turns)), complex) for mode in modes))
    masks = [
        np.concatenate([np.zeros(len(mode.free), bool), mask[len(mode.free) :]])
        for mode, mask in zip(modes, modal.masks(), strict=True)
    ]
    columns = lines.weighed(modal.slopes(lines, masks))
    numbers = np.linalg.lstsq(columns.T, lines.weighed(residual), rcond=1e-10)[0]
    shapes, place = [], 0
    for shape, mask, mode in zip(modal.shapes, masks, modes, strict=True):
        own = np.zeros(len(mask))
        own[mask] = numbers[place : place + int(mask.sum())]
        place += int(mask.sum())
        shapes.append(_complex(own[len(mode.free) :]).reshape(shape.shape))
    return replace(modal, shapes=tuple(shapes))
