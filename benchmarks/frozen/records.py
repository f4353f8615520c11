"""The records: cases of the other benchmarks and of the tests, by name, each with its seeds and its kind."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from benchmarks.adversary.run import case_of as adversary
from benchmarks.chain import records as chain
from benchmarks.chain.case import Case
from benchmarks.drawn.__main__ import drawn, inputs_of, record_of_draw
from benchmarks.methods import records as methods
from benchmarks.order.cases import system_of
from benchmarks.turbine.__main__ import record_of as turbine_record
from numpy.typing import NDArray
from tests.driven import (
    creeping,
    engine_record,
    flapping,
    lag,
    mathieu,
    mathieu_and_lag,
    paper_rotor,
    shaken,
    two_masses,
)

import floquid
from floquid import Record

NOISE = 0.01
"""The noise of the cases of the chain, a share of the largest free response."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Chain:
    """A way to identify records of one kind.

    Parameters
    ----------
    identify
        The result of a case, with a `model` and `findings`.
    module, function
        The linearisation that is counted, by the name of its module and its own.
    """

    identify: Callable[[Case], object]
    module: str
    function: str


CHAINS: Mapping[str, Chain] = {
    "free": Chain(
        identify=lambda case: floquid.identify(list(case.records), **case.options),
        module="floquid.periodic.least_squares._solver",
        function="eliminated",
    ),
    "inputs": Chain(
        identify=lambda case: floquid.identify(list(case.records), **case.options),
        module="floquid.inputs._solver",
        function="linearise",
    ),
    "ambient": Chain(
        identify=lambda case: floquid.identify(list(case.records), **case.options, excitation="ambient"),
        module="floquid.innovations._solve",
        function="normal_of",
    ),
    "lines": Chain(
        identify=lambda case: floquid.fit_transfer(floquid.measure_transfer(list(case.records), **case.options)),
        module="floquid.transfer._modal",
        function="eliminated",
    ),
}
"""How each kind of record is identified, and what is counted meanwhile: a function that moves is a line here."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Frozen:
    """A record: how it is made of a seed, which seeds are frozen, and what it may take.

    Parameters
    ----------
    kind
        The key of its chain.
    make
        The case of a seed.
    seeds
        Of the draws that are frozen.
    limit
        Processor seconds after which an identification is ended.
    """

    kind: str
    make: Callable[[int], Case]
    seeds: tuple[int, ...] = (0,)
    limit: float = 60.0


def known(
    records: tuple[Record, ...], period: float, exponents: NDArray[np.complex128], options: dict[str, object]
) -> Case:
    """The case of records of a system all of whose modes must be found."""
    must = np.ones(len(exponents), bool)
    return Case(records=records, period=period, exponents=np.asarray(exponents), must=must, options=options)


def of_methods(case: methods.Case, seed: int) -> Case:
    """A case of the benchmark of methods with the noise of a seed."""
    case = replace(case, seed=seed)
    record = case.record()
    options = {"inputs": inputs_of(record)} if case.kind == "driven" else {}
    return known((record,), case.system.period, case.system.exponents(), options)


def at_lock(depth: float) -> Callable[[int], Case]:
    """The free response of a damped oscillator at half the fundamental, at the edge of its lock.

    `depth` is the variation of the stiffness: beyond 0.007 the pair is two real multipliers.
    """
    system = replace(mathieu(), A=lambda t: np.array([[0.0, 1.0], [-(1.0072 + 2.0 * depth * np.cos(2.0 * t)), -0.03]]))
    case = methods.Case(kind="free", name="lock", system=system, periods=80, phases=16, noise=NOISE, depth=12)
    return partial(of_methods, case)


def driven(system, periods: int, phases: int, noise: float) -> Callable[[int], Case]:
    """White measured inputs on a system of the tests."""
    case = methods.Case(
        kind="driven", name="", system=system, periods=periods, phases=phases, noise=noise, depth=phases
    )
    return partial(of_methods, case)


def engine(name: str) -> Callable[[int], Case]:
    """A record of the tests' data with noise."""

    def make(seed: int) -> Case:
        record, period, exponents, inputs = engine_record(name, NOISE, seed)
        options = {"inputs": inputs} if inputs else {}
        return known((record,), period, exponents, options | {"period": period})

    return make


def of_drawn(excitation: str) -> Callable[[int], Case]:
    """A system drawn at random, with measured inputs or of outputs alone."""

    def make(seed: int) -> Case:
        draw = drawn(seed, excitation)
        record, period = record_of_draw(draw, seed, excitation), draw.system.period
        options = {"inputs": inputs_of(record)} if excitation == "inputs" else {}
        return known((record,), period, draw.system.exponents(), options | {"period": period})

    return make


def of_order(name: str) -> Callable[[int], Case]:
    """A random system of the benchmark of the order; its bounds say what must be found."""

    def make(seed: int) -> Case:
        system = system_of(name, seed)
        must = np.all([each.must for each in system.findable()], axis=0)
        case = known(tuple(system.records()), system.truth.period, system.truth.exponents, {})
        return replace(case, must=must)

    return make


def turbine(seed: int) -> Case:
    """Two masses under coloured forces and lines; poles of the forces are modes of the record, too."""
    system = two_masses()
    return known((turbine_record(seed),), system.period, system.exponents(), {"period": system.period})


def lines(system, phases: int, turns: int, noise: float) -> Callable[[int], Case]:
    """Modes of transfer functions measured line by line: five repeats of a multisine."""

    def make(seed: int) -> Case:
        _, record, names = shaken(system, phases, turns, 5, noise, seed, spare=0.0)
        return known((record,), system.period, system.exponents(), {"inputs": names, "harmonics": np.arange(-3, 4)})

    return make


def of_chain(name: str, *seeds: int) -> Frozen:
    """A record of the chain."""
    return Frozen(kind="free", make=partial(chain.RECORDS[name], NOISE), seeds=seeds or (0, 1))


def of_adversary(name: str, *seeds: int) -> Frozen:
    """A record of the adversary."""
    return Frozen(kind="free", make=partial(adversary, name), seeds=seeds or (0, 1))


RECORDS: dict[str, Frozen] = {
    # Outputs alone first: they take longest, and two processes end together when the short ones are last.
    "ambient, engine's rotor": Frozen(kind="ambient", make=engine("ambient_rotor"), limit=120.0),
    "ambient, turbine": Frozen(kind="ambient", make=turbine, limit=120.0),
    "ambient, drawn": Frozen(kind="ambient", make=of_drawn("ambient"), seeds=(0, 2, 3)),
    "ambient, Mathieu": Frozen(
        kind="ambient", make=partial(of_methods, methods.CASES["ambient, Mathieu"]), seeds=(0, 1)
    ),
    "ambient, weak": Frozen(
        kind="ambient", make=partial(of_methods, methods.CASES["ambient, Mathieu, q = 0.05"]), seeds=(0, 1)
    ),
    "ambient, rotor": Frozen(kind="ambient", make=partial(of_methods, methods.CASES["ambient, rotor"])),
    "inputs, engine under gravity": Frozen(kind="inputs", make=engine("driven_rotor_gravity")),
    "inputs, engine by hammer": Frozen(kind="inputs", make=engine("driven_rotor_hits")),
    "inputs, pumped circuit": Frozen(kind="inputs", make=engine("driven_circuit"), seeds=(0, 1)),
    "inputs, drawn": Frozen(kind="inputs", make=of_drawn("inputs"), seeds=tuple(range(6))),
    "inputs, Mathieu": Frozen(
        kind="inputs", make=partial(of_methods, methods.CASES["driven, Mathieu, 60 periods"]), seeds=(0, 1)
    ),
    "inputs, rotor": Frozen(kind="inputs", make=partial(of_methods, methods.CASES["driven, rotor"])),
    "inputs, flapping": Frozen(kind="inputs", make=driven(flapping(), 120, 24, 0.02), seeds=(0, 1)),
    "inputs, lag": Frozen(kind="inputs", make=driven(lag(), 120, 20, 0.02), seeds=(0, 1)),
    "inputs, pair and lag": Frozen(kind="inputs", make=driven(mathieu_and_lag(), 160, 20, 0.02), seeds=(0, 1)),
    "inputs, two masses": Frozen(kind="inputs", make=driven(two_masses(), 120, 20, 0.02), seeds=(0, 1)),
    "inputs, pair near its axis": Frozen(kind="inputs", make=driven(creeping(0.0149), 120, 16, 0.02), seeds=(0, 1)),
    "inputs, two real near": Frozen(kind="inputs", make=driven(creeping(0.0141), 120, 16, 0.02), seeds=(0, 1)),
    "lines, Mathieu": Frozen(kind="lines", make=lines(mathieu(), 20, 64, 0.05), seeds=(0, 1)),
    "lines, lag": Frozen(kind="lines", make=lines(lag(), 20, 64, 0.05), seeds=(0, 1)),
    "lines, flapping": Frozen(kind="lines", make=lines(flapping(), 40, 64, 0.01), seeds=(0, 1)),
    "lines, pair and lag": Frozen(kind="lines", make=lines(mathieu_and_lag(), 20, 64, 0.02), seeds=(0, 1)),
    "lines, two masses": Frozen(kind="lines", make=lines(two_masses(), 24, 64, 0.02), seeds=(0, 1)),
    "lines, rotor": Frozen(kind="lines", make=lines(paper_rotor(), 50, 128, 0.02)),
    **{
        f"free, {name}": of_chain(name)
        for name in (
            "rotor_650rpm",
            "rotor_1900rpm",
            "rotor_650rpm_tach",
            "duffing_orbit",
            "paper_wander",
            "paper_imbalance",
            "paper_gaps",
            "paper_dropouts",
            "paper_out_of_step_both",
            "turbine_orbit",
            "two_real",
            "two_close_lifted",
            "two_close_out_of_step",
            "coloured_sync_orbit",
            "coloured_out_of_step",
            "coloured_tach",
            "period_off_lifted_0.001",
            "period_off_out_of_step_3e-05",
            "paper_clean",
        )
    },
    **{f"free, edge of a lock, {depth}": Frozen(kind="free", make=at_lock(depth), seeds=(0, 1, 2))
       for depth in (0.0066, 0.0071, 0.0078)},
    "free, random systems": Frozen(kind="free", make=of_order("random systems"), seeds=(0, 1, 2, 3, 4, 5)),
    "free, five modes in much noise": Frozen(kind="free", make=of_order("5 modes, 20 %"), seeds=(0, 1)),
    **{
        f"adversary, {name}": of_adversary(name)
        for name in (
            "plain",
            "two blows",
            "coloured noise",
            "heavy tails",
            "orbit",
            "hum",
            "gaps",
            "drift",
            "cubic",
            "ambient",
            "clipped",
            "spikes",
            "quiet first",
            "second blow",
            "late channel",
            "AC coupled",
            "out of step",
            "tachometer",
            "exact pulses",
            "azimuth",
        )
    },
}  # fmt: skip
"""Every record by its name."""
