"""Lifting: which sample goes where, the noise of each channel and hit, and what is refused."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from floquid.core import ConstantPeriod, Cycles, Provenance, Record
from floquid.errors import InputError
from floquid.lifting import lift, unlift
from floquid.sync import segment


def cycles(*, shape=(2, 3, 5), seed=0, **changes):
    generator = np.random.default_rng(seed)
    valid = {
        "values": generator.standard_normal(shape),
        "periods": np.full(shape[2], 0.5),
        "channels": [f"c{i}" for i in range(shape[0])],
        "provenance": Provenance(sources=(f"hit {seed}",)),
    }
    return Cycles(**(valid | changes))


def refused(hits):
    with pytest.raises(InputError) as error:
        lift(hits)
    return str(error.value)


def ringing(noise, *, n_channels=3, n_phases=20, n_cycles=300, seed=0):
    """Two modes in each channel at every phase, beside white noise of the deviations `noise` (channels,)."""
    generator = np.random.default_rng(seed)
    modes = np.exp(np.multiply.outer([-0.02 + 0.7j, -0.05 + 2.1j], np.arange(n_cycles)))
    residues = generator.standard_normal((n_channels, n_phases, 2)) + 1j
    white = generator.standard_normal((n_channels, n_phases, n_cycles))
    return cycles(
        shape=(n_channels, n_phases, n_cycles),
        values=(residues @ modes).real + np.asarray(noise)[:, None, None] * white,
    )


def test_outputs_are_ordered_by_channel_then_phase():
    hits = [cycles(seed=0), cycles(seed=1, shape=(2, 3, 4)), cycles(seed=2)]
    lifted = lift(hits)
    assert lifted.responses.values.shape == (6, 3, 5)
    assert_array_equal(lifted.responses.lengths, [5, 4, 5])
    for hit, one in enumerate(hits):
        for channel in range(2):
            for phase in range(3):
                row = lifted.responses.values[channel * 3 + phase, hit, : one.n_cycles]
                assert_array_equal(row, one.values[channel, phase])
    assert (lifted.n_channels, lifted.n_phases, lifted.n_hits, lifted.period) == (2, 3, 3, 0.5)
    assert lifted.provenance.sources == ("hit 0", "hit 1", "hit 2")


def test_by_channel_undoes_the_stacking():
    lifted = lift([cycles(seed=0), cycles(seed=1)])
    outputs = np.moveaxis(lifted.responses.values, -1, 0)
    split = lifted.by_channel(outputs)
    assert split.shape == (5, 2, 3, 2)
    assert split[4, 1, 2, 1] == cycles(seed=1).values[1, 2, 4]


def test_one_hit_of_one_channel_is_a_view_from_the_record_to_the_lifted_responses_and_back():
    values = np.random.default_rng(0).standard_normal((1, 60))
    values.flags.writeable = False
    record = Record(values=values, sample_rate=20.0, channels=["X"], clock=ConstantPeriod(period=0.5))
    lifted = lift(segment(record))
    assert np.shares_memory(lifted.responses.values, values)
    assert np.shares_memory(unlift(lifted)[0].values, values)


def test_phase_times():
    lifted = lift(cycles(first_phase=0.25))
    assert_allclose(lifted.phase_times, [0.125, 0.125 + 0.5 / 3, 0.125 + 1.0 / 3], rtol=1e-15)


def test_the_noise_of_each_channel_and_hit_is_found_beside_the_modes():
    """300 cycles of 20 phases tell a deviation to about a percent; the start needs no more than ten."""
    noise = np.array([[0.001, 0.1], [1.0, 0.02], [0.01, 0.3]])
    lifted = lift([ringing(noise[:, 0], seed=1), ringing(noise[:, 1], seed=2)])
    assert_allclose(lifted.noise, noise, rtol=0.1)
    assert_array_equal(lifted.responses.noise, np.repeat(lifted.noise, 20, axis=0))


def test_without_noise_a_share_of_the_largest_value_stands_for_rounding():
    clean = ringing(np.zeros(3))
    lifted = lift(clean)
    largest = np.abs(clean.values).max(axis=(1, 2))
    assert (lifted.noise[:, 0] >= 1e-10 * largest).all()
    assert (lifted.noise[:, 0] <= 1e-7 * largest).all()


def test_with_noise_changes_the_noise_alone():
    lifted = lift([cycles(seed=0), cycles(seed=1)])
    other = lifted.with_noise(np.array([[1.0, 2.0], [3.0, 0.0]]))
    assert other.responses.values is lifted.responses.values
    assert_array_equal(other.responses.lengths, lifted.responses.lengths)
    assert_array_equal(other.noise[:, 0], [1.0, 3.0])
    assert other.noise[1, 1] == pytest.approx(1e-10 * np.abs(cycles(seed=1).values[1]).max())


def test_no_hit_is_refused():
    assert refused([]) == "Argument `cycles` of `lift` must hold at least one hit, but is empty."


@pytest.mark.parametrize(
    "other",
    [
        {"channels": ["c0", "other"]},
        {"shape": (2, 4, 5)},
        {"first_phase": 0.1},
        {"periods": np.full(5, 0.6)},
    ],
    ids=["channels", "phases", "first phase", "period"],
)
def test_hits_that_are_not_alike_are_refused(other):
    message = refused([cycles(), cycles(**other)])
    assert "must be alike in channels, phases, first phase and period, but hit 2 differs from hit 1" in message
    assert "segment([hit1, hit2])" in message


def test_a_missing_sample_is_refused():
    values = np.array(cycles().values)
    values[0, 1, 2] = np.nan
    assert "must have no missing samples, but hit 2 has NaN" in refused([cycles(), cycles(values=values)])


@pytest.mark.parametrize("level", [0.0, 7.5])
def test_a_constant_channel_is_refused_by_name(level):
    values = np.array(cycles().values)
    values[1] = level
    message = refused(cycles(values=values))
    assert f"must have channels that vary, but channel 'c1' of hit 1 is constant ({level:g})" in message
    assert "`channels=`" in message


def test_all_zeros_are_refused():
    assert "channel 'c0' of hit 1 is constant (0)" in refused(cycles(values=np.zeros((2, 3, 5))))
