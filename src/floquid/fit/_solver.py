r"""Levenberg and Marquardt's steps to the least cost, the damping by the ratio of gained to expected.

.. math:: (M + \mu\, \mathrm{diag}\, M)\, s = g, \qquad
          \varrho = \frac{f(p) - f(p + s)}{2 g^T s - s^T M s}, \qquad
          \mu \to \mu \max\big(\tfrac13,\; 1 - (2 \varrho - 1)^3\big)

A step that gains nothing doubles what the damping grows by (Nielsen 1999; Madsen, Nielsen and Tingleff 2004). A trial
costs f alone; gradient and matrix are those of accepted points.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Generic, Protocol, TypeVar

import numpy as np

from floquid._arrays import Floats, Mask
from floquid._checks import Rebuilt
from floquid.fit._algebra import ROUNDING, directions, unit_scale

START = 1e-6  # damping of the first step: all but none
WHOLE = 1e-4  # damping after a first rejected step: below it the step would be the same
MOST = 1e6  # damping at which a fit ends: no direction lowers the cost
FALL = 1.0 / 3.0  # least factor of the damping after an accepted step (Nielsen 1999)
STEPS, FEW_STEPS = 60, 12  # steps of a fit to the end, and of one that is only compared, at most
AT_REST, REST = 1e-4, 0.1  # gains of the last step of either: a hundredth, and a third, of a deviation
LONGEST_STEP = 0.3  # the most that an exponent moves in a step [1/period]: beyond, one linearisation says nothing
FARTHEST = 0.5  # the most that an exponent moves in a fit [1/period]: beyond, the multiplier is another one
CHUNK = 512  # samples whose columns or derivatives are formed at a time
ROUNDS = 3  # fits at most, each with the noise that the one before leaves: weights settle at once


class Costed(Protocol):
    """A point of a fit with its cost: χ², or minus twice the logarithm of the likelihood."""

    @property
    def cost(self) -> float: ...


Point = TypeVar("Point", bound=Costed)


@dataclass(frozen=True, kw_only=True, eq=False)
class Normal(Rebuilt):
    """Gauss-Newton matrix and gradient of a point, over a scale."""

    # JᵀWJ (parameters, parameters), and half the steepest descent JᵀWr (parameters,)
    matrix: Floats
    gradient: Floats
    # The scale of each parameter, infinite of one that stays (parameters,); None for the root of the diagonal
    given: Floats | None = None
    least: float = ROUNDING  # The share of the largest eigenvalue below which a direction is rounding
    # What secants have added to a matrix whose directions are known: W C Wᵀ, with W in these (directions, changes)
    known: tuple[Floats, Floats] | None = None
    changes: Floats | None = None
    weights: Floats | None = None  # C (changes,)

    @cached_property
    def scale(self) -> Floats:
        """The scale of each parameter (parameters,)."""
        return unit_scale(self.matrix) if self.given is None else self.given

    @cached_property
    def directions(self) -> tuple[Floats, Floats]:
        """Eigenvalues and eigenvectors of the scaled matrix, without rounding; none if it overflowed."""
        return self.known or directions(self.matrix, self.least, scale=self.scale)

    def _solved(self, damping: float, along: Floats) -> Floats:
        """The inverse of the damped matrix times some columns, in its directions (directions, columns)."""
        # An inverse takes up a few changes without another decomposition (Woodbury 1950).
        values = (self.directions[0] + damping)[:, None]
        if self.changes is None or self.weights is None:
            return along / values
        by = self.changes / values
        inner = np.eye(len(self.weights)) + self.weights[:, None] * (self.changes.T @ by)
        return along / values - by @ np.linalg.solve(inner, self.weights[:, None] * (by.T @ along))

    def step(self, damping: float, gradient: Floats) -> Floats:
        """The damped step of a gradient (parameters,)."""
        vectors = self.directions[1]
        return vectors @ self._solved(damping, (vectors.T @ (gradient / self.scale))[:, None])[:, 0] / self.scale

    def covariance(self, damping: float, which: Mask) -> Floats:
        """Columns of the inverse of the damped matrix (parameters, those)."""
        vectors = self.directions[1] / self.scale[:, None]
        return np.asarray(vectors @ self._solved(damping, vectors[which].T), np.float64)

    def gain(self, step: Floats, gradient: Floats) -> float:
        """The gain that a step lets expect."""
        return float(2.0 * (gradient @ step) - step @ self.matrix @ step)

    def promised(self, gradient: Floats) -> float:
        """The gain that the whole step lets expect."""
        along = (self.directions[1].T @ (gradient / self.scale))[:, None]
        return float(np.sum(along * self._solved(START, along)))

    def turned(self, step: Floats, change: Floats) -> Normal:
        r"""The matrix with the curvature that a step has shown, by what the gradient fell along it (Broyden 1970).

        .. math:: M + \frac{y y^T}{y^T s} - \frac{M s s^T M}{s^T M s}

        It holds what a residual and its second derivatives add, which Gauss and Newton leave out.
        """
        _, vectors = self.directions
        inside, behind = vectors.T @ (change / self.scale), self.matrix @ step
        change = self.scale * (vectors @ inside)
        seen, size = float(change @ step), float(behind @ step)
        if seen <= 0.0:
            return self
        both, weights = np.stack([inside, vectors.T @ (behind / self.scale)], axis=1), np.array([1.0, -1.0])
        weights /= [seen, size]
        if self.changes is not None and self.weights is not None:
            both, weights = np.hstack([self.changes, both]), np.concatenate([self.weights, weights])
        more = np.outer(change, change / seen) - np.outer(behind, behind / size)
        return replace(
            self, matrix=self.matrix + more, given=self.scale, known=self.directions, changes=both, weights=weights
        )

    def size(self, step: Floats) -> float:
        """The largest move of a parameter, in deviations of it with all others held."""
        return float(np.abs(step * np.where(np.isfinite(self.scale), self.scale, 0.0)).max(initial=0.0))


@dataclass(frozen=True, kw_only=True)
class Steps(Generic[Point]):
    """Functions that make the steps of a fit."""

    normal: Callable[[Point], Normal]  # The normal equations at a point
    moved: Callable[[Point, Floats], Point | None]  # The point a step away, None where there is none
    # A step shortened, by the point, the normal equations and the damping; None for steps of any length
    limited: Callable[[Point, Floats, Normal, float], Floats] | None = None
    # The gradient at a point, where it costs much less than the matrix: that serves while steps gain as expected
    gradient: Callable[[Point], Floats] | None = None
    # True where the fit may end, by the point and the gains of all steps; None where it never may
    enough: Callable[[Point, list[float]], bool] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Ends:
    """Ends of a fit, and its pace."""

    steps: int  # Steps at most
    deviations: float = 0.0  # The size of a step, in deviations of each parameter, below which it is the last
    gain: float = -np.inf  # The gain of a step below which it is the last
    patience: int = 1  # Such steps after which a fit ends although the whole step lets expect twice that


def levenberg_marquardt(start: Point, of: Steps[Point], ends: Ends) -> Point:
    """Return the point of least cost near a start."""
    point, normal, damping, growth = start, of.normal(start), START, 2.0
    gains, small, pull, kept = [], 0, normal.gradient, False
    while len(pull) and len(gains) < ends.steps:
        whole = normal.step(damping, pull)
        step = whole if of.limited is None else of.limited(point, whole, normal, damping)
        trial, gained = _tried(of, point, step)
        if trial is None and kept:
            normal, kept = of.normal(point), False
            pull = normal.gradient
            continue
        if trial is None:
            # Had it been accepted it would have been the last: shorter ones gain no more.
            if normal.size(step) < ends.deviations or normal.promised(pull) < ends.gain or damping >= MOST:
                break
            damping, growth = max(growth * damping, WHOLE), 2.0 * growth
            continue
        expected = normal.gain(step, pull)
        point, growth = trial, 2.0
        gains.append(gained)
        if expected > 0.0:
            damping *= max(FALL, 1.0 - (2.0 * min(gained / expected, 1.0) - 1.0) ** 3)
        small += gained < ends.gain
        idle = gained < ends.gain and (small >= ends.patience or normal.promised(pull) <= 2.0 * ends.gain)
        still = normal.size(step) < ends.deviations or np.abs(step).max() < ROUNDING
        if idle or still or len(gains) == ends.steps or (of.enough is not None and of.enough(point, gains)):
            break
        kept = of.gradient is not None
        if of.gradient is not None:
            before, pull = pull, of.gradient(point)
            normal = normal.turned(step, before - pull)
        else:
            normal = of.normal(point)
            pull = normal.gradient
    return point


def _tried(of: Steps[Point], point: Point, step: Floats) -> tuple[Point | None, float]:
    """The point a step away with what it gains; None where that is nothing."""
    trial = of.moved(point, step)
    if trial is None or not trial.cost <= point.cost + max(ROUNDING * abs(point.cost), np.finfo(float).tiny):
        return None, 0.0
    return trial, point.cost - trial.cost
