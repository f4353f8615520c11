"""Exponents across the edges of locks: intervals hold the truth, and nothing passes far off."""

import numpy as np
import pytest
from benchmarks.edge.__main__ import STEPS, judged
from benchmarks.edge.systems import FAMILIES


@pytest.mark.slow
def test_intervals_hold_on_both_sides_of_edges():
    """Of a thousand intervals together: those of one fit go together, and few of them do not tell 95 % from 92 %."""
    pulls = []
    for family in FAMILIES:
        rows = [judged(family, sign * step, seed) for step in STEPS for sign in (-1.0, 1.0) for seed in range(4)]
        assert not any(row.outcome == "refused" for row in rows)
        assert sum(row.wrong for row in rows) <= 1, family.name
        pulls += [pull for row in rows if row.order == row.true for pull in row.pulls]
    assert len(pulls) > 1000
    assert 0.93 < np.mean(np.array(pulls) < 1.96) < 0.97
