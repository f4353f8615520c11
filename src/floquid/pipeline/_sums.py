"""Channels that are sums of others, noise and all: they tell nothing, and make all deviations too small."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from floquid._arrays import Floats
from floquid._checks import input_error, several
from floquid.core import Record
from floquid.errors import IdentificationError
from floquid.findings import Finding, warning
from floquid.fit import HALF_DIGITS, MODES
from floquid.preparation import NO_NEWS, Prepared, Settings, name_of

PAST = 2 * MODES
"""Samples before that predict a sample: as many as the terms of a response that channels may be sums of."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sum:
    """A row that is a sum of others: its number, the numbers of the others, its shares of them, what it has beside."""

    row: int
    others: tuple[int, ...]
    shares: Floats
    beside: float

    def numbers(self, names: Sequence[str]) -> dict[str, Any]:
        """The numbers of a finding, of the names of the rows."""
        others = tuple(names[row] for row in self.others)
        return {"channel": names[self.row], "shares": self.shares, "others": others, "beside": self.beside}


class SumError(IdentificationError):
    """A channel that is a sum of others: its name, and the finding that says that it was left out."""

    def __init__(self, channel: str, finding: Finding) -> None:
        super().__init__(channel, finding)
        self.channel, self.finding = channel, finding


def sum_among(rows: Floats, noise: Floats, least: float) -> Sum | None:
    r"""The first row that is a weighted sum of others, noise and all; None where there is none.

    .. math:: D^{-1} Y = L Q, \qquad |L_{kk}| / \sqrt{N - k} < a

    with Y the `rows` (rows, N), D their `noise` (rows,), L lower triangular, and a the `least`: what a row has beside
    those before it, over its noise, is at least its own noise, unless it is a sum of them.
    """
    lower = np.asarray(np.linalg.qr((rows / noise[:, None]).T, mode="r")).T
    beside = np.abs(np.diag(lower)) / np.sqrt(rows.shape[1] - np.arange(len(rows)))
    if beside.min() >= least:
        return None
    first = int(np.flatnonzero(beside < least)[0])
    shares = np.linalg.solve(lower[:first, :first].T, lower[first, :first]) * noise[first] / noise[:first]
    sizes = np.abs(rows).max(axis=1)
    own = np.flatnonzero(np.abs(shares) * sizes[:first] > HALF_DIGITS**0.5 * sizes[first])
    return Sum(row=first, others=tuple(own.tolist()), shares=shares[own], beside=float(beside[first]))


def look_for_sums(prepared: Prepared) -> None:
    """Raise SumError where an output is a sum of others to rounding, beside what its past does not predict.

    The innovations are those of all outputs on the same samples before, of outputs and inputs, and inputs at once. The
    terms of a response without noise are predicted to rounding: there, fewer modes than channels make sums of all.
    """
    names = () if prepared.parted is None else tuple(channel.name for channel in prepared.parted.inputs)
    outputs = prepared.responses[0].channels
    if len(outputs) < 2 or len({record.sample_rate for record in prepared.responses}) > 1:
        return
    signals = len(outputs) + len(names)
    lags = max(1, PAST // signals)
    most = PAST * signals * (1 + lags) // len(prepared.responses)
    found = [
        _with_past(response.values, record.select(names).values if names else response.values[:0], lags, most)
        for response, record in zip(prepared.responses, prepared.records, strict=True)
    ]
    rows, past = (np.concatenate(own, axis=1) for own in zip(*found, strict=True))
    if rows.shape[1] <= 2 * (len(rows) + len(past)):
        return
    scale = np.maximum(np.abs(past).max(axis=1, keepdims=True), np.finfo(float).tiny)
    left = rows - (np.linalg.lstsq((past / scale).T, rows.T)[0].T @ (past / scale))
    noise = np.sqrt(np.mean(left**2, axis=1))
    if (noise <= HALF_DIGITS * np.abs(rows).max(axis=1)).any():
        return
    one = sum_among(rows, noise, HALF_DIGITS**0.5)
    if one is not None:
        named = [name_of(channel.name, 1, 1) for channel in outputs]
        raise SumError(outputs[one.row].name, warning("sum_left_out", **one.numbers(named)))


def _with_past(outputs: Floats, inputs: Floats, lags: int, most: int) -> tuple[Floats, Floats]:
    """Outputs (outputs, n) and what predicts them (…, n), at up to `most` samples that are measured with their past."""
    both = np.concatenate([outputs, inputs])
    own = np.unique(np.linspace(lags, both.shape[1] - 1, most).astype(int)) if both.shape[1] > lags else np.arange(0)
    past = np.concatenate([inputs[:, own], *(both[:, own - lag] for lag in range(1, lags + 1)), np.ones((1, len(own)))])
    there = np.isfinite(past).all(axis=0) & np.isfinite(outputs[:, own]).all(axis=0)
    return outputs[:, own[there]], past[:, there]


def without(
    channel: str, records: Record | Sequence[Record], settings: Settings
) -> tuple[tuple[Record, ...], Settings]:
    """The records and settings without a channel. Raises InputError where it is one of the states asked for."""
    if channel in settings.states:
        got = f"name {channel!r}, which is a sum of others, noise included"
        raise input_error("states", "identify", "be independent measurements", got, f"Name others: {NO_NEWS}")
    hits = several(records, Record)
    left = tuple(record.select([own.name for own in record.channels if own.name != channel]) for record in hits)
    return left, replace(settings, channels=tuple(name for name in settings.channels if name != channel))
