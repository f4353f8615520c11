"""Columns of modes over the cycles, and one step of maximum likelihood from sums over all responses.

With residues free at each phase of each channel, Y = Z(s) B + noise (Golub and Pereyra 1973). All that the data say of
the exponents s, to first order about a value of them, is in their products with a basis of Z, n Z and 1.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from queue import Queue
from threading import Event, Thread
from typing import Any, BinaryIO

import numpy as np

from floquid._arrays import Complexes, Floats, Integers, Mask
from floquid._checks import input_error
from floquid.core import ConstantPeriod, LazyRecord
from floquid.fit import scaled_inverse


@dataclass(frozen=True, slots=True)
class Modes:
    """Logarithms of the multipliers (modes,), of the upper half, and which of them are real."""

    logs: Complexes
    real: tuple[bool, ...]

    @staticmethod
    def of(multipliers: Complexes) -> Modes:
        """The upper half of multipliers, by rising angle."""
        upper = multipliers[multipliers.imag >= 0.0]
        upper = upper[np.argsort(np.angle(upper))]
        return Modes(np.log(upper.astype(complex)), tuple(bool(value.imag == 0.0) for value in upper))

    def picked(self, kept: Mask) -> Modes:
        """Some of the modes (modes,)."""
        return Modes(self.logs[kept], tuple(real for real, own in zip(self.real, kept, strict=True) if own))

    @property
    def order(self) -> int:
        """The number of columns: of poles, conjugates one by one."""
        return sum(1 if real else 2 for real in self.real)

    def columns(self, cycles: int) -> Floats:
        """Real and imaginary parts of μ^n (cycles, order); what grows is counted from the end."""
        parts = []
        for log, real in zip(self.logs, self.real, strict=True):
            power = np.exp(log * (np.arange(cycles) - self._from(log, cycles)))
            parts += [power.real] if real else [power.real, power.imag]
        return np.stack(parts, axis=1)

    def scales(self, cycles: int) -> Complexes:
        """Factors that take residues of these columns to the first cycle (modes,)."""
        return np.exp(-self.logs * [self._from(log, cycles) for log in self.logs])

    @staticmethod
    def _from(log: complex, cycles: int) -> int:
        return cycles - 1 if log.real > 0.0 else 0

    def turns(self) -> list[Floats]:
        """Shares of the columns times n in the derivative by each parameter: decay and angle of each mode in turn."""
        found, at = [], 0
        for real in self.real:
            decay = np.zeros((self.order, self.order))
            decay[at, at] = 1.0
            if real:
                found, at = [*found, decay], at + 1
                continue
            decay[at + 1, at + 1] = 1.0
            angle = np.zeros((self.order, self.order))
            angle[at + 1, at], angle[at, at + 1] = -1.0, 1.0
            found, at = [*found, decay, angle], at + 2
        return found

    def moved(self, step: Floats) -> Modes:
        """The modes after a step of their decays and angles."""
        logs, at = self.logs.copy(), 0
        for mode, real in enumerate(self.real):
            logs[mode] += step[at] if real else step[at] + 1j * step[at + 1]
            at += 1 if real else 2
        return Modes(logs, self.real)

    def mirrored(self, flipped: Mask) -> Modes:
        """The modes with the conjugate in the place of some (modes,)."""
        return Modes(np.where(flipped, self.logs.conj(), self.logs), self.real)

    @property
    def places(self) -> Integers:
        """The place of each mode among the multipliers (modes,)."""
        return np.cumsum([0, *(1 if real else 2 for real in self.real)])[:-1]

    @property
    def multipliers(self) -> Complexes:
        """Multipliers μ, each conjugate after its partner (order,); those of real modes are exactly real."""
        values = [
            [np.exp(log.real) * np.cos(log.imag)] if real else [np.exp(log), np.exp(log.conjugate())]
            for log, real in zip(self.logs, self.real, strict=True)
        ]
        return np.concatenate([np.zeros(0), *values]).astype(complex)

    @property
    def by_parameters(self) -> Complexes:
        """Derivatives of the logarithms of all multipliers by decays and angles (order, order)."""
        found, at = np.zeros((self.order, self.order), complex), 0
        for real in self.real:
            block = np.ones((1, 1)) if real else np.array([[1.0, 1.0j], [1.0, -1.0j]])
            found[at : at + len(block), at : at + len(block)] = block
            at += len(block)
        return found

    def deviations(self, covariance: Floats) -> Complexes:
        """Deviations of the logarithms (modes,), of real and imaginary part."""
        std, at, found = np.sqrt(np.diag(covariance)), 0, []
        for real in self.real:
            found.append(complex(std[at], 0.0 if real else std[at + 1]))
            at += 1 if real else 2
        return np.array(found)


@dataclass(frozen=True, slots=True)
class Basis:
    """An orthonormal basis of 1, Z and n Z over the cycles (cycles, 1 + 2 order), and its triangle R."""

    modes: Modes
    columns: Floats
    triangle: Floats

    @staticmethod
    def of(modes: Modes, cycles: int) -> Basis:
        """The basis for these modes."""
        plain = modes.columns(cycles)
        late = np.arange(cycles)[:, None] * plain
        both = np.concatenate([np.ones((cycles, 1)), plain, late], axis=1)
        columns, triangle = np.linalg.qr(both)
        return Basis(modes, columns, triangle)

    @property
    def fitted(self) -> int:
        """The columns of 1 and Z: those that a fit at these modes takes."""
        return 1 + self.modes.order

    def pseudoinverse(self, modes: Modes) -> Complexes:
        """The matrix from the sums of the basis to residues (order, columns), at other modes near these."""
        cycles = len(self.columns)
        system = self.columns.T @ np.concatenate([np.ones((cycles, 1)), modes.columns(cycles)], axis=1)
        values, at, found = np.linalg.pinv(system)[1:], 0, []
        for real, scale in zip(modes.real, modes.scales(cycles), strict=True):
            own = scale * (values[at] if real else 0.5 * (values[at] - 1j * values[at + 1]))
            found += [own] if real else [own, own.conj()]
            at += 1 if real else 2
        return np.array(found)

    def slope(self, modes: Modes, inverse: Complexes) -> Complexes:
        """G (order, order): an error δs of the logarithms of multipliers moves residues by -G diag(δs) R."""
        cycles = np.arange(len(self.columns))
        late = cycles[:, None] * np.exp(np.outer(cycles, np.log(modes.multipliers)))
        return inverse @ (self.columns.T @ late)

    def rises(self, gram: Floats) -> Floats:
        """Rises of χ² where one mode is left out and the others and the constants are fitted again (modes,)."""
        kept = slice(0, self.fitted)
        inverse = np.linalg.inv(self.triangle[kept, kept])
        squares, unit = ((inverse @ middle @ inverse.T)[1:, 1:] for middle in (gram[kept, kept], np.eye(self.fitted)))
        parts = [slice(at, at + (1 if r else 2)) for at, r in zip(self.modes.places, self.modes.real, strict=True)]
        return np.array([np.trace(np.linalg.solve(unit[part, part], squares[part, part])) for part in parts])

    def step(self, gram: Floats, responses: int) -> tuple[Floats, Floats]:
        """The step of maximum likelihood, and the covariance of decays and angles."""
        # What noise adds to the squares of the residues says nothing of the exponents: it adds to the variance alone.
        kept, rest = slice(0, self.fitted), slice(self.fitted, None)
        inverse = np.linalg.inv(self.triangle[kept, kept])
        squares = (inverse @ gram[kept, kept] @ inverse.T)[1:, 1:]
        noise = responses * (inverse @ inverse.T)[1:, 1:]
        crossed = (inverse @ gram[kept, rest])[1:]
        slopes = [self.triangle[rest, rest] @ turn for turn in self.modes.turns()]
        pull = np.array([np.trace(slope @ crossed) for slope in slopes])
        curvature, extra = (
            np.array([[np.trace(one @ middle @ other.T) for other in slopes] for one in slopes])
            for middle in (squares - noise, noise)
        )
        unit = scaled_inverse(curvature)
        return unit @ pull, unit @ (curvature + extra) @ unit


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
