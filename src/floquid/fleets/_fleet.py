"""Records by the thousand to one table: which files, what is left to do, and by whom."""

from __future__ import annotations

import hashlib
import os
import warnings
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, fields, is_dataclass
from glob import has_magic
from os import PathLike
from pathlib import Path
from time import monotonic, perf_counter
from typing import Any, Unpack

from floquid._bar import bar
from floquid._checks import counted, input_error, integer
from floquid._show import Brief, late
from floquid.fleets._runner import DIED, outcomes, time_left
from floquid.fleets._table import Done, Row, Table, labelled, lost, opened, rows_of
from floquid.io import as_path
from floquid.pipeline import identify
from floquid.preparation import Options, Reading, Settings, settings_of, takes_settings
from floquid.readers import FORMATS

OF = "fleet"

Place = str | PathLike[str]


def _said(error: BaseException) -> str:
    return f"{error}" or type(error).__name__


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """A record to be identified."""

    files: tuple[Path, ...]
    name: str
    key: tuple[int, int, str]  # size [bytes], time [ns], settings
    settings: Settings
    reading: Reading
    keep: Path | None
    words: Callable[[BaseException], str]

    def labelled(self, rows: list[Row], seconds: float) -> list[Row]:
        """The rows with the cells of the record."""
        size, modified, settings = self.key
        cells = {"size": size, "modified": modified, "settings": settings, "seconds": seconds}
        return labelled(rows, {"file": self.name, **cells})


@dataclass(frozen=True, slots=True, kw_only=True)
class Fleet(Brief):
    """Counts of the records of a run of `fleet`, earlier runs included, and reasons for those without a result.

    Parameters
    ----------
    out
        The table.
    n_records, n_before
        The records, and those of them that earlier runs had done.
    n_identified, n_passed, n_modes
        Records with a result, those that passed their checks, and modes of all.
    lost
        Records without a result: the file, and why.
    """

    out: Path
    n_records: int
    n_before: int
    n_identified: int
    n_passed: int
    n_modes: int
    lost: tuple[tuple[str, str], ...]

    def __str__(self) -> str:
        before = f" ({self.n_before} done before)" if self.n_before else ""
        results = f"{self.n_identified} identified ({self.n_passed} passed), {len(self.lost)} without a result"
        return f"{counted(self.n_records, 'record')}{before}: {results}; {counted(self.n_modes, 'mode')}."


@takes_settings
def fleet(
    sources: Place | Iterable[Place | Sequence[Place]],
    settings: Settings | None = None,
    *,
    executor: Executor | None = None,
    out: Place = "modes.parquet",
    workers: int | None = None,
    keep: Place | None = None,
    reading: Reading | None = None,
    words: Callable[[BaseException], str] = _said,
    progress: bool = False,
    **options: Unpack[Options],
) -> Fleet:
    """Identify many records, each for itself, into one Parquet table with a row a mode.

    A record without a result is one row, whose `mode` is null, with its `reason`. Rows are written in parts while the
    work goes on. A run that was killed, or is started again, does no finished record twice: by its file, size, time and
    settings. One whose process died is done again. A file that has changed gets new rows; rows of other files stay.
    Each record gives the same numbers, whichever worker does it.

    A worker that dies costs no other record. What it did is done once more, alone; then it is a row with the reason.

    Raises InputError where a source matches no file, the table cannot be written, is another file, or another run
    writes it; IdentificationError where the `executor` ends first.

    Parameters
    ----------
    sources
        Files, patterns such as "lake/*/*.parquet", and folders, in which all records are meant; or of several hits on
        one system a list of their files.
    settings
        The options of `identify`; or give them by name.
    executor
        Any executor of `concurrent.futures`, such as `Client(address).get_executor()` of `dask.distributed`; processes
        of this machine when not given. Its workers must see the files by the same names.
    out
        The table, ending in .parquet.
    workers
        How many processes, without an executor; one for each processor when not given.
    keep
        A folder for the whole result of each record, an .h5 file that `load` reads; none is kept when not given.
    reading
        How files are read: the rate, names, the origin, the operating point.
    words
        A function of a module that words an error as a reason.
    progress
        True for a bar on stderr with the time left.
    **options
        Fields of `Settings`, which come before those of `settings`.
    """
    chosen, how = settings_of(settings, options, OF), reading or Reading()
    if executor is not None and workers is not None:
        raise input_error("workers", OF, "not be given beside an executor", f"is {workers}", "It has its own workers.")
    if workers is not None:
        integer(workers, "workers", OF, at_least=1)
    path = as_path(out, of=OF, argument="out")
    folder = None if keep is None else _folder(keep)
    groups = _groups(sources, path)
    code = hashlib.sha256(repr((_plain(chosen), _plain(how))).encode()).hexdigest()[:16]
    with opened(path, OF) as table:
        jobs = [_job(files, code, chosen, how, folder, words) for files in groups]
        left = [job for job in jobs if not _is_done(table.done.get(job.name), job)]
        with bar(progress) as report:
            _run(left, table, executor, workers, report)
    found = [table.done[job.name] for job in jobs]
    return Fleet(
        out=path,
        n_records=len(jobs),
        n_before=len(jobs) - len(left),
        n_identified=sum(own.modes > 0 for own in found),
        n_passed=sum(own.passed for own in found),
        n_modes=sum(own.modes for own in found),
        lost=tuple((job.name, own.reason or "") for job, own in zip(jobs, found, strict=True) if not own.modes),
    )


def _run(
    jobs: Sequence[Job],
    table: Table,
    executor: Executor | None,
    workers: int | None,
    report: Callable[[str], None],
) -> None:
    """Do the jobs, and put their rows into the table as they come."""
    begin, count = 0.0, len(jobs)
    if jobs:
        report(f"identified 0 of {count} records")
    most = min(count, os.cpu_count() or 1) if workers is None else min(workers, max(count, 1))
    found = outcomes(
        done_of, jobs, lambda job, reason: job.labelled(lost(reason), 0.0), workers=most, executor=executor
    )
    for done, (number, rows) in enumerate(found, start=1):
        begin = begin or monotonic()  # the time left is that of records, without the start of workers
        if table.add(jobs[number].name, rows):
            report(f"identified {done} of {count} records{time_left(done - 1, count - 1, monotonic() - begin)}")


def done_of(job: Job) -> list[Row]:
    """The rows of a record; of one that fails the row with its reason."""
    begin, kept = perf_counter(), None
    try:
        with warnings.catch_warnings(record=True):
            records, settings = job.reading.records(job.files, job.settings)
            analysis = identify(records, settings)
            if job.keep is not None:
                late("store", "save")(analysis, kept := job.keep)
            rows = rows_of(analysis)
    except Exception as error:  # noqa: BLE001  # one bad record costs one record
        rows = lost(" ".join(job.words(error).split()))
    found = job.labelled(rows, perf_counter() - begin)
    return [{**row, "result": None if kept is None or row.get("mode") is None else str(kept)} for row in found]


def _is_done(known: Done | None, job: Job) -> bool:
    """True where a record need not be done again: as it is, with these settings, and not for want of memory."""
    if known is None or known.key != job.key or known.reason == DIED:
        return False
    return job.keep is None or not known.modes or (known.result is not None and Path(known.result).is_file())


def _job(
    files: tuple[Path, ...],
    code: str,
    settings: Settings,
    reading: Reading,
    keep: Path | None,
    words: Callable[[BaseException], str],
) -> Job:
    size, modified = 0, 0
    for file in files:
        try:
            known = file.stat()
        except OSError:
            size = modified = -1
            break
        size, modified = size + known.st_size, max(modified, known.st_mtime_ns)
    name = "; ".join(map(str, files))
    mark = hashlib.sha256(name.encode()).hexdigest()[:8]
    place = None if keep is None else keep / f"{files[0].stem}-{mark}.h5"
    return Job(
        files=files, name=name, key=(size, modified, code), settings=settings, reading=reading, keep=place, words=words
    )  # fmt: skip


def _folder(keep: Place) -> Path:
    folder = as_path(keep, of=OF, argument="keep").absolute()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        got = f"{folder} cannot be made ({error.strerror})"
        raise input_error("keep", OF, "be a folder that results can be written to", got) from None
    return folder


def _groups(sources: Place | Iterable[Place | Sequence[Place]], out: Path) -> list[tuple[Path, ...]]:
    """The files of each record, by their whole names, each once."""
    given = [sources] if isinstance(sources, (str, PathLike)) else list(sources)
    groups: dict[tuple[Path, ...], None] = {}
    for source in given:
        if isinstance(source, (str, PathLike)):
            groups |= {(file,): None for file in _matched(source) if file != out.absolute()}
        else:
            groups[tuple(as_path(file, of=OF, argument="sources").absolute() for file in source)] = None
    if not groups:
        raise input_error("sources", OF, "name a record", "none was given", 'As "lake/*/*.parquet".')
    return list(groups)


def _matched(source: Place) -> list[Path]:
    """The file, the files that a pattern matches, or the records in a folder."""
    path = as_path(source, of=OF, argument="sources").absolute()
    if path.is_dir():
        suffixes = {kind.suffix for kind in FORMATS}
        found = [file for file in sorted(path.rglob("*")) if file.suffix.lower() in suffixes]
    elif has_magic(str(path)) and not path.exists():
        found = sorted(Path(path.anchor).glob(str(path.relative_to(path.anchor))))
    else:
        return [path]  # one that is not there is a row with its reason
    # As in a shell, what is hidden is not meant: the parts of a table, for one.
    found = [
        file for file in found if file.is_file() and not any(part[0] == "." for part in {*file.parts} - {*path.parts})
    ]
    if not found:
        got = f"{source} holds no record" if path.is_dir() else f"{source} matches no file"
        raise input_error("sources", OF, "be files, or match some", got, "Check the name and the folder.")
    return found


def _plain(value: Any) -> Any:
    """A value by its type and all of its fields, for a key."""
    if is_dataclass(value):
        return type(value).__name__, [(field.name, _plain(getattr(value, field.name))) for field in fields(value)]
    return sorted(value.items()) if hasattr(value, "items") else value
