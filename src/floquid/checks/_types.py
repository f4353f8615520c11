"""The result of a validation: numbers, their limits, a verdict and its reasons."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from floquid._arrays import Floats, Integers
from floquid._checks import Rebuilt, finite, input_error
from floquid.findings import Finding, texts


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
