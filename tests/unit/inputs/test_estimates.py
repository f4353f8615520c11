"""Estimates of fits with inputs: what outputs have in common, and what their parameters are."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from floquid.inputs import Errors

OUTPUTS, EACH, KNOWN = 3, 4, 5


def whole_of(errors):
    """The covariance of the parameters and of all columns, put together again."""
    slopes = errors.slopes.reshape(-1, errors.slopes.shape[-1])
    left = slopes @ errors.parameters @ slopes.T
    for number, (block, scale) in enumerate(zip(errors.blocks, errors.scales, strict=True)):
        own = slice(number * EACH, (number + 1) * EACH)
        left[own, own] += scale**2 * errors.spread[block]
    mixed = slopes @ errors.parameters[:, :KNOWN]
    return np.block([[errors.parameters[:KNOWN, :KNOWN], mixed.T], [mixed, left]])


def joint(common, seed=0):
    """A covariance whose outputs share so much of their errors beyond the parameters."""
    generator, count = np.random.default_rng(seed), OUTPUTS * EACH
    known = generator.standard_normal((KNOWN, KNOWN))
    slopes = generator.standard_normal((count, KNOWN))
    own = np.zeros((count, count))
    for number in range(OUTPUTS):
        part = generator.standard_normal((EACH, EACH))
        own[number * EACH : (number + 1) * EACH, number * EACH : (number + 1) * EACH] = part @ part.T + np.eye(EACH)
    shared = common * generator.standard_normal((count, 3))
    left = own + shared @ shared.T + slopes @ known @ known.T @ slopes.T
    return np.block([[known @ known.T, known @ known.T @ slopes.T], [slopes @ known @ known.T, left]])


@pytest.mark.parametrize("common", [0.0, 0.1, 10.0])
def test_errors_put_together_again_are_the_joint_covariance(common):
    covariance = joint(common)
    errors = Errors.of_joint(covariance, KNOWN, OUTPUTS)
    assert_allclose(whole_of(errors), covariance, atol=1e-8 * np.abs(covariance).max())
    assert np.linalg.eigvalsh(errors.spread).min() > 0.0
    others = len(errors.parameters) - KNOWN
    assert others == 0 if common == 0.0 else 0 < others < OUTPUTS * EACH


def test_a_coefficient_that_is_held_has_no_error():
    covariance = joint(0.1)
    covariance[KNOWN + 2], covariance[:, KNOWN + 2] = 0.0, 0.0
    errors = Errors.of_joint(covariance, KNOWN, OUTPUTS)
    assert_allclose(whole_of(errors), covariance, atol=1e-8 * np.abs(covariance).max())
    assert not errors.spread[0][2].any()
