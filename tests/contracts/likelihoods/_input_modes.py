"""Modes of the contract as `InputMode`, which the likelihoods of measured inputs and of lines have in common."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from tests.contracts.likelihoods._point import Mode, Name

from floquid.inputs import InputMode


def input_mode(mode: Mode, size: np.ndarray) -> InputMode:
    """With the rms of each input (inputs,), by which a gain counts beside a first state."""
    return InputMode(
        exponent=mode.exponent,
        real=mode.real,
        reach=mode.driven,
        gains=mode.gains,
        turns=mode.seen,
        initial=mode.initial,
        sizes=2.0 * size,
    )


def plain_mode(mode: InputMode, shape: np.ndarray) -> Mode:
    return Mode(
        exponent=mode.exponent,
        real=mode.real,
        seen=mode.turns,
        shape=shape,
        driven=mode.reach,
        gains=mode.gains,
        initial=mode.initial,
    )


def names_of(modes: Sequence[InputMode]) -> tuple[Name, ...]:
    """Those of the free parameters, in the order of `InputMode.free`."""
    names: list[Name] = []
    for number, mode in enumerate(modes):
        size, begins = mode.gains.size, len(mode.initial)
        gains, initial = ([(number, kind, k) for k in range(n)] for kind, n in (("gain", size), ("initial", begins)))
        real, turning = [(number, "decay", 0), *gains], [(number, "frequency", 0), *gains, *initial]
        own = [*real, *gains, *initial] if mode.real else [*real, *initial, *turning]
        names += [name for name, free in zip(own, mode.free, strict=True) if free]
    return tuple(names)


def moved_modes(modes: Sequence[InputMode], step: np.ndarray) -> list[InputMode]:
    """Each a step of its free parameters away."""
    found, place = [], 0
    for mode in modes:
        own = np.zeros(len(mode.free))
        own[mode.free] = step[place : place + int(mode.free.sum())]
        place += int(mode.free.sum())
        found.append(mode.moved(own))
    return found
