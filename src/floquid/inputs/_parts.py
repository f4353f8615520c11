"""Modes of a fit with inputs as a model lists them, with deviations: of a block those of its readings."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from floquid.core import readings
from floquid.inputs._kinds import mirrored, ordinary
from floquid.inputs._modes import InputMode
from floquid.inputs._uncertainty import Uncertainty

Term = tuple[complex, NDArray[np.int64], NDArray[np.complex128], NDArray[np.int64], NDArray[np.complex128]]
"""λ, the harmonics m, c (outputs, harmonics), the harmonics l, b (inputs, harmonics)."""

ASIDE = 0.1
"""The share of the deviation of q that it is at least off zero where shapes are made of a block."""


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
    more: tuple[float, float] = (0.0, 0.0)
    """Variances of Re λ and Im λ beside those by the parameters."""


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
        std = mirrored(mode.turns, shape[1], -begin, deviations=True)[1]
        gain_std = mirrored(mode.reach, gain_std, begin, deviations=True)[1]
        initial = initial * np.exp(1j * begin * fundamental * begins)
    return Part(mode.real, exponent, rows, harmonics, coefficients, std, reach, gains, gain_std, initial)


def terms_of(mode: InputMode, shape: NDArray[np.complex128], fundamental: float) -> list[Term]:
    """A mode of a fit as modes of a model, with amplitudes 2 c (outputs, turns): a pair or a block as two."""
    if mode.square is not None:
        parts = ordinary(mode, shape, fundamental, np.zeros(len(mode.initial) // 2))
        return [term for own, part in parts for term in terms_of(own, part, fundamental)]
    if mode.real:
        begin = mode.turns[0] % 1.0
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


def parts_of(found: Uncertainty, number: int) -> list[Part]:
    """A mode of the fit as a model lists it: a block as a pair or as two real multipliers."""
    at, mode = found.at, found.at.modes[number]
    if mode.square is not None:
        return _parts_of_block(found, number)
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
    return [listed(mode, (shape, std), gain_std, rows, samples.fundamental, samples.first_times)]


def readable(found: Uncertainty, number: int) -> InputMode:
    """A block with its q at least a tenth of its deviation off zero, where shapes grow as 1/√|q|."""
    mode = found.at.modes[number]
    assert mode.square is not None
    last = found.places[number][0].stop - 1
    least = ASIDE * float(np.sqrt(found.parameters[last, last]))
    return replace(mode, square=float(np.copysign(max(abs(mode.square), least), mode.square)))


def _parts_of_block(found: Uncertainty, number: int) -> list[Part]:
    """The pair, or the two real multipliers, of a block, with deviations to first order of all but the exponents."""
    at, mode, samples = found.at, readable(found, number), found.samples
    omega, begins, count = samples.fundamental, samples.first_times, len(samples.values)
    place, free = found.places[number]

    def read(own: InputMode, shape: NDArray[np.complex128]) -> list[tuple[InputMode, NDArray[np.complex128]]]:
        return ordinary(own, shape, omega, begins)

    shape, steps = at.shape(number).T, np.sqrt(np.diag(found.parameters)[place])
    own, sides = read(mode, shape), []
    for index, std in zip(np.flatnonzero(free), 1e-3 * steps, strict=True):
        step = np.zeros(len(free))
        step[index] = std
        both = [read(mode.moved(sign * step), shape) for sign in (1.0, -1.0)]
        sides.append((2.0 * std, both))
    columns = at.slices()[number][0]
    unit = np.zeros((len(at.columns), shape.shape[1]), complex)
    for column in range(columns.start, columns.stop):
        unit[column] = replace(at, coefficients=np.eye(len(at.columns))[:, [column]]).shape(number)[:, 0]
    of_unit, parts = read(mode, unit), []
    ends = [place.start, place.stop - 1]
    slopes, more = _slopes_of_readings(mode, found.parameters[np.ix_(ends, ends)])
    for k, (one, amplitudes) in enumerate(own):
        by_gain = [(up[k][0].gains - down[k][0].gains).ravel() / size for size, (up, down) in sides]
        by_shape = [(up[k][1] - down[k][1]) / size for size, (up, down) in sides]
        gains = np.array(by_gain).T
        spread = found.parameters[place, place]
        gain_std = _roots(np.einsum("qp,pr,qr->q", part, spread, part) for part in (gains.real, gains.imag))
        std = np.zeros(amplitudes.shape, complex)
        for channel in range(count):
            by_parameters = np.zeros((amplitudes.shape[1], len(found.parameters)), complex)
            by_parameters[:, place] = np.array([own_slope[channel] for own_slope in by_shape]).T
            by_columns = of_unit[k][1].T
            std[channel] = _roots(
                found.variance(channel, a, b)
                for a, b in ((by_parameters.real, by_columns.real), (by_parameters.imag, by_columns.imag))
            )
        rows = np.zeros((2, len(free)))
        rows[:, [0, -1]] = slopes[k]
        rows = found.spread_over(number, rows)
        part = listed(one, (amplitudes, std), gain_std.reshape(one.gains.shape), rows, omega, begins)
        parts.append(replace(_on_branch(part, at.noise, omega, begins), more=tuple(more[k].tolist())))
    return parts


def _slopes_of_readings(
    mode: InputMode, covariance: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Slopes of both exponents of a block by σ and q (exponents, parts, 2), and variances beside (exponents, parts).

    Parts are the real and the imaginary one. Both make the deviations of `readings`, with the covariance of σ and q.
    """
    assert mode.square is not None
    _, std = readings(mode.exponent.real, mode.square, covariance, 0, 1.0)
    own, s = np.stack([std.real, std.imag], axis=1), max(float(np.sqrt(covariance[1, 1])), 1e-300)
    slope = min(
        0.5 / max(float(np.sqrt(abs(mode.square))), 1e-300), float(std[0].real if mode.square > 0.0 else own[0, 1]) / s
    )
    slopes = np.zeros((2, 2, 2))
    slopes[:, 0, 0] = 1.0
    slopes[:, 0 if mode.square > 0.0 else 1, 1] = slope * np.array([1.0, -1.0])
    variance = np.einsum("epk,kl,epl->ep", slopes, covariance, slopes)
    slopes *= np.minimum(own / np.sqrt(np.maximum(variance, 1e-300)), 1.0)[:, :, None]
    return slopes, np.maximum(own**2 - np.einsum("epk,kl,epl->ep", slopes, covariance, slopes), 0.0)


def _roots(variances: Iterable[NDArray[np.float64]]) -> NDArray[np.complex128]:
    """Deviations of real and of imaginary parts, from their variances."""
    real, imag = (np.sqrt(np.maximum(own, 0.0)) for own in variances)
    return real + 1j * imag


def _on_branch(part: Part, noise: NDArray[np.float64], omega: float, begins: NDArray[np.float64]) -> Part:
    """A pair on the branch whose zeroth harmonic is seen most, of a frequency that is not negative."""
    if part.real:
        return part
    turn = int(part.harmonics[np.argmax(np.sum(np.abs(part.coefficients.T / noise) ** 2, axis=1))])
    part = replace(
        part,
        exponent=part.exponent + 1j * turn * omega,
        harmonics=part.harmonics - turn,
        reach=part.reach + turn,
        initial=part.initial * np.exp(1j * turn * omega * begins),
    )
    if part.exponent.imag >= 0.0:
        return part
    return replace(
        part,
        exponent=part.exponent.conjugate(),
        rows=part.rows * np.array([[1.0], [-1.0]]),
        harmonics=-part.harmonics[::-1],
        coefficients=part.coefficients[:, ::-1].conj(),
        coefficient_std=part.coefficient_std[:, ::-1],
        reach=-part.reach[::-1],
        gains=part.gains[:, ::-1].conj(),
        gain_std=part.gain_std[:, ::-1],
        initial=part.initial.conj(),
    )
