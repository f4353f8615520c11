"""A periodic model finished by the constrained fit: bands, exponents, coefficients and their deviations."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from floquid._checks import input_error
from floquid.core import PeriodicModel
from floquid.lifting import Lifted
from floquid.lti import fit_residues
from floquid.periodic._bands import Entries, upper
from floquid.periodic._constrained import Held, evaluated, settled
from floquid.periodic._harmonics import GAP, select_bands
from floquid.periodic._sums import scales

ROUNDS = 4
"""How often the bands may be chosen again."""

LOOSE = 0.2
"""The probability at which noise may pass for a harmonic that is fitted: one that is missing does more harm."""

PADDING = 1
"""Harmonics fitted beyond each end of a band: weak ones that are left out bend the exponents."""


@dataclass(frozen=True, slots=True)
class Constrained:
    """What the constrained fit gives.

    Parameters
    ----------
    model
        The periodic model.
    noise
        The deviation of what is left (channels, hits) [units of the channels].
    misfit
        How much more holding the residues leaves than noise explains, in standard deviations: beyond a few, a mode is
        several that fold onto one another, or has harmonics outside its band.
    """

    model: PeriodicModel
    noise: NDArray[np.float64]
    misfit: float


def constrain(
    model: PeriodicModel, lifted: Lifted, *, false_alarm: float = 1e-8, choose: bool = True, padding: int = PADDING
) -> Constrained:
    r"""The model of the same modes, their residues held to their harmonics: exponents and coefficients anew.

    .. math:: y_{c,h}(t) = 2 \Re \sum_r \sum_{m \in M_r} B_{r,c,h,m}\, e^{(\lambda_r + i m \omega) t}

    (Allen 2009, eq. 12, the spacing ω enforced.) The bands M_r are those of the model, chosen again from the deviations
    of this fit until they stay; one harmonic more on each side is fitted and not reported.

    Parameters
    ----------
    model
        The periodic model of lifted responses.
    lifted
        The responses that it was found from.
    false_alarm
        The probability at which noise may pass for one harmonic.
    choose
        Whether bands are chosen again; else they are those of the model.
    padding
        Harmonics fitted beyond each end of a band.

    Returns
    -------
    Constrained
        The model, with deviations, and the noise left.

    Raises
    ------
    InputError
        The model is not one of these responses, or two of its multipliers are equal.
    IdentificationError
        There is no such fit near the model's exponents.
    """
    if (model.n_hits, len(model.channels)) != (lifted.n_hits, lifted.n_channels):
        raise input_error(
            "model",
            "constrain",
            "be a model of `lifted`",
            f"it has {len(model.channels)} channels and {model.n_hits} hits, and the responses "
            f"{lifted.n_channels} and {lifted.n_hits}",
        )
    gaps = np.abs(np.subtract.outer(model.multipliers, model.multipliers)) + np.eye(model.order)
    if (gaps < 1e-12).any():
        raise input_error(
            "model",
            "constrain",
            "have distinct multipliers",
            "two are equal, and residues that are free in each hit do not tell their modes apart",
            "Keep the model as it is: `constrained=False`.",
        )
    most = (lifted.n_phases - 1) // 2
    entries = Entries.of(model)
    bands, found = entries.bands, settled(lifted, entries.padded(padding, most))
    for _ in range(ROUNDS if choose else 0):
        wide = evaluated(lifted, replace(found.entries, bands=entries.bands).padded(GAP + 1, most))
        loose = _chosen(lifted, wide, LOOSE)
        bands = _chosen(lifted, wide, false_alarm)
        if (loose == entries.bands).all():
            break
        entries = replace(found.entries, bands=loose)
        found = settled(lifted, entries.padded(padding, most))
    return Constrained(_model(model, lifted, found, bands), _noise_left(lifted, found), _misfit(model, lifted, found))


def _chosen(lifted: Lifted, wide: Held, false_alarm: float) -> NDArray[np.int64]:
    """The bands that rise above the noise."""
    entries = wide.entries
    harmonics, coefficients, std = _coefficients(lifted, wide)
    seeds = np.stack([np.minimum(0, -entries.half_turns), np.maximum(0, -entries.half_turns)], axis=1)
    seeds = np.clip(seeds, harmonics[0], harmonics[-1])
    kept = select_bands(coefficients, std, harmonics, seeds, false_alarm=false_alarm)
    return np.array([(harmonics[row][0], harmonics[row][-1]) for row in kept], np.int64).reshape(-1, 2)


def _coefficients(
    lifted: Lifted, found: Held
) -> tuple[NDArray[np.int64], NDArray[np.complex128], NDArray[np.complex128]]:
    """Harmonics, coefficients and deviations (entries, channels, hits, harmonics) of what was fitted."""
    entries = found.entries
    columns, sines, parameters = entries.columns(), entries.sines(), entries.parameters()
    low, high = int(entries.bands[:, 0].min()), int(entries.bands[:, 1].max())
    low, high = (
        min(low, -int(entries.half_turns.max(initial=0)) - high),
        max(high, -int(entries.half_turns.min(initial=0)) - low),
    )
    harmonics = np.arange(low, high + 1)
    shape = (len(entries.exponents), lifted.n_channels, lifted.n_hits, len(harmonics))
    coefficients, std = np.zeros((2, *shape), complex)
    rates = columns.rates(entries.fundamental)
    gain = lifted.gain(rates)
    relative = (lifted.gain(rates, slope=True) / gain).T
    covariance = found.covariance()
    # What each parameter moves the rate of a column by.
    half = parameters.weights[:, : len(rates)]
    rate = np.where(parameters.turns[:, None], 1j, 1.0) * half
    for number, hit in enumerate(found.hits):
        scale = scales(lifted, number, columns)
        factor = np.where(sines, 0.5, 1.0)[:, None] / gain.T * scale[:, None] ** -1.0
        alpha, beta = np.split(hit.coefficients, 2)
        own = (alpha - 1j * beta) * factor
        # The slopes are those of e^{st} counted from t = 0, also where a column is scaled by its end.
        moved = -np.einsum("kl,plc->kcp", hit.inverse @ hit.mixed, parameters.applied(hit.coefficients))
        up, down = np.split(moved, 2)
        slopes = (up - 1j * down) * factor[:, :, None]
        slopes -= own[:, :, None] * np.einsum("kc,pk->kcp", relative, rate)
        n = len(rates)
        variance = np.diag(hit.inverse)
        both = np.diag(hit.inverse[:n, n:])
        noise = lifted.noise[:, number] ** 2
        for part, weights in ((1.0, (factor.real, factor.imag)), (1j, (factor.imag, -factor.real))):
            direct = (
                weights[0] ** 2 * variance[:n, None]
                + weights[1] ** 2 * variance[n:, None]
                + 2.0 * weights[0] * weights[1] * both[:, None]
            )
            turned = slopes.real if part == 1.0 else slopes.imag
            of_poles = np.einsum("kcp,pq,kcq->kc", turned, covariance, turned)
            deviation = np.sqrt(np.maximum(noise * direct + of_poles, 0.0))
            _put(std, deviation * part, columns, harmonics, number)
        _put(coefficients, own, columns, harmonics, number)
    _mirror(entries, harmonics, coefficients, std)
    return harmonics, coefficients, std


def _put(target: NDArray, values: NDArray, columns, harmonics: NDArray[np.int64], hit: int) -> None:
    places = columns.harmonics - harmonics[0]
    for column, (mode, place) in enumerate(zip(columns.modes, places, strict=True)):
        target[mode, :, hit, place] += values[column]


def _mirror(entries: Entries, harmonics: NDArray[np.int64], coefficients: NDArray, std: NDArray) -> None:
    """The other half of a real multiplier's shape."""
    for entry in np.flatnonzero(entries.real):
        for place, m in enumerate(harmonics):
            other = -int(entries.half_turns[entry]) - m - harmonics[0]
            if 2 * m + entries.half_turns[entry] > 0 and 0 <= other < len(harmonics):
                coefficients[entry, :, :, other] = coefficients[entry, :, :, place].conj()
                std[entry, :, :, other] = std[entry, :, :, place]


def _model(model: PeriodicModel, lifted: Lifted, found: Held, bands: NDArray[np.int64]) -> PeriodicModel:
    """The model with the exponents and coefficients of a fit, those within the bands."""
    harmonics, coefficients, std = _coefficients(lifted, found)
    mirror = -found.entries.half_turns[:, None] - bands[:, ::-1]
    real = found.entries.real
    ends = np.where(
        real[:, None],
        np.stack([np.minimum(bands[:, 0], mirror[:, 0]), np.maximum(bands[:, 1], mirror[:, 1])], 1),
        bands,
    )
    kept = (harmonics >= ends[:, :1]) & (harmonics <= ends[:, 1:])
    chosen = upper(model)
    positions = {r: k for k, r in enumerate(chosen)}
    order = model.order
    width = int(max(-harmonics[0], harmonics[-1]))
    whole = np.arange(-width, width + 1)
    out, out_std = np.zeros((2, order, lifted.n_channels, lifted.n_hits, len(whole)), complex)
    exponents = np.array(model.exponents)
    n, pairs = len(chosen), np.flatnonzero(~real)
    of_parts = np.zeros((2 * order, len(found.gradient)))
    place = slice(int(harmonics[0] + width), int(harmonics[-1] + width) + 1)
    for r in range(order):
        entry, conjugate = positions.get(r), False
        if entry is None:
            partner = int(np.flatnonzero(model.exponents == model.exponents[r].conj())[0])
            entry, conjugate = positions[partner], True
        value = found.entries.exponents[entry]
        exponents[r] = value.conjugate() if conjugate else value
        shape = np.zeros((lifted.n_channels, lifted.n_hits, len(whole)), complex)
        deviation = np.zeros_like(shape)
        shape[..., place] = coefficients[entry] * kept[entry]
        deviation[..., place] = std[entry] * kept[entry]
        out[r] = shape[..., ::-1].conj() if conjugate else shape
        out_std[r] = deviation[..., ::-1] if conjugate else deviation
        of_parts[r, entry] = 1.0
        if not real[entry]:
            of_parts[order + r, n + int(np.flatnonzero(pairs == entry)[0])] = -1.0 if conjugate else 1.0
    used = (out != 0).any(axis=(0, 1, 2)) | (whole == 0)
    return PeriodicModel(
        exponents=exponents,
        coefficients=out[..., used],
        harmonics=whole[used],
        period=model.period,
        channels=model.channels,
        covariance=of_parts @ found.covariance() @ of_parts.T,
        coefficient_std=out_std[..., used],
        provenance=model.provenance,
    )


def _misfit(model: PeriodicModel, lifted: Lifted, found: Held) -> float:
    r"""The rise of the cost over that of free residues, as a chi-square brought to zero mean and unit variance.

    .. math:: z = \frac{J_{\mathrm{held}} - J_{\mathrm{free}} - \nu}{\sqrt{2 \nu}}

    with ν the number of residues less that of coefficients; the free fit is at the model's own exponents.
    """
    free = fit_residues(model.multipliers, lifted.responses)
    assert free.residual_std is not None
    samples = np.maximum(lifted.responses.lengths - model.order, 0)
    cost = float(np.sum((free.residual_std / lifted.responses.noise) ** 2 * samples))
    coefficients = int(found.entries.sines().sum()) + len(found.entries.sines())
    residues = model.order * lifted.n_phases
    degrees = max((residues - coefficients) * lifted.n_channels * lifted.n_hits, 1)
    return (found.cost - cost - degrees) / np.sqrt(2.0 * degrees)


def _noise_left(lifted: Lifted, found: Held) -> NDArray[np.float64]:
    """The deviation of what is left (channels, hits), corrected for the parameters used."""
    columns = int(found.entries.sines().sum()) + len(found.entries.sines())
    free = [max(int(n) * lifted.n_phases - columns, 1) for n in lifted.responses.lengths]
    return np.sqrt(np.stack([hit.left for hit in found.hits], axis=1) / free)
