"""The fit of one mode to spectra near its peak, all responses at once: its residues eliminated, its pole by steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from floquid._arrays import Complexes, Floats
from floquid.fit import Ends, Normal, Steps, levenberg_marquardt, scaled_inverse
from floquid.lti._poles import FASTEST, PAIR, moved_pole
from floquid.lti._spectrum import Block, mode_columns

FEWEST_LINES = 6  # lines to each side of a peak that a fit looks at, however sharp the peak


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
    reach = max(int(np.ceil(widths * abs(s.real) / spacing)), FEWEST_LINES)
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
