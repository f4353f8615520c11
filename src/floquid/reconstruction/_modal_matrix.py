"""The modal matrix Ψ(t) in the coordinates of the states, A(t) from it, and what errors of the estimates do to both."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from floquid._arrays import Complexes, Floats, Integers, Mask
from floquid.core import Estimates, PeriodicModel
from floquid.errors import IdentificationError
from floquid.reconstruction._coordinates import Coordinates, channel_noise

LARGEST_CONDITION = 1e8  # the condition number of the equilibrated modal matrix beyond which its inverse is noise
MOST_SLOPES = 1 << 20  # slopes of elements by coefficients that are held at once


@dataclass(frozen=True, slots=True)
class Shapes:
    """The shapes of a model in the coordinates of the states, the hits combined."""

    exponents: Complexes  # (modes,)
    harmonics: Integers
    fundamental: float
    coefficients: Complexes  # of the channels (modes, channels, harmonics)
    hits: Complexes  # the factor of each hit in them (modes, hits)
    weights: Complexes  # the factor of each channel in each state (modes, harmonics, states, channels)
    slopes: Complexes  # the slope of the weights by the rate (modes, harmonics, states, channels)
    kept: Mask  # mask of the coefficients that count (modes, harmonics)

    @property
    def rates(self) -> Complexes:
        """λ + imω (modes, harmonics) [1/s]."""
        return self.exponents[:, None] + 1j * self.fundamental * self.harmonics

    @property
    def states(self) -> Complexes:
        """The coefficients of the states (modes, harmonics, states)."""
        return np.einsum("rmic,rcm->rmi", self.weights, self.coefficients * self.kept[:, None, :])


@dataclass(frozen=True, slots=True)
class Terms:
    """Places of the terms of estimates in `Shapes`."""

    estimates: Estimates
    modes: Integers
    places: Integers  # of the harmonics (terms,)
    mirror_modes: Integers
    mirror_places: Integers  # the same of their mirror images (terms,)

    def mask(self, kept: Mask, like: Shapes) -> Shapes:
        """The shapes with some of the terms alone (terms,), and their mirror images."""
        whole = np.zeros_like(like.kept)
        whole[self.modes[kept], self.places[kept]] = True
        whole[self.mirror_modes[kept], self.mirror_places[kept]] = True
        return replace(like, kept=whole)


def shapes_of(
    model: PeriodicModel, coordinates: Coordinates, estimates: Estimates | None = None, *, cut: bool = False
) -> Shapes:
    """The shapes of a model in these coordinates, with all terms of `estimates` where these are given.

    With `cut` the coefficients are those of the model all the same: zero where it has them so, in each channel.

    Several hits give one shape a mode, up to a factor that cancels in A(t) and Φ: the leading singular vector over the
    hits, channels weighted by their noise.
    """
    harmonics, whole = model.harmonics, model.coefficients
    if estimates is not None:
        terms = terms_of(model, estimates)
        low, high = _ends(model, estimates)
        harmonics = np.arange(low, high + 1)
        whole = np.zeros((*model.coefficients.shape[:3], len(harmonics)), complex)
        straight, back = np.moveaxis(whole, 3, 1), estimates.coefficients.conj()
        straight[terms.mirror_modes, terms.mirror_places] = back
        straight[terms.modes, terms.places] = estimates.coefficients
        if cut:
            whole[...] = 0.0
            whole[..., np.searchsorted(harmonics, model.harmonics)] = model.coefficients
    combined = np.zeros((model.order, len(model.channels), len(harmonics)), complex)
    hits = np.zeros((model.order, model.n_hits), complex)
    weight = 1.0 / channel_noise(model)
    for r in range(model.order):
        block = (model.coefficients[r] * weight[:, None, None]).transpose(0, 2, 1).reshape(-1, model.n_hits)
        _, _, right = np.linalg.svd(block, full_matrices=False)
        hits[r] = right[0].conj()
        combined[r] = np.einsum("chm,h->cm", whole[r], hits[r])
    rates = model.exponents[:, None] + 1j * harmonics * model.fundamental
    weights, slopes = coordinates.weights(rates)
    kept = (whole != 0).any(axis=(1, 2))
    return Shapes(model.exponents, harmonics, model.fundamental, combined, hits, weights, slopes, kept)


def terms_of(model: PeriodicModel, estimates: Estimates) -> Terms:
    """Places of the terms of estimates in the shapes of a model."""
    modes, low = model.modes_of(estimates), _ends(model, estimates)[0]
    own = modes[estimates.modes]
    partners = np.argmin(np.abs(np.subtract.outer(model.exponents[modes].conj(), model.exponents)), axis=1)
    mirrored = np.where(estimates.real, modes, partners)[estimates.modes]
    mirror = -estimates.half_turns[estimates.modes] - estimates.harmonics
    return Terms(estimates, own, estimates.harmonics - low, mirrored, mirror - low)


def at_terms(slopes: Complexes, model: PeriodicModel, terms: Terms) -> Complexes:
    """Slopes by the coefficients of a model, (..., modes, channels, hits, harmonics), as those by terms."""
    # That of the mirror image of a real multiplier's term is in its own.
    low = _ends(model, terms.estimates)[0]
    whole = np.zeros((*slopes.shape[:-1], int(max(terms.places.max(), terms.mirror_places.max())) + 1), complex)
    seen = (model.harmonics - low >= 0) & (model.harmonics - low < whole.shape[-1])
    whole[..., model.harmonics[seen] - low] = slopes[..., seen]
    by_mode = np.moveaxis(whole, (-4, -1), (0, 1))
    own = by_mode[terms.modes, terms.places]
    mirrored = by_mode[terms.mirror_modes, terms.mirror_places].conj()
    turning = terms.estimates.turning[:, None, None, None, None]
    return np.moveaxis(own + np.where(turning, mirrored, 0.0), 0, -3)


def _ends(model: PeriodicModel, estimates: Estimates) -> tuple[int, int]:
    """The lowest and the highest harmonic of the model, of the estimates, and of their mirror images."""
    mirror = -estimates.half_turns[estimates.modes] - estimates.harmonics
    whole = np.concatenate([model.harmonics, estimates.harmonics, mirror])
    return int(whole.min()), int(whole.max())


@dataclass(frozen=True, slots=True)
class Modal:
    """Ψ and A at some instants."""

    modal: Complexes  # Ψ (times, states, modes)
    inverse: Complexes
    system: Complexes  # a (times, states, states), real up to rounding
    condition: Floats  # of the equilibrated Ψ (times,)


def modal_at(shapes: Shapes, times: Floats, names: str = "these states") -> Modal:
    """Ψ(t) and A(t) = (Ψ' + ΨΛ) Ψ⁻¹ (Allen 2009, eqs. 18 and 21, as corrected)."""
    states, phases = shapes.states, np.exp(1j * shapes.fundamental * np.multiply.outer(times, shapes.harmonics))
    modal = np.einsum("rmi,tm->tir", states, phases)
    # d/dt(Ψ e^{Λt}) e^{-Λt} = Ψ' + ΨΛ: each coefficient times its own rate once more.
    moved = np.einsum("rmi,tm->tir", states * shapes.rates[:, :, None], phases)
    if (modal == 0).all(axis=(0, 2)).any():
        raise IdentificationError("A state chosen has no part in any mode: choose other channels with `states`.")
    condition = condition_of(modal)
    if not (condition < LARGEST_CONDITION).all():
        raise IdentificationError(
            f"The modes' shapes in {names} are linearly dependent (condition number {condition.max():.1e} of the "
            "modal matrix): A(t) in these states would be noise. Choose other channels with `states`."
        )
    inverse = np.linalg.inv(modal)
    return Modal(modal, inverse, moved @ inverse, condition)


def condition_of(modal: Complexes) -> Floats:
    """The condition numbers (times,) of Ψ (times, states, modes), states and modes brought to one size."""
    least = np.finfo(float).tiny
    scaled = modal / np.maximum(np.sqrt(np.mean(np.abs(modal) ** 2, axis=(0, 2))), least)[:, None]
    return np.linalg.cond(scaled / np.maximum(np.linalg.norm(scaled, axis=1, keepdims=True), least))


@dataclass(frozen=True, slots=True)
class Jacobian:
    """Slopes of the elements of a matrix (states, columns) at some instants."""

    by_coefficient: Complexes  # (times, states, columns, terms, channels, hits)
    by_rate: Complexes  # (times, states, columns, terms)
    by_exponent: Complexes | None = None  # (times, states, columns, modes of the estimates)
    by_parameter: Floats | None = None  # (times, states, columns, parameters of the estimates)

    def __sub__(self, other: Jacobian) -> Jacobian:
        return Jacobian(self.by_coefficient - other.by_coefficient, self.by_rate - other.by_rate)

    def loosened(self, matrix: Floats, loose: Complexes) -> Jacobian:
        """With what the errors E of states from all channels do: δA = DA - AD, D = diag(E, E), and δB = DB."""
        total, count = self.by_coefficient.copy(), len(loose)
        for i, j in np.ndindex(count, count):
            unit = np.zeros((count, count))
            unit[i, j] = 1.0
            off = np.kron(np.eye(2), unit)
            square = matrix.shape[-1] == 2 * count and self.by_parameter is None
            total += np.multiply.outer(off @ matrix - (matrix @ off if square else 0.0), loose[i, j])
        return replace(self, by_coefficient=total)

    def variance(self, estimates: Estimates) -> Floats:
        """The variance of the elements (times, states, states)."""
        shape = self.by_rate.shape[:3]
        count = int(np.prod(shape))
        return estimates.variance(
            by_coefficients=self.by_coefficient.reshape(count, *self.by_coefficient.shape[3:]),
            by_rates=self.by_rate.reshape(count, -1),
            by_exponents=None if self.by_exponent is None else self.by_exponent.reshape(count, -1),
            by_parameters=None if self.by_parameter is None else self.by_parameter.reshape(count, -1),
        ).reshape(shape)


def at_once(shapes: Shapes, times: Floats, terms: Terms) -> Iterator[slice]:
    """The instants in groups whose slopes are few enough to be held."""
    _, _, states, channels = shapes.weights.shape
    group = max(MOST_SLOPES // (states**2 * len(terms.modes) * channels * shapes.hits.shape[1]), 1)
    return (slice(begin, begin + group) for begin in range(0, len(times), group))


def _outer(by_channel: Complexes, left: Complexes, hits: Complexes) -> Complexes:
    """Products of (times, terms, states, channels), (times, terms, states) and (terms, hits), as in `Jacobian`."""
    right = (left[..., None] * hits[:, None]).swapaxes(1, 2)
    return by_channel.swapaxes(1, 2)[:, :, None, :, :, None] * right[:, None, :, :, None]


def by_system(shapes: Shapes, modal: Modal, times: Floats, t: slice, terms: Terms) -> Jacobian:
    r"""The slopes of A at the instants `times[t]`.

    .. math:: \delta A = (\delta(\dot\Psi + \Psi\Lambda) - A\, \delta\Psi)\, \Psi^{-1}
    """
    r, m = terms.modes, terms.places
    kept = shapes.kept[r, m]
    weights, slopes, rates = shapes.weights[r, m], shapes.slopes[r, m], shapes.rates[r, m]
    own, a = shapes.coefficients[r, :, m] * kept[:, None], modal.system[t]
    # By the rate: the weights change with it, and so does the factor s of the derivative.
    turned, moved = np.einsum("kic,kc->ki", weights, own), np.einsum("kic,kc->ki", slopes, own)
    phase = np.exp(1j * shapes.fundamental * np.multiply.outer(times[t], shapes.harmonics[m]))
    left = modal.inverse[t][:, r] * (terms.estimates.multiplicity * kept * phase)[..., None]
    by_channel = rates[:, None, None] * weights - a[:, None] @ weights
    return Jacobian(
        _outer(by_channel, left, shapes.hits[r]),
        np.einsum("tki,tkj->tijk", turned + rates[:, None] * moved - moved @ a.swapaxes(1, 2), left),
    )


def by_transition(shapes: Shapes, modal: Modal, times: Floats, t: slice, terms: Terms) -> Jacobian:
    r"""The slopes of Φ(t, t0) at the instants `times[t]`, t0 the first of all.

    .. math:: \delta\Phi = \delta\Psi(t)\, e^{\Lambda (t - t_0)} \Psi(t_0)^{-1}
              + \Psi(t)\, \delta e^{\Lambda (t - t_0)}\, \Psi(t_0)^{-1} - \Phi\, \delta\Psi(t_0)\, \Psi(t_0)^{-1}
    """
    r, m = terms.modes, terms.places
    kept = shapes.kept[r, m]
    weights, slopes = shapes.weights[r, m], shapes.slopes[r, m]
    moved = np.einsum("kic,kc->ki", slopes, shapes.coefficients[r, :, m] * kept[:, None])
    turns = 1j * shapes.fundamental * shapes.harmonics[m]
    first, later = modal.inverse[0], times[t] - times[0]
    growth = np.exp(np.multiply.outer(later, shapes.exponents))
    phi = (modal.modal[t] * growth[:, None]) @ first
    now, then = np.exp(np.multiply.outer(times[t], turns)) * growth[:, r], np.exp(turns * times[0])
    by_channel = now[..., None, None] * weights - then[:, None, None] * (phi[:, None] @ weights)
    by_rate = now[..., None] * moved - then[:, None] * (moved @ phi.swapaxes(1, 2))
    left = np.broadcast_to(first[r] * (terms.estimates.multiplicity * kept)[:, None], (len(later), len(r), len(first)))
    # Of a pair, the mode in the estimates and its conjugate do the same.
    entries = np.array([np.flatnonzero(terms.estimates.modes == e)[0] for e in range(len(terms.estimates.exponents))])
    modes, pairs = r[entries], np.where(terms.estimates.real, 1.0, 2.0)
    grown = modal.modal[t][..., modes] * (growth[:, modes] * later[:, None] * pairs)[:, None]
    return Jacobian(
        _outer(by_channel, left, shapes.hits[r]),
        np.einsum("tki,tkj->tijk", by_rate, left),
        np.einsum("tir,rj->tijr", grown, first[modes]),
    )


def by_inputs(shapes: Shapes, modal: Modal, times: Floats, t: slice, terms: Terms) -> Jacobian:
    r"""The slopes of B at the instants `times[t]`.

    .. math:: \delta B = \delta\Psi\, b + \Psi\, \delta b
    """
    own, r, m = terms.estimates, terms.modes, terms.places
    assert own.gains is not None
    kept = shapes.kept[r, m]
    weights, slopes = shapes.weights[r, m], shapes.slopes[r, m]
    turned = np.exp(1j * shapes.fundamental * np.multiply.outer(times[t], own.gains.harmonics))
    phase = np.exp(1j * shapes.fundamental * np.multiply.outer(times[t], shapes.harmonics[m]))
    entries = np.array([r[np.flatnonzero(own.modes == entry)[0]] for entry in range(len(own.exponents))])
    # The shapes have a factor of their own, as those of several hits have.
    factor = shapes.hits[entries, 0]
    gains = np.einsum("ril,tl->tri", own.gains.coefficients, turned) / factor[:, None]
    left = gains[:, own.modes] * (own.multiplicity * kept * phase)[..., None]
    moved = np.einsum("kic,kc->ki", slopes, shapes.coefficients[r, :, m] * kept[:, None])
    pairs = np.where(own.real, 1.0, 2.0) / factor
    by_gain = np.einsum("tsr,r,rilp,tl->tsip", modal.modal[t][..., entries], pairs, own.gains.slopes, turned)
    return Jacobian(
        _outer(np.broadcast_to(weights, (len(phase), *weights.shape)), left, shapes.hits[r]),
        np.einsum("ki,tkj->tijk", moved, left),
        by_parameter=by_gain.real,
    )
