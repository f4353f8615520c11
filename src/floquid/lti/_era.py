"""ERA, the eigensystem realisation algorithm, on the covariance of Hankel matrices that are never formed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from floquid._arrays import Complexes, Floats
from floquid._checks import integer
from floquid.lti._exponentials import model_of
from floquid.lti._factor import Factor, energetic_length, energies, factors
from floquid.lti._poles import PoleSet
from floquid.lti._types import AbstractIdentifier, ModalModel, Report, TimeResponses, given_order, reached, silent

ROUNDING = 16.0 * np.finfo(float).eps  # the share of the largest eigenvalue below which an eigenvalue is rounding


def hankel_covariance(factors: Sequence[Factor], window: int) -> Floats:
    """Σ_n f[n:n+L] f[n:n+L]ᵀ (L, L) over all columns f of blocks that are at least L long, n = 0 … samples - L."""
    # Its first row is a correlation; along each diagonal the next entry gains one product at the far end and loses one
    # at the near end.
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
        # Products, and not a transform, whose rounding would be that of the largest sample.
        row[0] = [np.vdot(block.values[:shifts], block.values[lag : lag + shifts]) for lag in range(window)]
        for i in range(window - 1):
            row[i + 1, i + 1 :] = row[i, i:-1] + change[i, i:]
        total += row
    upper = np.triu(total, 1)
    return upper + upper.T + np.diag(np.diag(total))


@dataclass(frozen=True, slots=True)
class Realisation:
    """The leading values (k,), descending, and vectors (M, k) of a Hankel covariance; and its shift (M, M)."""

    values: Floats
    vectors: Floats
    shifted: Floats

    @staticmethod
    def of(blocks: Sequence[Factor], window: int | None, most: int) -> Realisation:
        """Realisation of windows of M samples, from blocks longer than M; at most `most` leading directions."""
        longest = max(len(block.values) for block in blocks)
        lags = max(1, min(window or search_window(longest), longest - 1))
        covariance = hankel_covariance(blocks, lags + 1)
        values, vectors = np.linalg.eigh(covariance[:-1, :-1])
        return Realisation(values[: -most - 1 : -1], vectors[:, : -most - 1 : -1], covariance[:-1, 1:])

    @property
    def rank(self) -> int:
        """The number of eigenvalues above rounding."""
        return int((self.values > ROUNDING * self.values[0]).sum()) if self.values[0] > 0 else 0

    def multipliers(self, order: int) -> Complexes:
        """The eigenvalues (order,) of Λ⁻¹ Vᵀ H₀ᵀH₁ V = Σ⁻¹ Uᵀ H₁ V, similar to the A of the balanced realisation."""
        order = min(order, self.rank)
        lead, scale = self.vectors[:, :order], np.sqrt(self.values[:order])
        inner = (lead.T @ self.shifted @ lead) / np.outer(scale, scale)
        found = np.linalg.eigvals(inner).astype(complex)
        return found[np.abs(found) > ROUNDING]


def search_window(samples: int) -> int:
    """The length of the Hankel window: half of the longest block, so that a short one holds most poles; at most 200."""
    return max(2, min(200, samples // 2))


@dataclass(frozen=True, slots=True)
class Realised:
    """Responses and the realisation of their Hankel matrices."""

    data: TimeResponses
    realisation: Realisation


@final
@dataclass(frozen=True, slots=True, kw_only=True)
class ERA(AbstractIdentifier):
    r"""The eigensystem realisation algorithm (Juang and Pappa 1985) for free responses.

    .. math:: H_0 = U \Sigma V^T, \qquad
              A_n = \Sigma_n^{-1/2} U_n^T H_1 V_n \Sigma_n^{-1/2} \sim \Lambda_n^{-1} V_n^T (H_0^T H_1) V_n,
              \qquad H_0^T H_0 = V \Lambda V^T

    H₀ and H₁, one sample later, have a column a lag and a row a start and response; the multipliers are the eigenvalues
    of A_n. With many responses only H₀ᵀH₀ and H₀ᵀH₁ are needed, and both are sums of shifted blocks of the Gram matrix
    over time: neither Hankel matrix is formed, and their size does not depend on the number of responses. Responses are
    divided by their noise.

    At too low an order the estimate is biased, at too high a one it holds poles of noise: the order is the user's, or
    that of `MaximumLikelihood(initial=ERA())`.

    Parameters
    ----------
    window
        The number of lags M; None for half of the samples that hold energy, at most 200.
    most
        The highest order that can be extracted.
    """

    decides: ClassVar[bool] = False

    window: int | None = None
    most: int = 80

    def __post_init__(self) -> None:
        integer(self.most, "most", "ERA", at_least=1)
        if self.window is not None:
            integer(self.window, "window", "ERA", at_least=1)

    def prepare(self, data: TimeResponses) -> Realised:
        """The realisation of the highest order of the responses in `data`."""
        samples = energetic_length(energies(data), data)
        return Realised(data, Realisation.of(factors(data, samples), self.window, self.most))

    def extract(self, state: Realised, order: int | None = None, *, report: Report = silent) -> ModalModel:
        """The model of the `order` leading directions in `state`, or of all where there are fewer; tells `report`."""
        wanted = given_order(order, self, state.data)
        report("extracting from the realisation")
        poles = PoleSet.from_multipliers(state.realisation.multipliers(wanted))
        return model_of(poles, state.data, outcome=reached(wanted, poles.order))
