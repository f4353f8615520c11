r"""Candidates for exponents by a subspace method: with modulated inputs the response is that of an LTI system.

.. math:: \dot z = \lambda z + \sum_l b_l\, \tilde u_l, \qquad \tilde u_l = e^{i l \omega t} u, \qquad
          y = \sum_m c_m e^{i m \omega t} z

Each e^{imωt} z has the pole λ + imω and the inputs ũ: the view of Allen's FSE (2009, section 2.2.3), with inputs. A
filter in time commutes with that system, so that all is thinned to the band that is looked at. Products at lags are
formed part by part of the samples.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import BLOCK, Complexes, Floats
from floquid.fit import CHUNK, HALF_DIGITS, MODES, SURE, chi2_limit, inverse_root, scaled_inverse
from floquid.inputs._modes import RUNAWAY, InputMode, input_gain, runs_away
from floquid.inputs._samples import Samples
from floquid.inputs._slopes import slopes_in_parts
from floquid.inputs._solver import columns_of, turning_of
from floquid.search import GAP


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


THINNED = (1, 2, 4, 8)  # samples are thinned by these factors
ORDERS = (8, 14, 20, 28, 36, 48, 60)  # poles of each look
MANY, STRONGEST = 15, 8  # signals of a kind that are looked at as they are, at most, and the sums of more that are

FEWEST = 6
"""Block rows that tell poles, at least: a record too short for them with all outputs has them with fewer sums."""

MOST_ROWS = 0.5  # rows of the past and the future over the columns, at most


ALIKE = 0.15  # the distance of two candidates, over their decay, within which one is enough


def candidates(samples: Samples, response: Floats, *, held: bool = False) -> tuple[Complexes, Floats]:
    """Exponents that may be in a response (channels, samples) to the inputs, and how often they come up (candidates,).

    A pole of the system comes up at every order and every rate that it is looked for at, as in a diagram of
    stabilisation (Peeters and De Roeck 1999), one of noise does not: those that come up in most looks are first, each
    on the branch on which it came up most. Unless inputs may have held them by a feedback, none grows much
    over a record.
    """
    samples = replace(samples, inputs=_strongest(samples.inputs))
    response = _strongest(samples.bridged(response))
    found, turns, ages = [], [], []
    omega = samples.fundamental
    for number, thinned in enumerate(THINNED):
        poles = _poles(samples, response, thinned)
        for place, own in enumerate(poles):
            turn = np.rint(own.imag / omega)
            found.append(own - 1j * turn * omega)
            turns.append(turn)
            ages.append(np.full(len(own), number * len(ORDERS) + place))
    if not found:
        return np.zeros(0, np.complex128), np.zeros(0)
    poles = np.asarray(np.concatenate(found), np.complex128)
    branch, look = np.asarray(np.concatenate(turns), np.float64), np.concatenate(ages)
    longest = samples.step * max(own.stop - own.start for own in samples.records)
    good = (poles.real * samples.step > -np.pi) & (held | (poles.real * longest < RUNAWAY))
    # Of a pair both folds are there: the one of positive frequency is kept.
    poles, branch, look = poles[good], branch[good], look[good]
    below = poles.imag < 0.0
    poles = np.asarray(np.where(below, poles.conj(), poles), np.complex128)
    branch = np.where(below, -branch, branch)
    apart: list[complex] = []
    shares: list[float] = []
    looks = (look[:, None] == np.unique(look)).astype(float)
    near = np.abs(poles[:, None] - poles) < ALIKE * (np.abs(poles.real) + 1.0 / longest)[:, None]
    free = np.ones(len(poles), bool)
    while free.any() and len(apart) < MODES:
        votes = np.count_nonzero((near & free) @ looks, axis=1) * free
        best = int(np.argmax(votes))
        own = near[best] & free
        shares.append(float(votes[best]) / looks.shape[1])
        centre = np.median(poles[own].real) + 1j * np.median(poles[own].imag)
        values, counts = np.unique(branch[own], return_counts=True)
        turn = values[np.argmax(counts - 1e-3 * np.abs(values))]
        apart.append(complex(centre + 1j * turn * omega))
        free &= ~own
    return np.array(apart, np.complex128), np.array(shares)


def _poles(samples: Samples, response: Floats, thinned: int) -> list[Complexes]:
    """Poles of several orders, by past outputs and inputs as instruments (Verhaegen 1994); none of too few samples."""
    taps = low_pass(thinned)
    lengths = [(own.stop - own.start - len(taps) + thinned) // thinned for own in samples.stretches]
    most = MOST_ROWS * sum(max(n - 2 * FEWEST + 1, 0) for n in lengths) / (2 * FEWEST)
    room = int(most) - len(samples.inputs) * (1 + 2)
    if room < 1:
        return []
    if len(response) > room:
        response = _sums(response, room)
    count = len(response)
    looks = []
    for sidebands in range(GAP, 0, -1):  # the most that there are samples for
        signals = len(samples.inputs) * (1 + 2 * sidebands) + count
        depth = min(int(np.ceil(ORDERS[-1] / count)) + 2, 40)
        while depth >= FEWEST and 2 * depth * signals > MOST_ROWS * sum(max(n - 2 * depth + 1, 0) for n in lengths):
            depth -= 2 if depth > FEWEST + 1 else 1
        if depth < FEWEST:
            continue
        looks.append((sidebands, depth))
        if (depth - 1) * count >= ORDERS[1]:
            break
    if not looks:
        return []
    sidebands, depth = max(looks, key=lambda own: min(own[1] - 1, -(-ORDERS[1] // count)))
    looked = Thinned(samples, response, range(1, sidebands + 1), taps, thinned)
    rows = 2 * depth * looked.count
    gram = np.zeros((rows, rows))
    for own, length in zip(samples.stretches, lengths, strict=True):
        if length > 2 * depth:
            gram += products_of_lags(looked.parts(own.start, length), looked.count, 2 * depth)
    place = np.arange(2 * depth)[:, None] * looked.count + np.arange(looked.count)
    past, inputs, outputs = place[:depth].ravel(), place[depth:, :-count].ravel(), place[depth:, -count:].ravel()
    order = np.concatenate([inputs, past, outputs])
    gram = gram[np.ix_(order, order)]
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-12 * np.diag(gram).max()))
    gram /= scale
    gram /= scale[:, None]
    lower, rounding = _lower(gram)
    lower *= scale[:, None]
    first, last = len(inputs), len(inputs) + len(past)
    left, values, _ = np.linalg.svd(lower[last:, first:last], full_matrices=False)
    # Of a response that few poles explain all others are rounding: they would come up, too, and shift those that are.
    rank = int(np.count_nonzero(values > rounding * scale[last:].max()))
    found = []
    for wanted in ORDERS:
        if wanted > min((depth - 1) * count, rank):
            break
        observed = left[:, :wanted] * np.sqrt(values[:wanted])
        shift = np.linalg.lstsq(observed[:-count], observed[count:], rcond=None)[0]
        multipliers = np.asarray(np.linalg.eigvals(shift), np.complex128)
        found.append(np.asarray(np.log(multipliers + 1e-300), np.complex128) / (samples.step * thinned))
    return found


def _strongest(signals: Floats) -> Floats:
    """The strongest sums of many signals; few signals as they are (…, samples)."""
    return signals if len(signals) <= MANY else _sums(signals, STRONGEST)


def _sums(signals: Floats, most: int) -> Floats:
    """The first singular vectors of signals, each counted by its rms (most, samples)."""
    size = np.sqrt(np.mean(signals**2, axis=1, keepdims=True))
    scaled = signals / np.where(size > 0.0, size, 1.0)
    return np.asarray(np.linalg.eigh(scaled @ scaled.T)[1][:, -most:].T @ scaled, np.float64)


def _lower(matrix: Floats) -> tuple[Floats, float]:
    """The triangular factor of a matrix of products, with as much more on its diagonal as rounding needs."""
    # With the root of that: what the factor holds below it is rounding.
    for more in (1e-12, 1e-9, 1e-6):
        with suppress(np.linalg.LinAlgError):
            larger = matrix.copy()
            np.fill_diagonal(larger, np.diag(matrix) + more)
            return np.asarray(np.linalg.cholesky(larger), np.float64), more**0.5
    # Of inputs that are zero at most lags, as of blows, some products are rounding of those of others.
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray(np.linalg.qr((vectors * np.sqrt(np.maximum(values, 1e-6))).T)[1].T, np.float64), 1e-3


def bare_mode(samples: Samples, exponent: complex, reach: Floats, turns: Floats, *, real: bool = False) -> InputMode:
    """A mode with only exponent and harmonics known."""
    count, starts = len(samples.inputs), len(samples.records)
    longest = samples.step * max(own.stop - own.start for own in samples.records)
    return InputMode(
        exponent=exponent,
        real=real,
        reach=reach,
        gains=np.ones((count, len(reach)), complex),
        turns=turns,
        initial=np.ones(starts, complex),
        sizes=samples.input_size * np.sqrt(samples.step / max(abs(exponent.real), 1.0 / longest)),
        backwards=runs_away(samples, exponent),
    )


def answering(samples: Samples, mode: InputMode, other: Samples, delay: int) -> InputMode:
    """A mode with b such that it answers to other inputs as to these, except for the first samples of each answer."""
    # The other inputs are these some samples later, or with another hold.
    decay, ratios = np.exp(mode.exponent * samples.step), []
    for turn in mode.reach.tolist():
        both = [input_gain(mode.exponent, turn, own.fundamental, own.step, own.hold) for own in (samples, other)]
        said, acts = (now + decay * then for now, then in both)
        ratios.append(said / acts * np.exp((mode.exponent - 1j * turn * samples.fundamental) * delay * samples.step))
    return replace(mode, gains=mode.gains * np.array(ratios))


def split_products(bare: InputMode, strength: Floats, products: Floats, channels: int) -> InputMode:
    """A mode by its products c b (drives · columns, channels): b is their first left singular vector."""
    # Each drive counts by what it does to the state: by the rms of that (drives,).
    shapes = _shapes(bare, products.reshape(len(strength), -1), channels) * strength[:, None]
    left, _, _ = np.linalg.svd(shapes, full_matrices=False)
    weights = left[:, 0] / np.where(strength > 0.0, strength, np.inf)
    inner = bare.gains.size
    if bare.real:
        weights = np.concatenate([weights[:inner] + 1j * weights[inner : 2 * inner], weights[2 * inner :]])
    own = np.asarray(weights, np.complex128)
    return replace(bare, gains=own[:inner].reshape(bare.gains.shape), initial=own[inner:]).scaled()


def _shapes(mode: InputMode, products: Floats, channels: int) -> NDArray:
    """Coefficients of the columns as complex ones (drives, turns · channels); of a real multiplier as they are."""
    if mode.real:
        return products
    parts = products.reshape(len(products), 2, len(mode.turns), channels)
    return (parts[:, 0] + 1j * parts[:, 1]).reshape(len(products), -1)


def chosen_together(
    samples: Samples, bare: Sequence[InputMode], most: int, *, acting: int | None = None
) -> list[InputMode]:
    r"""Select from many modes with known exponents and harmonics, by what they explain beside those chosen.

    With all λ given the response is linear in the products :math:`c_m b_{i,l}` of every candidate: groups of columns
    enter by the gain in likelihood (orthogonal matching pursuit, Pati et al. 1993; Swirszcz et al. 2009 for groups).
    The first inputs, `acting` of them, act on the response at once as well: all by default.
    """
    columns, energy = _Products(samples, bare, acting), np.sum(samples.values**2, axis=1)
    gram, seen, _, _ = columns.sums(samples.values)
    places = columns.places
    gram, seen, energy = _less(gram, seen, energy, slice(0, places[0].start if places else len(gram)))
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
    samples: Samples, response: Floats, bare: Sequence[InputMode], *, acting: int | None = None
) -> tuple[float, list[InputMode]]:
    """Modes with known exponents and harmonics, from a response (channels, samples): all products together."""
    columns = _Products(samples, bare, acting)
    gram, seen, size, strengths = columns.sums(response)
    solved, energy = scaled_inverse(gram, HALF_DIGITS) @ seen, np.sum(response**2, axis=1)
    products = solved / size[:, None]
    squares = energy - np.sum(solved * (2.0 * seen - gram @ solved), axis=0)
    if np.any(
        squares < HALF_DIGITS * energy
    ):  # all but nothing is left: of the difference half the digits are rounding
        squares = np.zeros(len(response))
        for own, part, _ in columns:
            squares += np.sum((response[:, own] - products.T @ part) ** 2, axis=1)
    gain = samples.count * float(np.sum(np.log(energy / squares)))
    modes = [
        split_products(mode, strength, products[place], len(response))
        for mode, strength, place in zip(bare, strengths, columns.places, strict=True)
    ]
    return gain, modes


class _Products:
    """Columns of the inputs, of what is known and of the products of modes, formed part by part of the samples."""

    def __init__(self, samples: Samples, bare: Sequence[InputMode], acting: int | None = None) -> None:
        self._samples, self._bare, self._acting = samples, bare, acting
        drives = [(1 + mode.real) * mode.gains.size + len(mode.initial) for mode in bare]
        counts = [own * (len(mode.turns) + int(turning_of(mode).sum())) for mode, own in zip(bare, drives, strict=True)]
        ends = np.cumsum([len(samples.inputs[:acting]) + len(samples.known), *counts]).tolist()
        self.places, self.count = [slice(a, b) for a, b in pairwise(ends)], ends[-1]  # those of each mode, and of all

    def __iter__(self) -> Iterator[tuple[slice, Floats, list[NDArray]]]:
        """Parts of the samples with the columns (columns, samples) and the drives of each mode (drives, samples)."""
        samples, bare = self._samples, self._bare
        for part in slopes_in_parts(samples, bare, [None] * len(bare), 2 * self.count):
            here = part.alone
            groups = [
                columns_of(here.samples, mode, state)
                for mode, rows in zip(bare, here.rows, strict=True)
                for state in rows
            ]
            inputs = here.samples.kept(here.samples.inputs[: self._acting])
            yield part.own, np.concatenate([inputs, here.samples.known, *groups]), here.rows

    def sums(self, response: Floats) -> tuple[Floats, Floats, Floats, list[Floats]]:
        """Products of columns, over their lengths, with one another and a response, the lengths, the drives' rms."""
        gram, seen = np.zeros((self.count, self.count)), np.zeros((self.count, len(response)))
        squares = [0.0] * len(self._bare)
        for own, columns, drives in self:
            gram += columns @ columns.T
            seen += columns @ response[:, own].T
            squares = [one + np.sum(np.abs(rows) ** 2, axis=1) for one, rows in zip(squares, drives, strict=True)]
        size = np.sqrt(np.diag(gram))
        size = np.where(size > 0.0, size, np.inf)
        strengths = [np.sqrt(own / self._samples.n_samples) for own in squares]
        return gram / size / size[:, None], seen / size[:, None], size, strengths


def _taken(gram: Floats) -> Floats:
    """The inverse root of products of columns that were of unit length before others took their share."""
    return inverse_root(gram, HALF_DIGITS, scale=np.ones(len(gram)))


def _gain(gram: Floats, seen: Floats, energy: Floats, place: slice, samples: Samples) -> float:
    """The gain in twice the logarithm of the likelihood by a group of columns."""
    explained = np.sum((_taken(gram[place, place]).T @ seen[place]) ** 2, axis=0)
    return float(samples.count * np.sum(-np.log1p(-np.minimum(explained / energy, 1.0 - 1e-12))))


def _less(gram: Floats, seen: Floats, energy: Floats, place: slice) -> tuple[Floats, Floats, Floats]:
    """Products of all columns less their projections on a group."""
    root = _taken(gram[place, place])
    along, own = gram[:, place] @ root, root.T @ seen[place]
    return gram - along @ along.T, seen - along @ own, energy - np.sum(own**2, axis=0)
