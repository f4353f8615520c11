"""Make the two noisy records of this folder from the noise-free ones in `tests/data`: white noise of 1 %, seeded."""

from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
CLEAN = HERE.parents[1] / "tests" / "data"
NOISE = 0.01


def main() -> None:
    """Add noise of 1 % of each channel's largest free response and write single-precision files."""
    for hit in (1, 2):
        clean = np.load(CLEAN / f"rotor_1900rpm_hit{hit}.npz")
        values = clean["values"]
        rng = np.random.default_rng(hit)
        noise = NOISE * np.abs(values).max(axis=1, keepdims=True) * rng.standard_normal(values.shape)
        np.savez_compressed(
            HERE / f"hit{hit}.npz",
            values=(values + noise).astype(np.float32),
            sample_rate=clean["sample_rate"],
            channels=clean["channels"],
            units=clean["units"],
        )


if __name__ == "__main__":
    main()
