"""A record at the edge of a resonance: nothing is claimed of the kind, and what is regular has deviations."""

import numpy as np
import pytest
from tests.driven import creeping, record_of

from floquid import Channel, Record, identify

HERTZ, HARMONICS = np.linspace(0.01, 0.1, 5), np.arange(-1, 2)


@pytest.fixture(scope="module", params=[0.01438, 0.01440], ids=["two real multipliers", "a pair"])
def case(request):
    system = creeping(request.param)
    values, inputs = record_of(system, 60, 12, 0.01, 5)
    channels = [Channel(name="y", quantity="displacement", unit="m"), Channel(name="u", unit="N")]
    record = Record(values=np.concatenate([values, inputs]), sample_rate=12 / system.period, channels=channels)
    return system, identify(record, period=system.period, inputs=["u"], states=["y"], validate=False)


def test_nothing_is_claimed_of_the_kind(case):
    _, found = case
    assert found.model.order == 2
    assert "kind_open" in {finding.code for finding in found.findings}
    std = found.model.exponent_std
    assert (std.real > 0.0).all()
    assert (std.imag > 0.0).all()


def test_the_state_matrix_and_transfer_functions_are_regular(case):
    """Shapes grow as 1/√|q|, by which A(t) and G do not."""
    system, found = case
    gap = found.state.system - np.array([system.A(time) for time in found.state.times])
    assert np.abs(gap[:, 1] / found.state.system_std[:, 1]).max() < 4.0
    assert found.state.system_std.max() < 0.06
    got = found.transfer(HERTZ, HARMONICS)
    gap = got.values - system.transfer(HERTZ, HARMONICS)
    assert max(np.abs(gap.real / got.std.real).max(), np.abs(gap.imag / got.std.imag).max()) < 4.0
