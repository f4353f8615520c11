"""Errors of a shaft's angle beside a large steady response: told where they are more than what is left."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.driven import mathieu

from floquid import Channel, Record, identify

PERIODS, PHASES = 90, 20


@pytest.fixture(scope="module")
def wandering():
    """Mathieu's equation whose speed wanders: outputs, inputs and the angle of the system [rad]."""
    fixed = mathieu()
    step, count = fixed.period / PHASES, PERIODS * PHASES

    def angle(t):
        return 2.0 * t + 0.1 * np.sin(16.0 * np.pi * t / (count * step))

    own = replace(
        fixed,
        A=lambda t: np.array([[0.0, 1.0], [-(2.0 - np.cos(angle(t))), -0.1 * np.sqrt(2.0)]]),
        period=count * step,
    )
    generator = np.random.default_rng(0)
    inputs = generator.standard_normal((1, count))
    values = own.response(inputs, count)
    values += 0.05 * values.std() * generator.standard_normal(values.shape)
    return values, inputs, angle(step * np.arange(count))


def identified(wandering, orbit, sensor, measured):
    values, inputs, angle = wandering
    values = values + orbit * values.std() * np.cos(angle + 0.3)
    shaft, clock = {
        "pulses": (5.0 * (angle % (2.0 * np.pi) < 0.6), {"tach": "shaft"}),
        "azimuth": (np.degrees(angle) % 360.0, {"azimuth": "shaft"}),
    }[sensor]
    channels = ["y", Channel(name="F", unit="N"), "shaft"]
    record = Record(
        values=np.concatenate([values, inputs, shaft[None]]),
        sample_rate=PHASES / mathieu().period,
        channels=channels,
    )
    if measured:
        return identify(record, inputs=["F"], validate=False, **clock)
    return identify(record, channels=["y"], validate=False, **clock, excitation="ambient")


def told(found):
    return {own.code: own.severity.name for own in found.findings if own.severity.name != "NOTE"}


@pytest.mark.parametrize("measured", [pytest.param(True, marks=pytest.mark.slow), False])
def test_pulses_that_are_sampled_coarsely_beside_an_orbit_fail(wandering, measured):
    """What the error of the angle made of the orbit came out as a mode, and passed."""
    assert told(identified(wandering, 20.0, "pulses", measured))["vague_angle"] == "FAILURE"


@pytest.mark.first(1)
@pytest.mark.parametrize("measured", [True, False])
def test_an_azimuth_beside_an_orbit_is_as_good_as_it_needs_to_be(wandering, measured):
    """The curve leaves what is alike from sample to sample, and so small that it does nothing."""
    found = identified(wandering, 20.0, "azimuth", measured)
    assert found.model.order == 2
    assert not {"vague_angle", "angle_alike"} & set(told(found))


@pytest.mark.slow
def test_inputs_that_act_at_once_are_no_steady_response(wandering):
    values, inputs, angle = wandering
    channels = [Channel(name="y", unit="m/s^2", quantity="acceleration"), Channel(name="F", unit="N"), "shaft"]
    shaft = (np.degrees(angle) % 360.0)[None]
    sampled = PHASES / mathieu().period
    record = Record(values=np.concatenate([values, inputs, shaft]), sample_rate=sampled, channels=channels)
    found = identify(record, inputs=["F"], azimuth="shaft", validate=False, excitation="ambient")
    assert found.fit.acting == 1
    assert "vague_angle" not in told(found)
