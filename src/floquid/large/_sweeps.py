"""Sweeps over a record in blocks: a sketch of its responses, and their exact sums with the columns of modes."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from queue import Queue
from threading import Event, Thread
from typing import Any, BinaryIO

import numpy as np

from floquid._arrays import Floats
from floquid._checks import input_error
from floquid.core import ConstantPeriod, LazyRecord
from floquid.large._modes import Basis

Log = Callable[[str], None]

OF = "identify_large"
OWN = 6  # columns of the sketch that each channel goes to


@dataclass(frozen=True, slots=True)
class Plan:
    """The cycles of a record, and how it is read."""

    record: LazyRecord
    clock: ConstantPeriod
    phases: int
    cycles: int
    block: float  # bytes of a block
    columns: int  # of the sketch

    @property
    def responses(self) -> int:
        """The lifted responses: phases of all channels."""
        return self.record.n_channels * self.phases

    def blocks(self, what: str, report: Log) -> Iterator[tuple[slice, slice, Floats, Floats]]:
        """Blocks as rows, cycles, values (rows, cycles, phases) and energies (rows,), the next being read meanwhile."""
        samples, record = self.cycles * self.phases, self.record
        done, size, begun = 0, record.n_channels * samples, time.monotonic()
        for rows, part, values in _ahead(record.blocks(self.block, whole=self.phases, samples=samples)):
            energies = np.einsum("rn,rn->r", values, values)
            if not np.isfinite(energies).all():
                raise _unusable(record, rows, values, energies)
            cycles = slice(part.start // self.phases, part.stop // self.phases)
            yield rows, cycles, values.reshape(len(values), -1, self.phases), energies
            done += values.size
            left = (time.monotonic() - begun) * (size - done) / done
            report(f"{what}: {100 * done // size} of 100 percent, {left:.0f} s left")


def _ahead(blocks: Iterator[Any]) -> Iterator[Any]:
    """Blocks as they come, each read while the one before is worked on."""
    waiting: Queue[Any] = Queue(1)
    over = Event()

    def work() -> None:
        try:
            for block in blocks:
                waiting.put((block, None))
                if over.is_set():
                    return
            waiting.put((None, None))
        except BaseException as error:  # noqa: BLE001  # raised where it is waited for
            waiting.put((None, error))

    Thread(target=work, daemon=True).start()
    try:
        while True:
            block, error = waiting.get()
            if isinstance(error, (OSError, RuntimeError)):
                got = f"ends with: {str(error).splitlines()[0] if str(error) else type(error).__name__}"
                raise input_error("record", OF, "be readable to its end", got, "Copy it again.") from error
            if error is not None:
                raise error
            if block is None:
                return
            yield block
    finally:
        over.set()
        if not waiting.empty():
            waiting.get_nowait()


def _unusable(record: LazyRecord, rows: slice, values: Floats, energies: Floats) -> Exception:
    """The error for samples that are missing, or too large for their squares."""
    bad = int(np.flatnonzero(~np.isfinite(energies))[0])
    name = record.channels[rows.start + bad].name
    missing = int(np.isnan(values[bad]).sum())
    got = f"channel {name!r} misses {missing} samples" if missing else f"channel {name!r} has values that are too large"
    remedy = "Leave it out, or cut a part without gaps."
    return input_error("record", OF, "have all of its samples, in a usual unit", got, remedy)


def sketched(plan: Plan, report: Log) -> Floats:
    """A sketch of the lifted responses (columns, cycles): each channel's phases in a few columns, with random weights.

    Channels count by their root mean square, so that units do not matter.
    """
    sketch, scale = np.zeros((plan.columns, plan.cycles)), np.zeros(plan.record.n_channels)
    for rows, cycles, values, energies in plan.blocks("sweep 1, a sketch", report):
        for row, own, energy in zip(range(rows.start, rows.stop), values, energies, strict=True):
            if scale[row] == 0.0:
                scale[row] = np.sqrt(energy / own.size) or 1.0
            generator = np.random.default_rng([plan.columns, row])
            chosen = generator.choice(plan.columns, min(OWN, plan.columns), replace=False)
            weights = generator.standard_normal((plan.phases, len(chosen))) / (np.sqrt(plan.phases) * scale[row])
            sketch[chosen, cycles] += weights.T @ own.T
    return sketch[sketch.any(axis=1)]  # of few channels some columns have none


@dataclass(frozen=True, slots=True)
class Sums:
    """The products of all responses with a basis, over their noise (columns, columns), and the noise (channels,)."""

    gram: Floats
    noise: Floats


def summed(plan: Plan, basis: Basis, kept: BinaryIO, number: int, report: Log) -> Sums:
    """The exact sums of all responses with a basis; those of each channel go to a file (channels, columns, phases)."""
    kept.seek(0)
    width, kept_columns, channels = basis.columns.shape[1], basis.fitted, plan.record.n_channels
    gram, noise, energy = np.zeros((width, width)), np.zeros(channels), np.zeros(channels)
    free = plan.phases * (plan.cycles - kept_columns)
    sums: Floats = np.zeros((0, width, plan.phases))
    for rows, cycles, values, energies in plan.blocks(f"sweep {number}, exact sums", report):
        if cycles.start == 0:
            sums = np.zeros((len(values), width, plan.phases))
        sums += np.matmul(basis.columns[cycles].T, values)
        energy[rows] += energies
        if cycles.stop == plan.cycles:
            seen = np.einsum("rip,rip->r", sums[:, :kept_columns], sums[:, :kept_columns])
            # A channel that is modes to rounding has that for its noise.
            least = np.finfo(float).eps * energy[rows]
            noise[rows] = np.sqrt(np.maximum(energy[rows] - seen, np.maximum(least, np.finfo(float).tiny)) / free)
            scaled = (sums / noise[rows, None, None]).transpose(1, 0, 2).reshape(width, -1)
            gram += scaled @ scaled.T
            kept.write(np.ascontiguousarray(sums).data)
    kept.flush()
    return Sums(gram, noise)
