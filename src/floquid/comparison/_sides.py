"""Sides of a comparison: results, surveys, files of A(t), linearisations and example systems as points with modes."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from textwrap import shorten
from typing import Any

import numpy as np

from floquid._checks import input_error, kind_of, wrong_value
from floquid._show import late
from floquid.core import PeriodicModel
from floquid.errors import InputError
from floquid.floquet import read_matrix
from floquid.io import is_result
from floquid.surveys import KNOWN, Point, is_linearised, known_modes, point_of
from floquid.systems import SYSTEMS, JeffcottRotor

SAVED = ("result.h5", "survey.h5")
"""Files that `floquid identify` and `floquid survey` write into their folders."""

SYSTEM = "systems:"
APART = 0.02  # share by which periods and operating points may differ: beyond it λ is known modulo another iω


@dataclass(frozen=True, slots=True, kw_only=True)
class Side:
    """One side of a comparison."""

    label: str  # words for people
    points: tuple[Point, ...] = ()  # none of a system that can be made at any
    over: str | None = None  # the quantity that a survey goes over; None of one point
    # The system at a point of the other side; None where the points are all there is
    system: Callable[[Point, str | None], Any] | None = None


def side_of(thing: Any, argument: str, of: str) -> Side:
    """The side that is given as the `argument` of the callable `of`."""
    if isinstance(thing, str) and thing.startswith(SYSTEM):
        return _example(thing, argument, of)
    if isinstance(thing, (str, os.PathLike)):
        return _saved(Path(thing), argument, of)
    if kind_of(thing) == "survey":
        points = tuple(point for point in thing.points if point.model is not None)
        return Side(label=f"survey of {len(thing.points)} points", points=points, over=thing.over)
    if callable(thing) and not isinstance(thing, KNOWN):
        label = getattr(thing, "__name__", "a system").replace("<lambda>", "a function")
        return Side(label=label, system=_function(thing, argument, of))
    try:
        point = point_of(thing)
    except InputError as error:
        if "`results` of `survey`" not in str(error):
            raise
        must = "be a result, a survey, modes, a known system, a file of one of these, or systems:NAME"
        raise wrong_value(argument, of, must, thing) from None
    label = shorten("; ".join(point.files), 60, placeholder=" …") or type(thing).__name__
    return Side(label=label, points=(point,))


def _function(made: Callable[[float], Any], argument: str, of: str) -> Callable[[Point, str | None], Any]:
    def at(point: Point, over: str | None) -> Any:
        if over is None:
            must, remedy = "be one system beside one result", "Pass the system at the speed of the result."
            raise input_error(argument, of, must, "is a function of the operating point", remedy)
        return made(point.values[over])

    return at


def _example(word: str, argument: str, of: str) -> Side:
    """An example system, «systems:jeffcott» or «systems:jeffcott,support_y=2.01»."""
    name, *settings = word.removeprefix(SYSTEM).split(",")
    example = "For example: systems:jeffcott or systems:jeffcott,support_y=2.01"
    if name not in SYSTEMS:
        raise wrong_value(argument, of, f"name an example system ({', '.join(SYSTEMS)})", word, example)
    try:
        numbers = {key.strip(): float(value) for key, _, value in (one.partition("=") for one in settings)}
        made: Callable[..., JeffcottRotor] = SYSTEMS[name]
        rotor = made(**numbers)
    except (ValueError, TypeError):
        known = ", ".join(key for key, value in vars_of(JeffcottRotor()).items() if isinstance(value, float))
        raise wrong_value(argument, of, f"set numbers of {name} ({known})", word, example) from None
    if "speed" in numbers:
        return Side(label=word, points=(point_of(rotor),))
    return Side(label=word, system=lambda point, _: _turning(rotor, point))


def vars_of(rotor: JeffcottRotor) -> Mapping[str, object]:
    """The parameters of a `rotor` by name."""
    return {name: getattr(rotor, name) for name in rotor.__dataclass_fields__}


def _turning(rotor: JeffcottRotor, point: Point) -> JeffcottRotor:
    """The rotor at the speed at which its period, half a revolution, is that of the point."""
    return rotor if point.model is None else replace(rotor, speed=np.pi / point.model.period)


def _saved(path: Path, argument: str, of: str) -> Side:
    """A result or a survey, a folder of one, a file with A(t), `.lin` files in a folder, or several folders of them."""
    label = str(path)
    if path.is_dir():
        inside = next((path / name for name in SAVED if (path / name).is_file()), None)
        if inside is not None:
            return replace(_saved(inside, argument, of), label=label)
        folders = [path] if is_linearised(path) else [one for one in sorted(path.iterdir()) if is_linearised(one)]
        if not folders:
            remedy = "Name the folder that `floquid identify --out` or `floquid survey --out` wrote."
            raise input_error(argument, of, "hold a result, a survey or .lin files", f"{path} holds none", remedy)
        points = tuple(replace(point_of(_matrix(folder, argument, of)), files=(str(folder),)) for folder in folders)
        return Side(label=label, points=points, over="speed_rpm" if len(points) > 1 else None)
    if is_result(path):
        found = late("store", "load")(path)
        if found.kind not in ("analysis", "large", "fitted", "survey"):
            must, remedy = "be what `floquid identify` or `floquid survey` wrote", "Name that, or its folder."
            raise input_error(argument, of, must, f"{path} holds something else ({type(found).__name__})", remedy)
        return replace(side_of(found, argument, of), label=label)
    if path.suffix.lower() == ".json" and path.is_file() and '"floquid-' in path.read_text("utf-8", "replace")[:200]:
        remedy = f"Name {path.parent / SAVED[0]}: deviations are kept there."
        raise input_error(argument, of, "be the result itself", f"{path} is its summary", remedy)
    return Side(label=label, points=(replace(point_of(_matrix(path, argument, of)), files=(label,)),))


def _matrix(path: Path, argument: str, of: str) -> Any:
    """A(t) of a file; what is wrong with it is told of the argument."""
    try:
        return read_matrix(path)
    except InputError as error:
        if "Argument `period`" in str(error):
            got = f"{path} does not"
            raise input_error(argument, of, "state the period of A(t)", got, "Save `period` [s] beside A.") from None
        words = re.sub(r"`paths` of `floquet\.read_(matrix|openfast)`", f"`{argument}` of `{of}`", str(error))
        raise InputError(words) from None


def matched(a: Side, b: Side, of: str) -> tuple[list[tuple[Point, Point]], str | None]:
    """Points of both sides that belong together, and the quantity of the operating point; None of one point each."""
    if a.system is not None and b.system is not None:
        start = Point(values={})
        a = replace(a, points=(point_of(a.system(start, None)),), system=None)
        b = replace(b, points=(point_of(b.system(start, None)),), system=None)
    over = a.over or b.over
    if a.over and b.over and a.over != b.over:
        raise input_error("b", of, f"be a survey over {a.over}, as a", f"is one over {b.over}")
    if b.system is not None:
        return [(point, _made(b.system, point, over)) for point in a.points], over
    if a.system is not None:
        return [(_made(a.system, point, over), point) for point in b.points], over
    if over is None:
        return [(a.points[0], b.points[0])], None
    for side, argument in ((a, "a"), (b, "b")):
        if any(over not in point.values for point in side.points):
            raise input_error(argument, of, f"have a value of {over}", f"{side.label} has none")
    found = _neighbours(a.points, b.points, over)
    if not found:
        values = [", ".join(f"{point.values[over]:g}" for point in side.points[:6]) for side in (a, b)]
        got = f"{a.label} is at {values[0]}, and {b.label} at {values[1]}"
        raise input_error("b", of, f"have a value of {over} that a has", got)
    return found, over


def _neighbours(first: Sequence[Point], second: Sequence[Point], over: str) -> list[tuple[Point, Point]]:
    """Points that are the nearest to each other, and near enough."""
    x, y = (np.array([point.values[over] for point in points]) for points in (first, second))
    off = np.abs(np.subtract.outer(x, y))
    near = off <= APART * np.maximum.outer(np.abs(x), np.abs(y))
    near &= (off == off.min(axis=1, keepdims=True)) & (off == off.min(axis=0, keepdims=True))
    return [(first[i], second[j]) for i, j in np.argwhere(near).tolist()]


def _made(system: Callable[[Point, str | None], Any], point: Point, over: str | None) -> Point:
    """A known system at the operating point of the other side."""
    made = point_of(known_modes(system(point, over)))
    return replace(made, values={**made.values, **point.values})


def check_periods(one: Point, other: Point, of: str) -> None:
    """Refuse points whose periods are not one: exponents are known modulo iω."""
    assert one.model is not None
    assert other.model is not None
    lengths = one.model.period, other.model.period
    if abs(lengths[0] / lengths[1] - 1.0) > APART:
        remedy = "Compare at one speed, and with the period of the same part of a revolution: λ is known modulo iω."
        raise input_error("b", of, "have the period of a", f"has {lengths[1]:.6g} s, and a {lengths[0]:.6g} s", remedy)


def scaled(model: PeriodicModel, scale: Mapping[str, float]) -> PeriodicModel:
    """The model with channels multiplied by their `scale`, by name."""
    if not scale:
        return model
    by = np.array([scale.get(channel.name, 1.0) for channel in model.channels])[:, None, None]
    std = None if model.coefficient_std is None else model.coefficient_std * np.abs(by)
    return replace(model, coefficients=model.coefficients * by, coefficient_std=std, estimates=None, unselected=None)


def shared_channels(one: PeriodicModel, other: PeriodicModel, scale: Mapping[str, float], of: str) -> Sequence[str]:
    """Names of the channels that both have; refused where units differ and no `scale` makes them one."""
    units = {channel.name: channel.unit for channel in other.channels}
    found = [channel for channel in one.channels if channel.name in units]
    for channel in found:
        unit = units[channel.name]
        if channel.name not in scale and "-" not in (unit, channel.unit) and unit != channel.unit:
            got = f"has {channel.name!r} in {unit}, and a in {channel.unit}"
            remedy = f'Pass scale={{"{channel.name}": FACTOR}}, which takes b to the unit of a.'
            raise input_error("b", of, "have the units of a", got, remedy)
    return [channel.name for channel in found]
