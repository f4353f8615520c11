"""Φ(t, t0) and A(t) from a model of the response (Allen 2009, eqs. 13-21 as corrected)."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Floats, Mask
from floquid._checks import frozen_array, input_error, integer
from floquid.core import PeriodicModel
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
from floquid.reconstruction._state_model import StateModel
from floquid.reconstruction._states import Names, delayed, first_order, second_order

MOST_TIMES = 10_000
"""Instants of a period at most, where a number of them is asked for."""

Form = Literal["second-order", "first-order", "delayed"]


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
    deviations are those of the estimates, to first order. They include the next harmonic on either side of each band,
    if the series goes on falling as it does (`refine` has no such part).

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
        ["x", "vx", "ax"] or "x+vx+ax", are averaged at each rate by their noise, each used in its own right. "all"
        takes all channels: each state is the sum of them that is least noisy. In first-order form as many channels as
        there are modes; delayed, at least one.
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
        own, rows = terms.estimates, (shapes.weights != 0).any(axis=(0, 1, 2))
        sizes = sizes_left_out(own, kept, rows)
        loose = None if coordinates.loose is None else at_terms(coordinates.loose, model, terms)
        wider = terms.mask(kept | (sizes > 0).any(axis=(1, 2)), shapes)
        slopes_of = {"system": by_system, "transition": by_transition}
        if "inputs" in values and own.gains is not None:
            slopes_of["inputs"] = by_inputs
        std = {f"{name}_std": np.zeros(values[name].shape) for name in slopes_of}
        for t in at_once(shapes, instants, terms):
            for name, made in slopes_of.items():
                slopes = made(shapes, modal, instants, t, terms)
                if loose is not None:
                    slopes = slopes.loosened(values[name][t], loose)
                hidden = spread_of(sizes, made(wider, modal, instants, t, terms), own)
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
        must = 'be "auto", "model" or a whole number'
        raise input_error("harmonics", "reconstruct", must, f"is {harmonics!r}")
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
        raise input_error("times", of, "hold at least one instant", f"is {times!r}")
    return instants


def coordinates_of(model: PeriodicModel, states: Names, form: str, delay: float | None) -> Coordinates:
    """The states of a form."""
    if not model.order:
        remedy = "Nothing was found in the record: give an `order`, or a longer or cleaner one."
        raise input_error("model", "reconstruct", "have modes", "has none", remedy)
    if form not in get_args(Form):
        words = ", ".join(f'"{one}"' for one in get_args(Form))
        raise input_error("form", "reconstruct", f"be one of {words}", f"is {form!r}")
    if delay is not None and form != "delayed":
        raise input_error("delay", "reconstruct", 'be None unless form="delayed"', f"is {delay!r}")
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
