r"""Residual of a fit: its colour, and the independence of the responses.

Both are read from the residual's Gram matrix over time, G = R Rᵀ. Its sums along diagonals are the autocorrelation of
all responses together. Off the diagonal its elements are Σ_j r_j[n] r_j[m]: for noise with the covariance Σ between
responses they vary by tr Σ², and (tr Σ)²/tr Σ² is how many independent responses the noise is worth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from floquid._arrays import Floats
from floquid.fit import LAGS, yule_walker
from floquid.lti._exponentials import real_powers
from floquid.lti._factor import SHORT, Factor
from floquid.lti._poles import PoleSet

COLOURED = 8.0
"""The deviations from white noise at which a filter is worth its trouble: white noise has them once in 10,000 records,
since the squares that they are a sum of have a long tail."""

FEWEST = 24
"""Samples of a response, more than poles, below which noise is told neither from a misfit nor from what dies away."""

LASTING = 1.5
"""The ratio of the energies in the first and the second half of a record up to which a residual is noise. The inverse
has no bound: poles that decay take more of coloured noise out of the first half."""


@dataclass(frozen=True, slots=True)
class Residual:
    """The residual of one block (samples, rank), an orthonormal basis of what was fitted, and its responses' number.

    The first `taken` columns of the basis are those of what was taken off the responses before.
    """

    values: Floats
    fitted: Floats
    columns: int
    independent: float  # the share of the responses that the noise is worth (0 to 1]; 1 where it cannot be told from 1
    variance: float  # the mean square left, over that of the noise as it was stated, where it is judged; otherwise 1
    judged: bool
    """True where it is noise, and no response that dies away."""
    taken: int = 0

    @staticmethod
    def of(poles: PoleSet, factors: Sequence[Factor]) -> Residual:
        """Residual of the longest block, over its own mean deviation."""
        block = factors[0].cut(SHORT)
        taken = np.zeros((len(block.values), 0)) if block.taken is None else block.taken
        # What was taken off belongs to the fit: no noise is left there either, whichever samples are looked at.
        columns = real_powers(poles, len(block.values)) if len(poles) else taken[:, :0]
        q, _ = np.linalg.qr(np.concatenate([taken, columns], axis=1))
        residual = block.values - q @ (q.T @ block.values)
        free = max((len(residual) - q.shape[1]) * block.columns, 1)
        size = np.sqrt(max(np.einsum("nj,nj->", residual, residual), np.finfo(float).tiny) / free)
        residual /= size
        judged = _lasts(residual, q)
        independent = _independent(residual, q, block.columns) if judged else 1.0
        variance = float(size**2) if judged else 1.0
        return Residual(residual, q, block.columns, independent, variance, judged, taken.shape[1])

    def filtered(self, taps: Floats) -> Residual:
        """The residual of filtered responses, near enough: what was fitted is filtered with them."""
        values, fitted = convolved(self.values, taps), convolved(self.fitted, taps)
        return replace(self, values=values, fitted=np.linalg.qr(fitted)[0])

    def autocorrelation(self, lags: int) -> Floats:
        """The mean over responses and times (lags + 1,), 1 at lag zero."""
        # White noise from which k of n lines were taken has -k/n or so at all lags: it gets back what was taken.
        sums = _lagged(self.values, lags) + self.columns * _lagged(self.fitted[:, : self.taken], lags)
        return sums / sums[0]

    def white(self) -> bool:
        """True where it is noise that is white along the record."""
        return self.judged and self.colour() < COLOURED

    def colour(self) -> float:
        r"""Distance of the residual from white noise, in standard deviations of that number for white noise.

        .. math:: z = \frac{\sum_l (v_l - 1)^2 m_l - L}{\sqrt{\sum_l 2 + 6/m_l}}

        v_l is the power on line l of all responses together over what white noise has there, m_l how many independent
        responses it is made of (half as many at the ends); z has mean zero and unit variance.
        """
        from scipy.fft import rfft

        samples = len(self.values)
        weights = np.full(samples // 2 + 1, 1.0)
        # scipy transforms several columns at once: in half of numpy's time.
        power, taken = (
            np.sum(lines.real**2 + lines.imag**2, axis=1) / samples
            for lines in (np.asarray(rfft(part, axis=0), np.complex128) for part in (self.values, self.fitted))
        )
        weights[0] = 0.5
        if samples % 2 == 0:
            weights[-1] = 0.5
        judged = taken < 0.5  # little of the noise is left on the other lines
        if not judged.any() or not self.judged:
            return 0.0
        share = power[judged] / (1.0 - taken[judged])
        share /= np.average(share, weights=weights[judged])
        many = self.columns * self.independent * weights[judged]
        excess = np.sum((share - 1.0) ** 2 * many - 1.0)
        return float(excess / np.sqrt(np.sum(2.0 + 6.0 / many)))


def _lagged(values: Floats, lags: int) -> Floats:
    """Sums of products of values, by their lag in samples, of all columns (lags + 1,)."""
    size = 2 * len(values)
    power = np.sum(np.abs(np.fft.rfft(values, size, axis=0)) ** 2, axis=1)
    return np.fft.irfft(power, size)[: lags + 1]


def _lasts(residual: Floats, fitted: Floats) -> bool:
    """True where the residual is as large in the second half of the record as in the first: noise is, no decay is."""
    samples, poles = fitted.shape
    if samples - poles < FEWEST:
        return False
    energy = np.einsum("nj,nj->n", residual, residual)
    room = 1.0 - np.einsum("nk,nk->n", fitted, fitted)
    half = samples // 2
    first, second = (energy[part].sum() / room[part].sum() for part in (slice(half), slice(half, None)))
    return bool(first < LASTING * second)


def _independent(residual: Floats, fitted: Floats, columns: int) -> float:
    """The share of the responses that the noise is worth, from all elements of G off its diagonal."""
    # What was fitted is missing from the noise, which makes times depend on one another: the mean of G is (I - QQᵀ)
    # times their number.
    samples, rank = residual.shape
    inner = residual.T @ residual if rank < samples else residual @ residual.T
    powers = np.einsum("nj,nj->n", residual, residual)
    kept = 1.0 - np.einsum("nk,nk->n", fitted, fitted)
    free = samples - fitted.shape[1]
    squares = np.sum(inner**2) - 2.0 * columns * powers.sum() + columns**2 * free
    spread = (squares - np.sum((powers - columns * kept) ** 2)) / (samples * (samples - 1) * columns)
    return 1.0 if spread < 1.0 + 8.0 / max(free, 1) else 1.0 / spread


def whitening_of(residual: Residual) -> Floats | None:
    """The shortest filter that makes a residual white, or the longest; None where it is white."""
    if residual.colour() < COLOURED:
        return None
    taps = None
    order = 1
    while 4 * order < len(residual.values) and order < LAGS:
        taps = whitening(residual, order)
        if residual.filtered(taps).colour() < COLOURED:
            break
        order *= 2
    return taps


def whitening(residual: Residual, order: int) -> Floats:
    """The filter (order + 1,) by the Yule-Walker equations; its output has the variance of its input."""
    correlation = residual.autocorrelation(order)
    taps = yule_walker(correlation, order)
    return taps / np.sqrt(max(taps @ correlation, 1e-6))


def convolved(values: Floats, taps: Floats) -> Floats:
    """Σ_i a_i f[n - i] along time for n from the filter's length."""
    samples, order = len(values), len(taps) - 1
    return np.asarray(sum(tap * values[order - i : samples - i] for i, tap in enumerate(taps)))


def filtered(block: Factor, taps: Floats) -> Factor:
    """The filtered responses: exponentials stay exponentials of the same poles."""
    if len(block.values) <= len(taps):
        return block
    made = Factor.of(convolved(block.values, taps), block.columns)
    taken = None if block.taken is None else convolved(block.taken, taps)
    return replace(made, energy=made.energy + block.left_out, taken=taken)
