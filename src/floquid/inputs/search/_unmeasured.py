r"""Variances of forces that nobody measured, by what a fit leaves, and what they add to its errors.

.. math:: e = M \Big(\varepsilon + \sum_r \sqrt{P_r}\, v_r\Big), \qquad
          z_{k+1} = e^{\lambda_r \Delta} z_k + w_k, \quad v_r = \Re\, c_r(t)\, z

ε and w are white, c are the shapes over the noise, and M takes what the fit takes. The size of e, and of e through each
mode backwards in time, have means that are linear in P: they are solved for it (Rao 1971, "Estimation of variance
components by MINQUE").
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Floats
from floquid.fit import WITHIN
from floquid.inputs._modes import InputMode, followed, powers
from floquid.inputs._samples import Samples
from floquid.inputs._slopes import Part, slopes_in_parts
from floquid.inputs._solver import Equations, numbers_of, slopes_of
from floquid.inputs.search._scores import DRAWS, FEW, Scores


def unmeasured(scores: Scores) -> Floats:
    """P (modes,), zero where what is left is what noise of sensors leaves at 95 %."""
    # Real multipliers of a block, and modes of a fit that leaves nothing, have none.
    modes, found = scores.now.modes, np.zeros(len(scores.now.modes))
    if any(mode.states > 1 for mode in modes) or scores.by_noise(FEW) < WITHIN**2:
        return found
    generator, size = np.random.default_rng(0), 1 + len(modes)
    means = np.zeros((size, size))
    for _ in range(DRAWS):
        drawn = [_white(generator, scores.left), *(_driven(generator, scores, number) for number in range(len(modes)))]
        for place, own in enumerate(scores.unfitted(np.array(drawn))):
            means[:, place] += _sizes(scores, own)
    means = 0.5 * (means + means.T) / DRAWS
    scale = 1.0 / np.sqrt(np.diag(means))
    solved = np.linalg.lstsq(means * np.outer(scale, scale), _sizes(scores, scores.left) * scale)[0] * scale
    return np.asarray(np.maximum(solved[1:], 0.0), np.float64)


@dataclass(frozen=True, slots=True)
class Passed:
    """Sums over the samples of products of rows with what noise that drives a mode leaves, by that noise."""

    of_parameters: Floats  # of the slopes of the parameters beside the columns (parameters, parameters)
    of_columns: list[Floats]  # of the columns, of each output (outputs, columns, columns)


def passed(scores: Scores, at: Equations, numbers: Sequence[int]) -> list[Passed]:
    """The products of the modes with these numbers, rows over the noise."""
    now, channels = scores.now, range(len(scores.weights))
    beside = at.along @ now.inverse
    sums = [[_Through(now.modes[number]) for _ in range(1 + len(channels))] for number in numbers]
    for part in slopes_in_parts(scores.samples, now.modes, now.states, numbers_of(now)):
        columns = now.columns.of(part.samples, part.joined)
        each = zip(channels, scores.weights, beside, strict=True)
        slopes = [slopes_of(part.samples, now, c, part.rows, weight) - own @ columns for c, weight, own in each]
        for number, (of_parameters, *of_columns) in zip(numbers, sums, strict=True):
            heard, shape = scores.shape_heard(part.samples, number)
            drives = np.zeros(slopes[0].shape, complex)
            for channel, own in zip(np.flatnonzero(heard).tolist(), shape.conj(), strict=True):
                drives += own * slopes[channel]
                of_columns[channel].add(part, own * columns)
            of_parameters.add(part, drives)
    empty = np.zeros(now.inverse.shape)
    return [
        Passed(of_parameters.total, [own.total if own.parts else empty for own in of_columns])
        for of_parameters, *of_columns in sums
    ]


class _Through:
    """The sum of products of rows with what noise that drives a mode leaves, part by part of the samples."""

    def __init__(self, mode: InputMode) -> None:
        self.mode, self.parts = mode, []
        self.sum = np.zeros(())

    def add(self, part: Part, drives: NDArray) -> None:
        """Add a part, by products of its rows with the shape of the mode (rows, samples)."""
        # What later parts add to it, of a mode that is followed backwards earlier ones, is known at the end.
        mode, count = self.mode, part.own.stop - part.own.start
        rows = _back(part.samples, mode, drives)
        rate = part.samples.step * (mode.exponent.real if mode.real else mode.exponent)
        decay = powers(np.conj(-rate if mode.backwards else rate), part.samples.n_samples)
        decay = decay if mode.backwards else decay[::-1]
        inner = rows[:, :count]
        self.sum = self.sum + (inner @ inner.conj().T).real
        end = -1 if mode.backwards else 0
        mixed, size = inner @ decay[:count].conj(), float(np.sum(np.abs(decay[:count]) ** 2))
        self.parts.append((part.record, rows[:, end].copy(), decay[end], mixed, size))

    @property
    def total(self) -> Floats:
        """The sum of all parts (rows, rows)."""
        found, record, carried = self.sum.copy(), -1, np.zeros(0)
        for place, last, decay, mixed, size in self.parts if self.mode.backwards else self.parts[::-1]:
            carried = carried if place == record else np.zeros_like(last)
            both = np.outer(mixed, carried.conj()).real
            found += both + both.T + size * np.outer(carried, carried.conj()).real
            record, carried = place, last + decay * carried
        return found


def _back(samples: Samples, mode: InputMode, drives: NDArray) -> NDArray:
    """The adjoint of `followed`: the same in time reversed."""

    def turned(values: NDArray) -> NDArray:
        return samples.each(values.conj(), lambda own: own[..., ::-1])

    return turned(followed(samples, mode, turned(drives)))


def _sizes(scores: Scores, left: NDArray) -> Floats:
    """The square of what is left, and of that through each mode backwards (1 + modes,)."""
    found = [np.sum(np.abs(left) ** 2, dtype=float)]
    for number, mode in enumerate(scores.now.modes):
        heard, shape = scores.shape_heard(scores.samples, number)
        own = _back(scores.samples, mode, np.einsum("cn,cn->n", shape.conj(), left[heard]))
        found.append(np.sum(np.abs(own) ** 2, dtype=float))
    return np.array(found)


def _white(generator: np.random.Generator, like: NDArray) -> NDArray:
    return generator.standard_normal(like.shape, like.dtype)


def _driven(generator: np.random.Generator, scores: Scores, number: int) -> NDArray:
    """A draw of the response to noise that drives a mode (channels, samples)."""
    (heard, shape), mode = scores.shape_heard(scores.samples, number), scores.now.modes[number]
    noise = generator.standard_normal((2, scores.samples.n_samples))
    response = np.zeros_like(scores.left)
    response[heard] = (shape * followed(scores.samples, mode, noise[0] + 1j * noise[1])).real
    return scores.samples.kept(response)
