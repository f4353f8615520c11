"""Files of a survey as points: which belong together, their values, and what is identified from them in processes."""

from __future__ import annotations

import csv
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import monotonic

from floquid._checks import input_error
from floquid.cli._errors import in_a_line
from floquid.cli.arguments.options import Choices
from floquid.cli.arguments.records import check_files, read_records, records_in
from floquid.cli.arguments.shared import RESULT, is_saved
from floquid.cli.output.folder import modes_in
from floquid.core import as_point
from floquid.errors import InputError
from floquid.fleets import Kept, kept_results, outcomes, time_left
from floquid.floquet import read_matrix
from floquid.io import readable_file
from floquid.pipeline import identify
from floquid.readers import FORMATS
from floquid.shapes import ShapeOptions
from floquid.surveys import NOT_READ, Point, is_linearised, point_of

OF = "floquid survey"  # the command that names files, where no other does


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """One point to be made: a saved result, a folder of linearisations, or records of one point, which are hits."""

    files: tuple[Path, ...]
    choices: Choices
    values: Mapping[str, float] = field(default_factory=dict)
    saved: bool = False
    known: bool = False
    shapes: ShapeOptions = NOT_READ
    sidebands: bool = False
    reason: str | None = None  # why nothing can be made of it

    def lost(self, reason: str) -> Point:
        """The point without a result."""
        return Point(values=self.values, files=tuple(map(str, self.files)), reason=reason)


def jobs_of(
    files: Sequence[Path], choices: Choices, over: str | None, table: Path | None, shapes: ShapeOptions = NOT_READ
) -> list[Job]:
    """The points that files are, by their values: those of the table first, then of the files, then of the clock."""
    rows = {} if table is None else _rows(table)
    tables = {file: kept for file in files if (kept := kept_results(file)) is not None}
    given = [one for file in files if file not in tables for one in _expanded(file, table)]
    given += [one for file, kept in tables.items() for one in _results(file, kept)]
    given = given or list(rows)
    check_files(given, OF)
    jobs = [
        Job(files=(Path(own.file),), choices=choices, values=own.point, reason=own.reason)
        for kept in tables.values()
        for own in kept
        if own.reason is not None
    ]
    for file in given:
        job = _job(file, choices, rows.get(file.resolve(), rows.get(Path(file.name), {})))
        same = [k for k, one in enumerate(jobs) if _is_one(one, job, over)]
        if same:
            jobs[same[0]] = replace(jobs[same[0]], files=(*jobs[same[0]].files, *job.files))
        else:
            jobs.append(job)
    missing = [
        str(job.files[0])
        for job in jobs
        if not (job.saved or job.known) and job.reason is None and over not in job.values
    ]
    if over is not None and missing and over != "speed_rpm":  # which may be found with the angle of the shaft
        got = f"{', '.join(missing[:3])}{' …' if len(missing) > 3 else ''} has none"
        remedy = f"Add --table points.csv with a column `{over}`, or keep it with the record (`--point {over}=…`)."
        raise input_error("FILES", OF, f"have a value of {over} each", got, remedy)
    return [replace(job, shapes=shapes) for job in jobs]


def _is_one(first: Job, second: Job, over: str | None) -> bool:
    """True for records of one operating point: they are hits."""
    alone = any(one.saved or one.known or one.reason for one in (first, second))
    return over is not None and not alone and over in first.values and first.values.get(over) == second.values.get(over)


def _expanded(path: Path, table: Path | None) -> Iterator[Path]:
    """The file itself; of a folder its result or linearisation, or else the results, records and such in it."""
    if not path.is_dir() or (path / RESULT).is_file() or is_linearised(path):
        yield path
        return
    suffixes = {kind.suffix for kind in FORMATS}
    found = [
        one
        for one in sorted(path.iterdir())
        if (one.is_dir() and (one / RESULT).is_file())
        or is_linearised(one)
        or (one.is_file() and one.suffix.lower() in suffixes)
    ]
    found = [one for one in found if table is None or one.resolve() != table.resolve()]
    if not found:
        must, got = "hold records, results of `floquid identify`, or .lin files", f"{path} holds none"
        raise input_error("FILES", OF, must, got, "Name the files.")
    yield from found


def _results(table: Path, kept: Sequence[Kept]) -> list[Path]:
    """The results that `floquid fleet` kept beside its table."""
    found = [Path(own.result) for own in kept if own.result is not None]
    if not found:
        got = f"{table} has exponents alone, without the shapes by which modes are followed"
        remedy = "Run `floquid fleet` again with --keep DIR: results are kept there, and named in the table."
        raise input_error("FILES", OF, "hold records or results", got, remedy)
    return found


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
    if is_linearised(file):
        return Job(files=(file,), choices=choices, values={**choices.point, **values}, known=True)
    chosen = choices.with_given(period=row.get("period"), point={**choices.point, **values} or None)
    try:
        readable_file(file, of=OF, argument="FILES")
        (record,), _ = records_in([file], chosen)
    except (InputError, OSError) as error:
        return Job(files=(file,), choices=chosen, values=chosen.point, reason=in_a_line(error))
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


def points_of(jobs: Sequence[Job], workers: int | None, report: Callable[[str], None]) -> list[Point]:
    """A point a job, in their order; one that fails has its reason."""
    open_ = [k for k, job in enumerate(jobs) if job.reason is None]
    found = {k: job.lost(job.reason) for k, job in enumerate(jobs) if job.reason is not None}
    count = min(len(open_), os.cpu_count() or 1) if workers is None else workers
    count = min(count, len(open_))
    begin = monotonic()
    for done, (number, point) in enumerate(outcomes(made, [jobs[k] for k in open_], Job.lost, workers=count), start=1):
        k = open_[number]
        found[k] = point
        rest = time_left(done, len(open_), monotonic() - begin)
        report(f"identified {done} of {len(open_)} points{rest}: {jobs[k].files[0].name}")
    return [found[k] for k in range(len(jobs))]


def made(job: Job) -> Point:
    """The point of a job."""
    import warnings

    try:
        with warnings.catch_warnings(record=True):
            if job.known:
                found = point_of(read_matrix(job.files[0]), job.shapes)
                return replace(found, values={**found.values, **job.values}, files=(str(job.files[0]),))
            if job.saved:
                found = modes_in(job.files[0], OF)
            else:
                records, choices = read_records(job.files, job.choices, OF, lambda _: None)
                found = identify(records, choices.resolved())
            point = point_of(found, job.shapes, sidebands=job.sidebands)
    except Exception as error:  # noqa: BLE001  # one bad point costs one point
        return job.lost(in_a_line(error))
    return replace(point, values={**point.values, **job.values}, files=tuple(map(str, job.files)))
