"""Names in as much room as there is, the units of the elements of A(t)."""

from __future__ import annotations

from collections.abc import Sequence

from floquid.core import Channel
from floquid.reconstruction import StateModel

VELOCITY = "d/dt "  # what the name of a state that is the derivative of another begins with
LATER = "(t + "  # what comes between the name of a channel and the delay of a delayed state

_TIME_POWER = {"velocity": 1, "acceleration": 2}
_POWERS = {2: "²", 3: "³", 4: "⁴", 5: "⁵"}


def shortened(name: str, longest: int) -> str:
    """A `name`, or its beginning and its end with "…" between them: names of channels often differ in either alone.

    It has `longest` characters at most, 1 or more.
    """
    if len(name) <= longest:
        return name
    end = (longest - 1) // 2
    return f"{name[: longest - 1 - end]}…{name[len(name) - end :]}"


def in_unit(words: str, unit: str) -> str:
    """The label of an axis or the heading of a column: `words` in a `unit`; "-" stands for none."""
    return f"{words} [{'no unit' if unit == '-' else unit}]"


def element_unit(state: StateModel, i: int, j: int, channels: Sequence[Channel]) -> str:
    """The unit of A(i,j), dx_i/dt by x_j: that of the channels, if they differ, and a power of the second.

    In second-order form a channel of velocity is integrated once and one of acceleration twice, so that its
    displacement is in its own unit times s or s²; in other forms a state is in the unit of its channel.

    `state` has Φ and A(t), `i` and `j` are row and column from 0, and `channels` are those of the model; without that
    of a state, there is the unit of time alone. "-" stands for none.
    """
    (above, power), (below, other) = (_unit_of_state(state, k, channels) for k in (i, j))
    return _rate_unit(above, below, power - other - 1)


def input_unit(state: StateModel, i: int, channel: Channel, channels: Sequence[Channel]) -> str:
    """The unit of B(i,j), dx_i/dt by an input: that of the state's channel over that of the input, and a power of s.

    `state` has A(t) and B(t), `i` is the row from 0, `channel` is the input and `channels` are those of the model.
    """
    above, power = _unit_of_state(state, i, channels)
    return _rate_unit(above, channel.unit, power - 1)


def _unit_of_state(state: StateModel, k: int, channels: Sequence[Channel]) -> tuple[str | None, int]:
    """The unit of the channel of a state, None without one, and the power of the second beside it."""
    by_name = {channel.name: channel for channel in channels}
    name = state.states[k]
    own = name.removeprefix(VELOCITY)
    channel = by_name.get(own) or by_name.get(own.split(LATER)[0]) or by_name.get(own.split("+")[0])
    power = 0
    if any(one.startswith(VELOCITY) for one in state.states):
        power = (_TIME_POWER.get(str(channel.quantity), 0) if channel else 0) - name.startswith(VELOCITY)
    return channel.unit if channel else None, power


def _rate_unit(above: str | None, below: str | None, power: int) -> str:
    """One unit over another, times a power of the second."""
    ratio = "" if above is None or below is None or above == below else f"{_factor(above)}/{_factor(below)}"
    return " · ".join(part for part in (ratio, _time(power)) if part) or "-"


def _factor(unit: str) -> str:
    if unit == "-":
        return "1"
    return f"({unit})" if "/" in unit else unit


def _time(power: int) -> str:
    """A power of the second."""
    if power == 0:
        return ""
    raised = f"s{_POWERS.get(abs(power), '')}"
    return raised if power > 0 else f"1/{raised}"
