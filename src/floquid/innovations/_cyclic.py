"""The frequencies at which a random response is periodic, from the response alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from floquid._checks import Rebuilt
from floquid.fit import CHUNK, DEVIATIONS, LAGS, SURE, chi2_limit, inverse_root
from floquid.innovations._autoregression import delayed, whole_past
from floquid.inputs import Samples

HARMONICS = 3  # harmonics of a period that count together
WIDEST = 0.03  # the largest share by which a period may be off and its own be found
FINE = 4  # frequencies within the resolution of the records

SLOWEST = 0.1
"""The frequency over that given below which it is the excitation that changes, not the system that repeats."""

CLEARLY = 2.0
"""The score of a frequency over the largest at harmonics of the period given, from which on it is of another period.

A response that is hardly periodic scores at many periods, by up to 1.6 times what it does at its own.
"""


@dataclass(frozen=True, eq=False)
class Repetition(Rebuilt):
    """Repetition of a random response near a period that was given."""

    # (Own period - period given)/period given where it repeats most, and how finely that is known
    shift: float
    resolution: float
    # Squared scores of the harmonics of its own period, and of the one given
    own: float
    given: float
    # Squared scores of the even harmonics of the period given alone, and of the odd ones
    even: float
    odd: float
    limit: float  # What noise alone exceeds with probability `SURE`
    # The frequency apart from the harmonics of the period given that scores clearly more than these, or half the
    # fundamental where its odd multiples are above noise [rad/s]; zero if there is none
    other: float


def repetition(samples: Samples) -> Repetition:
    r"""Score test of an autoregression whose coefficients turn with a frequency ν, near the harmonics of a period.

    .. math:: S(\nu) = \frac{2}{N} \sum_{i,j} \Big| \sum_k e_{i,k}\, z_{j,k}\, e^{-i \nu t_k} \Big|^2

    with e the residuals of an autoregression of constant coefficients and z its regressors, both whitened: of a
    time-invariant system χ², and large at the harmonics of ω of a periodic one (Hurd and Gerr 1991, of correlation
    in place of residuals). Records of one rate at a constant speed; their phases need not be known.
    """
    left, past = _products(samples)
    longest = max(own.stop - own.start for own in samples.records)
    padded, scores = FINE * longest, np.zeros(FINE * longest // 2 + 1)
    for place in samples.records:
        for row in left[:, place]:
            for other in past[:, place]:
                scores += 2.0 / (place.stop - place.start) * np.abs(np.fft.rfft(row * other, padded)) ** 2
    per_turn = 2.0 * np.pi / (samples.fundamental * samples.step)
    highest = max(min(HARMONICS, int(0.5 * per_turn / (1.0 + WIDEST))), 1)
    step = per_turn / (FINE * longest * highest)

    def at(turns: range, shifts: NDArray[np.float64]) -> NDArray[np.float64]:
        places = [np.rint(turn * padded / (per_turn * (1.0 + shifts))).astype(int) for turn in turns]
        return np.sum([scores[np.minimum(place, len(scores) - 1)] for place in places], axis=0)

    count = int(WIDEST / step)
    shifts, turns = step * np.arange(-count, count + 1), range(1, highest + 1)
    both = at(turns, shifts)
    best, none = int(np.argmax(both)), np.zeros(1)
    one = 2 * len(left) * len(past) * len(samples.records)
    degrees = one * highest
    harmonics = np.arange(len(scores)) * per_turn / padded
    beside = (np.abs(harmonics - np.rint(harmonics)) * padded / per_turn > 2 * FINE) & (harmonics > SLOWEST)
    apart = int(np.argmax(np.where(beside, scores, 0.0)))
    own = float(scores[~beside & (harmonics > 0.5)].max())
    usual = float(np.median(scores))  # more than that of noise where its tails are long
    enough = usual + max(chi2_limit(one, SURE / len(scores)), CLEARLY * (own - usual))
    # Half the period of the system holds all of its even harmonics, which may be the stronger ones.
    halves = [round((turn - 0.5) * padded / per_turn) for turn in turns]
    other = float(apart) if scores[apart] > enough else 0.0
    if scores[halves].sum() > chi2_limit(degrees, SURE):
        other = 0.5 * padded / per_turn
    return Repetition(
        shift=float(shifts[best]),
        resolution=FINE * step,
        own=float(both[best]),
        given=float(both[count]),
        even=float(at(range(2, 2 * highest + 1, 2), none)[0]) if 4 * highest < per_turn else 0.0,
        odd=float(at(range(1, 2 * highest, 2), none)[0]) if 4 * highest < per_turn else np.inf,
        limit=chi2_limit(degrees, SURE / len(shifts)),
        other=2.0 * np.pi * other / (padded * samples.step),
    )


def _products(samples: Samples) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Residuals of an autoregression of constant coefficients, and its regressors, each white (signals, samples)."""
    values = samples.values - np.linalg.lstsq(samples.known.T, samples.values.T, rcond=None)[0].T @ samples.known
    signals = np.concatenate([values, samples.inputs])
    lags = max(min(LAGS, CHUNK // (len(values) * len(signals))), 2)
    past = np.concatenate([samples.each(signals, lambda own, lag=lag: delayed(own, lag)) for lag in range(1, lags + 1)])
    if samples.count < samples.n_samples:
        used = whole_past(samples, lags)
        values, past = values * used, past * used
    past = _white(past)
    return _white(values - values @ past.T @ past / samples.n_samples), past


def left_over(samples: Samples, innovations: NDArray[np.float64], frequency: float) -> bool:
    """Test if innovations of a model (outputs, samples) turn with the past at a frequency [rad/s]."""
    # The score of `repetition` at one frequency, of a model that takes account of all that is narrow: a response whose
    # lines alone are narrow leaves nothing.
    from scipy.special import chdtrc

    left, past = _white(innovations), _products(samples)[1]
    score = 2.0 / samples.n_samples * np.sum(np.abs((left * np.exp(-1j * frequency * samples.times)) @ past.T) ** 2)
    return float(chdtrc(2 * len(left) * len(past), score)) < SURE


def turned_records(samples: Samples) -> list[int]:
    """Records that are about half a period off the first, by their numbers from 0."""
    # The products of residuals and the past turn with ω at one phase in all records (as in `repetition`): where those
    # of two are above noise and have opposite signs, they are not.
    left, past = _products(samples)
    line = np.exp(-1j * samples.fundamental * samples.times)
    found, each = [], []
    for place in samples.records:
        both = (left[:, place] * line[place]) @ past[:, place].T * np.sqrt(2.0 / (place.stop - place.start))
        each.append(both.ravel())
    limit = chi2_limit(2 * each[0].size, SURE)
    strong = [float(np.sum(np.abs(own) ** 2)) > limit for own in each]
    for number in range(1, len(each)):
        alike = np.vdot(each[0], each[number]).real / (np.linalg.norm(each[0]) * np.linalg.norm(each[number]))
        if strong[0] and strong[number] and alike < -DEVIATIONS / np.sqrt(2.0 * each[0].size):
            found.append(number)
    return found


def _white(signals: NDArray[np.float64]) -> NDArray[np.float64]:
    """Signals combined to be independent of one another, with an rms of 1, without directions that are rounding."""
    size = np.sqrt(np.mean(signals**2, axis=1, keepdims=True))
    scaled = signals / np.where(size > 0.0, size, 1.0)
    return inverse_root(scaled @ scaled.T / scaled.shape[1], 1e-12).T @ scaled
