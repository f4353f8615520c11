"""Synchronous resampling beside `scipy.signal.resample_poly`: how long each takes, and what error each leaves.

`make bench` times them; in the ordinary run each is done once, as a test. The table of error against bandwidth that the
documentation shows is printed by `python benchmarks/test_resample.py`.
"""

import sys

import numpy as np
import pytest
from scipy.signal import resample_poly

from floquid.core import ConstantPeriod, Record
from floquid.sync import bandwidth, half_width, interpolate, interpolation_error, resample

RATE = 1000.0
SAMPLES = 100_000
# 64 samples a period brought to 50: a rational ratio, 25 to 32.
PERIOD = 0.064
CUTOFF = 0.5 * 50 / PERIOD
# The highest line at a half of the pass band, so that the short filter of `resample_poly` has its chance.
LINES = np.array([3.0, 31.0, 62.0, 125.0])


def response(times):
    """Eight channels of four lines."""
    angle = 2.0 * np.pi * np.multiply.outer(LINES, times)
    return np.array([np.cos(angle + channel).sum(axis=0) for channel in range(8)])


@pytest.fixture(scope="module")
def record():
    return Record(
        values=response(np.arange(SAMPLES) / RATE), sample_rate=RATE, channels=[f"X{channel}" for channel in range(8)]
    )


@pytest.mark.benchmark(group="resample 8 channels of 100 000 samples")
def test_resample(benchmark, record):
    (cycles,) = benchmark(resample, record, ConstantPeriod(period=PERIOD), n_phases=50)
    assert cycles.n_phases == 50


@pytest.mark.benchmark(group="resample 8 channels of 100 000 samples")
def test_resample_at_an_irrational_ratio(benchmark, record):
    (cycles,) = benchmark(resample, record, ConstantPeriod(period=PERIOD / np.sqrt(0.9)), n_phases=50)
    assert cycles.n_phases == 50


@pytest.mark.benchmark(group="resample 8 channels of 100 000 samples")
def test_interpolate(benchmark, record):
    times = np.arange(100, SAMPLES * 25 // 32 - 100) * PERIOD / 50
    got = benchmark(interpolate, record.values, RATE, 0.0, times, cutoff=CUTOFF)
    assert np.abs(got - response(times)).max() <= 1e-6 * len(LINES)


@pytest.mark.benchmark(group="resample 8 channels of 100 000 samples")
def test_resample_poly_with_its_own_filter(benchmark, record):
    got = benchmark(resample_poly, record.values, 25, 32, axis=1)
    inside = np.arange(100, got.shape[1] - 100)
    # Where the order and the cut-off are not asked for: three digits.
    assert 1e-4 < np.abs(got[:, inside] - response(inside * PERIOD / 50)).max() / len(LINES) < 1e-1


@pytest.mark.benchmark(group="resample 8 channels of 100 000 samples")
def test_resample_poly_with_a_filter_as_long(benchmark, record):
    """The same transition band and the same attenuation."""
    from scipy.signal import firwin, kaiserord

    taps, beta = kaiserord(20.0 * np.log10(8e6), 0.4 * CUTOFF / (0.5 * 25 * RATE))
    taper = firwin(taps | 1, CUTOFF, window=("kaiser", beta), fs=25 * RATE)
    got = benchmark(resample_poly, record.values, 25, 32, axis=1, window=taper)
    inside = np.arange(100, got.shape[1] - 100)
    assert np.abs(got[:, inside] - response(inside * PERIOD / 50)).max() <= 1e-6 * len(LINES)


@pytest.mark.benchmark(group="bandwidth 8 channels of 100 000 samples")
def test_bandwidth(benchmark, record):
    assert 125.0 <= benchmark(bandwidth, record) <= 127.0


def table(cutoff=CUTOFF):
    """Rows of (band, accuracy, half-width, and the largest error up to 0.25, 0.5, 0.75 and all of the pass band)."""
    for band in (0.5, 0.65, 0.8, 0.9, 0.95):
        for accuracy in (1e-3, 1e-6, 1e-9):
            options = {"cutoff": cutoff, "band": band, "accuracy": accuracy}
            errors = interpolation_error(np.linspace(0.0, band * cutoff, 201), RATE, **options)
            up_to = [errors[: 50 * quarter + 1].max() for quarter in (1, 2, 3, 4)]
            yield band, accuracy, half_width(RATE, **options), *up_to


def test_the_table_holds_what_is_stated():
    for _, accuracy, _, *errors in table():
        assert errors == sorted(errors)
        assert errors[-1] <= 0.8 * accuracy


if __name__ == "__main__":
    head = "band  accuracy  half-width  up to 1/4   1/2       3/4       all of the pass band"
    rows = [
        f"{band:4}  {accuracy:8.0e}  {half:10}  " + "  ".join(f"{error:8.1e}" for error in errors)
        for band, accuracy, half, *errors in table()
    ]
    sys.stdout.write("\n".join([head, *rows, ""]))
