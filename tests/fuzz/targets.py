"""What is fuzzed: the readers of records that are our own, and every other file that floquid itself takes apart.

What a library reads for us (decision 0020) is not: its faults are not ours to look for.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from random import Random

from tests.fuzz import mutators, seeds

from floquid import floquet
from floquid.cli.arguments.options import choices_of
from floquid.floquet import read_lin
from floquid.readers import FORMATS, describe_file, read

Call = Callable[[Path], object]
OURS = (".csv", ".uff", ".out", ".outb")


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


def settings(path: Path) -> object:
    """The choices in a settings file, resolved and written again."""
    choices = choices_of(path)
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


def _readers() -> dict[str, Target]:
    found: dict[str, Target] = {}
    loads = set()
    for kind in FORMATS:
        if kind.load in loads or kind.suffix not in OURS:  # .unv is .uff
            continue
        loads.add(kind.load)
        name = kind.suffix.removeprefix(".")
        found[name] = Target(
            name=name,
            seeds=lambda suffix=kind.suffix: seeds.records(suffix),
            mutate=mutators.of(name),
            calls=(describe_file, as_it_is, with_rate, by_name),
            suffix=_fixed(kind.suffix),
        )
    return found


TARGETS: dict[str, Target] = {
    **_readers(),
    "matrix": Target(
        name="matrix",
        seeds=seeds.matrices,
        mutate=mutators.matrix,
        calls=(one_matrix, given_period),
        suffix=_fixed(".json"),
    ),
    "lin": Target(
        name="lin", seeds=seeds.lin, mutate=mutators.text, calls=(one_lin, turn_of_lin), suffix=_fixed(".lin")
    ),
    "settings": Target(
        name="settings", seeds=seeds.settings, mutate=mutators.text, calls=(settings,), suffix=_fixed(".toml")
    ),
}
