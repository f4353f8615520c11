"""Files: one that must be there to be read, one written whole or not at all, and messages on what is read."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from floquid._checks import input_error, printable, wrong_value
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


def seems_to_be(path: Path) -> str:
    """The kind of file at `path` by its first bytes, in words; empty where they are of no kind that is known."""
    with path.open("rb") as stream:
        head = stream.read(512)
    found = next((name for first, name in _FIRST_BYTES.items() if head.startswith(first)), "")
    is_text = head and all(32 <= byte < 127 or byte in b"\t\r\n" for byte in head)
    return found or ("text (.csv)" if is_text else "")


def refuse_wrong_name(source: Source, kind: str, remedy: str) -> None:
    """Refuse a `source` that is no whole `kind` of file: by what it seems to be instead, else with a `remedy`."""
    found = seems_to_be(source.path)
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


_WRITABLE = "Choose a folder that exists and that you may write to."


def as_path(path: object, *, of: str, argument: str = "path") -> Path:
    """`path` as a `Path`, the `argument` of the public callable `of`."""
    if not isinstance(path, (str, os.PathLike)):
        raise wrong_value(argument, of, "be the path of a file", path, "Pass a string or a Path.")
    text = os.fspath(path)
    if not isinstance(text, str) or not text or "\0" in text:
        raise wrong_value(argument, of, "be the path of a file", text, "Pass a string or a Path.")
    return Path(text)


def readable_file(path: object, *, of: str, argument: str = "path") -> Path:
    """`path`, the `argument` of `of`, as that of a regular file that can be opened and is not empty."""
    file = as_path(path, of=of, argument=argument)
    must = "be the path of a file that can be read"
    try:
        if file.is_dir():
            raise input_error(argument, of, must, f"{file} is a folder", "Name a file in it.")
        if file.exists() and not file.is_file():
            raise input_error(argument, of, must, f"{file} is not a regular file", "Copy its content to a file first.")
        with file.open("rb") as stream:
            if not stream.read(1):
                raise input_error(argument, of, must, f"{file} is empty", "Export or copy it again.")
    except FileNotFoundError:
        raise input_error(argument, of, must, f"there is no file {file}", "Check the name and the folder.") from None
    except OSError as error:
        got = f"{file} cannot be opened ({_reason(error)})"
        raise input_error(argument, of, must, got, "Check its permissions and its name.") from None
    return file


@contextmanager
def atomic_path(path: object, *, of: str = "write", argument: str = "path") -> Iterator[Path]:
    """A temporary path beside `path` (`argument` of `of`), of its suffix, that takes its name when the block ends well.

    Write to the path that is yielded. At the end of the block the file is flushed to the disk and renamed. So `path`
    holds either its old content or all of the new file. When the block raises, the temporary file is removed and `path`
    is untouched.
    """
    target = as_path(path, of=of, argument=argument)
    must = "be a path that can be written"
    temporary: Path | None = None
    try:
        target = target.resolve()  # through a symbolic link, so that the link stays and its file is replaced
        if target.is_symlink():  # Python 3.13 passes over a loop
            raise OSError(errno.ELOOP, os.strerror(errno.ELOOP))
        if target.is_dir():
            raise input_error(argument, of, must, f"{target} is a folder", "Name a file in it.")
        if not target.parent.is_dir():
            raise input_error(argument, of, must, f"there is no folder {target.parent}", _WRITABLE)
        made = target.with_name(f".{os.urandom(6).hex()}-{target.name[-100:]}")
        os.close(os.open(made, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
        temporary = made
        if target.exists():
            temporary.chmod(target.stat().st_mode & 0o777)
        yield temporary
        flush(temporary)
        temporary.replace(target)
        temporary = None
        flush_folder(target.parent)
    except InputError:
        raise
    except (OSError, RuntimeError) as error:
        if isinstance(error, RuntimeError) and temporary is not None:
            raise  # the block's own; only resolving a loop of symbolic links, before Python 3.13, is ours
        raise input_error(argument, of, must, f"{target} cannot be ({_reason(error)})", _WRITABLE) from error
    finally:
        if temporary is not None:
            with suppress(OSError):
                temporary.unlink()


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error) or type(error).__name__


def flush(file: Path) -> None:
    """Wait until the content of a file is on the disk."""
    with file.open("r+b") as stream:
        os.fsync(stream.fileno())


def flush_folder(folder: Path) -> None:
    """Make the new name itself durable; some systems cannot open a folder, and the file is whole all the same."""
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
