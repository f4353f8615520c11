"""Transmission zeros of a periodic system."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from floquid._arrays import Complexes, Floats
from floquid._checks import input_error
from floquid.errors import InputError
from floquid.floquet.control._system import Matrices, PeriodicSystem, balanced_system, changes_sign, with_inputs
from floquid.floquet.matrices import (
    AbstractPeriodicMatrix,
    FunctionMatrix,
    after_jumps,
    constant_matrix,
    joint_breaks,
    real_series,
    stretches,
)
from floquid.floquet.monodromy_matrix import TOLERANCE, checked, factors, product_logarithms

_OF = "floquet.zeros"
_NONE = 1e-10  # of the size of its terms: a product below it is none
_SINGULAR = 1e-8  # reciprocal condition of the inputs' effect, rows at equal length, that counts as none


def zeros(system: PeriodicSystem, *, tolerance: float = TOLERANCE) -> Complexes:
    r"""The finite transmission zeros, as exponents on the principal branch (zeros,) [1/s]; they may be none.

    Of a `system` with as many inputs as outputs, λ is a zero if some input, and a state with it, pass without any
    output:

    .. math:: u(t) = \tilde u(t)\, e^{\lambda t}, \quad x(t) = \tilde x(t)\, e^{\lambda t} \quad\text{with periodic}
              \quad \tilde u, \tilde x, \qquad y(t) = 0

    Each output is differentiated until an input appears in it,

    .. math:: y_i^{(r_i)} = K_i(t)\, x + E_i(t)\, u, \qquad c_{i,0} = C_i, \quad
              c_{i,k+1} = \dot c_{i,k} + c_{i,k} A

    and the zeros are the exponents of :math:`A - B E^{-1} K` on the states for which all c_{i,k}(t) x are zero,
    k < r_i: n less the sum of the r_i. Where D(t) is invertible, no output is differentiated, and they are the n
    exponents of :math:`A - B D^{-1} C`. `tolerance` is as in `transition`.

    Bittanti and Colaneri 2009, Periodic Systems: Filtering and Control; the zero dynamics of Isidori 1995, Nonlinear
    Control Systems, 5.1. The outputs and their derivatives are projected out of every factor of a product that is not
    formed, so that no infinite zeros have to be told from finite ones.

    Raises InputError where the numbers of inputs and outputs differ; an output that has to be differentiated jumps; or
    E(t) is singular at some time, as where an output's first input fades within the period. Zeros may exist then: they
    are not found in this way.
    """
    with_inputs(system, _OF)
    if system.n_inputs != system.n_outputs:
        got = f"has {system.n_inputs} inputs and {system.n_outputs} outputs"
        remedy = "Leave out the surplus; zeros of a system that is not square are those of no square part of it."
        raise input_error("system", _OF, "have as many inputs as outputs", got, remedy)
    prepared = checked(system.A, None, (), tolerance, _OF)
    scaled = balanced_system(system, prepared, _OF)
    rows = [_differentiated(scaled, name, index) for index, name in enumerate(system.outputs)]
    held = [row for output in rows for row in output.held]
    closed = _closed(scaled, rows)
    if len(held) == system.n_states:
        return np.empty(0, dtype=np.complex128)
    # In the units of the open loop: in the closed one outputs and states come apart, up to rounding, which a balance
    # would blow up.
    both = prepared._replace(matrix=closed, smooth=False, scale=np.ones(system.n_states))
    found = factors(both, np.array([0.0, system.period]), tolerance, _OF)
    matrices = found.matrices
    if held:
        instants = np.append(found.left, 0.0)  # the end of the period is its beginning, to the last digit
        bases = _kernels(np.concatenate([after_jumps(row, instants) for row in held], axis=1))
        matrices = bases[1:].swapaxes(1, 2) @ matrices @ bases[:-1]
    return product_logarithms(matrices) / system.period


class _Output(NamedTuple):
    """One output, differentiated until an input appears in it."""

    held: list[AbstractPeriodicMatrix]  # c_0 ... c_{r-1} (1, n) each: what is zero while the output is
    K: AbstractPeriodicMatrix
    E: AbstractPeriodicMatrix


def _differentiated(scaled: Matrices, name: str, index: int) -> _Output:
    A, B, C, D = scaled
    pick = np.eye(C.shape[0])[index : index + 1]
    row, direct, held = pick @ C, pick @ D, []
    if not _is_none(direct, 0.0):
        return _Output([], row, direct)
    while len(held) < A.shape[0]:
        held.append(row)
        effect = row @ B
        after = _derivative(row, name) + row @ A
        if not _is_none(effect, _largest(row) * _largest(B)):
            return _Output(held, after, effect)
        row = after
    must = "let every output be reached by an input"
    raise input_error("system", _OF, must, f"its output {name!r} is reached by none", "Leave the output out.")


def _derivative(row: AbstractPeriodicMatrix, name: str) -> AbstractPeriodicMatrix:
    """The derivative in time of what varies smoothly."""
    values = row.at(stretches(row))
    if np.ptp(values.reshape(-1, values.shape[-1]), axis=0).max() <= _NONE * np.abs(values).max():
        return constant_matrix(np.zeros(row.shape), row.period)
    try:
        series = row.to_harmonics()
    except InputError:
        must = "let an output be differentiated until an input appears in it"
        got = f"its output {name!r} jumps, or a derivative of it does, before that"
        remedy = "Smooth the jumps of A(t) and C(t), or give the output a direct term."
        raise input_error("system", _OF, must, got, remedy) from None
    lines, fundamental = np.asarray(series.harmonics), 2.0 * np.pi / row.period
    return real_series(1j * fundamental * lines * np.asarray(series.coefficients), lines, row.period)


def _closed(scaled: Matrices, rows: list[_Output]) -> AbstractPeriodicMatrix:
    """A - B E⁻¹ K, with E invertible at all times."""
    A, B = scaled[:2]
    breaks = joint_breaks((A, B, *(row.E for row in rows), *(row.K for row in rows)), A.period)

    def effects(times: Floats) -> Floats:
        return np.concatenate([row.E.at(times) for row in rows], axis=-2)

    whole = FunctionMatrix(function=effects, period=A.period, breaks=breaks, vectorised=True)
    values = effects(stretches(whole))
    for axis in (-1, -2):  # the units of outputs and inputs do not matter
        lengths = np.linalg.norm(values, axis=axis, keepdims=True).max(axis=(0, 1))
        values = values / np.where(lengths > 0.0, lengths, 1.0)
    sizes = np.linalg.svd(values, compute_uv=False)
    if (sizes[..., -1] <= _SINGULAR).any() or changes_sign(values):
        raise input_error(
            "system",
            _OF,
            "have inputs whose first effects on the outputs are independent at all times",
            "their matrix E(t) is singular at some time",
            "Take other outputs or inputs; where the effect fades within the period zeros are not found in this way.",
        )

    def closed(times: Floats) -> Floats:
        wanted = np.concatenate([row.K.at(times) for row in rows], axis=-2)
        return A.at(times) - B.at(times) @ np.linalg.solve(effects(times), wanted)

    return FunctionMatrix(function=closed, period=A.period, breaks=breaks, vectorised=True)


def _kernels(rows: Floats) -> Floats:
    """An orthonormal basis of what every row makes zero (instants, n, n - rows)."""
    lengths = np.linalg.norm(rows, axis=2, keepdims=True)
    return np.linalg.svd(rows / lengths, full_matrices=True)[2][:, rows.shape[1] :].swapaxes(1, 2)


def _is_none(matrix: AbstractPeriodicMatrix, size: float) -> bool:
    return _largest(matrix) <= _NONE * size


def _largest(matrix: AbstractPeriodicMatrix) -> float:
    return float(np.abs(matrix.at(stretches(matrix))).max())
