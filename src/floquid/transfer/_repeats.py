"""Harmonic transfer functions from responses to inputs that repeat."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from floquid.core import Channel
from floquid.errors import IdentificationError
from floquid.findings import Finding, note, warning
from floquid.inputs import Samples, TransferFunctions
from floquid.transfer._measured import MeasuredTransfer

ALIKE = 0.02
"""The rms by which repeats of an input may differ, over its own."""

EXCITED = 1e-3
"""The amplitude of a line over the largest from which on it is one of the input."""

BESIDE = 8
"""Lines on either side whose variance over the repeats is put together."""

SURE = 1e-6
"""The probability at which noise may pass for something that is told."""

MARGIN = 0.3
"""The share of the noise above which that is told: its own level is an estimate."""


def repeat_of(samples: Samples) -> int | None:
    """The periods after which the inputs repeat, the fewest; None where they do not at least three times over."""
    inputs = samples.inputs - samples.inputs.mean(axis=1, keepdims=True)
    per_turn = 2.0 * np.pi / (samples.fundamental * samples.step)
    shortest = min(own.stop - own.start for own in samples.records)
    for turns in range(2, int(shortest / (3.0 * per_turn)) + 1):
        lag = round(turns * per_turn)
        if abs(turns * per_turn - lag) > 1e-3:
            continue
        late, early = (
            np.concatenate([inputs[:, own][:, part] for own in samples.records], axis=1)
            for part in (slice(lag, None), slice(None, -lag))
        )
        if np.sqrt(np.mean((late - early) ** 2)) < ALIKE * np.sqrt(np.mean(early**2)):
            return turns
    return None


def by_repeats(
    samples: Samples,
    turns: int,
    harmonics: Sequence[int],
    channels: tuple[tuple[Channel, ...], tuple[Channel, ...]],
    drop: int = 1,
) -> MeasuredTransfer:
    r"""G of the lines of inputs that repeat after J periods of the system, from the repeats in all records.

    .. math:: G_m(k) = \frac{\sum_r Y_r(k + mJ)\, U_r^*(k)}{\sum_r |U_r(k)|^2}, \qquad
              \mathrm{var}\, G_m(k) = \frac{s_Y^2(k + mJ)}{\sum_r |U_r(k)|^2}

    over the repeats r, with s² of what each differs from the mean of its record, over some lines. Each line of the
    response must belong to one line of one input, as those of `multisine` do (Louarroudi, Lataire and Pintelon 2012).

    Parameters
    ----------
    samples
        Outputs and inputs.
    turns
        J.
    harmonics
        The harmonics m (harmonics,).
    channels
        Those of the outputs and of the inputs.
    drop
        Repeats at the begin of each record that are left out, for the transient to die.

    Returns
    -------
    MeasuredTransfer
        G, its deviations, coherence and the level of what is not linear.

    Raises
    ------
    IdentificationError
        Fewer than two repeats are left, or lines of the response belong to two of the inputs.
    """
    count = round(turns * 2.0 * np.pi / (samples.fundamental * samples.step))
    records = _spectra(samples, count, drop)
    outputs, inputs = (np.concatenate([own[side] for own in records], axis=1) for side in (0, 1))
    repeats = outputs.shape[1]
    if repeats < len(records) + 1:
        raise IdentificationError(
            f"Of the records {repeats} whole repeats of {turns} periods are left once the first {drop} are: a variance "
            "needs two at least. Record more of them, or drop fewer."
        )
    about = [own[0] - own[0].mean(axis=1, keepdims=True) for own in records]
    spread = _beside(np.sum([np.sum(np.abs(own) ** 2, axis=1) for own in about], axis=0) / (repeats - len(records)))
    half = (count - 1) // 2 + 1
    size = np.sqrt(np.mean(np.abs(inputs) ** 2, axis=1))
    excited = size > EXCITED * size.max(axis=1, keepdims=True)
    excited[:, 0] = excited[:, half:] = False
    _refuse_collisions(excited, turns)
    places = np.flatnonzero(excited.any(axis=0))
    asked = np.unique(np.asarray(harmonics, np.int64))
    shape = (len(asked), len(outputs), len(inputs), len(places))
    values, std = np.full(shape, np.nan, complex), np.full(shape, np.nan, complex)
    for number, own in enumerate(excited):
        seen = own[places]
        driven = inputs[number][:, places[seen]]
        power = np.sum(np.abs(driven) ** 2, axis=0)
        for row, harmonic in enumerate(asked.tolist()):
            line = (places[seen] + harmonic * turns) % count
            values[row, :, number][:, seen] = np.sum(outputs[:, :, line] * driven.conj(), axis=1) / power
            std[row, :, number][:, seen] = (1.0 + 1.0j) * np.sqrt(0.5 * spread[:, line] / power)
    level, explained = spread[:, places], np.mean(np.abs(outputs[:, :, places]) ** 2, axis=1)
    nonlinear, lines = _nonlinear([own[0] for own in records], spread, excited, turns)
    found = TransferFunctions(
        frequencies_hz=places / (count * samples.step),
        harmonics=asked,
        values=values,
        std=std,
        outputs=channels[0],
        inputs=channels[1],
        step=samples.step,
    )
    return MeasuredTransfer(
        transfer=found,
        method="repeats",
        noise=2.0 / count * np.sqrt(level),
        coherence=np.clip(1.0 - level / np.maximum(explained, np.finfo(float).tiny), 0.0, 1.0),
        nonlinear=nonlinear,
        findings=(
            note("measured_repeats", repeats=repeats, turns=turns, dropped=drop),
            *_transient([own[0] for own in records], spread, drop),
            *_not_linear(nonlinear, lines, [channel.name for channel in channels[0]]),
        ),
    )


def _spectra(samples: Samples, count: int, drop: int) -> list[tuple[NDArray, NDArray]]:
    """Spectra of the outputs and of the inputs in the repeats of each record (channels, repeats, lines).

    Phases are those at phase zero of the system.
    """
    found = []
    for own in samples.records:
        both = np.concatenate([samples.values[:, own], samples.inputs[:, own]])
        whole = both[:, drop * count : both.shape[1] // count * count]
        spectra = np.fft.fft(whole.reshape(len(both), -1, count), axis=2)
        turned = spectra * np.exp(-2j * np.pi * np.fft.fftfreq(count, samples.step) * samples.times[own.start])
        found.append((turned[: len(samples.values)], turned[len(samples.values) :]))
    return found


def _beside(variance: NDArray[np.float64]) -> NDArray[np.float64]:
    """A variance over lines, each the mean of those beside it (outputs, lines)."""
    padded = np.concatenate([variance[:, -BESIDE:], variance, variance[:, :BESIDE]], axis=1)
    total = np.cumsum(np.concatenate([np.zeros((len(padded), 1)), padded], axis=1), axis=1)
    width = 2 * BESIDE + 1
    return (total[:, width:] - total[:, :-width]) / width


def _refuse_collisions(excited: NDArray[np.bool_], turns: int) -> None:
    """Refuse lines whose responses fall on one another."""
    lines = np.concatenate([np.flatnonzero(own) for own in excited])
    pairs = np.minimum(lines % turns, -lines % turns)
    if len(np.unique(pairs)) < len(pairs) or (pairs == 0).any() or (2 * pairs == turns).any():
        raise IdentificationError(
            "Lines of the inputs, or of one and its mirror image, are a multiple of the fundamental apart: the lines "
            "of the response belong to more than one of them. Take a multisine designed for it (`multisine`), or let "
            "polynomials over neighbouring lines part them (`repeat=0`)."
        )


def _nonlinear(
    records: list[NDArray], spread: NDArray[np.float64], excited: NDArray[np.bool_], turns: int
) -> tuple[NDArray[np.float64], int]:
    """The power in the classes that no line is in over that of the noise (outputs,), and how many lines those are."""
    line = np.arange(1, spread.shape[1] // 2)
    pairs = np.minimum(line % turns, -line % turns)
    used = np.concatenate([np.flatnonzero(own) for own in excited])
    taken = np.minimum(used % turns, -used % turns)
    # Lines of the period itself are those of an orbit.
    free = line[(pairs > 0) & ~np.isin(pairs, taken) & (line >= used.min() / 2.0) & (line <= 2.0 * used.max())]
    if not len(free):
        return np.full(len(spread), np.nan), 0
    parts = [
        np.mean(own.shape[1] * np.abs(own[:, :, free].mean(axis=1)) ** 2 / spread[:, free], axis=1) for own in records
    ]
    return np.mean(parts, axis=0), len(free) * len(parts)


def _transient(records: list[NDArray], spread: NDArray[np.float64], drop: int) -> list[Finding]:
    """Finding on a first repeat that differs from the last by more than noise does."""
    lines = slice(1, spread.shape[1] // 2)
    ratios = [
        np.mean(0.5 * np.abs(own[:, 0, lines] - own[:, -1, lines]) ** 2 / spread[:, lines], axis=1)
        for own in records
        if own.shape[1] > 2
    ]
    ratio, count = float(np.max(ratios, initial=0.0)), lines.stop - lines.start
    return [warning("measured_transient", ratio=ratio, dropped=drop)] if _above(ratio, count) else []


def _above(ratio: float, lines: int) -> bool:
    """True where a mean of squares of complex numbers over their variances is above 1 beyond chance."""
    return bool(lines and chdtrc(2 * lines, 2 * lines * ratio) < SURE and ratio > 1.0 + MARGIN)


def _not_linear(nonlinear: NDArray[np.float64], lines: int, names: Sequence[str]) -> list[Finding]:
    """Findings on outputs with power where a linear system has none."""
    return [
        warning("measured_nonlinear", channel=name, ratio=ratio)
        for name, ratio in zip(names, nonlinear.tolist(), strict=True)
        if _above(ratio, lines)
    ]
