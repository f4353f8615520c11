"""Significance of poles: the noise before any is known, and the rise of the cost if one is taken away."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from floquid._arrays import Floats
from floquid.fit import ROUNDING
from floquid.lti._era import hankel_covariance
from floquid.lti._exponentials import real_powers
from floquid.lti._factor import Factor, factor
from floquid.lti._poles import PoleSet


def white_noise_std(responses: Floats) -> float:
    r"""The standard deviation of the white noise on `responses` (outputs, samples) that share it, in their units.

    .. math:: \hat\sigma^2 = \operatorname{quartile}(\operatorname{eig} H H^T) / (c\, n)

    with H the block Hankel matrix of n columns. A sum of r exponentials lifts r of its eigenvalues, and the others are
    those of noise; c is the quartile's mean for white noise of unit variance and the same size, near 1 for many
    outputs. The residual of the maximum-likelihood fit corrects the estimate later.
    """
    outputs, samples = responses.shape
    window = max(1, min(samples // 2, 128))
    if outputs == 1:
        window = max(1, min(window, samples // 4))
    value = _quartile(responses, window)
    return float(np.sqrt(max(value, 0.0) / _expected_quartile(outputs, samples, window)))


def _quartile(responses: Floats, window: int) -> float:
    """The lower quartile of the eigenvalues of the Hankel covariance, a column: poles are fewer than three quarters."""
    outputs, samples = responses.shape
    values = np.linalg.eigvalsh(hankel_covariance([factor(responses.T)], window))
    # Eigenvalues of a squared matrix: below this share of the largest they are rounding, not noise.
    rounding = 8.0 * np.finfo(float).eps * values[-1]
    return max(float(np.quantile(values, 0.25)), rounding) / (outputs * (samples - window + 1))


@lru_cache(maxsize=64)
def _expected_quartile(outputs: int, samples: int, window: int) -> float:
    """The mean of `_quartile` for white noise of unit variance: no closed form is known for Hankel matrices."""
    rng = np.random.default_rng(0)
    draws = 4 if outputs * samples > 100 * window else 16
    return float(np.mean([_quartile(rng.standard_normal((outputs, samples)), window) for _ in range(draws)]))


TRACY_WIDOM = 3.27
"""The largest eigenvalue of a real white Wishart matrix is below this with probability 0.999, centred and scaled."""


def noise_edge(rows: int, columns: int) -> float:
    """The largest singular value of unit noise of `rows` and `columns`, passed once in 1000 (Johnstone 2001)."""
    tall, wide = np.sqrt(rows), np.sqrt(columns)
    scale = (tall + wide) * (1.0 / tall + 1.0 / wide) ** (1.0 / 3.0)
    return float(np.sqrt((tall + wide) ** 2 + TRACY_WIDOM * scale))


@lru_cache(maxsize=256)
def rise_limit(probability: float, degrees: float, samples: float) -> float:
    """The rise of the cost that noise exceeds with `probability`: `degrees` times the limit of an F ratio.

    The noise is estimated from as many numbers as there are samples; with many of them this is a chi-square. The
    tail is that of the beta distribution, since 1 - `probability` would be rounded to 1.
    """
    from scipy.special import betaincinv

    left = max(samples - degrees, 1.0)
    share = float(betaincinv(0.5 * left, 0.5 * degrees, probability))
    return left * (1.0 - share) / share


@dataclass(frozen=True, slots=True)
class Removal:
    r"""The real residues of a set of poles, as far as removals need them.

    A set K of columns taken away raises the cost by tr(S_KK⁻¹ M_KK), with S = (EᵀE)⁻¹ and M = Σ_j r_j r_jᵀ over all
    responses; of the others S and M are left as Schur complements.
    """

    poles: PoleSet
    spread: tuple[Floats, ...]
    moments: tuple[Floats, ...]

    @staticmethod
    def of(poles: PoleSet, factors: Sequence[Factor]) -> Removal:
        """For these poles."""
        spread, moments = [], []
        for block in factors:
            if len(block.values) <= poles.order:
                # Any one pole can be done without where the others take all there is.
                continue
            q, r = np.linalg.qr(real_powers(poles, len(block.values)))
            inverse = np.linalg.pinv(r, rcond=1e-14)
            residues = inverse @ (q.T @ block.values)
            spread.append(inverse @ inverse.T)
            moments.append(residues @ residues.T)
        return Removal(poles, tuple(spread), tuple(moments))

    def rises(self) -> Floats:
        """The rise for each entry (k,)."""
        rises = np.zeros(len(self.poles))
        first, pairs = self.poles.starts(), self.poles.sizes == 2
        second = np.where(pairs, first + 1, first)
        for spread, moments in zip(self.spread, self.moments, strict=True):
            s11, s22, s12 = spread[first, first], spread[second, second], spread[first, second]
            m11, m22, m12 = moments[first, first], moments[second, second], moments[first, second]
            single = np.divide(m11, s11, out=np.zeros_like(m11), where=s11 > 0)
            # Where the two columns of a pair are one to rounding, it takes what one of them takes.
            determinant = s11 * s22 - s12**2
            two = determinant > ROUNDING * s11 * s22
            both = np.divide(s22 * m11 + s11 * m22 - 2.0 * s12 * m12, determinant, out=single.copy(), where=two)
            rises += np.where(pairs, both, single)
        return rises

    def without(self, entry: int) -> Removal:
        """With one entry taken away."""
        start, size = int(self.poles.starts()[entry]), int(self.poles.sizes[entry])
        at = slice(start, start + size)
        rest = np.delete(np.arange(self.poles.order), at)
        spreads, moments = [], []
        for spread, moment in zip(self.spread, self.moments, strict=True):
            share = spread[rest, at] @ _inverse(spread[at, at])
            spreads.append(spread[rest][:, rest] - share @ spread[at][:, rest])
            half = moment[rest, at] @ share.T
            moments.append(moment[rest][:, rest] - half - half.T + share @ moment[at, at] @ share.T)
        return Removal(self.poles.without(entry), tuple(spreads), tuple(moments))


def _inverse(matrix: Floats) -> Floats:
    """The inverse of a symmetric matrix of one or two rows; where those are one to rounding, the pseudo-inverse."""
    trace = float(np.trace(matrix))
    if len(matrix) == 1 or trace == 0.0:
        return np.array([[1.0 / trace if trace else 0.0]]) if len(matrix) == 1 else np.zeros((2, 2))
    determinant = matrix[0, 0] * matrix[1, 1] - matrix[0, 1] * matrix[1, 0]
    if determinant <= ROUNDING * matrix[0, 0] * matrix[1, 1]:
        return matrix / trace**2
    return np.array([[matrix[1, 1], -matrix[0, 1]], [-matrix[1, 0], matrix[0, 0]]]) / determinant


def prune_linear(poles: PoleSet, factors: Sequence[Factor], limit: tuple[float, float]) -> PoleSet:
    """Take away, one by one, what the residues of the others can do without: the rise is below that of its size."""

    def needless(now: PoleSet, rises: Floats) -> int | None:
        excess = rises - np.where(now.sizes == 1, *limit)
        worst = int(np.argmin(excess))
        return None if excess[worst] > 0 else worst

    return _taken(poles, factors, needless)


def strongest(poles: PoleSet, factors: Sequence[Factor], order: int) -> PoleSet:
    """The poles that take most out of the responses, at most `order` counted one by one: the others leave in turn."""
    return _taken(poles, factors, lambda now, rises: weakest(now, rises, order))


def weakest(now: PoleSet, rises: Floats, order: int) -> int | None:
    """The entry of least rise a pole while there are more than `order`; where one is too many, a real one if any."""
    if now.order <= order:
        return None
    fits = now.sizes <= now.order - order
    return int(np.argmin(np.where(fits | ~fits.any(), rises / now.sizes, np.inf)))


def _taken(poles: PoleSet, factors: Sequence[Factor], choice: Callable[[PoleSet, Floats], int | None]) -> PoleSet:
    """Take away the entry chosen by the rises as long as there is one."""
    now = Removal.of(poles, factors)
    while len(now.poles):
        if len(now.spread) < sum(len(f.values) > now.poles.order for f in factors):
            now = Removal.of(now.poles, factors)
        entry = choice(now.poles, now.rises())
        if entry is None:
            break
        now = now.without(entry)
    return now.poles
