"""Files to records and back."""

from __future__ import annotations

import unicodedata
from collections.abc import Sequence
from os import PathLike

from floquid._checks import describe, input_error
from floquid.core import Record
from floquid.io import Source, as_path, atomic_path, readable_file
from floquid.readers._formats import WRITTEN, Format, format_of
from floquid.tables import Table, check_table, record_of


def read(
    path: str | PathLike[str],
    *,
    period: float | None = None,
    rate: float | None = None,
    channels: Sequence[str] | None = None,
    origin: float = 0.0,
) -> Record:
    """The record (channels, samples) in a file: sample n is at `start` + n/`rate` [s].

    The format is chosen by the suffix. `.npz`: `values` (channels, samples), `sample_rate` [Hz] or `time` (samples,)
    [s], `channels`, and optionally `units`, `quantities`, `start` [s], `period` [s], `origin` [s],
    `orbit` (channels, phases). `.csv`: a header
    row, a time column, then channels, units in brackets; an empty cell or `nan` is a missing sample. `.mat` (MATLAB v5
    to v7.3), `.h5` and `.hdf5`: the names of `.npz`. A file of these four without `values` is read by the paths of its
    variables in `channels`: `run/acc/x` is a vector of samples, `data[2]` row 2 of a matrix (channels, samples),
    counted from 0, `data.T[2]` column 2 of one (samples, channels), and `data` or `data.T` all of them. A vector `time`
    or `t` [s] beside them gives the rate, or a number `sample_rate` [Hz]. `.uff` and `.unv`: the time responses of a
    universal file. `.out` and `.outb`: output of OpenFAST. `.tdms` (needs npTDMS): channels of numbers, by their names,
    or as `group/channel`. `.parquet` (needs pyarrow): columns headed as in `.csv`, or dates for the times. `.wav`:
    whole numbers over full scale, others as they are.

    A time column is repaired, not trusted: the rate is fitted to the whole column and snapped to a nominal value where
    the evidence is clear, gaps of whole steps become missing samples, and `provenance` says so.

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
    origin
        The time of phase zero [s].

    Returns
    -------
    Record
        The record, with its provenance.

    Raises
    ------
    InputError
        The file is missing, damaged, of an unknown format or not what it must be; it says no rate and none is given;
        an argument is not possible. The message names the file, the place in it and the way out.
    """
    source, kind, table = load_table(path, of="read", channels=channels, ignore_time=rate is not None)
    n_channels, n_samples = table.values.shape
    step = f"Read {n_channels} channels of {n_samples} samples from a {kind.name} ({kind.suffix})."
    record = record_of(table, source, rate=rate, period=period, origin=origin, step=step)
    if record.n_samples < 2:
        raise source.error("hold at least two samples", f"holds {record.n_samples}", "Export more of the record.")
    return record


def write(record: Record, path: str | PathLike[str]) -> None:
    """Write `record` to a file that `read` gives back as it was, but for its provenance.

    The format is chosen by the suffix: .npz, .csv, .mat, .h5, .hdf5, .uff, .unv or .parquet. The file
    appears whole or not at all: an existing one is replaced at the end, in one step.

    Parameters
    ----------
    record
        The record.
    path
        The file, in a folder that exists.

    Raises
    ------
    InputError
        `record` is not a record of at least two samples, a name holds a control character, the suffix is not
        of a format that is written, or the folder does not exist or cannot be written to.
    """
    if not isinstance(record, Record):
        raise input_error("record", "write", "be a Record", f"is {describe(record)}", "Pass Record(values=..., ...).")
    file = as_path(path, of="write")
    kind = format_of(file, of="write")
    if kind.save is None:
        got = f"{file} would be a {kind.name}"
        raise input_error("path", "write", f"end in one of {WRITTEN}", got, "The others are only read.")
    if record.n_samples < 2:
        raise input_error("record", "write", "hold at least two samples", f"holds {record.n_samples}")
    for channel in record.channels:
        for text in (channel.name, channel.unit, channel.location, channel.direction):
            if any(unicodedata.category(letter) in ("Cc", "Cs") for letter in text):
                raise input_error(
                    "record", "write", "have channels described in plain words", f"has {text!r}", "Rename that channel."
                )
    with atomic_path(file, of="write") as temporary:
        kind.save(record, temporary)


def load_table(
    path: str | PathLike[str], *, of: str, channels: Sequence[str] | None, ignore_time: bool
) -> tuple[Source, Format, Table]:
    """The content of a file, checked but for its time axis."""
    source = Source(of=of, name=str(as_path(path, of=of)))
    kind = format_of(source.path, of=of)
    readable_file(path, of=of)
    if channels is not None and (isinstance(channels, str) or len(channels) == 0):
        raise input_error("channels", of, "be a list of names, at least one", f"is {channels!r}")
    try:
        table = kind.load(source, channels=channels, ignore_time=ignore_time)
    except (OSError, MemoryError) as error:
        raise source.error(
            "be readable to its end", f"is not ({error or type(error).__name__})", "Copy it again."
        ) from error
    check_table(table, source)
    return source, kind, table
