"""Files of a survey as points: which belong together, their values, and what is identified from them in processes."""

from __future__ import annotations

import csv
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import monotonic

from floquid._checks import input_error
from floquid.cli._errors import explained
from floquid.cli._folder import RESULT, identified_in, is_saved
from floquid.cli._options import Choices
from floquid.cli._records import check_files, read_records
from floquid.core import as_point
from floquid.errors import InputError
from floquid.io import readable_file
from floquid.pipeline import identify
from floquid.readers import FORMATS, read
from floquid.shapes import ShapeOptions
from floquid.surveys import NOT_READ, Point, point_of

OF = "floquid survey"
DIED = "The process that identified it ended at once: is there memory enough? Try --workers 1."


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """One point to be made: a saved result, or the records of one operating point, which are hits."""

    files: tuple[Path, ...]
    choices: Choices
    values: Mapping[str, float] = field(default_factory=dict)
    saved: bool = False
    shapes: ShapeOptions = NOT_READ
    reason: str | None = None  # why nothing can be made of it

    def lost(self, reason: str) -> Point:
        """The point without a result."""
        return Point(values=self.values, files=tuple(map(str, self.files)), reason=reason)


def jobs_of(
    files: Sequence[Path], choices: Choices, over: str, table: Path | None, shapes: ShapeOptions = NOT_READ
) -> list[Job]:
    """The points that files are, by their values: those of the table first, then of the files, then of the clock."""
    rows = {} if table is None else _rows(table)
    given = [one for file in files for one in _expanded(file, table)] or list(rows)
    check_files(given, OF)
    jobs: list[Job] = []
    for file in given:
        job = _job(file, choices, rows.get(file.resolve(), rows.get(Path(file.name), {})))
        same = [k for k, one in enumerate(jobs) if _is_one(one, job, over)]
        if same:
            jobs[same[0]] = replace(jobs[same[0]], files=(*jobs[same[0]].files, *job.files))
        else:
            jobs.append(job)
    missing = [str(job.files[0]) for job in jobs if not job.saved and job.reason is None and over not in job.values]
    if missing and over != "speed_rpm":  # which may be found with the angle of the shaft
        got = f"{', '.join(missing[:3])}{' …' if len(missing) > 3 else ''} has none"
        remedy = f"Add --table points.csv with a column `{over}`, or keep it with the record (`--point {over}=…`)."
        raise input_error("FILES", OF, f"have a value of {over} each", got, remedy)
    return [replace(job, shapes=shapes) for job in jobs]


def _is_one(first: Job, second: Job, over: str) -> bool:
    """True for records of one operating point: they are hits."""
    alone = first.saved or second.saved or first.reason or second.reason
    return not alone and over in first.values and first.values.get(over) == second.values.get(over)


def _expanded(path: Path, table: Path | None) -> Iterator[Path]:
    """The file itself; of a folder its result, or else the results and records in it."""
    if not path.is_dir() or (path / RESULT).is_file():
        yield path
        return
    suffixes = {kind.suffix for kind in FORMATS}
    found = [
        one
        for one in sorted(path.iterdir())
        if (one.is_dir() and (one / RESULT).is_file()) or (one.is_file() and one.suffix.lower() in suffixes)
    ]
    found = [one for one in found if table is None or one.resolve() != table.resolve()]
    if not found:
        must, got = "hold records, or results of `floquid identify`", f"{path} holds none"
        raise input_error("FILES", OF, must, got, "Name the files.")
    yield from found


def _rows(table: Path) -> dict[Path, dict[str, float]]:
    """The rows of a table by file: a column `file`, then a column a quantity."""
    readable_file(table, of=OF, argument="--table")
    text = table.read_text(encoding="utf-8-sig", errors="replace")
    rows = list(csv.DictReader(text.replace("\0", "").splitlines()))
    example = "Its first line is file,speed_rpm,temperature, and each line a file."
    if not rows or "file" not in rows[0]:
        raise input_error("--table", OF, "have a column `file`", f"{table} has none", example)
    found = {}
    for number, row in enumerate(rows, start=2):
        name = row.pop("file")
        try:
            values = {word.strip(): float(cell) for word, cell in row.items() if word and cell and cell.strip()}
        except (ValueError, AttributeError):
            raise input_error("--table", OF, "hold numbers", f"line {number} of {table} has others", example) from None
        beside = table.parent / name
        found[beside.resolve() if beside.exists() else Path(name)] = dict(as_point(values, OF))
    return found


def _job(file: Path, choices: Choices, row: Mapping[str, float]) -> Job:
    """One file as a job, with the values that are known before it is identified."""
    values = {name: value for name, value in row.items() if name != "period"}
    if is_saved([file]):
        return Job(files=(file,), choices=choices, values={**choices.point, **values}, saved=True)
    chosen = choices.with_given(period=row.get("period"), point={**choices.point, **values} or None)
    try:
        record = read(file, rate=choices.rate, header=choices.header)
    except (InputError, OSError) as error:
        return Job(files=(file,), choices=chosen, values=chosen.point, reason=_in_a_line(error))
    known = {**record.point, **chosen.point}
    setting = chosen.settings
    clock = setting.period or record.period
    per_turn = setting.periods_per_revolution
    if clock is not None:
        known = {"speed_rpm": 60.0 / (clock * per_turn), **known}
    elsewhere = record.clock is not None or setting.tach or setting.azimuth or setting.estimate_period
    if clock is None and not elsewhere and known.get("speed_rpm", 0.0) > 0.0:
        chosen = chosen.with_given(period=60.0 / (known["speed_rpm"] * per_turn))
    return Job(files=(file,), choices=chosen, values=known)


def _in_a_line(error: BaseException) -> str:
    return " ".join(explained(error)[0].split())


def points_of(jobs: Sequence[Job], workers: int | None, report: Callable[[str], None]) -> list[Point]:
    """A point a job, in their order; one that fails has its reason."""
    open_ = [k for k, job in enumerate(jobs) if job.reason is None]
    found = {k: job.lost(job.reason) for k, job in enumerate(jobs) if job.reason is not None}
    count = min(len(open_), os.cpu_count() or 1) if workers is None else workers
    begin = monotonic()
    for done, (k, point) in enumerate(_made([(k, jobs[k]) for k in open_], count), start=1):
        found[k] = point
        left = (monotonic() - begin) / done * (len(open_) - done)
        rest = f", about {left:.0f} s left" if left >= 1.0 else ""
        report(f"identified {done} of {len(open_)} points{rest}: {jobs[k].files[0].name}")
    return [found[k] for k in range(len(jobs))]


def _made(jobs: Sequence[tuple[int, Job]], workers: int) -> Iterator[tuple[int, Point]]:
    """The points as they are ready, with the numbers of their jobs."""
    if workers <= 1 or len(jobs) < 2:
        yield from ((k, made(job)) for k, job in jobs)
        return
    import multiprocessing
    from concurrent.futures import BrokenExecutor, ProcessPoolExecutor, as_completed

    # A fresh interpreter: a fork of a process with threads may hang.
    pool = ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"), initializer=_begin)
    try:
        sent = {pool.submit(made, job): (k, job) for k, job in jobs}
        for future in as_completed(sent):
            k, job = sent[future]
            try:
                yield k, future.result()
            except BrokenExecutor:
                yield k, job.lost(DIED)
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _begin() -> None:
    import signal

    # Ctrl-C reaches every process of a terminal; the first of them ends the others.
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def made(job: Job) -> Point:
    """The point of a job."""
    import warnings

    try:
        with warnings.catch_warnings(record=True):
            if job.saved:
                analysis = identified_in(job.files[0], OF)
            else:
                records, choices = read_records(job.files, job.choices, OF, lambda _: None)
                analysis = identify(records, choices.resolved())
            found = point_of(analysis, job.shapes)
    except Exception as error:  # noqa: BLE001  # one bad point costs one point
        return job.lost(_in_a_line(error))
    return replace(found, values={**found.values, **job.values}, files=tuple(map(str, job.files)))
