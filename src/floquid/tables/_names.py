"""Names in files: those of columns with their units, of times, of a sampling rate and of the step between samples."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

from floquid._checks import counted, input_error, wrong_value
from floquid.core import Channel
from floquid.errors import InputError
from floquid.io import Source
from floquid.tables._nominal_rate import rate_of_step
from floquid.tables._table import Table, check_distinct
from floquid.tables._time_axis import SECONDS

_TIME_NAME = re.compile(
    r"(?:elapsed |relative )?(t|times?|time[ _]?stamps?|x_value|zeit|temps|tiempo)(?:[ _.-](\w+))?", re.IGNORECASE
)
_OTHER_UNITS = {"-", "%", "°", "Hz", "rpm", "RPM", "V", "mV", "uV", "A", "mA"}
_OTHER_UNITS |= {"Pa", "kPa", "MPa", "bar", "Nm", "N.m", "N m"}


def name_and_unit(cell: str) -> tuple[str, str | None]:
    """The name and the unit in a `cell`: «x [m]», or «x (m)» where m is a unit and no remark; None without a unit."""
    match = re.fullmatch(r"(.*?)\s*\[([^\[\]]*)\]", cell)
    if match:
        return match[1], match[2].strip()
    match = re.fullmatch(r"(.*?)\s*\(([^()]*)\)", cell)
    if match and (_is_unit(match[2].strip()) or (_TIME_NAME.fullmatch(match[1]) and match[2].lower() in SECONDS)):
        return match[1], match[2].strip()
    return cell, None


def _is_unit(text: str) -> bool:
    return text in _OTHER_UNITS or text in SECONDS or (text != "" and Channel(name="x", unit=text).quantity != "other")


def find_time(source: Source, parts: Sequence[tuple[str, str | None]]) -> tuple[int | None, float | None]:
    """The first column of a `source` that is a time, and its unit in seconds; of `parts`, a name and a unit each.

    A time by its name, or the very first column by its unit. None stands for no such column, and for no unit.
    """
    for column, (name, unit) in enumerate(parts):
        known = SECONDS.get(unit or "")
        if column == 0 and known is not None:
            return column, known
        if name.lower() in SECONDS and len(name) > 1 and unit is None:  # a column headed «ms»
            return column, SECONDS[name.lower()]
        match = _TIME_NAME.fullmatch(name)
        if match is None or (match[2] is not None and match[2].lower() not in SECONDS):
            continue
        if unit in (None, "", "-"):
            return column, SECONDS[match[2].lower()] if match[2] else None
        known = SECONDS.get(unit.lower())  # `Time(S)`
        if known is not None:
            return column, known
        if len(match[1]) > 1:
            must, remedy = "have its times in one of s, ms, us, ns, min, h", "Export the times as numbers in seconds."
            raise source.error(must, f"has column {column + 1}, {name!r}, in {unit!r}", remedy)
    return None, None


_RATES = frozenset([
    "fs", "fsamp", "fsample", "samplefreq", "samplefrequency", "samplerate", "samplesperchannelpersecond",
    "samplespersecond", "samplingfreq", "samplingfrequency", "samplingrate", "sfreq", "srate",
])  # fmt: skip
_STEPS = frozenset([
    "deltat", "deltax", "dt", "increment", "sampleinterval", "sampleperiod", "samplestep", "sampletime",
    "samplinginterval", "samplingperiod", "samplingstep", "samplingtime", "timedelta", "timeincrement",
    "timeinterval", "timestep", "tinc", "tincrement", "tinterval", "ts", "tsample", "tstep", "wfincrement", "xdelta",
    "xinc", "xincrement", "xinterval",
])  # fmt: skip
_HERTZ = {"hz": 1.0, "khz": 1e3, "mhz": 1e6, "s/s": 1.0, "sa/s": 1.0, "1/s": 1.0}


def _parts(name: str) -> tuple[str, str]:
    """The letters of a `name` in lower case, and the unit at its end; "" without one."""
    found = re.fullmatch(r"(.*?)[\s_]*[\[(]([^\[\]()]*)[\])]\s*:?", name)
    if found is None:  # `fs_Hz`, `dt_ms`
        known = "|".join([*_HERTZ, *SECONDS])
        found = re.fullmatch(rf"(.*\w)[\s_.-]+({known})", name, re.IGNORECASE)
    text, unit = (found[1], found[2].strip()) if found else (name, "")
    return re.sub(r"[\s_.-]", "", text.lower().removesuffix(":")), unit


def says_rate(name: str) -> Literal["rate", "step"] | None:
    """Tell whether a number called `name` is a sampling rate or the step between samples; None where it is neither.

    Case, blanks and underscores do not count, nor a unit at the end or `Time` at the beginning: `Fs`, `SampleRate`,
    `Time_Sample_Rate`, `Sampling rate [kHz]`, `dt_ms`.
    """
    for letters in ((text := _parts(name)[0]), text.removeprefix("time")):
        if letters in _RATES:
            return "rate"
        if letters in _STEPS:
            return "step"
    return None


def rate_stated(name: str, value: float, unit: str | None = None) -> float | None:
    """The sampling rate [Hz] that a positive `value` called `name` states; None of other names.

    The `unit` is that of the name where none is given, and otherwise Hz or s. One of another kind gives None.
    """
    kind = says_rate(name)
    unit = (unit or _parts(name)[1]).strip("[]() ").lower()
    scale = (_HERTZ if kind == "rate" else SECONDS).get(unit, None if unit not in ("", "-") else 1.0)
    if kind is None or scale is None:
        return None
    return value * scale if kind == "rate" else rate_of_step(value * scale)


def numbered(names: Sequence[str]) -> list[str]:
    """The `names` of columns, those that come again with their number: x, x_2, x_3."""
    found: list[str] = []
    for name in names:
        number, new = 1, name
        while new in found:
            number += 1
            new = f"{name}_{number}"
        found.append(new)
    return found


def with_names(table: Table, names: Sequence[str], source: Source) -> Table:
    """The `table` of a `source`, its first channels renamed: to the `names`, or to the labels that one names."""
    if isinstance(names, str) or not names or not all(isinstance(name, str) for name in names):
        raise wrong_value("names", source.of, "be a list of names, at least one", names)
    chosen = table.labels[names[0]] if len(names) == 1 and names[0] in table.labels else names
    count = len(table.channels)
    if len(chosen) > count:
        listing = f" Texts in the file: {', '.join(table.labels)}." if table.labels else ""
        got = f"are {len(chosen)} for {counted(count, 'channel')} of {source.name}"
        raise input_error("names", source.of, "be as many as the channels", got, f"Leave some out.{listing}")
    channels = []
    for channel, name in zip(table.channels, chosen, strict=False):
        is_plain = Channel(name=channel.name, unit=channel.unit).quantity == channel.quantity
        try:
            channels.append(replace(channel, name=name, quantity=None if is_plain else channel.quantity))
        except InputError as error:
            raise source.wrapped(error) from None
    channels += table.channels[len(channels) :]
    check_distinct(source, [channel.name for channel in channels])
    return replace(table, channels=tuple(channels))
