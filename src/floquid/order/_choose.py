"""Order selection: the order that the data support, the reasons, and the doubts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from floquid._arrays import Complexes, Floats
from floquid._show import Brief
from floquid.findings import Finding, Severity, note, texts, warning
from floquid.fit import DEVIATIONS
from floquid.lti import (
    COLOURED,
    AbstractIdentifier,
    Ensemble,
    Evidence,
    MaximumLikelihood,
    ModalModel,
    Outcome,
    TimeResponses,
)

DETERMINED = 2e-3 * 2.0 * np.pi
"""The standard deviation of a decay or an angle above which a mode may stand for several [rad/sample]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Choice(Brief):
    """An order with its reasons.

    Parameters
    ----------
    order
        The number of poles, conjugates one by one.
    model
        The model of that order.
    findings
        What speaks for it (notes), and against it (warnings); with any of the latter, the order is ambiguous.
    runner_up
        The neighbouring model that comes nearest: one mode less or one more; None where there is none, and in a result
        read from a file.
    evidence
        The numbers behind the sentences; None in a result read from a file.
    """

    order: int
    model: ModalModel
    findings: tuple[Finding, ...]
    runner_up: ModalModel | None = None
    evidence: Evidence | None = None

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons for the order, a sentence each."""
        return texts(self.findings, Severity.NOTE)

    @property
    def doubts(self) -> tuple[str, ...]:
        """Reasons against the order, a sentence each."""
        return texts(self.findings, Severity.WARNING)

    @property
    def ambiguous(self) -> bool:
        """True where another order could be right too."""
        return bool(self.doubts)


def choose(
    data: TimeResponses, identifier: AbstractIdentifier | None = None, *, report: Callable[[str], None] = lambda _: None
) -> Choice:
    r"""The order that the data support.

    A mode stays when the cost (the sum of squares left, over the noise) would rise without it, all others fitted again,
    by more than noise explains; none is added that takes less out. As an information criterion this is

    .. math:: J(n) = \operatorname{cost}(n) + \sum_{\text{modes}} \ell(\text{mode})

    with the limit ℓ of an F test at the false-alarm probability as the penalty of a mode. The choice is ambiguous when
    a neighbouring order is nearly as good, or modes are hardly determined. So it is when they move as one more is
    added, or the residual is not white noise. `data` are the responses and their noise, `report` is told of each stage,
    and `identifier` finds the poles, by default `MaximumLikelihood()`; one that does not decide the order is the start
    of maximum likelihood.
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
    findings = _findings(evidence)
    # A random walk looks like modes that hardly change over the record.
    change = np.abs(np.log(evidence.multipliers)) * int(data.lengths.max())
    still = int((change < 2.0 * np.pi).sum()) if evidence.whitened else 0
    if still:
        findings.append(warning("modes_or_drift", number=still))
    apart = int((model.multipliers.imag >= 0).sum()) - len(evidence.multipliers)
    if data.n_inputs == 1:
        findings.append(note("one_initial_condition"))
    elif apart > 0:
        findings.append(note("shared_multipliers", number=apart, hits=data.n_inputs))
    else:
        findings.append(note("no_shared_multipliers"))
    if model.outcome is not Outcome.SUCCESS:
        findings.append(warning(model.outcome.value))
    # The neighbour whose criterion is nearest is the runner-up.
    below = float((evidence.rises - evidence.limits).min()) if len(evidence.rises) else np.inf
    above = evidence.gain_limit - evidence.gain
    first, second = (evidence.less, evidence.more) if below < above else (evidence.more, evidence.less)
    return Choice(
        order=model.order, model=model, findings=tuple(findings), runner_up=first or second, evidence=evidence
    )


def judge_products(data: TimeResponses, model: ModalModel, identifier: Ensemble) -> Choice:
    """The order of a `model` of outer products, by what its modes explain in the responses of all hits in `data`."""
    weighed = identifier.weigh(identifier.prepare(data), model)
    findings = [_weakest(*weighed), note("no_shared_multipliers")]
    if model.outcome is not Outcome.SUCCESS:
        findings.append(warning(model.outcome.value))
    return Choice(order=model.order, model=model, findings=tuple(findings))


def _findings(evidence: Evidence) -> list[Finding]:
    """Findings of the modes, their neighbours and the residual on the order."""
    found = []
    if len(evidence.rises):
        weighed = (evidence.multipliers, evidence.rises, evidence.limits, evidence.firm_limits)
        found += [_weakest(*weighed), _determined(evidence), *_nearness(evidence)]
    if np.isfinite(evidence.gap):
        near = evidence.gap < DEVIATIONS
        found.append((warning if near else note)("nearest_modes", gap=evidence.gap, near=near))
    doubtful = evidence.gain > evidence.doubtful_gain
    share = evidence.gain / evidence.gain_limit
    found.append((warning if doubtful else note)("further_mode", share=share, doubtful=doubtful))
    if evidence.moved > DEVIATIONS and doubtful:
        found.append(warning("modes_move", moved=evidence.moved))
    if abs(evidence.colour) > COLOURED:
        return [*found, warning("not_white", colour=evidence.colour)]
    return [*found, note("white", colour=evidence.colour, taps=evidence.whitened, independent=evidence.independent)]


def _mode(multiplier: complex) -> dict[str, Any]:
    """A multiplier that is real, else None; and the angle of it over 2π."""
    real = float(multiplier.real) if multiplier.imag == 0.0 else None
    return {"real": real, "share": float(abs(np.angle(multiplier))) / (2.0 * np.pi)}


def _weakest(multipliers: Complexes, rises: Floats, limits: Floats, firm_limits: Floats) -> Finding:
    share = rises / limits
    weakest = int(np.argmin(share))
    needed = bool(share[weakest] >= 1.0)
    just = needed and bool((rises < firm_limits).any())
    return (warning if just or not needed else note)(
        "modes_needed",
        needed=needed,
        modes=len(share),
        rise=share[weakest],
        just=just,
        **_mode(complex(multipliers[weakest])),
    )


def _determined(evidence: Evidence) -> Finding:
    worst = evidence.deviations.max(axis=1)
    weak = int((worst > DETERMINED).sum())
    if not weak:
        return note("well_determined")
    return warning("hardly_determined", number=weak, **_mode(complex(evidence.multipliers[int(np.argmax(worst))])))


def _nearness(evidence: Evidence) -> list[Finding]:
    r"""Distance within which two modes are seen as one, by the mode that is shown best and has no near neighbour.

    A pair of like strength and unlike shapes, Δ half-power widths apart, leaves about (Δ/2)² of the rise of one of them
    when it is fitted as one mode: to first order it is seen where :math:`\Delta > 2 \sqrt{\ell / \text{rise}}`.
    """
    logs = np.asarray(np.log(evidence.multipliers), np.complex128)
    distance = np.abs(np.subtract.outer(logs, logs)) + np.diag(np.full(len(logs), np.inf))
    share = evidence.rises / evidence.limits
    alone = (distance.min(axis=1) > 2.0 * np.abs(logs.real)) & (share > 0.0)
    return [note("resolution", widths=2.0 / np.sqrt(share[alone].max()))] if alone.any() else []
