r"""The fit of a structured equation of motion to the estimates of a free model (the extended invariance principle).

With p the exponents' parts and B the coefficients, both as the free model has them and as the structure has them,

.. math:: \min_{\theta, q} \; \delta p^T C_p^{-1} \delta p + \sum_{c,h} e_{c,h}^T V_{c,h}^{-1} e_{c,h}, \qquad
          e_{c,h} = g^{-1} \big(\delta B_{c,h} - S_{c,h}\, \delta p\big)

q being the amplitude of each mode in each hit, and S the slopes at the coefficients of the structure: those at the
estimates hold the noise of all coefficients, and with hundreds of them bend the exponents. This loses nothing
asymptotically against the fit of the record itself (Söderström and Stoica 1989, "On reparametrization of loss functions
used in estimation and the invariance principle").
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Integers
from floquid.core import Estimates
from floquid.errors import IdentificationError
from floquid.findings import Finding, note
from floquid.fit import Ends, Normal, Steps, levenberg_marquardt
from floquid.reconstruction._coordinates import Part
from floquid.reconstruction._harmonic_balance import Mode, slopes_of, solved
from floquid.reconstruction._structure import AbstractStructure, Basis, Block, SecondOrder

Array = NDArray[Any]

ITERATIONS = 60  # steps at most
AT_REST = 1e-4  # standard deviations that the last step may have

UNDETERMINED = 1e-12
"""The least eigenvalue of the scaled information, over the largest, at which the parameters count as determined."""

SURE = 1e-3  # the probability of what a wider structure gains by chance, below which it is taken
MOST = 12  # steps at most


@dataclass(frozen=True, slots=True)
class Seen(Part):
    """A displacement seen by a channel: gain · sᵖ e^{sτ} times its coefficient."""

    displacement: int = 0


@dataclass(frozen=True, slots=True)
class Problem:
    """The estimates, what the channels see of the displacements, and the structure."""

    estimates: Estimates
    seen: tuple[Seen, ...]
    basis: Basis
    anchors: tuple[Array, ...]
    """First shapes of the displacements, one a mode of the estimates (harmonics, displacements)."""
    whiteners: tuple[Array, ...]  # L⁻¹ of each V, without what does not turn
    parts: Integers  # mask of the parameters in p
    root: Array  # L⁻¹ of the covariance of these
    mixed: tuple[int, ...] = ()  # indices of `seen` with an unknown gain: a parameter more, after those of the basis

    @property
    def n_amplitudes(self) -> int:
        """Real numbers of one hit: two of a pair, one of a real multiplier."""
        return int(2 * (~self.estimates.real).sum() + self.estimates.real.sum())

    @property
    def n_others(self) -> int:
        """Parameters of the estimates that a structure leaves free: gains of inputs, errors in common."""
        return int((self.parts > self.estimates.fundamental_place).sum())

    @property
    def n_omega(self) -> int:
        """1 where the fundamental is a parameter."""
        return int(self.estimates.fundamental_place in self.parts)


@dataclass(frozen=True, slots=True)
class Point:
    """Parameters, and what follows from them."""

    parameters: Array
    amplitudes: Array  # (modes, hits)
    others: Array  # how far each other parameter is from its estimate (others,)
    fundamental: float
    modes: tuple[Mode, ...]
    rest: Array  # the whitened differences
    slopes: Array  # of what the structure predicts, whitened (differences, unknowns)
    mode_slopes: tuple  # of each mode

    @property
    def cost(self) -> float:
        """The sum of squares: a chi-square of `degrees` under the right structure."""
        return float(self.rest @ self.rest)

    @property
    def degrees(self) -> int:
        """The degrees of freedom of what is left."""
        return len(self.rest) - self.slopes.shape[1]

    @property
    def p_value(self) -> float:
        """The probability of as large a misfit under the right structure."""
        from scipy.special import chdtrc

        return float(chdtrc(self.degrees, self.cost)) if self.degrees > 0 else 1.0


def problem_of(
    estimates: Estimates, seen: tuple[Seen, ...], basis: Basis, shapes: list[NDArray], mixed: tuple[int, ...] = ()
) -> Problem:
    """The fit, with first shapes (harmonics, displacements) of the modes of the estimates."""
    turning = estimates.turning
    used = np.concatenate([np.ones(len(turning), bool), turning])
    whiteners = [_inverse_root(block[np.ix_(used, used)]) for block in estimates.spread]
    parts = np.flatnonzero(np.diag(estimates.covariance) > 0)
    root = _inverse_root(estimates.covariance[np.ix_(parts, parts)])
    return Problem(estimates, seen, basis, tuple(shapes), tuple(whiteners), parts, root, mixed)


def _inverse_root(matrix: Array) -> Array:
    """L⁻¹ with L Lᵀ the matrix."""
    scale = 1.0 / np.sqrt(np.diag(matrix))
    try:
        root = np.linalg.cholesky(matrix * np.outer(scale, scale))
    except np.linalg.LinAlgError:
        raise IdentificationError(
            "The estimates of the free model are not independent: modes fold onto one another. A(t) of a structure "
            "cannot be fitted to them."
        ) from None
    return np.linalg.solve(root, np.diag(scale))


def at(
    problem: Problem,
    parameters: Array,
    amplitudes: NDArray | None,
    fundamental: float,
    near: tuple[Mode, ...],
    others: Array | None = None,
) -> Point:
    """Everything at these parameters; amplitudes None are those of least squares, others None those estimated."""
    own, basis = problem.estimates, problem.basis
    matrices = basis.at(parameters[: len(basis.names)])
    modes, slopes = [], []
    for anchor, mode in zip(problem.anchors, near, strict=True):
        found, jacobian = solved(matrices, mode, anchor, fundamental)
        modes.append(found)
        by = slopes_of(basis.matrices, matrices, found, jacobian, fundamental)
        slopes.append(by.with_gap(len(parameters) - len(basis.names)))
    others = np.zeros(problem.n_others) if others is None else others
    empty = np.zeros(0)
    point = Point(parameters, empty, others, fundamental, tuple(modes), empty, np.zeros((0, 0)), tuple(slopes))
    if amplitudes is None:
        unit = np.ones((len(modes), own.coefficients.shape[2]), complex)
        rest, by = _differences(problem, point, unit)
        n = len(parameters) + problem.n_omega + problem.n_others
        step = np.linalg.lstsq(by[:, n:], rest, rcond=None)[0]
        amplitudes = _amplitudes(problem, step)
    point = replace(point, amplitudes=amplitudes)
    rest, by = _differences(problem, point, amplitudes)
    return replace(point, rest=rest, slopes=by)


def _amplitudes(problem: Problem, values: Array) -> Array:
    """The complex amplitudes (modes, hits) of real unknowns, hit by hit: real parts, then imaginary parts of pairs."""
    own = problem.estimates
    count, pairs = len(own.exponents), np.flatnonzero(~own.real)
    hits = values.reshape(-1, problem.n_amplitudes)
    found = hits[:, :count].astype(complex).T
    found[pairs] += 1j * hits[:, count:].T
    return found


def _differences(problem: Problem, point: Point, amplitudes: Array) -> tuple[Array, Array]:
    """The whitened differences of estimates and structure, and the slopes of what the structure predicts."""
    # The unknowns are the parameters, ω where it is one, the other parameters of the estimates, and the amplitudes.
    own, count = problem.estimates, len(problem.estimates.exponents)
    n, omega, place_of_omega = len(point.parameters), problem.n_omega, problem.estimates.fundamental_place
    ahead = n + omega + problem.n_others
    unknowns = ahead + problem.n_amplitudes * amplitudes.shape[1]
    moved = np.arange(n + 1 if omega else n)
    # p: real parts, imaginary parts, ω, others.
    predicted = np.array([mode.exponent for mode in point.modes])
    by_exponent = np.array([slope.exponent[moved] for slope in point.mode_slopes])
    whole = own.exponents - predicted
    others = problem.parts[problem.parts > place_of_omega]
    off, by_parts = np.zeros(len(own.covariance)), np.zeros((len(own.covariance), unknowns))
    off[: place_of_omega + 1] = *np.real(whole), *np.imag(whole), own.fundamental - point.fundamental
    off[others] = -point.others
    by_parts[:count, : n + omega] = np.real(by_exponent)
    by_parts[count:place_of_omega, : n + omega] = np.imag(by_exponent)
    if omega:
        by_parts[place_of_omega, n] = 1.0
    by_parts[others, np.arange(n + omega, ahead)] = 1.0
    fixed = np.setdiff1d(np.arange(len(off)), problem.parts)
    off[fixed], by_parts[fixed] = 0.0, 0.0
    rest = [problem.root @ off[problem.parts]]
    slopes = [problem.root @ by_parts[problem.parts]]
    turning = own.turning
    used = np.concatenate([np.ones(len(turning), bool), turning])
    for channel in sorted({one.channel for one in problem.seen}):
        base, by_base = _predicted(problem, point, channel, moved)
        for hit in range(amplitudes.shape[1]):
            q = amplitudes[own.modes, hit]
            along = own.slopes_at(q * base, channel, hit)
            away = own.coefficients[:, channel, hit] - q * base - along @ off
            by = np.zeros((len(own.modes), unknowns), complex)
            by[:, : n + omega] = q[:, None] * by_base
            place = ahead + hit * problem.n_amplitudes
            for mode in range(count):
                rows = own.modes == mode
                by[rows, place + mode] = base[rows]
            for number, mode in enumerate(np.flatnonzero(~own.real)):
                rows = own.modes == mode
                by[rows, place + count + number] = 1j * base[rows]
            by -= along @ by_parts
            scale = own.scales[:, channel, hit]
            root = problem.whiteners[own.blocks[channel, hit]]
            both = np.concatenate([(away / scale).real, (away / scale).imag])[used]
            by = by / scale[:, None]
            rest.append(root @ both)
            slopes.append(root @ np.concatenate([by.real, by.imag])[used])
    return np.concatenate(rest), np.concatenate(slopes)


def _predicted(problem: Problem, point: Point, channel: int, moved: Integers) -> tuple[Array, Array]:
    """The signal of a channel at unit amplitude (terms,), and its slopes by parameters and ω (terms, parameters)."""
    own = problem.estimates
    value = np.zeros(len(own.modes), complex)
    slope = np.zeros((len(own.modes), len(moved)), complex)
    for mode, (found, by) in enumerate(zip(point.modes, point.mode_slopes, strict=True)):
        rows = np.flatnonzero(own.modes == mode)
        harmonics = own.harmonics[rows]
        places = harmonics + len(found.coefficients) // 2
        rates = found.exponent + 1j * point.fundamental * harmonics
        by_rate = by.exponent[moved][:, None] * np.ones(len(rows))
        if len(moved) > len(point.parameters):
            by_rate = by_rate.astype(complex)
            by_rate[-1] += 1j * harmonics
        for number, one in enumerate(problem.seen):
            if one.channel != channel:
                continue
            u, gain = found.coefficients[places, one.displacement], 1.0
            factor = one.weight(rates)
            if number in problem.mixed:
                unknown = len(problem.basis.names) + problem.mixed.index(number)
                gain = point.parameters[unknown]
                slope[rows, unknown] += factor * u
            value[rows] += gain * factor * u
            slope[rows] += gain * (factor * by.coefficients[moved][:, places, one.displacement]).T
            slope[rows] += gain * (one.slope(rates) * u * by_rate).T
    return value, slope


def fitted(problem: Problem, parameters: Array, near: tuple[Mode, ...]) -> Point:
    """The least squares near these parameters, by Levenberg-Marquardt; IdentificationError where there is none."""
    ends = np.cumsum([len(parameters), problem.n_omega, problem.n_others])

    def moved(now: Point, step: Array) -> Point | None:
        own, omega, others, amplitudes = np.split(step, ends)
        with suppress(IdentificationError, np.linalg.LinAlgError):
            return at(
                problem,
                now.parameters + own,
                now.amplitudes + _amplitudes(problem, amplitudes),
                now.fundamental + float(omega.sum()),
                now.modes,
                now.others + others,
            )
        return None

    steps = Steps(
        normal=lambda now: Normal(matrix=now.slopes.T @ now.slopes, gradient=now.slopes.T @ now.rest), moved=moved
    )
    start = at(problem, parameters, None, problem.estimates.fundamental, near)
    return levenberg_marquardt(start, steps, Ends(steps=ITERATIONS, gain=AT_REST**2))


def covariance_of(point: Point) -> Array:
    """The covariance of the unknowns; IdentificationError where the estimates do not determine them."""
    scale = np.linalg.norm(point.slopes, axis=0)
    if (scale == 0).any():
        raise _undetermined()
    values, vectors = np.linalg.eigh((point.slopes / scale).T @ (point.slopes / scale))
    if values[0] < UNDETERMINED * values[-1]:
        raise _undetermined()
    return (vectors / values) @ vectors.T / np.outer(scale, scale)


def _undetermined() -> IdentificationError:
    return IdentificationError(
        "The response does not determine every parameter of the structure asked for. It has too many harmonics or free "
        "elements for these modes. Give it fewer harmonics, a symmetry, or known elements."
    )


Fitted = Callable[[AbstractStructure, tuple[Point, Basis] | None], tuple[Point, Basis]]
"""The fit of a structure near that of another, or near the free model."""


def found_structure(
    fit: Fitted, report: Callable[[str], None] = lambda _: None
) -> tuple[AbstractStructure, tuple[Point, Basis], tuple[Finding, ...]]:
    """The simplest second-order form that the data do not contradict, its fit, and what was added and gained."""
    from scipy.special import chdtrc

    now: AbstractStructure = SecondOrder(stiffness=Block(symmetry="symmetric"), damping=Block())
    near, found = _tried(fit, now, None), []
    for _ in range(MOST):
        best: tuple[Point, Basis] | None = None
        least, words, chosen = (False, 0.0), "", now
        for name, other in now.wider():
            report(f"trying a structure: {name}")
            trial = _tried(fit, other, near)
            if trial is None:
                continue
            more = trial[0].slopes.shape[1] - (0 if near is None else near[0].slopes.shape[1])
            gain = np.inf if near is None else near[0].cost - trial[0].cost
            rare = 0.0 if near is None else float(chdtrc(max(more, 1), max(gain, 0.0)))
            # Where several are sure, the one that gains most for each number that it adds.
            worth = (rare > SURE, -gain / max(more, 1))
            if rare < SURE and (best is None or worth < least):
                best, least, words, chosen = trial, worth, name, other
        if best is None:
            break
        before = np.inf if near is None else near[0].cost
        found.append(note("structure_widened", name=words, before=before, after=best[0].cost))
        now, near = chosen, best
    if near is None:
        raise IdentificationError("No second-order form of few harmonics fits the response in these states.")
    return now, near, (note("structure_found", structure=now.words()), *found)


def _tried(fit: Fitted, structure: AbstractStructure, near: tuple[Point, Basis] | None) -> tuple[Point, Basis] | None:
    """The fit; None where there is none, or the data do not determine it.

    A fit that leaves more than that of the structure within it, `near`, has gone astray: it is made again from there.
    """
    best: tuple[Point, Basis] | None = None
    for start in (None,) if near is None else (None, near):
        if best is not None and near is not None and best[0].cost <= near[0].cost:
            break
        with suppress(IdentificationError, np.linalg.LinAlgError):
            trial = fit(structure, start)
            covariance_of(trial[0])
            best = trial if best is None or trial[0].cost < best[0].cost else best
    return best
