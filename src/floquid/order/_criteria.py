"""How well each order fits: one measure for the models of any identifier."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from floquid.lti import ModalModel, TimeResponses, weighted_blocks
from floquid.order._types import Criteria


def criteria(models: Sequence[ModalModel], principal: TimeResponses, data: TimeResponses) -> Criteria:
    r"""The fit of each model to the data behind its principal responses.

    .. math:: c_n = \operatorname{tr}\big((I - P_n) W^T W\big), \qquad
              \mathrm{AIC} = N \ln\frac{c_n}{N} + 2 p, \qquad
              \mathrm{BIC} = N \ln\frac{c_n}{N} + n \ln N + n O \sum_i \ln N_i

    with N = O Σ N_i numbers of O outputs, p = n (1 + O I) real parameters of n poles and their residues, and the level
    of the noise free. A residue is told by the N_i samples of its own response alone, which is what it is charged for
    (Schwarz 1978, with each parameter's own sample size). With many outputs AIC is close to the chi-square test
    of `MaximumLikelihood`; BIC misses weak modes there.
    """
    n_outputs, samples = data.n_outputs, int(data.lengths.sum())
    numbers = n_outputs * samples
    energy, beyond = float(np.sum(principal.values**2)), 0.0
    if principal.n_outputs < min(n_outputs, samples):
        # Principal responses were left out: what they hold is never explained.
        beyond = max(sum(float(np.sum(block**2)) for block in weighted_blocks(data)) - energy, 0.0)
    cost = np.array([_left(model.multipliers, principal) for model in models]) + beyond
    orders = np.array([model.order for model in models])
    parameters = orders * (1 + n_outputs * data.n_inputs)
    fitted = numbers * np.log(np.maximum(cost, np.finfo(float).tiny) / numbers)
    spread = float(n_outputs * np.log(principal.lengths).sum())
    return Criteria(
        cost=cost,
        left=cost / max(energy + beyond, np.finfo(float).tiny),
        aic=fitted + 2.0 * parameters,
        bic=fitted + orders * (np.log(numbers) + spread),
        degrees=numbers - parameters,
    )


def _left(multipliers: NDArray[np.complex128], principal: TimeResponses) -> float:
    """The sum of squares that the best residues of these multipliers leave."""
    left = 0.0
    for i, length in enumerate(principal.lengths):
        values = principal.values[:, i, :length].T
        upper = np.asarray(np.log(multipliers[multipliers.imag >= 0]), dtype=np.complex128)
        # A growing mode is scaled at its end, so that nothing overflows.
        k = np.arange(length)[:, None] - np.where(upper.real > 0, length - 1, 0)
        columns = np.exp(k * upper)
        pairs = multipliers[multipliers.imag >= 0].imag > 0
        q, _ = np.linalg.qr(np.concatenate([columns.real, columns[:, pairs].imag], axis=1))
        left += float(np.sum((values - q @ (q.T @ values)) ** 2))
    return left
