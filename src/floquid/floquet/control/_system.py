"""Linear time-periodic systems with inputs and outputs, and their responses to inputs that are sampled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias, final, get_args

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Floats, Indices
from floquid._checks import an_instance, frozen_array, input_error, wrong_value
from floquid._show import Brief
from floquid.floquet.matrices import (
    SAME,
    AbstractPeriodicMatrix,
    Operand,
    Prepared,
    after_jumps,
    common_period,
    constant_matrix,
    constant_of,
    joint_breaks,
    named,
    operand,
    probe_times,
)
from floquid.floquet.monodromy_matrix import TOLERANCE, checked, divided, factorise, stages

# A, B, C and D.
Matrices: TypeAlias = tuple[
    AbstractPeriodicMatrix, AbstractPeriodicMatrix, AbstractPeriodicMatrix, AbstractPeriodicMatrix
]

_PROBES = 64


@final
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PeriodicSystem(Brief):
    r"""A linear time-periodic system.

    .. math:: \dot x = A(t)\, x + B(t)\, u, \qquad y = C(t)\, x + D(t)\, u

    All that vary have one period; a constant has any.

    Raises InputError where shapes do not agree, no matrix is periodic, the periods differ, or names are not
    distinct.

    Parameters
    ----------
    A
        The state matrix, periodic or a constant array (n, n) [1/s].
    B
        The input matrix (n, inputs); by default there are no inputs.
    C
        The output matrix (outputs, n); by default the outputs are the states.
    D
        The direct term (outputs, inputs); by default zero.
    states, inputs, outputs
        Their names; by default x1, x2, ..., u1, u2, ... and y1, y2, ....
    """

    A: AbstractPeriodicMatrix
    B: AbstractPeriodicMatrix | None
    C: AbstractPeriodicMatrix
    D: AbstractPeriodicMatrix | None
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    def __init__(
        self,
        *,
        A: AbstractPeriodicMatrix | ArrayLike,
        B: AbstractPeriodicMatrix | ArrayLike | None = None,
        C: AbstractPeriodicMatrix | ArrayLike | None = None,
        D: AbstractPeriodicMatrix | ArrayLike | None = None,
        states: Sequence[str] | None = None,
        inputs: Sequence[str] | None = None,
        outputs: Sequence[str] | None = None,
    ) -> None:
        of = "PeriodicSystem"
        if B is None and D is not None:
            raise input_error("B", of, "be given with D", "is None", "Without inputs leave out both.")
        given = {"A": operand(A, "A", of)}
        n = given["A"].shape[0]
        given["C"] = np.eye(n) if C is None else operand(C, "C", of)
        if B is not None:
            given["B"] = operand(B, "B", of)
            n_outputs, n_inputs = given["C"].shape[0], given["B"].shape[1]
            given["D"] = np.zeros((n_outputs, n_inputs)) if D is None else operand(D, "D", of)
            _check_shape(given["B"], "B", (n, n_inputs), "(n, inputs)")
            _check_shape(given["D"], "D", (n_outputs, n_inputs), "(outputs, inputs)")
        _check_shape(given["A"], "A", (n, n), "(n, n)")
        _check_shape(given["C"], "C", (given["C"].shape[0], n), "(outputs, n)")
        held = _over_one_period(given)
        put = object.__setattr__
        for name in "ABCD":
            put(self, name, held.get(name))
        put(self, "states", named(states, n, "x", "states", of))
        put(self, "inputs", named(inputs, self.n_inputs, "u", "inputs", of))
        put(self, "outputs", named(outputs, self.n_outputs, "y", "outputs", of))

    @property
    def period(self) -> float:
        """The period T [s]."""
        return self.A.period

    @property
    def n_states(self) -> int:
        """The number of states, n."""
        return self.A.shape[0]

    @property
    def n_inputs(self) -> int:
        """The number of inputs."""
        return 0 if self.B is None else self.B.shape[1]

    @property
    def n_outputs(self) -> int:
        """The number of outputs."""
        return self.C.shape[0]


def _check_shape(matrix: Operand, argument: str, shape: tuple[int, int], words: str) -> None:
    if matrix.shape != shape:
        raise input_error(argument, "PeriodicSystem", f"have shape {words} = {shape}", f"has shape {matrix.shape}")


def _over_one_period(given: dict[str, Operand]) -> dict[str, AbstractPeriodicMatrix]:
    """All of them over the period of those that vary."""
    of = "PeriodicSystem"
    values = {name: constant_of(matrix) for name, matrix in given.items()}
    periodic = {name: matrix for name, matrix in given.items() if isinstance(matrix, AbstractPeriodicMatrix)}
    varying = {name: matrix for name, matrix in periodic.items() if values[name] is None}
    if varying:
        period = common_period(varying, of)
    else:
        some = [matrix.period for matrix in periodic.values()]
        if not some:
            remedy = "Pass `HarmonicMatrix(coefficients=A[:, :, None], harmonics=[0], period=...)`."
            raise input_error("A", of, "have a period where all is constant", "is an array", remedy)
        period = some[0]
    held = {name: constant_matrix(value, period) for name, value in values.items() if value is not None}
    return {**held, **varying}


def matrix_reach(prepared: Prepared, entry: AbstractPeriodicMatrix) -> Floats:
    """The speed at which a unit of each input moves the states, in their units (inputs,)."""
    size = np.abs(entry.at(probe_times(entry.period, _PROBES))).max(axis=0)
    return (size / prepared.scale[:, None]).max(axis=0)


def input_units(prepared: Prepared, reach: Floats) -> Floats:
    """Units of the inputs in which they move the states as quickly as these move each other, powers of two."""
    rate = prepared.size or 1.0 / prepared.matrix.period
    return np.where(reach > 0.0, 2.0 ** np.round(np.log2(rate / np.where(reach > 0.0, reach, rate))), 1.0)


def checked_system(system: PeriodicSystem, of: str, *, inputs: bool) -> None:
    """Refuse what is no periodic system, and one without inputs where they are needed."""
    an_instance(system, PeriodicSystem, "system", of, "Of A(t) alone: `PeriodicSystem(A=...)`.")
    if inputs and system.B is None:
        raise input_error("system", of, "have inputs", "has none", "Give it a `B`.")


def with_inputs(system: PeriodicSystem, of: str) -> Matrices:
    """A, B, C and D of a periodic system, refused where it has no inputs."""
    checked_system(system, of, inputs=True)
    assert system.B is not None
    assert system.D is not None
    return system.A, system.B, system.C, system.D


Between: TypeAlias = Literal["linear", "held"]
_OF = "floquet.simulate"
_BATCH = 2048  # gaps between instants that are integrated at once


def simulate(
    system: PeriodicSystem,
    inputs: ArrayLike | None,
    times: ArrayLike,
    *,
    initial: ArrayLike | None = None,
    between: Between = "linear",
    tolerance: float = TOLERANCE,
) -> Floats:
    r"""The outputs of a periodic system at `times` under given inputs (outputs, times); the value after a jump.

    .. math:: x(t_{k+1}) = \Phi(t_{k+1}, t_k)\, x(t_k) + \int_{t_k}^{t_{k+1}} \Phi(t_{k+1}, s)\, B(s)\, u(s)\, ds,
              \qquad y(t_k) = C(t_k)\, x(t_k) + D(t_k)\, u(t_k)

    Φ and the integral are found together: the forcing is one more column of the transition matrix (Van Loan 1978).
    Collocation halves its intervals until each reaches the tolerance. Of samples, what belongs to a gap between two
    instants is found once for every phase of the period that it begins at: a long record in steps that divide the
    period costs hardly more than one period of it.

    Raises InputError where a shape is not possible, `times` does not ascend, the system cannot be integrated, or the
    response overflows.

    Parameters
    ----------
    system
        The periodic system.
    inputs
        The samples of u at `times` (inputs, times); None for no inputs.
    times
        Instants, ascending, with the initial state at the first (times,) [s].
    initial
        The state at the first instant (n,); zero by default.
    between
        What samples of u are taken to be between the instants: "linear", or "held" at the last sample.
    tolerance
        The relative error of each step: that of the transition to itself, that of the forcing to its largest value.
        From 1e-14 to 1e-3.
    """
    checked_system(system, _OF, inputs=False)
    if between not in get_args(Between):
        raise wrong_value("between", _OF, 'be "linear" or "held"', between)
    instants = frozen_array(times, "times", _OF, axes=("times",))
    if not instants.size or (np.diff(instants) < 0.0).any():
        raise input_error("times", _OF, "ascend and hold one instant at least", f"has shape {instants.shape}")
    start = frozen_array(
        np.zeros(system.n_states) if initial is None else initial, "initial", _OF, axes=(system.n_states,)
    )
    prepared = checked(system.A, None, (), tolerance, _OF)
    given = np.zeros((system.n_inputs, instants.size)) if inputs is None else inputs
    remedy = "Give one sample for each of `times`, the last axis."
    given = frozen_array(given, "inputs", _OF, axes=(system.n_inputs, instants.size), remedy=remedy)
    states = _sampled(prepared, None if inputs is None else system.B, given, instants, start, between, tolerance)
    phases = np.mod(instants, system.period)
    outputs = np.einsum("tij,tj->it", after_jumps(system.C, phases), states)
    if system.D is not None and len(given):
        outputs += np.einsum("tij,jt->it", after_jumps(system.D, phases), given)
    return outputs


def _sampled(
    prepared: Prepared,
    entry: AbstractPeriodicMatrix | None,
    inputs: Floats,
    instants: Floats,
    start: Floats,
    between: Between,
    tolerance: float,
) -> Floats:
    r"""The states at the instants (times, n) under samples of the inputs.

    .. math:: x_{k+1} = \Phi_k x_k + \int \Phi B\, ds\; u_k
              + \int \Phi B\, \frac{s - t_k}{t_{k+1} - t_k}\, ds\; (u_{k+1} - u_k)
    """
    widths = np.diff(instants)
    period = prepared.matrix.period
    # Instants k·dt are known to their own rounding, and gaps that differ by less are one.
    grain = max(SAME, 8.0 * np.finfo(float).eps * float(np.abs(instants).max()) / period) * period
    phases = np.mod(instants[:-1], period)
    keys = np.stack([np.round(phases / grain), np.round(widths / grain)], axis=1).astype(np.int64)
    _, first, which = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    blocks = 0 if entry is None else 1 + (between == "linear")
    steps = np.empty((len(first), len(start), len(start) + blocks * len(inputs)))
    for begin in range(0, len(first), _BATCH):
        some = first[begin : begin + _BATCH]
        steps[begin : begin + _BATCH] = _steps(prepared, entry, phases[some], widths[some], blocks, tolerance)
    n, m = len(start), len(inputs)
    index = which.ravel()
    forcing = np.zeros((len(index), n))
    if blocks:
        forcing += np.einsum("kij,jk->ki", steps[index, :, n : n + m], inputs[:, :-1])
    if blocks == 2:
        forcing += np.einsum("kij,jk->ki", steps[index, :, n + m :], np.diff(inputs))
    states = np.empty((len(instants), n))
    states[0] = start
    free = steps[:, :, :n]
    with np.errstate(over="ignore", invalid="ignore"):
        for k, step in enumerate(index.tolist()):
            states[k + 1] = free[step] @ states[k] + forcing[k]
    good = np.isfinite(states).all(axis=1)
    if not good.all():
        must = "end before the response leaves the range of floating point"
        raise input_error("times", _OF, must, f"it overflows by t = {instants[int(np.argmin(good))]:g}")
    return states


def _steps(
    prepared: Prepared,
    entry: AbstractPeriodicMatrix | None,
    left: Floats,
    widths: Floats,
    blocks: int,
    tolerance: float,
) -> Floats:
    """Φ over each gap, and beside it what the inputs, then their slopes, move the states (gaps, n, n + blocks m)."""
    matrix = prepared.matrix
    n = len(prepared.scale)
    m = 0 if entry is None else entry.shape[1]
    whole = n + blocks * m
    units = np.empty(0) if entry is None else input_units(prepared, matrix_reach(prepared, entry))

    def evaluate(owner: Indices, times: Floats) -> Floats:
        out = np.zeros((*times.shape, whole, whole))
        out[..., :n, :n] = matrix.at(times)
        if entry is not None:
            out[..., :n, n : n + m] = entry.at(times)
        if blocks == 2:
            rows = np.arange(n, n + m)
            out[..., rows, rows + m] = (1.0 / widths[owner])[:, None, None]
        return out

    matrices = (matrix,) if entry is None else (matrix, entry)
    gap, starts, ends = _pieces(left, left + widths, joint_breaks(matrices, matrix.period), prepared)
    found = factorise(
        evaluate,
        gap,
        starts,
        ends,
        scale=np.concatenate([prepared.scale, np.tile(units, blocks)]),
        tolerance=tolerance,
        smooth=prepared.smooth and not (entry is not None and entry.is_function),
    )
    if not found.finished:
        worst = found.left[int(np.argmin(found.right - found.left))]
        must = f"be integrable with its inputs to a relative error of {tolerance:g}"
        remedy = "Name the instants at which its matrices jump in their `breaks`, or raise `tolerance`."
        raise input_error("system", _OF, must, f"the steps near t = {worst:g} shrink without end", remedy)
    out = np.broadcast_to(np.eye(whole), (len(left), whole, whole)).copy()
    with np.errstate(over="ignore", invalid="ignore"):
        for owner, factor in zip(found.owner.tolist(), found.matrices, strict=True):
            out[owner] = factor @ out[owner]
    return out[:, :n]


def _pieces(left: Floats, right: Floats, breaks: Floats, prepared: Prepared) -> tuple[Indices, Floats, Floats]:
    """First intervals in each gap: the gap (intervals,), left and right ends, none across a break or too long."""
    period, scale = prepared.matrix.period, prepared.scale
    owner, ends = np.arange(len(left)), np.stack([left, right], axis=1)
    if breaks.size and len(left):
        turns = period * np.arange(np.ceil(right.max() / period) + 1.0)
        jumps = np.add.outer(turns, breaks).ravel()
        gap, jump = np.nonzero((jumps > left[:, None]) & (jumps < right[:, None]))
        every = np.concatenate([owner, owner, gap]), np.concatenate([left, right, jumps[jump]])
        order = np.lexsort((every[1], every[0]))
        whose, at = every[0][order], every[1][order]
        same = whose[1:] == whose[:-1]
        owner, ends = whose[:-1][same], np.stack([at[:-1], at[1:]], axis=1)[same]
    width = ends[:, 1] - ends[:, 0]
    real = width > 0.0
    owner, ends, width = owner[real], ends[real], width[real]
    longest = min(0.5 * period, stages(len(scale)) / (3.0 * prepared.size)) if prepared.size else 0.5 * period
    parts = np.maximum(1, np.ceil(width / longest - 1e-9)).astype(np.intp)
    interval, lefts, rights = divided(ends[:, 0], ends[:, 1], parts)
    return owner[interval], lefts, rights
