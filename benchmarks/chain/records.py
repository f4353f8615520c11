"""Every case by its name."""

from __future__ import annotations

from collections.abc import Callable

from benchmarks.chain import measured, paper
from benchmarks.chain.case import Case

Builder = Callable[[float, int], Case]
"""The share of noise and the seed -> the case."""

RECORDS: dict[str, Builder] = {
    "rotor_650rpm": measured.rotor_650rpm,
    "rotor_1900rpm": measured.rotor_1900rpm,
    "rotor_650rpm_tach": measured.rotor_650rpm_tach,
    "duffing_orbit": measured.duffing_orbit,
    "paper_wander": paper.paper_wander,
    "paper_imbalance": paper.paper_imbalance,
}
