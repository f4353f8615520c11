"""Linear time-periodic systems with inputs and outputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, TypeAlias, final

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Floats
from floquid._checks import input_error
from floquid._show import Brief
from floquid.floquet.matrices import (
    AbstractPeriodicMatrix,
    FunctionMatrix,
    Operand,
    Prepared,
    assembled,
    constant_matrix,
    constant_value,
    declared,
    multiples,
    named,
    operand,
    probe_times,
    stretches,
)

# A, B, C and D.
Matrices: TypeAlias = tuple[
    AbstractPeriodicMatrix, AbstractPeriodicMatrix, AbstractPeriodicMatrix, AbstractPeriodicMatrix
]

_SINGULAR = 1e-12  # reciprocal condition of I ∓ D₁D₂ below which a loop has no solution
_PROBES = 64


@final
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PeriodicSystem(Brief):
    r"""A linear time-periodic system.

    .. math:: \dot x = A(t)\, x + B(t)\, u, \qquad y = C(t)\, x + D(t)\, u

    `G2 @ G1` is G1 followed by G2, `G1 + G2` and `G1 - G2` are in parallel, `G1.feedback(G2)` closes a loop.
    All four are held over their least common period; a constant has any period, so it takes no part in finding it.

    Raises InputError where shapes do not agree, no matrix is periodic, the periods have no common multiple, or names
    are not distinct.

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

    def __matmul__(self, other: Any) -> PeriodicSystem:
        """`other` first, then this one."""
        if not isinstance(other, PeriodicSystem):
            return NotImplemented
        if self.n_inputs != other.n_outputs:
            got = f"has {other.n_outputs}"
            raise input_error("right", "@", f"have as many outputs as the left has inputs, {self.n_inputs}", got)
        second, first = with_inputs(self, "@", "left"), with_inputs(other, "@", "right")
        (A2, B2, C2, D2), (A1, B1, C1, D1) = second, first
        return _built(
            A=[[A1, np.zeros((other.n_states, self.n_states))], [B2 @ C1, A2]],
            B=[[B1], [B2 @ D1]],
            C=[[D2 @ C1, C2]],
            D=D2 @ D1,
            states=_joined(other.states, self.states),
            inputs=other.inputs,
            outputs=self.outputs,
        )

    def __add__(self, other: Any) -> PeriodicSystem:
        """Both at one input, their outputs added."""
        if not isinstance(other, PeriodicSystem):
            return NotImplemented
        sizes, theirs = (self.n_outputs, self.n_inputs), (other.n_outputs, other.n_inputs)
        if sizes != theirs:
            raise input_error("right", "+", f"have {sizes[0]} outputs and {sizes[1]} inputs", f"has {theirs}")
        (A1, B1, C1, D1), (A2, B2, C2, D2) = with_inputs(self, "+", "left"), with_inputs(other, "+", "right")
        n, m = self.n_states, other.n_states
        return _built(
            A=[[A1, np.zeros((n, m))], [np.zeros((m, n)), A2]],
            B=[[B1], [B2]],
            C=[[C1, C2]],
            D=D1 + D2,
            states=_joined(self.states, other.states),
            inputs=self.inputs,
            outputs=self.outputs,
        )

    def __neg__(self) -> PeriodicSystem:
        """The outputs with the other sign."""
        return PeriodicSystem(
            A=self.A,
            B=self.B,
            C=-self.C,
            D=None if self.D is None else -self.D,
            states=self.states,
            inputs=self.inputs,
            outputs=self.outputs,
        )

    def __sub__(self, other: Any) -> PeriodicSystem:
        """Both at one input, the outputs of the other taken away."""
        return self + -other if isinstance(other, PeriodicSystem) else NotImplemented

    def feedback(self, other: PeriodicSystem, *, sign: Literal[-1, 1] = -1) -> PeriodicSystem:
        r"""The loop closed through `other`, from this one's outputs back to its inputs; the states of both.

        .. math:: u_1 = r \pm y_2, \qquad u_2 = y_1, \qquad y = y_1

        Feedback is negative with a `sign` of -1 and positive with 1.

        Raises InputError where the numbers of inputs and outputs do not match, or at some time I ∓ D₁(t) D₂(t) is
        singular or all but: then the loop has no solution.
        """
        of = "PeriodicSystem.feedback"
        checked_system(other, of, inputs=True, argument="other")
        if sign not in (-1, 1):
            raise input_error("sign", of, "be -1 or 1", f"is {sign!r}")
        wanted, theirs = (self.n_inputs, self.n_outputs), (other.n_outputs, other.n_inputs)
        if wanted != theirs:
            raise input_error("other", of, f"have {wanted[0]} outputs and {wanted[1]} inputs", f"has {theirs}")
        (A1, B1, C1, D1), (A2, B2, C2, D2) = with_inputs(self, of, "self"), with_inputs(other, of, "other")
        E = _inverse(np.eye(self.n_outputs) - sign * (D1 @ D2), of)  # y₁ = E (C₁x₁ ± D₁C₂x₂ + D₁r)
        direct, from_first, from_second = E @ D1, E @ C1, sign * (E @ D1 @ C2)
        back = sign * (B1 @ D2)
        return _built(
            A=[
                [A1 + back @ from_first, sign * (B1 @ C2) + back @ from_second],
                [B2 @ from_first, A2 + B2 @ from_second],
            ],
            B=[[B1 + back @ direct], [B2 @ direct]],
            C=[[from_first, from_second]],
            D=direct,
            states=_joined(self.states, other.states),
            inputs=self.inputs,
            outputs=self.outputs,
        )


def _check_shape(matrix: Operand, argument: str, shape: tuple[int, int], words: str) -> None:
    if matrix.shape != shape:
        must = f"have shape {words} = {shape}"
        raise input_error(argument, "PeriodicSystem", must, f"has shape {matrix.shape}")


def _over_one_period(given: dict[str, Operand]) -> dict[str, AbstractPeriodicMatrix]:
    """All of them over the least common period of those that vary."""
    of = "PeriodicSystem"
    values = {name: constant_value(m) if isinstance(m, AbstractPeriodicMatrix) else m for name, m in given.items()}
    varying = {
        name: matrix
        for name, matrix in given.items()
        if isinstance(matrix, AbstractPeriodicMatrix) and values[name] is None
    }
    if varying:
        period, counts = multiples(tuple(matrix.period for matrix in varying.values()), of)
    else:
        some = [matrix.period for matrix in given.values() if isinstance(matrix, AbstractPeriodicMatrix)]
        if not some:
            remedy = "Pass `HarmonicMatrix(coefficients=A[:, :, None], harmonics=[0], period=...)`."
            raise input_error("A", of, "have a period where all is constant", "is an array", remedy)
        period, counts = some[0], []
    held: dict[str, AbstractPeriodicMatrix] = {
        name: constant_matrix(value, period) for name, value in values.items() if value is not None
    }
    return held | {
        name: declared(matrix, count, period) for (name, matrix), count in zip(varying.items(), counts, strict=True)
    }


def _built(
    A: list[list[Operand]],
    B: list[list[Operand]],
    C: list[list[Operand]],
    D: AbstractPeriodicMatrix,
    **names: tuple[str, ...],
) -> PeriodicSystem:
    """The system of these blocks; the period of D is that of what is constant alone, the rest finds its own."""
    return PeriodicSystem(A=assembled(A, D.period), B=assembled(B, D.period), C=assembled(C, D.period), D=D, **names)


def _joined(first: tuple[str, ...], second: tuple[str, ...]) -> tuple[str, ...]:
    """The names of both; those of the second that are taken get a number."""
    names = list(first)
    for name in second:
        free, number = name, 2
        while free in names or (free != name and free in second):
            free, number = f"{name}_{number}", number + 1
        names.append(free)
    return tuple(names)


def _inverse(matrix: AbstractPeriodicMatrix, of: str) -> AbstractPeriodicMatrix:
    """The inverse at every time, refused where there is none."""
    values = matrix.at(stretches(matrix))
    sizes = np.linalg.svd(values, compute_uv=False)
    # Between two breaks a determinant is continuous: one of both signs has a zero, whether or not an instant met it.
    signs = np.linalg.slogdet(values)[0]
    if (sizes[..., -1] <= _SINGULAR * sizes[..., 0]).any() or (signs != signs[:, :1]).any():
        must = "leave the loop a solution at all times"
        got = "I ∓ D₁(t) D₂(t) is singular at some time"
        raise input_error("other", of, must, got, "Take the direct term out of one of the two, or change the gain.")
    if constant_value(matrix) is not None:
        return constant_matrix(_inverted(matrix, np.zeros(())), matrix.period)
    return FunctionMatrix(
        function=partial(_inverted, matrix), period=matrix.period, breaks=matrix.breaks, vectorised=True
    )


def _inverted(matrix: AbstractPeriodicMatrix, times: Floats) -> Floats:
    return np.linalg.inv(matrix.at(times)).astype(np.float64, copy=False)


def balanced_system(system: PeriodicSystem, prepared: Prepared, of: str) -> Matrices:
    """A, B, C and D in units of the states in which A is balanced."""
    _, B, C, D = with_inputs(system, of)
    to, back = np.diag(prepared.scale), np.diag(1.0 / prepared.scale)
    return back @ prepared.matrix @ to, back @ B, C @ to, D


def matrix_reach(prepared: Prepared, entry: AbstractPeriodicMatrix) -> Floats:
    """The speed at which a unit of each input moves the states, in their units (inputs,)."""
    size = np.abs(entry.at(probe_times(entry.period, _PROBES))).max(axis=0)
    return (size / prepared.scale[:, None]).max(axis=0)


def input_units(prepared: Prepared, reach: Floats) -> Floats:
    """Units of the inputs in which they move the states as quickly as these move each other, powers of two."""
    rate = prepared.size or 1.0 / prepared.matrix.period
    return np.where(reach > 0.0, 2.0 ** np.round(np.log2(rate / np.where(reach > 0.0, reach, rate))), 1.0)


def checked_system(system: PeriodicSystem, of: str, *, inputs: bool, argument: str = "system") -> None:
    """Refuse what is no periodic system, and one without inputs where they are needed."""
    if not isinstance(system, PeriodicSystem):
        got = f"is {type(system).__name__}"
        raise input_error(argument, of, "be a PeriodicSystem", got, "Of A(t) alone: `PeriodicSystem(A=...)`.")
    if inputs and system.B is None:
        raise input_error(argument, of, "have inputs", "has none", "Give it a `B`.")


def with_inputs(system: PeriodicSystem, of: str, argument: str = "system") -> Matrices:
    """A, B, C and D of a periodic system, refused where it has no inputs."""
    checked_system(system, of, inputs=True, argument=argument)
    assert system.B is not None
    assert system.D is not None
    return system.A, system.B, system.C, system.D
