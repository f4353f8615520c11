"""Scans over orders: what agrees between them says something only where each order is fitted afresh."""

import pytest

from floquid.lti import LSCF, PolyLSCF
from floquid.order import scan
from floquid.pipeline import lifted
from floquid.systems import JeffcottRotor


@pytest.mark.first(1)
@pytest.mark.parametrize("kind", [LSCF, PolyLSCF])
def test_a_rational_function_has_a_denominator_of_its_own_at_each_order(kind, monkeypatch):
    """The strongest roots of one denominator agree with themselves, those of noise too."""
    data = lifted(JeffcottRotor().simulate(n_periods=240, samples_per_period=12, noise=0.01, seed=0)).responses
    degrees, prepare = [], kind.prepare

    def spied(self, data):
        degrees.append(self.degree)
        return prepare(self, data)

    monkeypatch.setattr(kind, "prepare", spied)
    found = scan(data, kind(), range(4, 31, 2))
    own = [degree for degree in degrees if degree is not None]
    assert own == sorted(set(own))
    assert len(own) == len(found.orders)
    assert 4 <= found.n_stable.max() <= 8
    degrees.clear()
    scan(data, kind(degree=64), range(4, 31, 2))
    assert degrees == [64]
