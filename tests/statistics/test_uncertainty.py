"""Deviations and covariances of the chain are those of its errors, by repetition over the noise."""

import numpy as np
import pytest

EXPERIMENTS = {
    "two pairs": {"exponents": [-0.03 + 0.85j, -0.02 + 0.32j]},
    "a close pair": {"exponents": [-0.03 + 0.85j, -0.03 + 0.865j], "hits": 2, "noise": 0.01},
    "two hits, channels of unequal noise": {
        "exponents": [-0.03 + 0.85j, -0.02 + 0.32j],
        "hits": 2,
        "units": [1.0, 10.0],
        "noise": 0.01,
    },
    "much noise": {"exponents": [-0.01 + 0.85j, -0.008 + 0.32j], "noise": 0.2, "n_cycles": 120},
    "fast decay": {"exponents": [-0.15 + 0.85j, -0.1 + 0.32j], "noise": 0.01},
    "a growing mode": {"exponents": [0.005 + 0.85j, -0.02 + 0.32j], "noise": 0.01},
}
SEEDS = 40
MANY = 400
NORMAL = ["two pairs", "a close pair", "two hits, channels of unequal noise"]
FEW = pytest.mark.parametrize("name", NORMAL)
EVERY = pytest.mark.parametrize("name", EXPERIMENTS)


def repeat(known, chain, seeds):
    models = [chain(known.records(seed)) for seed in range(seeds)]
    errors, covariances = map(np.array, zip(*(known.exponent_errors(m) for m in models), strict=True))
    coefficients = np.array([known.coefficient_pulls(m) for m in models])
    return errors, covariances, coefficients


def check(known, chain, seeds, assert_that):
    errors, covariances, coefficients = repeat(known, chain, seeds)
    assert_that.errors_have_the_covariance(errors, covariances)
    deviations = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    assert_that.pulls_have_unit_variance(errors / deviations)
    assert_that.pulls_have_unit_variance(coefficients)


@FEW
def test_exponents_and_coefficients_err_as_they_say(experiment, chain, assert_that, name):
    check(experiment(**EXPERIMENTS[name]), chain, SEEDS, assert_that)


@pytest.mark.slow
@EVERY
def test_exponents_and_coefficients_err_as_they_say_over_many_seeds(experiment, chain, assert_that, name):
    check(experiment(**EXPERIMENTS[name]), chain, MANY, assert_that)
