"""Modes with periodic shapes, measured or modelled alike; and pairs of real multipliers that are one locked pair."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from floquid._arrays import Complexes, Floats, Integers
from floquid.core._channel import Channel
from floquid.core._shape import Shape


@runtime_checkable
class PeriodicModes(Protocol):
    """Interface of modes in named channels: those of a `PeriodicModel`, identified or of a known A(t)."""

    @property
    def exponents(self) -> Complexes:
        """The Floquet exponents λ (modes,) [1/s], conjugates one by one."""

    @property
    def covariance(self) -> Floats | None:
        """Covariance of the exponents (2 modes, 2 modes): real parts, then imaginary parts; None of a known system."""

    @property
    def harmonics(self) -> Integers:
        """The integers m of the shapes, ascending (harmonics,)."""

    @property
    def period(self) -> float:
        """The period [s]."""

    @property
    def channels(self) -> tuple[Channel, ...]:
        """One `Channel` a row of each shape."""

    @property
    def point(self) -> Mapping[str, float]:
        """The operating point, numbers by name."""

    @property
    def couples(self) -> tuple[tuple[int, int], ...]:
        """Pairs of modes that are one pair locked to the period, two real multipliers of one sign."""

    def shape(self, mode: int, reference: str | None = None) -> Shape:
        """The shape of a `mode`, one for all hits; its largest line, or that of a `reference` channel, is positive."""
        ...


LIKE = 0.5
"""Least share of one half shape along another at which two real multipliers may be one pair; unlike ones have none."""

APART = 0.1  # least lead of that share over the share along any third real multiplier, at which a couple is sure


@dataclass(frozen=True, slots=True, kw_only=True)
class Couple:
    """Two real multipliers of one sign that have the place of one pair.

    Parameters
    ----------
    modes
        Their numbers, ascending.
    likeness
        The share of one half shape along the other, 0 to 1.
    is_sure
        True where no third real multiplier of that sign is nearly as much like one of them.
    """

    modes: tuple[int, int]
    likeness: float
    is_sure: bool


def couples_of(modes: PeriodicModes) -> tuple[Couple, ...]:
    """Couples among the real multipliers of `modes`, by the lines of positive frequency of their shapes.

    A pair that is locked to the period has two real shapes, each a complex multiple of the shape of the pair and its
    conjugate: their halves of positive frequency differ by a factor alone. Two real multipliers of one sign are a
    couple where each is more like the other than like any third.
    """
    turns = 2.0 * modes.exponents.imag * modes.period / (2.0 * np.pi)
    found = []
    for parity in (0, 1):
        members = [k for k in np.flatnonzero(np.abs(turns - np.rint(turns)) < 1e-6) if np.rint(turns[k]) % 2 == parity]
        if len(members) < 2:
            continue
        likeness = _likeness([_half(modes.shape(int(k)), int(np.rint(turns[k]))) for k in members])
        nearest = likeness.argmax(axis=1)
        for i, j in enumerate(nearest.tolist()):
            if i < j and nearest[j] == i and likeness[i, j] >= LIKE:
                thirds = np.delete(likeness[[i, j]], [i, j], axis=1).max(initial=0.0)
                pair = (int(members[i]), int(members[j]))
                sure = bool(likeness[i, j] - thirds >= APART)
                found.append(Couple(modes=pair, likeness=float(likeness[i, j]), is_sure=sure))
    return tuple(sorted(found, key=lambda couple: couple.modes))


def _half(shape: Shape, half_turns: int) -> Complexes:
    """Lines of a shape by their frequency, in halves of the fundamental, from zero on (channels, frequencies)."""
    places = 2 * shape.harmonics + half_turns
    ahead = places >= 0
    out = np.zeros((len(shape.channels), int(places.max(initial=0)) + 1), complex)
    out[:, places[ahead]] = shape.values[:, ahead]
    return out


def _likeness(halves: Sequence[Complexes]) -> Floats:
    """Share of each half shape along each other (modes, modes), channels in units of their size; zero for itself."""
    width = max(half.shape[1] for half in halves)
    whole = np.stack([np.pad(half, ((0, 0), (0, width - half.shape[1]))) for half in halves])
    norms = np.sqrt(np.sum(np.abs(whole) ** 2, axis=(1, 2), keepdims=True))
    whole = whole / np.where(norms > 0.0, norms, 1.0)
    size = np.sqrt(np.mean(np.sum(np.abs(whole) ** 2, axis=2), axis=0))
    whole = whole / np.where(size > 0.0, size, 1.0)[:, None]
    flat = whole.reshape(len(whole), -1)
    norms = np.linalg.norm(flat, axis=1, keepdims=True)
    flat = flat / np.where(norms > 0.0, norms, 1.0)
    shares = np.abs(flat.conj() @ flat.T) ** 2
    np.fill_diagonal(shares, 0.0)
    return shares
