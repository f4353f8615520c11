"""Names by which files call a sampling rate or a sampling step, and the rate that such a number states."""

from __future__ import annotations

import re
from typing import Literal

from floquid.tables._nominal_rate import rate_of_step
from floquid.tables._time_axis import SECONDS

_RATES = frozenset([
    "fs", "fsamp", "fsample", "samplefreq", "samplefrequency", "samplerate", "samplesperchannelpersecond",
    "samplespersecond", "samplingfreq", "samplingfrequency", "samplingrate", "sfreq", "srate",
])  # fmt: skip
_STEPS = frozenset([
    "deltat", "dt", "increment", "sampleinterval", "sampleperiod", "samplestep", "sampletime", "samplinginterval",
    "samplingperiod", "samplingstep", "samplingtime", "tinc", "tincrement", "tinterval", "timedelta", "timeincrement",
    "timeinterval", "timestep", "ts", "tsample", "tstep", "wfincrement", "xdelta", "xinc", "xincrement", "xinterval",
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
