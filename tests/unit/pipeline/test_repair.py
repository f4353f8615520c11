"""What a record shows to be no free response: cut, left out, or refused, and said."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from floquid import Channel, IdentificationError, Record, identify
from floquid.preparation import prepare
from floquid.systems import JeffcottRotor

ROTOR = JeffcottRotor()


def ringing(*, noise=0.01, seed=1, periods=60, phase=0.0):
    return ROTOR.simulate(n_periods=periods, samples_per_period=24, noise=noise, seed=seed, first_phase=phase)


def with_values(record, values):
    return replace(record, values=values)


def codes(prepared):
    return [own.code for own in prepared.findings]


def right(analysis):
    """True where the exponents are the rotor's, within five deviations and modulo the fundamental."""
    from floquid import floquet

    truth, model = floquet.modes(ROTOR.system, ROTOR.period).exponents, analysis.model
    if model.order != 4:
        return False
    gaps = np.subtract.outer(truth, model.exponents)
    gaps = gaps.real + 1j * (gaps.imag - model.fundamental * np.rint(gaps.imag / model.fundamental))
    own, std = gaps[np.abs(gaps).argmin(axis=0), range(4)], model.exponent_std
    return bool((np.abs(own.real) < 5 * std.real).all() and (np.abs(own.imag) < 5 * std.imag).all())


def quiet_first(record, samples):
    sigma = 0.01 * np.abs(record.values).max(axis=1, keepdims=True)
    noise = sigma * np.random.default_rng(3).standard_normal((record.n_channels, samples))
    return with_values(record, np.concatenate([noise, record.values], axis=1))


@pytest.mark.first(1)
@pytest.mark.parametrize("samples", [40, 72])
def test_what_comes_before_the_blow_is_cut_off(samples):
    quiet = quiet_first(ringing(phase=(samples % 24) / 24.0), samples)
    prepared = prepare(quiet)
    assert codes(prepared) == ["cut_at_blows"]
    # A short quiet stretch is no longer than what foretells the next sample: up to a period of the decay goes with it.
    late = prepared.responses[0].start * quiet.sample_rate - samples
    assert -1.5 < late < (1.5 if samples > 64 else 24)
    assert f"{prepared.responses[0].start:.6g}" in str(prepared.findings[0])
    found = identify(quiet)
    assert right(found)
    assert found.passed
    assert codes(prepare(quiet, repair=False)) == []


def test_a_second_blow_makes_two_hits_where_the_first_lasted():
    first, second = ringing(periods=130), ringing(periods=60, noise=0.0)
    values = np.array(first.values)
    values[:, 24 * 70 :] += second.values
    hit_twice = with_values(first, values)
    found = identify(hit_twice, validate=False)
    assert len(found.cycles) == 2
    assert right(found)
    assert any("hit again" in warning for warning in found.warnings)


@pytest.mark.slow
def test_a_strong_first_response_is_kept_before_a_longer_weak_one():
    first, second = ringing(periods=130), ringing(periods=80, noise=0.0)
    values = np.array(first.values)
    values[:, 24 * 50 :] += 0.3 * second.values
    found = identify(with_values(first, values), validate=False)
    assert [hit.n_cycles for hit in found.cycles] == [50, 80]
    assert right(found)


def test_spikes_are_left_out():
    record = ringing()
    values = np.array(record.values)
    size = np.abs(values).max(axis=1)
    at = [(0, 300), (2, 701), (1, 1100)]
    for row, sample in at:
        values[row, sample] += 0.8 * size[row]
    prepared = prepare(with_values(record, values))
    assert codes(prepared) == ["spikes"]
    missing = np.isnan(prepared.records[0].values)
    assert all(missing[row, sample] for row, sample in at)
    assert missing.sum() <= 3 * 4 * record.n_channels
    assert right(identify(with_values(record, values), validate=False))


def test_clipped_samples_and_a_channel_that_stands_still_are_left_out():
    record = ringing()
    values = np.array(record.values)
    level = 0.7 * np.abs(values[0]).max()
    values[0] = np.clip(values[0], -level, level)
    values[3, :80] = 0.0
    prepared = prepare(with_values(record, values))
    assert codes(prepared) == ["left_out", "left_out"]
    assert_array_equal(np.isnan(prepared.records[0].values[0]), np.abs(values[0]) == level)
    assert np.isnan(prepared.records[0].values[3, :80]).all()
    found = identify(with_values(record, values))
    assert right(found)
    assert found.passed


def test_a_good_record_stays_as_it_is():
    for seed in range(6):
        record = ringing(seed=seed, noise=0.02)
        prepared = prepare(record)
        assert_array_equal(prepared.records[0].values, record.values)
        assert prepared.findings == ()


def test_a_force_that_goes_on_is_refused():
    record = ringing()
    force = np.random.default_rng(0).standard_normal((1, record.n_samples))
    channels = (*record.channels, Channel(name="F", quantity="force", unit="N"))
    driven = replace(record, values=np.concatenate([record.values, force]), channels=channels)
    with pytest.raises(IdentificationError, match=r"'F' is a force that acts during the record: .*`inputs=F`"):
        identify(driven)
    # One of two forces that is not named is no response, and not left out in silence either.
    both = replace(
        driven,
        values=np.concatenate([driven.values, force[:, ::-1]]),
        channels=(*channels, Channel(name="G", quantity="force", unit="N")),
    )
    with pytest.raises(IdentificationError, match=r"'G' is a force that acts .*`inputs=F,G`"):
        identify(both, inputs=["F"])
    blow = np.zeros_like(force)
    blow[0, :3] = 100.0
    free = replace(driven, values=np.concatenate([record.values, blow + 0.01 * force]))
    assert prepare(free).responses


def test_a_random_response_is_refused():
    """The rotor driven by white noise: two broad peaks that last."""
    generator, times = np.random.default_rng(4), np.arange(24 * 400) / 24.0
    total = np.zeros((2, len(times)))
    for frequency in (0.23, 0.41):
        lags = np.arange(24 * 60) / 24.0
        kernel = np.exp(-0.1 * lags) * np.sin(2.0 * np.pi * frequency * lags)
        total += np.array(
            [np.convolve(row, kernel)[: len(times)] for row in generator.standard_normal((2, len(times)))]
        )
    wind = Record(values=total, sample_rate=24.0, channels=["x", "y"]).with_clock(ringing().clock)
    wind = wind.with_clock(replace(wind.clock, period=1.0))
    with pytest.raises(IdentificationError, match=r"does not decay, and is random.*by the ground\. Identify it .*amb"):
        identify(wind)
    blows = np.zeros((1, len(times)))
    blows[0, ::2400] = 1.0
    hit = replace(
        wind,
        values=np.concatenate([wind.values, blows]),
        channels=(*wind.channels, Channel(name="F", quantity="force", unit="N")),
    )
    with pytest.raises(IdentificationError, match=r"Name what was measured of it as inputs \(`inputs=F`\)"):
        identify(hit)
    assert prepare(wind, repair=False).responses
