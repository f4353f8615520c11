"""A record whose values stay where they are: on a disk, or in an array that is computed when it is asked for."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np

from floquid._arrays import Floats
from floquid._checks import input_error, positive
from floquid.core._channel import Channel
from floquid.core._clock import ConstantPeriod

NUMBER = 8  # bytes of a sample in memory, whatever it is on the disk


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LazyRecord:
    """Samples of several channels at a constant rate, read in blocks: what `read(..., lazy=True)` gives.

    Parameters
    ----------
    array
        The samples (channels, samples): a dataset of HDF5, a memory map, an array of dask or Zarr, or the data of an
        xarray object. Whatever has a shape and gives an array for two slices.
    sample_rate
        Samples a second [Hz].
    channels
        One `Channel` a row.
    clock
        The constant period of the system; None where it is not known.
    start
        The time of the first sample [s].
    source
        Where the record comes from.
    """

    array: Any
    sample_rate: float
    channels: tuple[Channel, ...]
    clock: ConstantPeriod | None = None
    start: float = 0.0
    source: str = ""

    def __post_init__(self) -> None:
        shape, of = tuple(getattr(self.array, "shape", ())), "LazyRecord"
        if len(shape) != 2 or 0 in shape:
            raise input_error("array", of, "have the axes (channels, samples)", f"has the shape {shape}")
        if shape[0] != len(self.channels):
            must, got = f"be {shape[0]}, one a row of the array", f"are {len(self.channels)}"
            raise input_error("channels", of, must, got, "Time is the last axis.")
        positive(self.sample_rate, "sample_rate", of, unit="Hz")

    def __repr__(self) -> str:
        size = f"{self.n_channels} channels of {self.n_samples} samples"
        return f"LazyRecord({self.source}: {size} at {self.sample_rate:.8g} Hz; {self.clock!r:.80})"

    @property
    def n_channels(self) -> int:
        """The number of channels."""
        return int(self.array.shape[0])

    @property
    def n_samples(self) -> int:
        """The number of samples of each channel."""
        return int(self.array.shape[1])

    @property
    def values(self) -> NoReturn:
        """Refused with an InputError: the values may be larger than memory, and `blocks` gives them in parts."""
        must = "be read in blocks, since it may be larger than memory"
        raise input_error("values", "LazyRecord", must, "was asked for as a whole", "Take them from `.blocks()`.")

    def blocks(
        self, memory: float = 2**26, *, whole: int = 1, samples: int | None = None
    ) -> Iterator[tuple[slice, slice, Floats]]:
        """Parts of the values, channel by channel: their rows, their samples, and an array (rows, samples).

        All samples of some channels at once where these have room, else stretches of some channels one after the other.

        Parameters
        ----------
        memory
            Bytes that a part may have, at least one period of one channel.
        whole
            Samples that are never parted: those of a period.
        samples
            Samples of each channel that are read, all by default.
        """
        rows_of, length = self._steps(memory, whole, samples := samples or self.n_samples)
        for row in range(0, self.n_channels, rows_of):
            rows = slice(row, min(row + rows_of, self.n_channels))
            for first in range(0, samples, length):
                part = slice(first, min(first + length, samples))
                yield rows, part, np.asarray(self.array[rows, part], np.float64)

    def _steps(self, memory: float, whole: int, samples: int) -> tuple[int, int]:
        """Channels and samples of a part: whole chunks of the file where they have room."""
        most = int(memory // NUMBER)
        least = min(int((getattr(self.array, "chunks", None) or (1,))[0]), self.n_channels) if _chunked(self) else 1
        if least * whole > most:
            least = 1
        if whole > most:
            must, got = f"hold a period of one channel, {NUMBER * whole} bytes", f"leaves {int(memory)} bytes for it"
            raise input_error("memory", "LazyRecord.blocks", must, got, "Allow more.")
        if least * samples <= most:
            return least * max(most // (least * samples), 1), samples
        return least, max(most // least // whole, 1) * whole


def _chunked(record: LazyRecord) -> bool:
    """True where the array is in chunks of whole numbers of rows, as HDF5 and Zarr have them."""
    chunks = getattr(record.array, "chunks", None)
    return bool(chunks) and isinstance(chunks[0], int)
