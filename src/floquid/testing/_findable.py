"""Which modes of known responses must be found."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from floquid._checks import frozen_array
from floquid.lti import MaximumLikelihood, ModalModel, TimeResponses
from floquid.testing._bounds import Known, bound_of, known_model, scaled_columns

DETERMINED = 2e-3
"""A mode that must be found has an exponent whose deviation is below this share of the fundamental."""

APART = 5.0
"""The deviations by which it lies apart from every other exponent and from its own conjugate."""

INVISIBLE = 1.0
"""A mode that removal changes by less than this much chi-square plays no part in the bound of the others."""

CLEAR = 20.0
"""Times the rise needed at which a mode far from all others is not removed by trial: they could not take its part."""

AMPLIFIED = 1e4
"""The noiseless responses are fitted at this many times their size, so that the optimiser sees no noise in them."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Findable:
    """What the responses of a known model can tell about each of its poles.

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


def must_be_found(
    multipliers: ArrayLike,
    residues: ArrayLike,
    noise: ArrayLike,
    lengths: ArrayLike,
    dt: float,
    *,
    false_alarm: float = 1e-9,
) -> NDArray[np.bool_]:
    """Which modes a good identifier must find (`findable`, which see for the parameters and errors).

    Parameters
    ----------
    multipliers, residues, noise, lengths, dt, false_alarm
        As for `findable`.

    Returns
    -------
    ndarray
        Whether each mode must be found (modes,); conjugates agree.
    """
    return findable(multipliers, residues, noise, lengths, dt, false_alarm=false_alarm).must


def findable(
    multipliers: ArrayLike,
    residues: ArrayLike,
    noise: ArrayLike,
    lengths: ArrayLike,
    dt: float,
    *,
    false_alarm: float = 1e-9,
) -> Findable:
    r"""What the responses of a known model can tell of each of its poles.

    A mode must be found when three things hold: both deviations of its pole, by the Cramér-Rao bound, are below
    0.2 % of the fundamental 2π/dt; it lies five deviations (of the difference, where the other is as well determined)
    apart from every other pole modulo the fundamental, and from its own conjugate; and taking it away raises the least-squares cost of the noiseless
    responses, all other poles and residues refitted, by

    .. math:: \Delta \ge 2 q - \nu, \qquad P\left(\chi^2_\nu > q\right) = \text{false alarm}

    so that with noise the rise is twice what a test at that false-alarm rate asks for. ν counts the residues and the
    pole, 2M + 2 for a pair over M responses; with the noise estimated, q is ν times the quantile of F. A mode that
    costs less is left out while the others are judged. Modes that cost less than one take no part in the bound of the others
    either: free residues of what is not there to be seen would inflate it.

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
        covariance[np.ix_(both, both)] = bound_of(known.keep(visible))
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
    """Whether each pole lies `APART` deviations from all visible others, modulo the fundamental (modes,).

    Beside a pole that is sharp too the deviation is that of their difference; where the other one may be anywhere,
    that of this one.
    """
    n, logs = len(known.multipliers), np.log(known.multipliers)
    gap = np.subtract.outer(logs, logs)
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
        model = known.keep(left)
        now = _removals(model, needed[left][model.upper])
        share = now / needed[left][model.upper]
        position = np.flatnonzero(left)
        failed = int(np.argmin(share))
        for entry in [failed] if share[failed] < 1.0 else range(len(now)):
            mode = position[model.upper[entry]]
            rises[[mode, known.partner[mode]]] = now[entry]
            left[[mode, known.partner[mode]]] = False
    return rises


def _removals(known: Known, needed: NDArray[np.float64]) -> NDArray[np.float64]:
    """The noiseless cost of taking away each upper pole with its conjugate, all others being needed (upper,).

    All that the responses of one input are to a least-squares cost is a factor of their Gram matrix, and without noise
    that has no more columns than there are poles. With the other poles held the cost is an upper bound of that with
    them free: where it is too small already, it will do.
    """
    data = _compressed(known)
    rest = np.ones((len(known.upper), len(known.multipliers)), bool)
    for entry, mode in enumerate(known.upper):
        rest[entry, [mode, known.partner[mode]]] = False
    rises = np.array([_left(known.multipliers[kept], data) for kept in rest]) / AMPLIFIED**2
    if (rises < needed).any():
        return rises
    identifier = MaximumLikelihood(time_constants=1e9)
    state = identifier.prepare(data)
    for entry in np.flatnonzero(~(_far(known) & (rises > CLEAR * needed)) & rest.any(axis=1)):
        multipliers = known.multipliers[rest[entry]]
        residues = np.zeros((len(multipliers), data.n_outputs, data.n_inputs))
        found = identifier.refine(state, ModalModel(multipliers=multipliers, residues=residues, dt=1.0))
        rises[entry] = min(rises[entry], found.stats["cost"] / AMPLIFIED**2)
    return rises


def _compressed(known: Known) -> TimeResponses:
    """Noiseless responses of the model's Gram matrices, `AMPLIFIED` (modes or fewer, inputs, samples)."""
    at, pair = known.upper, known.size == 2
    parts = known.residues[at] * known.size[:, None, None]
    parts = np.concatenate([parts.real, -parts.imag[pair]])
    longest = int(known.lengths.max())
    values = np.zeros((min(parts.shape[:2]), len(known.lengths), longest))
    for index, length in enumerate(known.lengths):
        columns, scale = scaled_columns(known.multipliers[at], int(length))
        columns = np.concatenate([columns.real, columns.imag[:, pair]], axis=1)
        scaled = parts[:, :, index] / np.concatenate([scale, scale[pair]])[:, None]
        values[:, index, :length] = (columns @ np.linalg.qr(scaled.T, mode="r").T).T
    return TimeResponses(values=AMPLIFIED * values, dt=1.0, lengths=known.lengths)


def _left(multipliers: NDArray[np.complex128], data: TimeResponses) -> float:
    """The sum of squares that these poles leave of the responses."""
    upper = multipliers[multipliers.imag >= 0]
    total = 0.0
    for index, length in enumerate(data.lengths):
        columns, _ = scaled_columns(upper, int(length))
        q, _ = np.linalg.qr(np.concatenate([columns.real, columns.imag[:, upper.imag > 0]], axis=1))
        block = data.values[:, index, :length].T
        # Twice: what is left may be a small part of the whole.
        block = block - q @ (q.T @ block)
        total += float(np.sum((block - q @ (q.T @ block)) ** 2))
    return total


def _far(known: Known) -> NDArray[np.bool_]:
    """Whether no other pole is so near to each upper one that it could move to take its part (upper,)."""
    logs = np.log(known.multipliers)
    gap = np.subtract.outer(logs[known.upper], logs)
    gap = np.abs(gap - 2j * np.pi * np.rint(gap.imag / (2.0 * np.pi)))
    gap[np.arange(len(known.upper)), known.upper] = np.inf
    width = np.maximum(np.abs(logs[known.upper].real), 2.0 * np.pi / known.lengths.max())
    return gap.min(axis=1) > 4.0 * width
