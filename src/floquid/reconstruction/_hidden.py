r"""The share of what was seen of something left out that may be true.

With an estimate δ of what is left out, n numbers of covariance C, and χ² = δᵀC⁻¹δ,

.. math:: E\, \theta \theta^T = E(1 - B)\, C + E(1 - B)^2\, \delta \delta^T, \qquad
      p(B) \propto B^{(n-1)/2} e^{-B \chi^2 / 2}, \; 0 < B < 1

B is the share of noise in δ: what is left out is taken to be normal about zero, with a covariance 1/B - 1 times that of
its estimate, and B to have the density 1/(2√B) before (Strawderman 1971, "Proper Bayes minimax estimators of the
multivariate normal mean", a = 1/2; decision 0028 has what other choices came to). So little counts where δ is as small
as noise makes it, and all where it is much larger.
"""

from __future__ import annotations

import numpy as np

SHARES = np.linspace(0.0, 1.0, 2001)[1:]  # values of B that are summed over


def hidden_share(square: float, numbers: int) -> tuple[float, float]:
    """E(1 - B) and E(1 - B)² after a χ² of some numbers."""
    logs = 0.5 * (numbers - 1.0) * np.log(SHARES) - 0.5 * square * SHARES
    weights = np.exp(logs - logs.max())
    weights /= weights.sum()
    return float(weights @ (1.0 - SHARES)), float(weights @ (1.0 - SHARES) ** 2)
