"""Messages on a file or an object that is read, and on packages that a plain installation does not have."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from floquid._checks import input_error, printable
from floquid.errors import InputError


class DamagedError(ValueError):
    """A file is not as it must be: why, in words."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """A file or an object that a public callable was given.

    Parameters
    ----------
    of, argument
        The callable and its argument, as a message names them.
    name
        The path of the file, or "it".
    """

    of: str
    argument: str = "path"
    name: str = "it"

    @property
    def path(self) -> Path:
        """The name as a path, of a file."""
        return Path(self.name)

    def error(self, must: str, got: str, remedy: str = "") -> InputError:
        """The message «Argument `path` of `read` `must` …, but run.csv `got` …», and a `remedy`."""
        return input_error(self.argument, self.of, must, f"{self.name} {got}", remedy)

    def wrapped(self, error: InputError) -> InputError:
        """An error of a type that knows no file and no object, with its name before it."""
        return self.error("hold a valid record", f"does not: {error}".removesuffix("."))

    @contextmanager
    def taken_apart(self, kind: str, remedy: str) -> Iterator[None]:
        """Turn what a library raises in this block into one message: it is no whole `kind` of file, and a `remedy`."""
        try:
            yield
        except (InputError, MemoryError):
            raise
        except Exception as error:  # noqa: BLE001  # damage raises anything: OSError, struct.error, KeyError, ...
            words = printable(" ".join(str(error).split())).rstrip(". ") or type(error).__name__
            words = f"KeyError: {words}" if isinstance(error, KeyError) else words
            got = f"is not one, or is damaged or cut short ({words})"
            raise self.error(f"be a whole {kind}", got, remedy) from None


_FIRST_BYTES = {
    b"PK\x03\x04": "a ZIP archive such as NumPy's (.npz)",
    b"MATLAB": "a MATLAB file (.mat)",
    b"\x89HDF": "an HDF5 file (.h5)",
    b"RIFF": "a WAV file (.wav)",
    b"TDSm": "a TDMS file (.tdms)",
    b"PAR1": "a Parquet file (.parquet)",
}


def refuse_wrong_name(source: Source, kind: str, remedy: str) -> None:
    """Refuse a `source` that is no whole `kind` of file: by what it seems to be instead, else with a `remedy`."""
    with source.path.open("rb") as stream:
        head = stream.read(512)
    found = next((name for first, name in _FIRST_BYTES.items() if head.startswith(first)), "")
    if not found and head and all(32 <= byte < 127 or byte in b"\t\r\n" for byte in head):
        found = "text (.csv)"
    if found and f"({source.path.suffix.lower()})" not in found:
        raise source.error(f"be {kind}", f"seems to be {found}", "Name it by its format.")
    raise source.error(f"be {kind}", "is not one, or is damaged or cut short", remedy)


def load_package(name: str, of: str, *, extra: str = "") -> Any:
    """The module called `name`, for the public callable `of`; it comes with the `extra`, by default of its own name."""
    try:
        return import_module(name)
    except ImportError as error:
        message = f"`{of}` works with the package {name.partition('.')[0]}, which cannot be imported ({error})."
        raise InputError(f'{message}\n  Install it: pip install "floquid[{extra or name}]"') from None
