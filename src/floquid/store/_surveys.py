"""Surveys in a result file: points with their models, tracks and edges."""

from __future__ import annotations

from typing import Any

import numpy as np

from floquid.core import PeriodicModel
from floquid.store._datasets import get, get_fields, get_object, put, put_object
from floquid.surveys import Edge, Point, Survey, Track

UNLINKED = "modes, point and mode"


def put_survey(file: Any, found: Survey) -> None:
    """Write a survey."""
    put_object(file, found)
    put(file, "unlinked", np.array(found.unlinked, np.int64).reshape(-1, 2), UNLINKED)
    for name, things in (("points", found.points), ("tracks", found.tracks), ("edges", found.edges)):
        for number, thing in enumerate(things, start=1):
            group = file.create_group(f"{name}/{name[:-1]}{number}")
            put_object(group, thing)
            if isinstance(thing, Point) and thing.model is not None:
                put_object(group.create_group("model"), thing.model)


def read_survey(file: Any) -> Survey:
    """The survey of a file."""

    def groups(name: str) -> list[Any]:
        count = len(file[name]) if name in file else 0
        return [file[f"{name}/{name[:-1]}{number}"] for number in range(1, count + 1)]

    points = tuple(
        Point(**get_fields(group, Point), model=get_object(group["model"], PeriodicModel) if "model" in group else None)
        for group in groups("points")
    )
    return Survey(
        **get_fields(file, Survey),
        points=points,
        tracks=tuple(get_object(group, Track) for group in groups("tracks")),
        edges=tuple(_edge(get_fields(group, Edge)) for group in groups("edges")),
        unlinked=tuple((point, mode) for point, mode in get(file, "unlinked", UNLINKED).tolist()),
    )


def _edge(fields: dict[str, Any]) -> Edge:
    """An edge, what it holds as tuples."""
    lists: dict[str, Any] = {name: tuple(fields[name].tolist()) for name in ("interval", "between", "tracks")}
    return Edge(**fields | lists)
