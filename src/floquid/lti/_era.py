"""ERA, the eigensystem realisation algorithm, on the covariance of Hankel matrices that are never formed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from floquid._arrays import BLOCK, Complexes, Floats
from floquid._checks import integer
from floquid.lti._exponentials import model_of
from floquid.lti._factor import Factor, energetic_length, energies, factors
from floquid.lti._identifier import AbstractIdentifier, Report, given_order, reached, silent
from floquid.lti._poles import PoleSet
from floquid.lti._types import ModalModel, TimeResponses

ROUNDING = 16.0 * np.finfo(float).eps  # the share of the largest eigenvalue below which an eigenvalue is rounding


def hankel(blocks: Iterator[Floats], inputs: int, samples: int, degree: int) -> Floats:
    r"""Σ_o Σ_t y_oi[t-k] y_oj[t-m] over t ≥ degree, (powers and inputs, powers and inputs), the power first.

    Its first rows are correlations; along each diagonal the next entry gains one product at the near end and loses one
    at the far end.
    """
    size = 1 << int(np.ceil(np.log2(samples + degree + 1)))
    cross = np.zeros((inputs, inputs, size // 2 + 1), complex)
    change = np.zeros((degree * inputs, degree * inputs))
    for block in blocks:
        for start in range(0, len(block), max(1, BLOCK // (size * inputs))):
            part = block[start : start + max(1, BLOCK // (size * inputs))]
            late = np.fft.rfft(np.where(np.arange(samples) < degree, 0.0, part), size)
            whole = np.fft.rfft(part, size).conj()
            for i in range(inputs):
                for j in range(inputs):
                    cross[i, j] += np.einsum("ol,ol->l", late[:, i], whole[:, j])
        near = block[:, :, :degree][..., ::-1].transpose(2, 1, 0).reshape(degree * inputs, -1)
        far = block[:, :, samples - degree :][..., ::-1].transpose(2, 1, 0).reshape(degree * inputs, -1)
        change += near @ near.T - far @ far.T
    first = np.fft.irfft(cross, size)[..., : degree + 1]
    steps = change.reshape(degree, inputs, degree, inputs)
    normal = np.zeros((degree + 1, inputs, degree + 1, inputs))
    normal[0] = first.transpose(0, 2, 1)
    for k in range(degree):
        normal[k + 1, :, 0] = first[:, :, k + 1].T
        normal[k + 1, :, 1:] = normal[k, :, :-1] + steps[k]
    whole = normal.reshape((degree + 1) * inputs, -1)
    return 0.5 * (whole + whole.T)


def hankel_covariance(factors: Sequence[Factor], window: int) -> Floats:
    r"""Σ_n f[n:n+L] f[n:n+L]ᵀ (L, L) over all columns f of blocks that are at least L long, n = 0 … samples - L."""
    long = [block.values.T[:, None] for block in factors if len(block.values) >= window]
    parts = [hankel(iter([values]), 1, values.shape[2], window - 1) for values in long]
    return np.sum(parts, axis=0)[::-1, ::-1] if parts else np.zeros((window, window))


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
