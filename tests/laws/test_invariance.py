"""Units of the channels, and finer fits of trials, change no answer: free responses, measured inputs, outputs alone."""

import numpy as np
import pytest
from tests.driven import ambient_of, creeping, mathieu, mathieu_and_lag, paper_rotor, record_of, two_masses

from floquid import ConstantPeriod, InputError, Record, identify, measure_transfer
from floquid.innovations import _solve as ambient_fits
from floquid.innovations.search import _search as ambient_search
from floquid.inputs.search import _bands as driven_fits
from floquid.periodic.search import Point
from floquid.preparation import propose

FREE = {"rotor": (paper_rotor(), 30), "lag": (mathieu_and_lag(), 10), "masses": (two_masses(), 12)}
DRIVEN = {"masses": two_masses(), "lag": mathieu_and_lag(), "creeping": creeping(0.0145)}


def free(name, seed):
    system, periods = FREE[name]
    generator = np.random.default_rng(seed)
    silence = np.zeros((system.B(0.0).shape[1], 32 * periods))
    values = system.response(silence, 32, generator.standard_normal(len(system.A(0.0))))
    values += 0.01 * values.std(axis=1, keepdims=True) * generator.standard_normal(values.shape)
    return system, values, 32, {}


def driven(name, seed):
    system = DRIVEN[name]
    values, forces = record_of(system, 60, 20, 0.02, seed)
    names = [f"y{len(values) + number}" for number in range(len(forces))]
    return system, np.concatenate([values, forces]), 20, {"inputs": names}


def ambient(name, seed):
    """Mathieu's equation beside a channel of noise: a mode of that noise stayed in 1 of 4 draws, in other units."""
    system = creeping(0.0145) if name == "creeping" else mathieu()
    values = ambient_of(system, 250, 16, 0.02, seed if name == "creeping" else 0)
    if name == "noise":
        values = np.concatenate([values, np.random.default_rng(seed).standard_normal(values.shape)])
    return system, values, 16, {"excitation": "ambient"}


CASES = [
    *[pytest.param(free, name, seed, id=f"free-{name}-{seed}") for name in FREE for seed in range(2)],
    *[pytest.param(driven, name, seed, id=f"driven-{name}-{seed}") for name in DRIVEN for seed in range(2)],
    *[pytest.param(ambient, "noise", seed, id=f"ambient-noise-{seed}") for seed in range(1, 5)],
    *[pytest.param(ambient, "creeping", seed, id=f"ambient-creeping-{seed}") for seed in range(3)],
]
"""The first of them is for every day: outputs alone take six seconds."""


def record_from(system, values, phases):
    names = [f"y{number}" for number in range(len(values))]
    clock = ConstantPeriod(period=system.period)
    return Record(values=values, sample_rate=phases / system.period, channels=names, clock=clock)


def identified(system, values, phases, options):
    return identify(record_from(system, values, phases), validate=False, **options)


def gap(one, other):
    """The largest distance of exponents over their deviations."""
    assert one.model.order == other.model.order
    apart, std = one.model.exponents - other.model.exponents, one.model.exponent_std
    parts = np.abs([apart.real, apart.imag]) / np.array([std.real, np.where(std.imag > 0.0, std.imag, np.inf)])
    assert [finding.code for finding in one.findings] == [finding.code for finding in other.findings]
    return float(parts.max())


@pytest.mark.first(1)
@pytest.mark.parametrize(("of", "name", "seed"), CASES)
def test_units_of_the_channels_change_nothing(of, name, seed):
    system, values, phases, options = of(name, seed)
    size = np.where(np.arange(len(values)) % 2, 1.0, 1e6)[:, None]
    own, large = (identified(system, by * values, phases, options) for by in (1.0, size))
    assert gap(own, large) < 1e-5


def small(kind):
    """Mathieu's equation, quickly identified."""
    system, generator = mathieu(), np.random.default_rng(1)
    if kind == "ambient":
        return system, ambient_of(system, 150, 16, 0.02, 0), {"excitation": "ambient"}
    forces = generator.standard_normal((1, 800)) * (kind == "inputs")
    values = system.response(forces, 16, np.ones(2))
    values += 0.01 * values.std() * generator.standard_normal(values.shape)
    return (system, np.concatenate([values, forces]), {"inputs": ["y1"]}) if forces.any() else (system, values, {})


@pytest.mark.parametrize("kind", ["free", "inputs", "ambient"])
def test_any_unit_will_do_whose_squares_can_be_computed_with(kind):
    """Before: single precision overflowed for inputs of 1e-18, outputs alone of 1e-200 ended in an assertion."""
    system, values, options = small(kind)
    sizes = np.array([[1e70], [1e-70]])[: len(values)]
    assert gap(*(identified(system, by * values, 16, options) for by in (1.0, sizes))) < 1e-6
    for by in (1e-200, 1e-100, 1e100, 1e160):
        with pytest.raises(InputError, match=r"squares can be computed with.*'y0' of record 1 reaches"):
            identified(system, by * values, 16, options)


def test_each_input_may_have_a_unit_of_its_own():
    """The rough steps overflowed for inputs of 1e10 and 1e-10 together."""
    system, generator = two_masses(), np.random.default_rng(0)
    forces = generator.standard_normal((2, 480))
    values = system.response(forces, 8)
    values += 0.01 * values.std() * generator.standard_normal(values.shape)
    units = np.array([[1e10], [1e-10]])
    records = (np.concatenate([values, by * forces]) for by in (1.0, units))
    assert gap(*(identified(system, own, 8, {"inputs": ["y2", "y3"]}) for own in records)) < 1e-6


def test_records_in_other_units_are_measured_and_proposed_alike():
    """Before: an overflow in the proposal, which could be none of outputs of 1e-200."""
    system, values, options = small("inputs")
    with pytest.raises(InputError, match="squares can be computed with"):
        measure_transfer(record_from(system, 1e160 * values, 16), **options)
    system, values, options = small("ambient")
    for by in (1e-200, 1.0, 1e160):
        assert propose(record_from(system, by * values, 16)).settings == options


@pytest.mark.first(1)
@pytest.mark.parametrize(("of", "name", "seed"), CASES)
def test_trials_that_are_fitted_finer_change_nothing(of, name, seed, monkeypatch):
    """The search is not over where a fit is: how far trials are fitted must not decide which of them are kept."""
    case = of(name, seed)
    own = identified(*case)
    for fits, finer in ((ambient_fits, 10), (ambient_search, 4), (driven_fits, 4)):
        monkeypatch.setattr(fits, "FEW_STEPS", finer * fits.FEW_STEPS)
    for fits in (ambient_fits, driven_fits):
        monkeypatch.setattr(fits, "REST", 0.1 * fits.REST)
    rest = Point.settled.__kwdefaults__
    monkeypatch.setattr(
        Point.settled, "__kwdefaults__", rest | {"steps": 4 * rest["steps"], "rest": 0.1 * rest["rest"]}
    )
    assert gap(own, identified(*case)) < 1e-2
