"""A check, what it notes on the way, and the loop that runs the list of checks on a model of any kind of record."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Floats, Mask
from floquid.checks._types import Criterion, Validation
from floquid.findings import Finding, failure, warning
from floquid.fit import is_vague
from floquid.innovations import GONE

FAINT = 0.1  # the amplitude of what is left, over the noise, that is let pass in any case
MISFIT = 1.3  # times the noise that a fit may leave: its level is an estimate
REMAINDER = 0.05  # the share of the response, in amplitude, that a model may leave beyond the noise and still pass


@dataclass(slots=True)
class Evidence:
    """Numbers with their limits, findings and arrays, gathered by one check after another."""

    metrics: dict[str, float] = field(default_factory=dict)
    criteria: dict[str, Criterion] = field(default_factory=dict)
    findings: list[Finding] = field(default_factory=list)
    arrays: dict[str, NDArray] = field(default_factory=dict)
    remainder: float = 0.0
    hidden: Mask | bool = False  # responses with a line of their own, whose colour is that line (channels, hits)

    def kept(
        self, name: str, value: float, limit: float, *, at_least: bool = False, failing: float | None = None
    ) -> bool:
        """True where a number keeps to its limit, both noted; also where it is none, which is a finding of its own."""
        self.criteria[name] = Criterion(limit=limit, at_least=at_least, failing=failing)
        if not np.isfinite(value):
            self.findings.append(failure("overflow", name=name))
            return True
        self.metrics[name] = float(value)
        return self.criteria[name].met(value)

    def against(self, code: str, *names: str, share: float = 0.0, **numbers: Any) -> tuple[Finding]:
        """Finding by the checks of these names, which leave a share of the response; a failure if that is too much."""
        self.remainder = max(self.remainder, share)
        known = [name for name in names if name in self.metrics]
        failed = share > REMAINDER or any(self.criteria[name].failed(self.metrics[name]) for name in known)
        return ((failure if failed else warning)(code, **numbers),)

    def missing(self, names: dict[str, float], why: Finding) -> tuple[Finding]:
        """Finding on numbers that could not be computed, their limits noted."""
        self.criteria.update({name: Criterion(limit=limit) for name, limit in names.items()})
        return (why,)

    def verdict(self, shape: tuple[int, int]) -> Validation:
        """Verdict by all that was noted, for these numbers of channels and hits."""
        nothing = np.full(shape, np.nan)
        none: dict[str, Any] = {"fit": nothing, "held_out_error": nothing, "colour": nothing}
        none |= {"tones": np.zeros((*shape, 0)), "lines": np.zeros((*shape, 0))}
        failed = any(
            criterion.failed(self.metrics[name]) for name, criterion in self.criteria.items() if name in self.metrics
        )
        return Validation(
            metrics=self.metrics,
            criteria=self.criteria,
            passed=bool(self.criteria) and set(self.metrics) == set(self.criteria) and not failed,
            findings=tuple(self.findings),
            **(none | self.arrays),
        )


@dataclass(frozen=True, slots=True)
class Check:
    """One question about a model.

    Parameters
    ----------
    name, question
        Its name, and what it asks, in words.
    needs
        The method of a kind of record that answers it: a kind without it is not asked.
    look
        The function of a model with its records, and of what was noted so far, that returns findings; None where the
        method does.
    """

    name: str
    question: str
    needs: str
    look: Callable[[Any, Evidence], Iterable[Finding]] | None = None

    def answered(self, kind: type[Subject]) -> bool:
        """True where a kind of record can answer."""
        return hasattr(kind, self.needs)


class Subject:
    """A model with the records that it is of, as checks ask it."""

    of_verdict: ClassVar[frozenset[str]] = frozenset()
    """Names of the checks that make its verdict; the others find what makes a model wrong, also without one."""

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of channels and of hits."""
        raise NotImplementedError


def looked_at(subject: Subject, checks: Sequence[Check], *, verdict: bool) -> Evidence:
    """The evidence by the checks that the verdict on a model is of, or by all others."""
    evidence, kind = Evidence(), type(subject)
    for check in checks:
        if check.answered(kind) and (check.name in kind.of_verdict) is verdict:
            look = check.look or (lambda asked, _, name=check.needs: getattr(asked, name)())
            evidence.findings += look(subject, evidence)
    return evidence


def is_undetermined(std: Floats, decay: Floats, period: float) -> Mask:
    """True of decays that are told neither from none nor to a neper a period.

    Real multipliers that make up for one another, or for a pair, are of that kind; one of slow decay is not.
    """
    return is_vague(std, decay) & is_vague(std * period, GONE)


def strongest(sizes: np.ndarray) -> list[tuple[int, ...]]:
    """The indices of what is above zero, the largest first."""
    places = np.argwhere(sizes > 0)
    order = np.argsort(-1.0 * sizes[tuple(places.T)], kind="stable")
    return [tuple(int(i) for i in places[k]) for k in order]
