"""A folder of results under kill -9 and under several writers: it holds one whole result, the old or the new."""

import os
import shutil
import subprocess
import sys

import pytest
from tests.cli.conftest import PICTURES, contents

from floquid.cli.output.folder import FIGURES, LOCK, MOVING, READY, RESULT, UNFINISHED, _sweep, result_folder, settle
from floquid.errors import InputError
from floquid.store import load

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs os.fork")

KILLS = 200

SOME = 60
"""Of them, each time that the tests run."""

WRITER = (
    PICTURES
    + """
import random, sys, time
from dataclasses import replace
from pathlib import Path
from floquid.cli.output.folder import NAMES, draw_result, result_folder, write_result
from floquid.pipeline import identify
from floquid.systems import JeffcottRotor
import filelock, h5py, tomli_w

place = Path(sys.argv[1])
rotor = JeffcottRotor()
made = [
    identify(rotor.simulate(n_periods=n, samples_per_period=12, noise=0.01), validate=False, states=states)
    for n, states in ((96, ["X", "Y"]), (128, []))
]

def put(which):
    with result_folder(place, NAMES) as folder:
        mark = write_result(folder, made[which], f"of = {which}", lambda _: None)
    draw_result(place, made[which], mark, lambda _: None, figures=True)
"""
)

KILLED = (
    WRITER
    + """
import os, shutil, signal

moments, rest, where = int(sys.argv[2]), random.Random(int(sys.argv[3])), os.path.realpath(place)
for which in (1, 0):
    put(which)
    shutil.copytree(place, f"result{which}")
    shutil.rmtree(place)
    place.mkdir()
left, operations = 0, ("open", "os.rename", "os.remove", "os.rmdir", "os.mkdir", "shutil.rmtree")

def watch(event, details):
    # Before the n-th time that anything in the folder is opened, renamed or removed.
    global left
    if left and event in operations:
        if any(isinstance(d, (str, os.PathLike)) and os.path.realpath(d).startswith(where) for d in details):
            left -= 1
            if not left:
                os.kill(os.getpid(), signal.SIGKILL)

begun = time.monotonic()
put(0)
took = time.monotonic() - begun
for moment in range(moments):
    child = os.fork()
    if child == 0:
        if moment % 2:
            sys.addaudithook(watch)
            left = rest.randint(1, 90)
        while True:
            put(rest.randint(0, 1))
    if moment % 2 == 0:
        time.sleep(rest.uniform(0.0, 2.0 * took))
        os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    rest.random()
    print("killed", flush=True)
    if sys.stdin.readline() != "next\\n":
        sys.exit(1)
"""
)


FIRST = (RESULT, "summary.json", "settings.toml")
"""Files that are written before any picture is drawn."""


def visible(folder):
    return {name: data for name, data in contents(folder).items() if not name.startswith(".floquid-")}


def script(code, *words, **options):
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    return subprocess.Popen([sys.executable, "-c", code, *map(str, words)], env=environment, text=True, **options)


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def killed(here, moments, seed):
    """Kill a program that writes results over results so many times; what each left, before and after it is mended."""
    place = here / "place"
    with script(KILLED, place, moments, seed, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        for _ in range(moments):
            assert process.stdout.readline() == "killed\n"
            yield place
            process.stdin.write("next\n")
            process.stdin.flush()
    assert process.returncode == 0


def check_kill(place, results, seen):
    """Every file is whole at once, and all are of one result when the folder is next looked at."""
    now = visible(place)
    for name, data in now.items():
        assert data in [own.get(name) for own in results], f"{name} is neither of the one nor of the other"
    load(place / RESULT)
    between = any((place / name).exists() for name in (READY, MOVING))
    settle(place)
    after = visible(place)
    whole = [*results, *({name: own[name] for name in FIRST} for own in results)]
    assert after in whole
    assert not any((place / name).exists() for name in (READY, MOVING))
    seen.append("between" if between else "mended" if after != now else "whole")


def check_kills(here, kills, seed):
    results, seen = None, []
    for place in killed(here, kills, seed):
        if results is None:
            results = [contents(here / f"result{which}") for which in (0, 1)]
            assert results[0][RESULT] != results[1][RESULT]
            assert set(results[0]) != set(results[1])
        check_kill(place, results, seen)
    assert len(seen) == kills
    assert seen.count("between") >= kills // 40, "some kills fell between the moves"
    left = [path.name for path in (here / "place").iterdir() if path.name.startswith(UNFINISHED)]
    assert len(left) <= 1, "what a kill leaves is removed by the next run"


@pytest.mark.kill
def test_killed_at_some_moments(here):
    check_kills(here, SOME, seed=0)


@pytest.mark.slow
def test_killed_at_200_moments(here):
    check_kills(here, KILLS, seed=1)


SEVERAL = (
    WRITER
    + """
which, times = int(sys.argv[2]), int(sys.argv[3])
print("ready", flush=True)
sys.stdin.readline()
for _ in range(times):
    put(which)
"""
)


@pytest.mark.slow
def test_several_programs_write_one_folder(here):
    """Three programs write over each other, while a fourth reads; one is killed on the way."""
    place = here / "place"
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    writers = [script(SEVERAL, place, which, 25, **pipes) for which in (0, 1, 1)]
    for writer in writers:
        assert writer.stdout.readline() == "ready\n"
    for writer in writers:
        writer.stdin.write("go\n")
        writer.stdin.flush()
    read = 0
    while any(writer.poll() is None for writer in writers):
        if (place / RESULT).exists():
            assert load(place / RESULT).model.order == 4
            read += 1
            writers[2].kill()
    assert [writer.wait() for writer in writers][:2] == [0, 0]
    for writer in writers:
        writer.stdin.close()
        writer.stdout.close()
    assert read > 0
    settle(place)
    texts = {name: data.decode(errors="replace") for name, data in visible(place).items()}
    assert texts["settings.toml"] in ("of = 0", "of = 1")
    own = load(place / RESULT)
    assert (own.state is not None) == ("figures/system_elements.png" in texts) == (texts["settings.toml"] == "of = 0")
    assert texts["report.html"] == f"report {own.model.coefficients}"
    assert all(text.endswith(str(own.model.coefficients)) for name, text in texts.items() if name.endswith("png"))


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_nothing_is_left_where_nothing_was_written(here):
    (here / "there").mkdir()
    for place in (here / "there", here / "made" / "deep"):
        with pytest.raises(ZeroDivisionError), result_folder(place, ()):
            raise ZeroDivisionError
    assert names(here) == ["there"]
    assert names(here / "there") == []


def test_a_new_result_takes_the_figures_of_the_earlier_one_away_and_nothing_else(here):
    place = here / "place"
    (place / "figures").mkdir(parents=True)
    for name in (FIGURES[0], FIGURES[1], "mine.png"):
        (place / "figures" / name).write_text("old")
    (place / "notes.txt").write_text("mine")
    with result_folder(place, ()) as folder:
        (folder.unfinished / "figures").mkdir()
        (folder.unfinished / "figures" / FIGURES[1]).write_text("new")
        (folder.unfinished / RESULT).write_text("new")
        folder.publish()
    assert contents(place) == {
        f"figures/{FIGURES[1]}": b"new", "figures/mine.png": b"old", "notes.txt": b"mine", RESULT: b"new"
    }  # fmt: skip
    with result_folder(place, ()) as folder:  # a scan, say: the result and its figures stay
        (folder.unfinished / "scan.json").write_text("scan")
        folder.publish()
    assert set(contents(place)) == {f"figures/{FIGURES[1]}", "figures/mine.png", "notes.txt", RESULT, "scan.json"}


@pytest.mark.parametrize("name", [READY, MOVING])
def test_moves_that_were_begun_are_finished_by_any_command(here, name):
    (here / name / "figures").mkdir(parents=True)
    (here / name / "summary.json").write_text("new")
    (here / name / "figures" / FIGURES[0]).write_text("new")
    (here / "summary.json").write_text("old")
    with result_folder(here, ()):
        pass
    assert contents(here) == {"summary.json": b"new", f"figures/{FIGURES[0]}": b"new"}


def test_an_unfinished_folder_of_a_living_program_stays(here):
    with result_folder(here, ()) as one:
        with result_folder(here, ()) as other:
            assert one.unfinished.exists()
            (other.unfinished / "a").write_text("a")
            other.publish()
        assert one.unfinished.exists()
        (one.unfinished / "b").write_text("b")
        one.publish()
    assert names(here) == ["a", "b"]
    abandoned = here / f"{UNFINISHED}left"
    abandoned.mkdir()
    with result_folder(here, ()):
        assert not abandoned.exists()


def test_a_link_is_refused_before_any_work(here):
    (here / "elsewhere.h5").write_text("theirs")
    (here / RESULT).symlink_to(here / "elsewhere.h5")
    with pytest.raises(InputError, match="is a symbolic link"), result_folder(here, (RESULT,)):
        pass
    assert (here / "elsewhere.h5").read_text() == "theirs"


def test_a_folder_that_another_user_left_is_passed_over(here, monkeypatch):
    (here / f"{UNFINISHED}left").mkdir()

    def denied(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("floquid.cli.output.folder._lock", denied)
    monkeypatch.setattr(shutil, "rmtree", lambda *_, **__: pytest.fail("it is not ours"))
    _sweep(here)


def test_a_lock_that_is_never_given_back_is_told_of(here, monkeypatch):
    from filelock import FileLock

    monkeypatch.setattr("floquid.cli.output.folder.WAIT", 0.05)
    told = pytest.raises(InputError, match="another program has been writing to")
    with FileLock(here / LOCK), told, result_folder(here, ()):
        pass


def test_a_folder_that_cannot_be_mended_is_told_of(here):
    (here / READY).mkdir()
    (here / READY / "summary.json").write_text("new")
    (here / "summary.json").mkdir()
    with pytest.raises(InputError, match="holds a result that could not be moved to its place"):
        settle(here)
