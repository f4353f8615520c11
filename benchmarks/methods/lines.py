"""Transfer functions from chirps and from a scan of sines, as they were measured before multisines."""

from __future__ import annotations

import numpy as np
from benchmarks.methods.records import Case
from numpy.typing import NDArray

from floquid import Channel, Record, measure_transfer
from floquid.inputs import TransferFunctions

HARMONICS = (-1, 0, 1)

BAND = (0.02, 0.2)
"""Of chirps and scans, over the sampling rate."""

CHIRPS, DRIVEN = 4, 0.75
"""Chirps of a record, begun at phases spread over the period, and the share in which they last, for the rest to die."""

CURVATURE = 0.03
"""The weight of the curvature, tuned by hand on these records."""

SINES, REPEATS = 8, 3
"""Of a scan at most, and what each repeats, the first left out."""


def chirped(case: Case) -> NDArray[np.float64]:
    """Chirps begun at phases spread over the period, and nothing behind each (1, samples)."""
    count = case.periods // CHIRPS * case.phases
    time = np.arange(round(DRIVEN * count))
    once = np.sin(2.0 * np.pi * (BAND[0] * time + 0.5 * (BAND[1] - BAND[0]) * time**2 / len(time)))
    inputs = np.zeros((1, CHIRPS * count))
    for number in range(CHIRPS):
        begin = number * count + number * case.phases // CHIRPS
        inputs[0, begin : begin + len(time)] = once
    return inputs


def chirps(case: Case) -> TransferFunctions:
    r"""G of chirps begun at phases spread over the period, its curvature over frequency penalised (Siddiqi 2001).

    .. math:: \min \sum_{p,k} \Big|Y_p(k) - \sum_m G_m(k - mM)\, U_p(k - mM)\Big|^2
              + \alpha \sum_{m,k} |G_m(k - 1) - 2 G_m(k) + G_m(k + 1)|^2

    of records of M periods, from rest and back to it, with U over its rms; of one input.
    """
    inputs = chirped(case)
    periods, count = case.periods // CHIRPS, inputs.shape[1] // CHIRPS
    y, u = (np.fft.fft(own.reshape(-1, CHIRPS, count), axis=2) for own in (case.response(inputs, 2), inputs))
    high = round(BAND[1] * count)
    lines, seen = np.arange(-high, high + 1), np.arange(-high - periods, high + periods + 1)
    scale = np.sqrt(np.mean(np.abs(u) ** 2))
    matrix = np.zeros((CHIRPS, len(seen), len(HARMONICS), len(lines)), complex)
    for number, harmonic in enumerate(HARMONICS):
        place = np.arange(len(lines)) + (harmonic + 1) * periods
        matrix[:, place, number, np.arange(len(lines))] = u[0][:, lines] / scale
    columns = matrix.reshape(CHIRPS * len(seen), -1)
    rough = np.kron(np.eye(len(HARMONICS)), np.diff(np.eye(len(lines)), 2, axis=0))
    normal = columns.conj().T @ columns + CURVATURE * (rough.T @ rough)
    right = columns.conj().T @ (y[:, :, seen] / scale).reshape(len(y), -1).T
    found = np.linalg.solve(normal, right).reshape(len(HARMONICS), len(lines), 1, -1)
    kept = lines >= BAND[0] * count
    return TransferFunctions(
        frequencies_hz=lines[kept] / (count * case.step),
        harmonics=np.array(HARMONICS),
        values=found[:, kept].transpose(0, 3, 2, 1),
        std=None,
        outputs=tuple(Channel(name=f"y{k}") for k in range(len(y))),
        inputs=(Channel(name="u0"),),
        step=case.step,
    )


def chirps_by_polynomials(case: Case) -> TransferFunctions:
    """G of the same record by local polynomials."""
    inputs = chirped(case)
    record = case.record(case.response(inputs, 2), inputs)
    return measure_transfer(record, inputs=["u0"], harmonics=HARMONICS, method="polynomials").transfer


def scan(case: Case) -> TransferFunctions:
    """G of one sine after another in as many samples as the record, by the repeats of each (`measure_transfer`)."""
    sines = min(SINES, case.periods // (4 * REPEATS))
    turns = case.periods // (sines * REPEATS)
    count = turns * case.phases
    lines = np.unique(np.linspace(BAND[0] * count, BAND[1] * count, sines).astype(int))
    lines = np.where(2 * lines % turns == 0, lines + 1, lines)
    records: list[Record] = []
    for number, line in enumerate(lines.tolist()):
        inputs = np.tile(np.sqrt(2.0) * np.sin(2.0 * np.pi * line * np.arange(count) / count), REPEATS)[None]
        records.append(case.record(case.response(inputs, 10 + number), inputs))
    return measure_transfer(records, inputs=["u0"], harmonics=HARMONICS).transfer
