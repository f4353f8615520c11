"""The state transition matrix and the state matrix over one period."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from floquid._arrays import Complexes, Floats
from floquid._checks import Rebuilt, frozen_array
from floquid._show import Drawings, Drawn
from floquid.core import Provenance
from floquid.findings import Finding, texts
from floquid.reconstruction._structure import AbstractStructure


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StateModel(Drawn, Rebuilt):
    r"""Φ(t, t0) and A(t) at instants of one period, with t0 the first of them.

    .. math:: x(t) = \Phi(t, t_0)\, x(t_0), \qquad \dot x = A(t)\, x \;[+\; B(t)\, u], \qquad
              [y = C(t)\, x + D(t)\, u]

    Parameters
    ----------
    times
        Instants after phase zero (times,) [s].
    transition, system
        Φ (times, n, n), and A (times, n, n) [1/s, in the units of the states].
    condition
        The condition number of the equilibrated modal matrix Ψ at each instant (times,): the factor by which errors
        of the shapes may grow in A.
    states, coordinates
        The names of the states, displacements first, then velocities; and what they are, in words.
    system_std, transition_std
        Standard deviations of A and Φ (times, n, n); None where not estimated.
    provenance
        Where the model comes from.
    inputs, outputs, direct
        B (times, n, inputs), C (times, channels, n) and D (times, channels, inputs) of a model with measured inputs;
        None of one of free responses.
    inputs_std
        Standard deviations of B; None where not estimated.
    """

    times: Floats
    transition: Floats
    system: Floats
    condition: Floats
    states: tuple[str, ...]
    coordinates: str = ""
    system_std: Floats | None = None
    transition_std: Floats | None = None
    provenance: Provenance = field(default_factory=Provenance)
    inputs: Floats | None = None
    outputs: Floats | None = None
    direct: Floats | None = None
    inputs_std: Floats | None = None

    def _figures(self) -> Drawings:
        return {"system_elements": (self, {})}

    def without_deviations(self) -> StateModel:
        """Drop all deviations: a model that leaves more than noise has none to quote."""
        return replace(self, system_std=None, transition_std=None, inputs_std=None)

    def __post_init__(self) -> None:
        of, put = "StateModel", object.__setattr__
        n = len(self.states)
        put(self, "times", frozen_array(self.times, "times", of, axes=("times",)))
        steps = len(self.times)
        for name in ("transition", "system"):
            put(self, name, frozen_array(getattr(self, name), name, of, axes=(steps, n, n)))
        put(self, "condition", frozen_array(self.condition, "condition", of, axes=(steps,)))
        for name in ("system_std", "transition_std"):
            if getattr(self, name) is not None:
                put(self, name, frozen_array(getattr(self, name), name, of, axes=(steps, n, n)))
        b = (n, "inputs")
        for name, axes in (
            ("inputs", b),
            ("inputs_std", b),
            ("outputs", ("channels", n)),
            ("direct", ("channels", "inputs")),
        ):
            if getattr(self, name) is not None:
                put(self, name, frozen_array(getattr(self, name), name, of, axes=(steps, *axes)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Refinement(Rebuilt):
    """A state matrix of given structure, fitted to all that a record says.

    Parameters
    ----------
    state, structure
        Φ and A(t) with their deviations, and the structure of A(t).
    parameters, names, covariance
        The parameters of the structure in the units of its blocks, what each is, as stiffness[0,1] cos 2 (parameters,),
        and their covariance (parameters, parameters). Of a structure that was found, all deviations count what the next
        wider ones could hide.
    exponents, exponent_std
        The Floquet exponents of A(t), as the response model lists them, and their deviations (modes,) [1/s].
    chi_square, degrees, p_value
        What is left between the structure and the free model, its degrees of freedom, and the probability of as much or
        more under the right structure.
    findings
        How the structure was found, and the test of each next wider one; empty where it was given.
    """

    state: StateModel
    structure: AbstractStructure
    parameters: Floats
    names: tuple[str, ...]
    covariance: Floats
    exponents: Complexes
    exponent_std: Complexes
    chi_square: float
    degrees: int
    p_value: float
    findings: tuple[Finding, ...] = ()

    def __post_init__(self) -> None:
        of, n = "Refinement", len(self.names)
        for name, axes, dtype in (
            ("parameters", (n,), np.float64),
            ("covariance", (n, n), np.float64),
            ("exponents", ("modes",), np.complex128),
            ("exponent_std", (len(self.exponents),), np.complex128),
        ):
            object.__setattr__(self, name, frozen_array(getattr(self, name), name, of, axes=axes, dtype=dtype))

    @property
    def reasons(self) -> tuple[str, ...]:
        """Steps by which the structure was found, and tests of the next wider ones, a sentence each."""
        return texts(self.findings)

    @property
    def conditional_on(self) -> tuple[str, ...]:
        """Words for what is taken for granted: the structure given, or the absence of what the data do not tell."""
        if not any(own.code in ("structure_tested", "structure_conditional") for own in self.findings):
            return (self.structure.words(),)
        return tuple(f"no {own.numbers['name']}" for own in self.findings if own.code == "structure_conditional")

    @property
    def std(self) -> Floats:
        """The deviations of the parameters (parameters,)."""
        return np.sqrt(np.diag(self.covariance))
