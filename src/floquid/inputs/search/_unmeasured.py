r"""Variances of forces that nobody measured, by what a fit leaves, and what they add to its errors.

.. math:: e = M \Big(\varepsilon + \sum_r \sqrt{P_r}\, v_r\Big), \qquad
          z_{k+1} = e^{\lambda_r \Delta} z_k + w_k, \quad v_r = \Re\, c_r(t)\, z

ε and w are white, c are the shapes over the noise, and M takes what the fit takes. The size of e, and of e through each
mode backwards in time, have means that are linear in P: they are solved for it (Rao 1971, "Estimation of variance
components by MINQUE").
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from floquid.fit import WITHIN
from floquid.inputs._modes import InputMode, followed
from floquid.inputs._samples import Samples
from floquid.inputs.search._scores import DRAWS, FEW, Scores


def unmeasured(scores: Scores) -> NDArray[np.float64]:
    """P (modes,), zero where what is left is what noise of sensors leaves at 95 %."""
    # Real multipliers of a block, and modes of a fit that leaves nothing, have none.
    modes, found = scores.now.modes, np.zeros(len(scores.now.modes))
    if any(mode.states > 1 for mode in modes) or scores.by_noise(FEW) < WITHIN**2:
        return found
    generator, size = np.random.default_rng(0), 1 + len(modes)
    means = np.zeros((size, size))
    for _ in range(DRAWS):
        means[:, 0] += _sizes(scores, scores.unfitted(_white(generator, scores.left)))
        for number in range(len(modes)):
            means[:, 1 + number] += _sizes(scores, scores.unfitted(_driven(generator, scores, number)))
    means = 0.5 * (means + means.T) / DRAWS
    scale = 1.0 / np.sqrt(np.diag(means))
    solved = np.linalg.lstsq(means * np.outer(scale, scale), _sizes(scores, scores.left) * scale)[0] * scale
    return np.asarray(np.maximum(solved[1:], 0.0), np.float64)


def driving(scores: Scores, number: int, channel: int, rows: NDArray[np.float64]) -> NDArray:
    """Products of rows of a channel over its noise with the shape of a mode (…, samples), zero where not heard."""
    heard, shape = scores.shapes_heard[number]
    return shape[np.sum(heard[:channel])].conj() * rows if heard[channel] else 0.0 * rows


def through(scores: Scores, number: int, drives: NDArray) -> NDArray:
    """Products of rows with what noise that drives a mode leaves, by that noise at each sample (…, samples)."""
    # Rows go in by the sum over the channels of their `driving`.
    return _back(scores.samples, scores.now.modes[number], drives)


def _back(samples: Samples, mode: InputMode, drives: NDArray) -> NDArray:
    """The adjoint of `followed`: the same in time reversed."""

    def turned(values: NDArray) -> NDArray:
        return samples.each(values.conj(), lambda own: own[..., ::-1])

    return turned(followed(samples, mode, turned(drives)))


def _sizes(scores: Scores, left: NDArray) -> NDArray[np.float64]:
    """The square of what is left, and of that through each mode backwards (1 + modes,)."""
    parts = [left]
    for number, (heard, shape) in enumerate(scores.shapes_heard):
        parts.append(through(scores, number, np.sum(shape.conj() * left[heard], axis=0)))
    return np.array([np.sum(np.abs(part) ** 2, dtype=float) for part in parts])


def _white(generator: np.random.Generator, like: NDArray) -> NDArray:
    return generator.standard_normal(like.shape, like.dtype)


def _driven(generator: np.random.Generator, scores: Scores, number: int) -> NDArray:
    """A draw of the response to noise that drives a mode (channels, samples)."""
    (heard, shape), mode = scores.shapes_heard[number], scores.now.modes[number]
    noise = generator.standard_normal((2, scores.samples.n_samples))
    response = np.zeros_like(scores.left)
    response[heard] = (shape * followed(scores.samples, mode, noise[0] + 1j * noise[1])).real
    return scores.samples.kept(response)
