"""Maximum likelihood: separable least squares in the poles, started from ESPRIT, with an order that is tested."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, final

import numpy as np

from floquid.lti._exponentials import Factor, Fit, factor, polish
from floquid.lti._identifier import AbstractIdentifier
from floquid.lti._order import checked_order, reached
from floquid.lti._poles import PoleSet
from floquid.lti._residues import model_of
from floquid.lti._select import choose, energetic_length, force_order
from floquid.lti._types import ModalModel, Outcome, TimeResponses


@dataclass(frozen=True, slots=True)
class Prepared:
    """Responses, and their factors over unit noise: one a distinct length."""

    data: TimeResponses
    factors: tuple[Factor, ...]
    initial: Any = None
    """What the wrapped identifier prepared, where there is one."""


@final
@dataclass(frozen=True, slots=True, kw_only=True)
class MaximumLikelihood(AbstractIdentifier):
    r"""Poles that minimise the noise-weighted sum of squares, the residues eliminated.

    .. math:: \min_\mu \operatorname{tr}\left((I - P_\mu)\, Y Y^T\right)

    (Golub and Pereyra 1973, in Kaufman's form; the Gram matrix as in `errata.md`, "What makes it scale"). Conjugate
    pairs, positive real and negative real multipliers are kinds of their own. ESPRIT at several orders gives the start;
    with `order=None` each mode must pass a chi-square test with the others refitted. Where another identifier is
    wrapped (`initial`), the start and the order are its own, and this is the finish.

    Parameters
    ----------
    false_alarm
        The probability at which noise may pass for one mode.
    most
        The highest order considered; never more than half the samples.
    starts
        The orders at which ESPRIT is asked, as far as the samples allow.
    time_constants
        The fit looks at samples out to this many time constants of the slowest pole; what comes later is noise.
    initial
        The identifier whose poles are to be made those of maximum likelihood; None for a search of our own.
    """

    decides: ClassVar[bool] = True

    false_alarm: float = 1e-9
    most: int = 80
    starts: tuple[int, ...] = (24, 48)
    time_constants: float = 6.0
    initial: AbstractIdentifier | None = None

    def prepare(self, data: TimeResponses) -> Prepared:
        """The triangular factors of the responses over their noise, one a distinct length.

        Parameters
        ----------
        data
            The responses and their noise.

        Returns
        -------
        Prepared
            What `extract` and `refine` start from.
        """
        scaled = data.values / data.noise[:, :, None]
        factors = []
        for length in np.unique(data.lengths)[::-1]:
            block = scaled[:, data.lengths == length, :length]
            factors.append(factor(block.reshape(-1, length).T))
        return Prepared(data, tuple(factors), None if self.initial is None else self.initial.prepare(data))

    def extract(
        self, state: Prepared, order: int | None = None, *, report: Callable[[str], None] = lambda _: None
    ) -> ModalModel:
        """The maximum-likelihood model.

        Parameters
        ----------
        state
            What `prepare` returned.
        order
            The number of poles, conjugates one by one; None finds it.
        report
            Is told of each stage.

        Returns
        -------
        ModalModel
            The model; its `outcome` says how it ended.

        Raises
        ------
        InputError
            `order` is not a positive integer below the number of samples.
        """
        checked_order(order, self, state.data)
        most = min(self.most, int(state.data.lengths.max()) // 2)
        if self.initial is not None:
            found = self.initial.extract(state.initial, order, report=report)
            return self.refine(state, found) if found.order else found
        found, factors, ended = self._choose(state, most, report)
        outcome = Outcome.SUCCESS
        if order is not None:
            found = force_order(found, factors, order, self.false_alarm)
            outcome = reached(order, found.poles.order)
        elif not len(found.poles):
            outcome = Outcome.NO_MODE
        elif not ended:
            outcome = Outcome.NOT_WHITE
        elif found.poles.order >= most:
            outcome = Outcome.TOO_FEW_SAMPLES
        return self._model(state, polish(found.poles, factors), outcome)

    def refine(self, state: Prepared, model: ModalModel) -> ModalModel:
        """The maximum-likelihood model of the same order nearest to another one, on other data or another noise.

        Parameters
        ----------
        state
            What `prepare` returned for the data.
        model
            Where to start.

        Returns
        -------
        ModalModel
            The model; its outcome is that of `model`.
        """
        poles = PoleSet.from_multipliers(model.multipliers)
        samples = self._horizon(poles, state)
        return self._model(state, polish(poles, [f.cut(samples) for f in state.factors]), model.outcome)

    def _choose(self, state: Prepared, most: int, report: Callable[[str], None]) -> tuple[Fit, list[Factor], bool]:
        """The poles from the samples that hold energy, and again from more when a mode lasts longer than those."""
        whole = int(state.data.lengths.max())
        samples = energetic_length(state.factors)
        while True:
            factors = [f.cut(samples) for f in state.factors]
            found, ended = choose(factors, false_alarm=self.false_alarm, most=most, starts=self.starts, report=report)
            horizon = self._horizon(found.poles, state)
            if horizon <= samples or samples == whole or not ended:
                return found, factors, ended
            samples = horizon

    def _horizon(self, poles: PoleSet, state: Prepared) -> int:
        """The samples in which the slowest pole decays by `time_constants`."""
        whole = int(state.data.lengths.max())
        slowest = poles.s.real.max() if len(poles) else 0.0
        return whole if slowest >= 0 else min(whole, int(np.ceil(self.time_constants / -slowest)))

    def _model(self, state: Prepared, found: Fit, outcome: Outcome) -> ModalModel:
        data, poles = state.data, found.poles
        map_ = poles.parameter_map()
        stacked = np.concatenate([map_.real, map_.imag])
        unit = found.covariance() if len(poles) else np.zeros((0, 0))
        stats = {"cost": found.cost, "degrees": _degrees(state, poles.order)}
        covariance = stacked @ unit @ stacked.T / data.dt**2
        return model_of(poles, data, covariance=covariance, outcome=outcome, stats=stats)


def _degrees(state: Prepared, order: int) -> float:
    """Samples less free residues less poles."""
    return float(state.data.n_outputs * (state.data.lengths - order).sum() - order)
