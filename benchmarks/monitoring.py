"""Monitoring measured: false alarms, delay of detection, intervals of the instant of a change, amounts, and time.

`python -m benchmarks.monitoring` prints a table; `--part NAME` measures one part, `--records N` how many records of the
rotor are identified. Features of `false-alarms`, `detection` and `change` are drawn from given covariances.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Callable
from dataclasses import replace
from time import process_time

import numpy as np
from tests.machines import as_point, machine, shapes_of

import floquid as fq
from floquid import floquet
from floquid.core import PeriodicModel
from floquid.monitoring import Monitor
from floquid.shapes import Sidebands, sidebands_of

MODES, RECORDS, BASELINE = 6, 150, 30


def monitored(
    seed: int, change: Callable[[int], float] = lambda _: 0.0, records: int = RECORDS
) -> tuple[Monitor, np.ndarray]:
    """A machine whose features change by `change(record)` times a direction, monitored; and that direction's power.

    The direction is of one deviation in ΔS⁻¹Δ at the mean covariance.
    """
    generator = np.random.default_rng([seed, 1])
    direction = generator.standard_normal(2 * MODES)
    shapes, points, power = shapes_of(seed, MODES), [], []
    drawn = list(machine(seed, records, MODES))
    unit = direction / np.sqrt(direction @ np.linalg.solve(np.mean([own[1] for own in drawn], axis=0), direction))
    for k, (x, covariance, point) in enumerate(drawn):
        step = change(k) * unit
        power.append(step @ np.linalg.solve(covariance, step))
        points.append(as_point(x + step, covariance, point, shapes))
    by_mode = direction.reshape(2, MODES).T.ravel()  # as features are: decay and frequency of each mode
    found = fq.monitor(points, baseline=slice(0, BASELINE), direction=by_mode)
    return found, np.array(power)


def false_alarms(first: int, runs: int) -> str:
    """Alarms of healthy machines, by chart."""
    counts, total, refused = np.zeros(3), 0, 0
    for seed in range(first, first + runs):
        try:
            found, _ = monitored(seed)
        except fq.InputError:
            refused += 1
            continue
        charts = found.charts
        assert charts is not None
        later = ~found.baseline & (charts.leverage <= 1.0)
        total += int(later.sum())
        with np.errstate(invalid="ignore"):
            for k, name in enumerate(("t2", "ewma", "directed")):
                values, limits = getattr(charts, name), getattr(charts, f"{name}_limit")
                counts[k] += np.count_nonzero(later & (values > limits))
    names = ("T²", "MEWMA", "directed")
    rates = ", ".join(f"{name} {100.0 * own:.3f} %" for name, own in zip(names, counts / total, strict=True))
    return f"{total} records of {runs - refused} machines ({refused} baselines refused): {rates} (asked 0.1 %)"


def detection(runs: int) -> str:
    """Records between where the noncentrality passes the limit's 50 % point and the first alarm, of a ramp."""
    delays, directed = [], []
    for seed in range(runs):
        try:
            found, power = monitored(seed, lambda k: 0.35 * max(0, k - 60))
        except fq.InputError:
            continue
        charts = found.charts
        assert charts is not None
        # T² of f degrees has its median at f - 2/3 + power: the limit's 50 % point.
        half = int(np.argmax(power + 2 * MODES - 0.67 > charts.t2_limit))
        late = np.arange(RECORDS) >= 60
        delays.append(int(np.argmax(found.alarm & late)) - half)
        with np.errstate(invalid="ignore"):
            directed.append(int(np.argmax((charts.directed > charts.directed_limit) & late)) - half)
    within = np.mean(np.array(delays) <= 2)
    return (
        f"{len(delays)} ramps: first alarm {np.median(delays):+.0f} records from the 50 % point (median), at most "
        f"{max(delays):+d}, within two in {100.0 * within:.0f} %; directed alone {np.median(directed):+.0f}"
    )


def change(runs: int) -> str:
    """How often the 95 % interval holds the instant of a change, and its width, of steps and ramps of several sizes."""
    out = []
    for name, form in (
        ("step of 3 deviations", lambda k: 3.0 * (k >= 80)),
        ("step of 6 deviations", lambda k: 6.0 * (k >= 80)),
        ("ramp of 0.15 a record", lambda k: 0.15 * max(0, k - 79)),
        ("ramp of 0.5 a record", lambda k: 0.5 * max(0, k - 79)),
    ):
        held, width, missed = [], [], 0
        for seed in range(runs):
            try:
                found, _ = monitored(seed, form)
            except fq.InputError:
                continue
            if found.change is None:
                missed += 1
                continue
            low, high = found.change.interval
            held.append(low <= 80 <= high)
            width.append(high - low)
        out.append(f"{name}: {np.sum(held)} of {len(held)} hold it, width {np.mean(width):.1f}, not found {missed}")
    return "\n    ".join(out)


def rotor(crack: float, speed: float = 0.5) -> fq.systems.JeffcottRotor:
    """The round shaft of the paper's rotor with a crack, on its anisotropic supports."""
    return fq.systems.JeffcottRotor(rotor_x=1.0, rotor_y=1.0 - crack, speed=speed)


def known(crack: float) -> PeriodicModel:
    """The modes of the rotor from its equations."""
    own = rotor(crack)
    matrix, outputs = (
        floquet.FunctionMatrix(function=function, period=own.period, vectorised=True)
        for function in (own.system, own.outputs)
    )
    return floquet.modes(matrix, outputs=outputs, channels=[channel.name for channel in own.channels])


def amounts(records: int) -> str:
    """How often intervals of amounts hold the truth, of identified records of the rotor with several cracks."""
    out, healthy = [], sidebands_of(known(0.0))
    assert healthy is not None
    exact = sidebands_of(known(0.01))
    assert exact is not None
    for crack in (0.0, 0.004, 0.02):
        truth = sidebands_of(known(crack))
        assert truth is not None
        held, errors, amounts_ = [], [], []
        for seed in range(records):
            record = rotor(crack).simulate(n_periods=60, samples_per_period=12, noise=0.01, seed=seed)
            found = sidebands_of(fq.identify(record, order=4, validate=False))
            assert found is not None
            rows = np.array([np.argmin(_off(found.shapes, own)) for own in truth.shapes])
            here, every = found.picked(rows), np.arange(len(rows))
            both, origin = truth.on(here, every), healthy.on(here, every).values
            delta, std = here.along(exact.on(here, every).values - origin, origin)
            errors.append((delta - crack / 0.01) / std)
            own = here.amount()
            real = float(np.sqrt(here.weights @ both.vector**2))
            held.append(own.interval[0] <= real <= own.interval[1])
            amounts_.append(real)
        inside = np.mean(np.abs(errors) <= 1.96)
        out.append(
            f"crack {100.0 * crack:g} %: sidebands {100.0 * np.mean(amounts_):.3f} % of the response, interval holds "
            f"{np.sum(held)} of {records}; along the template within 1.96 deviations {100.0 * inside:.0f} %, "
            f"errors over deviations {np.std(errors):.2f} (mean {np.mean(errors):+.2f}), deviation {std:.3f} % of loss"
        )
    return "\n    ".join(out)


def _off(shapes: np.ndarray, own: np.ndarray) -> np.ndarray:
    """One less the MAC of each of the shapes with another."""
    size = np.linalg.norm(shapes, axis=1) * np.linalg.norm(own)
    return 1.0 - np.abs(shapes.conj() @ own) ** 2 / size**2


def identified(records: int) -> str:
    """Alarms of really identified records of a healthy rotor over speed and temperature, then with a crack."""
    points = []
    generator = np.random.default_rng(0)
    for k in range(records + 10):
        speed, temperature = generator.uniform(0.49, 0.51), generator.uniform(12.0, 28.0)
        soft = 1.0 - 1e-3 * (temperature - 20.0)
        own = fq.systems.JeffcottRotor(
            rotor_y=1.0 - 2e-4 * max(0, k - records + 1), support_x=soft, support_y=2.0 * soft, speed=speed
        )
        record = own.simulate(n_periods=60, samples_per_period=12, noise=0.01, seed=k)
        found = fq.identify(record.with_point({"speed": speed, "temperature": temperature}), order=4, validate=False)
        points.append(found)
    made = fq.monitor(points, baseline=slice(0, 30), covariates=("speed", "temperature"))
    healthy = int(made.alarm[:records].sum())
    first = int(np.argmax(made.alarm[records:]))
    interval = None if made.change is None else made.change.interval
    return (
        f"{healthy} alarms in {records - 30} healthy records; crack growing 0.02 % of stiffness a record from record "
        f"{records}: first alarm {first} later, change in {interval}"
    )


def paper() -> str:
    """Alarms of the paper's rotor, 512 periods with 2 % of noise, in the first record of a loss of 0.02 %."""
    made = []
    for k in range(30):
        own = fq.systems.JeffcottRotor(rotor_y=1.5 * (1.0 - (2e-4 if k >= 20 else 0.0)))
        made.append(fq.identify(own.simulate(n_periods=512, noise=0.02, seed=k), order=4, validate=False))
    charts = fq.monitor(made, baseline=slice(0, 20), covariates=()).charts
    assert charts is not None
    seen = charts.t2[20:] > charts.t2_limit[20:]
    return (
        f"{int(seen.sum())} of 10 records of 0.02 % loss alarm, each alone; T² {np.median(charts.t2[20:]):.0f} (median)"
    )


def time(records: int) -> str:
    """Processor time of monitoring identified records, with their sidebands."""
    shapes = shapes_of(0, MODES)
    generator, size = np.random.default_rng(0), MODES * 3 * 2
    points = []
    for own in machine(0, records, MODES):
        parts = generator.standard_normal((2, MODES, 3, 2))
        sides = Sidebands(
            modes=np.arange(MODES), shapes=shapes[:, :, 0, 1], values=0.01 * (parts[0] + 1j * parts[1]),
            covariance=1e-4 * np.eye(2 * size), shares=np.full(MODES, 1.0 / MODES), noise=np.ones(3),
            channels=("a", "b", "c"),
        )  # fmt: skip
        points.append(replace(as_point(*own, shapes), sidebands=sides))
    begin = process_time()
    fq.monitor(points, baseline=slice(0, BASELINE))
    return f"{records} records of {MODES} modes: {process_time() - begin:.1f} s"


PARTS: dict[str, Callable[[argparse.Namespace], str]] = {
    "false-alarms": lambda options: false_alarms(options.first, options.runs),
    "detection": lambda options: detection(options.runs // 2),
    "change": lambda options: change(options.runs // 2),
    "amounts": lambda options: amounts(options.records),
    "identified": lambda options: identified(options.records),
    "paper": lambda _: paper(),
    "time": lambda options: time(options.long),
}


def main() -> None:
    """Measure the parts asked for, and print them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--part", choices=PARTS, default=None)
    parser.add_argument("--runs", type=int, default=200, help="machines of drawn features")
    parser.add_argument("--first", type=int, default=0, help="the first seed of false-alarms")
    parser.add_argument("--records", type=int, default=100, help="identified records of the rotor")
    parser.add_argument("--long", type=int, default=1000, help="records that are timed")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    for name, part in PARTS.items():
        if options.part in (None, name):
            sys.stdout.write(f"{name}:\n    {part(options)}\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
