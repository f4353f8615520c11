"""A record beside what the model says of it, and its noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floquid._arrays import Floats
from floquid._checks import Sealed
from floquid.core import PeriodicModel, PhaseClock, Record
from floquid.periodic import instants, unexplained
from floquid.pipeline import Analysis
from floquid.views._modes import check_analysis, frozen


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Synthesis(Sealed):
    """One channel of a record, the model's response, and their difference.

    Parameters
    ----------
    times
        The samples (samples,) [s], on the record's own time axis.
    measured
        The free response as it was identified from (samples,) [unit of the channel]; NaN where no sample is.
    predicted
        The model's response (samples,) [unit of the channel]; NaN where no sample is.
    residual
        Their difference, measured less predicted (samples,) [unit of the channel].
    noise
        The deviation of the noise [unit of the channel]; where it is coloured, of all of it together.
    """

    times: Floats
    measured: Floats
    predicted: Floats
    residual: Floats
    noise: float


@dataclass(frozen=True, slots=True)
class Response:
    """One hit as it was identified from: the record, its clock, the model of that hit alone."""

    record: Record
    clock: PhaseClock
    model: PeriodicModel
    noise: Floats  # the deviation of the noise, before any whitening filter (channels,) [units of the channels]


def response_of(analysis: Analysis, hit: int, channels: list[int]) -> Response:
    """The free response of some channels of one hit, with the model that counts from its phase zero."""
    whole, record, noise = analysis.model, analysis.responses[hit], analysis.noise[channels, hit]
    if analysis.whitening is not None:
        noise = noise * colour(analysis.whitening)[channels]
    names = [record.channels[row].name for row in channels]
    model = PeriodicModel(
        exponents=whole.exponents,
        coefficients=whole.coefficients[:, channels][:, :, [hit]],
        harmonics=whole.harmonics,
        period=whole.period,
        channels=[whole.channels[row] for row in channels],
    )
    return Response(record=record.select(names), clock=analysis.clocks[hit], model=model, noise=noise)


def lifted_points(analysis: Analysis, channel: int, hit: int = 0) -> tuple[Floats, Floats]:
    r"""The first sample of each cycle, at its own instant: what one of the lifted responses is made of.

    .. math:: t_k = t_0 + (k + j + p)\,T

    (Allen 2009, eq. 7.) Where the free response is whole samples a period they are samples of it. Else it is resampled
    at equal times: its first cycle begins j whole periods, and its first phase p, after phase zero.

    Of what `identify` found (`analysis`), for a `channel` and a `hit` counted from 0: the instants (cycles,) [s], on
    the time axis of `synthesis`, and the values (cycles,) [unit of the channel]. Raises InputError where there is no
    such channel or hit.
    """
    check_analysis(analysis, "lifted_points", channel=channel, hit=hit)
    cycles, own = analysis.cycles[hit], response_of(analysis, hit, [channel])
    after, _ = instants(own.record, own.clock, own.model.fundamental)
    passed = (cycles.first_cycle + cycles.first_phase + np.arange(cycles.n_cycles)) * own.model.period
    return frozen(own.record.start - after[0] + passed), frozen(np.array(cycles.values[channel, 0]))


def synthesis(analysis: Analysis, channel: int, hit: int = 0) -> Synthesis:
    r"""A channel of a record, the response of the model at its samples, and the residual.

    .. math:: \hat y(t) = \sum_{r,m} B_{r,m}\, e^{(\lambda_r + i m\omega) t}

    (Allen 2009, eq. 12.) The record is the one identified from, at its own times: of whole periods, where it is whole
    samples a period, and without a forced response that was fitted beside the modes.

    Of what `identify` found (`analysis`), for a `channel` and a `hit` counted from 0. Raises InputError where there is
    no such channel or hit.
    """
    check_analysis(analysis, "synthesis", channel=channel, hit=hit)
    own = response_of(analysis, hit, [channel])
    (left,) = unexplained(own.model, [own.record], [own.clock])
    measured = own.record.values[0]
    return Synthesis(
        times=own.record.times,
        measured=measured,
        predicted=frozen(measured - left[0]),
        residual=frozen(left[0]),
        noise=float(own.noise[0]),
    )


def colour(whitening: Floats) -> Floats:
    """Ratio of the noise before the whitening filter to that after it (channels,) [-]."""
    gain = np.fft.fft(whitening, 512, axis=1)
    return np.asarray(np.sqrt(np.mean(np.abs(gain) ** -2.0, axis=1)), np.float64)


def raw_noise(analysis: Analysis) -> Floats:
    """The deviations of the noise of the records, before any whitening filter (channels, hits) [units of the channels].

    `analysis` is what `identify` found; where the noise is coloured, they are of all of it together.
    """
    if analysis.whitening is None:
        return analysis.noise
    return analysis.noise * colour(analysis.whitening)[:, None]
