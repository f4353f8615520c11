"""Records as commands are given them; `floquid info`: what is in a file; `floquid convert`: to another format."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from floquid._arrays import Floats
from floquid._checks import counted, input_error
from floquid.cli._folder import identified_in
from floquid.cli._options import Choices, Frequency, Header, Names, NewRecordFile, Rate, RecordFile, period_of, split
from floquid.cli._terminal import new_table, progress, terminal
from floquid.core import Record
from floquid.errors import InputError
from floquid.exports import MODE_FORMATS, export_modes
from floquid.io import GUARD, attribute
from floquid.readers import ClockCandidate, FileSummary, describe_file, read, write

OF = "floquid convert"

_OPTIONS = {"pulses": "--tach", "azimuth": "--azimuth"}
"""The option of `identify` that takes a clock, by its kind; a period needs none."""

_MOTIONS = ("displacement", "velocity", "acceleration", "strain")

_DRIVE = re.compile(r"[mkuµ]?[VA]|[mkM]?N[ .·*-]?m")
"""Units of voltages, currents and torques, which drive a system more often than they are its response."""

_DRIVING = re.compile(
    r"(?<![a-z])(inputs?|shaker|excit(?:ation|er)|command|inject(?:ed|ion)|disturbance)(?![a-z])", re.I
)
"""Words in the names of channels that drive a system."""

_TELLS = (
    "A forced response does not tell the period. Use a tachometer (--tach), the shaft angle (--azimuth), or 60 over "
    "the speed in rpm."
)
"""Sources of the period where the response is forced."""

_BLOWS = 12.0  # the range of a force over its deviation from which on it is one of blows: of a random one it is 8 or 10


def check_files(files: Sequence[Path], of: str) -> None:
    """Refuse no record at all, and one record as two: its noise would count as two independent ones."""
    if not files:
        example = f"For example: {of} run.npz --period 0.02"
        raise input_error("FILES", of, "name at least one record", "none was given", example)
    seen: dict[Path, Path] = {}
    for file in files:
        place = file.resolve()
        if place in seen:
            got = f"{seen[place]} is given twice" if file == seen[place] else f"{seen[place]} and {file} are one file"
            remedy = "A record counted twice would halve its variance, and nothing more would be known."
            raise input_error("FILES", of, "name each record once", got, remedy)
        seen[place] = file


def read_records(
    files: Sequence[Path], choices: Choices, of: str, report: Callable[[str], None]
) -> tuple[list[Record], Choices]:
    """The records, and the choices with the names that the channels have from here on."""
    chosen, records = choices.settings, []
    signals = [name for name in (chosen.tach, chosen.azimuth) if name is not None]
    beside = [name for name in (*signals, *chosen.inputs) if name not in (*chosen.channels, *choices.names)]
    named = (*chosen.channels, *beside) if chosen.channels else None
    for file in files:
        report(f"reading {file.name}")
        record = read(
            file, period=chosen.period, rate=choices.rate, channels=named, names=choices.names or None,
            origin=choices.origin, header=choices.header,
        )  # fmt: skip
        if record.clock is None and not signals and not chosen.estimate_period:
            got = f"neither it nor --frequency is, and {file} does not state one"
            free = not chosen.inputs and chosen.excitation == "none"
            remedy = (
                "Give the period [s] (--period 0.02), its frequency [Hz] (--frequency 50), or the channel of a "
                f"tachometer (--tach tach). {'--estimate-period finds it from the response.' if free else _TELLS}"
                f"{_likely(file, choices.rate, choices.header)}"
            )
            raise input_error("--period", of, "be given", got, remedy)
        records.append(record)
    if chosen.channels:  # a path may stand for all rows of a matrix: from here on each has its name
        own = tuple(c.name for c in records[0].channels if c.name not in beside)
        choices = choices.with_given(channels=own, asked=chosen.channels if choices.names else None)
    return records, choices


def _likely(file: Path, rate: float | None, header: bool) -> str:
    """The option for the clock that the file seems to hold, in a sentence; empty if there is none."""
    option = _best_option(describe_file(file, rate=rate, header=header).clock_candidates)
    return f"\n  This file seems to have one: {option}" if option else ""


def info(file: RecordFile, /, *, channels: str | None = None, rate: Rate = None, header: Header = True) -> None:
    """Show what is in a record file: channels, units, rate, candidates for the clock, and what to type next.

    Parameters
    ----------
    file
        The record.
    channels
        The channels to show, comma-separated; all when not given.
    """
    found = describe_file(file, rate=rate, channels=None if channels is None else split(channels), header=header)
    _print_summary(found)
    given = "" if channels is None else f" --channels {shlex.quote(channels)}"
    given += "" if rate is None else f" --rate {rate:.17g}"
    given += "" if header else " --no-header"
    terminal().print(_next_command(found, given), soft_wrap=True)


def _print_summary(found: FileSummary) -> None:
    """Print what is in a file."""
    console = terminal()
    rate = "rate unknown" if found.sample_rate is None else f"{found.sample_rate:.10g} Hz"
    length = "" if found.duration is None else f", {found.duration:.6g} s"
    console.print(
        f"{found.path}: {found.format}, {counted(len(found.channels), 'channel')}, "
        f"{counted(found.n_samples, 'sample')}, {rate}{length}",
        soft_wrap=True,
    )
    table = new_table(["channel", "quantity", "unit"], ["min", "max", "std", "missing"])
    for c in found.channels:
        numbers = [("-" if value is None else f"{value:.4g}") for value in (c.minimum, c.maximum, c.std)]
        table.add_row(c.name, str(c.quantity), c.unit, *numbers, str(c.n_missing) if c.n_missing else "-")
    console.print(table)
    for note in found.notes:
        console.print(f"Note: {note}")
    for candidate in found.clock_candidates:
        option = _option_of(candidate)
        console.print(f"Possible clock: {candidate.name}, {candidate.why}.{f' Use {option}.' if option else ''}")
    if not found.clock_candidates:
        console.print("No candidate for a clock: give the period with --period or --frequency.", style="dim")
    for c in found.channels:
        if c.impacts:
            unit = "" if c.unit == "-" else f" [{c.unit}]"
            console.print(f"{c.name}{unit}: {counted(c.impacts, 'impact')}. Use --find-hits.")
    if why := _driving(found):
        words = "; ".join(f"{name}: {reason}" for name, reason in why.items())
        option = f"--inputs {shlex.quote(','.join(why))}"
        console.print(f"Input candidate{'s' * (len(why) > 1)}: {words} ({option})", soft_wrap=True)


def _option_of(candidate: ClockCandidate) -> str:
    """The option of `identify` that takes this clock, as it is typed."""
    option = _OPTIONS.get(candidate.kind)
    return f"{option} {shlex.quote(candidate.name)}" if option else ""


def _best_option(candidates: tuple[ClockCandidate, ...]) -> str | None:
    """The option for the likeliest clock, empty where the file states a period; None if there is no clock."""
    usable = [candidate for candidate in candidates if candidate.kind != "speed"]
    usable.sort(key=lambda c: (c.kind != "period", not c.is_sure, c.kind != "azimuth"))
    return _option_of(usable[0]) if usable else None


def _driving(found: FileSummary) -> dict[str, str]:
    """Channels that seem to drive the system, and the reason for thinking so."""
    moving = any(c.quantity in _MOTIONS for c in found.channels)
    clocks = [candidate.name for candidate in found.clock_candidates]
    reasons = {}
    for c in found.channels:
        if c.name in clocks or c.quantity in ("pulse", "angle") or c.minimum is None or c.is_constant or c.impacts:
            continue
        if c.quantity == "force":
            reasons[c.name] = "its quantity is force"
        elif named := _DRIVING.search(c.name.replace("_", " ")):
            reasons[c.name] = f"its name has the word {named[0]!r}"
        elif moving and c.quantity == "other" and _DRIVE.fullmatch(c.unit):
            reasons[c.name] = f"its unit is {c.unit}, beside motions"
    return reasons


def _lasting(found: FileSummary) -> list[str]:
    """Forces that act all along: `identify` refuses to take such a response for a free one."""
    return [
        c.name
        for c in found.channels
        if c.quantity == "force" and c.minimum is not None and c.maximum is not None
        if c.std and c.maximum - c.minimum < _BLOWS * c.std
    ]


def _next_command(found: FileSummary, given: str) -> str:
    """The command to type after this one; `given` are the options that were typed."""
    path = shlex.quote(found.path)
    if found.sample_rate is None:
        return f"Next, with the sampling rate [Hz]: floquid info {path}{given} --rate HZ"
    best = _best_option(found.clock_candidates)
    if "--channels" not in given:
        given += _responses(found, best or "")
    if any(c.impacts for c in found.channels):
        given += " --find-hits"
    if lasting := _lasting(found):
        given += f" --inputs {shlex.quote(','.join(lasting))}"
    if best is None and lasting:
        return f"Next, with the period of the system [s]: floquid identify {path}{given} --period S\n  {_TELLS}"
    if best is None:
        return (
            f"Next: floquid identify {path}{given} --estimate-period\n"
            "  This file does not state the period; --estimate-period finds it from a free response. If you know it, "
            "give --period [s] or --frequency [Hz]. For random excitation that nobody measured give the period and "
            "--excitation ambient."
        )
    return f"Next: floquid identify {path}{given}{f' {best}' if best else ''}"


def _responses(found: FileSummary, clock: str) -> str:
    """The option that leaves out voltages and torques beside motions; forces, pulses and angles are left out anyway."""
    moving = [c.name for c in found.channels if c.quantity in _MOTIONS]
    others = [c for c in found.channels if c.quantity == "other" and c.name not in shlex.split(clock)]
    kept = [*moving, *(c.name for c in others if not _DRIVE.fullmatch(c.unit))]
    all_kept = not moving or len(kept) == len(moving) + len(others)
    return "" if all_kept else f" --channels {shlex.quote(','.join(kept))}"


def convert(
    file: RecordFile,
    out: NewRecordFile,
    /,
    *,
    channels: str | None = None,
    names: Names = None,
    rate: Rate = None,
    period: float | None = None,
    frequency: Frequency = None,
    origin: float = 0.0,
    header: Header = True,
) -> None:
    """Write a record in another format, and say what that format could not hold; or the modes of a result.

    Of a result.h5, or of the folder that it is in, the modes are written for other programs: OUT ends in .uff, .unv,
    .mat, .csv or .json then, and there are no options.

    Parameters
    ----------
    file
        The record, or the result.
    out
        The file to write: its suffix chooses the format.
    channels
        The channels to keep, comma-separated, in that order; all when not given.
    period
        The period of the system [s], to be kept with the record.
    origin
        The time of phase zero [s].
    """
    _refuse_same(file, out)
    if file.is_dir() or _is_result(file):
        options = {"channels": channels, "names": names, "rate": rate, "period": period, "frequency": frequency}
        _convert_modes(file, out, options | {"origin": origin or None, "no-header": None if header else True})
        return
    with progress(3) as report:
        report(f"reading {file.name}")
        chosen, called = (None if words is None else split(words) for words in (channels, names))
        period = period_of(period, frequency, OF)
        record = read(file, rate=rate, period=period, channels=chosen, names=called, origin=origin, header=header)
        report(f"writing {out.name}")
        _write(record, out)
        report("reading it back")
        lost = differences(record, read(out))
    console = terminal()
    console.print(
        f"Written to {out}: {counted(record.n_channels, 'channel')}, {counted(record.n_samples, 'sample')} at "
        f"{record.sample_rate:.10g} Hz.",
        soft_wrap=True,
    )
    for words in lost:
        console.print(f"Not kept: {words}.", soft_wrap=True)


def _refuse_same(file: Path, out: Path) -> None:
    with suppress(OSError):
        if out.resolve() == file.resolve() or out.samefile(file):
            got = f"{out} is the file that is read"
            raise input_error("OUT", OF, "be another file", got, "Give the new file a name of its own.")


def _is_result(file: Path) -> bool:
    """True where it is a file that `identify` wrote."""
    if file.suffix.lower() not in (".h5", ".hdf5"):
        return False
    try:
        return GUARD.call(file, _mark, file) == "floquid-result"
    except (OSError, RuntimeError, ValueError, KeyError, TypeError):
        return False  # whatever it is, the reader will say what is wrong with it


def _mark(file: Path) -> str:
    import h5py

    with h5py.File(file, "r") as stored:
        return attribute(stored, "format")


def _write(record: Record, out: Path) -> None:
    try:
        write(record, out)
    except InputError as error:  # the path of `write` is an option elsewhere, and OUT here
        raise InputError(str(error).replace("`path` of `write`", f"`OUT` of `{OF}`")) from None


def differences(record: Record, found: Record) -> list[str]:
    """In words, what of `record` is not in `found`, which was read from the file that it was written to."""
    pairs = {
        "every sample as it was": _same(record.values, found.values),
        f"the rate of {record.sample_rate!r} Hz": record.sample_rate == found.sample_rate,
        f"the start at {record.start!r} s": record.start == found.start,
        "the words on the channels (names, units, places)": record.channels == found.channels,
        "the clock": record.clock == found.clock,
        "the orbit": _same(record.orbit, found.orbit),
    }
    return [words for words, kept in pairs.items() if not kept]


def _same(one: Floats | None, other: Floats | None) -> bool:
    if one is None or other is None:
        return one is other
    return np.array_equal(one, other, equal_nan=True)


def _convert_modes(result: Path, out: Path, options: Mapping[str, object]) -> None:
    """Write the modes of a result, a file or the folder that it is in; `options` are those of records."""
    given = [name for name, value in options.items() if value is not None]
    if given:
        got, remedy = f"{result} is a result of `floquid identify`", "Leave the option out: modes have all of it."
        raise input_error(f"--{given[0]}", OF, "come with a record", got, remedy)
    if out.suffix.lower() not in MODE_FORMATS:
        remedy = f"Use one of {', '.join(MODE_FORMATS)}."
        raise input_error("OUT", OF, "have a suffix that modes can be written to", f"is {out}", remedy)
    with progress(2) as report:
        report("reading the result")
        analysis = identified_in(result, OF)
        report(f"writing {out.name}")
        export_modes(analysis, out)
    model = analysis.model
    modes, harmonics = counted(len(model.upper_modes), "mode"), counted(len(model.harmonics), "harmonic")
    terminal().print(f"Written to {out}: {modes}, of {harmonics}.", soft_wrap=True)
