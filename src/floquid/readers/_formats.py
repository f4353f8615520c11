"""The table of the formats, and the choice of one by a file's suffix."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, final

from floquid._checks import input_error
from floquid.core import Record
from floquid.io import Source
from floquid.readers._tdms import load_tdms
from floquid.readers._wav import load_wav
from floquid.readers.columns import load_csv, load_parquet, save_csv, save_parquet
from floquid.readers.openfast import load_out, load_outb
from floquid.readers.uff import load_uff, save_uff
from floquid.readers.variables import load_hdf5, load_mat, load_npz, save_hdf5, save_mat, save_npz
from floquid.tables import Table


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
    """

    name: str
    suffix: str
    load: Load
    save: Save | None = None
    needs: str = ""


FORMATS: tuple[Format, ...] = (
    Format(name="NumPy archive", suffix=".npz", load=load_npz, save=save_npz),
    Format(name="text table", suffix=".csv", load=load_csv, save=save_csv),
    Format(name="MATLAB file", suffix=".mat", load=load_mat, save=save_mat),
    Format(name="data file in HDF5", suffix=".h5", load=load_hdf5, save=save_hdf5),
    Format(name="data file in HDF5", suffix=".hdf5", load=load_hdf5, save=save_hdf5),
    Format(name="universal file", suffix=".uff", load=load_uff, save=save_uff),
    Format(name="universal file", suffix=".unv", load=load_uff, save=save_uff),
    Format(name="text output of OpenFAST", suffix=".out", load=load_out),
    Format(name="binary output of OpenFAST", suffix=".outb", load=load_outb),
    Format(name="TDMS file", suffix=".tdms", load=load_tdms, needs="tdms"),
    Format(name="Parquet file", suffix=".parquet", load=load_parquet, save=save_parquet, needs="parquet"),
    Format(name="WAV file", suffix=".wav", load=load_wav),
)

SUFFIXES = ", ".join(kind.suffix for kind in FORMATS)
"""The suffixes in one line, for messages and help."""

WRITTEN = ", ".join(kind.suffix for kind in FORMATS if kind.save)
"""Those of the formats that are written, too."""


def format_of(path: Path, *, of: str) -> Format:
    """The format that the suffix of `path` chooses."""
    for known in FORMATS:
        if path.suffix.lower() == known.suffix:
            return known
    listing = ", ".join(f"{known.suffix} ({known.name})" for known in FORMATS)
    got = f"{path} ends in {path.suffix!r}" if path.suffix else f"{path} has no suffix"
    raise input_error("path", of, f"end in one of {SUFFIXES}", got, f"The formats are: {listing}.")
