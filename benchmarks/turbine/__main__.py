"""Two masses under coloured forces and lines of 1P and 3P, from their outputs alone: how often it is right."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from tests.driven import coloured, excitations, pulls, two_masses
from threadpoolctl import threadpool_limits

from floquid import IdentificationError, Record, identify

PERIODS, PHASES, NOISE = 400, 20, 0.02
LASTING = 0.2
"""The decay below which a mode is the system's [1/s]: its own have 0.025 and 0.06, the forces 0.5."""

OFF = 5.0
"""Deviations from which on an exponent is wrong."""

WITHIN = 1.96
"""Deviations of a 95 % interval."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """What came of one draw.

    `outcome` is "passed", "failed" or "refused". `modes` counts those that last, of which the system has two; `named`
    of the `others` are told to be the excitation's, maybe, and `misnamed` of those that last. `damping` and
    `frequency` are the deviations by which Re λ and Im λ of each that lasts are off the nearest true one.
    """

    seed: int
    outcome: str
    order: int = 0
    modes: int = 0
    others: int = 0
    named: int = 0
    misnamed: int = 0
    damping: tuple[float, ...] = ()
    frequency: tuple[float, ...] = ()
    against: tuple[str, ...] = ()
    seconds: float

    @property
    def right(self) -> bool:
        """Whether it passed with the system's modes alone, and names all poles of the excitation and no other."""
        named = self.named == self.others and not self.misnamed
        return self.outcome == "passed" and self.modes == 2 and self.worst < OFF and named

    @property
    def worst(self) -> float:
        """The most deviations by which a mode that lasts is off."""
        return max((*self.damping, *self.frequency), default=0.0)

    def __str__(self) -> str:
        return (
            f"{self.seed}: {self.outcome}, order {self.order}, {self.modes} lasting modes, {self.named} of "
            f"{self.others} others named, {self.worst:.2f} deviations off at most, {self.seconds:.1f} s"
            + "".join(f", {code}" for code in self.against)
        )


def record_of(seed: int) -> Record:
    """The outputs of one draw."""
    system = two_masses()
    values = coloured(system, PERIODS, PHASES, NOISE, seed)
    return Record(values=values, sample_rate=PHASES / system.period, channels=["tower", "blade"])


def judged(seed: int) -> Row:
    """The row of one draw, identified on one thread as a user would."""
    system, record = two_masses(), record_of(seed)
    begin = time.process_time()
    try:
        with threadpool_limits(limits=1):
            found = identify(record, period=system.period, excitation="ambient")
    except IdentificationError:
        return Row(seed=seed, outcome="refused", seconds=time.process_time() - begin)
    seconds, model = time.process_time() - begin, found.model
    upper = np.array(model.upper_modes)
    lasting = np.abs(model.exponents[upper].real) < LASTING
    told = excitations(found)
    named = np.array([one in told for one in (np.abs(model.exponents[upper]) / (2.0 * np.pi)).tolist()])
    off = pulls(system, model)[upper[lasting]]
    return Row(
        seed=seed,
        outcome="passed" if found.passed else "failed",
        order=model.order,
        modes=int(lasting.sum()),
        others=int((~lasting).sum()),
        named=int(named[~lasting].sum()),
        misnamed=int(named[lasting].sum()),
        damping=tuple(off[:, 0].tolist()),
        frequency=tuple(off[:, 1].tolist()),
        against=tuple(sorted({own.code for own in found.findings if own.severity.name == "FAILURE"})),
        seconds=seconds,
    )


def table(rows: Sequence[Row]) -> str:
    """Counts, and of the models that passed the share of 95 % intervals that hold the truth; seconds of all."""
    passed = [row for row in rows if row.outcome == "passed"]
    orders = sorted({row.order for row in passed})
    lines = [
        ("passed", f"{len(passed)} of {len(rows)}"),
        ("their orders", ", ".join(f"{n}: {sum(row.order == n for row in passed)}" for n in orders)),
        ("with the system's two modes", f"{sum(row.modes == 2 for row in passed)}"),
        ("all poles of the excitation named", f"{sum(row.named == row.others for row in passed)}"),
        ("a mode of the system named so", f"{sum(row.misnamed > 0 for row in passed)}"),
    ]
    for name in ("frequency", "damping"):
        off = np.array([one for row in passed for one in getattr(row, name)])
        if off.size:
            inside = np.count_nonzero(off < WITHIN)
            words = f"{inside} of {off.size} ({inside / off.size:.0%}), rms {np.sqrt(np.mean(off**2)):.2f}"
            lines.append((f"{name}: 95 % intervals that hold", f"{words}, largest {off.max():.1f}"))
    middle, most, worst = np.quantile([row.seconds for row in rows], [0.5, 0.9, 1.0])
    lines.append(("seconds: median, nine of ten, most", f"{middle:.0f}, {most:.0f}, {worst:.0f}"))
    lines.append(("not right", ", ".join(str(row.seed) for row in rows if not row.right) or "none"))
    head = (("draws", f"{rows[0].seed} to {rows[-1].seed}"), ("---", "---"))
    return "\n".join(f"| {name} | {value} |" for name, value in (*head, *lines))


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.turbine", description=__doc__)
    parser.add_argument("--draws", type=int, default=100, help="records that differ in their forces and noise")
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--out", type=Path, help="a JSON file, written anew after every draw")
    options = parser.parse_args(arguments)
    if options.draws < 1 or options.jobs < 1:
        parser.error("--draws and --jobs are 1 or more")
    rows: list[Row] = []
    with ProcessPoolExecutor(options.jobs) as pool:
        for row in pool.map(judged, range(options.first, options.first + options.draws)):
            rows.append(row)
            sys.stderr.write(f"{row}\n")
            if options.out is not None:
                options.out.parent.mkdir(parents=True, exist_ok=True)
                text = json.dumps([{**asdict(each), "right": each.right} for each in rows], indent=1)
                options.out.write_text(text + "\n", encoding="utf-8")
    sys.stdout.write(table(rows) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
