"""Surveys of rotors measured: links, edges, names, exponents, false modes and time, free decays and outputs alone.

`python -m benchmarks.surveyed` identifies records of turbines at eight speeds (three equal blades, three of which one
is softer by a tenth in flap, and two), and of a shaft with a disc and a housing at twenty. `--only NAME`,
`--excitation free` and `--seeds N` choose; `--profile` tells where the time of one point goes. `--edges N` finds edges
of N draws of known modes instead, `--command` times `floquid survey` over a folder of the shaft's records, and
`--phases` looks for phase zero of outputs alone that begin at any sample.
"""

from __future__ import annotations

import argparse
import cProfile
import pstats
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from resource import RUSAGE_CHILDREN, getrusage
from subprocess import run
from tempfile import TemporaryDirectory
from time import perf_counter, process_time

import numpy as np
from benchmarks.chain.case import wrapped
from benchmarks.simulators.machine import Floats, stepped
from benchmarks.simulators.turbines import RADIUS, two_bladed
from scipy.optimize import linear_sum_assignment
from tests import blades, locks

import floquid as fq
from floquid import floquet
from floquid.surveys import Point, Survey, objects_of, similarities

POINTS, PHASES, NOISE, HITS = 8, 24, 0.01, 2
FINER = 4  # steps of the true survey from one of the points to the next
THIRD = 3  # of twenty speeds seven stay
PERIODS, WARM = {"free": 40, "ambient": 200}, 40
COUPLED = 4.0
"""Stiffness between blades and tower over that of `tests.blades`, where all modes of one family have one multiplier."""

WITHIN, FALSE = 1.96, 0.02
"""Deviations of a 95 % interval, and the distance [ω] from every true exponent beyond which a mode is a false one."""

ROUNDING = 1e-9
SURE = 0.8
"""Confidence of a link from which on a wrong one is a fault."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rotor:
    """A rotor over the speeds of a survey.

    `matrix` gives A(t) at a speed, the fundamental [rad/s], displacements before rates; `scales` make lengths of
    displacements.
    """

    matrix: Callable[[float], Callable[[float], Floats]]
    channels: Sequence[str]
    scales: Floats
    read: dict[str, object]
    between: tuple[float, float]
    points: int = POINTS

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


def shaft(speed: float) -> Callable[[float], Floats]:
    r"""A(t) of a disc that moves and tilts on a shaft of unequal stiffness, in a housing on unequal supports.

    .. math:: K(t) = S^T\, [P \otimes (I + 0.12\, R(2 \Omega t))]\, S + K_F

    with P the stiffness of the shaft in one plane, R its unequal part, S what bends it, and 2Ω the `speed` given: two
    modes lock with themselves and two with each other between 2.75 and 3.25.
    """
    stiffness, bent = np.array([[1.0, 0.25], [0.25, 0.7]]), np.eye(4, 6)
    bent[[0, 1], [4, 5]] = -1.0
    inertia = np.diag([1.0, 1.0, 0.5, 0.5, 2.0, 2.0])
    support = np.diag([0.0, 0.0, 0.0, 0.0, 2.2, 3.3])
    damping = 0.012 * inertia + np.diag([0.0, 0.0, 0.0, 0.0, 0.03, 0.03])
    damping[2, 3], damping[3, 2] = 0.45 * speed, -0.45 * speed  # the disc's gyroscopic terms

    def matrix(t: float) -> Floats:
        c, s = np.cos(speed * t), np.sin(speed * t)
        turned = np.kron(stiffness, np.eye(2) + 0.12 * np.array([[c, s], [s, -c]]))
        whole = bent.T @ turned @ bent + support
        lower = -np.linalg.solve(inertia, np.hstack([whole, damping]))
        return np.vstack([np.eye(6, 12, 6), lower])

    return matrix


def of_three(soft: float) -> Rotor:
    """Three blades of which one is softer in flap by a share."""
    groups = {"flap": blades.BLADES[:3], "edge": blades.BLADES[3:]}
    return Rotor(
        matrix=partial(three_bladed, soft=soft), channels=blades.CHANNELS, scales=np.ones(10),
        read={"blades": groups, "fixed": blades.FIXED}, between=(0.9, 1.6),
    )  # fmt: skip


ROTORS = {
    "three equal blades": of_three(0.0),
    "three, one soft": of_three(0.1),
    "two blades": Rotor(
        matrix=two_bladed, channels=["ss", "fa", "flap1", "flap2", "edge1", "edge2"],
        scales=np.array([1.0, 1.0, *[RADIUS] * 4]),
        read={"blades": {"flap": ["flap1", "flap2"], "edge": ["edge1", "edge2"]}, "fixed": ["fa", "ss"]},
        between=(1.6, 2.4),
    ),
    "shaft and disc": Rotor(
        matrix=shaft, channels=["x", "y", "tilt x", "tilt y", "housing x", "housing y"], scales=np.ones(6),
        read={"pairs": ["x:y", "housing x:housing y"]}, between=(2.75, 3.25), points=20,
    ),
}  # fmt: skip


def records_of(rotor: Rotor, speed: float, excitation: str, seed: int) -> list[fq.Record]:
    """Free decays after two blows, or one response to white forces on every displacement, with 1 % of noise."""
    period, count = 2.0 * np.pi / speed, 2 * len(rotor.scales)
    whole = stepped(rotor.matrix(speed), period, PHASES)
    steps = [after @ np.linalg.inv(before) for before, after in pairwise(whole)]
    generator = np.random.default_rng([seed, round(1e6 * speed)])
    free, found = excitation == "free", []
    for _ in range(HITS if free else 1):
        samples = (PERIODS[excitation] + (0 if free else WARM)) * PHASES
        state = generator.standard_normal(count) / np.tile(rotor.scales, 2) * free
        forces = np.zeros((samples, count))
        if not free:
            forces[:, count // 2 :] = generator.standard_normal((samples, count // 2)) / rotor.scales
        states = np.empty((samples, count))
        for number in range(samples):
            states[number] = state
            state = steps[number % PHASES] @ state + forces[number]
        values = (states @ rotor.outputs.T).T[:, 0 if free else WARM * PHASES :]
        size = np.abs(values).max(axis=1) if free else values.std(axis=1)
        values = values + NOISE * size[:, None] * generator.standard_normal(values.shape)
        clock, point = fq.ConstantPeriod(period=period), {"speed": speed}
        channels = [fq.Channel(name=name, unit="m") for name in rotor.channels]
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
    sure: int = 0  # wrong links of a confidence from SURE on
    named: int = 0
    edges: int = 0
    held: int = 0
    chi2: float = 0.0
    dof: int = 0
    pulls: list[float] = field(default_factory=list)
    shapes: list[bool] = field(default_factory=list)  # of results that pass: the interval holds the leak or whirl
    mixtures: int = 0  # of these, those that are not determined
    seconds: list[float] = field(default_factory=list)

    def row(self, name: str) -> str:
        """A row of the table."""
        inside = np.mean(np.array(self.pulls) < WITHIN) if self.pulls else np.nan
        cells = (
            name, f"{self.points - self.without - self.failed} of {self.points}", f"{self.found} of {self.true}",
            str(self.false), f"{self.linked} of {self.links}", str(self.sure), f"{self.named} of {self.found}",
            f"{inside:.1%}", f"{sum(self.shapes)} of {len(self.shapes)}",
            str(self.mixtures), f"{self.held} of {self.edges}", f"{self.chi2:.0f} of {self.dof}",
            f"{np.median(self.seconds):.1f}, {max(self.seconds):.1f}",
        )  # fmt: skip
        return f"| {' | '.join(cells)} |"


HEAD = (
    "| rotor, excitation | passed | modes found | false | links right | wrong and sure | names right | "
    "exponents within 95 % | leak or whirl within 95 % | of these not determined | edges within 95 % | "
    "χ² to the truth | s a record: median, most |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|"
)


def matched(point: Point, truth: Point) -> tuple[dict[int, tuple[int, list[float]]], int, int]:
    """True modes that are found, by the model's upper modes, with errors over deviations; how many both sides have.

    Of true modes that are near each other modulo iω shapes tell which it is. Two real multipliers of a lock are one
    mode, by that which grows.
    """
    seen, known = objects_of((point, truth))
    macs = np.array([[similarities(own, other).max() for own in known] for other in seen])
    grows = [int(own.exponents.real.argmax()) for own in seen]
    one = np.array([own.exponents[k] for own, k in zip(seen, grows, strict=True)])
    other = np.array([max(own.exponents, key=np.real) for own in known])
    fundamental = known[0].fundamental
    gaps = [np.subtract.outer(lam, other) for lam in (one, one.conj())]
    gaps = [gap.real + 1j * wrapped(gap.imag, fundamental) for gap in gaps]
    gap = np.where(np.abs(gaps[0]) <= np.abs(gaps[1]), *gaps)
    far = np.abs(gap) / (FALSE * fundamental)
    rows, columns = linear_sum_assignment(np.minimum(far, 2.0) + 1.0 - macs)
    pairs = {}
    for row, column in zip(rows, columns, strict=True):
        if far[row, column] < 1.0:
            own, error = seen[row], complex(gap[row, column])
            std = np.sqrt(np.diag(own.covariance))[[grows[row], grows[row] + len(own.modes)]].tolist()
            pulls = [abs(part) / size for part, size in zip((error.real, error.imag), std, strict=True) if size > 0.0]
            pairs[own.modes[0]] = (known[column].modes[0], pulls)
    return pairs, len(seen), len(known)


def judge(counts: Counts, found: Survey, known: Survey, finer: int = FINER) -> None:
    """Count what a survey has of the `known` one, which has more points: those between say which mode is which."""
    of_track = {
        (int(point) // finer, int(mode)): number
        for number, track in enumerate(known.tracks)
        for point, mode in zip(track.points, track.modes[:, 0], strict=True)
        if point % finer == 0
    }
    met: list[dict[int, int]] = []
    for number, (point, true) in enumerate(zip(found.points, known.points[::finer], strict=True)):
        counts.points += 1
        met.append({})
        if point.model is None:
            counts.without += 1
            counts.true += len(objects_of((true,))[0])
            continue
        counts.failed += not point.passed
        pairs, seen, there = matched(point, true)
        counts.true += there
        counts.found += len(pairs)
        counts.false += seen - len(pairs)
        for mode, (own, pulls) in pairs.items():
            met[-1][mode] = of_track.get((number, own), -1)
            counts.named += point.names[mode].split(":")[0] == true.names[own].split(":")[0]
            counts.pulls += pulls
            if point.passed:
                off_shape(counts, point, mode, true, own)
    for link in found.links:
        track = found.tracks[link.track]
        place = int(np.flatnonzero(track.points == link.between[0])[0])
        ends = [met[int(track.points[k])].get(int(track.modes[k, 0])) for k in (place, place + 1)]
        counts.links += None not in ends
        counts.linked += None not in ends and ends[0] == ends[1]
        counts.sure += None not in ends and ends[0] != ends[1] and link.confidence >= SURE
    for edge in known.edges:
        low, high = found.values[[0, -1]]
        step = (high - low) / (len(found.points) - 1)
        near = [own for own in found.edges if own.value is not None and abs(own.value - edge.value) < step]
        counts.edges += 1
        counts.held += any(own.interval[0] <= edge.value <= own.interval[1] for own in near)


def off_shape(counts: Counts, point: Point, mode: int, true: Point, own: int) -> None:
    """Count a leak, or else a whirl, of a mode by its interval; to the rounding of the truth."""
    if point.leak_interval is not None and point.blades is not None and true.blades is not None:
        (low, high), std, truth = point.leak_interval[mode], point.blades[mode, 2], true.blades[own, 1]
    elif point.whirl_interval is not None and point.whirl is not None and true.whirl is not None:
        (low, high), std, truth = point.whirl_interval[mode], point.whirl[mode, 1], true.whirl[own, 0]
    else:
        return
    counts.shapes.append(bool(low - ROUNDING <= truth <= high + ROUNDING))
    counts.mixtures += not np.isfinite(std)


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


def surveyed(rotor: Rotor, excitation: str, seeds: Sequence[int], points: int | None = None) -> list[Counts]:
    """Surveys of records of a rotor at the first speeds, one a seed, held against that of the rotor itself.

    The counts of every third speed follow those of all of them, where that leaves enough.
    """
    all_of_them, thinned = Counts(), Counts()
    speeds = np.linspace(*rotor.between, rotor.points)[:points]
    between = (float(speeds[0]), float(speeds[-1]))
    finer = FINER * (len(speeds) - 1) + 1
    known = fq.survey(rotor.modes, over="speed", between=between, points=finer, **rotor.read)
    for seed in seeds:
        results = []
        for speed in speeds:
            records = records_of(rotor, float(speed), excitation, seed)
            results.append(identified(records, excitation, all_of_them))
            sys.stderr.write(f"{excitation} {speed:.3f}: {all_of_them.seconds[-1]:.1f} s a record\n")
            if isinstance(results[-1], fq.Analysis) and results[-1].passed:
                compared = fq.compare(results[-1], rotor.modes(float(speed)))
                all_of_them.chi2 += compared.chi2 or 0.0
                all_of_them.dof += compared.dof
        begin = process_time()
        found = fq.survey(results, over="speed", **rotor.read)
        ended = process_time()
        with TemporaryDirectory() as folder:
            fq.report(found, Path(folder) / "report.html")
        sys.stderr.write(f"survey {ended - begin:.1f} s, page {process_time() - ended:.1f} s\n")
        judge(all_of_them, found, known)
        if len(speeds) > 2 * POINTS:
            thinned.seconds = all_of_them.seconds
            few = fq.survey(results[::THIRD], over="speed", **rotor.read)
            few_known = fq.survey(known.points[: (len(speeds) - 1) // THIRD * THIRD * FINER + 1], over="speed")
            judge(thinned, few, replace(few_known, edges=()), FINER * THIRD)
            sys.stderr.write("\n".join(few.warnings) + "\n")
    return [all_of_them, *([thinned] if thinned.points else [])]


def edges(draws: int) -> str:
    """How far edges of drawn modes are off: of locks at three steps, and of the paper's rotor at two."""
    truth = np.array([*locks.LOCKED, *locks.TOGETHER])
    lines = []
    for step in (0.3, 0.4, 0.5):
        speeds = np.arange(17.6, 25.01, step)
        drawn = [
            [
                Point(values={"speed": v}, model=locks.known(v, std=0.002, shape_std=0.01, seed=1000 * seed + k))
                for k, v in enumerate(speeds)
            ]
            for seed in range(draws)
        ]
        lines.append(edges_of(drawn, truth, f"two locks, steps of {step:g}"))
    known = fq.survey(paper_modes, over="speed", between=(0.70, 0.92), points=89, edge_tolerance=1e-9)
    truth = np.array([edge.value for edge in known.edges])
    for every in (2, 4):
        points = known.points[::every]
        drawn = [[noisy(point, 1000 * seed + k) for k, point in enumerate(points)] for seed in range(draws)]
        lines.append(edges_of(drawn, truth, f"paper's rotor, deviations of 2e-5, steps of {0.0025 * every:g}"))
    return "\n".join(lines)


def paper_modes(speed: float) -> floquet.FloquetModes:
    """The modes of the paper's rotor."""
    rotor = fq.systems.JeffcottRotor(speed=speed)
    matrix = floquet.FunctionMatrix(function=rotor.system, period=rotor.period, vectorised=True)
    return floquet.modes(matrix, outputs=np.eye(2, 4), channels=["X", "Y"])


def noisy(point: Point, seed: int, std: float = 2e-5) -> Point:
    """A point with errors of one deviation in each part of each exponent; real multipliers stay real."""
    model, generator = point.model, np.random.default_rng(seed)
    assert model is not None
    lam, size = np.array(model.exponents), np.zeros((2, model.order))
    for mode in model.upper_modes:
        partner = int(np.abs(model.exponents - model.exponents[mode].conj()).argmin())
        size[:, [mode, partner]] = [[std], [0.0 if model.real[mode] else std]]
        error = generator.standard_normal(2) * size[:, mode]
        lam[mode] += complex(*error)
        if not model.real[mode]:
            lam[partner] = lam[mode].conj()
    return replace(point, model=replace(model, exponents=lam, covariance=np.diag(size.ravel() ** 2)))


def edges_of(drawn: Sequence[Sequence[Point]], truth: Floats, name: str) -> str:
    """A line on the edges of surveys of drawn points: errors, intervals that hold, and those within 3 deviations."""
    errors, pulls, held = [], [], 0
    for points in drawn:
        for edge in fq.survey(points, over="speed").edges:
            value = np.mean(edge.interval) if edge.value is None else edge.value
            true = truth[np.abs(truth - value).argmin()]
            held += edge.interval[0] <= true <= edge.interval[1]
            if edge.value is not None:
                errors.append(edge.value - true)
                pulls.append(abs(errors[-1]) / edge.std)
    rms = np.sqrt(np.mean(np.square(errors)))
    return (
        f"{name}: {len(errors)} of {len(truth) * len(drawn)} edges, rms error {rms:.1e}, "
        f"interval holds {held}, within 3 deviations {np.sum(np.array(pulls) < 3.0)}"
    )


def phases(speeds: Sequence[float] = (0.5, 0.55, 0.6, 0.65, 0.95)) -> str:
    """How well phase zero is found of outputs alone that begin at any sample: of the paper's rotor, damped more."""
    samples, lines, tracks = 16, [], []
    for begins in ([0] * len(speeds), [3, 8, 13, 2, 12]):
        results, off, macs = [], [], []
        for number, (speed, begin) in enumerate(zip(speeds, begins, strict=True)):
            rotor = fq.systems.JeffcottRotor(speed=speed, damping=0.02)
            steps = [
                after @ np.linalg.inv(one) for one, after in pairwise(stepped(rotor.system, rotor.period, samples))
            ]
            generator, state, states = np.random.default_rng(number), np.zeros(4), []
            for k in range(461 * samples):
                states.append(state[:2])
                state = steps[k % samples] @ state + np.append([0.0, 0.0], generator.standard_normal(2))
            values = np.array(states[60 * samples + begin :][: 400 * samples]).T
            values = values + NOISE * values.std(axis=1, keepdims=True) * generator.standard_normal(values.shape)
            clock, rate = fq.ConstantPeriod(period=rotor.period), samples / rotor.period
            record = fq.Record(values=values, sample_rate=rate, channels=["X", "Y"], clock=clock)
            results.append(fq.identify(record.with_point({"speed": speed}), excitation="ambient"))
            compared = fq.compare(results[-1], rotor)
            off.append((compared.points[0].turn + begin / samples + 0.5) % 1.0 - 0.5)
            macs += [pair.mac for pair in compared.pairs]
        tracks.append(fq.survey(results, over="speed").tracks)
        lines.append(f"phase zero off by {np.abs(off).max():.3f} periods at most, mac {min(macs):.4f} at least")
    same = all(np.array_equal(one.modes, other.modes) for one, other in zip(*tracks, strict=True))
    return "\n".join([*lines, f"the survey has {'the same' if same else 'other'} links"])


def command() -> str:
    """The time of `floquid survey` over a folder of the shaft's records."""
    rotor = ROTORS["shaft and disc"]
    with TemporaryDirectory() as folder:
        count = 0
        for speed in np.linspace(*rotor.between, rotor.points):
            for record in records_of(rotor, float(speed), "free", 0):
                fq.write(record, Path(folder) / f"run{count:02d}.npz")
                count += 1
        words = [sys.executable, "-m", "floquid", "survey", folder, "--over", "speed", "--pairs", "x:y"]
        begin, before = perf_counter(), getrusage(RUSAGE_CHILDREN).ru_utime
        run([*words, "--out", str(Path(folder) / "survey")], check=True, capture_output=True)
        busy, waited = getrusage(RUSAGE_CHILDREN).ru_utime - before, perf_counter() - begin
    return f"{count} records of {len(rotor.channels)} channels: {waited:.0f} s, {busy:.0f} s of processor"


def main(arguments: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.surveyed", description=__doc__)
    parser.add_argument("--only", choices=ROTORS, action="append", help="a rotor")
    parser.add_argument("--excitation", choices=PERIODS, action="append", help="free decays, or outputs alone")
    parser.add_argument("--seeds", type=int, default=1, help="surveys of each")
    parser.add_argument("--points", type=int, default=None, choices=range(3, 21), help="the lowest speeds")
    parser.add_argument("--edges", type=int, default=0, help="draws whose edges are found, instead")
    parser.add_argument("--command", action="store_true", help="time `floquid survey` instead")
    parser.add_argument("--phases", action="store_true", help="records of outputs alone that begin anywhere, instead")
    parser.add_argument("--profile", action="store_true", help="the time of the first point alone, by function")
    options = parser.parse_args(arguments)
    if options.edges or options.command or options.phases:
        told = command() if options.command else phases() if options.phases else edges(options.edges)
        sys.stdout.write(told + "\n")
        return 0
    sys.stdout.write("" if options.profile else f"{HEAD}\n")
    for name in options.only or ROTORS:
        rotor = ROTORS[name]
        for excitation in options.excitation or PERIODS:
            if options.profile:
                records, profile = records_of(rotor, rotor.between[0], excitation, 0), cProfile.Profile()
                profile.runcall(identified, records, excitation, Counts())
                pstats.Stats(profile, stream=sys.stdout).sort_stats("cumulative").print_stats(60)
                continue
            words = "free decays" if excitation == "free" else "outputs alone"
            for counts in surveyed(rotor, excitation, range(options.seeds), options.points):
                sys.stdout.write(counts.row(f"{name}, {words}, {counts.points} points") + "\n")
            sys.stdout.flush()
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
