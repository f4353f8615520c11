"""The covariance of block Hankel matrices, and the subspace and poles in it, without forming any Hankel matrix."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from floquid.lti._factor import BLOCK, Factor

ROUNDING = 16.0 * np.finfo(float).eps
"""The share of the largest eigenvalue below which an eigenvalue is rounding."""

DENSE = 512
"""The window up to which all eigenvalues are computed; beyond, Lanczos finds the leading ones."""


def hankel_covariance(factors: Sequence[Factor], window: int) -> NDArray[np.float64]:
    r"""Σ_n f[n:n+L] f[n:n+L]ᵀ (L, L) over all columns f of blocks that are at least L long, n = 0 … samples - L.

    Its first row is a correlation; along each diagonal the next entry gains one product at the far end and loses one
    at the near end.
    """
    total = np.zeros((window, window))
    for block in factors:
        samples = len(block.values)
        if samples < window:
            continue
        shifts = samples - window + 1
        head = block.values[: window - 1] @ block.values[: window - 1].T
        tail = block.values[shifts:] @ block.values[shifts:].T
        change = tail - head
        row = np.zeros((window, window))
        row[0] = _correlation(block.values, shifts, window)
        for i in range(window - 1):
            row[i + 1, i + 1 :] = row[i, i:-1] + change[i, i:]
        total += row
    upper = np.triu(total, 1)
    return upper + upper.T + np.diag(np.diag(total))


def _correlation(values: NDArray[np.float64], shifts: int, window: int) -> NDArray[np.float64]:
    """Σ_{n < shifts} f[n] f[n + l] (window,), over all columns."""
    samples, rank = values.shape
    if samples * window <= 2**16:
        gram = values @ values.T
        return np.array([np.trace(gram[:shifts, lag : lag + shifts]) for lag in range(window)])
    size = 1 << int(np.ceil(np.log2(samples + window)))
    total, step = np.zeros(size // 2 + 1, complex), max(1, BLOCK // size)
    for start in range(0, rank, step):
        part = values[:, start : start + step].T
        total += np.einsum(
            "cl,cl->l", np.fft.rfft(part[:, :shifts], size).conj(), np.fft.rfft(part, size), optimize=False
        )
    return np.fft.irfft(total, size)[:window]


@dataclass(frozen=True, slots=True)
class Realisation:
    """The leading values (k,), descending, and vectors (M, k) of a Hankel covariance; and its shift (M, M)."""

    values: NDArray[np.float64]
    vectors: NDArray[np.float64]
    shifted: NDArray[np.float64]

    @staticmethod
    def of(factors: Sequence[Factor], window: int, most: int) -> Realisation:
        """That of windows of M samples, from blocks longer than M; at most `most` leading directions."""
        covariance = hankel_covariance(factors, window + 1)
        values, vectors = leading(covariance[:-1, :-1], min(most, window))
        return Realisation(values, vectors, covariance[:-1, 1:])

    @property
    def rank(self) -> int:
        """The number of eigenvalues above rounding."""
        return int((self.values > ROUNDING * self.values[0]).sum()) if self.values[0] > 0 else 0

    def multipliers(self, order: int) -> NDArray[np.complex128]:
        r"""The eigenvalues (order,) of Λ⁻¹ Vᵀ H₀ᵀH₁ V = Σ⁻¹ Uᵀ H₁ V, similar to the A of the balanced realisation.

        At most `rank` of them.
        """
        order = min(order, self.rank)
        lead, scale = self.vectors[:, :order], np.sqrt(self.values[:order])
        inner = (lead.T @ self.shifted @ lead) / np.outer(scale, scale)
        found = np.linalg.eigvals(inner).astype(complex)
        return found[np.abs(found) > ROUNDING]


def leading(matrix: NDArray[np.float64], most: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The `most` largest eigenvalues, descending, and eigenvectors of a symmetric matrix."""
    size = len(matrix)
    if size <= DENSE or 3 * most > size:
        values, vectors = np.linalg.eigh(matrix)
    else:
        from scipy.sparse.linalg import eigsh

        values, vectors = eigsh(matrix, most, which="LA", v0=np.ones(size))
    order = np.argsort(values)[::-1][:most]
    return values[order], vectors[:, order]
