"""Random linear time-periodic systems, drawn from ranges."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from benchmarks.order.random_systems import CLASSES, RandomSystem, Ranges
from numpy.typing import NDArray

from floquid._checks import integer
from floquid.core import PeriodicModel

HARMONICS = np.arange(-4, 5)
"""Those of the shapes: -3 to 3, and -4 to 3 where a real negative multiplier pairs harmonic m with -m - 1."""

ROUNDING = 1e-10
"""The deviation, as a share of the largest response, that stands for noise where there is none."""

CYCLES_A_POLE = 4
"""Cycles that a record holds at least for each of its poles."""

PAIR, REAL, HALF = 0, 1, -1
"""Kinds of modes: a conjugate pair, a real exponent, a real negative multiplier."""


def random_system(seed: int, ranges: Ranges | None = None) -> RandomSystem:
    r"""A random linear time-periodic system with records of its free response.

    .. math:: y_h(t) = \sum_r \sum_m \psi_{r,m} L_{r,h}\, e^{(\lambda_r + i m \omega) t}

    (Allen 2009, eqs. 11-12, for several hits.) Exponents have random decays and frequencies, on random branches; the
    sizes of a shape's harmonics halve from one to the next; each mode has its own size in each hit. Channels have
    units of their own. Half of the systems with weak modes have one, the others two.

    Parameters
    ----------
    seed
        Each seed gives one system, and always the same.
    ranges
        What is drawn from; by default as wide as what floquid is made for.

    Returns
    -------
    RandomSystem
        The system, its records and their noise.

    Raises
    ------
    InputError
        `seed` is not an integer of at least 0.
    """
    seed = integer(seed, "seed", "random_system", at_least=0)
    ranges, generator = ranges or Ranges(), np.random.default_rng([seed, 0])
    modes = _whole(ranges.modes, generator)
    classes = _classes(modes, ranges, generator)
    logs, kinds = _exponents(modes, classes, ranges, generator)
    outputs = _whole(ranges.outputs, generator)
    channels = min(_whole(ranges.channels, generator), outputs)
    hits = int(generator.integers(ranges.hits[0], ranges.hits[1] + 1)) if "several hits" in classes else 1
    lengths = _lengths(int(np.where(kinds == PAIR, 2, 1).sum()), hits, ranges, generator)
    shapes = _shapes(kinds, channels, hits, ranges, generator)
    if "weak mode" in classes:
        weak = generator.choice(modes, min(modes - 1, int(generator.integers(1, 3))), replace=False)
        shapes[weak] *= _log(ranges.weakness, generator, len(weak))[:, None, None, None]
    period, n_phases = float(_log((0.01, 10.0), generator)), outputs // channels
    spread = float(_log(ranges.correlation, generator)) * n_phases if "coloured noise" in classes else 0.0
    system = RandomSystem(
        truth=_model(logs / period, kinds, shapes, period),
        n_phases=n_phases,
        lengths=lengths,
        noise=np.ones((channels, hits)),
        correlation=float(np.exp(-1.0 / spread)) if spread else 0.0,
        classes=classes,
        seed=seed,
    )
    largest = np.max([np.abs(values).max(axis=1) for values in system.clean()], axis=0)
    level = ROUNDING if "no noise" in classes else float(_log(ranges.noise, generator))
    return replace(system, noise=np.repeat(level * largest[:, None], hits, axis=1))


def _log(bounds: tuple[float, float], generator: np.random.Generator, size: int | None = None) -> NDArray[np.float64]:
    """A number between the bounds, uniform in the logarithm."""
    return np.exp(generator.uniform(np.log(bounds[0]), np.log(bounds[1]), size))


def _whole(bounds: tuple[int, int], generator: np.random.Generator) -> int:
    """A whole number between the bounds, both included, about uniform in the logarithm."""
    return int(np.clip(np.floor(_log((bounds[0], bounds[1] + 1), generator)), *bounds))


def _classes(modes: int, ranges: Ranges, generator: np.random.Generator) -> tuple[str, ...]:
    """The classes of the system, as far as it has modes enough for them."""
    shares = (ranges.pairs, ranges.weak, ranges.real, ranges.half, ranges.coloured, ranges.several, ranges.exact)
    drawn = [name for name, share in zip(CLASSES, shares, strict=True) if generator.uniform() < share]
    needs = {"close pair": 2, "real exponent": 1, "half-per-rev": 1}
    left, kept = modes, []
    for name in drawn:
        if needs.get(name, 0) > left or (name == "weak mode" and modes < 2):
            continue
        if name == "no noise" and "coloured noise" in kept:
            continue
        left -= needs.get(name, 0)
        kept.append(name)
    return tuple(kept)


def _exponents(
    modes: int, classes: tuple[str, ...], ranges: Ranges, generator: np.random.Generator
) -> tuple[NDArray[np.complex128], NDArray[np.int64]]:
    """λT and the kind of each mode (modes,)."""
    logs = -_log(ranges.decay, generator, modes) + 1j * generator.uniform(0.0, np.pi, modes)
    kinds = np.full(modes, PAIR)
    if "close pair" in classes:
        width = 2.0 * abs(logs[0].real)
        logs[1] = logs[0].real * _log(ranges.width_ratio, generator) + 1j * logs[0].imag
        # Towards the middle of the strip, so that the pair is not reflected onto itself.
        logs[1] += np.sign(0.5 * np.pi - logs[0].imag) * 1j * width * _log(ranges.separation, generator)
    if "real exponent" in classes:
        kinds[-1], logs[-1] = REAL, logs[-1].real
    if "half-per-rev" in classes:
        at = modes - 1 - int("real exponent" in classes)
        kinds[at], logs[at] = HALF, logs[at].real + 1j * np.pi
    turns = generator.integers(0, 3, modes) * (kinds == PAIR)
    sign = np.where(turns > 0, generator.choice([-1, 1], modes), 1)
    return logs.real + 1j * (sign * logs.imag + 2.0 * np.pi * turns), kinds


def _lengths(poles: int, hits: int, ranges: Ranges, generator: np.random.Generator) -> NDArray[np.int64]:
    """The periods of each hit; later hits are up to half as long."""
    least = max(ranges.cycles[0], CYCLES_A_POLE * poles)
    first = _whole((least, max(least, ranges.cycles[1])), generator)
    others = generator.integers(max(least, first // 2), first + 1, hits - 1)
    return np.array([first, *others], dtype=np.int64)


def _shapes(
    kinds: NDArray[np.int64], channels: int, hits: int, ranges: Ranges, generator: np.random.Generator
) -> NDArray[np.complex128]:
    """The coefficients of each mode (modes, channels, hits, harmonics): an outer product of a shape and the hits."""
    size, turned = (len(kinds), channels, len(HARMONICS)), HARMONICS[::-1]
    shapes = generator.standard_normal(size) + 1j * generator.standard_normal(size)
    shapes *= 0.5 ** np.abs(HARMONICS) * (np.abs(HARMONICS) < 4)
    inputs = _log(ranges.strength, generator, len(kinds) * hits).reshape(len(kinds), hits)
    inputs = inputs * np.exp(2j * np.pi * generator.uniform(size=inputs.shape))
    for mode in np.flatnonzero(kinds != PAIR):
        # Real where it must be: harmonic m is the conjugate of -m, or of -m - 1 with a multiplier below zero.
        mirror = turned if kinds[mode] == REAL else turned - 1
        image = [shapes[mode, :, m - HARMONICS[0]] if m >= HARMONICS[0] else np.zeros(channels) for m in mirror]
        shapes[mode] = 0.5 * (shapes[mode] + np.conj(np.stack(image, axis=-1)))
        inputs[mode] = np.abs(inputs[mode]) * generator.choice([-1.0, 1.0], hits)
    units = 10.0 ** generator.uniform(-2.0, 2.0, channels)
    return shapes[:, :, None, :] * units[:, None, None] * inputs[:, None, :, None]


def _model(
    exponents: NDArray[np.complex128], kinds: NDArray[np.int64], shapes: NDArray[np.complex128], period: float
) -> PeriodicModel:
    """The periodic model, each pair's conjugate after it."""
    all_exponents, all_shapes = [], []
    for s, kind, shape in zip(exponents, kinds, shapes, strict=True):
        all_exponents.append(s)
        all_shapes.append(shape)
        if kind == PAIR:
            all_exponents.append(np.conj(s))
            all_shapes.append(shape[..., ::-1].conj())
    return PeriodicModel(
        exponents=np.array(all_exponents),
        coefficients=np.stack(all_shapes),
        harmonics=HARMONICS,
        period=period,
        channels=[f"c{number}" for number in range(1, shapes.shape[1] + 1)],
    )
