"""From names of channels to states: displacements (all channels combined, too) and velocities, channels, delays."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Complexes, Floats, Integers
from floquid._checks import input_error, positive, wrong_value
from floquid.core import Channel, PeriodicModel, channels_named
from floquid.errors import IdentificationError
from floquid.reconstruction._coordinates import OF, Coordinates, Part, State, channel_noise, derivative_of, refuse_rest
from floquid.reconstruction._modal_matrix import condition_of

ALL = "all"  # the word for all channels, each state a weighted sum of them

Names = str | Sequence[str | Sequence[str]]

TRIED = 200  # delays that are tried
PHASES = 24  # instants of the period at which each is judged
NO_CHANCE = 1e-6  # probability of what is left at which the channels are no constant combinations of the displacements


def second_order(model: PeriodicModel, states: Names) -> Coordinates:
    """Displacements and their velocities; an entry of `states` may be several channels of one motion."""
    if model.order % 2:
        must = "have an even number of modes: a channel gives two states, displacement and velocity"
        remedy = 'Identify again with an even `order`, pass `form="delayed"`, or leave A(t) out.'
        raise input_error("model", OF, must, f"has {model.order}", remedy)
    if states == ALL and ALL not in {channel.name for channel in model.channels}:
        return combined(model, model.order // 2)
    named = displacements(model.channels, states)
    needed = model.order // 2
    if len(named) != needed:
        got = f"names {len(named)}"
        raise _wrong_number(model, needed, got, "half of them velocities", f"name {needed} channels")
    noise = channel_noise(model)
    made = [replace(own, noise=tuple(float(noise[part.channel]) for part in own.parts if own.noise)) for own in named]
    refuse_rest(model, made)
    names = ", ".join(
        "+".join(model.channels[part.channel].name for part in own.parts) if own.noise else own.name for own in named
    )
    return Coordinates(
        (*made, *(state.derivative() for state in made)),
        len(model.channels),
        "second-order",
        f"second-order form from {names}",
    )


def first_order(model: PeriodicModel, states: Names) -> Coordinates:
    """The channels as they are, as many as there are modes."""
    names = [channel.name for channel in model.channels] if states == ALL else states
    made = as_they_are(model.channels, names)
    if len(made) != model.order:
        got = f"names {len(made)}"
        raise _wrong_number(model, model.order, got, "each a channel", f"name {model.order} channels")
    words = f"first-order form from {', '.join(state.name for state in made)}"
    return Coordinates(tuple(made), len(model.channels), "first-order", words)


NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"


def displacements(channels: Sequence[Channel], states: Names, *, of: str = OF) -> list[State]:
    """The displacements: one channel, views of it joined by + (or a list of names), or a sum such as 0.5*X+Y."""
    listing = "The channels are: " + ", ".join(channel.name for channel in channels) + "."
    if isinstance(states, str):
        raise wrong_value("states", of, "be a list of channel names", states, listing)
    place = {channel.name: row for row, channel in enumerate(channels)}
    found: list[State] = []
    views: list[str] = []
    for entry in states:
        if isinstance(entry, str) and entry not in place and "*" in entry:
            found.append(_sum_of(entry, channels, of))
            continue
        if isinstance(entry, str):
            group = [entry] if entry in place else [name.strip() for name in entry.split("+")]
        elif isinstance(entry, (list, tuple)):
            group = list(entry)
        else:
            raise wrong_value("states", of, "be a list of channel names", states, listing)
        views += group
        channels_named(channels, views, argument="states", of=of)
        found.append(State(group[0], tuple(Part(place[name]) for name in group), (1.0,) * len(group)))
    _refuse_dependent(found, len(channels), of)
    return [replace(own, parts=tuple(_of_motion(part, channels, of) for part in own.parts)) for own in found]


def as_they_are(channels: Sequence[Channel], states: Names, *, of: str = OF) -> list[State]:
    """The states of first order: channels, and sums of them such as 0.5*X+Y."""
    known = {channel.name for channel in channels}
    sums = {
        own: _sum_of(own, channels, of) for own in states if isinstance(own, str) and own not in known and "*" in own
    }
    plain = [own for own in states if own not in sums] if sums else states
    rows = iter(channels_named(channels, plain, argument="states", of=of))  # type: ignore[arg-type]
    made = [sums[own] if own in sums else State(own, (Part(next(rows)),)) for own in states]  # type: ignore[index, arg-type]
    _refuse_dependent(made, len(channels), of)
    return made


def _sum_of(entry: str, channels: Sequence[Channel], of: str) -> State:
    """The state of a sum of channels with constant weights."""
    names = sorted((channel.name for channel in channels), key=len, reverse=True)
    weighed = rf"\s*(?:({NUMBER})\s*\*\s*)?({'|'.join(map(re.escape, names))})\s*"
    if not re.fullmatch(f"[+-]?{weighed}(?:[+-]{weighed})*", entry):
        listing = f"The channels are: {', '.join(channel.name for channel in channels)}."
        raise input_error("states", of, "be channels, or sums of them as 0.5*X+Y", f"has {entry!r}", listing)
    place = {channel.name: row for row, channel in enumerate(channels)}
    parts = tuple(
        Part(place[name], (-1.0 if sign == "-" else 1.0) * float(gain or 1.0))
        for sign, gain, name in re.findall(f"([+-]?){weighed}", entry)
    )
    return State(entry.replace(" ", ""), parts)


def _refuse_dependent(states: Sequence[State], count: int, of: str) -> None:
    """Refuse sums that are sums of one another."""
    weights = np.zeros((len(states), count))
    for own, state in zip(weights, states, strict=True):
        for part in state.parts[:1] if state.noise else state.parts:
            own[part.channel] += part.gain
    rank = int(np.linalg.matrix_rank(weights))
    if rank < len(states):
        got = f"only {rank} of the {len(states)} are"
        raise input_error("states", of, "be independent combinations of channels", got, "Change their weights.")


def _of_motion(part: Part, channels: Sequence[Channel], of: str) -> Part:
    return replace(part, power=-derivative_of(channels[part.channel], of))


def _wrong_number(model: PeriodicModel, needed: int, got: str, what: str, must: str) -> Exception:
    few = needed > len(model.channels)
    return input_error(
        "states",
        OF,
        f"{must}: {model.order} modes (conjugates one by one) need as many states, {what}",
        got,
        f"The channels are: {', '.join(c.name for c in model.channels)}."
        + (' There are too few of them to span these modes: pass `form="delayed"`.' if few else ""),
    )


def delayed(model: PeriodicModel, states: Names, delay: float | None) -> Coordinates:
    r"""The channels and the same channels later, as many as there are modes.

    .. math:: x(t) = [y(t);\ y(t + \tau);\ y(t + 2\tau);\ \ldots]

    A delay that is not given is the one with the least condition number of the modes' shapes in these states, at the
    worst phase of the period.
    """
    names: Sequence[str] = [channel.name for channel in model.channels] if states == ALL else states  # type: ignore[assignment]
    rows = channels_named(model.channels, names, argument="states", of=OF)
    if not 0 < len(rows) <= model.order:
        must, got = f"name 1 to {model.order} channels", f"names {len(rows)}"
        raise input_error("states", OF, must, got, "The rest of the states are the same channels later.")
    if delay is None:
        fastest = float(np.abs(model.exponents).max())
        slowest = max(float(np.abs(model.exponents).min()), 1e-3 * fastest)
        tried = np.geomspace(0.05 / fastest, 2.0 * np.pi / slowest, TRIED)
        delay = float(tried[np.argmin([_condition(model, rows, one) for one in tried])])
    else:
        positive(delay, "delay", OF, unit="s")
    made = []
    for number in range(model.order):
        later, row = divmod(number, len(rows))
        name = model.channels[rows[row]].name
        said = f"{name}(t + {later * delay:.4g} s)" if later else name
        made.append(State(said, (Part(rows[row], delay=later * delay),)))
    words = (
        f"delayed outputs, {', '.join(state.name for state in made)}: Φ and A are those of these coordinates, which "
        "are no displacements and velocities; the exponents are the same in any"
    )
    return Coordinates(tuple(made), len(model.channels), "delayed", words)


def _condition(model: PeriodicModel, rows: Sequence[int], delay: float) -> float:
    """The largest condition number of the equilibrated shapes over the period."""
    count = -(-model.order // len(rows))
    later = delay * np.arange(count)[:, None] + np.arange(PHASES) * model.period / PHASES
    hits = np.argmax(np.sum(np.abs(model.coefficients) ** 2, axis=(1, 3)), axis=1)
    shapes: Complexes = model.shapes(later.ravel())[np.arange(model.order), :, hits][:, list(rows)]
    shapes = shapes.reshape(model.order, len(rows), count, PHASES)
    grown = shapes * np.exp(np.multiply.outer(model.exponents, delay * np.arange(count)))[:, None, :, None]
    modal = grown.transpose(3, 2, 1, 0).reshape(PHASES, -1, model.order)[:, : model.order]
    return float(condition_of(modal).max())


def combined(model: PeriodicModel, count: int) -> Coordinates:
    r"""Displacements u from all channels, each a constant combination of them.

    .. math:: B_{c} = s^{p_c} \sum_i V_{ci} u_i, \qquad u = (V^T \Sigma^{-1} V)^{-1} V^T \Sigma^{-1} (s^{-p} B)

    with Σ the noise of the channels and V their leading singular vectors, so scaled that the `count` channels that are
    farthest from dependent are u themselves, up to noise.
    """
    from scipy.linalg import qr
    from scipy.special import chdtrc

    powers = np.array([derivative_of(channel) for channel in model.channels])
    if len(powers) < count:
        must, got = f"be at least {count} channels: half as many as there are modes", f"there are {len(powers)}"
        raise input_error("states", "reconstruct", must, got, 'Pass `form="delayed"`.')
    noise = channel_noise(model)
    if len(powers) == count:
        mixing, chosen, loose = np.eye(count), np.arange(count), None
    else:
        table, units, degrees, left = _table(model, powers, noise, count)
        vectors = np.linalg.svd(table, full_matrices=False)[0][:, :count]
        if degrees and chdtrc(degrees, left) < NO_CHANCE:
            raise IdentificationError(
                f"The channels are no constant combinations of {count} displacements: the residual has a chi-square "
                f"of {left:.4g} for {degrees} degrees of freedom. Their combination varies with the period. Choose "
                f"{count} of them with `states`."
            )
        order = qr(vectors.T, pivoting=True)[-1]
        chosen = np.sort(order[:count])
        spread = noise[:, None] * vectors
        mixing = spread @ np.linalg.inv(spread[chosen])
        loose = None if units is None else _loose(table, units, vectors, noise, chosen, mixing)
    weighted = mixing / noise[:, None] ** 2
    weights = np.linalg.solve(mixing.T @ weighted, weighted.T)
    states = []
    for i, row in enumerate(chosen):
        parts = tuple(Part(c, float(weights[i, c]), -int(powers[c])) for c in range(len(powers)) if weights[i, c])
        states.append(State(f"{model.channels[row].name}*", parts))
    refuse_rest(model, states)
    sums = "; ".join(
        f"{state.name} = " + " + ".join(f"{part.gain:.4g} {model.channels[part.channel].name}" for part in state.parts)
        for state in states
    )
    words = f"second-order form from all channels, weighted by their noise ({sums})"
    derived = tuple(state.derivative() for state in states)
    rows = tuple(int(row) for row in chosen)
    return Coordinates((*states, *derived), len(powers), "second-order", words, mixing, rows, loose)


def _loose(
    table: Floats, units: Complexes, vectors: Floats, noise: Floats, chosen: NDArray[Any], mixing: Floats
) -> Complexes:
    r"""Slopes of the error that the errors of V make in the displacements.

    .. math:: E = N_c\, (\Pi_\perp\, \delta M\, U^+)_c

    with M = N⁻¹VU the table, Π⊥ the projector off its columns, and c the chosen rows. A number of the table is the real
    or the imaginary part of a coefficient times its `units` (channels, modes, hits, harmonics).
    """
    across = noise[chosen][:, None] * (np.eye(len(vectors)) - vectors @ vectors.T)[chosen]
    back = np.linalg.pinv(np.linalg.lstsq(mixing / noise[:, None], table, rcond=None)[0])
    real, imag = np.split(back, 2)
    there = (units != 0).any(axis=0)
    slopes = np.zeros((len(chosen), len(chosen), *units.shape), complex)
    slopes[..., there] = np.einsum("ic,cq,qj->ijcq", across, units[:, there], real - 1j * imag)
    return np.moveaxis(slopes, 2, 3)


def _table(
    model: PeriodicModel, powers: Integers, noise: Floats, count: int
) -> tuple[Floats, Complexes | None, int, float]:
    """Displacement coefficients over their noise (channels, numbers), and what that makes of each coefficient."""
    # With degrees and chi-square of what is left. Without deviations they are as they are.
    rates = model.exponents[:, None] + 1j * model.harmonics * model.fundamental
    factors = np.where(rates[None] == 0, 1.0, rates[None]) ** -powers[:, None, None] / noise[:, None, None]
    values = np.moveaxis(model.coefficients, 1, 0)
    upper = model.exponents.imag >= 0
    if model.coefficient_std is None or not model.coefficient_std.any():
        flat = (values * factors[:, :, None, :])[:, upper].reshape(len(powers), -1)
        return np.concatenate([flat.real, flat.imag], axis=1), None, 0, 0.0
    std = np.moveaxis(model.coefficient_std, 1, 0) * np.abs(factors[:, :, None, :])
    size = np.sqrt(0.5 * np.mean(std.real**2 + std.imag**2, axis=0))
    there = (size > 0) & upper[:, None, None]
    units = factors[:, :, None, :] * np.divide(1.0, size, out=np.zeros_like(size), where=there)
    flat = (values * units)[:, there]
    table = np.concatenate([flat.real, flat.imag], axis=1)
    singular = np.linalg.svd(table, compute_uv=False)
    degrees = (table.shape[0] - count) * max(table.shape[1] - count, 0)
    return table, units, degrees, float(np.sum(singular[count:] ** 2))
