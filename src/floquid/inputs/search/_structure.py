"""Structures of a fit with inputs, their price, and the limits of a search."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from floquid.fit import chi2_limit
from floquid.inputs._modes import InputMode
from floquid.search import SECONDS


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of a search."""

    # The probabilities that noise passes for a mode, and for a harmonic
    mode_alarm: float = 1e-9
    harmonic_alarm: float = 1e-6
    # The highest harmonic of input and output; of a pair the next whole number above zero where it is a half
    highest: float = 12
    # Modes that may be found, at most, and poles; None for as many as there are
    modes: int = 20
    order: int | None = None
    seconds: float = SECONDS  # The processor time of a search [s]
    until: float = math.inf  # That at which it ends, once it has begun [s]

    def begun(self) -> Limits:
        """The limits of a search that begins now."""
        return replace(self, until=time.process_time() + self.seconds)

    @property
    def most(self) -> int:
        """Modes that a search may begin with, at most."""
        return self.modes if self.order is None else min(self.modes, -(-self.order // 2))

    def room(self, modes: Sequence[Any]) -> bool:
        """True where a search may add a mode to some."""
        poles = sum(1 if mode.real and mode.square is None else 2 for mode in modes)
        return len(modes) < self.modes and (self.order is None or poles < self.order)

    @property
    def over(self) -> bool:
        """True once the processor time of the search is used up."""
        return time.process_time() > self.until


@dataclass(frozen=True, slots=True, eq=False)
class Structure:
    """Modes with their harmonics, and the harmonics of the direct term."""

    modes: tuple[InputMode, ...]
    direct: tuple[float, ...]

    def without(self, gone: Iterable[int]) -> Structure:
        """Without some modes."""
        return replace(self, modes=tuple(own for k, own in enumerate(self.modes) if k not in set(gone)))

    def within(self, highest: float) -> Structure:
        """With no harmonic beyond the highest; a band of none keeps the one nearest to it."""
        modes = []
        for mode in self.modes:
            for band in ("turns", "reach"):
                own = np.abs(getattr(mode, band))
                kept = own <= max(highest, own.min())
                mode = mode if kept.all() else mode.with_band(band, getattr(mode, band)[kept])
            modes.append(mode)
        return replace(self, modes=tuple(modes))

    def joined(self, modes: Iterable[InputMode]) -> Structure:
        """With some modes more."""
        return replace(self, modes=(*self.modes, *modes))


@dataclass(frozen=True, slots=True)
class Price:
    """Price of the units of a structure: the gain that noise exceeds with the probabilities that the user allows."""

    limits: Limits
    outputs: int
    inputs: int
    records: int

    def mode(self, *, real: bool) -> float:
        """Price of an exponent with its first states."""
        return chi2_limit((1 if real else 2) * (1 + self.records), self.limits.mode_alarm)

    def seen(self, turn: float, *, real: bool = False) -> float:
        """Price of a harmonic of the outputs."""
        return chi2_limit((1 if real and not turn else 2) * self.outputs, self.limits.harmonic_alarm)

    def driven(self, turn: float, *, real: bool = False) -> float:
        """Price of a harmonic of the inputs."""
        return chi2_limit((1 if real and not turn else 2) * self.inputs, self.limits.harmonic_alarm)

    def direct(self, turn: float) -> float:
        """Price of a harmonic of the direct term."""
        return chi2_limit((2 if turn else 1) * self.inputs * self.outputs, self.limits.harmonic_alarm)

    def of_mode(self, mode: InputMode) -> float:
        """Price of a mode with its harmonics."""
        seen = sum(self.seen(turn, real=mode.real) for turn in mode.turns.tolist())
        return self.mode(real=mode.real) + seen + sum(self.driven(turn, real=mode.real) for turn in mode.reach.tolist())

    def of(self, structure: Structure) -> float:
        """Price of a structure."""
        return sum(map(self.of_mode, structure.modes)) + sum(map(self.direct, structure.direct))
