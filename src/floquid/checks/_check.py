"""A check, what it notes on the way, the loop over the list of checks, and the verdict with its reasons."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Floats, Integers, Mask
from floquid._checks import Rebuilt, finite, input_error
from floquid.findings import Finding, failure, texts, warning
from floquid.fit import is_vague
from floquid.innovations import GONE


@dataclass(frozen=True, slots=True, kw_only=True)
class Criterion:
    """The limit of a number.

    Raises InputError where the limit is not a finite number.

    Parameters
    ----------
    limit, at_least
        The most allowed, in the unit of the number; with `at_least`, the least.
    failing
        The number beyond which the model fails: up to there it passes with a remainder. None fails it beyond the limit.
    """

    limit: float
    at_least: bool = False
    failing: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "limit", finite(self.limit, "limit", "Criterion"))

    def met(self, value: float) -> bool:
        """True where `value` keeps to the limit."""
        return value >= self.limit if self.at_least else value <= self.limit

    def failed(self, value: float) -> bool:
        """True where `value` is beyond what a model may leave and still pass."""
        bound = self.limit if self.failing is None else self.failing
        return value < bound if self.at_least else value > bound


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Validation(Rebuilt):
    """The verdict on a model.

    Raises InputError where shapes do not belong together, or a criterion has no number.

    Parameters
    ----------
    metrics
        Numbers by name, as `docs/verdict.md` has them; one that could not be computed is absent, and a reason says why.
        `mode`: the power of the weakest mode over the most that a fit makes of noise. `misfit`: what the fit leaves
        over the level of its noise. `remainder`: the largest share of the response, in amplitude, that is left.
    criteria
        The limit of each of them.
    passed
        Whether no number is beyond what fails a model, and none is missing: it passes with a remainder where one is
        beyond its limit (`unmet`).
    findings
        What speaks against the model: failures, and warnings of what is left of the response where it passes.
    fit, held_out_error
        The share of the response of each channel and hit that the model predicts on held-out cycles, and the rms of the
        prediction error over the noise (channels, hits); NaN where not computed, or the channel shows no response.
    colour
        The sum of squared autocorrelations of what the model leaves, less what white noise has (channels, hits).
    turns, tones
        The harmonics of the period at which tones were looked for (tones,), 1/2 being half its frequency; the amplitude
        left at each, over the noise (channels, hits, tones).
    modes, harmonics, lines
        The mode of the model and the harmonic outside its band that were looked for (lines,); what is left there, in
        standard deviations (channels, hits, lines).
    """

    metrics: Mapping[str, float]
    criteria: Mapping[str, Criterion]
    passed: bool
    findings: tuple[Finding, ...]
    fit: Floats
    held_out_error: Floats
    colour: Floats
    turns: Floats = field(default_factory=lambda: np.zeros(0))
    tones: Floats
    modes: Integers = field(default_factory=lambda: np.zeros(0, np.int64))
    harmonics: Integers = field(default_factory=lambda: np.zeros(0, np.int64))
    lines: Floats

    def __post_init__(self) -> None:
        of, put = "Validation", object.__setattr__
        self._freeze(missing=True, fit=("channels", "hits"))
        self._freeze(turns=("tones",))
        self._freeze(dtype=np.int64, modes=("lines",))
        rows, lines = self.fit.shape, len(self.modes)
        self._freeze(dtype=np.int64, harmonics=(lines,))
        self._freeze(missing=True, held_out_error=rows, colour=rows)
        self._freeze(missing=True, tones=(*rows, len(self.turns)), lines=(*rows, lines))
        if set(self.metrics) - set(self.criteria):
            got = f"{sorted(set(self.metrics) - set(self.criteria))} have none"
            raise input_error("criteria", of, "have a limit for each of the metrics", got)
        put(self, "metrics", MappingProxyType({name: float(value) for name, value in self.metrics.items()}))
        put(self, "criteria", MappingProxyType(dict(self.criteria)))

    def __repr__(self) -> str:
        return f"Validation(passed={self.passed}, unmet={self.unmet}, metrics={len(self.metrics)})"

    @property
    def answer(self) -> str:
        """The verdict: "passes", "passes with a remainder of" a share of the response [%, amplitude], or "fails"."""
        if not self.passed:
            return "fails"
        if not self.findings or "remainder" not in self.metrics:  # no share is known where excitation goes on
            return "passes"
        share = 100.0 * self.metrics["remainder"]
        return f"passes with a remainder of {f'{share:.2g}' if share >= 0.1 else 'less than 0.1'} %"

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons against the model and what to do, a sentence each; empty where nothing is left."""
        return texts(self.findings)

    @property
    def unmet(self) -> tuple[str, ...]:
        """The names of the criteria that are not met, or have no number."""
        values = self.metrics
        return tuple(n for n, criterion in self.criteria.items() if n not in values or not criterion.met(values[n]))


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
    """True of decays that are told neither from none nor to a neper a period."""
    # Real multipliers that make up for one another, or for a pair, are of that kind; one of slow decay is not.
    return is_vague(std, decay) & is_vague(std * period, GONE)


def strongest(sizes: np.ndarray) -> list[tuple[int, ...]]:
    """The indices of what is above zero, the largest first."""
    places = np.argwhere(sizes > 0)
    order = np.argsort(-1.0 * sizes[tuple(places.T)], kind="stable")
    return [tuple(int(i) for i in places[k]) for k in order]
