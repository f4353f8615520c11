"""Time-invariant systems that stand for a discrete periodic one, to other packages and back."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias, final

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Complexes, Floats
from floquid._checks import Rebuilt, frozen_array, input_error, integer, positive, wrong_value
from floquid.floquet.control._discrete import DiscretePeriodicSystem, checked_phase
from floquid.io import load_package

if TYPE_CHECKING:
    import control
    import scipy.signal


Label: TypeAlias = tuple[int, str]  # the phase and the name of a lifted signal
RANK = 1e-10  # share of the largest singular value below which a state is rounding
_OF = "floquet.realise"


@final
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LiftedSystem(Rebuilt):
    r"""A time-invariant system with the responses of a periodic one; `lift` makes it.

    .. math:: x_{h+1} = A x_h + B u_h, \qquad y_h = C x_h + D u_h

    Parameters
    ----------
    A, B, C, D
        Its matrices.
    dt
        The step [s]: the period of the periodic system.
    n_phases
        Steps of the periodic system a period, P.
    first_phase
        The phase of the first sample.
    states, inputs, outputs
        Phase and name of each; all states are those at the first phase.
    """

    A: Floats
    B: Floats
    C: Floats
    D: Floats
    dt: float
    n_phases: int
    first_phase: int
    states: tuple[Label, ...]
    inputs: tuple[Label, ...]
    outputs: tuple[Label, ...]

    def __post_init__(self) -> None:
        n, m, p = len(self.states), len(self.inputs), len(self.outputs)
        self._freeze(A=(n, n), B=(n, m), C=(p, n), D=(p, m))

    def poles(self) -> Complexes:
        """The eigenvalues of A (states,), the largest first.

        They are the multipliers, small ones to a fraction of the largest alone: see
        `DiscretePeriodicSystem.multipliers`.
        """
        found = np.linalg.eigvals(self.A).astype(np.complex128)
        return found[np.argsort(-np.abs(found), kind="stable")]

    def stack(self, inputs: ArrayLike) -> Floats:
        """The inputs of the periodic system, from the first phase on, as this one takes them (lifted inputs, steps).

        They are u of the periodic system (inputs, samples), whole periods of it, or it is an InputError.
        """
        of, count = "LiftedSystem.stack", len(self.inputs) // self.n_phases
        given = frozen_array(inputs, "inputs", of, axes=(count, "samples"), remedy="Time is the last axis.")
        samples = given.shape[1]
        if samples % self.n_phases:
            got = f"hold {samples} samples"
            raise input_error("inputs", of, f"be whole periods of {self.n_phases} samples", got, "Append zeros.")
        return given.reshape(count, -1, self.n_phases).transpose(2, 0, 1).reshape(len(self.inputs), -1)

    def unstack(self, outputs: ArrayLike) -> Floats:
        """The outputs of the periodic system (outputs, samples), from this one's `outputs` (lifted outputs, steps)."""
        of = "LiftedSystem.unstack"
        given = frozen_array(outputs, "outputs", of, axes=(len(self.outputs), "steps"), remedy="Time is the last axis.")
        count = len(self.outputs) // self.n_phases
        return given.reshape(self.n_phases, count, -1).transpose(1, 2, 0).reshape(count, -1)

    def to_control(self) -> Any:
        """The system as `control.StateSpace`, every signal named "name[phase]", a full stop in it as a middle dot.

        Raises InputError where python-control is not installed.
        """
        # python-control keeps the full stop for itself.
        words: dict[str, Any] = {
            kind: [f"{name.replace('.', '·')}[{phase}]" for phase, name in getattr(self, kind)]
            for kind in ("states", "inputs", "outputs")
        }
        return load_package("control", "to_control").StateSpace(self.A, self.B, self.C, self.D, self.dt, **words)

    def to_scipy(self) -> scipy.signal.StateSpace:
        """The system as that of scipy, in steps of `dt`; it knows no names."""
        from scipy.signal import StateSpace

        return StateSpace(self.A, self.B, self.C, self.D, dt=self.dt)


def lift(system: DiscretePeriodicSystem, *, first_phase: int = 0) -> LiftedSystem:
    r"""A time-invariant system with the responses of a discrete periodic one, its signals labelled by phase and name.

    One step is a period, and the inputs and outputs of a period are stacked (Meyer and Burrus 1975): with
    :math:`\Phi_{i,j} = A_{i-1} \cdots A_j`, counted from the first phase,

    .. math:: x_{h+1} = \Phi_{P,0}\, x_h + [\Phi_{P,1} B_0, \ldots, B_{P-1}]\, u_h, \qquad
              (y_h)_i = C_i \Phi_{i,0}\, x_h + \sum_{j<i} C_i \Phi_{i,j+1} B_j\, (u_h)_j + D_i\, (u_h)_i

    Its poles are the multipliers.

    Bittanti and Colaneri 2009, Periodic Systems: Filtering and Control, chapter 6.

    `system` is the periodic system, and `first_phase` the phase with which a step begins, 0 to P - 1: the lifted state
    is the state at that phase. Raises InputError where the phase is not possible.
    """
    first = checked_phase(first_phase, system.n_phases, "floquet.lift")
    order = np.roll(np.arange(system.n_phases), -first)
    found = _in_time(*(stack[order] for stack in (system.A, system.B, system.C, system.D)))
    matrices: dict[str, Any] = dict(zip("ABCD", found, strict=True))
    phases = order.tolist()
    return LiftedSystem(
        **matrices,
        dt=system.period,
        n_phases=system.n_phases,
        first_phase=first,
        states=tuple((first, name) for name in system.states),
        inputs=tuple((phase, name) for phase in phases for name in system.inputs),
        outputs=tuple((phase, name) for phase in phases for name in system.outputs),
    )


def _in_time(A: Floats, B: Floats, C: Floats, D: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """The matrices of a step of one period, by what the state at each phase owes to the first state and the inputs."""
    n_phases, n_outputs, n_inputs = D.shape
    n = A.shape[1]
    owed = np.hstack([np.eye(n), np.zeros((n, n_phases * n_inputs))])
    outputs = np.zeros((n_phases, n_outputs, n + n_phases * n_inputs))
    for phase in range(n_phases):
        own = slice(n + phase * n_inputs, n + (phase + 1) * n_inputs)
        outputs[phase] = C[phase] @ owed
        outputs[phase, :, own] = D[phase]
        owed = A[phase] @ owed
        owed[:, own] = B[phase]
    seen = outputs.reshape(n_phases * n_outputs, -1)
    return owed[:, :n], owed[:, n:], seen[:, :n], seen[:, n:]


def realise(system: control.StateSpace, n_phases: int, *, first_phase: int = 0) -> DiscretePeriodicSystem:
    r"""The periodic system whose lifted form is a system of python-control.

    .. math:: \begin{bmatrix} y_k, \ldots, y_{P-1}, x_P \end{bmatrix}^T = O_k\, x_k, \qquad
              x_k = R_k \begin{bmatrix} x_0, u_0, \ldots, u_{k-1} \end{bmatrix}^T

    The state at each phase comes from factors of low rank. So its coordinates are those of `system` at the first phase
    and others between, as many as the neediest phase needs. All responses are the same: it is the inverse of
    `lift(...).to_control()` up to coordinates.

    `system` is one of discrete time whose step is the period, its inputs and outputs by phase, then by name; `n_phases`
    are the steps a period, P, and `first_phase`, 0 to P - 1, is the phase with which a step of it begins. Raises
    InputError where python-control is not installed, the system is of continuous time, or is not causal within a
    period.
    """
    if not isinstance(system, load_package("control", _OF).StateSpace):
        raise wrong_value("system", _OF, "be a control.StateSpace", system, "Use `control.ss`.")
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
    found: dict[str, Any] = {name: np.roll(stack, first, axis=0) for name, stack in zip("ABCD", stacks, strict=True)}
    return DiscretePeriodicSystem(
        **found,
        dt=positive(float(dt), "system", _OF, unit="s") / phases,
        inputs=_names(system.input_labels, n_inputs),
        outputs=_names(system.output_labels, n_outputs),
    )


def _factors(whole: Floats, phases: int, n_inputs: int, n_outputs: int, n_states: int) -> tuple[Floats, ...]:
    """A_k, B_k, C_k and D_k, from the matrix that gives (y_0, ..., y_P-1, x_P) by (x_0, u_0, ..., u_P-1)."""
    # The state at phase k is what all that comes later, rows from y_k on, owes to all before it, columns up to u_k-1: a
    # factor of that block.
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


def _check_causal(D: Floats, phases: int) -> None:
    blocks = np.abs(D.reshape(phases, D.shape[0] // phases, phases, D.shape[1] // phases)).max(axis=(1, 3), initial=0.0)
    ahead = np.triu(blocks, 1)
    if (ahead > RANK * blocks.max(initial=0.0)).any():
        phase, later = (int(index) for index in np.argwhere(ahead == ahead.max())[0])
        must = "be causal within a period: D zero above its diagonal of blocks"
        remedy = "Signals are by phase, then by name, as `lift(...).to_control()` has them; take them in that order."
        raise input_error("system", _OF, must, f"answers at phase {phase} to an input at phase {later}", remedy)


def _names(labels: Any, count: int) -> tuple[str, ...] | None:
    """The names in labels such as `y1[0]`, where all phases have the same ones."""
    found = [re.fullmatch(r"(.*)\[(\d+)\]", str(label)) for label in labels]
    names = [match[1] if match else "" for match in found]
    first = tuple(names[:count])
    alike = all(names[k] and names[k] == first[k % count] for k in range(len(names)))
    return first if count and alike and len(set(first)) == count else None
