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

from floquid.errors import FloquidError
from floquid.io._source import DamagedError

SECONDS, SECONDS_A_BYTE = 8, 5e-8
"""Time of the processor that one file may take, and more of it by its size; about a tenth is what a good one needs."""

_LENGTH = struct.Struct("<Q")


class Guard:
    """A child process that calls functions on files, started again after each that ended it."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._child: subprocess.Popen[bytes] | None = None
        self._owner = 0
        self._serving = False

    def call(self, path: Path, function: Callable[..., Any], *args: Any, **options: Any) -> Any:
        """What `function`, given `args` and `options`, makes of the file at `path`; an error of its own is raised here.

        Raises
        ------
        DamagedError
            The child ended, or took longer than a file of that size can need.
        """
        if self._serving:
            return function(*args, **options)
        with self._lock:
            child = self._started()
            try:
                seconds = SECONDS + int(path.stat().st_size * SECONDS_A_BYTE)
                _send(child.stdin, (Path.cwd(), seconds, function, args, options))
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
        if self._child is None or self._owner != os.getpid():  # after a fork the child is the parent's
            places = os.pathsep.join(place for place in sys.path if place)
            command = [sys.executable, "-P", "-c", "from floquid.io._guard import GUARD; GUARD.serve()"]
            self._child = subprocess.Popen(  # noqa: S603
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env=os.environ | {"PYTHONPATH": places},
            )
            with suppress(ImportError, AttributeError, OSError):  # Linux: twice as fast for a long record
                import fcntl

                fcntl.fcntl(cast("Any", self._child.stdout), fcntl.F_SETPIPE_SZ, 1 << 20)
            self._owner = os.getpid()
        return self._child

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
        with suppress(EOFError, BrokenPipeError):
            while True:
                folder, seconds, function, args, options = _received(sys.stdin.buffer)
                os.chdir(folder)  # where the program is now, and not where it was
                _limit(seconds)
                answer: Any
                try:
                    answer = None, function(*args, **options)
                except Exception as error:  # noqa: BLE001  # raised again in the parent
                    if not isinstance(error, (FloquidError, DamagedError)):
                        error.add_note(traceback.format_exc())
                    answer = error, None
                _send(answers, answer)


def _limit(seconds: int) -> None:
    """Let this process take `seconds` more of the processor's time, and the memory that the machine has."""
    with suppress(ImportError, OSError, ValueError):  # not on Windows
        import resource

        used = resource.getrusage(resource.RUSAGE_SELF)
        _, most = resource.getrlimit(resource.RLIMIT_CPU)
        resource.setrlimit(resource.RLIMIT_CPU, (int(used.ru_utime + used.ru_stime) + 1 + seconds, most))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
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
    """Read a message.

    Raises
    ------
    EOFError
        The other side has ended.
    """
    count = _LENGTH.unpack(_exactly(stream, _LENGTH.size))[0]
    lengths = [_LENGTH.unpack(_exactly(stream, _LENGTH.size))[0] for _ in range(count)]
    body, *buffers = (_exactly(stream, length) for length in lengths)
    return pickle.loads(body, buffers=buffers)  # noqa: S301  # from our own child


def _exactly(stream: BinaryIO, length: int) -> bytearray:
    content = bytearray(length)
    view, at = memoryview(content), 0
    while at < length:
        count = stream.readinto(view[at:])  # type: ignore[attr-defined]
        if not count:
            raise EOFError
        at += count
    return content


GUARD = Guard()
atexit.register(GUARD.stop)
