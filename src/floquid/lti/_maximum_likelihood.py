"""Maximum likelihood: separable least squares in the poles, started from ESPRIT, with an order that is tested."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from floquid._checks import input_error, integer
from floquid.lti._exponentials import Factor, Fit, basis, complex_residues, factor, polish, real_basis
from floquid.lti._identifier import AbstractIdentifier
from floquid.lti._poles import PoleSet
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
        longest = int(state.data.lengths.max())
        most = min(self.most, longest // 2)
        if order is not None and integer(order, "order", "MaximumLikelihood.extract", at_least=1) >= longest:
            raise input_error(
                "order",
                "MaximumLikelihood.extract",
                f"be less than the {longest} samples",
                f"is {order}",
                "Record more samples, or ask for fewer poles.",
            )
        if self.initial is not None:
            found = self.initial.extract(state.initial, order, report=report)
            return self.refine(state, found) if found.order else found
        found, factors, ended = self._choose(state, most, report)
        outcome = Outcome.SUCCESS
        if order is not None:
            found = force_order(found, factors, order, self.false_alarm)
            outcome = Outcome.SUCCESS if found.poles.order == order else Outcome.ORDER_UNREACHED
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
        n = poles.order
        residues = np.zeros((n, data.n_outputs, data.n_inputs), complex)
        spread, slope = np.zeros((2, data.n_inputs, n, n), complex)
        residual = np.zeros((data.n_outputs, data.n_inputs))
        for i, length in enumerate(data.lengths):
            residues[:, :, i], spread[i], slope[i], residual[:, i] = _residues(poles, data.values[:, i, :length])
        map_ = poles.parameter_map()
        stacked = np.concatenate([map_.real, map_.imag])
        unit = found.covariance() if n else np.zeros((0, 0))
        return ModalModel(
            multipliers=poles.multipliers(),
            residues=residues,
            dt=data.dt,
            covariance=stacked @ unit @ stacked.T / data.dt**2,
            residue_spread=spread,
            residue_slope=slope,
            residual_std=residual,
            outcome=outcome,
            stats={"cost": found.cost, "degrees": _degrees(state, n)},
        )


def _degrees(state: Prepared, order: int) -> float:
    """Samples less free residues less poles."""
    return float(state.data.n_outputs * (state.data.lengths - order).sum() - order)


def _residues(
    poles: PoleSet, responses: NDArray[np.float64]
) -> tuple[NDArray[np.complex128], NDArray[np.complex128], NDArray[np.complex128], NDArray[np.float64]]:
    """Residues (n, outputs), their spread and slope (n, n), and the residual's deviation (outputs,)."""
    samples = responses.shape[1]
    columns = basis(poles, samples)
    q, r = np.linalg.qr(real_basis(poles, columns))
    inverse = np.linalg.pinv(r, rcond=1e-14)
    projected = q.T @ responses.T
    free = max(samples - poles.order, 1)
    left = np.sqrt(np.sum((responses.T - q @ projected) ** 2, axis=0) / free)
    pinv = complex_residues(poles, inverse @ q.T)
    # The columns were scaled so that a growing mode cannot overflow; residues belong to sample zero.
    s = poles.full()
    scale = np.exp(-np.where(s.real > 0, samples - 1, 0) * s)
    pinv = scale[:, None] * pinv
    unscaled = columns / scale
    slope = pinv @ (np.arange(samples)[:, None] * unscaled)
    return pinv @ responses.T, pinv @ pinv.conj().T, slope, left
