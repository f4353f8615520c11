"""Search for the modes of transfer functions that were measured: a grid of exponents, then harmonics by χ²."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from floquid._arrays import Complexes, Floats, Mask
from floquid.fit import FEW_STEPS, RARE, chi2_limit
from floquid.inputs import InputMode, Limits
from floquid.search import CANDIDATES, LOOSE
from floquid.transfer._modal import Fitted, Lines, Modal, eliminated, fitted, near_real, promised, real_for

DECAYS = 10  # decays of the grid, from a part of the distance of lines to their range
FINE = 3  # frequencies of the grid for a line
FAR = 1e3  # the size of an exponent over the highest frequency of the lines from which on a fit ran away from them
HELD = 1e6  # weight of a gain over the initial state, where the scale of a mode is fixed


def searched(lines: Lines, limits: Limits, report: Callable[[str], None] = lambda _: None) -> Fitted | None:
    """The modes that rise above the deviations of G with their harmonics; None where there is none."""
    now: Fitted | None = None
    chi_square = eliminated(lines, Modal((), ())).cost
    while now is None or len(now.modal.modes) < limits.modes:
        trial = _with_one_more(lines, now)
        if trial is None:
            break
        trial = _with_real_ones(lines, _grown(lines, trial, limits), limits)
        more = trial.n_parameters - (0 if now is None else now.n_parameters)
        if chi_square - trial.cost < _by_noise(lines, trial, more, limits.mode_alarm):
            break
        now, chi_square = trial, trial.cost
        report(f"searching for modes: {len(now.modal.modes)} found")
    if now is None:
        return None
    now = _without_needless(lines, now, limits)
    return fitted(lines, _padded(lines, _centred(lines, _with_echoes(lines, now).modal), limits))


def _without_needless(lines: Lines, now: Fitted, limits: Limits) -> Fitted:
    """Without modes that noise explains once the others are fitted again with the harmonics that they then need."""
    for number in reversed(range(len(now.modal.modes) if len(now.modal.modes) > 1 else 0)):
        less = _less(now.modal, [number])
        trial = _grown(lines, fitted(lines, less, FEW_STEPS), limits)
        fewer = now.n_parameters - trial.n_parameters
        if trial.cost - now.cost < _by_noise(lines, now, fewer, limits.mode_alarm):
            return _without_needless(lines, trial, limits)
    return now


def _less(modal: Modal, numbers: Sequence[int]) -> Modal:
    """Modes without some."""
    kept = [k for k in range(len(modal.modes)) if k not in numbers]
    return Modal(tuple(modal.modes[k] for k in kept), tuple(modal.shapes[k] for k in kept), modal.direct)


def _with_echoes(lines: Lines, now: Fitted) -> Fitted:
    """The fit with the transient of the records, where it is more than noise is likely to be."""
    begins = lines.echoes[1]
    if lines.alive or not len(begins):
        return now
    modes = tuple(replace(mode, initial=np.zeros(len(begins), complex)) for mode in now.modal.modes)
    trial = fitted(lines, replace(now.modal, modes=modes))
    limit = _by_noise(lines, trial, trial.n_parameters - now.n_parameters, LOOSE)
    return trial if now.cost - trial.cost > limit else now


def _level(lines: Lines, fit: Fitted, chi_square: float | None = None) -> float:
    """χ² of a degree of freedom, at least 1: deviations that are too small make no modes of noise."""
    left = fit.cost if chi_square is None else chi_square
    return max(left / max(_degrees(lines, fit), 1), 1.0)


def _by_noise(lines: Lines, fit: Fitted, more: int, alarm: float) -> float:
    """Fall of χ² that noise alone may give to `more` parameters; infinite where a fit has as many as data."""
    return chi2_limit(max(more, 1), alarm) * _level(lines, fit) if _degrees(lines, fit) > 0 else np.inf


def _degrees(lines: Lines, fit: Fitted) -> int:
    """Numbers that were measured over those fitted: a fit of as many explains anything."""
    return 2 * int(np.count_nonzero(lines.there)) - fit.n_parameters


def _padded(lines: Lines, modal: Modal, limits: Limits) -> Modal:
    """With one harmonic more at each end of all bands: what is left out has no deviation."""
    for number in range(2 * len(modal.modes)):
        wider = _wider(modal, number, limits, lines.values.shape[1:3])
        if wider is not None and eliminated(lines, wider).n_parameters < np.count_nonzero(lines.there):
            modal = wider
    return modal


def _centred(lines: Lines, modal: Modal) -> Modal:
    """Pairs on the branch on which the outputs see them most, at a positive frequency where it is one."""
    modes, shapes = [], []
    for mode, shape in zip(modal.modes, modal.shapes, strict=True):
        if not mode.real:
            turn = mode.turns[np.argmax(np.linalg.norm(shape, axis=0))]
            mode = mode.turned(turn, lines.fundamental, lines.echoes[1][: len(mode.initial)])
            if mode.exponent.imag < 0.0:
                mode, shape = mode.conjugated(), shape.conj()[:, ::-1]
        modes.append(mode)
        shapes.append(shape)
    return Modal(tuple(modes), tuple(shapes), modal.direct)


def _with_one_more(lines: Lines, now: Fitted | None) -> Fitted | None:
    """The fit with the exponent of the grid that makes it best; None where no fit has fewer numbers than there are."""
    modal = Modal((), ()) if now is None else now.modal
    trials = []
    for exponent in _candidates(lines, lines.values - modal.transfer(lines)):
        for main in (0, 1, -1):
            start = eliminated(lines, _joined(modal, [_bare(lines, exponent, main)]))
            if _degrees(lines, start) > 0:
                trials.append(fitted(lines, start.modal, FEW_STEPS))
    trials = [one for one in trials if np.isfinite(one.cost)]
    return fitted(lines, min(trials, key=lambda one: one.cost).modal) if trials else None


def _bare(lines: Lines, exponent: complex, main: int, bands: tuple[Floats, Floats] | None = None) -> InputMode:
    """A mode reached by one harmonic above all: a pair with one on either side, or a real one of some bands."""
    inputs, records = lines.values.shape[2], len(lines.echoes[1]) * lines.alive
    turns, reach = (np.arange(-1.0, 2.0),) * 2 if bands is None else bands
    gains = np.full((inputs, len(reach)), 0.01 + 0.0j)
    gains[:, main + (bands is None)] = 1.0
    return InputMode(
        exponent=exponent,
        real=bands is not None,
        reach=reach,
        gains=gains,
        turns=turns,
        initial=np.zeros(records, complex),
        sizes=np.full(inputs, HELD),
    )


def _with_real_ones(lines: Lines, now: Fitted, limits: Limits, refused: list[complex] | None = None) -> Fitted:
    """With pairs whose multipliers may be one or two real ones taken for that, where noise explains the rest."""
    refused = [] if refused is None else refused
    modes, omega = now.modal.modes, lines.fundamental
    if any(abs(mode.exponent) > FAR * np.abs(lines.omega).max() for mode in modes):
        return now  # a fit that ran away from the lines is wrong whatever stands for its pairs
    for pairs in near_real(modes, lambda: now.parameters, omega, refused):
        rest = _less(now.modal, pairs)
        kinds, turns, reach = real_for([modes[k] for k in pairs], omega)
        for starts in kinds:
            trials = []
            for mains in product(range(min(2, len(reach))), repeat=len(starts)):
                both = zip(starts, mains, strict=True)
                bare = [_bare(lines, complex(own), main, (turns, reach)) for own, main in both]
                start = eliminated(lines, _joined(rest, bare))
                if _degrees(lines, start) > 0:
                    trials.append(fitted(lines, start.modal, FEW_STEPS))
            if not trials:
                continue
            best = fitted(lines, min(trials, key=lambda one: one.cost).modal)
            best = _grown(lines, best, limits)
            rise = (best.cost - now.cost) / _level(lines, now)
            # These fits are not narrowed: numbers more are no argument against one that is better.
            fewer = max(now.n_parameters - best.n_parameters, 0)
            if rise < (chi2_limit(fewer, RARE) if fewer else 0.0):
                return _with_real_ones(lines, best, limits, refused)
    return now


def _joined(modal: Modal, more: Sequence[InputMode]) -> Modal:
    """Modes with some more, of no amplitudes yet."""
    outputs = len(modal.shapes[0]) if modal.shapes else 1
    bare = (np.zeros((outputs, len(mode.turns)), complex) for mode in more)
    return Modal((*modal.modes, *more), (*modal.shapes, *bare), modal.direct)


def _candidates(lines: Lines, residual: Complexes) -> list[complex]:
    """Exponents that explain most of a residual, harmonics each with an amplitude of its own, best first."""
    low, high = float(lines.omega.min()), float(lines.omega.max())
    gap = (high - low) / max(len(lines.omega) - 1, 1)
    decays = -np.geomspace(0.1 * gap, high, DECAYS)
    turned = np.linspace(max(low - gap, 0.0), high + gap, FINE * len(lines.omega) + 1)
    poles = (decays[:, None] + 1j * turned).ravel()
    left = np.zeros(len(poles))
    for source in range(lines.values.shape[2]):
        there = np.asarray(lines.there[:, :, source].all(axis=(0, 1)), np.bool_)
        std = lines.std[:, :, source, there].reshape(-1, int(there.sum()))
        weight = np.sqrt(np.mean(1.0 / np.abs(std) ** 2, axis=0))
        right = (residual[:, :, source, there].reshape(len(std), -1) * weight).T
        basis = np.concatenate([_resonances(lines, own, there) for own in (poles, poles.conj())], axis=1) * weight
        matrix = np.moveaxis(basis, 1, 2)
        orthogonal, _ = np.linalg.qr(matrix / np.linalg.norm(matrix, axis=1, keepdims=True))
        left += np.sum(np.abs(right) ** 2) - np.sum(np.abs(orthogonal.conj().swapaxes(1, 2) @ right) ** 2, axis=(1, 2))
    chosen: list[complex] = []
    for pole in poles[np.argsort(left)].tolist():
        if all(abs(pole - other) > max(2.0 * gap, abs(other.real)) for other in chosen):
            chosen.append(pole)
        if len(chosen) == CANDIDATES:
            break
    return chosen


def _resonances(lines: Lines, poles: Complexes, there: Mask) -> Complexes:
    """1/(i(Ω + lω) - λ), or that of samples, of l from -1 to 1 (exponents, 3, frequencies)."""
    turned = 1j * (lines.omega[there] + np.arange(-1, 2)[:, None] * lines.fundamental)
    if lines.held is None:
        return np.asarray(1.0 / (turned - poles[:, None, None]), np.complex128)
    step = lines.held[0]
    return np.asarray(1.0 / (np.exp(turned * step) - np.exp(poles * step)[:, None, None]), np.complex128)


def _grown(lines: Lines, now: Fitted, limits: Limits) -> Fitted:
    """The fit with harmonics of inputs, of outputs and of D beside its own as long as each makes it better."""
    improved = True
    while improved:
        improved = False
        for number in range(2 * len(now.modal.modes) + 1):
            wider = _wider(now.modal, number, limits, lines.values.shape[1:3])
            if wider is None:
                continue
            start = eliminated(lines, wider)
            if _degrees(lines, start) <= 0:
                continue
            # What is left holds what other bands lack: no measure of noise, and χ² decides.
            limit = chi2_limit(max(start.n_parameters - now.n_parameters, 1), limits.harmonic_alarm)
            promise = promised(start)
            if now.cost - promise < limit * _level(lines, start, promise):
                continue
            trial = fitted(lines, wider, FEW_STEPS)
            if now.cost - trial.cost > limit * _level(lines, trial):
                now, improved = trial, True
    return now


def _wider(modal: Modal, number: int, limits: Limits, size: tuple[int, ...]) -> Modal | None:
    """Modes, one with one harmonic more on either side of its turns (even number) or reach, or one more of D."""
    if number == 2 * len(modal.modes):
        return replace(modal, direct=(*modal.direct, np.zeros(size, complex))) if len(modal.direct) < 3 else None
    place, side = divmod(number, 2)
    mode, shape = modal.modes[place], modal.shapes[place]
    bands = (mode.turns, mode.reach)[side]
    if bands[-1] >= limits.highest:
        return None
    below = 0 if mode.real else 1
    added = np.concatenate([bands[:below] - 1.0, bands, bands[-1:] + 1.0])
    pad = ((0, 0), (below, 1))
    if side == 0:
        mode, shape = replace(mode, turns=added), np.pad(shape, pad)
    else:
        mode = replace(mode, reach=added, gains=np.pad(mode.gains, pad))
    modes, shapes = list(modal.modes), list(modal.shapes)
    modes[place], shapes[place] = mode, shape
    return Modal(tuple(modes), tuple(shapes), modal.direct)
