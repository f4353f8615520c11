"""The cases: many modes, much noise, close pairs; and systems of every kind."""

from __future__ import annotations

from dataclasses import replace

from benchmarks.order.drawing import random_system
from benchmarks.order.random_systems import RandomSystem, Ranges

PLAIN = Ranges(
    outputs=(50, 100),
    channels=(2, 8),
    cycles=(100, 400),
    decay=(0.01, 0.03),
    strength=(0.5, 1.0),
    noise=(0.02, 0.02),
    pairs=0.0,
    weak=0.0,
    real=0.0,
    half=0.0,
    coloured=0.0,
    several=0.0,
    exact=0.0,
)
"""Modes that ring for tens of periods in some channels and phases, every one of them strong."""


LOUD = {"outputs": (100, 100), "cycles": (400, 400), "decay": (0.005, 0.01), "strength": (0.7, 1.0)}
"""What it takes for most modes to be told in noise of 50 %."""


def _modes(number: int, noise: float = 0.02) -> Ranges:
    return replace(PLAIN, modes=(number, number), noise=(noise, noise))


def _pair(separation: float, noise: float = 0.02) -> Ranges:
    pair = replace(_modes(2, noise), pairs=1.0, separation=(separation, separation), width_ratio=(1.0, 1.0))
    return replace(pair, outputs=(200, 200), cycles=(400, 400), decay=(0.01, 0.02), strength=(0.7, 1.0))


CASES: dict[str, Ranges] = {
    "2 modes, 2 %": _modes(2),
    "5 modes, 2 %": _modes(5),
    "10 modes, 2 %": _modes(10),
    "20 modes, 2 %": _modes(20),
    "5 modes, 20 %": _modes(5, 0.2),
    "5 modes, 50 %": replace(_modes(5, 0.5), **LOUD),
    "pair, a tenth, 2 %": _pair(0.1),
    "pair, a fortieth, 2 %": _pair(0.025),
    "pair, a tenth, 20 %": _pair(0.1, 0.2),
}

RANDOM = "random systems"
"""Systems across all ranges."""


def system_of(case: str, number: int) -> RandomSystem:
    """The system of one draw of a case: another one each time."""
    return random_system(number, CASES.get(case))
