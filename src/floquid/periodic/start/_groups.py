"""Start of the fit of the samples: the poles of lifted responses, taken apart at their unfolded frequencies."""

from __future__ import annotations

import numpy as np

from floquid._arrays import Complexes, Floats
from floquid.core import PeriodicModel
from floquid.fit import DEVIATIONS, HALF_DIGITS, SURE, chi2_limit
from floquid.lifting import Lifted
from floquid.lti import ModalModel
from floquid.periodic.expansion import expansion
from floquid.periodic.least_squares import ModeParameters

APART = 2  # harmonics of one pole that are further apart than this start as modes of their own

OFF_AXIS = 0.05
"""The imaginary part that a real exponent starts with, over its decay: on the axis, nothing says which way it lies."""


def groups(modal: ModalModel, lifted: Lifted) -> ModeParameters:
    """One mode for each pole of `modal` and group of its harmonics significant in `lifted`, its band about the largest.

    Modes fold onto one another in lifted responses: their poles then come out as one, or bent. Their harmonics lie at
    different unfolded frequencies, and start as separate modes. They are split at the sign of the frequency and at gaps
    of more than `APART` harmonics; where they are one mode after all, a test of equal exponents joins them.
    """
    expanded = expansion(modal, lifted)
    omega = 2.0 * np.pi / lifted.period
    limit = chi2_limit(2 * expanded.coefficients.shape[1] * expanded.coefficients.shape[2], SURE)
    exponents, bands = [], []
    for r in expanded.upper:
        score = _score(expanded.coefficients[r], expanded.std[r])
        turns = expanded.exponents[r].imag / omega + expanded.harmonics
        seen = (score > limit) & (np.abs(turns) < 0.5 * lifted.n_phases - HALF_DIGITS)
        if expanded.real[r]:
            seen &= turns > -HALF_DIGITS  # the other half is its conjugate
        if not seen.any():
            seen[int(np.argmax(score * (turns > -HALF_DIGITS)))] = True
        places = np.flatnonzero(seen)
        cut = (np.diff(expanded.harmonics[places]) > APART) | (
            np.sign(turns[places[1:]]) != np.sign(turns[places[:-1]])
        )
        for group in np.split(places, np.flatnonzero(cut) + 1):
            strongest = int(group[np.argmax(score[group])])
            value = expanded.exponents[r] + 1j * omega * expanded.harmonics[strongest]
            ends = expanded.harmonics[group[[0, -1]]] - expanded.harmonics[strongest]
            if value.imag < 0.0:
                value, ends = value.conjugate(), -ends[::-1]
            if expanded.real[r]:
                least = omega / int(lifted.responses.lengths.max())
                value += 1j * OFF_AXIS * max(abs(value.real), least)
            exponents.append(value)
            bands.append(ends)
    return ModeParameters.made(exponents, np.array(bands, np.int64).reshape(-1, 2), omega)


def distinct_multipliers(model: PeriodicModel) -> int:
    """The number of multipliers of a model that deviations tell apart: two modes may share one.

    Free in each hit, the residues of one mode hold those of both, and only outer products of shape and hit tell them
    apart.
    """
    std = np.zeros(model.order, np.complex128) if model.exponent_std is None else model.exponent_std
    kept: list[int] = []
    for mode in np.flatnonzero(model.multipliers.imag >= -HALF_DIGITS):
        gaps = model.exponents[kept] - model.exponents[mode]
        gaps -= 1j * model.fundamental * np.rint(gaps.imag / model.fundamental)
        within = DEVIATIONS * (np.hypot(std.real[kept], std.real[mode]) + 1j * np.hypot(std.imag[kept], std.imag[mode]))
        within += (1.0 + 1.0j) * HALF_DIGITS * model.fundamental
        if not ((np.abs(gaps.real) < within.real) & (np.abs(gaps.imag) < within.imag)).any():
            kept.append(int(mode))
    return int(np.sum(np.where(np.abs(model.multipliers.imag[kept]) > HALF_DIGITS, 2, 1)))


def _score(coefficients: Complexes, std: Complexes) -> Floats:
    """The chi-square of each harmonic over channels and hits (harmonics,)."""
    total = np.zeros(coefficients.shape[-1])
    for value, deviation in ((coefficients.real, std.real), (coefficients.imag, std.imag)):
        share = np.divide(value, deviation, out=np.zeros_like(value), where=deviation > 0)
        total += np.sum(share**2, axis=(0, 1))
    return total
