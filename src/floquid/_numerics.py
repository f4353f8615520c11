"""Numerics that several fits share: steps to the least cost, and what is done with information matrices."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

import numpy as np

from floquid._arrays import Complexes, Floats


def sandwich(information: Floats, scatter: Floats, *, smallest: float = 1e-14) -> Floats:
    """The covariance I⁻¹ H I⁻¹ of parameters with the information I, whose gradient has the covariance H.

    The information is brought to a unit diagonal first: a weak mode beside a strong one is not a null direction.
    Directions below the share `smallest` of the largest are.
    """
    scale = np.sqrt(np.maximum(np.diag(information), np.finfo(float).tiny))
    both = np.outer(scale, scale)
    inverse = np.linalg.pinv(information / both, rcond=smallest, hermitian=True)
    return inverse @ (scatter / both) @ inverse / both


def positive_part(whole: Floats, reduced: Floats) -> Floats:
    """`reduced` between a hundredth of `whole` and all of it in each direction, so that it stays definite."""
    if not len(whole):
        return whole
    size = np.diag(whole)
    scale = np.sqrt(np.where(size > np.finfo(float).tiny, size, 1.0))
    both = np.outer(scale, scale)
    values, vectors = np.linalg.eigh(whole / both)
    size = np.sqrt(np.maximum(values, 1e-15 * max(values[-1], 1e-15)))
    root, inverse = vectors * size, (vectors / size).T
    inner = inverse @ (reduced / both) @ inverse.T
    share, directions = np.linalg.eigh(0.5 * (inner + inner.T))
    kept = root @ (directions * np.clip(share, 1e-2, 1.0)) @ directions.T @ root.T
    return kept * both


class Quadratic(Protocol):
    """A point of a fit: its cost, half its steepest descent (n,), and the Gauss-Newton matrix (n, n)."""

    @property
    def cost(self) -> float: ...
    @property
    def gradient(self) -> Floats: ...
    @property
    def information(self) -> Floats: ...


Point = TypeVar("Point", bound=Quadratic)


def levenberg_marquardt(
    now: Point,
    moved: Callable[[Point, Floats], Point | None],
    *,
    steps: int,
    tolerance: float,
    damping: float = 1e-6,
    rounding: float = 1e-12,
    enough: float = -np.inf,
) -> Point:
    """The point of least cost near `now`, by Levenberg's and Marquardt's steps, none of a parameter above 0.5.

    `moved` gives the point after a step, or None where it leads nowhere. Ends when a step is below `tolerance` standard
    deviations in every parameter or below rounding, when none lowers the cost but by the share `rounding`, or as soon
    as the cost is below `enough`. The damping stays above rounding: a parameter that does nothing leaves the matrix
    singular.
    """
    for _ in range(steps if len(now.gradient) else 0):
        scale = np.sqrt(np.maximum(np.diag(now.information), np.finfo(float).tiny))
        system = now.information / np.outer(scale, scale)
        while damping < 1e8:
            step = np.linalg.solve(system + damping * np.eye(len(scale)), now.gradient / scale) / scale
            size = np.abs(step).max()
            step = step * min(1.0, 0.5 / size) if size > 0 else step
            trial = moved(now, step)
            if trial is not None and trial.cost <= now.cost * (1.0 + rounding) + 1e-300:
                break
            damping = max(10.0 * damping, 1e-4)
        else:
            return now
        done = np.abs(step * scale).max() < tolerance or np.abs(step).max() < 1e-14
        now, damping = trial, max(0.1 * damping, 1e-12)
        if done or now.cost < enough:
            break
    return now


def yule_walker(correlation: Floats, order: int) -> Floats:
    """The filter (order + 1,) that makes white noise of an autoregression with this autocorrelation, from lag zero."""
    from scipy.linalg import solve_toeplitz

    first = correlation[:order].copy()
    first[0] *= 1.0 + 1e-9
    return np.concatenate([[1.0], -np.asarray(solve_toeplitz(first, correlation[1 : order + 1]))])


def filtered(values: Floats, taps: Floats) -> Floats:
    """Values (channels, samples) after the filter of each channel, from where it has its past on; NaN goes through."""
    if taps.shape[1] > values.shape[1]:
        return values[:, :0]
    return np.array([np.convolve(row, own, "valid") for row, own in zip(values, taps, strict=True)])


def filter_gain(taps: Floats, delays: Floats, rates: Complexes, *, slope: bool = False) -> Complexes:
    """The gain of filters (channels, taps) at e^{st}, Σ_i a_i e^{-s τ_i}, or its derivative by s (channels, ...)."""
    weights = -delays * taps if slope else taps
    return np.asarray(np.tensordot(weights, np.exp(-np.multiply.outer(delays, rates)), axes=1), np.complex128)
