"""Discrete linear periodic systems, and those that a continuous one becomes under a held input."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from floquid._checks import Rebuilt, frozen_array, input_error, integer, positive
from floquid.floquet import _product
from floquid.floquet._arithmetic import assembled
from floquid.floquet._conversion import after_jumps
from floquid.floquet._exponents import principal_order
from floquid.floquet._matrices import AbstractPeriodicMatrix
from floquid.floquet._system import PeriodicSystem, named
from floquid.floquet._system_matrix import Prepared
from floquid.floquet._transition import TOLERANCE, checked, factors

if TYPE_CHECKING:
    from control import StateSpace

    from floquid.floquet._lifted_system import LiftedSystem


@final
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DiscretePeriodicSystem(Rebuilt):
    r"""A linear periodic system in steps of time, P of them a period.

    .. math:: x_{k+1} = A_k x_k + B_k u_k, \qquad y_k = C_k x_k + D_k u_k, \qquad A_{k+P} = A_k, \ldots

    Parameters
    ----------
    A
        A_k for k = 0..P-1 (phases, n, n).
    dt
        The step [s]; the period is P of them.
    B
        B_k (phases, n, inputs); by default there are no inputs.
    C
        C_k (phases, outputs, n); by default the outputs are the states.
    D
        D_k (phases, outputs, inputs); by default zero.
    states, inputs, outputs
        Their names; by default x1, x2, ..., u1, u2, ... and y1, y2, ....

    Raises
    ------
    InputError
        Shapes do not agree, or names are not distinct.
    """

    A: NDArray[np.float64]
    B: NDArray[np.float64]
    C: NDArray[np.float64]
    D: NDArray[np.float64]
    dt: float
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    def __init__(
        self,
        *,
        A: ArrayLike,
        dt: float,
        B: ArrayLike | None = None,
        C: ArrayLike | None = None,
        D: ArrayLike | None = None,
        states: Sequence[str] | None = None,
        inputs: Sequence[str] | None = None,
        outputs: Sequence[str] | None = None,
    ) -> None:
        of = "DiscretePeriodicSystem"
        remedy = "Phases are the first axis; a constant matrix is repeated along it by `np.broadcast_to`."
        system = frozen_array(A, "A", of, axes=("phases", "n", "n"), remedy=remedy)
        n_phases, n, columns = system.shape
        if not system.size or n != columns:
            raise input_error("A", of, "be square (phases, n, n)", f"has shape {system.shape}", remedy)
        given = np.zeros((n_phases, n, 0)) if B is None else B
        entry = frozen_array(given, "B", of, axes=(n_phases, n, "inputs"), remedy=remedy)
        given = np.broadcast_to(np.eye(n), system.shape) if C is None else C
        exit_ = frozen_array(given, "C", of, axes=(n_phases, "outputs", n), remedy=remedy)
        given = np.zeros((n_phases, exit_.shape[1], entry.shape[2])) if D is None else D
        direct = frozen_array(given, "D", of, axes=(n_phases, exit_.shape[1], entry.shape[2]), remedy=remedy)
        put = object.__setattr__
        for name, value in zip("ABCD", (system, entry, exit_, direct), strict=True):
            put(self, name, value)
        put(self, "dt", positive(dt, "dt", of, unit="s"))
        put(self, "states", named(states, n, "x", "states", of))
        put(self, "inputs", named(inputs, self.n_inputs, "u", "inputs", of))
        put(self, "outputs", named(outputs, self.n_outputs, "y", "outputs", of))

    @classmethod
    def from_control(cls, system: StateSpace, n_phases: int, *, first_phase: int = 0) -> DiscretePeriodicSystem:
        r"""The periodic system whose lifted form by "time" is a system of python-control.

        .. math:: \begin{bmatrix} y_k, \ldots, y_{P-1}, x_P \end{bmatrix}^T = O_k\, x_k, \qquad
                  x_k = R_k \begin{bmatrix} x_0, u_0, \ldots, u_{k-1} \end{bmatrix}^T

        The state at each phase is had by factors of low rank, so its coordinates are those of `system` at the first
        phase and others between. All responses are the same: it is the inverse of `lifted().to_control()` but for
        coordinates.

        Parameters
        ----------
        system
            A discrete-time system whose step is the period, its inputs and outputs by phase, then by name.
        n_phases
            Steps a period, P.
        first_phase
            The phase with which a step of `system` begins, 0 to P - 1.

        Returns
        -------
        DiscretePeriodicSystem
            The periodic system; as many states as are needed at the phase that needs most.

        Raises
        ------
        InputError
            python-control is not installed, the system is of continuous time, or is not causal within a period.
        """
        from floquid.floquet._realisation import realise

        return realise(system, n_phases, first_phase)

    @property
    def n_phases(self) -> int:
        """The number of steps a period, P."""
        return self.A.shape[0]

    @property
    def period(self) -> float:
        """The period [s]."""
        return self.n_phases * self.dt

    @property
    def n_states(self) -> int:
        """The number of states, n."""
        return self.A.shape[1]

    @property
    def n_inputs(self) -> int:
        """The number of inputs."""
        return self.B.shape[2]

    @property
    def n_outputs(self) -> int:
        """The number of outputs."""
        return self.C.shape[1]

    def multipliers(self) -> NDArray[np.complex128]:
        r"""The eigenvalues of the product of a period, which is not formed.

        .. math:: \mu_r = \mathrm{eig}\,(A_{P-1} \cdots A_1 A_0)

        Returns
        -------
        NDArray[np.complex128]
            The multipliers (n,), by the size of their angle, then by falling magnitude; the same at every phase.
        """
        logs = self._logarithms()
        size = np.exp(logs.real)
        turned = np.where(logs.imag == 0.0, size, -size)
        return np.where(np.isin(logs.imag, (0.0, np.pi)), turned, size * np.exp(1j * logs.imag))

    def exponents(self) -> NDArray[np.complex128]:
        r"""The Floquet exponents on the principal branch.

        .. math:: \lambda_r = \frac{\ln \mu_r}{P\,\Delta t}

        Returns
        -------
        NDArray[np.complex128]
            The exponents (n,) [1/s], in the order of `multipliers`; the real part of a multiplier of zero is -inf.
        """
        logs = self._logarithms()
        out = np.empty(logs.shape, dtype=np.complex128)
        out.real, out.imag = logs.real / self.period, logs.imag / self.period
        return out

    def simulate(
        self, inputs: ArrayLike, *, initial: ArrayLike | None = None, first_phase: int = 0
    ) -> NDArray[np.float64]:
        """The response to a sequence of inputs.

        Parameters
        ----------
        inputs
            u (inputs, samples); of a system without inputs `np.empty((0, samples))`.
        initial
            The state at the first sample (n,); zero by default.
        first_phase
            The phase k of the first sample, 0 to P - 1.

        Returns
        -------
        NDArray[np.float64]
            y (outputs, samples).

        Raises
        ------
        InputError
            A shape or the phase is not possible.
        """
        of = "DiscretePeriodicSystem.simulate"
        given = frozen_array(inputs, "inputs", of, axes=(self.n_inputs, "samples"), remedy="Time is the last axis.")
        start = np.zeros(self.n_states) if initial is None else initial
        state = frozen_array(start, "initial", of, axes=(self.n_states,))
        phases = (checked_phase(first_phase, self.n_phases, of) + np.arange(given.shape[1])) % self.n_phases
        driven = np.einsum("kij,jk->ki", self.B[phases], given)
        states = np.empty((len(phases), self.n_states))
        for sample, phase in enumerate(phases.tolist()):
            states[sample] = state
            state = self.A[phase] @ state + driven[sample]
        outputs = np.einsum("kij,kj->ik", self.C[phases], states)
        return outputs + np.einsum("kij,jk->ik", self.D[phases], given)

    def lifted(self, form: Literal["time", "cyclic"] = "time", *, first_phase: int = 0) -> LiftedSystem:
        r"""A time-invariant system with the same responses.

        By "time", one step is a period, and the inputs and outputs of a period are stacked: with
        :math:`\Phi_{i,j} = A_{i-1} \cdots A_j`, counted from the first phase,

        .. math:: x_{h+1} = \Phi_{P,0}\, x_h + [\Phi_{P,1} B_0, \ldots, B_{P-1}]\, u_h, \qquad
                  (y_h)_i = C_i \Phi_{i,0}\, x_h + \sum_{j<i} C_i \Phi_{i,j+1} B_j\, (u_h)_j + D_i\, (u_h)_i

        Its poles are the multipliers. By "cyclic", a step stays a step, and every signal has P copies, of which the
        one of the present phase holds the signal and the others are zero. Its poles are all P-th roots of the
        multipliers, and small multipliers are not lost in a product.

        Parameters
        ----------
        form
            "time" (Meyer and Burrus 1975) or "cyclic" (Flamm 1991).
        first_phase
            The phase with which a step begins, 0 to P - 1: the lifted state is the state at that phase.

        Returns
        -------
        LiftedSystem
            The system, its states, inputs and outputs labelled by phase and name.

        Raises
        ------
        InputError
            The form is unknown, or the phase is not possible.

        Notes
        -----
        Bittanti and Colaneri 2009, Periodic Systems: Filtering and Control, chapter 6.
        """
        from floquid.floquet._lifted_system import lift

        return lift(self, form, first_phase)

    def _logarithms(self) -> NDArray[np.complex128]:
        logs = _product.logarithms(_product.schur(self.A))
        return logs[principal_order(logs)]


def discretise(system: PeriodicSystem, n_phases: int, *, tolerance: float = TOLERANCE) -> DiscretePeriodicSystem:
    r"""The discrete system of a continuous one whose input is held constant within each step.

    .. math:: A_k = \Phi(t_{k+1}, t_k), \qquad B_k = \int_{t_k}^{t_{k+1}} \Phi(t_{k+1}, s)\, B(s)\, ds, \qquad
              t_k = kT/P

    Both at once, as the transition matrix of the states and the held inputs. C_k and D_k are the values at t_k, after
    it where they jump: the outputs are those at the beginning of each step.

    Parameters
    ----------
    system
        The continuous system.
    n_phases
        Steps a period, P.
    tolerance
        The relative error that is aimed at, from 1e-14 to 1e-3.

    Returns
    -------
    DiscretePeriodicSystem
        The discrete system, with the same names.

    Raises
    ------
    InputError
        There is no step, or the system cannot be integrated.
    """
    of = "floquet.discretise"
    if not isinstance(system, PeriodicSystem):
        got = f"is {type(system).__name__}"
        raise input_error("system", of, "be a PeriodicSystem", got, "Of A(t) alone: `PeriodicSystem(A=...)`.")
    count = integer(n_phases, "n_phases", of, at_least=1)
    n, units = system.n_states, np.empty(0)
    prepared = checked(system.A, None, (), tolerance, of)
    if system.B is not None:
        prepared, units = _with_held_inputs(prepared, system.A, system.B, tolerance, of)
    instants = system.period * np.arange(count + 1) / count
    found = factors(prepared, instants, tolerance, of)
    phi = np.broadcast_to(np.eye(n + len(units)), (count, n + len(units), n + len(units))).copy()
    for owner, factor in zip(found.owner, found.matrices, strict=True):
        phi[owner] = factor @ phi[owner]
    return DiscretePeriodicSystem(
        A=phi[:, :n, :n],
        B=phi[:, :n, n:] / units,
        C=after_jumps(system.C, instants[:-1]),
        D=None if system.D is None else after_jumps(system.D, instants[:-1]),
        dt=system.period / count,
        states=system.states,
        inputs=system.inputs,
        outputs=system.outputs,
    )


def checked_phase(first_phase: int, n_phases: int, of: str) -> int:
    """A phase of 0 to P - 1."""
    phase = integer(first_phase, "first_phase", of, at_least=0)
    if phase >= n_phases:
        raise input_error("first_phase", of, f"be below the number of phases, {n_phases}", f"is {phase}")
    return phase


def _with_held_inputs(
    prepared: Prepared, A: AbstractPeriodicMatrix, B: AbstractPeriodicMatrix, tolerance: float, of: str
) -> tuple[Prepared, NDArray[np.float64]]:
    """The states and inputs together, ready to be integrated, and the units that the inputs are given (inputs,).

    The units make the inputs move the states as quickly as these move each other, so that neither a step's error nor
    its rounding depends on the units that the inputs came in.
    """
    probes = B.period * (np.arange(64) + 0.381966) / 64
    reach = (np.abs(B.at(probes)).max(axis=0) / prepared.scale[:, None]).max(axis=0)
    rate = prepared.size or 1.0 / B.period
    units = np.where(reach > 0.0, 2.0 ** np.round(np.log2(rate / np.where(reach > 0.0, reach, rate))), 1.0)
    n, m = B.shape
    both = assembled([[A, B @ np.diag(units)], [np.zeros((m, n)), np.zeros((m, m))]], A.period)
    return checked(both, None, (), tolerance, of), units
