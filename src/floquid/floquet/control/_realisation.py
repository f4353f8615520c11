"""From a system lifted in time back to the discrete periodic one."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from floquid._checks import describe, input_error, integer, positive
from floquid.floquet.control._discrete import DiscretePeriodicSystem, checked_phase
from floquid.io import load_package

if TYPE_CHECKING:
    from control import StateSpace

RANK = 1e-10  # share of the largest singular value below which a state is rounding
_OF = "floquet.realise"


def realise(system: StateSpace, n_phases: int, *, first_phase: int = 0) -> DiscretePeriodicSystem:
    r"""The periodic system whose lifted form by "time" is a system of python-control.

    .. math:: \begin{bmatrix} y_k, \ldots, y_{P-1}, x_P \end{bmatrix}^T = O_k\, x_k, \qquad
              x_k = R_k \begin{bmatrix} x_0, u_0, \ldots, u_{k-1} \end{bmatrix}^T

    The state at each phase is had by factors of low rank, so its coordinates are those of `system` at the first
    phase and others between, as many as the phase needs that needs most. All responses are the same: it is the
    inverse of `lift(...).to_control()` but for coordinates.

    Parameters
    ----------
    system
        A discrete-time system whose step is the period, its inputs and outputs by phase, then by name.
    n_phases
        Steps a period, P.
    first_phase
        The phase with which a step of `system` begins, 0 to P - 1.

    Raises
    ------
    InputError
        python-control is not installed, the system is of continuous time, or is not causal within a period.
    """
    if not isinstance(system, load_package("control", _OF).StateSpace):
        raise input_error("system", _OF, "be a control.StateSpace", f"is {describe(system)}", "Use `control.ss`.")
    phases = integer(n_phases, "n_phases", _OF, at_least=1)
    first = checked_phase(first_phase, phases, _OF)
    A, B, C, D = (np.asarray(matrix, np.float64) for matrix in (system.A, system.B, system.C, system.D))
    if not len(A) or len(C) % phases or B.shape[1] % phases:
        got = f"has {len(A)} states, {B.shape[1]} inputs and {len(C)} outputs for {phases} phases"
        raise input_error("system", _OF, "have states, and as many inputs and outputs at each phase", got)
    dt = system.dt
    if dt is None or isinstance(dt, bool) or dt == 0:
        remedy = "Its step is the period: `control.ss(A, B, C, D, period)`."
        raise input_error("system", _OF, "be of discrete time, in steps of the period [s]", f"has dt={dt}", remedy)
    n_inputs, n_outputs = B.shape[1] // phases, len(C) // phases
    _check_causal(D, phases)
    stacks = _factors(np.block([[C, D], [A, B]]), phases, n_inputs, n_outputs, len(A))
    found = [np.roll(stack, first, axis=0) for stack in stacks]
    return DiscretePeriodicSystem(
        A=found[0],
        B=found[1],
        C=found[2],
        D=found[3],
        dt=positive(float(dt), "system", _OF, unit="s") / phases,
        inputs=_names(system.input_labels, n_inputs),
        outputs=_names(system.output_labels, n_outputs),
    )


def _factors(
    whole: NDArray[np.float64], phases: int, n_inputs: int, n_outputs: int, n_states: int
) -> tuple[NDArray[np.float64], ...]:
    """A_k, B_k, C_k and D_k, from the matrix that gives (y_0, ..., y_P-1, x_P) by (x_0, u_0, ..., u_P-1).

    The state at phase k is what all that comes later, rows from y_k on, owes to all before it, columns up to u_k-1: a
    factor of that block.
    """
    factors = [whole[:, :n_states]]
    for phase in range(1, phases):
        block = whole[phase * n_outputs :, : n_states + phase * n_inputs]
        left, size, _ = np.linalg.svd(block, full_matrices=False)
        rank = int(np.sum(size > RANK * size.max(initial=0.0)))
        factors.append(left[:, :rank] * np.sqrt(size[:rank]))
    factors.append(np.eye(n_states))
    n = max(factor.shape[1] for factor in factors)
    A, B = np.zeros((phases, n, n)), np.zeros((phases, n, n_inputs))
    C, D = np.zeros((phases, n_outputs, n)), np.zeros((phases, n_outputs, n_inputs))
    for phase in range(phases):
        own, following = factors[phase], factors[phase + 1]
        columns = slice(n_states + phase * n_inputs, n_states + (phase + 1) * n_inputs)
        rows = slice(phase * n_outputs, (phase + 1) * n_outputs)
        back = np.linalg.pinv(following)
        A[phase, : following.shape[1], : own.shape[1]] = back @ own[n_outputs:]
        B[phase, : following.shape[1]] = back @ whole[rows.stop :, columns]
        C[phase, :, : own.shape[1]] = own[:n_outputs]
        D[phase] = whole[rows, columns]
    return A, B, C, D


def _check_causal(D: NDArray[np.float64], phases: int) -> None:
    blocks = np.abs(D.reshape(phases, D.shape[0] // phases, phases, D.shape[1] // phases)).max(axis=(1, 3), initial=0.0)
    ahead = np.triu(blocks, 1)
    if (ahead > RANK * blocks.max(initial=0.0)).any():
        phase, later = (int(index) for index in np.argwhere(ahead == ahead.max())[0])
        raise input_error(
            "system",
            _OF,
            "be causal within a period: D zero above its diagonal of blocks",
            f"answers at phase {phase} to an input at phase {later}",
            "Signals are by phase, then by name, as `lift(...).to_control()` has them; take them in that order.",
        )


def _names(labels: Any, count: int) -> tuple[str, ...] | None:
    """The names in labels such as `y1[0]`, where all phases have the same ones."""
    found = [re.fullmatch(r"(.*)\[(\d+)\]", str(label)) for label in labels]
    names = [match[1] if match else "" for match in found]
    first = tuple(names[:count])
    alike = all(names[k] and names[k] == first[k % count] for k in range(len(names)))
    return first if count and alike and len(set(first)) == count else None
