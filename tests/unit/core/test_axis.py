"""What is reported of two exponents near an axis."""

import numpy as np
import pytest

from floquid.core import read_axis, with_deviations

STD = 4e-4
COVARIANCE = np.diag([1e-6, STD**2])


@pytest.mark.parametrize("square", [0.0, 1.9 * STD, -1.9 * STD])
def test_the_kind_is_open_where_the_interval_of_q_holds_zero(square):
    read = read_axis(-0.1, square, COVARIANCE, 1, 2.0)
    assert read.apart == pytest.approx(np.sqrt(abs(square) + 1.96 * STD))
    assert abs(read.square) == pytest.approx(max(abs(square), 0.1 * STD))
    assert read.std.shape == (2,)
    assert (read.std.real > 0.0).all()
    assert (read.std.imag > 0.0).all()


@pytest.mark.parametrize("square", [2.0 * STD, -2.0 * STD])
def test_the_kind_is_known_where_it_does_not(square):
    read = read_axis(-0.1, square, COVARIANCE, 1, 2.0)
    assert read.apart is None
    assert read.square == square


def test_what_is_not_determined_is_read_no_further_than_halfway_to_the_next_axis():
    read = read_axis(-0.1, 0.01, np.diag([1e30, 1e34]), 1, 2.0)
    assert abs(read.square) <= 1.0
    assert read.apart == pytest.approx(np.sqrt(0.01 + 1.96))


def test_other_deviations_leave_correlations_and_what_is_not_given():
    root = np.random.default_rng(0).standard_normal((4, 4))
    before = root @ root.T
    std = np.array([complex(np.nan, np.nan), 0.3 + 0.7j])
    after = with_deviations(before, std)
    expected = [before[0, 0] ** 0.5, 0.3, before[2, 2] ** 0.5, 0.7]
    assert np.sqrt(np.diag(after)) == pytest.approx(expected)
    sizes = [np.sqrt(np.outer(np.diag(own), np.diag(own))) for own in (before, after)]
    assert after / sizes[1] == pytest.approx(before / sizes[0])
