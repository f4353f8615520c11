"""Surveys of turbines measured: links, names, exponents, false modes and time, free decays and outputs alone.

`python -m benchmarks.surveyed` identifies records of three turbines, each at eight speeds: three equal blades, three of
which one is softer by a tenth in flap, and two. `--only NAME`, `--excitation free` and `--seeds N` choose; `--profile`
tells where the time of one point goes.
"""

from __future__ import annotations

import argparse
import cProfile
import pstats
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from time import process_time

import numpy as np
from benchmarks.chain.case import wrapped
from benchmarks.simulators.machine import Floats, stepped
from benchmarks.simulators.turbines import RADIUS, two_bladed
from scipy.optimize import linear_sum_assignment
from tests import blades

import floquid as fq
from floquid import floquet
from floquid.surveys import Point, Survey, objects_of, similarities

POINTS, PHASES, NOISE, HITS = 8, 24, 0.01, 2
FINER = 4  # steps of the true survey from one of the points to the next
PERIODS, WARM = {"free": 40, "ambient": 200}, 40
COUPLED = 4.0
"""Stiffness between blades and tower over that of `tests.blades`, where all modes of one family have one multiplier."""

WITHIN, FALSE = 1.96, 0.02
"""Deviations of a 95 % interval, and the distance [ω] from every true exponent beyond which a mode is a false one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Turbine:
    """A turbine over the speeds of a survey.

    `matrix` gives A(t) at a speed [rad/s], displacements before rates; `scales` make lengths of displacements.
    """

    matrix: Callable[[float], Callable[[float], Floats]]
    channels: Sequence[str]
    scales: Floats
    read: dict[str, object]
    between: tuple[float, float]

    @property
    def outputs(self) -> Floats:
        """C, of displacements alone."""
        return np.hstack([np.diag(self.scales), np.zeros((len(self.scales),) * 2)])

    def modes(self, speed: float) -> floquet.FloquetModes:
        """The true modes at a speed."""
        known = floquet.FunctionMatrix(function=self.matrix(speed), period=2.0 * np.pi / speed)
        return floquet.modes(known, outputs=self.outputs, channels=self.channels)


def three_bladed(speed: float, soft: float = 0.0) -> Callable[[float], Floats]:
    """A(t) of three blades that flap and lag on a tower that sways, tilts and yaws; one may be soft in flap."""
    stiffness, damping = blades.coleman(speed)
    moved = stiffness - np.diag(np.diag(stiffness))
    stiffness += (COUPLED - 1.0) * 0.5 * (moved + moved.T)  # the rest is gyroscopic
    return blades.rotor(stiffness, damping, soft=soft * 2.9**2, omega=speed)


def of_three(soft: float) -> Turbine:
    """Three blades of which one is softer in flap by a share."""
    groups = {"flap": blades.BLADES[:3], "edge": blades.BLADES[3:]}
    return Turbine(
        matrix=partial(three_bladed, soft=soft), channels=blades.CHANNELS, scales=np.ones(10),
        read={"blades": groups, "fixed": blades.FIXED}, between=(0.9, 1.6),
    )  # fmt: skip


TURBINES = {
    "three equal blades": of_three(0.0),
    "three, one soft": of_three(0.1),
    "two blades": Turbine(
        matrix=two_bladed, channels=["ss", "fa", "flap1", "flap2", "edge1", "edge2"],
        scales=np.array([1.0, 1.0, *[RADIUS] * 4]),
        read={"blades": {"flap": ["flap1", "flap2"], "edge": ["edge1", "edge2"]}, "fixed": ["fa", "ss"]},
        between=(1.6, 2.4),
    ),
}  # fmt: skip


def records_of(turbine: Turbine, speed: float, excitation: str, seed: int) -> list[fq.Record]:
    """Free decays after two blows, or one response to white forces on every displacement, with 1 % of noise."""
    period, count = 2.0 * np.pi / speed, 2 * len(turbine.scales)
    whole = stepped(turbine.matrix(speed), period, PHASES)
    steps = [after @ np.linalg.inv(before) for before, after in pairwise(whole)]
    generator = np.random.default_rng([seed, round(1e6 * speed)])
    free, found = excitation == "free", []
    for _ in range(HITS if free else 1):
        samples = (PERIODS[excitation] + (0 if free else WARM)) * PHASES
        state = generator.standard_normal(count) / np.tile(turbine.scales, 2) * free
        forces = np.zeros((samples, count))
        if not free:
            forces[:, count // 2 :] = generator.standard_normal((samples, count // 2)) / turbine.scales
        states = np.empty((samples, count))
        for number in range(samples):
            states[number] = state
            state = steps[number % PHASES] @ state + forces[number]
        values = (states @ turbine.outputs.T).T[:, 0 if free else WARM * PHASES :]
        size = np.abs(values).max(axis=1) if free else values.std(axis=1)
        values = values + NOISE * size[:, None] * generator.standard_normal(values.shape)
        clock, point = fq.ConstantPeriod(period=period), {"speed": speed}
        channels = [fq.Channel(name=name, unit="m") for name in turbine.channels]
        made = fq.Record(values=values, sample_rate=PHASES / period, channels=channels, clock=clock)
        found.append(made.with_point(point))
    return found


@dataclass(slots=True)
class Counts:
    """What is counted over the points of surveys; `seconds` are those of each record."""

    points: int = 0
    without: int = 0
    failed: int = 0
    true: int = 0
    found: int = 0
    false: int = 0
    links: int = 0
    linked: int = 0
    named: int = 0
    pulls: list[float] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)

    def row(self, name: str) -> str:
        """A row of the table."""
        pulls = np.array(self.pulls)
        inside = np.mean(pulls < WITHIN) if len(pulls) else np.nan
        cells = (
            name, f"{self.points - self.without - self.failed} of {self.points}", f"{self.found} of {self.true}",
            str(self.false), f"{self.linked} of {self.links}", f"{self.named} of {self.found}", f"{inside:.1%}",
            f"{np.median(self.seconds):.1f}, {max(self.seconds):.1f}",
        )  # fmt: skip
        return f"| {' | '.join(cells)} |"


HEAD = (
    "| turbine, excitation | passed | modes found | false | links right | names right | 95 % intervals that hold | "
    "s a record: median, most |\n|---|---|---|---|---|---|---|---|"
)


def matched(point: Point, truth: Point) -> dict[int, tuple[int, complex]]:
    """True modes that are found, by the model's upper modes, each with the error of λ.

    Of true modes that are near each other modulo iω shapes tell which it is.
    """
    seen, known = objects_of((point, truth))
    macs = np.array([[similarities(own, other).max() for own in known] for other in seen])
    one, other = (np.array([own.exponents[0] for own in objects]) for objects in (seen, known))
    fundamental = known[0].fundamental
    gaps = [np.subtract.outer(lam, other) for lam in (one, one.conj())]
    gaps = [gap.real + 1j * wrapped(gap.imag, fundamental) for gap in gaps]
    gap = np.where(np.abs(gaps[0]) <= np.abs(gaps[1]), *gaps)
    far = np.abs(gap) / (FALSE * fundamental)
    rows, columns = linear_sum_assignment(np.minimum(far, 2.0) + 1.0 - macs)
    return {
        seen[row].modes[0]: (known[column].modes[0], complex(gap[row, column]))
        for row, column in zip(rows, columns, strict=True)
        if far[row, column] < 1.0
    }


def judge(counts: Counts, found: Survey, known: Survey) -> None:
    """Count what a survey has of the `known` one, which has more points: those between say which mode is which."""
    of_track = {
        (int(point) // FINER, int(mode)): number
        for number, track in enumerate(known.tracks)
        for point, mode in zip(track.points, track.modes[:, 0], strict=True)
        if point % FINER == 0
    }
    met: list[dict[int, int]] = []
    for number, (point, true) in enumerate(zip(found.points, known.points[::FINER], strict=True)):
        counts.points += 1
        met.append({})
        assert true.model is not None
        counts.true += len(true.model.upper_modes)
        if point.model is None:
            counts.without += 1
            continue
        counts.failed += not point.passed
        std = point.model.exponent_std
        assert std is not None
        pairs = matched(point, true)
        counts.found += len(pairs)
        counts.false += len(point.model.upper_modes) - len(pairs)
        for mode, (own, error) in pairs.items():
            met[-1][mode] = of_track.get((number, own), -1)
            counts.named += point.names[mode].split(":")[0] == true.names[own].split(":")[0]
            counts.pulls += [abs(error.real) / std[mode].real, abs(error.imag) / max(std[mode].imag, 1e-300)]
    for link in found.links:
        track = found.tracks[link.track]
        place = int(np.flatnonzero(track.points == link.between[0])[0])
        ends = [met[int(track.points[k])].get(int(track.modes[k, 0])) for k in (place, place + 1)]
        counts.links += None not in ends
        counts.linked += None not in ends and ends[0] == ends[1]


def identified(records: Sequence[fq.Record], excitation: str, counts: Counts) -> fq.Analysis | Point:
    """The result at one point, or a point without one."""
    begin = process_time()
    try:
        options = {"excitation": "ambient"} if excitation == "ambient" else {}
        return fq.identify(records, **options)
    except fq.FloquidError as error:
        return Point(values=records[0].point, reason=str(error))
    finally:
        counts.seconds.append((process_time() - begin) / len(records))


def surveyed(turbine: Turbine, excitation: str, seeds: Sequence[int], points: int = POINTS) -> Counts:
    """Surveys of records of a turbine at the first speeds, one a seed, held against that of the turbine itself."""
    counts = Counts()
    speeds = np.linspace(*turbine.between, POINTS)[:points]
    between = (float(speeds[0]), float(speeds[-1]))
    finer = FINER * (points - 1) + 1
    known = fq.survey(turbine.modes, over="speed", between=between, points=finer, **turbine.read)
    for seed in seeds:
        results = []
        for speed in speeds:
            results.append(identified(records_of(turbine, float(speed), excitation, seed), excitation, counts))
            sys.stderr.write(f"{excitation} {speed:.3f}: {counts.seconds[-1]:.1f} s a record\n")
        judge(counts, fq.survey(results, over="speed", **turbine.read), known)
    return counts


def main(arguments: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.surveyed", description=__doc__)
    parser.add_argument("--only", choices=TURBINES, action="append", help="a turbine")
    parser.add_argument("--excitation", choices=PERIODS, action="append", help="free decays, or outputs alone")
    parser.add_argument("--seeds", type=int, default=1, help="surveys of each")
    parser.add_argument("--points", type=int, default=POINTS, choices=range(3, POINTS + 1), help="the lowest speeds")
    parser.add_argument("--profile", action="store_true", help="the time of the first point alone, by function")
    options = parser.parse_args(arguments)
    sys.stdout.write("" if options.profile else f"{HEAD}\n")
    for name in options.only or TURBINES:
        turbine = TURBINES[name]
        for excitation in options.excitation or PERIODS:
            if options.profile:
                records, profile = records_of(turbine, turbine.between[0], excitation, 0), cProfile.Profile()
                profile.runcall(identified, records, excitation, Counts())
                pstats.Stats(profile, stream=sys.stdout).sort_stats("cumulative").print_stats(60)
                continue
            counts = surveyed(turbine, excitation, range(options.seeds), options.points)
            words = "free decays" if excitation == "free" else "outputs alone"
            sys.stdout.write(counts.row(f"{name}, {words}") + "\n")
            sys.stdout.flush()
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
