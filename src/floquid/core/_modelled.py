"""The periodic model of estimates, each mode with its conjugate, with the deviations of all that it holds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from floquid._arrays import Complexes, Floats, Integers, Mask
from floquid.core._channel import Channel
from floquid.core._estimates import Estimates
from floquid.core._model_inputs import ModelInputs
from floquid.core._periodic_model import PeriodicModel
from floquid.core._record import Provenance
from floquid.errors import IdentificationError
from floquid.findings import Finding, note
from floquid.fit import WITHIN, AxisMode, correlation

NARROW, WIDE = 1.0, 4.0
"""Deviations of q within which a reading must hold the truth by as many of its own: up to all that is called near."""

OFF = 0.1
"""Deviations of q that the reported exponents have at least between them: where both are one, shapes have no limit."""


At = TypeVar("At")


@dataclass(frozen=True, slots=True)
class Reading:
    """Two exponents near an axis as they are reported."""

    std: Complexes  # their deviations (2,) [1/s]
    square: float  # the q that shapes are read at: at least `OFF` deviations off zero [1/s²]
    apart: float | None  # how far apart both may be where the kind is open [1/s]


def read_axis(mean: float, square: float, covariance: Floats, half_turns: int, fundamental: float) -> Reading:
    """Read two exponents as they are reported from their mean and squared half-difference, as `readings` has them."""
    # Whatever is known of q, half the difference ends halfway to the next axis.
    std = min(float(np.sqrt(max(covariance[1, 1], 0.0))), (0.5 * fundamental) ** 2)
    return Reading(
        readings(mean, square, covariance, half_turns, fundamental)[1],
        float(np.copysign(max(abs(square), OFF * std), square)),
        float(np.sqrt(abs(square) + WITHIN * std)) if abs(square) < WITHIN * std else None,
    )


@dataclass(frozen=True, slots=True)
class NearAxis(Generic[At]):
    """A fit of ordinary modes, deviations of exponents as they were read, by numbers of modes, and notes on kinds."""

    at: At
    as_read: Mapping[int, complex]
    findings: tuple[Finding, ...]

    @staticmethod
    def of(at: At, blocks: Mapping[int, Reading], modes: Sequence[AxisMode], fundamental: float) -> NearAxis[At]:
        """The fit `at` where ordinary modes take the place of `blocks`, behind all other `modes`, as they were read."""
        stds, place, findings = [], len(modes) - len(blocks), []
        for number, read in blocks.items():
            stds += read.std.tolist()[: 2 if read.square > 0.0 else 1]
            if read.apart is not None:
                findings.append(kind_open(1j * modes[number].axis * fundamental, read.apart))
        return NearAxis(at, dict(enumerate(stds, place)), tuple(findings))


def read_blocks(
    modes: Sequence[AxisMode], covariance: Floats, places: Integers, fundamental: float
) -> dict[int, Reading]:
    """Read the exponents of each block, by its number among `modes`, from a covariance with σ and q at its `places`."""
    return {
        number: read_axis(
            mode.exponent.real, mode.square, covariance[np.ix_(place, place)], round(2.0 * mode.axis), fundamental
        )
        for number, (mode, place) in enumerate(zip(modes, places, strict=True))
        if mode.square is not None
    }


def kind_open(exponent: complex, apart: float) -> Finding:
    """Note on a pair, or two real multipliers, that are so far apart at most either way [1/s]."""
    return note("kind_open", frequency=abs(exponent.imag) / (2.0 * np.pi), apart=apart)


def with_deviations(covariance: Floats, std: Complexes) -> Floats:
    """The covariance of the parts of exponents (2 modes, 2 modes) with other deviations (modes,), nan to keep one."""
    before, after = np.sqrt(np.diag(covariance)), np.concatenate([std.real, std.imag])
    after = np.where(np.isnan(after), before, after)
    share = np.where(before > 0.0, after / np.where(before > 0.0, before, 1.0), 0.0)
    scaled = covariance * np.outer(share, share)
    scaled[np.diag_indices(len(after))] = after**2
    return scaled


def readings(
    mean: float, square: float, covariance: Floats, half_turns: int, fundamental: float
) -> tuple[Complexes, Complexes]:
    r"""Read two exponents and their deviations from their mean and squared half-difference, both (2,) [1/s].

    .. math:: \lambda = \sigma \pm \sqrt q + \tfrac{i \kappa \omega}{2}

    They are two real multipliers where q > 0 and a pair of conjugates about the axis where q < 0. A square root has no
    slope at zero, so its deviation is that of the interval: the largest change of it that k deviations of q make either
    way, over k, for k between 1 and 4. Where such an interval of q holds zero, both parts have a deviation, which
    covers both kinds, and σ moves with q by their covariance. Two real multipliers far apart that are correlated less
    than σ and q have deviations of their own.

    Parameters
    ----------
    mean, square
        σ [1/s] and q [1/s²].
    covariance
        That of σ and q (2, 2).
    half_turns, fundamental
        κ, and ω [rad/s].
    """
    root = np.sqrt(complex(square))
    exponents = np.asarray(mean + np.array([root, -root]) + 0.5j * half_turns * fundamental, np.complex128)
    variance, s = max(float(covariance[0, 0]), 0.0), float(np.sqrt(max(covariance[1, 1], 0.0)))
    imag = float(np.abs(_changes(-square, s)).max())
    real = _apart(square, covariance)
    if real is None:
        # σ moves with q by their covariance, and on its own.
        along = float(covariance[0, 1]) / max(s, 1e-300)
        changes = _changes(square, s)
        real = np.array([np.abs(along + way * changes).max() for way in (1.0, -1.0)])
        real = np.hypot(real if square > 0.0 else np.full(2, real.max()), np.sqrt(max(variance - along**2, 0.0)))
    return exponents, np.asarray(real + 1j * imag, np.complex128)


def _apart(square: float, covariance: Floats) -> Floats | None:
    """Deviations of two real multipliers each for itself (2,); None where mean and difference are told better."""
    # One that is seen well beside one that is hardly seen is hardly correlated with it; its mean with that other one is
    # correlated with their difference. Nearer to the edge neither is Gaussian.
    if not square > WIDE * float(np.sqrt(max(covariance[1, 1], 0.0))):
        return None
    slope = 0.5 / np.sqrt(square)
    turn = np.array([[1.0, slope], [1.0, -slope]])
    of_each = turn @ covariance @ turn.T
    return np.sqrt(np.maximum(np.diag(of_each), 0.0)) if correlation(covariance) > correlation(of_each) else None


def _changes(square: float, s: float) -> Floats:
    """(√(q + k s) - √q)/k, roots of negative values being zero, where it is least and largest over k (k,)."""
    # The size of k is from `NARROW` to `WIDE`.
    if s == 0.0:
        return np.zeros(1)
    # Upwards it is largest where q + k s = -q, if q is negative, and downwards where q - k s = 0.
    up, down = np.clip([-2.0 * square / s, square / s], NARROW, WIDE)
    k = np.array([NARROW, up, WIDE, -NARROW, -down, -WIDE])
    return (np.sqrt(np.maximum(square + k * s, 0.0)) - np.sqrt(max(square, 0.0))) / k


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Driven:
    """Effects of measured inputs beside driving the modes: D, and the states at the start of each record."""

    channels: Sequence[Channel]  # One `Channel` an input
    # D (outputs, inputs, direct harmonics), and the integers n, ascending (direct harmonics,)
    direct: Complexes
    direct_harmonics: Integers
    initial: Complexes  # z at the first sample of each record (modes of the estimates, records)
    begins: Floats  # t there (records,) [s]


def modelled(
    estimates: Estimates,
    *,
    channels: Sequence[Channel],
    provenance: Provenance,
    kept: Mask | None = None,
    unselected: Estimates | None = None,
    driven: Driven | None = None,
    as_read: Mapping[int, complex] | None = None,
) -> PeriodicModel:
    """The periodic model of estimates, modes in their order, each pair followed by its conjugate."""
    entries = np.repeat(np.arange(len(estimates.exponents)), np.where(estimates.real, 1, 2))
    back = np.append(False, entries[1:] == entries[:-1])[: len(entries)]
    slopes = np.where(back[:, None], estimates.exponent_slopes[entries].conj(), estimates.exponent_slopes[entries])
    by = np.concatenate([slopes.real, slopes.imag])
    covariance = by @ estimates.covariance @ by.T
    if not (np.isfinite(covariance).all() and (np.diag(covariance) >= 0.0).all()):
        raise IdentificationError("A mode is not determined at all: with its residues held, it has no deviation.")
    if as_read:
        covariance = with_deviations(
            covariance, np.array([as_read.get(k, complex(np.nan, np.nan)) for k in entries.tolist()])
        )
    exponents = estimates.exponents[entries]
    harmonics, coefficients, std = _shapes(estimates, kept, entries)
    return PeriodicModel(
        exponents=np.where(back, exponents.conj(), exponents),
        coefficients=coefficients,
        harmonics=harmonics,
        period=2.0 * np.pi / estimates.fundamental,
        channels=channels,
        covariance=covariance,
        coefficient_std=std,
        estimates=estimates,
        unselected=unselected,
        provenance=provenance,
        inputs=None if driven is None else _inputs(estimates, driven, entries, back),
    )


def _shapes(estimates: Estimates, kept: Mask | None, own: Integers) -> tuple[Integers, Complexes, Complexes]:
    """The harmonics of a model, its coefficients and their deviations (modes, channels, hits, harmonics)."""
    used = np.ones(len(estimates.modes), bool) if kept is None else kept
    modes, straight = estimates.modes[used], estimates.harmonics[used]
    real = estimates.real[modes]
    mirror = -straight - estimates.half_turns[modes]
    harmonics = np.unique(np.concatenate([[0], straight, mirror]))
    coefficients, std = np.zeros((2, len(own), *estimates.blocks.shape, len(harmonics)), complex)
    first, last = np.searchsorted(own, modes), np.searchsorted(own, modes, side="right") - 1
    there, beyond = np.searchsorted(harmonics, straight), np.searchsorted(harmonics, mirror)
    turns = estimates.turning[used] | ~real
    for place, values, reflected in (
        (coefficients, estimates.coefficients[used], estimates.coefficients[used].conj()),
        (std, estimates.std()[used], estimates.std()[used]),
    ):
        by_term = np.moveaxis(place, 3, 1)
        by_term[last[turns], beyond[turns]] = reflected[turns]
        by_term[first, there] = values
    return harmonics, coefficients, std


def _inputs(estimates: Estimates, driven: Driven, own: Integers, back: Mask) -> ModelInputs:
    """The inputs of a model, conjugates included."""
    gains = estimates.gains
    assert gains is not None
    harmonics = np.unique(np.concatenate([[0], gains.harmonics, -gains.harmonics]))
    both = np.zeros((2, len(gains.coefficients), len(driven.channels), len(harmonics)), complex)
    both[..., np.searchsorted(harmonics, gains.harmonics)] = gains.coefficients, gains.std(estimates.covariance)
    values, std = both[:, own]
    values[back], std[back] = values[back][..., ::-1].conj(), std[back][..., ::-1]
    initial = driven.initial[own]
    return ModelInputs(
        channels=tuple(driven.channels),
        coefficients=values,
        harmonics=harmonics,
        coefficient_std=std,
        direct=driven.direct,
        direct_harmonics=driven.direct_harmonics,
        initial=np.where(back[:, None], initial.conj(), initial),
        begins=driven.begins,
    )
