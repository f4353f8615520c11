"""One set of hits on one system identified, and its exponents held against the true ones."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from benchmarks.short.systems import Case
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

import floquid
from floquid.errors import IdentificationError

FAR = 4.0
"""Deviations within which an exponent is found."""


@dataclass(frozen=True)
class Row:
    """One seed: exponents found of those there are, false ones, the largest pull and error, and the verdict."""

    seed: int
    found: int
    must: int
    false: int
    pulls: NDArray[np.float64]
    error: float
    passed: bool
    seconds: float


def judged(case: Case, seed: int) -> Row:
    """The row of one seed; a refusal finds nothing."""
    records = case.records(np.random.default_rng(seed))
    truth, begin = case.exponents, time.process_time()
    try:
        analysis = floquid.identify(records)
    except IdentificationError:
        return Row(seed, 0, len(truth), 0, np.zeros(0), np.nan, False, time.process_time() - begin)
    seconds, std = time.process_time() - begin, analysis.model.exponent_std
    assert std is not None
    pulls, errors = pulls_of(analysis.model.exponents, std, truth, case.period)
    near = pulls < FAR
    order, verdict = analysis.model.order, analysis.passed
    return Row(
        seed, int(near.sum()), len(truth), order - int(near.sum()), pulls, float(errors.max()), bool(verdict), seconds
    )


def pulls_of(
    values: NDArray[np.complex128], std: NDArray[np.complex128], truth: NDArray[np.complex128], period: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Errors over their deviations and errors, modulo iω, of the best assignment; a pair may stand for two real ones.

    Two real multipliers that are found as a pair are held against by their mean alone: the deviations of a pair do not
    reach over the axis.
    """
    fundamental = 2.0 * np.pi / period
    gap = values[:, None] - truth[None, :]
    gap -= 1j * fundamental * np.rint(gap.imag / fundamental)
    rows, columns = linear_sum_assignment(np.abs(gap))
    off = gap[rows, columns]
    real = np.abs(np.sin(np.pi * truth.imag * 2.0 / fundamental)) < 1e-9
    if real.sum() == 2:
        both = np.isin(columns, np.flatnonzero(real))
        paired = np.abs(np.sin(np.pi * values[rows].imag * 2.0 / fundamental)) > 1e-9
        if both.sum() == 2 and (both & paired).sum() == 2:
            off[both] = off[both].real.mean()
    imaginary = np.divide(np.abs(off.imag), std[rows].imag, out=np.zeros(len(off)), where=std[rows].imag > 0)
    return np.maximum(np.abs(off.real) / std[rows].real, imaginary), np.abs(off)
