"""Steady tones of records whose excitation goes on: the mains, another machine."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floquid._arrays import Floats
from floquid.preparation._lines import BESIDE, LOUD, STEADY_LINES
from floquid.sync import STEADY

FINER = 4
"""Frequencies looked at in each line: a tone between two of them still has a tenth of it in the lines beside."""


@dataclass(frozen=True, slots=True)
class Tone:
    """A steady tone: its frequency [cycles a sample], and its amplitude in each output (channels,)."""

    frequency: float
    amplitudes: Floats


def tones_of(values: Floats, inputs: Floats, known: Floats, fundamental: float) -> tuple[Tone, ...]:
    """Tones in the outputs of a record (channels, samples) beside what is known of them (columns, samples).

    One stands as far above the lines beside it as `LOUD` says: a mode that is excited all along does only if it loses
    less than two nepers in the record, and then no record of outputs alone tells its decay. What an input has at the
    same frequency is no tone, nor what it has whole multiples of the `fundamental` [cycles a sample] away. Nor is what
    is beside a harmonic of it: that may be a harmonic of the true period, and the one given be wrong.
    """
    taken: list[float] = []
    while True:
        columns = np.concatenate([_columns(taken, values.shape[1]), known])
        fitted = np.linalg.lstsq(columns.T, values.T, rcond=None)[0].T
        left = values - fitted @ columns
        found = _loudest(left, inputs, fundamental) if len(taken) < STEADY_LINES else None
        if found is None:
            break
        taken.append(found)
    amplitudes = np.hypot(*np.split(fitted[:, : 2 * len(taken)], 2, axis=1))
    return tuple(Tone(frequency, own) for frequency, own in zip(taken, amplitudes.T, strict=True))


def _columns(frequencies: list[float], count: int) -> Floats:
    angles = 2.0 * np.pi * np.multiply.outer(np.array(frequencies), np.arange(count))
    return np.concatenate([np.cos(angles), np.sin(angles)])


def _loudest(left: Floats, inputs: Floats, fundamental: float) -> float | None:
    """The frequency of the tone that is furthest above what is beside it; None where none is [cycles a sample]."""
    count = left.shape[1]
    ratios, level = _above(left)
    margin = FINER * (max(BESIDE) + 1)
    ratios[:margin] = ratios[-margin:] = 0.0
    driven = _above(inputs - inputs.mean(axis=1, keepdims=True))[0] > LOUD
    for place in np.argsort(-ratios)[: max(int(np.sum(ratios > LOUD)), 0)]:
        frequency = place / (FINER * count)
        harmonic = np.rint(frequency / fundamental)
        if abs(frequency - harmonic * fundamental) < max(STEADY * fundamental, 2.0 / count):
            continue
        at = place + FINER * count * fundamental * np.arange(-STEADY_LINES, STEADY_LINES + 1)
        beside = np.abs(np.rint(at)).astype(np.int64) % (FINER * count)
        beside = np.minimum(beside, FINER * count - beside)
        if any(driven[max(own - FINER, 0) : own + FINER + 1].any() for own in beside):
            continue
        weights = 1.0 / np.maximum(level[:, place], np.finfo(float).tiny)
        return _refined(left, weights, frequency, 1.0 / (FINER * count))
    return None


def _above(values: Floats) -> tuple[Floats, Floats]:
    """The amplitude of each line over that of those beside it, the most of all channels (lines,).

    With the square of the latter (channels, lines).
    """
    from scipy.fft import rfft

    length = FINER * values.shape[1]
    most, level = np.zeros(length // 2 + 1), np.zeros((len(values), length // 2 + 1))
    for own, beside in zip(values, level, strict=True):  # spectra of all channels at once take five times as much
        power = np.abs(rfft(own, length)) ** 2
        for line in BESIDE:
            by = FINER * line
            beside[by:] += power[:-by]
            beside[:-by] += power[by:]
        beside /= len(BESIDE)
        power /= np.maximum(beside, np.finfo(float).tiny)
        np.maximum(most, power, out=most)
    return np.sqrt(most), level


def _refined(left: Floats, weights: Floats, near: float, by: float) -> float:
    """The frequency near one at which a line is largest, over the levels beside it: that of least squares."""
    from scipy.optimize import minimize_scalar

    ticks = np.arange(left.shape[1])

    def missed(frequency: float) -> float:
        turned = np.exp(-2j * np.pi * frequency * ticks)
        return -float(weights @ np.abs(left @ turned) ** 2)

    bounds = (near - by, near + by)
    return float(minimize_scalar(missed, bounds=bounds, method="bounded", options={"xatol": 1e-4 * by}).x)
