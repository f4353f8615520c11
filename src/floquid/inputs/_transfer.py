"""Harmonic transfer functions of a model with inputs, with deviations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from floquid._checks import Rebuilt, frozen_array, input_error
from floquid.core import Channel, PeriodicModel
from floquid.inputs._modes import input_gain
from floquid.inputs._samples import Hold


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TransferFunctions(Rebuilt):
    r"""Harmonic transfer functions G_m of a periodic system (Wereley and Hall 1990).

    .. math:: u(t) = e^{i \Omega t} \;\to\; y(t) = \sum_m G_m(\Omega)\, e^{i (\Omega + m \omega) t}

    Parameters
    ----------
    frequencies_hz
        Ω/2π (frequencies,) [Hz].
    harmonics
        The integers m, ascending (harmonics,).
    values
        G (harmonics, outputs, inputs, frequencies) [units of the outputs over those of the inputs]; NaN where an input
        that was measured at some frequencies has none.
    std
        Their deviations, that of the real part as the real part, alike; None if not estimated.
    outputs, inputs
        One `Channel` each.
    step
        The sampling interval [s] where G is that of samples: of u at the samples to y at the samples, what the input
        does between them and what is folded included. None where it is that of continuous time.
    """

    frequencies_hz: NDArray[np.float64]
    harmonics: NDArray[np.int64]
    values: NDArray[np.complex128]
    std: NDArray[np.complex128] | None
    outputs: tuple[Channel, ...]
    inputs: tuple[Channel, ...]
    step: float | None = None

    def __post_init__(self) -> None:
        of, put = "TransferFunctions", object.__setattr__
        put(self, "frequencies_hz", frozen_array(self.frequencies_hz, "frequencies_hz", of, axes=("frequencies",)))
        put(self, "harmonics", frozen_array(self.harmonics, "harmonics", of, axes=("harmonics",), dtype=np.int64))
        axes = (len(self.harmonics), len(self.outputs), len(self.inputs), len(self.frequencies_hz))
        for name in ("values", "std"):
            if getattr(self, name) is not None:
                value = frozen_array(getattr(self, name), name, of, axes=axes, dtype=np.complex128, missing=True)
                put(self, name, value)

    def unit(self, output: int, driven_by: int) -> str:
        """The unit of G of one path; "-" where there is none. `output` and `driven_by` count from 0."""
        above, below = self.outputs[output].unit, self.inputs[driven_by].unit
        if above == below:
            return "-"
        return above if below == "-" else f"{'1' if above == '-' else above}/{f'({below})' if '/' in below else below}"


def transfer_functions(
    model: PeriodicModel, frequencies_hz: ArrayLike, harmonics: ArrayLike = (-1, 0, 1)
) -> TransferFunctions:
    r"""The harmonic transfer functions of a model with inputs, without deviations.

    .. math:: G_m(\Omega) = \sum_r \sum_l \frac{c_{r,m-l}\, b_{r,l}}{i (\Omega + l \omega) - \lambda_r} + D_m

    Parameters
    ----------
    model
        A model with inputs.
    frequencies_hz
        Ω/2π (frequencies,) [Hz]; negative ones, too.
    harmonics
        The integers m (harmonics,).

    Returns
    -------
    TransferFunctions
        G.

    Raises
    ------
    InputError
        The model has no inputs, or a frequency is that of an undamped pole.
    """
    of = "inputs.transfer_functions"
    own = model.inputs
    if own is None:
        raise input_error("model", of, "have inputs", "is one of free responses", "Identify it with `inputs=`.")
    hertz = frozen_array(np.atleast_1d(np.asarray(frequencies_hz, float)), "frequencies_hz", of, axes=("frequencies",))
    turns = np.unique(np.atleast_1d(np.asarray(harmonics, np.int64)))
    values = np.zeros((len(turns), len(model.channels), len(own.channels), len(hertz)), complex)
    for exponent, c, b in zip(model.exponents, model.coefficients[:, :, 0], own.coefficients, strict=True):
        values += modal_transfer(
            exponent, model.fundamental, (model.harmonics, c), (own.harmonics, b), turns, 2.0 * np.pi * hertz
        )
    for turn, direct in zip(own.direct_harmonics, np.moveaxis(own.direct, 2, 0), strict=True):
        values[turns == turn] += direct[:, :, None]
    if not np.isfinite(values).all():
        remedy = "Ask for frequencies beside it."
        raise input_error("frequencies_hz", of, "lie off the poles", "has one on an undamped pole", remedy)
    return TransferFunctions(
        frequencies_hz=hertz, harmonics=turns, values=values, std=None, outputs=model.channels, inputs=own.channels
    )


def modal_transfer(
    exponent: complex,
    fundamental: float,
    seen: tuple[NDArray[np.int64], NDArray[np.complex128]],
    reached: tuple[NDArray[np.int64], NDArray[np.complex128]],
    harmonics: NDArray[np.int64],
    omega: NDArray[np.float64],
    sampled: tuple[float, Hold] | None = None,
) -> NDArray[np.complex128]:
    r"""The part of one mode in G at angular frequencies (harmonics, outputs, inputs, frequencies).

    `seen` are the harmonics of the outputs and c (outputs, harmonics), `reached` those of the inputs and b. That of
    samples, with their interval h and the hold, has :math:`\beta_l / (e^{i (\Omega + l \omega) h} - e^{\lambda h})` for
    :math:`b_l / (i (\Omega + l \omega) - \lambda)`.
    """
    (turns, c), (reach, b) = seen, reached
    turned = omega + reach[:, None] * fundamental
    with np.errstate(divide="ignore", invalid="ignore"):
        if sampled is None:
            resonance = 1.0 / (1j * turned - exponent)
        else:
            step, ahead = sampled[0], np.exp(1j * turned * sampled[0])
            shares = np.array([input_gain(exponent, turn, fundamental, *sampled) for turn in reach.tolist()])
            resonance = (shares[:, :1] + shares[:, 1:] * ahead) / (ahead - np.exp(exponent * step))
    wanted = harmonics[:, None] - reach
    place = np.clip(np.searchsorted(turns, wanted), 0, len(turns) - 1)
    shifted = np.where(turns[place] == wanted, c[:, place], 0.0)
    return np.einsum("oml,ilf->moif", shifted, b[:, :, None] * resonance)
