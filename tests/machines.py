"""A machine of which all is known: exponents of records over speed and temperature, with correlated errors."""

from collections.abc import Iterator

import numpy as np

from floquid.core import PeriodicModel
from floquid.surveys import Point

PERIOD = 2.0


def machine(seed: int, records: int, modes: int) -> Iterator[tuple[np.ndarray, np.ndarray, dict]]:
    """Exponents of a healthy machine over speed and temperature, with correlated errors: values, covariance, point."""
    generator = np.random.default_rng(seed)
    size = 2 * modes
    mixed = generator.standard_normal((size, size))
    std = 10.0 ** generator.uniform(-3.5, -2.5, size)
    shape = (mixed @ mixed.T / size + 0.3 * np.eye(size)) * np.outer(std, std)
    mean = np.concatenate([-generator.uniform(0.02, 0.05, modes), (np.arange(modes) + 0.5) * 2.7])
    by = generator.standard_normal((size, 4)) * 10.0 * std[:, None]
    for _ in range(records):
        speed, temperature = generator.uniform(-1.0, 1.0, 2)
        covariance = shape * generator.uniform(0.5, 2.0)
        x = mean + by @ [0.0, speed, temperature, speed**2]
        x = x + np.linalg.cholesky(covariance) @ generator.standard_normal(size)
        yield x, covariance, {"speed_rpm": 700.0 + 50.0 * speed, "temperature": 20.0 + 8.0 * temperature}


def as_point(x: np.ndarray, covariance: np.ndarray, point: dict, shapes: np.ndarray) -> Point:
    """Exponents as a result of one record: conjugate pairs with given shapes."""
    modes = len(x) // 2
    lam = x[:modes] + 1j * x[modes:]
    to = np.zeros((4 * modes, 2 * modes))
    to[:modes, :modes] = to[modes : 2 * modes, :modes] = np.eye(modes)
    to[2 * modes : 3 * modes, modes:], to[3 * modes :, modes:] = np.eye(modes), -np.eye(modes)
    model = PeriodicModel(
        exponents=np.concatenate([lam, lam.conj()]), harmonics=[-1, 0, 1], period=PERIOD * 700.0 / point["speed_rpm"],
        coefficients=np.concatenate([shapes, shapes.conj()[..., ::-1]]), channels=["a", "b", "c"],
        covariance=to @ covariance @ to.T,
    )  # fmt: skip
    return Point(values=point, model=model, passed=True, weak=np.zeros(2 * modes, bool))


def shapes_of(seed: int, modes: int) -> np.ndarray:
    """Random shapes of modes, mostly of their main line."""
    parts = np.random.default_rng(seed).standard_normal((2, modes, 3, 1, 3))
    return (parts[0] + 1j * parts[1]) * [0.1, 1.0, 0.1]
