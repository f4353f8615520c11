"""Files of the disk: one that must be there to be read, and one that is written whole or not at all."""

from __future__ import annotations

import errno
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from floquid._checks import describe, input_error
from floquid.errors import InputError

_WRITABLE = "Choose a folder that exists and that you may write to."


def as_path(path: object, *, of: str, argument: str = "path") -> Path:
    """`path` as a `Path`, the `argument` of the public callable `of`."""
    if not isinstance(path, (str, os.PathLike)):
        raise input_error(argument, of, "be the path of a file", f"is {describe(path)}", "Pass a string or a Path.")
    text = os.fspath(path)
    if not isinstance(text, str) or not text or "\0" in text:
        raise input_error(argument, of, "be the path of a file", f"is {describe(text)}", "Pass a string or a Path.")
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
        made = target.with_name(f".{secrets.token_hex(6)}-{target.name[-100:]}")
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
