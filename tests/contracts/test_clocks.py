"""Every clock through the same laws: the facts of a clock of a record, and the phase that it says or shows."""

from dataclasses import fields

import h5py
import numpy as np
import pytest
from numpy.testing import assert_allclose

from floquid.core import (
    CLOCKS,
    AzimuthSignal,
    Channel,
    ConstantPeriod,
    PhaseClock,
    PulseTimes,
    Record,
    TachometerSignal,
)
from floquid.store._files import _put_record, _record
from floquid.sync import ShaftAngle, divisible, tied

PERIOD, ORIGIN, START, RATE, SAMPLES = 0.125, -1.66, -1.7, 512.0, 4096
TIMES = START + np.arange(SAMPLES) / RATE
TURNS = (TIMES - ORIGIN) / PERIOD
"""The truth: a shaft of constant speed, a period of the system in each revolution, at phase zero at `ORIGIN`."""

MADE = {
    ConstantPeriod: ConstantPeriod(period=PERIOD, origin=ORIGIN),
    TachometerSignal: TachometerSignal(channel="tach", pulses_per_revolution=2),
    AzimuthSignal: AzimuthSignal(channel="azimuth"),
    PulseTimes: PulseTimes(times=ORIGIN + PERIOD * np.arange(64)),
}
FACTS = ("channel", "option", "pulses_per_revolution", "period", "origin")
EVERY = pytest.mark.parametrize("clock", MADE.values(), ids=[kind.__name__ for kind in MADE])


def record(clock):
    apart = np.abs((2.0 * TURNS + 0.25) % 1.0 - 0.5)
    pulses = np.clip(0.5 + 4.0 * (0.25 - apart), 0.0, 1.0)  # half-way up at phases 0 and 1/2
    channels = ["x", "tach", Channel(name="azimuth", unit="deg")]
    values = np.array([np.cos(TIMES), pulses, 360.0 * (TURNS % 1.0)])
    return Record(values=values, sample_rate=RATE, channels=channels, start=START, clock=clock)


def off(turns, truth):
    """The largest distance of turns from the true ones, whole turns apart [periods]."""
    return np.abs((turns - truth + 0.5) % 1.0 - 0.5).max()


def test_the_table_has_every_clock():
    assert set(MADE) == set(CLOCKS)


@EVERY
def test_a_clock_of_a_record_has_the_facts_of_one(clock):
    facts = {name: getattr(clock, name) for name in FACTS}
    own = record(clock)
    assert (own.period, own.origin, own.clock_channel) == (clock.period, clock.origin, clock.channel)
    assert facts["channel"] in (None, *(channel.name for channel in own.channels))
    assert facts["option"] in ("period", "tach", "azimuth", "records")
    assert isinstance(facts["pulses_per_revolution"], int)
    assert (facts["period"] is not None) == isinstance(clock, PhaseClock)
    bare = record(None)
    assert (bare.period, bare.origin, bare.clock_channel) == (None, 0.0, None)


@EVERY
def test_each_is_tied_to_the_phase_that_is_true(clock):
    phase = tied(record(clock))
    assert isinstance(phase, PhaseClock)
    assert (phase is clock) == (clock.period is not None)
    assert_allclose(phase.period, PERIOD, rtol=1e-4)
    assert off(phase.turns(TIMES), TURNS) < 5e-3


@EVERY
def test_facts_about_the_phase_agree_with_one_another(clock):
    phase = tied(record(clock))
    turns = phase.turns(TIMES)
    assert_allclose(phase.times_at(turns), TIMES, atol=1e-9)
    for time in (START, ORIGIN, 2.345):
        zero = phase.phase_zero(time)
        assert time - 1.001 * PERIOD < zero <= time + 1e-8
        passed = phase.turns(np.array([zero, time]))
        assert abs(passed[0] - round(passed[0])) < 1e-8
        assert off(np.array([phase.phase(time)]), passed[1]) < 1e-8
    times, angles = phase.since_phase_zero(START, TIMES - START)
    assert_allclose(times, TIMES - phase.phase_zero(START), atol=1e-9)
    angles = 2.0 * np.pi / phase.period * times if angles is None else angles
    assert_allclose(angles, 2.0 * np.pi * (turns - np.floor(turns[0])), atol=1e-6)


@EVERY
def test_an_angle_that_is_measured_has_an_error_and_a_stated_period_has_none(clock):
    phase = tied(record(clock))
    assert phase.measured == (clock.period is None)
    assert phase.measured == (phase.periods_per_revolution is not None)
    assert phase.measured == (phase.since_phase_zero(START, TIMES - START)[1] is not None)
    assert phase.measured == (phase.fluctuation(TIMES) is not None)
    assert phase.measured == (phase.angle_spread(TIMES) > 0.0)
    assert phase.wander >= 0.0


@EVERY
def test_a_part_of_a_record_keeps_the_phase(clock):
    whole = divisible(clock, record(clock))
    first = 800  # the next pulse is of line 1
    part = Record(
        values=whole.values[:, first:],
        sample_rate=RATE,
        channels=whole.channels,
        start=START + first / RATE,
        clock=whole.clock,
    )
    assert off(tied(part).turns(part.times), TURNS[first:]) < 5e-3


@EVERY
def test_a_result_file_gives_the_clock_back(clock):
    with h5py.File("clock", "w", "core", backing_store=False) as file:
        _put_record(file, record(clock))
        back = _record(file).clock
    assert type(back) is type(clock)
    for field in fields(clock):
        np.testing.assert_array_equal(getattr(back, field.name), getattr(clock, field.name))


def test_an_angle_is_no_clock_of_a_record():
    shaft = tied(record(MADE[AzimuthSignal]))
    assert isinstance(shaft, ShaftAngle)
    assert not isinstance(shaft, CLOCKS)
