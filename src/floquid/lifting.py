"""Cycles ↔ lifted responses: the samples at one phase, a period apart, are the response of an LTI system.

Noise that is coloured along the record is made white by a filter along it. That leaves e^{λt} p(t) as it is except for
the shape: harmonic m is multiplied by the gain of the filter at λ + imω, and stays one. Noise that is an autoregression
becomes white, between the phases as well as between periods, and least squares on the filtered responses is what
maximum likelihood is on the record (Aitken 1935).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Complexes, Floats, Integers
from floquid._checks import Rebuilt, input_error, refuse_size, several
from floquid.core import Channel, Cycles, Provenance
from floquid.fit import HALF_DIGITS, LAGS, ROUNDING, filter_gain, filtered, yule_walker
from floquid.lti import COLOURED, FEWEST, ModalModel, TimeResponses, white_noise_std

FLOOR = 1e-10
"""The noise is taken to be at least this share of a channel's largest value: records are never exact beyond it."""

SINGLE = 0.5 * float(np.finfo(np.float32).eps)  # the same for samples that were stored in single precision


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Lifted(Rebuilt):
    """The responses at all phases of all channels, as responses of one LTI system sampled once a period.

    Output `channel * n_phases + phase` and input `hit` of `responses` is the sequence of samples of that channel at
    that phase in that hit.

    Parameters
    ----------
    responses
        The lifted responses, with the noise of each (outputs, hits).
    channels
        One `Channel` a block of `n_phases` outputs.
    n_phases
        Samples a period P.
    first_phase
        The phase of the first of them, in periods.
    provenance
        Where the responses come from.
    floor
        The least share of a channel's largest value that the noise is taken to be; of whitened responses, one for each
        (channels, hits).
    whitening
        The filter of each channel along the record (channels, taps) that the responses went through (`whitened`); None
        where there was none.
    later_cycles, later_squares
        Cycles of each hit behind those in `responses` in which nothing rings (hits,), and the sums of squares of their
        samples (channels, hits) [units of the channels squared]: they tell the noise. None where none were cut off.
    """

    responses: TimeResponses
    channels: tuple[Channel, ...]
    n_phases: int
    first_phase: float
    provenance: Provenance
    floor: float | Floats = FLOOR
    whitening: Floats | None = None
    later_cycles: Integers | None = None
    later_squares: Floats | None = None

    def __post_init__(self) -> None:
        if isinstance(self.floor, np.ndarray):
            self._freeze(floor=(self.n_channels, self.n_hits))
        self._freeze(whitening=(self.n_channels, "taps"), later_squares=(self.n_channels, self.n_hits))
        self._freeze(dtype=np.int64, later_cycles=(self.n_hits,))

    @property
    def n_channels(self) -> int:
        """The number of channels."""
        return len(self.channels)

    @property
    def n_hits(self) -> int:
        """The number of hits."""
        return self.responses.n_inputs

    @property
    def period(self) -> float:
        """The period [s]: the sampling interval of the lifted responses."""
        return self.responses.dt

    @property
    def noise(self) -> Floats:
        """The standard deviation of the noise (channels, hits) [units of the channels]."""
        return self.responses.noise[:: self.n_phases]

    @property
    def phase_times(self) -> Floats:
        """The time of each phase after phase zero (phases,) [s]."""
        return (self.first_phase + np.arange(self.n_phases) / self.n_phases) * self.period

    def gain(self, rates: NDArray[np.complexfloating], *, slope: bool = False) -> Complexes:
        r"""Gain of the whitening filter at e^{st}, or its derivative with respect to s.

        .. math:: g_c(s) = \sum_i a_{c,i}\, e^{-s\, i\, T/P}

        `rates` are s (...) [1/s]; g (channels, ...) is 1 where there is no filter [-]. With `slope` dg/ds [s] is given.
        """
        if self.whitening is None:
            return np.full((self.n_channels, *rates.shape), 0j if slope else 1.0 + 0j)
        delays = np.arange(self.whitening.shape[1]) * self.period / self.n_phases
        return filter_gain(self.whitening, delays, np.asarray(rates, np.complex128), slope=slope)

    def by_channel(self, outputs: NDArray) -> NDArray:
        """An array over outputs (..., outputs, hits) as (..., channels, phases, hits)."""
        shape = (*outputs.shape[:-2], self.n_channels, self.n_phases, outputs.shape[-1])
        return outputs.reshape(shape)

    def with_noise(self, noise: Floats) -> Lifted:
        """Return the responses with another noise (channels, hits)."""
        at_least = self.floor * largest_values(self.responses.values, self.n_channels)
        spread, now = np.repeat(np.maximum(noise, at_least), self.n_phases, axis=0), self.responses
        return replace(self, responses=replace(now, noise=spread))

    def first(self, cycles: int) -> Lifted:
        """The first `cycles` of each hit, and the squares of the later ones, which are noise alone."""
        data, values = self.responses, self.responses.values[:, :, :cycles].copy()
        values.flags.writeable = False
        lengths = np.minimum(data.lengths, cycles)
        later = [data.values[:, hit, cycles:length] for hit, length in enumerate(data.lengths)]
        squares = np.stack([np.einsum("on,on->o", part, part) for part in later], axis=1)
        return replace(
            self,
            responses=TimeResponses(values=values, dt=data.dt, noise=data.noise, lengths=lengths),
            later_cycles=data.lengths - lengths,
            later_squares=self.by_channel(squares).sum(axis=1),
        )


def lift(cycles: Cycles | Sequence[Cycles], *, floor: float = FLOOR, noise: Floats | None = None) -> Lifted:
    r"""The lifted responses of one or several hits, with the noise of each channel and hit, estimated if not given.

    .. math:: y^L[m] = [y_0^T, \dots, y_{P-1}^T]^T[m] = \sum_r R^{Ld}_r e^{\lambda_r m T}

    (Allen 2009, eqs. 7-8; outputs are ordered by channel, then phase). One hit of one channel is a view.

    They are (channels · phases, hits, cycles). `cycles` are one `Cycles` a hit, alike in channels, phases, first phase
    and period; their numbers of cycles may differ. `floor` is the least share of a channel's largest value that the
    noise is taken to be; samples that are all in single precision raise it to 2⁻²⁴. `noise` is the deviation of the
    noise (channels, hits) [units of the channels]; None estimates it. Raises InputError where hits are not alike,
    samples are missing, or a channel is constant or too large or small for its square.
    """
    hits = several(cycles, Cycles)
    if not hits:
        raise input_error("cycles", "lift", "hold at least one hit", "is empty")
    first = hits[0]
    for number, hit in enumerate(hits, start=1):
        _check(first, hit, number)
    lengths = np.array([hit.n_cycles for hit in hits])
    if len(hits) == 1:
        values = first.values.reshape(-1, first.n_cycles)[:, None, :]
    else:
        values = np.zeros((first.n_channels * first.n_phases, len(hits), lengths.max()))
        for index, hit in enumerate(hits):
            values[:, index, : hit.n_cycles] = hit.values.reshape(-1, hit.n_cycles)
    values.flags.writeable = False
    lifted = Lifted(
        responses=TimeResponses(values=values, dt=first.period, lengths=lengths),
        channels=first.channels,
        n_phases=first.n_phases,
        first_phase=first.first_phase,
        provenance=Provenance.merge(tuple(hit.provenance for hit in hits)),
        floor=floor_of(values, floor),
    )
    return lifted.with_noise(_noise_of(hits) if noise is None else noise)


def _noise_of(hits: Sequence[Cycles]) -> Floats:
    """The noise of each channel and hit, before anything is known of the response (channels, hits)."""
    noise = np.array([[white_noise_std(block) for block in hit.values] for hit in hits]).T
    # A hit of fewer cycles has no noise of its own while there are longer ones.
    long = np.array([hit.n_cycles for hit in hits]) >= FEWEST
    if long.any():
        # A few cycles do not tell noise from modes; until there is a fit, a short hit has the noise of the long ones.
        noise[:, ~long] = noise[:, long].mean(axis=1, keepdims=True)
    return noise


def unlift(lifted: Lifted) -> tuple[Cycles, ...]:
    """The cycles of each hit of `lifted`, the exact inverse of `lift`; of whitened responses the whitened cycles."""
    return tuple(
        Cycles(
            values=lifted.responses.values[:, hit, :length].reshape(lifted.n_channels, lifted.n_phases, length),
            periods=np.full(length, lifted.period),
            first_phase=lifted.first_phase % 1.0,
            channels=lifted.channels,
            provenance=lifted.provenance,
        )
        for hit, length in enumerate(lifted.responses.lengths)
    )


def _check(first: Cycles, hit: Cycles, number: int) -> None:
    """Refuse a hit unlike the first, or one that cannot be lifted."""
    alike = (
        [c.name for c in hit.channels] == [c.name for c in first.channels]
        and hit.n_phases == first.n_phases
        and abs(hit.first_phase - first.first_phase) < HALF_DIGITS
        and abs(hit.period - first.period) < 1e-9 * first.period
    )
    if not alike:
        must, remedy = "be alike in channels, phases, first phase and period", "`segment([hit1, hit2])`"
        got = f"hit {number} differs from hit 1"
        raise input_error("cycles", "lift", must, got, f"Cut all records together: {remedy}.")
    if np.isnan(hit.values).any():
        raise input_error("cycles", "lift", "have no missing samples", f"hit {number} has NaN", "Cut the gap out.")
    refuse_values(hit.channels, hit.values, f"hit {number}", argument="cycles", of="lift")


def refuse_values(
    channels: Sequence[Channel],
    values: Iterable[Floats],
    where: str,
    *,
    argument: str = "records",
    of: str = "identify",
) -> None:
    """Refuse channels without samples, that do not vary, or whose squares leave the range of floating point.

    `values` are the samples of each of the `channels`, of any shape, NaN a missing one; `where` names the record, and
    `argument` and `of` what they came in, for the message of the `InputError`.
    """
    for channel, samples in zip(channels, values, strict=True):
        name, there = f"channel {channel.name!r} of {where}", samples
        if np.isnan(samples).any():
            there = samples[~np.isnan(samples)]
        if there.size < 2:
            must, got = "have samples in each channel", f"{name} has {'none' if not there.size else 'one'}"
            raise input_error(argument, of, must, got, "Leave it out with `channels=`.")
        lowest, highest = float(there.min()), float(there.max())
        largest = max(highest, -lowest)
        refuse_size(largest, name, argument, of)
        if highest - lowest <= ROUNDING * largest:
            must, got = "have channels that vary", f"{name} is constant ({there.flat[0]:g})"
            raise input_error(argument, of, must, got, "Leave it out with `channels=`, or check its sensor.")


def largest_values(values: Floats, n_channels: int) -> Floats:
    """The largest size in each channel and hit (`n_channels`, hits), from lifted `values` (outputs, hits, cycles)."""
    outputs, inputs, _ = values.shape
    largest = np.maximum(values.max(axis=2), -values.min(axis=2))
    return largest.reshape(n_channels, outputs // n_channels, inputs).max(axis=1)


def floor_of(values: Iterable[Floats], floor: float) -> float:
    """The share of the largest value that the noise is at least: `floor`, or 2⁻²⁴ if more and all in single precision.

    The parts of `values` are looked at one by one, to hold no copy of all; NaN marks a missing sample.
    """
    with np.errstate(over="ignore"):
        single = all(np.array_equal(part, part.astype(np.float32), equal_nan=True) for part in values)
    return max(floor, SINGLE) if single else floor


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
    order = 1
    while order < correlations.shape[1]:
        taps = np.array([yule_walker(own, order) for own in correlations])
        left = np.array([_filtered(own, part) for own, part in zip(correlations, taps, strict=True)])
        if (_colours(left, numbers) < COLOURED)[coloured].all():
            break
        order *= 2
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


__all__ = [
    "LAGS", "Lifted", "filters_of", "floor_of", "largest_values", "lift", "refuse_values", "unlift", "whitened",
    "whitening_filter",
]  # fmt: skip
