"""The covariance of the parameters, against the likelihood that falls beside its maximum."""

import numpy as np
import pytest
from tests.driven import mathieu
from tests.unit.inputs.test_start import samples_from

from floquid.inputs import linearise, solve
from floquid.inputs._joint import chosen_together
from floquid.inputs._solver import covariance
from floquid.inputs._start import bare_mode


def test_a_step_by_a_deviation_costs_one():
    """Twice the logarithm of the likelihood is 1 less at C e / √C_ee, coefficients fitted again (Cramér and Rao)."""
    system = mathieu()
    samples = samples_from(system, 80, 20, 0.02)
    turns = np.arange(-1.0, 2.0)
    bare = [bare_mode(samples, complex(system.exponents()[0]), turns, turns)]
    now = solve(samples, chosen_together(samples, bare, 2), at_rest=1e-9)
    (mode,), found = now.modes, covariance(samples, now)
    assert len(found) == mode.free.sum()
    for number, column in enumerate(found.T):
        step = np.zeros(len(mode.free))
        step[mode.free] = column / np.sqrt(found[number, number])
        both = [linearise(samples, [mode.moved(sign * step)]).log_likelihood for sign in (1.0, -1.0)]
        assert now.log_likelihood - np.mean(both) == pytest.approx(1.0, rel=0.1), number
