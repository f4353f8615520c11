"""Which modes of known responses must be found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from benchmarks.truth import Known, bound_of, columns_of, information, known_model, parameters, projected
from numpy.typing import ArrayLike, NDArray

from floquid._checks import Rebuilt, frozen_array

DETERMINED = 2e-3
"""A mode that must be found has an exponent whose deviation is below this share of the fundamental."""

APART = 5.0
"""The deviations by which it lies apart from every other exponent and from its own conjugate."""

INVISIBLE = 1.0
"""A mode that removal changes by less than this much chi-square plays no part in the bound of the others."""

CLEAR = 20.0
"""Times the rise needed at which a mode far from all others is not removed by trial: they could not take its part."""

TIME_CONSTANTS = 12.0
"""Those of the slowest mode after which noiseless responses hold nothing more: e⁻²⁴ of its energy."""


STEPS = 40
"""Iterations, at most, of a noiseless fit."""

SETTLED = 1e-3
"""The share of the cost by which a step must lower it to be worth another one."""

FARTHEST = 0.1
"""The largest move of a logarithm in one step."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Findable(Rebuilt):
    """The information on each pole in the responses of a known model.

    Parameters
    ----------
    covariance
        The Cramér-Rao bound of the poles (2 modes, 2 modes), real parts, then imaginary parts [1/s²].
    rises
        The noiseless cost of removing each mode, the rest refitted (modes,) [-]: for a mode far from all others and
        clear beyond doubt, or too weak in any case, that with the other poles held.
    needed
        The rise that a mode that must be found makes (modes,) [-].
    must
        Whether the mode must be found (modes,).
    """

    covariance: NDArray[np.float64]
    rises: NDArray[np.float64]
    needed: NDArray[np.float64]
    must: NDArray[np.bool_]

    def __post_init__(self) -> None:
        of, put = "Findable", object.__setattr__
        n = len(self.must)
        put(self, "covariance", frozen_array(self.covariance, "covariance", of, axes=(2 * n, 2 * n)))
        for name in ("rises", "needed"):
            put(self, name, frozen_array(getattr(self, name), name, of, axes=(n,)))
        put(self, "must", frozen_array(self.must, "must", of, axes=(n,), dtype=np.bool_))

    @property
    def std(self) -> NDArray[np.complex128]:
        """Deviations of the poles (modes,) [1/s]: real part of the real, imaginary part of the imaginary."""
        both = np.sqrt(np.diag(self.covariance))
        return both[: len(self.must)] + 1j * both[len(self.must) :]


def findable(
    multipliers: ArrayLike,
    residues: ArrayLike,
    noise: ArrayLike,
    lengths: ArrayLike,
    dt: float,
    *,
    false_alarm: float = 1e-9,
) -> Findable:
    r"""The information on each pole in the responses of a known model.

    A mode must be found when three things hold: both deviations of its pole, by the Cramér-Rao bound, are below 0.2 %
    of the fundamental 2π/dt; it lies five deviations (of the difference, where the other is as well determined) apart
    from every other pole modulo the fundamental, and from its own conjugate; and taking it away raises the
    least-squares cost of the noiseless responses, all other poles and residues refitted, by

    .. math:: \Delta \ge 2 q - \nu, \qquad P\left(\chi^2_\nu > q\right) = \text{false alarm}

    so that with noise the rise is twice what a test at that false-alarm rate asks for. ν counts the residues and the
    pole, 2M + 2 for a pair over M responses; with the noise estimated, q is ν times the quantile of F. A mode that
    costs less is left out while the others are judged. Modes that cost less than one take no part in the bound of the
    others either: free residues of what is not there to be seen would inflate it.

    Parameters
    ----------
    multipliers
        μ, with the conjugate of each (modes,).
    residues
        R (modes, outputs, inputs) [units of the responses].
    noise
        The standard deviations of the white noise (outputs, inputs) [units of the responses].
    lengths
        The number of samples of each input (inputs,).
    dt
        The sampling interval [s].
    false_alarm
        The probability at which the test takes noise for a mode.

    Returns
    -------
    Findable
        The bound, the rises, and which modes must be found.

    Raises
    ------
    InputError
        A shape or a value is not possible, a conjugate is missing, or there are as many poles as samples.
    """
    known = known_model(multipliers, residues, noise, lengths, dt, "findable")
    n = len(known.multipliers)
    if not n:
        return Findable(covariance=np.zeros((0, 0)), rises=np.zeros(0), needed=np.zeros(0), must=np.zeros(0, bool))
    outputs = known.residues.shape[1] * known.residues.shape[2]
    samples = known.residues.shape[1] * int(known.lengths.sum())
    needed = np.zeros(n)
    for mode, size in zip(known.upper, known.size, strict=True):
        degrees = int(size) * (outputs + 1)
        needed[[mode, known.partner[mode]]] = 2.0 * _limit(false_alarm, degrees, samples) - degrees
    rises = _rises(known, needed)
    visible = rises >= INVISIBLE
    covariance = bound_of(known)
    if visible.any() and not visible.all():
        both = np.flatnonzero(np.concatenate([visible, visible]))
        covariance[np.ix_(both, both)] = bound_of(_kept(known, visible))
    std = np.sqrt(np.diag(covariance)).reshape(2, n).max(axis=0)
    sharp = (rises >= needed) & (std * known.dt < DETERMINED * 2.0 * np.pi)
    must = sharp & _apart(known, covariance, visible, sharp)
    return Findable(covariance=covariance, rises=rises, needed=needed, must=must)


def _limit(probability: float, degrees: int, samples: int) -> float:
    """The rise that noise makes with this probability: `degrees` times the quantile of F, by the beta distribution."""
    from scipy.special import betaincinv

    left = max(samples - degrees, 1)
    share = float(betaincinv(0.5 * left, 0.5 * degrees, probability))
    return left * (1.0 / share - 1.0)


def _apart(
    known: Known, covariance: NDArray[np.float64], visible: NDArray[np.bool_], sharp: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """True for poles that lie `APART` deviations from all visible others, modulo the fundamental (modes,).

    Beside a pole that is sharp too the deviation is that of their difference; where the other one may be anywhere,
    that of this one.
    """
    n, logs = len(known.multipliers), known.logs
    gap = logs[:, None] - logs
    gap = gap - 2j * np.pi * np.rint(gap.imag / (2.0 * np.pi))
    size = np.abs(gap)
    along = np.divide(gap, size, out=np.zeros_like(gap), where=size > 0)
    apart = np.ones(n, bool)
    for one in range(n):
        for other in np.flatnonzero(visible):
            if one == other:
                continue
            slope = np.zeros(2 * n)
            slope[[one, n + one]] = along[one, other].real, along[one, other].imag
            if sharp[other]:
                slope[[other, n + other]] = -slope[[one, n + one]]
            std = np.sqrt(max(slope @ covariance @ slope, 0.0)) * known.dt
            apart[one] &= size[one, other] > APART * std
    return apart


def _rises(known: Known, needed: NDArray[np.float64]) -> NDArray[np.float64]:
    """The noiseless cost of taking away each mode with its conjugate (modes,).

    The least visible leaves first, as long as one costs less than it needs to, and the others are judged without it:
    beside a mode that is hardly seen each other one could go for little, since that mode would move to its place.
    """
    rises, left = np.zeros(len(known.multipliers)), np.ones(len(known.multipliers), bool)
    while left.any():
        model, position = _kept(known, left), np.flatnonzero(left)
        for entry, rise in _removals(model, needed[left][model.upper]).items():
            mode = position[model.upper[entry]]
            rises[[mode, known.partner[mode]]] = rise
            left[[mode, known.partner[mode]]] = False
    return rises


def _removals(known: Known, needed: NDArray[np.float64]) -> dict[int, float]:
    """The noiseless cost of taking away one upper pole that is not needed, or else that of each.

    With the other poles held the cost is an upper bound of that with them free: where it is too small already, or the
    pole far from all others, it will do.
    """
    logs, real, data = known.logs[known.upper], known.size == 1, _compressed(known)
    rest = ~np.eye(len(logs), dtype=bool)
    held = np.array([_held(logs[kept], real[kept], data) for kept in rest])
    worst = int(np.argmin(held / needed))
    if held[worst] < needed[worst]:
        return {worst: held[worst]}
    rises = dict(enumerate(held.tolist()))
    for entry in np.argsort(held / needed):
        if rest[entry].any() and not (_far(known)[entry] and held[entry] > CLEAR * needed[entry]):
            cost = least_cost(logs[rest[entry]], real[rest[entry]], data, 0.5 * float(needed[entry]))
            rises[int(entry)] = min(rises[int(entry)], cost)
            if cost < needed[entry]:
                return {int(entry): cost}
    return rises


def _compressed(known: Known) -> list[NDArray[np.float64]]:
    """Noiseless responses with the Gram matrix of the model's, one array (samples, modes or fewer) an input.

    That is all that they are to a least-squares cost; samples after all modes have died are left out.
    """
    logs, real = known.logs[known.upper], known.size == 1
    slowest = float(logs.real.max())
    lasting = known.lengths.max() if slowest >= 0 else np.ceil(TIME_CONSTANTS / -slowest)
    parts = known.residues[known.upper] * known.size[:, None, None]
    parts = np.concatenate([parts.real, -parts.imag[~real]])
    blocks = []
    for index, length in enumerate(known.lengths):
        _, flat, scale = columns_of(logs, real, int(length))
        scaled = parts[:, :, index] / np.concatenate([scale, scale[~real]])[:, None]
        seen = int(min(length, max(lasting, 2 * len(known.multipliers) + 2)))
        blocks.append(flat[:seen] @ np.asarray(np.linalg.qr(scaled.T, mode="r")).T)
    return blocks


def _held(logs: NDArray[np.complex128], real: NDArray[np.bool_], data: list[NDArray[np.float64]]) -> float:
    """The sum of squares that poles leave of the responses where they are."""
    total = 0.0
    for values in data:
        q, _ = np.linalg.qr(columns_of(logs, real, len(values))[1])
        # Twice: what is left may be a small part of the whole.
        left = values - q @ (q.T @ values)
        total += float(np.sum((left - q @ (q.T @ left)) ** 2))
    return total


def _far(known: Known) -> NDArray[np.bool_]:
    """True for upper poles that no other is near enough to replace by a move (upper,)."""
    logs = known.logs
    gap = logs[known.upper, None] - logs
    gap = np.abs(gap - 2j * np.pi * np.rint(gap.imag / (2.0 * np.pi)))
    gap[np.arange(len(known.upper)), known.upper] = np.inf
    width = np.maximum(np.abs(logs[known.upper].real), 2.0 * np.pi / known.lengths.max())
    return gap.min(axis=1) > 4.0 * width


def least_cost(
    logs: NDArray[np.complex128], real: NDArray[np.bool_], data: Sequence[NDArray[np.float64]], enough: float
) -> float:
    """The sum of squares that poles leave of noiseless `data` (samples, responses) when they move to where it is least.

    Levenberg and Marquardt with Kaufman's (1975) Jacobian; ends early once the cost is below `enough`.
    """
    cost, gradient, matrix = _state(logs, real, data)
    moves, turn = parameters(real)
    damping = 1e-3
    for _ in range(STEPS if len(logs) else 0):
        scale = np.sqrt(np.maximum(np.diag(matrix), np.finfo(float).tiny))
        inner = matrix / np.outer(scale, scale) + damping * np.eye(len(scale))
        step = np.linalg.solve(inner, gradient / scale) / scale
        step *= min(1.0, FARTHEST / max(np.abs(step).max(), np.finfo(float).tiny))
        trial = logs.copy()
        np.add.at(trial, moves, step * np.where(turn.imag > 0, 1j, 1.0))
        now = _state(trial, real, data)
        if now[0] > cost:
            damping *= 10.0
            if damping > 1e6:
                break
            continue
        drop, damping = cost - now[0], max(0.1 * damping, 1e-9)
        logs, (cost, gradient, matrix) = trial, now
        if cost < enough or drop < SETTLED * cost:
            break
    return cost


def _state(
    logs: NDArray[np.complex128], real: NDArray[np.bool_], data: Sequence[NDArray[np.float64]]
) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """The cost, the direction of descent and the Gauss-Newton matrix."""
    moves, turn = parameters(real)
    cost, gradient, matrix = 0.0, np.zeros(len(moves)), np.zeros((len(moves), len(moves)))
    for values in data:
        block = projected(logs, real, len(values))
        inside = block.basis.T @ values
        # Twice: what is left may be a small part of the whole.
        left = values - block.basis @ inside
        left = left - block.basis @ (block.basis.T @ left)
        cost += float(np.sum(left**2))
        flat = np.linalg.lstsq(block.triangle, inside, rcond=1e-14)[0]
        residues = (np.where(real, 1.0, 0.5)[:, None] * flat[: len(logs)]).astype(np.complex128)
        residues[~real] -= 0.5j * flat[len(logs) :]
        gradient += (turn * np.sum(residues * (block.slopes.T @ left), axis=1)[moves]).real
        matrix += information(block, residues, real)
    return cost, gradient, matrix


def _kept(known: Known, modes: NDArray[np.bool_]) -> Known:
    """The model of some of the modes; conjugates stay together."""
    position = np.cumsum(modes) - 1
    upper, partner = known.upper[modes[known.upper]], known.partner[modes]
    return Known(
        known.multipliers[modes], known.residues[modes], known.lengths, known.dt, position[upper], position[partner]
    )
