"""Readings of the shapes of modes: whirl, patterns over blades and participation, of one result or known system."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from floquid._arrays import Floats, Integers
from floquid._checks import Rebuilt, Sealed, input_error, positive, wrong_value
from floquid.core import Channel, Identified, PeriodicModes, Shape, as_point, channels_named, couples_of
from floquid.periodic import CONFIDENT
from floquid.shapes._blades import WORDS, BladePattern, Words, pattern_of
from floquid.shapes._shares import (
    APART,
    OF,
    Blades,
    Energies,
    Family,
    Pair,
    Pairs,
    Whirl,
    families_of,
    pairs_of,
    whirl_of,
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Participation(Sealed):
    """Shares of the lines of a mode in one channel, after Peters and Lieb.

    Parameters
    ----------
    channel
        The name of the channel.
    harmonics
        The integers m (harmonics,).
    shares, std
        The share of the line at Im λ + mω in the energy of the channel, and its deviation (harmonics,); None if not
        estimated.
    """

    channel: str
    harmonics: Integers
    shares: Floats
    std: Floats | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModeReading(Rebuilt):
    """The reading of the shape of one mode.

    Parameters
    ----------
    mode, number
        Its place in the model, counted from 0, and its number in tables, where each pair is one row, from 1.
    exponent
        λ as the model has it [1/s].
    frequency
        Its frequency [rad/s], above zero: on the branch of the blades where there are some, else of the exponent.
    whirl, blades, participation
        What was asked for; None for the others.
    name
        The name with its ordinal, as `1st flap backward`; of a mode of several patterns these with their shares. None
        without blades, of a result that fails, and of a weak mode, unless the share of its first pattern is sure.
    couple
        The other mode of a pair that is locked to the period; None of a mode that is none.
    is_weak
        True where the deviation of the exponent leaves the mode in doubt, as `weak` in the table of modes.
    is_mixture
        True where hits disagree on the shape: the mode stands for several, and its whirl and leak are not determined.
    """

    mode: int
    number: int
    exponent: complex
    frequency: float
    whirl: Whirl | None = None
    blades: BladePattern | None = None
    participation: Participation | None = None
    name: str | None = None
    couple: int | None = None
    is_weak: bool = False
    is_mixture: bool = False


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ShapeReadings(Rebuilt):
    """Readings of the shapes of all modes of a result, one of each conjugate pair.

    Parameters
    ----------
    modes
        One reading a mode, by its frequency.
    period, harmonics
        The period [s], and the integers m of all shapes (harmonics,).
    point
        The operating point.
    warnings
        What a reader must know, a sentence each.
    """

    modes: tuple[ModeReading, ...]
    period: float
    harmonics: Integers
    point: Mapping[str, float] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", as_point(self.point, "ShapeReadings"))


@dataclass(frozen=True, slots=True, kw_only=True)
class ShapeOptions(Rebuilt):
    """The arguments of `read_shapes` by which each point of a survey is read; without any of them none is."""

    pairs: Pairs = ()
    blades: Blades = ()
    fixed: Sequence[str] = ()
    scales: Mapping[str, float] = field(default_factory=dict)
    words: Words = "en"

    def __post_init__(self) -> None:
        """Hold tuples and plain mappings: what was given may change, and is kept in files."""
        pairs, blades = ((own,) if isinstance(own, str) else own for own in (self.pairs, self.blades))
        if isinstance(blades, Mapping):
            blades = MappingProxyType({name: tuple(own) for name, own in blades.items()})
        pairs = tuple(own if isinstance(own, str) else tuple(own) for own in pairs)
        known = {"pairs": pairs, "blades": blades if isinstance(blades, Mapping) else tuple(blades)}
        known |= {"fixed": tuple(self.fixed), "scales": MappingProxyType(dict(self.scales))}
        for name, value in known.items():
            object.__setattr__(self, name, value)

    def __bool__(self) -> bool:
        return bool(self.pairs or self.blades or self.fixed)

    def families(self, channels: Sequence[Channel]) -> tuple[Family, ...]:
        """The groups of blades and the fixed channels among `channels`; none where no blades are read."""
        return families_of(self.blades, self.fixed, self.scales, channels) if self.blades or self.fixed else ()

    def read(self, result: Identified | PeriodicModes, *, participation: str | None = None) -> ShapeReadings:
        """The readings of a result."""
        return read_shapes(
            result,
            pairs=self.pairs,
            blades=self.blades,
            fixed=self.fixed,
            scales=self.scales,
            participation=participation,
            words=self.words,
        )


def read_shapes(
    result: Identified | PeriodicModes,
    *,
    pairs: Pairs = (),
    blades: Blades = (),
    fixed: Sequence[str] = (),
    scales: Mapping[str, float] = MappingProxyType({}),
    participation: str | None = None,
    periods_per_revolution: float | None = None,
    words: Words = "en",
) -> ShapeReadings:
    r"""Whirl of modes, their patterns over the blades of a rotor with names, and shares of their lines.

    Nothing is transformed: exponents and shapes stay as they were identified. Deviations are those of the joint
    covariance, to first order; shares count all lines of a shape as they are, not over their noise. Returns one reading
    of each mode.

    Raises InputError where a channel is unknown, units of a pair or a group differ, a group has one blade, or the
    period is not one revolution and blades are to be read.

    Parameters
    ----------
    result
        What `identify` or `identify_large` gave, a `PeriodicModel`,
        or modes of a known A(t): `floquet.modes(..., outputs=C)`.
    pairs
        Pairs of channels at right angles in a plane of the fixed frame, "x:y" each: from x to y the shaft turns.
    blades
        Groups of channels, one a blade: {"flap": ["b1", "b2", "b3"]}, or "flap=b1,b2,b3" each. Each blade is ahead of
        the one before, in the sense of rotation. By default those that the channels state; none where there are pairs.
    fixed
        Channels in the fixed frame that count beside the blades, the motion of a tower say.
    scales
        What makes groups and fixed channels lengths (or angles) that can be compared: {"tower": 1 / 60}. Without it,
        and with units that differ, names are given within each group alone.
    participation
        A channel whose lines are shared out.
    periods_per_revolution
        Periods in a revolution of the rotor; those of the settings of an analysis, else 1.
    words
        Words for directions: "en" (forward, backward), "openfast" (progressive, regressive) or "hawc" (FW, BW).
    """
    modes = getattr(result, "model", result)
    if not isinstance(modes, PeriodicModes):
        must = "be an Analysis or modes in channels"
        raise wrong_value("result", OF, must, result, "Pass what `identify` gave, or `floquet.modes(..., outputs=C)`.")
    if words not in WORDS:
        raise wrong_value("words", OF, f"be one of {', '.join(WORDS)}", words)
    pairs_read = pairs_of(pairs, modes.channels)
    families = () if pairs_read and not blades and not fixed else families_of(blades, fixed, scales, modes.channels)
    if not (pairs_read or families or participation):
        remedy = "Name channels: x:y for whirl, flap=b1,b2,b3 for patterns over blades, or one for its participation."
        raise input_error("pairs", OF, "be given, or blades, or a participation", "none is", remedy)
    if families:
        _refuse_period(result, modes, periods_per_revolution)
    row = None
    if participation is not None:
        row = channels_named(modes.channels, [participation], argument="participation", of=OF)[0]
    failed = bool(getattr(result, "failed", False))
    compared = len({modes.channels[own].unit for one in families for own in one.rows}) < 2 or bool(scales)
    readings = _readings(modes, pairs_read, families, row, compared=compared, words=words)
    couples, numbers = couples_of(modes), {one.mode: one.number for one in readings}
    partners = {a: b for couple in couples for a, b in (couple.modes, couple.modes[::-1])}
    readings = [replace(one, couple=partners.get(one.mode)) for one in readings]
    warnings = [
        f"Modes {numbers[couple.modes[0]]} and {numbers[couple.modes[1]]} may be one pair locked to the period, but a "
        "third real multiplier is nearly as much like one of them."
        for couple in couples
        if not couple.is_sure
    ]
    if mixed := [one for one in readings if one.is_mixture]:
        listing = ", ".join(f"{one.frequency / (2.0 * np.pi):.4g} Hz" for one in mixed)
        warnings.append(
            f"Hits disagree on the shape at {listing}: a mode there stands for several, and its whirl, leak and shares "
            "are those of a mixture."
        )
    if families and not compared:
        warnings.append(
            "Groups differ in unit: names hold within each group. Give scales that make them lengths to compare them."
        )
    if failed:
        warnings.append("The model fails: its modes are given no names.")
    return ShapeReadings(
        modes=tuple(readings if failed else _named(readings)),
        period=modes.period,
        harmonics=modes.harmonics,
        point=modes.point,
        warnings=tuple(warnings),
    )


def _refuse_period(result: Any, modes: PeriodicModes, given: float | None) -> None:
    """Refuse to read blades where ω is not the speed of the rotor, as stated or as `speed_rpm` says."""
    stated = getattr(getattr(result, "settings", None), "periods_per_revolution", 1.0)
    turns = modes.period * modes.point.get("speed_rpm", 0.0) / 60.0
    whole = round(1.0 / turns) if turns > 0.0 else 0
    if whole > 1 and abs(whole * turns - 1.0) < APART:
        stated = float(whole)
    periods = stated if given is None else positive(given, "periods_per_revolution", OF)
    if periods != 1.0:
        must = "be 1 where blades are read: ω must be the speed of the rotor"
        got = f"is {periods:g}" + (" by the period and `speed_rpm`" if whole > 1 and given is None else "")
        remedy = "Identify with the period of one revolution. Of another shaft's speed pass `periods_per_revolution=1`."
        raise input_error("periods_per_revolution", OF, must, got, remedy)


def _readings(
    modes: PeriodicModes,
    pairs: Sequence[Pair],
    families: Sequence[Family],
    row: int | None,
    *,
    compared: bool,
    words: Words,
) -> list[ModeReading]:
    """The reading of one of each conjugate pair, and of each real multiplier, without names, by frequency."""
    fundamental = 2.0 * np.pi / modes.period
    turns = 2.0 * modes.exponents.imag / fundamental
    near = np.abs(np.subtract.outer(modes.exponents, modes.exponents.conj())) < 1e-9 * fundamental
    alone = np.diag(near) | ~near.any(axis=1)
    found = []
    limit = CONFIDENT * fundamental
    spread = None if modes.covariance is None else np.sqrt(np.diag(modes.covariance)).reshape(2, -1).max(axis=0)
    for number, mode in enumerate(np.flatnonzero(alone | (modes.exponents.imag > 0.0)).tolist(), start=1):
        exponent, shape = complex(modes.exponents[mode]), modes.shape(mode)
        is_real = bool(alone[mode] and abs(turns[mode] - np.rint(turns[mode])) < 1e-6)
        pattern = None
        if families:
            pattern = pattern_of(
                shape, exponent, fundamental, families, is_real=is_real, is_compared=compared, words=words
            )
        found.append(
            ModeReading(
                mode=mode,
                number=number,
                exponent=exponent,
                is_weak=bool(spread is not None and spread[mode] > limit),
                is_mixture=shape.is_mixture,
                frequency=abs(exponent.imag) if pattern is None else pattern.frequency,
                whirl=whirl_of(shape, exponent, fundamental, pairs) if pairs else None,
                blades=pattern,
                participation=None if row is None else _participation(shape, row),
            )
        )
    return sorted(found, key=lambda one: one.frequency)


def _participation(shape: Shape, row: int) -> Participation:
    """The shares of the lines of one row of a shape."""
    count = len(shape.harmonics)
    to = np.zeros((count, *shape.values.shape), complex)
    to[np.arange(count), row, np.arange(count)] = 1.0
    energies = Energies.of(shape, to)
    shares = [energies.share(np.arange(count) == line) for line in range(count)]
    stds = [share.std for share in shares]
    return Participation(
        channel=shape.channels[row].name,
        harmonics=shape.harmonics,
        shares=np.array([share.value for share in shares]),
        std=None if None in stds else np.array(stds, float),
    )


def _named(readings: Sequence[ModeReading]) -> list[ModeReading]:
    """Readings with names: family, direction, and an ordinal by frequency among those of both."""
    counts: Counter[str] = Counter()
    found = []
    for one in readings:
        name = None if one.blades is None or (one.is_weak and not one.blades.is_sure) else one.blades.words
        if name is not None and one.blades is not None and one.blades.is_compared and not one.blades.is_mixed:
            first = one.blades.shares[0].name
            counts[first] += 1
            name = f"{ordinal(counts[first])} {first}"
        found.append(replace(one, name=name))
    return found


def ordinal(number: int) -> str:
    """1st, 2nd, 3rd, 4th."""
    ending = {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{'th' if 10 <= number % 100 <= 20 else ending}"
