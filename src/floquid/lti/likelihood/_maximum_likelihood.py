"""Maximum likelihood: separable least squares in the poles, started from ERA, with the evidence for the order."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, final

import numpy as np

from floquid._arrays import Complexes, Floats
from floquid._checks import Rebuilt
from floquid.fit import SURE, wald_rise
from floquid.lti._era import Realisation, search_window
from floquid.lti._exponentials import Fit, model_of, of_dependent_noise, polish
from floquid.lti._factor import Factor, energetic_length, energies, factors
from floquid.lti._poles import PAIR, PoleSet
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
from floquid.lti.likelihood._rank_one import Noise, merged, refined, separated
from floquid.lti.likelihood._residual import Residual, filtered, whitening_of
from floquid.lti.likelihood._select import Threshold, candidates, choose, force_order, possible


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


AT_REST = 1e-6  # deviations that the last step of the poles may have: two starts that meet give the same digits
LOOKS = 4  # starts of the search, with more samples or with the noise whitened


@dataclass(frozen=True, slots=True)
class Prepared:
    """Responses, and their factors over unit noise: one a distinct length."""

    data: TimeResponses
    factors: tuple[Factor, ...]
    """Factors of the samples that hold energy."""
    initial: Any = None
    """State of the wrapped identifier, where there is one."""

    @property
    def whole(self) -> int:
        """The samples of the longest response."""
        return int(self.data.lengths.max())

    def whitened(self, taps: Floats | None) -> tuple[Factor, ...]:
        """The factors after a filter along time, if there is one."""
        return self.factors if taps is None else tuple(filtered(block, taps) for block in self.factors)

    def first(self, samples: int) -> tuple[Factor, ...]:
        """Factors of the first samples."""
        if samples > len(self.factors[0].values):
            return factors(self.data, samples)
        return tuple(block.cut(samples) for block in self.factors)


@final
@dataclass(frozen=True, slots=True, kw_only=True)
class MaximumLikelihood(AbstractIdentifier):
    r"""Poles that minimise the noise-weighted sum of squares, the residues eliminated.

    .. math:: \min_\mu \operatorname{tr}\left((I - P_\mu)\, Y Y^T\right)

    (Golub and Pereyra 1973, in Kaufman's form). Conjugate pairs, positive real and negative real multipliers are kinds
    of their own. ERA at generous orders gives the start; with `order=None` each mode must pass a chi-square test with
    the others refitted. Any other identifier may be wrapped (`initial`): one that decides the order leaves only the
    finish to this. The poles of one that does not are the start of the search, instead of those of ERA.

    Noise that is correlated in time is whitened by a short filter. Responses with dependent noise count for as many as
    they are worth. Of several inputs the residues are free in the search; where those of a pole are of higher rank than
    one, modes of equal multipliers are told apart as outer products.

    Parameters
    ----------
    false_alarm
        The probability at which noise may pass for one mode.
    most
        The highest order considered; never more than half the samples.
    starts
        The orders of the starts, as far as the samples allow; the later ones are left out where the first tells all.
    time_constants
        The fit looks at samples out to this many time constants of the slowest pole; what comes later is noise.
    initial
        The identifier that gives the start; None for ERA.
    seconds
        Processor time of a search [s], after which it ends with the poles so far, and that outcome.
    rank_one
        Whether a mode's residues are an outer product of outputs and inputs, as they are for one system started in
        different ways: a pole with residues of higher rank then is that of several modes. False leaves the inputs
        independent.
    """

    decides: ClassVar[bool] = True

    false_alarm: float = 1e-9
    most: int = 128
    starts: tuple[int, ...] = (16, 32, 64)
    time_constants: float = 6.0
    initial: AbstractIdentifier | None = None
    seconds: float = np.inf
    rank_one: bool = True

    def bounded(self, seconds: float) -> MaximumLikelihood:
        """The algorithm with a search of `seconds` of a processor [s] at most, that of `initial` too."""
        initial = None if self.initial is None else self.initial.bounded(seconds)
        return replace(self, seconds=min(seconds, self.seconds), initial=initial)

    def prepare(self, data: TimeResponses) -> Prepared:
        """The triangular factors of the responses in `data` over their noise, one a distinct length."""
        samples = energetic_length(energies(data), data)
        initial = None if self.initial is None else self.initial.prepare(data)
        return Prepared(data, factors(data, samples), initial)

    def extract(self, state: Prepared, order: int | None = None, *, report: Report = silent) -> ModalModel:
        """The maximum-likelihood model in `state`, of this `order` or the one found; `report` is told of each stage."""
        checked_order(order, self, state.data)
        most = min(self.most, int(state.data.lengths.max()) // 2)
        if self.initial is not None and self.initial.decides:
            fit = self.initial.extract(state.initial, order, report=report)
            return self.refine(state, fit) if fit.order else fit
        fit, blocks, ended, residual = self._choose(state, most, report)
        outcome = ended
        if order is not None:
            fit = force_order(fit, blocks, order, self.false_alarm)
            outcome = reached(order, fit.poles.order) if ended is not Outcome.OUT_OF_TIME else ended
        elif not len(fit.poles):
            outcome = Outcome.NO_MODE
        elif ended is Outcome.SUCCESS and fit.poles.order >= most:
            outcome = Outcome.TOO_FEW_SAMPLES
        model = _model(state, polish(fit, blocks, tolerance=AT_REST), blocks, outcome, residual)
        several = self.rank_one and order is None and min(state.data.n_inputs, state.data.n_outputs) > 1
        if not several or not model.order:
            return model
        return separated(model, state.data, self.false_alarm, self._noise(state, model))

    def refine(self, state: Prepared, model: ModalModel) -> ModalModel:
        """The maximum-likelihood model in `state` of the order and outcome of `model`, from the poles of that."""
        if model.outer_products:
            return refined(model, state.data, self._noise(state, model))
        poles, blocks, _ = self._seen(state, model)
        return _model(state, polish(poles, blocks, tolerance=AT_REST), blocks, model.outcome)

    def weigh(self, state: Prepared, model: ModalModel) -> Evidence:
        """Weigh the order of a `model` of the data in `state`: take modes away, add one more, look at what is left."""
        poles, blocks, taps = self._seen(state, model)
        fit = polish(poles, blocks)
        residual = Residual.of(fit.poles, blocks)
        threshold = Threshold.for_(blocks, self.false_alarm, residual)
        limits = np.array([threshold.of(int(size)) for size in fit.poles.sizes])
        rises, less = removed(fit, blocks, limits) if len(poles) else (np.zeros(0), None)
        further = clearest(fit, blocks, threshold) if poles.order < self.most else None
        more, size = further or (fit, 1)
        return Evidence(
            multipliers=fit.poles.multipliers()[fit.poles.starts()],
            rises=rises,
            limits=limits,
            firm_limits=np.array([threshold.at(SURE * self.false_alarm, int(size)) for size in fit.poles.sizes]),
            deviations=entry_deviations(fit),
            gap=nearest_pair(fit),
            gain=max(fit.cost - more.cost, 0.0),
            gain_limit=threshold.of(size),
            doubtful_gain=threshold.at(SURE, size),
            moved=movement(fit, more.poles),
            less=None if less is None else _model(state, less, blocks, Outcome.SUCCESS),
            more=None if further is None else _model(state, more, blocks, Outcome.SUCCESS),
            colour=residual.colour(),
            whitened=0 if taps is None else len(taps) - 1,
            independent=residual.independent,
            cost=fit.cost,
            degrees=_degrees(blocks, fit.poles.order),
        )

    def _seen(self, state: Prepared, model: ModalModel) -> tuple[PoleSet, tuple[Factor, ...], Floats | None]:
        """The poles of a model as a free fit has them, the samples that they last for, whitened, and the filter."""
        poles = merged(model) if model.outer_products else PoleSet.from_multipliers(model.multipliers)
        raw = state.first(horizon(poles, state.whole, self.time_constants))
        taps = whitening_of(Residual.of(poles, raw))
        return poles, replace(state, factors=raw).whitened(taps), taps

    def _noise(self, state: Prepared, model: ModalModel) -> Noise:
        """The noise that a model leaves, as its poles see it."""
        poles, blocks, taps = self._seen(state, model)
        residual = Residual.of(poles, blocks)
        return Noise.whitened_by(taps, model, residual.independent, residual.variance)

    def _choose(self, state: Prepared, most: int, report: Report) -> tuple[Fit, tuple[Factor, ...], Outcome, Residual]:
        """The poles from the samples that hold energy, and again from more when a mode lasts longer than those."""
        # With the samples used, how the search ended, and what is left.
        # Coloured noise is whitened before the search, judged by what generous poles leave. They take the peaks of the
        # noise with them, so it is judged again by what the poles found leave, until their number stays.
        start, noise = self._looked_at(state, state.factors)
        taps, looks, before = whitening_of(noise), 0, None
        until = time.process_time() + self.seconds
        while True:
            looks += 1
            blocks = state.whitened(taps)
            if taps is not None:
                report(f"the noise is coloured: whitened by {len(taps) - 1} taps")
                start = self._start(state, blocks)
                generous = start(self._starts(blocks)[-1]).plausible()
                noise = Residual.of(generous if before is None else before, blocks)
            fit, ended, residual = choose(
                blocks,
                start,
                false_alarm=self.false_alarm,
                most=most,
                starts=self._starts(blocks),
                noise=noise,
                until=until,
                report=report,
            )
            if looks == LOOKS or ended is Outcome.OUT_OF_TIME:
                return fit, blocks, ended, residual
            needed = horizon(fit.poles, state.whole, self.time_constants)
            if ended is Outcome.SUCCESS and needed > len(state.factors[0].values):
                state = replace(state, factors=state.first(needed))
                start, noise = self._looked_at(state, state.factors)
                continue
            after = whitening_of(residual if taps is None else Residual.of(fit.poles, state.factors))
            same = before is not None and before.order == fit.poles.order
            if (after is None) == (taps is None) and (taps is None or same):
                return fit, blocks, ended, residual
            if after is None:
                start, noise = self._looked_at(state, state.factors)
            taps, before = after, fit.poles

    def _looked_at(self, state: Prepared, blocks: tuple[Factor, ...]) -> tuple[Callable[[int], PoleSet], Residual]:
        """Source of poles of any order, and the noise that generous ones leave."""
        start = self._start(state, blocks)
        return start, Residual.of(start(self._starts(blocks)[-1]).plausible(), blocks)

    def _starts(self, blocks: tuple[Factor, ...]) -> list[int]:
        """The orders of the starts that blocks of this length allow."""
        lags = search_window(len(blocks[0].values)) - 1
        return sorted({max(1, min(order, lags)) for order in self.starts})

    def _start(self, state: Prepared, blocks: tuple[Factor, ...]) -> Callable[[int], PoleSet]:
        """Poles of any order: those of the wrapped identifier, or of ERA."""
        if self.initial is not None:
            initial = self.initial
            return lambda order: PoleSet.from_multipliers(initial.extract(state.initial, order).multipliers)
        realisation = Realisation.of(blocks, None, max(self.starts))
        return lambda order: PoleSet.from_multipliers(realisation.multipliers(order))


def horizon(poles: PoleSet, whole: int, time_constants: float) -> int:
    """The samples in which the slowest pole decays by `time_constants`; at most `whole`."""
    slowest = poles.s.real.max() if len(poles) else 0.0
    return whole if slowest >= 0 else min(whole, int(np.ceil(time_constants / -slowest)))


def _model(
    state: Prepared, fit: Fit, blocks: tuple[Factor, ...], outcome: Outcome, residual: Residual | None = None
) -> ModalModel:
    """The model of a fit, with residues from all samples; `residual` is that of such poles, where it is known."""
    if len(fit.poles) and (residual or Residual.of(fit.poles, blocks)).independent < 1.0:
        fit = of_dependent_noise(fit, blocks)
    unit = fit.covariance() if len(fit.poles) else np.zeros((0, 0))
    covariance = fit.poles.covariance_of_all(unit) / state.data.dt**2
    stats = {"cost": fit.cost, "degrees": _degrees(blocks, fit.poles.order)}
    return model_of(fit.poles, state.data, covariance=covariance, outcome=outcome, stats=stats)


def _degrees(blocks: tuple[Factor, ...], order: int) -> float:
    """Samples less free residues less poles."""
    return float(sum(block.columns * (len(block.values) - order) for block in blocks) - order)
