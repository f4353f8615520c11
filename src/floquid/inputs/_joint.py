"""Start of a search: modes chosen together from many candidates, all that is linear in them fitted at once."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from floquid.fit import HALF_DIGITS, SURE, chi2_limit, inverse_root, scaled_inverse
from floquid.inputs._modes import InputMode, reached_by
from floquid.inputs._samples import Samples
from floquid.inputs._solver import columns_of
from floquid.inputs._start import split_products


def chosen_together(
    samples: Samples, bare: Sequence[InputMode], most: int, *, acting: int | None = None
) -> list[InputMode]:
    r"""Select from many modes with known exponents and harmonics, by what they explain beside those chosen.

    With all λ given the response is linear in the products :math:`c_m b_{i,l}` of every candidate: groups of columns
    enter by the gain in likelihood (orthogonal matching pursuit, Pati et al. 1993; Swirszcz et al. 2009 for groups).
    The first inputs, `acting` of them, act on the response at once as well: all by default.
    """
    columns, places, _ = _columns(samples, bare, acting)
    columns /= _size(columns)[:, None]
    gram, seen, energy = columns @ columns.T, columns @ samples.values.T, np.sum(samples.values**2, axis=1)
    gram, seen, energy = _less(gram, seen, energy, slice(0, places[0].start if places else len(columns)))
    taken: list[int] = []
    while len(taken) < min(most, len(bare)):
        gains = [-np.inf if k in taken else _gain(gram, seen, energy, own, samples) for k, own in enumerate(places)]
        best = int(np.argmax(gains))
        if gains[best] < chi2_limit((places[best].stop - places[best].start) * len(energy), SURE):
            break
        taken.append(best)
        gram, seen, energy = _less(gram, seen, energy, places[best])
    return fitted_together(samples, samples.values, [bare[k] for k in taken], acting=acting)[1]


def fitted_together(
    samples: Samples, response: NDArray[np.float64], bare: Sequence[InputMode], *, acting: int | None = None
) -> tuple[float, list[InputMode]]:
    """Modes with known exponents and harmonics, from a response (channels, samples): all products together.

    With the gain in twice the logarithm of the likelihood, the products free. The first inputs, `acting` of them, act
    on the response at once as well: all by default.
    """
    columns, places, drives = _columns(samples, bare, acting)
    size = _size(columns)
    columns /= size[:, None]
    solved = scaled_inverse(columns @ columns.T, HALF_DIGITS) @ (columns @ response.T)
    left = response - solved.T @ columns
    gain = samples.count * float(np.sum(np.log(np.mean(response**2, axis=1) / np.mean(left**2, axis=1))))
    products = solved / size[:, None]
    modes = [
        split_products(mode, own, products[place], len(response))
        for mode, own, place in zip(bare, drives, places, strict=True)
    ]
    return gain, modes


def _columns(
    samples: Samples, bare: Sequence[InputMode], acting: int | None = None
) -> tuple[NDArray[np.float64], list[slice], list[NDArray[np.complex128]]]:
    """Columns of the inputs, of what is known and of the products of modes; the place, and the drives, of each mode."""
    drives = [reached_by(samples, mode) for mode in bare]
    groups = [
        np.concatenate([columns_of(samples, mode, state) for state in own])
        for mode, own in zip(bare, drives, strict=True)
    ]
    inputs = samples.kept(samples.inputs[:acting])
    first = len(inputs) + len(samples.known)
    ends = np.cumsum([first, *(len(own) for own in groups)]).tolist()
    return np.concatenate([inputs, samples.known, *groups]), [slice(a, b) for a, b in pairwise(ends)], drives


def _size(columns: NDArray[np.float64]) -> NDArray[np.float64]:
    """The length of each column, infinite of one that is nothing, as the imaginary part of turn zero (columns,)."""
    size = np.sqrt(np.einsum("kn,kn->k", columns, columns))
    return np.where(size > 0.0, size, np.inf)


def _taken(gram: NDArray[np.float64]) -> NDArray[np.float64]:
    """The inverse root of products of columns that were of unit length before others took their share."""
    return inverse_root(gram, HALF_DIGITS, scale=np.ones(len(gram)))


def _gain(
    gram: NDArray[np.float64],
    seen: NDArray[np.float64],
    energy: NDArray[np.float64],
    place: slice,
    samples: Samples,
) -> float:
    """The gain in twice the logarithm of the likelihood by a group of columns."""
    explained = np.sum((_taken(gram[place, place]).T @ seen[place]) ** 2, axis=0)
    return float(samples.count * np.sum(-np.log1p(-np.minimum(explained / energy, 1.0 - 1e-12))))


def _less(
    gram: NDArray[np.float64], seen: NDArray[np.float64], energy: NDArray[np.float64], place: slice
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Products of all columns less their projections on a group."""
    root = _taken(gram[place, place])
    along, own = gram[:, place] @ root, root.T @ seen[place]
    return gram - along @ along.T, seen - along @ own, energy - np.sum(own**2, axis=0)
