"""Sidebands of modes with their joint covariance: how periodic a system is, as a test, an amount, and a template's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floquid._arrays import Complexes, Floats, Integers, Mask
from floquid._checks import Rebuilt, Sealed, input_error
from floquid.core import Estimates, PeriodicModel
from floquid.fit import SURE, scaled_inverse, wald_rise
from floquid.periodic import on_a_mode
from floquid.pipeline import Analysis

SIDES = (-1, 1)
"""Harmonics beside the main line."""

DRAWS = 4000  # of the noise of an amount: its 95 % interval is known to 0.7 % of its probability
LARGEST = 1000  # sidebands with a joint covariance: it takes some 30 MB then


@dataclass(frozen=True, slots=True, kw_only=True)
class PeriodicAmount(Rebuilt):
    """The amount of a periodic system: sidebands over the main lines of its modes.

    Parameters
    ----------
    value, std, interval
        The root of the energy of the sidebands over that of the response, its deviation, and a 95 % interval.
    energy, energy_std
        The share of energy less its expectation under noise, which may be below zero, and its deviation.
    p_value
        The probability of sidebands like these in a constant system.
    mode, harmonic
        The mode of the result and the harmonic, -1 or 1, that carry most of it.
    """

    value: float
    std: float
    interval: tuple[float, float]
    energy: float
    energy_std: float
    p_value: float
    mode: int
    harmonic: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sidebands(Sealed):
    r"""The lines beside the main line of each mode, over its main line on a reference shape.

    .. math:: s_{r,c,\pm 1} = B_{r,c,\pm 1}/g_r, \qquad g_r = \frac{\langle u_r, B_{r,0} \rangle}{\|u_r\|^2}

    channels weighted by their noise, so that sidebands do not depend on how the system was hit. Hits are averaged by
    the size of the mode in them. Real multipliers have none here, nor modes whose sideband lies on another mode.

    Parameters
    ----------
    modes
        The mode of the model that each row is (modes,).
    shapes
        Reference shapes u (modes, channels) [units of the channels].
    values
        s of harmonics -1 and 1 (modes, channels, 2).
    covariance
        Of their real parts, then imaginary parts (2 sidebands, 2 sidebands).
    shares
        The share of each mode in the energy of the response, by its main line (modes,).
    noise
        The noise of each channel, by which energies count (channels,) [units of the channels].
    channels
        Names.
    """

    modes: Integers
    shapes: Complexes
    values: Complexes
    covariance: Floats
    shares: Floats
    noise: Floats
    channels: tuple[str, ...]

    @property
    def vector(self) -> Floats:
        """Real parts, then imaginary parts of all sidebands (2 sidebands,)."""
        return np.concatenate([self.values.real.ravel(), self.values.imag.ravel()])

    @property
    def weights(self) -> Floats:
        """The weight of the square of each part in the energy (2 sidebands,)."""
        each = np.abs(self.shapes / self.noise) ** 2
        by_mode = self.shares[:, None] / each.sum(axis=1, keepdims=True) / self.noise**2
        return np.tile(np.repeat(by_mode.ravel(), len(SIDES)), 2)

    def on(self, other: Sidebands, rows: Integers) -> Sidebands:
        """The sidebands of the modes of `other`, over its reference shapes and shares; `rows` are their modes here."""
        both = other.shapes.conj() / other.noise**2
        change = np.sum(both * self.shapes[rows], axis=1) / np.sum(both * other.shapes, axis=1)
        factor = np.repeat(1.0 / change, self.values[0].size)
        parts = np.arange(self.values.size).reshape(len(self.values), -1)[rows].ravel()
        parts = np.concatenate([parts, parts + self.values.size])
        turn = np.block([[np.diag(factor.real), -np.diag(factor.imag)], [np.diag(factor.imag), np.diag(factor.real)]])
        return Sidebands(
            modes=self.modes[rows],
            shapes=other.shapes,
            values=self.values[rows] / change[:, None, None],
            covariance=turn @ self.covariance[np.ix_(parts, parts)] @ turn.T,
            shares=other.shares,
            noise=other.noise,
            channels=self.channels,
        )

    def picked(self, rows: Integers) -> Sidebands:
        """The sidebands of some modes, the `rows` of this, shares as they are."""
        parts = np.arange(self.values.size).reshape(len(self.values), -1)[rows].ravel()
        parts = np.concatenate([parts, parts + self.values.size])
        return Sidebands(
            modes=self.modes[rows], shapes=self.shapes[rows], values=self.values[rows],
            covariance=self.covariance[np.ix_(parts, parts)], shares=self.shares[rows], noise=self.noise,
            channels=self.channels,
        )  # fmt: skip

    def chance(self, values: Complexes) -> float:
        """The probability of `values` (modes, channels, 2) under noise alone, by χ² with the joint covariance."""
        from scipy.special import chdtrc

        vector = np.concatenate([values.real.ravel(), values.imag.ravel()])
        return float(chdtrc(len(vector), wald_rise(vector, self.covariance)))

    def amount(self, *, confidence: float = 0.95, seed: int = 0) -> PeriodicAmount:
        r"""The amount of the sidebands, without a model.

        .. math:: a^2 = \mu^T K \mu, \qquad \hat{a}^2 = s^T K s - \mathrm{tr}(K \Sigma)

        K are weights, shares of modes over the energy of their main lines. The interval holds each a whose response
        a û + ε has a sum of squares like that seen, û the direction seen and ε noise drawn from Σ. A sum below its
        expectation counts as that: else an interval could be empty. `confidence` is the probability that the interval
        holds a, and `seed` that of the draws.
        """
        vector, weights = self.vector, self.weights
        seen, expected = float(weights @ vector**2), float(weights @ np.diag(self.covariance))
        root = np.linalg.cholesky(self.covariance + np.diag(SURE * np.diag(self.covariance)))
        noise = np.random.default_rng(seed).standard_normal((DRAWS, len(vector))) @ root.T
        enough = max(seen, expected)  # or a sum that noise makes small would leave an empty interval
        across = noise @ (weights * vector) / np.sqrt(max(seen, 1e-300))
        inside = across**2 + enough - noise**2 @ weights
        ends = np.where(inside > 0.0, np.maximum(np.sqrt(np.maximum(inside, 0.0)) - across, 0.0), 0.0)
        low, high = np.quantile(ends, [0.5 - 0.5 * confidence, 0.5 + 0.5 * confidence]).tolist()
        weighted = self.covariance * weights[:, None]
        energy = seen - expected
        error = float(np.sqrt(2.0 * np.sum(weighted * weighted.T) + 4.0 * max(energy, 0.0) * across.var()))
        parts = (self.weights * (vector**2 - np.diag(self.covariance))).reshape(2, *self.values.shape).sum(axis=(0, 2))
        mode, side = np.unravel_index(int(parts.argmax()), parts.shape)
        return PeriodicAmount(
            value=float(np.sqrt(max(energy, 0.0))), std=error / (2.0 * float(np.sqrt(max(energy, 0.5 * error)))),
            interval=(low, high), energy=energy, energy_std=error, p_value=self.chance(self.values),
            mode=int(self.modes[mode]), harmonic=SIDES[side],
        )  # fmt: skip

    def along(
        self, template: Complexes, origin: Complexes | None = None, spread: Floats | None = None
    ) -> tuple[float, float]:
        r"""The amount of a `template` t (modes, channels, 2) in the sidebands less an `origin`, and its deviation.

        .. math:: \hat\delta = \frac{t^T \Sigma^{-1} s}{t^T \Sigma^{-1} t - \mathrm{tr}\, \Sigma^{-1} \Sigma_t},
                  \qquad \mathrm{std}\,\hat\delta = \frac{(t^T \Sigma^{-1} t)^{1/2}}
                  {t^T \Sigma^{-1} t - \mathrm{tr}\, \Sigma^{-1} \Sigma_t}

        with the joint covariance: that of each sideband alone makes the deviation too small. `spread` is the covariance
        Σ_t of a template that was measured, which would make the amount too small. Both are NaN where the template is
        below its noise. Raises InputError where the template has another shape.
        """
        if np.shape(template) != self.values.shape:
            got = f"has {np.shape(template)}"
            raise input_error("template", "Sidebands.along", f"have the shape {self.values.shape}", got)
        inverse = scaled_inverse(self.covariance)
        direction = np.concatenate([np.real(template).ravel(), np.imag(template).ravel()])
        values = self.values if origin is None else self.values - origin
        vector = np.concatenate([values.real.ravel(), values.imag.ravel()])
        whole = float(direction @ inverse @ direction)
        information = whole if spread is None else whole - float(np.sum(inverse * spread))
        if information <= 0.0:
            return np.nan, np.nan
        return float(direction @ inverse @ vector) / information, whole**0.5 / information


def sidebands_of(result: Analysis | PeriodicModel) -> Sidebands | None:
    """Sidebands of the modes of a `result`; None where it has no estimates of them, or too many for a covariance.

    Those of a known system, which has no deviations, are exact.
    """
    model = result.model
    whole = model.unselected
    if whole is None:
        return _exact(model) if model.covariance is None else None
    terms, rows = _terms(whole)
    channels = len(model.channels)
    if not len(rows) or len(rows) * channels * len(SIDES) > LARGEST:
        return None
    zeroth = np.abs(whole.scales[terms[:, 1]])
    noise, by_hit = np.sqrt(np.mean(zeroth**2, axis=(0, 2))), np.sqrt(np.mean((zeroth / zeroth.mean()) ** 2, axis=1))
    main = whole.coefficients[terms[:, 1]]
    sizes = np.sum(np.abs(main / noise[:, None]) ** 2, axis=1)  # (modes, hits)
    shapes = _shapes(main, sizes, noise)
    back = shapes.conj() / noise**2
    back /= np.sum(back * shapes, axis=1, keepdims=True)
    factors = np.einsum("rc,rch->rh", back, main)
    weights = np.abs(factors / by_hit) ** 2
    weights /= weights.sum(axis=1, keepdims=True)
    sides = whole.coefficients[terms[:, [0, 2]]]  # (modes, sides, channels, hits)
    values = np.einsum("rmch,rh->rcm", sides, weights / factors)
    slopes = np.zeros((*values.shape, *whole.coefficients.shape), complex)
    for row, (lower, centre, upper) in enumerate(terms.tolist()):
        for channel in range(channels):
            for side, term in enumerate((lower, upper)):
                slopes[row, channel, side, term, channel] += weights[row] / factors[row]
                moved = -sides[row, side, channel] * weights[row] / factors[row] ** 2
                slopes[row, channel, side, centre] += back[row][:, None] * moved
    return Sidebands(
        modes=model.modes_of(whole)[rows],
        shapes=shapes,
        values=values,
        covariance=_covariance(whole, slopes.reshape(values.size, *whole.coefficients.shape)),
        shares=sizes.sum(axis=1) / sizes.sum(),
        noise=noise,
        channels=tuple(channel.name for channel in model.channels),
    )


def _exact(model: PeriodicModel) -> Sidebands | None:
    """Sidebands of a known system: one of each conjugate pair."""
    places = [np.flatnonzero(model.harmonics == m) for m in (-1, 0, 1)]
    modes = np.array([mode for mode in model.upper_modes if not model.real[mode]], np.int64)
    if not all(map(len, places)) or not len(modes):
        return None
    lower, main, upper = (model.coefficients[modes][:, :, 0, place[0]] for place in places)
    noise = np.ones(main.shape[1])
    shapes = _shapes(main[:, :, None], np.ones((len(modes), 1)), noise)
    strongest = np.abs(main).argmax(axis=1)
    factors = main[np.arange(len(modes)), strongest][:, None]
    sizes = np.sum(np.abs(main) ** 2, axis=1)
    values = np.stack([lower / factors, upper / factors], axis=2)
    return Sidebands(
        modes=modes, shapes=shapes, values=values, covariance=np.zeros((2 * values.size, 2 * values.size)),
        shares=sizes / sizes.sum(), noise=noise, channels=tuple(channel.name for channel in model.channels),
    )  # fmt: skip


def _terms(whole: Estimates) -> tuple[Integers, Integers]:
    """Terms of harmonics -1, 0 and 1 of the modes that have them (modes, 3), and these modes (modes,)."""
    hidden: Mask = on_a_mode(whole)
    rows, terms = [], []
    for mode in np.flatnonzero(~whole.real):
        own = [whole.term(int(mode), m) for m in (-1, 0, 1)]
        if all(term is not None and not hidden[term] for term in own) and (whole.coefficients[own[1]] != 0).any():
            rows.append(int(mode))
            terms.append(own)
    return np.array(terms, np.int64).reshape(-1, 3), np.array(rows, np.int64)


def _shapes(main: Complexes, sizes: Floats, noise: Floats) -> Complexes:
    """Reference shapes (modes, channels): those of the hit with most of the mode, its strongest channel being one."""
    rows = np.arange(len(main))
    shapes = main[rows, :, sizes.argmax(axis=1)]
    strongest = np.abs(shapes / noise).argmax(axis=1)
    return shapes / shapes[rows, strongest][:, None]


def _covariance(whole: Estimates, slopes: Complexes) -> Floats:
    """Joint covariance of quantities by their slopes (quantities, terms, channels, hits), which are analytic."""
    flat = slopes.reshape(len(slopes), -1)
    common = flat @ whole.slopes.reshape(flat.shape[1], -1)
    both = np.concatenate([common.real, common.imag])
    total = both @ whole.covariance @ both.T
    seen = slopes * whole.scales
    if whole.shared:  # the rows of a channel have one error
        seen = seen.sum(axis=3, keepdims=True)
    for channel, hit in np.ndindex(*seen.shape[2:]):
        own = seen[:, :, channel, hit]
        turn = np.block([[own.real, -own.imag], [own.imag, own.real]])
        total += turn @ whole.spread[whole.blocks[channel, hit]] @ turn.T
    return 0.5 * (total + total.T)
