"""The child process that takes files apart: what it gives back, and what becomes of a decoder that never does."""

import copy
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from floquid.errors import InputError
from floquid.io import DamagedError
from floquid.io._guard import Guard
from floquid.readers import read

HERE = Path(__file__)


@pytest.fixture
def guard():
    guard = Guard()
    yield guard
    guard.stop()


def test_functions_work_elsewhere_and_give_what_they_give_here(guard):
    assert guard.call(HERE, os.getpid) != os.getpid()
    assert guard.call(HERE, np.add, np.arange(3), 1).tolist() == [1, 2, 3]
    assert guard.call(HERE, dict, a=(1, "two")) == {"a": (1, "two")}


def test_relative_paths_are_those_of_the_program(guard, tmp_path, monkeypatch):
    guard.call(HERE, os.getpid)
    monkeypatch.chdir(tmp_path)
    assert guard.call(HERE, os.getcwd) == str(tmp_path)


@pytest.mark.first(2)
@pytest.mark.parametrize("size", [0, 3_000_000, 1, 100_000])
def test_arrays_come_back_as_they_were_sealed(guard, size):
    sealed = np.arange(float(size))
    sealed.flags.writeable = False
    opened, found = guard.call(HERE, copy.copy, (np.arange(float(size)), sealed))
    np.testing.assert_array_equal(found, sealed)
    assert (opened.flags.writeable, found.flags.writeable) == (True, False)


def test_errors_are_those_of_the_function(guard):
    with pytest.raises(InputError) as here:
        read("nowhere.h5")
    with pytest.raises(InputError, match=f"^{re.escape(str(here.value))}$"):
        guard.call(HERE, read, "nowhere.h5")
    with pytest.raises(ValueError, match="invalid literal") as caught:
        guard.call(HERE, int, "five")
    assert "in _answer" in caught.value.__notes__[0], "where it happened"
    with pytest.raises(MemoryError):
        guard.call(HERE, np.ones, 1 << 50)


@pytest.mark.first(1)
@pytest.mark.parametrize("ended", [os.abort, sys.exit])
def test_a_decoder_that_ends_is_damage_and_the_next_file_is_read(guard, ended):
    first = guard.call(HERE, os.getpid)
    assert guard.call(HERE, os.getpid) == first
    with pytest.raises(DamagedError, match="ends its decoder"):
        guard.call(HERE, ended)
    assert guard.call(HERE, os.getpid) != first


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="limits are those of POSIX")
def test_a_decoder_that_never_ends_is_damage(guard, monkeypatch):
    monkeypatch.setattr("floquid.io._guard.SECONDS", 1)
    with pytest.raises(DamagedError, match="far longer than a whole file"):
        guard.call(HERE, eval, "all(True for _ in iter(int, 1))")
    monkeypatch.undo()
    assert guard.call(HERE, int, "7") == 7


BUSY = "[None for now in [process_time] for begin in [now()] for _ in iter(lambda: now() - begin < 0.6, False)]"


@pytest.mark.kill
def test_time_is_counted_for_each_file(guard, monkeypatch):
    """Four times 0.6 s of the processor, where one file may take a second, and the second that it began in."""
    monkeypatch.setattr("floquid.io._guard.SECONDS", 1)
    for _ in range(4):
        guard.call(HERE, eval, BUSY, {"process_time": time.process_time})


def test_a_folder_that_is_gone_is_no_damage(guard, tmp_path, monkeypatch):
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    assert guard.call(HERE, int, "7") == 7


@pytest.mark.slow
def test_the_child_keeps_neither_folders_nor_samples(guard, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    child = guard.call(HERE, os.getpid)
    assert guard.call(HERE, np.ones, 20_000_000).nbytes == 160_000_000
    assert guard.call(HERE, int, "7") == 7  # what it answered before is done with
    if not Path("/proc/self").is_dir():
        pytest.skip("no /proc")
    assert Path(f"/proc/{child}/cwd").readlink() != tmp_path
    used = re.search(r"VmRSS:\s+(\d+) kB", Path(f"/proc/{child}/status").read_text())
    assert int(used[1]) < 120_000


@pytest.mark.parametrize("program", ["", "MATLAB", "python-that-is-not-there"])
def test_without_a_python_to_start_it_is_done_here(guard, monkeypatch, program):
    monkeypatch.setattr(sys, "executable", program)
    assert guard.call(HERE, os.getpid) == os.getpid()


def test_a_child_that_cannot_begin_is_not_the_files_fault(guard, monkeypatch):
    monkeypatch.setattr("floquid.io._guard._THERE", b"floquid calls")
    assert guard.call(HERE, os.getpid) == os.getpid()


def test_what_a_library_prints_is_no_answer(guard):
    assert guard.call(HERE, os.system, "echo noise") == 0
    assert guard.call(HERE, print, "noise") is None
    assert guard.call(HERE, int, "7") == 7


def test_an_interrupted_call_leaves_nothing_behind(guard, monkeypatch):
    def interrupted(stream):
        raise KeyboardInterrupt

    monkeypatch.setattr("floquid.io._guard._received", interrupted)
    with pytest.raises(KeyboardInterrupt):
        guard.call(HERE, int, "5")
    monkeypatch.undo()
    assert guard.call(HERE, int, "7") == 7


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_a_fork_has_a_child_of_its_own(guard):
    child = guard.call(HERE, os.getpid)
    forked = os.fork()
    if not forked:
        own = guard.call(HERE, os.getpid)
        guard.stop()
        os._exit(int(own == child))
    assert os.waitpid(forked, 0)[1] == 0
    assert guard.call(HERE, os.getpid) == child


@pytest.mark.kill
def test_the_child_ends_with_its_parent():
    """Also with one that is killed: its standard input ends."""
    code = (
        "import os; from floquid.io import GUARD; from pathlib import Path; print(GUARD.call(Path('.'), os.getpid)); "
    )
    ended = subprocess.run(
        [sys.executable, "-c", code + "os.kill(os.getpid(), 9)"], capture_output=True, text=True, check=False
    )
    assert ended.returncode == -signal.SIGKILL
    for _ in range(100):
        try:
            os.kill(int(ended.stdout), 0)
        except ProcessLookupError:
            break
        subprocess.run([sys.executable, "-c", "import time; time.sleep(0.05)"], check=True)
    else:
        pytest.fail("the child goes on")
