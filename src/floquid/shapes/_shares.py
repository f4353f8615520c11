"""Pairs of directions, groups of blades and scales as users name them, and shares of energy in a shape."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from floquid._arrays import Complexes, Floats, Indices, Integers, Mask
from floquid._checks import Sealed, describe, finite, input_error
from floquid.core import Channel, Shape, channels_named
from floquid.fit import SURE, WITHIN, chi2_limit

OF = "read_shapes"
APART = 0.02  # share by which periods may differ from one part of a revolution: a speed is often said in whole numbers

Pairs: TypeAlias = Sequence[str | tuple[str, str]]
"""Pairs of channels: "x:y", several joined by commas, or (x, y); from x to y is the sense of rotation."""

Blades: TypeAlias = Mapping[str, Sequence[str]] | Sequence[str]
"""Groups of channels, one a blade: {"flap": ["b1", "b2", "b3"]}, or "flap=b1,b2,b3" each."""

_EVEN = 0.02  # rad: errors of stated angles of blades within which they are evenly spaced


@dataclass(frozen=True, slots=True)
class Pair:
    """Two channels at right angles in one plane."""

    name: str
    x: int
    y: int


@dataclass(frozen=True, slots=True)
class Family:
    """Channels that measure the same thing: one a blade, evenly spaced on the rotor, or one in the fixed frame."""

    name: str
    rows: Indices
    """In the order of the blades: each is ahead of the one before, in the sense of rotation."""
    scale: float

    @property
    def is_fixed(self) -> bool:
        """True of one channel in the fixed frame."""
        return len(self.rows) == 1

    @property
    def waves(self) -> Integers:
        """The space harmonics n (waves,)."""
        count = len(self.rows)
        return np.arange(-((count - 1) // 2), count // 2 + 1)


def pairs_of(pairs: Pairs, channels: Sequence[Channel]) -> tuple[Pair, ...]:
    """The `pairs` among `channels`; InputError where they differ in unit, or turn with the shaft."""
    words = [pairs] if isinstance(pairs, str) else list(pairs)
    named: list[tuple[str, str]] = []
    for word in words:
        for part in word.split(",") if isinstance(word, str) else [word]:
            both = tuple(part.split(":")) if isinstance(part, str) else tuple(part)
            if len(both) != 2 or not all(isinstance(name, str) for name in both):
                must, remedy = "be two channels each", 'Pass "x:y": from x to y is the sense of rotation.'
                raise input_error("pairs", OF, must, f"has {describe(part)}", remedy)
            named.append((both[0].strip(), both[1].strip()))
    found = []
    for x, y in named:
        rows = channels_named(channels, [x, y], argument="pairs", of=OF)
        for row in rows:
            if channels[row].frame == "rotating":
                must = "be in the fixed frame"
                remedy = "Whirl is that of the fixed frame; name turning members by `blades`."
                raise input_error("pairs", OF, must, f"has {channels[row].name!r}, which turns", remedy)
        found.append(Pair(f"{x}:{y}", *rows))
    _refuse_units([channels[row] for pair in found for row in (pair.x, pair.y)], "pairs")
    return tuple(found)


def families_of(
    blades: Blades, fixed: Sequence[str], scales: Mapping[str, float], channels: Sequence[Channel]
) -> tuple[Family, ...]:
    """Groups of `blades`, then channels of the `fixed` frame, with scales; InputError where one is impossible."""
    named = _named(blades) if blades else _stated(channels)
    found = [Family(name, _members(name, members, channels), _scale(scales, name)) for name, members in named.items()]
    rows = channels_named(channels, fixed, argument="fixed", of=OF)
    found += [Family(name, np.array([row]), _scale(scales, name)) for name, row in zip(fixed, rows, strict=True)]
    if unknown := [name for name in scales if name not in {family.name for family in found}]:
        listing = f"There are: {', '.join(family.name for family in found) or 'none'}."
        raise input_error("scales", OF, "be of groups of blades or fixed channels", f"has {unknown[0]!r}", listing)
    return tuple(found)


def _scale(scales: Mapping[str, float], name: str) -> float:
    return finite(scales.get(name, 1.0), f"scales[{name!r}]", OF)


def _named(blades: Blades) -> dict[str, list[str]]:
    if isinstance(blades, Mapping):
        return {name: list(members) for name, members in blades.items()}
    found: dict[str, list[str]] = {}
    for number, word in enumerate([blades] if isinstance(blades, str) else blades, start=1):
        name, equals, members = word.partition("=")
        listed = [member.strip() for member in (members if equals else name).split(",")]
        found[name.strip() if equals else _stem(listed) or f"group {number}"] = listed
    return found


def _stem(members: Sequence[str]) -> str:
    """The name of a group by what the names of its members have in common."""
    stems = {re.sub(r"[ _.\-]*\d+$", "", member) for member in members}
    return stems.pop() if len(stems) == 1 else ""


def _stated(channels: Sequence[Channel]) -> dict[str, list[str]]:
    """Groups by what channels say of themselves: turning members 1, 2, … of one group."""
    groups: dict[str, dict[int, str]] = {}
    for channel in channels:
        if channel.group and channel.member is not None and channel.frame == "rotating":
            groups.setdefault(channel.group, {})[channel.member] = channel.name
    whole = {name: members for name, members in groups.items() if set(members) == set(range(1, len(members) + 1))}
    return {name: [members[j] for j in sorted(members)] for name, members in whole.items() if len(members) > 1}


def _members(name: str, members: Sequence[str], channels: Sequence[Channel]) -> Indices:
    """The rows of the members of a group, in the order of their angles where these are stated."""
    rows = np.array(channels_named(channels, members, argument="blades", of=OF))
    if len(rows) < 2:
        remedy = "A pattern over blades needs one channel a blade: name the others too."
        raise input_error("blades", OF, "name two blades at least", f"has one in {name!r}", remedy)
    own = [channels[row] for row in rows]
    _refuse_units(own, "blades")
    if still := [channel.name for channel in own if channel.frame == "fixed"]:
        remedy = "Name it by `fixed`, or `pairs`."
        raise input_error("blades", OF, "turn with the rotor", f"has {still[0]!r}, which is in the fixed frame", remedy)
    angles = [channel.angle for channel in own]
    if None in angles:
        return rows
    offs = (np.array(angles, float) - float(angles[0] or 0.0)) % (2.0 * np.pi) / (2.0 * np.pi / len(rows))
    places = np.rint(offs).astype(int) % len(rows)
    uneven = np.abs((offs + 0.5) % 1.0 - 0.5).max() * 2.0 * np.pi / len(rows) > _EVEN
    if uneven or len(set(places.tolist())) < len(rows):
        listing = ", ".join(f"{channel.angle:g}" for channel in own)
        raise input_error("blades", OF, "be evenly spaced", f"has angles of {listing} rad in {name!r}")
    return rows[np.argsort(places)]


def _refuse_units(channels: Sequence[Channel], argument: str) -> None:
    """Refuse channels of different units, whose sizes cannot be compared."""
    for channel in channels[1:]:
        if channel.unit != channels[0].unit:
            got = f"has {channels[0].name!r} in {channels[0].unit} and {channel.name!r} in {channel.unit}"
            raise input_error(argument, OF, "have one unit", got, "Convert one of them before it is identified.")


INSIDE = 0.95  # the probability that an interval holds its share


@dataclass(frozen=True, slots=True)
class Share:
    """A share of energy, what noise adds on average being taken off; deviation and interval None if not estimated."""

    value: float
    std: float | None = None
    interval: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class Energies:
    r"""Amplitudes of a mode over the root of all their energy, and their covariance.

    .. math:: v = z / \sqrt{E}, \qquad E = |z|^2 - \mathrm{tr}\, \Sigma_z, \qquad
              \Sigma_v = (I - v v^T)\, \Sigma_z\, (I - v v^T) / E

    z are real parts, then imaginary parts of the amplitudes.
    """

    v: Floats  # (2 amplitudes,)
    covariance: Floats | None  # (2 amplitudes, 2 amplitudes)
    noise: Floats  # what noise adds to the square of each, over E (2 amplitudes,)
    dropped: float = 0.0  # energy of harmonics that the model does not keep, at most, over E
    is_known: bool = True  # the shape is that of one mode, and its energy more than noise

    @staticmethod
    def of(shape: Shape, to: Complexes) -> Energies:
        """The energies of amplitudes, sums of the lines of a `shape` by `to` (amplitudes, channels, harmonics)."""
        amplitudes = np.tensordot(to, shape.values, axes=2)
        z, covariance = np.concatenate([amplitudes.real, amplitudes.imag]), shape.covariance(to)
        noise = np.zeros_like(z) if covariance is None else np.diag(covariance)
        seen, whole = max(float(z @ z), 1e-300), float(z @ z - noise.sum())
        if covariance is None:
            return Energies(z / np.sqrt(seen), None, noise, is_known=bool(z.any()))
        spread = np.sqrt(2.0 * float(np.sum(covariance**2)) + 4.0 * float(z @ covariance @ z))
        known = whole > WITHIN * spread and not shape.is_mixture
        whole = whole if whole > 0.0 else seen
        v = z / np.sqrt(whole)
        along = np.outer(v, covariance @ v)
        moved = covariance - along - along.T + (v @ covariance @ v) * np.outer(v, v)
        dropped = min(1.0, _dropped(shape) * float(noise.sum()) / whole)
        return Energies(v, moved / whole, noise / whole, dropped, known)

    def share(self, inside: Mask) -> Share:
        r"""The share of some amplitudes, `inside` (amplitudes,).

        Of the energy q = \|v\|² of these, or of the others where that is less, mean and variance are known where its
        expected value is a²:

        .. math:: a^2 + \mathrm{tr}\, \Sigma_v, \qquad 2\, \mathrm{tr}\, \Sigma_v^2 + 4 a^2\, u^T \Sigma_v u

        with u the direction seen. The interval holds each a² for which a multiple of a χ² with this mean and variance
        has the energy seen within its middle 95 %. An energy below its expectation under noise alone counts as that.
        """
        kept = np.tile(inside, 2)
        parts = [float(np.sum(self.v[own] ** 2 - self.noise[own])) for own in (kept, ~kept)]
        value = min(max(parts[0], 0.0), 1.0)
        if not self.is_known:  # without motion, half is neither
            return Share(value if self.v.any() else 0.5, None, (0.0, 1.0))
        if self.covariance is None:
            return Share(value)
        turned = parts[1] < parts[0]
        own = ~kept if turned else kept
        v, covariance = self.v[own], self.covariance[np.ix_(own, own)]
        seen, square, across = float(v @ v), float(np.sum(covariance**2)), float(v @ covariance @ v)
        variance = max(2.0 * square, 4.0 * across)  # v holds its own noise: a little on the safe side
        low, high = _interval(seen, float(np.trace(covariance)), square, across / max(seen, 1e-300))
        low, high = min(low, 1.0), min(high, 1.0)
        low, high = (1.0 - high, 1.0 - low) if turned else (low, high)
        interval = low * (1.0 - self.dropped), high + self.dropped * (1.0 - high)
        return Share(value, float(np.sqrt(variance)), interval)


def _dropped(shape: Shape) -> float:
    """The energy that a model may lack at most, over that of the noise of its harmonics: one at either end of them."""
    numbers = 2 * len(shape.channels)
    kept = int((shape.values != 0.0).any(axis=0).sum())
    return 2.0 * chi2_limit(numbers, SURE) / numbers / max(kept, 1)


def _interval(seen: float, noise: float, square: float, across: float) -> tuple[float, float]:
    """Ends of a² for which the energy `seen` is within the middle of its distribution."""
    from scipy.optimize import brentq
    from scipy.special import gammainc

    if not noise > 0.0:
        return seen, seen
    energy = max(seen, noise)

    def below(expected: float, probability: float) -> float:
        mean, variance = expected + noise, 2.0 * square + 4.0 * expected * across
        return float(gammainc(mean**2 / variance, energy * mean / variance)) - probability

    ends = []
    for probability in (0.5 + 0.5 * INSIDE, 0.5 - 0.5 * INSIDE):
        far = energy
        while below(far, probability) > 0.0:
            far *= 2.0
        ends.append(brentq(below, 0.0, far, args=(probability,)) if below(0.0, probability) > 0.0 else 0.0)
    return ends[0], ends[1]


CLEAR = 0.2
"""The index beyond which all of an interval is where a mode whirls one way. A circle has 1, a straight line 0."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Whirl(Sealed):
    r"""The whirl of a mode in pairs of channels x and y, from x to y being the sense of rotation.

    .. math:: f_m = \tfrac14 |B_x + i B_y|^2, \quad b_m = \tfrac14 |B_x - i B_y|^2, \quad
              W = \frac{\sum_m (f_m - b_m)}{\sum_m (f_m + b_m)}

    f and b exchanged at lines of negative frequency.

    Parameters
    ----------
    index, std, interval
        W from -1 (backward circles) to 1 (forward circles), what noise adds being taken off, its deviation, and a 95 %
        interval, which is no multiple of that next to a circle; None if not estimated.
    strongest
        W of the strongest line alone.
    by_pair
        W of each pair (pairs,).
    word
        "forward", "backward" or "mixed", "mixed (planar)" where the strongest line is nearly straight, "mixed, differs
        along the shaft" where pairs whirl against each other.
    axis
        The angle of the straight line from x towards y [rad] where it is planar; else None.
    """

    index: float
    std: float | None
    interval: tuple[float, float] | None
    strongest: float
    by_pair: Floats
    word: str
    axis: float | None = None


def whirl_of(shape: Shape, exponent: complex, fundamental: float, pairs: Sequence[Pair]) -> Whirl:
    """The whirl of a `shape` in `pairs` of its channels, lines at Im λ + mω by its `exponent` and `fundamental`."""
    signs = np.where(exponent.imag + fundamental * shape.harmonics < 0.0, -1.0, 1.0)
    rows = np.array([[pair.x, pair.y] for pair in pairs])
    whole = _index(shape, signs, rows)
    parts = [_index(shape, signs, row[None]) for row in rows]
    x, y = shape.values[rows[:, 0]], shape.values[rows[:, 1]]
    energy = 0.5 * (np.abs(x) ** 2 + np.abs(y) ** 2)
    line = int(energy.sum(axis=0).argmax())
    turning = (-signs * (x.conj() * y).imag).sum(axis=0)
    strongest = float(turning[line] / (energy[:, line].sum() or 1.0))
    word, axis = _side(whole), None
    sides = {_side(part) for part in parts}
    if {"forward", "backward"} <= sides:
        word = "mixed, differs along the shaft"
    elif word == "mixed" and abs(strongest) < CLEAR and energy[:, line].sum() > 0.5 * energy.sum():
        word, axis = "mixed (planar)", _axis(x[:, line], y[:, line])
    return Whirl(
        index=whole.value,
        std=whole.std,
        interval=whole.interval,
        strongest=strongest,
        by_pair=np.array([part.value for part in parts]),
        word=word,
        axis=axis,
    )


def _index(shape: Shape, signs: Floats, rows: Indices) -> Share:
    """W over pairs of rows (pairs, 2), with deviation and interval: twice the share that turns forward, less one."""
    lines = np.arange(len(shape.harmonics))
    to = np.zeros((len(rows), 2, len(lines), *shape.values.shape), complex)
    for pair, (x, y) in enumerate(rows):
        to[pair, :, lines, x, lines] = 0.5
        to[pair, 0, lines, y, lines], to[pair, 1, lines, y, lines] = 0.5j * signs, -0.5j * signs
    forward = np.tile(np.repeat([True, False], len(lines)), len(rows))
    found = Energies.of(shape, to.reshape(-1, *shape.values.shape)).share(forward)
    std = None if found.std is None else 2.0 * found.std
    low, high = (2.0 * end - 1.0 for end in found.interval or (found.value, found.value))
    return Share(2.0 * found.value - 1.0, std, None if found.interval is None else (low, high))


def sense_of(low: Floats, high: Floats) -> Integers:
    """1 where all of an interval of W is forward, -1 where all is backward, else 0; of its ends `low` and `high`."""
    return (low > CLEAR).astype(np.int64) - (high < -CLEAR)


def _side(index: Share) -> str:
    low, high = index.interval or (index.value, index.value)
    return {1: "forward", -1: "backward"}.get(int(sense_of(np.array(low), np.array(high))), "mixed")


def _axis(x: Complexes, y: Complexes) -> float:
    """The angle of the long axis of the largest of several ellipses, from x towards y [rad], in [0, π)."""
    largest = int((np.abs(x) ** 2 + np.abs(y) ** 2).argmax())
    ahead, back = x[largest] + 1j * y[largest], np.conj(x[largest] - 1j * y[largest])
    return float(0.5 * np.angle(ahead * back) % np.pi)
