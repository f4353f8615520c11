"""What is to be seen in the figures, as numbers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from floquid.paper._experiment import uncut
from floquid.pipeline import Analysis

STANDS_OUT = 4.0
"""How many times its surroundings a peak must be. White noise does so on one line in a hundred thousand."""

TOP, NEAR, AROUND = 0.004, 0.012, 0.06
"""A peak is the largest line within the first of these of a frequency; its surroundings are the lines between the
second and the third [fundamentals]."""


def _spectrum(analysis: Analysis, row: int, phase: int | None) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Frequencies [rad/s] and magnitudes of a channel's periods, or of its lifted response at a phase (lines,)."""
    cycles = analysis.cycles[0]
    values = cycles.values[row].T.ravel() if phase is None else cycles.values[row, phase]
    step = analysis.lifted.period / (cycles.n_phases if phase is None else 1)
    frequencies = 2.0 * np.pi * np.arange(len(values) // 2 + 1) / (len(values) * step)
    return np.asarray(frequencies, dtype=np.float64), np.asarray(np.abs(np.fft.rfft(values)), dtype=np.float64)


def strongest(analysis: Analysis, row: int, phase: int | None) -> float:
    """The frequency of the highest line of a channel, or of its lifted response at a phase [rad/s]."""
    frequencies, magnitudes = _spectrum(analysis, row, phase)
    return float(frequencies[np.argmax(magnitudes)])


def prominent(analysis: Analysis, row: int, phase: int | None, candidates: NDArray[np.float64]) -> dict[float, float]:
    """Those of the candidates [rad/s] that stand out, with their heights over the median of their surroundings."""
    frequencies, magnitudes = _spectrum(analysis, row, phase)
    found = {}
    for candidate in candidates:
        away = np.abs(frequencies - candidate) / analysis.model.fundamental
        top = away <= max(TOP, away.min())
        around = magnitudes[(away > NEAR) & (away < AROUND)]
        height = float(magnitudes[top].max() / np.median(around)) if len(around) else 0.0
        if height >= STANDS_OUT:
            found[float(candidate)] = height
    return found


def residue_of(analysis: Analysis, mode: int, row: int) -> tuple[float, float, float, float]:
    """Of a residue: its constant, the rest of its smooth part, the scatter about that, and what the noise gives."""
    model, whole = analysis.model, uncut(analysis)
    assert whole.coefficient_std is not None
    own, kept = model.coefficients[mode, row, 0], model.harmonics
    dropped = ~np.isin(whole.harmonics, kept[own != 0])
    rest = whole.coefficients[mode, row, 0, dropped]
    std = np.abs(whole.coefficient_std[mode, row, 0, dropped])
    return (
        float(np.abs(own[kept == 0]).sum()),
        float(np.linalg.norm(own[kept != 0])),
        float(np.linalg.norm(rest)),
        float(np.linalg.norm(std)),
    )


def coefficients_of(analysis: Analysis, mode: int, row: int) -> tuple[int, float, float]:
    """How many coefficients of a residue are kept, the smallest of them and the largest of the others [deviations]."""
    model, whole = analysis.model, uncut(analysis)
    assert whole.coefficient_std is not None
    size = np.abs(whole.coefficients[mode, row, 0])
    std = np.abs(whole.coefficient_std[mode, row, 0])
    heights = np.divide(size, std, out=np.zeros_like(size), where=std > 0)
    kept = np.isin(whole.harmonics, model.harmonics[model.coefficients[mode, row, 0] != 0])
    return int(kept.sum()), float(heights[kept].min()), float(heights[~kept].max())
