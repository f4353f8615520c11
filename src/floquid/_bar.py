"""A progress bar for work that takes long; a line a stage where nobody is watching."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from floquid._checks import printable

_COUNT = re.compile(r"(\d+) of (\d+)")


def _lines() -> Callable[[str], None]:
    """Writer of each stage to stderr, once, as a line of its own: the part after its colon is left out."""
    told: set[str] = set()

    def report(words: str) -> None:
        stage = printable(words.split(": ", maxsplit=1)[0])
        if stage in told:
            return
        told.add(stage)
        try:
            sys.stderr.write(f"{stage}\n")
            sys.stderr.flush()
        except (AttributeError, OSError, ValueError):
            pass  # there is no stderr, or nobody reads it: no reason to stop the work

    return report


@contextmanager
def bar(
    wanted: bool, report: Callable[[str], None] = lambda _: None, *, stages: int | None = None
) -> Iterator[Callable[[str], None]]:
    """Listener to each stage: `report`, and, where it is wanted, a bar on stderr; without a terminal, lines.

    The bar is one of the given number of `stages`, or else of the «3 of 10» in what is told.
    """
    if not wanted:
        yield report
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (
        SpinnerColumn(), BarColumn(bar_width=24), TimeElapsedColumn(), TextColumn("{task.description}", markup=False)
    )  # fmt: skip
    console = Console(stderr=True)
    if not console.is_terminal:
        line = _lines()

        def listed(words: str) -> None:
            line(words)
            report(words)

        yield listed
        return
    with Progress(*columns, console=console, transient=True) as drawn:
        task, last = drawn.add_task("starting", total=stages), ""

        def told(words: str) -> None:
            nonlocal last
            stage = words.split(":", maxsplit=1)[0]
            if stages is None:
                count = _COUNT.search(words)
                done, total = (int(number) for number in count.groups()) if count else (0, None)
                drawn.update(task, description=words, completed=done, total=total)
            else:
                drawn.update(task, description=words, advance=0 if stage == last else 1)
            last = stage
            report(words)

        yield told
