"""One random mechanism, A(t) of its record by itself and with the structure that is found, held against the truth."""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from benchmarks.structure.systems import Family, Mechanism, drawn

import floquid
from floquid import PeriodicModel, StateModel
from floquid.errors import IdentificationError
from floquid.reconstruction import SecondOrder, reconstruct, refine

WITHIN = 1.96
BLOCKS = ("stiffness", "damping")
TIMES = 12
"""Instants of the period at which A(t) is looked at."""


@dataclass(frozen=True)
class Block:
    """One block of an A(t): its elements at all instants."""

    inside: int
    """Intervals of 95 % that hold the truth."""
    intervals: int
    worst: float
    """The largest error, in deviations."""
    deviation: float
    """The mean deviation, over the largest element."""
    error: float
    """The mean error, over the largest element."""


@dataclass(frozen=True)
class Row:
    """One record: A(t) by itself and with the structure found, by block."""

    seed: int
    true: tuple[int, bool, int]
    """Harmonics of the stiffness, True where it is symmetric, and harmonics of the damping."""
    found: tuple[int, bool, int] | None
    seconds: float
    """Processor seconds of the search for the structure."""
    free: dict[str, Block]
    auto: dict[str, Block]

    @property
    def relation(self) -> str:
        """The structure found beside the true one: right, wider, narrow (it lacks something), or none."""
        if self.found is None or self.found == self.true:
            return "none" if self.found is None else "right"
        (k, symmetric, d), true = self.found, self.true
        return "wider" if k >= true[0] and symmetric <= true[1] and d >= true[2] else "narrow"


def judged(seed: int, family: Family = "springs", kind: str = "free") -> Row | None:
    """The row of one seed; None where the model has not the order of the truth."""
    generator = np.random.default_rng(seed)
    mechanism = drawn(generator, family)
    record = mechanism.record(generator) if kind == "free" else mechanism.excited(kind, seed)
    options = {
        "free": {},
        "inputs": {"inputs": [own.name for own in record.channels if own.quantity == "force"]},
        "ambient": {"excitation": "ambient"},
    }[kind]
    try:
        model = floquid.identify(record, validate=False, **options).model
    except IdentificationError:
        return None
    return None if model.order != 2 * mechanism.size else compared(seed, mechanism, model)


def compared(seed: int, mechanism: Mechanism, model: PeriodicModel) -> Row:
    """The row of a model."""
    free = blocks_of(mechanism, reconstruct(model, mechanism.names, times=TIMES))
    begin, found, auto = time.process_time(), None, {}
    with suppress(IdentificationError):
        refined = refine(model, mechanism.names, "auto", times=TIMES)
        own = refined.structure
        assert isinstance(own, SecondOrder)
        found = (own.stiffness.harmonics, own.stiffness.symmetry == "symmetric", own.damping.harmonics)
        auto = blocks_of(mechanism, refined.state)
    return Row(seed, mechanism.kept, found, time.process_time() - begin, free, auto)


def blocks_of(mechanism: Mechanism, state: StateModel) -> dict[str, Block]:
    """Each block of A(t) beside the truth."""
    n, truth = mechanism.size, mechanism.system(state.times)
    assert state.system_std is not None
    found = {}
    for name, columns in zip(BLOCKS, (slice(0, n), slice(n, None)), strict=True):
        place = np.s_[:, n:, columns]
        off, std = np.abs(state.system - truth)[place], state.system_std[place]
        pulls, scale = off / std, np.abs(truth[place]).max()
        inside, worst = int((pulls < WITHIN).sum()), float(pulls.max())
        found[name] = Block(inside, pulls.size, worst, float(std.mean() / scale), float(off.mean() / scale))
    return found
