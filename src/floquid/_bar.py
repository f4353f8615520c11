"""A progress bar for work that takes long."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_COUNT = re.compile(r"(\d+) of (\d+)")


@contextmanager
def bar(wanted: bool, report: Callable[[str], None]) -> Iterator[Callable[[str], None]]:
    """What is to be told of each stage: `report`, and, where it is wanted, a bar on stderr if that is a terminal.

    A stage that says «… 3 of 8» fills the bar; another makes it run without a measure.
    """
    if not wanted:
        yield report
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (BarColumn(bar_width=24), TimeElapsedColumn(), TextColumn("{task.description}", markup=False))
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as drawn:
        task = drawn.add_task("starting", total=None)

        def told(words: str) -> None:
            count = _COUNT.search(words)
            done, total = (int(number) for number in count.groups()) if count else (0, None)
            drawn.update(task, description=words, completed=done, total=total)
            report(words)

        yield told
