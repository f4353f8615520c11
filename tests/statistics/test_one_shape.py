"""One shape for all hits: errors are those stated and near the bound, and hits are said to disagree by no chance."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import binom
from tests.several_hits import Hits

from floquid import identify
from floquid.periodic.least_squares import ModeParameters, OneShape, linearise, noise_of, record_blocks, solve
from floquid.periodic.search._one_shape import agreement

PAIRS = [-0.2 + 2.1j, -0.35 + 4.0j]
DRAWS = 100
EXPERIMENTS = {
    "three hits": Hits.drawn(PAIRS, 3, 30, noise=0.05),
    "twelve hits": Hits.drawn(PAIRS, 12, 10, noise=0.1),
}
EVERY = pytest.mark.parametrize("hits", EXPERIMENTS.values(), ids=EXPERIMENTS)


@EVERY
def test_errors_are_as_stated_and_near_the_bound(hits):
    pulls, shares, ratios, (bound, _) = [], [], [], hits.bound()
    for seed in range(DRAWS):
        found = identify(hits.records(seed), validate=False)
        model = found.model
        assert model.order == 4
        assert model.one_shape
        assert "hits_disagree" not in [finding.code for finding in found.findings]
        own = [int(np.argmin(np.abs(model.exponents - value))) for value in hits.exponents]
        off, std = model.exponents[own] - hits.exponents, model.exponent_std[own]
        pulls += [off.real / std.real, off.imag / std.imag]
        ratios += [std.real / bound.real, std.imag / bound.imag]
        places = np.searchsorted(model.harmonics, [-1, 0, 1])
        off, std = model.coefficients[own][..., places] - hits.coefficients, model.coefficient_std[own][..., places]
        kept = std.real > 0.0
        shares.append(
            np.mean([np.abs(off.real[kept] / std.real[kept]) < 1.96, np.abs(off.imag[kept] / std.imag[kept]) < 1.96])
        )
    pulls = np.array(pulls)
    assert 0.85 < np.sqrt(np.mean(pulls**2)) < 1.15
    assert 0.92 < np.mean(np.abs(pulls) < 1.96) < 0.98
    assert 0.92 < np.mean(shares) < 0.98
    # A harmonic more on each side of every band is fitted than there are. Residues of each hit: 2.1 and 3.6 times it.
    assert np.mean(ratios) < 1.5


def probabilities(hits, draws, *, known, other=None):
    """Of the agreement of hits, the noise known or estimated."""
    found = []
    for seed in range(draws):
        records = hits.records(seed, other=other)
        blocks, fundamental, _ = record_blocks(records, [record.clock for record in records], 1.0)
        blocks = [block.with_noise(np.full(len(block.rows), hits.noise)) for block in blocks]
        free = solve(blocks, ModeParameters.made(hits.exponents, (-1, 1), fundamental))
        if not known:
            noise = noise_of(blocks, free, 1e-10)
            blocks = [block.with_noise(noise[block.rows, block.hit]) for block in blocks]
            free = solve(blocks, linearise(blocks, free.entries))
        one = OneShape.at(blocks, free.entries, free.linear).solved()
        found.append(agreement(one, SimpleNamespace(blocks=blocks, solution=free)))
    return np.array(found)


@EVERY
@pytest.mark.parametrize("level", [0.05, 0.3])
def test_hits_that_agree_are_said_not_to_at_the_rate_allowed(hits, level):
    seen = np.sum(probabilities(hits, 200, known=True) < level)
    assert binom.ppf(1e-3, 200, level) <= seen <= binom.ppf(1.0 - 1e-3, 200, level)


@EVERY
def test_noise_that_is_estimated_raises_no_alarm(hits):
    """Weights that err raise the statistic a little: what the users' 1e-6 allow is never exceeded."""
    found = probabilities(hits, 200, known=False)
    assert np.sum(found < 0.05) <= binom.ppf(1.0 - 1e-3, 200, 0.1)
    assert found.min() > 1e-6


@EVERY
def test_a_hit_that_disagrees_is_told(hits):
    states = hits.states.copy()
    states[:, -1] = 1.0, 1.0j
    other = hits.shapes.copy()
    other[0, 0, 1] *= 1.5
    assert (probabilities(replace(hits, states=states), 20, known=False, other=other) < 1e-6).all()
