"""A(t), Φ and B(t) of results whose excitation goes on, with deviations by the joint errors of the fit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from floquid._checks import input_error
from floquid.core import PeriodicModel
from floquid.fit import covariance_root
from floquid.innovations import Fit, terms_of_mode
from floquid.inputs import Term, Uncertainty, terms_of
from floquid.reconstruction import Form, Names, StateModel, reconstruct

NEAR = 0.1
"""The share of a deviation by which parameters are moved for a difference."""

ROUNDING = 1e-12
"""The share of the largest below which a direction of a covariance is rounding."""


def refuse_delayed(form: str, of: str) -> None:
    """Raise InputError where states are asked for that have no deviations here."""
    if form not in ("second-order", "first-order"):
        remedy = "Delayed states have no deviations: `floquid.reconstruct(analysis.model, ...)`."
        raise input_error("form", of, 'be "second-order" or "first-order"', f"is {form!r}", remedy)


def state_matrix_of(
    model: PeriodicModel,
    fit: Uncertainty | Fit,
    states: Names,
    form: Form,
    times: ArrayLike | int,
) -> StateModel:
    """What `reconstruct` makes of a model, with deviations by differences along independent errors of its fit."""
    found = reconstruct(model, states, form=form, times=times)
    names = ("system", "transition") if found.inputs is None else ("system", "transition", "inputs")
    variances = {name: np.zeros_like(getattr(found, name)) for name in names}
    for sides in _neighbours(fit) if isinstance(fit, Uncertainty) else _ambient_neighbours(fit):
        up, down = (reconstruct(_with(model, own), states, form=form, times=found.times) for own in sides)
        for name, variance in variances.items():
            variance += ((getattr(up, name) - getattr(down, name)) / (2.0 * NEAR)) ** 2
    if form == "second-order":  # displacements change at their velocities
        variances["system"][:, : len(found.states) // 2] = 0.0
    return replace(found, **{f"{name}_std": np.sqrt(variance) for name, variance in variances.items()})


def _neighbours(fit: Uncertainty) -> Iterator[tuple[list[Term], list[Term]]]:
    """All modes near a fit with inputs on either side, along errors that are independent: of all, then of a channel."""
    at = fit.at

    def moved(step: NDArray[np.float64], change: NDArray[np.float64]) -> list[Term]:
        modes = []
        for mode, (place, free) in zip(at.modes, fit.places, strict=True):
            own = np.zeros(len(free))
            own[free] = step[place]
            modes.append(mode.moved(own))
        here = replace(at, modes=tuple(modes), coefficients=at.coefficients + change)
        omega = fit.samples.fundamental
        return [one for number, mode in enumerate(modes) for one in terms_of(mode, here.shape(number).T, omega)]

    for column in NEAR * covariance_root(fit.parameters, ROUNDING).T:
        change = (fit.slopes @ column).T
        yield moved(column, change), moved(-column, -change)
    held, change = np.zeros(len(fit.parameters)), np.zeros_like(at.coefficients)
    for channel, noise in enumerate(at.noise):
        for column in NEAR * noise * covariance_root(at.inverse, ROUNDING).T:
            change[:, channel] = column
            yield moved(held, change), moved(held, -change)
        change[:, channel] = 0.0


def _ambient_neighbours(fit: Fit) -> Iterator[tuple[list[Term], list[Term]]]:
    """The same of a fit in innovations form."""

    def moved(step: NDArray[np.float64]) -> list[Term]:
        pairs = zip(fit.at.modes, fit.places, strict=True)
        return [one for mode, place in pairs for one in terms_of_mode(mode.moved(step[place]), fit.samples)]

    for column in NEAR * covariance_root(fit.parameters, ROUNDING).T:
        yield moved(column), moved(-column)


def _with(model: PeriodicModel, terms: Sequence[Term]) -> PeriodicModel:
    """The model with other modes: those of a block may have become of the other kind, on other harmonics."""
    seen, driven = (np.unique(np.concatenate([term[k] for term in terms])) for k in (1, 3))
    coefficients, own = np.zeros((len(terms), len(model.channels), 1, len(seen)), complex), model.inputs
    gains = None if own is None else np.zeros((len(terms), len(own.channels), len(driven)), complex)
    for number, (_, harmonics, shape, reach, gain) in enumerate(terms):
        coefficients[number][:, 0, np.searchsorted(seen, harmonics)] = shape
        if gains is not None:
            gains[number][:, np.searchsorted(driven, reach)] = gain
    if own is not None and gains is not None:
        own = replace(own, coefficients=gains, harmonics=driven, coefficient_std=None)
    return PeriodicModel(
        exponents=np.array([term[0] for term in terms]),
        coefficients=coefficients,
        harmonics=seen,
        period=model.period,
        channels=model.channels,
        inputs=own,
    )
