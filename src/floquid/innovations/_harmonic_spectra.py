"""Spectra of exponentially modulated outputs, and operational modal analysis of them (H-OMA)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, TypeAlias, get_args

import numpy as np

from floquid._arrays import Complexes, Floats, Integers
from floquid._checks import Rebuilt, describe, input_error, integer, wrong_value
from floquid.errors import IdentificationError
from floquid.inputs import Samples
from floquid.lti import ERA, AbstractIdentifier, ModalModel, TimeResponses

HomaForm: TypeAlias = Literal["frequency", "time"]

SEGMENTS = 12  # segments of the shortest record by default, next to each other
SEGMENT = 3  # length of a segment for correlations, over the longest lag
WHOLE = 1e-4  # the share of a sample by which a period, or the angle at a sample, may be off a whole number of steps


@dataclass(frozen=True, kw_only=True, eq=False)
class HarmonicSpectra(Rebuilt):
    r"""Harmonic power spectra: those of outputs modulated by each harmonic, averaged over segments.

    .. math:: y_m(t) = y(t)\, e^{-i m \omega t}, \qquad
              S_{mn}(\Omega) = \int E\{ y_m(t + \tau)\, y_n(t)^H \}\, e^{-i \Omega \tau}\, d\tau

    (Allen, Sracic, Chauhan and Hansen 2011.) Each is the spectrum of y moved by mω; what is beside the
    blocks of m = n is zero unless the system is periodic. Where Ω is near Im λ + lω the matrix is of rank one.

    Parameters
    ----------
    frequencies_hz
        Ω/2π from zero to half the rate (lines,) [Hz].
    harmonics
        m, from -M to M (harmonics,).
    values
        S (lines, signals, signals), the signals being all channels of the first harmonic, then those of the next
        [units of the channels squared/Hz].
    segments
        Segments in the mean; they overlap by half.
    """

    frequencies_hz: Floats
    harmonics: Integers
    values: Complexes
    segments: int

    def __post_init__(self) -> None:
        self._freeze(frequencies_hz=("lines",))
        self._freeze(dtype=np.int64, harmonics=("harmonics",))
        self._freeze(dtype=np.complex128, values=(len(self.frequencies_hz), "signals", "signals"))

    @property
    def singular_values(self) -> Floats:
        """Singular values of S, descending (lines, signals): their peaks are where the modes are."""
        return np.asarray(np.linalg.svd(self.values, compute_uv=False), np.float64)


def harmonic_spectra(samples: Samples, harmonics: int = 1, periods: int | None = None) -> HarmonicSpectra:
    """The harmonic power spectra of the outputs, what is known beside the modes taken off, by Welch's method.

    `samples` are outputs of records of one rate; with `harmonics` M they are modulated by -M to M. A segment has as
    many `periods`; by default the shortest record holds `SEGMENTS` of them. Raises InputError where a number is not
    possible or a record is shorter than a segment.
    """
    of = "harmonic_spectra"
    _check(samples, of)
    turns = _turns(harmonics, of)
    shortest = min(own.stop - own.start for own in samples.records)
    per_turn = 2.0 * np.pi / (samples.fundamental * samples.step)
    wanted = (
        max(shortest / per_turn / SEGMENTS, 1.0) if periods is None else integer(periods, "periods", of, at_least=1)
    )
    length = round(wanted * per_turn)
    if length > shortest:
        must = f"be at most {int(shortest / per_turn)}, the periods of the shortest record"
        raise input_error("periods", of, must, f"is {periods}")
    frequencies, values, segments = _averaged(samples, turns, np.hanning(length + 1)[:-1])
    kept = frequencies >= 0.0
    return HarmonicSpectra(frequencies_hz=frequencies[kept], harmonics=turns, values=values[kept], segments=segments)


def _check(samples: object, of: str) -> None:
    """Refuse what is no `Samples`, as a record is."""
    if not isinstance(samples, Samples):
        remedy = f'What is found of a record has them: `{of}(identify(record, excitation="ambient").driven.samples)`.'
        raise input_error("samples", of, "be the samples of a result", f"are {describe(samples)}", remedy)


def _turns(harmonics: int, of: str) -> Integers:
    """-M to M."""
    most = integer(harmonics, "harmonics", of, at_least=0)
    return np.arange(-most, most + 1)


def _averaged(samples: Samples, turns: Integers, window: Floats) -> tuple[Floats, Complexes, int]:
    """Frequencies on both sides (lines,) [Hz], the mean of the products of spectra in segments, and their number."""
    from scipy.signal import ShortTimeFFT

    signals = modulated(samples, turns)
    transform = ShortTimeFFT(window, len(window) // 2, 1.0 / samples.step, fft_mode="centered", scale_to="psd")
    total, segments = np.zeros((len(window), len(signals), len(signals)), np.complex128), 0
    for own in samples.records:
        first, last = transform.lower_border_end[1], transform.upper_border_begin(own.stop - own.start)[1]
        lines = transform.stft(signals[:, own], p0=first, p1=last)
        total = total + np.einsum("afp,bfp->fab", lines, lines.conj(), optimize=True)
        segments += lines.shape[2]
    return np.asarray(transform.f, np.float64), np.asarray(total / segments, np.complex128), segments


def modulated(samples: Samples, turns: Integers) -> Complexes:
    """Outputs without what is known beside the modes, times e^{-imωt} (harmonics · channels, samples)."""
    rest = samples.values - np.linalg.lstsq(samples.known.T, samples.values.T, rcond=None)[0].T @ samples.known
    return np.concatenate([samples.turned(-float(turn)) * rest for turn in turns.tolist()])


def h_oma(
    samples: Samples,
    order: int,
    *,
    form: HomaForm = "frequency",
    lags: int = 20,
    harmonics: int = 1,
    identifier: AbstractIdentifier | None = None,
) -> ModalModel:
    r"""Operational modal analysis of exponentially modulated outputs (H-OMA), in the frequency or the time domain.

    .. math:: R_{mn}(jT) = E\{ y_m(t + jT)\, y_n(t)^H \} = \sum_r C_{r,mn}\, \mu_r^j, \qquad \mu = e^{\lambda T}

    Correlations at whole periods are free decays of the multipliers, and any LTI identification takes them. In the
    frequency domain they are transforms of the harmonic power spectra, over that of the segments' window (Allen,
    Sracic, Chauhan and Hansen 2011); in the time domain those of the lifted outputs, whose discrete transform over
    each period is the modulation. No deviations are given, since errors of correlations are not white: for those there
    is `floquid.identify`.

    Returns the model; its poles are exponents on the principal branch. Raises InputError where an option is not
    possible, IdentificationError where a period is no whole number of samples or the speed is not constant.

    Parameters
    ----------
    samples
        Outputs of records of one rate.
    order
        The number of exponents, conjugates one by one.
    form
        "frequency" or "time".
    lags
        Periods of the correlations that are used: one or two time constants of the modes.
    harmonics
        M of the harmonics -M to M, in the frequency domain alone.
    identifier
        What is applied to the correlations; ERA where none is given.
    """
    of = "h_oma"
    _check(samples, of)
    if form not in get_args(HomaForm):
        raise wrong_value("form", of, 'be "frequency" or "time"', form)
    phases = _whole_period(samples)
    most = min(own.stop - own.start for own in samples.records) // phases // (SEGMENT + 1)
    if integer(lags, "lags", of, at_least=2) > most:
        must = f"be at most {most}, the periods of the shortest record over {SEGMENT + 1}"
        raise input_error("lags", of, must, f"is {lags}", "Record for longer.")
    found = _by_spectra(samples, harmonics, phases, lags) if form == "frequency" else _lifted(samples, phases, lags)
    chosen = ERA() if identifier is None else identifier
    responses = TimeResponses(values=found, dt=2.0 * np.pi / samples.fundamental)
    model = chosen.extract(chosen.prepare(responses), order)
    return replace(model, covariance=None, residue_spread=None, residue_slope=None)


def _whole_period(samples: Samples) -> int:
    """Samples a period, of records at one constant speed."""
    per_turn = 2.0 * np.pi / (samples.fundamental * samples.step)
    even = all(np.ptp(np.diff(samples.times[own])) < WHOLE * samples.step for own in samples.records)
    if not even or abs(per_turn - round(per_turn)) > WHOLE:
        raise IdentificationError(
            f"A period is {per_turn:.6g} samples{'' if even else ', and the speed is not constant'}: correlations at "
            "whole periods need a whole number of samples in each of them. Resample the record to its angle."
        )
    return round(per_turn)


def _by_spectra(samples: Samples, harmonics: int, phases: int, lags: int) -> Floats:
    """Correlations of the modulated outputs at whole periods from 1 on, real parts, then imaginary ones."""
    window = np.zeros((SEGMENT + 1) * lags * phases)
    window[: SEGMENT * lags * phases] = 1.0
    _, values, _ = _averaged(samples, _turns(harmonics, "h_oma"), window)
    kept = slice(phases, (lags + 1) * phases, phases)
    own = np.fft.ifft(np.abs(np.fft.fft(window)) ** 2).real[kept]
    found = np.moveaxis(np.fft.ifft(np.fft.ifftshift(values, axes=0), axis=0)[kept], 0, 2) / own
    return np.concatenate([found.real, found.imag], axis=1)


def _lifted(samples: Samples, phases: int, lags: int) -> Floats:
    """Correlations of the lifted outputs at 1 to `lags` periods (outputs, outputs, lags)."""
    rest = modulated(samples, np.zeros(1, np.int64)).real
    total, count = np.zeros((lags, phases * len(rest), phases * len(rest))), 0
    for own in samples.records:
        periods = (own.stop - own.start) // phases
        cycles = rest[:, own.start : own.start + periods * phases].reshape(len(rest), periods, phases)
        lifted = np.moveaxis(cycles, 1, 2).reshape(-1, periods)
        for lag in range(1, lags + 1):
            total[lag - 1] += lifted[:, lag:] @ lifted[:, : periods - lag].T
        count += periods
    return np.moveaxis(total / count, 0, 2)
