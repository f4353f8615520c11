"""A(t), integrated over a period, against the system that the model describes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from floquid._arrays import Complexes, Floats
from floquid.checks._check import Evidence
from floquid.core import PeriodicModel
from floquid.findings import Finding, failure
from floquid.fit import DEVIATIONS
from floquid.reconstruction import StateModel

TOLERANCE = 1e-4  # relative errors of multipliers, and of Φ, that interpolation between the instants may make
ACCURACY = TOLERANCE / 100.0
"""The relative change of Φ over a period at which steps are short enough: half as long, they are 16 times as good.

A smaller share of the largest multiplier is not told by integrating.
"""

MOST_STEPS = 2**16  # steps in a period, at most


@dataclass(frozen=True, slots=True)
class Consistency:
    """Result of integrating A(t)."""

    multipliers: float  # the largest difference of a multiplier from the model's, over what it may be
    pair: tuple[complex, complex]  # worst multiplier of A(t), and that of the model
    liouville: float  # the mean of tr A less the sum of the exponents, times the period, over what it may be
    composition: float  # the largest relative difference of Φ(t + T, t0), integrated, and Φ(t, t0) Φ(t0 + T, t0)


def system(case: Any, evidence: Evidence) -> tuple[Finding, ...]:
    """Finding on A(t), integrated over a period, that is not the model's."""
    if case.state is None:
        return ()
    compared = consistency(case.model, case.state)
    if isinstance(compared, Finding):
        return evidence.missing({"multipliers": 1.0, "liouville": 1.0, "composition": TOLERANCE}, compared)
    multipliers = evidence.kept("multipliers", compared.multipliers, 1.0)
    trace = evidence.kept("liouville", compared.liouville, 1.0)
    composition = evidence.kept("composition", compared.composition, TOLERANCE)
    if multipliers and trace and composition:
        return ()
    return evidence.against(
        "system_other",
        "multipliers",
        "liouville",
        "composition",
        pair=None if multipliers else compared.pair,
        trace=not trace,
        composition=None if composition else compared.composition,
    )


def consistency(model: PeriodicModel, state: StateModel) -> Consistency | Finding:
    r"""A(t) interpolated between its instants and integrated over a period, against the model and against Φ.

    .. math:: \Phi(T) v = e^{\lambda T} v, \qquad \int_0^T \operatorname{tr} A\, dt = T \sum_r \lambda_r, \qquad
              \Phi(t + T, t_0) = \Phi(t, t_0)\, \Phi(t_0 + T, t_0)

    A(t) is a trigonometric polynomial through its samples, integrated by Magnus' expansion of order 4 (Blanes et al.
    2009, eq. 253), halving the step until Φ stays. Too few instants, or a real part taken of what is not real, give
    other multipliers. A finding says why there is nothing to compare.
    """
    instants, n = len(state.times), len(state.states)
    if n != model.order:
        return failure("system_states", states=n, modes=model.order)
    steps = np.diff(state.times, append=state.times[0] + model.period)
    if np.abs(steps - model.period / instants).max() > 1e-6 * model.period / instants:
        return failure("system_instants")
    integrated = _integrated(state, model.period)
    if integrated is None:
        return failure("system_too_large")
    reached, monodromy = integrated
    multipliers, pair = _multipliers(np.asarray(np.linalg.eigvals(monodromy), np.complex128), model)
    parts = np.zeros(2 * model.order)
    parts[: model.order] = model.period
    spread = 0.0 if model.covariance is None else float(np.sqrt(parts @ model.covariance @ parts))
    trace = float(np.trace(state.system, axis1=1, axis2=2).mean()) * model.period
    liouville = abs(trace - float(model.exponents.real.sum()) * model.period) / (DEVIATIONS * spread + TOLERANCE)
    ahead = state.transition @ monodromy
    scale = _scales(state)
    size = np.abs(ahead / scale[:, None] * scale).max(axis=(1, 2))
    off = np.abs((reached @ monodromy - ahead) / scale[:, None] * scale).max(axis=(1, 2))
    composition = float((off / np.maximum(size, np.finfo(float).tiny)).max())
    return Consistency(multipliers, pair, liouville, composition)


def _multipliers(of_system: Complexes, model: PeriodicModel) -> tuple[float, tuple[complex, complex]]:
    """The largest difference from the nearest multiplier, both ways, over what it may be; and the pair."""
    of_model = model.multipliers
    std = 0.0 if model.exponent_std is None else np.abs(model.exponent_std) * model.period
    may = np.abs(of_model) * (DEVIATIONS * std + TOLERANCE) + ACCURACY * np.abs(of_model).max()
    off = np.abs(np.subtract.outer(of_system, of_model)) / may
    # Two that are one would not be seen by this: the sum of the exponents is looked at beside it.
    pairs = [(int(np.argmin(row)), k) for k, row in enumerate(off.T)]
    pairs += [(k, int(np.argmin(row))) for k, row in enumerate(off)]
    worst = max(pairs, key=lambda pair: off[pair])
    return float(off[worst]), (complex(of_system[worst[0]]), complex(of_model[worst[1]]))


def _scales(state: StateModel) -> Floats:
    """Units of the states in which A(t) is balanced (n,)."""
    from scipy.linalg import matrix_balance

    _, (scale, _) = matrix_balance(np.abs(state.system).mean(axis=0), permute=False, separate=True)
    return np.asarray(scale, np.float64)


def _integrated(state: StateModel, period: float) -> tuple[Floats, Floats] | None:
    """Φ(t, t0) at the instants (times, n, n), and after a period (n, n); None where no step is short enough."""
    scale = _scales(state)
    parts = np.fft.rfft(state.system / scale[:, None] * scale, axis=0) / len(state.times)
    parts[1 : (len(state.times) + 1) // 2] *= 2.0
    width = period / len(state.times)
    largest = float(np.abs(parts).sum(axis=0).sum(axis=1).max())
    steps, before = 2 ** max(0, int(np.ceil(np.log2(max(width * largest, 1.0))))), None
    while steps * len(state.times) <= MOST_STEPS:
        transition = _propagated(parts, len(state.times), steps, period)
        if before is not None and np.abs(transition[-1] - before).max() <= ACCURACY * np.abs(transition[-1]).max():
            whole = transition * scale[:, None] / scale
            return whole[:-1], whole[-1]
        steps, before = 2 * steps, transition[-1]
    return None


def _propagated(parts: Complexes, instants: int, steps: int, period: float) -> Floats:
    """Φ from the first instant to each one and to the end of the period (instants + 1, n, n)."""
    from scipy.linalg import expm

    n, total = parts.shape[1], instants * steps
    step = period / total
    turns = 2j * np.pi / period * np.arange(len(parts))

    def system(times: Floats) -> Floats:
        turned = np.exp(np.multiply.outer(times, turns))
        return (turned @ parts.reshape(len(parts), -1)).real.reshape(-1, n, n)

    begin, node = np.arange(total) * step, 0.5 * step / np.sqrt(3.0)
    first, second = system(begin + 0.5 * step - node), system(begin + 0.5 * step + node)
    bracket = second @ first - first @ second
    moved = expm(0.5 * step * (first + second) + np.sqrt(3.0) / 12.0 * step**2 * bracket)
    transitions = np.empty((instants + 1, n, n))
    transitions[0] = np.eye(n)
    for k in range(instants):
        state = transitions[k]
        for factor in moved[k * steps : (k + 1) * steps]:
            state = factor @ state
        transitions[k + 1] = state
    return transitions
