"""Filters along evenly spaced samples: of an autoregression, their action and their gain."""

from __future__ import annotations

import numpy as np

from floquid._arrays import Complexes, Floats

LAGS = 16
"""Lags of a correlation that tell coloured noise: what modes leave has some a period apart."""


def yule_walker(correlation: Floats, order: int) -> Floats:
    """The filter (order + 1,) that whitens an autoregression, from its autocorrelation at lags from zero on."""
    from scipy.linalg import solve_toeplitz

    first = correlation[:order].copy()
    first[0] *= 1.0 + 1e-9
    return np.concatenate([[1.0], -np.asarray(solve_toeplitz(first, correlation[1 : order + 1]))])


def filtered(values: Floats, taps: Floats) -> Floats:
    """Values (channels, samples) after the filter of each channel, from the first sample with all its past on."""
    if taps.shape[1] > values.shape[1]:
        return values[:, :0]
    return np.array([np.convolve(row, filter_, "valid") for row, filter_ in zip(values, taps, strict=True)])


def filter_gain(taps: Floats, delays: Floats, rates: Complexes, *, slope: bool = False) -> Complexes:
    """The gain of filters (channels, taps) at e^{st}, Σ_i a_i e^{-s τ_i}, or its derivative by s (channels, ...)."""
    weights = -delays * taps if slope else taps
    return np.asarray(np.tensordot(weights, np.exp(-np.multiply.outer(delays, rates)), axes=1), np.complex128)
