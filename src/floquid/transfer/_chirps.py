"""Harmonic transfer functions from chirps, their curvature over frequency penalised."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from floquid.core import Channel
from floquid.errors import IdentificationError
from floquid.inputs import Samples
from floquid.transfer._measured import MeasuredTransfer, measured_of
from floquid.transfer._polynomials import chosen_lines, spectra_of, whole_periods

CURVATURE = 0.03
"""The usual weight of the curvature."""

ALIKE = 1e-3
"""The least eigenvalue of the correlations over records of what meets in a line, below which they do not part it."""


def by_chirps(
    samples: Samples,
    harmonics: Sequence[int],
    channels: tuple[tuple[Channel, ...], tuple[Channel, ...]],
    frequencies_hz: NDArray[np.float64] | int = 400,
    curvature: float = CURVATURE,
) -> MeasuredTransfer:
    r"""G at all lines at once, by least squares with its curvature over frequency penalised (Siddiqi 2001).

    .. math:: \min_G \sum_{p,k} \Big|Y_p(k) - \sum_{m,i} G_{m,i}(k - mM)\, U_{p,i}(k - mM)\Big|^2
              + \alpha \sum_{m,i,k} s_i^2\, |G_{m,i}(k - 1) - 2 G_{m,i}(k) + G_{m,i}(k + 1)|^2

    of records p of M whole periods, with s the rms of the spectrum of an input. Each record holds a chirp, from rest
    and back to rest, and they begin at different phases of the period, as many as there are harmonics of all inputs or
    more. Lines of the period itself are left out. The penalty flattens resonances by what α and the distance
    of lines make of it: no deviations are given, since most of the error is that. Where they are wanted
    `by_polynomials` has them.

    Parameters
    ----------
    samples
        Outputs and inputs.
    harmonics
        The harmonics m (harmonics,).
    channels
        Those of the outputs and of the inputs.
    frequencies_hz
        Ω/2π (frequencies,) [Hz], the nearest lines are taken; or a number of them over what the inputs excite.
    curvature
        α: more of it averages more noise, and flattens more.

    Returns
    -------
    MeasuredTransfer
        G without deviations; noise and coherence are not told.

    Raises
    ------
    IdentificationError
        The records do not part the harmonics, or no whole number of their periods is one of samples.
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


def _refuse_alike(meeting: NDArray[np.complex128]) -> None:
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
