"""AMI, the Algorithm of Mode Isolation: one mode after another out of the composite spectrum."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, final

import numpy as np

from floquid.fit import FEW_STEPS, IN_VAIN, positive_part, sandwich
from floquid.lti._exponentials import complex_residues
from floquid.lti._poles import NEGATIVE, PAIR, POSITIVE, Block, PoleSet, composites, spectra
from floquid.lti._significance import rise_limit
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
from floquid.lti.ami._fit import KNOWN, Bands, Coupled, Mode, bands_of, complex_columns
from floquid.lti.ami._isolation import (
    Isolated,
    Rounds,
    empty_mode,
    first_fits,
    go_round,
    growth,
    joined,
    nothing,
    peaks,
    residues,
    started,
    without,
)


@dataclass(frozen=True, slots=True)
class Lines:
    """Responses and their weighted spectra, one block a distinct length."""

    data: TimeResponses
    blocks: tuple[Block, ...]

    @property
    def size(self) -> int:
        """The number of samples of all responses."""
        return int(self.data.n_outputs * self.data.lengths.sum())

    def limit(self, parameters: int, false_alarm: float) -> float:
        """The drop of the cost that `parameters` poles, counted one by one, make by chance with that probability."""
        columns = self.data.n_outputs * self.data.n_inputs
        return rise_limit(false_alarm, parameters * (columns + 1), self.size)


@final
@dataclass(frozen=True, slots=True, kw_only=True)
class AMI(AbstractIdentifier):
    r"""The Algorithm of Mode Isolation, in the z-domain.

    .. math:: Y_{oi}(z) = \sum_r R_{r,oi}\, \frac{1 - \mu_r^N z^{-N}}{1 - \mu_r z^{-1}} + \text{noise},
              \qquad z = e^{2\pi i l/N}, \quad z^N = 1

    The composite, the mean magnitude of the spectra of all responses over their noise, shows the strongest mode as its
    highest peak. One mode is fitted near it to all responses at once, and is subtracted. After that each mode found so
    far is fitted again to the data less the others, round after round, until the poles stop moving. What is left
    is searched for the next peak, until nothing rises above the noise. A mode and its conjugate are fitted together
    everywhere, since near θ = 0 and π they overlap; there a real pole is tried too. A mode stays when the drop of
    the sum of squares that it brings, the others refitted, has a probability below `false_alarm` by chance.

    Of several inputs the residues of a mode are an outer product ψ Lᵀ: modes of equal poles then are told apart.

    The algorithm is that of Drexel and Ginsberg (2001), global over all outputs as in Allen and Ginsberg (2006), over
    several inputs as in Allen and Ginsberg (2005); it is the one used in Allen (2009), section 3.1. Fitting in the
    z-domain with the exact finite sum, the test of a mode and the standard deviations are ours.

    Parameters
    ----------
    false_alarm
        The probability at which noise may pass for one mode.
    most
        The highest order considered; never more than half the samples.
    widths
        The lines that a mode is fitted to: half-power half-widths to each side of its peak.
    tolerance
        The poles have stopped when none moves by more than this many of its standard deviations in a round.
    rounds
        The number of rounds, at most.
    rank_one
        Whether a mode's residues are an outer product of outputs and inputs, as they are for one system started in
        different ways; false leaves the inputs independent.
    """

    decides: ClassVar[bool] = True

    false_alarm: float = 1e-9
    most: int = 80
    widths: float = 16.0
    tolerance: float = 1e-3
    rounds: int = 200
    rank_one: bool = True

    def prepare(self, data: TimeResponses) -> Lines:
        """The weighted spectra of the responses in `data`."""
        return Lines(data, spectra(data))

    def extract(self, state: Lines, order: int | None = None, *, report: Report = silent) -> ModalModel:
        """The model, with its composites, of the modes isolated in `state`; `report` is told of each.

        Without an `order` it goes on until nothing rises above the noise.
        """
        checked_order(order, self, state.data)
        most = min(self.most, int(state.data.lengths.max()) // 2)
        now = self._search(state, most if order is None else max(most, order), report)
        outcome = Outcome.SUCCESS
        if order is not None:
            now = self._force(now, state, order)
            outcome = reached(order, now.order)
        elif not now.modes:
            outcome = Outcome.NO_MODE
        elif now.order >= most:
            outcome = Outcome.TOO_FEW_SAMPLES if most < self.most else Outcome.NOT_WHITE
        return isolated_model(now, state.data, state.blocks, outcome, self.widths)

    def refine(self, state: Lines, model: ModalModel) -> ModalModel:
        """The model in `state` of the same modes: going round, from the poles of `model`; its outcome is that of it."""
        poles = PoleSet.from_multipliers(model.multipliers)
        now = started(poles, state.blocks, self._rounds())
        now = go_round(now, state.blocks, self._rounds())
        return isolated_model(now, state.data, state.blocks, model.outcome, self.widths)

    def _rounds(self, most: int | None = None) -> Rounds:
        most = self.rounds if most is None else min(most, self.rounds)
        return Rounds(widths=self.widths, tolerance=self.tolerance, most=most, rank_one=self.rank_one)

    def _search(self, state: Lines, most: int, report: Report) -> Isolated:
        """Isolate mode after mode."""
        now = nothing(state.blocks)
        while (more := self._next(now, state, most)) is not None:
            now = self._settle(more, state)
            report(f"{now.order} poles isolated")
        return now

    def _next(self, now: Isolated, state: Lines, most: int) -> Isolated | None:
        """The modes and one more, if a peak of what is left holds one."""
        for peak in peaks(now, state.blocks)[:IN_VAIN]:
            best: tuple[float, Isolated] | None = None
            for mode in first_fits(peak, now, state.blocks, self.rank_one):
                if now.order + mode.size > most:
                    continue
                more = go_round(joined(now, mode, state.blocks), state.blocks, self._rounds(FEW_STEPS))
                gain = now.cost - more.cost - state.limit(mode.size, self.false_alarm)
                if gain > 0 and (best is None or gain > best[0]):
                    best = gain, more
            if best is not None:
                return best[1]
        return None

    def _settle(self, now: Isolated, state: Lines) -> Isolated:
        """Bring the poles to rest, take away what is not needed, and put on the real axis what may lie there."""
        rounds = self._rounds()
        if now.rest >= self.tolerance:
            now = go_round(now, state.blocks, rounds)
        changed = True
        while changed and now.modes:
            changed = False
            for position in np.argsort([_energy_of(mode, state) for mode in now.modes]):
                simpler = self._simpler(now, int(position), state)
                if simpler is not None:
                    now, changed = go_round(simpler, state.blocks, rounds), True
                    break
        return now

    def _simpler(self, now: Isolated, position: int, state: Lines) -> Isolated | None:
        """The modes less one, or with a pair made a real pole, where the noise could explain the difference."""
        mode, rounds = now.modes[position], self._rounds(FEW_STEPS)
        limit = state.limit(mode.size, self.false_alarm)
        less = without(now, position, state.blocks)
        trial = go_round(less, state.blocks, rounds)
        if trial.cost - now.cost < limit:
            return trial
        for kind, angle in ((POSITIVE, mode.s.imag), (NEGATIVE, np.pi - mode.s.imag)):
            if mode.kind == PAIR and angle < 0.5 * abs(mode.s.real) + _resolution(state):
                real = empty_mode(complex(mode.s.real, 0.0 if kind == POSITIVE else np.pi), kind, state.blocks)
                trial = go_round(joined(less, real, state.blocks), state.blocks, rounds)
                if trial.cost - now.cost < state.limit(1, self.false_alarm):
                    return trial
        return None

    def _force(self, now: Isolated, state: Lines, order: int) -> Isolated:
        """The modes brought to `order` where that can be done: the weakest leave, the clearest peaks join."""
        while now.order > order:
            sizes = [m.size <= now.order - order for m in now.modes]
            if not any(sizes):
                break
            energies = [_energy_of(m, state) if fits else np.inf for m, fits in zip(now.modes, sizes, strict=True)]
            now = without(now, int(np.argmin(energies)), state.blocks)
            now = go_round(now, state.blocks, self._rounds())
        while now.order < order:
            trials = [
                go_round(joined(now, mode, state.blocks), state.blocks, self._rounds())
                for peak in peaks(now, state.blocks, clear=-np.inf)[:order]
                for mode in first_fits(peak, now, state.blocks, self.rank_one)
                if now.order + mode.size <= order
            ]
            trials = [trial for trial in trials if trial.cost < now.cost]
            if not trials:
                break
            now = min(trials, key=lambda trial: trial.cost)
        return now


def _resolution(state: Lines) -> float:
    """Two lines of the longest response [rad/sample]."""
    return 4.0 * np.pi / int(state.data.lengths.max())


def _energy_of(mode: Mode, state: Lines) -> float:
    """The sum of squares of what a mode is on the lines."""
    lines = (mode.lines(b, block) for b, block in enumerate(state.blocks))
    return float(sum(np.sum(np.abs(x) ** 2) for x in lines))


def isolated_model(
    now: Isolated, data: TimeResponses, blocks: Sequence[Block], outcome: Outcome, widths: float
) -> ModalModel:
    """The model of isolated modes."""
    # Its deviations are those of the equations that going round solves (`Coupled`): the covariance of the poles is J⁻¹
    # cov(g) J⁻ᵀ. The noise on the residues inflates J, and its expectation is taken off.
    poles = now.poles()
    n = poles.order
    values = np.zeros((n, data.n_outputs, data.n_inputs), complex)
    for start, mode in zip(poles.starts(), now.modes, strict=True):
        values[start] = residues(mode, blocks, data.n_inputs)
        if mode.kind == PAIR:
            values[start + 1] = values[start].conj()
    left = np.zeros((data.n_outputs, data.n_inputs))
    for block, lines in zip(blocks, now.left, strict=True):
        free = max(block.samples - n, 1)
        left[:, block.inputs] = block.noise * np.sqrt(np.sum(np.abs(lines) ** 2, axis=0) / free)
    bands = bands_of(now.modes, blocks, widths)
    whole = [[slice(0, len(block.values))] * len(now.modes) for block in blocks]
    # Of modes hardly told apart the bands' equations may not be definite; those of all lines are, and differ little.
    deviations = _deviations(now, data, blocks, bands) or _deviations(now, data, blocks, whole)
    model = ModalModel(
        multipliers=poles.multipliers(),
        residues=values,
        dt=data.dt,
        residual_std=left,
        outcome=outcome,
        stats={"cost": now.cost, "rest": now.rest},
        **deviations,
    )
    return replace(model, composites=composites(data, model))


def _deviations(now: Isolated, data: TimeResponses, blocks: Sequence[Block], near: Bands) -> dict[str, Any]:
    """The covariance and what noise does to the residues, by name; none where two poles are one to rounding."""
    poles, n = now.poles(), now.order
    if not n:
        return {}
    whole, noise, scatter = np.zeros((3, n, n))
    spread, slope = np.zeros((2, data.n_inputs, n, n), complex)
    for number, block in enumerate(blocks):
        coupled = Coupled.of(now.modes, block, near[number], KNOWN)
        if coupled is None:
            return {}
        parts = coupled.slopes(now.modes, number)
        whole, noise = whole + parts[0], noise + parts[1]
        scatter += coupled.scatter_of_equations(coupled.strength(now.modes, number))
        scale = np.array([growth(s, block) if s.real > 0 else 1.0 for s in poles.full()])
        solve = scale[:, None] * complex_residues(poles, coupled.solve)
        spread[block.inputs] = solve @ solve.conj().T
        slope[block.inputs] = solve @ (complex_columns(poles, coupled.moved) / scale)
    if not (np.diag(whole) > np.finfo(float).tiny).all():
        return {}
    unit = sandwich(positive_part(whole, whole - noise), scatter)
    covariance = poles.covariance_of_all(0.5 * (unit + unit.T)) / data.dt**2
    return {"covariance": covariance, "residue_spread": spread, "residue_slope": slope}
