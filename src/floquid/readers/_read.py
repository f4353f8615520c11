"""Files to records and back: the table of the formats, and the choice of one by a file's suffix."""

from __future__ import annotations

import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any, Literal, Protocol, final, overload

import numpy as np

from floquid._checks import an_instance, input_error, wrong_value
from floquid.core import Channel, ConstantPeriod, LazyRecord, Record
from floquid.io import GUARD, DamagedError, Source, as_path, atomic_path, readable_file
from floquid.readers._csv import load_csv, load_xlsx, save_csv
from floquid.readers._parquet import load_parquet, save_parquet
from floquid.readers.recorders import SAMPLES, load_comtrade, load_mdf, load_tdms, load_wav
from floquid.readers.simulators import load_out, load_outb, load_sel
from floquid.readers.uff import load_uff, save_uff
from floquid.readers.variables import (
    load_hdf5,
    load_mat,
    load_npy,
    load_npz,
    refuse_packed,
    save_hdf5,
    save_mat,
    save_npz,
)
from floquid.tables import Table, check_table, record_of, with_names, without_counters

LAZY = (".h5", ".hdf5", ".npy")
"""Suffixes of files whose records may stay on the disk."""


def read_lazily(
    path: str | PathLike[str],
    *,
    period: float | None,
    rate: float | None,
    channels: Sequence[str] | None,
    origin: float,
) -> LazyRecord:
    """The record of a file without its values: what `read` with `lazy=True` gives."""
    file, of = readable_file(path, of="read"), "read"
    if file.suffix.lower() not in LAZY:
        must, got = f"end in one of {', '.join(LAZY)} with `lazy=True`", f"is {file}"
        raise input_error("path", of, must, got, "Other formats are read whole, without it.")
    source = Source(of=of, name=str(file))
    said: dict[str, Any] = {}
    if file.suffix.lower() == ".npy":
        array = np.load(file, mmap_mode="r")
        if channels is not None:
            raise input_error("channels", of, "be left out of a lazy .npy", "is given", "Rows have no names there.")
    else:
        array, said = _hdf5(source, file, channels)
    if array.ndim != 2 or array.dtype.kind not in "fiu":
        must = "hold one matrix of real numbers (channels, samples)"
        raise source.error(must, f"has {array.dtype} of shape {array.shape}", "Save it as such.")
    hertz = rate if rate is not None else said.get("sample_rate")
    if hertz is None:
        raise source.error("say its `sample_rate` [Hz]", "does not", "Pass `rate=`.")
    seconds = period if period is not None else said.get("period")
    names = said.get("channels") or [f"{row}" for row in range(1, array.shape[0] + 1)]
    units = said.get("units") or ["-"] * len(names)
    return LazyRecord(
        array=array,
        sample_rate=float(hertz),
        channels=tuple(Channel(name=name, unit=unit) for name, unit in zip(names, units, strict=False)),
        clock=None if seconds is None else ConstantPeriod(period=float(seconds), origin=origin),
        start=float(said.get("start", 0.0)),
        source=str(file),
    )


def _hdf5(source: Source, file: Path, channels: Sequence[str] | None) -> tuple[Any, dict[str, Any]]:
    """The matrix of an HDF5 file, which stays open with it, and what the file says of it."""
    import h5py

    if channels is not None and len(channels) != 1:
        must, got = "name one matrix of a lazy HDF5 file", f"has {len(channels)} names"
        raise input_error("channels", "read", must, got, "Its rows are all channels.")
    name = "values" if channels is None else channels[0]
    try:
        opened = h5py.File(file, "r")
        array = opened[name]
        said: dict[str, Any] = {}
        for key in ("sample_rate", "period", "start"):
            if key in opened:
                said[key] = float(np.asarray(opened[key]).reshape(-1)[0])
        for key in ("channels", "units"):
            if key in opened and channels is None:
                said[key] = [str(text) for text in opened[key].asstr()[()].tolist()]
    except (OSError, KeyError, TypeError, ValueError) as error:
        must = f"hold a matrix `{name}` (channels, samples) that can be read"
        raise source.error(must, f"does not ({str(error).splitlines()[0]})", "Name it by `channels=`.") from None
    if not isinstance(array, h5py.Dataset):
        raise source.error(f"hold a matrix `{name}` (channels, samples)", "has a group there", "Name the matrix.")
    refuse_packed(source, opened, array)
    return array, said


class Load(Protocol):
    """Reads a file into a table: all channels or those named, and its times unless they are to be ignored."""

    def __call__(self, source: Source, *, channels: Sequence[str] | None, ignore_time: bool) -> Table: ...


class Save(Protocol):
    """Writes a record to a path that may be written to."""

    def __call__(self, record: Record, path: Path) -> None: ...


@final
@dataclass(frozen=True, slots=True, kw_only=True)
class Format:
    """A file format.

    Parameters
    ----------
    name
        What people call it.
    suffix
        The suffix that chooses it, in lower case with its dot.
    load, save
        From a file to its table, and from a record to a file; None of a format that is only read.
    needs
        The extra that it needs, as in `pip install "floquid[tdms]"`; empty where a plain installation has all.
    guarded
        A damaged file can end its decoder, or keep it busy without end: it works in the child process.
    beside
        Suffixes of a file with the samples beside it, which counts for how long taking it apart may take.
    """

    name: str
    suffix: str
    load: Load
    save: Save | None = None
    needs: str = ""
    guarded: bool = False
    beside: tuple[str, ...] = ()

    def largest(self, path: Path) -> Path:
        """The larger one of the file at a `path` and that with its samples beside it."""
        files = [path, *(file for end in self.beside if (file := path.with_suffix(end)).exists())]
        return max(files, key=lambda file: file.stat().st_size)


FORMATS: tuple[Format, ...] = (
    Format(name="NumPy archive", suffix=".npz", load=load_npz, save=save_npz),
    Format(name="text table", suffix=".csv", load=load_csv, save=save_csv),
    *(Format(name="text table", suffix=suffix, load=load_csv) for suffix in (".txt", ".dat", ".asc", ".tsv", ".lvm")),
    Format(name="workbook", suffix=".xlsx", load=load_xlsx, needs="excel", guarded=True),
    Format(name="MATLAB file", suffix=".mat", load=load_mat, save=save_mat, guarded=True),
    Format(name="data file in HDF5", suffix=".h5", load=load_hdf5, save=save_hdf5, guarded=True),
    Format(name="data file in HDF5", suffix=".hdf5", load=load_hdf5, save=save_hdf5, guarded=True),
    Format(name="universal file", suffix=".uff", load=load_uff, save=save_uff),
    Format(name="universal file", suffix=".unv", load=load_uff, save=save_uff),
    Format(name="text output of OpenFAST", suffix=".out", load=load_out),
    Format(name="binary output of OpenFAST", suffix=".outb", load=load_outb),
    Format(name="TDMS file", suffix=".tdms", load=load_tdms, needs="tdms", guarded=True),
    Format(name="Parquet file", suffix=".parquet", load=load_parquet, save=save_parquet, needs="parquet", guarded=True),
    Format(name="WAV file", suffix=".wav", load=load_wav),
    Format(name="NumPy array", suffix=".npy", load=load_npy),
    Format(
        name="COMTRADE file",
        suffix=".cfg",
        load=load_comtrade,
        needs="comtrade",
        guarded=True,
        beside=SAMPLES,
    ),
    Format(name="COMTRADE file", suffix=".cff", load=load_comtrade, needs="comtrade", guarded=True),
    Format(name="MDF file", suffix=".mf4", load=load_mdf, needs="mdf", guarded=True),
    Format(name="MDF file", suffix=".mdf", load=load_mdf, needs="mdf", guarded=True),
    Format(name="output of HAWC2", suffix=".sel", load=load_sel),
)

SUFFIXES = ", ".join(kind.suffix for kind in FORMATS)
"""The suffixes in one line, for messages and help."""

WRITTEN = ", ".join(kind.suffix for kind in FORMATS if kind.save)
"""Suffixes of the formats that are written, too."""


def format_of(path: Path, *, of: str) -> Format:
    """The format that the suffix of `path` chooses."""
    for known in FORMATS:
        if path.suffix.lower() == known.suffix:
            return known
    if path.is_dir():
        raise input_error("path", of, "be a file", f"{path} is a folder", "Name the files in it.")
    listing = ", ".join(f"{known.suffix} ({known.name})" for known in FORMATS)
    got = f"{path} ends in {path.suffix!r}" if path.suffix else f"{path} has no suffix"
    raise input_error("path", of, f"end in one of {SUFFIXES}", got, f"The formats are: {listing}.")


@overload
def read(
    path: str | PathLike[str],
    *,
    period: float | None = None,
    rate: float | None = None,
    channels: Sequence[str] | None = None,
    names: Sequence[str] | None = None,
    origin: float = 0.0,
    header: bool = True,
    lazy: Literal[False] = False,
) -> Record: ...


@overload
def read(
    path: str | PathLike[str],
    *,
    period: float | None = None,
    rate: float | None = None,
    channels: Sequence[str] | None = None,
    names: Sequence[str] | None = None,
    origin: float = 0.0,
    header: bool = True,
    lazy: Literal[True],
) -> LazyRecord: ...


def read(
    path: str | PathLike[str],
    *,
    period: float | None = None,
    rate: float | None = None,
    channels: Sequence[str] | None = None,
    names: Sequence[str] | None = None,
    origin: float = 0.0,
    header: bool = True,
    lazy: bool = False,
) -> Record | LazyRecord:
    """The record (channels, samples) in a file: sample n is at `start` + n/`rate` [s].

    The format is chosen by the suffix. `.npz`: `values` (channels, samples), `sample_rate` [Hz] or `time` (samples,)
    [s], `channels`, and optionally `units`, `quantities`, `start` [s], `period` [s], `origin` [s], `orbit` (channels,
    phases); a single number of another name is part of the operating point (`Record.point`). Text tables (`.csv`,
    `.txt`, `.dat`, `.asc`, `.tsv`, `.lvm`, and `.xlsx` with python-calamine): a header row, a time column in a unit or
    of dates, then channels, units in brackets or in a row below; an empty cell or `nan` is a missing sample. `.mat`
    (MATLAB v4 to v7.3), `.h5` and `.hdf5`: the names of `.npz`. A file of these four without `values` is read by the
    paths of its variables in `channels`: `run/acc/x` is a vector of samples, `data[2]` row 2 of a matrix (channels,
    samples), counted from 0. `data.T[2]` is column 2 of one (samples, channels), and `data` or `data.T` all of them.
    `Y[1]/Data` is in element 1 of a struct array, and `Y` all its elements. A vector `time` or `t` [s] beside them
    gives the rate, or a number called `sample_rate`, `fs`, `dt` or the like. `.npy`: one array, `data`. `.uff` and
    `.unv`: the time responses of a universal file. `.out` and `.outb`: output of OpenFAST. `.tdms` (needs npTDMS):
    channels of numbers, by their names, or as `group/channel`. `.parquet` (needs pyarrow): columns headed as in
    `.csv`, or dates for the times. `.wav`: whole numbers over full scale, others as they are. `.cfg` with `.dat`, or
    `.cff` (needs comtrade), `.mf4` and `.mdf` (needs asammdf): channels with one rate. `.sel` with `.dat`: output of
    HAWC2.

    A time column is repaired, not trusted: the rate is fitted to the whole column, and is a nominal value where the
    evidence is clear. Gaps of whole steps become missing samples, and `provenance` says so.

    Raises InputError where the file is missing, damaged, of an unknown format or not what it must be; it says no rate
    and none is given; an argument is not possible. The message names the file, the place in it and the way out.

    Parameters
    ----------
    path
        The file.
    period
        The period T of the system [s]; attaches `ConstantPeriod(period, origin)`. None takes the file's own, if it
        states one.
    rate
        The sampling rate [Hz]; takes precedence over what the file says. A time column is then ignored and the record
        starts at zero, or at the file's `start`.
    channels
        The names of the channels to read, in that order, or the paths of their variables; None reads all.
    names
        Names to give the channels, in that order; fewer leave the others as they are. One may be the path of a variable
        of texts, such as `labels`, one for each row of the matrix that is read. None leaves all.
    origin
        The time of phase zero [s].
    header
        False for a text table without a line of names: its columns are called 1, 2, 3, and the first is the time where
        it increases.
    lazy
        True leaves the values on the disk: a `LazyRecord`, of an HDF5 file with a matrix `values`, or the one that
        `channels` names, or of a `.npy` file.
    """
    if lazy and (names is not None or not header):
        got = "is given" if names is not None else "is False"
        option = "names" if names is not None else "header"
        must = "be left out with `lazy=True`"
        raise input_error(option, "read", must, got, "Read the record whole, or leave it out.")
    if lazy:
        return read_lazily(path, period=period, rate=rate, channels=channels, origin=origin)
    source, kind, table = load_table(path, of="read", channels=channels, ignore_time=rate is not None, header=header)
    table = table if names is None else with_names(table, names, source)
    n_channels, n_samples = table.values.shape
    step = f"Read {n_channels} channels of {n_samples} samples from a {kind.name} ({kind.suffix})."
    record = record_of(table, source, rate=rate, period=period, origin=origin, step=step)
    if record.n_samples < 2:
        raise source.error("hold at least two samples", f"holds {record.n_samples}", "Export more of the record.")
    return record


def write(record: Record, path: str | PathLike[str]) -> None:
    """Write `record` to a file that `read` gives back as it was, except for its provenance.

    The format is chosen by the suffix: .npz, .csv, .mat, .h5, .hdf5, .uff, .unv or .parquet. The file
    appears whole or not at all: an existing one is replaced at the end, in one step.

    The folder of `path` exists. Raises InputError where `record` has fewer than two samples, a name holds a control
    character, or the suffix is not of a format that is written. So it does where the folder does not exist or cannot be
    written to.
    """
    an_instance(record, Record, "record", "write", "Pass Record(values=..., ...).")
    file = as_path(path, of="write")
    kind = format_of(file, of="write")
    if kind.save is None:
        got = f"{file} would be a {kind.name}"
        raise input_error("path", "write", f"end in one of {WRITTEN}", got, "The others are only read.")
    if record.n_samples < 2:
        raise input_error("record", "write", "hold at least two samples", f"holds {record.n_samples}")
    for channel in record.channels:
        for text in (channel.name, channel.unit, channel.location, channel.direction, channel.place):
            if any(unicodedata.category(letter) in ("Cc", "Cs") for letter in text):
                must = "have channels described in plain words"
                raise input_error("record", "write", must, f"has {text!r}", "Rename that channel.")
    with atomic_path(file, of="write") as temporary:
        kind.save(record, temporary)


def load_table(
    path: str | PathLike[str], *, of: str, channels: Sequence[str] | None, ignore_time: bool, header: bool
) -> tuple[Source, Format, Table]:
    """The content of a file, checked except for its time axis."""
    source = Source(of=of, name=str(as_path(path, of=of)))
    kind = format_of(source.path, of=of)
    readable_file(path, of=of)
    if channels is not None and (isinstance(channels, str) or len(channels) == 0):
        raise wrong_value("channels", of, "be a list of names, at least one", channels)
    load = partial(kind.load, source, channels=channels, ignore_time=ignore_time)
    if not header:
        if kind.load not in (load_csv, load_xlsx):
            raise input_error("header", of, "be False for a text table alone", f"{source.name} is a {kind.name}")
        load = partial(load, header=False)
    try:
        table = GUARD.call(kind.largest(source.path), load) if kind.guarded else load()
    except DamagedError as error:
        raise source.error(f"be a whole {kind.name}", f"is damaged: {error}", "Copy it again.") from None
    except (OSError, MemoryError) as error:
        must = "be readable to its end"
        raise source.error(must, f"is not ({error or type(error).__name__})", "Copy it again.") from error
    check_table(table, source)
    return source, kind, without_counters(table) if channels is None else table
