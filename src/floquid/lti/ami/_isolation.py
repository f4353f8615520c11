"""Mode isolation: find the strongest peak of what is left, fit one mode there, subtract it, and go round the modes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from floquid._arrays import Complexes, Floats
from floquid.fit import DEVIATIONS, ROUNDS, STEPS
from floquid.lti._poles import FASTEST, NEGATIVE, PAIR, POSITIVE, WHITE, Block, PoleSet
from floquid.lti.ami._fit import (
    Band,
    Bands,
    Mode,
    band_lines,
    bands_of,
    cut,
    evaluate,
    fit_pole,
    fit_residues,
    joint_residues,
    newton,
)

NEAR = 3.0
"""Half-power half-widths to each side of a peak that a mode's first fit looks at, the other modes being unknown."""


@dataclass(frozen=True, slots=True)
class Isolated:
    """Modes, and what they leave of each block's lines (lines, outputs, inputs) with its sum of squares."""

    modes: tuple[Mode, ...]
    left: tuple[Complexes, ...]
    cost: float
    rest: float = 0.0  # distance that a pole moved in the last round, in its deviations

    @staticmethod
    def of(modes: Sequence[Mode], left: Sequence[Complexes], rest: float = 0.0) -> Isolated:
        """With the sum of squares of what is left."""
        cost = float(sum(np.sum(lines.real**2) + np.sum(lines.imag**2) for lines in left))
        return Isolated(tuple(modes), tuple(left), cost, rest)

    @property
    def order(self) -> int:
        """The number of poles, one by one."""
        return sum(mode.size for mode in self.modes)

    def poles(self) -> PoleSet:
        """The poles."""
        return PoleSet(np.array([m.s for m in self.modes], complex), np.array([m.kind for m in self.modes], np.int64))


@dataclass(frozen=True, slots=True, kw_only=True)
class Rounds:
    """Order of going round the modes, and rounds at `most`: the options of `AMI`."""

    widths: float
    tolerance: float
    most: int
    rank_one: bool


def nothing(blocks: Sequence[Block]) -> Isolated:
    """No mode yet."""
    return Isolated.of((), [block.values for block in blocks])


def empty_mode(s: complex, kind: int, blocks: Sequence[Block]) -> Mode:
    """A mode with no residues yet."""
    size = 2 if kind == PAIR else 1
    return Mode(s, kind, tuple(np.zeros((size, *block.values.shape[1:])) for block in blocks))


def started(poles: PoleSet, blocks: Sequence[Block], rounds: Rounds) -> Isolated:
    """Modes at given poles, to go round from."""
    modes = [empty_mode(complex(s), int(kind), blocks) for s, kind in zip(poles.s, poles.kind, strict=True)]
    modes = joint_residues(modes, blocks, bands_of(modes, blocks, rounds.widths)) or modes
    return Isolated.of(modes, _left(modes, blocks), np.inf)


def go_round(now: Isolated, blocks: Sequence[Block], rounds: Rounds) -> Isolated:
    """Fit each mode to the data less the others, again and again, until the poles stop moving."""
    # Modes that overlap come to rest slowly, by a constant factor a round. So every few rounds a leap to where they
    # will come to rest is tried, and taken unless it leaves more than the last round did: Newton's step on the
    # equations that the rounds solve.
    outer = rounds.rank_one and sum(len(block.inputs) for block in blocks) > 1
    near: Bands = []
    best: Isolated | None = None
    for count in range(rounds.most if now.modes else 0):
        if count < ROUNDS:  # bands that go on following their poles would not let them come to rest
            near = bands_of(now.modes, blocks, rounds.widths)
        now = _one_round(now, blocks, near, rounds.rank_one)
        if now.rest < rounds.tolerance:
            break
        best = now if best is None or now.cost < best.cost else best
        if (count + 1) % ROUNDS == 0 and len(now.modes) > 1:
            leap = newton(now.modes, blocks, near, lambda modes: Isolated.of(modes, _left(modes, blocks)).cost)
            now = _taken(leap, now, blocks, outer)
    # Poles that are hardly told apart may drive each other away instead of coming to rest.
    return now if best is None or now.cost < best.cost + 1.0 else best


def _left(modes: Sequence[Mode], blocks: Sequence[Block]) -> tuple[Complexes, ...]:
    """Residual of the blocks' lines beside modes."""
    return tuple(block.values - sum(mode.lines(b, block) for mode in modes) for b, block in enumerate(blocks))


def _taken(leap: Sequence[Mode] | None, now: Isolated, blocks: Sequence[Block], outer: bool) -> Isolated:
    """The modes after a leap, or as they were where it leads nowhere."""
    if leap is None or any(not FASTEST[0] <= mode.s.real <= FASTEST[1] for mode in leap):
        return now
    modes = tuple(rank_one_mode(mode, blocks) for mode in leap) if outer else tuple(leap)
    there = Isolated.of(modes, _left(modes, blocks), now.rest)
    return there if there.cost < now.cost + 1.0 else now


def _one_round(now: Isolated, blocks: Sequence[Block], near: Bands, rank_one: bool) -> Isolated:
    modes, left, moved = list(now.modes), list(now.left), 0.0
    for position, mode in enumerate(modes):
        own = [lines + mode.lines(b, block) for b, (block, lines) in enumerate(zip(blocks, left, strict=True))]
        new = fit_mode(mode, blocks, own, [lines[position] for lines in near], rank_one)
        left = [lines - new.lines(b, block) for b, (block, lines) in enumerate(zip(blocks, own, strict=True))]
        distance = min(abs(new.s - mode.s), abs(new.s - mode.s.conjugate()))
        moved = max(moved, distance / new.deviation)
        modes[position] = new
    return Isolated.of(modes, left, moved)


def fit_mode(
    mode: Mode, blocks: Sequence[Block], own: Sequence[Complexes], near: Sequence[slice], rank_one: bool
) -> Mode:
    """The mode fitted to `own`, lines that should hold nothing else, on the lines `near` its peak."""
    bands = [cut(block, lines, n) for block, lines, n in zip(blocks, own, near, strict=True)]
    s, _, deviation = fit_pole(mode.s, mode.kind, bands, iterations=4)
    shapes = [lines.shape[1:] for lines in own]
    found = [fit_residues(s, mode.kind, band).reshape(-1, *shape) for band, shape in zip(bands, shapes, strict=True)]
    fitted = Mode(s, mode.kind, tuple(found), deviation)
    return rank_one_mode(fitted, blocks) if rank_one and sum(shape[1] for shape in shapes) > 1 else fitted


def growth(s: complex, block: Block) -> complex:
    """Factor that takes a residue of the scaled columns to sample zero: growing modes are scaled to one at the last."""
    return complex(np.exp(-(block.samples - 1) * s)) if s.real > 0 else 1.0 + 0.0j


def residues(mode: Mode, blocks: Sequence[Block], n_inputs: int) -> Complexes:
    """R (outputs, inputs) of a mode, of the upper half of a pair, in the units of the responses."""
    out = np.zeros((blocks[0].values.shape[1], n_inputs), complex)
    for own, block in zip(mode.coefficients, blocks, strict=True):
        value = 0.5 * (own[0] - 1j * own[1]) if mode.kind == PAIR else own[0] + 0.0j
        out[:, block.inputs] = value * block.noise * growth(mode.s, block)
    return out


def rank_one_mode(mode: Mode, blocks: Sequence[Block]) -> Mode:
    """The mode with its residues brought to the nearest outer product ψ Lᵀ, in the metric of the noise."""
    n_inputs = sum(len(block.inputs) for block in blocks)
    noise = np.ones((blocks[0].values.shape[1], n_inputs))
    for block in blocks:
        noise[:, block.inputs] = block.noise
    nearest = nearest_outer_product(residues(mode, blocks, n_inputs), noise)
    parts = []
    for block in blocks:
        value = nearest[:, block.inputs] / (block.noise * growth(mode.s, block))
        parts.append(np.stack([2.0 * value.real, -2.0 * value.imag]) if mode.kind == PAIR else value.real[None])
    return replace(mode, coefficients=tuple(parts))


def nearest_outer_product(matrix: Complexes, noise: Floats) -> Complexes:
    """The outer product ψ Lᵀ (outputs, inputs) that minimises Σ |R - ψ Lᵀ|²/σ², by turns in ψ and L."""
    weight = 1.0 / noise**2
    rows = np.exp(np.mean(np.log(noise), axis=1, keepdims=True))
    right = np.linalg.svd(matrix / rows, full_matrices=False)[2][0]
    product = np.zeros_like(matrix)
    for _ in range(STEPS):
        shape = (weight * matrix) @ right.conj() / np.maximum(weight @ np.abs(right) ** 2, np.finfo(float).tiny)
        size = weight.T @ np.abs(shape) ** 2
        right = shape.conj() @ (weight * matrix) / np.maximum(size, np.finfo(float).tiny)
        before, product = product, np.outer(shape, right)
        if np.sum(weight * np.abs(product - before) ** 2) <= 1e-24 * np.sum(weight * np.abs(product) ** 2):
            break
    return product


def without(now: Isolated, position: int, blocks: Sequence[Block]) -> Isolated:
    """The modes less one, its part given back to what is left."""
    gone = now.modes[position]
    left = [x + gone.lines(b, block) for b, (block, x) in enumerate(zip(blocks, now.left, strict=True))]
    return Isolated.of(now.modes[:position] + now.modes[position + 1 :], left)


def joined(now: Isolated, mode: Mode, blocks: Sequence[Block]) -> Isolated:
    """The modes and one more, subtracted from what is left."""
    left = [x - mode.lines(b, block) for b, (block, x) in enumerate(zip(blocks, now.left, strict=True))]
    return Isolated.of((*now.modes, mode), left)


@dataclass(frozen=True, slots=True)
class Peak:
    """A stretch of a block's composite above white noise: its highest line, its width, how clear it is."""

    block: int
    line: int
    width: int
    clarity: float


def peaks(now: Isolated, blocks: Sequence[Block], *, clear: float = DEVIATIONS) -> list[Peak]:
    """The stretches of the composites of what is left that rise most clearly above white noise, the clearest first."""
    # A sharp peak is clearest in a narrow stretch, a broad one in a wide one: widths of 1, 2, 4, … lines are tried, in
    # units of the standard deviation that white noise has there. Of stretches that overlap the clearest is kept.
    found: list[Peak] = []
    for number, (block, lines) in enumerate(zip(blocks, now.left, strict=True)):
        curve, count = np.abs(lines).mean(axis=(1, 2)) / block.weights, lines.shape[1] * lines.shape[2]
        # Real lines (the ends) are |x| of a normal number, the others |z| of a complex one.
        real = block.weights == 1.0
        mean = np.where(real, np.sqrt(2.0 / np.pi), WHITE)
        variance = np.where(real, 1.0 - 2.0 / np.pi, 1.0 - np.pi / 4.0) / count
        width = 1
        while width <= max(1, len(curve) // 4):
            box = np.ones(width)
            excess = np.convolve(curve - mean, box, "valid") / np.sqrt(np.convolve(variance, box, "valid"))
            # Every start of a narrow stretch would be listed: those within its own width are one peak.
            for start in _tops(excess, width, clear):
                line = start + int(np.argmax(curve[start : start + width]))
                found.append(Peak(number, line, width, float(excess[start])))
            width *= 2
    return _apart(sorted(found, key=lambda peak: -peak.clarity), blocks)


def _tops(values: Floats, width: int, least: float) -> list[int]:
    """The positions of the largest values above `least`, each the largest within `width` of it."""
    order = np.argsort(values)[::-1]
    tops: list[int] = []
    for position in order[: 64 * width]:
        if values[position] <= least:
            break
        if all(abs(position - other) >= width for other in tops):
            tops.append(int(position))
    return tops


def _apart(found: Sequence[Peak], blocks: Sequence[Block]) -> list[Peak]:
    """The peaks that do not lie within the stretch of a clearer one."""
    kept: list[Peak] = []
    for peak in found:
        angle = peak.line / blocks[peak.block].samples
        reach = [max(p.width, peak.width) / blocks[p.block].samples for p in kept]
        if all(abs(angle - p.line / blocks[p.block].samples) > r for p, r in zip(kept, reach, strict=True)):
            kept.append(peak)
    return kept


def first_fits(peak: Peak, now: Isolated, blocks: Sequence[Block], rank_one: bool) -> Iterator[Mode]:
    """One-mode fits near a peak of the residual: a pair, and next to an end of the band a real pole too."""
    samples = blocks[peak.block].samples
    spacing = 2.0 * np.pi / samples
    angle, reach = peak.line * spacing, max(2 * peak.width, 8) * spacing
    kinds = [PAIR] * (samples > 2)
    kinds += [POSITIVE] if angle <= reach else []
    kinds += [NEGATIVE] if np.pi - angle <= reach else []
    wide = [band_lines(complex(0.5 * peak.width * spacing / NEAR, angle), block, 2.0 * NEAR) for block in blocks]
    bands = [cut(block, x, near) for block, x, near in zip(blocks, now.left, wide, strict=True)]
    for kind in kinds:
        s, _, _ = fit_pole(_start(kind, angle, spacing, peak.width, bands), kind, bands)
        near = [band_lines(s, block, NEAR) for block in blocks]
        yield fit_mode(Mode(s, kind), blocks, now.left, near, rank_one)


def _start(kind: int, angle: float, spacing: float, width: int, bands: Sequence[Band]) -> complex:
    """The best of a grid of poles near a peak."""
    decays = spacing * np.unique([0.05, 0.2, 0.5, 1.0, 0.25 * width, 0.5 * width, width])
    turns = spacing * np.array([-0.6, -0.3, 0.0, 0.3, 0.6]) if kind == PAIR else np.zeros(1)
    middle = {PAIR: np.clip(angle, 0.7 * spacing, np.pi - 0.7 * spacing), POSITIVE: 0.0}.get(kind, np.pi)
    trials = [complex(-decay, middle + turn) for decay in decays for turn in turns]
    return min(trials, key=lambda s: evaluate(s, kind, bands).cost)
