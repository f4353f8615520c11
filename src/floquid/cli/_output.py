"""The result folder and what goes to stdout."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import mkdtemp
from types import MappingProxyType

import numpy as np

from floquid._checks import input_error
from floquid.core import Record
from floquid.pipeline import Analysis
from floquid.plot import FIGURES as DRAWN
from floquid.readers import write
from floquid.store import save, summary

Truth = tuple[np.ndarray, np.ndarray]
"""Instants (times,) [s] and the true A at each (times, n, n)."""

FILES = ("record.npz", "result.h5", "summary.json", "settings.toml", "report.html")
FIGURES = tuple(f"{name}.png" for name in DRAWN)
"""The figures that there may be: some need an A(t), or a tachometer."""
UNFINISHED = ".floquid-unfinished-"
"""What the folder is called in which a result is put together; it is left behind when the machine or a kill ends it."""


@dataclass(frozen=True, slots=True)
class ResultFolder:
    """A folder that can be written to, holding or about to hold one result, and a folder in it to prepare the next."""

    path: Path
    unfinished: Path

    def write(
        self,
        analysis: Analysis,
        settings: str,
        report: Callable[[str], None],
        *,
        record: Record | None = None,
        truth: Truth | None = None,
        others: Mapping[str, Callable[[Path], object]] = MappingProxyType({}),
    ) -> None:
        """Write the result, its summary, settings, figures and report, then move them to their names together.

        `others` are further files by their names in the folder, each with a function that writes it to a path. Nothing
        of an earlier result is touched before all of this one is on the disk.
        """
        from floquid.plot import save_figures
        from floquid.reporting import report as write_report

        report("writing the result")
        if record is not None:
            write(record, self.unfinished / "record.npz")
        save(analysis, self.unfinished / "result.h5")
        (self.unfinished / "summary.json").write_text(json_text(analysis), encoding="utf-8")
        (self.unfinished / "settings.toml").write_text(settings, encoding="utf-8")
        report("drawing the figures")
        (self.unfinished / "figures").mkdir()
        save_figures(analysis, self.unfinished / "figures", truth=truth)
        write_report(
            analysis, self.unfinished / "report.html", truth=None if analysis.state is None else truth, progress=report
        )
        for name, make in others.items():
            make(self.unfinished / name)
        self._publish(tuple(others))

    def _publish(self, others: Sequence[str]) -> None:
        figures = self.path / "figures"
        figures.mkdir(exist_ok=True)
        for name in FIGURES:
            new = self.unfinished / "figures" / name
            if new.exists():
                new.replace(figures / name)
            else:
                (figures / name).unlink(missing_ok=True)  # of an earlier result, and not of this one
        for name in (*others, *FILES):
            new = self.unfinished / name
            if new.exists():
                new.replace(self.path / name)


@contextmanager
def result_folder(path: Path, others: Sequence[str] = ()) -> Iterator[ResultFolder]:
    """The folder `path`, made if need be and tried before any long work; without a result it is left as it was.

    `others` are the names in it of further files that are to be written.

    Raises
    ------
    InputError
        It cannot be made or written to, or something in it stands in the way of a result.
    """
    made: list[Path] = []
    unfinished: Path | None = None
    try:
        try:
            made = [folder for folder in (path, *path.parents) if not folder.exists()]
            if path.exists() and not path.is_dir():
                raise _unusable(path, f"{path} is a file")
            path.mkdir(parents=True, exist_ok=True)
            _refuse_obstacles(path, others)
            unfinished = Path(mkdtemp(prefix=UNFINISHED, dir=path))
        except OSError as error:
            raise _unusable(path, f"{path} is not: {error.strerror or error}") from None
        yield ResultFolder(path, unfinished)
    finally:
        if unfinished is not None:
            shutil.rmtree(unfinished, ignore_errors=True)
        for folder in made:
            with suppress(OSError):
                folder.rmdir()  # which only takes what is empty


def _refuse_obstacles(path: Path, others: Sequence[str]) -> None:
    figures = path / "figures"
    if figures.exists() and not figures.is_dir():
        raise _unusable(path, f"{figures} is a file")
    for file in [*(path / name for name in (*FILES, *others)), *(figures / name for name in FIGURES)]:
        if file.is_dir():
            raise _unusable(path, f"{file} is a folder")


def _unusable(path: Path, got: str) -> Exception:
    must = "be a folder that a result can be written to"
    return input_error("--out", "floquid", must, got, f"Choose another folder than {path}.")


def json_text(analysis: Analysis) -> str:
    """`summary.json` as text."""
    return json.dumps(summary(analysis), indent=1, allow_nan=False) + "\n"


def print_json(analysis: Analysis) -> None:
    """`summary.json`, alone on stdout."""
    sys.stdout.write(json_text(analysis))
