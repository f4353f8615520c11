"""Scans over orders: what agrees between them says something only where each order is fitted afresh."""

import numpy as np

from floquid.lti import LSCF, PolyLSCF, TimeResponses
from floquid.order import scan


def test_a_rational_function_is_fitted_afresh_at_each_order():
    """The strongest roots of one denominator agree with themselves: poles of noise were stable, too."""
    times = np.arange(200)
    poles = np.exp([-0.02 + 1.0j, -0.03 + 2.0j])
    generator = np.random.default_rng(0)
    values = (generator.standard_normal((6, 2)) @ (poles[:, None] ** times).real)[:, None, :]
    values = values + 0.05 * generator.standard_normal(values.shape)
    data = TimeResponses(values=values, dt=1.0, noise=np.full((6, 1), 0.05))
    for identifier in (LSCF(), PolyLSCF()):
        found = scan(data, identifier, range(4, 21, 2))
        given = scan(data, type(identifier)(degree=40), range(4, 21, 2))
        assert 4 <= found.n_stable.max() <= 6 < given.n_stable.max()
