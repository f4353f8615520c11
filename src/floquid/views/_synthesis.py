"""A record beside what the model says of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from floquid._checks import Rebuilt, frozen_array, positive
from floquid.core import ConstantPeriod, PeriodicModel, Record
from floquid.periodic import instants, unexplained
from floquid.pipeline import Analysis
from floquid.sync import ShaftAngle, rejoin
from floquid.views._modes import checked, frozen, periods_later
from floquid.views._noise import colour


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Synthesis(Rebuilt):
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

    times: NDArray[np.float64]
    measured: NDArray[np.float64]
    predicted: NDArray[np.float64]
    residual: NDArray[np.float64]
    noise: float

    def __post_init__(self) -> None:
        of, put = "Synthesis", object.__setattr__
        put(self, "times", frozen_array(self.times, "times", of, axes=("samples",)))
        for name in ("measured", "predicted", "residual"):
            put(self, name, frozen_array(getattr(self, name), name, of, axes=(len(self.times),), missing=True))
        put(self, "noise", positive(self.noise, "noise", of))


@dataclass(frozen=True, slots=True)
class Response:
    """One hit as it was identified from: the record, its clock, the model of that hit alone, the record's own time."""

    record: Record
    clock: ConstantPeriod | ShaftAngle
    model: PeriodicModel
    later: float
    """What is added to the record's times to give those of the file [s]."""
    noise: NDArray[np.float64]
    """The deviation of the noise, before any whitening filter (channels,) [units of the channels]."""


def response_of(analysis: Analysis, hit: int, channels: list[int]) -> Response:
    """The free response of some channels of one hit, with the model that counts from its phase zero."""
    whole, later, noise = analysis.model, 0.0, analysis.noise[channels, hit]
    coefficients = whole.coefficients[:, channels][:, :, [hit]]
    if analysis.fit is not None:
        record, own = analysis.fit.free[hit], analysis.measured[hit].clock
        clock = analysis.shafts[hit] if analysis.shafts else own
        assert isinstance(clock, (ConstantPeriod, ShaftAngle))
    else:
        cycles = analysis.cycles[hit]
        record, clock = rejoin(replace(cycles, periods=np.full(cycles.n_cycles, whole.period))), None
        clock = ConstantPeriod(period=whole.period)
        # Rejoined, the record begins where the model's time zero is, or whole periods after it.
        passed = periods_later(analysis, hit) * whole.period
        coefficients = coefficients * np.exp(whole.exponents * passed)[:, None, None, None]
        later = _begin(analysis, hit) - record.start + passed
    if analysis.whitening is not None:
        noise = noise * colour(analysis.whitening)[channels]
    names = [record.channels[row].name for row in channels]
    model = PeriodicModel(
        exponents=whole.exponents,
        coefficients=coefficients,
        harmonics=whole.harmonics,
        period=whole.period,
        channels=[whole.channels[row] for row in channels],
    )
    return Response(record=record.select(names), clock=clock, model=model, later=later, noise=noise)


def lifted_points(analysis: Analysis, channel: int, hit: int = 0) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    r"""The first sample of each cycle, at its own instant: what one of the lifted responses is made of.

    .. math:: t_k = t_0 + (k + j)\,T

    (Allen 2009, eq. 7.) Of a record that was lifted they are samples of the record. One that was fitted as it was
    sampled is resampled afterwards, at equal times: its first cycle begins j whole periods after phase zero.

    Parameters
    ----------
    analysis
        What `identify` found.
    channel, hit
        Which, from 0.

    Returns
    -------
    tuple of numpy.ndarray
        The instants (cycles,) [s], on the time axis of `synthesis`, and the values (cycles,) [unit of the channel].

    Raises
    ------
    InputError
        There is no such channel or hit.
    """
    checked(analysis, "lifted_points", channel=channel, hit=hit)
    cycles, own = analysis.cycles[hit], response_of(analysis, hit, [channel])
    values = np.array(cycles.values[channel, 0])
    if analysis.fit is None:
        return frozen(own.record.times[:: cycles.n_phases] + own.later), frozen(values)
    after, _ = instants(own.record, own.clock, own.model.fundamental)
    passed = (periods_later(analysis, hit) + np.arange(len(values))) * own.model.period
    return frozen(own.record.start - after[0] + passed), frozen(values)


def _begin(analysis: Analysis, hit: int) -> float:
    """The time of the first sample of the first cycle [s]."""
    record, cycles = analysis.records[hit], analysis.cycles[hit]
    assert isinstance(record.clock, ConstantPeriod)
    ahead = (cycles.first_phase - record.clock.phase(record.start)) % 1.0
    samples = round(ahead * cycles.n_phases) % cycles.n_phases
    return record.start + samples / record.sample_rate


def synthesis(analysis: Analysis, channel: int, hit: int = 0) -> Synthesis:
    r"""A channel of a record, the response of the model at its samples, and what is left.

    .. math:: \hat y(t) = \sum_{r,m} B_{r,m}\, e^{(\lambda_r + i m\omega) t}

    (Allen 2009, eq. 12.) The record is the one identified from: whole periods, and without a forced response that was
    fitted beside the modes. A record that was fitted as it was sampled is the measured one, at its own times.

    Parameters
    ----------
    analysis
        What `identify` found.
    channel, hit
        Which, from 0.

    Returns
    -------
    Synthesis
        Record, response, what is left, and the noise.

    Raises
    ------
    InputError
        There is no such channel or hit.
    """
    checked(analysis, "synthesis", channel=channel, hit=hit)
    own = response_of(analysis, hit, [channel])
    (left,) = unexplained(own.model, [own.record], [own.clock])
    measured = own.record.values[0]
    return Synthesis(
        times=frozen(own.record.times + own.later),
        measured=measured,
        predicted=frozen(measured - left[0]),
        residual=frozen(left[0]),
        noise=float(own.noise[0]),
    )
