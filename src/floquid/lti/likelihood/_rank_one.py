r"""Several inputs: the residues of a mode are an outer product, and modes of equal multipliers can be told apart.

.. math:: y_{oi}[k] = \sum_r \psi_{or}\, l_{ri}\, \mu_r^k

One initial condition excites one combination of modes of equal multipliers, and its response holds no more than that;
two of them excite two. A free fit then finds one pole with residues of rank two. Here the rank is tested, the pole is
split, and poles and participations l are fitted together, the shapes ψ eliminated (variable projection as in
`_exponentials`, inputs one after the other as samples of one response).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from floquid._arrays import Complexes, Floats, Integers
from floquid.fit import DEVIATIONS, ROUNDING, Ends, Normal, Steps, levenberg_marquardt, positive_part, sandwich
from floquid.lti._exponentials import complex_residues, from_sample_zero, no_longer, powers
from floquid.lti._factor import Factor, factors, product_noise
from floquid.lti._poles import PAIR, PoleSet
from floquid.lti._significance import rise_limit
from floquid.lti._types import PRODUCTS, ModalModel, Outcome, OuterProducts, TimeResponses


@dataclass(frozen=True, slots=True)
class Noise:
    """Noise of a free fit, relative to independent white noise of the deviations stated.

    `power` (modes,) is the noise at the frequency of each pole, over its mean; `independent` the share of the responses
    that it is worth.
    """

    power: Floats
    independent: float = 1.0
    size: float = 1.0  # its mean square, which `power` holds too

    @property
    def colour(self) -> Floats:
        """The noise at the frequency of each pole over that of white noise of its size (modes,)."""
        return self.power / self.size

    @staticmethod
    def whitened_by(taps: Floats | None, model: ModalModel, independent: float, variance: float) -> Noise:
        """The noise that a filter makes white, 1/|A|² on the unit circle."""
        turn = np.angle(model.multipliers)
        taps = np.ones(1) if taps is None else taps
        gain = np.abs(np.exp(-1j * np.multiply.outer(turn, np.arange(len(taps)))) @ taps) ** 2
        size = max(variance, 1.0)
        return Noise(size / np.maximum(gain, 1e-6), independent, size)

    def limit(self, entry: int, degrees: float, false_alarm: float) -> float:
        """The sum of squares that noise exceeds at the frequency of a pole."""
        share = self.independent
        return float(self.power[entry]) * rise_limit(false_alarm, max(degrees * share, 1.0), 1e9) / share


def ranks(model: ModalModel, data: TimeResponses, false_alarm: float, noise: Noise | None = None) -> Integers:
    """Number of outer products that the residues of each pole of a free fit hold beyond noise (modes,)."""
    # A singular value of the residues, over the noise that they carry, is kept when those from it on hold more than a
    # chi-square of their degrees of freedom does at the false-alarm probability.
    assert model.residue_spread is not None
    outputs, inputs = data.n_outputs, data.n_inputs
    # A factor a response would undo the products; what a factor an output and an input leaves unequal is averaged.
    scale = product_noise(data.noise)
    unequal = (data.noise / scale) ** 2
    worth = float(unequal.sum() ** 2 / np.sum(unequal**2) / unequal.size)
    noise = noise or Noise(np.ones(model.order))
    counts = np.ones(model.order, np.int64)
    for r in range(model.order):
        carried = scale * np.sqrt(model.residue_spread[:, r, r].real)
        values = np.linalg.svd(model.residues[r] / carried, compute_uv=False)
        parts = 1 if model.multipliers[r].imag == 0 else 2
        for rank in range(1, min(outputs, inputs)):
            degrees = parts * (outputs - rank) * (inputs - rank)
            excess = parts * float(np.sum(values[rank:] ** 2)) / float(unequal.mean())
            if excess * worth < noise.limit(r, degrees * worth, false_alarm):
                break
            counts[r] = rank + 1
    return counts


@dataclass(frozen=True, slots=True)
class Products:
    """Poles, the participation of each in each input (k, inputs), and the input (k,) where it is 1 by definition."""

    poles: PoleSet
    shares: Complexes
    reference: Integers

    @staticmethod
    def of(poles: PoleSet, shares: Complexes) -> Products:
        """With the participations brought to their normal form."""
        return Products(poles, *poles.normalised(shares))

    def without(self, entry: int) -> Products:
        """Less one entry."""
        rest = np.delete(self.shares, entry, axis=0)
        return Products(self.poles.without(entry), rest, np.delete(self.reference, entry))


def split(model: ModalModel, data: TimeResponses, counts: Integers) -> Products:
    """Each pole as often as its residues have rank, with the participations of their singular vectors."""
    scale = product_noise(data.noise)
    s, kind, shares = [], [], []
    for r in range(model.order):
        mu = model.multipliers[r]
        if mu.imag < 0:
            continue
        right = np.linalg.svd(model.residues[r] / scale, full_matrices=False)[2]
        pole = PoleSet.from_multipliers(np.array([mu]))
        for number in range(int(counts[r])):
            s.append(pole.s[0])
            kind.append(pole.kind[0])
            shares.append(right[number])
    return Products.of(PoleSet(np.array(s), np.array(kind)), np.array(shares))


@dataclass(frozen=True, slots=True)
class Tangents:
    """Derivatives of the columns of each entry: the moved columns and the residues that they carry."""

    first: Floats
    second: Floats
    a: Integers
    b: Integers

    def beside(self, q: Floats) -> Tangents:
        """Less what orthonormal columns take of them; what only rounding leaves is zero."""
        # Where two poles are one, a participation moves nothing: divided by rounding, its step would be the longest,
        # and that of all others be shortened to nothing.
        parts = []
        for moved in (self.first, self.second):
            beside = moved - q @ (q.T @ moved)
            beside[:, np.sum(beside**2, axis=0) <= ROUNDING * np.sum(moved**2, axis=0)] = 0.0
            parts.append(beside)
        return Tangents(parts[0], parts[1], self.a, self.b)

    def products(self, moments: Floats) -> Floats:
        """Products of the tangents with one another, over all responses, from the second moments of the residues."""
        total = (self.first.T @ self.first) * moments[np.ix_(self.a, self.a)]
        mixed = (self.first.T @ self.second) * moments[np.ix_(self.a, self.b)]
        return total + mixed + mixed.T + (self.second.T @ self.second) * moments[np.ix_(self.b, self.b)]


@dataclass(frozen=True, slots=True)
class ProductFit:
    """The least-squares fit of outer products: its cost, and what a step and the covariance need."""

    products: Products
    cost: float
    gradient: Floats
    whole: Floats
    information: Floats


def _columns(products: Products, lengths: Integers) -> tuple[Floats, Tangents]:
    """The real columns (rows, order), inputs one after the other, and their tangents, a column a parameter."""
    poles = products.poles
    terms = powers(poles.s, int(lengths.max()))
    ends = np.cumsum(lengths)
    rows = int(ends[-1])
    columns: list[Floats] = []
    first, second, a, b = [], [], [], []
    for entry, kind in enumerate(poles.kind):
        whole, slope = np.zeros(rows, np.complex128), np.zeros(rows, np.complex128)
        alone: list[Complexes] = []
        for i, (end, length) in enumerate(zip(ends, lengths, strict=True)):
            part = slice(int(end - length), int(end))
            whole[part] = products.shares[entry, i] * terms[:length, entry]
            slope[part] = np.arange(length) * whole[part]
            if i != products.reference[entry]:
                single = np.zeros(rows, np.complex128)
                single[part] = terms[:length, entry]
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


def fit_products(products: Products, block: Factor, lengths: Integers) -> ProductFit:
    """Cost, gradient and information matrices."""
    moves, inverse, residues, residual = _eliminated(products, block, lengths)
    gradient = np.einsum("pj,pj->p", moves.first.T @ residual, residues[moves.a])
    gradient += np.einsum("pj,pj->p", moves.second.T @ residual, residues[moves.b])
    whole = moves.products(residues @ residues.T)
    noise = block.columns * moves.products(inverse @ inverse.T)
    cost = float(np.sum(residual**2)) + block.left_out
    return ProductFit(products, cost, gradient, whole, positive_part(whole, whole - noise))


def _eliminated(products: Products, block: Factor, lengths: Integers) -> tuple[Tangents, Floats, Floats, Floats]:
    """The tangents beside the columns QR, R⁻¹, the residues (order, responses), and what is left (rows, responses)."""
    columns, moves = _columns(products, lengths)
    q, r = np.linalg.qr(columns)
    projected = q.T @ block.values
    inverse = np.linalg.pinv(r, rcond=1e-12)
    return moves.beside(q), inverse, inverse @ projected, block.values - q @ projected


def _moved(products: Products, step: Floats) -> Products:
    """After a step in the real parameters: of each entry, those of the pole, then those of the participations."""
    s, shares, at = products.poles.s.copy(), products.shares.copy(), 0
    for entry, kind in enumerate(products.poles.kind):
        free = [i for i in range(shares.shape[1]) if i != products.reference[entry]]
        width = 2 if kind == PAIR else 1
        parts = step[at : at + width * (1 + len(free))].reshape(-1, width)
        numbers = parts[:, 0] + (1j * parts[:, 1] if width == 2 else 0.0)
        s[entry] += numbers[0]
        shares[entry, free] += numbers[1:]
        at += width * (1 + len(free))
    return Products(PoleSet.of(s, products.poles.kind), shares, products.reference)


@dataclass(frozen=True, slots=True)
class Stacked:
    """The responses of all inputs, one input after the other, over the noise as a product; and their factor."""

    data: TimeResponses
    scale: Floats
    values: Floats
    block: Factor

    @staticmethod
    def of(data: TimeResponses) -> Stacked:
        """The responses stacked."""
        scale = product_noise(data.noise)
        parts = [data.values[:, i, :length] / scale[:, i, None] for i, length in enumerate(data.lengths)]
        values = np.concatenate(parts, axis=1)
        values.flags.writeable = False
        return Stacked(data, scale, values, factors(TimeResponses(values=values[:, None], dt=data.dt))[0])


def polish_products(start: Products, stacked: Stacked, *, tolerance: float = 1e-3) -> ProductFit:
    """The poles and participations of least cost near `start`."""
    block, lengths = stacked.block, stacked.data.lengths
    return levenberg_marquardt(
        fit_products(start, block, lengths),
        Steps(
            normal=lambda at: Normal(matrix=at.information, gradient=at.gradient),
            moved=lambda at, step: fit_products(_moved(at.products, step), block, lengths),
            limited=no_longer,
        ),
        Ends(steps=60, deviations=tolerance),
    )


def separated(model: ModalModel, data: TimeResponses, false_alarm: float, noise: Noise) -> ModalModel:
    """The model with the modes of equal multipliers apart; the model itself where there are none."""
    # Each pole of a free fit is split by the rank of its residues. Poles near one another share their errors and seem
    # to have a higher rank; so each outer product must then pass the test that every mode passes.
    counts = ranks(model, data, false_alarm, noise)
    if counts.max(initial=1) == 1:
        return model
    stacked = Stacked.of(data)
    fitted = polish_products(split(model, data, counts), stacked)
    before, level = int((model.multipliers.imag >= 0).sum()), float(np.mean((data.noise / stacked.scale) ** 2))

    def limits(products: Products) -> list[float]:
        near = np.abs(np.subtract.outer(np.exp(products.poles.s), model.multipliers)).argmin(axis=1)
        # An outer product with a real pole has one parameter for each output and input, one with a pair twice as many.
        degrees = products.poles.sizes * (data.n_outputs + data.n_inputs)
        return [
            noise.limit(pole, degree, false_alarm) * level
            for pole, degree in zip(near.tolist(), degrees.tolist(), strict=True)
        ]

    fitted = pruned(fitted, stacked, limits, least=before)
    if len(fitted.products.poles) == before:
        return model
    near = np.argmin(np.abs(fitted.products.poles.multipliers()[:, None] - model.multipliers), axis=1)
    return model_of_products(fitted, stacked, model.outcome, noise.colour[near])


def pruned(
    fit: ProductFit,
    stacked: Stacked,
    limits: Callable[[Products], list[float]],
    *,
    least: int,
    until: float = np.inf,
) -> ProductFit:
    """The fit without the entries, one after another, whose absence raises the cost by less than their `limits`.

    Once the processor time `until` [s] is over, it is the fit so far.
    """
    while len(fit.products.poles) > least:
        trials: list[ProductFit] = []
        for entry in range(len(fit.products.poles)):
            if time.process_time() > until:
                return fit
            trials.append(polish_products(fit.products.without(entry), stacked, tolerance=1e-2))
        excess = np.array([trial.cost - fit.cost for trial in trials]) - np.array(limits(fit.products))
        weakest = int(np.argmin(excess))
        if excess[weakest] > 0.0:
            break
        fit = polish_products(trials[weakest].products, stacked)
    return fit


def merged(model: ModalModel) -> PoleSet:
    """The poles of a free fit that stand for those of outer products: one for all that are not told apart by it."""
    assert model.covariance is not None
    poles = PoleSet.from_multipliers(model.multipliers)
    std = np.sqrt(np.maximum(np.diag(model.covariance), 0.0)) * model.dt
    size = np.hypot(std[: model.order], std[model.order :])[poles.starts()]
    kept: list[int] = []
    for entry, s in enumerate(poles.s):
        if all(abs(s - poles.s[known]) > DEVIATIONS * (size[entry] + size[known]) for known in kept):
            kept.append(entry)
    return poles.keep(np.isin(np.arange(len(poles)), kept))


def refined(model: ModalModel, data: TimeResponses, noise: Noise) -> ModalModel:
    """The model of outer products nearest to another one, on other data; `noise` is as its poles see it."""
    stacked = Stacked.of(data)
    ones = np.ones(model.order, np.int64)
    return model_of_products(polish_products(split(model, data, ones), stacked), stacked, model.outcome, noise.colour)


def model_of_products(fit: ProductFit, stacked: Stacked, outcome: Outcome, colour: Floats) -> ModalModel:
    """The modal model of outer products, with the covariance of its poles."""
    products, data, scale, values = fit.products, stacked.data, stacked.scale, stacked.values
    poles, n = products.poles, products.poles.order
    columns, _ = _columns(products, data.lengths)
    pinv = np.linalg.pinv(columns, rcond=1e-12)
    real = np.asarray(pinv @ values.T, np.float64)
    scale_zero, back = from_sample_zero(poles, int(data.lengths.max()))
    shapes, spread = (
        scale_zero[:, None] * complex_residues(poles, part) for part in (real, np.asarray(pinv, np.float64))
    )
    in_inputs = [poles.with_conjugates(products.shares[:, i]) for i in range(data.n_inputs)]
    residues = np.stack([in_inputs[i][:, None] * shapes * scale[:, i] for i in range(data.n_inputs)], axis=2)
    rest = (values - (columns @ real).T) ** 2
    ends = np.cumsum(data.lengths)
    parts = [slice(int(end - length), int(end)) for end, length in zip(ends, data.lengths, strict=True)]
    free = [max(length - n / data.n_inputs, 1) for length in data.lengths]
    residual_std = [scale[:, i] * np.sqrt(rest[:, part].sum(axis=1) / free[i]) for i, part in enumerate(parts)]
    terms = powers(poles.full(), int(data.lengths.max()))
    steps = [np.arange(length)[:, None] * terms[:length] * in_inputs[i] * back for i, length in enumerate(data.lengths)]
    slope = spread @ np.concatenate(steps)
    # An input that hardly holds a mode says nothing of how its residue there moves with the pole.
    least = np.sqrt(np.finfo(float).eps)
    safe = [np.where(np.abs(share) > least, share, least) for share in in_inputs]
    joint, of_inputs = _covariance(fit, stacked, colour, data.dt), scale[0] / scale[0, 0]
    errors = [spread[:, part] / size for part, size in zip(parts, of_inputs, strict=True)]
    alone = [terms[:length] * back for length in data.lengths]
    return ModalModel(
        multipliers=poles.multipliers(),
        residues=residues,
        dt=data.dt,
        covariance=joint[: 2 * n, : 2 * n],
        residue_spread=np.stack([np.outer(share, share.conj()) * (spread @ spread.conj().T) for share in in_inputs]),
        residue_slope=np.stack([one[:, None] * slope / divisor for one, divisor in zip(in_inputs, safe, strict=True)]),
        residual_std=np.stack(residual_std, axis=1),
        outcome=outcome,
        stats={"cost": fit.cost, PRODUCTS: 1.0},
        products=OuterProducts(
            shares=np.stack(in_inputs, axis=1) * of_inputs,
            spread=np.stack([error @ error.conj().T for error in errors]),
            slope=np.stack([error @ term for error, term in zip(errors, alone, strict=True)]),
            covariance=joint * np.outer(*[np.concatenate([np.ones(2 * n), np.repeat(of_inputs, 2 * n)])] * 2),
        ),
    )


def _covariance(fit: ProductFit, stacked: Stacked, colour: Floats, dt: float) -> Floats:
    """Covariance of the poles [1/s], then of the participations in each input; of each real parts, then imaginary."""
    poles, shares = fit.products.poles, fit.products.shares
    moves, _, residues, residual = _eliminated(fit.products, stacked.block, stacked.data.lengths)
    turned = residual @ residues.T
    # The covariance of the gradient, with that of the responses taken from the residual (`of_dependent_noise`).
    # The parameters, one an input for each pole, have taken their part of it: all of it where any matrix takes so few
    # samples. Then it is that of white noise of the level given.
    degrees = len(residual) - poles.order - stacked.data.n_inputs
    scatter = moves.products(turned.T @ turned / degrees) if degrees > 0 else fit.whole
    unit = sandwich(fit.information, scatter, 1e-12)
    map_ = poles.parameter_map()
    stack = np.concatenate([map_.real, map_.imag]) * np.sqrt(colour)[poles.columns()[0]]
    # Of each entry the parameters of the pole come first, then those of the inputs but the reference, where it is 1.
    to, at, column = np.zeros((1 + shares.shape[1], len(stack), len(unit))), 0, 0
    for width, reference in zip(poles.sizes.tolist(), fit.products.reference.tolist(), strict=True):
        for place in (0, *(1 + i for i in range(shares.shape[1]) if i != reference)):
            to[place, :, at : at + width] = stack[:, column : column + width] / (1.0 if place else dt)
            at += width
        column += width
    stacked_all = to.reshape(-1, len(unit))
    return np.asarray(stacked_all @ unit @ stacked_all.T, np.float64)
