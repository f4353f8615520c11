r"""The branches of the exponents of a model: λ + ikω with the shape e^{-ikωt} p(t) is the same mode for every whole k.

A sensor that runs to and fro over a structure measures a shape that is the same on the way there and back: about a
turning point of its path the shape is even on one branch alone, and that one has the frequency of the structure.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, TypeAlias

import numpy as np

from floquid._arrays import Complexes, Floats, Integers, Mask
from floquid.core._estimates import Estimates, Gains
from floquid.core._model_inputs import ModelInputs
from floquid.core._periodic_model import PeriodicModel
from floquid.errors import UnevenError
from floquid.fit import covariance_root, inverse_root

Branch: TypeAlias = Literal["strongest", "slowest", "symmetric"]

EVEN = 0.9
"""Share of what is even less what is odd, from which on a shape is even.

Of two equal lines it is a half about either, of four three quarters. Of scans with 5 % of noise it was above 0.999,
with 50 % above 0.96.
"""


def on_branch(model: PeriodicModel, branch: Branch) -> PeriodicModel:
    r"""Move the exponents of a model to another branch, and its shapes with them.

    .. math:: \lambda' = \lambda + i k \omega, \qquad B'_m = B_{m + k}, \qquad b'_l = b_{l - k}, \qquad
              z'(t) = e^{i k \omega t} z(t)

    with b and z the gains and the first states of a model with measured inputs. Deviations move along: where the period
    was estimated, that of Im λ' has the error of kω in it. The response and the transfer functions are the same.
    `model` is what was identified, `branch` the rule by which each pair has its k: "strongest" leaves the model as it
    is, its zeroth harmonics being the strongest; "slowest" makes \|Im λ\| at most ω/2; "symmetric" makes all shapes
    even about one turning point, as `turning_point` finds it.

    Raises UnevenError where a mode has no symmetric branch.
    """
    if branch == "strongest":
        return model
    if branch == "slowest":
        return _moved(model, np.rint((model.principal() - model.exponents).imag / model.fundamental).astype(np.int64))
    return _moved(model, turning_point(model)[1])


def turning_point(model: PeriodicModel) -> tuple[float, Integers]:
    r"""Find the turning point about which the shapes of a model are even, and the branch of each mode.

    .. math:: B_{k+n}\, e^{-i n \varphi} = B_{k-n}\, e^{i n \varphi}

    for all n, B those of the `model`: a sensor at x = cos(ωt + φ) runs to and fro between -1 and 1. Channels and hits
    are weighted by their noise, modes alike. φ maximises the share of what is even, summed over the modes. Gives φ
    [rad], from -π/2 to π/2, since either end of the path may be x = 1, and the whole numbers k (modes,), zero for real
    multipliers.

    Raises UnevenError where a mode has no such branch: too little of its energy is even about any of its lines.
    """
    upper = [mode for mode in model.upper_modes if not model.unpaired[mode]]
    noise = _noise(model)
    pairs = [_products(model.coefficients[mode] / noise, model.harmonics) for mode in upper]
    widest = int(np.ptp(model.harmonics)) + 1
    # A share has as many waves over φ as the shape has harmonics: eight points a wave find the highest.
    grid = np.pi * np.arange(8 * widest) / (8 * widest) - 0.5 * np.pi
    sums = sum((_shares(table, grid).max(axis=0) for table in pairs), np.zeros(len(grid)))
    phase = float(grid[int(sums.argmax())])
    for width in np.pi / (8 * widest) * 0.5 ** np.arange(32):  # to the last digits
        near = phase + width * np.array([-1.0, 0.0, 1.0])
        sums = sum((_shares(table, near).max(axis=0) for table in pairs), np.zeros(3))
        phase = float(near[int(sums.argmax())])
    turns = np.zeros(model.order, np.int64)
    for mode, table in zip(upper, pairs, strict=True):
        shares = _shares(table, np.array([phase]))[:, 0]
        best = int(shares.argmax())
        if shares[best] < EVEN:
            raise UnevenError(float(model.frequencies_hz[mode]), float(1.0 - shares[best]))
        turns[mode] = model.harmonics[0] + best
        partner = int(np.abs(model.exponents - model.exponents[mode].conj()).argmin())
        turns[partner] = -turns[mode]
    return (phase + 0.5 * np.pi) % np.pi - 0.5 * np.pi, turns


def unevenness(model: PeriodicModel) -> tuple[float, int]:
    r"""The squared deviations of all shapes from being even, and how many numbers they are of.

    .. math:: d_m = B_m\, e^{-i m \varphi} - B_{-m}\, e^{i m \varphi}, \qquad
              \min_\varphi d^T\, \mathrm{cov}(d)^{-1} d

    over channels, modes and harmonics m > 0, those included that were fitted and not kept; hits are added, each by its
    state. Lines that another mode has too are left out. Noise makes it χ². `model` is one on its symmetric branch;
    without deviations both are 0.

    Raises UnevenError where a mode has no such branch.
    """
    estimates = model.estimates if model.unselected is None else model.unselected
    if estimates is None:
        return 0.0, 0
    sure = _determined(estimates)
    terms = {(estimates.modes[term], estimates.harmonics[term]): term for term in np.flatnonzero(sure).tolist()}
    pairs = [
        (term, terms[mode, -m])
        for (mode, m), term in terms.items()
        if m > 0 and (mode, -m) in terms and not estimates.real[mode]
    ]
    if not pairs:
        return 0.0, 0
    places, rows = np.transpose(pairs), np.arange(len(pairs))
    turned = np.exp(-1j * estimates.harmonics * turning_point(model)[0])
    weights = _hit_weights(estimates, _noise(model)[..., 0])[estimates.modes] * turned[:, None, None]
    root = covariance_root(estimates.covariance)
    apart, by = [], []  # d, and its slopes by errors that all share and by φ, over the noise of each channel
    for channel in range(len(model.channels)):
        to = np.zeros((model.n_hits, len(pairs), len(weights)), complex)
        for place, sign in zip(places, (1.0, -1.0), strict=True):
            to[:, rows, place] = sign * weights[place, channel].T
        values = estimates.coefficients[:, channel].T[:, :, None]
        shared, turning = (
            estimates.slopes[:, channel].swapaxes(0, 1) @ root,
            -1j * estimates.harmonics[:, None] * values,
        )
        inner = inverse_root(_spread(estimates, to, channel)).T
        whole = (to @ np.concatenate([values, shared, turning], axis=2)).sum(axis=0)
        whole = inner @ np.concatenate([whole.real, whole.imag])
        apart.append(whole[:, 0])
        by.append(whole[:, 1:])
    size = root.shape[1]
    known = np.concatenate([*by, np.eye(size, size + 1)])
    wanted = np.concatenate([*apart, np.zeros(size)])
    left = wanted - known @ np.linalg.lstsq(known, wanted, rcond=None)[0]
    return float(left @ left), sum(map(len, apart)) - 1


def _determined(estimates: Estimates) -> Mask:
    """Mask of the terms that are known better than to the largest of their mode (terms,)."""
    size, std = (np.abs(values).max(axis=(1, 2), initial=0.0) for values in (estimates.coefficients, estimates.std()))
    largest = np.array([size[estimates.modes == mode].max(initial=0.0) for mode in range(len(estimates.exponents))])
    return np.asarray(std < largest[estimates.modes], bool)


def _hit_weights(estimates: Estimates, noise: Floats) -> Complexes:
    """Weights of the hits by which a shape is seen best (modes, channels, hits); `noise` (channels, hits)."""
    found = np.zeros((len(estimates.exponents), *noise.shape), complex)
    for mode, weights in enumerate(found):
        lines = estimates.coefficients[estimates.modes == mode] / noise
        weights[:] = np.linalg.svd(lines.reshape(-1, noise.shape[1]), full_matrices=False)[2][0].conj() / noise
    return found


def _spread(estimates: Estimates, to: Complexes, channel: int) -> Floats:
    """Covariance by the noise of a channel of sums of its coefficients by `to` (hits, sums, terms): real, imaginary."""
    by = to * estimates.scales[:, channel].T[:, None]
    parts = np.concatenate([np.concatenate([by.real, -by.imag], 2), np.concatenate([by.imag, by.real], 2)], 1)
    spread = estimates.spread[estimates.blocks[channel]]
    if estimates.shared:  # the hits of a channel have one error
        parts, spread = parts.sum(axis=0, keepdims=True), spread[:1]
    return np.asarray((parts @ spread @ parts.swapaxes(1, 2)).sum(axis=0), np.float64)


def _noise(model: PeriodicModel) -> Floats:
    """The size by which coefficients count: their noise, or where there is none the size of the channel."""
    std = model.coefficient_std
    if std is not None and (size := np.sqrt(np.mean(np.abs(std) ** 2, axis=(0, 3)))).all():
        return np.asarray(size[:, :, None])
    size = np.sqrt(np.mean(np.abs(model.coefficients) ** 2, axis=(0, 2, 3), keepdims=True))[0]
    return np.where(size > 0.0, size, 1.0)


def _products(lines: Complexes, harmonics: Integers) -> Complexes:
    """Σ B_{k+n} conj(B_{k-n}) over channels and hits, over the energy (branches, distances n), all k from the first."""
    first, count = int(harmonics[0]), int(np.ptp(harmonics)) + 1
    dense = np.zeros((*lines.shape[:2], 3 * count), complex)
    dense[..., count + harmonics - first] = lines
    table = np.array(
        [
            [np.vdot(dense[..., count + k - n], dense[..., count + k + n]) * (2.0 if n else 1.0) for n in range(count)]
            for k in range(count)
        ]
    )
    energy = float(np.sum(np.abs(lines) ** 2))
    return np.asarray(table / max(energy, np.finfo(float).tiny), np.complex128)


def _shares(table: Complexes, phases: Floats) -> Floats:
    """The share of what is even, less that of what is odd (branches, phases), at most 1."""
    return (table @ np.exp(-2j * np.multiply.outer(np.arange(table.shape[1]), phases))).real


def _moved(model: PeriodicModel, turns: Integers) -> PeriodicModel:
    """The model with the exponents moved by whole `turns` of iω (modes,), opposite ones of conjugates."""
    kept = np.nonzero((model.coefficients != 0).any(axis=(1, 2)))
    if not turns.any() or not len(kept[0]):
        return model
    lines = model.harmonics[kept[1]] - turns[kept[0]]
    harmonics = np.arange(lines.min(), lines.max() + 1)
    shape = (*model.coefficients.shape[:3], len(harmonics))
    coefficients, std = np.zeros(shape, complex), np.zeros(shape, complex)
    for mode, place, line in zip(*kept, lines - harmonics[0], strict=True):
        coefficients[mode, ..., line] = model.coefficients[mode, ..., place]
        if model.coefficient_std is not None:
            std[mode, ..., line] = model.coefficient_std[mode, ..., place]
    return PeriodicModel(
        exponents=model.exponents + 1j * model.fundamental * turns,
        coefficients=coefficients,
        harmonics=harmonics,
        period=model.period,
        channels=model.channels,
        covariance=_covariance(model, turns),
        coefficient_std=None if model.coefficient_std is None else std,
        estimates=_estimates(model, model.estimates, turns),
        unselected=_estimates(model, model.unselected, turns),
        provenance=model.provenance,
        inputs=None if model.inputs is None else _inputs(model.inputs, turns, model.fundamental),
        point=model.point,
    )


def _inputs(inputs: ModelInputs, turns: Integers, fundamental: float) -> ModelInputs:
    """The inputs of a model moved by `turns` of iω (modes,)."""
    lines = np.add.outer(turns, inputs.harmonics)
    harmonics, coefficients = _spread_out(lines, inputs.coefficients)
    std = inputs.coefficient_std
    return replace(
        inputs,
        harmonics=harmonics,
        coefficients=coefficients,
        coefficient_std=None if std is None else _spread_out(lines, std)[1],
        initial=inputs.initial * np.exp(1j * fundamental * np.multiply.outer(turns, inputs.begins)),
    )


def _spread_out(lines: Integers, values: Complexes) -> tuple[Integers, Complexes]:
    """All harmonics of modes with `lines` of their own (modes, lines), and values there (modes, inputs, lines, ...)."""
    harmonics = np.unique(lines)
    found = np.zeros((*values.shape[:2], len(harmonics), *values.shape[3:]), complex)
    for of_mode, own, value in zip(found, lines, values, strict=True):
        of_mode[:, np.searchsorted(harmonics, own)] = value
    return harmonics, found


def _covariance(model: PeriodicModel, turns: Integers) -> Floats | None:
    """The covariance of the exponents moved by `turns` of iω, the error of ω included."""
    estimates, covariance = model.estimates, model.covariance
    if covariance is None or estimates is None or not estimates.fundamental_std:
        return covariance
    place = estimates.fundamental_place
    with_period = estimates.exponent_slopes @ estimates.covariance[:, place]
    straight, mirrored = (
        np.abs(np.subtract.outer(model.exponents, side)) for side in (estimates.exponents, estimates.exponents.conj())
    )
    of = np.minimum(straight, mirrored).argmin(axis=1)
    is_straight = (straight <= mirrored)[np.arange(model.order), of]
    sign = np.where(is_straight, 1.0, -1.0)
    beside = np.concatenate([with_period.real[of], sign * with_period.imag[of]])
    moved = np.concatenate([np.zeros(model.order), turns])
    cross = np.multiply.outer(moved, beside)
    return covariance + cross + cross.T + np.multiply.outer(moved, moved) * estimates.covariance[place, place]


def _estimates(model: PeriodicModel, estimates: Estimates | None, turns: Integers) -> Estimates | None:
    """The estimates of a model moved by `turns` of iω; a pair that comes below the axis by its other half."""
    if estimates is None:
        return None
    own = turns[model.modes_of(estimates)]
    exponents = estimates.exponents + 1j * estimates.fundamental * own
    below = ~estimates.real & (exponents.imag < 0.0)
    flipped, terms = below[estimates.modes], len(estimates.modes)
    count, place = len(own), estimates.fundamental_place
    old = np.eye(len(estimates.covariance))  # the parameters as they were, by those that they become
    imaginary = np.arange(count, 2 * count)[~estimates.real]
    sign = np.where(below, -1.0, 1.0)[~estimates.real]
    old[imaginary, imaginary], old[imaginary, place] = sign, -own[~estimates.real]
    new = np.linalg.inv(old)
    turned = np.concatenate([np.ones(terms), np.where(flipped, -1.0, 1.0)])
    both = np.multiply.outer(turned, turned)

    def mirrored(values: Complexes, flipped: Mask = flipped) -> Complexes:
        return np.where(flipped.reshape(-1, *[1] * (values.ndim - 1)), values.conj(), values)

    lines, gains = estimates.harmonics - own[estimates.modes], estimates.gains
    if gains is not None:
        reach = np.where(below, -1, 1)[:, None] * np.add.outer(own, gains.harmonics)
        driven, values = _spread_out(reach, mirrored(gains.coefficients, below))
        _, by = _spread_out(reach, mirrored(gains.slopes @ old, below))
        gains = Gains(harmonics=driven, coefficients=values, slopes=by)
    return replace(
        estimates,
        exponents=np.where(below, exponents.conj(), exponents),
        harmonics=np.where(flipped, -lines, lines),
        coefficients=mirrored(estimates.coefficients),
        covariance=new @ estimates.covariance @ new.T,
        slopes=mirrored(estimates.slopes @ old),
        spread=estimates.spread * both,
        scales=mirrored(estimates.scales),
        drift=None if estimates.drift is None else estimates.drift * both,
        bend=None if estimates.bend is None else mirrored(estimates.bend),
        gains=gains,
    )
