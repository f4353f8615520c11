"""Delayed outputs as states, where the channels do not span them (Allen 2009, section 2.3; Peters and Wang)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from floquid._checks import input_error, positive
from floquid.core import PeriodicModel, channels_named
from floquid.reconstruction._coordinates import OF, Coordinates, Part, State
from floquid.reconstruction._states import ALL, Names

TRIED = 200
"""Delays that are tried."""

PHASES = 24
"""Instants of the period at which each is judged."""


def delayed(model: PeriodicModel, states: Names, delay: float | None) -> Coordinates:
    r"""The channels and the same channels later, as many as there are modes.

    .. math:: x(t) = [y(t);\ y(t + \tau);\ y(t + 2\tau);\ \ldots]

    A delay that is not given is the one with the least condition number of the modes' shapes in these states, at the
    worst phase of the period.

    Raises
    ------
    InputError
        A channel is unknown, there are more channels than modes, or the delay is not positive.
    """
    names: Sequence[str] = [channel.name for channel in model.channels] if states == ALL else states  # type: ignore[assignment]
    rows = channels_named(model.channels, names, argument="states", of=OF)
    if not 0 < len(rows) <= model.order:
        must, got = f"name 1 to {model.order} channels", f"names {len(rows)}"
        raise input_error("states", OF, must, got, "The rest of the states are the same channels later.")
    if delay is None:
        delay = _best(model, rows)
    else:
        positive(delay, "delay", OF, unit="s")
    made = _states(model, rows, delay)
    words = (
        f"delayed outputs, {', '.join(state.name for state in made)}: Φ and A are those of these coordinates, which "
        "are no displacements and velocities; the exponents are the same in any"
    )
    return Coordinates(made, len(model.channels), "delayed", words)


def _states(model: PeriodicModel, rows: Sequence[int], delay: float) -> tuple[State, ...]:
    made = []
    for number in range(model.order):
        later, row = divmod(number, len(rows))
        name = model.channels[rows[row]].name
        made.append(
            State(
                name if not later else f"{name}(t + {later * delay:.4g} s)", (Part(rows[row], 1.0, 0, later * delay),)
            )
        )
    return tuple(made)


def _best(model: PeriodicModel, rows: Sequence[int]) -> float:
    """The delay whose states have the least condition number at the worst phase."""
    fastest = float(np.abs(model.exponents).max())
    slowest = max(float(np.abs(model.exponents).min()), 1e-3 * fastest)
    tried = np.geomspace(0.05 / fastest, 2.0 * np.pi / slowest, TRIED)
    return float(tried[np.argmin([_condition(model, rows, delay) for delay in tried])])


def _condition(model: PeriodicModel, rows: Sequence[int], delay: float) -> float:
    """The largest condition number of the equilibrated shapes over the period."""
    count = -(-model.order // len(rows))
    later = delay * np.arange(count)[:, None] + np.arange(PHASES) * model.period / PHASES
    hits = np.argmax(np.sum(np.abs(model.coefficients) ** 2, axis=(1, 3)), axis=1)
    shapes: NDArray[np.complex128] = model.shapes(later.ravel())[np.arange(model.order), :, hits][:, list(rows)]
    shapes = shapes.reshape(model.order, len(rows), count, PHASES)
    grown = shapes * np.exp(np.multiply.outer(model.exponents, delay * np.arange(count)))[:, None, :, None]
    modal = grown.transpose(3, 2, 1, 0).reshape(PHASES, -1, model.order)[:, : model.order]
    modal = modal / np.maximum(np.sqrt(np.mean(np.abs(modal) ** 2, axis=(0, 2))), np.finfo(float).tiny)[:, None]
    modal = modal / np.maximum(np.linalg.norm(modal, axis=1, keepdims=True), np.finfo(float).tiny)
    return float(np.linalg.cond(modal).max())
