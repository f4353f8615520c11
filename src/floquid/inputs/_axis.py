"""Pairs near an axis of real multipliers, and two of these of one sign, fitted as one block."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from floquid.inputs._bands import grown, narrowed
from floquid.inputs._joint import fitted_together
from floquid.inputs._kinds import block_of_pair, block_of_reals, half_of, ordinary
from floquid.inputs._modes import InputMode
from floquid.inputs._real import noise_explains
from floquid.inputs._samples import Samples
from floquid.inputs._scores import Limits
from floquid.inputs._solver import Linearisation, covariance, linearise, solve
from floquid.inputs._start import bare_mode
from floquid.inputs._states import runs_away

NEAR, APART = 5.0, 6.0
"""Deviations of q from zero up to which a block is tried, and from which on its two readings are ordinary modes."""

STEPS = 8
"""Steps of a fit with a block."""

FLAT = 0.5
"""The ratio of the axes of the ellipses along which the states of a block are seen and driven, up to which it is kept
whatever its harmonics cost."""

SAME = 0.05
"""The distance of two exponents over their decay below which they are one."""


def with_blocks(
    samples: Samples, now: Linearisation, limits: Limits, tried: list[complex] | None = None
) -> Linearisation:
    """The fit with pairs near an axis, or two real multipliers of one sign, as a block, or as one real multiplier.

    Each is tried once: those that were, by their exponents, join `tried`.
    """
    tried = [] if tried is None else tried
    spread = covariance(samples, now) if now.modes else np.zeros((0, 0))
    for numbers in _near_axis(samples, now, spread):
        marks = [_mark(now.modes[number]) for number in numbers]
        if all(any(abs(own - other) < SAME * abs(other.real) for other in tried) for own in marks):
            continue
        tried += marks
        for trial in _trials(samples, now, numbers, limits):
            rise, fewer = now.log_likelihood - trial.log_likelihood, now.n_parameters - trial.n_parameters
            one = trial.modes[-1].square is None  # the other is below noise, or it is needed
            if not (one or _told(samples, trial)):
                continue
            better = not one and (trial.criterion >= now.criterion or (rise < 0.0 and _nearly_real(trial)))
            if better or noise_explains(rise, fewer):
                return with_blocks(samples, trial, limits, tried)
    return _parted(samples, now, spread)


def _near_axis(samples: Samples, now: Linearisation, spread: NDArray[np.float64]) -> Iterator[list[int]]:
    """Numbers of modes that may be one block: of pairs of one sign all together first."""
    modes, omega, places = now.modes, samples.fundamental, np.cumsum([0, *(m.free.sum() for m in now.modes)])
    near: dict[float, list[int]] = {}
    for number, mode in enumerate(modes):
        if mode.real or runs_away(samples, mode.growth):
            continue
        half = half_of(mode, omega)
        imag = (places[number] + places[number + 1]) // 2
        # The deviations of q from zero are half those of its root.
        if abs(mode.exponent.imag - half * omega) < 2.0 * NEAR * spread[imag, imag] ** 0.5:
            near.setdefault(half % 1.0, []).append(number)
    for pairs in near.values():
        yield from [pairs, *([[one] for one in pairs] if len(pairs) > 1 else [])]
    real = [number for number, mode in enumerate(modes) if mode.real and not runs_away(samples, mode.growth)]
    yield from [[number] for number in real if modes[number].square is not None]
    for one, other in combinations([number for number in real if modes[number].square is None], 2):
        if modes[one].lowest == modes[other].lowest:
            a, b = places[one], places[other]
            gap = abs(modes[one].exponent.real - modes[other].exponent.real)
            if gap < 2.0 * NEAR * max(spread[a, a] + spread[b, b] - 2.0 * spread[a, b], 0.0) ** 0.5:
                yield [one, other]


def _trials(samples: Samples, now: Linearisation, numbers: Sequence[int], limits: Limits) -> Iterator[Linearisation]:
    """Fits with one real multiplier for some modes, or with a block."""
    own = [now.modes[number] for number in numbers]
    rest = [mode for k, mode in enumerate(now.modes) if k not in numbers]

    def fitted(mode: InputMode) -> Linearisation:
        found = grown(samples, solve(samples, [*rest, mode], now.direct, iterations=STEPS, rough=True), limits)
        found = solve(samples, found.modes, found.direct, iterations=STEPS, rough=True)
        return narrowed(samples, found, limits)

    one, ends = _real_starts(own)
    left = linearise(samples, rest, now.direct).left

    def started(decays: Sequence[float]) -> list[InputMode]:
        turns, reach = (
            max((_folded_band(mode, name, samples.fundamental) for mode in own), key=len) for name in ("turns", "reach")
        )
        bare = [bare_mode(samples, complex(decay), reach, turns, real=True) for decay in decays]
        return fitted_together(samples, left, bare)[1]

    reals = [mode for mode in own if mode.real and mode.square is None]
    with suppress(np.linalg.LinAlgError):
        if not reals:
            yield fitted(started([one])[0])
    if any(mode.square is not None for mode in own):
        return
    with suppress(np.linalg.LinAlgError):
        blocks = [block_of_pair(samples, mode) for mode in own if not mode.real][:1]
        if reals:
            blocks = [block_of_reals(reals[0], reals[1], samples.fundamental)]
        else:
            fast, slow = started(ends)
            blocks.append(block_of_reals(fast, slow, samples.fundamental))
        yield max((fitted(block) for block in blocks), key=lambda trial: trial.criterion)


def _real_starts(modes: Sequence[InputMode]) -> tuple[float, tuple[float, float]]:
    """Exponents with which one real multiplier, and two, for some modes begin."""
    if len(modes) == 1 and modes[0].square is not None:
        return modes[0].growth, (0.0, 0.0)
    decays = [mode.exponent.real for mode in modes]
    ends = (0.7 * decays[0], 1.4 * decays[0]) if len(decays) == 1 else (max(decays), min(decays))
    return float(np.mean(decays)), ends


def _folded_band(mode: InputMode, name: str, omega: float) -> NDArray[np.float64]:
    """Harmonics about the axis of a mode's `turns` or `reach`."""
    half = 0.0 if mode.real else half_of(mode, omega) * (1.0 if name == "turns" else -1.0)
    band = np.abs(getattr(mode, name) + half)
    return np.arange(band.min() % 1.0, band.max() + 0.5)


def _parted(samples: Samples, now: Linearisation, spread: NDArray[np.float64]) -> Linearisation:
    """The same fit with the pair, or the two real multipliers, for each block whose q is far from zero."""
    found, place, begins = [], 0, samples.first_times
    for number, mode in enumerate(now.modes):
        place += int(mode.free.sum())
        if mode.square is None or abs(mode.square) < APART * spread[place - 1, place - 1] ** 0.5:
            found.append(mode)
            continue
        found += [own for own, _ in ordinary(mode, now.shape(number).T, samples.fundamental, begins)]
    return (
        now
        if len(found) == len(now.modes) and not any(a is not b for a, b in zip(found, now.modes, strict=True))
        else linearise(samples, [mode.scaled() for mode in found], now.direct)
    )


def _told(samples: Samples, now: Linearisation) -> bool:
    """True where q of the last mode, a block, is told: a pair of q less its deviation is nearest to this axis."""
    square = now.modes[-1].square
    assert square is not None
    std = float(np.sqrt(covariance(samples, now)[-1, -1]))
    return float(np.sqrt(max(-square, 0.0) + std)) < 0.25 * samples.fundamental


def _nearly_real(now: Linearisation) -> bool:
    """True where the last mode is a block whose shape and inputs are real, but for a factor and a small part.

    Where a pair meets the axis they are: harmonics that noise explains, on the other side, are no argument for it.
    A pair that crosses the axis as the frequency of a constant system does turns one way: no block is regular there.
    """
    mode = now.modes[-1]
    assert mode.square is not None
    root = float(np.sqrt(abs(mode.square)))
    shape, gains = now.shape(len(now.modes) - 1) / now.noise, mode.gains * np.tile(mode.sizes, 2)[:, None]
    ratios = []
    for both in (shape.reshape(2, -1) * [[root], [1.0]], gains.reshape(2, -1) * [[1.0], [root]]):
        low, high = np.linalg.eigvalsh((both @ both.conj().T).real)
        ratios.append(low / max(high, 1e-300))
    return max(ratios) < FLAT**2


def _mark(mode: InputMode) -> complex:
    """The exponent of a mode, of a block σ and √|q|."""
    return mode.exponent if mode.square is None else mode.exponent + 1j * np.sqrt(abs(mode.square))
