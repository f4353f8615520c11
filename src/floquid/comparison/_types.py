"""A comparison: pairs of modes with their differences, what is missing, and how likely all differences are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floquid._arrays import Floats
from floquid._checks import Rebuilt, Sealed
from floquid._show import Drawings, Drawn, Told
from floquid.core import PeriodicModel


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pair(Rebuilt):
    """One mode of both sides.

    Parameters
    ----------
    point
        The number of the point.
    a, b
        The modes of the models, counted from 0. Of two real multipliers of a lock each has its own row; a pair beside
        such two has one row, with the one of both that decays less.
    exponent_a, exponent_b
        λ on the branch that a reports [1/s].
    difference, std
        λ of a less λ of b, and its deviation by both sides together, part by part [1/s]; the imaginary part is NaN of
        real multipliers, and of a pair beside two of them.
    z
        The difference over its deviations, √(d' C⁻¹ d); NaN where neither side has any.
    mac
        The similarity of both shapes, 0 to 1; NaN where fewer than two channels are common.
    mac_noise
        The 1 - mac that the noise of the shapes makes on average.
    counted
        False of a weak mode and of a result that fails: they are shown, and are not in χ².
    """

    point: int
    a: int
    b: int
    exponent_a: complex
    exponent_b: complex
    difference: complex
    std: complex
    z: float
    mac: float
    mac_noise: float
    counted: bool

    @property
    def frequencies_hz(self) -> tuple[float, float]:
        """|Im λ|/2π of a and b [Hz]."""
        return abs(self.exponent_a.imag) / (2.0 * np.pi), abs(self.exponent_b.imag) / (2.0 * np.pi)

    @property
    def damping_ratios(self) -> tuple[float, float]:
        """-Re λ/|λ| of a and b; NaN where λ is zero."""
        a, b = (-z.real / abs(z) if z else float("nan") for z in (self.exponent_a, self.exponent_b))
        return a, b


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ComparedPoint(Sealed):
    """The modes of both sides at one point.

    Parameters
    ----------
    value
        The operating point, None of one point without.
    model_a, model_b
        The models as one hit.
    modes_a, modes_b
        Modes of the rows and columns of `macs`: one of each pair, both of a couple.
    macs
        The similarity of each mode of a with each of b, NaN without shapes (modes of a, modes of b).
    turn
        By how much of a period phase zero of b is later than that of a, as the shapes say; it was moved so far.
    """

    value: float | None
    model_a: PeriodicModel
    model_b: PeriodicModel
    modes_a: tuple[tuple[int, ...], ...]
    modes_b: tuple[tuple[int, ...], ...]
    macs: Floats
    turn: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Comparison(Told, Drawn, Rebuilt):
    r"""Two sets of modes held against one another.

    .. math:: \chi^2 = d^T (\Sigma_a + \Sigma_b)^{-1} d

    with d the differences of all exponents that are paired and counted, and Σ the covariances of both sides, zero of a
    known system.

    Parameters
    ----------
    a, b
        What was compared, in words.
    over
        The quantity of the operating point; None of one point.
    points
        The modes of both sides, point by point.
    pairs
        The modes that both have.
    missing_in_a, missing_in_b
        A point and a mode of the other side that this side has not.
    chi2, dof, p
        χ², the number of its parts, and the probability that χ² is as large by the deviations alone; None, 0 and None
        where nothing is counted.
    independent
        False where both sides are identified from samples of one record: no χ² holds then.
    warnings
        What a reader must know, a sentence each.
    """

    a: str
    b: str
    over: str | None
    points: tuple[ComparedPoint, ...]
    pairs: tuple[Pair, ...]
    missing_in_a: tuple[tuple[int, int], ...]
    missing_in_b: tuple[tuple[int, int], ...]
    chi2: float | None
    dof: int
    p: float | None
    independent: bool = True
    warnings: tuple[str, ...] = ()

    @property
    def worst(self) -> Pair | None:
        """The pair with the largest z among those that count, else of all; None without any."""
        return max(self.pairs, key=lambda pair: (pair.counted, float(np.nan_to_num(pair.z))), default=None)

    def _figures(self) -> Drawings:
        return {"comparison": (self, {})}
