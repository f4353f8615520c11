"""A bootstrap that was cut short is gone on with, and gives what one that was not would have given."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from floquid.cli import run
from floquid.cli.commands.bootstrap import KEPT
from floquid.pipeline import Draw, DrawFile, bootstrap, identify
from floquid.store import save
from floquid.systems import JeffcottRotor

pytestmark = pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")

COMMAND = """
import sys
from floquid.cli import run
from floquid.pipeline.draws import _spread
_spread.EVERY = 0.0
sys.exit(run(sys.argv[1:]))
"""


@pytest.fixture(scope="module")
def analysis():
    record = JeffcottRotor().simulate(n_periods=128, samples_per_period=12, noise=0.01)
    return identify(record, states=["X", "Y"], validate=False)


@pytest.fixture(scope="module")
def short():
    """An analysis whose draws take little time."""
    record = JeffcottRotor().simulate(n_periods=60, samples_per_period=12, noise=0.01)
    return identify(record, constrained=False, validate=False)


@pytest.fixture
def result(analysis, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save(analysis, tmp_path / "result.h5")
    return tmp_path


@pytest.mark.kill
def test_killed_and_gone_on_with(result, capsys):
    words = ["bootstrap", "result.h5", "--workers", "1", "--draws", "60", "--out", "place"]
    process = subprocess.Popen([sys.executable, "-c", COMMAND, *words], stdout=subprocess.DEVNULL)
    log = DrawFile(path=result / "place" / KEPT, key="")
    while not log.path.exists():
        assert process.poll() is None
        time.sleep(0.01)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert not (result / "place" / "bootstrap.json").exists()
    assert run(words) == 0
    assert "draws were done by a run that was cut short" in capsys.readouterr().err
    assert sorted(path.name for path in (result / "place").iterdir()) == ["bootstrap.json", "bootstrap.npz"]
    assert run([*words[:-1], "whole"]) == 0
    assert "cut short" not in capsys.readouterr().err
    one, other = (json.loads((result / name / "bootstrap.json").read_text()) for name in ("place", "whole"))
    assert one == other


class Counted(DrawFile):
    """A file that is written at each draw."""

    __slots__ = ()

    def keep(self, draws):
        self.write(draws)


def test_what_is_done_is_not_done_again(short, tmp_path):
    log = Counted(path=tmp_path / "draws.npz", key="k")
    bootstrap(short, draws=20, workers=1, kept=log)
    assert len(log.read()) == 20
    told = []
    longer = bootstrap(short, draws=25, workers=1, kept=log, report=told.append)
    assert told[0] == "drawing: 20 of 25"
    assert len(told) == 6
    fresh = bootstrap(short, draws=25, workers=1)
    assert np.array_equal(longer.exponents.draws, fresh.exponents.draws)


def test_draws_come_back(tmp_path):
    log = DrawFile(path=tmp_path / "draws.npz", key="of this")
    exponents, coefficients = np.array([1j, -1j]), np.ones((2, 1, 1, 3), complex)
    draws = [
        Draw(2, exponents, coefficients, 2.0, np.eye(2)[None], np.ones((1, 2, 2))),
        Draw(0, failure="it would not"),
        Draw(4),
        Draw(2, 2.0 * exponents, coefficients, 3.0, np.eye(2)[None], np.ones((1, 2, 2))),
    ]
    log.write(draws)
    back = log.read()
    assert [one.order for one in back] == [2, 0, 4, 2]
    assert [one.failure for one in back] == ["", "it would not", "", ""]
    assert back[1].exponents is back[2].system is None
    assert np.array_equal(back[3].exponents, 2.0 * exponents)
    assert back[3].period == 3.0


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"not an archive"], ids=["empty", "cut", "text"])
def test_what_is_no_archive_is_passed_over(tmp_path, content):
    path = tmp_path / "draws.npz"
    path.write_bytes(content)
    assert DrawFile(path=path, key="k").read() == []


def test_a_damaged_archive_is_passed_over(tmp_path):
    log = DrawFile(path=tmp_path / "draws.npz", key="k")
    log.write([Draw(0, failure="x")] * 3)
    whole, rest = log.path.read_bytes(), np.random.default_rng(0)
    for _ in range(300):
        changed = bytearray(whole)
        for place in rest.integers(0, len(whole), 3):
            changed[place] = rest.integers(0, 256)
        log.path.write_bytes(changed)
        assert len(log.read()) in (0, 3)


def test_an_archive_that_unpacks_into_much_is_passed_over(tmp_path):
    log = DrawFile(path=tmp_path / "draws.npz", key="k")
    log.write([Draw(0, failure="x")] * 3)
    content = dict(np.load(log.path))
    np.savez_compressed(log.path, **content)
    assert log.read() == []
    np.savez(log.path, **content)
    assert len(log.read()) == 3


def test_draws_of_something_else_are_passed_over(short, tmp_path):
    log = DrawFile(path=tmp_path / "draws.npz", key="one")
    log.write([Draw(0, failure="x")])
    assert DrawFile(path=log.path, key="other").read() == []
    log.write([Draw(3, np.ones(3, complex), np.ones((3, 1, 1, 1), complex), 1.0)] * 20)
    assert bootstrap(short, draws=20, workers=1, kept=log).n_used > 0
