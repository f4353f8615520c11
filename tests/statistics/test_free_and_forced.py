"""A free decay and a forced record of one system, each identified by its own chain, have the same exponents."""

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment
from scipy.special import chdtrc
from tests.driven import mathieu, record_of, two_masses

import floquid
from floquid import ConstantPeriod, Record

PHASES = 24
SEEDS = 8
CASES = {"mathieu": (mathieu(), [1.0, 0.0], 30), "two masses": (two_masses(), [1.0, 0.6, 0.0, 0.5], 40)}


def differences(name, seed):
    """Differences of the exponents of both over their joint deviations (numbers,)."""
    system, start, decay = CASES[name]
    rate, inputs = PHASES / system.period, system.B(0.0).shape[1]
    still = np.zeros((inputs, decay * PHASES))
    outputs = [f"y{k}" for k in range(len(system.C(0.0)))]
    free, _ = record_of(system, decay, PHASES, 0.01, seed, inputs=still, start=start)
    forced, pushed = record_of(system, 80, PHASES, 0.02, 100 + seed)
    clock = ConstantPeriod(period=system.period)
    one = floquid.identify(Record(values=free, sample_rate=rate, channels=outputs, clock=clock)).model
    names = [f"u{k}" for k in range(inputs)]
    record = Record(values=np.vstack([forced, pushed]), sample_rate=rate, channels=[*outputs, *names], clock=clock)
    other = floquid.identify(record, inputs=names, validate=False).model
    assert one.order == other.order
    gap = np.subtract.outer(one.exponents, other.exponents)
    gap = gap - 1j * one.fundamental * np.rint(gap.imag / one.fundamental)
    rows, columns = linear_sum_assignment(np.abs(gap))
    upper = [k for k in range(len(rows)) if one.principal()[rows[k]].imag > 0.0]
    off, own = gap[rows, columns], (one.exponent_std[rows], other.exponent_std[columns])
    real = off.real / np.hypot(own[0].real, own[1].real)
    imag = off.imag / np.hypot(own[0].imag, own[1].imag)
    return np.concatenate([real[upper], imag[upper]])


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_exponents_agree_within_joint_deviations(name):
    found = np.concatenate([differences(name, seed) for seed in range(SEEDS)])
    squares, count = float(np.sum(found**2)), len(found)
    assert 1e-3 < chdtrc(count, squares) < 1.0 - 1e-3
    assert np.abs(found).max() < 4.5
