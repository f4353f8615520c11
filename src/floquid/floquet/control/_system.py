"""Linear time-periodic systems with inputs and outputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias, final

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Floats
from floquid._checks import input_error
from floquid._show import Brief
from floquid.floquet.matrices import (
    AbstractPeriodicMatrix,
    Operand,
    Prepared,
    constant_matrix,
    constant_of,
    declared,
    multiples,
    named,
    operand,
    probe_times,
)

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


def _check_shape(matrix: Operand, argument: str, shape: tuple[int, int], words: str) -> None:
    if matrix.shape != shape:
        must = f"have shape {words} = {shape}"
        raise input_error(argument, "PeriodicSystem", must, f"has shape {matrix.shape}")


def _over_one_period(given: dict[str, Operand]) -> dict[str, AbstractPeriodicMatrix]:
    """All of them over the least common period of those that vary."""
    of = "PeriodicSystem"
    values = {name: constant_of(matrix) for name, matrix in given.items()}
    periodic = {name: matrix for name, matrix in given.items() if isinstance(matrix, AbstractPeriodicMatrix)}
    varying = {name: matrix for name, matrix in periodic.items() if values[name] is None}
    if varying:
        period, counts = multiples(tuple(matrix.period for matrix in varying.values()), of)
    else:
        some = [matrix.period for matrix in periodic.values()]
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
    if not isinstance(system, PeriodicSystem):
        got = f"is {type(system).__name__}"
        raise input_error("system", of, "be a PeriodicSystem", got, "Of A(t) alone: `PeriodicSystem(A=...)`.")
    if inputs and system.B is None:
        raise input_error("system", of, "have inputs", "has none", "Give it a `B`.")


def with_inputs(system: PeriodicSystem, of: str) -> Matrices:
    """A, B, C and D of a periodic system, refused where it has no inputs."""
    checked_system(system, of, inputs=True)
    assert system.B is not None
    assert system.D is not None
    return system.A, system.B, system.C, system.D
