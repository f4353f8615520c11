"""Make the universal files of this folder from the engine's records in `tests/data`, which are free of noise.

What a test rig adds is added here: an analyser with a rate of its own, some time before the blow, a hammer and a
tachometer, the response to the rotor's imbalance, and noise.
"""

from pathlib import Path

import numpy as np
from scipy.interpolate import make_interp_spline

import floquid as fq

HERE = Path(__file__).parent
CLEAN = HERE.parents[1] / "tests" / "data"
RATE = 512.0  # of the analyser [Hz]; the shaft does not go into it
SPEED = 1900.0 / 60.0  # of the shaft [Hz]
BEFORE, AFTER = 0.2, 3.0  # the blow [s]
SCALE = 100.0  # the engine's blow is a weak one, and the system is linear
NOISE = 0.005  # of the largest free response of each channel
IMBALANCE = {1: 0.3, 2: 0.1}  # the same, by harmonic of the revolution
NAMES = ("tip x", "tip y", "housing x", "housing y", "tilt x", "tilt y")
LATE = {1: 0.31, 2: 0.78}  # of a sample: the blow falls between two


def main() -> None:
    """Write `hit1.uff` and `hit2.uff`."""
    for hit in (1, 2):
        fq.write(measured(hit), HERE / f"hit{hit}.uff")


def measured(hit: int) -> fq.Record:
    """One triggered measurement: hammer, responses, tachometer (channels, samples)."""
    generator = np.random.default_rng(hit)
    clean = np.load(CLEAN / f"rotor_1900rpm_hit{hit}.npz")
    times = (np.arange(round((BEFORE + AFTER) * RATE)) - LATE[hit]) / RATE - BEFORE  # zero at the blow
    known = np.arange(clean["values"].shape[1]) / clean["sample_rate"]
    free = make_interp_spline(known, SCALE * clean["values"], k=7, axis=1)(np.maximum(times, 0.0))
    size = np.abs(free).max(axis=1)
    values = free + forced(times) + NOISE * size[:, None] * generator.standard_normal(free.shape)
    blow = np.exp(-0.5 * ((times - 0.0005) / 0.0004) ** 2)
    near = np.abs((SPEED * times + 0.6 + 0.5) % 1.0 - 0.5) / SPEED  # the mark passes 0.4 revolutions after the blow
    pulse = 5.0 / (1.0 + np.exp((near - 0.0015) / 0.0002))
    faint = 0.005 * generator.standard_normal((2, len(times)))
    return fq.Record(
        values=np.vstack([40.0 * (blow + faint[0]), values, pulse + faint[1]]).astype(np.float32),
        sample_rate=RATE,
        channels=[
            fq.Channel(name="hammer", quantity="force", unit="N"),
            *(
                fq.Channel(name=n, quantity="displacement", unit=str(u))
                for n, u in zip(NAMES, clean["units"], strict=True)
            ),
            fq.Channel(name="tach", quantity="pulse", unit="V"),
        ],
        start=0.0,
    )


def forced(times: np.ndarray) -> np.ndarray:
    """The response to the imbalance, which is the same in both measurements (channels, times)."""
    size = SCALE * np.abs(np.load(CLEAN / "rotor_1900rpm_hit1.npz")["values"]).max(axis=1)
    generator = np.random.default_rng(0)
    total = np.zeros((len(size), len(times)))
    for k, share in IMBALANCE.items():
        lag = generator.uniform(-np.pi, np.pi, (len(size), 1))
        total += share * size[:, None] * np.cos(2.0 * np.pi * k * SPEED * times + lag)
    return total


if __name__ == "__main__":
    main()
