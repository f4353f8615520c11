"""Results of a scan over orders, and what spectra and singular values say before any model is fitted."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache
from typing import ClassVar

import numpy as np

from floquid._arrays import BLOCK, Floats, Integers
from floquid._checks import Rebuilt, frozen_array, input_error, integer, positive
from floquid._show import Drawings, Drawn, Told
from floquid.fit import DEVIATIONS
from floquid.lti import ModalModel, TimeResponses, composites, compress, noise_edge


class Stability(IntEnum):
    """Agreement of a pole with one of the next lower order; each level holds those before it."""

    NEW = 0
    FREQUENCY = 1
    DAMPING = 2
    SHAPE = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Tolerances:
    """Tolerances within which poles of neighbouring orders count as one.

    Raises InputError where a tolerance is not between 0 and 1.

    Parameters
    ----------
    frequency
        The largest difference of the frequencies, as a share of the sampling frequency (of lifted responses: of the
        fundamental). Not of the frequency itself: where the band folds, zero is no special place.
    damping
        The largest relative difference of the decays; also the share of its decay that the frequency of a heavily
        damped mode may differ by, in radians.
    decay
        The difference of decays that counts as none [neper/sample], for modes with hardly any damping.
    shape
        The least MAC of the noise-weighted residues.
    """

    frequency: float = 0.002
    damping: float = 0.05
    decay: float = 5e-4
    shape: float = 0.95

    def __post_init__(self) -> None:
        for name in ("frequency", "damping", "decay", "shape"):
            value = positive(getattr(self, name), name, "Tolerances")
            if value >= 1.0:
                raise input_error(name, "Tolerances", "lie between 0 and 1", f"is {value:g}")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Criteria(Rebuilt):
    """Fit of each order, whatever found its poles: the residues are those that leave least.

    Parameters
    ----------
    cost
        The sum of squares left, over the noise (orders,) [-].
    left
        The share of the data's sum of squares over the noise that is left (orders,) [-].
    aic, bic
        Akaike's and the Bayesian information criterion (orders,) [-]; lower is better.
    degrees
        The numbers fitted less the parameters of the fit (orders,); the cost of a right model is about as large.
    """

    cost: Floats
    left: Floats
    aic: Floats
    bic: Floats
    degrees: Integers

    def __post_init__(self) -> None:
        self._freeze(cost=("orders",))
        orders = (len(self.cost),)
        self._freeze(left=orders, aic=orders, bic=orders)
        self._freeze(dtype=np.int64, degrees=orders)

    @property
    def misfit(self) -> Floats:
        """The cost over its degrees of freedom (orders,) [-]: 1 where white noise alone is left; NaN without any."""
        return np.divide(self.cost, self.degrees, out=np.full(len(self.cost), np.nan), where=self.degrees > 0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Indicators(Rebuilt):
    """Indications of the number of modes before any model is fitted.

    Parameters
    ----------
    angles
        The lines (lines,) [rad/sample], 0 to π.
    dt
        The sampling interval [s].
    cmif
        The singular values of the spectral matrix at each line, descending (lines, curves), over the largest that white
        noise alone is expected to have [-].
    smoothing
        How many adjacent lines are looked at together.
    composite
        The mean magnitude of the spectra over the noise (lines,) [-]; white noise alone has `lti.WHITE`.
    residual
        The same of what a model leaves (lines,); None without a model.
    singular_values
        Of the responses over their noise, with `delays` samples in turn as rows of their own, descending (values,) [-].
    noise_edge
        The largest singular value that white noise alone has [-].
    delays
        The number of delays; with 1, the squares are the eigenvalues of the Gram matrix of the responses.
    """

    angles: Floats
    dt: float
    cmif: Floats
    smoothing: int
    composite: Floats
    residual: Floats | None = None
    singular_values: Floats
    noise_edge: float
    delays: int

    def __post_init__(self) -> None:
        of = "Indicators"
        self._freeze(angles=("lines",), singular_values=("values",))
        lines = len(self.angles)
        self._freeze(cmif=(lines, "curves"), composite=(lines,), residual=(lines,))
        for name, unit in (("dt", "s"), ("noise_edge", "")):
            object.__setattr__(self, name, positive(getattr(self, name), name, of, unit=unit))
        integer(self.smoothing, "smoothing", of, at_least=1)
        integer(self.delays, "delays", of, at_least=1)

    @property
    def n_above(self) -> int:
        """Number of singular values above the noise: the least number of poles."""
        return int((self.singular_values > self.noise_edge).sum())


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OrderScan(Told, Drawn, Rebuilt):
    """The models of several orders, and which of their poles stay from one to the next.

    Parameters
    ----------
    orders
        The orders asked for, ascending (orders,).
    models
        The model of each; its `outcome` says whether the order was reached. The residues are those of the principal
        responses (`lti.compress`), in units of the noise; `lti.fit_residues` gives those of the responses themselves.
    stable
        For each order the `Stability` of each of its poles (modes,), against the next lower order that was reached.
    criteria
        How well each order fits.
    indicators
        What can be seen without a model.
    tolerances
        When poles counted as one.
    """

    kind: ClassVar[str] = "scan"  # by it the functions for a result are found
    orders: tuple[int, ...]
    models: tuple[ModalModel, ...]
    stable: tuple[Integers, ...]
    criteria: Criteria
    indicators: Indicators
    tolerances: Tolerances

    def __post_init__(self) -> None:
        of, number = "OrderScan", len(self.orders)
        for name in ("models", "stable", "criteria"):
            held = len(self.criteria.cost) if name == "criteria" else len(getattr(self, name))
            if held != number:
                raise input_error(name, of, f"hold one entry for each of the {number} orders", f"holds {held}")
        levels = tuple(
            frozen_array(flags, "stable", of, axes=(model.order,), dtype=np.int64)
            for flags, model in zip(self.stable, self.models, strict=True)
        )
        object.__setattr__(self, "stable", levels)

    def _figures(self) -> Drawings:
        return {"stabilisation": (self, {}), "indicators": (self.indicators, {})}

    @property
    def n_stable(self) -> Integers:
        """The number of poles of each order that agree in frequency, damping and shape (orders,)."""
        return np.array([int((flags == Stability.SHAPE).sum()) for flags in self.stable], dtype=np.int64)


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
