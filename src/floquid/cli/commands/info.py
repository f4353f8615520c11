"""`floquid info`: what is in a file, what its channels may be used for, and the command to type next."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from floquid._checks import counted
from floquid.cli._errors import in_options
from floquid.cli.arguments.shared import TELLS, Format, Header, Names, Rate, RecordFile, is_saved, options, split
from floquid.cli.output.terminal import json_text, new_table, terminal
from floquid.core import Record
from floquid.preparation import Candidate, Proposal, propose
from floquid.readers import FileSummary, read_and_describe

PERIODS = (
    "Where the system repeats more often than its shaft turns, add --periods-per-rev: 2 of an asymmetric shaft seen "
    "from the ground, 3 of three equal blades."
)
"""Words on the option that goes with every clock that counts revolutions."""

WHAT = {
    "analysis": "a result of `floquid identify`",
    "measured": "transfer functions of `floquid transfer`",
    "fitted": "modes fitted to transfer functions by `floquid transfer`",
    "survey": "a survey of `floquid survey`",
    "comparison": "a comparison of `floquid compare`",
    "update": "a model with parameters fitted to results",
    "monitor": "a monitor of `floquid monitor`",
}
"""Words for results, by their kinds."""

MAINS = (50.0, 60.0, 400.0, 50.0 / 3.0)
"""Frequencies of grids [Hz]: Europe and Asia, the Americas, aircraft, railways."""


def info(
    file: RecordFile,
    /,
    *,
    channels: str | None = None,
    names: Names = None,
    rate: Rate = None,
    header: Header = True,
    format: Format = "text",  # noqa: A002
) -> None:
    """Show what is in a record file: channels, units, rate, candidates for clock, hits and inputs, what to type next.

    Of a result.h5, or of the folder that it is in: what was found, and the commands that go on from there.

    Parameters
    ----------
    file
        The record, or a result.
    channels
        The channels to show, comma-separated; all when not given.
    format
        text prints a table; json prints the same for a program.
    """
    if is_saved([file]):
        _print_result(file, format)
        return
    named, called = (None if words is None else split(words) for words in (channels, names))
    found, record = read_and_describe(file, rate=rate, channels=named, names=called, header=header)
    with np.errstate(all="ignore"):  # damage; what comes of it is no number and proposes nothing
        proposal = Proposal(candidates=(), settings={}) if record is None else propose(record, found.clock_candidates)
        given = "" if channels is None else f" --channels {shlex.quote(channels)}"
        given += "" if names is None else f" --names {shlex.quote(names)}"
        given += "" if rate is None else f" --rate {rate:.17g}"
        following = _next(found, record, proposal, given + ("" if header else " --no-header"))
    if format == "json":
        sys.stdout.write(json_text(_content(found, proposal, following)))
        return
    _print_summary(found, proposal)
    lines = [f"{following['words']}: {following['command']}", *(f"  {line}" for line in following["hints"])]
    terminal().print("\n".join(lines), soft_wrap=True)


def _print_result(file: Path, format: Format) -> None:  # noqa: A002
    """Print what a result is, and the commands that start from it."""
    from floquid.cli.output.folder import result_file
    from floquid.store import load

    found: Any = load(result_file(file))
    words, whole = WHAT.get(found.kind, "what was found of several results"), found.kind == "analysis"
    if whole:
        verdict = {True: "; it passes", False: "; it fails", None: ""}[found.passed]
        counts = counted(len(found.model.upper_modes), "mode"), counted(len(found.model.channels), "channel")
        words += f", {counts[0]} of {counts[1]}"
        words += f", period {found.model.period:.8g} s{verdict}"
    path = shlex.quote(str(file))
    lines = found.kind in ("measured", "fitted")
    following = [f"floquid transfer --lines {path} --method fit" if lines else f"floquid report {path}"]
    if whole:
        following.append(f"floquid convert {path} modes.csv")
    if format == "json":
        next_command = {"command": following[0], "complete": True, "hints": following[1:]}
        content = {"format": "floquid-info/1", "path": str(file), "file_format": words, "next": next_command}
        sys.stdout.write(json_text(content))
        return
    told = [f"{file}: {words}.", f"Next: {following[0]}", *(f"  or {command}" for command in following[1:])]
    terminal().print("\n".join(told), soft_wrap=True)


def _print_summary(found: FileSummary, proposal: Proposal) -> None:
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
    if found.point:
        words = ", ".join(f"{name} = {value:.6g}" for name, value in found.point.items())
        console.print(f"Operating point: {words}.", soft_wrap=True)
    understood = [c for c in found.channels if "=" in c.place.partition("axis")[0]]  # an axis alone is the name's
    if places := [f"{c.name} ({c.place.replace('=', ' ').replace(';', ',')})" for c in understood]:
        console.print(f"Places of channels: {'; '.join(places)}.", soft_wrap=True)
    for note in found.notes:
        console.print(f"Note: {in_options(note)}")
    clocks = proposal.of_use("clock")
    for own in (*clocks, *proposal.of_use("none"), *_unread(found, proposal)):
        use = f" Use {options(own.settings)}." if own.settings and own.use == "clock" else ""
        console.print(f"Possible clock: {own.name}, {own.why.rstrip('.')}.{use}")
    for words in _of_shaft(proposal):
        console.print(words)
    if not clocks:
        console.print("No candidate for a clock: give the period with --period or --frequency.", style="dim")
    units = {c.name: "" if c.unit == "-" else f" [{c.unit}]" for c in found.channels}
    for own in proposal.of_use("hits"):
        impacts = counted(own.impacts, "impact")
        console.print(f"{own.name}{units[own.name]}: {impacts}. Use --find-hits. It {own.why}.")
    if driving := proposal.of_use("input"):
        words = "; ".join(f"{own.name}: {own.why}" for own in driving)
        option = f"--inputs {shlex.quote(','.join(own.name for own in driving))}"
        console.print(f"Input candidate{'s' * (len(driving) > 1)}: {words} ({option})", soft_wrap=True)
    for own in proposal.of_use("excitation"):
        console.print(f"Excitation: {own.why}. Use {options(own.settings)}.")


def _of_shaft(proposal: Proposal) -> list[str]:
    """Words on the periods in a revolution where a shaft may be the clock."""
    shafts = any(own.settings.keys() & {"tach", "azimuth"} for own in proposal.of_use("clock"))
    return [PERIODS] if shafts else []


def _unread(found: FileSummary, proposal: Proposal) -> list[Candidate]:
    """Candidates for the clock of a file without a rate: nothing could be read from them."""
    if proposal.candidates or found.sample_rate is not None:
        return []
    return [Candidate(name=own.name, use="clock", why=own.why) for own in found.clock_candidates]


def _next(found: FileSummary, record: Record | None, proposal: Proposal, given: str) -> dict[str, Any]:
    """The command to type after this one with the options `given`, words before it, and hints below it."""
    path = shlex.quote(found.path)
    if record is None and found.sample_rate is None:
        if "--" not in given and (alone := _alone(found)):
            command = f"floquid info {path} --channels {shlex.quote(alone)}"
            return {"words": "Next", "command": command, "hints": [], "complete": True}
        words = "Next, with the sampling rate [Hz]"
        return {"words": words, "command": f"floquid info {path}{given} --rate HZ", "hints": [], "complete": False}
    settings = {
        name: value for name, value in proposal.settings.items() if not ("--channels" in given and name == "channels")
    }
    more, hints, complete = "", [], True
    if proposal.clock is None:
        driven = settings.get("inputs") or settings.get("excitation")
        frequency = None if record is None else _grid(record, settings)
        speed = 0.0 if record is None else record.point.get("speed_rpm", 0.0)
        if speed > 0.0:
            more = f" --period {60.0 / speed:.10g}"
            hints.append(
                f"That is a revolution at speed_rpm = {speed:g}. Halve it where the system repeats twice in one, as an "
                "unequal shaft does."
            )
        elif frequency is not None:
            more = f" --frequency {frequency:.6g}"
            hints.append(f"The strongest line is that of a grid at {frequency:.6g} Hz: it is taken for the period.")
        elif driven:
            more, complete = " --period S", False
            hints += [TELLS, *_of_the_field(found)]
        else:
            more = " --estimate-period"
            hints.append(
                "This file does not state the period; --estimate-period finds it from a free response. If you know it, "
                "give --period [s] or --frequency [Hz]. For random excitation that nobody measured give the period and "
                "--excitation ambient."
            )
            hints += _of_the_field(found)
    typed = options(settings)
    command = f"floquid identify {path}{given}{f' {typed}' if typed else ''}{more}"
    words = "Next" if complete else "Next, with the period of the system [s]"
    return {"words": words, "command": command, "hints": hints, "complete": complete}


def _of_the_field(found: FileSummary) -> list[str]:
    """Words on the period in the terms of the file's field; none where its channels say nothing."""
    if found.format.endswith((".out)", ".outb)")):
        return [
            "Of OpenFAST: add Azimuth to the OutList of ElastoDyn and use --azimuth Azimuth, or --period 60/RotSpeed."
        ]
    quantities = {c.quantity for c in found.channels}
    if _is_electric(c.unit for c in found.channels if c.quantity not in ("pulse", "angle")):
        return ["Of a converter or machine: give the frequency of the grid or of the modulation, as --frequency 50."]
    if quantities & {"acceleration", "velocity", "strain"} or {c.unit for c in found.channels} & {
        "m",
        "mm",
        "um",
        "µm",
    }:
        return ["Of a rotor: --period is 60 over the speed in rpm, as 0.04 of 1500 rpm; or record a tachometer too."]
    return []


def _is_electric(units: Any) -> bool:
    """True where all units are of voltages, currents and powers."""
    known = {f"{prefix}{unit}" for prefix in ("", "m", "k", "M") for unit in ("V", "A", "W", "VA", "var")}
    own = set(units)
    return bool(own) and own <= known


def _grid(record: Record, settings: Mapping[str, Any]) -> float | None:
    """The frequency of the grid [Hz] where voltages and currents have their strongest line at it."""
    rows = [row for row, c in enumerate(record.channels) if c.quantity == "other" and c.name not in settings]
    if not rows or not _is_electric(record.channels[row].unit for row in rows):
        return None
    values = np.nan_to_num(record.values[rows] - np.nanmean(record.values[rows], axis=1, keepdims=True))
    size = np.sqrt(np.mean(values**2, axis=1, keepdims=True))
    lines = np.abs(np.fft.rfft(values / np.where(size > 0.0, size, 1.0) * np.hanning(values.shape[1]), axis=1)) ** 2
    strongest = float(lines.sum(axis=0).argmax()) / record.duration
    return next((own for own in MAINS if abs(own - strongest) * record.duration <= 1.0), None)


def _alone(found: FileSummary) -> str | None:
    """The first channel of a file whose channels are not sampled together, if it is read alone."""
    if len(found.channels) < 2:
        return None
    name = found.channels[0].name
    summary, _ = read_and_describe(Path(found.path), channels=[name])
    return None if summary.sample_rate is None else name


def _content(found: FileSummary, proposal: Proposal, following: Mapping[str, Any]) -> dict[str, Any]:
    """The content of `--format json`."""
    summary = {name: value for name, value in asdict(found).items() if name != "clock_candidates"}
    candidates = [*proposal.candidates, *_unread(found, proposal)]
    return {
        "format": "floquid-info/1",
        "path": summary.pop("path"),
        "file_format": summary.pop("format"),
        **summary,
        **{name: list(map(in_options, getattr(found, name))) for name in ("notes", "time_axis")},
        "candidates": [asdict(own) | {"options": options(own.settings)} for own in candidates],
        "next": {
            **{name: following[name] for name in ("command", "complete")},
            "hints": [*_of_shaft(proposal), *following["hints"]],
        },
        "settings": proposal.settings,
    }
