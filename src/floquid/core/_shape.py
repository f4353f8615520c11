"""Shapes of modes, one for all hits; modes with periodic shapes, measured or modelled alike; locked pairs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np

from floquid._arrays import Complexes, Floats, Indices, Integers, Mask
from floquid._checks import Rebuilt, index
from floquid.core._channel import Channel, channels_named
from floquid.core._estimates import Estimates
from floquid.core._record import as_channels
from floquid.fit import RARE, covariance_root

if TYPE_CHECKING:
    from floquid.core._periodic_model import PeriodicModel


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shape(Rebuilt):
    r"""The lines of the periodic shape of one mode, and their joint errors.

    .. math:: p(t) = \sum_m B_m\, e^{i m \omega t}, \qquad \delta B_{c,m} = \sum_k S_{c,m,k}\, \epsilon_k + e_{c,m}

    with ε independent errors of variance one that all channels have in common, and e those of each channel alone. A
    complex factor of a shape is free: errors are those at a factor that is held.

    Raises InputError where a size is not possible.

    Parameters
    ----------
    values
        B (channels, harmonics) [units of the channels].
    harmonics
        The integers m, ascending (harmonics,).
    channels
        One `Channel` a row.
    slopes
        S (channels, harmonics, common errors); None if not estimated.
    spread
        Covariance of e of each channel, real parts, then imaginary parts (channels, 2 harmonics, 2 harmonics); None
        with the slopes.
    agreement
        One where all hits have this shape, zero where they have as much of others: such a mode stands for several.
    is_mixture
        True where noise does not explain what the hits have beside this shape: it is a mixture of several, whose parts
        may be anything.
    """

    values: Complexes
    harmonics: Integers
    channels: tuple[Channel, ...]
    slopes: Complexes | None = field(default=None, repr=False)
    spread: Floats | None = field(default=None, repr=False)
    agreement: float = 1.0
    is_mixture: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "channels", as_channels(self.channels, "Shape"))
        self._freeze(dtype=np.int64, harmonics=("harmonics",))
        rows, lines = len(self.channels), len(self.harmonics)
        self._freeze(dtype=np.complex128, values=(rows, lines), slopes=(rows, lines, "common errors"))
        self._freeze(spread=(rows, 2 * lines, 2 * lines))

    def variance(self, by_values: Complexes) -> Floats | None:
        r"""The variance of real quantities f, to first order (quantities,); None if not estimated.

        .. math:: \delta f = \Re \sum_{c,m} \frac{\partial f}{\partial B_{c,m}}\, \delta B_{c,m}

        `by_values` are these slopes (quantities, channels, harmonics).
        """
        if self.slopes is None or self.spread is None:
            return None
        common = np.tensordot(by_values, self.slopes, axes=2).real
        own = np.concatenate([by_values.real, -by_values.imag], axis=2)
        return np.sum(common**2, axis=1) + np.einsum("qci,cij,qcj->q", own, self.spread, own)

    def covariance(self, to: Complexes) -> Floats | None:
        r"""Covariance of complex sums of the lines, to first order; None if not estimated.

        .. math:: \delta z = \sum_{c,m} t_{c,m}\, \delta B_{c,m}

        Real parts, then imaginary parts (2 sums, 2 sums); `to` are the factors t (sums, channels, harmonics).
        """
        if self.slopes is None or self.spread is None:
            return None
        common = np.tensordot(to, self.slopes, axes=2)
        root = np.concatenate([common.real, common.imag])
        found = root @ root.T
        for row in np.flatnonzero(to.any(axis=(0, 2))):
            own, spread = to[:, row], self.spread[row]
            turn = np.block([[own.real, -own.imag], [own.imag, own.real]])
            found += turn @ spread @ turn.T
        return np.asarray(found, np.float64)

    @property
    def std(self) -> Complexes | None:
        """Deviations of the lines (channels, harmonics): real part of the real, imaginary of the imaginary part."""
        if self.slopes is None or self.spread is None:
            return None
        own, lines = np.diagonal(self.spread, axis1=1, axis2=2), len(self.harmonics)
        parts = [
            np.sqrt(np.maximum(np.sum(slopes**2, axis=2) + variance, 0.0))
            for slopes, variance in ((self.slopes.real, own[:, :lines]), (self.slopes.imag, own[:, lines:]))
        ]
        return np.asarray(parts[0] + 1j * parts[1], np.complex128)

    def drawn(self, count: int, generator: np.random.Generator) -> Complexes:
        """Draws of the lines, `count` of them, with errors from a `generator` (count, channels, harmonics)."""
        values = np.repeat(self.values[None], count, axis=0)
        if self.slopes is None or self.spread is None:
            return values
        values += np.moveaxis(self.slopes @ generator.standard_normal((self.slopes.shape[2], count)), 2, 0)
        for row, spread in enumerate(self.spread):
            root = covariance_root(spread)
            both = (root @ generator.standard_normal((root.shape[1], count))).T
            values[:, row] += both[:, : len(self.harmonics)] + 1j * both[:, len(self.harmonics) :]
        return values


def shape_of(model: PeriodicModel, mode: int, reference: str | None) -> Shape:
    r"""The shape of a `mode` of a `model`, its largest line, or that of a `reference` channel, real and positive.

    Its hits are lines times a state each. The singular value decomposition finds both, lines weighted by the noise of
    their channel and hits by theirs: a weight of each pair of them would spoil the product. The size is the root mean
    square over the hits. Of a real multiplier the factor is real, so that lines stay mirror images.
    """
    of = "PeriodicModel.shape"
    mode = index(mode, "mode", of, model.order)
    rows = np.arange(len(model.channels))
    if reference is not None:
        rows = np.array(channels_named(model.channels, [reference], argument="reference", of=of))
    lines = model.coefficients[mode]
    by_channel, by_hit = _weights(model, mode)
    weights = by_channel[:, None, None] * by_hit[:, None]
    factors, energies = _states(lines * weights, by_hit, real=bool(model.real[mode]))
    states = factors[0] * np.sqrt(np.mean(np.abs(factors[0] / by_hit**2) ** 2))
    noise = 0.0 if model.coefficient_std is None else float(np.sum(np.abs(model.coefficient_std[mode] * weights) ** 2))
    others = max(0.0, float(energies[1:].sum()) - noise * (1.0 - 1.0 / len(states)))
    agreement = max(0.0, (energies[0] - others) / max(energies[0] + others, 1e-300))
    values = np.einsum("chm,h->cm", lines, states)
    size = np.abs(values[rows]) * by_channel[rows, None]
    largest = values[rows].flat[int(size.argmax())] if size.any() else 1.0 + 0.0j
    turn = np.conj(largest) / abs(largest)
    if model.real[mode]:  # the line that turns with half a turn alone is real as it is
        turn = 1.0 if (largest.real if abs(largest.real) >= abs(largest.imag) else largest.imag) >= 0.0 else -1.0
    slopes, spread = _errors(model, mode, states * turn)
    return Shape(
        values=values * turn, harmonics=model.harmonics, channels=model.channels, slopes=slopes, spread=spread,
        agreement=agreement, is_mixture=_is_mixture(model, mode, factors[1:], by_channel, float(energies[1:].sum())),
    )  # fmt: skip


def _weights(model: PeriodicModel, mode: int) -> tuple[Floats, Floats]:
    """One over the noise of each channel, and over that of each hit, in the lines of a mode: (channels,), (hits,)."""
    # Noise is taken for that of a channel times that of a hit, by the mean of logarithms. Without any a channel counts
    # by its size.
    if model.coefficient_std is not None:
        noise = np.sqrt(np.mean(np.abs(model.coefficient_std[mode]) ** 2, axis=2))
        if (noise > 0.0).all():
            logarithms = np.log(noise)
            return np.exp(-logarithms.mean(axis=1)), np.exp(logarithms.mean() - logarithms.mean(axis=0))
    size = np.sqrt(np.mean(np.abs(model.coefficients) ** 2, axis=(0, 2, 3)))
    return np.divide(1.0, size, out=np.ones_like(size), where=size > 0.0), np.ones(model.n_hits)


def _states(weighted: Complexes, by_hit: Floats, *, real: bool) -> tuple[Complexes, Floats]:
    """Factors of hits by which their lines make shapes at right angles (shapes, hits), and squared singular values."""
    hits = len(by_hit)
    rows = np.moveaxis(weighted, 1, 2).reshape(-1, hits)
    if real:
        rows = np.concatenate([rows.real, rows.imag])
    if not rows.any():
        return np.full((1, hits), 1.0 / hits, complex), np.ones(1)
    _, values, along = np.linalg.svd(rows, full_matrices=False)
    return np.asarray(along.conj() * by_hit, np.complex128), values**2


def _is_mixture(model: PeriodicModel, mode: int, others: Complexes, by_channel: Floats, energy: float) -> bool:
    r"""True where the hits have shapes beside the first one that noise does not explain.

    Of one shape alone their `energy` is nearly a multiple of a χ², with mean and variance

    .. math:: \mathrm{tr}\, C, \qquad 2\, \mathrm{tr}\, C^2

    C the covariance of the lines that the hits make by the factors `others` (shapes, hits), over the noise of each
    channel.
    """
    from scipy.special import chdtrc

    if model.estimates is None or model.estimates.shared:
        return False
    mean, square = 0.0, 0.0
    for factors in others:
        slopes, spread = _errors(model, mode, factors)
        assert slopes is not None
        assert spread is not None
        common = np.concatenate([slopes.real, slopes.imag], axis=1) * by_channel[:, None, None]
        own = spread * by_channel[:, None, None] ** 2
        mean += float(np.sum(common**2) + np.trace(own, axis1=1, axis2=2).sum())
        products = np.tensordot(common, common, axes=([0, 1], [0, 1]))
        square += float(np.sum(products**2) + np.sum(own**2) + 2.0 * np.sum(common * (own @ common)))
    return mean > 0.0 and bool(chdtrc(mean**2 / square, energy * mean / square) < RARE)


@dataclass(frozen=True, slots=True)
class _Terms:
    """Terms of the estimates that make the lines of a mode."""

    terms: Indices  # of the estimates, each may be there twice
    places: Indices  # of the harmonics of the model
    mirrored: Mask  # the line is the conjugate of the term


def _terms(model: PeriodicModel, mode: int) -> _Terms:
    """Terms of the estimates of a `model` that are the lines of a `mode`: of a real multiplier also mirror images."""
    estimates = model.estimates
    assert estimates is not None
    of = model.modes_of(estimates)
    entries = np.flatnonzero(of == mode)
    conjugate = len(entries) == 0
    if conjugate:
        partner = int(np.abs(model.exponents - model.exponents[mode].conj()).argmin())
        entries = np.flatnonzero(of == partner)
    terms = np.flatnonzero(model.kept_terms(estimates) & np.isin(estimates.modes, entries[:1]))
    harmonics, mirrored = estimates.harmonics[terms], np.full(len(terms), conjugate)
    if conjugate:
        harmonics = -harmonics
    elif model.real[mode]:
        both = terms[estimates.turning[terms]]
        harmonics = np.concatenate(
            [harmonics, -estimates.harmonics[both] - estimates.half_turns[estimates.modes[both]]]
        )
        terms, mirrored = np.concatenate([terms, both]), np.append(mirrored, np.ones(len(both), bool))
    there = np.isin(harmonics, model.harmonics)
    return _Terms(terms[there], np.searchsorted(model.harmonics, harmonics[there]), mirrored[there])


def _errors(model: PeriodicModel, mode: int, states: Complexes) -> tuple[Complexes | None, Floats | None]:
    """Slopes of a shape by common errors, and the covariance of each channel alone, at `states` of the hits held."""
    estimates = model.estimates
    if estimates is None:
        return None, None
    own = _terms(model, mode)
    channels, lines = len(model.channels), len(model.harmonics)
    by_terms = np.einsum("kchp,pd->kchd", estimates.slopes[own.terms], covariance_root(estimates.covariance))
    by_terms[own.mirrored] = by_terms[own.mirrored].conj()
    slopes = np.zeros((channels, lines, by_terms.shape[3]), complex)
    slopes[:, own.places] = np.einsum("kchd,h->ckd", by_terms, states)
    spread = np.zeros((channels, 2 * lines, 2 * lines))
    for channel in range(channels):
        parts = [
            (_to_lines(estimates, own, channel, hit, state, lines), estimates.spread[estimates.blocks[channel, hit]])
            for hit, state in enumerate(states)
        ]
        if estimates.shared:  # the errors of a channel are one in all hits
            parts = [(sum((to for to, _ in parts), np.zeros_like(parts[0][0])), parts[0][1])]
        spread[channel] = sum((to @ covariance @ to.T for to, covariance in parts), np.zeros((2 * lines, 2 * lines)))
    return slopes, spread


def _to_lines(estimates: Estimates, own: _Terms, channel: int, hit: int, state: complex, lines: int) -> Floats:
    """Derivatives of the lines of a channel by the errors of one row (2 lines, 2 terms): real parts, then imaginary."""
    to = np.zeros((2 * lines, 2 * len(estimates.modes)))
    scale = estimates.scales[own.terms, channel, hit]
    sign = np.where(own.mirrored, -1.0, 1.0)
    for unit, offset in ((1.0, 0), (1j, len(estimates.modes))):
        moved = scale * unit
        moved = state * (moved.real + 1j * sign * moved.imag)
        to[own.places, offset + own.terms] += moved.real
        to[lines + own.places, offset + own.terms] += moved.imag
    return to


@runtime_checkable
class PeriodicModes(Protocol):
    """Interface of modes in named channels: those of a `PeriodicModel`, identified or of a known A(t)."""

    @property
    def exponents(self) -> Complexes:
        """The Floquet exponents λ (modes,) [1/s], conjugates one by one."""

    @property
    def covariance(self) -> Floats | None:
        """Covariance of the exponents (2 modes, 2 modes): real parts, then imaginary parts; None of a known system."""

    @property
    def harmonics(self) -> Integers:
        """The integers m of the shapes, ascending (harmonics,)."""

    @property
    def period(self) -> float:
        """The period [s]."""

    @property
    def channels(self) -> tuple[Channel, ...]:
        """One `Channel` a row of each shape."""

    @property
    def point(self) -> Mapping[str, float]:
        """The operating point, numbers by name."""

    @property
    def couples(self) -> tuple[tuple[int, int], ...]:
        """Pairs of modes that are one pair locked to the period, two real multipliers of one sign."""

    def shape(self, mode: int, reference: str | None = None) -> Shape:
        """The shape of a `mode`, one for all hits; its largest line, or that of a `reference` channel, is positive."""
        ...


LIKE = 0.5
"""Least share of one half shape along another at which two real multipliers may be one pair; unlike ones have none."""

APART = 0.1  # least lead of that share over the share along any third real multiplier, at which a couple is sure


@dataclass(frozen=True, slots=True, kw_only=True)
class Couple:
    """Two real multipliers of one sign that have the place of one pair.

    Parameters
    ----------
    modes
        Their numbers, ascending.
    likeness
        The share of one half shape along the other, 0 to 1.
    is_sure
        True where no third real multiplier of that sign is nearly as much like one of them.
    """

    modes: tuple[int, int]
    likeness: float
    is_sure: bool


def couples_of(modes: PeriodicModes) -> tuple[Couple, ...]:
    """Couples among the real multipliers of `modes`, by the lines of positive frequency of their shapes.

    A pair that is locked to the period has two real shapes, each a complex multiple of the shape of the pair and its
    conjugate: their halves of positive frequency differ by a factor alone. Two real multipliers of one sign are a
    couple where each is more like the other than like any third.
    """
    turns = 2.0 * modes.exponents.imag * modes.period / (2.0 * np.pi)
    found = []
    for parity in (0, 1):
        members = [k for k in np.flatnonzero(np.abs(turns - np.rint(turns)) < 1e-6) if np.rint(turns[k]) % 2 == parity]
        if len(members) < 2:
            continue
        likeness = _likeness([_half(modes.shape(int(k)), int(np.rint(turns[k]))) for k in members])
        nearest = likeness.argmax(axis=1)
        for i, j in enumerate(nearest.tolist()):
            if i < j and nearest[j] == i and likeness[i, j] >= LIKE:
                thirds = np.delete(likeness[[i, j]], [i, j], axis=1).max(initial=0.0)
                pair = (int(members[i]), int(members[j]))
                sure = bool(likeness[i, j] - thirds >= APART)
                found.append(Couple(modes=pair, likeness=float(likeness[i, j]), is_sure=sure))
    return tuple(sorted(found, key=lambda couple: couple.modes))


def _half(shape: Shape, half_turns: int) -> Complexes:
    """Lines of a shape by their frequency, in halves of the fundamental, from zero on (channels, frequencies)."""
    places = 2 * shape.harmonics + half_turns
    ahead = places >= 0
    out = np.zeros((len(shape.channels), int(places.max(initial=0)) + 1), complex)
    out[:, places[ahead]] = shape.values[:, ahead]
    return out


def _likeness(halves: Sequence[Complexes]) -> Floats:
    """Share of each half shape along each other (modes, modes), channels in units of their size; zero for itself."""
    width = max(half.shape[1] for half in halves)
    whole = np.stack([np.pad(half, ((0, 0), (0, width - half.shape[1]))) for half in halves])
    norms = np.sqrt(np.sum(np.abs(whole) ** 2, axis=(1, 2), keepdims=True))
    whole = whole / np.where(norms > 0.0, norms, 1.0)
    size = np.sqrt(np.mean(np.sum(np.abs(whole) ** 2, axis=2), axis=0))
    whole = whole / np.where(size > 0.0, size, 1.0)[:, None]
    flat = whole.reshape(len(whole), -1)
    norms = np.linalg.norm(flat, axis=1, keepdims=True)
    flat = flat / np.where(norms > 0.0, norms, 1.0)
    shares = np.abs(flat.conj() @ flat.T) ** 2
    np.fill_diagonal(shares, 0.0)
    return shares
