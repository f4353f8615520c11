"""Products of thinned signals at lags, formed part by part of the samples: the table of a subspace method."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import BLOCK, Floats
from floquid.fit import CHUNK
from floquid.inputs._samples import Samples


def low_pass(thinned: int) -> Floats:
    """Taps that let through what is below nine tenths of half the thinned rate (taps,): a sinc, Hamming's window."""
    half = 4 * thinned if thinned > 1 else 0
    taps = np.sinc(0.9 / thinned * np.arange(-half, half + 1)) * np.hamming(2 * half + 1)
    return taps / taps.sum()


class Thinned:
    """Inputs, as they are and modulated, and a response, of rms 1 and thinned, formed part by part of the samples."""

    def __init__(self, samples: Samples, response: Floats, turns: Sequence[int], taps: NDArray, thinned: int) -> None:
        self._samples, self._response, self._turns = samples, response, turns
        self._taps, self._thinned = taps, thinned
        self.count = len(samples.inputs) * (1 + 2 * len(turns)) + len(response)
        size = [samples.inputs.std(axis=1)]
        for turn in turns:
            turned = [samples.turned(turn) * own for own in samples.inputs]
            size += [np.array([own.real.std() for own in turned]), np.array([own.imag.std() for own in turned])]
        size = np.concatenate([*size, response.std(axis=1)])
        self._size = np.where(size > 0.0, size, 1.0)[:, None]

    def parts(self, start: int, length: int) -> Iterator[Floats]:
        """Parts one after another of as many thinned samples, the first of them beginning with the sample `start`."""
        step = max(BLOCK // (4 * self.count * self._thinned), CHUNK)
        for first in range(0, length, step):
            last = min(first + step, length) - 1
            own = slice(start + first * self._thinned, start + last * self._thinned + len(self._taps))
            part = self._samples.part(own)
            turned = [part.turned(turn) * part.inputs for turn in self._turns]
            signals = [
                part.inputs,
                *(each for both in turned for each in (both.real, both.imag)),
                self._response[:, own],
            ]
            signals = np.concatenate(signals) / self._size
            yield np.array([np.convolve(row, self._taps, "valid")[:: self._thinned] for row in signals])


def products_of_lags(parts: Iterator[Floats], count: int, lags: int) -> Floats:
    """Products of signals at lags, summed over the samples (lags · signals, lags · signals), by parts of these."""
    # The block one lag later of both is the block less its first sample, and one sample more.
    found, joined, begin = np.zeros((lags, count, lags, count)), np.zeros((count, 0)), np.zeros((count, 0))
    for part in parts:
        begin = np.concatenate([begin, part[:, : lags - 1 - begin.shape[1]]], axis=1)
        joined = np.concatenate([joined, part], axis=1)
        columns = max(joined.shape[1] - lags + 1, 0)
        for lag in range(lags):
            found[0, :, lag] += joined[:, :columns] @ joined[:, lag : lag + columns].T
        joined = joined[:, columns:]
    ends = np.stack([begin, joined], axis=1)
    for row in range(1, lags):
        gone = np.tensordot(ends[:, :, row - 1] * [1.0, -1.0], ends[:, :, row - 1 :], (1, 1))
        found[row, :, row:] = found[row - 1, :, row - 1 : -1] - np.moveaxis(gone, 1, 2)
    for row in range(1, lags):
        found[row, :, :row] = found[:row, :, row].transpose(2, 0, 1)
    return found.reshape(lags * count, lags * count)
