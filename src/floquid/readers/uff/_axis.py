"""The time axis that the functions of a universal file share, and the rate behind a step printed to six digits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from floquid._checks import counted
from floquid.errors import InputError
from floquid.io import Source
from floquid.readers.uff._channels import OwnLines
from floquid.readers.uff._datasets import FunctionHeader
from floquid.tables import SECONDS, Printed, nominal_rate_of_step

_TIME_KINDS = (0, 1, 17)  # specific data types of an abscissa that may be a time: unknown, general, time

_OVERRIDE = "Pass `rate=` [Hz] to say what it is."
_SEEN = 0.005  # samples of drift over the record from which a message says so


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """Time axis of the headers: rate [Hz] (None for times), start [s], how it was found; `scale`, the unit [s]."""

    sample_rate: float | None
    rate_note: str | None
    start: float
    scale: float
    notes: tuple[str, ...]


def shared_axis(
    source: Source,
    headers: Sequence[FunctionHeader],
    own: Sequence[OwnLines | None],
    names: Sequence[str],
    *,
    ignore_time: bool,
) -> Axis:
    """The axis of all functions named."""
    _check_alike(source, headers, own, names)
    header, name = headers[0], names[0]
    scale = SECONDS.get(header.abscissa.unit.strip("[]()- ").lower() or "s")
    if header.abscissa.kind not in _TIME_KINDS or (scale is None and not ignore_time):
        unit = f" in {header.abscissa.unit!r}" if header.abscissa.unit else ""
        must = "have times in seconds for its abscissas (specific data type 17)"
        remedy = "Export the time histories, in seconds; or pass `rate=` [Hz] if only the unit's name is unknown."
        raise source.error(must, f"has the type {header.abscissa.kind}{unit} for {name!r}", remedy)
    scale = scale or 1.0
    start, step = (
        replace(number, value=number.value * scale, quantum=number.quantum * scale)
        for number in (header.start, header.step)
    )
    if not header.is_even:
        note = ("The times in the file were ignored.",) if ignore_time else ()
        return Axis(sample_rate=None, rate_note=None, start=0.0, scale=scale, notes=note)
    if step.value <= 0.0 or not 1.0 / step.value < float("inf"):
        if not ignore_time:
            raise source.error("have a positive step of time", f"has {step.text} s for {name!r}", _OVERRIDE)
        return Axis(sample_rate=None, rate_note=None, start=start.value, scale=scale, notes=())
    stated = next((lines for lines in own if lines is not None), None)
    if stated is not None and _agree(stated, start, step):
        rate = f"Sampling rate {stated.sample_rate:.12g} Hz: as ID line 2 states; the header's {step.text} s agrees."
        return Axis(sample_rate=stated.sample_rate, rate_note=rate, start=stated.start, scale=scale, notes=())
    if stated is not None and not ignore_time:
        raise source.error(
            "have an ID line 2 that agrees with its header",
            f"states {stated.sample_rate:.12g} Hz and {stated.start:.12g} s there, and a step of {step.text} s from "
            f"{start.text} s in the header of {name!r}",
            "The samples were changed since, or one of the two. " + _OVERRIDE,
        )
    rate, note = _rate_of(step, header.n_points)
    return Axis(sample_rate=rate, rate_note=note, start=start.value, scale=scale, notes=_start_notes(start, step))


def _agree(stated: OwnLines, start: Printed, step: Printed) -> bool:
    """True where exact numbers are printed as those of the header."""
    off = abs(1.0 / stated.sample_rate - step.value), abs(stated.start - start.value)
    return off[0] <= 0.6 * step.quantum and off[1] <= 0.6 * start.quantum


def _rate_of(step: Printed, n_points: int) -> tuple[float, str]:
    """The rate that a printed step means, and the sentence on how it was found.

    As in 1.95313e-05 s, which is 51200 Hz: one over it would drift by 79 samples in 600 s.
    """
    nominal = nominal_rate_of_step(step)
    rate = 1.0 / step.value if nominal is None else nominal
    if nominal is not None:
        drift = abs(nominal * step.value - 1.0) * n_points
        loss = f"and would drift by {drift:.3g} samples over the record" if drift > _SEEN else "and agrees"
        few = float(f"{nominal:.7g}") == nominal
        why = "nominal" if few else f"a nominal step of {1.0 / nominal:.6g} s"
        return rate, (
            f"Sampling rate {rate:.12g} Hz: {why}; the header's {step.text} s is rounded to "
            f"{counted(step.digits, 'digit')}, {loss}. `rate=` overrides it."
        )
    drift = 0.5 * step.quantum / step.value * n_points
    if drift <= _SEEN:
        return rate, f"Sampling rate {rate:.12g} Hz: one over the header's {step.text} s."
    return rate, (
        f"Sampling rate {rate:.12g} Hz: one over the header's {step.text} s, known to "
        f"{counted(step.digits, 'digit')} only. The true one may drift by up to {drift:.3g} samples over the record. "
        "No round rate is clearly meant; `rate=` overrides it."
    )


def _start_notes(start: Printed, step: Printed) -> tuple[str, ...]:
    if start.value == 0.0 or 0.5 * start.quantum <= 0.01 * step.value:
        return ()
    known = f"to {counted(start.digits, 'digit')} only, or {0.5 * start.quantum / step.value:.3g} samples"
    return (f"The start {start.text} s is known {known}: so is the phase at it.",)


def _check_alike(
    source: Source, headers: Sequence[FunctionHeader], own: Sequence[OwnLines | None], names: Sequence[str]
) -> None:
    """Check that all headers agree, and our ID lines where there are such."""
    facts = [_facts(header) for header in headers]
    for row, words in enumerate(facts):
        if words != facts[0]:
            raise _differ(source, names, facts, 0, row)
    stated = [_stated(lines) if lines else "" for lines in own]
    first = next((row for row, words in enumerate(stated) if words), 0)
    for row, words in enumerate(stated):
        if words not in ("", stated[first]):
            raise _differ(source, names, stated, first, row)


def _stated(own: OwnLines) -> str:
    clock = "no period" if own.period is None else f"a period of {own.period!r} s from {own.origin!r} s"
    return f"{own.sample_rate!r} Hz from {own.start!r} s and {clock} in its ID lines"


def _facts(header: FunctionHeader) -> str:
    steps = f"of {header.step.value!r} from {header.start.value!r}" if header.is_even else "at uneven times"
    return f"{header.n_points} points {steps} {header.abscissa.unit}".rstrip()


def _differ(source: Source, names: Sequence[str], facts: Sequence[str], one: int, other: int) -> InputError:
    groups: dict[str, list[str]] = {}
    for name, words in zip(names, facts, strict=True):
        groups.setdefault(words, []).append(name)
    listing = " | ".join(", ".join(group[:12]) + (", ..." if len(group) > 12 else "") for group in groups.values())
    must = "hold channels of one step, start, length and period"
    got = f"has {names[one]!r} with {facts[one]} and {names[other]!r} with {facts[other]}"
    return source.error(must, got, f"Choose channels that go together with `channels=`: {listing}.")
