"""The speed of the shaft in the unit that the reader asks for; frequencies of vibration are always in Hz."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal, TypeAlias

from floquid._checks import describe, input_error
from floquid.findings import Finding, Severity
from floquid.pipeline import Analysis

SpeedUnit: TypeAlias = Literal["hz", "rpm"]

UNITS = {"hz": ("Hz", 1.0), "rpm": ("rpm", 60.0)}


def speed_unit(unit: object, of: str) -> tuple[str, float]:
    """The symbol of a `unit` of speed, and how many of it are a revolution a second.

    Raises InputError in the name of the callable `of` where it is none.
    """
    if not isinstance(unit, str) or unit not in UNITS:
        raise input_error("speed_unit", of, 'be "hz" or "rpm"', f"is {describe(unit)}")
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
