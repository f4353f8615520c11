"""A periodic model fitted anew to other samples of the same responses: same modes, same bands."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from floquid._arrays import Complexes, Floats, Mask
from floquid._checks import input_error, noise_array
from floquid.core import PeriodicModel, PhaseClock, Record
from floquid.fit import DEVIATIONS, FARTHEST, HALF_DIGITS
from floquid.lifting import Lifted
from floquid.periodic.least_squares import (
    AT_REST,
    Block,
    KeptCycles,
    LiftedBlock,
    ModeParameters,
    OneShape,
    Solution,
    complex_of,
    linearise,
    model_of,
    reals_of,
    record_blocks,
    solve,
    through,
)
from floquid.periodic.search import period_step


def below(half: float) -> int:
    """The highest harmonic below half of the samples a period."""
    return max(int(np.ceil(half)) - 1, 0)


def half_of(records: Sequence[Record], period: float) -> float:
    """Half of the samples a period at the lowest rate, a whole number of them where it is one up to rounding."""
    least = min(record.sample_rate for record in records) * period
    if least < 2.0:
        remedy = "Check the period and the sampling rate."
        raise input_error("period", "fit", "be two sampling intervals or more", f"it is {least:.3g} of them", remedy)
    return 0.5 * (round(least) if abs(least - round(least)) < HALF_DIGITS else least)


Clocks = Sequence[PhaseClock]


def refit(
    model: PeriodicModel,
    records: Sequence[Record] = (),
    clocks: Clocks = (),
    *,
    lifted: Lifted | None = None,
    noise: ArrayLike | None = None,
    whitening: Floats | None = None,
    at_rest: float = AT_REST,
    free_period: bool = False,
    wider: bool = False,
    one_shape: bool = False,
    hold: bool = False,
) -> PeriodicModel:
    r"""Refit modes with their bands of harmonics to records as they were sampled, or lifted.

    .. math:: \min_{\lambda, B} \sum_{c,h} \frac{1}{\sigma_{c,h}^2} \sum_k
              \Big(y_{c,h}(t_k) - \sum_r \sum_{m \in M_r} B_{r,c,h,m}\, e^{\lambda_r t_k + i m \theta(t_k)}\Big)^2

    (Allen 2009, eqs. 11-12, the spacing enforced), started at the exponents of the model; θ is ωt, or the angle of the
    shaft. Of records that are whole samples a period, with whole cycles left out, it costs as little as of lifted
    responses: no sample's exponentials are formed. Exponents, coefficients and deviations are those of these samples.

    Raises InputError where records, clocks, noise and model do not belong together, or the period of a measured angle
    is to be fitted; IdentificationError where there is no such fit near the model's exponents.

    Parameters
    ----------
    model
        The model; it says the period, too.
    records
        The free response, one record a hit. NaN marks samples that are left out.
    clocks
        What ties each record to the phase.
    lifted
        The free responses lifted, with their noise, in place of records and clocks.
    noise
        The deviation of the noise (channels, hits) [units of the channels]; with `whitening`, after the filter.
    whitening
        The filter of each channel along the record that makes its noise white (channels, taps).
    at_rest
        The deviations that the last step may have.
    free_period
        Whether the period is fitted too, where constant periods tie the records to the phase.
    wider
        Whether the fit with several harmonics more on each side of every band is made too (`unselected`).
    one_shape
        Whether all hits share the shapes of the modes, as those of the model do: B is a shape times a state.
    hold
        Whether an exponent that runs away stays as the model has it, its residues fitted, where noise alone may move
        it as far: samples may be too few to tell that of a weak mode. Not with one shape for all hits.
    """
    if free_period and any(clock.measured for clock in clocks):
        must, got = "be false where the angle of a shaft is measured", "is true"
        raise input_error("free_period", "refit", must, got, "The angle says the period.")
    if lifted is not None:
        _check_lifted(model, lifted)
        blocks = LiftedBlock.all_of(lifted)
    else:
        # Blocks of cycles are cut at a period that stays as it is, and are not filtered.
        blocks = _noisy(model, records, clocks, noise, "refit", cut=not free_period and whitening is None)
        blocks = through(blocks, whitening)
    most = None
    if wider:
        most = below(half_of(records, model.period)) if lifted is None else (lifted.n_phases - 1) // 2
    entries = replace(ModeParameters.of(model), free_period=free_period)
    solution, shared = _evaluated(model, blocks, entries), None
    if one_shape:
        shared = _shared(model, blocks, solution).solved(at_rest=at_rest)
        solution = (
            linearise(blocks, shared.entries, tuple(linear.coefficients for linear in shared.linear))
            if wider
            else solution
        )
    else:
        solution = solve(blocks, solution, at_rest=at_rest, hold=_may_run_away(solution) if hold else False)
        if hold and solution.entries.fixed.any():  # as modes of the model, which they are
            solution = linearise(blocks, replace(solution.entries, fixed=entries.fixed))
    return model_of(
        blocks, solution, entries.bands, channels=model.channels, provenance=model.provenance, most=most, one=shared
    )


def _may_run_away(solution: Solution) -> Mask:
    """Mask of the entries whose exponents noise may move beyond `FARTHEST` (entries,)."""
    entries, std = solution.entries, np.sqrt(np.maximum(np.diag(solution.covariance()), 0.0))
    may = np.zeros(len(entries.exponents), bool)
    may[entries.leading] = DEVIATIONS * std[: int(entries.leading.sum())] * 2.0 * np.pi > FARTHEST * entries.fundamental
    return may


def _check_lifted(model: PeriodicModel, lifted: Lifted) -> None:
    if (model.n_hits, len(model.channels)) != (lifted.n_hits, lifted.n_channels):
        must = f"be responses of {model.n_hits} hits and {len(model.channels)} channels, as the model"
        raise input_error("lifted", "refit", must, f"has {lifted.n_hits} hits and {lifted.n_channels} channels")


def own_period(
    model: PeriodicModel, records: Sequence[Record], clocks: Clocks, *, noise: ArrayLike
) -> tuple[float, float] | None:
    r"""(own period - T)/T as the harmonics of the response have it, and its standard deviation.

    One Gauss-Newton step of the fit with the fundamental as a parameter: a linear estimate. The `model` says T, too;
    `records`, `clocks` (by a constant period) and `noise` (channels, hits) [units of the channels] are as of `refit`.

    None where the response does not tell it. Raises InputError where records, clocks, noise and model do not belong
    together.
    """
    blocks = _noisy(model, records, clocks, noise, "own_period")
    if not model.one_shape:
        return period_step(_evaluated(model, blocks, ModeParameters.of(model)))
    return _shared(model, blocks, _evaluated(model, blocks, ModeParameters.of(model))).period_step()


def unexplained(model: PeriodicModel, records: Sequence[Record], clocks: Clocks) -> tuple[Floats, ...]:
    r"""Residual of records, at the samples that are there.

    .. math:: e_{c,h}(t_k) = y_{c,h}(t_k) - \sum_{r,m} B_{r,c,h,m}\, e^{\lambda_r t_k + i m \theta(t_k)}

    One array a record (channels, samples) [units of the channels]; NaN where no sample is. `model`, `records` and
    `clocks` are as of `refit`. Raises InputError where records, clocks and model do not belong together.
    """
    _check(model, records, clocks, "unexplained")
    entries = ModeParameters.of(model)
    residuals: list[Floats] = [np.full(record.values.shape, np.nan) for record in records]
    for block in seen(model.period, records, clocks):
        taken = np.flatnonzero(~np.isnan(records[block.hit].values[block.rows[0]]))
        _, residual = block.residual(entries.columns(), scaled(model, entries, block))
        if residual.shape == residuals[block.hit].shape:
            residuals[block.hit] = residual
        else:
            residuals[block.hit][np.ix_(block.rows, taken)] = residual
    return tuple(residuals)


def _evaluated(model: PeriodicModel, blocks: Sequence[Block], entries: ModeParameters) -> Solution:
    """The linearisation at a model's exponents, started from its coefficients."""
    return linearise(blocks, entries, tuple(reals_of(scaled(model, entries, block)) for block in blocks))


def _shared(model: PeriodicModel, blocks: Sequence[Block], solution: Solution) -> OneShape:
    """The fit of one shape for all hits at a model's exponents, states and shapes."""
    values = [2.0 * scaled(model, solution.entries, block) for block in blocks]
    return OneShape.near(blocks, solution.entries, solution.linear, values).with_states()


def scaled(model: PeriodicModel, entries: ModeParameters, block: Block) -> Complexes:
    """The coefficients of a model on the scaled columns of a block, after its filter (columns, rows)."""
    columns = entries.columns()
    place = np.searchsorted(model.harmonics, columns.harmonics).clip(0, len(model.harmonics) - 1)
    known = model.harmonics[place] == columns.harmonics
    modes = np.array(model.upper_modes, np.int64)[columns.modes]
    # A column without a sine counts once, the others with their conjugates.
    share = np.where(entries.sines(), 1.0, 0.5) * block.scales(columns) * known
    coefficients = model.coefficients[modes, :, block.hit, place][:, block.rows] * share[:, None]
    return coefficients * block.gain(columns.rates).T


def instants(record: Record, clock: PhaseClock, fundamental: float) -> tuple[NDArray, NDArray]:
    """Times after phase zero (samples,) [s], and the phase angle of the system at each (samples,) [rad].

    They are those of a `record` that a `clock` ties to the phase; `fundamental` is ω [rad/s], of a constant period.
    """
    times, angles = clock.since_phase_zero(record.start, np.arange(record.n_samples) / record.sample_rate)
    return times, fundamental * times if angles is None else angles


def _blocks(model: PeriodicModel, records: Sequence[Record], clocks: Clocks, *, cut: bool) -> list[Block]:
    """Blocks of cycles where all records can, and may, be cut into them, else blocks of samples."""
    pairs = zip(records, clocks, strict=True)
    cheap = [KeptCycles.of(record, clock, model.period, hit) for hit, (record, clock) in enumerate(pairs) if cut]
    if cut and all(block is not None for block in cheap):
        return [block for block in cheap if block is not None]
    return list(record_blocks(records, clocks, 1.0)[0])


def seen(period: float, records: Sequence[Record], clocks: Clocks) -> Iterator[Block]:
    """Blocks of the samples of records that are there: a channel, or a record, may have none."""
    for hit, (record, clock) in enumerate(zip(records, clocks, strict=True)):
        cheap = KeptCycles.of(record, clock, period, hit)
        if cheap is not None:
            yield cheap
            continue
        rows = np.flatnonzero((~np.isnan(record.values)).sum(axis=1) > 1)
        if len(rows):
            part = record if len(rows) == record.n_channels else record.select([record.channels[r].name for r in rows])
            for block in record_blocks([part], [clock], 1.0)[0]:
                yield block.placed(hit, rows[block.rows])


def _noisy(
    model: PeriodicModel,
    records: Sequence[Record],
    clocks: Clocks,
    noise: ArrayLike | None,
    of: str,
    *,
    cut: bool = True,
) -> list[Block]:
    """The blocks with their noise."""
    _check(model, records, clocks, of)
    spread = noise_of_records(noise, model.coefficients.shape[1:3], of)
    return [block.with_noise(spread[block.rows, block.hit]) for block in _blocks(model, records, clocks, cut=cut)]


def noise_of_records(noise: ArrayLike | None, shape: tuple[int, ...], of: str) -> Floats:
    """The noise (channels, hits) that has to be given with records."""
    if noise is None:
        raise input_error("noise", of, "be given with records", "is None", "Pass the noise that the analysis found.")
    return noise_array(noise, of, shape)


def _check(model: PeriodicModel, records: Sequence[Record], clocks: Clocks, of: str) -> None:
    if not model.order:
        raise input_error("model", of, "have a mode", "has none", "Identify again: nothing was found in the record.")
    if len(clocks) != len(records):
        raise input_error("clocks", of, "be one a record", f"there are {len(clocks)}, and {len(records)} records")
    if model.n_hits != len(records) or any(record.n_channels != len(model.channels) for record in records):
        must = f"be {model.n_hits} of {len(model.channels)} channels, as the model"
        got = f"there are {len(records)}, of {[record.n_channels for record in records]}"
        raise input_error("records", of, must, got, "Pass the records that the model was identified from.")


def line_amplitudes(
    record: Record, clock: PhaseClock, period: float, exponents: ArrayLike, turns: ArrayLike
) -> tuple[Floats, Floats]:
    r"""The amplitude of each exponential in each channel, alone, and the sum of squares that it takes off.

    .. math:: \min_B \sum_k \big(y(t_k) - 2 \Re B\, e^{\lambda t_k + i q \theta(t_k)}\big)^2

    Returns 2|B| [units of the channels] and the sums [units squared] (channels, columns).

    Parameters
    ----------
    record
        The samples; NaN where there is none.
    clock
        What ties them to the phase.
    period
        T [s].
    exponents, turns
        λ [1/s] and q, turns a period (columns,). What grows is counted from the end of the record.
    """
    columns = _entries(exponents, turns, period).columns()
    n = len(columns.modes)
    amplitudes, squares = np.zeros((2, record.n_channels, n))
    for block in seen(period, [record], [clock]) if n else ():
        sums = block.sums(columns, np.zeros((n, len(block.rows)), complex))
        cosines, sines = np.split(np.diag(sums.gram)[:, None], 2)
        both, (cosine_sums, sine_sums) = np.diag(sums.gram, n)[:, None], np.split(sums.seen, 2)
        total = np.maximum(cosines + sines, np.finfo(float).tiny)
        determinant = cosines * sines - both**2
        turning = determinant > HALF_DIGITS * total**2
        safe = np.where(turning, determinant, 1.0)
        alpha = np.where(turning, (sines * cosine_sums - both * sine_sums) / safe, cosine_sums / total)
        beta = np.where(turning, (cosines * sine_sums - both * cosine_sums) / safe, sine_sums / total)
        amplitudes[block.rows] = np.hypot(alpha, beta).T
        squares[block.rows] = (alpha * cosine_sums + beta * sine_sums).T
    return amplitudes, squares


def without_lines(record: Record, clock: PhaseClock, period: float, exponents: ArrayLike, turns: ArrayLike) -> Floats:
    r"""A record less exponentials that are fitted to it together.

    .. math:: y(t_k) - 2 \Re \sum_j B_j\, e^{\lambda_j t_k + i q_j \theta(t_k)}

    Returns what is left (channels, samples) [units of the channels]. `record`, `clock`, `period`, `exponents` and
    `turns` are as of `line_amplitudes`.
    """
    entries, remaining = _entries(exponents, turns, period), np.array(record.values)
    for block in seen(period, [record], [clock]):
        solution = linearise([block.with_noise(np.ones(len(block.rows)))], entries)
        there = ~np.isnan(record.values[block.rows[0]])
        remaining[np.ix_(block.rows, there)] = block.residual(
            entries.columns(), complex_of(solution.linear[0].coefficients)
        )[1]
    return remaining


def _entries(exponents: ArrayLike, turns: ArrayLike, period: float) -> ModeParameters:
    """One entry a column, its exponent fixed."""
    return ModeParameters.made(exponents, (0, 0), 2.0 * np.pi / period, offsets=turns, fixed=True)
