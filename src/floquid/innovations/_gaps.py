"""The predictor past samples that were not measured: how vague it is until its gains have made that up."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from floquid.fit import LAGS
from floquid.inputs import Samples

MEMORY = 64  # samples after a gap at which it is taken for forgotten, beside its own length


def scales_of(
    samples: Samples,
    matrices: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]],
    innovations: NDArray[np.float64],
) -> NDArray[np.float64]:
    r"""T (samples, channels, channels) that makes innovations after gaps as small as others, of the form Λ, K and C.

    .. math:: P^+ = (\Lambda - K C) P (\Lambda - K C)^T, \qquad S = C P C^T + R, \qquad T S T^T = R

    with :math:`P^+ = \Lambda P \Lambda^T + K R K^T` where nothing was measured, which is a step without an innovation
    (Anderson and Moore 1979, section 4.1). P is zero far from gaps. Stretches of samples go side by side, each begun
    so far before that what a gap did there is forgotten.
    """
    system, gains, seen = matrices
    covariance = _calm(samples, innovations)
    spreads = np.broadcast_to(covariance, (samples.n_samples, *covariance.shape)).copy()
    length = MEMORY + max((b - a for a, b in samples.gaps), default=0)
    begins = np.concatenate([np.arange(own.start, own.stop, length) for own in samples.records])
    owner = np.searchsorted(samples.begins, begins, side="right")
    first, last = (np.asarray(samples.begins)[owner - by] for by in (1, 0))
    spread = np.zeros((len(begins), *system.shape))
    for step in range(2 * length):
        place = begins - length + step
        inside = (place >= first) & (place < last)
        place = np.where(inside, place, 0)
        if step >= length:
            own = seen[place] @ spread @ seen[place].swapaxes(1, 2)
            spreads[place[inside]] += own[inside]
        held = samples.there[place, None, None]
        ahead = system - held * (gains[place] @ seen[place])
        lost = ~held * gains[place]
        spread = ahead @ spread @ ahead.swapaxes(1, 2) + lost @ covariance @ lost.swapaxes(1, 2)
        spread *= inside[:, None, None]
    spreads = np.where(samples.there[:, None, None], spreads, covariance)
    return np.asarray(np.linalg.cholesky(covariance) @ np.linalg.inv(np.linalg.cholesky(spreads)), np.float64)


def _calm(samples: Samples, innovations: NDArray[np.float64]) -> NDArray[np.float64]:
    """The covariance of innovations far from gaps, of all where hardly any are."""
    used = samples.there.copy()
    for begin, end in samples.gaps:
        used[begin : end + LAGS] = False
    own = innovations[:, used if used.sum() > LAGS * len(innovations) else samples.there]
    return own @ own.T / own.shape[1]
