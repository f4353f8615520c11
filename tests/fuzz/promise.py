"""What is promised of every file, whatever is in it, and the measure of it.

Any bytes end in what was read or in one `FloquidError`, within `SECONDS` and without a warning. The peak of memory is
at most `FLOOR`, `PER_BYTE` times the file and `PER_DECODED` times the arrays that come of it. Nothing is written,
started, connected to or run.
"""

from __future__ import annotations

import os
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from floquid.errors import FloquidError

SECONDS = 10.0
FLOOR, PER_BYTE, PER_DECODED = 64 << 20, 32, 4

_STATUS, _CLEAR = Path("/proc/self/status"), Path("/proc/self/clear_refs")
_CHANGES = (
    *("os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.link", "os.symlink", "os.truncate", "os.chmod", "os.utime"),
    *("shutil.move", "shutil.copyfile", "shutil.rmtree", "tempfile.mkstemp", "tempfile.mkdtemp"),
    *("subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "os.fork", "os.spawn", "socket.connect"),
    *("pickle.find_class", "ctypes.dlopen", "exec"),
)
_WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """A promise that was broken: `key` is the same for the same cause, `words` says what happened."""

    key: str
    words: str


class Watch:
    """The deeds of the interpreter while it reads; there is no end to an audit hook, so there is one a process."""

    def __init__(self) -> None:
        self.on = False
        self.deeds: list[str] = []
        sys.addaudithook(self._hook)

    def _hook(self, event: str, arguments: tuple[Any, ...]) -> None:
        if not self.on:
            return
        if event in _CHANGES and not (event == "exec" and _is_loading(arguments[0])):
            self.deeds.append(f"{event} {arguments!r:.200}")
        elif event == "open" and isinstance(arguments[2], int) and arguments[2] & _WRITES:
            self.deeds.append(f"open {arguments!r:.200}")


def _is_loading(code: Any) -> bool:
    """Whether code that is run is a module on the disk, or what one runs while it is loaded: no deed of an input."""
    if Path(getattr(code, "co_filename", "")).suffix == ".py":
        return True
    frame = sys._getframe()
    while frame is not None and frame.f_code.co_filename != "<frozen importlib._bootstrap>":
        frame = frame.f_back
    return frame is not None


def resident(name: str = "VmRSS") -> int:
    """Bytes of memory in use, or (`VmHWM`) the most since `forget_peak`; 0 where the system does not say."""
    if not _CLEAR.exists():
        return 0
    said = os.pread(_opened(_STATUS, os.O_RDONLY), 4096, 0)
    return int(said.partition(f"{name}:".encode())[2].split(None, 1)[0]) << 10


def forget_peak() -> None:
    """Let the peak of memory begin anew."""
    if _CLEAR.exists():
        os.pwrite(_opened(_CLEAR, os.O_WRONLY), b"5", 0)


@cache
def _opened(path: Path, flags: int) -> int:
    """Opened once: it is asked several times for each input."""
    return os.open(path, flags)


def n_bytes(thing: object) -> int:
    """The bytes of the arrays and the texts in a tree of values."""
    if isinstance(thing, np.ndarray):
        return thing.nbytes
    if isinstance(thing, str):
        return len(thing)
    if is_dataclass(thing) and not isinstance(thing, type):
        return sum(n_bytes(getattr(thing, field.name)) for field in fields(thing))
    if isinstance(thing, Mapping):
        return n_bytes(tuple(thing.values()))
    return sum(map(n_bytes, thing)) if isinstance(thing, (tuple, list)) else 0


def broken(calls: Iterable[Callable[[Path], object]], path: Path, watch: Watch | None = None) -> list[Finding]:
    """The promises that reading `path` by each of `calls` breaks."""
    return [finding for call in calls for finding in _broken(call, path, watch)]


def _broken(call: Callable[[Path], object], path: Path, watch: Watch | None) -> list[Finding]:
    found: list[Finding] = []
    decoded, size = 0, path.stat().st_size
    forget_peak()
    before, began = resident(), time.perf_counter()
    if watch is not None:
        watch.deeds.clear()
        kept, sys.dont_write_bytecode = sys.dont_write_bytecode, True  # what a module compiles to is no deed of a file
        watch.on = True
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", ResourceWarning)
            decoded = n_bytes(call(path))
    except FloquidError as error:
        found += _bad_refusal(error, path)
    except Exception as error:  # noqa: BLE001  # whatever it is, it is a finding
        found.append(Finding(key=f"{type(error).__name__} {_place(error)}", words=traceback.format_exc(limit=-8)))
    if watch is not None:
        watch.on, sys.dont_write_bytecode = False, kept
        found += [Finding(key=f"deed {deed.split()[0]}", words=deed) for deed in watch.deeds]
    seconds, used = time.perf_counter() - began, resident("VmHWM") - before
    name = getattr(call, "__name__", "call")
    if seconds > SECONDS:
        found.append(Finding(key=f"slow {name}", words=f"{seconds:.1f} s for {size} bytes"))
    allowed = FLOOR + PER_BYTE * size + PER_DECODED * decoded
    if used > allowed:
        words = f"{used >> 20} MiB for {size} bytes and {decoded} bytes decoded; {allowed >> 20} MiB are allowed"
        found.append(Finding(key=f"memory {name}", words=words))
    return found


def _bad_refusal(error: BaseException, path: Path) -> list[Finding]:
    """A refusal must name the file or its argument, fit a terminal, and not stand for a lack of memory."""
    found = []
    text = str(error)
    if len(text) > 20_000 or not all(letter.isprintable() or letter in "\n\xa0" for letter in text):
        found.append(Finding(key=f"message {_place(error)}", words=f"{len(text)} letters: {text[:300]!r}"))
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, MemoryError) and path.stat().st_size < 1 << 20:
            found.append(Finding(key=f"MemoryError {_place(cause)}", words=text[:300]))
        cause = cause.__cause__ or cause.__context__
    return found


def _place(error: BaseException) -> str:
    """Where in floquid it was raised, or the last place outside of it."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if f"{os.sep}floquid{os.sep}" in frame.filename]
    frame = (own or list(frames) or [None])[-1]
    return "nowhere" if frame is None else f"{Path(frame.filename).name}:{frame.lineno}"
