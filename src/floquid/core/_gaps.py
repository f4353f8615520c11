"""Runs of samples, and samples that are missing filled for the start of a search."""

from __future__ import annotations

import numpy as np

from floquid._arrays import Floats, Mask

BRIDGED = 0.2  # periods over which missing samples are filled for the start: a cubic follows no harmonic for longer


def runs_of(mask: Mask) -> list[tuple[int, int]]:
    """First and one past the last index of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def longest_run(mask: Mask) -> tuple[int, int]:
    """The first of the longest runs of True; (0, 0) where there is none."""
    return max(runs_of(mask), key=lambda run: run[1] - run[0], default=(0, 0))


def over_gaps(values: Floats, missing: Mask) -> Floats:
    """Values with the missing ones from the cubic through two samples on either side (rows, samples)."""
    there, gaps = np.flatnonzero(~missing), np.flatnonzero(missing)
    if not len(gaps) or not len(there):
        return values
    whole = np.array([np.interp(np.arange(len(missing)), there, own[there]) for own in values])
    gaps = gaps[(gaps > there[0]) & (gaps < there[-1])]
    if len(there) < 4 or not len(gaps):
        return whole
    nodes = there[np.clip(np.searchsorted(there, gaps) - 2, 0, len(there) - 4)[:, None] + np.arange(4)]
    weights = np.ones(nodes.shape)
    for k in range(4):
        for j in range(4):
            if j != k:
                weights[:, k] *= (gaps - nodes[:, j]) / (nodes[:, k] - nodes[:, j])
    whole[:, gaps] = np.sum(weights * values[:, nodes], axis=2)
    return whole
