"""Stability of a periodic system over its parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from floquid._arrays import Complexes, Floats, Mask
from floquid._bar import bar
from floquid._checks import Rebuilt, finite, frozen_array, input_error, integer, positive
from floquid._show import Drawings, Drawn
from floquid.floquet.monodromy_matrix import TOLERANCE
from floquid.floquet.stability_maps._boundaries import (
    Samples,
    added,
    bisect,
    boundary,
    refine,
    samples,
    taken,
    thin_bands,
)
from floquid.floquet.stability_maps._spectra import Family, Spectra, family, joined, spectra

_CHUNK = 512  # points of one batch of a vectorised system
_CHUNK_PLAIN = 32  # and of a plain one, whose cost is its own
_NUMBERS = 50_000  # of the matrices of one sample of a batch


def _in_batches(of: Family, points: Floats, done: Callable[[int], None] = lambda _: None) -> Spectra:
    """The spectra at points (points, parameters); a listener is told how many are done."""
    size, parts = min(_CHUNK if of.vectorised else _CHUNK_PLAIN, 1 + _NUMBERS // len(of.scale) ** 2), []
    for start in range(0, len(points), size):
        parts.append(spectra(of, points[start : start + size]))
        done(min(start + size, len(points)))
    return joined(parts)


_HALVINGS = (20, 3)  # by default, of the steps of the grid of one and of two parameters
_EDGES = (1e-9, 1e-6)  # by default, the largest error of an edge as a fraction of the range
_NODES = 50_000_000  # of the finest lattice of two parameters


class Instability(IntEnum):
    """Kinds of instability, by the largest multiplier μ."""

    STABLE = 0
    """No instability."""

    DIVERGENCE = 1
    """μ > 1: growth without oscillation, or at whole multiples of the system's own frequency."""

    PERIOD_DOUBLING = 2
    """μ < -1: growth at odd multiples of half of the system's frequency."""

    FLUTTER = 3
    """A conjugate pair outside the unit circle."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StabilityMap(Drawn, Rebuilt):
    """Map of where a periodic system is unstable; `stability_map` makes it.

    Parameters
    ----------
    names
        The parameters, one or two.
    grids
        The values of each at the start, ascending.
    points
        Every point that was evaluated, ascending, the last parameter fastest (points, parameters).
    exponents
        The exponents at each, on the principal branch, ascending in their real parts (points, n) [1/s].
    growth
        The largest real part of the exponents at each (points,) [1/s].
    multiplier
        The largest multiplier at each (points,).
    kind
        The `Instability` at each (points,).
    grid_growth
        `growth` on the grid at the start, one axis a parameter.
    bands
        Unstable intervals of one parameter, low and high end (bands, 2); one that ends with the grid may go on.
    boundary
        Segments of the boundary of two parameters (segments, 2 ends, 2 parameters).
    margin
        The growth [1/s] above which the system is called unstable.
    """

    names: tuple[str, ...]
    grids: tuple[Floats, ...]
    points: Floats
    exponents: Complexes
    growth: Floats
    multiplier: Complexes
    kind: NDArray[np.int8]
    grid_growth: Floats
    bands: Floats | None
    boundary: Floats | None
    margin: float

    def _figures(self) -> Drawings:
        return {"stability_map": (self, {})}

    @property
    def unstable(self) -> Mask:
        """True where the system is unstable (points,)."""
        return self.kind != Instability.STABLE


def stability_map(
    system: Callable[..., ArrayLike],
    period: float | Callable[..., ArrayLike],
    parameters: Mapping[str, ArrayLike],
    *,
    vectorised: bool = False,
    breaks: ArrayLike = (),
    margin: float = 0.0,
    edge_tolerance: float | None = None,
    refinements: int | None = None,
    tolerance: float = TOLERANCE,
    narrowest: float = 1.0 / 64.0,
    progress: bool = False,
    report: Callable[[str], None] = lambda _: None,
) -> StabilityMap:
    r"""The bands, or the boundary, within which a periodic system is unstable, over one or two parameters.

    .. math:: \max_r \mathrm{Re}\,\lambda_r(p) > \text{margin}, \qquad \dot x = A(t; p)\, x, \qquad
              A(t + T(p); p) = A(t; p)

    The grid given is evaluated whole. Of one parameter, thin bands are then looked for between its values, and the
    edges of all bands are halved down to `edge_tolerance`. With two parameters, the cells of the grid are halved where
    their corners differ or a band may hide. So are the boundary's crossings of the sides of the smallest.

    A band is found if it holds a value of the grid. Between two stable values it is found if it is wider than
    2^-refinements of their distance and one pair of multipliers meets there once, from which it springs: the
    eigenvectors then change places (the sets of multipliers being followed between neighbours, as by Yakubovich and
    Starzhinskii, Linear Differential Equations with Periodic Coefficients, III), or if the growth rises towards it at
    neighbouring values. A grid so coarse that shapes change wholly between its values can miss one.

    The exponents are those of the product of the factors of Φ(T), kept in range: the largest multipliers are as good
    as the product allows, small ones may be lost, which stability does not ask for; `floquet.exponents` has them.

    Raises InputError where the parameters are not one or two ascending grids, a callable does not return what it must,
    or A(t; p) does not have the period T(p) or cannot be integrated.

    Parameters
    ----------
    system
        A(t; p): t [s] and the values of the parameters, in the order of `parameters`, -> (n, n) [1/s]. When
        `vectorised`: times and parameters, arrays that broadcast to a shape (...), -> (..., n, n).
    period
        The period T [s]; or, where it depends on the parameters, a callable of them, taking arrays when `vectorised`.
    parameters
        The names of one or two parameters and the values at which to begin, ascending (values,).
    vectorised
        Whether the callables take arrays, which is many times faster. A plain callable is called about 70 times at
        each point if A(t) is smooth.
    breaks
        Where in the period A(t) jumps, as fractions of it in [0, 1) (breaks,), the same for all values.
    margin
        The growth [1/s] above which the system is called unstable. Rounding and the error of the integration are
        taken off the growth first, multiplier by multiplier with its condition, so that with the default an undamped
        system is stable between its bands.
    edge_tolerance
        The largest error of an edge, as a fraction of the whole range of each parameter: 1e-9 by default for one
        parameter, 1e-6 for two.
    refinements
        How often the steps of the grid are halved in search of thin bands, 20 by default; of two parameters, the
        cells, 3 by default.
    tolerance
        The relative error of each factor of Φ(T), from 1e-14 to 1e-3.
    narrowest
        The shortest feature of A(t), as a fraction of the period, that must be seen: see `FunctionMatrix`. 1/16 is
        enough, and four times as quick, for a plain callable that is known to be smooth.
    progress
        Whether a progress bar is drawn on stderr, if that is a terminal.
    report
        Is told of each stage.
    """
    of = "floquet.stability_map"
    grids = _grids(parameters, of)
    names = tuple(parameters)
    margin = finite(margin, "margin", of, unit="1/s")
    limit = _EDGES[len(names) - 1] if edge_tolerance is None else positive(edge_tolerance, "edge_tolerance", of)
    halvings = integer(_HALVINGS[len(names) - 1] if refinements is None else refinements, "refinements", of, at_least=0)
    if len(names) == 2 and np.prod([(len(grid) - 1.0) * 2.0**halvings + 1.0 for grid in grids]) > _NODES:
        must = f"leave at most {_NODES:.0e} nodes of the finest lattice"
        raise input_error("refinements", of, must, f"is {halvings}", "Ask for less.")
    points = np.stack(np.meshgrid(*grids, indexing="ij"), axis=-1).reshape(-1, len(names))
    how: dict[str, Any] = {"vectorised": vectorised, "breaks": breaks, "tolerance": tolerance, "narrowest": narrowest}
    given = family(system, period, points, names, **how, of=of)
    ranges = np.array([grid[-1] - grid[0] for grid in grids])
    with bar(progress, report) as told:

        def evaluate(points: Floats, words: str) -> Spectra:
            told(words)
            return _in_batches(given, points)

        first = _in_batches(given, points, lambda done: told(f"evaluating the grid: {done} of {len(points)}"))
        known = samples(points, first, margin)
        bands = segments = None
        if len(names) == 1:
            known = thin_bands(known, evaluate, margin, halvings)
            bands, met = _bands(known, limit * ranges, evaluate, margin)
        else:
            cells = refine(grids, known, evaluate, margin, halvings)
            segments, met = boundary(cells, limit * ranges, evaluate, margin)
            known = cells.samples
    for more in met:
        known = added(known, more)
    return _map(given, known, grids, first.growth, bands, segments, margin)


def _grids(parameters: Mapping[str, ArrayLike], of: str) -> tuple[Floats, ...]:
    """The grids, checked."""
    if not isinstance(parameters, Mapping) or not 1 <= len(parameters) <= 2:
        got = f"holds {len(parameters)}" if isinstance(parameters, Mapping) else f"is {type(parameters).__name__}"
        remedy = 'Such as {"speed": np.linspace(0.4, 1.2, 201)}.'
        raise input_error("parameters", of, "map one or two names to their values", got, remedy)
    grids = tuple(frozen_array(values, "parameters", of, axes=("values",)) for values in parameters.values())
    for name, grid in zip(parameters, grids, strict=True):
        if len(grid) < 2 or (np.diff(grid) <= 0.0).any():
            must = f"hold ascending values of `{name}`, two at least"
            raise input_error("parameters", of, must, f"holds {len(grid)} values that do not ascend")
    return grids


def _bands(
    known: Samples, tolerance: Floats, evaluate: Callable[..., Spectra], margin: float
) -> tuple[Floats, list[Samples]]:
    """The unstable intervals among sorted samples of one parameter, their edges refined."""
    turn = np.flatnonzero(known.unstable[:-1] != known.unstable[1:])
    begins = known.unstable[turn + 1]
    calm = known.points[np.where(begins, turn, turn + 1)]
    wild = known.points[np.where(begins, turn + 1, turn)]
    edges, met = bisect(calm, wild, tolerance, evaluate, margin)
    ends = edges[:, 0]
    if known.unstable[0]:
        ends = np.concatenate([known.points[0], ends])
    if known.unstable[-1]:
        ends = np.concatenate([ends, known.points[-1]])
    return ends.reshape(-1, 2), met


def _map(
    given: Family,
    known: Samples,
    grids: tuple[Floats, ...],
    first: Floats,
    bands: Floats | None,
    segments: Floats | None,
    margin: float,
) -> StabilityMap:
    known = taken(known, np.lexsort(known.points.T[::-1]))
    multiplier = known.spectra.multiplier
    kind = np.where(
        multiplier.imag != 0.0,
        Instability.FLUTTER,
        np.where(multiplier.real > 0.0, Instability.DIVERGENCE, Instability.PERIOD_DOUBLING),
    )
    kind[~known.unstable] = Instability.STABLE
    arrays = {
        "points": known.points,
        "exponents": known.spectra.exponents,
        "growth": known.spectra.growth,
        "multiplier": multiplier,
        "kind": kind.astype(np.int8),
        "grid_growth": first.reshape([len(grid) for grid in grids]),
        "bands": bands,
        "boundary": segments,
    }
    for array in arrays.values():
        if array is not None:
            array.flags.writeable = False
    return StabilityMap(names=given.names, grids=grids, margin=margin, **arrays)
