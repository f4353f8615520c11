"""Coefficients of a constrained fit: values, deviations, bands, and the model they make."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Complexes, Floats, Integers
from floquid.core import Channel, Estimates, PeriodicModel, Provenance, modelled
from floquid.errors import IdentificationError
from floquid.fit import FEW_STEPS, REST, SURE, WITHIN
from floquid.periodic.expansion import select_bands
from floquid.periodic.least_squares._one_shape import OneShape
from floquid.periodic.least_squares._parameters import ModeParameters
from floquid.periodic.least_squares._sample_block import Block
from floquid.periodic.least_squares._solver import Solution, linearise, solve
from floquid.search import GAP


@dataclass(frozen=True, slots=True)
class Shapes:
    """Coefficients of each entry (entries, channels, hits, harmonics), and their deviations, part by part."""

    harmonics: Integers
    coefficients: Complexes
    std: Complexes


def estimates_of(blocks: Sequence[Block], solution: Solution) -> Estimates:
    """Coefficients of every entry of a fit, those of the forced response too, with their joint covariance."""
    entries = solution.entries
    columns, sines, parameters = entries.columns(), entries.sines(), entries.parameters()
    n, count = len(columns.modes), len(entries.exponents)
    shape = (n, 1 + max(int(b.rows.max()) for b in blocks), 1 + max(b.hit for b in blocks))
    coefficients, scales = np.zeros((2, *shape), complex)
    slopes = np.zeros((*shape, len(solution.gradient)), complex)
    spread, drift = np.zeros((2, len(blocks), 2 * n, 2 * n))
    which, bend = np.zeros(shape[1:], np.int64), np.zeros(shape, complex)
    # What each parameter moves the rate of a column by.
    rate = np.where(parameters.turns[:, None], 1j, 1.0) * parameters.weights[:, :n]
    signs = np.repeat([1.0, -1.0], n)
    for number, (block, linear) in enumerate(zip(blocks, solution.linear, strict=True)):
        gain = block.gain(columns.rates)
        relative = (block.gain(columns.rates, slope=True) / gain).T
        factor = np.where(sines, 0.5, 1.0)[:, None] / gain.T / block.scales(columns)[:, None]
        alpha, beta = np.split(linear.coefficients, 2)
        block_coefficients = (alpha - 1j * beta) * factor
        # The slopes are those of e^{st} counted from t = 0, also where a column is scaled by its end.
        along = linear.inverse @ linear.mixed
        moved = -np.einsum("kl,plc->kcp", along, parameters.applied(linear.coefficients))
        up, down = np.split(moved, 2)
        coefficients[:, block.rows, block.hit] = block_coefficients
        slopes[:, block.rows, block.hit] = (up - 1j * down) * factor[:, :, None] - block_coefficients[
            :, :, None
        ] * np.einsum("kc,pk->kcp", relative, rate)
        scales[:, block.rows, block.hit] = factor * block.noise
        spread[number], drift[number] = (signs[:, None] * matrix * signs for matrix in (linear.inverse, along))
        bend[:, block.rows, block.hit] = relative
        which[block.rows, block.hit] = number
    place = parts_of(entries)
    return Estimates(
        exponents=entries.exponents + 1j * entries.fundamental * entries.offsets * entries.real,
        real=entries.real,
        fundamental=entries.fundamental,
        modes=columns.modes,
        harmonics=columns.harmonics,
        coefficients=coefficients,
        covariance=place @ solution.covariance() @ place.T
        if len(solution.gradient)
        else np.zeros((2 * count + 1,) * 2),
        slopes=np.matmul(slopes, place.T, dtype=np.complex128),
        spread=spread,
        blocks=which,
        scales=scales,
        drift=drift,
        bend=bend if bend.any() else None,
    )


def estimates_of_shapes(shared: OneShape, further: Floats | None = None) -> Estimates:
    """Coefficients of the modes of a fit of one shape for all hits, with their joint covariance."""
    entries, columns_free, count = shared.entries, shared.own, len(shared.entries.exponents)
    columns, sines, parameters = entries.columns(), entries.sines(), entries.parameters()
    n, rates = len(columns_free), shared.n_rates
    shape = (n, shared.n_channels, shared.states.shape[1])
    coefficients, scales, bend = np.zeros((3, *shape), complex)
    slopes = np.zeros((*shape, len(shared.whole[1])), complex)
    rate = np.where(parameters.turns[:, None], 1j, 1.0) * parameters.weights[:, columns_free]
    spread, along = (
        np.zeros((shared.n_channels, 2 * n, 2 * n)),
        np.zeros((shared.n_channels, 2 * n, len(shared.whole[1]))),
    )
    spread[np.ix_(np.arange(shared.n_channels), shared.kept, shared.kept)] = shared.inverse
    along[:, shared.kept] = -shared.inverse @ shared.whole[2]
    moved = np.moveaxis(along[:, :n] + 1j * along[:, n:], 0, 1)  # of the shapes (columns, channels, parameters)
    first = (
        rates + shared.modes * shared.states.shape[1]
    )  # the real part of the state of a column's mode in the first hit
    for block in shared.blocks:
        gain = block.gain(columns.rates)[:, columns_free].T
        relative = block.gain(columns.rates, slope=True)[:, columns_free].T / gain
        factor = np.where(sines, 0.5, 1.0)[columns_free, None] / gain / block.scales(columns)[columns_free, None]
        state, seen = shared.states[shared.modes, block.hit][:, None], shared.complex_shapes[:, block.rows]
        own_slopes = state[..., None] * moved[:, block.rows]
        for part, unit in ((0, 1.0), (shared.states.size, 1j)):
            own_slopes[np.arange(n), :, first + part + block.hit] += unit * seen
        coefficients[:, block.rows, block.hit] = state * seen * factor
        own_slopes *= factor[..., None]
        own_slopes[..., :rates] -= np.einsum("kc,kc,pk->kcp", state * seen * factor, relative, rate)
        slopes[:, block.rows, block.hit] = own_slopes
        scales[:, block.rows, block.hit] = state * factor
        bend[:, block.rows, block.hit] = relative
    place = np.zeros((2 * count + 1 + len(shared.free), len(shared.whole[1])))
    place[: 2 * count + 1, :rates] = parts_of(entries)
    place[2 * count + 1 + np.arange(len(shared.free)), rates + shared.free] = 1.0
    covariance = shared.covariance.copy()
    covariance[:rates, :rates] = shared.of_rates(further)
    return Estimates(
        exponents=entries.exponents + 1j * entries.fundamental * entries.offsets * entries.real,
        real=entries.real,
        fundamental=entries.fundamental,
        modes=columns.modes[columns_free],
        harmonics=columns.harmonics[columns_free],
        coefficients=coefficients,
        covariance=place @ covariance @ place.T,
        slopes=np.matmul(slopes, place.T, dtype=np.complex128),
        spread=spread,
        blocks=np.tile(np.arange(shared.n_channels)[:, None], (1, shape[2])),
        scales=scales,
        bend=bend if bend.any() else None,
        shared=True,
    )


def parts_of(entries: ModeParameters) -> Floats:
    """Selection of real parts, imaginary parts and the fundamental from the parameters (2 entries + 1, parameters)."""
    decays, pairs = np.flatnonzero(~entries.fixed), np.flatnonzero(~entries.fixed & ~entries.real)
    count = len(entries.exponents)
    parts = np.concatenate([decays, count + pairs, [2 * count] * entries.free_period]).astype(int)
    place = np.zeros((2 * count + 1, len(parts)))
    place[parts, np.arange(len(parts))] = 1.0
    return place


def shapes(blocks: Sequence[Block], solution: Solution) -> Shapes:
    """The coefficients that a fit has, with their deviations."""
    return _shapes(solution.entries, estimates_of(blocks, solution))


def _shapes(entries: ModeParameters, whole: Estimates) -> Shapes:
    """The estimates, by harmonics that all entries have."""
    low, high = int(entries.bands[:, 0].min(initial=0)), int(entries.bands[:, 1].max(initial=0))
    low, high = (
        min(low, -int(entries.half_turns.max(initial=0)) - high),
        max(high, -int(entries.half_turns.min(initial=0)) - low),
    )
    harmonics = np.arange(low, high + 1)
    coefficients, std = np.zeros((2, len(entries.exponents), *whole.blocks.shape, len(harmonics)), complex)
    for place, values in ((coefficients, whole.coefficients), (std, whole.std())):
        np.moveaxis(place, 3, 1)[whole.modes, whole.harmonics - low] = values
    _mirror(entries, harmonics, coefficients, std)
    return Shapes(harmonics, coefficients, std)


def _mirror(entries: ModeParameters, harmonics: Integers, coefficients: NDArray, std: NDArray) -> None:
    """The other half of a real multiplier's shape."""
    for entry in np.flatnonzero(entries.real):
        for place, m in enumerate(harmonics):
            mirrored = -int(entries.half_turns[entry]) - m - harmonics[0]
            if 2 * m + entries.half_turns[entry] > 0 and 0 <= mirrored < len(harmonics):
                coefficients[entry, :, :, mirrored] = coefficients[entry, :, :, place].conj()
                std[entry, :, :, mirrored] = std[entry, :, :, place]


def chosen_bands(blocks: Sequence[Block], wide: Solution) -> Integers:
    """The bands above the noise, of entries not fixed."""
    entries, fitted_shapes = wide.entries, shapes(blocks, wide)
    harmonics = fitted_shapes.harmonics
    seeds = np.stack([np.minimum(0, -entries.half_turns), np.maximum(0, -entries.half_turns)], axis=1)
    seeds = np.clip(seeds, harmonics[0], harmonics[-1])
    those = (fitted_shapes.coefficients, fitted_shapes.std, harmonics, seeds)
    free = int((~entries.fixed).sum())
    kept = select_bands(*those, false_alarm=SURE, n_modes=free)
    bands = np.array([(harmonics[row][0], harmonics[row][-1]) for row in kept], np.int64).reshape(-1, 2)
    return np.where(entries.fixed[:, None], entries.bands, bands)


def model_of(
    blocks: Sequence[Block],
    solution: Solution,
    bands: Integers,
    *,
    channels: tuple[Channel, ...],
    provenance: Provenance,
    most: int | None,
    as_read: Mapping[int, complex] | None = None,
    one: OneShape | None = None,
) -> PeriodicModel:
    """The periodic model of the entries that are not fixed, each with its conjugate, harmonics within the bands."""
    order = _in_order(solution.entries if one is None else one.entries)
    whole = estimates_of(blocks, solution) if one is None else estimates_of_shapes(one, solution.further)
    estimates = whole.picked(modes=order)
    low, high = bands[order].T
    # Of a real multiplier the harmonics that turn backwards are mirror images.
    mirror = -estimates.half_turns - low
    high = np.where(estimates.real, np.maximum(high, mirror), high)[estimates.modes]
    kept = (estimates.harmonics >= low[estimates.modes]) & (estimates.harmonics <= high)
    return modelled(
        estimates,
        kept=kept,
        channels=channels,
        provenance=provenance,
        unselected=None if most is None else unselected(blocks, solution, bands, most),
        as_read={number: as_read[int(entry)] for number, entry in enumerate(order) if int(entry) in as_read}
        if as_read
        else None,
    )


def _in_order(entries: ModeParameters) -> Integers:
    """The entries that are not fixed, the smallest exponent first."""
    free = np.flatnonzero(~entries.fixed)
    size = np.abs(entries.exponents + 1j * entries.fundamental * entries.offsets)[free]
    return free[np.argsort(size, kind="stable")]


def unselected(blocks: Sequence[Block], solution: Solution, bands: Integers, most: int) -> Estimates | None:
    """The estimates of the same fit with more harmonics beyond the bands reported; None where there is no such fit."""
    try:
        wide = linearise(blocks, replace(solution.entries, bands=bands).padded(GAP + 1, most))
        scale = np.sqrt(np.maximum(np.diag(wide.information), 0.0))
        step = np.asarray(np.linalg.solve(wide.information, wide.gradient), np.float64)
        if np.abs(step * scale).max(initial=0.0) > WITHIN:  # one step of a linearisation does not stand for a fit
            wide = solve(blocks, wide, at_rest=REST, iterations=FEW_STEPS)
        else:
            start = tuple(block.coefficients for block in wide.linear)
            wide = linearise(blocks, wide.entries.moved(step), start)
        whole = estimates_of(blocks, wide)
    except (IdentificationError, np.linalg.LinAlgError):
        return None
    return whole.picked(modes=_in_order(solution.entries))
