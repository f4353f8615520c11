"""Innovations by a long periodic autoregression: the first step of Hannan and Rissanen (1982)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from floquid.errors import IdentificationError
from floquid.inputs import Samples

LAGS = (4, 8, 16, 32)
"""Samples of the past that are tried."""

SHORT = (1, 2)
"""Samples of the past where the record is too short for all: many outputs tell the state by less of the past."""

HARMONICS = (0, 1, 2)  # harmonics of the coefficients that are tried
MOST = 0.05  # coefficients of one channel over the samples, at most


def first_innovations(samples: Samples, acting: int = 0) -> NDArray[np.float64]:
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


def _least(samples: Samples, tried: Sequence[int], acting: int) -> NDArray[np.float64] | None:
    """The innovations by the lags and harmonics of the least criterion; None where each has too many coefficients."""
    best, found = np.inf, None
    for harmonics in HARMONICS:
        before = np.inf
        for lags in tried:
            rows = _regressors(samples, lags, harmonics, acting)
            used = whole_past(samples, lags)
            count = int(used.sum())
            if len(rows) > MOST * count:
                break
            rows, values = rows[:, used], samples.values[:, used]
            gram = rows @ rows.T
            size = np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
            system = gram / np.outer(size, size) + 1e-10 * np.eye(len(size))
            left = values - (np.linalg.solve(system, rows @ values.T / size[:, None]) / size[:, None]).T @ rows
            criterion = count * np.linalg.slogdet(left @ left.T / count)[1] + len(rows) * len(values) * np.log(count)
            if criterion / count > before:
                break
            before = criterion / count
            if before < best:
                best, found = before, np.zeros_like(samples.values)
                found[:, used] = left
    return found


def _regressors(samples: Samples, lags: int, harmonics: int, acting: int) -> NDArray[np.float64]:
    """Known columns, inputs that act at once, and samples and inputs before, all but the first turned (…, samples)."""
    signals = np.concatenate([samples.values, samples.inputs])
    rows = [samples.each(signals, lambda own, lag=lag: delayed(own, lag)) for lag in range(1, lags + 1)]
    late = np.concatenate([samples.inputs[:acting], *rows])
    turned = [samples.turned(turn) for turn in range(1, harmonics + 1)]
    return np.concatenate([samples.known, late, *(part * late for own in turned for part in (own.real, own.imag))])


def whole_past(samples: Samples, lags: int) -> NDArray[np.bool_]:
    """Mask of the samples that were measured with those `lags` before in their record (samples,)."""
    found = samples.there.copy()
    for own in samples.records:
        for lag in range(1, lags + 1):
            found[own.start + lag : own.stop] &= samples.there[own.start : own.stop - lag]
        found[own.start : min(own.start + lags, own.stop)] = False
    return found


def delayed(values: NDArray, lag: int) -> NDArray:
    """Values some samples ago, zero where there were none (…, samples)."""
    found = np.zeros_like(values)
    found[:, lag:] = values[:, :-lag] if lag < values.shape[1] else 0.0
    return found
