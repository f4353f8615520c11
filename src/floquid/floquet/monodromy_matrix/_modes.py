"""Floquet modes of a known A(t): exponents, periodic shapes and participation, in states or in outputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import ClassVar, overload

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Complexes, Floats, Integers
from floquid._checks import Rebuilt, input_error, integer
from floquid._show import Drawings, Drawn, Told
from floquid.core import Channel, PeriodicModel, Provenance
from floquid.floquet.matrices import AbstractPeriodicMatrix, Prepared, StateMatrix, balanced_units, operand
from floquid.floquet.monodromy_matrix import _periodic_schur
from floquid.floquet.monodromy_matrix._collocation import Factors
from floquid.floquet.monodromy_matrix._transition import (
    TOLERANCE,
    balanced,
    checked,
    factors,
    refuse_lost,
    trace_integral,
)

_FIRST, _LAST = 64, 512  # phases of the period tried until the shapes' harmonics have died away
_MANY = 20  # states from which half as many phases are tried first, since each costs their cube
_TAIL = 1e-10  # of a shape: its harmonics in the last eighth, where more phases are not needed
_SHARED = 1e3  # condition of an exponent above which its shape may be another's
_CLOSE = 10.0  # errors of an exponent within which another is not told from it


class ModesOutcome(Enum):
    """The outcome of the analysis, with the remedy."""

    FULL = "the modes are a full set"
    DEFECTIVE = (
        "some exponents may be multiple and share a shape (see `defective`). Their mean is right; each alone only to "
        "the root of the tolerance. The response has terms t e^{λt}: use `floquet_lyapunov`, which needs no full set"
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FloquetModes(Told, Drawn, Rebuilt):
    r"""The modes of x' = A(t) x.

    .. math:: x(t) = \sum_r p_r(t)\, e^{\lambda_r t}\, q_r, \qquad
              p_r(t) = p_r(t + T) = \sum_m c_{r,m}\, e^{i m \omega t}

    Each exponent is the representative of its class modulo iω whose zeroth harmonic is the strongest of its shape,
    states weighted so that units do not matter; conjugates are chosen together. Of the zeroth harmonic of a shape the
    state that is strongest by the same weights is one.

    Parameters
    ----------
    exponents
        λ (modes,) [1/s], by \|Im λ\| of the principal value, then by falling real part.
    coefficients
        c_{r,m} (modes, states, harmonics).
    harmonics
        m, ascending (harmonics,).
    period
        T [s].
    participation
        The share of each harmonic in its shape's mean square (modes, harmonics), states weighted as above: it sums to
        one over the harmonics.
    condition
        Of each exponent, 1 for shapes at right angles (modes,): by what a relative error of the multipliers' factors is
        multiplied.
    defective
        Groups of indices of modes that cannot be told from a multiple exponent with a shared shape.
    outcome
        Whether the modes are a full set.
    mean_trace
        The mean of tr A(t) over the period [1/s], which the exponents sum to (Liouville).
    """

    kind: ClassVar[str] = "modes"  # by it the functions for a result are found
    exponents: Complexes
    coefficients: Complexes
    harmonics: Integers
    period: float
    participation: Floats
    condition: Floats
    defective: tuple[tuple[int, ...], ...]
    outcome: ModesOutcome
    mean_trace: float

    def _figures(self) -> Drawings:
        return dict.fromkeys(("exponents", "periodic_shapes"), (self, {}))

    @property
    def order(self) -> int:
        """The number of modes, conjugates counted one by one."""
        return len(self.exponents)

    @property
    def fundamental(self) -> float:
        """ω = 2π/T [rad/s]."""
        return 2.0 * np.pi / self.period

    @property
    def multipliers(self) -> Complexes:
        """e^{λT} (modes,); one below 1e-308 is zero."""
        with np.errstate(over="ignore", under="ignore"):
            return np.exp(self.exponents * self.period)

    @property
    def frequencies_hz(self) -> Floats:
        """The physical frequencies |λ|/2π (modes,) [Hz]."""
        return np.abs(self.exponents) / (2.0 * np.pi)

    @property
    def damping_ratios(self) -> Floats:
        """The damping ratios -Re λ/|λ| (modes,), negative for a growing mode."""
        size = np.abs(self.exponents)
        return np.divide(-self.exponents.real, size, out=np.zeros_like(size), where=size > 0)

    @property
    def growth(self) -> float:
        """The largest Re λ [1/s]: the system is asymptotically stable where it is negative."""
        return float(self.exponents.real.max())

    def principal(self) -> Complexes:
        """The exponents on the strip -ω/2 < Im λ ≤ ω/2 (modes,) [1/s]."""
        turns = self.exponents.imag / self.fundamental
        return self.exponents - 1j * self.fundamental * np.ceil(turns - 0.5 - 1e-12)

    def shapes(self, times: ArrayLike) -> Complexes:
        """The periodic shapes p_r at `times` [s] (modes, states, times)."""
        t = np.atleast_1d(np.asarray(times, dtype=np.float64))
        return self.coefficients @ np.exp(1j * self.fundamental * np.multiply.outer(self.harmonics, t))


@overload
def modes(
    system: StateMatrix,
    period: float | None = None,
    *,
    breaks: ArrayLike = (),
    n_phases: int | None = None,
    tolerance: float = TOLERANCE,
    outputs: None = None,
) -> FloquetModes: ...
@overload
def modes(
    system: StateMatrix,
    period: float | None = None,
    *,
    breaks: ArrayLike = (),
    n_phases: int | None = None,
    tolerance: float = TOLERANCE,
    outputs: AbstractPeriodicMatrix | ArrayLike,
    channels: Sequence[Channel | str] | None = None,
    point: Mapping[str, float] | None = None,
) -> PeriodicModel: ...
def modes(
    system: StateMatrix,
    period: float | None = None,
    *,
    breaks: ArrayLike = (),
    n_phases: int | None = None,
    tolerance: float = TOLERANCE,
    outputs: AbstractPeriodicMatrix | ArrayLike | None = None,
    channels: Sequence[Channel | str] | None = None,
    point: Mapping[str, float] | None = None,
) -> FloquetModes | PeriodicModel:
    """The Floquet modes of A(t): exponents and periodic shapes, by factors that are never multiplied out.

    Allen 2009, eqs. (3), (4), (6). The shape of a small multiplier is carried through each factor in the direction in
    which errors decay. `system`, `period`, `breaks` and `tolerance` are as in `transition`, errors as in `exponents`;
    `n_phases` are equal steps of the period at which shapes are found, 8 at least: by default 32 or 64, or as many more
    as their harmonics need, 512 at most.

    With `outputs`, C of y = C(t) x, constant or periodic, it is the `PeriodicModel` of the shapes in y, as one of a
    record: its `channels` are y1, y2, ... by default, its operating `point` has none.
    """
    of = "floquet.modes"
    prepared = checked(system, period, breaks, tolerance, of)
    first = _FIRST if len(prepared.scale) < _MANY else _FIRST // 2
    count = first if n_phases is None else integer(n_phases, "n_phases", of, at_least=8)
    while True:
        length = prepared.matrix.period
        found = factors(prepared, length * np.arange(count + 1) / count, tolerance, of)
        carried = _periodic_schur.modes(_periodic_schur.schur(balanced(found, prepared)))
        # The first factor of each step begins on its phase.
        shapes = _periodic_schur.periodic_shapes(carried, np.searchsorted(found.owner, np.arange(count)))
        lines = np.fft.fft(shapes, axis=0) / count
        sizes = np.abs(lines).max(axis=1)  # (lines, modes)
        upper = sizes[count // 2 - count // 16 : count // 2 + count // 16 + 1].max(axis=0)
        if n_phases is not None or count >= _LAST or (upper <= _TAIL * sizes.max(axis=0)).all():
            break
        count *= 2
    refuse_lost(carried.logarithms, found, prepared, of)
    made = _assembled(carried, lines, prepared, found, tolerance)
    if outputs is None:
        return made
    return seen(made.exponents, made.coefficients, made.harmonics, made.period, outputs, channels, point, of)


def _assembled(
    carried: _periodic_schur.ProductModes, lines: Complexes, prepared: Prepared, found: Factors, tolerance: float
) -> FloquetModes:
    """The modes sorted, each on its representative branch, in the units of the caller."""
    period, count = prepared.matrix.period, len(lines)
    order = _periodic_schur.principal_order(carried.logarithms)
    exponents = carried.logarithms[order] / period
    limit = (count - 1) // 2
    harmonics = np.arange(-limit, limit + 1)
    plain = np.moveaxis(lines[harmonics % count][:, :, order], (2, 1, 0), (0, 1, 2)) * prepared.scale[None, :, None]
    units = balanced_units(np.abs(prepared.matrix.at(period * np.arange(16) / 16)).max(axis=0))
    energy = (np.abs(plain / units[None, :, None]) ** 2).sum(axis=1)
    centres = _centres(exponents, energy, harmonics, 2.0 * np.pi / period)
    shifted = np.stack([_moved(c, int(m)) for c, m in zip(plain, centres, strict=True)])
    shares = (np.abs(shifted / units[None, :, None]) ** 2).sum(axis=1)
    middle = shifted[:, :, limit]
    strongest = np.take_along_axis(middle, np.abs(middle / units).argmax(axis=1)[:, None], axis=1)
    vectors = carried.vectors[0][:, order] * (prepared.scale / units)[:, None]
    condition = np.linalg.norm(left_vectors(vectors), axis=1) * np.linalg.norm(vectors, axis=0)
    error = tolerance * len(found.owner) ** 0.5 * condition
    groups = _defective(carried.logarithms[order], condition, error)
    return FloquetModes(
        exponents=exponents + 2j * np.pi / period * centres,
        coefficients=shifted / strongest[:, :, None],
        harmonics=harmonics,
        period=period,
        participation=shares / shares.sum(axis=1, keepdims=True),
        condition=condition,
        defective=groups,
        outcome=ModesOutcome.DEFECTIVE if groups else ModesOutcome.FULL,
        mean_trace=trace_integral(found, prepared) / period,
    )


def _centres(exponents: Complexes, energy: Floats, harmonics: Integers, fundamental: float) -> Integers:
    """The harmonic that becomes the zeroth of each mode: the strongest; of equals that of the larger |Im|."""
    centres = np.zeros(len(exponents), dtype=np.int64)
    edge = 0.5 * fundamental
    for r, (exponent, share) in enumerate(zip(exponents, energy, strict=True)):
        alone = min(abs(exponent.imag), abs(abs(exponent.imag) - edge)) <= 1e-9 * fundamental
        best = np.flatnonzero(share >= share.max() * (1.0 - 1e-6))
        moved = np.abs(exponent.imag + harmonics[best] * fundamental)
        # A mode that is its own conjugate has equal harmonics on both sides: the upper one is taken.
        upper = harmonics[best] + (exponent.imag / fundamental if alone else 0.0)
        centres[r] = harmonics[best[np.lexsort((-upper, -np.round(moved / fundamental, 6)))[0]]]
    return centres


def _moved(coefficients: Complexes, centre: int) -> Complexes:
    """The coefficients (n, harmonics) with `centre` made the zeroth; what leaves the range has died away."""
    out = np.zeros_like(coefficients)
    size = coefficients.shape[1]
    if centre >= 0:
        out[:, : size - centre] = coefficients[:, centre:]
    else:
        out[:, -centre:] = coefficients[:, : size + centre]
    return out


def left_vectors(vectors: Complexes) -> Complexes:
    """The inverses (..., n, n); of a singular set that of one a rounding error away."""
    u, s, vh = np.linalg.svd(vectors)
    sizes = np.maximum(s, 1e-16 * s[..., :1])[..., None]
    inverse = np.swapaxes(vh.conj(), -1, -2) @ (np.swapaxes(u.conj(), -1, -2) / sizes)
    return np.asarray(inverse, dtype=np.complex128)


def _defective(logs: Complexes, condition: Floats, error: Floats) -> tuple[tuple[int, ...], ...]:
    """Groups of modes nearer to each other than their errors, whose shapes are nearly one."""
    gap = logs[:, None] - logs[None, :]
    turned = (gap.imag + np.pi) % (2.0 * np.pi) - np.pi
    distance = np.hypot(gap.real, turned)
    doubtful = condition > _SHARED
    near = (distance <= _CLOSE * np.maximum(error[:, None], error[None, :])) & doubtful[:, None] & doubtful[None, :]
    groups: list[tuple[int, ...]] = []
    left = set(range(len(logs)))
    while left:
        group, fresh = set(), {left.pop()}
        while fresh:
            group |= fresh
            fresh = {j for i in fresh for j in np.flatnonzero(near[i]).tolist()} - group
        left -= group
        if len(group) > 1:
            groups.append(tuple(sorted(group)))
    return tuple(sorted(groups))


def seen(
    exponents: Complexes,
    coefficients: Complexes,
    harmonics: Integers,
    period: float,
    outputs: AbstractPeriodicMatrix | ArrayLike,
    channels: Sequence[Channel | str] | None,
    point: Mapping[str, float] | None,
    of: str,
) -> PeriodicModel:
    """The model of modes with `coefficients` (modes, states, harmonics) in the outputs y = C(t) x, C the `outputs`."""
    matrix = operand(outputs, "outputs", of)
    if matrix.shape[1] != coefficients.shape[1]:
        must = f"have shape (outputs, {coefficients.shape[1]})"
        raise input_error("outputs", of, must, f"has shape {matrix.shape}", "It has one column a state.")
    names = [f"y{row}" for row in range(1, matrix.shape[0] + 1)] if channels is None else channels
    return PeriodicModel(
        exponents=exponents,
        coefficients=_lines(matrix, coefficients, harmonics, period, of)[:, :, None],
        harmonics=harmonics,
        period=period,
        channels=names,
        provenance=Provenance(sources=("a known A(t)",)),
        point=point,
    )


def _lines(
    matrix: AbstractPeriodicMatrix | Floats, coefficients: Complexes, harmonics: Integers, period: float, of: str
) -> Complexes:
    """The harmonics of C(t) times the shapes (modes, outputs, harmonics)."""
    if not isinstance(matrix, AbstractPeriodicMatrix):
        return matrix @ coefficients
    turns = period / matrix.period
    if abs(turns - round(turns)) > 1e-9 * turns or round(turns) < 1:
        must = f"repeat with the period of A(t), {period:.9g} s"
        raise input_error("outputs", of, must, f"repeats every {matrix.period:.9g} s")
    count = 4 * len(harmonics)  # room for as many harmonics of C(t) again, without folding
    times = period * np.arange(count) / count
    waves = np.exp(2j * np.pi * np.multiply.outer(harmonics, np.arange(count)) / count)
    values = np.einsum("tcn,rnt->rct", matrix.at(times), coefficients @ waves)
    return np.asarray(values @ waves.conj().T / count, np.complex128)
