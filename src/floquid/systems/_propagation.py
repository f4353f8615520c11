"""Free responses of a known periodic system, carried from period to period by its monodromy matrix."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from floquid.floquet import transition


def free_response(
    system: Callable[[ArrayLike], NDArray[np.float64]],
    outputs: Callable[[ArrayLike], NDArray[np.float64]],
    initial: NDArray[np.float64],
    *,
    period: float,
    n_periods: int,
    samples_per_period: int,
    start: float,
) -> NDArray[np.float64]:
    """The outputs y(t₀ + kT + τ) = C(τ) Φ(τ, t₀) Φ(t₀ + T, t₀)^k x(t₀) (channels, samples).

    A(t) is integrated over one period only, so that the error after k periods is k times that of one: about 1e-13 k of
    the response there. `outputs` is C(t) -> (times, channels, n), `initial` the state at t₀ = `start`.
    """
    offsets = period * np.arange(samples_per_period + 1) / samples_per_period
    phi = transition(system, period, start + offsets, start=start)
    states = np.empty((n_periods, len(initial)))
    states[0] = initial
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(1, n_periods):
            states[k] = phi[-1] @ states[k - 1]
        observed = outputs(start + offsets[:-1]) @ phi[:-1]
        values = np.einsum("pcn,kn->ckp", observed, states, optimize=True)
    return values.reshape(values.shape[0], -1)
