"""How many modes: the order that the data support, the reasons, and what speaks against it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from floquid.lti import AbstractIdentifier, Evidence, MaximumLikelihood, ModalModel, Outcome, TimeResponses

WHITE = 8.0
"""The standard deviations by which the colour of a residual may differ from that of white noise."""

APART = 5.0
"""The standard deviations that two modes must be apart, and that modes may not move by when one more is there."""

DETERMINED = 2e-3 * 2.0 * np.pi
"""The standard deviation of a decay or an angle above which a mode may stand for several [rad/sample]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Choice:
    """An order with its reasons.

    Parameters
    ----------
    order
        The number of poles, conjugates one by one.
    model
        The model of that order.
    reasons
        What speaks for it, a sentence each.
    doubts
        What speaks against it, a sentence each; with any, the order is ambiguous.
    runner_up
        The neighbouring model that comes nearest: one mode less or one more; None where there is none, and in a result
        read from a file.
    evidence
        The numbers behind the sentences; None in a result read from a file.
    """

    order: int
    model: ModalModel
    reasons: tuple[str, ...]
    doubts: tuple[str, ...]
    runner_up: ModalModel | None = None
    evidence: Evidence | None = None

    @property
    def ambiguous(self) -> bool:
        """Whether another order could be right too."""
        return bool(self.doubts)


def choose(
    data: TimeResponses,
    identifier: AbstractIdentifier | None = None,
    *,
    report: Callable[[str], None] = lambda _: None,
) -> Choice:
    r"""The order that the data support.

    A mode stays when the cost (the sum of squares left, over the noise) would rise without it, all others fitted again,
    by more than noise explains; none is added that takes less out. As an information criterion this is

    .. math:: J(n) = \operatorname{cost}(n) + \sum_{\text{modes}} \ell(\text{mode})

    with the limit ℓ of an F test at the false-alarm probability as the penalty of a mode. The choice is ambiguous when
    a neighbouring order is nearly as good, when modes are not told apart or hardly determined, when they move as one
    more is added, or when what is left is not white noise.

    Parameters
    ----------
    data
        The responses and their noise.
    identifier
        The algorithm that finds the poles; one that does not decide the order is the start of maximum likelihood. None
        for `MaximumLikelihood()`.
    report
        Is told of each stage.
    """
    used = identifier or MaximumLikelihood()
    if not used.decides:
        used = MaximumLikelihood(initial=used)
    model = used.extract(used.prepare(data), report=report)
    report("weighing the order")
    return judge(data, model)


def judge(data: TimeResponses, model: ModalModel) -> Choice:
    """The order of a `model` with the reasons, the doubts and the runner-up that the responses in `data` give."""
    likelihood = MaximumLikelihood()
    evidence = likelihood.weigh(likelihood.prepare(data), model)
    reasons, doubts = [], []
    for text, speaks_against in [*_findings(evidence), *_drift(data, evidence), *_hits(data, model, evidence)]:
        (doubts if speaks_against else reasons).append(text)
    if model.outcome is not Outcome.SUCCESS:
        doubts.append(model.outcome.value)
    return Choice(
        order=model.order,
        model=model,
        reasons=tuple(reasons),
        doubts=tuple(doubts),
        runner_up=_runner_up(evidence),
        evidence=evidence,
    )


def _runner_up(evidence: Evidence) -> ModalModel | None:
    """The neighbour whose criterion is nearest."""
    below = float((evidence.rises - evidence.limits).min()) if len(evidence.rises) else np.inf
    above = evidence.gain_limit - evidence.gain
    first, second = (evidence.less, evidence.more) if below < above else (evidence.more, evidence.less)
    return first or second


def _findings(evidence: Evidence) -> list[tuple[str, bool]]:
    """Sentences, and whether each speaks against the order."""
    found = []
    if len(evidence.rises):
        found += [_weakest(evidence), _determined(evidence), *_nearness(evidence)]
    if np.isfinite(evidence.gap):
        text = f"The two modes nearest to each other are {evidence.gap:.3g} standard deviations apart"
        near = evidence.gap < APART
        found.append((text + (": they may be one mode, or three." if near else "."), near))
    share = evidence.gain / evidence.gain_limit
    doubtful = evidence.gain > evidence.doubtful_gain
    text = f"The clearest further mode takes {share:.2f} of what it must take out of the misfit"
    end = ": too little to be kept, but more than noise mostly has." if doubtful else "."
    found.append((text + (": a mode is missing." if share >= 1.0 else end), doubtful))
    if evidence.moved > APART and doubtful:
        text = f"With one more mode the others move by up to {evidence.moved:.3g} standard deviations."
        found.append((text, True))
    found.append(_residual(evidence))
    return found


def _drift(data: TimeResponses, evidence: Evidence) -> list[tuple[str, bool]]:
    """Modes that hardly change over the record, beside noise that wanders: a random walk looks like them."""
    change = np.abs(np.log(evidence.multipliers)) * int(data.lengths.max())
    still = int((change < 2.0 * np.pi).sum()) if evidence.whitened else 0
    if not still:
        return []
    names = "One mode turns and decays" if still == 1 else f"{still} modes turn and decay"
    return [(f"{names} by less than once over the record, and the noise is coloured: its drift may look so.", True)]


def _hits(data: TimeResponses, model: ModalModel, evidence: Evidence) -> list[tuple[str, bool]]:
    """What the number of initial conditions lets be said."""
    apart = int((model.multipliers.imag >= 0).sum()) - len(evidence.multipliers)
    if data.n_inputs == 1:
        return [("With one initial condition, modes of equal multipliers are seen as one.", False)]
    if apart > 0:
        count = "One multiplier is" if apart == 1 else f"{apart} multipliers are"
        return [(f"{count} that of two modes or more: the residues of the {data.n_inputs} hits have that rank.", False)]
    return [("No two modes share a multiplier: the residues are outer products of shape and hit.", False)]


def _frequency(multiplier: complex) -> str:
    if multiplier.imag == 0.0:
        return "the real multiplier " + f"{multiplier.real:.4g}"
    share = abs(np.angle(multiplier)) / (2.0 * np.pi)
    return f"the mode folded to {share:.4f} of ω"


def _weakest(evidence: Evidence) -> tuple[str, bool]:
    share = evidence.rises / evidence.limits
    weakest = int(np.argmin(share))
    name = _frequency(complex(evidence.multipliers[weakest]))
    needed = bool(share[weakest] >= 1.0)
    only_just = needed and bool((evidence.rises < evidence.firm_limits).any())
    text = (
        f"{'Each' if needed else 'Not each'} of the {len(share)} modes is needed: without the one that would be missed "
        f"least, {name}, the misfit rises by {share[weakest]:.3g} times what noise explains"
    )
    return text + (": only just more." if only_just else "."), only_just or not needed


def _determined(evidence: Evidence) -> tuple[str, bool]:
    worst = evidence.deviations.max(axis=1)
    weak = worst > DETERMINED
    if not weak.any():
        return "Each mode is well determined.", False
    name = _frequency(complex(evidence.multipliers[int(np.argmax(worst))]))
    text = f"{int(weak.sum())} of the modes are weakly determined, {name} most: each may stand for several."
    return text, True


def _nearness(evidence: Evidence) -> list[tuple[str, bool]]:
    r"""How near two modes may be and still be seen as one, by the mode that is shown best and has no near neighbour.

    A pair of like strength and unlike shapes, Δ half-power widths apart, leaves about (Δ/2)² of the rise of one of them
    when it is fitted as one mode: to first order it is seen where :math:`\Delta > 2 \sqrt{\ell / \text{rise}}`.
    """
    logs = np.asarray(np.log(evidence.multipliers), np.complex128)
    distance = np.abs(np.subtract.outer(logs, logs)) + np.diag(np.full(len(logs), np.inf))
    share = evidence.rises / evidence.limits
    alone = (distance.min(axis=1) > 2.0 * np.abs(logs.real)) & (share > 0.0)
    if not alone.any():
        return []
    widths = 2.0 / np.sqrt(share[alone].max())
    text = f"Two modes nearer to each other than about {widths:.2g} half-power widths would be seen as one"
    return [(f"{text}, weaker ones than the strongest here from farther away.", False)]


def _residual(evidence: Evidence) -> tuple[str, bool]:
    if abs(evidence.colour) > WHITE:
        text = f"What is left is not white noise ({evidence.colour:.3g} standard deviations from it)"
        return text + ": modes may be missing, or some that were found may be noise.", True
    how = f"white once {evidence.whitened} taps have taken its colour off" if evidence.whitened else "white noise"
    worth = (
        "" if evidence.independent > 0.9 else f"; its responses are worth {evidence.independent:.0%} of their number"
    )
    return f"What is left is {how} ({evidence.colour:.2g} standard deviations from it){worth}.", False
