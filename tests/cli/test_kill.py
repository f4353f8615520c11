"""`floquid identify --out` over an earlier result, killed with no warning: one whole result is left, old or new."""

import json
import os
import random
import signal
import subprocess
import sys
import time

import pytest
from tests.cli.conftest import PICTURES, contents

import floquid
from floquid.cli import run
from floquid.cli.output.folder import FIGURES, UNFINISHED, settle

PERIOD = "6.283185307179586"
TO = ["--out", "place", "--figures"]
OLD = ["identify", "good.npz", "--period", PERIOD, "--states", "X,Y", *TO]
NEW = ["identify", "good.npz", "--period", PERIOD, "--channels", "X,Y", "--harmonics", "2", *TO]
FIRST = {"result.h5", "summary.json", "settings.toml"}
"""Files that are written before any picture is drawn."""

NAMES = {*FIRST, "report.html", *(f"figures/{name}" for name in FIGURES)}

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")

# Before the n-th time that it opens, renames or removes anything under `place`, a child kills itself.
SCRIPT = (
    PICTURES
    + """
import os, shutil, signal, sys
from floquid.cli import run
import h5py

moments, words = [int(n) for n in sys.argv[1].split(",")], sys.argv[2:]
where = os.path.realpath("place")
left = 0

def watch(event, details):
    global left
    if event in ("open", "os.rename", "os.remove", "os.rmdir", "os.mkdir", "shutil.rmtree", "os.truncate") and left:
        if any(isinstance(d, (str, os.PathLike)) and os.path.realpath(d).startswith(where) for d in details):
            left -= 1
            if not left:
                os.kill(os.getpid(), signal.SIGKILL)

for moment in moments:
    shutil.copytree("old", "place")
    child = os.fork()
    if child == 0:
        sys.addaudithook(watch)
        left = moment
        os._exit(run(words))
    _, status = os.waitpid(child, 0)
    os.rename("place", f"after{moment}")
    print(moment, -os.WTERMSIG(status) if os.WIFSIGNALED(status) else os.WEXITSTATUS(status), flush=True)
"""
)

COMMAND = (
    PICTURES
    + """
import sys
from floquid.cli import run
sys.exit(run(sys.argv[1:]))
"""
)


@pytest.fixture
def results(here):
    """The files of the old and of the new result; the old one is at its place."""
    for words, name in ((NEW, "new"), (OLD, "old")):
        assert run(words) == 0
        (here / "place").rename(here / name)
    return contents(here / "old"), contents(here / "new")


def visible(folder):
    return {name: data for name, data in contents(folder).items() if not name.startswith(".floquid-")}


def assert_whole(folder, old, new):
    """Each file at a final name is all of the old one or all of the new one, and both readers take them."""
    now = visible(folder)
    assert set(now) <= NAMES, "nothing under another name"
    assert set(now) >= FIRST, "none has gone"
    for name, data in now.items():
        assert data in (old[name], new.get(name)), f"{name} is neither the old nor the new one"
    assert floquid.load(folder / "result.h5").model.order == 4
    assert json.loads((folder / "summary.json").read_text())["format"] == "floquid-summary/2"
    settle(folder)
    bare = {name: new[name] for name in FIRST}
    assert visible(folder) in (old, bare, new), "the next command finds one result"
    return now


def self_killed(here, moments):
    """The exit status of the command by the number of the file operation that it was to die at."""
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    words = [sys.executable, "-c", SCRIPT, ",".join(map(str, moments)), *NEW, "--format", "json"]
    ended = subprocess.run(words, capture_output=True, text=True, check=False, env=environment)
    assert ended.returncode == 0, ended.stderr
    lines = [line.split() for line in ended.stdout.splitlines() if line[:1].isdigit()]
    return {int(moment): int(status) for moment, status in lines}


def check_moments(here, results, moments):
    old, new = results
    ends = self_killed(here, moments)
    seen = set()
    for moment, status in ends.items():
        now = assert_whole(here / f"after{moment}", old, new)
        if status == 0:
            assert now == new
        else:
            assert status == -signal.SIGKILL
        seen.add("new" if now == new else "old" if now == old else "both")
    return ends, seen


@pytest.mark.kill
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs os.fork")
def test_killed_at_some_file_operations(here, results):
    """The first, some of those in between, and one so late that the command has ended by then."""
    moments = [1, *sorted(random.Random(0).sample(range(2, 60), 7)), 1000]
    ends, seen = check_moments(here, results, moments)
    assert ends[1] == -signal.SIGKILL
    assert ends[1000] == 0
    assert {"old", "new"} <= seen


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs os.fork")
def test_killed_at_every_file_operation(here, results):
    ends, seen = check_moments(here, results, [*range(1, 161)])
    statuses = list(ends.values())
    assert statuses == sorted(statuses), "first those that were killed, then those that ended before"
    assert {0, -signal.SIGKILL} == set(statuses)
    assert seen == {"old", "both", "new"}, "the moves themselves are among the moments"


def killed_at(here, results, shares):
    """Kill the command after these shares of the time that it takes."""
    old, new = results
    command = [sys.executable, "-c", COMMAND, *NEW]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    begun = time.monotonic()
    subprocess.run(command, check=True, **quiet)
    whole = time.monotonic() - begun
    for number, share in enumerate(shares):
        (here / "place").rename(here / f"done{number}")
        subprocess.run(["cp", "-r", "old", "place"], check=True)
        process = subprocess.Popen(command, **quiet)
        time.sleep(share * whole)
        process.kill()
        process.wait()
        assert_whole(here / "place", old, new)


@pytest.mark.kill
def test_killed_at_six_moments(here, results):
    killed_at(here, results, [random.Random(1).uniform(0.4, 1.0) for _ in range(6)])


@pytest.mark.slow
def test_killed_at_many_moments(here, results):
    rest = random.Random(2)
    killed_at(here, results, [rest.uniform(0.2, 1.1) for _ in range(60)])


@pytest.mark.kill
def test_what_a_kill_leaves_behind_is_no_result(here, results):
    """A later run does not take it up, and it cannot be mistaken for a result by its name."""
    self_killed(here, [12])
    left = [path for path in (here / "after12").iterdir() if path.name.startswith(UNFINISHED)]
    assert left
    assert left[0].name.startswith(".")
    (here / "after12").rename(here / "place")
    assert run(NEW) == 0
    assert contents(here / "place") == results[1]


@pytest.mark.kill
def test_the_check_can_fail(here, results):
    old, new = results
    (here / "old").rename(here / "place")
    assert_whole(here / "place", old, new)
    whole = (here / "place" / "summary.json").read_bytes()
    (here / "place" / "summary.json").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(AssertionError, match="neither the old nor the new"):
        assert_whole(here / "place", old, new)


def test_the_two_results_differ(results):
    old, new = results
    assert all(old[name] != new[name] for name in ("result.h5", "summary.json", "settings.toml"))
