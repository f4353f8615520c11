"""Mode indicators: what spectra and singular values say before any model is fitted."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from floquid._arrays import BLOCK, Floats
from floquid._checks import input_error, integer
from floquid.fit import DEVIATIONS
from floquid.lti import ModalModel, TimeResponses, composites, compress, noise_edge
from floquid.order._types import Indicators

SMOOTHING = 5  # number of adjacent lines that are looked at together
FEW = 64  # rows below which delays are added, half of the samples allowing: fewer responses than poles cannot tell them

DRAWS = 16  # draws of noise for the edge where delays repeat it: their deviation is known to a fifth


def indicators(data: TimeResponses, model: ModalModel | None = None, *, smoothing: int | None = None) -> Indicators:
    r"""Mode indicator functions of free responses.

    .. math:: \mathrm{CMIF}_j(\theta_l) = \frac{\sigma_j\big(\big[H(\theta_{l-h}) \cdots H(\theta_{l+h})\big]\big)}
              {\sqrt{O} + \sqrt{m}}, \qquad
              H_{oi}(\theta) = \frac{1}{\sigma_{oi}\sqrt{N_i}} \sum_k y_{oi}[k]\, e^{-i\theta k}

    With one input the spectral matrix is a column and has one curve. So 2h + 1 adjacent lines are looked at together,
    which makes m = (2h + 1) I columns: next to one mode they are all multiples of its shape, and a second curve that
    rises with the first means a second mode. 1 is where white noise alone is expected to end. (Shih, Tsuei, Allemang
    and Brown 1988; the edge after Marchenko and Pastur 1967.)

    Of several inputs, σ is the nearest product of one number an output and one an input, so that a mode stays of rank
    one.

    The singular values are those of the weighted responses, one a row, cut to the shortest input; each pole adds one at
    most. They are held against the largest of white noise: √rows + √columns with the margin of its fluctuations at one
    in a thousand (Johnstone 2001). Fewer than 64 rows are given delays as rows of their own, and the edge is
    drawn from noise of the same size.

    `data` are the responses and their noise; spectra of unequally long inputs are those of the shorter ones filled with
    zeros. A `model` of them gives the composite of what it leaves. `smoothing` is the number of adjacent lines, odd; 5,
    as far as there are enough, when not given. Raises InputError where it is not an odd positive number below the
    number of lines, or the model is not one of the data.
    """
    of, lines = "indicators", data.values.shape[2] // 2 + 1
    if smoothing is not None and (integer(smoothing, "smoothing", of, at_least=1) % 2 == 0 or smoothing > lines):
        raise input_error("smoothing", of, f"be odd and at most {lines}, the lines there are", f"is {smoothing}")
    if model is not None and model.residues.shape[1:] != data.noise.shape:
        must, got = f"be of the {data.noise.shape} responses", f"is of {model.residues.shape[1:]}"
        raise input_error("model", of, must, got, "Pass `fit_residues(model.multipliers, data)` for one of a scan.")
    return indicators_of(data, *both_compressed(data), model, smoothing=smoothing)


def both_compressed(data: TimeResponses) -> tuple[TimeResponses, TimeResponses]:
    """The principal responses, by the noise and by weights that keep residues of rank one: of one input, the same."""
    exact = compress(data)
    return exact, exact if data.n_inputs == 1 else compress(data, rank_one=True)


def indicators_of(
    data: TimeResponses,
    exact: TimeResponses,
    product: TimeResponses,
    model: ModalModel | None = None,
    *,
    smoothing: int | None = None,
) -> Indicators:
    """The indicators of responses whose principal ones are known."""
    samples = data.values.shape[2]
    lines = samples // 2 + 1
    together = smoothing or min(SMOOTHING, lines - 1 + lines % 2)
    none = np.zeros((0, data.n_outputs, data.n_inputs), dtype=np.complex128)
    nothing = ModalModel(multipliers=none[:, 0, 0], residues=none, dt=data.dt)
    curves = composites(data, model or nothing)
    shortest = int(data.lengths.min())
    rows = data.n_outputs * data.n_inputs
    delays = max(1, min(-(-FEW // rows), shortest // 2))
    return Indicators(
        angles=2.0 * np.pi * np.arange(lines) / samples,
        dt=data.dt,
        cmif=_cmif(product, together, data.n_outputs),
        smoothing=together,
        composite=curves.data,
        residual=None if model is None else curves.difference,
        singular_values=_singular_values(exact.values[:, :, :shortest].reshape(-1, shortest), delays),
        noise_edge=delayed_edge(rows, shortest, delays),
        delays=delays,
    )


def _cmif(principal: TimeResponses, smoothing: int, n_outputs: int) -> Floats:
    """Singular values of adjacent lines together (lines, curves), over the edge of noise."""
    responses, inputs, samples = principal.values.shape
    spectra = np.empty((responses, inputs, samples), complex)
    for i, length in enumerate(principal.lengths):
        spectra[:, i] = np.fft.fft(principal.values[:, i, :length], n=samples) / np.sqrt(length)
    columns, half = inputs * smoothing, smoothing // 2
    step = max(1, BLOCK // (responses * columns))
    curves = []
    for start in range(0, samples // 2 + 1, step):
        middle = np.arange(start, min(start + step, samples // 2 + 1))
        near = np.mod(middle[:, None] + np.arange(-half, half + 1), samples)
        matrices = np.moveaxis(spectra[:, :, near], 2, 0).reshape(len(middle), responses, columns)
        curves.append(np.linalg.svd(matrices, compute_uv=False))
    return np.concatenate(curves) / (np.sqrt(n_outputs) + np.sqrt(columns))


def _singular_values(values: Floats, delays: int) -> Floats:
    """Singular values of the responses (rows, samples) with their delays below one another, descending."""
    shifts = values.shape[1] - delays + 1
    rows = np.concatenate([values[:, d : d + shifts] for d in range(delays)])
    return np.asarray(np.linalg.svd(rows, compute_uv=False), dtype=np.float64)


@lru_cache(maxsize=64)
def delayed_edge(rows: int, samples: int, delays: int) -> float:
    """The largest singular value that white noise of unit variance has, except for one time in a thousand or so."""
    if delays == 1:
        return noise_edge(rows, samples)
    generator = np.random.default_rng(0)
    draws = [_singular_values(generator.standard_normal((rows, samples)), delays)[0] for _ in range(DRAWS)]
    return float(np.mean(draws) + DEVIATIONS * np.std(draws, ddof=1))
