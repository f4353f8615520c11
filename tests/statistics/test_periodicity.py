"""How often a constant system is called periodic, and how often the paper's rotor with little asymmetry is not.

Records of constant systems of two to five modes, seen by sensors that stand still, given a period of 16 samples; all
through `identify`. Modes of which one is a whole number of fundamentals from another, nearer than their decays, are one
mode to lifting: those systems are looked at on their own.
"""

import numpy as np
import pytest
from scipy.stats import binom

from floquid import Record, identify
from floquid.core import ConstantPeriod
from floquid.errors import IdentificationError
from floquid.systems import JeffcottRotor

PERIOD = 6.0
OMEGA = 2 * np.pi / PERIOD
PHASES = 16
CYCLES = 100
LEVEL = 0.05
RARE = 1e-3
FIRST = 700_000
"""Of the seeds: none of those that the test was looked at with."""


def folded_gap(exponents):
    """The least distance of two modes modulo the fundamental, conjugates too, over the sum of their decays."""
    both = np.concatenate([exponents, exponents.conj()])
    gaps = np.subtract.outer(both, both)
    gaps = np.abs(gaps.real + 1j * (gaps.imag - OMEGA * np.rint(gaps.imag / OMEGA)))
    gaps /= np.abs(np.add.outer(both.real, both.real))
    return float((gaps + 1e9 * np.eye(len(both))).min())


def constant_system(kind, generator):
    """Exponents: "apart" do not fold onto one another, "any" may; a mode near "half" or near a "whole" fundamental."""
    while True:
        n = int(generator.integers(2, 6))
        turns, decays = generator.uniform(0.1, 6.0, n), generator.uniform(0.005, 0.025, n) * OMEGA
        if kind in ("half", "whole"):
            turns[0] = generator.integers(1, 5) + (0.5 if kind == "half" else 0.0) + generator.uniform(-0.003, 0.003)
        exponents = -decays + 1j * OMEGA * turns
        if kind != "apart" or folded_gap(exponents) > 2.0:
            return exponents


def constant_record(kind, noise, seed):
    generator = np.random.default_rng([seed, *kind.encode()])
    exponents = constant_system(kind, generator)
    shapes = generator.standard_normal((2, len(exponents))) + 1j * generator.standard_normal((2, len(exponents)))
    t = np.arange(PHASES * CYCLES) * PERIOD / PHASES
    values = (shapes @ np.exp(np.multiply.outer(exponents, t))).real
    values += noise * np.abs(values).max(axis=1, keepdims=True) * generator.standard_normal(values.shape)
    return Record(values=values, sample_rate=PHASES / PERIOD, channels=["a", "b"], clock=ConstantPeriod(period=PERIOD))


def called_periodic(kind, noise, seeds):
    """How many of so many records are called periodic; a record that is refused, or not tested, is not counted."""
    found = []
    for seed in range(seeds):
        try:
            result = identify(constant_record(kind, noise, FIRST + seed), validate=False).periodicity
        except IdentificationError:
            continue
        if result is not None:
            found.append(result.periodic is True)
    assert len(found) > 0.8 * seeds
    return sum(found), len(found)


def check(kind, noise, seeds, *, exact):
    called, tested = called_periodic(kind, noise, seeds)
    assert binom.sf(called - 1, tested, LEVEL) > RARE, f"{called} of {tested} constant systems are called periodic"
    if exact:
        assert binom.cdf(called, tested, LEVEL) > RARE, f"{called} of {tested}: the test is timid"


def test_few_constant_systems_are_called_periodic():
    check("apart", 0.02, 40, exact=False)


@pytest.mark.parametrize("noise", [0.02, 0.1])
@pytest.mark.parametrize("kind", ["apart", "any"])
def test_one_in_twenty_constant_systems_is_called_periodic(kind, noise):
    check(kind, noise, 400, exact=kind == "apart")


@pytest.mark.parametrize("kind", ["half", "whole"])
def test_a_mode_near_half_or_a_whole_fundamental_is_not_called_periodic_more_often(kind):
    check(kind, 0.02, 400, exact=False)


@pytest.mark.parametrize("noise", [0.02, 0.1])
@pytest.mark.parametrize("support", [2.0, 1.1])
def test_a_tenth_of_the_papers_asymmetry_is_seen(support, noise):
    """Of the shaft alone, and of shaft and support: seen 95 times in 100 at the least."""
    rotor = JeffcottRotor(rotor_y=1.05, support_y=support)
    found = [identify(rotor.simulate(noise=noise, seed=FIRST + k), validate=False).periodicity for k in range(5)]
    assert binom.cdf(sum(one.periodic is True for one in found), 5, 0.95) > RARE
