r"""Poles of many short responses: the outputs of one sample are the state, its step a least-squares matrix.

.. math:: x_i[k] = U^T y_i[k], \qquad
          M = \Big(\sum_{i,k} x_i[k+1]\, x_i[k]^T\Big) \Big(\sum_{i,k} x_i[k]\, x_i[k]^T - K\, I\Big)^{-1}

with U the leading left singular vectors of all samples side by side, and K the number of steps: noise of unit variance
adds so much to the products. Free residues hold half as many poles as a response has samples above the noise. Here the
number is bounded by the outputs, and by all samples of all inputs together.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import ClassVar, final

import numpy as np

from floquid._arrays import Complexes, Floats, Integers
from floquid.fit import MODES, SURE, chi2_limit
from floquid.lti._poles import NEGATIVE, PAIR, POSITIVE, PoleSet
from floquid.lti._significance import noise_edge, rise_limit
from floquid.lti._types import (
    AbstractIdentifier,
    ModalModel,
    Outcome,
    Report,
    TimeResponses,
    checked_order,
    reached,
    silent,
)
from floquid.lti.likelihood._rank_one import (
    Noise,
    ProductFit,
    Products,
    Stacked,
    model_of_products,
    polish_products,
    pruned,
    refined,
    split,
)


@dataclass(frozen=True, slots=True)
class States:
    """Responses over their noise side by side, as long as they are above it, and their singular vectors and values."""

    stacked: Stacked
    loud: Floats  # outputs, with delayed ones where they are few, and samples of all inputs
    first: Integers  # the first sample of each input
    left: Floats
    values: Floats

    @staticmethod
    def of(data: TimeResponses) -> States:
        """The states of responses."""
        stacked, ends = Stacked.of(data), np.minimum(data.lengths, max(samples_above(data), 1))
        starts = np.cumsum(data.lengths) - data.lengths
        delays = max(1, min(-(-MODES // data.n_outputs), int(ends.min()) // 2))
        counts = ends - delays + 1
        kept = np.concatenate([start + np.arange(count) for start, count in zip(starts, counts, strict=True)])
        loud = np.concatenate([stacked.values[:, kept + delay] for delay in range(delays)])
        vectors, values, _ = np.linalg.svd(loud, full_matrices=False)
        return States(stacked, loud, np.cumsum(counts) - counts, vectors, values)

    @property
    def rank(self) -> int:
        """Number of singular values above those of noise."""
        return int((self.values > noise_edge(*self.loud.shape)).sum())

    def start(self, order: int) -> Products:
        """Multipliers of the step matrix, and the participation of each in each input."""
        x = self.left[:, :order].T @ self.loud
        later = np.setdiff1d(np.arange(x.shape[1]), self.first)
        squares = x[:, later - 1] @ x[:, later - 1].T
        less = squares - len(later) * np.eye(order)
        if np.linalg.eigvalsh(less)[0] > 0.0:
            squares = less
        multipliers, vectors = np.linalg.eig(np.linalg.solve(squares, x[:, later - 1] @ x[:, later].T).T)
        shares = np.linalg.solve(vectors, x[:, self.first])
        upper = (multipliers.imag >= 0) & (multipliers != 0)  # one of zero is over at once
        return Products.of(PoleSet.from_multipliers(multipliers[upper].astype(complex)), shares[upper].astype(complex))


def samples_above(data: TimeResponses) -> int:
    """The samples of a response before its energy is that of noise, over all outputs and inputs."""
    energy, count = np.zeros((2, data.values.shape[2]))
    for hit, length in enumerate(data.lengths.tolist()):
        energy[:length] += np.sum((data.values[:, hit, :length] / data.noise[:, hit, None]) ** 2, axis=0)
        count[:length] += data.n_outputs
    loud = np.flatnonzero(energy > [chi2_limit(float(degrees), SURE) for degrees in count])
    return int(loud[-1]) + 1 if len(loud) else 0


@final
@dataclass(frozen=True, slots=True, kw_only=True)
class Ensemble(AbstractIdentifier):
    r"""Poles of many short responses, as outer products of shape and participation.

    .. math:: y_{oi}[k] = \sum_r \psi_{or}\, l_{ri}\, \mu_r^k

    Started from the step matrix of the outputs (least squares, the noise taken off), polished to maximum likelihood.
    Each mode must be needed: without it, the cost would rise by more than noise explains.

    Parameters
    ----------
    false_alarm
        The probability at which noise may pass for one mode.
    seconds
        Processor time of a search [s], after which it ends with the poles so far, and that outcome.
    """

    decides: ClassVar[bool] = True

    false_alarm: float = 1e-9
    seconds: float = np.inf

    def bounded(self, seconds: float) -> Ensemble:
        """The algorithm with a search of `seconds` of a processor [s] at most."""
        return replace(self, seconds=min(seconds, self.seconds))

    def prepare(self, data: TimeResponses) -> States:
        """The singular vectors and values of the responses in `data` over their noise."""
        return States.of(data)

    def extract(self, state: States, order: int | None = None, *, report: Report = silent) -> ModalModel:
        """The model in `state`, of this `order` or the one found; `report` is told of each stage."""
        data = state.stacked.data
        checked_order(order, self, data)
        rank = min(state.rank, MODES)
        if not rank:
            return _empty(data)
        if rank > int((data.lengths - 1).sum()):
            return _empty(data, Outcome.TOO_FEW_SAMPLES)  # any matrix takes so few steps
        report(f"states of many short responses: rank {rank}")
        stacked, until = state.stacked, time.process_time() + self.seconds
        try:
            start = state.start(rank)
            if not len(start.poles):
                return _empty(data)
            fit = _straightened(polish_products(start, stacked), stacked, until)
            if order is None:
                fit = pruned(fit, stacked, lambda own: self._limits(own, stacked), least=1, until=until)
                fit = self._halved(fit, stacked, until)
            else:
                fit = _lowered(fit, stacked, order, until)
        except np.linalg.LinAlgError:
            return _empty(data)
        number = fit.products.poles.order
        outcome = Outcome.OUT_OF_TIME if time.process_time() > until else reached(order, number)
        return model_of_products(fit, stacked, outcome, np.ones(number))

    def refine(self, state: States, model: ModalModel) -> ModalModel:
        """The maximum-likelihood model in `state` of the order and outcome of `model`, from its poles."""
        return refined(model, state.stacked.data, Noise(np.ones(model.order))) if model.order else model

    def weigh(self, state: States, model: ModalModel) -> tuple[Complexes, Floats, Floats, Floats]:
        """Multipliers of a `model` of the data in `state`, and rises of the cost without each, the others fitted again.

        A pair counts once. Last come the limits of the rises: what noise exceeds at the probability allowed for a mode,
        and what it hardly ever exceeds; all are (modes,).
        """
        stacked = state.stacked
        fit = polish_products(split(model, stacked.data, np.ones(model.order, np.int64)), stacked)
        poles, rest = fit.products.poles, [float(np.sum(stacked.values**2))]
        if len(poles) > 1:
            fewer = [fit.products.without(entry) for entry in range(len(poles))]
            rest = [polish_products(products, stacked, tolerance=1e-2).cost for products in fewer]
        limits, firm = (np.array(self._limits(fit.products, stacked, share)) for share in (1.0, SURE))
        return poles.multipliers()[poles.starts()], np.array(rest) - fit.cost, limits, firm

    def _halved(self, fit: ProductFit, stacked: Stacked, until: float) -> ProductFit:
        """The fit with a pair on the axis as one real multiplier where noise explains what that costs."""
        for entry in np.flatnonzero(fit.products.poles.kind == PAIR).tolist():
            poles, shares = fit.products.poles, fit.products.shares
            angle = abs(poles.s[entry].imag)
            for kind, axis in ((POSITIVE, 0.0), (NEGATIVE, np.pi)):
                if not np.isclose(angle, axis, rtol=0.0, atol=0.05) or time.process_time() > until:
                    continue
                rest = np.arange(len(poles)) != entry
                alone = PoleSet.of(np.array([poles.s[entry].real + 1j * axis]), np.array([kind]))
                both = np.concatenate([shares[rest], shares[[entry]].real.astype(complex)])
                trial = polish_products(Products.of(poles.keep(rest).plus(alone), both), stacked)
                if trial.cost - fit.cost < self._limits(trial.products, stacked)[-1]:
                    return self._halved(trial, stacked, until)
        return fit

    def _limits(self, products: Products, stacked: Stacked, share: float = 1.0) -> list[float]:
        """The rise without each entry that noise exceeds at the false-alarm probability, or a `share` of it."""
        rows, outputs = stacked.values.shape[1], stacked.data.n_outputs
        numbers = products.poles.sizes * (outputs + stacked.data.n_inputs)
        return [rise_limit(share * self.false_alarm, float(number), float(rows * outputs)) for number in numbers]


def _lowered(fit: ProductFit, stacked: Stacked, order: int, until: float) -> ProductFit:
    """The fit with no more than `order` poles where that can be had: the entries that are missed least are removed."""
    while fit.products.poles.order > order and time.process_time() < until:
        sizes = fit.products.poles.sizes
        fitting = np.flatnonzero(sizes <= fit.products.poles.order - order)
        if not len(fitting) or len(sizes) == 1:
            break
        trials = [polish_products(fit.products.without(int(entry)), stacked) for entry in fitting]
        fit = min(trials, key=lambda trial: trial.cost)
    return fit


def _straightened(fit: ProductFit, stacked: Stacked, until: float) -> ProductFit:
    """The fit with two real multipliers of one sign as a pair where that costs less: noise makes one of the other."""
    for kind, axis in ((POSITIVE, 0.0), (NEGATIVE, np.pi)):
        poles = fit.products.poles
        along = np.flatnonzero(poles.kind == kind)
        along = along[np.argsort(poles.s[along].real)]
        for first, second in pairwise(along.tolist()):
            if time.process_time() > until:
                return fit
            poles, shares = fit.products.poles, fit.products.shares
            middle, gap = poles.s[[first, second]].real.mean(), abs(np.diff(poles.s[[first, second]].real)[0])
            pair = PoleSet.of(np.array([middle + 1j * (axis - max(gap, 0.05))]), np.array([PAIR]))
            rest = ~np.isin(np.arange(len(poles)), [first, second])
            both = np.concatenate([shares[rest], (shares[[first]] + 1j * shares[[second]])])
            trial = polish_products(Products.of(poles.keep(rest).plus(pair), both), stacked)
            if trial.cost < fit.cost:
                return _straightened(trial, stacked, until)
    return fit


def _empty(data: TimeResponses, outcome: Outcome = Outcome.NO_MODE) -> ModalModel:
    """The model without a mode."""
    return ModalModel(
        multipliers=np.zeros(0, complex),
        residues=np.zeros((0, data.n_outputs, data.n_inputs), complex),
        dt=data.dt,
        outcome=outcome,
    )


def brief(data: TimeResponses, per_pole: int) -> bool:
    """True where a quarter of `data` is above its noise for fewer than `per_pole` samples for each pole."""
    above = samples_above(data)
    shorter = min(above, float(np.quantile(data.lengths, 0.25)))
    return 0 < above < per_pole * MODES and shorter < per_pole * min(States.of(data).rank, MODES)


def pooled_noise(blocks: Iterable[Sequence[Floats]]) -> Floats:
    r"""The standard deviation of white noise on the blocks of each output, one an input, by their ranks.

    .. math:: \hat\sigma = s_{(1/4)} / \bar s_{(1/4)}

    s the lower quartile of the singular values of a block (rows, samples), over that of white noise of unit variance
    and the same size. A block of twice as many samples as it has values beyond the edge of noise gives its own. The
    others have that of all side by side (outputs, inputs). That holds where the modes are fewer than three quarters of
    the samples of all inputs together: the samples of one may be few.
    """
    sigma = []
    for several in blocks:
        whole, _ = _noise_of(np.concatenate(several, axis=1))
        estimates = [(block.shape[1], *_noise_of(block)) for block in several]
        sigma.append([sigma_of_block if 2 * rank <= samples else whole for samples, sigma_of_block, rank in estimates])
    return np.array(sigma)


@lru_cache(maxsize=64)
def _unit_quartile(rows: int, columns: int) -> float:
    """Mean lower quartile of the singular values of white noise of unit variance (rows, columns)."""
    rng, quartiles = np.random.default_rng(0), []
    for _ in range(4):
        white = rng.standard_normal((1, rows, columns))
        unit = np.sqrt(np.linalg.eigvalsh(white @ np.swapaxes(white, 1, 2)))
        quartiles.append(np.quantile(unit, 0.25, axis=1)[0])
    return float(np.mean(quartiles))


def _noise_of(block: Floats) -> tuple[float, int]:
    """The standard deviation of white noise on a block, and the number of singular values that are none of noise."""
    small = block if len(block) <= block.shape[1] else block.T
    values = np.sqrt(np.maximum(np.linalg.eigvalsh(small @ small.T), 0.0))
    sigma = float(np.quantile(values, 0.25) / _unit_quartile(*small.shape))
    return sigma, int((values > noise_edge(*block.shape) * sigma).sum())
