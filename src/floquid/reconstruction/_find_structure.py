"""The simplest second-order form that the data do not contradict."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from floquid.errors import IdentificationError
from floquid.reconstruction._invariance import Point, covariance_of
from floquid.reconstruction._structure import AbstractStructure, Basis, Block, SecondOrder

SURE = 1e-3
"""The probability of what a wider structure gains by chance, below which it is taken."""

MOST = 12
"""Steps at most."""

Fitted = Callable[[AbstractStructure], tuple[Point, Basis]]


def found_structure(
    fit: Fitted, report: Callable[[str], None] = lambda _: None
) -> tuple[AbstractStructure, tuple[str, ...]]:
    """Forward selection from constant symmetric stiffness and constant damping, by likelihood ratio tests.

    Parameters
    ----------
    fit
        Fits a structure.
    report
        Is told what is tried.

    Returns
    -------
    structure
        The structure.
    reasons
        What was added, and what it gained.

    Raises
    ------
    IdentificationError
        No structure that the data determine leaves as little.
    """
    from scipy.special import chdtrc

    now: AbstractStructure = SecondOrder(stiffness=Block(symmetry="symmetric"), damping=Block())
    point, reasons = _tried(fit, now), []
    for _ in range(MOST):
        best: Point | None = None
        least, words, chosen = (False, 0.0), "", now
        for name, other in now.wider():
            report(f"trying a structure: {name}")
            trial = _tried(fit, other)
            if trial is None:
                continue
            more = trial.slopes.shape[1] - (0 if point is None else point.slopes.shape[1])
            gain = np.inf if point is None else point.cost - trial.cost
            rare = 0.0 if point is None else float(chdtrc(max(more, 1), max(gain, 0.0)))
            # Where several are sure, the one that gains most for each number that it adds.
            worth = (rare > SURE, -gain / max(more, 1))
            if rare < SURE and (best is None or worth < least):
                best, least, words, chosen = trial, worth, name, other
        if best is None:
            break
        before = np.inf if point is None else point.cost
        reasons.append(f"{words[0].upper()}{words[1:]}: chi-square from {before:.4g} to {best.cost:.4g}.")
        now, point = chosen, best
    if point is None:
        raise IdentificationError("No second-order form of few harmonics fits the response in these states.")
    return now, (f"Structure found: {now.words()}.", *reasons)


def _tried(fit: Fitted, structure: AbstractStructure) -> Point | None:
    """The fit; None where there is none, or the data do not determine it."""
    try:
        point, _ = fit(structure)
        covariance_of(point)
    except (IdentificationError, np.linalg.LinAlgError):
        return None
    return point
