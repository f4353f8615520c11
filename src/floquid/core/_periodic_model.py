"""The identified response model of a linear time-periodic system."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Complexes, Floats, Integers, Mask
from floquid._checks import Rebuilt, frozen_array, input_error, positive
from floquid._show import Drawings, Drawn
from floquid.core._channel import Channel
from floquid.core._estimates import Estimates
from floquid.core._model_inputs import ModelInputs
from floquid.core._record import Provenance, as_channels, as_point
from floquid.core._shape import Shape, couples_of, shape_of
from floquid.fit import WITHIN

PRODUCT = 1e-9  # share of the first singular value below which the second is rounding: a shape times a state
SAME = 1e-9  # share of the fundamental within which two exponents are one


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PeriodicModel(Drawn, Rebuilt):
    r"""The free response as Floquet modes with periodic shapes.

    .. math:: y_h(t) = \sum_r \sum_m B_{r,h,m}\, e^{(\lambda_r + i m \omega) t}, \qquad \omega = 2\pi/T

    (Allen 2009, eqs. 11-12), with t = 0 at phase zero of the clock: the instant of phase zero at or before the first
    sample used of each hit. Modes come with their conjugates, one by one, so the response is real.

    Raises InputError where a shape or a value is not possible.

    Parameters
    ----------
    exponents
        The Floquet exponents λ (modes,) [1/s], each on the branch of its physical frequency: the one whose zeroth
        harmonic carries most of the shape's energy.
    coefficients
        The Fourier coefficients B (modes, channels, hits, harmonics) [units of the channels]; zero where discarded.
    harmonics, period
        The integers m, ascending (harmonics,), and the period T [s].
    channels
        One `Channel` a row.
    covariance
        The covariance of the exponents (2 modes, 2 modes): real parts, then imaginary parts [1/s²]; None if not
        estimated.
    coefficient_std
        Standard deviations of the coefficients, that of the real part as the real part and that of the imaginary part
        as the imaginary part (modes, channels, hits, harmonics); zero where discarded, None if not estimated.
    estimates
        The fit that the model is of: its exponents and coefficients, also those that were discarded, with their joint
        covariance; None if not estimated, or without `coefficient_std`.
    unselected
        The same fit with several harmonics more on each side of every band, whatever their significance: all that the
        record says, for what is fitted to it afterwards.
    provenance
        Where the model comes from.
    inputs
        How measured inputs drive the modes and the outputs; None of a model of free responses. With inputs, the
        coefficients are those of a unit state of each mode, as one hit.
    point
        The operating point of the records, finite numbers by name; empty for None.
    """

    exponents: Complexes
    coefficients: Complexes
    harmonics: Integers
    period: float
    channels: tuple[Channel, ...]
    covariance: Floats | None = None
    coefficient_std: Complexes | None = None
    estimates: Estimates | None = None
    unselected: Estimates | None = None
    provenance: Provenance = field(default_factory=Provenance)
    inputs: ModelInputs | None = None
    point: Mapping[str, float] = field(default_factory=dict)

    def __init__(
        self,
        *,
        exponents: ArrayLike,
        coefficients: ArrayLike,
        harmonics: ArrayLike,
        period: float,
        channels: Sequence[Channel | str],
        covariance: ArrayLike | None = None,
        coefficient_std: ArrayLike | None = None,
        estimates: Estimates | None = None,
        unselected: Estimates | None = None,
        provenance: Provenance | None = None,
        inputs: ModelInputs | None = None,
        point: Mapping[str, float] | None = None,
    ) -> None:
        of = "PeriodicModel"
        named = as_channels(channels, of)
        m = frozen_array(harmonics, "harmonics", of, axes=("harmonics",), dtype=np.int64)
        if (np.diff(m) <= 0).any():
            raise input_error("harmonics", of, "ascend", f"is {m.tolist()}", "Sort them, and the coefficients alike.")
        lam = frozen_array(exponents, "exponents", of, axes=("modes",), dtype=np.complex128)
        axes = (len(lam), len(named), "hits", len(m))
        put = object.__setattr__
        put(self, "exponents", lam)
        put(self, "coefficients", frozen_array(coefficients, "coefficients", of, axes=axes, dtype=np.complex128))
        put(self, "harmonics", m)
        put(self, "period", positive(period, "period", of, unit="s"))
        put(self, "channels", named)
        if covariance is not None:
            covariance = frozen_array(covariance, "covariance", of, axes=(2 * len(lam), 2 * len(lam)))
            if (np.diag(covariance) < 0).any():
                raise input_error("covariance", of, "have no negative variance", f"has {np.diag(covariance).min():g}")
        put(self, "covariance", covariance)
        axes = self.coefficients.shape
        if coefficient_std is not None:
            coefficient_std = frozen_array(coefficient_std, "coefficient_std", of, axes=axes, dtype=np.complex128)
        put(self, "coefficient_std", coefficient_std)
        for name, value in (("estimates", estimates), ("unselected", unselected)):
            put(self, name, None if coefficient_std is None else value)
        if self.estimates is not None:
            self._check_estimates(self.estimates)
        put(self, "provenance", provenance if provenance is not None else Provenance())
        if inputs is not None and (len(inputs.coefficients), len(inputs.direct)) != (len(lam), len(named)):
            got = f"has {len(inputs.coefficients)} modes and {len(inputs.direct)} outputs"
            raise input_error("inputs", of, f"have the {len(lam)} modes and {len(named)} channels of the model", got)
        put(self, "inputs", inputs)
        put(self, "point", as_point(point, of))

    def _check_estimates(self, estimates: Estimates) -> None:
        """Refuse estimates of another model."""
        off = np.abs(np.subtract.outer(estimates.exponents, self.exponents)).min(axis=1, initial=np.inf)
        if (off > 1e-9 * self.fundamental).any() or estimates.blocks.shape != self.coefficients.shape[1:3]:
            must, remedy = "belong to the model", "Pass `estimates=None`: the model then has no joint covariance."
            raise input_error("estimates", "PeriodicModel", must, "their exponents or channels are others", remedy)

    def __repr__(self) -> str:
        _, channels, hits, harmonics = self.coefficients.shape
        size = f"channels={channels}, hits={hits}, harmonics={harmonics}"
        return f"PeriodicModel(order={self.order}, period={self.period:.8g} s, {size})"

    @property
    def model(self) -> PeriodicModel:
        """The model itself: functions of a result take its model, too."""
        return self

    def _figures(self) -> Drawings:
        return dict.fromkeys(("exponents", "periodic_shapes"), (self, {}))

    @property
    def order(self) -> int:
        """The number of modes, conjugates counted one by one."""
        return len(self.exponents)

    @property
    def unpaired(self) -> Mask:
        """Mask of the modes that are no half of a conjugate pair of the model (modes,)."""
        near = np.abs(np.subtract.outer(self.exponents, self.exponents.conj())) < SAME * self.fundamental
        return np.diag(near) | ~near.any(axis=1)

    @property
    def real(self) -> Mask:
        """Mask of the modes of a real multiplier, listed once (modes,): 2 Im λ is a whole number of fundamentals."""
        turns = 2.0 * self.exponents.imag / self.fundamental
        return self.unpaired & (np.abs(turns - np.rint(turns)) < SAME)

    @property
    def upper_modes(self) -> tuple[int, ...]:
        """One mode of each conjugate pair, that of positive imaginary part, and each that is unpaired (indices)."""
        return tuple(np.flatnonzero(self.unpaired | (self.exponents.imag > 0.0)).tolist())

    @property
    def n_hits(self) -> int:
        """The number of initial conditions (hits)."""
        return self.coefficients.shape[2]

    @property
    def one_shape(self) -> bool:
        """True where all hits share the shapes of the modes, each with a state of its own; false of one hit."""
        rows = np.moveaxis(self.coefficients, 2, 3).reshape(self.order, -1, self.n_hits)
        if self.n_hits < 2 or not self.order:
            return False
        values = np.linalg.svd(rows, compute_uv=False)
        return bool((values[:, 1] < PRODUCT * values[:, 0]).all())

    @property
    def fundamental(self) -> float:
        """The fundamental angular frequency ω = 2π/T [rad/s]."""
        return 2.0 * np.pi / self.period

    @property
    def multipliers(self) -> Complexes:
        """The Floquet multipliers μ = e^{λT} (modes,)."""
        return np.exp(self.exponents * self.period)

    @property
    def exponent_std(self) -> Complexes | None:
        """Standard deviations of the exponents (modes,) [1/s]: real part of the real, imaginary of the imaginary."""
        if self.covariance is None:
            return None
        std = np.sqrt(np.diag(self.covariance))
        return std[: self.order] + 1j * std[self.order :]

    @property
    def frequencies_hz(self) -> Floats:
        """The physical frequencies |λ|/2π (modes,) [Hz]."""
        return np.abs(self.exponents) / (2.0 * np.pi)

    @property
    def damping_ratios(self) -> Floats:
        """The damping ratios -Re λ/|λ| (modes,), negative for a growing mode."""
        size = np.abs(self.exponents)
        return np.divide(-self.exponents.real, size, out=np.zeros_like(size), where=size > 0)

    @property
    def multiplier_std(self) -> Complexes | None:
        """Deviations of the multipliers (modes,): real part of the real, imaginary of the imaginary."""
        covariance = self.multiplier_covariance
        if covariance is None:
            return None
        variances = np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 0.0)
        return np.sqrt(variances[:, 0]) + 1j * np.sqrt(variances[:, 1])

    @property
    def multiplier_covariance(self) -> Floats | None:
        r"""Covariance of the real and the imaginary part of each multiplier (modes, 2, 2); None if not estimated.

        .. math:: \delta\mu = \mu\, (T\, \delta\lambda + \lambda\, \delta T)

        to first order, with δT where the period was estimated.
        """
        if self.covariance is None:
            return None
        estimates, n = self.estimates, self.order
        if estimates is None or estimates.fundamental_std == 0.0:
            slope = self.multipliers * self.period
            turned = np.moveaxis(np.array([[slope.real, -slope.imag], [slope.imag, slope.real]]), 2, 0)
            parts = np.array([self.covariance[r::n, r::n] for r in range(n)]).reshape(n, 2, 2)
            return turned @ parts @ turned.transpose(0, 2, 1)
        # Half the fundamental, in a real multiplier, turns by half a turn a period whatever the period is.
        slope = self.multipliers[self.modes_of(estimates)] * self.period
        by = slope[:, None] * estimates.exponent_slopes
        by[:, estimates.fundamental_place] -= slope * estimates.exponents / estimates.fundamental
        both = np.stack([by.real, by.imag], axis=1)
        known = both @ estimates.covariance @ both.transpose(0, 2, 1)
        straight, mirrored = (
            np.abs(np.subtract.outer(self.exponents, side))
            for side in (estimates.exponents, estimates.exponents.conj())
        )
        of = np.argmin(np.minimum(straight, mirrored), axis=1)
        sign = np.where((straight <= mirrored)[np.arange(n), of], 1.0, -1.0)  # of a conjugate the imaginary part's
        covariances = known[of]
        covariances[:, 0, 1] *= sign
        covariances[:, 1, 0] *= sign
        return covariances

    @property
    def multiplier_interval(self) -> Floats | None:
        r"""Ends of the 95 % intervals of real and imaginary part of each multiplier (modes, parts, ends).

        .. math:: \Re \mu \pm 1.96\, s_{\Re}, \quad \Im \mu \pm 1.96\, s_{\Im}; \qquad
                  \mu\, e^{\pm 1.96\, s_\sigma T} \text{ of a real one}

        None if not estimated.
        """
        std, exponent_std = self.multiplier_std, self.exponent_std
        if std is None or exponent_std is None:
            return None
        values, sides = self.multipliers, np.array([-WITHIN, WITHIN])
        parts = ((values.real, std.real), (values.imag, std.imag))
        ends = np.stack([part[:, None] + sides * spread[:, None] for part, spread in parts], axis=1)
        if self.real.any():
            grown = np.exp(sides * exponent_std.real[self.real, None] * self.period)
            ends[self.real] = 0.0
            ends[self.real, 0] = np.sort(values.real[self.real, None] * grown, axis=1)
        return ends

    @property
    def frequency_std_hz(self) -> Floats | None:
        """Standard deviations of the physical frequencies (modes,) [Hz]."""
        if self.covariance is None:
            return None
        size = np.maximum(np.abs(self.exponents), np.finfo(float).tiny) * 2.0 * np.pi
        return self._std_of(self.exponents.real / size, self.exponents.imag / size)

    @property
    def damping_ratio_std(self) -> Floats | None:
        r"""Standard deviations of the damping ratios (modes,); δζ = -(Im λ)² δRe λ/|λ|³ + Re λ Im λ δIm λ/|λ|³."""
        if self.covariance is None:
            return None
        size = np.maximum(np.abs(self.exponents), np.finfo(float).tiny)
        real, imag = self.exponents.real / size, self.exponents.imag / size
        return self._std_of(-(imag**2) / size, real * imag / size)

    def _std_of(self, by_real: Floats, by_imag: Floats) -> Floats:
        """The deviations of quantities of one mode each, by their slopes (modes,)."""
        assert self.covariance is not None
        whole, n = self.covariance, self.order
        real, imag, both = np.diag(whole)[:n], np.diag(whole)[n:], np.diag(whole[:n, n:])
        variance = by_real**2 * real + by_imag**2 * imag + 2.0 * by_real * by_imag * both
        return np.sqrt(np.maximum(variance, 0.0))

    @property
    def couples(self) -> tuple[tuple[int, int], ...]:
        """Modes that are two by two one pair locked to the period: real multipliers of one sign, alike in shape."""
        return tuple(couple.modes for couple in couples_of(self))

    def shape(self, mode: int, reference: str | None = None) -> Shape:
        """The shape of a `mode`, counted from 0, one for all hits, with the covariance of its lines.

        Its size is the root mean square over the hits. A complex factor is free: the largest line over the noise, or
        the largest of a `reference` channel, is real and positive; of a real multiplier the sign alone is free.
        """
        return shape_of(self, mode, reference)

    def principal(self) -> Complexes:
        """The exponents moved by whole multiples of iω to the strip -ω/2 < Im λ ≤ ω/2 (modes,) [1/s] (eq. 4)."""
        turns = self.exponents.imag / self.fundamental
        return self.exponents - 1j * self.fundamental * np.ceil(turns - 0.5 - 1e-12)

    def shapes(self, times: ArrayLike) -> Complexes:
        """The periodic shapes Σ_m B e^{imωt} at `times` [s] (modes, channels, hits, times) (eq. 11)."""
        t = np.atleast_1d(np.asarray(times, dtype=np.float64))
        return self.coefficients @ np.exp(1j * self.fundamental * np.multiply.outer(self.harmonics, t))

    def response(self, times: ArrayLike) -> Floats:
        """The free response at `times` [s] after phase zero (channels, hits, times) (eq. 12)."""
        t = np.atleast_1d(np.asarray(times, dtype=np.float64))
        return np.einsum("rchn,rn->chn", self.shapes(t), np.exp(np.multiply.outer(self.exponents, t))).real

    def shape_std(self, times: ArrayLike, modes: Sequence[int] | None = None) -> Complexes | None:
        """Deviations of the periodic shapes at `times` [s] (modes, channels, hits, times), None if not estimated.

        That of the real part as the real part, that of the imaginary part as the imaginary part. The harmonics that
        were discarded count as zero. `modes` are counted from 0; None for all.
        """
        if self.estimates is None:
            return None
        t = np.atleast_1d(np.asarray(times, dtype=np.float64))
        std = np.zeros((*self.coefficients.shape[:3], len(t)), complex)
        kept = self.kept_terms(self.estimates)
        wanted = list(range(self.order)) if modes is None else list(modes)
        for entry, mode in enumerate(self.modes_of(self.estimates)):
            partner = np.flatnonzero(np.abs(self.exponents - self.exponents[mode].conj()) < 1e-9 * self.fundamental)
            if mode not in wanted and not np.isin(partner, wanted).any():
                continue
            # All exponents stay: those of other modes move these coefficients too.
            of_mode = self.estimates.picked(terms=kept & (self.estimates.modes == entry))
            turned = np.exp(1j * self.fundamental * np.multiply.outer(of_mode.harmonics, t))
            mirror = -of_mode.half_turns[entry] - of_mode.harmonics
            back = np.exp(1j * self.fundamental * np.multiply.outer(mirror, t)) * (of_mode.multiplicity == 2.0)[:, None]
            back = back if of_mode.real[entry] else np.zeros_like(back)
            std[mode] = _real_imag_std(of_mode, turned.T, back.T)
            if not of_mode.real[entry] and len(partner):
                std[partner[0]] = std[mode]
        return std[wanted]

    def modes_of(self, estimates: Estimates) -> Integers:
        """The mode of the model that each mode of `estimates` is, by their exponents (modes of `estimates`,)."""
        off = np.abs(np.subtract.outer(estimates.exponents, self.exponents))
        return np.argmin(off, axis=1).astype(np.int64)

    def kept_terms(self, estimates: Estimates) -> Mask:
        """Mask over the terms of `estimates`: those whose coefficients the model keeps (terms,)."""
        kept = (self.coefficients != 0).any(axis=(1, 2))
        modes, there = self.modes_of(estimates)[estimates.modes], np.isin(estimates.harmonics, self.harmonics)
        place = np.clip(np.searchsorted(self.harmonics, estimates.harmonics), 0, len(self.harmonics) - 1)
        return there & kept[modes, place]


class Identified(Protocol):
    """Interface of a result with identified modes: an `Analysis`, or that of a record larger than memory."""

    @property
    def model(self) -> PeriodicModel:
        """The modes."""

    @property
    def failed(self) -> bool:
        """True where something was found that makes the model wrong."""


def _real_imag_std(estimates: Estimates, straight: Complexes, mirrored: Complexes) -> Complexes:
    """Deviations of Σ B·straight + B̄·mirrored (channels, hits, quantities), by (quantities, terms)."""
    std = np.zeros((*estimates.blocks.shape, len(straight)), complex)
    # Row by row: their noises are independent, and slopes by all rows at once would be nearly all zero.
    for channel, hit in np.ndindex(*estimates.blocks.shape):
        noise = estimates.noise_covariance(channel, hit)
        for unit in (1.0, 1j):
            # Re((a B + b B̄)/unit) = Re((a/unit + conj(b/unit)) B)
            by = straight / unit + (mirrored / unit).conj()
            both, moved = np.concatenate([by.real, -by.imag], axis=1), (by @ estimates.slopes[:, channel, hit]).real
            variance = np.einsum("qk,qk->q", both @ noise, both)
            variance += np.einsum("qp,qp->q", moved @ estimates.covariance, moved)
            std[channel, hit] += unit * np.sqrt(np.maximum(variance, 0.0))
    return std
