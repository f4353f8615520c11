"""Descent of J over structures: each tried once, the best predicted move first, accepted where J falls."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import replace

import numpy as np

from floquid.periodic.least_squares import ModeParameters
from floquid.periodic.search._moves import Move, unfolded
from floquid.periodic.search._objective import Point

TRIES = 12  # moves of one round that are fitted, the best predicted first: what comes later hardly ever helps
SAME = 0.06  # the difference of two exponents times the period [1] within which structures count as one

Stages = Callable[[Point], Iterator[Iterable[Move]]]
Report = Callable[[str], None]


def descended(begin: Point, stages: Stages, until: float, report: Report = lambda _: None) -> Point:
    """The point from which no move lowers J; or the last one when the processor time `until` is over."""
    now = begin
    seen = {key(now)}
    while True:
        better = _improved(now, stages, seen, until, report)
        if better is None:
            return replace(now, unfinished=time.process_time() > until)
        now = better


def _improved(now: Point, stages: Stages, seen: set, until: float, report: Report) -> Point | None:
    for stage in stages(now):
        for move in sorted(stage, key=lambda move: move.change)[:TRIES]:
            name = key(now, move.entries)
            if name in seen:
                continue
            if time.process_time() > until:
                return None
            seen.add(name)
            with suppress(np.linalg.LinAlgError):
                trial = now.with_entries(move.entries).settled(below=now.value)
                if trial.value < now.value - move.least:
                    report(f"searching for modes: {int((~trial.entries.fixed).sum())} found")
                    return trial
    return None


def key(point: Point, entries: ModeParameters | None = None) -> tuple:
    """Name of the structure of a point or of other entries: one for all branches of a mode unless the speed wanders."""
    entries = point.entries if entries is None else entries
    period, low = 2.0 * np.pi / entries.fundamental, unfolded(entries)
    branches = np.rint(entries.exponents.imag * period / (2.0 * np.pi)) if point.wanders else np.zeros(len(low))
    widths = entries.bands[:, 1] - entries.bands[:, 0]
    decays, turns = np.rint(np.array([low.real, low.imag]) * period / SAME)
    names = np.stack([entries.real, decays, turns, widths, branches], axis=1)
    steady = np.stack([np.round(low.imag * period, 6), entries.factors], axis=1)
    held = entries.fixed
    return tuple(sorted(map(tuple, names[~held].tolist()))), tuple(sorted(map(tuple, steady[held].tolist())))
