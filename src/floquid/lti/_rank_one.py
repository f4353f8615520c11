r"""Several inputs: the residues of a mode are an outer product, and modes of equal multipliers can be told apart.

.. math:: y_{oi}[k] = \sum_r \psi_{or}\, l_{ri}\, \mu_r^k

One initial condition excites one combination of modes of equal multipliers, and its response holds no more than that;
two of them excite two. A free fit then finds one pole with residues of rank two. Here the rank is tested, the pole is
split, and poles and participations l are fitted together, the shapes ψ eliminated (variable projection as in
`_exponentials`, inputs one after the other as samples of one response).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from floquid._numerics import positive_part, sandwich
from floquid.lti._exponentials import LEAST_DAMPING, basis, complex_residues
from floquid.lti._factor import Factor, factors
from floquid.lti._noise import product_noise
from floquid.lti._poles import PAIR, PoleSet
from floquid.lti._rank import Noise, ranks
from floquid.lti._types import PRODUCTS, ModalModel, Outcome, TimeResponses

STEPS = 60
"""Steps of the fit, at most."""

NOTHING = 1e-12
"""The share of the curvature beyond that of the columns themselves below which it is rounding."""

TOGETHER = 5.0
"""The sum of their standard deviations, times this, within which poles are one to a free fit."""


@dataclass(frozen=True, slots=True)
class Products:
    """Poles, the participation of each in each input (k, inputs), and the input (k,) where it is 1 by definition."""

    poles: PoleSet
    shares: NDArray[np.complex128]
    reference: NDArray[np.int64]

    @staticmethod
    def of(poles: PoleSet, shares: NDArray[np.complex128]) -> Products:
        """With the participations brought to their normal form."""
        reference = np.argmax(np.abs(shares), axis=1)
        shares = shares / shares[np.arange(len(shares)), reference][:, None]
        return Products(poles, np.where(poles.kind[:, None] == PAIR, shares, shares.real), reference)

    def without(self, entry: int) -> Products:
        """Less one entry."""
        rest = np.delete(self.shares, entry, axis=0)
        return Products(self.poles.without(entry), rest, np.delete(self.reference, entry))

    def in_input(self, i: int) -> NDArray[np.complex128]:
        """The participations in input `i` (order,), conjugates conjugated."""
        parts = [
            [v, v.conjugate()] if k == PAIR else [v] for v, k in zip(self.shares[:, i], self.poles.kind, strict=True)
        ]
        return np.concatenate(parts).astype(complex)


def split(model: ModalModel, data: TimeResponses, counts: NDArray[np.int64]) -> Products:
    """Each pole as often as its residues have rank, with the participations of their singular vectors."""
    scale = product_noise(data.noise)
    s, kind, shares = [], [], []
    for r in range(model.order):
        mu = model.multipliers[r]
        if mu.imag < 0:
            continue
        right = np.linalg.svd(model.residues[r] / scale, full_matrices=False)[2]
        one = PoleSet.from_multipliers(np.array([mu]))
        for number in range(int(counts[r])):
            s.append(one.s[0])
            kind.append(one.kind[0])
            shares.append(right[number])
    return Products.of(PoleSet(np.array(s), np.array(kind)), np.array(shares))


@dataclass(frozen=True, slots=True)
class Tangents:
    """How each real parameter moves the columns of its entry: the moved columns and which residues they carry."""

    first: NDArray[np.float64]
    second: NDArray[np.float64]
    a: NDArray[np.int64]
    b: NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class ProductFit:
    """The least-squares fit of outer products: its cost, and what a step and the covariance need."""

    products: Products
    cost: float
    gradient: NDArray[np.float64]
    whole: NDArray[np.float64]
    information: NDArray[np.float64]
    unprojected: NDArray[np.float64]
    """The diagonal of `whole` if the columns took nothing of their tangents (parameters,)."""


def _columns(now: Products, lengths: NDArray[np.int64]) -> tuple[NDArray[np.float64], Tangents]:
    """The real columns (rows, order), inputs one after the other, and their tangents, a column a parameter."""
    poles = now.poles
    powers = basis(poles, int(lengths.max()))[:, poles.starts()]
    ends = np.cumsum(lengths)
    rows = int(ends[-1])
    columns: list[NDArray[np.float64]] = []
    first, second, a, b = [], [], [], []
    for entry, kind in enumerate(poles.kind):
        whole, slope = np.zeros(rows, np.complex128), np.zeros(rows, np.complex128)
        alone: list[NDArray[np.complex128]] = []
        for i, (end, length) in enumerate(zip(ends, lengths, strict=True)):
            part = slice(int(end - length), int(end))
            whole[part] = now.shares[entry, i] * powers[:length, entry]
            slope[part] = np.arange(length) * whole[part]
            if i != now.reference[entry]:
                single = np.zeros(rows, np.complex128)
                single[part] = powers[:length, entry]
                alone.append(single)
        at = len(columns)
        pair = kind == PAIR
        columns += [whole.real, whole.imag] if pair else [whole.real]
        for moved in (slope, *alone):
            for turned in (moved, 1j * moved) if pair else (moved,):
                first.append(turned.real)
                second.append(turned.imag if pair else np.zeros(rows))
                a.append(at)
                b.append(at + 1 if pair else at)
    return np.stack(columns, axis=1), Tangents(
        np.stack(first, axis=1), np.stack(second, axis=1), np.array(a), np.array(b)
    )


def fit_products(now: Products, block: Factor, lengths: NDArray[np.int64]) -> ProductFit:
    """Cost, gradient and information matrices."""
    columns, moves = _columns(now, lengths)
    q, r = np.linalg.qr(columns)
    first = moves.first - q @ (q.T @ moves.first)
    second = moves.second - q @ (q.T @ moves.second)
    projected = q.T @ block.values
    inverse = np.linalg.pinv(r, rcond=1e-12)
    residues = inverse @ projected
    left = block.values - q @ projected
    gradient = np.einsum("pj,pj->p", first.T @ left, residues[moves.a])
    gradient += np.einsum("pj,pj->p", second.T @ left, residues[moves.b])

    def products(moments: NDArray[np.float64]) -> NDArray[np.float64]:
        total = (first.T @ first) * moments[np.ix_(moves.a, moves.a)]
        mixed = (first.T @ second) * moments[np.ix_(moves.a, moves.b)]
        return total + mixed + mixed.T + (second.T @ second) * moments[np.ix_(moves.b, moves.b)]

    moments = residues @ residues.T
    whole = products(moments)
    unprojected = moments[moves.a, moves.a] * np.sum(moves.first**2, axis=0)
    unprojected += 2.0 * moments[moves.a, moves.b] * np.sum(moves.first * moves.second, axis=0)
    unprojected += moments[moves.b, moves.b] * np.sum(moves.second**2, axis=0)
    noise = block.columns * products(inverse @ inverse.T)
    cost = float(np.sum(left**2)) + block.energy - float(np.sum(block.values**2))
    return ProductFit(now, cost, gradient, whole, positive_part(whole, whole - noise), unprojected)


def _moved(now: Products, step: NDArray[np.float64]) -> Products:
    """After a step in the real parameters: of each entry, those of the pole, then those of the participations."""
    s, shares, at = now.poles.s.copy(), now.shares.copy(), 0
    for entry, kind in enumerate(now.poles.kind):
        free = [i for i in range(shares.shape[1]) if i != now.reference[entry]]
        width = 2 if kind == PAIR else 1
        parts = step[at : at + width * (1 + len(free))].reshape(-1, width)
        numbers = parts[:, 0] + (1j * parts[:, 1] if width == 2 else 0.0)
        s[entry] += numbers[0]
        shares[entry, free] += numbers[1:]
        at += width * (1 + len(free))
    return Products(PoleSet.of(s, now.poles.kind), shares, now.reference)


@dataclass(frozen=True, slots=True)
class Stacked:
    """The responses of all inputs, one input after the other, over the noise as a product; and their factor."""

    data: TimeResponses
    scale: NDArray[np.float64]
    values: NDArray[np.float64]
    block: Factor

    @staticmethod
    def of(data: TimeResponses) -> Stacked:
        """The responses stacked."""
        scale = product_noise(data.noise)
        parts = [data.values[:, i, :length] / scale[:, i, None] for i, length in enumerate(data.lengths)]
        values = np.concatenate(parts, axis=1)
        values.flags.writeable = False
        return Stacked(data, scale, values, factors(TimeResponses(values=values[:, None], dt=data.dt))[0])

    def limit(self, size: int, false_alarm: float, noise: Noise, near: int) -> float:
        """The rise that noise explains when an outer product with a real pole (1) or a pair (2) is taken away.

        `near` is the position of the pole of the free fit whose frequency it has.
        """
        degrees = size * (self.data.n_outputs + self.data.n_inputs)
        return noise.limit(near, degrees, false_alarm) * self.noise

    @property
    def noise(self) -> float:
        """The mean square of the noise where its product is 1."""
        return float(np.mean((self.data.noise / self.scale) ** 2))


def polish_products(now: Products, stacked: Stacked, *, steps: int = STEPS, tolerance: float = 1e-3) -> ProductFit:
    """The poles and participations of least cost near `now`, by Levenberg and Marquardt."""
    block, lengths = stacked.block, stacked.data.lengths
    found, damping = fit_products(now, block, lengths), 1e-4
    for _ in range(steps):
        size = np.sqrt(np.diag(found.information))
        # Where two poles are one, a participation moves nothing: its step would shorten that of all others to nothing.
        size[size**2 <= NOTHING * found.unprojected] = np.inf
        system = found.information / np.outer(size, size)
        while damping < 1e8:
            step = np.linalg.solve(system + damping * np.eye(len(size)), found.gradient / size) / size
            step *= min(1.0, 0.5 / max(np.abs(step).max(), 1e-300))
            trial = fit_products(_moved(found.products, step), block, lengths)
            if trial.cost <= found.cost * (1.0 + 1e-12):
                break
            damping = max(10.0 * damping, 1e-4)
        else:
            break
        found, damping = trial, max(0.1 * damping, LEAST_DAMPING)
        if np.abs(step * np.where(np.isfinite(size), size, 0.0)).max() < tolerance:
            break
    return found


def separated(model: ModalModel, data: TimeResponses, false_alarm: float, noise: Noise) -> ModalModel:
    """The model with the modes of equal multipliers apart; the model itself where there are none.

    Each pole of a free fit is split by the rank of its residues. Poles near one another share their errors and seem to
    have a higher rank; so each outer product must then pass the test that every mode passes.
    """
    counts = ranks(model, data, false_alarm, noise)
    if counts.max(initial=1) == 1:
        return model
    stacked = Stacked.of(data)
    found = polish_products(split(model, data, counts), stacked)
    before = int((model.multipliers.imag >= 0).sum())
    while len(found.products.poles) > before:
        trials = [
            polish_products(found.products.without(entry), stacked, tolerance=1e-2)
            for entry in range(len(found.products.poles))
        ]
        rises = [trial.cost - found.cost for trial in trials]
        poles = found.products.poles
        near = np.abs(np.subtract.outer(np.exp(poles.s), model.multipliers)).argmin(axis=1)
        limits = [
            stacked.limit(int(size), false_alarm, noise, int(pole))
            for size, pole in zip(poles.sizes, near, strict=True)
        ]
        least = int(np.argmin(np.array(rises) - np.array(limits)))
        if rises[least] > limits[least]:
            break
        found = polish_products(trials[least].products, stacked)
    if len(found.products.poles) == before:
        return model
    near = np.argmin(np.abs(found.products.poles.multipliers()[:, None] - model.multipliers), axis=1)
    return model_of_products(found, stacked, model.outcome, noise.colour[near])


def merged(model: ModalModel) -> PoleSet:
    """The poles of a free fit that stand for those of outer products: one for all that are not told apart by it."""
    assert model.covariance is not None
    poles = PoleSet.from_multipliers(model.multipliers)
    std = np.sqrt(np.maximum(np.diag(model.covariance), 0.0)) * model.dt
    size = np.hypot(std[: model.order], std[model.order :])[poles.starts()]
    kept: list[int] = []
    for entry, s in enumerate(poles.s):
        if all(abs(s - poles.s[other]) > TOGETHER * (size[entry] + size[other]) for other in kept):
            kept.append(entry)
    return poles.keep(np.isin(np.arange(len(poles)), kept))


def refined(model: ModalModel, data: TimeResponses, noise: Noise) -> ModalModel:
    """The model of outer products nearest to another one, on other data; `noise` is as its poles see it."""
    stacked = Stacked.of(data)
    ones = np.ones(model.order, np.int64)
    return model_of_products(polish_products(split(model, data, ones), stacked), stacked, model.outcome, noise.colour)


def model_of_products(found: ProductFit, stacked: Stacked, outcome: Outcome, colour: NDArray[np.float64]) -> ModalModel:
    """The modal model of outer products, with the covariance of its poles."""
    now, data, scale, values = found.products, stacked.data, stacked.scale, stacked.values
    poles, n = now.poles, now.poles.order
    columns, _ = _columns(now, data.lengths)
    pinv = np.linalg.pinv(columns, rcond=1e-12)
    real = np.asarray(pinv @ values.T, np.float64)
    shapes, spread = complex_residues(poles, real), complex_residues(poles, np.asarray(pinv, np.float64))
    own = [now.in_input(i) for i in range(data.n_inputs)]
    residues = np.stack([own[i][:, None] * shapes * scale[:, i] for i in range(data.n_inputs)], axis=2)
    rest = (values - (columns @ real).T) ** 2
    ends = np.cumsum(data.lengths)
    parts = [slice(int(end - length), int(end)) for end, length in zip(ends, data.lengths, strict=True)]
    free = [max(length - n / data.n_inputs, 1) for length in data.lengths]
    left = [scale[:, i] * np.sqrt(rest[:, part].sum(axis=1) / free[i]) for i, part in enumerate(parts)]
    powers = basis(poles, int(data.lengths.max()))
    steps = [np.arange(length)[:, None] * powers[:length] * own[i] for i, length in enumerate(data.lengths)]
    slope = spread @ np.concatenate(steps)
    # An input that hardly holds a mode says nothing of how its residue there moves with the pole.
    safe = [np.where(np.abs(share) > 1e-9, share, 1e-9) for share in own]
    return ModalModel(
        multipliers=poles.multipliers(),
        residues=residues,
        dt=data.dt,
        covariance=_covariance(found, stacked, colour) / data.dt**2,
        residue_spread=np.stack([np.outer(share, share.conj()) * (spread @ spread.conj().T) for share in own]),
        residue_slope=np.stack([one[:, None] * slope / other for one, other in zip(own, safe, strict=True)]),
        residual_std=np.stack(left, axis=1),
        outcome=outcome,
        stats={"cost": found.cost, PRODUCTS: 1.0},
    )


def _covariance(found: ProductFit, stacked: Stacked, colour: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of the logarithms of the multipliers (2 order, 2 order), real parts, then imaginary parts.

    The scatter of the gradient is that of what is left, whose responses need not err independently, times the noise
    at the frequency of each pole (order,), over its mean.
    """
    unit = sandwich(found.information, _scatter(found.products, stacked), smallest=1e-12)
    own = _pole_parameters(found.products)
    map_ = found.products.poles.parameter_map()
    stack = np.concatenate([map_.real, map_.imag]) * np.sqrt(colour)[found.products.poles.columns()[0]]
    return stack @ unit[np.ix_(own, own)] @ stack.T


def _scatter(now: Products, stacked: Stacked) -> NDArray[np.float64]:
    """The covariance of the gradient, with that of the responses taken from what is left (`of_dependent_noise`)."""
    columns, moves = _columns(now, stacked.data.lengths)
    q, r = np.linalg.qr(columns)
    first = moves.first - q @ (q.T @ moves.first)
    second = moves.second - q @ (q.T @ moves.second)
    projected = q.T @ stacked.block.values
    turned = (stacked.block.values - q @ projected) @ (np.linalg.pinv(r, rcond=1e-12) @ projected).T
    moments = turned.T @ turned / max(len(columns) - now.poles.order, 1)
    mixed = (first.T @ second) * moments[np.ix_(moves.a, moves.b)]
    total = (first.T @ first) * moments[np.ix_(moves.a, moves.a)] + mixed + mixed.T
    return total + (second.T @ second) * moments[np.ix_(moves.b, moves.b)]


def _pole_parameters(now: Products) -> NDArray[np.int64]:
    """The positions of the poles' parameters among all (order,)."""
    positions, at = [], 0
    for kind in now.poles.kind:
        width = 2 if kind == PAIR else 1
        positions += list(range(at, at + width))
        at += width * now.shares.shape[1]
    return np.array(positions)
