"""Transfer functions from chirps and from a scan of sines, as they were measured before multisines."""

from __future__ import annotations

import numpy as np
from benchmarks.methods.records import Case
from numpy.typing import NDArray

from floquid import Channel, Record, measure_transfer
from floquid.inputs import TransferFunctions, samples_of
from floquid.transfer import by_chirps

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
    """G of chirps begun at phases spread over the period, its curvature over frequency penalised (Siddiqi 2001)."""
    inputs = chirped(case)
    values, count = case.response(inputs, 2), inputs.shape[1] // CHIRPS
    samples = samples_of(
        np.split(values, CHIRPS, axis=1),
        np.split(inputs, CHIRPS, axis=1),
        [number * count * case.step for number in range(CHIRPS)],
        step=case.step,
        fundamental=2.0 * np.pi / case.system.period,
    )
    channels = tuple(Channel(name=f"y{k}") for k in range(len(values))), (Channel(name="u0"),)
    hertz = np.arange(round(BAND[0] * count), round(BAND[1] * count) + 1) / (count * case.step)
    return by_chirps(samples, HARMONICS, channels, hertz, CURVATURE).transfer


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
