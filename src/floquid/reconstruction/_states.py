"""From names of channels to states: displacements and velocities, channels as they are, or delayed outputs."""

from __future__ import annotations

from collections.abc import Sequence

from floquid._checks import input_error
from floquid.core import Channel, PeriodicModel, channels_named
from floquid.reconstruction._combination import combined
from floquid.reconstruction._coordinates import OF, Coordinates, Part, State, channel_noise, derivative_of, refuse_rest

ALL = "all"
"""The word for all channels, each state a weighted sum of them."""

Names = str | Sequence[str | Sequence[str]]


def second_order(model: PeriodicModel, states: Names) -> Coordinates:
    """Displacements and their velocities; an entry of `states` may be several channels of one motion.

    Raises
    ------
    InputError
        A channel is unknown, is not a motion, or there are too few or too many for the modes.
    IdentificationError
        A mode has a harmonic that stands still, whose displacement no velocity or acceleration shows.
    """
    _even(model)
    if states == ALL and ALL not in {channel.name for channel in model.channels}:
        return combined(model, model.order // 2)
    groups = groups_of(model.channels, states)
    needed = model.order // 2
    if len(groups) != needed:
        got = f"names {len(groups)}"
        raise _wrong_number(model, needed, got, "half of them velocities", f"name {needed} channels")
    noise = channel_noise(model)
    displacements = []
    for group in groups:
        parts = tuple(Part(row, 1.0, -derivative_of(model.channels[row])) for row in group)
        name = model.channels[group[0]].name
        displacements.append(State(name, parts, tuple(float(noise[row]) for row in group)))
    refuse_rest(model, displacements)
    names = ", ".join("+".join(model.channels[row].name for row in group) for group in groups)
    return Coordinates(
        (*displacements, *(state.derivative() for state in displacements)),
        len(model.channels),
        "second-order",
        f"second-order form from {names}",
    )


def first_order(model: PeriodicModel, states: Names) -> Coordinates:
    """The channels as they are, as many as there are modes."""
    names = [channel.name for channel in model.channels] if states == ALL else states
    rows = channels_named(model.channels, names, argument="states", of=OF)  # type: ignore[arg-type]
    if len(rows) != model.order:
        got = f"names {len(rows)}"
        raise _wrong_number(model, model.order, got, "each a channel", f"name {model.order} channels")
    made = tuple(State(model.channels[row].name, (Part(row),)) for row in rows)
    return Coordinates(
        made, len(model.channels), "first-order", f"first-order form from {', '.join(s.name for s in made)}"
    )


def groups_of(channels: Sequence[Channel], states: Names) -> list[list[int]]:
    """The rows of the channels of each displacement: one name, several joined by +, or a list of names."""
    listing = "The channels are: " + ", ".join(channel.name for channel in channels) + "."
    if isinstance(states, str):
        raise input_error("states", OF, "be a list of channel names", f"is {states!r}", listing)
    known = {channel.name for channel in channels}
    groups: list[list[str]] = []
    for entry in states:
        if isinstance(entry, str):
            groups.append([entry] if entry in known else [name.strip() for name in entry.split("+")])
        elif isinstance(entry, (list, tuple)):
            groups.append(list(entry))
        else:
            raise input_error("states", OF, "be a list of channel names", f"is {states!r}", listing)
    channels_named(channels, [name for group in groups for name in group], argument="states", of=OF)
    place = {channel.name: row for row, channel in enumerate(channels)}
    rows = [[place[name] for name in group] for group in groups]
    for group in rows:
        for row in group:
            derivative_of(channels[row])
    return rows


def _even(model: PeriodicModel) -> None:
    if model.order % 2:
        raise input_error(
            "model",
            OF,
            "have an even number of modes: a channel gives two states, displacement and velocity",
            f"has {model.order}",
            'Identify again with an even `order`, pass `form="delayed"`, or leave A(t) out.',
        )


def _wrong_number(model: PeriodicModel, needed: int, got: str, what: str, must: str) -> Exception:
    few = needed > len(model.channels)
    return input_error(
        "states",
        OF,
        f"{must}: {model.order} modes (conjugates one by one) need as many states, {what}",
        got,
        f"The channels are: {', '.join(c.name for c in model.channels)}."
        + (' There are too few of them to span these modes: pass `form="delayed"` (`--form delayed`).' if few else ""),
    )
