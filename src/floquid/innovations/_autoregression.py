"""Innovations by a long periodic autoregression: the first step of Hannan and Rissanen (1982)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from floquid._arrays import Floats, Mask
from floquid.errors import IdentificationError
from floquid.inputs import Samples

LAGS = (4, 8, 16, 32)
"""Samples of the past that are tried."""

SHORT = (1, 2)
"""Samples of the past where the record is too short for all: many outputs tell the state by less of the past."""

HARMONICS = (0, 1, 2)  # harmonics of the coefficients that are tried
MOST = 0.05  # numbers that are fitted over the rows that tell them, at most: of one channel for coefficients


def first_innovations(samples: Samples, acting: int = 0) -> Floats:
    r"""Innovations (channels, samples) by least squares on the samples before, zero at the start of each record.

    .. math:: y_k = \sum_{j \ge 1} \alpha_j(t_k)\, y_{k-j} + \sum_{j \ge 0} \beta_j(t_k)\, u_{k-j} + e_k

    β at no lag is zero except for the first inputs, `acting` of them.
    Lags and harmonics of α and β are those of the least criterion of Schwarz (1978).

    Raises IdentificationError where the record is too short for this number of signals.
    """
    for tried in (LAGS, SHORT):
        found = _least(samples, tried, acting)
        if found is not None:
            return found
    signals = len(samples.values) + len(samples.inputs)
    raise IdentificationError(
        f"The record has {samples.count} samples of {signals} channels: too few to predict each channel by all "
        f"of them, which takes at least {np.ceil(signals / MOST):.0f}. Name fewer: `channels=`."
    )


def _least(samples: Samples, tried: Sequence[int], acting: int) -> Floats | None:
    """The innovations by the lags and harmonics of the least criterion; None where each has too many coefficients."""
    best, found = np.inf, None
    for harmonics in HARMONICS:
        before = np.inf
        for lags in tried:
            width = _width(samples, lags, harmonics, acting)
            used = whole_past(samples, lags)
            count = int(used.sum())
            if width > MOST * count:
                break
            gram, seen = np.zeros((width, width)), np.zeros((width, len(samples.values)))
            for own, rows in _regressors(samples, lags, harmonics, acting):
                kept = rows * used[own]
                gram += kept @ kept.T
                seen += kept @ samples.values[:, own].T
            size = np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
            system = gram / np.outer(size, size) + 1e-10 * np.eye(len(size))
            fitted, left = np.linalg.solve(system, seen / size[:, None]) / size[:, None], np.zeros_like(samples.values)
            for own, rows in _regressors(samples, lags, harmonics, acting):
                left[:, own] = (samples.values[:, own] - fitted.T @ rows) * used[own]
            criterion = count * np.linalg.slogdet(left @ left.T / count)[1] + fitted.size * np.log(count)
            if criterion / count > before:
                break
            before = criterion / count
            if before < best:
                best, found = before, left
    return found


def _width(samples: Samples, lags: int, harmonics: int, acting: int) -> int:
    """The number of the rows of `_regressors`."""
    late = len(samples.inputs[:acting]) + lags * (len(samples.values) + len(samples.inputs))
    return len(samples.known) + (1 + 2 * harmonics) * late


def _regressors(samples: Samples, lags: int, harmonics: int, acting: int) -> Iterator[tuple[slice, Floats]]:
    """Known columns, inputs that act at once, and samples and inputs before, all but the first turned (…, samples)."""
    for parts in samples.parts(_width(samples, lags, harmonics, acting)):
        for own in parts:
            part, past = samples.part(own), past_of(samples, own, parts[0].start, lags)
            late = np.concatenate([part.inputs[:acting], past])
            turned = [part.turned(turn) for turn in range(1, harmonics + 1)]
            modulated = (each * late for both in turned for each in (both.real, both.imag))
            yield own, np.concatenate([part.known, late, *modulated])


def past_of(samples: Samples, own: slice, begin: int, lags: int) -> Floats:
    """Samples and inputs 1 to `lags` samples before those of a part, zero before a record begins (…, samples)."""
    first, count = max(own.start - lags, begin), own.stop - own.start
    before = [signals[:, first : own.stop - 1] for signals in (samples.values, samples.inputs)]
    signals = np.pad(np.concatenate(before), ((0, 0), (lags - (own.start - first), 0)))
    return np.concatenate([signals[:, lags - lag : lags - lag + count] for lag in range(1, lags + 1)])


def whole_past(samples: Samples, lags: int) -> Mask:
    """Mask of the samples that were measured with those `lags` before in their record (samples,)."""
    found = samples.there.copy()
    for own in samples.records:
        for lag in range(1, lags + 1):
            found[own.start + lag : own.stop] &= samples.there[own.start : own.stop - lag]
        found[own.start : min(own.start + lags, own.stop)] = False
    return found
