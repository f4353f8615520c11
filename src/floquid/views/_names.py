"""Choice of modes, channels and hits; names in as much room as there is; units of A(t) and of the speed of a shaft."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Complexes, Integers
from floquid._checks import an_instance, index, wrong_value
from floquid.core import Channel, PeriodicModel
from floquid.findings import Finding, Severity
from floquid.fit import DEVIATIONS
from floquid.pipeline import Analysis
from floquid.reconstruction import StateModel

VELOCITY = "d/dt "  # what the name of a state that is the derivative of another begins with
LATER = "(t + "  # what comes between the name of a channel and the delay of a delayed state


class Ink:
    """Okabe and Ito's palette and two greys: readable in print, in grey and by the colour-blind."""

    BLACK, BLUE, VERMILION, GREEN = "#000000", "#0072B2", "#D55E00", "#009E73"
    PURPLE, ORANGE, SKY = "#CC79A7", "#E69F00", "#56B4E9"
    GREY, SILVER = "#767676", "#999999"  # on the page, on paper


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


SpeedUnit: TypeAlias = Literal["hz", "rpm"]

UNITS = {"hz": ("Hz", 1.0), "rpm": ("rpm", 60.0)}


def speed_unit(unit: object, of: str) -> tuple[str, float]:
    """The symbol of a `unit` of speed, and how many of it are a revolution a second.

    Raises InputError in the name of the callable `of` where it is none.
    """
    if not isinstance(unit, str) or unit not in UNITS:
        raise wrong_value("speed_unit", of, 'be "hz" or "rpm"', unit)
    return UNITS[unit]


def speed_words(analysis: Analysis, unit: SpeedUnit = "hz") -> str:
    """The speed of the shaft by the period and the periods a revolution of an `analysis`, in words with its `unit`."""
    symbol, factor = speed_unit(unit, "speed_words")
    periods = analysis.settings.periods_per_revolution
    shaft = "" if unit == "hz" and periods == 1.0 else "shaft at "
    more = "" if periods == 1.0 else f", {periods:g} periods a revolution"
    return f"{shaft}{factor / (analysis.model.period * periods):.6g} {symbol}{more}"


def speed_texts(findings: Iterable[Finding], unit: SpeedUnit, *severities: Severity) -> tuple[str, ...]:
    """The sentences of those `findings` that are of one of the `severities`, the speed of the shaft in a `unit`.

    In a finding the speed is the number `hz`.
    """
    symbol, factor = speed_unit(unit, "speed_texts")
    return tuple(
        str(own).replace(f"{own.numbers['hz']:.6g} Hz", f"{factor * own.numbers['hz']:.6g} {symbol}")
        if "hz" in own.numbers
        else str(own)
        for own in findings
        if own.severity in severities
    )


ENDINGS = {
    "_rpm": "rpm",
    "_m_s": "m/s",
    "_hz": "Hz",
    "_rad_s": "rad/s",
    "_c": "°C",
    "_n": "N",
    "_nm": "N m",
    "_deg": "deg",
}
"""Units by the endings of names."""


def over_unit(name: str) -> tuple[str, str]:
    """Words and unit of a quantity by its `name`: speed and rpm of `speed_rpm`; an empty unit where none is named."""
    for ending, unit in sorted(ENDINGS.items(), key=lambda one: -len(one[0])):
        if name.endswith(ending) and len(name) > len(ending):
            return name[: -len(ending)].replace("_", " "), unit
    return name.replace("_", " "), ""


def over_label(name: str) -> str:
    """Words of a quantity by its `name`, with its unit in brackets."""
    words, unit = over_unit(name)
    return f"{words} [{unit}]" if unit else words


def grows(model: PeriodicModel, mode: int) -> bool:
    r"""True where a `mode` of the `model` grows beyond doubt, or as far as is known.

    .. math:: \Re\lambda > 4\,\sigma_{\Re\lambda}

    Without a deviation, :math:`\Re\lambda > 0`.
    """
    std = 0.0 if model.exponent_std is None else float(model.exponent_std[mode].real)
    return bool(model.exponents[mode].real > DEVIATIONS * (std if np.isfinite(std) else 0.0))


def check_analysis(analysis: Analysis, of: str, *, channel: int | None = None, hit: int = 0) -> None:
    """Refuse an `analysis` that is none, and a `channel` or a `hit` that it has not; `of` is the callable."""
    an_instance(analysis, Analysis, "analysis", of, "Pass what `identify` gives.")
    index(hit, "hit", of, analysis.model.n_hits)
    if channel is not None:
        index(channel, "channel", of, len(analysis.model.channels))


def paired(one: Complexes, other: Complexes) -> Integers:
    """Index in `other` of each mode of `one` (modes of `one`,): each taken once, so that the differences are least."""
    from scipy.optimize import linear_sum_assignment

    off = np.abs(np.subtract.outer(one, other))
    found = np.argmin(off, axis=1)
    rows, columns = linear_sum_assignment(off)
    found[rows] = columns
    return found.astype(np.int64)


def frozen(values: NDArray) -> NDArray:
    """The array, read-only."""
    values.flags.writeable = False
    return values
