"""One draw of a bootstrap: records made of the model and noise, and what is found in them; many in processes."""

from __future__ import annotations

import pickle
import signal
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.random import SeedSequence

from floquid._arrays import Complexes, Floats
from floquid._checks import Rebuilt, input_error
from floquid.core import ConstantPeriod, Estimates, PeriodicModel, PhaseClock, Record
from floquid.errors import FloquidError, IdentificationError
from floquid.findings import failure
from floquid.fit import CHUNK, HALF_DIGITS
from floquid.lifting import Lifted, lift, whitened
from floquid.lti import MaximumLikelihood, ModalModel, Outcome
from floquid.periodic import assemble, estimate_at, instants, refit
from floquid.pipeline._analysis import Analysis
from floquid.pipeline._deviations import Again, Driven, state_of, widening_of
from floquid.pipeline._identify import identify
from floquid.pipeline.draws._plan import aligned, choices_of, selected, with_all_fitted, without_states
from floquid.pipeline.free import again_of, by_cycles, samples_of, why_sampled
from floquid.preparation import Settings
from floquid.sync import segment


@dataclass(frozen=True, slots=True)
class Draw(Rebuilt):
    """Estimates of one draw, in the order of the modes drawn from; the order alone where that is another.

    Parameters
    ----------
    order
        The order that was found; zero where the draw failed.
    exponents, coefficients
        λ (modes,) [1/s] and B (modes, channels, hits, harmonics) [units of the channels].
    period
        The period [s].
    system, transition, inputs
        A(t) and Φ(t, t0) (times, n, n), and B(t) of measured inputs (times, n, inputs); None where there is none.
    failure
        Why the draw failed; empty where it did not.
    """

    order: int
    exponents: Complexes | None = None
    coefficients: Complexes | None = None
    period: float = 0.0
    system: Floats | None = None
    transition: Floats | None = None
    inputs: Floats | None = None
    failure: str = ""


@dataclass(frozen=True, slots=True)
class Plan:
    """Draws of free responses: all that one needs beside its seed."""

    model: PeriodicModel  # the model drawn from, without its joint covariance
    fitted: PeriodicModel
    """Model with every harmonic that was fitted, also those that it does not keep: where fits start."""
    built: PeriodicModel  # the same with the harmonics alone that A(t) was built from
    states: tuple[str, ...]  # names of the states of A(t); none where there is no A(t)
    settings: Settings  # without states where there is no A(t); with the structure and the delay that were found
    clean: tuple[Floats, ...]
    """Response of all that was fitted in each record (channels, samples), NaN where a sample is missing."""
    noise: Floats  # (channels, hits)
    whole: bool
    estimated: bool
    """True where the model has the joint covariance of its coefficients, as those of draws should then have."""
    free_period: bool  # true where the period is fitted too
    one_shape: bool  # true where all hits share the shapes of the modes
    lifted: Lifted | None
    """The lifted responses, where they hold all that was fitted: then a fit of them is the cheaper one."""
    modal: ModalModel | None  # the modal model, where residues were left free
    whitening: Floats | None  # filter of each channel that makes its noise white; `noise` is that after it
    records: tuple[Record, ...]
    """The records that draws take the place of: with their clocks' channels for `whole`, without otherwise."""
    rows: tuple[tuple[int, ...], ...]  # the rows of `records` that are responses
    clocks: tuple[PhaseClock, ...]  # clock of each record
    period_std: float | None  # the deviation of the period [s]; None where it is not fitted
    widened: bool  # whether the deviations hold what is left beside noise, which is in no draw

    def redone(self, generator: np.random.Generator) -> Draw:
        """Identify records drawn from the model."""
        values = noisy(self, generator)
        return _identified(self, values) if self.whole else _fitted(self, values)


def plan_of(analysis: Analysis, whole: bool) -> Plan:
    """The plan of an analysis of free responses."""
    decay = analysis.decay
    assert decay is not None
    model, fit, shafts = analysis.model, decay.fit, analysis.shafts
    bare = replace(model, covariance=None, estimates=None, unselected=None)
    # Free residues have no harmonics to hold: then the poles are refined, and the shapes expanded again. All that was
    # fitted is drawn from: of a weak mode, what is not kept may be much of what the record says.
    fitted = bare if not fit.constrained or model.estimates is None else with_all_fitted(model)
    measured = samples_of(analysis.records, shafts) if whole and fit.constrained else fit.free
    clean = []
    for hit, (record, clock, seen) in enumerate(zip(fit.free, analysis.clocks, measured, strict=True)):
        own = _response(fitted, hit, *instants(record, clock, model.fundamental))
        # The forced response as it was found, wherever the speed took it; NaN where a sample is missing.
        clean.append(own + (seen.values - record.values))
    records = analysis.records if whole and why_sampled(fit, shafts) else fit.free
    # Draws of the modes alone would not know a period that the steady response told.
    steady = not whole and fit.forced is not None and len(fit.forced.harmonics) > 0
    free_period, clocks = fit.period_std is not None and not steady, analysis.clocks
    if fit.period_std is not None and steady:
        # Phases count from where they did by the first value.
        zeros = (clock.phase_zero(own.start) for clock, own in zip(clocks, fit.free, strict=True))
        clocks = tuple(ConstantPeriod(period=model.period, origin=zero) for zero in zeros)
    names = {channel.name for channel in model.channels}
    return Plan(
        model=bare,
        fitted=fitted,
        **choices_of(analysis, bare),
        clean=tuple(clean),
        noise=fit.noise,
        whole=whole,
        estimated=model.estimates is not None,
        free_period=free_period,
        one_shape=model.one_shape,
        lifted=analysis.lifted if by_cycles(fit, shafts) else None,
        modal=None if fit.constrained else analysis.modal,
        whitening=fit.whitening,
        records=records,
        rows=tuple(tuple(row for row, c in enumerate(record.channels) if c.name in names) for record in records),
        clocks=clocks,
        period_std=fit.period_std if free_period else None,
        widened=widening_of(analysis) > 1.0,
    )


def _response(model: PeriodicModel, hit: int, times: Floats, angles: Floats) -> Floats:
    """The free response of one hit (channels, samples) at times after phase zero [s] and phase angles [rad]."""
    found = np.empty((len(model.channels), len(times)))
    weights = model.coefficients[:, :, hit].transpose(1, 0, 2).reshape(len(model.channels), -1)
    for first in range(0, len(times), CHUNK):
        part = slice(first, first + CHUNK)
        decays = np.exp(np.multiply.outer(model.exponents, times[part]))
        turned = np.exp(1j * np.multiply.outer(model.harmonics, angles[part]))
        found[:, part] = (weights @ (decays[:, None] * turned).reshape(weights.shape[1], -1)).real
    return found


@dataclass(frozen=True, slots=True)
class ExcitedRedrawn:
    """Draws of records whose excitation goes on: inputs are those measured, noise or innovations are drawn."""

    analysis: Analysis
    fit: Driven
    model: PeriodicModel
    built: PeriodicModel
    states: tuple[str, ...]
    settings: Settings
    whole: bool
    period_std: None = None
    widened: bool = False

    @staticmethod
    def of(analysis: Analysis, fit: Driven, whole: bool) -> ExcitedRedrawn:
        """Draws from a result."""
        bare = replace(analysis.model, covariance=None, estimates=None, unselected=None)
        bare = replace(bare, coefficient_std=analysis.model.coefficient_std)
        return ExcitedRedrawn(analysis=analysis, fit=fit, model=bare, whole=whole, **choices_of(analysis, bare))

    def redone(self, generator: np.random.Generator) -> Draw:
        """Identify records drawn from the model."""
        values = self.fit.drawn(generator)
        if self.whole:
            found = self._identified(values)
            fit, model = found.driven, found.model
            assert fit is not None
        else:
            fit = self.fit.refitted(values)
            model = fit.model(self.model.channels, self.analysis.inputs, self.model.provenance)
        if model.order != self.model.order:
            return Draw(model.order)
        built = None if self.whole or self.built is self.model else selected(self.built, model)
        return compared(self, model, fit.estimates_at, built)

    def _identified(self, values: Floats) -> Analysis:
        """The whole identification anew; A(t) comes after: with a structure it might be refused."""
        names = [channel.name for channel in self.model.channels]
        records = []
        for record, own in zip(self.analysis.records, self.fit.samples.records, strict=True):
            mixed = np.array(record.values)
            mixed[[[channel.name for channel in record.channels].index(name) for name in names]] = values[:, own]
            records.append(replace(record, values=mixed))
        settings = replace(without_states(self.settings), channels=tuple(names), skip=None, validate=False)
        settings = replace(settings, branch="strongest")  # that of the fit, which is linearised at the exponents found
        return identify(records, settings)


Redrawn: TypeAlias = Plan | ExcitedRedrawn
"""A kind of record to draw from: all that is needed beside a seed."""


def redrawn(analysis: Analysis, *, whole: bool) -> Redrawn:
    """The records to draw of a result, whatever it is of."""
    if analysis.driven is not None:
        return ExcitedRedrawn.of(analysis, analysis.driven, whole)
    return plan_of(analysis, whole)


def draw(plan: Redrawn, seed: SeedSequence) -> Draw:
    """One draw."""
    try:
        return plan.redone(np.random.default_rng(seed))
    except (FloquidError, np.linalg.LinAlgError, FloatingPointError) as error:
        return Draw(0, failure=str(error).splitlines()[0] or type(error).__name__)


def noisy(plan: Plan, generator: np.random.Generator) -> list[Floats]:
    """The records of one draw, (channels, samples) each; noise is coloured as that which was whitened."""
    taps, found = plan.whitening, []
    for hit, clean in enumerate(plan.clean):
        before = 0 if taps is None else _memory(taps, clean.shape[1])
        white = generator.standard_normal((len(clean), before + clean.shape[1])) * plan.noise[:, hit, None]
        if taps is not None:
            from scipy.signal import lfilter

            white = np.array([lfilter([1.0], own, row) for own, row in zip(taps, white, strict=True)])
        found.append(clean + white[:, before:])
    return found


def _memory(taps: Floats, longest: int) -> int:
    """Samples in which coloured noise forgets how it began."""
    slowest = max((float(np.abs(np.roots(own)).max(initial=0.0)) for own in taps), default=0.0)
    if slowest >= 1.0:
        return longest
    return min(longest, int(np.ceil(np.log(HALF_DIGITS) / np.log(slowest)))) if slowest > 0.0 else 0


def _fitted(plan: Plan, values: Sequence[Floats]) -> Draw:
    """Refit the modes and bands, and A(t) as before."""
    records = [replace(record, values=own) for record, own in zip(plan.records, values, strict=True)]
    clocks = plan.clocks
    if plan.lifted is not None and (plan.modal is not None or plan.lifted.whitening is not None):
        lifted = _lifted(plan.lifted, plan.settings, records)
        shared = {"wider": True, "one_shape": plan.one_shape}
        found = refit(plan.fitted, lifted=lifted, **shared) if plan.modal is None else _free(plan, lifted, plan.modal)
    else:
        # Of lifted responses the same numbers sooner: nothing but the fit itself is done.
        lifted, wider = None, bool(plan.settings.structure)
        own = {"noise": plan.noise, "whitening": plan.whitening, "one_shape": plan.one_shape}
        found = refit(plan.fitted, records, clocks, **own, free_period=plan.free_period, wider=wider)

    def again(exponents: Complexes) -> Estimates:
        if lifted is not None:
            return estimate_at(found, exponents, lifted=lifted)
        return estimate_at(found, exponents, records=records, clocks=clocks, noise=plan.noise, whitening=plan.whitening)

    built = selected(plan.built, found)
    if not plan.estimated:
        built = replace(built, estimates=None, unselected=None)
    return compared(plan, found, again, built)


def compared(plan: Redrawn, found: PeriodicModel, again: Again, built: PeriodicModel | None) -> Draw:
    """Estimates of a draw: the modes in the order drawn from, and A(t), of the harmonics of a model if given."""
    exponents, coefficients = aligned(plan.model, found)
    held, own = built is not None, found if built is None else built
    # The free model that is drawn from has a misfit already: twice that much is no news of the structure.
    state, _ = state_of(own, plan.settings, again, lambda _: None, held=held, refuse=0.0)
    if state is not None and state.states != plan.states:
        was, now = ", ".join(plan.states), ", ".join(state.states)
        raise IdentificationError(f"The states of A(t) came out as {now}, and not as {was}.")
    return Draw(
        found.order,
        exponents,
        coefficients,
        found.period,
        None if state is None else state.system,
        None if state is None else state.transition,
        None if state is None else state.inputs,
    )


def _lifted(like: Lifted, settings: Settings, records: Sequence[Record]) -> Lifted:
    """The lifted responses of a draw, through the same filter and with the same noise."""
    found = lift(segment(records), floor=settings.noise_floor)
    if like.whitening is not None:
        found = whitened(found, like.whitening)
    return found.with_noise(like.noise)


def _free(plan: Plan, lifted: Lifted, modal: ModalModel) -> PeriodicModel:
    """The fit of lifting, residues free at each phase, with all harmonics that it has."""
    identifier = plan.settings.identifier or MaximumLikelihood(false_alarm=plan.settings.mode_false_alarm)
    found = identifier.refine(identifier.prepare(lifted.responses), modal)
    if found.outcome is not Outcome.SUCCESS:
        raise IdentificationError(f"{failure(found.outcome.value).clause}.")
    return assemble(found, lifted, harmonics=(lifted.n_phases - 1) // 2)


def _identified(plan: Plan, values: Sequence[Floats]) -> Draw:
    """The whole identification anew; modes are compared where the order is the same."""
    # What was done to the records before is done: hits are cut, clocks and orbits known, channels chosen. A force that
    # was named for a response stays one.
    channels = tuple(channel.name for channel in plan.model.channels)
    given = {"channels": channels, "tach": None, "azimuth": None, "orbit": False, "find_hits": False, "skip": 0.0}
    # A(t) comes after: with a structure it might be refused.
    settings = replace(without_states(plan.settings), **given, validate=False)
    records = []
    for record, rows, own in zip(plan.records, plan.rows, values, strict=True):
        mixed = record.values.copy()
        mixed[list(rows)] = own
        records.append(replace(record, values=mixed))
    found = identify(records, settings)
    if found.model.order != plan.model.order:
        return Draw(found.model.order)
    assert found.decay is not None
    again = again_of(found.decay.fit, found.lifted, found.shafts)
    return compared(plan, found.model, again, None)


def drawn(plan: Redrawn, seeds: Sequence[SeedSequence], workers: int) -> Iterator[Draw]:
    """The draws in the order of their seeds, by several processes; InputError where one cannot start, or dies."""
    from threadpoolctl import threadpool_limits

    if workers == 1:
        with threadpool_limits(limits=1, user_api="blas"):
            for seed in seeds:
                yield draw(plan, seed)
        return
    import multiprocessing
    from concurrent.futures import ProcessPoolExecutor
    from concurrent.futures.process import BrokenProcessPool

    # A fresh interpreter: a fork of a process with threads may hang.
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(workers, mp_context=context, initializer=_begin, initargs=(_sent(plan),))
    try:
        yield from pool.map(_one, seeds)
    except BrokenProcessPool:
        raise _unusable("one of them ended before its time") from None
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


_PLAN: list[Redrawn] = []  # that of this worker process


def _begin(sent: bytes) -> None:
    from threadpoolctl import threadpool_limits

    # Ctrl-C reaches every process of a terminal; the first of them ends the others.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threadpool_limits(limits=1, user_api="blas")
    _PLAN[:] = [pickle.loads(sent)]  # noqa: S301  # from the process that started this one


def _one(seed: SeedSequence) -> Draw:
    return draw(_PLAN[0], seed)


def _sent(plan: Redrawn) -> bytes:
    try:
        return pickle.dumps(plan)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise _unusable(f"the settings cannot be sent to another ({error})") from None


def _unusable(why: str) -> Exception:
    remedy = (
        "Put the call of a script under `if __name__ == '__main__':`; where memory is short take fewer; `workers=1` "
        "starts none."
    )
    return input_error("workers", "bootstrap", "be a number of processes that can be started and last", why, remedy)
