"""Results of a survey: points, tracks through them, links between neighbours, edges of instability."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from floquid._arrays import Complexes, Floats, Integers, Mask
from floquid._checks import Rebuilt, Sealed
from floquid._show import Drawings, Drawn, Told
from floquid.core import PeriodicModel
from floquid.shapes import ShapeOptions, Sidebands, sense_of
from floquid.surveys._edges import Kind


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Point(Sealed):
    """One operating point of a survey: its values, and the model identified there or the reason why there is none.

    Parameters
    ----------
    values
        The operating point by quantity, such as `speed_rpm`.
    files
        Where it comes from.
    model
        Modes as one hit, exponents and shapes with their deviations; None without a result.
    passed
        True where the result passed its checks, and of a known system.
    weak
        Modes that no edge rests on (modes,): weakly determined, or of a result that fails.
    reason
        Why there is no result, or why it fails; None where all is well.
    whirl
        Index of whirl of each mode, from -1 (backward) to 1 (forward), and its deviation (modes, 2); NaN where not
        estimated, None where no pairs of channels were given.
    names
        The pattern of each mode over the blades, with its family (modes,); empty where it was not read.
    whirl_interval, leak_interval
        95 % intervals of the index and of the leak (modes, 2), as `whirl` and `blades`; NaN without a deviation.
    blades
        The share of the largest pattern, the leak and its deviation, and the harmonic of its line (modes, 4);
        NaN where they were not read, None where no blades were given.
    agreement
        One where all hits have one shape of a mode, less where it stands for several (modes,); None of a known system.
    sidebands
        Lines beside the main line of each mode, where they were asked for; a file of a survey does not keep them.
    marks
        A mark of the samples of each channel that it was identified from: errors of points that share one are not
        independent.
    """

    values: Mapping[str, float]
    files: tuple[str, ...] = ()
    model: PeriodicModel | None = None
    passed: bool = False
    weak: Mask | None = None
    reason: str | None = None
    whirl: Floats | None = None
    whirl_interval: Floats | None = None
    names: tuple[str, ...] = ()
    blades: Floats | None = None
    leak_interval: Floats | None = None
    agreement: Floats | None = None
    sidebands: Sidebands | None = None
    marks: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        Sealed.__post_init__(self)
        object.__setattr__(self, "values", MappingProxyType(dict(self.values)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Track(Sealed):
    """One mode followed through the points of a survey.

    Arrays go over the points where it was found. Of a couple of real multipliers, into which a mode turns in a lock,
    there are two exponents.

    Parameters
    ----------
    name
        The name of the mode.
    points
        Numbers of the points, ascending (places,).
    modes
        The mode of the point's model, and the second of a couple, else -1 (places, 2).
    exponents, exponent_std
        λ on the branch of the track [1/s], and deviations, of the real part as the real part; the second NaN where
        it is no couple (places, 2).
    shifts, mirrored
        The branch: λ is that of the model moved by this many fundamentals, of the mirror image where `mirrored`
        (places,).
    weak
        True where no edge rests on it (places,).
    confidence, mac, cost, runner_up
        Of the link that leads to each place, the likeness of its shapes, its cost and that of the best other choice;
        NaN for the first (places,).
    whirl, whirl_std, whirl_interval
        Index of whirl, from -1 (backward) to 1 (forward), and its deviation; NaN where it was not read (places,). A
        95 % interval of it (places, 2), which is no multiple of the deviation next to -1 and 1.
    names
        The pattern over the blades with its family at each place (places,); empty where blades were not read.
    name_share, leak, leak_std, leak_interval
        The share of the largest pattern, and that of motion off one line of the fixed frame with its deviation; NaN
        where they were not read (places,). A 95 % interval of the leak (places, 2). Of a mode that stands for several
        it is all there is, and the deviation NaN. Intervals are NaN where shapes have no deviations.
    """

    name: str
    points: Integers
    modes: Integers
    exponents: Complexes
    exponent_std: Complexes
    shifts: Integers
    mirrored: Mask
    weak: Mask
    confidence: Floats
    mac: Floats
    cost: Floats
    runner_up: Floats
    whirl: Floats
    whirl_std: Floats
    names: tuple[str, ...] = ()
    name_share: Floats
    leak: Floats
    leak_std: Floats
    whirl_interval: Floats | None = None
    leak_interval: Floats | None = None

    @property
    def sense(self) -> Integers:
        """1 where the mode whirls forward, -1 backward, by all of the interval if there is one; else 0 (places,)."""
        if self.whirl_interval is None:
            return sense_of(self.whirl, self.whirl)
        low, high = np.where(np.isnan(self.whirl_interval), self.whirl[:, None], self.whirl_interval).T
        return sense_of(low, high)

    @property
    def locked(self) -> Mask:
        """True where the mode is a couple of real multipliers (places,)."""
        return self.modes[:, 1] >= 0

    @property
    def frequency(self) -> Floats:
        """Im λ on the branch of the track [rad/s], continuous over the points (places,)."""
        return self.exponents[:, 0].imag

    @property
    def frequency_std(self) -> Floats:
        """Deviations of the frequency [rad/s] (places,)."""
        return self.exponent_std[:, 0].imag

    @property
    def decay(self) -> Floats:
        """Re λ [1/s], of a couple the mean of both (places,)."""
        return np.where(self.locked, self.exponents.real.mean(axis=1), self.exponents[:, 0].real)

    @property
    def decay_std(self) -> Floats:
        """Deviations of the decay [1/s], of a couple the larger of both (places,)."""
        return np.fmax(self.exponent_std[:, 0].real, self.exponent_std[:, 1].real)

    @property
    def damping_ratio(self) -> Floats:
        """-Re λ/|λ| on the branch of the track; NaN of a couple, which has no frequency of its own (places,)."""
        lam = np.where(self.locked, np.nan, self.exponents[:, 0])
        return -lam.real / np.abs(lam)

    @property
    def growth(self) -> Floats:
        """Re λ [1/s], of a couple the larger of both (places,)."""
        return np.fmax(self.exponents[:, 0].real, self.exponents[:, 1].real)

    @property
    def growth_std(self) -> Floats:
        """Deviations of the growth [1/s], of a couple that of the larger (places,)."""
        second = self.exponents[:, 1].real > self.exponents[:, 0].real
        return np.where(second, self.exponent_std[:, 1].real, self.exponent_std[:, 0].real)


@dataclass(frozen=True, slots=True, kw_only=True)
class Link:
    """A step of a track from one point to the next.

    Parameters
    ----------
    track, between
        The number of the track, and those of the points.
    cost, runner_up
        The cost of the step, and that of the best other choice.
    mac
        The likeness of the shapes.
    confidence
        The share of draws from the covariances that keep the link, less where another choice is nearly as cheap, or
        where hits disagree on a shape.
    """

    track: int
    between: tuple[int, int]
    cost: float
    runner_up: float
    mac: float
    confidence: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Edge:
    """An edge of instability: a mode turns unstable or stable again between two points.

    Parameters
    ----------
    value, std, interval
        The operating point, its deviation, and what holds it with the survey's confidence: values are None where the
        bracket alone is known, and the interval is the bracket then.
    between
        Numbers of the points on both sides.
    kind
        "lock" of a mode with itself (half or whole order), "sum" of two modes with each other, or "single".
    tracks
        Numbers of the tracks.
    direction
        "onset" where the mode turns unstable as the operating point rises, "end" where it turns stable.
    """

    value: float | None
    std: float | None
    interval: tuple[float, float]
    between: tuple[int, int]
    kind: Kind
    tracks: tuple[int, ...]
    direction: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Survey(Told, Drawn, Rebuilt):
    """Modes over an operating point.

    Parameters
    ----------
    over
        The quantity, such as `speed_rpm`.
    points
        All points, ascending.
    tracks
        Modes followed through them, by frequency.
    edges
        Where they turn unstable and stable again, ascending.
    unlinked
        A point and a mode that is on no track.
    shapes
        How shapes were read.
    confidence
        The probability that the interval of an edge holds it.
    notes
        Where tracks cross or veer, in words.
    warnings
        Points without a result, doubtful links, and what else a reader must know.
    """

    kind: ClassVar[str] = "survey"  # by it the functions for a result are found
    over: str
    points: tuple[Point, ...]
    tracks: tuple[Track, ...]
    edges: tuple[Edge, ...]
    unlinked: tuple[tuple[int, int], ...]
    shapes: ShapeOptions = field(default_factory=ShapeOptions)
    confidence: float = 0.95
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    def _figures(self) -> Drawings:
        return dict.fromkeys(("campbell", "damping", "multipliers"), (self, {}))

    @property
    def links(self) -> tuple[Link, ...]:
        """The steps of all tracks."""
        return tuple(
            Link(track=number, between=(int(first), int(last)), cost=cost, runner_up=other, mac=mac, confidence=sure)
            for number, track in enumerate(self.tracks)
            for first, last, cost, other, mac, sure in zip(
                track.points[:-1], track.points[1:],
                *(own[1:].tolist() for own in (track.cost, track.runner_up, track.mac, track.confidence)),
                strict=True,
            )
        )  # fmt: skip

    @property
    def values(self) -> Floats:
        """The operating point of each point (points,)."""
        return np.array([point.values[self.over] for point in self.points])
