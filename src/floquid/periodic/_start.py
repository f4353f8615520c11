"""Start of a fit from lifted responses: one mode a multiplier and group of harmonics, beside the forced response.

What repeats with the revolution (an orbit, gravity, an imbalance, an offset) has multipliers e^{2πij/ν}, with ν periods
a revolution; a drift is one of multiplier 1 that grows with time. Neither is a mode, however near one lies.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from floquid._arrays import Complexes, Floats
from floquid.core import PeriodicModel
from floquid.fit import DEVIATIONS, HALF_DIGITS, MODES, OFF, RARE, ROUNDING, SLOW, SURE, chi2_limit
from floquid.lifting import Lifted, largest_values, whitened, whitening_filter
from floquid.lti import ERA, ModalModel
from floquid.periodic.expansion import expansion, physical_exponents
from floquid.periodic.least_squares import ModeParameters
from floquid.search import GAP


def groups(modal: ModalModel, lifted: Lifted) -> ModeParameters:
    """One mode for each pole of `modal` and group of its harmonics significant in `lifted`, its band about the largest.

    Modes fold onto one another in lifted responses: their poles then come out as one, or bent. Their harmonics lie at
    different unfolded frequencies, and start as separate modes. They are split at the sign of the frequency and at gaps
    of more than `GAP` harmonics; where they are one mode after all, a test of equal exponents joins them.
    """
    expanded = expansion(modal, lifted)
    omega = 2.0 * np.pi / lifted.period
    limit = chi2_limit(2 * expanded.coefficients.shape[1] * expanded.coefficients.shape[2], SURE)
    exponents, bands = [], []
    for r in expanded.upper:
        score = _score(expanded.coefficients[r], expanded.std[r])
        turns = expanded.exponents[r].imag / omega + expanded.harmonics
        seen = (score > limit) & (np.abs(turns) < 0.5 * lifted.n_phases - HALF_DIGITS)
        if expanded.real[r]:
            seen &= turns > -HALF_DIGITS  # the other half is its conjugate
        if not seen.any():
            seen[int(np.argmax(score * (turns > -HALF_DIGITS)))] = True
        places = np.flatnonzero(seen)
        cut = (np.diff(expanded.harmonics[places]) > GAP) | (np.sign(turns[places[1:]]) != np.sign(turns[places[:-1]]))
        for group in np.split(places, np.flatnonzero(cut) + 1):
            strongest = int(group[np.argmax(score[group])])
            value = expanded.exponents[r] + 1j * omega * expanded.harmonics[strongest]
            ends = expanded.harmonics[group[[0, -1]]] - expanded.harmonics[strongest]
            if value.imag < 0.0:
                value, ends = value.conjugate(), -ends[::-1]
            if expanded.real[r]:
                least = omega / int(lifted.responses.lengths.max())
                # On the axis, nothing says which way it lies.
                value += 1j * OFF * max(abs(value.real), least)
            exponents.append(value)
            bands.append(ends)
    return ModeParameters.made(exponents, np.array(bands, np.int64).reshape(-1, 2), omega)


def distinct_multipliers(model: PeriodicModel) -> int:
    """The number of multipliers of a model that deviations tell apart: two modes may share one.

    Free in each hit, the residues of one mode hold those of both, and only outer products of shape and hit tell them
    apart.
    """
    std = np.zeros(model.order, np.complex128) if model.exponent_std is None else model.exponent_std
    kept: list[int] = []
    for mode in np.flatnonzero(model.multipliers.imag >= -HALF_DIGITS):
        gaps = model.exponents[kept] - model.exponents[mode]
        gaps -= 1j * model.fundamental * np.rint(gaps.imag / model.fundamental)
        within = DEVIATIONS * (np.hypot(std.real[kept], std.real[mode]) + 1j * np.hypot(std.imag[kept], std.imag[mode]))
        within += (1.0 + 1.0j) * HALF_DIGITS * model.fundamental
        if not ((np.abs(gaps.real) < within.real) & (np.abs(gaps.imag) < within.imag)).any():
            kept.append(int(mode))
    return int(np.sum(np.where(np.abs(model.multipliers.imag[kept]) > HALF_DIGITS, 2, 1)))


def _score(coefficients: Complexes, std: Complexes) -> Floats:
    """The chi-square of each harmonic over channels and hits (harmonics,)."""
    total = np.zeros(coefficients.shape[-1])
    for value, deviation in ((coefficients.real, std.real), (coefficients.imag, std.imag)):
        share = np.divide(value, deviation, out=np.zeros_like(value), where=deviation > 0)
        total += np.sum(share**2, axis=(0, 1))
    return total


def held_shapes(modal: ModalModel, lifted: Lifted, *, false_alarm: float) -> tuple[ModalModel, int]:
    r"""The modal model with residues held to harmonics, and the number of harmonics on each side.

    .. math:: R_{k,r} \approx \sum_{|m| \le M} B_{r,m}\, e^{(\lambda_r + i m \omega) t_k}

    by least squares, which weighs each phase by what the response is there. An expansion of R e^{-λt} alone weighs the
    end of the period like its beginning, where noise is e^{λT} times louder. M is the least that raises the cost by no
    more than noise explains; it raises it by more with the probability `false_alarm`. `modal` is the modal model of the
    responses in `lifted`.
    """
    from scipy.special import chdtri

    exponents, most = physical_exponents(modal, lifted), (lifted.n_phases - 1) // 2
    for width in range(most):
        held = replace(modal, residues=_held(modal, lifted, exponents, width))
        moved = physical_exponents(held, lifted)
        if (moved != exponents).any():
            held = replace(modal, residues=_held(modal, lifted, moved, width))
        fewer = modal.order * lifted.n_channels * (lifted.n_phases - 2 * width - 1)
        if _rise(modal, held, lifted) < float(chdtri(fewer, false_alarm)):
            return held, width
    return modal, most


def _held(modal: ModalModel, lifted: Lifted, exponents: Complexes, width: int) -> Complexes:
    """Residues (modes, outputs, hits) with harmonics on each side of the branch of each mode."""
    omega, residues = 2.0 * np.pi / lifted.period, np.array(modal.residues)
    for mode, value in enumerate(exponents):
        low = high = 0
        if modal.multipliers[mode].imag == 0.0:
            # The shape of a real multiplier is its own conjugate, and so are its harmonics.
            mirror = -round(2.0 * value.imag / omega)
            low, high = min(0, mirror), max(0, mirror)
        rates = value + 1j * omega * np.arange(low - width, high + width + 1)
        columns, _ = np.linalg.qr(np.exp(np.multiply.outer(lifted.phase_times, rates)))
        shapes = lifted.by_channel(residues[mode])
        held = np.einsum("pm,qm,cqh->cph", columns, columns.conj(), shapes, optimize=True)
        held = held.reshape(residues[mode].shape)
        residues[mode] = held.real if modal.multipliers[mode].imag == 0.0 else held
    return residues


def _rise(modal: ModalModel, held: ModalModel, lifted: Lifted) -> float:
    """The squares of the difference of two models over the noise, over all samples."""
    total, change = 0.0, held.residues - modal.residues
    for hit, length in enumerate(lifted.responses.lengths.tolist()):
        powers = np.exp(np.multiply.outer(modal.poles * lifted.period, np.arange(length)))
        moved: Floats = (change[:, :, hit].T @ powers).real / lifted.responses.noise[:, hit, None]
        total += float(np.sum(moved**2))
    return total


FEWEST = 8  # cycles below which what is known is not told from a free response, for each of its multipliers


@dataclass(frozen=True, slots=True)
class Known:
    """Forced response that lifted responses hold.

    Parameters
    ----------
    roots
        The multipliers e^{2πip} that are there, as p in [0, 1/2] (roots,).
    drift
        Whether there is a drift.
    turns
        Turns a period of the harmonics that rise above the noise, the zeroth among them (harmonics,).
    """

    roots: tuple[float, ...] = ()
    drift: bool = False
    turns: tuple[float, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.roots) or self.drift

    def basis(self, n_cycles: int) -> Floats:
        """Orthonormal columns over the `n_cycles` of a hit (n_cycles, columns)."""
        columns = [part for root in self.roots for part in columns_of(root, n_cycles)]
        if self.drift:
            columns.append(_drift(n_cycles))
        q, _ = np.linalg.qr(np.stack(columns, axis=1))
        return np.asarray(q, np.float64)


def columns_of(root: float, n_cycles: int) -> list[Floats]:
    """Real columns of the multiplier e^{2πip} (cycles,)."""
    angles = 2.0 * np.pi * root * np.arange(n_cycles)
    return [np.cos(angles)] if 2.0 * root == round(2.0 * root) else [np.cos(angles), np.sin(angles)]


def _drift(n_cycles: int) -> Floats:
    return np.linspace(-1.0, 1.0, n_cycles)


def without_known(
    lifted: Lifted, nu: float, *, speeds: Sequence[Floats] | None = None, halves: bool = False
) -> tuple[Lifted, Known, Floats | None]:
    """The `lifted` responses without the forced response in them, that response, and filters that whiten the rest.

    Generous poles take the free response with them, so that what is left to the known columns is theirs. There are `nu`
    periods in a revolution; with `halves`, one that repeats after two periods is looked for where that is one: an orbit
    that is half-wave symmetric. The forced response follows a wandering speed by the factors `speeds`, an array a hit
    (factors, cycles). The filters are of what generous poles leave (channels, taps), None where that is white.
    """
    count = round(nu) if nu >= 1.0 else 1
    roots = [k / count for k in range(count // 2 + 1)]
    if halves and count == 1 and lifted.responses.lengths.min() >= 2 * FEWEST:
        roots.append(0.5)
    modal = generous_poles(lifted)
    taps = whitening_filter(lifted, modal)
    if lifted.responses.lengths.min() < FEWEST * count:
        return lifted, Known(), taps
    # Judged where the noise is white: else what is loud near a known multiplier passes for a forced response.
    judged = lifted if taps is None else whitened(lifted, taps)
    lengths = judged.responses.lengths.tolist()
    poles = _apart(modal if taps is None else generous_poles(judged), roots, max(lengths))
    known = Known(tuple(roots), True)
    bases = [_orthonormal(_columns(poles, length)) for length in lengths]
    for root in (None, *roots):
        kept = tuple(r for r in known.roots if r != root)
        less = Known(known.roots, False) if root is None else Known(kept, known.drift)
        beside = [_with(basis, less, length) for basis, length in zip(bases, lengths, strict=True)]
        if not _gains(judged, beside, [known.basis(length) for length in lengths]):
            known = less
    if count == 1 and 0.5 in known.roots:
        beside = [_with(basis, known, length) for basis, length in zip(bases, lengths, strict=True)]
        if _gains(judged, beside, [_drift(n)[:, None] * np.stack(columns_of(0.5, n), axis=1) for n in lengths]):
            # An orbit is steady. What grows or decays is a real multiplier, next to the edge of a resonance.
            known = Known(tuple(root for root in known.roots if root != 0.5), known.drift)
    if not known:
        return lifted, known, taps
    poles = _apart(modal, known.roots, int(lifted.responses.lengths.max()))
    free, turns = _subtracted(lifted, poles, known, speeds)
    return free, Known(known.roots, known.drift, turns), whitening_filter(free, generous_poles(free))


def generous_poles(lifted: Lifted) -> ModalModel:
    """More poles than there are modes, of lifted responses: they take any response with them, and leave the noise."""
    era = ERA()
    order = max(1, min(2 * MODES, int(lifted.responses.lengths.max()) // 3))
    return era.extract(era.prepare(lifted.responses), order)


def _apart(modal: ModalModel, roots: Sequence[float], n_cycles: int) -> Complexes:
    """Logarithms of the multipliers, of the upper half, that are told from the known ones."""
    logs = np.asarray(np.log(modal.multipliers), np.complex128)
    logs = logs[logs.imag >= -HALF_DIGITS]
    for root in roots:
        logs = logs[np.abs(logs - 2j * np.pi * root) * n_cycles > SLOW]
    return np.asarray(logs, np.complex128)


def _columns(poles: Complexes, n_cycles: int) -> Floats:
    """Real columns of the poles (cycles, columns), what grows being counted from the end."""
    counts = np.arange(n_cycles)[:, None] - np.where(poles.real > 0, n_cycles - 1, 0)
    powers = np.asarray(np.exp(counts * poles), np.complex128)
    return np.concatenate([powers.real, powers.imag], axis=1)


def _orthonormal(columns: Floats) -> Floats:
    """A basis of columns, except for those that are rounding (cycles, rank)."""
    size = np.linalg.norm(columns, axis=0)
    vectors, values, _ = np.linalg.svd(columns[:, size > 0] / size[size > 0], full_matrices=False)
    return vectors[:, values > ROUNDING * values.max(initial=1e-300)]


def _beyond(basis: Floats, columns: Floats, least: float) -> Floats:
    """A basis of what orthonormal columns have beyond another basis, where it is that share at least (cycles, rank)."""
    vectors, values, _ = np.linalg.svd(columns - basis @ (basis.T @ columns), full_matrices=False)
    return vectors[:, values > least]


def _squares_left(values: Floats, basis: Floats) -> Floats:
    """The sum of squares that orthonormal columns leave of responses (responses,)."""
    taken = values @ basis
    whole = np.einsum("rn,rn->r", values, values)
    squares = whole - np.einsum("rk,rk->r", taken, taken)
    if (squares > HALF_DIGITS * whole).all():
        return squares
    return np.sum((values - taken @ basis.T) ** 2, axis=1)


def _with(basis: Floats, known: Known, length: int) -> Floats:
    """Orthonormal columns with those of what is known (cycles, rank)."""
    return np.concatenate([basis, _beyond(basis, known.basis(length), ROUNDING)], axis=1) if known else basis


def _gains(lifted: Lifted, bases: Sequence[Floats], more: Sequence[Floats]) -> bool:
    """True where columns take more off the misfit than noise does, beside orthonormal ones, an array a hit of each."""
    total, degrees, data = 0.0, 0, lifted.responses
    for hit, (basis, columns) in enumerate(zip(bases, more, strict=True)):
        extra, length = _beyond(basis, columns, RARE), len(basis)
        values = data.values[:, hit, :length]
        seen = values @ extra
        free = max(length - basis.shape[1] - extra.shape[1], 1)
        squares = _squares_left(values, np.concatenate([basis, extra], axis=1))
        noise = lifted.by_channel(squares[:, None] / free).mean(axis=1)[:, 0]
        power = lifted.by_channel(np.sum(seen**2, axis=1)[:, None]).sum(axis=1)[:, 0]
        total += float(np.sum(power / np.maximum(noise, _least(lifted)[:, hit])))
        degrees += extra.shape[1] * len(values)
    return total > chi2_limit(max(degrees, 1), SURE)


def _least(lifted: Lifted) -> Floats:
    """The least variance that the noise is taken to have (channels, hits)."""
    return (lifted.floor * largest_values(lifted.responses.values, lifted.n_channels)) ** 2 + 1e-300


def _subtracted(
    lifted: Lifted, poles: Complexes, known: Known, speeds: Sequence[Floats] | None
) -> tuple[Lifted, tuple[float, ...]]:
    """The responses without the known columns, and the turns a period of their harmonics above the noise."""
    data = lifted.responses
    values, turns_of_hits = np.array(data.values), []
    for hit, length in enumerate(data.lengths.tolist()):
        columns = [(root, part) for root in known.roots for part in columns_of(root, length)]
        names, stack = [root for root, _ in columns], [part for _, part in columns]
        if known.drift:
            stack.append(_drift(length))
        if speeds is not None:
            stack += [speed * part for _, part in columns for speed in speeds[hit]]
        system = np.concatenate([np.stack(stack, axis=1), _columns(poles, length)], axis=1)
        size = np.linalg.norm(system, axis=0)
        system = system[:, size > 0] / size[size > 0]
        inverse = np.linalg.pinv(system, rcond=1e-10)
        response = data.values[:, hit, :length]
        amplitudes = response @ inverse.T
        values[:, hit, :length] = response - amplitudes[:, : len(stack)] @ system[:, : len(stack)].T
        noise = np.sum((response - amplitudes @ system.T) ** 2, axis=1) / max(length - system.shape[1], 1)
        noise = np.maximum(lifted.by_channel(noise[:, None]).mean(axis=1)[:, 0], _least(lifted)[:, hit])
        spread = np.sum(inverse**2, axis=1)
        turns_of_hits.append(_harmonics(lifted, names, amplitudes[:, : len(names)], noise, spread[: len(names)]))
    turns = sorted({turn for each in turns_of_hits for turn in each})
    values.flags.writeable = False
    free = replace(data, values=values, taken=known.basis(int(data.lengths.max())))
    return replace(lifted, responses=free), tuple(turns)


def _harmonics(lifted: Lifted, roots: Sequence[float], amplitudes: Floats, noise: Floats, spread: Floats) -> set[float]:
    """Turns a period of the harmonics of known columns that rise above the noise, up to half of the samples."""
    half, omega = lifted.n_phases // 2, 2.0 * np.pi / lifted.period
    limit, turns_found = chi2_limit(2 * lifted.n_channels, SURE), set()
    for column, root in enumerate(roots):
        turns = root + np.arange(-half, half + 1)
        kernel = np.exp(-1j * omega * np.multiply.outer(turns, lifted.phase_times)) / lifted.n_phases
        shapes = lifted.by_channel(amplitudes[:, column : column + 1])[:, :, 0]
        power = np.abs(shapes @ kernel.T) ** 2
        scale = noise[:, None] * spread[column] / (2.0 * lifted.n_phases)
        seen = (power / scale).sum(axis=0) > limit
        turns_found |= {abs(float(turn)) for turn in turns[seen] if abs(turn) <= 0.5 * lifted.n_phases}
    return turns_found
