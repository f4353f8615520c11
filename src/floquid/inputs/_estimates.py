"""Estimates of modes with inputs: their exponents, shapes and gains with one joint covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from floquid._arrays import Complexes, Floats, Integers, Mask
from floquid.core import Channel, Driven, Estimates, Gains
from floquid.fit import HALF_DIGITS, covariance_root, inverse_root
from floquid.inputs._modes import InputMode

Term = tuple[complex, Integers, Complexes, Integers, Complexes]
"""λ, the harmonics m, c (outputs, harmonics), the harmonics l, b (inputs, harmonics)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Errors:
    """Errors of a fit with linear amplitudes: of its free parameters, and of the columns of each output."""

    # Covariance of the free parameters of the modes, and of others behind them (parameters, parameters)
    parameters: Floats
    slopes: Floats  # Derivatives of the coefficients of the columns by them (outputs, columns, parameters)
    # Covariance of the coefficients beside them (blocks, columns, columns), and the block of each output (outputs,)
    spread: Floats
    blocks: Integers
    scales: Floats  # What its root is multiplied by in each output (outputs,)

    @staticmethod
    def of_joint(covariance: Floats, count: int, outputs: int) -> Errors:
        r"""Errors by one covariance of the free parameters, `count` of them, and of the columns of each output.

        .. math:: K = S C S^T + \mu\, \mathrm{diag}(K_1, K_2, \ldots) + R R^T

        with μ the largest share of the errors of each output alone that leaves a covariance: what outputs have in
        common beyond the parameters is that of others, of variance 1, with the slopes R.
        """
        from scipy.linalg import block_diag

        known = covariance[:count, :count]
        root = inverse_root(known)
        slopes = covariance[count:, :count] @ root @ root.T
        left = covariance[count:, count:] - slopes @ known @ slopes.T
        each = len(left) // max(outputs, 1)
        places = [slice(number * each, (number + 1) * each) for number in range(outputs)]
        blocks = np.array([0.5 * (left[own, own] + left[own, own].T) for own in places]).reshape(-1, each, each)
        roots = [inverse_root(own) for own in blocks]
        whitener = block_diag(*roots) if outputs else np.zeros((0, 0))
        values, vectors = np.linalg.eigh(whitener.T @ left @ whitener)
        least = float(np.clip(values.min(initial=1.0), 0.0, 1.0))
        beyond = values - least > HALF_DIGITS
        share = block_diag(*blocks) @ whitener @ vectors[:, beyond] * np.sqrt(values[beyond] - least)
        parameters = np.eye(count + share.shape[1])
        parameters[:count, :count] = known
        return Errors(
            parameters=parameters,
            slopes=np.concatenate([slopes, share], axis=1).reshape(outputs, each, -1),
            spread=least * blocks,
            blocks=np.arange(outputs),
            scales=np.ones(outputs),
        )

    def root(self, output: int) -> Floats:
        """Root of the covariance of the parameters and the columns of one output (parameters + columns, directions)."""
        shared = covariance_root(self.parameters)
        own = covariance_root(self.spread[self.blocks[output]]) * self.scales[output]
        none = np.zeros((len(shared), own.shape[1]))
        return np.block([[shared, none], [self.slopes[output] @ shared, own]])

    def variance(self, output: int, by_parameters: Floats, by_columns: Floats) -> Floats:
        """The variance of real quantities of one output (quantities,), by the same."""
        columns = slice(by_columns.shape[1])
        whole = by_columns @ self.slopes[output, columns]
        whole[:, : by_parameters.shape[1]] += by_parameters
        own = np.sum((by_columns @ self.spread[self.blocks[output], columns, columns]) * by_columns, axis=1)
        shared = np.sum((whole @ self.parameters) * whole, axis=1)
        return np.maximum(shared + own * self.scales[output] ** 2, 0.0)


def estimates_of(
    modes: Sequence[InputMode],
    shapes: Sequence[Complexes],
    errors: Errors,
    fundamental: float,
    free: Sequence[Mask] | None = None,
) -> Estimates:
    """The estimates of modes with amplitudes 2 c (outputs, turns) each, of pairs once."""
    turning = [np.ones(len(mode.turns), bool) if not mode.real else mode.turns > 0.0 for mode in modes]
    begins = np.array([mode.axis for mode in modes])
    columns, place = [], 0
    for own in turning:
        real = place + np.arange(len(own))
        imag = np.full(len(own), -1)
        imag[own] = real[-1] + 1 + np.arange(int(own.sum())) if len(own) else imag[own]
        place += len(own) + int(own.sum())
        columns.append(np.stack([real, imag]))
    real, imag = np.concatenate(columns, axis=1) if columns else np.zeros((2, 0), int)
    there = np.concatenate([np.ones(len(real), bool), imag >= 0])
    both = np.concatenate([real, np.maximum(imag, 0)])
    spread = errors.spread[:, both][:, :, both] * np.outer(there, there)
    half = 0.5 * np.concatenate([np.where(own, 1.0, 2.0) for own in [*turning, np.zeros(0, bool)]])
    selected = selection_of(modes, free, len(errors.parameters))
    slopes = np.moveaxis(errors.slopes[:, both] * there[:, None], 1, 0) @ selected.T
    up, down = np.split(slopes, 2)
    values = np.concatenate([own.T for own in shapes]) if len(shapes) else np.zeros((0, len(errors.blocks)), complex)
    return Estimates(
        exponents=np.array([mode.exponent for mode in modes]) + 1j * begins * fundamental,
        real=np.array([mode.real for mode in modes], bool),
        fundamental=fundamental,
        modes=np.repeat(np.arange(len(modes)), [len(mode.turns) for mode in modes]),
        harmonics=np.rint(np.concatenate([mode.turns - mode.axis for mode in modes])).astype(np.int64),
        coefficients=np.asarray((values * half[:, None])[:, :, None], np.complex128),
        covariance=selected @ errors.parameters @ selected.T,
        slopes=((up + 1j * down) * half[:, None, None])[:, :, None],
        spread=spread,
        blocks=errors.blocks[:, None],
        scales=(half[:, None] * errors.scales).astype(complex)[:, :, None],
        gains=_gains(modes, free, selected) if len(modes) and len(modes[0].gains) else None,
    )


def selection_of(modes: Sequence[InputMode], free: Sequence[Mask] | None = None, width: int | None = None) -> Floats:
    """Selection of the parameters of estimates from the free ones of a fit (parameters, free parameters)."""
    masks = _free(modes, free)
    count, ends = len(modes), np.cumsum([0, *(int(free.sum()) for free in masks)]).tolist()
    parts = []
    for mode, mask, (first, _) in zip(modes, masks, pairwise(ends), strict=True):
        parts.append((first, None if mode.real else first + int(mask[: len(mask) // 2].sum())))
    known = [place for both in parts for place in both if place is not None]
    others = np.setdiff1d(np.arange(width or ends[-1]), known)
    found = np.zeros((2 * count + 1 + len(others), len(known) + len(others)))
    for number, (real, imag) in enumerate(parts):
        found[number, real] = 1.0
        if imag is not None:
            found[count + number, imag] = 1.0
    found[2 * count + 1 + np.arange(len(others)), others] = 1.0
    return found


def _free(modes: Sequence[InputMode], free: Sequence[Mask] | None) -> Sequence[Mask]:
    return [mode.free for mode in modes] if free is None else free


def _gains(modes: Sequence[InputMode], free: Sequence[Mask] | None, selected: Floats) -> Gains:
    """Coefficients b of all modes at the same harmonics, with their slopes."""
    masks = _free(modes, free)
    made = [_listed_gains(mode) for mode in modes]
    harmonics = np.unique(np.concatenate([np.zeros(0, np.int64), *(turns for turns, _, _ in made)]))
    values = np.zeros((len(modes), len(modes[0].gains), len(harmonics)), complex)
    slopes = np.zeros((*values.shape, len(selected)), complex)
    first = 0
    for number, (mask, (turns, own, by)) in enumerate(zip(masks, made, strict=True)):
        where, stop = np.searchsorted(harmonics, turns), first + int(mask.sum())
        values[number][:, where] = own
        slopes[number][:, where] = by[..., mask] @ selected[:, first:stop].T
        first = stop
    return Gains(harmonics=harmonics, coefficients=values, slopes=slopes)


def _listed_gains(mode: InputMode) -> tuple[Integers, Complexes, Complexes]:
    """Harmonics of a mode's gains as a model lists them, b, and its slopes by all parameters of the mode."""
    size, width = mode.gains.size, len(mode.free)
    later = 1 + size if mode.real else 1 + width // 2
    slopes = np.zeros((size, width), complex)
    slopes[np.arange(size), 1 + np.arange(size)], slopes[np.arange(size), later + np.arange(size)] = 1.0, 1j
    slopes = slopes.reshape(*mode.gains.shape, width)
    if not mode.real:
        return mode.reach.astype(np.int64), mode.gains, slopes
    turns, gains = mirrored(mode.reach, mode.gains, mode.axis)
    by = np.moveaxis(slopes, 2, 0)
    # A real part moves both halves alike, an imaginary part against each other: as the values themselves.
    return turns, gains, np.moveaxis(np.array([mirrored(mode.reach, own, mode.axis)[1] for own in by]), 0, 2)


def mirrored(turns: Floats, values: Complexes, shift: float) -> tuple[Integers, Complexes]:
    """Harmonics of a real signal's amplitudes (rows, turns), those below zero too, all moved by a shift."""
    down = turns > 0.0
    own = np.where(down, 0.5, 1.0) * values
    both = np.concatenate([-turns[down][::-1], turns]) + shift
    return np.rint(both).astype(np.int64), np.concatenate([own[:, down][:, ::-1].conj(), own], axis=1)


def terms_of(mode: InputMode, shape: Complexes, fundamental: float) -> list[Term]:
    """A mode of a fit as modes of a model, with amplitudes 2 c (outputs, turns): a pair as two."""
    if mode.real:
        begin = mode.axis
        seen, reached = mirrored(mode.turns, shape, -begin), mirrored(mode.reach, mode.gains, begin)
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


def driven_of(
    modes: Sequence[InputMode],
    inputs: Sequence[Channel],
    direct: dict[int, Complexes],
    outputs: int,
    fundamental: float,
    begins: Floats,
) -> Driven | None:
    """Effects of inputs beside driving the modes; None where there are no inputs."""
    if not inputs:
        return None
    last = max(direct, default=-1)
    turns = np.arange(-last, last + 1, dtype=np.int64) if direct else np.zeros(0, np.int64)
    found = np.zeros((outputs, len(inputs), len(turns)), complex)
    for turn, value in direct.items():
        found[:, :, turns == turn] += value[:, :, None]
        if turn:
            found[:, :, turns == -turn] += value.conj()[:, :, None]
    initial = [mode.initial * np.exp(1j * mode.axis * fundamental * begins) for mode in modes]
    return Driven(
        channels=inputs,
        direct=found,
        direct_harmonics=turns,
        initial=np.array(initial).reshape(len(modes), -1),
        begins=begins,
    )
