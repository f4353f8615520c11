"""`floquid report`: the page again, from a saved result."""

from __future__ import annotations

from pathlib import Path

from floquid.cli._folder import result_file
from floquid.cli._options import Debug, OutputFolder, Place
from floquid.cli._progress import progress
from floquid.cli._terminal import terminal
from floquid.reporting import report as write_report
from floquid.store import load

STAGES = 3


def report(
    result: Place,
    *,
    out: OutputFolder = None,
    title: str | None = None,
    debug: Debug = False,
) -> None:
    """Write the report of a saved result: one HTML page that opens in any browser, without a network.

    Parameters
    ----------
    result
        A result.h5 that `floquid identify --out DIR` wrote, or the folder that it is in.
    out
        The page, ending in .html; report.html beside the result when not given.
    title
        The heading of the page; the names of the records when not given.
    debug
        Show the traceback of an error.
    """
    del debug
    file = result_file(result)
    page: Path = file.parent / "report.html" if out is None else out
    with progress(STAGES) as stage:
        stage("reading the result")
        write_report(load(file), page, title=title, progress=stage)
    terminal().print(f"Written: {page}", soft_wrap=True)
