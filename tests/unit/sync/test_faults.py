"""Clipped tops, dropouts, gaps and wrapped counts in records made with them, and records that seem to have some."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from floquid.core import Channel, Record, TachometerSignal
from floquid.sync import clipped, dropouts, gaps, wrapped

RATE = 1000.0
TIMES = np.arange(8000) / RATE


def decay(*, noise=0.0, seed=0, hz=20.0, size=1.0):
    wave = size * np.exp(-0.3 * TIMES) * np.cos(2 * np.pi * hz * TIMES)
    return wave + noise * np.random.default_rng(seed).standard_normal(len(TIMES))


def quantised(values, bits, full=1.2):
    step = full / 2 ** (bits - 1)
    return step * np.round(values / step)


def record(*rows, names=None, units=None, clock=None, start=0.0):
    names = names or [f"c{n}" for n in range(len(rows))]
    units = units or ["-"] * len(rows)
    channels = [Channel(name=n, unit=u) for n, u in zip(names, units, strict=True)]
    return Record(values=np.array(rows), sample_rate=RATE, channels=channels, clock=clock, start=start)


@pytest.mark.parametrize("bits", [None, 16, 12, 10, 7])
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_a_channel_cut_at_both_ends_or_one_is_told(bits, noise):
    wave = decay(noise=noise)
    both, top = np.clip(wave, -0.7, 0.7), np.minimum(wave, 0.8)
    rows = [wave, both, top] if bits is None else [quantised(row, bits) for row in (wave, both, top)]
    two, one = clipped(record(*rows, units=["m", "m/s", "m/s^2"]))
    assert (two.numbers["channel"], one.numbers["channel"]) == ("c1", "c2")
    step = 0.0 if bits is None else 1.2 / 2**bits
    assert_allclose(two.numbers["levels"], (-0.7, 0.7), atol=1.01 * step)
    assert_allclose(one.numbers["levels"], (0.8,), atol=1.01 * step)
    if bits is None:
        assert 0.85 * np.sum(np.abs(both) == 0.7) <= two.numbers["samples"] <= np.sum(np.abs(both) == 0.7)
        assert two.numbers["share"] == two.numbers["samples"] / len(TIMES)
    low, high = two.numbers["levels"]
    assert two.clause.startswith(f"channel 'c1' is clipped at {low:.6g} m/s and {high:.6g} m/s: ")
    assert two.clause.endswith("%")
    assert " m/s^2: " in one.clause


@pytest.mark.parametrize("bits", [4, 6, 8, 12, 16])
@pytest.mark.parametrize("hz", [0.4, 1.7, 20.0, 249.9])
@pytest.mark.parametrize("noise", [0.0, 0.002, 0.05])
def test_quantisation_and_coarse_sampling_do_not_look_clipped(bits, hz, noise):
    steady = np.cos(2 * np.pi * hz * TIMES + 0.3) + noise * np.random.default_rng(1).standard_normal(len(TIMES))
    assert clipped(record(quantised(steady, bits), quantised(decay(hz=hz, noise=noise), bits))) == ()
    assert clipped(record(steady)) == ()


def test_four_samples_a_cycle_on_the_crest_do_not_look_clipped():
    """Every crest at the same float, or two at a time."""
    assert clipped(record(np.tile([1.0, 0.0, -1.0, 0.0], 2000), np.tile([0.7, 0.7, -0.7, -0.7, 0.0], 1600))) == ()


def test_pulses_and_constant_channels_are_passed_over():
    pulses = np.where(np.arange(len(TIMES)) % 100 < 6, 5.0, 0.1)
    noisy = pulses + 0.01 * np.random.default_rng(0).standard_normal(len(TIMES))
    flat = np.clip(noisy, 0.1, 5.0)
    rows = [decay(), pulses, flat, np.full_like(TIMES, 2.0)]
    assert clipped(record(*rows, units=["m", "V", "V", "V"])) == ()
    assert dropouts(record(*rows, units=["m", "V", "V", "V"])) == ()
    cut = np.clip(decay(), -0.7, 0.7)
    clock = TachometerSignal(channel="c0")
    assert clipped(record(cut, decay(), clock=clock)) == ()
    assert len(clipped(record(cut, decay()))) == 1


def test_a_force_at_rest_is_not_clipped_but_its_flat_top_is():
    force = np.zeros_like(TIMES)
    for first in (500, 4000):
        force[first : first + 40] = 30.0 * np.sin(np.pi * (np.arange(40) + 0.5) / 40)
    assert clipped(record(force, units=["N"])) == ()
    assert clipped(record(force + 0.5, units=["N"])) == ()
    blow = force[500:540]
    often = 0.5 + np.tile(np.concatenate([np.zeros(20), blow, np.zeros(100), blow]), 20)
    assert clipped(record(often, units=["N"])) == ()
    (found,) = clipped(record(np.minimum(force, 20.0), units=["N"]))
    assert found.numbers["levels"] == (20.0,)
    assert found.numbers["samples"] == int((np.minimum(force, 20.0) == 20.0).sum())


def test_padding_and_lost_samples_are_dropouts_and_not_clipping():
    lost, held, padded, lifted = decay(noise=0.01), decay(noise=0.01, seed=1), decay(noise=0.01), 3.0 + decay()
    lost[2000:2100] = 0.0
    held[3000:3050] = held[3000]
    padded[7000:] = 0.0
    lifted[5000:5020] = 0.0
    made = record(lost, held, padded, lifted, units=["m", "m", "m", "g"], start=10.0)
    assert clipped(made) == ()
    found = dropouts(made)
    assert [(d.numbers["channel"], d.numbers["samples"]) for d in found] == [
        ("c0", 100),
        ("c1", 50),
        ("c2", 1000),
        ("c3", 20),
    ]
    assert_allclose([(d.numbers["first"], d.numbers["last"]) for d in found[:2]], [(12.0, 12.099), (13.0, 13.049)])
    assert found[3].clause == "channel 'c3' stands still at 0 g from 15 to 15.019 s, 20 samples"
    assert found[1].numbers["level"] == held[3000]
    assert dropouts(made, least=200) == (found[2],) or len(dropouts(made, least=200)) == 1


def test_a_slow_or_quiet_channel_that_is_quantised_has_no_dropout():
    quiet = quantised(np.exp(-3.0 * TIMES) * np.cos(2 * np.pi * 20 * TIMES), 8)
    slow = quantised(np.cos(2 * np.pi * 0.4 * TIMES), 8)
    assert dropouts(record(quiet, slow)) == ()
    assert dropouts(record(np.clip(decay(), -0.7, 0.7))) == ()


def test_gaps_that_all_channels_share_are_one():
    values = np.array([decay(), decay(), decay()])
    values[:, 100:200] = np.nan
    values[1, 500] = np.nan
    values[:2, 7990:] = np.nan
    found = gaps(record(*values, start=2.0))
    assert [(g.numbers["channels"], g.numbers["samples"]) for g in found] == [
        (("c0", "c1", "c2"), 100),
        (("c1",), 1),
        (("c0", "c1"), 10),
    ]
    assert_allclose([(g.numbers["first"], g.numbers["last"]) for g in found], [(2.1, 2.199), (2.5, 2.5), (9.99, 9.999)])
    assert [g.clause for g in found] == [
        "all 3 channels miss 100 samples from 2.1 to 2.199 s",
        "channel 'c1' misses 1 sample at 2.5 s",
        "channels 'c0', 'c1' miss 10 samples from 9.99 to 9.999 s",
    ]
    assert gaps(record(decay())) == ()


def test_missing_samples_do_not_hide_a_flat_top():
    wave = np.clip(decay(), -0.7, 0.7)
    whole = clipped(record(wave))[0]
    wave[::97] = np.nan
    (found,) = clipped(record(wave))
    assert found.numbers["levels"] == whole.numbers["levels"]
    assert 0.8 * whole.numbers["samples"] < found.numbers["samples"] < whole.numbers["samples"]
    assert clipped(record(np.full_like(TIMES, np.nan), decay())) == ()


@pytest.mark.parametrize(("bits", "scale"), [(8, 1.0), (12, 3.7), (16, 1.0), (16, 0.00123), (24, 1.0), (32, 1.0)])
@pytest.mark.parametrize("offset", [0, 1])
def test_counts_that_wrapped_round_are_told(bits, scale, offset):
    """Signed, and unsigned with the zero in the middle; of other units too."""
    half = 2 ** (bits - 1)
    counts = np.round(decay(size=1.2 * half)) + offset * half
    lowest = (offset - 1) * half
    round_ = (counts - lowest) % (2 * half) + lowest
    jumps = int((np.abs(np.diff(round_)) > half).sum())
    (found,) = wrapped(record(decay(), round_ * scale))
    assert (found.numbers["channel"], found.numbers["bits"], found.numbers["jumps"]) == ("c1", bits, jumps)
    assert f"jumps by {2**bits} counts, its whole range, {jumps} times" in found.clause


def test_what_fills_its_range_has_not_wrapped_round():
    """A converter that is well used, one that clips, noise over all of the range, a square wave, and floats."""
    generator = np.random.default_rng(0)
    noise = generator.integers(-128, 128, len(TIMES)).astype(float)
    square = 255.0 * (np.sin(2 * np.pi * 20 * TIMES) > 0) - 128.0
    square[:256] = np.arange(-128, 128)
    rows = [np.round(127.49 * decay()), np.clip(np.round(200 * decay()), -128, 127), noise, square, decay(noise=0.1)]
    assert wrapped(record(*rows)) == ()
    pulses = record(np.round(300 * decay()).astype(np.int8), clock=TachometerSignal(channel="c0"))
    assert wrapped(pulses) == ()
