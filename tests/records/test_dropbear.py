"""Measured decays: a cantilever with a movable roller.

DROPBEAR, High-Rate-SHM-Working-Group Dataset-8, Vereen, Downey, Dodson and Moura 2023, CC BY-SA 4.0: read from its
place, and not copied.

The system is constant; its own repeatability is the truth. Its two accelerometers, mixed with cos Ωt and sin Ωt, make
a time-periodic output on real noise, and the poles must not move.
"""

from pathlib import Path

import numpy as np
import pytest

from floquid import ConstantPeriod, FloquidError, Record, identify
from floquid.sync import rejoin, resample

FILE = Path(__file__).resolve().parents[3] / "shared" / "data" / "measured" / "dropbear_dwells.npz"
PERIOD = 0.02
"""The period of the mixing [s]."""

PUBLISHED = {1: 30.795, 2: 33.885, 3: 37.53}
"""Position of the roller, frequency [Hz]."""


def decay(position, trial):
    """Both accelerometers after the first tenth of a second, brought to 500 Hz."""
    with np.load(FILE) as archive:
        values, step = archive["y"][trial, position].T.astype(float), float(archive["dt"])
    values = values[:, round(0.1 / step) :]
    values = values - values[:, -500:].mean(axis=1, keepdims=True)
    clock = ConstantPeriod(period=PERIOD)
    record = Record(values=values, sample_rate=1.0 / step, channels=["low-g", "shock"], clock=clock)
    return rejoin(resample(record, clock, n_phases=10)[0])


def mixed(record):
    """One output that turns once a period from one accelerometer to the other."""
    angle = 2.0 * np.pi / PERIOD * record.times
    one, other = record.values / np.abs(record.values).max(axis=1, keepdims=True)
    output = one * np.cos(angle) + other * np.sin(angle)
    return Record(
        values=output[None], sample_rate=record.sample_rate, channels=["mixed"], start=record.start, clock=record.clock
    )


def nearest(record, published):
    """Frequency [Hz] and damping ratio of the strongest mode within 1 Hz, on any branch; None where there is none."""
    try:
        model = identify(record, trust_period=True, validate=False).model
    except FloquidError:
        return None
    best, size = None, 0.0
    for value, shape in zip(model.exponents, model.coefficients, strict=True):
        frequency = value.imag / (2.0 * np.pi) + np.arange(-4, 5) / PERIOD
        frequency = frequency[np.argmin(np.abs(frequency - published))]
        if abs(frequency - published) < 1.0 and np.abs(shape).max() > size:
            best, size = (frequency, -value.real / (2.0 * np.pi * frequency)), float(np.abs(shape).max())
    return best


@pytest.mark.slow
@pytest.mark.parametrize(
    ("position", "trials"),
    [(position, (3, 5, 10)) for position in PUBLISHED],
)
def test_measured_decays_and_their_mixture_have_the_same_poles(position, trials):
    if not FILE.exists():
        pytest.skip("the DROPBEAR records are not beside this checkout")
    published = PUBLISHED[position]
    found = [(nearest(r, published), nearest(mixed(r), published)) for r in (decay(position, t) for t in trials)]
    both = np.array([pair for pair in found if None not in pair])
    assert len(both) >= 2
    frequency, damping = np.median(both[..., 0], axis=0), np.median(both[..., 1], axis=0)
    assert frequency == pytest.approx(published, abs=0.04)
    assert abs(frequency[0] - frequency[1]) < 0.02
    assert damping == pytest.approx(0.0012, abs=0.0006)
