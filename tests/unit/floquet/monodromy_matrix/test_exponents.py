"""What `floquet` and the comparison of spectra refuse, and their edges."""

import numpy as np
import pytest

from floquid import floquet
from floquid.errors import InputError
from floquid.testing import assert_exponents_close, pair_exponents

A = np.array([[0.0, 1.0], [-1.0, -0.1]])


def swinging(t):
    return A * (1.0 + 0.5 * np.cos(t))


@pytest.mark.parametrize(
    ("system", "period", "message"),
    [
        (A, 1.0, r"`system` of `floquet.exponents` must have shape \(n, n, phases\).*\n.*A\[:, :, None\]"),
        (np.zeros((8, 2, 2)), 1.0, r"has shape \(8, 2, 2\)\.\n.*moveaxis"),
        (np.zeros((2, 3, 8)), 1.0, r"must have shape \(n, n, phases\), but has shape \(2, 3, 8\)"),
        (np.zeros((2, 2, 0)), 1.0, r"has shape \(2, 2, 0\)"),
        (np.full((2, 2, 8), np.nan), 1.0, "must be finite"),
        (lambda t: [1.0, t], 1.0, r"must return a matrix \(rows, columns\), but returns shape \(2,\)"),
        (lambda t: np.full((2, 2), np.nan if t > 0.5 else 0.0), 1.0, "must be finite"),
        (lambda t: A if t < 0.5 else np.eye(3), 1.0, r"must have shape \(2, 2\), but has shape \(3, 3\)"),
        (lambda t: A + 1j, 1.0, "must be real"),
        (swinging, -1.0, "`period` of `floquet.exponents` must be positive"),
        (swinging, np.pi, r"`period` of `floquet.exponents` must be a period of A\(t\), but A differs by"),
    ],
)
def test_wrong_systems_are_refused(system, period, message):
    with pytest.raises(InputError, match=message):
        floquet.exponents(system, period)


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"times": [1.0, 0.5]}, "`times` of `floquet.transition` must ascend"),
        ({"times": [0.5, 1.0], "start": 0.7}, "`times` of `floquet.transition` must ascend from `start` = 0.7"),
        ({"times": 1.0}, r"must have shape \(times,\)"),
        ({"times": [1.0], "start": np.inf}, "`start` of `floquet.transition` must be a finite number"),
        ({"times": [1.0], "breaks": [7.0]}, r"`breaks` of `floquet.transition` must lie in \[0, 6.28319\)"),
    ],
)
def test_wrong_times_are_refused(keywords, message):
    with pytest.raises(InputError, match=message):
        floquet.transition(swinging, 2 * np.pi, **keywords)


def test_no_times_give_no_matrices():
    assert floquet.transition(swinging, 2 * np.pi, []).shape == (0, 2, 2)


def test_a_system_that_explodes_is_refused():
    with pytest.raises(InputError, match="within the range of floating point"):
        floquet.monodromy(np.full((1, 1, 1), 1e3), 10.0)
    assert floquet.exponents(np.full((1, 1, 1), 1e3), 10.0) == pytest.approx([1e3], rel=1e-13)


def square(t):
    """Return A(t), negative definite in the first 0.3 of the period 1, positive after."""
    return np.diag([-1.0, -2.0]) if t % 1.0 < 0.3 else np.diag([1.0, 3.0])


def test_breaks_are_met_in_every_period_and_from_any_start():
    phi = floquet.transition(square, 1.0, [0.5, 2.3, 2.4], start=0.2, breaks=[0.3, 0.0])
    exact = [(-0.1 + 0.2, -0.2 + 0.6), (-0.7 + 1.4, -1.4 + 4.2), (-0.7 + 1.5, -1.4 + 4.5)]
    assert phi == pytest.approx(np.stack([np.diag(np.exp(e)) for e in exact]), rel=1e-12, abs=1e-14)


def test_no_step_sees_the_other_side_of_a_jump():
    """Else the error estimate would shrink the steps at every jump: 2600 evaluations in place of 300."""
    evaluations = []

    def counted(t):
        evaluations.append(t)
        return square(t)

    floquet.monodromy(counted, 1.0, breaks=[0.0, 0.3])
    assert len(evaluations) < 600


def test_the_highest_line_of_samples_is_counted_once():
    """The samples 1, -1 of a period are cos ωt, whose integral is sin ωt/ω."""
    times = np.array([0.1, 0.35, 0.8])
    phi = floquet.transition(np.array([[[1.0, -1.0]]]), 1.0, times)
    assert phi[:, 0, 0] == pytest.approx(np.exp(np.sin(2 * np.pi * times) / (2 * np.pi)), abs=1e-12)


def test_unequal_units_do_not_cost_accuracy():
    """A resonator at 2000 rad/s: entries of A from 1 to 4e6."""
    system = np.array([[0.0, 1.0], [-4e6, -8.0]])[:, :, None]
    damped = np.sqrt(4e6 - 16.0)
    assert_exponents_close(floquet.exponents(system, 1e-3), [-4.0 + 1j * damped, -4.0 - 1j * damped], 1e-3, atol=1e-8)


def test_samples_between_which_a_is_interpolated_are_on_the_phases_from_zero():
    times = 2 * np.pi * np.arange(4) / 4
    samples = np.stack([swinging(t) for t in times], axis=-1)
    at = [0.3, 1.9, 6.0]
    exact = floquet.transition(swinging, 2 * np.pi, at)
    assert floquet.transition(samples, 2 * np.pi, at) == pytest.approx(exact, abs=1e-11)


def test_exponents_are_sorted_conjugates_together():
    blocks = np.zeros((5, 5))
    blocks[:2, :2] = [[-0.1, 2.0], [-2.0, -0.1]]
    blocks[2:4, 2:4] = [[-0.2, 1.0], [-1.0, -0.2]]
    blocks[4, 4] = -0.5
    found = floquet.exponents(blocks[:, :, None], 1.0)
    assert found == pytest.approx(np.array([-0.5, -0.2 + 1j, -0.2 - 1j, -0.1 + 2j, -0.1 - 2j]), abs=1e-11)


def test_differences_are_wrapped_to_the_strip():
    permutation, differences = pair_exponents([0.49j, 3.0 + 0j], [3.0 + 2j, -0.49j], 2 * np.pi)
    assert permutation.tolist() == [1, 0]
    assert differences == pytest.approx([0.0, -0.02j], abs=1e-12)
    assert pair_exponents([0.5j], [0.0], 2 * np.pi).differences[0] == 0.5j
    assert pair_exponents([-0.5j], [0.0], 2 * np.pi).differences[0] == 0.5j


def test_estimates_without_a_partner_are_left_out():
    permutation, differences = pair_exponents([9.0, 1.1, 2.1], [2.0, 1.0], 1.0)
    assert permutation.tolist() == [2, 1]
    assert differences == pytest.approx([0.1, 0.1])
    with pytest.raises(InputError, match="must hold at least the 2 exponents of `truth`, but holds 1"):
        pair_exponents([1.0], [2.0, 1.0], 1.0)


def test_assertion_tells_missing_and_wrong_exponents():
    assert_exponents_close([1.0 + 1j, 2.0], [2.0, 1.0], 2 * np.pi, atol=1e-12)
    with pytest.raises(AssertionError, match="2 exponents, but 1 were expected"):
        assert_exponents_close([1.0, 2.0], [1.0], 1.0, atol=1.0)
    with pytest.raises(AssertionError, match=r"off by 0\.1"):
        assert_exponents_close([1.1], [1.0], 1.0, atol=0.01)
    with pytest.raises(AssertionError, match=r"over 0\.01"):
        assert_exponents_close([1.0 + 0.1j], [1.0], 1.0, atol=0.01)
