"""A folder of results: what belongs together takes its names together, whatever ends the program, whoever else writes.

A result is put together in a hidden folder inside. Then, under a lock,

1. the hidden folder is flushed to the disk and named `READY`: from here on the new result is the one that there is;
2. what an earlier result has and this one lacks, figures and tables, is deleted, and `READY` is named `MOVING`;
3. its files are moved to their names, and `MOVING` is removed.

A kill before 1 leaves the earlier result. After it, the next command that is given the folder does the rest (`settle`):
2 and 3 may be done twice. Every single file is at all times that of the one result or that of the other.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from floquid._bar import bar
from floquid._checks import input_error
from floquid.cli.arguments.shared import RESULT
from floquid.cli.output.terminal import json_text, print_files, terminal
from floquid.core import Record
from floquid.exports import summary, transfer_rows
from floquid.io import flush, flush_folder, is_result
from floquid.large import LargeResult
from floquid.pipeline import Analysis
from floquid.plot import FIGURES as DRAWN
from floquid.preparation import SHORT
from floquid.readers import write
from floquid.store import load, save
from floquid.views import DampingUnit, SpeedUnit

FIGURES = tuple(f"{name}.png" for name in DRAWN)  # the figures that there may be
FILES = ("record.npz", RESULT, "summary.json", "settings.toml", "report.html", "transfer.csv")
# What the files of a result are called in its folder.
NAMES = (*FILES, *(f"figures/{name}" for name in FIGURES))
LOCK = ".floquid-lock"  # held while files take their names

READY, MOVING = ".floquid-ready", ".floquid-moving"

UNFINISHED = ".floquid-unfinished-"
"""Name of the folder in which a result is put together. One left behind by a kill is removed by the next run."""

_OWNED = ".lock"
"""In an unfinished folder: held by the program that fills it, so that no other takes it for left behind."""

WAIT = 60.0  # how long another program's moves are waited for [s]; they take milliseconds


@dataclass(frozen=True, slots=True)
class ResultFolder:
    """A folder that can be written to, and a hidden folder in it in which the next result is put together."""

    path: Path
    unfinished: Path
    owned: ExitStack

    def write(self, name: str, text: str) -> None:
        """Write a text under a name in the hidden folder."""
        (self.unfinished / name).write_text(text, encoding="utf-8")

    def publish(self, beside: str = "") -> None:
        """Give all that is in the hidden folder its names, together; with a mark only `beside` the result of it."""
        for folder, _, names in os.walk(self.unfinished, topdown=False):
            for name in names:
                flush(Path(folder, name))
            flush_folder(Path(folder))
        with _locked(self.path):
            _settle(self.path)
            if beside and _mark(self.path / RESULT) != beside:
                return
            self.owned.close()
            (self.unfinished / _OWNED).unlink(missing_ok=True)
            self.unfinished.rename(self.path / READY)
            flush_folder(self.path)
            _settle(self.path)


def settle(path: Path) -> None:
    """Finish the moves that a killed program had begun in the folder `path`, if there are any."""
    if not any((path / name).is_dir() for name in (READY, MOVING)):
        return
    try:
        with _locked(path):
            _settle(path)
    except OSError as error:
        raise _unusable(path, f"{path} holds a result that could not be moved to its place ({_words(error)})") from None


def result_file(path: Path) -> Path:
    """The result in a folder, or the file itself; moves that a killed program had begun there are finished first."""
    folder = path if path.is_dir() else path.parent
    settle(folder)
    return folder / RESULT if path.is_dir() else path


def modes_in(path: Path, of: str) -> Analysis | LargeResult:
    """The result with identified modes at a path, or in the folder there."""
    found: Any = load(result_file(path))
    if found.kind not in ("analysis", "large"):
        lines = found.kind in ("measured", "fitted")
        remedy = "`floquid transfer --lines` reads it." if lines else "`floquid report` writes its page."
        holds = f"holds {'transfer functions' if lines else 'what was found of several results'}"
        raise input_error("RESULT", of, "be what `floquid identify` wrote", holds, remedy)
    return found


def identified_in(path: Path, of: str) -> Analysis:
    """The analysis at a path, or in the folder there."""
    return in_memory(modes_in(path, of), of)


def in_memory(found: Any, of: str) -> Any:
    """A result with all that it was made of; refused where that stayed on the disk."""
    if found.kind == "large":
        must, got = "be of a record in memory", "is of one that was read in blocks (`--memory`)"
        raise input_error("RESULT", of, must, got, "`floquid compare`, `survey` and `shapes` take it.")
    return found


def refuse_beside_result(said: Mapping[str, object], of: str) -> None:
    """Refuse settings beside a saved result: it has its own."""
    for name in said:
        option = f"--{SHORT.get(name, name).replace('_', '-')}"
        remedy = "`floquid identify` identifies the records anew."
        raise input_error(option, of, "not be given beside a saved result", "is given", remedy)


@contextmanager
def maybe_folder(path: Path | None, names: Sequence[str]) -> Iterator[ResultFolder | None]:
    """The folder of `result_folder`, or none where none was asked for."""
    with ExitStack() as held:
        yield None if path is None else held.enter_context(result_folder(path, names))


@contextmanager
def result_folder(path: Path, names: Sequence[str]) -> Iterator[ResultFolder]:
    """The folder `path`, made if need be and tried before any long work; without a result it is left as it was."""
    made: list[Path] = []
    unfinished: Path | None = None
    with ExitStack() as owned:
        try:
            try:
                made = [folder for folder in (path, *path.parents) if not folder.exists()]
                if path.exists() and not path.is_dir():
                    raise _unusable(path, f"{path} is a file")
                path.mkdir(parents=True, exist_ok=True)
                _refuse_obstacles(path, names)
                with _locked(path):
                    _settle(path)
                    _sweep(path)
                    unfinished = path / f"{UNFINISHED}{os.urandom(6).hex()}"
                    unfinished.mkdir()
                    owned.enter_context(_lock(unfinished / _OWNED, 0.0))
            except OSError as error:
                raise _unusable(path, f"{path} is not: {_words(error)}") from None
            yield ResultFolder(path, unfinished, owned)
        finally:
            owned.close()
            if unfinished is not None:
                shutil.rmtree(unfinished, ignore_errors=True)
            for folder in made:
                with suppress(OSError):
                    folder.rmdir()  # which only takes what is empty


def _settle(path: Path) -> None:
    ready, moving = path / READY, path / MOVING
    if moving.is_dir():
        _move(moving, path)
    if ready.is_dir():
        if (ready / RESULT).exists():
            for name in ("report.html", "transfer.csv", *(f"figures/{figure}" for figure in FIGURES)):
                if not (ready / name).exists():
                    (path / name).unlink(missing_ok=True)
        ready.rename(moving)
        _move(moving, path)


def _move(source: Path, target: Path) -> None:
    """Every file of `source` to the same name under `target`; `source` is gone in the end."""
    for entry in sorted(source.iterdir()):
        if entry.is_dir() and not entry.is_symlink():
            (target / entry.name).mkdir(exist_ok=True)
            _move(entry, target / entry.name)
        else:
            entry.replace(target / entry.name)
    flush_folder(target)
    source.rmdir()


def _sweep(path: Path) -> None:
    """Remove what killed programs left behind: unfinished folders that nobody holds."""
    from filelock import Timeout

    for left in path.glob(f"{UNFINISHED}*"):
        if not left.is_dir() or left.is_symlink():
            continue
        try:
            with _lock(left / _OWNED, 0.0):
                pass
        except (Timeout, OSError):  # it is alive, or another user's
            continue
        shutil.rmtree(left, ignore_errors=True)


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    from filelock import Timeout

    try:
        with _lock(path / LOCK, WAIT):
            try:
                yield
            finally:
                with suppress(OSError):  # who waits for it sees that it is gone, and makes a new one
                    (path / LOCK).unlink()
    except Timeout:
        got = f"another program has been writing to {path} for {WAIT:.0f} s"
        raise _unusable(path, got) from None


@contextmanager
def _lock(file: Path, wait: float) -> Iterator[None]:
    from filelock import FileLock

    with FileLock(file, timeout=wait, poll_interval=0.01):
        yield


def _refuse_obstacles(path: Path, names: Sequence[str]) -> None:
    figures = path / "figures"
    if figures.exists() and not figures.is_dir():
        raise _unusable(path, f"{figures} is a file")
    for file in (path / name for name in names):
        if file.is_dir():
            raise _unusable(path, f"{file} is a folder")
        if file.is_symlink():
            raise _unusable(path, f"{file} is a symbolic link, and what it points to cannot be replaced with the rest")
    if RESULT in names and (path / RESULT).exists() and not is_result(path / RESULT):
        raise _unusable(path, f"{path / RESULT} is no result of floquid, and would be replaced")


def _words(error: OSError) -> str:
    return error.strerror or str(error)


def _unusable(path: Path, got: str) -> Exception:
    must = "be a folder that a result can be written to"
    return input_error("--out", "floquid", must, got, f"Choose another folder than {path}.")


def write_result(
    folder: ResultFolder,
    analysis: Analysis,
    settings: str,
    report: Callable[[str], None],
    *,
    record: Record | None = None,
) -> str:
    """Write the result, its summary and settings into a folder, where they take their names together."""
    place = folder.unfinished
    report("writing the result")
    if record is not None:
        write(record, place / "record.npz")
    save(analysis, place / RESULT)
    folder.write("summary.json", json_text(summary(analysis)))
    folder.write("settings.toml", settings)
    if analysis.inputs:
        folder.write("transfer.csv", transfer_rows(analysis.transfer()))
    mark = _mark(place / RESULT)
    folder.publish()
    return mark


def draw_result(
    path: Path,
    analysis: Analysis,
    mark: str,
    report: Callable[[str], None],
    *,
    figures: bool,
    truth: tuple[np.ndarray, np.ndarray] | None = None,
    speed_unit: SpeedUnit = "hz",
    damping_unit: DampingUnit = "percent",
) -> None:
    """Draw the page, and with `figures` files of its figures, of a result that `write_result` marked in `path`.

    Where another program has put its result there meanwhile, nothing is added to that.
    """
    from floquid.plot import save_figures
    from floquid.reporting import report as write_report

    with result_folder(path, NAMES) as folder:
        place = folder.unfinished
        if figures:
            report("drawing the figures")
            (place / "figures").mkdir()
            save_figures(analysis, place / "figures", truth=truth, speed_unit=speed_unit)
        known = truth if analysis.state is not None else None
        write_report(
            analysis,
            place / "report.html",
            truth=known,
            speed_unit=speed_unit,
            damping_unit=damping_unit,
            progress=report,
        )
        folder.publish(beside=mark)


def _mark(file: Path) -> str:
    """A mark of the content of a file; of none an empty one."""
    return hashlib.sha256(file.read_bytes()).hexdigest() if file.exists() else ""


PAGE, DRAWINGS = "report.html", "figures/"


def refuse_beside_identified(out: Path | None, of: str) -> None:
    """Refuse a folder that holds a result of an identification, which has a page of its own."""
    if out is not None and (out / RESULT).exists():
        must = "be a folder without a result of `floquid identify`, whose report.html would be replaced"
        raise input_error("--out", of, must, f"{out} holds {RESULT}", "Choose another folder.")


def keep(folder: ResultFolder | None, found: Any, names: Sequence[str], texts: Sequence[str]) -> None:
    """Write the result and its `texts` under their `names` into a folder, if there is one, together."""
    if folder is None:
        return
    save(found, folder.unfinished / names[0])
    for name, text in zip(names[1:], texts, strict=False):
        folder.write(name, text)
    folder.publish()


def tell(
    found: Any,
    printed: Callable[[Console, Any], None],
    *,
    out: Path | None,
    names: Sequence[str],
    json: str | None,
    why: str,
    options: Mapping[str, Mapping[str, Any]] | None = None,
    page: Mapping[str, Any] | None = None,
) -> None:
    """Print the result, or its `json` alone; then draw it into the folder `out`.

    `names` are those of all files of the folder; `why` says what they are kept for. `options` are those of each figure,
    `page` those of the page.
    """
    if json is None:
        printed(terminal(), found)
    else:
        sys.stdout.write(json)
        sys.stdout.flush()
    if out is not None:
        _draw(out, found, names, options or {}, page or {})
    if json is None:
        drawn = [name for name in names if name.startswith(DRAWINGS)]
        kept = [name for name in names if name not in {PAGE, *drawn} and not name.endswith(".parquet")]
        print_files(out, [PAGE, *kept, DRAWINGS], why)


def _draw(
    out: Path, found: Any, names: Sequence[str], options: Mapping[str, Mapping[str, Any]], page: Mapping[str, Any]
) -> None:
    """Draw the figures and the page into the folder."""
    from floquid.plot import save_figure
    from floquid.reporting import report as write_report

    with bar(True) as report, result_folder(out, names) as folder:
        report("drawing the figures")
        (folder.unfinished / DRAWINGS).mkdir()
        for name in names:
            if name.startswith(DRAWINGS) and (function := Path(name).stem) in dir(found.plot):
                save_figure(getattr(found.plot, function)(**options.get(function, {})), folder.unfinished / name)
        report("drawing the report")
        write_report(found, folder.unfinished / PAGE, **page)
        folder.publish()
