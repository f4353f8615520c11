"""Spectra of the record, of its lifted responses and of the model beside it; long curves with few points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floquid._arrays import Floats, Integers
from floquid._checks import Sealed, index, input_error
from floquid.core import PeriodicModel, PhaseClock, Record
from floquid.innovations import harmonic_spectra
from floquid.lti import WHITE
from floquid.periodic import instants, unexplained
from floquid.pipeline import Analysis
from floquid.views._names import check_analysis, frozen


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Spectrum(Sealed):
    """The magnitudes of a transform, with those that noise alone would have.

    Parameters
    ----------
    omega
        The lines (lines,) [rad/s].
    values
        The magnitudes (lines,) [unit of the channel · s].
    noise
        The mean magnitude of the noise alone (lines,) [unit of the channel · s].
    """

    omega: Floats
    values: Floats
    noise: Floats


def record_spectrum(analysis: Analysis, channel: int, hit: int = 0) -> Spectrum:
    r"""The transform of the whole periods of a channel, as they were cut from the record.

    .. math:: \Delta t \Big| \sum_n y[n]\, e^{-i\Omega n \Delta t} \Big|

    (Allen 2009, figure 3.)

    Of what `identify` found (`analysis`), for a `channel` and a `hit` counted from 0, up to half of the sampling rate.
    Raises InputError where there is no such channel or hit.
    """
    check_analysis(analysis, "record_spectrum", channel=channel, hit=hit)
    cycles = analysis.cycles[hit]
    values = cycles.values[channel].T.ravel()
    return _spectrum(analysis, channel, hit, values, analysis.lifted.period / cycles.n_phases, 1)


def lifted_spectrum(analysis: Analysis, channel: int, phase: int, hit: int = 0) -> Spectrum:
    r"""The transform of one lifted response: the samples of a channel at one phase, one a period.

    .. math:: T \Big| \sum_m y_k[m]\, e^{-i\Omega m T} \Big|

    (Allen 2009, figure 4.)

    Of what `identify` found (`analysis`), for a `channel`, a `phase` and a `hit` counted from 0, up to half of the
    fundamental. Raises InputError where there is no such channel, phase or hit.
    """
    of = "lifted_spectrum"
    check_analysis(analysis, of, channel=channel, hit=hit)
    cycles = analysis.cycles[hit]
    index(phase, "phase", of, cycles.n_phases)
    values = cycles.values[channel, phase]
    return _spectrum(analysis, channel, hit, values, analysis.lifted.period, cycles.n_phases)


def _spectrum(analysis: Analysis, channel: int, hit: int, values: Floats, step: float, folds: int) -> Spectrum:
    """Noise that was whitened has the colour that the filter took off, folded as often as the response is."""
    omega = np.asarray(2.0 * np.pi * np.arange(len(values) // 2 + 1) / (len(values) * step), dtype=np.float64)
    magnitudes = np.asarray(np.abs(np.fft.rfft(values)) * step, dtype=np.float64)
    white = WHITE * float(analysis.lifted.noise[channel, hit]) * step * np.sqrt(len(values))
    turns = 1j * (omega + 2.0 * np.pi * np.arange(folds)[:, None] / step)
    colour = np.sqrt(np.mean(np.abs(analysis.lifted.gain(turns)[channel]) ** -2.0, axis=0))
    return Spectrum(omega=omega, values=magnitudes, noise=white * colour)


def envelope(x: Floats, y: Floats, points: int) -> tuple[Floats, Floats]:
    """A curve with at most `points` points that looks the same: of each stretch, its smallest and largest value.

    The points kept are points of the curve, in their order, and no extreme is lost. A short curve is kept whole.
    A gap (NaN) stays one where a whole stretch is missing.

    `x` (samples,) ascends over `y` (samples,); of both what is kept is returned, `points` or fewer, 2 or more.
    """
    if len(x) <= points:
        return x, y
    stretches = max(points // 2, 1)
    size = -(-len(x) // stretches)
    padded = np.full(-(-len(x) // size) * size, y[-1])
    padded[: len(y)] = y
    blocks = padded.reshape(-1, size)
    missing = np.isnan(blocks)
    lowest, highest = np.where(missing, np.inf, blocks), np.where(missing, -np.inf, blocks)
    inside = np.stack([lowest.argmin(axis=1), highest.argmax(axis=1)])
    kept = np.sort((inside + np.arange(len(blocks)) * size).ravel())
    kept = np.unique(np.minimum(kept, len(x) - 1))
    return x[kept], y[kept]


SMALLEST = 1e-3  # the share of a mode's energy below which a line is not marked


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpectraOfModes(Sealed):
    """Singular values of the harmonic power spectra of a record, and the lines of the modes of its model.

    Parameters
    ----------
    frequencies_hz
        From zero to half the rate (lines,) [Hz].
    values
        Singular values, descending (lines, signals) [`unit`].
    unit
        That of the channels squared over Hz; channels of different units are divided by their rms.
    modes
        Of each conjugate pair and each real mode, the frequencies at which it shows (lines of the mode,) [Hz], the
        strongest first.
    end
        Half a fundamental above the highest of them, or half the rate where that is less [Hz].
    """

    frequencies_hz: Floats
    values: Floats
    unit: str
    modes: tuple[Floats, ...]
    end: float


def spectra_of_modes(analysis: Analysis, harmonics: int = 1, periods: int | None = None) -> SpectraOfModes:
    """The harmonic power spectra of a record of outputs alone, and the lines |Im λ + mω| of its modes in them.

    `analysis` is what `identify` found of records whose excitation goes on. With `harmonics` M outputs are modulated by
    -M to M: lines show up to M fundamentals beside those of a mode. A segment is `periods` long, or a twelfth of the
    shortest record. Raises InputError where a number is not possible.
    """
    model, driven = analysis.model, analysis.driven
    if driven is None:
        got = "is of free responses"
        raise input_error("analysis", "spectra_of_modes", "be of records whose excitation goes on", got)
    samples = driven.samples
    found = harmonic_spectra(samples, harmonics, periods)
    units = {channel.unit for channel in model.channels}
    scale = np.ones(len(samples.values)) if len(units) == 1 else 1.0 / samples.values.std(axis=1)
    scale = np.tile(scale, len(found.harmonics))
    values = np.linalg.svd(found.values * scale[:, None] * scale, compute_uv=False)
    unit = units.pop() if len(units) == 1 else "-"
    squared = "1" if unit == "-" else f"{unit}²" if unit.isalpha() else f"({unit})²"
    modes = tuple(_lines_of(analysis, mode, found.harmonics) for mode in model.upper_modes)
    nyquist = float(found.frequencies_hz[-1])
    return SpectraOfModes(
        frequencies_hz=found.frequencies_hz,
        values=np.asarray(values, np.float64),
        unit=f"{squared}/Hz",
        modes=modes,
        end=min(nyquist, max((float(own.max()) for own in modes), default=nyquist) + 0.5 / model.period),
    )


def _lines_of(analysis: Analysis, mode: int, moved: Integers) -> Floats:
    """Frequencies of a mode's harmonics that are seen, the strongest first, and of those moved (lines,) [Hz]."""
    model = analysis.model
    energy = np.sum(np.abs(model.coefficients[mode, :, 0] / analysis.noise) ** 2, axis=0)
    seen = model.harmonics[energy > SMALLEST * energy.sum()]
    turns = [model.harmonics[np.argmax(energy)], *np.unique(np.add.outer(seen, moved))]
    return frozen(np.abs(model.exponents[mode].imag + model.fundamental * np.array(turns)) / (2.0 * np.pi))


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
