"""Parts of an analysis that the page shows: its modes, and of many channels the strongest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from floquid.order import OrderScan
from floquid.pipeline import Analysis
from floquid.views import DampingUnit, shortened

MOST_CHANNELS = 8  # channels that one figure can tell apart; the result file holds all
LONGEST = 28  # characters of a name in a legend
POINTS = 3000  # the most points of a curve: a long record keeps its envelope


@dataclass(frozen=True, slots=True)
class Case:
    """An analysis and what of it is shown."""

    analysis: Any  # an Analysis, or what shows modes of lines as one
    scan: OrderScan | None  # the poles of several orders; None where there are none
    why: str  # why there are none
    modes: tuple[int, ...]  # one mode of each pair
    channels: tuple[int, ...]  # the strongest channels, in their own order
    hits: tuple[int, ...]  # the hit in which each of `modes` is strongest
    damping: DampingUnit = "percent"  # the unit of damping

    @property
    def turn(self) -> float:
        """Frequencies are in hertz: cycles in a radian."""
        return 0.5 / np.pi

    def names(self) -> list[str]:
        """The names of the channels shown."""
        return [self.analysis.model.channels[row].name for row in self.channels]

    def labels(self) -> list[str]:
        """The names as short as a legend wants them, no two alike."""
        short = [shortened(name, LONGEST) for name in self.names()]
        return [f"{name} ({n})" if short.count(name) > 1 else name for n, name in enumerate(short, start=1)]

    def units(self) -> list[str]:
        """The units of the channels shown."""
        return [self.analysis.model.channels[row].unit for row in self.channels]


def case_of(
    analysis: Analysis, scan: OrderScan | None = None, why: str = "", *, damping: DampingUnit = "percent"
) -> Case:
    """Choose what is shown, damping in a unit."""
    model = analysis.model
    modes = tuple(model.upper_modes)
    energy = np.abs(model.coefficients) ** 2 / analysis.noise[:, :, None] ** 2
    energy = energy.sum(axis=-1)  # (modes, channels, hits)
    # Every mode counts the same, or the channels of the strongest mode alone would be seen.
    share = energy.sum(axis=2) / np.maximum(energy.sum(axis=(1, 2)), np.finfo(float).tiny)[:, None]
    strongest = np.argsort(share.sum(axis=0))[::-1][:MOST_CHANNELS]
    return Case(
        analysis=analysis,
        scan=scan,
        why=why,
        modes=modes,
        channels=tuple(sorted(int(row) for row in strongest)),
        hits=tuple(int(np.argmax(energy[mode].sum(axis=0))) for mode in modes),
        damping=damping,
    )
