r"""The objective of every decision of a search with inputs, and the fit of one structure by it.

.. math:: J = \sum_c N \ln (R_c/N) + \text{price}

with R what the modes leave of an output. The noise is profiled out, so that fits with other modes can be compared.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from floquid.fit import FEW_STEPS, REST
from floquid.inputs._samples import Samples
from floquid.inputs._solver import Linearisation, solve
from floquid.inputs.search._scores import Scores
from floquid.inputs.search._structure import Limits, Price, Structure
from floquid.search import HOPE, SAME, Move


@dataclass(frozen=True, eq=False)
class Point:
    """A structure fitted to samples, and J."""

    samples: Samples
    limits: Limits
    at: Linearisation
    bands: Callable[[Point], Iterable[Move[Structure]]]  # moves of bands, by which a trial with other modes is helped
    unfinished: bool = False

    @property
    def structure(self) -> Structure:
        """Modes and harmonics of the direct term."""
        return Structure(self.at.modes, self.at.direct)

    @cached_property
    def price(self) -> Price:
        """Price of structures."""
        return Price(self.limits, len(self.samples.values), len(self.samples.inputs), len(self.samples.records))

    @cached_property
    def value(self) -> float:
        """J."""
        return self.at.cost + self.price.of(self.structure)

    @property
    def settling(self) -> Move[Structure]:
        """The move that goes on with the fit."""
        return Move(-self.scores.promised, "settle", self.structure, again=True)

    @property
    def n_modes(self) -> int:
        """Modes, a pair counted once."""
        return len(self.at.modes)

    @cached_property
    def scores(self) -> Scores:
        """Scores by one linearisation."""
        return Scores(self.samples, self.at)

    def name(self, structure: Structure | None = None) -> tuple:
        """Name of this structure or of another, one for all branches."""
        structure = self.structure if structure is None else structure
        omega, names = self.samples.fundamental, []
        for mode in structure.modes:
            low = mode.exponent + 1j * omega * mode.turns[0]
            decay, turn = (round(part * 2.0 * np.pi / omega / SAME) for part in (low.real, low.imag))
            reached = float(mode.reach[0] + mode.turns[0])
            names.append((mode.real, decay, turn, len(mode.turns), reached, len(mode.reach)))
        return tuple(sorted(names)), structure.direct

    def settled(self, structure: Structure, *, below: float = np.inf) -> Point:
        """The least J near a structure; given up where it will not come below a value."""
        structure = structure.within(self.limits.highest)
        below -= self.price.of(structure)
        at = solve(
            self.samples, structure.modes, structure.direct, iterations=FEW_STEPS, at_rest=REST, rough=True, below=below
        )
        return replace(self, at=at)

    def tried(self, move: Move[Structure]) -> Point:
        """The fit of another structure, other modes with the bands that they then need; given up without hope."""
        trial = self.settled(move.structure, below=np.inf if move.again else self.value - move.least)
        other = [mode.real for mode in move.structure.modes] != [mode.real for mode in self.at.modes]
        while (other or move.helped) and trial.value >= self.value:
            best = min(self.bands(trial), key=lambda each: each.change, default=None)
            if best is None or trial.value + HOPE * best.change > self.value:
                break
            more = trial.settled(best.structure)
            if more.value >= trial.value:
                break
            trial = more
        return trial

    def ended(self, *, unfinished: bool) -> Point:
        """Mark the point as the last of a descent."""
        return replace(self, unfinished=unfinished)
