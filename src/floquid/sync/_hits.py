"""Impacts in a record with several hits, and the free responses between them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise

import numpy as np

from floquid._checks import finite, input_error, positive
from floquid.core import Record, channels_named
from floquid.findings import Finding, note
from floquid.sync._impact_search import by_force, by_response

LEAST = 0.05  # the weakest impact that counts, as a share of the strongest one
APART = 0.01  # Impacts closer than this share of the record are one impact
SHORTEST = 0.1  # pieces shorter than this share of the longest one are left out


@dataclass(frozen=True, slots=True, kw_only=True)
class Impact:
    """One impact found in a record.

    Parameters
    ----------
    start, end
        When it begins, on the record's own time axis, and from when on the response is free again [s].
    strength
        The amplitude of its force, or of its prediction error, as a share of the strongest impact's.
    double
        True for more than one blow: a double hit or a bounce.
    channel
        The name of the force channel it was seen in, or None when it was seen in the response.
    """

    start: float
    end: float
    strength: float
    double: bool
    channel: str | None = None

    @property
    def finding(self) -> Finding:
        """The impact as a finding."""
        return note("impact", **asdict(self))


def find_impacts(
    record: Record,
    *,
    force: str | None = None,
    channels: Sequence[str] | None = None,
    least: float = LEAST,
    apart: float | None = None,
) -> tuple[Impact, ...]:
    r"""The impacts in a record of several hits, in order of time, from the force or else from the response.

    .. math::
        e_n = y_n - \sum_{k=1}^{p} A_k y_{n-k} - c, \qquad
        s_m = \sum_{n=m}^{m+w-1} e_n^T R^{-1} e_n + \sum_{n=m-w}^{m-1} b_n^T R_b^{-1} b_n

    A force channel is read by two thresholds above its resting level: an impact begins and ends at the lower one and
    must reach the upper one. Without a force, or without a blow in it, a multi-channel autoregressive model is fitted
    by least squares to the whole record. One fit goes forwards (e) and one backwards (b). Free decays, their periodic
    modulation and a periodic forced response are all sums of exponentials, which such a model foretells; an impact is
    not. It disturbs e only after it and b only before it, so that s stands out exactly there. The model is fitted again
    without the impacts found, until these stay the same. `s` is compared with its own median nearby and over the
    record.

    A free response that starts at the first sample is no impact: an empty result says that the record is one free
    response from its first sample (or that the first samples are all that was hit). Two blows nearer than the model's
    memory (up to 64 samples) look like one long impact in the response alone. The soft beginning and end of a long one
    drown in noise: then split with a `skip`. A hard knock of loose parts is an impact; longer chatter, which both
    predictions miss on both of its sides, is not counted.

    Raises InputError where a channel is unknown or a number is out of its range. So it does where the response is too
    short or misses too many samples.

    Parameters
    ----------
    record
        The record; missing samples (NaN) are passed over, and an impact within a missing stretch is not seen.
    force
        The name of the channel to find the impacts in; by default a channel of quantity "force", if there is one.
    channels
        The names of the response channels to use when there is no force: by default all but force, pulse and angle
        channels and the clock's channel.
    least
        The weakest impact that counts, in (0, 1): its amplitude as a share of the strongest one's.
    apart
        Impacts closer than this are one impact [s]: by default 1 % of the record.
    """
    of = "find_impacts"
    share = positive(least, "least", of, remedy="It is a share of the strongest impact: 0.05 is 5 %.")
    if share >= 1.0:
        raise input_error("least", of, "be below 1", f"is {share:g}", "0.05 is 5 % of the strongest impact.")
    stretch = APART * record.duration if apart is None else positive(apart, "apart", of, unit="s")
    samples = max(1, round(stretch * record.sample_rate))
    for row in _force_rows(record, force, of):
        blows = by_force(record.values[row], least=share, apart=samples)
        if blows or force is not None:
            return tuple(_impact(record, blow, record.channels[row].name) for blow in blows)
    rows = _response_rows(record, channels, of)
    return tuple(_impact(record, blow, None) for blow in by_response(record.values, rows, least=share, apart=samples))


def find_hits(record: Record, *, force: str | None = None, least: float = LEAST) -> tuple[float, ...]:
    """The instants [s] at which the impacts of a record begin, in order: `find_impacts` for short.

    `record`, `force` and `least`, the errors and an empty result are those of `find_impacts`.
    """
    return tuple(impact.start for impact in find_impacts(record, force=force, least=least))


def split_hits(
    record: Record,
    instants: Iterable[float | Impact] | None = None,
    *,
    force: str | None = None,
    skip: float = 0.0,
    shortest: float | None = None,
) -> tuple[Record, ...]:
    """The free responses of a record of several hits: one record from each impact's end to the next impact.

    The pieces keep the time axis, the clock and the channels of the record, the force left out. Their values are
    views of the record's (of one copy, where a force channel lies in the midst of the others). What is left out is
    said in the provenance.

    Raises InputError where an instant is outside the record or the instants do not ascend. So it does where a channel
    is unknown, a number is out of its range, or nothing is left.

    Parameters
    ----------
    record
        The record of several hits.
    instants
        The impacts, or instants [s] from which on the response is free (the end of a blow is added where a force
        channel shows one under way): by default those that `find_impacts` finds. When it finds none, the record is
        one free response. What comes before the first instant is left out; if the record begins with a free response
        too, put `record.start` first.
    force
        The name of the force channel: by default those of quantity "force".
    skip, shortest
        Left out after each impact [s], such as first cycles that are not linear; and the length below which pieces are
        left out [s], by default a tenth of the longest.
    """
    of = "split_hits"
    pause = finite(skip, "skip", of, unit="s")
    if pause < 0.0:
        raise input_error("skip", of, "not be negative [s]", f"is {pause:g}")
    impacts = find_impacts(record, force=force) if instants is None else _as_impacts(record, instants, force)
    if not impacts:
        impacts = (Impact(start=record.start, end=record.start, strength=1.0, double=False),)
    bounds = _bounds(record, impacts, pause)
    lengths = [max(0, stop - first) / record.sample_rate for first, stop in bounds]
    limit = SHORTEST * max(lengths) if shortest is None else positive(shortest, "shortest", of, unit="s")
    kept = [number for number, length in enumerate(lengths) if length > 0 and length >= limit * (1 - 1e-9)]
    if not kept:
        got = f"is {pause:g} s, and the longest piece would last {max(lengths):g} s"
        raise input_error("skip", of, f"leave pieces of at least {limit:g} s", got, "Lower `skip` or `shortest`.")
    few = [f"hit {n + 1} ({impacts[n].start:.6g} s, {lengths[n]:.4g} s)" for n in range(len(impacts)) if n not in kept]
    left = f"; pieces shorter than {limit:.4g} s left out: {', '.join(few)}" if few else ""
    base = _without_force(record, force)
    return tuple(_piece(base, record, impacts, bounds, number, pause, left) for number in kept)


def _impact(record: Record, blow: tuple[int, int, float, bool], channel: str | None) -> Impact:
    first, stop, strength, double = blow
    start, end = (float(record.start + n / record.sample_rate) for n in (first, stop))
    return Impact(start=start, end=end, strength=strength, double=double, channel=channel)


def _force_rows(record: Record, force: str | None, of: str) -> list[int]:
    if force is not None:
        return channels_named(record.channels, [force], argument="force", of=of)
    return [row for row, channel in enumerate(record.channels) if channel.quantity == "force"]


def _response_rows(record: Record, channels: Sequence[str] | None, of: str) -> list[int]:
    """The rows of the response that change at all."""
    if channels is None:
        others = ("force", "pulse", "angle")
        rows = [n for n, c in enumerate(record.channels) if c.quantity not in others and c.name != record.clock_channel]
    else:
        rows = channels_named(record.channels, channels, argument="channels", of=of)
    # fmin and fmax pass over missing samples without a temporary as large as the record.
    moving = [row for row in rows if np.fmax.reduce(record.values[row]) > np.fmin.reduce(record.values[row])]
    if not moving:
        got = "none does" if rows else "all channels are forces, pulses or angles"
        raise input_error("record", of, "have a response channel that changes", got, "Name them in `channels`.")
    return moving


def _as_impacts(record: Record, instants: Iterable[float | Impact], force: str | None) -> tuple[Impact, ...]:
    """The caller's instants as impacts: one that falls into a blow of the force ends with the blow."""
    of = "split_hits"
    known: tuple[Impact, ...] = ()
    given = tuple(instants)
    if _force_rows(record, force, of) and not all(isinstance(instant, Impact) for instant in given):
        known = tuple(blow for blow in find_impacts(record, force=force) if blow.channel is not None)
    step = 1.0 / record.sample_rate
    impacts: list[Impact] = []
    for instant in given:
        if isinstance(instant, Impact):
            impacts.append(instant)
            continue
        time = finite(instant, "instants", of, unit="s")
        end = max((blow.end for blow in known if blow.start - step <= time <= blow.end), default=time)
        impacts.append(Impact(start=time, end=end, strength=1.0, double=False))
    starts = [impact.start for impact in impacts]
    last = record.start + record.duration
    for start in starts:
        if not record.start - 0.5 * step <= start < last:
            must = f"lie within the record ({record.start:g} to {last:g} s)"
            raise input_error("instants", of, must, f"has {start:g} s", "Times count on the record's own axis.")
    if any(later <= earlier for earlier, later in pairwise(starts)):
        raise input_error("instants", of, "ascend", "has a later one before an earlier one", "Sort them.")
    return tuple(impacts)


def _bounds(record: Record, impacts: Sequence[Impact], skip: float) -> list[tuple[int, int]]:
    """First and one past the last sample of each free response, before any is left out."""

    def sample(time: float) -> int:
        # The first sample at `time` or after it, however the time was rounded.
        return min(record.n_samples, max(0, int(np.ceil((time - record.start) * record.sample_rate - 1e-6))))

    stops = [sample(impact.start) for impact in impacts[1:]] + [record.n_samples]
    return [(sample(impact.end + skip), stop) for impact, stop in zip(impacts, stops, strict=True)]


def _without_force(record: Record, force: str | None) -> Record:
    left = _force_rows(record, force, "split_hits")
    rows = [row for row in range(record.n_channels) if row not in left]
    if not rows:
        raise input_error("record", "split_hits", "have a response channel", "all its channels are forces")
    if not left:
        return record
    names = ", ".join(repr(record.channels[row].name) for row in left)
    # Rows in a regular sequence are a view; anything else must be copied, once.
    step = rows[1] - rows[0] if len(rows) > 1 else 1
    regular = rows == list(range(rows[0], rows[-1] + 1, step))
    values = record.values[rows[0] : rows[-1] + 1 : step] if regular else record.values[rows]
    values.flags.writeable = False
    provenance = record.provenance.then(f"force channel {names} left out")
    return replace(record, values=values, channels=tuple(record.channels[r] for r in rows), provenance=provenance)


def _piece(
    base: Record,
    record: Record,
    impacts: Sequence[Impact],
    bounds: Sequence[tuple[int, int]],
    number: int,
    skip: float,
    left: str,
) -> Record:
    first, stop = bounds[number]
    impact = impacts[number]
    start, last = (record.start + n / record.sample_rate for n in (first, stop - 1))
    double = " (more than one blow)" if impact.double else ""
    words = f"hit {number + 1} of {len(impacts)} at {impact.start:.6g} s{double}: free response from {start:.6g} to "
    words += f"{last:.6g} s, {stop - first} samples"
    words += f", {skip:.4g} s after the impact skipped" if skip else ""
    words += f"; {bounds[0][0]} samples before the first piece left out" if number == 0 and bounds[0][0] else ""
    provenance = base.provenance.then(words + left)
    return replace(base, values=base.values[:, first:stop], start=start, provenance=provenance)
