"""`floquid convert`: a record from one format to another, or the modes of a result to other programs."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from floquid._checks import input_error
from floquid.cli._convert_modes import convert_modes
from floquid.cli._options import Debug, NewRecordFile, RecordFile, split
from floquid.cli._progress import progress
from floquid.cli._records import period_of
from floquid.cli._terminal import counted, terminal
from floquid.core import Record
from floquid.errors import InputError
from floquid.io import attribute
from floquid.readers import read, write

OF = "floquid convert"


def convert(
    file: RecordFile,
    out: NewRecordFile,
    /,
    *,
    channels: str | None = None,
    rate: float | None = None,
    period: float | None = None,
    frequency: float | None = None,
    origin: float = 0.0,
    debug: Debug = False,
) -> None:
    """Write a record in another format, and say what that format could not hold; or the modes of a result.

    Of a result.h5, or of the folder that it is in, the modes are written for other programs: OUT ends in .uff, .unv,
    .mat, .csv or .json then, and there are no options.

    Parameters
    ----------
    file
        The record, or the result.
    out
        The file to write: its suffix chooses the format.
    channels
        The channels to keep, comma-separated, in that order; all when not given.
    rate
        The sampling rate [Hz], overriding what the file says.
    period
        The period of the system [s], to be kept with the record.
    frequency
        The fundamental frequency [Hz], one over the period; instead of --period.
    origin
        The time of phase zero [s].
    debug
        Show the traceback of an error.
    """
    del debug
    _refuse_same(file, out)
    if file.is_dir() or _is_result(file):
        options = {"channels": channels, "rate": rate, "period": period, "frequency": frequency}
        convert_modes(file, out, options | {"origin": origin or None})
        return
    with progress(3) as report:
        report(f"reading {file.name}")
        named = None if channels is None else split(channels)
        record = read(file, rate=rate, period=period_of(period, frequency, OF), channels=named, origin=origin)
        report(f"writing {out.name}")
        _write(record, out)
        report("reading it back")
        lost = differences(record, read(out))
    console = terminal()
    console.print(
        f"Written to {out}: {counted(record.n_channels, 'channel')}, {counted(record.n_samples, 'sample')} at "
        f"{record.sample_rate:.10g} Hz.",
        soft_wrap=True,
    )
    for words in lost:
        console.print(f"Not kept: {words}.", soft_wrap=True)


def _refuse_same(file: Path, out: Path) -> None:
    with suppress(OSError):
        if out.resolve() == file.resolve() or out.samefile(file):
            got = f"{out} is the file that is read"
            raise input_error("OUT", OF, "be another file", got, "Give the new file a name of its own.")


def _is_result(file: Path) -> bool:
    """Whether it is a file that `identify` wrote."""
    import h5py

    if file.suffix.lower() not in (".h5", ".hdf5"):
        return False
    try:
        with h5py.File(file, "r") as stored:
            return attribute(stored, "format") == "floquid-result"
    except (OSError, RuntimeError, ValueError, KeyError, TypeError):
        return False  # whatever it is, the reader will say what is wrong with it


def _write(record: Record, out: Path) -> None:
    try:
        write(record, out)
    except InputError as error:  # the path of `write` is an option elsewhere, and OUT here
        raise InputError(str(error).replace("`path` of `write`", f"`OUT` of `{OF}`")) from None


def differences(record: Record, found: Record) -> list[str]:
    """In words, what of `record` is not in `found`, which was read from the file that it was written to."""
    pairs = {
        "every sample as it was": _same(record.values, found.values),
        f"the rate of {record.sample_rate!r} Hz": record.sample_rate == found.sample_rate,
        f"the start at {record.start!r} s": record.start == found.start,
        "the words on the channels (names, units, places)": record.channels == found.channels,
        "the clock": record.clock == found.clock,
        "the orbit": _same(record.orbit, found.orbit),
    }
    return [words for words, kept in pairs.items() if not kept]


def _same(one: NDArray[np.float64] | None, other: NDArray[np.float64] | None) -> bool:
    if one is None or other is None:
        return one is other
    return np.array_equal(one, other, equal_nan=True)
