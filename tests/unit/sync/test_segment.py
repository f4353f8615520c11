"""Records cut into whole periods and joined again: which samples go where, and what is refused."""

import pickle
import re

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from floquid.core import Channel, ConstantPeriod, Cycles, Provenance, Record
from floquid.errors import InputError, NotSynchronousError
from floquid.sync import rejoin, segment

RATE = 50.0
PERIOD = 0.2  # ten samples


def record(*, samples=47, start=0.0, origin=0.0, period=PERIOD, rate=RATE, channels=("X", "Y"), values=None):
    """A record whose sample n of channel c is 1000 c + n, so that each value says where it came from."""
    counted = 1000.0 * np.arange(len(channels))[:, None] + np.arange(samples)
    return Record(
        values=counted if values is None else values,
        sample_rate=rate,
        channels=channels,
        clock=None if period is None else ConstantPeriod(period=period, origin=origin),
        start=start,
        provenance=Provenance(sources=("counted",)),
    )


def refused(records):
    with pytest.raises(InputError) as error:
        segment(records)
    return str(error.value)


def test_sample_k_of_cycle_m_is_sample_k_plus_m_periods():
    (cycles,) = segment(record())
    assert cycles.values.shape == (2, 10, 4)
    channel, phase, cycle = np.ogrid[:2, :10, :4]
    assert_array_equal(cycles.values, 1000.0 * channel + phase + 10 * cycle)
    assert_array_equal(cycles.periods, np.full(4, PERIOD))
    assert cycles.first_phase == 0.0


def test_the_cycles_are_a_view_of_the_record():
    whole = record()
    (cycles,) = segment(whole)
    assert np.shares_memory(cycles.values, whole.values)
    assert not cycles.values.flags.writeable


def test_what_is_left_out_is_told():
    (cycles,) = segment(record(samples=47))
    assert cycles.provenance.sources == ("counted",)
    assert cycles.provenance.steps == ("cut into 4 periods of 10 samples; 7 samples left out",)
    (cycles,) = segment(record(samples=40))
    assert cycles.provenance.steps == ("cut into 4 periods of 10 samples",)


@pytest.mark.parametrize(
    ("start", "origin", "phase"), [(0.06, 0.0, 0.3), (0.0, 0.06, 0.7), (1.06, -0.4, 0.3), (-0.14, 0.0, 0.3)]
)
def test_one_record_may_start_at_any_phase(start, origin, phase):
    (cycles,) = segment(record(start=start, origin=origin))
    assert cycles.first_phase == pytest.approx(phase, abs=1e-12)
    assert cycles.values[0, 0, 0] == 0.0


def test_hits_are_cut_to_the_phase_of_the_first():
    """The second starts three samples after phase zero, so seven of its samples go before the next phase zero."""
    first, second = segment([record(), record(start=0.06, samples=60)])
    assert (first.first_phase, second.first_phase) == (0.0, 0.0)
    assert second.values[0, 0, 0] == 7.0
    assert (first.n_cycles, second.n_cycles) == (4, 5)
    first, second = segment([record(start=0.06), record()])
    assert second.first_phase == pytest.approx(0.3)
    assert second.values[0, 0, 0] == 3.0


def test_hits_a_rounding_error_apart_in_phase_lose_nothing():
    for slip in (1e-12, -1e-12):
        _, second = segment([record(start=0.06), record(start=0.06 + slip)])
        assert second.values[0, 0, 0] == 0.0


def test_a_single_sample_a_period():
    (cycles,) = segment(record(period=1.0 / RATE))
    assert cycles.values.shape == (2, 1, 47)


def test_rejoin_is_the_way_back():
    whole = record(samples=40, start=0.06)
    (cycles,) = segment(whole)
    back = rejoin(cycles)
    assert_array_equal(back.values, whole.values)
    assert back.sample_rate == pytest.approx(RATE, rel=1e-12)
    assert back.channels == whole.channels
    assert back.clock.phase(back.start) == pytest.approx(0.3, abs=1e-12)


def test_rejoin_refuses_periods_that_differ():
    uneven = Cycles(values=np.ones((1, 2, 3)), periods=[1.0, 1.0, 1.1], channels=["X"])
    with pytest.raises(InputError, match=r"^Argument `cycles` of `rejoin` must have one period, but .* by 0\.1 s"):
        rejoin(uneven)


def test_the_papers_rounded_step_is_refused_with_the_way_out():
    """Δt = 0.126 with a period of 2π is 49.87 samples: a slip of 0.13 samples every period."""
    message = refused(record(samples=51200, rate=1.0 / 0.126, period=2.0 * np.pi))
    assert message.startswith("Argument `period` of `segment` must be a whole number of sampling intervals, but ")
    assert "49.866" in message
    assert "slip by 137 samples" in message
    way_out = float(re.search(r"pass period=([\d.]+);", message)[1])
    assert way_out == pytest.approx(6.3, rel=1e-10)
    (cycles,) = segment(record(samples=51200, rate=1.0 / 0.126, period=way_out))
    assert cycles.values.shape == (2, 50, 1024)


def test_a_slip_too_small_to_matter_is_let_pass():
    """A hundredth of a sample over the record is the limit, not a relative error of the period."""
    samples = 10_000
    harmless, harmful = (PERIOD * (1.0 + part * 0.01 / samples) for part in (0.9, 1.1))
    assert segment(record(samples=samples, period=harmless))[0].n_phases == 10
    assert "must be a whole number of sampling intervals" in refused(record(samples=samples, period=harmful))


def test_a_period_longer_than_the_record_is_refused():
    message = refused(record(samples=47, period=1.0))
    assert "must be shorter than the record (0.94 s), but is 1 s" in message
    assert "Check the unit of the period" in message


def test_a_period_shorter_than_a_sample_is_refused():
    assert "is 0.25 samples" in refused(record(period=0.25 / RATE))


def test_no_record_and_no_clock_are_refused():
    assert refused([]) == "Argument `records` of `segment` must hold at least one record, but is empty."
    message = refused(record(period=None))
    assert "must have a clock, but the record has none" in message
    assert "`period=`" in message
    assert "must have a clock" in refused([record(), record(period=None)])


def test_a_missing_sample_is_refused_and_located():
    values = np.ones((2, 47))
    values[1, 30] = np.nan
    message = refused(record(values=values))
    assert "must have no missing samples, but 1 are missing, the first in channel 'Y' at sample 30" in message


@pytest.mark.parametrize(
    ("other", "what"),
    [
        ({"channels": ("Y", "X")}, "channels"),
        ({"channels": (Channel(name="X", unit="mm"), Channel(name="Y"))}, "units"),
        ({"rate": 51.0}, "sample rate"),
        ({"period": 0.22}, "period"),
    ],
)
def test_hits_unlike_the_first_are_refused(other, what):
    message = refused([record(), record(), record(**other)])
    assert f"must have the same {what}, but number 1 has" in message
    assert "number 3 has" in message


def test_hits_sampled_between_the_firsts_phases_are_refused():
    message = refused([record(), record(start=0.3 / RATE)])
    assert "must be sampled at the same phases of the period, but one is 0.3 samples off" in message


def test_a_hit_that_ends_before_its_first_whole_period_is_refused():
    message = refused([record(), record(start=0.06, samples=16)])
    assert "must hold at least one whole period, but one has 16 samples, 7 of them before the first phase" in message


@pytest.mark.parametrize(
    ("records", "why"),
    [
        ([record(period=0.203)], "whole number"),
        ([record(), record(start=0.3 / RATE)], "phases"),
        ([record(), record(rate=51.0, period=PERIOD)], "rates"),
    ],
)
def test_what_keeps_records_from_being_cut_can_be_asked_for(records, why):
    with pytest.raises(NotSynchronousError) as error:
        segment(records)
    assert error.value.why == why
    again = pickle.loads(pickle.dumps(error.value))
    assert (str(again), again.why) == (str(error.value), why)


def test_what_no_resampling_would_mend_is_another_error():
    for records in ([record(period=1.0)], [record(), record(period=0.22)], [record(period=None)]):
        with pytest.raises(InputError) as error:
            segment(records)
        assert not isinstance(error.value, NotSynchronousError)
