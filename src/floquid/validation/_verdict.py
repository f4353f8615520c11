"""Sentences on what speaks against a model: where, how much, and what to do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from floquid.core import PeriodicModel

LISTED = 3
"""Findings of one kind that are named one by one."""


@dataclass(frozen=True, slots=True)
class Names:
    """What channels, hits and modes are called."""

    model: PeriodicModel

    def channel(self, channel: int, hit: int) -> str:
        """One response."""
        name = f"channel {self.model.channels[channel].name}"
        return f"{name} of hit {hit + 1}" if self.model.n_hits > 1 else name

    def mode(self, mode: int) -> str:
        """One mode, by its frequency."""
        return f"the mode at {self.model.frequencies_hz[mode]:.4g} Hz"

    def tone(self, turn: float, per_revolution: float) -> str:
        """One harmonic of the revolution."""
        if turn == 0.0:
            return "an offset"
        return f"{Fraction(turn * per_revolution).limit_denominator(999)} per revolution"


def listed(parts: Sequence[str]) -> str:
    """The first few, and how many more there are."""
    more = len(parts) - LISTED
    return "; ".join(parts[:LISTED]) + (f"; and {more} more" if more > 0 else "")


def sentence(text: str, remedy: str) -> str:
    """What is wrong, and what to do."""
    return f"{text[0].upper()}{text[1:]}. {remedy}"


def strongest(sizes: np.ndarray) -> list[tuple[int, ...]]:
    """The indices of what is above zero, the largest first."""
    found = np.argwhere(sizes > 0)
    order = np.argsort(-1.0 * sizes[tuple(found.T)], kind="stable")
    return [tuple(int(i) for i in found[k]) for k in order]
