"""Φ(t, t0) and A(t) from a model of the response (Allen 2009, eqs. 13-21 as corrected), and their types."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Complexes, Floats, Mask
from floquid._checks import Rebuilt, frozen_array, input_error, integer, wrong_value
from floquid._show import Drawings, Drawn
from floquid.core import MOST_TIMES, Form, PeriodicModel, Provenance
from floquid.findings import Finding, texts
from floquid.reconstruction._bands import chosen, sizes_left_out, spread_of
from floquid.reconstruction._coordinates import Coordinates
from floquid.reconstruction._modal_matrix import (
    Modal,
    Shapes,
    Terms,
    at_once,
    at_terms,
    by_inputs,
    by_system,
    by_transition,
    modal_at,
    shapes_of,
    terms_of,
)
from floquid.reconstruction._states import Names, delayed, first_order, second_order
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
        self._freeze(times=("times",))
        steps, n = len(self.times), len(self.states)
        square, entry = (steps, n, n), (steps, n, "inputs")
        self._freeze(transition=square, system=square, condition=(steps,), system_std=square, transition_std=square)
        self._freeze(inputs=entry, inputs_std=entry, outputs=(steps, "channels", n))
        self._freeze(direct=(steps, "channels", "inputs"))


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
        n, modes = len(self.names), len(self.exponents)
        self._freeze(parameters=(n,), covariance=(n, n))
        self._freeze(dtype=np.complex128, exponents=("modes",), exponent_std=(modes,))

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


def reconstruct(
    model: PeriodicModel,
    states: Names,
    *,
    form: Form = "second-order",
    delay: float | None = None,
    harmonics: Literal["auto", "model"] | int = "auto",
    times: ArrayLike | int = 50,
) -> StateModel:
    r"""The state transition matrix and the state matrix in the coordinates of chosen channels.

    With s = λ_r + imω, and w_i(s) what the channels count in state i,

    .. math:: \psi_{i,r}(t) = \sum_m w_i(s) \cdot B_{r,m}\, e^{i m \omega t}

    and

    .. math:: \Phi(t, t_0) = \Psi(t)\, e^{\Lambda (t - t_0)}\, \Psi(t_0)^{-1}, \qquad
              A(t) = (\dot\Psi + \Psi\Lambda)\, \Psi^{-1}

    (Allen 2009, eqs. 13-21; the factor s belongs to the velocity half alone, and the Vandermonde matrix of eqs. 16-19
    cancels: L(t0) = Ψ(t0)⁻¹ exactly.) Several hits give one shape a mode, up to a factor that cancels too. Standard
    deviations are those of the estimates, to first order. They include the harmonics beyond each band, by what the
    record says of these and of how the shape falls (decision 0028).

    With measured inputs, of a model that has them, also

    .. math:: B(t) = \Psi(t)\, b(t), \qquad C(t) = c(t)\, \Psi(t)^{-1}, \qquad D(t)

    in all channels; B with deviations.

    Raises InputError where a channel is unknown, is not a motion, or the channels chosen cannot span the modes; or an
    option is not possible; IdentificationError where the shapes of the modes in the chosen channels are linearly
    dependent.

    Parameters
    ----------
    model
        The identified response model.
    states
        In second-order form the channels taken as displacements (E in eq. 13), half as many as there are modes; w is 1
        and s, over s for a velocity channel and over s² for an acceleration channel. Several channels of one motion,
        ["x", "vx", "ax"] or "x+vx+ax", are averaged at each rate by their noise. With weights, "0.5*x+y", it
        is a sum: a row of any constant E of full rank. "all" takes all channels: each state is the sum of them that is
        least noisy. In first-order form as many channels as there are modes, or such sums; delayed,
        at least one.
    form
        "second-order": displacements, then their velocities. "first-order": the channels as they are. "delayed": the
        channels and the same channels later, where they are too few to span the states (section 2.3): the exponents are
        the same, Φ and A are those of these coordinates.
    delay
        Of "delayed" [s]; None takes the one with the best condition.
    harmonics
        "auto": those that make the error of A(t) least, of all that the model's estimates hold; "model": the model's
        coefficients as they are, also where they were cut by hand; or -harmonics … harmonics of each mode, as far as
        the estimates go. Without estimates, those of the model.
    times
        Instants after phase zero [s], or how many equally spaced ones over a period, 10,000 at most.
    """
    instants = instants_of(times, model.period, "reconstruct")
    coordinates = coordinates_of(model, states, form, delay)
    shapes, terms, kept = _built_from(model, coordinates, harmonics)
    modal = modal_at(shapes, instants, coordinates.said)
    growth = np.exp(np.multiply.outer(instants - instants[0], model.exponents))
    transition = (modal.modal * growth[:, None, :]) @ modal.inverse[0]
    values = {
        "transition": transition.real,
        "system": modal.system.real,
        **_input_output(model, shapes, modal, instants),
    }
    std: dict[str, Floats] = {}
    if terms is not None:
        own, loose = terms.estimates, None if coordinates.loose is None else at_terms(coordinates.loose, model, terms)
        sizes, wider, beyond = _left_out(model, coordinates, terms, kept)
        slopes_of = {"system": by_system, "transition": by_transition}
        if "inputs" in values and own.gains is not None:
            slopes_of["inputs"] = by_inputs
        std = {f"{name}_std": np.zeros(values[name].shape) for name in slopes_of}
        for t in at_once(wider, instants, beyond):
            for name, made in slopes_of.items():
                slopes = made(shapes, modal, instants, t, terms)
                if loose is not None:
                    slopes = slopes.loosened(values[name][t], loose)
                hidden = spread_of(sizes, made(wider, modal, instants, t, beyond), beyond.estimates)
                std[f"{name}_std"][t] = np.sqrt(slopes.variance(own) + hidden)
        if coordinates.form == "second-order":  # displacements change at their velocities
            std["system_std"][:, : len(coordinates.states) // 2] = 0.0
    return StateModel(
        times=instants,
        condition=modal.condition,
        states=coordinates.names,
        coordinates=coordinates.words,
        provenance=model.provenance.then(f"state matrix in {coordinates.words}"),
        **values,
        **std,
    )


def _left_out(model: PeriodicModel, coordinates: Coordinates, terms: Terms, kept: Mask) -> tuple[Floats, Shapes, Terms]:
    """Sizes that terms beyond those kept may have (terms, channels, hits), shapes with these, and their places."""
    # Of all terms that the record says something of.
    every = terms.estimates if model.unselected is None else model.unselected
    beyond, shapes = terms_of(model, every), shapes_of(model, coordinates, every)
    used = set(zip(terms.modes[kept].tolist(), terms.estimates.harmonics[kept].tolist(), strict=True))
    own = np.array([pair in used for pair in zip(beyond.modes.tolist(), every.harmonics.tolist(), strict=True)])
    sizes = sizes_left_out(every, own, (shapes.weights != 0).any(axis=(0, 1, 2)))
    return sizes, beyond.mask(own | (sizes > 0).any(axis=(1, 2)), shapes), beyond


def _input_output(model: PeriodicModel, shapes: Shapes, modal: Modal, times: Floats) -> dict[str, Floats]:
    """B, C and D of a model with inputs; nothing of one of free responses."""
    own = model.inputs
    if own is None:
        return {}
    turned, straight = (
        np.exp(1j * model.fundamental * np.multiply.outer(times, turns))
        for turns in (own.harmonics, own.direct_harmonics)
    )
    # The shapes have a factor of their own, as those of several hits have.
    factor = shapes.hits[:, 0]
    gains = np.einsum("ril,tl->tri", own.coefficients, turned) / factor[:, None]
    phases = np.exp(1j * model.fundamental * np.multiply.outer(times, shapes.harmonics))
    seen = np.einsum("rcm,rm,tm->tcr", shapes.coefficients, shapes.kept, phases)
    return {
        "inputs": (modal.modal @ gains).real,
        "outputs": (seen @ modal.inverse).real,
        "direct": np.einsum("cil,tl->tci", own.direct, straight).real,
    }


def _built_from(
    model: PeriodicModel, coordinates: Coordinates, harmonics: str | int
) -> tuple[Shapes, Terms | None, Mask]:
    """The shapes that A(t) is built from, where the estimates are that tell their deviations, and which count."""
    if isinstance(harmonics, str) and harmonics not in ("auto", "model"):
        raise wrong_value("harmonics", "reconstruct", 'be "auto", "model" or a whole number', harmonics)
    if not isinstance(harmonics, str):
        integer(harmonics, "harmonics", "reconstruct", at_least=0)
    estimates = model.estimates
    if estimates is None:
        if not isinstance(harmonics, str):
            must, got = 'be "auto" or "model" for a model without estimates', f"is {harmonics}"
            raise input_error("harmonics", "reconstruct", must, got, "Set its other coefficients to zero yourself.")
        return shapes_of(model, coordinates), None, np.zeros(0, bool)
    if harmonics == "model":
        whole, terms = shapes_of(model, coordinates, estimates, cut=True), terms_of(model, estimates)
        kept = whole.kept[terms.modes, terms.places]
        # What the model keeps beside the estimates has no deviations, and A(t) then has none either.
        known = (terms.mask(kept, whole).kept == whole.kept).all()
        return whole, terms if known else None, kept
    if harmonics != "auto" and model.unselected is not None:
        estimates = model.unselected
    whole, terms = shapes_of(model, coordinates, estimates), terms_of(model, estimates)
    kept = chosen(model, whole, terms) if harmonics == "auto" else np.abs(estimates.harmonics) <= harmonics
    return terms.mask(kept, whole), terms, kept


def instants_of(times: ArrayLike | int, period: float, of: str) -> Floats:
    """The instants [s] that are meant: given, or a number of them over a period."""
    if isinstance(times, (int, np.integer)):
        count = integer(times, "times", of, at_least=0, at_most=MOST_TIMES, remedy="Give the instants themselves.")
        instants = np.arange(count) * period / max(count, 1)
        instants.flags.writeable = False
    else:
        instants = frozen_array(times, "times", of, axes=("times",))
    if not len(instants):
        raise wrong_value("times", of, "hold at least one instant", times)
    return instants


def coordinates_of(model: PeriodicModel, states: Names, form: str, delay: float | None) -> Coordinates:
    """The states of a form."""
    if not model.order:
        remedy = "Nothing was found in the record: give an `order`, or a longer or cleaner one."
        raise input_error("model", "reconstruct", "have modes", "has none", remedy)
    if form not in get_args(Form):
        words = ", ".join(f'"{one}"' for one in get_args(Form))
        raise wrong_value("form", "reconstruct", f"be one of {words}", form)
    if delay is not None and form != "delayed":
        raise wrong_value("delay", "reconstruct", 'be None unless form="delayed"', delay)
    if form == "delayed":
        return delayed(model, states, delay)
    return (second_order if form == "second-order" else first_order)(model, states)


def choices(
    model: PeriodicModel, states: Names, *, form: Form = "second-order", delay: float | None = None
) -> tuple[float | None, Mask | None]:
    """The delay, and the terms of the estimates, that A(t) is built from with `harmonics="auto"`, to build it again.

    The delay [s] is None where no state has one, the mask over the terms of `model.estimates` (terms,) without these.
    `model`, `states`, `form`, `delay` and the errors are those of `reconstruct`.
    """
    coordinates = coordinates_of(model, states, form, delay)
    later = [part.delay for state in coordinates.states for part in state.parts if part.delay > 0.0]
    found = min(later, default=None) if form == "delayed" else None
    if model.estimates is None:
        return found, None
    own = model.estimates
    return found, chosen(model, shapes_of(model, coordinates, own), terms_of(model, own))
