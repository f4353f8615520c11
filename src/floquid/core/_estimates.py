"""Exponents and coefficients together with their joint covariance, kept in factors."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Complexes, Floats, Integers, Mask
from floquid._checks import Rebuilt, finite, input_error, positive


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Gains(Rebuilt):
    """Coefficients by which measured inputs drive the modes of `Estimates`, and how they move with its parameters.

    Raises InputError where a shape is not possible.
    """

    harmonics: Integers  # The integers l, ascending (harmonics,)
    # b (modes, inputs, harmonics) [1/s over the units of the inputs]; of a real multiplier those below zero, too
    coefficients: Complexes
    slopes: Complexes  # Derivatives of b by the parameters p of the estimates (modes, inputs, harmonics, parameters)

    def __post_init__(self) -> None:
        self._freeze(dtype=np.int64, harmonics=("harmonics",))
        self._freeze(dtype=np.complex128, coefficients=("modes", "inputs", len(self.harmonics)))
        self._freeze(dtype=np.complex128, slopes=(*self.coefficients.shape, "parameters"))

    def std(self, covariance: Floats) -> Complexes:
        """Deviations of b (modes, inputs, harmonics), by the covariance of p: real part of the real part."""
        return _deviations(self.slopes, covariance)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Estimates(Rebuilt):
    r"""Exponents and every coefficient of a fit, with their joint covariance.

    The parameters are p = (Re λ, Im λ, ω, others), others being all else that errors of several rows have in common:
    gains of inputs, or the states of hits that share their shapes. One *term* (r, m) is the coefficient B of harmonic m
    of mode r. Errors are those of p and, independent of them, the noise of each row, a row being one channel in one
    hit:

    .. math:: \delta B_{k,c,h} = \sum_p S_{k,c,h,p}\, \delta p + g_{k,c,h}\, e_{k,c,h}, \qquad
              \mathrm{cov}\,[\Re e; \Im e]_{c,h} = V_{b(c,h)}

    so that a model of many channels is never one dense matrix (decision 0014). Of a conjugate pair the mode of positive
    imaginary part alone is here, and of a real multiplier the harmonics that turn forwards: the others are their mirror
    images.

    Where all hits share one shape (`shared`), the errors e are those of a channel, the same in each hit. Then p has
    further parameters behind ω that move coefficients alone: the states of modes in hits.

    Raises InputError where a shape or a value is not possible.

    Parameters
    ----------
    exponents, fundamental
        λ (modes,) [1/s], and ω [rad/s].
    real
        Which multipliers are real (modes,): the imaginary part is no parameter, but half the fundamental or nothing.
    modes, harmonics
        The mode and the harmonic m of each term (terms,).
    coefficients
        B (terms, channels, hits) [units of the channels].
    covariance
        Of p: real parts, imaginary parts, fundamental, others (parameters, parameters), at least 2 modes + 1; zero
        where one is no parameter.
    slopes
        S (terms, channels, hits, parameters).
    spread, blocks
        V, of real parts, then imaginary parts (blocks, 2 terms, 2 terms), and b: the V of each row (channels, hits).
    scales
        g (terms, channels, hits) [units of the channels].
    drift
        W (blocks, 2 terms, 2 terms), by which the slopes follow from coefficients (`slopes_at`); None where they are
        known at these coefficients alone.
    bend
        f (terms, channels, hits), the relative slope of the filter that the responses went through; None for none.
    gains
        How measured inputs drive the modes; None where none were measured.
    shared
        True where the hits share one shape: the rows of one channel have one error e.
    """

    exponents: Complexes
    real: Mask
    fundamental: float
    modes: Integers
    harmonics: Integers
    coefficients: Complexes
    covariance: Floats
    slopes: Complexes
    spread: Floats
    blocks: Integers
    scales: Complexes
    drift: Floats | None = None
    bend: Complexes | None = None
    gains: Gains | None = None
    shared: bool = False

    def __post_init__(self) -> None:
        of, put = "Estimates", object.__setattr__
        self._freeze(dtype=np.complex128, exponents=("modes",))
        self._freeze(dtype=np.int64, modes=("terms",))
        lam, modes, n = self.exponents, self.modes, len(self.modes)
        self._freeze(dtype=np.complex128, coefficients=(n, "channels", "hits"))
        put(self, "fundamental", positive(self.fundamental, "fundamental", of, unit="rad/s"))
        real = np.array(self.real, bool)
        real.flags.writeable = False
        put(self, "real", real)
        shape, square = self.coefficients.shape, (2 * n, 2 * n)
        self._freeze(dtype=np.int64, harmonics=(n,), blocks=shape[1:])
        parts = max(len(np.atleast_1d(self.covariance)), 2 * len(lam) + 1)
        self._freeze(covariance=(parts, parts))
        self._freeze(spread=("blocks", *square), drift=(len(self.spread), *square))
        self._freeze(dtype=np.complex128, slopes=(*shape, parts), scales=shape, bend=shape)
        if real.shape != lam.shape or (n and (modes.min() < 0 or modes.max() >= len(lam))):
            raise input_error("modes", of, "name modes of `exponents`", f"are {np.unique(modes).tolist()}")
        if self.blocks.size and (self.blocks.min() < 0 or self.blocks.max() >= len(self.spread)):
            raise input_error("blocks", of, "name blocks of `spread`", f"are {np.unique(self.blocks).tolist()}")
        if self.gains is not None and self.gains.slopes.shape[::3] != (len(lam), parts):
            must = f"have the {len(lam)} modes and {parts} parameters of the estimates"
            raise input_error("gains", of, must, f"have {self.gains.slopes.shape[::3]}")

    @property
    def fundamental_place(self) -> int:
        """The place of ω among the parameters, behind both parts of the exponents."""
        return 2 * len(self.exponents)

    @property
    def rates(self) -> Complexes:
        """λ + imω of each term (terms,) [1/s]."""
        return self.exponents[self.modes] + 1j * self.fundamental * self.harmonics

    @property
    def half_turns(self) -> Integers:
        """κ = 2 Im λ/ω of real multipliers, zero for pairs (modes,)."""
        return np.where(self.real, np.rint(2.0 * self.exponents.imag / self.fundamental), 0).astype(np.int64)

    @property
    def turning(self) -> Mask:
        """Mask of the terms that turn (terms,): all but that of a real multiplier that has a real coefficient."""
        return ~(self.real[self.modes] & (2 * self.harmonics + self.half_turns[self.modes] == 0))

    @property
    def multiplicity(self) -> Floats:
        """Count of a term in the response, its mirror image included: 2, or 1 where it does not turn (terms,)."""
        return np.where(self.turning, 2.0, 1.0)

    @property
    def rate_slopes(self) -> Complexes:
        """Derivatives of the rate of each term with respect to the parameters (terms, parameters)."""
        slopes = self.exponent_slopes[self.modes]
        slopes[:, self.fundamental_place] += 1j * self.harmonics
        return slopes

    @property
    def exponent_slopes(self) -> Complexes:
        """Derivatives of the exponents with respect to the parameters (modes, parameters)."""
        count = len(self.exponents)
        slopes = np.zeros((count, len(self.covariance)), complex)
        modes = np.arange(count)
        slopes[modes, modes], slopes[modes, count + modes] = 1.0, 1j * ~self.real
        slopes[:, self.fundamental_place] = 0.5j * self.half_turns
        return slopes

    def std(self) -> Complexes:
        """Deviations of the coefficients (terms, channels, hits): real part of the real, imaginary of the imaginary."""
        n = len(self.modes)
        spread = np.diagonal(self.spread, axis1=1, axis2=2)[self.blocks]
        cross = np.diagonal(self.spread[:, :n, n:], axis1=1, axis2=2)[self.blocks]
        up, down, both = (np.moveaxis(part, -1, 0) for part in (spread[..., :n], spread[..., n:], cross))
        g, s = self.scales, self.slopes
        real = g.real**2 * up + g.imag**2 * down - 2.0 * g.real * g.imag * both
        imag = g.imag**2 * up + g.real**2 * down + 2.0 * g.real * g.imag * both
        shared = _deviations(s, self.covariance)
        real, imag = real + shared.real**2, imag + shared.imag**2
        return np.sqrt(np.maximum(real, 0.0)) + 1j * np.sqrt(np.maximum(imag, 0.0))

    def noise_covariance(self, channel: int, hit: int) -> Floats:
        """Covariance of the coefficients of a row, `channel` and `hit`, when p is known (2 terms, 2 terms)."""
        g = self.scales[:, channel, hit]
        turn = np.block([[np.diag(g.real), -np.diag(g.imag)], [np.diag(g.imag), np.diag(g.real)]])
        return turn @ self.spread[self.blocks[channel, hit]] @ turn.T

    def row_covariance(self, channel: int, hit: int) -> Floats:
        """Covariance of the coefficients of a row, `channel` and `hit`, by all errors (2 terms, 2 terms)."""
        slopes = self.slopes[:, channel, hit]
        both = np.concatenate([slopes.real, slopes.imag])
        return self.noise_covariance(channel, hit) + both @ self.covariance @ both.T

    def slopes_at(self, coefficients: Complexes, channel: int, hit: int) -> Complexes:
        r"""The slopes S of one row for other coefficients than those estimated (terms, parameters).

        .. math:: S = -g\, W \Big(\frac{\partial s}{\partial p}\, g^{-1} B\Big) - f\, \frac{\partial s}{\partial p} B

        with s the rates, B the `coefficients` (terms,), `channel` and `hit` the row. The slopes at the estimates hold
        the noise of every coefficient; where many are small, what is fitted needs those at its own coefficients.
        """
        if self.drift is None:
            return self.slopes[:, channel, hit]
        scale = self.scales[:, channel, hit]
        turned = self.rate_slopes * (coefficients / scale)[:, None]
        stacked = self.drift[self.blocks[channel, hit]] @ np.concatenate([turned.real, turned.imag])
        up, down = np.split(stacked, 2)
        slopes = -(up + 1j * down) * scale[:, None]
        if self.bend is not None:
            slopes = slopes - (self.bend[:, channel, hit] * coefficients)[:, None] * self.rate_slopes
        return slopes

    def variance(
        self,
        *,
        by_coefficients: Complexes,
        by_rates: Complexes | None = None,
        by_exponents: Complexes | None = None,
        by_parameters: Floats | None = None,
    ) -> Floats:
        r"""The variance of real quantities f, to first order (quantities,).

        .. math:: \delta f = \Re \Big(\sum_k \frac{\partial f}{\partial B_k} \delta B_k +
                  \sum_k \frac{\partial f}{\partial s_k} \delta s_k + \sum_r \frac{\partial f}{\partial \lambda_r}
                  \delta \lambda_r\Big) + \sum_p \frac{\partial f}{\partial p} \delta p

        with s the rates of the terms. A slope is that of the term and of its mirror image together: `by_coefficients`
        (quantities, terms, channels, hits), `by_rates` (quantities, terms), `by_exponents` (quantities, modes),
        `by_parameters` (quantities, parameters) of what depends on p beside them.
        """
        flat = by_coefficients.reshape(len(by_coefficients), -1)
        total = (flat @ self.slopes.reshape(flat.shape[1], -1)).real
        if by_rates is not None:
            total += (by_rates @ self.rate_slopes).real
        if by_exponents is not None:
            total += (by_exponents @ self.exponent_slopes).real
        if by_parameters is not None:
            total += by_parameters
        variance = np.einsum("qp,qp->q", total @ self.covariance, total)
        used = by_coefficients.any(axis=(0, 1))
        for block, spread in enumerate(self.spread):
            in_block = used & (self.blocks == block)
            seen = by_coefficients[:, :, in_block] * self.scales[:, in_block]
            if self.shared:
                seen = seen.sum(axis=2, keepdims=True)  # the rows of a block are the hits of a channel
            both = np.concatenate([seen.real, -seen.imag], axis=1).swapaxes(1, 2)
            variance += np.sum((both @ spread) * both, axis=(1, 2))
        return np.maximum(variance, 0.0)

    def picked(self, *, modes: ArrayLike | None = None, terms: ArrayLike | None = None) -> Estimates:
        """Some of the `modes`, in the order wanted, and of their `terms`, a mask or indices; None for all of them."""
        kept = np.arange(len(self.exponents)) if modes is None else np.asarray(modes, np.int64)
        chosen = np.arange(len(self.modes))
        if terms is not None:
            chosen = chosen[np.asarray(terms)]
        place = np.full(len(self.exponents), -1)
        place[kept] = np.arange(len(kept))
        kept_terms = [k for mode in kept for k in chosen if self.modes[k] == mode]
        others = np.arange(self.fundamental_place, len(self.covariance))
        parts = np.concatenate([kept, kept + len(self.exponents), others])
        both = np.concatenate([kept_terms, np.array(kept_terms, int) + len(self.modes)]).astype(int)
        return Estimates(
            exponents=self.exponents[kept],
            real=self.real[kept],
            fundamental=self.fundamental,
            modes=place[self.modes[kept_terms]],
            harmonics=self.harmonics[kept_terms],
            coefficients=self.coefficients[kept_terms],
            covariance=self.covariance[np.ix_(parts, parts)],
            slopes=self.slopes[kept_terms][..., parts],
            spread=self.spread[:, both][:, :, both],
            blocks=self.blocks,
            scales=self.scales[kept_terms],
            drift=None if self.drift is None else self.drift[:, both][:, :, both],
            bend=None if self.bend is None else self.bend[kept_terms],
            gains=None if self.gains is None else self._gains_of(self.gains, kept, parts),
            shared=self.shared,
        )

    @staticmethod
    def _gains_of(gains: Gains, kept: Integers, parts: Integers) -> Gains:
        return Gains(
            harmonics=gains.harmonics, coefficients=gains.coefficients[kept], slopes=gains.slopes[kept][..., parts]
        )

    def moved(self, step: Floats) -> Estimates:
        """The estimates after a step of their parameters (parameters,)."""
        gains = self.gains
        return replace(
            self,
            exponents=self.exponents + self.exponent_slopes @ step,
            fundamental=self.fundamental + float(step[self.fundamental_place]),
            coefficients=self.coefficients + self.slopes @ step,
            gains=None if gains is None else replace(gains, coefficients=gains.coefficients + gains.slopes @ step),
        )

    def term(self, mode: int, harmonic: int) -> int | None:
        """The position of the term of a `mode` and `harmonic`; None where there is none."""
        places = np.flatnonzero((self.modes == mode) & (self.harmonics == harmonic))
        return int(places[0]) if len(places) else None

    def period_std(self) -> float:
        """The deviation of the period [s]; zero where it was given."""
        return finite(2.0 * np.pi / self.fundamental**2 * self.fundamental_std, "covariance", "Estimates")

    @property
    def fundamental_std(self) -> float:
        """The deviation of ω [rad/s]; zero where the period was given."""
        return float(np.sqrt(self.covariance[self.fundamental_place, self.fundamental_place]))


def _deviations(slopes: Complexes, covariance: Floats) -> Complexes:
    """Deviations by slopes (…, parameters): that of the real part as the real part, of the imaginary the imaginary."""
    real, imag = (
        np.sqrt(np.maximum(np.sum((part @ covariance) * part, axis=-1), 0.0)) for part in (slopes.real, slopes.imag)
    )
    return np.asarray(real + 1j * imag, np.complex128)
