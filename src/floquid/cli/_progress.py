"""A progress bar on stderr, while something is being done and a person is watching; otherwise a line a stage."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from floquid._bar import lines


@contextmanager
def progress(stages: int) -> Iterator[Callable[[str], None]]:
    """A bar of `stages` steps; each call says what is being done. Without a terminal, a stage is a line on stderr."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    if not console.is_terminal:
        yield lines()
        return
    columns = (
        SpinnerColumn(),
        BarColumn(bar_width=24),
        TimeElapsedColumn(),
        TextColumn("{task.description}", markup=False),
    )
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("starting", total=stages)
        last = ""

        def report(words: str) -> None:
            nonlocal last
            stage = words.split(":", maxsplit=1)[0]
            bar.update(task, description=words, advance=0 if stage == last else 1)
            last = stage

        yield report
