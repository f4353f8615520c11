"""The fit of modes to spectra near their peaks: one by steps of its pole, or all at once by Newton."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from floquid._arrays import Complexes, Floats
from floquid.fit import FEW_STEPS, ROUNDING, Ends, Normal, Steps, levenberg_marquardt, positive_part, scaled_inverse
from floquid.lti._poles import FASTEST, PAIR, Block, PoleSet, mode_columns, moved_pole


@dataclass(frozen=True, slots=True)
class Mode:
    """One mode: s = ln μ, its kind, and the coefficients of its real columns, (columns, outputs, inputs) a block."""

    s: complex
    kind: int
    coefficients: tuple[Floats, ...] = ()
    deviation: float = np.inf  # the larger standard deviation of Re s and Im s, the other modes being known

    @property
    def size(self) -> int:
        """The number of complex poles: 2 for a pair."""
        return 2 if self.kind == PAIR else 1

    def lines(self, number: int, block: Block) -> Complexes:
        """Mode on the lines of block `number` (lines, outputs, inputs)."""
        columns, _ = mode_columns(self.s, self.kind, block.angles, block.samples, block.weights)
        return np.tensordot(columns, self.coefficients[number], axes=1)


@dataclass(frozen=True, slots=True)
class Band:
    """The lines of one block that a fit looks at, as rows of real numbers: `values` (2 lines, responses)."""

    angles: Floats
    weights: Floats
    samples: int
    values: Floats


def real_rows(lines: Complexes) -> Floats:
    """Real parts above imaginary parts."""
    return np.concatenate([lines.real, lines.imag])


def band_lines(s: complex, block: Block, widths: float) -> slice:
    """The lines within `widths` half-power half-widths of a pole's peak."""
    spacing = 2.0 * np.pi / block.samples
    # No peak is narrower than a line on each side.
    reach = int(np.ceil(widths * max(abs(s.real) / spacing, 1.0)))
    centre = round(abs(s.imag) / spacing)
    return slice(max(0, centre - reach), min(len(block.values), centre + reach + 1))


def cut(block: Block, values: Complexes, near: slice) -> Band:
    """The lines `near` of `values` (lines, outputs, inputs)."""
    rows = real_rows(values[near].reshape(near.stop - near.start, -1))
    return Band(block.angles[near], block.weights[near], block.samples, rows)


@dataclass(frozen=True, slots=True)
class Step:
    """A pole, its cost with the residues eliminated, the gradient, and the Gauss-Newton matrix (Kaufman's)."""

    s: complex
    cost: float
    gradient: Floats
    information: Floats


def evaluate(s: complex, kind: int, bands: Sequence[Band]) -> Step:
    """The step at a pole of this kind."""
    parameters = 2 if kind == PAIR else 1
    cost, gradient, information = 0.0, np.zeros(parameters), np.zeros((parameters, parameters))
    for band in bands:
        columns, slopes = mode_columns(s, kind, band.angles, band.samples, band.weights)
        basis, moved = real_rows(columns), real_rows(slopes)
        q, inverse = orthonormal(basis)
        projected = q.T @ band.values
        left = band.values - q @ projected
        own = inverse @ projected
        cost += float(np.sum(left**2))
        # d/d Re s takes the columns Re, Im of kμ^k; d/d Im s takes -Im, Re of it.
        turns = [moved, np.stack([-moved[:, 1], moved[:, 0]], axis=1)] if kind == PAIR else [moved]
        turns = [turn - q @ (q.T @ turn) for turn in turns]
        strength = own @ own.T
        gradient += [float(np.sum((turn.T @ left) * own)) for turn in turns]
        information += [[float(np.sum((a.T @ b) * strength)) for b in turns] for a in turns]
    return Step(s, cost, gradient, information)


def orthonormal(basis: Floats) -> tuple[Floats, Floats]:
    """Q and R⁻¹ of one or two columns, ten times as fast as a library's; a dependent column counts for nothing."""
    q, inverse = np.array(basis), np.eye(basis.shape[1])
    for column in range(basis.shape[1]):
        size = whole = np.sqrt(q[:, column] @ q[:, column])
        for _ in range(2 * column):
            share = q[:, 0] @ q[:, 1]
            q[:, 1] -= share * q[:, 0]
            inverse[:, 1] -= share * inverse[:, 0]
            size = np.sqrt(q[:, 1] @ q[:, 1])
        scale = 1.0 / size if size > 1e-13 * whole else 0.0
        q[:, column] *= scale
        inverse[:, column] *= scale
    return q, inverse


def fit_pole(
    s: complex, kind: int, bands: Sequence[Band], *, iterations: int = 30, tolerance: float = 1e-4
) -> tuple[complex, float, float]:
    """The pole that fits the bands best near `s`, the cost there, and its deviation."""
    bands = [_condensed(band) for band in bands]

    def moved(now: Step, step: Floats) -> Step | None:
        there = moved_pole(now.s, kind, step)
        return evaluate(there, kind, bands) if FASTEST[0] <= there.real <= FASTEST[1] else None

    start = evaluate(s, kind, bands)
    steps = Steps(normal=lambda at: Normal(matrix=at.information, gradient=at.gradient), moved=moved)
    now = levenberg_marquardt(start, steps, Ends(steps=iterations, deviations=tolerance))
    spread = scaled_inverse(now.information)
    # Of a pole without residues the lines say nothing: it may be anywhere.
    return now.s, now.cost, float(np.sqrt(np.diag(spread).max())) or np.pi


def _condensed(band: Band) -> Band:
    """Reduce a band to no more columns than rows: their products are the same."""
    rows, columns = band.values.shape
    if columns <= rows:
        return band
    triangle = np.asarray(np.linalg.qr(band.values.T, mode="r")).T
    return Band(band.angles, band.weights, band.samples, triangle)


def fit_residues(s: complex, kind: int, band: Band) -> Floats:
    """The coefficients of the real columns (columns, responses) that fit a band best."""
    columns, _ = mode_columns(s, kind, band.angles, band.samples, band.weights)
    q, inverse = orthonormal(real_rows(columns))
    return inverse @ (q.T @ band.values)


WORST = 1.0 / ROUNDING  # the condition number of the coupled fits beyond which two modes count as one

KNOWN = ROUNDING ** (-2.0 / 3.0)
"""The condition number beyond which no deviations are known: rounding in slopes grows with its power 3/2."""

Bands = Sequence[Sequence[slice]]  # the lines to which each mode is fitted, for each block


def bands_of(modes: Sequence[Mode], blocks: Sequence[Block], widths: float) -> list[list[slice]]:
    """The lines within `widths` half-power half-widths of each mode's peak, for each block."""
    return [[band_lines(mode.s, block, widths) for mode in modes] for block in blocks]


def columns_of(modes: Sequence[Mode]) -> list[slice]:
    """Indices of the real columns of each mode."""
    return [slice(int(a), int(b)) for a, b in pairwise(np.cumsum([0, *(mode.size for mode in modes)]))]


def complex_columns(poles: PoleSet, real: Floats) -> Complexes:
    """The columns of μ^k and its conjugate (rows, order) from those of its real and imaginary part."""
    out = real.astype(np.complex128)
    for start, kind in zip(poles.starts(), poles.kind, strict=True):
        if kind == PAIR:
            out[:, start] = real[:, start] + 1j * real[:, start + 1]
            out[:, start + 1] = out[:, start].conj()
    return out


@dataclass(frozen=True, slots=True)
class Coupled:
    r"""The equations of all modes in one block, as rows of real numbers, residues eliminated.

    At rest, mode r solves B_rᵀ W_r (d - Σ_q B_q c_q) = 0 for its residues and g_u = Σ (∂B_u c_r)ᵀ W_r (d - B c) = 0
    for each parameter u of its pole, W_r the lines near its peak and the sum over the responses. The residues of all
    modes together are c = G⁻¹ H d, with G_rq = B_rᵀ W_r B_q and H_r = B_rᵀ W_r, and Q = I - B G⁻¹ H takes them out:

    .. math:: g_u = \sum c_r^T V_u^T d, \quad J_{uv} = \sum c_r^T V_u^T \dot B_v c_q, \quad
              \operatorname{cov} g_{uv} = \sum c_r^T V_u^T V_v c_q, \qquad V_u = Q^T W_r \dot B_u

    `moved` is k times the columns (rows, n); `solve` is G⁻¹H (n, rows); `taken` holds, for each parameter, the slice
    of its mode's columns, Q ∂B and V (rows, columns of the mode). What Q takes out of ∂B is nothing to V, but
    much to the rounding of V: of two modes hardly told apart it is nearly all of ∂B.
    """

    moved: Floats
    solve: Floats
    taken: tuple[tuple[slice, Floats, Floats], ...]

    @staticmethod
    def of(modes: Sequence[Mode], block: Block, near: Sequence[slice], worst: float = WORST) -> Coupled | None:
        """The equations of one block; None when two modes have the same columns, or nearly: a condition of `worst`."""
        if not modes:
            nothing = np.zeros((2 * len(block.values), 0))
            return Coupled(nothing, nothing.T, ())
        pairs = [mode_columns(m.s, m.kind, block.angles, block.samples, block.weights) for m in modes]
        columns = np.concatenate([real_rows(c) for c, _ in pairs], axis=1)
        moved = np.concatenate([real_rows(m) for _, m in pairs], axis=1)
        seen = np.zeros(columns.shape, bool)
        own = columns_of(modes)
        half = len(block.values)
        for lines, at in zip(near, own, strict=True):
            seen[lines, at], seen[half + lines.start : half + lines.stop, at] = True, True
        weighted = np.where(seen, columns, 0.0)
        coupling = weighted.T @ columns
        size = np.sqrt(np.diag(coupling)) + np.finfo(float).tiny
        if not np.linalg.cond(coupling / np.outer(size, size)) < worst:
            return None
        solve = np.asarray(np.linalg.solve(coupling, weighted.T), dtype=np.float64)
        taken = []
        for mode, at in zip(modes, own, strict=True):
            turns = [moved[:, at]]
            if mode.kind == PAIR:
                turns.append(np.stack([-turns[0][:, 1], turns[0][:, 0]], axis=1))
            for turn in turns:
                here = np.where(seen[:, at], turn, 0.0)
                taken.append((at, turn - columns @ (solve @ turn), here - solve.T @ (columns.T @ here)))
        return Coupled(moved, solve, tuple(taken))

    def strength(self, modes: Sequence[Mode], number: int) -> Floats:
        """Σ c cᵀ (n, n) over the responses of block `number`."""
        own = np.concatenate([mode.coefficients[number].reshape(mode.size, -1) for mode in modes])
        return own @ own.T

    def equations(self, modes: Sequence[Mode], number: int, data: Floats) -> Floats:
        """The sums g (n,) for the rows `data` (rows, responses) of block `number`."""
        own = [mode.coefficients[number].reshape(mode.size, -1) for mode in modes for _ in range(mode.size)]
        return np.array([np.sum((v.T @ data) * c) for (_, _, v), c in zip(self.taken, own, strict=True)])

    def slope_of_equations(self, strength: Floats) -> Floats:
        """J (n, n) for residues of this Σ c cᵀ."""
        rows = [[np.sum((v.T @ w) * strength[a, b]) for b, w, _ in self.taken] for a, _, v in self.taken]
        return np.array(rows).reshape(len(rows), len(rows))

    def slopes(self, modes: Sequence[Mode], number: int) -> tuple[Floats, Floats]:
        """J (n, n) of block `number`, and what the noise on the residues is expected to add to it; symmetric parts."""
        responses = modes[0].coefficients[number][0].size
        both = self.slope_of_equations(self.strength(modes, number)), self.slope_of_equations(self.solve @ self.solve.T)
        whole, noise = (0.5 * (part + part.T) for part in both)
        return whole, responses * noise

    def scatter_of_equations(self, strength: Floats) -> Floats:
        """The covariance of g (n, n) for unit noise."""
        rows = [[np.sum((v.T @ w) * strength[a, b]) for b, _, w in self.taken] for a, _, v in self.taken]
        return np.array(rows).reshape(len(rows), len(rows))


def joint_residues(modes: Sequence[Mode], blocks: Sequence[Block], near: Bands) -> list[Mode] | None:
    """The modes with the residues that going round would end with, were the poles to stay; None if two are one."""
    found: list[list[Floats]] = [[] for _ in modes]
    for block, lines in zip(blocks, near, strict=True):
        coupled = Coupled.of(modes, block, lines)
        if coupled is None:
            return None
        own = coupled.solve @ _rows(block)
        for parts, at in zip(found, columns_of(modes), strict=True):
            parts.append(own[at].reshape(-1, *block.values.shape[1:]))
    return [replace(mode, coefficients=tuple(parts)) for mode, parts in zip(modes, found, strict=True)]


def newton(
    modes: Sequence[Mode], blocks: Sequence[Block], near: Bands, cost: Callable[[Sequence[Mode]], float]
) -> list[Mode] | None:
    """The modes after Newton's step on their equations, halved until the `cost` falls; None if two are one."""
    now = joint_residues(modes, blocks, near)
    if now is None:
        return None
    size = sum(mode.size for mode in modes)
    whole, noise, lean = np.zeros((size, size)), np.zeros((size, size)), np.zeros(size)
    for number, block in enumerate(blocks):
        coupled = Coupled.of(now, block, near[number])
        assert coupled is not None
        parts = coupled.slopes(now, number)
        whole, noise = whole + parts[0], noise + parts[1]
        lean += coupled.equations(now, number, _rows(block))
    if not (np.diag(whole) > np.finfo(float).tiny).all():
        return now
    slope = positive_part(whole, whole - noise)
    scale = np.sqrt(np.maximum(np.diag(slope), np.finfo(float).tiny))
    both = np.outer(scale, scale)
    if not np.linalg.cond(slope / both) < WORST:
        return now
    step, before = np.linalg.solve(slope / both, lean / scale) / scale, cost(now)
    for _ in range(FEW_STEPS):
        poles = [
            replace(mode, s=moved_pole(mode.s, mode.kind, step[at]))
            for mode, at in zip(now, columns_of(now), strict=True)
        ]
        moved = joint_residues(poles, blocks, near) if np.abs(step).max() < 1.0 else None
        if moved is not None and cost(moved) < before + 1.0:
            return moved
        step = 0.5 * step
    return now


def _rows(block: Block) -> Floats:
    return real_rows(block.values.reshape(len(block.values), -1))
