"""Search over structures by one objective: descent of J, each structure tried once, the best predicted move first."""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Generic, Protocol, Self, TypeVar

import numpy as np

from floquid._arrays import Floats

CANDIDATES = 3  # candidates of a further mode that are fitted, the strongest first: each takes long
TRIES = 12  # moves of one round that are fitted, the best predicted first: what comes later hardly ever helps
HOPE = 2.0  # times the fall of J that a linearisation promises beyond which no fit goes
SAME = 0.06  # the difference of two exponents times the period [1] within which structures count as one
NEAR = 0.5  # decays within which two modes may be one
LOOSE = 0.02  # probability at which noise may pass for a harmonic that is fitted: one that is missing does more harm
REACH = 4.0  # times its price up to which it is tried whether the other modes can do without one
GAP = 3  # harmonics beyond the end of a band that are looked at: a symmetric system has every other one
SECONDS = 120.0  # processor time of a search [s] after which the least J so far is reported: ten dear records

Structure = TypeVar("Structure")


@dataclass(frozen=True, slots=True)
class Move(Generic[Structure]):
    """Candidate structure, and the predicted change of J."""

    change: float
    name: str
    structure: Structure
    least: float = 1e-3  # the fall of J from which on it is accepted: what is less is rounding
    again: bool = False  # whether it is the same structure, whose fit goes on
    helped: bool = False  # whether it gets the harmonics that it needs before it is given up


class Point(Protocol[Structure]):
    """A structure that is fitted, with its J."""

    @property
    def value(self) -> float:
        """J."""
        ...

    @property
    def n_modes(self) -> int:
        """Modes of the structure."""
        ...

    def name(self, structure: Structure | None = None) -> Hashable:
        """Name of this structure or of another: one for all branches that are the same."""
        ...

    def tried(self, move: Move[Structure]) -> Self:
        """The fit of another structure to the same samples; given up where J will not come below this one."""
        ...

    def ended(self, *, unfinished: bool) -> Self:
        """Mark the point as the last of a descent."""
        ...


P = TypeVar("P", bound=Point)
Stages = Callable[[P], Iterator[Iterable[Move]]]
Report = Callable[[str], None]


def descended(begin: P, stages: Stages[P], until: float, report: Report = lambda _: None) -> P:
    """The point from which no move lowers J; or the last one when the processor time `until` is over."""
    point = begin
    seen: set[tuple[Hashable, bool]] = {(begin.name(), False)}
    while True:
        better = _improved(point, stages, seen, until, report)
        if better is None:
            return point.ended(unfinished=time.process_time() > until)
        point = better


def _improved(point: P, stages: Stages[P], seen: set[tuple[Hashable, bool]], until: float, report: Report) -> P | None:
    for stage in stages(point):
        fitted = 0
        for move in sorted(stage, key=lambda move: move.change):
            name = (point.name(move.structure), move.again)
            if name in seen:  # one structure may come by several moves
                continue
            if fitted == TRIES:
                break
            if time.process_time() > until:
                return None
            seen.add(name)
            fitted += 1
            with suppress(np.linalg.LinAlgError):
                trial = point.tried(move)
                if trial.value < point.value - move.least:
                    report(f"searching for modes: {trial.n_modes} found")
                    return trial
    return None


def longer(band: Floats, by: float, highest: float, real: bool) -> Floats:
    """A band of harmonics with some more at each end, none beyond the highest; of a real multiplier upwards alone."""
    more = np.arange(1.0, by + 1.0)
    both = np.concatenate([[] if real else band[0] - more[::-1], band, band[-1] + more])
    # Twelve samples hold twelve harmonics of a pair, five on one side and six on the other: the highest is 5½ then. On
    # another branch a band may reach beyond: it keeps what it has, and ends earlier on the other side.
    lowest = min(band[0], max(-highest, band[-1] - 2.0 * highest))
    most = highest if real else min(np.ceil(highest), band[0] + 2.0 * highest)
    return both[(both >= lowest) & (both <= max(band[-1], most))]
