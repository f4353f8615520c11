"""The fit of the samples: modes, their period and the forced response together, started at the poles of lifting."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from floquid._arrays import Floats, Integers
from floquid._checks import Rebuilt, input_error
from floquid.core import Channel, PeriodicModel, PhaseClock, Provenance, Record
from floquid.errors import IdentificationError
from floquid.findings import Finding, Severity, failure, note, texts, warning
from floquid.fit import AT_REST, MODES
from floquid.lifting import Lifted
from floquid.periodic._forced_part import (
    ForcedResponse,
    angle_std,
    forced_base,
    forced_of,
    forced_turns,
    free_records,
    without_noise,
)
from floquid.periodic._refit import below, half_of
from floquid.periodic._start import Known
from floquid.periodic.least_squares import (
    Block,
    LiftedBlock,
    ModeParameters,
    forced_entries,
    model_of,
    noise_of,
    record_blocks,
    shapes,
)
from floquid.periodic.search import (
    FASTEST,
    LOUD,
    Bounds,
    Point,
    SearchResult,
    as_one_of_hits,
    coloured,
    disagreement,
    evidence,
    finished,
    own_step,
    priced,
    read_as_modes,
    searched,
    searched_white,
    with_one_shape,
)
from floquid.search import SECONDS


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fit(Rebuilt):
    """Result of the fit of the samples.

    Parameters
    ----------
    model
        The periodic model.
    forced
        The forced response; None where there is none.
    noise
        The deviation of what is left (channels, hits) [units of the channels].
    free
        What was fitted, without the forced response.
    period_std
        The deviation of the period [s]; None where it was not a parameter.
    own_period
        (own period - period given)/period given as the response has it, a linear estimate, and its deviation; None
        where the period was a parameter, the shaft tells it, or the response does not.
    constrained, misfit
        Whether the residues are constrained to their harmonics, and not free at each phase; the rms of the residual
        over the level of its noise, the largest of all channels and hits: 1 where it is noise, None where residues
        are free.
    whitening
        The filter of each channel along the record that made its noise white (channels, taps); None where it was.
    findings
        What speaks for the modes found (notes), and against them (warnings).
    warnings
        Warnings that speak against no mode: the time of the search was over, hits disagree on the shapes.
    later
        The cycles of each hit behind those that were fitted (hits,): they told the noise alone. None where all were.
    """

    model: PeriodicModel
    forced: ForcedResponse | None
    noise: Floats
    free: tuple[Record, ...]
    period_std: float | None
    own_period: tuple[float, float] | None
    constrained: bool = True
    misfit: float | None = None
    whitening: Floats | None = None
    findings: tuple[Finding, ...] = ()
    warnings: tuple[Finding, ...] = ()
    later: Integers | None = None

    def __post_init__(self) -> None:
        self._freeze(noise=("channels", "hits"))
        self._freeze(dtype=np.int64, later=("hits",))

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons for the modes found, a sentence each."""
        return texts(self.findings, Severity.NOTE)

    @property
    def doubts(self) -> tuple[str, ...]:
        """Reasons against them, a sentence each."""
        return texts(self.findings, Severity.WARNING)


def fit(
    records: Sequence[Record],
    clocks: Sequence[PhaseClock],
    *,
    start: ModeParameters | None = None,
    known: Known | None = None,
    lifted: Lifted | None = None,
    forced: str | Sequence[int] = "auto",
    periods_per_revolution: float = 1.0,
    order: int | None = None,
    harmonics: int | None = None,
    free_period: bool = False,
    search: bool = True,
    noise_floor: float = 1e-10,
    mode_false_alarm: float = 1e-9,
    harmonic_false_alarm: float = 1e-6,
    seconds: float = SECONDS,
    report: Callable[[str], None] = lambda _: None,
) -> Fit:
    r"""Modes and forced response of records at the times at which they were sampled.

    .. math:: y_{c,h}(t) = 2 \Re \sum_r \sum_{m \in M_r} B_{r,c,h,m}\, e^{\lambda_r (t - t_h) + i m \theta(t)}
              + b_{c,h} + d_{c,h} t + 2 \Re \sum_j F_{c,h,j}\, e^{i j \theta(t)/\nu}

    with θ the phase angle of the system (2π a period), ν periods a revolution, and t_h the instant of phase zero at or
    before the first sample of hit h. Decay and frequency run in time, shapes in angle: on a shaft whose speed wanders
    neither time nor angle alone makes the response one of an LTI system. All modes are fitted together, residues held
    to contiguous bands of harmonics (Allen 2009, eq. 12). Scores of one linearisation decide on bands, on modes to
    split, merge or remove, and on further lines in the spectrum of the residual (section 2.2.3, the FSE view). Missing
    samples (NaN) take no part. Where the speed wanders, F is let follow it (`followed`). Returns model, forced
    response and noise.

    Raises InputError where records or clocks do not belong together, or the forced response or the harmonics cannot be
    what is asked for; IdentificationError where no mode rises above the noise, or what does is no mode that could be
    fitted.

    Parameters
    ----------
    records
        One record, or one a hit on the same system, of equal channels.
    clocks
        What ties each record to the phase: a constant period, one for all, or the shaft's angle.
    start
        The modes to start from (`groups`); None starts from the spectrum alone.
    known
        The forced response that was found in the lifted responses; None where that is not known.
    lifted
        The same records lifted, forced response and all, where they are whole samples a period: that is cheaper.
    forced
        "auto" finds the harmonics of the revolution in the forced response; or those to be fitted; "none" for none.
    periods_per_revolution
        ν, where the clocks are constant periods; of 1, it is 2 where `known` holds what repeats after two periods.
    order
        The number of complex poles, conjugates one by one; None finds it.
    harmonics
        Keep the harmonics -harmonics … harmonics of each mode, below half of the samples a period; None keeps those
        that rise above the noise.
    free_period
        Whether the period is a parameter; the clocks then have a first value.
    search
        Whether modes may be added, parted, joined or left out.
    noise_floor
        The share of the largest free response that the noise is taken to be at least.
    mode_false_alarm, harmonic_false_alarm
        The probabilities that noise passes for a mode, and for a harmonic of any mode.
    seconds
        The processor time after which the search ends with the best found so far [s].
    report
        Is told of each stage.
    """
    if free_period and any(clock.measured for clock in clocks):
        raise input_error("free_period", "fit", "be false with a tachometer", "is true", "The shaft tells the period.")
    auto = isinstance(forced, str) and forced == "auto"
    doubled = auto and periods_per_revolution == 1.0 and known is not None and 0.5 in known.roots
    samples = Samples.of(records, clocks, lifted, known, 2.0 if doubled else periods_per_revolution)
    most = samples.most
    if harmonics is not None and harmonics > most:
        must = f"be at most {most}, below half of the samples a period"
        raise input_error("harmonics", "fit", must, f"is {harmonics}", "Ask for fewer, or sample faster.")
    nu, omega = samples.nu, samples.fundamental
    base = forced_base(forced_turns(forced, known, samples.half, nu), omega, wanders=samples.wanders)
    starts = 0 if start is None else int((~start.fixed).sum())
    bounds = Bounds(
        most=most,
        span=below(2.0 * samples.half),
        modes=max(MODES, 2 * starts) if order is None else (order + 1) // 2,
        forced=np.arange(1, int(samples.half * nu) + 1) / nu if auto else np.zeros(0),
        width=harmonics,
        search=search,
        angle_std=angle_std(clocks, records),
        seconds=seconds,
    )
    begin = forced_entries([], omega) if start is None else replace(start, fundamental=omega)
    if harmonics is not None:
        begin = replace(begin, bands=np.tile([-harmonics, harmonics], (len(begin.exponents), 1)))
    if search:  # a start that decays faster keeps every mode from moving: no step from there is taken
        begin = begin.picked(np.flatnonzero(np.abs(begin.exponents.real) * 2.0 * np.pi <= FASTEST * omega))
    report("fitting the samples")
    taps = None if lifted is None else lifted.whitening
    price_of = partial(priced, floor=noise_floor, mode_alarm=mode_false_alarm, harmonic_alarm=harmonic_false_alarm)
    if search and not isinstance(samples.final[0], LiftedBlock):
        point, taps = searched_white(samples.search, base.joined(begin), partial(price_of, base=base), bounds, report)
        samples = replace(samples, search=point.blocks, final=point.blocks)
    else:
        beside = base.picked([]) if samples.projected else base
        first = Point.at(samples.search, *price_of(samples.search, beside), beside.joined(begin))
        point = searched(first, bounds, report)
    ended = (warning("out_of_time", seconds=bounds.seconds),) if point.unfinished else ()
    if samples.projected:
        # The forced response was at every phase for itself: now it has the harmonics that are there.
        point = Point.at(samples.final, *price_of(samples.final, base), base.joined(point.entries))
    final = partial(
        finished, floor=noise_floor, most=most, choose=harmonics is None, steady=order is None, free_period=free_period
    )

    def of_hits(found: SearchResult) -> SearchResult:
        judged = read_as_modes(without_noise(found) if auto else found)
        return with_one_shape(judged, harmonic_false_alarm, noise_floor, most, order)

    fitted = final(point, search=search)
    if not (~fitted.solution.entries.fixed).any():
        raise IdentificationError(_no_mode(fitted))
    result = of_hits(fitted)
    fewer = as_one_of_hits(fitted, result.one, harmonic_false_alarm) if search else None
    if fewer is not None:
        # Without a search: what no exponent of all fits would be a pair near an axis.
        fitted = final(point.with_entries(fewer).settled(rest=AT_REST), search=False)
        result = of_hits(replace(fitted, unlike=tuple(replace(each, torn=True) for each in fitted.unlike)))
    _check_order(result, order)
    found = result_of(
        result, records, clocks, samples, taps, free_period=free_period, noise_floor=noise_floor, ended=ended
    )
    if not search or int((~result.solution.entries.fixed).sum()) < bounds.modes:
        return found
    return replace(found, findings=(*found.findings, warning("search_ended", number=bounds.modes)))


@dataclass(frozen=True, slots=True)
class Samples:
    """The samples as blocks: those that modes are searched with, and those of the final fit."""

    search: tuple[Block, ...]
    final: tuple[Block, ...]
    fundamental: float
    nu: float
    half: float  # half of the samples a period: a forced response may lie there, and only one phase of it is seen

    @property
    def most(self) -> int:
        """The highest harmonic of a mode: it lies below half of the samples a period."""
        return below(self.half)

    @property
    def projected(self) -> bool:
        """True where the forced response is projected off the blocks of the search."""
        return self.search is not self.final

    @property
    def wanders(self) -> bool:
        """True where the speed wanders."""
        return any(block.wanders for block in self.final)

    @staticmethod
    def of(
        records: Sequence[Record], clocks: Sequence[PhaseClock], lifted: Lifted | None, known: Known | None, nu: float
    ) -> Samples:
        """Blocks of lifted responses where there are any, else of the records."""
        if lifted is not None and not (known is not None and known.drift):
            final = LiftedBlock.all_of(lifted)
            lengths = lifted.responses.lengths.tolist()
            search = LiftedBlock.all_of(lifted, [known.basis(n) for n in lengths]) if known else final
            return Samples(search, final, 2.0 * np.pi / lifted.period, nu, 0.5 * lifted.n_phases)
        blocks, fundamental, nu = record_blocks(records, clocks, nu)
        return Samples(blocks, blocks, fundamental, nu, half_of(records, 2.0 * np.pi / fundamental))


class OrderError(IdentificationError):
    """The fit has not as many poles as were asked for."""


def _check_order(result: SearchResult, order: int | None) -> None:
    """Refuse a fit without as many poles as were asked for."""
    reached = result.solution.entries.order
    if order not in (None, reached):
        raise OrderError(
            f"Identification ended without a result: order {order} cannot be reached, {reached} is what was found. Ask "
            "for that order, or let it be found."
        )


def result_of(
    result: SearchResult,
    records: Sequence[Record],
    clocks: Sequence[PhaseClock],
    samples: Samples,
    taps: Floats | None,
    *,
    free_period: bool,
    noise_floor: float,
    ended: tuple[Finding, ...],
    noise: Floats | None = None,
) -> Fit:
    """The result of a search, as it is reported; its noise is what is left, unless it is given."""
    names = records[0].channels
    colour = coloured(result) if taps is None else ()
    try:
        model = model_of(
            result.blocks,
            result.solution,
            result.bands,
            channels=names,
            provenance=Provenance.merge(tuple(record.provenance for record in records)),
            most=None if result.twice else samples.most,  # free residues of two columns of one exponent are not told
            as_read=result.as_read,
            one=result.one,
        )
    except IdentificationError as error:
        raise IdentificationError(" ".join([str(error), *texts(colour)])) from None
    period_std = None
    if free_period:
        spread = result.solution.covariance() if result.one is None else result.one.of_rates()
        period_std = float(2.0 * np.pi / model.fundamental**2 * np.sqrt(spread[-1, -1]))
    return Fit(
        model=model,
        forced=forced_of(result, samples.nu, names, wanders=samples.wanders),
        noise=noise_of(result.blocks, result.solution, noise_floor) if noise is None else noise,
        free=free_records(records, clocks, result, samples.nu),
        period_std=period_std,
        own_period=None if clocks[0].measured else own_step(result),
        misfit=result.misfit,
        whitening=taps,
        findings=(*_interference(result, names), *evidence(result), *colour),
        warnings=(*ended, *disagreement(result), *_held(result)),
    )


def _interference(result: SearchResult, channels: Sequence[Channel]) -> tuple[Finding, ...]:
    """Notes on the steady tones beside the modes: the frequency of each, and its amplitude where it is largest."""
    entries = result.solution.entries
    tones = np.flatnonzero(entries.fixed & (entries.exponents.real == 0.0) & (entries.exponents != 0.0))
    if not len(tones):
        return ()
    sizes, notes = 2.0 * np.abs(shapes(result.blocks, result.solution).coefficients[tones]).max(axis=(2, 3)), []
    for tone, size in zip(tones, sizes, strict=True):
        row = int(np.argmax(size))
        frequency = abs(float(entries.exponents[tone].imag)) / (2.0 * np.pi)
        channel = channels[row]
        notes.append(
            note("interference", frequency=frequency, amplitude=size[row], channel=channel.name, unit=channel.unit)
        )
    return tuple(notes)


def _held(result: SearchResult) -> tuple[Finding, ...]:
    """Finding on modes that are in the fit and in no model, as the samples do not determine their exponents."""
    entries = result.solution.entries
    held = entries.exponents[entries.fixed & (entries.exponents.real != 0.0)]
    if not len(held):
        return ()
    return (failure("undetermined", frequencies=(np.abs(held.imag) / (2.0 * np.pi)).tolist()),)


def _no_mode(result: SearchResult) -> str:
    """Message that no mode was found: nothing rises above the noise, or what does is no mode that could be fitted."""
    beside = ", beside a forced response, an offset and a drift" if result.solution.entries.fixed.any() else ""
    if result.peak.gain < LOUD * result.peak.limit:
        return (
            f"Identification ended without a result: no mode rises above the noise{beside}. Use a record with a clear "
            "free decay, or start it closer to the blow."
        )
    way = "growing" if result.peak.exponent.real > 0 else "decaying"
    return (
        f"Identification ended without a result: no mode could be fitted{beside}. A {way} response is strongest at "
        f"{result.peak.exponent.imag / (2.0 * np.pi):.4g} Hz. Check the period or the tachometer first, then the "
        "record for glitches and steps. Modes that decay by more than a factor of 2 or 3 a period need a whole number "
        "of samples a period."
    )
