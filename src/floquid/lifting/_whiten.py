r"""Noise that is coloured along the record, and the filter that makes it white.

A filter along the record leaves e^{λt} p(t) as it is except for the shape: harmonic m is multiplied by the gain of the
filter at λ + imω, and stays one. Noise that is an autoregression becomes white, between the phases as well as between
periods, and least squares on the filtered responses is what maximum likelihood is on the record (Aitken 1935).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from floquid._arrays import Floats
from floquid.core import Cycles
from floquid.fit import filtered, yule_walker
from floquid.lifting._lift import Lifted, largest_values, lift
from floquid.lti import COLOURED, FEWEST, ORDERS, ModalModel

LAGS = 16
"""The lags looked at. Shorter than a period: poles that were fitted leave correlations a period apart."""


def whitening_filter(lifted: Lifted, modal: ModalModel) -> Floats | None:
    """The shortest filter of each channel that whitens, along the record, what `modal` leaves of `lifted`.

    By the Yule-Walker equations for the residual of all hits together. The order is that at which every channel is
    white, or the highest tried; more poles than there are modes do no harm. (channels, taps); a channel of white noise
    has a filter that does nothing, and where all are white there is none.
    """
    most = min(LAGS, lifted.n_phases - 1)
    if most < 1 or not modal.order or lifted.responses.lengths.max() < FEWEST:
        return None
    correlations, numbers = _correlations(lifted, modal, most)
    return filters_of(correlations, numbers)


def filters_of(correlations: Floats, numbers: Floats) -> Floats | None:
    """The shortest autoregressive filters that make noise of these autocorrelations white, as `whitening_filter`.

    `correlations` (channels, lags) are those of each channel's noise, from lag zero on, each the mean of `numbers`
    (channels,) samples.
    """
    coloured = _colours(correlations, numbers) > COLOURED
    if not coloured.any():
        return None
    taps = np.eye(1)
    for order in ORDERS:
        if order >= correlations.shape[1]:
            break
        taps = np.array([yule_walker(own, order) for own in correlations])
        left = np.array([_filtered(own, part) for own, part in zip(correlations, taps, strict=True)])
        if (_colours(left, numbers) < COLOURED)[coloured].all():
            break
    taps[~coloured] = np.eye(1, taps.shape[1])
    return taps


def whitened(lifted: Lifted, taps: Floats) -> Lifted:
    """The responses `lifted` after filters `taps` (channels, taps) along the record, with an estimate of their noise.

    The first samples, before which a filter has no past, are left out: one period.
    """
    order, phases = taps.shape[1] - 1, lifted.n_phases
    hits = []
    for hit, length in enumerate(lifted.responses.lengths):
        cycles = (int(length) * phases - order) // phases
        cut = np.empty((lifted.n_channels, phases, cycles))
        for channel in range(lifted.n_channels):
            along = lifted.responses.values[channel * phases : (channel + 1) * phases, hit, :length].T.reshape(1, -1)
            out = filtered(along, taps[channel, None])[0, : cycles * phases]
            cut[channel] = out.reshape(cycles, phases).T
        cut.flags.writeable = False
        hits.append(
            Cycles(
                values=cut,
                periods=np.full(cycles, lifted.period),
                channels=lifted.channels,
                provenance=lifted.provenance,
            )
        )
    found = lift(hits, floor=0.0)
    if lifted.responses.taken is not None:
        # A cycle later steady responses and drifts are sums of the same functions.
        taken = lifted.responses.taken[: found.responses.values.shape[2]]
        found = replace(found, responses=replace(found.responses, taken=taken))
    # What the record cannot be believed below goes through the filter too.
    largest, left = (largest_values(one.responses.values, lifted.n_channels) for one in (lifted, found))
    floor = lifted.floor * largest * np.linalg.norm(taps, axis=1)[:, None] / left
    found = replace(found, floor=floor).with_noise(found.noise)
    return replace(found, first_phase=lifted.first_phase + order / lifted.n_phases, whitening=taps)


def _left(values: Floats, shapes: Floats, powers: Floats) -> Floats:
    """Residual of one channel (phases, cycles), in the order of time; some phases at a time."""
    left = np.empty(values.shape[::-1])
    for first in range(0, len(values), 64):
        part = slice(first, first + 64)
        left[:, part] = (values[part] - shapes[:, part].T @ powers).T
    return left.ravel()


def _correlations(lifted: Lifted, modal: ModalModel, most: int) -> tuple[Floats, Floats]:
    """The autocorrelation of what is left (channels, lags), and the numbers that it is the mean of (channels,)."""
    data, phases = lifted.responses, lifted.n_phases
    # Of a conjugate pair one is enough: 2 Re(R μ^n) is a real product of real and imaginary parts.
    upper = modal.multipliers.imag >= 0.0
    logs = np.asarray(np.log(modal.multipliers[upper]), np.complex128)
    both = np.where(modal.multipliers[upper].imag > 0.0, 2.0, 1.0)
    sums = np.zeros((lifted.n_channels, most + 1))
    floor = np.broadcast_to(lifted.floor, (lifted.n_channels, lifted.n_hits))
    numbers = np.zeros(lifted.n_channels)
    for hit, length in enumerate(data.lengths):
        # A growing mode is counted from its end, so that its powers cannot overflow.
        last = np.where(logs.real > 0.0, length - 1, 0)
        turning = np.exp(logs[:, None] * (np.arange(length) - last[:, None]))
        residues = modal.residues[upper, :, hit]
        residues = residues * (both * np.exp(np.where(residues.any(axis=1), logs * last, 0.0)))[:, None]
        powers, shapes = (np.concatenate([turning.real, turning.imag]), np.concatenate([residues.real, -residues.imag]))
        for channel in range(lifted.n_channels):
            rows = slice(channel * phases, (channel + 1) * phases)
            values = data.values[rows, hit, :length]
            along = _left(values, shapes[:, rows], powers)
            square = float(along @ along) / len(along)
            free = max(len(along) - phases * modal.order, 1)
            if square * len(along) / free <= (floor[channel, hit] * np.abs(values).max()) ** 2:
                continue
            sums[channel] += [along[lag:] @ along[: len(along) - lag] / square for lag in range(most + 1)]
            numbers[channel] += free
    white = sums[:, 0] == 0
    sums[white, 0] = 1.0
    return sums / sums[:, :1], numbers


def _colours(correlations: Floats, numbers: Floats) -> Floats:
    """Distance of correlations from those of white noise, in deviations of Box and Pierce's sum (channels,)."""
    lags = max(correlations.shape[1] - 1, 1)
    return (numbers * np.sum(correlations[:, 1:] ** 2, axis=1) - lags) / np.sqrt(2.0 * lags)


def _filtered(correlation: Floats, taps: Floats) -> Floats:
    """The autocorrelation after a filter, at the lags where all that it needs is known."""
    both = np.concatenate([correlation[:0:-1], correlation])
    square = np.correlate(taps, taps, mode="full")
    through = np.convolve(both, square, mode="valid")
    middle = len(through) // 2
    return through[middle:] / through[middle]
