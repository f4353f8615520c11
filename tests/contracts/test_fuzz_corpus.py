"""Files that were found by the fuzzer or built on purpose, through every reader and every command that takes one.

`python -m tests.fuzz` looks for more. What is promised is in `tests.fuzz.promise`.
"""

import subprocess
from pathlib import Path
from random import Random

import numpy as np
import pytest
from tests.fuzz.promise import Watch, broken
from tests.fuzz.targets import OURS, TARGETS

from floquid import floquet
from floquid.cli import run
from floquid.errors import InputError
from floquid.readers import FORMATS

KEPT = sorted((Path(__file__).parents[1] / "fuzz" / "corpus").iterdir())
EVERY_TARGET = pytest.mark.parametrize("target", TARGETS.values(), ids=TARGETS)


@pytest.fixture(scope="module")
def watch():
    return Watch()


def changed(data, seed):
    """Some bytes of a file, without the help of the fuzzer."""
    random = Random(seed)

    def mutate(part):
        found = bytearray(part or b"\0")
        for _ in range(random.randint(1, 4)):
            at = random.randrange(len(found))
            found[at : at + random.randint(0, 2)] = random.randbytes(random.randint(0, 3))
            found = found or bytearray(b"\0")
        return bytes(found[: random.choice((len(found), len(found), random.randrange(len(found)) + 1))])

    return mutate


def kept_promise(target, data, folder, watch):
    path = folder / f"input{target.suffix(data)}"
    path.write_bytes(data)
    before = sorted(folder.rglob("*"))
    assert broken(target.calls, path, watch) == []
    assert sorted(folder.rglob("*")) == before


def test_every_reader_of_ours_is_a_target():
    assert {suffix.removeprefix(".") for suffix in OURS} <= set(TARGETS)


@pytest.mark.parametrize("path", KEPT, ids=[path.name for path in KEPT])
def test_a_kept_file(path, tmp_path, watch):
    """Named by its target: `csv-two-header-lines.csv`."""
    kept_promise(TARGETS[path.name.partition("-")[0]], path.read_bytes(), tmp_path, watch)


@EVERY_TARGET
def test_whole_files_and_changes_of_them(target, tmp_path, watch):
    whole = target.seeds()
    for data in whole:
        path = tmp_path / f"input{target.suffix(data)}"
        path.write_bytes(data)
        broken(target.calls, path)  # what loads late loads now, and is no deed of a file
    for seed in range(25):
        random = Random(f"{target.name} {seed}")
        data = target.mutate(random.choice(whole), random, changed(b"", seed))
        if data:
            kept_promise(target, data, tmp_path, watch)


def test_the_promise_can_be_broken(tmp_path, watch):
    path = tmp_path / "input.csv"
    path.write_bytes(b"x")

    def out_of_memory(path):
        try:
            raise MemoryError
        except MemoryError as error:
            raise InputError("be readable") from error

    calls = {
        "KeyError": lambda path: {}["x"],
        "UserWarning": lambda path: __import__("warnings").warn("odd", stacklevel=1),
        "memory": lambda path: np.ones(30 << 20)[:1].copy(),
        "deed open": lambda path: (path.parent / "other").write_text("written"),
        "deed os.mkdir": lambda path: (path.parent / "folder").mkdir(),
        "deed subprocess.Popen": lambda path: subprocess.run(["true"], check=True),
        "deed exec": lambda path: exec("1"),
        "message": lambda path: (_ for _ in ()).throw(InputError("cleared: \x1b[2J")),
        "MemoryError": out_of_memory,
    }
    for word, call in calls.items():
        assert any(finding.key.startswith(word) for finding in broken([call], path, watch)), word
    assert broken([lambda path: path.read_bytes()], path, watch) == []


@pytest.mark.parametrize("kind", ["fourier", "cubic"])
def test_samples_between_which_nothing_can_be_worked_out(kind):
    values = np.array([[[1e308, -1e308, 1e308, 1.7e308, 1.7e308]]])
    with pytest.raises(InputError, match=r"`values` of `SampledMatrix` .* reach 1.7e\+308 at steps down to 0.2 s"):
        floquet.SampledMatrix(values=values, period=1.0, interpolation=kind)
    assert np.isfinite(floquet.SampledMatrix(values=values, period=1.0, interpolation="linear").at([0.1, 0.5])).all()


# The command line.

RECORDS = [kind.suffix.removeprefix(".") for kind in FORMATS if kind.suffix.removeprefix(".") in TARGETS]


def snapshot(*folders):
    """What is in the folders, but for the one for output."""
    found = (path for folder in folders for path in folder.rglob("*") if "output" not in path.parts)
    return {path: path.read_bytes() if path.is_file() else None for path in found}


def typed(words, capsys):
    """Run a command: an exit code of the table, and no word of a mistake of ours."""
    code = run(words)
    said = capsys.readouterr()
    assert code in (0, 1, 2), (words, said.err)
    for bad in ("Traceback", "mistake in floquid", "Unexpected"):
        assert bad not in said.out + said.err, (words, said.err)
    assert "\x1b[2J" not in said.out + said.err
    return code


def samples(name):
    """A few whole and a few changed files of a target."""
    target = TARGETS[name]
    whole = target.seeds()
    kept = [path.read_bytes() for path in KEPT if path.name.startswith(f"{name}-")]
    changes = []
    for seed in range(6):
        random = Random(f"{name} at the command line {seed}")
        changes.append(target.mutate(random.choice(whole), random, changed(b"", seed)))
    return [data for data in (*whole[-2:], *kept[:6], *changes) if data]


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A folder to work in, one in it for output, and a home, all watched."""
    work, home = tmp_path / "work", tmp_path / "home"
    (work / "output").mkdir(parents=True)
    home.mkdir()
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.chdir(work)
    return work, home


@pytest.mark.first(1)
@pytest.mark.parametrize("name", RECORDS)
def test_records_at_the_command_line(name, place, capsys):
    for number, data in enumerate(samples(name)):
        file = f"input{number}{TARGETS[name].suffix(data)}"
        Path(file).write_bytes(data)
        before = snapshot(*place)
        typed(["info", file], capsys)
        typed(["convert", file, "output/other.csv"], capsys)
        typed(["identify", file, "--period", "0.05", "--out", f"output/{number}"], capsys)
        assert snapshot(*place) == before


@pytest.mark.parametrize(("name", "command"), [("matrix", "floquet"), ("lin", "floquet")])
def test_others_at_the_command_line(name, command, place, capsys):
    for number, data in enumerate(samples(name)[2:]):
        file = f"input{number}{TARGETS[name].suffix(data)}"
        Path(file).write_bytes(data)
        before = snapshot(*place)
        typed([command, file, "--out", f"output/{number}"], capsys)
        assert snapshot(*place) == before


def test_settings_at_the_command_line(place, capsys):
    Path("record.csv").write_bytes(b"time,x\n0,1\n1,2\n2,3\n")
    for data in samples("settings"):
        Path("settings.toml").write_bytes(data)
        before = snapshot(*place)
        assert typed(["identify", "record.csv", "--settings", "settings.toml", "--period", "nan"], capsys) == 2
        assert snapshot(*place) == before
