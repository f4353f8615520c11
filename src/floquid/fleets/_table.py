"""The table of a fleet: rows in parts as they come, one file in the end, and what of it need not be done again.

Beside `modes.parquet` there is a folder `.modes.parquet.parts` while a run is at work, and after one that was killed:
each part is a Parquet file that was written whole. At the end of a run the rows of the earlier table and of all parts
become the new table, which takes its name at once; of a file that was done again the last rows count.
"""

from __future__ import annotations

import secrets
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np

from floquid._checks import input_error
from floquid._json import for_json
from floquid._version import __version__
from floquid.io import atomic_path, load_package
from floquid.periodic import CONFIDENT, participation
from floquid.pipeline import Analysis

COLUMNS = {
    "file": "string",
    "mode": "int32",
    "re": "float64",
    "im": "float64",
    "std_re": "float64",
    "std_im": "float64",
    "covariance": "float64",
    "multiplier_re": "float64",
    "multiplier_im": "float64",
    "frequency_hz": "float64",
    "damping_ratio": "float64",
    "harmonics": "list<int32>",
    "weak": "bool",
    "passed": "bool",
    "order": "int32",
    "period": "float64",
    "warnings": "list<string>",
    "reason": "string",
    "result": "string",
    "settings": "string",
    "floquid": "string",
    "size": "int64",
    "modified": "int64",
    "seconds": "float64",
}
"""Columns by name, with their types; behind them one of numbers for each quantity of the operating points."""

Row = dict[str, Any]


def rows_of(analysis: Analysis) -> list[Row]:
    """A row a mode of an analysis, of a conjugate pair the mode above the real axis; modes are numbered from 1."""
    model = analysis.model
    record = {
        "passed": analysis.passed,
        "order": model.order,
        "period": model.period,
        "warnings": [*analysis.warnings],
        "reason": analysis.reasons[0] if analysis.failed else None,
        **{name if name not in COLUMNS else f"point_{name}": float(value) for name, value in model.point.items()},
    }
    std, covariance, count = model.exponent_std, model.covariance, model.order
    rows = []
    for number, mode in enumerate(model.upper_modes, start=1):
        value, multiplier = complex(model.exponents[mode]), complex(model.multipliers[mode])
        error = complex(np.nan, np.nan) if std is None else complex(std[mode])
        rows.append(
            {
                "mode": number,
                "re": value.real,
                "im": value.imag,
                "std_re": error.real,
                "std_im": error.imag,
                "covariance": np.nan if covariance is None else float(covariance[mode, count + mode]),
                "multiplier_re": multiplier.real,
                "multiplier_im": multiplier.imag,
                "frequency_hz": float(model.frequencies_hz[mode]),
                "damping_ratio": float(model.damping_ratios[mode]),
                "harmonics": participation(model, mode, 1.0 / analysis.noise)[0].tolist(),
                "weak": std is None or max(error.real, error.imag) > CONFIDENT * model.fundamental,
                **record,
            }
        )
    return for_json(rows)


def lost(reason: str) -> list[Row]:
    """The row of a record without a result."""
    return [{"passed": False, "reason": reason}]


def labelled(rows: list[Row], record: Row) -> list[Row]:
    """The rows with the cells of their record, which says the version too."""
    return [{**row, **record, "floquid": __version__} for row in rows]


MARK = {b"floquid": b"fleet/1"}
FIRST, SHARE = 1.0, 0.01  # a part is written after a second, and then whenever a hundredth of the time has gone by

GROUP = 50_000  # rows of the table that are one group, of some megabytes: small groups are larger than their rows


@dataclass(frozen=True, slots=True)
class Done:
    """A record that was done: its size [bytes], time [ns] and settings, and what came of it."""

    key: tuple[int, int, str]
    reason: str | None
    passed: bool
    modes: int
    result: str | None


@dataclass(slots=True)
class Table:
    """A table that one run writes.

    Parameters
    ----------
    path
        The file.
    done
        Records that are in it, or in parts, by file.
    """

    path: Path
    of: str
    done: dict[str, Done] = field(default_factory=dict)
    _rows: list[Row] = field(default_factory=list)
    _begin: float = field(default_factory=monotonic)
    _due: float = FIRST
    _run: str = ""

    @property
    def parts(self) -> Path:
        """The folder of the parts."""
        return self.path.with_name(f".{self.path.name}.parts")

    def add(self, file: str, rows: Sequence[Row]) -> bool:
        """Take the rows of a record; True where what has come was written."""
        self._rows += rows
        self.done[file] = _done_of(rows)
        passed = monotonic() - self._begin
        if passed < self._due:
            return False
        self._due = passed + max(FIRST, SHARE * passed)
        self.flush()
        return True

    def flush(self) -> None:
        """Write the rows that have come as a part."""
        if not self._rows:
            return
        number = sum(1 for _ in self.parts.glob("*.parquet"))
        with _written(self.parts / f"{number:08d}-{self._run}.parquet", _points(self._rows), self.of) as write:
            write(_arrow().Table.from_pylist(self._rows, schema=_schema(_points(self._rows))))
        self._rows = []

    def finish(self) -> None:
        """Make one table of the earlier one and all parts."""
        self.flush()
        sources = self._sources()
        if not any(source.parent == self.parts for source in sources):
            return
        owner = {
            file: k
            for k, source in enumerate(sources)
            for batch in _read(source, ["file"])
            for file in batch["file"].to_pylist()
        }
        points = sorted({name for source in sources for name in _names(source)} - COLUMNS.keys())
        with _written(self.path, points, self.of) as write:
            waiting, count = [], 0
            for k, source in enumerate(sources):
                for batch in _read(source, None):
                    own = _arrow().array([owner[file] == k for file in batch["file"].to_pylist()], "bool")
                    waiting.append(_widened(_arrow().Table.from_batches([batch]).filter(own), points))
                    count += len(waiting[-1])
                    if count >= GROUP:
                        write(_arrow().concat_tables(waiting))
                        waiting, count = [], 0
            if waiting:
                write(_arrow().concat_tables(waiting))
        shutil.rmtree(self.parts)

    def _sources(self) -> list[Path]:
        """The earlier table and the parts, in the order in which they were written."""
        return [*([self.path] if self.path.exists() else []), *sorted(self.parts.glob("[!.]*.parquet"))]

    def look(self) -> None:
        """Read what was done before."""
        for source in self._sources():
            by_file: dict[str, list[Row]] = {}
            names = ["file", "mode", "size", "modified", "settings", "reason", "passed", "result"]
            for batch in _read(source, names):
                for row in batch.to_pylist():
                    by_file.setdefault(row["file"], []).append(row)
            self.done |= {file: _done_of(rows) for file, rows in by_file.items()}


def _done_of(rows: Sequence[Row]) -> Done:
    first = rows[0]
    key = (first["size"], first["modified"], first["settings"])
    modes = sum(row.get("mode") is not None for row in rows)
    return Done(key, first.get("reason"), bool(first.get("passed")), modes, first.get("result"))


@contextmanager
def opened(path: Path, of: str) -> Iterator[Table]:
    """The table at a path for one run, which no other run may write meanwhile."""
    from filelock import FileLock, Timeout

    load_package("pyarrow.parquet", of, extra="fleet")
    if path.suffix.lower() != ".parquet":
        raise input_error("out", of, "end in .parquet", f"is {path}", "As modes.parquet.")
    if not path.absolute().parent.is_dir():
        raise input_error("out", of, "lie in a folder that exists", f"there is no {path.absolute().parent}")
    if path.exists() and not is_fleet(path):
        must = "be a table of `fleet`, or no file yet"
        raise input_error("out", of, must, f"{path} is another file", "Choose a new name.")
    lock = FileLock(path.with_name(f".{path.name}.lock"), timeout=0.0)
    try:
        with lock:
            table = Table(path, of, _run=secrets.token_hex(4))
            table.parts.mkdir(exist_ok=True)
            table.look()
            try:
                yield table
                table.finish()
            finally:
                try:
                    table.flush()
                finally:
                    with suppress(OSError):  # of a folder only where it is empty
                        Path(lock.lock_file).unlink()
                        table.parts.rmdir()
    except Timeout:
        must, got = "be a table of one run at a time", f"another run is writing {path}"
        raise input_error("out", of, must, got, "Wait for it, or choose another name.") from None


@dataclass(frozen=True, slots=True, kw_only=True)
class Kept:
    """A record of a table, with the result that was kept.

    Parameters
    ----------
    file, result
        The record and its result; None where none was kept.
    reason
        Why there is no result; None where there is one.
    point
        The operating point by quantity.
    """

    file: str
    result: str | None
    reason: str | None
    point: Mapping[str, float]


def is_fleet(path: Path) -> bool:
    """True for a table that `fleet` wrote."""
    try:
        from pyarrow.parquet import read_schema

        return (read_schema(path).metadata or {}).get(b"floquid") == MARK[b"floquid"]
    except (ImportError, OSError, ValueError):
        return False


def kept_results(path: Path) -> list[Kept] | None:
    """The records of the table of a fleet at `path`, with the results that were kept; None of another file."""
    if path.suffix.lower() != ".parquet" or not path.is_file() or not is_fleet(path):
        return None
    found: dict[str, Kept] = {}
    for batch in _read(path, None):
        for row in batch.to_pylist():
            point = {name: value for name, value in row.items() if name not in COLUMNS and value is not None}
            reason = row["reason"] if row["mode"] is None else None
            found[row["file"]] = Kept(file=row["file"], result=row["result"], reason=reason, point=point)
    return list(found.values())


def _arrow() -> Any:
    import pyarrow as pa

    return pa


def _points(rows: Sequence[Row]) -> list[str]:
    """Names of quantities of the operating points in rows."""
    return sorted({name for row in rows for name in row} - COLUMNS.keys())


def _schema(points: Sequence[str]) -> Any:
    pa = _arrow()
    kinds = {"list<int32>": pa.list_(pa.int32()), "list<string>": pa.list_(pa.string())}
    fields = [(name, kinds[kind] if kind in kinds else pa.type_for_alias(kind)) for name, kind in COLUMNS.items()]
    return pa.schema([*fields, *((name, pa.float64()) for name in points)], metadata=MARK)


def _widened(table: Any, points: Sequence[str]) -> Any:
    """A table with all columns, those that it lacks being null."""
    schema = _schema(points)
    columns = [table[f.name] if f.name in table.column_names else _arrow().nulls(len(table), f.type) for f in schema]
    return _arrow().table(columns, schema=schema)


@contextmanager
def _written(path: Path, points: Sequence[str], of: str) -> Iterator[Any]:
    """The writer of a table, which takes its name when it is whole."""
    from pyarrow.parquet import ParquetWriter

    with atomic_path(path, of=of, argument="out") as temporary, ParquetWriter(temporary, _schema(points)) as writer:
        yield writer.write_table


def _names(path: Path) -> list[str]:
    from pyarrow.parquet import read_schema

    return read_schema(path).names


def _read(path: Path, names: Sequence[str] | None) -> Iterator[Any]:
    """Batches of rows of a table."""
    from pyarrow.parquet import ParquetFile

    with ParquetFile(path) as file:
        yield from file.iter_batches(columns=names)
