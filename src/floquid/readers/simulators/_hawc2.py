"""Time series that HAWC2 writes as text or 16-bit numbers: .sel, with the samples in .dat beside it.

The head has fixed columns. In line 9: the number of samples, that of channels, the length [s], and ASCII or BINARY.
From line 13 a line a channel: its name from column 13, its unit from 44 and what it is from 55. Of binary samples the
scales follow, from three lines below on. Binary samples lie channel by channel, text has a column a channel; the first
channel is the time. HAWC2 also writes HDF5, which `floquid.readers.variables` reads.

Source: `Hawc2io.py` of DTU's Wind Energy Toolbox, and files that HAWC2 wrote.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Floats
from floquid.io import Source
from floquid.tables import Table, TimeColumn, WholeLines, make_channels, numbered, rate_of_step, rows_of

_FIRST = 12  # lines above the channels


def load_sel(source: Source, *, channels: Sequence[str] | None, ignore_time: bool) -> Table:
    """The table of HAWC2's .sel and .dat."""
    lines = source.path.read_text(encoding="latin-1").splitlines()
    with source.taken_apart("head of HAWC2's output", "Run HAWC2 again, or copy the file again."):
        words = lines[8].split()
        n_samples, n_channels, length = int(words[0]), int(words[1]), float(words[2])
        if min(n_samples, n_channels) < 1 or not 0.0 < length < np.inf or n_channels > len(lines) - _FIRST:
            raise ValueError(f"line 9 has {lines[8].strip()!r}")
        is_binary = words[3].upper() == "BINARY"
        heads = lines[_FIRST : _FIRST + n_channels]
        first_scale = _FIRST + n_channels + 2
        scales = np.array([float(line) for line in lines[first_scale : first_scale + n_channels * is_binary]])
        if is_binary and len(scales) != n_channels:
            raise ValueError(f"it has {len(scales)} scales for {n_channels} channels")
    samples = next((file for end in (".dat", ".DAT") if (file := source.path.with_suffix(end)).exists()), None)
    if samples is None:
        got = f"has no {source.path.with_suffix('.dat').name} beside it"
        raise source.error("have its samples beside it", got, "Copy both files into one folder.")
    units = [head[43:54].strip() for head in heads]
    named = make_channels(source, numbered([head[12:43].strip() for head in heads]), [unit or "-" for unit in units])
    has_time = named[0].name.lower() == "time" and n_channels > 1
    named = named[has_time:]
    rows = rows_of(source, named, channels)
    columns = [row + has_time for row in rows]
    step = length / n_samples
    if is_binary:
        raw, notes = _binary(source, samples, n_samples, n_channels)
        values = np.empty((len(columns), n_samples))
        for row, column in zip(values, columns, strict=True):
            np.multiply(raw[column], scales[column], out=row)
        first = float(raw[0, 0] * scales[0]) if has_time else step
        # 16 bits blur the times; a run that is written late begins later than after one step.
        start = step if abs(first - step) <= scales[0] else step * round(first / step)
        notes = ("The samples are packed into 16 bits: about 5 digits of each range.", *notes)
        time, rate = None, rate_of_step(step)
    else:
        table, notes = _text(source, samples, n_samples, n_channels)
        values = np.ascontiguousarray(table[:, columns].T)
        start, rate = None, None if has_time else rate_of_step(step)
        time = TimeColumn(values=table[:, 0].copy(), scale=1.0, label="Time") if has_time else None
    return Table(
        values=values,
        channels=tuple(named[row] for row in rows),
        sample_rate=None if ignore_time else rate,
        start=None if ignore_time else start,
        time=None if ignore_time else time,
        notes=notes,
    )


def _binary(source: Source, path: Path, n_samples: int, n_channels: int) -> tuple[NDArray[np.int16], tuple[str, ...]]:
    """The counts (channels, samples), and a note on what is behind them."""
    size, expected = path.stat().st_size, 2 * n_samples * n_channels
    if size < expected:
        got = f"declares {n_channels} channels of {n_samples} samples, and {path.name} has {size} of {expected} bytes"
        raise source.error("have all its samples beside it", got, "Run HAWC2 to its end, or copy both files again.")
    left = f"{path.name} has {size - expected} bytes behind its samples, which are not used."
    return np.fromfile(path, "<i2", n_samples * n_channels).reshape(n_channels, n_samples), (left,) * (size > expected)


def _text(source: Source, path: Path, n_samples: int, n_channels: int) -> tuple[Floats, tuple[str, ...]]:
    """The rows (samples, channels), and a note where some are missing."""
    with source.taken_apart("text output of HAWC2", "Mend that line of the .dat, or leave it out."):
        with path.open(encoding="latin-1") as stream:
            body = WholeLines((number, line) for number, line in enumerate(stream, 1) if line.strip())
            table = np.loadtxt((line for _, line in body), ndmin=2)
        if table.shape[1] != n_channels:
            raise ValueError(f"{path.name} has {table.shape[1]} columns for {n_channels} channels")
    short = f"The file is cut short: it declares {n_samples} samples, and {len(table)} are there."
    return table, (*body.notes, *(short,) * (len(table) < n_samples))
