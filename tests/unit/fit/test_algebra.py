"""Inverses, roots and tests of linear models, of which the answers are known in closed form."""

import numpy as np
import pytest

from floquid.fit import (
    chi2_limit,
    covariance_root,
    inverse_root,
    positive_part,
    sandwich,
    scaled_inverse,
    schwarz,
    score_gain,
    wald_rise,
)

UNITS = 10.0 ** np.array([-9.0, 0.0, 5.0, 9.0])


def information(seed: int = 0) -> np.ndarray:
    """A matrix of products of well separated columns."""
    columns = np.random.default_rng(seed).standard_normal((4, 40))
    return columns @ columns.T


def test_units_do_not_decide_what_is_known():
    matrix = information()
    units = np.outer(UNITS, UNITS)
    assert scaled_inverse(matrix * units) * units == pytest.approx(np.linalg.inv(matrix), rel=1e-9, abs=1e-12)
    assert sandwich(matrix * units, matrix * units) * units == pytest.approx(np.linalg.inv(matrix), rel=1e-9, abs=1e-12)
    root = covariance_root(matrix * units)
    assert root @ root.T / units == pytest.approx(matrix, rel=1e-9, abs=1e-9)


def test_a_direction_without_information_is_left_out_or_taken_for_all_but_unknown():
    matrix = information()
    twice = np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1], [1, 0, 0, 0]])
    singular = twice @ matrix @ twice.T
    assert inverse_root(singular, 1e-10).shape == (5, 4)
    assert singular @ scaled_inverse(singular, 1e-10) @ singular == pytest.approx(singular, rel=1e-9)
    apart = np.array([1.0, 0.0, 0.0, 0.0, -1.0])
    assert apart @ scaled_inverse(singular, 1e-10) @ apart == pytest.approx(0.0, abs=1e-12)
    assert apart @ scaled_inverse(singular, 1e-10, floor=True) @ apart > 1e6
    assert np.isnan(scaled_inverse(np.full((3, 3), np.inf), floor=True)).all()
    assert not inverse_root(np.zeros((3, 3))).size
    assert not inverse_root(np.full((3, 3), np.inf), scale=np.ones(3)).size


def test_noise_taken_off_leaves_an_information_that_is_definite():
    matrix = information()
    assert positive_part(matrix, 0.5 * matrix) == pytest.approx(0.5 * matrix)
    kept = positive_part(matrix, matrix - 3.0 * np.diag(np.diag(matrix)))
    assert np.linalg.eigvalsh(kept).min() > 0.0
    assert np.linalg.eigvalsh(matrix - kept).min() > -1e-9


@pytest.mark.parametrize("more", [1, 2])
def test_both_tests_of_a_linear_model_are_what_a_fit_without_parameters_leaves_more(more):
    generator = np.random.default_rng(more)
    columns, values = generator.standard_normal((5, 60)), generator.standard_normal(60)

    def left(rows: np.ndarray) -> np.ndarray:
        return values - np.linalg.lstsq(rows.T, values, rcond=None)[0] @ rows

    fewer, extra = columns[:-more], columns[-more:]
    rise = np.sum(left(fewer) ** 2) - np.sum(left(columns) ** 2)
    beyond = extra - np.linalg.lstsq(fewer.T, extra.T, rcond=None)[0].T @ fewer
    before = np.einsum("kn,kn->k", extra, extra)
    assert score_gain(extra @ left(fewer), beyond @ beyond.T, 1e-9, before=before) == pytest.approx(rise)
    whole, inverse = np.linalg.lstsq(columns.T, values, rcond=None)[0], np.linalg.inv(columns @ columns.T)
    assert wald_rise(whole[-more:], inverse[-more:, -more:]) == pytest.approx(rise)


def test_a_covariance_that_overflowed_says_nothing():
    assert wald_rise(np.ones(2), np.full((2, 2), np.inf)) == 0.0


def test_noise_exceeds_a_limit_with_its_probability_and_each_parameter_has_its_price():
    draws = np.sum(np.random.default_rng(0).standard_normal((20000, 3)) ** 2, axis=1)
    assert np.mean(draws > chi2_limit(3, 0.05)) == pytest.approx(0.05, abs=0.005)
    assert schwarz(10.0, 3, 100) == pytest.approx(10.0 - 3.0 * np.log(100.0))
