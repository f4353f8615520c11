"""The parametric bootstrap: how estimates spread when the experiment is done again, by doing it again."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import ClassVar

import numpy as np
from numpy.random import SeedSequence
from numpy.typing import NDArray

from floquid._arrays import Integers, Mask
from floquid._bar import bar
from floquid._checks import Rebuilt, integer, wrong_value
from floquid._show import Told
from floquid.errors import IdentificationError
from floquid.findings import Finding, note, texts, warning
from floquid.pipeline._analysis import Analysis
from floquid.pipeline.draws._redraw import Draw, Redrawn, drawn, redrawn
from floquid.pipeline.draws._spread import MATERIAL, DrawFile, Spread

OF = "bootstrap"

FAMILY_WISE = 0.01  # probability at which the verdict is against deviations that are right, over all elements together
FEWEST = 20  # draws below which nothing can be said of a deviation


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Bootstrap(Told, Rebuilt):
    """Result of `bootstrap`: the spread of each quantity, its elements as in the `PeriodicModel` or `StateModel`.

    Parameters
    ----------
    exponents, multipliers
        λ (modes,) [1/s] and e^{λT} (modes,).
    frequencies_hz, damping_ratios
        (modes,) [Hz] and (modes,).
    coefficients
        B (modes, channels, hits, harmonics) [units of the channels]; zero where the model keeps none.
    period
        The period [s]; None where it was given.
    system, transition, inputs
        A(t) and Φ(t, t0) (times, n, n), and B(t) of measured inputs (times, n, inputs); None where there is none.
    n_draws, seed
        How many draws were asked for, and the seed.
    orders
        The order of each draw (draws,); zero where it failed.
    failures
        Why draws failed, a sentence each (failed draws,).
    whole
        Whether each draw was identified from the beginning.
    """

    kind: ClassVar[str] = "bootstrap"  # by it the functions for a result are found
    exponents: Spread
    multipliers: Spread
    frequencies_hz: Spread
    damping_ratios: Spread
    coefficients: Spread
    period: Spread | None
    system: Spread | None
    transition: Spread | None
    inputs: Spread | None
    n_draws: int
    seed: int
    orders: Integers
    failures: tuple[str, ...]
    whole: bool

    def __repr__(self) -> str:
        return f"Bootstrap(n_draws={self.n_draws}, n_used={self.n_used}, seed={self.seed}, whole={self.whole})"

    @property
    def quantities(self) -> tuple[Spread, ...]:
        """The spreads that there are."""
        values = (getattr(self, field.name) for field in fields(self))
        return tuple(value for value in values if isinstance(value, Spread))

    @property
    def n_used(self) -> int:
        """The draws that the spreads are of: those that did not fail, and that have the order drawn from."""
        return len(self.exponents.draws)

    @property
    def failure_counts(self) -> tuple[tuple[str, int], ...]:
        """Reasons of failed draws with their counts, largest first; those that differ in numbers alone are one."""
        alike: dict[str, list[str]] = {}
        for words in self.failures:
            alike.setdefault(re.sub(r"\d+", "", words), []).append(words)
        return tuple((own[0], len(own)) for own in sorted(alike.values(), key=len, reverse=True))

    @property
    def doubtful(self) -> dict[str, Mask]:
        """Elements of `Spread.ratios` that differ from one by more than chance, by quantity; those alone that have any.

        Together, over all quantities, right deviations are found wrong with a probability of at most `FAMILY_WISE`
        (Bonferroni).
        """
        chances = {spread.name: spread.chances() for spread in self.quantities}
        level = FAMILY_WISE / max(sum(len(own) for own in chances.values()), 1)
        return {name: own < level for name, own in chances.items() if (own < level).any()}

    @property
    def holds(self) -> bool | None:
        """True where the asymptotic deviations hold; None where there are none to compare with."""
        if not any(len(spread.ratios()) for spread in self.quantities):
            return None
        return not self.doubtful

    @property
    def reasons(self) -> tuple[str, ...]:
        """The verdict, a sentence each: deviations, bias, draws that failed, orders."""
        return texts(self.findings)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """The verdict: deviations, bias, draws that failed, orders."""
        return (self._on_deviations(), *self._on_bounds(), *self._on_bias(), *self._on_draws())

    def _on_deviations(self) -> Finding:
        tested, error = sum(len(spread.ratios()) for spread in self.quantities), self.exponents.sampling_error
        doubtful = self.doubtful
        if not tested:
            return note("no_deviations")
        if not doubtful:
            return note("deviations_hold", tested=tested, draws=self.n_used, error=error)
        ratios = {spread.name: spread.ratios() for spread in self.quantities}
        worst = [ratios[name][wrong] for name, wrong in doubtful.items()]
        return warning(
            "deviations_wrong",
            names=list(doubtful),
            wrong=[len(own) for own in worst],
            elements=[len(ratios[name]) for name in doubtful],
            least=[own.min() for own in worst],
            most=[own.max() for own in worst],
            right=[name for name, own in ratios.items() if name not in doubtful and len(own)],
            error=error,
        )

    def _on_bounds(self) -> list[Finding]:
        """Finding on deviations that exceed the spread of the draws."""
        wide = {}
        for spread in self.quantities:
            ratios = spread.ratios()
            if spread.bound and (spread.spare() < FAMILY_WISE / max(len(ratios), 1)).any():
                wide[spread.name] = np.median(1.0 / ratios)
        numbers = {"names": list(wide), "ratios": list(wide.values()), "misfit": self.exponents.bound}
        return [note("deviations_wide", **numbers)] if wide else []

    def _on_bias(self) -> list[Finding]:
        from scipy.special import ndtri

        # Of a bound, the bias is compared with it together with the spread.
        biases = {spread.name: np.abs(spread.biases()) for spread in self.quantities if not spread.bound}
        count = sum(len(own) for own in biases.values())
        chance = -float(ndtri(0.5 * FAMILY_WISE / max(count, 1))) / np.sqrt(self.n_used)
        large = {name: own[own > MATERIAL + chance] for name, own in biases.items()}
        names = [name for name, own in large.items() if len(own)]
        if not names:
            return []
        most, elements = [large[name].max() for name in names], [len(biases[name]) for name in names]
        return [warning("bias", names=names, large=[len(large[n]) for n in names], elements=elements, most=most)]

    def _on_draws(self) -> list[Finding]:
        found = []
        if self.failures:
            errors, numbers = zip(*self.failure_counts[:3], strict=True)
            failed = len(self.failures)
            found.append(warning("draws_failed", failed=failed, draws=self.n_draws, numbers=numbers, errors=errors))
        if self.whole:
            orders, numbers = np.unique(self.orders[self.orders > 0], return_counts=True)
            found.append(note("draws_orders", draws=self.n_draws, same=self.n_used, orders=orders, numbers=numbers))
        return found


def bootstrap(
    analysis: Analysis,
    *,
    draws: int = 200,
    seed: int = 0,
    whole: bool = False,
    workers: int | None = None,
    kept: DrawFile | None = None,
    progress: bool = False,
    report: Callable[[str], None] = lambda _: None,
) -> Bootstrap:
    r"""Spread of the estimates over records that are drawn from the model.

    .. math:: y^{(b)}_{c,h}(t_n) = \hat y_{c,h}(t_n) + \hat\sigma_{c,h}\, e^{(b)}_{c,h,n}, \qquad b = 1 \dots B

    with ŷ the fitted response, with harmonics that the model does not keep, at the samples of the record. e is white
    noise of unit variance, or coloured by the inverse of the whitening filter (Efron and Tibshirani 1993, "An
    Introduction to the Bootstrap", section 6.5). Measured inputs are those of the record; of outputs alone the
    innovations are drawn, with their covariance along the period, and go through the model. In each draw the same modes
    with the same bands are fitted anew, from the model on. A(t) is built from that fit as the analysis built it, with
    its structure. What the draws show of the deviations that the fit itself gave is said in words: those are right to
    first order in the noise alone. The deviations of A(t), Φ and B(t) without a structure also count the harmonics that
    are left out, which are in no draw: the draws may spread less than these, but not more. Returns the spread of each
    quantity, and the verdict.

    Raises InputError where an argument is not possible, the processes cannot be started or die, or the draws cannot be
    kept; IdentificationError where fewer than two draws give the order drawn from, or the model fails.

    Parameters
    ----------
    analysis
        What `identify` found, or `load` read.
    draws
        B, at least 20. A deviation is then known to 1/√(2B): 5 % of 200 draws.
    seed
        The seed of the noise. Each draw has its own stream, spawned from it.
    whole
        Identify each draw from the beginning instead: order, noise and bands too. Modes are compared in the draws that
        have the same order; how often that is, is said.
    workers
        How many processes share the draws; None for one a processor. The result does not depend on it.
    kept
        Where draws that are done are kept (`DrawFile`), so that a run that is cut short is gone on with.
    progress
        Whether a progress bar is drawn on stderr, if that is a terminal.
    report
        Is told of each draw that is done.
    """
    if not isinstance(analysis, Analysis):
        raise wrong_value("analysis", OF, "be a result of `identify`", analysis, "Pass what `identify` gave.")
    if analysis.failed:
        raise IdentificationError(f"{analysis.warnings[0]}\n  Records drawn from it say nothing of how far off it is.")
    count = integer(draws, "draws", OF, at_least=FEWEST, remedy="A deviation of so few draws says nothing.")
    first = integer(seed, "seed", OF, at_least=0)
    if not isinstance(whole, (bool, np.bool_)):
        raise wrong_value("whole", OF, "be true or false", whole)
    several = _processors() if workers is None else integer(workers, "workers", OF, at_least=1)
    plan = redrawn(analysis, whole=bool(whole))
    seeds = SeedSequence(first).spawn(count)
    # Each draw has its own stream, whatever the number of draws: those of a shorter run are the first of a longer one.
    found = [] if kept is None else _fitting(kept.read(), plan)[:count]
    with bar(progress, report) as told:
        told(f"drawing: {len(found)} of {count}")
        try:
            for one in drawn(plan, seeds[len(found) :], min(several, count)):
                found.append(one)
                told(f"drawing: {len(found)} of {count}")
                if kept is not None:
                    kept.keep(found)
        except BaseException:
            if kept is not None and found:
                kept.write(found)
            raise
    return _gathered(analysis, plan, found, first)


def _fitting(draws: list[Draw], plan: Redrawn) -> list[Draw]:
    """The draws, if they can be of this plan."""
    shapes = (plan.model.exponents.shape, plan.model.coefficients.shape, bool(plan.states), bool(plan.states))
    for one in draws:
        if one.exponents is None:
            continue
        own = (
            one.exponents.shape,
            None if one.coefficients is None else one.coefficients.shape,
            one.system is not None,
            one.transition is not None,
        )
        if own != shapes:
            return []
    return draws


def _processors() -> int:
    """The processors that this process may use."""
    affinity = getattr(os, "sched_getaffinity", None)
    return (len(affinity(0)) if affinity is not None else os.cpu_count()) or 1


def _gathered(analysis: Analysis, plan: Redrawn, found: Sequence[Draw], seed: int) -> Bootstrap:
    """The draws together."""
    model, state = analysis.model, analysis.state
    used = [one for one in found if one.exponents is not None]
    failures = tuple(one.failure for one in found if one.failure)
    if len(used) < 2:
        why = f" {Counter(failures).most_common(1)[0][0]}" if failures else ""
        raise IdentificationError(
            f"Of {len(found)} records drawn from the model, {len(used)} gave its order again: nothing can be said of "
            f"its deviations.{why}"
        )
    exponents = np.array([one.exponents for one in used])
    periods = np.array([one.period for one in used])
    size = np.abs(exponents)
    damping = np.divide(-np.real(exponents), size, out=np.zeros_like(size), where=size > 0)
    upper = np.isin(np.arange(model.order), model.upper_modes)
    period_std = plan.period_std
    bent = plan.widened

    def spread(name: str, unit: str, estimate: NDArray, values: NDArray, std: NDArray | None, own: NDArray) -> Spread:
        return Spread(name=name, unit=unit, estimate=estimate, draws=values, asymptotic=std, distinct=own, bound=bent)

    def of_state(name: str, unit: str) -> Spread | None:
        estimate = None if state is None else getattr(state, name)
        if state is None or estimate is None:
            return None
        values = np.array([getattr(one, name) for one in used])
        # The deviations of the free A(t) also count the harmonics left out, those of a found structure what it hides;
        # B(t) is that of the free shapes with a structure, too.
        return replace(
            spread(name, unit, estimate, values, getattr(state, f"{name}_std"), np.array(True)),
            bound=bent or name == "inputs" or analysis.refinement is None or bool(analysis.refinement.findings),
        )

    return Bootstrap(
        exponents=spread("exponents", "1/s", model.exponents, exponents, model.exponent_std, upper),
        multipliers=spread(
            "multipliers", "", model.multipliers, np.exp(exponents * periods[:, None]), model.multiplier_std, upper
        ),
        frequencies_hz=spread(
            "frequencies_hz", "Hz", model.frequencies_hz, size / (2.0 * np.pi), model.frequency_std_hz, upper
        ),
        damping_ratios=spread("damping_ratios", "", model.damping_ratios, damping, model.damping_ratio_std, upper),
        coefficients=spread(
            "coefficients",
            "that of the channel",
            model.coefficients,
            np.array([one.coefficients for one in used]),
            model.coefficient_std,
            upper[:, None, None, None],
        ),
        period=None
        if period_std is None
        else spread("period", "s", np.array(model.period), periods, np.array(period_std), np.array(True)),
        system=of_state("system", "1/s in the units of the states"),
        transition=of_state("transition", ""),
        inputs=of_state("inputs", "1/s in the units of the states over those of the inputs"),
        n_draws=len(found),
        seed=seed,
        orders=np.array([one.order for one in found], np.int64),
        failures=failures,
        whole=plan.whole,
    )
