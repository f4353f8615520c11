"""Sources of a result: the files and what was done to them, in order."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from math import isfinite
from types import MappingProxyType

from floquid._checks import describe, finite, input_error
from floquid._show import Brief


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance(Brief):
    """The history of a record or a result.

    Parameters
    ----------
    sources
        Where the data came from: file names, or the words of a simulation.
    steps
        What was done since, one sentence a step, in order.
    """

    sources: tuple[str, ...] = ()
    steps: tuple[str, ...] = ()

    def then(self, *steps: str) -> Provenance:
        """History with `steps` added at its end."""
        return replace(self, steps=self.steps + steps)

    @staticmethod
    def merge(parts: tuple[Provenance, ...]) -> Provenance:
        """One history of `parts`: every source, and each distinct step once, in order of first mention."""
        sources = dict.fromkeys(source for part in parts for source in part.sources)
        steps = dict.fromkeys(step for part in parts for step in part.steps)
        return Provenance(sources=tuple(sources), steps=tuple(steps))


_EXAMPLE = 'Pass a mapping, as {"speed_rpm": 742.0}.'


def names_quantity(name: object) -> bool:
    """True where a name is a printable word without a slash or an equals sign, which files and the command line use."""
    return isinstance(name, str) and name.strip(" .") != "" and name.isprintable() and not {"/", "="} & set(name)


def as_point(point: Mapping[str, float] | None, of: str) -> Mapping[str, float]:
    """The numbers of a `point` by their names, read-only; empty of None. InputError, by `of`, where it has others."""
    if point is None:
        return MappingProxyType({})
    if not isinstance(point, Mapping):
        raise input_error("point", of, "hold numbers by name", f"is {describe(point)}", _EXAMPLE)
    for name in point:
        if not names_quantity(name):
            raise input_error("point", of, "have plain words for names", f"has {describe(name)}", _EXAMPLE)
    return MappingProxyType({name: finite(value, f"point[{name!r}]", of) for name, value in point.items()})


def point_of(numbers: Mapping[str, float]) -> dict[str, float]:
    """The `numbers` of a file that an operating point can have: finite ones of plain names."""
    return {name: value for name, value in numbers.items() if isfinite(value) and names_quantity(name)}


def common_point(points: Iterable[Mapping[str, float]]) -> Mapping[str, float]:
    """The mean of each number that all `points` have, by name: records identified together are of one of them."""
    given = list(points)
    shared = [name for name in given[0] if all(name in point for point in given)] if given else []
    return MappingProxyType({name: sum(point[name] for point in given) / len(given) for name in shared})
