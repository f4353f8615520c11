"""Across the edge of a parametric resonance, where a pair of conjugates becomes two real multipliers."""

import numpy as np
import pytest
from scipy.optimize import brentq
from tests.driven import Driven, record_of

from floquid import Record, identify

STEPS = [0.0, *(sign * step for step in (0.001, 0.003, 0.01, 0.03, 0.1, 0.3) for sign in (1.0, -1.0))]
DRAWS, PERIODS, PHASES = 8, 160, 16


def locked(depth):
    """A damped Mathieu equation whose frequency is nearly half that of its spring, which varies by `depth`."""
    return Driven(
        A=lambda t: np.array([[0.0, 1.0], [-(1.0072 + 2.0 * depth * np.cos(2.0 * t)), -0.03]]),
        B=lambda _: np.array([[0.0], [1.0]]),
        C=lambda _: np.array([[1.0, 0.0]]),
        period=np.pi,
    )


def block_of(depth):
    """σ and q, from the trace and the determinant of the monodromy matrix: its eigenvalues lose half their digits."""
    whole = np.eye(2)
    for transition, _ in locked(depth).maps(40):
        whole = transition @ whole
    mean = 0.5 * np.log(np.linalg.det(whole))
    half = -0.5 * np.trace(whole) * np.exp(-mean)
    root = np.arccosh(half + 0j) / np.pi
    return mean / np.pi, (root**2).real


@pytest.fixture(scope="module")
def edge():
    return brentq(lambda depth: block_of(depth)[1], 0.005, 0.009, xtol=1e-14)


def test_intervals_hold_on_either_side_and_at_the_edge(edge):
    off = []
    for number, step in enumerate(STEPS):
        depth = edge * (1.0 + step)
        mean, square = block_of(depth)
        root = np.sqrt(complex(square))
        for seed in range(DRAWS):
            values, inputs = record_of(locked(depth), PERIODS, PHASES, 0.01, 100 * number + seed)
            record = Record(values=np.concatenate([values, inputs]), sample_rate=PHASES / np.pi, channels=["y", "u"])
            found = identify(record, period=np.pi, inputs=["u"], validate=False)
            model = found.model
            assert model.order == 2
            assert not found.failed
            # Both are exponents about the axis: the one of the larger real or imaginary part first.
            about = model.exponents - 1j * np.rint(model.exponents.imag)
            first = int(np.argmax(about.real + about.imag))
            gap = about[first] - mean - root
            std = model.exponent_std[first]
            off.append([abs(gap.real) / std.real, abs(gap.imag) / std.imag if std.imag else 0.0])
    off = np.array(off)
    # The other exponent errs alike. Of a real multiplier far from the edge the imaginary part is exact.
    counted = off[off > 0.0]
    share, spread = np.mean(counted < 1.96), np.sqrt(0.95 * 0.05 / len(counted))
    assert 0.93 - 1.96 * spread < share < 0.97 + 1.96 * spread
    assert off.max() < 4.0
