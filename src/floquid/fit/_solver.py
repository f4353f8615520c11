"""Steps to the least cost."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

import numpy as np

from floquid._arrays import Floats


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
