"""Impacts found in records of several hits whose instants are known, and the free responses between them.

The system is linear and periodic, so a record of several hits is the sum of the free responses to each, every one
begun at its own phase of the period.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from floquid.core import Channel, PulseTimes, Record
from floquid.errors import InputError
from floquid.sync import _impact_search, find_hits, find_impacts, segment, split_hits
from floquid.systems import JeffcottRotor

ROTOR = JeffcottRotor()
PHASES = 50
RATE = PHASES / ROTOR.period
SCALES = np.array([1.0, 3e9, 2e-7, 40.0])[:, None]
UNITS = ("m", "nm", "km", "mm")
HITS = ((0, 1.0, 45.0), (3317, 0.6, 100.0), (6504, 0.8, 10.0))


@cache
def free(hits, n_periods):
    """The sum of the free responses to hits of (first sample, size, direction [deg])."""
    total = np.zeros((4, n_periods * PHASES))
    for first, size, direction in hits:
        response = ROTOR.simulate(
            n_periods=n_periods - first // PHASES,
            samples_per_period=PHASES,
            noise=0.0,
            impulse_deg=direction,
            first_phase=(first % PHASES) / PHASES,
        )
        total[:, first:] += size * response.values[:, : total.shape[1] - first]
    return total


def measured(hits=HITS, *, n_periods=200, seed=0, noise=0.02, imbalance=5.0, start=0.0):
    """The free responses with an imbalance response, noise, and channels of very different scales."""
    response = free(hits, n_periods)
    largest = np.abs(response).max(axis=1, keepdims=True)
    generator = np.random.default_rng(seed)
    angle = ROTOR.speed * np.arange(response.shape[1]) / RATE
    forced = sum(size * np.cos(k * angle + generator.uniform(0, 2 * np.pi, (4, 1))) for k, size in ((1, 1.0), (2, 0.2)))
    values = response + imbalance * largest * forced + noise * largest * generator.standard_normal(response.shape)
    channels = [
        Channel(name=c.name, quantity="displacement", unit=u) for c, u in zip(ROTOR.channels, UNITS, strict=True)
    ]
    return Record(values=SCALES * values, sample_rate=RATE, channels=channels, start=start)


def samples(record, times):
    return (np.asarray(times) - record.start) * record.sample_rate


def with_force(record, blows, *, noise=0.01, seed=1, at_row=4):
    """`record` with the force of soft blows of (first sample, length, size)."""
    force = noise * np.random.default_rng(seed).standard_normal(record.n_samples)
    for first, length, size in blows:
        force[first : first + length] += size * np.sin(np.pi * (np.arange(length) + 0.5) / length) ** 2
    channels = list(record.channels)
    channels.insert(at_row, Channel(name="hammer", unit="N"))
    return replace(record, values=np.insert(record.values, at_row, force, axis=0), channels=tuple(channels))


@pytest.mark.first(8)
@pytest.mark.parametrize("seed", range(20))
def test_hits_in_the_response_of_others_are_found_to_two_samples(seed):
    record = measured(seed=seed)
    found = samples(record, find_hits(record))
    assert_allclose(found, [3317, 6504], atol=2)


def test_what_the_detector_needs_is_what_makes_it_see(monkeypatch):
    """A mutant: a model of one coefficient foretells no oscillation, and sees no hit for its own errors."""
    monkeypatch.setattr(_impact_search, "LONGEST_MEMORY", 1)
    monkeypatch.setattr(_impact_search, "_memory", lambda complete, _: (1, np.ones(len(complete) - 1, dtype=bool)))
    assert len(find_hits(measured())) != 2


@pytest.mark.slow
@pytest.mark.parametrize("imbalance", [0.0, 5.0])
def test_one_free_response_has_no_hit_in_fifty_seeds(imbalance):
    counts = [len(find_hits(measured(HITS[:1], seed=seed, n_periods=100, imbalance=imbalance))) for seed in range(50)]
    assert counts == [0] * 50


@pytest.mark.slow
def test_a_response_that_is_over_long_before_the_record_has_no_hit_and_a_late_one_is_seen():
    """The predictor is fitted where it rings, too: rows at even distances hold noise alone."""
    times, generator, turns = np.arange(150_000) / PHASES, np.random.default_rng(0), np.arange(-3, 4)
    shapes = generator.standard_normal((4, 14, 2)) @ np.array([1.0, 1j]) * 0.5 ** np.abs(np.tile(turns, 2))
    rates = np.add.outer([-0.02 + 1.3j, -0.015 + 2.5j], 2j * np.pi * turns).ravel()
    response = 2.0 * (shapes @ np.exp(np.outer(rates, times))).real
    values = response + 0.3 * generator.standard_normal(response.shape)
    record = Record(values=values, sample_rate=PHASES, channels=list("abcd"))
    assert find_impacts(record) == ()
    values[:, 100_000:] += response[:, :-100_000]
    assert_allclose(samples(record, find_hits(replace(record, values=values))), [100_000], atol=2)


def test_neither_a_record_without_noise_nor_one_of_noise_alone_has_a_hit():
    assert find_hits(measured(HITS[:1], noise=0.0)) == ()
    assert find_hits(measured(HITS[:1], noise=3.0)) == ()


@pytest.mark.slow
def test_errors_that_grow_and_fall_with_the_response_are_not_hits():
    """As where the system is not quite linear: an error of 5 % of a response that dies away, and all the same a hit."""
    for seed in range(10):
        for hits, found in ((HITS[:1], []), ((HITS[0], (6504, 0.5, 45.0)), [6504])):
            response = free(hits, 200)
            fading = 0.05 * np.exp(-np.arange(response.shape[1]) / 1500)
            error = fading * np.random.default_rng(seed).standard_normal(response.shape)
            record = measured(hits, seed=seed, noise=0.002)
            largest = np.abs(response).max(axis=1, keepdims=True)
            faulty = replace(record, values=record.values + SCALES * largest * error)
            assert_allclose(samples(faulty, find_hits(faulty)), found, atol=2)


@pytest.mark.slow
def test_noise_that_comes_and_goes_raises_the_limit():
    """What is usual is as scattered as the record shows: noise whose level changes every 60 samples, by up to four."""
    for seed in range(5):
        generator = np.random.default_rng(seed)
        levels = np.repeat(np.exp(generator.uniform(-0.7, 0.7, 167)), 60)[:10000]
        for hits, found in ((HITS[:1], []), (HITS, [3317, 6504])):
            record = measured(hits, seed=seed, noise=0.0)
            largest = np.abs(free(hits, 200)).max(axis=1, keepdims=True)
            gusty = record.values + 0.003 * SCALES * largest * levels * generator.standard_normal(record.values.shape)
            record = replace(record, values=gusty)
            assert_allclose(samples(record, find_hits(record)), found, atol=2)


def test_channels_that_tell_the_same_do_no_harm():
    for noise in (0.0, 0.02):
        record = measured(noise=noise)
        channels = (*record.channels, Channel(name="again"), Channel(name="still"))
        twice = np.vstack([record.values, 2.0 * record.values[:1], np.ones_like(record.values[:1])])
        doubled = replace(record, values=twice, channels=channels)
        assert_allclose(samples(doubled, find_hits(doubled)), [3317, 6504], atol=2)


def test_one_channel_without_noise_or_with_it_shows_the_hits():
    hits = (HITS[0], (3317, 0.8, 60.0), HITS[2])
    for noise in (0.0, 0.02):
        record = measured(hits, noise=noise).select(["X"])
        assert_allclose(samples(record, find_hits(record)), [3317, 6504], atol=3)


@pytest.mark.first(1)
@pytest.mark.parametrize("first", [5, 20, 100])
def test_a_record_that_begins_shortly_before_its_only_hit_shows_it(first):
    for seed in range(5):
        record = measured(((first, 1.0, 45.0),), seed=seed)
        (found,) = samples(record, find_hits(record))
        assert first - 1 <= found <= first + 8


def test_missing_stretches_and_samples_do_not_look_like_hits():
    record = measured()
    values = record.values.copy()
    values[:, 1200:1500] = np.nan
    values[2, 5000:5070] = np.nan
    values[np.random.default_rng(3).random(values.shape) < 1e-3] = np.nan
    values[2, 3296] = values[0, 3348] = np.nan
    first, second = find_impacts(replace(record, values=values))
    # Samples are missing on either side of the first: it lies where neither prediction reaches.
    assert samples(record, first.start) < 3317 < samples(record, first.end)
    assert_allclose(samples(record, [first.start, first.end]), 3317, atol=45)
    assert_allclose(samples(record, second.start), 6504, atol=2)


@pytest.mark.slow
def test_an_impact_that_lasts_has_an_end_after_which_the_response_is_free():
    """Blows 30 samples long: a hit begins in each of them."""
    length = 30
    blow = tuple((4000 + k, np.sin(np.pi * (k + 0.5) / length), 80.0) for k in range(length))
    quiet = measured((HITS[0], *blow), noise=0.001)
    (impact,) = find_impacts(quiet)
    start, end = samples(quiet, [impact.start, impact.end])
    assert 4000 <= start <= 4005
    assert 4025 <= end <= 4030
    # The weak begin and end of the blow drown in more noise.
    (impact,) = find_impacts(measured((HITS[0], *blow)))
    start, end = samples(quiet, [impact.start, impact.end])
    assert 4000 <= start < end <= 4030
    assert end - start > 8
    assert not impact.double


def test_a_bounce_is_one_impact_that_is_flagged():
    record = measured((HITS[0], (4000, 1.0, 80.0), (4250, 0.7, 80.0), (8000, 1.0, 20.0)))
    first, second = find_impacts(record, apart=400 / RATE)
    assert first.double
    assert not second.double
    assert_allclose(samples(record, [first.start, first.end, second.start]), [4000, 4250, 8000], atol=3)
    assert "more than one blow" in first.finding.clause
    assert "more than one blow" not in second.finding.clause
    assert_allclose(samples(record, find_hits(record)), [4000, 4250, 8000], atol=3)
    # Nearer than the model looks back they cannot be told apart, and are still flagged.
    near, _ = find_impacts(measured((HITS[0], (4000, 1.0, 80.0), (4090, 0.7, 80.0), (8000, 1.0, 20.0))), apart=1 / RATE)
    assert near.double


def test_a_hit_weaker_than_the_least_does_not_count():
    record = measured((HITS[0], (3000, 1.0, 80.0), (6000, 0.3, 80.0)))
    weak = find_impacts(record)[1]
    assert 0.15 < weak.strength < 0.45
    assert_allclose(samples(record, find_hits(record, least=0.6)), [3000], atol=2)


def test_chatter_is_not_a_hit():
    """A burst of noise fails both predictions on both of its sides, and changes nothing after it."""
    record = measured(HITS[:1])
    values = record.values.copy()
    burst = np.random.default_rng(0).standard_normal((4, 300)) * np.hanning(300)
    values[:, 5000:5300] += 0.12 * SCALES * np.abs(free(HITS[:1], 200)).max(axis=1, keepdims=True) * burst
    assert find_hits(replace(record, values=values)) == ()


def test_pulses_and_the_channel_of_the_clock_are_not_read_as_responses():
    record = measured()
    pulses = (np.arange(record.n_samples) % 777 < 5) * 5.0
    channels = (*record.channels, Channel(name="tacho", quantity="pulse"))
    both = replace(record, values=np.vstack([record.values, pulses]), channels=channels)
    assert find_hits(both) == find_hits(record)
    with pytest.raises(InputError, match="have a response channel that changes"):
        find_hits(both.select(["tacho"]))
    assert len(find_impacts(both, channels=["X", "Y"])) == 2


def test_the_force_shows_where_an_impact_begins_and_ends():
    record = with_force(measured(), [(3310, 12, 40.0), (6500, 9, -25.0)])
    first, second = find_impacts(record)
    assert_allclose(samples(record, [first.start, first.end]), [3310, 3322], atol=1)
    assert_allclose(samples(record, [second.start, second.end]), [6500, 6509], atol=1)
    assert (first.channel, second.channel) == ("hammer", "hammer")
    assert first.strength == 1.0
    assert second.strength == pytest.approx(25 / 40, abs=0.02)
    assert "seen in the force 'hammer'" in first.finding.clause


def test_a_bounce_in_the_force_is_flagged_and_a_small_one_is_passed_over():
    record = with_force(measured(), [(3310, 12, 40.0), (3340, 8, 15.0), (6500, 9, 25.0), (6530, 9, 0.5)])
    first, second = find_impacts(record)
    assert first.double
    assert samples(record, first.end) == pytest.approx(3348, abs=1)
    assert not second.double
    assert samples(record, second.end) == pytest.approx(6509, abs=1)


def test_a_force_that_shows_no_blow_leaves_it_to_the_response():
    record = with_force(measured(), [])
    assert all(impact.channel is None for impact in find_impacts(record))
    assert len(find_hits(record)) == 2
    assert find_hits(record, force="hammer") == ()
    shaken = with_force(measured(HITS[:1]), [(k * 60, 60, (-1.0) ** k) for k in range(160)])
    assert find_hits(shaken) == ()


def test_pieces_are_views_from_after_one_impact_to_before_the_next():
    record = with_force(measured(start=7.0), [(3310, 12, 40.0), (6500, 9, 25.0)])
    first, second = split_hits(record)
    assert_array_equal(first.values, record.values[:4, 3322:6500])
    assert_array_equal(second.values, record.values[:4, 6509:])
    assert np.shares_memory(first.values, record.values)
    assert not first.values.flags.writeable
    assert first.start == pytest.approx(7.0 + 3322 / RATE, rel=1e-12)
    assert [c.name for c in first.channels] == ["X", "Y", "X_tt", "Y_tt"]
    left, words = first.provenance.steps
    assert left == "force channel 'hammer' left out"
    assert words.startswith("hit 1 of 2 at ")
    assert words.endswith("3178 samples; 3322 samples before the first piece left out")


def test_a_force_in_the_midst_of_the_channels_is_left_out_too():
    record = with_force(measured(), [(3310, 12, 40.0)], at_row=1)
    (piece,) = split_hits(record)
    assert_array_equal(piece.values, record.values[[0, 2, 3, 4], 3322:])
    assert not piece.values.flags.writeable


def test_the_pieces_are_free_responses_of_the_one_system():
    """Each is what the rotor does from the state after the hit, at the shaft phase the clock gives it."""
    clocked = measured(noise=0.0, imbalance=0.0).with_clock(ROTOR.simulate(n_periods=1).clock)
    whole, *rest = split_hits(clocked, (clocked.start, *find_hits(clocked)))
    cycles = segment([whole, *rest])
    assert len({c.first_phase for c in cycles}) == 1
    for piece in rest:
        assert piece.clock is clocked.clock
        n = round((piece.start - clocked.start) * RATE)
        assert_array_equal(piece.values, clocked.values[:, n : n + piece.n_samples])
    # One monodromy matrix carries all three from period to period: the state is the mass at two phases.
    states = [np.concatenate([c.values[:2, 0], c.values[:2, 12]]) / SCALES[[0, 1, 0, 1], 0, None] for c in cycles]
    before, after = (np.hstack([s[:, cut] for s in states]) for cut in (slice(0, -1), slice(1, None)))
    joint, *_ = np.linalg.lstsq(before.T, after.T, rcond=1e-10)
    assert np.abs(before.T @ joint - after.T).max() < 1e-6 * np.abs(after).max()


def test_a_record_without_hits_is_one_free_response():
    record = measured(HITS[:1])
    (piece,) = split_hits(record)
    assert_array_equal(piece.values, record.values)
    assert np.shares_memory(piece.values, record.values)


def test_instants_of_the_caller_are_taken_and_a_blow_under_way_is_waited_for():
    record = with_force(measured(start=-3.0), [(3310, 12, 40.0), (6500, 9, 25.0)])
    times = [record.start, record.start + 3310 / RATE, record.start + 6000 / RATE]
    pieces = split_hits(record, times)
    assert [round(samples(record, p.start)) for p in pieces] == [0, 3322, 6000]
    assert [p.n_samples for p in pieces] == [3310, 2678, 4000]
    impacts = find_impacts(record)
    assert [p.start for p in split_hits(record, impacts)] == [i.end for i in impacts]


def test_what_is_skipped_or_too_short_is_left_out_and_said():
    record = measured()
    at = [n / RATE for n in (0, 3000, 3100, 6000)]
    first, third, fourth = split_hits(record, at, skip=50 / RATE)
    assert [p.n_samples for p in (first, third, fourth)] == [2950, 2850, 3950]
    assert f"hit 2 ({at[1]:.6g} s, {50 / RATE:.4g} s)" in first.provenance.steps[-1]
    assert "after the impact skipped" in third.provenance.steps[-1]
    assert third.provenance.steps[-1].startswith("hit 3 of 4 ")
    assert len(split_hits(record, at, skip=50 / RATE, shortest=50 / RATE)) == 4
    assert len(split_hits(record, at, skip=50 / RATE, shortest=3000 / RATE)) == 1


@pytest.mark.parametrize("start", [0.0, 0.1, -1e4 / 3])
def test_an_instant_on_a_sample_begins_with_that_sample(start):
    record = measured(start=start)
    for first in (1, 7, 123, 3001, 9973):
        (piece,) = split_hits(record, [start + first / RATE])
        assert piece.n_samples == record.n_samples - first
        (piece,) = split_hits(record, [start + (first + 0.3) / RATE])
        assert piece.n_samples == record.n_samples - first - 1


def test_pieces_keep_the_clock():
    record = measured().with_clock(PulseTimes(times=np.array([0.0, 1.0])))
    assert all(piece.clock is record.clock for piece in split_hits(record))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"instants": [5.0, 4.0]}, "`instants` of `split_hits` must ascend"),
        ({"instants": [-1.0]}, "must lie within the record"),
        ({"instants": [1e9]}, "must lie within the record"),
        ({"instants": ["now"]}, "`instants` of `split_hits` must be a finite number"),
        ({"skip": -1.0}, "`skip` of `split_hits` must not be negative"),
        ({"instants": [0.0], "skip": 1e9}, "`skip` of `split_hits` must leave pieces"),
        ({"instants": [0.0], "shortest": 1e9}, "must leave pieces of at least"),
        ({"shortest": 0.0}, "`shortest` of `split_hits` must be positive"),
        ({"force": "nobody"}, "`force` of `find_impacts` must name channels of the record"),
    ],
)
def test_what_cannot_be_split_is_refused(change, message):
    with pytest.raises(InputError, match=message):
        split_hits(measured(), **change)


def test_what_cannot_be_searched_is_refused():
    record = measured()
    with pytest.raises(InputError, match="`least` of `find_impacts` must be below 1"):
        find_hits(record, least=5.0)
    with pytest.raises(InputError, match="`apart` of `find_impacts` must be positive"):
        find_impacts(record, apart=0.0)
    with pytest.raises(InputError, match=r"to find impacts in 4 response channels, but has 20, and 0 of them miss"):
        find_hits(replace(record, values=record.values[:, :20]))
    values = record.values.copy()
    values[0, ::2] = np.nan
    with pytest.raises(InputError, match="5000 of them miss a channel"):
        find_hits(replace(record, values=values))
