r"""Pairs near an axis, and two real multipliers of one sign, as blocks of their mean and squared half-difference.

.. math:: \lambda = \sigma \pm \sqrt q + \tfrac{i \kappa \omega}{2}

Either kind is singular where the other begins: σ and q are determined there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import Protocol, TypeVar

import numpy as np

from floquid._arrays import Floats, Integers
from floquid.fit._tests import DEVIATIONS, RARE, WITHIN, chi2_limit

OFF = 0.02  # the least √|q| over the decay with which a block begins: numbers of its second state are over it


class AxisMode(Protocol):
    """A pair of conjugates, a real multiplier on an axis, or a block of both kinds."""

    @property
    def exponent(self) -> complex: ...
    @property
    def real(self) -> bool: ...
    @property
    def axis(self) -> float: ...
    @property
    def square(self) -> float | None: ...


class AxisFit(Protocol):
    """A fit of such modes."""

    @property
    def modes(self) -> Sequence[AxisMode]: ...
    @property
    def n_parameters(self) -> int: ...
    @property
    def log_likelihood(self) -> float: ...


Fit = TypeVar("Fit", bound=AxisFit)


def half_of(mode: AxisMode, omega: float) -> float:
    """The multiple of half the fundamental that a mode is nearest to, in fundamentals."""
    return mode.axis if mode.real else 0.5 * round(2.0 * mode.exponent.imag / omega)


def off_axis(mode: AxisMode, omega: float) -> float:
    """The distance of a mode from the axis that it is nearest to [1/s]."""
    return abs(mode.exponent.imag - half_of(mode, omega) * omega)


def near_axis(mode: AxisMode, omega: float, std: float = 0.0) -> bool:
    """True of a pair within its decay of an axis, or within eight deviations `std`: it may be one real multiplier."""
    # The deviations of q from zero are half those of its root.
    return not mode.real and off_axis(mode, omega) <= max(abs(mode.exponent.real), 2.0 * DEVIATIONS * std)


def couples(modes: Sequence[AxisMode], covariance: Floats, places: Integers, omega: float) -> Iterator[list[int]]:
    """Numbers of modes that may be of either kind: each pair near an axis, and two real multipliers of one sign."""
    reals: dict[float, list[int]] = {}
    for number, (mode, (_, imag)) in enumerate(zip(modes, places.tolist(), strict=True)):
        if mode.square is not None:
            continue
        if mode.real:
            reals.setdefault(mode.axis, []).append(number)
        elif near_axis(mode, omega, float(max(covariance[imag, imag], 0.0) ** 0.5)):
            yield [number]
    for alike in reals.values():
        decays = {number: modes[number].exponent.real for number in sorted(alike, key=lambda k: modes[k].exponent.real)}
        nearest = min(pairwise(decays), key=lambda two: decays[two[1]] - decays[two[0]], default=None)
        if nearest is None:
            continue
        rows = places[list(nearest), 0]
        if not _each_for_itself(decays[nearest[1]] - decays[nearest[0]], covariance[np.ix_(rows, rows)]):
            yield list(nearest)


def _each_for_itself(gap: float, covariance: Floats) -> bool:
    """True of two real multipliers that are told apart, and less correlated than their mean and difference (2, 2)."""
    # One that is seen well beside one that is hardly seen has a deviation of its own. Where they meet they are one.
    by = np.array([[0.5, 0.5], [1.0, -1.0]])
    turned = by @ covariance @ by.T
    return correlation(covariance) < correlation(turned) and gap > WITHIN * float(np.sqrt(turned[1, 1]))


def correlation(covariance: Floats) -> float:
    """The size of the correlation of two values, from their covariance (2, 2)."""
    return abs(float(covariance[0, 1])) / max(float(np.sqrt(covariance[0, 0] * covariance[1, 1])), 1e-300)


def with_blocks(
    fit: Fit, may_be: Callable[[Fit], Iterator[list[int]]], as_block: Callable[[Fit, list[int]], Fit | None]
) -> Fit:
    """The fit with each couple of modes that `may_be` of either kind as a block, where `as_block` finds one."""
    # Each is tried once.
    tried: set[tuple[complex, ...]] = set()
    while True:
        for numbers in may_be(fit):
            key = tuple(fit.modes[number].exponent for number in numbers)
            if key not in tried:
                break
        else:
            return fit
        tried.add(key)
        fit = as_block(fit, numbers) or fit


def begun_off(away: float, decay: float, omega: float) -> float:
    """The distance from an axis with which a block begins, at least a share of the decay [1/s]."""
    return float(np.copysign(max(abs(away), OFF * abs(decay), 1e-9 * omega), away))


def block_stands(trial: AxisFit, without: AxisFit, variance: float, omega: float, *, real: bool) -> bool:
    """True where a fit with a block, its last mode, takes the place of one with a pair, or two `real` multipliers."""
    square, std = trial.modes[-1].square, float(np.sqrt(max(variance, 0.0)))
    assert square is not None
    # Where its deviation reaches the next axis, q is not determined.
    if not np.sqrt(std) < 0.25 * omega:
        return False
    # Harmonics that neither kind has cost more than a q that is not open gains.
    away = DEVIATIONS if trial.n_parameters <= without.n_parameters else WITHIN
    if abs(square) > away * std and (square > 0.0) == real:
        return False
    # It holds both kinds: where it fits worse its fit has not ended.
    return without.log_likelihood - trial.log_likelihood < chi2_limit(1, RARE)
