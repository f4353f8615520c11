"""`floquid shapes`: whirl, names of patterns over blades, and shares of lines, of the modes of a saved result."""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass, fields
from fractions import Fraction
from math import pi
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter

from floquid._checks import wrong_value
from floquid._json import attributes
from floquid.cli.arguments.shared import Format, Saved, split
from floquid.cli.output.folder import modes_in
from floquid.cli.output.terminal import json_text, new_table, print_title, print_whole, terminal
from floquid.errors import InputError
from floquid.exports import columns_text, path_columns
from floquid.io import as_path, atomic_path
from floquid.shapes import (
    BladePattern,
    ModeReading,
    Participation,
    PathShapes,
    ShapeOptions,
    ShapeReadings,
    Whirl,
    Words,
    path_shapes,
)
from floquid.views import with_error

OF = "floquid shapes"

SHAPES = "Shapes"


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class ShapeChoices:
    """Options by which shapes are read.

    Parameters
    ----------
    pairs
        Pairs of channels at right angles in a plane, x:y,x2:y2; from x to y is the sense of rotation.
    blades
        A group of channels, one a blade, flap=b1,b2,b3; may be given several times. Each blade is ahead of the one
        before, in the sense of rotation.
    fixed
        Channels in the fixed frame that count beside the blades, comma-separated.
    scale
        What makes a group or a fixed channel a length that can be compared with the others, fa=1/60; may be given
        several times.
    words
        Words for directions: en has forward and backward, openfast progressive and regressive, hawc FW and BW.
    """

    pairs: Annotated[str | None, Parameter(group=SHAPES)] = None
    blades: Annotated[list[str] | None, Parameter(negative=(), group=SHAPES)] = None
    fixed: Annotated[str | None, Parameter(group=SHAPES)] = None
    scale: Annotated[list[str] | None, Parameter(negative=(), group=SHAPES)] = None
    words: Annotated[Words, Parameter(group=SHAPES)] = "en"

    def options(self, of: str) -> ShapeOptions:
        """The options as `read_shapes` takes them; InputError of the command `of` where a scale is no number."""
        return ShapeOptions(
            pairs=(self.pairs,) if self.pairs else (),
            blades=tuple(self.blades or ()),
            fixed=split(self.fixed or ""),
            scales=scales_of(self.scale or (), of),
            words=self.words,
        )


def shapes(
    result: Saved,
    /,
    *,
    read: ShapeChoices | None = None,
    participation: str | None = None,
    path: Path | None = None,
    format: Format = "text",  # noqa: A002
) -> None:
    """Read the shapes of a saved result: whirl of modes, their names by patterns over blades, shares of their lines.

    Or, with --path, those of a structure over the path of a sensor that runs over it to and fro.

    Parameters
    ----------
    result
        The saved result.
    read
        How shapes are read. Without pairs and blades, groups of blades are those that names tell.
    participation
        A channel whose lines are shared out.
    path
        A .csv file to write: shapes over the path of a scanning sensor, a row a position, each mode on the branch on
        which its shape is the same on the way there and back.
    format
        text prints a table; json prints all, the table of each pattern too.
    """
    if path is not None:
        _print_path(path_shapes(modes_in(result, OF).model), path, format)
        return
    identified = modes_in(result, OF)
    asked = (read or ShapeChoices()).options(OF)
    try:
        found = asked.read(identified, participation=participation)
    except InputError as error:
        message = str(error).replace("`scales`", "`scale`")
        raise InputError(re.sub(r"Argument `(\w+)` of `read_shapes`", r"`--\1`", message)) from None
    if format == "json":
        sys.stdout.write(json_text(content(found)))
        return
    _print(found)


def _print_path(found: PathShapes, path: Path, format: Format) -> None:  # noqa: A002
    """Write shapes over the path to a file at `path`, and print the poles."""
    with atomic_path(as_path(path, of=OF), of=OF) as temporary:
        temporary.write_text(columns_text(path_columns(found)), encoding="utf-8")
    if format == "json":
        own = {field.name: getattr(found, field.name) for field in fields(found) if field.name != "channels"}
        sys.stdout.write(json_text({"format": "floquid-path/1", **own, "channels": [c.name for c in found.channels]}))
        return
    console, std = terminal(), found.exponent_std
    table = new_table([""], ["f [Hz]", "Re λ [1/s]", "Im λ [rad/s]"])
    for mode, exponent in enumerate(found.exponents.tolist()):
        error = 0.0j if std is None else complex(std[mode])
        parts = with_error(exponent.real, error.real), with_error(exponent.imag, error.imag)
        table.add_row(str(mode + 1), f"{abs(exponent) / (2.0 * pi):.6g}", *parts)
    print_whole(console, table)
    console.print(f"The path is x = cos(ωt + φ), φ = {found.phase:.4g} rad after phase zero; -x with φ + π is as good.")
    console.print(f"Wrote {path}: the shapes over x.")


def scales_of(words: Sequence[str], of: str) -> dict[str, float]:
    """Scales by names, numbers or fractions, of the command `of`."""
    found = {}
    for word in words:
        name, _, number = word.partition("=")
        try:
            found[name.strip()] = float(Fraction(number.strip()))
        except (ValueError, ZeroDivisionError):
            raise wrong_value("--scale", of, "be NAME=NUMBER", word, "For example: --scale fa=1/60") from None
    return found


def _print(found: ShapeReadings) -> None:
    """Print the table of readings."""
    console = terminal()
    first = found.modes[0] if found.modes else None
    whirls = first is not None and first.whirl is not None
    patterns = first is not None and first.blades is not None
    words = (["whirl"] if whirls else []) + (["name", "largest shares"] if patterns else [])
    numbers = ["f [Hz]", *(["index"] if whirls else []), *(["leak"] if patterns else [])]
    table = new_table([""], numbers, words)
    for one in found.modes:
        cells, texts = [f"{one.frequency / (2.0 * pi):.5g}"], []
        if one.whirl is not None:
            cells.append(_within(one.whirl.index, one.whirl.interval))
            axis = "" if one.whirl.axis is None else f" at {one.whirl.axis * 180.0 / pi:.0f}°"
            texts.append(one.whirl.word + axis)
        if one.blades is not None:
            cells.append(_within(one.blades.leak, one.blades.leak_interval))
            texts += [_name(one), ", ".join(f"{share.name} {share.share:.2f}" for share in one.blades.shares[:2])]
        table.add_row(str(one.number), *cells, *texts)
    print_whole(console, table)
    if whirls:
        meaning = "index: 1 for a forward circle, 0 for a straight line, -1 for a backward circle; with 95 % interval."
        console.print(meaning, style="dim")
    console.print("f: that of the line in the spectrum, |Im λ|/2π; `floquid identify` has |λ|/2π.", style="dim")
    if patterns:
        meaning = "leak: the share of motion off one line in the fixed frame, its 95 % interval; 0 of equal blades."
        console.print(meaning, style="dim")
    for one in found.modes:
        if one.participation is not None:
            _print_participation(one, one.participation, 2.0 * pi / found.period)
    for sentence in found.warnings:
        console.print(sentence, style="yellow")


def _within(value: float, interval: tuple[float, float] | None) -> str:
    """A number with its interval, to thousandths."""
    return f"{value:.3f}" + ("" if interval is None else f" ({interval[0]:.3f} to {interval[1]:.3f})")


def _name(one: ModeReading) -> str:
    """The name of a mode, and a word on why there is none."""
    locked = "" if one.couple is None else " (locked)"
    return ("weak" if one.is_weak and one.name is None else one.name or "-") + locked


def _print_participation(one: ModeReading, shared: Participation, fundamental: float) -> None:
    """Print the shares of the lines of a mode above a hundredth."""
    console = terminal()
    print_title(console, f"Mode {one.number}, lines of {shared.channel}")
    table = new_table(["m"], ["f [Hz]", "share"])
    for line, share in enumerate(shared.shares.tolist()):
        if share > 0.01:
            std = 0.0 if shared.std is None else float(shared.std[line])
            frequency = abs(one.exponent.imag + shared.harmonics[line] * fundamental) / (2.0 * pi)
            table.add_row(f"{shared.harmonics[line]:+d}", f"{frequency:.5g}", with_error(share, std))
    console.print(table)


def content(found: ShapeReadings) -> dict[str, Any]:
    """The content of `--format json`."""
    return {
        "format": "floquid-shapes/1",
        **attributes(found, "period", "harmonics"),
        "point": dict(found.point),
        "modes": [
            {
                "mode": one.number,
                "exponent": np.complex128(one.exponent),
                "frequency_rad_s": one.frequency,
                "name": one.name,
                "weak": one.is_weak,
                "locked": one.couple is not None,
                "whirl": None if one.whirl is None else _whirl(one.whirl),
                "blades": None if one.blades is None else _blades(one.blades),
                "participation": None
                if one.participation is None
                else attributes(one.participation, "channel", "shares", "std"),
            }
            for one in found.modes
        ],
        "warnings": list(found.warnings),
    }


def _whirl(whirl: Whirl) -> dict[str, Any]:
    return attributes(whirl, "index", "std", "interval", "strongest", "by_pair", "word") | {"axis_rad": whirl.axis}


def _blades(pattern: BladePattern) -> dict[str, Any]:
    return {
        **attributes(pattern, "branch", "leak", "leak_std", "leak_interval"),
        "compared": pattern.is_compared,
        "shares": [attributes(share, "family", "wave", "word", "share", "std") for share in pattern.shares],
        "tables": {name: {"waves": pattern.waves[name], "values": values} for name, values in pattern.tables.items()},
    }
