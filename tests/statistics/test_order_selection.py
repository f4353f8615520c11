"""The order found is the true one: many modes, close pairs, and none at all in noise."""

import numpy as np
import pytest

from floquid.lti import MaximumLikelihood

IDENTIFIER = MaximumLikelihood()
SYSTEMS = [(1, 10, 64), (2, 10, 64), (3, 24, 64), (5, 40, 128), (8, 40, 200), (12, 72, 60)]
RATE = 0.99


@pytest.mark.parametrize(("modes", "outputs", "samples"), SYSTEMS)
def test_every_mode_of_a_random_system_is_found_and_no_other(assert_that, orders, modes, outputs, samples):
    drawn = [orders.decays(modes, outputs=outputs, samples=samples, seed=seed) for seed in range(5)]
    right = sum(orders.is_right(*one, IDENTIFIER) for one in drawn)
    assert_that.happens_at_least(right, len(drawn), RATE)


def test_twenty_modes_at_two_percent(orders):
    assert orders.is_right(*orders.decays(20, outputs=60, samples=256), IDENTIFIER)


@pytest.mark.parametrize("modes", range(1, 21))
def test_every_mode_of_many_random_systems_is_found_and_no_other(assert_that, orders, modes):
    outputs, samples = 10 + 4 * modes, max(64, 16 * modes)
    drawn = [orders.decays(modes, outputs=outputs, samples=samples, seed=seed) for seed in range(100, 112)]
    right = sum(orders.is_right(*one, IDENTIFIER) for one in drawn)
    assert_that.happens_at_least(right, len(drawn), RATE)


def test_pure_noise_holds_no_mode(orders):
    assert orders.seen_in_noise(IDENTIFIER, range(20)) == 0


def test_pure_noise_holds_no_mode_in_many_draws(orders):
    assert orders.seen_in_noise(IDENTIFIER, range(1000, 1100)) == 0


def pairs_told_apart(orders, seeds) -> int:
    """Two pairs a tenth of their half-power width (twice the damping) apart, 2 % noise.

    Both must be found, each nearer to its own than half of their separation.
    """
    damping, count = 0.02, 0
    logs = np.array([-damping + 1.0j, -damping + 1j * (1.0 + 0.2 * damping)])
    for seed in seeds:
        data = orders.ringing(logs, 50, 256, 0.02, np.random.default_rng(seed))
        found = IDENTIFIER.extract(IDENTIFIER.prepare(data))
        if found.order == 4:
            off = np.abs(np.subtract.outer(logs, np.log(found.multipliers))).min(axis=1)
            count += bool(off.max() < 0.5 * abs(logs[1] - logs[0]))
    return count


def test_pairs_a_tenth_of_the_half_power_width_apart_are_told_apart(assert_that, orders):
    assert_that.happens_at_least(pairs_told_apart(orders, range(8)), 8, RATE)


def test_many_pairs_a_tenth_of_the_half_power_width_apart_are_told_apart(assert_that, orders):
    assert_that.happens_at_least(pairs_told_apart(orders, range(100, 200)), 100, RATE)
