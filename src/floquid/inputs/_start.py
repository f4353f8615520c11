r"""Candidates for exponents by a subspace method: with modulated inputs the response is that of an LTI system.

.. math:: \dot z = \lambda z + \sum_l b_l\, \tilde u_l, \qquad \tilde u_l = e^{i l \omega t} u, \qquad
          y = \sum_m c_m e^{i m \omega t} z

Each e^{imωt} z has the pole λ + imω and the inputs ũ: the view of Allen's FSE (2009, section 2.2.3), with inputs. A
filter in time commutes with that system, so that all is thinned to the band that is looked at.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from floquid.inputs._modes import InputMode, reached_by
from floquid.inputs._samples import Samples
from floquid.inputs._solver import ROUNDING, columns_of

SIDEBANDS = (3, 2, 1)
"""Harmonics of the modulated inputs, the most that there are samples for."""

SCALES = ((1, 12), (2, 14), (4, 14), (8, 14), (4, 8))
"""Samples thinned by a factor, and the samples that predictions look back and ahead."""

ORDER = 14
"""Poles of each look."""

MOST_ROWS = 0.5
"""Rows of the past and the future over the columns, at most."""

FASTEST = 1.5
"""The largest decay between two samples of a candidate [nepers]."""

ALIKE = 0.15
"""The distance of two candidates, over their decay, within which one is enough."""

GROWN = 3.0
"""The largest growth of one over a record [nepers]."""


def candidates(samples: Samples, response: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Exponents that may be in a response (channels, samples) to the inputs, in the strip 0 ≤ Im λ ≤ ω/2."""
    found = []
    for thinned, depth in SCALES:
        for sidebands in SIDEBANDS:
            poles = _poles(samples, response, sidebands, thinned, depth)
            if poles is not None:
                found.append(poles)
                break
    poles = np.asarray(np.concatenate(found) if found else np.zeros(0), np.complex128)
    omega = samples.fundamental
    poles = poles.real + 1j * np.abs(poles.imag - omega * np.rint(poles.imag / omega))
    longest = samples.step * max(own.stop - own.start for own in samples.records)
    poles = poles[(poles.real * samples.step > -FASTEST) & (poles.real * longest < GROWN)]
    apart: list[complex] = []
    for pole in poles.tolist():
        near = ALIKE * (abs(pole.real) + 1.0 / longest)
        if all(abs(pole - other) > near for other in apart):
            apart.append(pole)
    return np.array(apart, np.complex128)


def _poles(
    samples: Samples, response: NDArray[np.float64], sidebands: int, thinned: int, depth: int
) -> NDArray[np.complex128] | None:
    """Poles by past outputs and inputs as instruments (Verhaegen 1994); None where there are too few samples."""
    from scipy.signal import firwin, lfilter

    turned = [samples.turned(turn) * samples.inputs for turn in range(1, sidebands + 1)]
    signals = np.concatenate([samples.inputs, *(part for own in turned for part in (own.real, own.imag)), response])
    size = signals.std(axis=1, keepdims=True)
    signals = signals / np.where(size > 0.0, size, 1.0)
    taps = firwin(8 * thinned + 1, 0.9 / thinned) if thinned > 1 else np.ones(1)
    count, blocks = len(response), []
    for own in samples.records:
        part = np.asarray(lfilter(taps, 1.0, signals[:, own], axis=1))[:, len(taps) - 1 :: thinned]
        columns = part.shape[1] - 2 * depth + 1
        if columns < 1:
            continue
        rows = [
            np.concatenate([part[:, lag : lag + columns] for lag in range(first, first + depth)])
            for first in (0, depth)
        ]
        place = np.arange(depth)[:, None] * len(part) + np.arange(len(part))
        inputs, outputs = place[:, :-count].ravel(), place[:, -count:].ravel()
        blocks.append(np.concatenate([rows[1][inputs], rows[0], rows[1][outputs]]))
    if not blocks:
        return None
    table = np.concatenate(blocks, axis=1)
    if len(table) > MOST_ROWS * table.shape[1]:
        return None
    lower = np.transpose(np.asarray(np.linalg.qr(table.T, mode="r")))
    first, last = depth * (len(signals) - count), len(table) - depth * count
    left, values, _ = np.linalg.svd(lower[last:, first:last], full_matrices=False)
    order = min(ORDER, (depth - 1) * count)
    observed = left[:, :order] * np.sqrt(values[:order])
    shift = np.linalg.lstsq(observed[:-count], observed[count:], rcond=None)[0]
    multipliers = np.asarray(np.linalg.eigvals(shift), np.complex128)
    poles = np.asarray(np.log(multipliers + 1e-300) / (samples.step * thinned), np.complex128)
    return poles[poles.imag >= 0.0]


def relaxed(
    samples: Samples,
    response: NDArray[np.float64],
    exponent: complex,
    reach: NDArray[np.float64],
    turns: NDArray[np.float64],
    *,
    real: bool = False,
) -> tuple[float, InputMode]:
    r"""The mode of an exponent that explains a response best, and the gain in twice the logarithm of its likelihood.

    With λ given the response is linear in the products :math:`X_{m,(i,l)} = c_m b_{i,l}`, which are fitted freely; b is
    the first left singular vector of X.
    """
    count, starts = len(samples.inputs), len(samples.records)
    longest = samples.step * max(own.stop - own.start for own in samples.records)
    bare = InputMode(
        exponent=exponent,
        real=real,
        reach=reach,
        gains=np.ones((count, len(reach)), complex),
        turns=turns,
        initial=np.ones(starts, complex),
        sizes=samples.input_size * np.sqrt(samples.step / max(abs(exponent.real), 1.0 / longest)),
    )
    drives = reached_by(samples, bare)
    columns = np.concatenate([columns_of(samples, bare, state) for state in drives])
    both = np.concatenate([columns, samples.known])
    size = np.sqrt(np.einsum("kn,kn->k", both, both))
    # A drive that is nothing, as the imaginary part of turn zero, has no column.
    size = np.where(size > 0.0, size, np.inf)
    values, vectors = np.linalg.eigh(both @ both.T / np.outer(size, size))
    good = values > ROUNDING**0.5 * values[-1]
    seen = (both @ response.T) / size[:, None]
    solved = ((vectors[:, good] / values[good]) @ (vectors[:, good].T @ seen)) / size[:, None]
    fitted = solved.T @ both
    before, after = np.mean(response**2, axis=1), np.mean((response - fitted) ** 2, axis=1)
    gain = float(response.shape[1] * np.sum(np.log(before / after)))
    products = solved[: len(columns)].reshape(len(drives), -1)
    # Each drive counts by what it does to the state.
    strength = np.sqrt(np.mean(np.abs(drives) ** 2, axis=1))
    left, _, _ = np.linalg.svd(_shapes(bare, products, len(response)) * strength[:, None], full_matrices=False)
    weights = left[:, 0] / np.where(strength > 0.0, strength, np.inf)
    inner = count * len(reach)
    if real:
        weights = np.concatenate([weights[:inner] + 1j * weights[inner : 2 * inner], weights[2 * inner :]])
    own = np.asarray(weights, np.complex128)
    return gain, replace(bare, gains=own[:inner].reshape(count, -1), initial=own[inner:]).scaled()


def _shapes(mode: InputMode, products: NDArray[np.float64], channels: int) -> NDArray:
    """Coefficients of the columns as complex ones (drives, turns · channels); of a real multiplier as they are."""
    if mode.real:
        return products
    parts = products.reshape(len(products), 2, len(mode.turns), channels)
    return (parts[:, 0] + 1j * parts[:, 1]).reshape(len(products), -1)
