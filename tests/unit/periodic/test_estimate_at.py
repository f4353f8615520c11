"""The record linearised anew at given exponents: one Gauss-Newton step, by the lifted record or by its samples."""

from dataclasses import replace

import numpy as np
import pytest

from floquid import identify
from floquid.core import ConstantPeriod, Estimates, Record
from floquid.errors import InputError
from floquid.lifting import lift
from floquid.periodic import estimate_at
from floquid.systems import JeffcottRotor

ROTOR = JeffcottRotor()


@pytest.fixture(scope="module")
def found():
    """Two hits on the rotor of the paper, short, so that a step is seen."""
    hits = [
        ROTOR.simulate(n_periods=n, samples_per_period=20, noise=0.02, seed=n, impulse_deg=angle)
        for n, angle in ((120, 30.0), (100, 75.0))
    ]
    return identify(hits, channels=["X", "Y"], validate=False)


@pytest.fixture(scope="module")
def known(found) -> Estimates:
    return found.model.unselected


def deviations(known):
    parts = np.sqrt(np.diag(known.covariance))
    n = len(known.exponents)
    return parts[:n] + 1j * parts[n : 2 * n]


def far(one, other, std):
    """The largest difference of real and imaginary parts, in deviations."""
    off = one - other
    return float(np.max(np.abs(np.stack([off.real / std.real, off.imag / std.imag]))))


def by_samples(found, exponents, **changes):
    clocks = [ConstantPeriod(period=found.model.period) for _ in found.records]
    given = {"records": found.records, "clocks": clocks, "noise": found.noise} | changes
    return estimate_at(found.model, exponents, **given)


def test_at_its_own_exponents_it_is_the_fit_itself(found, known):
    here = estimate_at(found.model, known.exponents, lifted=found.lifted)
    assert far(here.exponents, known.exponents, deviations(known)) < 1e-3
    assert far(here.coefficients, known.coefficients, known.std()) < 1e-3
    assert here.covariance == pytest.approx(known.covariance, rel=1e-6, abs=1e-20)
    assert here.spread == pytest.approx(known.spread, rel=1e-6, abs=1e-12)
    assert np.array_equal(here.modes, known.modes)
    assert np.array_equal(here.harmonics, known.harmonics)


@pytest.mark.parametrize("steps", [1.0, -2.0])
def test_a_step_leads_back_to_the_least_squares(found, known, steps):
    """Exponents and coefficients both: from a deviation away, what is left is of second order."""
    std = deviations(known)
    start = known.exponents + steps * std
    here = estimate_at(found.model, start, lifted=found.lifted)
    assert far(start, known.exponents, std) == pytest.approx(abs(steps))
    assert far(here.exponents, known.exponents, std) < 0.03 * abs(steps)
    assert far(here.coefficients, known.coefficients, known.std()) < 0.03 * abs(steps)
    # Without the step of the exponents, the coefficients that are best at the start are not near them.
    moved = known.slopes @ np.concatenate([steps * std.real, steps * std.imag, [0.0]])
    assert np.abs(moved / np.abs(known.std())).max() > 0.2


def test_samples_and_lifted_samples_say_the_same(found, known):
    start = known.exponents + deviations(known)
    lifted, sampled = estimate_at(found.model, start, lifted=found.lifted), by_samples(found, start)
    assert far(sampled.exponents, lifted.exponents, deviations(known)) < 1e-6
    assert far(sampled.coefficients, lifted.coefficients, known.std()) < 1e-6
    assert sampled.covariance == pytest.approx(lifted.covariance, rel=1e-8)


@pytest.mark.slow
def test_real_multipliers_stay_real():
    """A negative and a positive one beside a pair: their imaginary parts are no parameters."""
    t = np.arange(80 * 10) / 10.0
    shapes = [1.0 + 0.4 * np.cos(2.0 * np.pi * t + phase) for phase in (0.0, 1.0, 2.0)]
    parts = [np.exp(-0.02 * t) * np.cos(1.7 * t), np.exp(-0.03 * t) * np.cos(np.pi * t), 0.7 * np.exp(-0.05 * t)]
    mixed = np.array([[1.0, 0.5, 0.4], [0.3, 1.0, -0.8], [0.2, 0.4, 1.0]]) @ np.array(
        [shape * part for shape, part in zip(shapes, parts, strict=True)]
    )
    values = mixed + 1e-3 * np.random.default_rng(0).standard_normal(mixed.shape)
    record = Record(values=values, sample_rate=10.0, channels=["a", "b", "c"], clock=ConstantPeriod(period=1.0))
    found = identify(record, validate=False)
    known = found.model.unselected
    assert known.real.sum() == 2
    std = deviations(known)
    here = estimate_at(found.model, known.exponents + std.real, lifted=found.lifted)
    assert np.array_equal(here.real, known.real)
    assert np.array_equal(here.exponents.imag[known.real], known.exponents.imag[known.real])
    assert (np.abs((here.exponents - known.exponents).real) < 0.05 * std.real).all()
    assert far(here.coefficients, known.coefficients, known.std() + 1e-9 * (1.0 + 1.0j)) < 0.05


def test_a_forced_response_is_fitted_again_beside_the_modes():
    """The free record lacks what was taken off it: without its columns, deviations would be too small."""
    record = ROTOR.simulate(n_periods=60, samples_per_period=20, noise=0.02, seed=3).select(["X", "Y"])
    turned = 0.3 * np.cos(np.pi / ROTOR.period * record.times + np.array([[0.4], [1.1]])) + 0.2
    values = record.values + turned
    found = identify(replace(record, values=values), forced="1", periods_per_revolution=2, validate=False)
    known, fit = found.model.unselected, found.fit
    clocks = [record.clock]
    given = {"records": fit.free, "clocks": clocks, "noise": fit.noise}
    here = estimate_at(found.model, known.exponents, **given, forced=fit.forced)
    bare = estimate_at(found.model, known.exponents, **given)
    assert far(here.exponents, known.exponents, deviations(known)) < 0.02
    assert here.covariance == pytest.approx(known.covariance, rel=0.02, abs=1e-4 * np.abs(known.covariance).max())
    own, too_small = (np.diag(each.covariance)[:-1] for each in (here, bare))
    assert (too_small < own).all()
    assert (too_small < 0.9995 * own).any()  # an offset and one harmonic: no drift is fitted where there is none


def test_a_free_period_takes_its_step_too():
    record = ROTOR.simulate(n_periods=200, samples_per_period=20, noise=0.02, seed=4).select(["X", "Y"])
    found = identify(replace(record, clock=None), estimate_period=True, period=6.0, validate=False)
    known = found.model.unselected
    assert known.covariance[-1, -1] > 0.0
    clocks = [ConstantPeriod(period=found.model.period)]
    here = estimate_at(
        found.model, known.exponents + deviations(known), records=found.fit.free, clocks=clocks, noise=found.fit.noise,
        forced=found.fit.forced,
    )  # fmt: skip
    assert here.covariance[-1, -1] == pytest.approx(known.covariance[-1, -1], rel=0.1)
    assert 0.0 < abs(here.fundamental - known.fundamental) < 0.05 * np.sqrt(known.covariance[-1, -1])
    assert far(here.exponents, known.exponents, deviations(known)) < 0.05


def test_without_wider_bands_it_is_by_those_of_the_model():
    """Of one hit: estimates of shapes that several hits share are no residues."""
    alone = ROTOR.simulate(n_periods=120, samples_per_period=20, noise=0.02, seed=120, impulse_deg=30.0)
    found = identify(alone, channels=["X", "Y"], validate=False)
    bare = replace(found.model, unselected=None)
    here = estimate_at(bare, bare.estimates.exponents, lifted=found.lifted)
    assert np.array_equal(here.harmonics, bare.estimates.harmonics)
    assert far(here.exponents, bare.estimates.exponents, deviations(bare.estimates)) < 1e-3


def test_what_does_not_belong_together_is_refused(found, known):
    exponents = known.exponents
    with pytest.raises(InputError, match="Argument `model` of `estimate_at` must have the joint covariance"):
        estimate_at(replace(found.model, estimates=None, unselected=None), exponents, lifted=found.lifted)
    with pytest.raises(InputError, match=r"Argument `exponents` of `estimate_at` .* shape \(2,\)"):
        estimate_at(found.model, exponents[:1], lifted=found.lifted)
    with pytest.raises(InputError, match="Argument `noise` of `estimate_at` must be given with records"):
        by_samples(found, exponents, noise=None)
    with pytest.raises(InputError, match="Argument `noise` of `estimate_at` must be positive"):
        by_samples(found, exponents, noise=0.0 * found.noise)
    one = {"records": found.records[:1], "clocks": [ConstantPeriod(period=found.model.period)]}
    with pytest.raises(InputError, match="Argument `records` of `estimate_at` must be 2 of 2 channels, as the model"):
        by_samples(found, exponents, **one)
    fewer = [record.select(["X"]) for record in found.records]
    with pytest.raises(InputError, match="Argument `records` of `estimate_at` must be 2 of 2 channels, as the model"):
        by_samples(found, exponents, records=fewer)
    alone = lift(found.cycles[:1])
    with pytest.raises(InputError, match="Argument `records` of `estimate_at` must be 2 of 2 channels, as the model"):
        estimate_at(found.model, exponents, lifted=alone)
