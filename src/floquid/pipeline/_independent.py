"""Channels that are refused: those that say nothing, and those that are no measurements of their own."""

from __future__ import annotations

from collections.abc import Sequence
from hashlib import sha256

import numpy as np
from numpy.typing import NDArray

from floquid._checks import input_error
from floquid.core import AzimuthSignal, Record, TachometerSignal
from floquid.lifting import refuse_values
from floquid.periodic import unexplained
from floquid.pipeline._analysis import Analysis
from floquid.pipeline._doubts import QUIET
from floquid.pipeline._validated import responses_of_model
from floquid.sync import wrapped

OWN = 0.1
"""What a channel has beside the others, over its noise, below which it has no noise of its own: 1 % of its power."""

COPIED = 0.04
"""The same below which it is a copy, but for rounding; above, sensors may share what they do not measure."""

ENOUGH = 4
"""Samples for each response from which on sums of them are looked for."""

NORMAL_QUARTILE = 0.6745
"""The median size of a normal number of unit deviation."""

NAMED = 0.01
"""The share of a channel that another must make up to be named."""

NO_NEWS = "a copy adds no knowledge, but would make the deviations too small."


def refuse_unusable(records: Sequence[Record]) -> None:
    """Refuse a response that has no samples, does not vary, wrapped round, or cannot be computed with, in any record.

    Raises
    ------
    InputError
        There is such a channel.
    """
    for number, record in enumerate(records, start=1):
        clock = record.clock.channel if isinstance(record.clock, (TachometerSignal, AzimuthSignal)) else None
        rows = [row for row, channel in enumerate(record.channels) if channel.name != clock]
        refuse_values([record.channels[row] for row in rows], record.values[rows], f"record {number}")
        for fault in wrapped(record):
            must, remedy = "hold the samples that were measured", "Read them as wider integers, or measure anew."
            raise input_error("records", "identify", must, f"in record {number} {fault.sentence}", remedy)


def refuse_copies(records: Sequence[Record]) -> None:
    """Refuse a channel or a hit that is a copy of another: its noise would count as independent of the other's.

    Raises
    ------
    InputError
        Two responses are the same, sample by sample.
    """
    seen: dict[bytes, str] = {}
    for hit, record in enumerate(records, start=1):
        for channel, values in zip(record.channels, record.values, strict=True):
            name = _name(channel.name, hit, len(records))
            found = seen.setdefault(sha256(values.tobytes()).digest(), name)
            if found != name and np.ptp(values) > 0.0:
                raise input_error(
                    "records",
                    "identify",
                    "be independent measurements",
                    f"{name} is a copy of {found}, sample by sample",
                    f"Leave one of them out: {NO_NEWS}",
                )


def sum_of_others(analysis: Analysis) -> tuple[str, float]:
    r"""What is wrong with a response that is a weighted sum of others, noise and all; empty where none is.

    .. math:: D^{-1} Y = L Q, \qquad |L_{kk}| / \sqrt{N} < 0.1

    with Y the responses (channels · hits, N samples), D their noise (of what the model leaves, without what is smooth),
    and L lower triangular: what a response has beside those before it, over its noise, is at least its own noise, but
    for a sum of the others. Records with hardly any noise are passed over: there, modes that are fewer than channels
    make sums of all of them.

    Parameters
    ----------
    analysis
        What was identified.

    Returns
    -------
    str
        A clause that names the response and those that make it up.
    float
        What it has beside them, over its noise.
    """
    records, clocks = responses_of_model(analysis)
    left = unexplained(analysis.model, records, clocks)
    if len({record.sample_rate for record in records}) > 1:
        return "", 1.0
    n = min(record.n_samples for record in records)
    rows = np.concatenate([record.values[:, :n] for record in records])
    rests = np.concatenate([own[:, :n] for own in left])
    there = np.isfinite(rests).all(axis=0)
    if there.sum() < ENOUGH * len(rows):
        return "", 1.0
    noise = np.minimum(_noise_of(rests[:, there]), _noise_of(rows[:, there]))  # a wrong model leaves more than there is
    if (noise <= QUIET * np.abs(rows[:, there]).max(axis=1)).any():
        return "", 1.0
    lower = np.asarray(np.linalg.qr((rows[:, there] / noise[:, None]).T, mode="r")).T
    beside = np.abs(np.diag(lower)) / np.sqrt(there.sum())
    if beside.min() >= OWN:
        return "", 1.0
    first = int(np.flatnonzero(beside < OWN)[0])
    names = [_name(c.name, hit, len(records)) for hit, r in enumerate(records, start=1) for c in r.channels]
    shares = np.linalg.solve(lower[:first, :first].T, lower[first, :first]) * noise[first] / noise[:first]
    own = float(beside[first])
    return _sentence(names, first, shares, np.abs(rows[:, there]).max(axis=1), own), own


def _noise_of(rests: NDArray[np.float64]) -> NDArray[np.float64]:
    """The noise of samples that may hold a response too (rows,).

    Their root mean square, or what their median second difference is in white noise, if that is less.
    """
    rough = np.median(np.abs(np.diff(rests, 2, axis=1)), axis=1) / (NORMAL_QUARTILE * np.sqrt(6.0))
    return np.minimum(np.sqrt(np.mean(rests**2, axis=1)), rough)


def _sentence(
    names: Sequence[str], first: int, shares: NDArray[np.float64], sizes: NDArray[np.float64], beside: float
) -> str:
    """«Channel 'V' is -2.54 times channel 'X' …»."""
    own = [k for k in range(first) if abs(shares[k]) * sizes[k] > NAMED * sizes[first]]
    parts = " and ".join(f"{shares[k]:.4g} times {names[k]}" for k in own)
    return f"{names[first]} is {parts}, noise and all, but for {100.0 * beside:.2g} % of its noise"


def _name(channel: str, hit: int, hits: int) -> str:
    return f"channel {channel!r}" + (f" of record {hit}" if hits > 1 else "")
