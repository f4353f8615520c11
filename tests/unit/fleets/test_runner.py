"""Jobs on workers: in this process, in processes that die, by another's executor."""

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import pytest
from tests.unit.fleets.jobs import dies, double, raises

from floquid.errors import IdentificationError, InputError
from floquid.fleets import outcomes, scheduled, time_left


def lost(job, reason):
    return job, reason


class Refusing(Executor):
    """Breaks after two jobs, as a pool of processes does."""

    def __init__(self):
        self.left = 2

    def submit(self, function, /, *arguments, **options):
        future = Future()
        self.left -= 1
        if self.left < 0:
            future.set_exception(BrokenProcessPool("a process ended"))
        else:
            future.set_result(function(*arguments))
        return future


def test_in_this_process_one_after_the_other():
    taken = []

    def jobs():
        for job in range(3):
            taken.append(job)
            yield job

    found = outcomes(double, jobs(), lost, workers=1)
    assert next(found) == (0, 0)
    assert taken == [0]
    assert list(found) == [(1, 2), (2, 4)]


@pytest.mark.parametrize("count", [0, 1, 7, 2500])
def test_by_another_executor(count):
    with ThreadPoolExecutor(3) as executor:
        assert sorted(outcomes(double, range(count), lost, executor=executor)) == [
            (job, 2 * job) for job in range(count)
        ]


def test_what_another_executor_raises_costs_one_job():
    with ThreadPoolExecutor(1) as executor:
        ((number, found),) = outcomes(raises, ["a"], lost, executor=executor)
    assert number == 0
    assert found == ("a", "The worker gave no result: RuntimeError: lost a.")


def test_another_executor_that_ends_ends_the_work():
    found = outcomes(double, range(4), lost, executor=Refusing())
    with pytest.raises(IdentificationError, match="Run it again"):
        list(found)


@pytest.mark.slow
def test_a_process_that_dies_costs_one_job(tmp_path):
    """What died once is done again; what dies twice has no result; the others do not notice."""
    jobs = ["a", "always", "b", tmp_path / "once", *"cdefghij"]
    found = dict(outcomes(dies, jobs, lost, workers=2))
    assert sorted(found) == list(range(len(jobs)))
    assert [number for number, own in found.items() if isinstance(own, tuple)] == [1]
    assert found[1][0] == "always"
    assert "twice" in found[1][1]
    assert {number: own for number, own in found.items() if number != 1} == {
        number: str(job) for number, job in enumerate(jobs) if number != 1
    }


ORPHANS = """
import sys, time
from tests.unit.fleets.jobs import double
from floquid.fleets._runner import _pool

if __name__ == "__main__":
    with _pool(1) as pool:
        pool.submit(double, 1).result()
        print(*pool._processes, flush=True)
        time.sleep(60)
"""


@pytest.mark.kill
def test_processes_end_with_the_one_that_began_them(tmp_path):
    (tmp_path / "run.py").write_text(ORPHANS)
    places = os.pathsep.join([str(Path.cwd()), os.environ.get("PYTHONPATH", "")])
    run = subprocess.Popen(
        [sys.executable, tmp_path / "run.py"], stdout=subprocess.PIPE, env={**os.environ, "PYTHONPATH": places}
    )
    child = int(run.stdout.readline())
    assert is_at_work(child)
    run.send_signal(signal.SIGKILL)
    run.communicate()
    for _ in range(200):
        if not is_at_work(child):
            return
        time.sleep(0.05)
    raise AssertionError("it is still there")


def is_at_work(child):
    """True of a process that has not ended."""
    try:
        os.kill(child, 0)
        return Path(f"/proc/{child}/stat").read_text().split()[2] != "Z"
    except OSError:
        return False


def test_time_left():
    assert time_left(1, 4, 10.0) == ", about 30 s left"
    assert time_left(1, 31, 10.0) == ", about 5 min left"
    assert time_left(1, 3601, 10.0) == ", about 10 h left"
    assert time_left(4, 4, 10.0) == ""


def test_dask_that_is_not_there(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r'pip install "floquid\[fleet\]"'), scheduled("tcp://localhost:1"):
        pass
