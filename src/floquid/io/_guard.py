"""Files taken apart in a child process: where a decoder in C ends on a damaged file, the child ends and we do not.

HDF5, scipy's reader of MATLAB files and pyarrow follow what a file says of itself; a wrong byte can make them write
where nothing is theirs, or count for hours. The child is kept while the program runs, so that the first file alone
waits for its start.
"""

from __future__ import annotations

import atexit
import os
import pickle
import signal
import struct
import subprocess
import sys
import traceback
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from threading import Lock
from typing import Any, BinaryIO, cast

import numpy as np

from floquid.errors import FloquidError
from floquid.io._files import DamagedError

SECONDS, SECONDS_A_BYTE = 8, 1e-6
"""Time of the processor that one file may take, and more of it by its size.

A result whose record is resampled takes 6e-8 s a byte, records 1e-9 to 6e-9, on a core of 2024; slow ones take several
times that.
"""

RESERVED = 4 << 30  # bytes of addresses that libraries take beyond the memory that they use: pyarrow 2 GB

_LENGTH = struct.Struct("<Q")
_THERE = b"floquid reads"


class Guard:
    """A child process that calls functions on files, started again after each that ended it."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._child: subprocess.Popen[bytes] | None = None
        self._owner = 0
        self._serving = False

    def call(self, path: Path, function: Callable[..., Any], *args: Any, **options: Any) -> Any:
        """Result of `function`, given `args` and `options`, for the file at `path`; an error of its own is raised here.

        Raises DamagedError where the child ended, or took longer than a file of that size can need.

        Where no child can be had, as in a program that is not run by a Python of its own, it is done here.
        """
        with self._lock:
            child = None if self._serving else self._started()
            if child is not None:
                return self._answered(child, path, (function, args, options))
        return function(*args, **options)

    def _answered(
        self, child: Any, path: Path, what: tuple[Callable[..., Any], tuple[Any, ...], dict[str, Any]]
    ) -> Any:
        try:
            seconds = SECONDS + int(path.stat().st_size * SECONDS_A_BYTE)
            _send(child.stdin, (_folder(), seconds, *what))
            error, value = _received(child.stdout)
        except (EOFError, BrokenPipeError):
            self.stop()
            late = os.name == "posix" and child.returncode == -signal.SIGXCPU
            raise DamagedError(
                "taking it apart takes far longer than a whole file of its size" if late else "it ends its decoder"
            ) from None
        except BaseException:  # interrupted halfway: what the child would answer belongs to nothing
            self.stop()
            raise
        if error is not None:
            raise error
        return value

    def _started(self) -> Any:
        """The child, which has said that it is there; None where it cannot be."""
        if self._child is not None and self._owner == os.getpid():  # after a fork the child is the parent's
            return self._child
        program = Path(sys.executable or "")
        if getattr(sys, "frozen", False) or not program.stem.lower().startswith(("python", "pypy")):
            return None
        places = os.pathsep.join(place for place in sys.path if place)
        command = [str(program), "-P", "-c", "from floquid.io._guard import GUARD; GUARD.serve()"]
        try:
            self._child = subprocess.Popen(  # noqa: S603
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env=os.environ | {"PYTHONPATH": places},
            )
            self._owner = os.getpid()
            with suppress(ImportError, AttributeError, OSError):  # Linux: twice as fast for a long record
                import fcntl

                fcntl.fcntl(cast("Any", self._child.stdout), fcntl.F_SETPIPE_SZ, 1 << 20)
            if _exactly(cast("Any", self._child.stdout), len(_THERE)) == _THERE:
                return self._child
        except (OSError, EOFError):
            pass
        self.stop()
        self._serving = True  # it will not be there for the next file either
        return None

    def stop(self) -> None:
        """End the child, if there is one of this process."""
        child, self._child = self._child, None
        if child is not None and self._owner == os.getpid():
            with suppress(OSError), child:
                child.kill()

    def serve(self) -> None:
        """Call what the parent sends until it ends."""
        self._serving = True
        answers = os.fdopen(os.dup(1), "wb")
        os.dup2(2, 1)  # what a library prints is no answer
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        os.chdir(Path(__file__).parent)
        answers.write(_THERE)
        answers.flush()
        with suppress(EOFError, BrokenPipeError):
            while True:
                _send(answers, _answer(*_received(sys.stdin.buffer)))


def _folder() -> Path | None:
    """Folder that the program is in; None where it is gone."""
    with suppress(OSError):
        return Path.cwd()
    return None


def _answer(
    folder: Path | None, seconds: int, function: Callable[..., Any], args: tuple[Any, ...], options: dict[str, Any]
) -> tuple[Exception | None, Any]:
    """The error of a function, and what it gives."""
    _limit(seconds)
    try:
        if folder is not None:
            os.chdir(folder)
        return None, function(*args, **options)
    except Exception as error:  # noqa: BLE001  # raised again in the parent
        if not isinstance(error, (FloquidError, DamagedError)):
            error.add_note(traceback.format_exc())
        return error, None
    finally:
        os.chdir(Path(__file__).parent)  # a folder of the user's could not be removed on Windows


def _limit(seconds: int) -> None:
    """Let this process take `seconds` more of the processor's time, and the memory that the machine has."""
    with suppress(ImportError, OSError, ValueError):  # not on Windows
        import resource

        used = resource.getrusage(resource.RUSAGE_SELF)
        _, most = resource.getrlimit(resource.RLIMIT_CPU)
        resource.setrlimit(resource.RLIMIT_CPU, (int(used.ru_utime + used.ru_stime) + 1 + seconds, most))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") + RESERVED
        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))


def _send(stream: BinaryIO, message: object) -> None:
    """Write a message, arrays as they are in memory."""
    buffers: list[pickle.PickleBuffer] = []
    body = pickle.dumps(message, protocol=5, buffer_callback=buffers.append)
    parts = [memoryview(body), *(buffer.raw() for buffer in buffers)]
    stream.write(_LENGTH.pack(len(parts)) + b"".join(_LENGTH.pack(part.nbytes) for part in parts))
    for part in parts:
        stream.write(part)
    stream.flush()


def _received(stream: BinaryIO) -> Any:
    """Read a message; EOFError where the other side has ended."""
    count = _LENGTH.unpack(_exactly(stream, _LENGTH.size))[0]
    lengths = [_LENGTH.unpack(_exactly(stream, _LENGTH.size))[0] for _ in range(count)]
    body, *buffers = (_exactly(stream, length) for length in lengths)
    return pickle.loads(body, buffers=buffers)  # noqa: S301  # from our own child


def _exactly(stream: BinaryIO, length: int) -> memoryview:
    content, at = np.empty(length, np.uint8).data, 0  # not filled with zeros first, as a bytearray is
    while at < length:
        count = stream.readinto(content[at:])  # type: ignore[attr-defined]
        if not count:
            raise EOFError
        at += count
    return content


GUARD = Guard()
atexit.register(GUARD.stop)
