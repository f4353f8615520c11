"""What is fuzzed: every reader of records, from the table of formats, and every other file that floquid takes in."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from random import Random

from tests.fuzz import mutators, seeds

from floquid import floquet, store
from floquid.cli._settings import load_choices
from floquid.floquet._lin_file import read_lin
from floquid.readers import FORMATS, describe_file, read

Call = Callable[[Path], object]


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """One kind of file: whole ones to begin with, how one is changed, its suffix, and the calls that take it."""

    name: str
    seeds: Callable[[], list[bytes]]
    mutate: Callable[[bytes, Random, mutators.Mutate], bytes]
    calls: tuple[Call, ...]
    suffix: Callable[[bytes], str]


def as_it_is(path: Path) -> object:
    """The record in a file, by what the file says."""
    return read(path)


def with_rate(path: Path) -> object:
    """The record in a file whose times are ignored."""
    return read(path, rate=100.0, period=0.1)


def by_name(path: Path) -> object:
    """One channel of a file."""
    return read(path, channels=["x"], rate=50.0)


def by_path(path: Path) -> object:
    """Vectors, by their paths in a file of variables."""
    return read(path, channels=["run/a", "run.b"])


def all_columns(path: Path) -> object:
    """The columns of a matrix in a file of variables."""
    return read(path, channels=["data.T"])


def settings(path: Path) -> object:
    """The choices in a settings file, resolved and written again."""
    choices = load_choices(path)
    return choices.resolved(), choices.text()


def one_matrix(path: Path) -> object:
    """A(t) in a file of arrays."""
    return floquet.read_matrix(path, period=None)


def given_period(path: Path) -> object:
    """A(t) in a file of arrays that need not state its period."""
    return floquet.read_matrix(path, period=1.7, interpolation="linear")


def one_lin(path: Path) -> object:
    """One linearisation, and those of a turn of which it is a part."""
    return read_lin(path)


def turn_of_lin(path: Path) -> object:
    """The linearisations of one turn of a rotor, of which this is one."""
    return floquet.read_openfast([path, *_other_azimuths()])


@cache
def _other_azimuths() -> tuple[Path, ...]:
    folder = Path(tempfile.mkdtemp(prefix="floquid-fuzz-lin-"))
    others = []
    for number, data in enumerate(seeds.lin()[1:4]):
        others.append(folder / f"other.{number}.lin")
        others[-1].write_bytes(data)
    return tuple(others)


def _fixed(suffix: str) -> Callable[[bytes], str]:
    return lambda data: suffix


def _of_matrix(data: bytes) -> str:
    """By the first bytes: A(t) comes in several formats, which one target mixes."""
    for mark, suffix in ((b"PK", ".npz"), (b"\x89HDF", ".h5"), (b"MATLAB", ".mat")):
        if data.startswith(mark):
            return suffix
    return ".json"


def _readers() -> dict[str, Target]:
    found: dict[str, Target] = {}
    loads = set()
    for kind in FORMATS:
        if kind.load in loads:  # .hdf5 is .h5, and .unv is .uff
            continue
        loads.add(kind.load)
        name = kind.suffix.removeprefix(".")
        variables = (by_path, all_columns) if name in ("mat", "h5") else (by_name,)
        found[name] = Target(
            name=name,
            seeds=lambda suffix=kind.suffix: seeds.records(suffix),
            mutate=mutators.of(name),
            calls=(describe_file, as_it_is, with_rate, *variables),
            suffix=_fixed(kind.suffix),
        )
    return found


TARGETS: dict[str, Target] = {
    **_readers(),
    "result": Target(
        name="result", seeds=seeds.results, mutate=mutators.result, calls=(store.load,), suffix=_fixed(".h5")
    ),
    "matrix": Target(
        name="matrix",
        seeds=seeds.matrices,
        mutate=mutators.matrix,
        calls=(one_matrix, given_period),
        suffix=_of_matrix,
    ),
    "lin": Target(
        name="lin", seeds=seeds.lin, mutate=mutators.text, calls=(one_lin, turn_of_lin), suffix=_fixed(".lin")
    ),
    "settings": Target(
        name="settings", seeds=seeds.settings, mutate=mutators.text, calls=(settings,), suffix=_fixed(".toml")
    ),
}
