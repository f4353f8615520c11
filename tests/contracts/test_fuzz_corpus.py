"""Files that were found by the fuzzer or built on purpose, through every reader and every command that takes one.

`python -m tests.fuzz` looks for more. What is promised is in `tests.fuzz.promise`.
"""

import io
import subprocess
import zlib
from pathlib import Path
from random import Random
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from tests.fuzz import seeds
from tests.fuzz.promise import Watch, broken
from tests.fuzz.targets import TARGETS

from floquid import floquet, store
from floquid.cli import run
from floquid.errors import InputError
from floquid.readers import FORMATS, read
from floquid.store._check import check_padding
from floquid.store._get import DamagedError

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


def test_every_reader_is_a_target():
    calls = {kind.load for kind in FORMATS}
    names = {kind.suffix.removeprefix(".") for kind in FORMATS}
    assert len(names & set(TARGETS)) == len(calls)


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


def test_a_head_of_blanks_is_not_handed_to_a_tokenizer(tmp_path, monkeypatch):
    """It takes NumPy ten seconds or more: what is tested is not the time, but that NumPy does not see it."""
    calls = []
    monkeypatch.setattr(np.lib.format, "read_array_header_1_0", lambda *words: calls.append(words))
    path = tmp_path / "input.npz"
    path.write_bytes((KEPT[0].parent / "npz-head-of-blanks.npz").read_bytes())
    with pytest.raises(InputError, match="its head is no description of an array"):
        read(path)
    assert calls == []


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


# Results that were made to do harm.


def result(change):
    """A whole result after `change` of the open file."""
    stream = io.BytesIO(seeds.RESULT.read_bytes())
    with h5py.File(stream, "r+") as file:
        change(file)
    return stream.getvalue()


def put(name, *arguments, **options):
    def change(file):
        del file[name]
        file.create_dataset(name, *arguments, **options)

    return change


def chunk_bomb(name):
    """A chunk of 2 MiB that unpacks into 2 GiB: each part of it follows from nothing before it."""
    packer = zlib.compressobj(9)
    parts = [packer.compress(bytes(1 << 24)) + packer.flush(zlib.Z_FULL_FLUSH) for _ in range(2)]
    data = parts[0] + 127 * parts[1]
    assert len(zlib.decompressobj().decompress(data, 1 << 26)) == 1 << 26

    def change(file):
        del file[name]
        made = file.create_dataset(name, (2, 1 << 20), "f8", chunks=(2, 1 << 20), compression="gzip")
        made.id.write_direct_chunk((0, 0), data)

    return change


def many_of_one(file):
    """One record as a thousand hits."""
    del file["lifted/lengths"]
    file["lifted/lengths"] = np.ones(1000, int)
    for number in range(3, 1001):
        file[f"records/hit{number}"] = file["records/hit1"]


def virtual(file):
    layout = h5py.VirtualLayout(shape=(4,), dtype="f8")
    layout[:] = h5py.VirtualSource("other.h5", "x", shape=(4,))
    del file["model/covariance"]
    file.create_virtual_dataset("model/covariance", layout)


def link(name, to):
    def change(file):
        del file[name]
        file[name] = to(file) if callable(to) else to

    return change


def twice(name, of):
    def change(file):
        file[name] = file[of]

    return change


def identifier(text):
    def change(file):
        if "identifier" in file["settings"]:
            del file["settings/identifier"]
        file.create_dataset("settings/identifier", data=text, dtype=h5py.string_dtype())

    return change


def attribute(name, value, **options):
    def change(file):
        file.attrs.create(name, value, **options)

    return change


CRAFTED = {
    "a shape of nothing": (put("records/hit1/values", (4, 1 << 36), "f8"), "cannot be"),
    "a shape in chunks that are not there": (put("records/hit1/values", (4, 1 << 36), "f8", chunks=(1, 1 << 20)), "be"),
    "a bomb": (chunk_bomb("records/hit1/values"), "chunks of"),
    "another filter": (put("lifted/noise", data=np.ones((3, 2)), chunks=(3, 2), scaleoffset=2), "another filter"),
    "a file elsewhere": (put("model/covariance", (4,), "f8", external=[("/etc/passwd", 0, 32)]), "in another file"),
    "data in another file": (virtual, "in another file"),
    "a link to another file": (link("model", h5py.ExternalLink("other.h5", "/")), "/model is a link"),
    "a link to itself": (link("model", h5py.SoftLink("/model")), "/model is a link"),
    "a group within itself": (twice("model/loop", "model"), "there twice"),
    "one record as many": (many_of_one, "there twice"),
    "an identifier of the system": (identifier('{"name": "os.system", "options": {"command": "id"}}'), "os.system"),
    "an identifier of the interpreter": (identifier('{"name": "eval", "options": {}}'), "eval"),
    "an attribute of an identifier": (identifier('{"name": "ERA", "options": {"__class__": 1}}'), "__class__"),
    "an identifier within a name": (identifier('{"name": {"name": "ERA"}, "options": {}}'), "cannot be read"),
    "an identifier without end": (identifier("[" * 100_000), "cannot be read"),
    "a long identifier": (identifier("x" * 2_000_000), "cannot be read"),
    "a setting of another type": (put("settings/order", data="four", dtype=h5py.string_dtype()), "order"),
    "a setting out of its range": (put("settings/order", data=np.int64(-4)), "order"),
    "texts of objects": (put("warnings", (3,), h5py.vlen_dtype("f8")), "cannot be"),
    "texts within records": (put("warnings", data=np.array([("a",)], [("x", h5py.string_dtype())])), "nor text"),
    "an attribute of many texts": (attribute("format", ["a"] * 99, dtype=h5py.string_dtype()), "no single text"),
    "an attribute that is long": (attribute("floquid", np.zeros(2000)), "no short text"),
}


@pytest.mark.parametrize("name", CRAFTED)
def test_a_crafted_result(name, tmp_path, watch):
    change, words = CRAFTED[name]
    data = result(change)
    kept_promise(TARGETS["result"], data, tmp_path, watch)
    with pytest.raises(InputError, match=words):
        store.load(tmp_path / "input.h5")


def test_a_crafted_result_that_would_have_read_another_file(tmp_path, monkeypatch):
    """The other file is there and is as it must be: what is refused is that it is another."""
    (tmp_path / "other.h5").write_bytes(seeds.RESULT.read_bytes())
    monkeypatch.chdir(tmp_path)
    (tmp_path / "input.h5").write_bytes(result(link("model", h5py.ExternalLink("other.h5", "/model"))))
    with h5py.File("input.h5") as file:
        assert "exponents" in file["model"], "the link does not work, so this test shows nothing"
    with pytest.raises(InputError, match="/model is a link"):
        store.load("input.h5")


def text_of_a_billion_letters(name):
    """A result in which what stands for a text declares a length of 2^30 - 1."""
    data = bytearray(result(lambda file: None))
    with h5py.File(io.BytesIO(bytes(data))) as file:
        at = file[name].id.get_offset()
    data[at : at + 4] = b"\xff\xff\xff\x3f"
    return bytes(data)


def test_a_text_of_a_billion_letters(tmp_path, watch):
    kept_promise(TARGETS["result"], text_of_a_billion_letters("modal/outcome"), tmp_path, watch)
    with pytest.raises(InputError, match="/modal/outcome: a text in it is not of the length declared"):
        store.load(tmp_path / "input.h5")


@pytest.mark.parametrize("kind", ["fourier", "cubic"])
def test_samples_between_which_nothing_can_be_worked_out(kind):
    values = np.array([[[1e308, -1e308, 1e308, 1.7e308, 1.7e308]]])
    with pytest.raises(InputError, match=r"`values` of `SampledMatrix` .* reach 1.7e\+308 at steps down to 0.2 s"):
        floquet.SampledMatrix(values=values, period=1.0, interpolation=kind)
    assert np.isfinite(floquet.SampledMatrix(values=values, period=1.0, interpolation="linear").at([0.1, 0.5])).all()


# The same files, of which A(t) is read.

CRAFTED_MATRICES = {
    "a link to another file": (
        link("state/system", h5py.ExternalLink("other.h5", "/")),
        "`state/system` in it is a link",
    ),
    "a link within the path": (link("state", h5py.ExternalLink("other.h5", "/")), "`state` in it is a link"),
    "a bomb": (chunk_bomb("state/system"), "chunks of"),
    "a shape of nothing": (put("state/system", (4, 1 << 36), "f8"), "declares 2.05e.03 GiB"),
    "another filter": (put("state/times", data=np.ones((4,)), chunks=(4,), scaleoffset=2), "another filter"),
    "data in another file": (put("state/times", (4,), "f8", external=[("/etc/passwd", 0, 32)]), "in another file"),
    "records": (put("state/times", data=np.zeros(3, [("a", "f8")])), "neither numbers nor text"),
    "many texts": (put("state/states", data=["x"] * 10_001, dtype=h5py.string_dtype()), "more text"),
}


@pytest.mark.parametrize("name", CRAFTED_MATRICES)
def test_a_crafted_matrix(name, tmp_path, watch):
    change, words = CRAFTED_MATRICES[name]
    kept_promise(TARGETS["matrix"], result(change), tmp_path, watch)
    with pytest.raises(InputError, match=words):
        floquet.read_matrix(tmp_path / "input.h5")


def test_a_matrix_whose_states_have_a_billion_letters(tmp_path, watch):
    kept_promise(TARGETS["matrix"], text_of_a_billion_letters("state/states"), tmp_path, watch)
    with pytest.raises(InputError, match="a text in it is not of the length declared"):
        floquet.read_matrix(tmp_path / "input.h5")


def test_hits_so_unequal_that_the_zeros_behind_them_are_a_bomb(tmp_path):
    path = tmp_path / "result.h5"
    path.write_bytes(seeds.RESULT.read_bytes())
    long = SimpleNamespace(n_channels=2, n_samples=800_000)
    short = SimpleNamespace(n_channels=2, n_samples=8)
    with h5py.File(path) as file:
        check_padding(file, [long, *[short] * 80])  # 1.04e9 bytes
        with pytest.raises(DamagedError, match="84 hits, filled up to 800000 samples, would take 1075200000 bytes"):
            check_padding(file, [long, *[short] * 83])


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


@pytest.mark.parametrize(("name", "command"), [("result", "report"), ("matrix", "floquet"), ("lin", "floquet")])
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
