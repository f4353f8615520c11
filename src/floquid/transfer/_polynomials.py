"""Harmonic transfer functions from broad-band inputs: polynomials over neighbouring lines, smooth curves of chirps."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import BLOCK, Complexes, Floats, Integers
from floquid.core import Channel
from floquid.errors import IdentificationError
from floquid.findings import Finding, note, warning
from floquid.fit import SURE
from floquid.inputs import LEAKAGE, Samples
from floquid.transfer._measured import MeasuredTransfer, measured_of

DEGREE = 2  # degree of the polynomials
FREE = (20, 0.6)  # lines of a window beyond the unknowns: a number, and a share of them more

POOR = 1e6
"""The variance of G, over that from inputs of the same power at every line, from which on they have none to tell it."""

BENT = 12  # windows in which G bends most, for which polynomials of one degree more are tried,
WORSE = 1.6  # and the gain over the noise of them that is told


def by_polynomials(
    samples: Samples,
    harmonics: Sequence[int],
    channels: tuple[tuple[Channel, ...], tuple[Channel, ...]],
    frequencies_hz: Floats | int = 400,
    reference: Floats | None = None,
) -> MeasuredTransfer:
    r"""G by least squares over the lines beside each (local polynomial method).

    .. math:: Y(k + r) = \sum_{m,i} \Big(\sum_{s=0}^{2} g_{m,i,s}\, r^s\Big) U_i(k + r - mM) + \sum_{s=0}^{2} t_s r^s
              + \text{noise}

    of records of M whole periods; t is the transient. `Schoukens, Vandersteen, Barbé and Pintelon (2009)`, with the
    inputs modulated as Louarroudi, Lataire and Pintelon (2012) have them. G must vary little over a window: a resonance
    needs some fifty lines over half of its width.

    With a reference R, as many channels as inputs, the equations are held against R in the place of U (instrumental
    variables), all harmonics at once: what R knows nothing of, noise on an input or what a feedback makes of that of
    the outputs, is then no bias.
    """
    asked = np.unique(np.asarray(harmonics, np.int64))
    periods, count = whole_periods(samples)
    outputs, inputs = (spectra_of(samples, own, count) for own in (samples.values, samples.inputs))
    known = inputs if reference is None else spectra_of(samples, reference, count)
    size, also = (np.sqrt(np.mean(np.abs(own) ** 2, axis=(0, 2))) for own in (inputs, known))
    inputs, known = inputs / size[:, None], known / also[:, None]  # units do not matter
    lines, records = chosen_lines(known, frequencies_hz, samples.step), len(outputs)
    unknowns = (DEGREE + 1) * (len(asked) * inputs.shape[1] + records)
    half = int(np.ceil(0.5 * (unknowns + max(FREE[0], FREE[1] * unknowns)) / records))
    if 4 * half > count // 2:
        raise IdentificationError(
            f"The records hold {periods} whole periods, {count // 2} lines: too few for {unknowns} unknowns in windows "
            f"of {2 * half + 1} lines. Record for longer, or ask for fewer harmonics."
        )
    shape = (len(asked), outputs.shape[1], inputs.shape[1], len(lines))
    values, std = np.zeros(shape, complex), np.zeros(shape, complex)
    noise, explained = np.zeros((outputs.shape[1], len(lines))), np.zeros((outputs.shape[1], len(lines)))
    bends = np.zeros((len(asked), len(lines)))
    even = 1.0 / (records * (2 * half + 1))
    together = max(BLOCK // (unknowns * records * (2 * half + 1)), 1)  # windows that are solved at once
    for row, begin in product(range(len(asked)), range(0, len(lines), together)):
        own = slice(begin, begin + together)
        middle = lines[own] + asked[row] * periods
        solved, variance, left, share = _windows(outputs, (inputs, known), middle, asked, periods, half)
        driven = slice(0, (DEGREE + 1) * len(asked) * inputs.shape[1])
        bend = np.abs(solved) ** 2 / (variance[:, :, None] * left[:, None, :])
        bends[row, own] = (
            bend[:, driven].reshape(len(middle), -1, DEGREE + 1, outputs.shape[1])[:, :, 2].max(axis=(1, 2))
        )
        place = (DEGREE + 1) * inputs.shape[1] * row + (DEGREE + 1) * np.arange(inputs.shape[1])
        # Between the lines of a multisine the equations are of rounding alone.
        told = np.where(variance[:, place, None] < POOR * even, variance[:, place, None], np.nan)
        g = np.where(np.isfinite(told), solved[:, place], np.nan)
        values[row, :, :, own] = np.moveaxis(g, 0, -1).swapaxes(0, 1)
        spread = np.sqrt(0.5 * told * left[:, None, :])
        std[row, :, :, own] = (1.0 + 1.0j) * np.moveaxis(spread, 0, -1).swapaxes(0, 1)
        if asked[row] == 0 or (row == 0 and 0 not in asked):
            noise[:, own], explained[:, own] = 2.0 / count * np.sqrt(left.T), share.T
    values, std = values / size[:, None], std / size[:, None]
    _refuse_lines(values, lines / (count * samples.step))
    return measured_of(
        samples,
        channels,
        (lines, count),
        asked,
        (values, std),
        method="polynomials",
        noise=noise,
        coherence=explained,
        nonlinear=np.full(outputs.shape[1], np.nan),
        echoes=np.zeros((0, inputs.shape[1], len(lines)), complex),
        begins=np.zeros(0),
        findings=(
            note("measured_polynomials", lines=2 * half + 1, width=(2 * half + 1) / (count * samples.step)),
            *_flattened(outputs, (inputs, known), lines + asked[:, None] * periods, bends, asked, periods, half),
        ),
    )


def _refuse_lines(values: Complexes, hertz: Floats) -> None:
    """Refuse inputs that tell G at fewer than half of the frequencies (harmonics, outputs, inputs, frequencies)."""
    without = np.isnan(values).any(axis=(0, 1, 2))
    if 2 * np.count_nonzero(without) > len(hertz):
        raise IdentificationError(
            f"The inputs have no power between their lines at {np.count_nonzero(without)} of {len(hertz)} "
            f"frequencies, as at {hertz[without][0]:.4g} Hz, so G is not determined there. For a multisine that "
            'repeats use its lines (`method="repeats"`), or drive the system with a broad-band input.'
        )


def _flattened(
    outputs: NDArray,
    inputs: tuple[NDArray, NDArray],
    middle: Integers,
    bends: Floats,
    harmonics: Integers,
    periods: int,
    half: int,
) -> list[Finding]:
    """Finding where polynomials of a higher degree leave less than noise, in windows in which G bends most."""
    from scipy.special import fdtrc

    order, chosen = np.argsort(-bends, axis=None), []
    for line in middle.ravel()[order].tolist():
        if all(abs(line - other) > 2 * half for other in chosen):
            chosen.append(line)
        if len(chosen) == BENT:
            break
    both = [_windows(outputs, inputs, np.array(chosen), harmonics, periods, half, DEGREE + more) for more in (0, 1)]
    lines = len(outputs) * (2 * half + 1)
    (low, few), (high, many) = ((np.sum(one[2], axis=0), one[0].shape[1]) for one in both)
    free, more = lines - many, many - few
    gain = ((lines - few) * low - free * high) / more / high
    degrees = 2.0 * len(chosen)
    sure = fdtrc(degrees * more, degrees * free, gain) * len(gain) < SURE
    return [warning("measured_flattened", ratio=float(gain.max()))] if (sure & (gain > WORSE)).any() else []


def whole_periods(samples: Samples) -> tuple[int, int]:
    """The most whole periods that each record holds, in a whole number of samples, and that number."""
    per_turn = 2.0 * np.pi / (samples.fundamental * samples.step)
    most = int(min(own.stop - own.start for own in samples.records) / per_turn + 1e-6)
    for periods in range(most, most // 2, -1):
        if abs(periods * per_turn - round(periods * per_turn)) < LEAKAGE:
            return periods, round(periods * per_turn)
    raise IdentificationError(
        f"No whole number of periods between {most // 2 + 1} and {most} is one of samples ({per_turn:.8g} a period): "
        "lines of the response would leak. Resample the record to a whole number of samples a period."
    )


def spectra_of(samples: Samples, signals: Floats, count: int) -> Complexes:
    """Spectra of the first samples of each record, their phases those at phase zero (records, signals, lines)."""
    turned = np.exp(-2j * np.pi * np.fft.fftfreq(count, samples.step) * samples.first_times[:, None, None])
    return np.array([np.fft.fft(signals[:, own.start : own.start + count]) for own in samples.records]) * turned


def chosen_lines(inputs: NDArray, frequencies_hz: Floats | int, step: float) -> Integers:
    """The lines nearest to frequencies [Hz], or a number of them over what inputs (records, inputs, lines) excite."""
    if isinstance(frequencies_hz, int):
        return _excited(inputs, frequencies_hz)
    return np.unique(np.rint(frequencies_hz * inputs.shape[2] * step).astype(int))


def _excited(inputs: NDArray, count: int) -> Integers:
    """Lines, a number at most, over the band in which the inputs have their power."""
    half = inputs.shape[2] // 2
    power = np.sum(np.abs(inputs[:, :, 1:half]) ** 2, axis=(0, 1))
    share = np.cumsum(power) / power.sum()
    low, high = 1 + int(np.searchsorted(share, 5e-3)), 1 + int(np.searchsorted(share, 0.995))
    return np.unique(np.linspace(low, high, count).astype(np.int64))


def _windows(
    outputs: NDArray,
    inputs: tuple[NDArray, NDArray],
    middle: Integers,
    harmonics: Integers,
    periods: int,
    half: int,
    degree: int = DEGREE,
) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Solutions in windows about some lines of the response (windows, unknowns, outputs), and their quality."""
    records, count = len(outputs), outputs.shape[2]
    offsets = np.arange(-half, half + 1)
    line = (middle[:, None] + offsets) % count
    powers = (offsets / half)[:, None] ** np.arange(degree + 1)
    shifted = (line[:, None, :] - harmonics[:, None] * periods) % count
    # Lines of the period itself belong to what repeats with it, an orbit or an imbalance.
    used = (line % periods != 0).astype(float)

    def columns(signals: NDArray) -> NDArray:
        """Signals modulated by each harmonic, and a transient of each record, times powers."""
        blocks = []
        for record in range(records):
            driven = np.moveaxis(signals[record][:, shifted], 0, 2)  # windows, harmonics, inputs, lines
            regressors = driven.reshape(len(line), -1, len(offsets))[..., None] * powers
            flat = np.moveaxis(regressors, 2, 1).reshape(len(line), len(offsets), -1)
            transient = np.zeros((len(line), len(offsets), records * (degree + 1)), complex)
            transient[..., record * (degree + 1) : (record + 1) * (degree + 1)] = powers
            blocks.append(np.concatenate([flat, transient], axis=2) * used[..., None])
        return np.concatenate(blocks, axis=1)

    matrix = columns(inputs[0])
    right = np.concatenate([np.moveaxis(own[:, line], 0, 2) * used[..., None] for own in outputs], axis=1)
    size = np.sqrt(np.sum(np.abs(matrix) ** 2, axis=1, keepdims=True))
    size = np.where(size > 0.0, size, 1.0)
    held = matrix if inputs[1] is inputs[0] else columns(inputs[1])
    orthogonal = np.linalg.qr(held / size)[0]
    against = orthogonal.conj().swapaxes(1, 2)
    normal = against @ (matrix / size)
    normal[np.linalg.det(normal) == 0.0] = np.nan  # inputs with lines that are zero to the last bit
    inverse = np.linalg.inv(normal)
    solved = inverse @ (against @ right) / size.swapaxes(1, 2)
    left = right - matrix @ solved
    free = records * used.sum(axis=1) - matrix.shape[2]
    variance = np.sum(np.abs(left) ** 2, axis=1) / free[:, None]
    power = np.sum(np.abs(right) ** 2, axis=1) / (records * used.sum(axis=1))[:, None]
    spread = np.sum(np.abs(inverse) ** 2, axis=2) / size[:, 0] ** 2
    return solved, spread, variance, np.clip(1.0 - variance / np.maximum(power, np.finfo(float).tiny), 0.0, 1.0)


CURVATURE = 0.03  # the usual weight of the curvature

ALIKE = 1e-3
"""The least eigenvalue of the correlations over records of what meets in a line, below which they do not part it."""


def by_chirps(
    samples: Samples,
    harmonics: Sequence[int],
    channels: tuple[tuple[Channel, ...], tuple[Channel, ...]],
    frequencies_hz: Floats | int = 400,
    curvature: float = CURVATURE,
) -> MeasuredTransfer:
    r"""G at all lines at once, by least squares with its curvature over frequency penalised (Siddiqi 2001).

    .. math:: \min_G \sum_{p,k} \Big|Y_p(k) - \sum_{m,i} G_{m,i}(k - mM)\, U_{p,i}(k - mM)\Big|^2
              + \alpha \sum_{m,i,k} s_i^2\, |G_{m,i}(k - 1) - 2 G_{m,i}(k) + G_{m,i}(k + 1)|^2

    of records p of M whole periods, with s the rms of the spectrum of an input. Each record holds a chirp, from rest
    and back to rest, and they begin at different phases of the period, as many as there are harmonics of all inputs or
    more. Lines of the period itself are left out. The penalty flattens resonances by what α and the distance
    of lines make of it: no deviations are given, since most of the error is that. Where they are wanted
    `by_polynomials` has them, nor are noise and coherence told.
    """
    from scipy.sparse import csc_array, diags_array, kron
    from scipy.sparse.linalg import splu

    asked = np.unique(np.asarray(harmonics, np.int64))
    number = len(asked) * len(samples.inputs)
    periods, count = whole_periods(samples)
    outputs, inputs = (spectra_of(samples, own, count) for own in (samples.values, samples.inputs))
    lines = chosen_lines(inputs, frequencies_hz, samples.step)
    _refuse_alike(inputs[:, :, (lines[:, None] - asked * periods) % count])
    size = np.sqrt(np.mean(np.abs(inputs) ** 2, axis=(0, 2)))
    # Lines by their residue modulo M, and then by harmonic: what meets in one line of the response stands together.
    line = np.arange(count)
    place = np.argsort(np.argsort(line % periods, kind="stable"))
    used = line % periods != 0
    rows, columns, values = [], [], []
    for record, own in enumerate(inputs):
        for row, harmonic in enumerate(asked.tolist()):
            answered = (line + harmonic * periods) % count
            for source in range(len(size)):
                rows.append(record * count + answered)
                columns.append(place * number + row * len(size) + source)
                values.append(own[source] / size[source] * used[answered])
    shape = (len(inputs) * count, count * number)
    matrix = csc_array((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=shape)
    moved = csc_array((np.ones(count), (place, place[(line + 1) % count])), shape=(count, count))
    bent = moved - 2.0 * diags_array(np.ones(count)) + moved.T
    rough = kron(bent.T @ bent, diags_array(np.ones(number)))
    against = matrix.conj().T
    right = against @ np.concatenate(list(outputs * used), axis=1).T
    solved = splu(csc_array(against @ matrix + curvature * rough), permc_spec="NATURAL").solve(right)
    g = solved.reshape(count, len(asked), len(size), -1)[place] / size[:, None]
    untold = np.full((len(outputs[0]), len(lines)), np.nan)
    return measured_of(
        samples,
        channels,
        (lines, count),
        asked,
        (g[lines].transpose(1, 3, 2, 0), None),
        method="chirps",
        noise=untold,
        coherence=untold,
        nonlinear=untold.mean(axis=1),
        echoes=np.zeros((0, len(size), len(lines)), complex),
        begins=np.zeros(0),
    )


def _refuse_alike(meeting: Complexes) -> None:
    """Refuse records whose inputs (records, inputs, lines, harmonics) are in each line one another's sum."""
    parts = np.moveaxis(meeting, 2, 0).reshape(meeting.shape[2], len(meeting), -1)
    power = np.sum(np.abs(parts) ** 2, axis=1)
    unit = parts / np.sqrt(np.maximum(power, np.finfo(float).tiny))[:, None]
    least = np.linalg.eigvalsh(unit.conj().swapaxes(1, 2) @ unit)[:, 0]
    if least @ power.min(axis=1) < ALIKE * power.min(axis=1).sum():
        raise IdentificationError(
            f"{len(meeting)} records do not part {parts.shape[2]} transfer functions of each output. At "
            "least as many chirps are needed, begun at different phases of the period. Record more, or ask for fewer "
            "harmonics."
        )
