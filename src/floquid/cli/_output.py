"""The files of a result, and what goes to stdout."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np

from floquid.cli._folder import FIGURES, RESULT, ResultFolder
from floquid.core import Record
from floquid.exports import summary
from floquid.pipeline import Analysis
from floquid.readers import write
from floquid.store import save

Truth = tuple[np.ndarray, np.ndarray]
"""Instants (times,) [s] and the true A at each (times, n, n)."""

FILES = ("record.npz", RESULT, "summary.json", "settings.toml", "report.html")
NAMES = (*FILES, *(f"figures/{name}" for name in FIGURES))
"""What the files of a result are called in its folder."""


def write_result(
    folder: ResultFolder,
    analysis: Analysis,
    settings: str,
    report: Callable[[str], None],
    *,
    record: Record | None = None,
    truth: Truth | None = None,
    others: Mapping[str, Callable[[Path], object]] = MappingProxyType({}),
) -> None:
    """Write the result, its summary, settings, figures and report into a folder, where they take their names together.

    `others` are further files by their names in the folder, each with a function that writes it to a path.
    """
    from floquid.plot import save_figures
    from floquid.reporting import report as write_report

    place = folder.unfinished
    report("writing the result")
    if record is not None:
        write(record, place / "record.npz")
    save(analysis, place / RESULT)
    (place / "summary.json").write_text(json_text(analysis), encoding="utf-8")
    (place / "settings.toml").write_text(settings, encoding="utf-8")
    report("drawing the figures")
    (place / "figures").mkdir()
    save_figures(analysis, place / "figures", truth=truth)
    write_report(analysis, place / "report.html", truth=None if analysis.state is None else truth, progress=report)
    for name, make in others.items():
        make(place / name)
    folder.publish()


def json_text(analysis: Analysis) -> str:
    """`summary.json` as text."""
    return json.dumps(summary(analysis), indent=1, allow_nan=False) + "\n"


def print_json(analysis: Analysis) -> None:
    """`summary.json`, alone on stdout."""
    sys.stdout.write(json_text(analysis))
