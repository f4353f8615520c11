"""The line through a time column, how the column was rounded, and the round rate that is clearly meant."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Floats

_EPS = float(np.finfo(np.float64).eps)
_BLOCK = 1 << 16

_EVIDENCE = 0.02
"""Largest chance that a rate picked at random agrees with a candidate: the width of what the column allows over the
distance between candidates of that roundness."""

_OCTAVES = (1.0, 5.0, 25.0, 125.0, 375.0, 11025.0)
"""Rates of acquisition hardware are one of these times a power of two: 4096, 10240, 51200, 64000, 48000, 44100 Hz."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LineFit:
    """The least squares line t_n ≈ `start` + k_n `step` [s], with its residuals (rows,) [s]."""

    start: float
    step: float
    residuals: Floats
    spread: float

    def step_std(self, quantum: float) -> float:
        """The standard error of the step [s], as if errors were independent and no smaller than rounding (q/√12)."""
        free = max(len(self.residuals) - 2, 1)
        scatter = float(np.sum(self.residuals**2)) / free
        return float(np.sqrt(max(scatter, quantum**2 / 12.0) / self.spread))

    def rate_std(self, quantum: float) -> float:
        """The standard error of the rate [Hz], with rounding errors that run alike over many rows counted as one.

        Where the residuals leave some of the quantum unused (all of it, when every time is a whole multiple), a line
        tilted by that much over the record would have been rounded alike, which no residual shows.
        """
        slow = float(np.sqrt(_slow_scatter(self.residuals) / self.spread))
        unused = (quantum - float(np.ptp(self.residuals))) / len(self.residuals)
        return max(self.step_std(quantum), slow, unused / np.sqrt(12.0)) / self.step**2


def fit_line(positions: Floats, times: Floats) -> LineFit:
    """The least squares line through `times` (rows,) [s] at the sample numbers `positions` (rows,)."""
    first = (times[-1] - times[0]) / (positions[-1] - positions[0])
    rest = times - times[0]
    rest -= first * positions  # small numbers, so that the sums below lose no digits
    centred = positions - positions.mean()
    spread = float(centred @ centred)
    change = float(centred @ rest) / spread
    mean = float(rest.mean())
    rest -= mean
    centred *= change
    rest -= centred
    start = float(times[0]) + mean - change * float(positions.mean())
    return LineFit(start=start, step=float(first) + change, residuals=rest, spread=spread)


def _slow_scatter(residuals: Floats) -> float:
    """The variance that independent errors would need for the slow part of `residuals` (rows,): that of block means."""
    # Rounding repeats its pattern where a step is nearly a simple fraction of the quantum; averaged over blocks of
    # √rows the pattern is gone and its slow drift is left, which counts as often as it changes sign.
    width = int(np.sqrt(len(residuals)))
    means = residuals[: len(residuals) // width * width].reshape(-1, width).mean(axis=1)
    spectrum = np.fft.rfft(means, 2 << len(means).bit_length())
    correlation = np.fft.irfft(np.abs(spectrum) ** 2)[: len(means)]
    negative = np.flatnonzero(correlation <= 0.0)
    alike = correlation[1 : negative[0] if negative.size else None].sum()
    return float(width * (correlation[0] + 2.0 * alike) / len(means))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rounding:
    """Rounding of a time column: to the `quantum` (rows,) [s] of each time, and the same in `words`."""

    quantum: Floats
    words: str

    @property
    def coarsest(self) -> float:
        """The largest quantum [s]."""
        return float(self.quantum.max())


def rounding(times: NDArray[np.floating], scale: float) -> Rounding:
    """The unit of the last place kept, of each of the `times` (rows,) in units of `scale` seconds."""
    # Times printed with d decimals are whole multiples of 10^-d; times printed with s significant digits are so in each
    # decade. Both numbers are read off the values and the coarser rounding holds, which is right for either; s only
    # where decades of ten times or more show it, as a few may end in zeros by chance. Never finer than the
    # floating-point type, nor than what summing a step up sample by sample loses.
    values = times.astype(np.float64, copy=False)
    size = np.abs(values)
    decade, decimals = _decades_and_decimals(size)
    largest = float(size.max())
    positive = size > 0
    del size
    digits = np.where(positive, decimals + decade + 1, 1)
    index = decade - decade.min()
    counts = np.bincount(index)
    enough = (counts >= 10)[index] & positive
    most = float(np.max(digits[enough], initial=0.0))
    fixed = 10.0 ** -float(decimals.max())
    quanta = np.maximum(fixed, 10.0 ** (np.arange(len(counts)) + float(decade.min()) + 1.0 - most))
    is_floating = bool((quanta > fixed)[index][enough].any())
    # Where all are alike it is one number, not a column of them: a record of one channel is mostly its times.
    printed = np.where(positive, quanta[index], fixed) if is_floating else np.array([fixed])
    with np.errstate(over="ignore"):
        single = values.astype(np.float32)
    if (single == values).all() and digits.max() > 9 and fixed < 1.0:
        quantum, words = np.abs(np.spacing(single)).astype(np.float64), "single precision"
    elif digits.max() >= 15:
        quantum, words = printed, "full precision"
    elif (printed == fixed).all():
        quantum, words = printed, f"rounded to {fixed * scale:.2g} s"
    else:
        quantum, words = printed, f"rounded to {most:.0f} significant digits"
    np.maximum(quantum, 0.5 * len(values) * _EPS * largest, out=quantum)
    quantum *= scale
    return Rounding(quantum=np.broadcast_to(quantum, len(values)), words=words)


def _decades_and_decimals(size: Floats) -> tuple[NDArray[np.int16], NDArray[np.int16]]:
    """Decade of each non-negative number (0 of zero), and the decimals that it needs (rows,)."""
    decade, decimals = np.zeros(len(size), np.int16), np.zeros(len(size), np.int16)
    for first in range(0, len(size), _BLOCK):  # block by block: a long column is held once, not ten times
        part = size[first : first + _BLOCK]
        decade[first : first + _BLOCK] = np.floor(np.log10(part, out=np.zeros_like(part), where=part > 0))
        decimals[first : first + _BLOCK] = _decimals(part)
    return decade, decimals


def _decimals(size: Floats) -> Floats:
    """Number of decimals of each non-negative number (rows,), as far as double precision can tell."""
    decimals = np.zeros(len(size))
    left = np.arange(len(size))
    for count in range(23):  # 10^22 is the largest power of ten that is exact
        scaled = size[left] * 10.0**count
        whole = np.abs(scaled - np.rint(scaled)) <= 1.5 * _EPS * scaled
        decimals[left] = count
        left = left[~whole]
        if not left.size:
            break
    return decimals


def nominal_rate(positions: Floats, times: Floats, rounding: Rounding, line: LineFit) -> float | None:
    """The round rate [Hz] that the column clearly means, or None."""
    # A candidate is a rate of acquisition hardware, a whole number of hertz, or a rate or a step of few significant
    # digits; the roundest that passes is taken. It passes when
    # - over the whole record it differs from the fitted line by less than the rounding of the times, - its own line
    # runs within half the rounding of every time, or, where it only just does, within three standard errors of the
    # fitted step, and - such an agreement by chance has a probability of at most 2 % (the rates that the column allows
    # against the distance between candidates as round as this one), or there is nothing to decide, as the two are equal
    # to machine precision.
    # So a snapped rate changes no time by more than its last digit.
    coarse = rounding.coarsest
    length = float(positions[-1]) * line.step
    allowed = 2.0 * coarse / length
    equal = 16.0 * _EPS * (1.0 + float(np.abs(times).max()) / length)
    for rate, spacing in _candidates(1.0 / line.step):
        change = abs(rate * line.step - 1.0)
        if change > max(coarse / length, equal) or (allowed > _EVIDENCE * spacing and change > equal):
            continue
        if _explains(1.0 / rate, positions, times, rounding, line):
            return rate
    return None


@dataclass(frozen=True, slots=True, kw_only=True)
class Printed:
    """A number as a text has it.

    Parameters
    ----------
    text, value
        The text and its number.
    quantum, digits
        The unit of the last digit, and how many there are.
    """

    text: str
    value: float
    quantum: float
    digits: int


def printed(text: str) -> Printed:
    """The finite number that `text` spells, with E or with Fortran's D before its exponent.

    Nine digits or more that are those of a number in single precision are no finer than that.
    """
    word = text.strip()
    if "_" in word or not word.isascii():
        raise ValueError(text)
    value = float(word.upper().replace("D", "E"))  # before Decimal, as it bounds the exponent
    if not np.isfinite(value):
        raise ValueError(text)
    try:
        _, digits, exponent = Decimal(word.upper().replace("D", "E")).as_tuple()
    except InvalidOperation:  # zero, times ten to a power that is no number
        raise ValueError(text) from None
    quantum = float(f"1e{exponent}")
    with np.errstate(over="ignore", under="ignore"):
        single = np.float32(value)
    if len(digits) >= 9 and 0.0 < abs(float(single) - value) <= 0.5 * quantum:
        quantum = max(quantum, abs(float(np.spacing(single))))
    return Printed(text=word, value=value, quantum=quantum, digits=len(digits))


def nominal_rate_of_step(step: Printed) -> float | None:
    """The round rate [Hz] that a positive step [s], printed to some digits, clearly means, or None.

    The candidates are those of `nominal_rate`, and the roundest that passes is taken. It passes when its step is
    printed as this one, and such an agreement by chance has a probability of at most 2 %.
    """
    width = step.quantum / step.value
    half = 0.5 * step.quantum * (1.0 + 1e-6) + 4.0 * _EPS * step.value  # a step halfway is printed up or down
    if not 0.0 < width < _EVIDENCE:
        return None
    for rate, spacing in _candidates(1.0 / step.value):
        if abs(1.0 / rate - step.value) <= half and width <= _EVIDENCE * spacing:
            return rate
    return None


def _candidates(rate: float) -> Iterator[tuple[float, float]]:
    """Round rates near `rate` [Hz], and the distance to the next as round, relative; the roundest first."""
    if rate >= 100.0:
        for base in _OCTAVES:
            yield base * 2.0 ** float(np.rint(np.log2(rate / base))), 1.0 / 8.0
    decade = int(np.floor(np.log10(rate)))
    step_decade = int(np.floor(-np.log10(rate)))
    for digits in range(1, max(6, decade + 1) + 1):
        unit = decade + 1 - digits
        yield _rounded(rate, unit), 10.0**unit / rate
        if digits <= 4:
            unit = step_decade + 1 - digits
            yield _reciprocal(_rounded(1.0 / rate, unit)), 10.0**unit * rate


def _rounded(value: float, unit: int) -> float:
    """`value` to a whole multiple of 10^unit, correctly rounded."""
    return float(f"{round(value / 10.0**unit)}e{unit}")


def rate_of_step(step: float) -> float:
    """One over `step` [s], and 6250 where that is 6249.999999999999; a step in single precision as it was meant."""
    with np.errstate(over="ignore", under="ignore"):
        single = np.float32(step)
    if float(single) == step:
        text = Printed(text=str(single), value=step, quantum=float(np.spacing(single)), digits=8)
        return nominal_rate_of_step(text) or _reciprocal(step)
    return _reciprocal(step)


def _reciprocal(step: float) -> float:
    rate = 1.0 / step
    whole = float(f"{rate:.12g}")
    return whole if abs(whole - rate) <= 4.0 * _EPS * rate else rate


def _explains(step: float, positions: Floats, times: Floats, rounding: Rounding, line: LineFit) -> bool:
    """True where some line of this step runs within half the rounding of every time."""
    rest = times - positions * step
    half = rounding.quantum / 2.0
    room = float((rest + half).min() - (rest - half).max())
    edge = 1e-6 * rounding.coarsest + 8.0 * float(np.spacing(np.abs(times).max()))
    if abs(room) > edge:
        return room > 0.0
    return abs(step - line.step) <= 3.0 * line.step_std(rounding.coarsest)
