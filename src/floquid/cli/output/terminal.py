"""Output for a person on the terminal."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from textwrap import fill
from typing import IO, Any

from rich.console import Console
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from floquid._bar import bar
from floquid._json import for_json
from floquid.preparation import for_command


def terminal(*, stderr: bool = False) -> Console:
    """A console that prints names and units as they are, and options as the command has them."""
    return _Terminal(stderr=stderr, markup=False, emoji=False, highlight=False)


def plain(file: IO[str], width: int, *, is_terminal: bool = False) -> Console:
    """A console of this width that prints texts as they are, in a notebook too."""
    return Console(
        file=file,
        width=width,
        markup=False,
        emoji=False,
        highlight=False,
        force_terminal=is_terminal,
        force_jupyter=False,
    )


class _Terminal(Console):
    """A console on which texts name the options of the command, not those of Python."""

    def render_str(self, text: str, **how: Any) -> Text:
        """The text as rich shows it."""
        return super().render_str(for_command(text), **how)


def new_table(left: Sequence[str], right: Sequence[str], after: Sequence[str] = ()) -> Table:
    """A table of columns of words, of numbers, and of words again."""
    table = Table(box=None)
    for name in left:
        table.add_column(name)
    for name in right:
        table.add_column(name, justify="right", no_wrap=True)
    for name in after:
        table.add_column(name)
    return table


def json_text(content: Any) -> str:
    """Output for a program: complex numbers are [real, imaginary], what is not finite is null."""
    return json.dumps(for_json(content), indent=1, allow_nan=False) + "\n"


def print_files(folder: Path | None, names: Sequence[str], kept: str) -> None:
    """Print the place of the files, each name whole, or the option that keeps them."""
    text = f"Written to {folder}/: {', '.join(names)}" if folder else f"Add --out DIR {kept}."
    text = fill(text, terminal().width, break_long_words=False, break_on_hyphens=False)
    terminal().print(text, soft_wrap=True, style=None if folder else "dim")


def print_warnings(console: Console, warnings: Iterable[object]) -> None:
    """Print a line for each warning."""
    for warning in dict.fromkeys(map(str, warnings)):
        console.print(f"Warning: {warning}", style="yellow")


def print_folder(folder: Path | None, *others: str, figures: bool) -> None:
    """Print the place of the result, or the option that keeps it."""
    names = ("report.html", *others, "result.h5", "summary.json", "settings.toml", *(("figures/",) if figures else ()))
    print_files(folder, names, "to keep the result and a report for the browser")


def print_title(console: Console, words: str) -> None:
    """A table's title on a line of its own: it may be wider than the table."""
    console.print()
    console.print(words, style="bold")


def width_of(console: Console, table: Table) -> int:
    """The width of a table that is not cut short, in characters."""
    return Measurement.get(console, console.options.update(max_width=10_000), table).maximum


def print_whole(console: Console, table: Table) -> None:
    """Print a table of numbers that are not to be cut short, however narrow the terminal: first the gaps shrink."""
    if width_of(console, table) > console.width:
        table.padding, table.pad_edge = (0, 1, 0, 0), False
    width = max(console.width, width_of(console, table))
    plain(console.file, width, is_terminal=console.is_terminal).print(table)


def progress(stages: int) -> AbstractContextManager[Callable[[str], None]]:
    """A bar of `stages` steps; each call says what is being done. Without a terminal, a stage is a line on stderr."""
    return bar(True, stages=stages)
