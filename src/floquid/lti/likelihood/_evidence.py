"""Evidence for and against an order: each mode taken away, the clearest one more, and what is left."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from floquid._arrays import Complexes, Floats
from floquid._checks import Rebuilt
from floquid.fit import wald_rise
from floquid.lti._exponentials import Fit, polish
from floquid.lti._factor import Factor
from floquid.lti._poles import PAIR, PoleSet
from floquid.lti._types import ModalModel
from floquid.lti.likelihood._search import candidates
from floquid.lti.likelihood._select import Threshold, possible


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Evidence(Rebuilt):
    """Evidence for an order against its neighbours.

    Parameters
    ----------
    multipliers
        One of each mode (entries,), that above the real axis of a pair.
    rises
        What the cost rises by when the mode is taken away and the others are fitted again (entries,) [-].
    limits, firm_limits
        The rises that noise alone exceeds at the false-alarm probability, and at a probability that leaves no doubt
        (entries,) [-].
    deviations
        The standard deviations of the decay and of the angle of each mode (entries, 2) [neper/sample, rad/sample];
        zero for the angle of a real multiplier.
    gap
        The least distance of two modes of one kind over its standard deviation; infinite for a single one.
    gain, gain_limit
        What the clearest further mode takes out of the cost, the others fitted again, and its limit [-].
    doubtful_gain
        The gain that noise alone exceeds at the probability given for doubt [-].
    moved
        How far the modes move when the further one is there, in standard deviations of the largest such move.
    less, more
        The models with the weakest mode taken away and with the clearest further one; None where there is none.
    colour
        How far from white noise the residual is, in standard deviations; of whitened responses where `whitened`.
    whitened
        The taps of the filter that whitened the noise; 0 where it is white.
    independent
        The share of the responses that the noise is worth.
    cost, degrees
        The cost and the number of samples less that of parameters.
    """

    multipliers: Complexes
    rises: Floats
    limits: Floats
    firm_limits: Floats
    deviations: Floats
    gap: float
    gain: float
    gain_limit: float
    doubtful_gain: float
    moved: float
    less: ModalModel | None
    more: ModalModel | None
    colour: float
    whitened: int
    independent: float
    cost: float
    degrees: float

    def __post_init__(self) -> None:
        self._freeze(dtype=np.complex128, multipliers=("entries",))
        each = (len(self.multipliers),)
        self._freeze(finite=False, rises=each, limits=each, firm_limits=each, deviations=(*each, 2))


def removed(fit: Fit, factors: Sequence[Factor], limits: Floats) -> tuple[Floats, Fit]:
    """The rise for each entry with the others fitted again, and the fit without the weakest."""
    fits = [polish(fit.poles.without(entry), factors, iterations=25, tolerance=1e-2) for entry in range(len(fit.poles))]
    rises = np.array([max(less.cost - fit.cost, 0.0) for less in fits])
    return rises, fits[int(np.argmin(rises / limits))]


def clearest(fit: Fit, factors: Sequence[Factor], threshold: Threshold) -> tuple[Fit, int] | None:
    """The fit with the further mode that comes nearest to passing, and its size."""
    best: tuple[float, Fit, int] | None = None
    found_ones = candidates(fit.poles, factors)
    ranked = sorted(found_ones, key=lambda pair: -pair[1] / threshold.of(int(pair[0].sizes[0])))
    for candidate, promised in ranked:
        size = int(candidate.sizes[0])
        if best is not None and promised < threshold.promising(size):
            continue
        more = polish(fit.poles.plus(candidate), factors, iterations=25, tolerance=1e-2)
        share = (fit.cost - more.cost) / threshold.of(size)
        if possible(more) and (best is None or share > best[0]):
            best = share, more, size
    return None if best is None else (best[1], best[2])


def nearest_pair(fit: Fit) -> float:
    """The least distance of two entries of one kind over its standard deviation."""
    poles, covariance = fit.poles, fit.covariance()
    starts, least = poles.starts(), np.inf
    for i in range(len(poles)):
        for j in range(i):
            if poles.kind[i] != poles.kind[j]:
                continue
            difference = poles.s[i] - poles.s[j]
            parts = [difference.real] + ([difference.imag] if poles.kind[i] == PAIR else [])
            turn = np.zeros((len(parts), poles.order))
            for k in range(len(parts)):
                turn[k, starts[i] + k], turn[k, starts[j] + k] = 1.0, -1.0
            spread = turn @ covariance @ turn.T
            least = min(least, np.sqrt(wald_rise(np.array(parts), spread)))
    return float(least)


def movement(fit: Fit, more: PoleSet) -> float:
    """The largest distance from a pole to the nearest one of a larger set, in its own standard deviations."""
    if not len(fit.poles):
        return 0.0
    std = entry_deviations(fit)
    worst = 0.0
    for s, (decay, angle) in zip(fit.poles.s, std, strict=True):
        apart = more.s - s
        size = np.hypot(apart.real / max(decay, 1e-300), apart.imag / max(angle, decay, 1e-300))
        worst = max(worst, float(size.min()))
    return worst


def entry_deviations(fit: Fit) -> Floats:
    """Standard deviations of Re s and Im s of each entry (k, 2), zero where a part is not free."""
    std = np.sqrt(np.maximum(np.diag(fit.covariance()), 0.0))
    starts = fit.poles.starts()
    second = np.where(fit.poles.kind == PAIR, std[np.minimum(starts + 1, len(std) - 1)], 0.0)
    return np.stack([std[starts], second], axis=1)
