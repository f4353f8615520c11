"""Discrete linear periodic systems, and those that a continuous one becomes under a held input."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Complexes, Floats
from floquid._checks import Rebuilt, frozen_array, input_error, integer, positive
from floquid.floquet.control._system import PeriodicSystem, checked_system, input_units, matrix_reach
from floquid.floquet.matrices import after_jumps, assembled, named
from floquid.floquet.monodromy_matrix import (
    TOLERANCE,
    checked,
    factors,
    multipliers_of,
    product_logarithms,
    product_shapes,
)


@final
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DiscretePeriodicSystem(Rebuilt):
    r"""A linear periodic system in steps of time, P of them a period.

    .. math:: x_{k+1} = A_k x_k + B_k u_k, \qquad y_k = C_k x_k + D_k u_k, \qquad A_{k+P} = A_k, \ldots

    Raises InputError where shapes do not agree, or names are not distinct.

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
    """

    A: Floats
    B: Floats
    C: Floats
    D: Floats
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

    def multipliers(self) -> Complexes:
        r"""The eigenvalues of the product of a period (n,), which is not formed; the same at every phase.

        .. math:: \mu_r = \mathrm{eig}\,(A_{P-1} \cdots A_1 A_0)

        By the size of their angle, then by falling magnitude.
        """
        return multipliers_of(product_logarithms(self.A))

    def exponents(self) -> Complexes:
        r"""The Floquet exponents on the principal branch (n,) [1/s], in the order of `multipliers`.

        .. math:: \lambda_r = \frac{\ln \mu_r}{P\,\Delta t}

        The real part of a multiplier of zero is -inf.
        """
        logs = product_logarithms(self.A)
        return np.asarray(logs.real / self.period + 1j * (logs.imag / self.period), dtype=np.complex128)

    def modes(self) -> tuple[Complexes, Complexes]:
        r"""The exponents as `exponents` has them (n,) [1/s], and the periodic shapes of the states (phases, n, modes).

        .. math:: A_k\, p_{r,k} = e^{\lambda_r \Delta t}\, p_{r,k+1}, \qquad p_{r,P} = p_{r,0}

        Shapes of a multiplier of zero, and of one that is repeated with fewer eigenvectors, are no basis.
        """
        logs, shapes = product_shapes(self.A)
        return np.asarray(logs.real / self.period + 1j * (logs.imag / self.period), np.complex128), shapes


def discretise(system: PeriodicSystem, n_phases: int, *, tolerance: float = TOLERANCE) -> DiscretePeriodicSystem:
    r"""The discrete system of a continuous `system` whose input is held constant within each step.

    .. math:: A_k = \Phi(t_{k+1}, t_k), \qquad B_k = \int_{t_k}^{t_{k+1}} \Phi(t_{k+1}, s)\, B(s)\, ds, \qquad
              t_k = kT/P

    There are `n_phases` steps a period, P. Both at once, as the transition matrix of the states and the held inputs, to
    a relative error `tolerance`, from 1e-14 to 1e-3. C_k and D_k are the values at t_k, after it where they jump: the
    outputs are those at the beginning of each step.

    Raises InputError where there is no step, or the system cannot be integrated.
    """
    of = "floquet.discretise"
    checked_system(system, of, inputs=False)
    count = integer(n_phases, "n_phases", of, at_least=1)
    n, units = system.n_states, np.empty(0)
    prepared = checked(system.A, None, (), tolerance, of)
    if system.B is not None:
        # Held inputs are states that do not move, in units in which they move the others as quickly as these move each
        # other: neither a step's error nor its rounding depends on the units that they came in.
        units = input_units(prepared, matrix_reach(prepared, system.B))
        m = len(units)
        both = assembled([[system.A, system.B @ np.diag(units)], [np.zeros((m, n)), np.zeros((m, m))]], system.period)
        prepared = checked(both, None, (), tolerance, of)
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
