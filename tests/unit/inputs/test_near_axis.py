"""Kinds of modes near an axis of real multipliers."""

import numpy as np
import pytest
from tests.driven import Driven, creeping, pulls, record_of

from floquid import Record, identify
from floquid.inputs import bare_mode, read_near_axis, samples_of, solve
from floquid.inputs._solver import covariance
from floquid.inputs.search import _search

PHASES = 16


def oscillator(depth, stiffness):
    """Damped, of a frequency that is half that of its spring, which varies by `depth`."""
    return Driven(
        A=lambda t: np.array([[0.0, 1.0], [-(stiffness + 2.0 * depth * np.cos(2.0 * t)), -0.03]]),
        B=lambda _: np.array([[0.0], [1.0]]),
        C=lambda _: np.array([[1.0, 0.0]]),
        period=np.pi,
    )


def identified(system, seed):
    values, inputs = record_of(system, 80, PHASES, 0.01, seed)
    record = Record(values=np.concatenate([values, inputs]), sample_rate=PHASES / np.pi, channels=["y", "u"])
    return identify(record, period=np.pi, inputs=["u"], validate=False)


def test_harmonics_that_noise_explains_are_no_argument_for_a_pair():
    """At 0.3 % from the edge of its lock; the pair, with two harmonics less, was 3.8 of its deviations off."""
    found = identified(oscillator(0.0069601540, 1.0072), 3003)
    assert pulls(oscillator(0.0069601540, 1.0072), found.model).max() < 3.0


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_a_frequency_of_a_constant_system_may_be_at_the_axis(seed):
    """Two multipliers meet there with two vectors, and q is not regular; intervals hold all the same."""
    system = oscillator(0.0, 1.0 + 0.015**2)
    found = identified(system, seed)
    assert found.model.order == 2
    assert not found.failed
    assert pulls(system, found.model).max() < 4.0


@pytest.mark.parametrize(
    ("depth", "starts", "count"), [(0.02, (-0.1, -0.15), 1), (0.012, (-0.06, -0.18), 2)], ids=["a pair", "two real"]
)
def test_two_real_multipliers_become_the_pair_that_they_stand_for(depth, starts, count):
    system = creeping(depth)
    values, inputs = record_of(system, 100, 20, 0.01, 0)
    omega = 2.0 * np.pi / system.period
    samples = samples_of([values], [inputs], [0.0], step=system.period / 20, fundamental=omega)
    band = np.arange(2.0)
    now = solve(samples, [bare_mode(samples, exponent, band, band, real=True) for exponent in starts])
    near = read_near_axis(samples, now)
    assert len(near.at.modes) == count
    gaps = [np.abs(mode.exponent - system.exponents()).min() for mode in near.at.modes]
    assert max(gaps) < 0.01 * abs(system.exponents().real).min()
    assert not near.findings


def test_a_pair_of_which_q_is_not_determined_is_left_as_it_is(monkeypatch):
    """With its deviation off it would be nearer to the next axis."""
    system, band = creeping(0.0144), np.arange(-1.0, 2.0)
    values, inputs = record_of(system, 60, 12, 0.01, 5)
    omega = 2.0 * np.pi / system.period
    samples = samples_of([values], [inputs], [0.0], step=system.period / 12, fundamental=omega)
    now = solve(samples, [bare_mode(samples, -0.12 + 0.01j, band, band)])
    assert read_near_axis(samples, now).at is not now
    monkeypatch.setattr(_search, "covariance", lambda *fit: 1e8 * covariance(*fit))
    assert read_near_axis(samples, now).at is now
