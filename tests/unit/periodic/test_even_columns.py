"""Sums over columns in pieces, against those over every sample: with its angles given, a block takes no pieces."""

from dataclasses import replace

import numpy as np
import pytest

from floquid.periodic.least_squares import FOLLOWS, PLAIN, TREND, RecordBlock
from floquid.periodic.least_squares._sample_block import Columns
from floquid.periodic.least_squares._uniform_grid import EvenColumns, step_of

STEP, START = 0.01, 3.7
OMEGA = 2.0 * np.pi / 0.37


def columns(n_samples, factors=(PLAIN, PLAIN, PLAIN, TREND, PLAIN)):
    """Two modes that decay, one that grows, an offset or a trend, and a mode of half a fundamental."""
    span = n_samples * STEP
    exponents = np.array([-4.0 / span + 4j, -300.0 / span + 9j, 3.0 / span + 3j, 0j, -1.0 / span + 0j])
    modes = np.array([0, 0, 0, 1, 1, 2, 2, 3, 4])
    harmonics = np.array([-2, 0, 1, 0, 3, -1, 0, 0, 0])
    return Columns(exponents, np.array([0, 0, 0, 0, 0.5]), np.array(factors), modes, harmonics, OMEGA, np.zeros(5))


def block(n_samples, rows=3, start=START):
    rng = np.random.default_rng(n_samples)
    times = start + np.arange(n_samples) * STEP
    return RecordBlock(times, rng.standard_normal((rows, n_samples)), 0, np.arange(rows), np.ones(rows))


def slow(one):
    """The same samples, each of whose columns is formed."""
    return replace(one, angles=OMEGA * one.times)


def coefficients(columns, rows=3):
    parts = np.random.default_rng(7).standard_normal((2, len(columns.modes), rows))
    return parts[0] + 1j * parts[1]


def used(one, columns):
    return EvenColumns.of(columns, one.times, one.step, middle=one.middle, half=one.half, last=one.last)


def assert_equal(found, expected, tolerance=1e-11):
    """Each sum to so much of what its columns and its channel could make of it."""
    plain, timed, left = (
        np.sqrt(np.abs(each)) for each in (expected.gram.diagonal(), expected.slopes.diagonal(), expected.left)
    )
    scales = {
        "gram": np.outer(plain, plain),
        "mixed": np.outer(plain, timed),
        "slopes": np.outer(timed, timed),
        "seen": np.outer(plain, left),
        "late": np.outer(timed, left),
        "left": left**2,
    }
    for name, scale in scales.items():
        difference = np.abs(getattr(found, name) - getattr(expected, name))
        assert (difference <= tolerance * scale + 1e-15 * scale.max()).all(), name


@pytest.mark.parametrize("n_samples", [2, 100, 1025, 5003, 1 << 16, (1 << 16) + 17, (3 << 16) + 255])
@pytest.mark.parametrize("start", [START, 0.0])
def test_the_sums_are_those_over_every_sample(n_samples, start):
    one, some = block(n_samples, start=start), columns(n_samples)
    assert used(one, some) is not None
    B = coefficients(some)
    assert_equal(one.sums(some, B), slow(one).sums(some, B))


@pytest.mark.parametrize("n_samples", [100, 5003, (2 << 16) + 3])
def test_what_is_left_is_that_of_every_sample(n_samples):
    one, some = block(n_samples), columns(n_samples)
    B = coefficients(some)
    times, left = one.residual(some, B)
    assert times is one.times
    np.testing.assert_allclose(left, slow(one).residual(some, B)[1], atol=1e-9)


def test_two_trends_and_harmonics_of_one():
    some = columns(3000, factors=(TREND, PLAIN, TREND, TREND, PLAIN))
    one, B = block(3000), coefficients(some)
    assert_equal(one.sums(some, B), slow(one).sums(some, B))


def test_a_record_without_columns():
    none = Columns(*(np.zeros(0, kind) for kind in (complex, float, int, int, int)), OMEGA, np.zeros(0))
    one = block(2000)
    found = one.sums(none, np.zeros((0, 3), complex))
    np.testing.assert_allclose(found.left, np.sum(one.values**2, axis=1), rtol=1e-12)
    assert found.gram.shape == (0, 0)
    assert found.seen.shape == (0, 3)


class TestWhereThereAreNoPieces:
    def test_samples_are_missing(self):
        times = block(3000).times
        assert step_of(times) is not None
        assert step_of(np.delete(times, 1500)) is None

    def test_the_last_sample_is_missing(self):
        times = block(3000).times
        assert step_of(times[:-1]) == pytest.approx(STEP, rel=1e-12)

    def test_times_that_jitter(self):
        times = block(3000).times
        times[700] += 1e-9
        assert step_of(times) is None

    def test_a_single_sample(self):
        assert step_of(block(2).times[:1]) is None

    def test_a_factor_that_follows_the_speed(self):
        one = block(3000)
        assert used(one, columns(3000, factors=(PLAIN, PLAIN, PLAIN, FOLLOWS[0], PLAIN))) is None

    def test_growth_that_overflows_within_a_piece(self):
        one, some = block(100_000), columns(100_000)
        steep = replace(some, exponents=some.exponents + np.array([0, 0, 1000.0, 0, 0]))
        assert used(one, some) is not None
        assert used(one, steep) is None
        assert np.isfinite(one.sums(steep, coefficients(steep)).gram).all()
