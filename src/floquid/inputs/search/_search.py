"""Search for modes with inputs: the descent of J over structures, from no mode on."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

from floquid.inputs._modes import InputMode
from floquid.inputs._samples import Samples
from floquid.inputs._solver import Linearisation, linearise, solve
from floquid.inputs.search._bands import centred, far_growths, growths, helpful, shrinkages
from floquid.inputs.search._changes import additions, afresh, apart, kinds, merges, removals
from floquid.inputs.search._point import REST, Point
from floquid.inputs.search._structure import Limits, Structure
from floquid.search import LOOSE, Move, descended


def searched(
    samples: Samples, limits: Limits, report: Callable[[str], None] = lambda _: None
) -> tuple[Linearisation, bool]:
    """The modes by which J is least, with their harmonics, and whether the budget of time was over before."""
    until = limits.begun().until
    least = descended(Point(samples, limits, linearise(samples, []), helpful), _stages, until, report)
    if not least.n_modes:
        return least.at, least.unfinished
    report(f"searching for modes: harmonics of {least.n_modes}")
    loose = replace(limits, harmonic_alarm=LOOSE)
    least = descended(replace(least, limits=loose), _last_stages, until, report)
    found = least.at
    modes = [centred(samples, mode, found, number) for number, mode in enumerate(found.modes)]
    return solve(samples, [_padded(mode, limits.highest) for mode in modes], found.direct), least.unfinished


def _stages(point: Point) -> Iterator[Iterable[Move[Structure]]]:
    """Moves in groups: a group is made only where none of those before lowers J."""
    if point.n_modes:
        yield growths(point, alone=False)
        yield [*shrinkages(point), *removals(point), *merges(point)]
        yield [point.settling] if point.scores.promised > REST else []
        yield kinds(point)
    if point.limits.room(point.at.modes):
        yield additions(point)
    if point.n_modes:
        yield afresh(point)


def _last_stages(point: Point) -> Iterator[Iterable[Move[Structure]]]:
    """Moves by which the modes stay, of bands and of kinds."""
    yield growths(point, alone=False)
    yield shrinkages(point)
    yield [point.settling] if point.scores.promised > REST else []
    yield kinds(point)
    yield far_growths(point)


def nearly_one(samples: Samples, now: Linearisation) -> bool:
    """True where two modes of a fit differ by less than they decay, apart from a multiple of the fundamental."""
    found = [mode.exponent for mode in now.modes]
    return not all(apart(each, found[:number], samples.fundamental) for number, each in enumerate(found))


def _padded(mode: InputMode, highest: float) -> InputMode:
    """A mode with one harmonic more at each end of its bands: what is left out has no deviation."""
    return mode.padded("turns", 1.0, highest).padded("reach", 1.0, highest)
