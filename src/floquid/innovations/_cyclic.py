"""The frequencies at which a random response is periodic, from the response alone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from floquid._arrays import Floats
from floquid._checks import Rebuilt
from floquid.fit import CHUNK, DEVIATIONS, LAGS, SURE, chi2_limit, inverse_root
from floquid.innovations._autoregression import past_of, whole_past
from floquid.inputs import Samples

HARMONICS = 3  # harmonics of a period that count together
WIDEST = 0.03  # the largest share by which a period may be off and its own be found
FINE = 4  # frequencies looked at in each line: a tone between two still has a tenth of it in the lines beside

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
    left, past = _residuals(samples)
    longest = max(own.stop - own.start for own in samples.records)
    padded, scores = FINE * longest, np.zeros(FINE * longest // 2 + 1)
    for some in past.few_at_a_time():
        for place in samples.records:
            for row in left[:, place]:
                for other in some[:, place]:
                    scores += 2.0 / (place.stop - place.start) * np.abs(np.fft.rfft(row * other, padded)) ** 2
    per_turn = 2.0 * np.pi / (samples.fundamental * samples.step)
    highest = max(min(HARMONICS, int(0.5 * per_turn / (1.0 + WIDEST))), 1)
    step = per_turn / (FINE * longest * highest)

    def at(turns: range, shifts: Floats) -> Floats:
        places = [np.rint(turn * padded / (per_turn * (1.0 + shifts))).astype(int) for turn in turns]
        return np.sum([scores[np.minimum(place, len(scores) - 1)] for place in places], axis=0)

    count = int(WIDEST / step)
    shifts, turns = step * np.arange(-count, count + 1), range(1, highest + 1)
    both = at(turns, shifts)
    best, none = int(np.argmax(both)), np.zeros(1)
    one = 2 * len(left) * past.count * len(samples.records)
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


class _Past:
    """Signals of all samples before, combined to be independent of one another, formed part by part of the samples."""

    def __init__(self, samples: Samples, values: Floats, lags: int) -> None:
        self._samples, self._lags, self.used = replace(samples, values=values), lags, np.ones(samples.n_samples, bool)
        if samples.count < samples.n_samples:
            self.used = whole_past(samples, lags)
        rows = lags * (len(values) + len(samples.inputs))
        self._root, gram = np.eye(rows), np.zeros((rows, rows))
        for _, past in self:
            gram += past @ past.T
        self._root = _whitener(gram / samples.n_samples)

    @property
    def count(self) -> int:
        """Number of the signals."""
        return self._root.shape[1]

    def __iter__(self) -> Iterator[tuple[slice, Floats]]:
        """Parts of the samples, and the signals there (signals, samples)."""
        return self._of(self._root)

    def _of(self, root: Floats) -> Iterator[tuple[slice, Floats]]:
        for parts in self._samples.parts(2 * len(root)):
            for own in parts:
                past = past_of(self._samples, own, parts[0].start, self._lags)
                yield own, root.T @ (past * self.used[own])

    def few_at_a_time(self) -> Iterator[Floats]:
        """Few of the signals over all samples, as many as there are outputs, then the next (signals, samples)."""
        step = len(self._samples.values)
        for first in range(0, self.count, step):
            root = self._root[:, first : first + step]
            found = np.empty((root.shape[1], self._samples.n_samples))
            for own, past in self._of(root):
                found[:, own] = past
            yield found


def _residuals(samples: Samples) -> tuple[Floats, _Past]:
    """Residuals of an autoregression of constant coefficients, each white (outputs, samples), and its regressors."""
    values, signals = samples.moving, len(samples.values) + len(samples.inputs)
    past = _Past(samples, values, max(min(LAGS, CHUNK // (len(values) * signals)), 2))
    if samples.count < samples.n_samples:
        values = values * past.used
    along = sum(values[:, own] @ rows.T for own, rows in past) / samples.n_samples
    left = np.empty(values.shape)
    for own, rows in past:
        left[:, own] = values[:, own] - along @ rows
    return _white(left), past


def left_over(samples: Samples, innovations: Floats, frequency: float) -> bool:
    """Test if innovations of a model (outputs, samples) turn with the past at a frequency [rad/s]."""
    # The score of `repetition` at one frequency, of a model that takes account of all that is narrow: a response whose
    # lines alone are narrow leaves nothing.
    from scipy.special import chdtrc

    left, past = _white(innovations), _residuals(samples)[1]
    turned = left * np.exp(-1j * frequency * samples.times)
    score = 2.0 / samples.n_samples * np.sum(np.abs(sum(turned[:, own] @ rows.T for own, rows in past)) ** 2)
    return float(chdtrc(2 * len(left) * past.count, score)) < SURE


def turned_records(samples: Samples) -> list[int]:
    """Records that are about half a period off the first, by their numbers from 0."""
    # The products of residuals and the past turn with ω at one phase in all records (as in `repetition`): where those
    # of two are above noise and have opposite signs, they are not.
    left, past = _residuals(samples)
    turned = left * np.exp(-1j * samples.fundamental * samples.times)
    found, none = [], np.zeros((len(left), past.count), complex)
    sums = {place.start: none for place in samples.records}
    for own, rows in past:
        begin = max(start for start in sums if start <= own.start)
        sums[begin] = sums[begin] + turned[:, own] @ rows.T
    each = [
        np.ravel(both * np.sqrt(2.0 / (place.stop - place.start)))
        for both, place in zip(sums.values(), samples.records, strict=True)
    ]
    limit = chi2_limit(2 * each[0].size, SURE)
    strong = [float(np.sum(np.abs(own) ** 2)) > limit for own in each]
    for number in range(1, len(each)):
        alike = np.vdot(each[0], each[number]).real / (np.linalg.norm(each[0]) * np.linalg.norm(each[number]))
        if strong[0] and strong[number] and alike < -DEVIATIONS / np.sqrt(2.0 * each[0].size):
            found.append(number)
    return found


def _white(signals: Floats) -> Floats:
    """Signals combined to be independent of one another, with an rms of 1, without directions that are rounding."""
    return _whitener(signals @ signals.T / signals.shape[1]).T @ signals


def _whitener(squares: Floats) -> Floats:
    """Combinations that make signals white, by the means of their products (signals, combinations)."""
    return inverse_root(squares, 1e-12)
