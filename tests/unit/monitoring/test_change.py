"""The instant of a change: its gain against two fits written out, its kind, and its interval."""

import numpy as np
import pytest
from tests.unit.monitoring.test_baseline import drawn, stacked

from floquid.monitoring._baseline import fit_baseline
from floquid.monitoring._change import change_of

LATER = np.arange(40) >= 15


def features(seed, at=25, kind="step", size=4.0):
    values, covariance, conditions = drawn(seed)
    columns = fit_baseline(values, covariance, conditions, 0.0 * conditions, 2).columns(conditions)
    form = np.maximum(np.arange(40) - at + 1, 0) if kind == "ramp" else np.arange(40) >= at
    direction = np.array([1.0, 0.0, -1.0, 2.0]) * np.sqrt(np.diag(covariance[0]))
    return values + size * np.multiply.outer(form, direction), covariance, columns


@pytest.mark.parametrize(("kind", "size"), [("step", 1.0), ("ramp", 0.3)])
def test_the_gain_is_the_fall_of_the_sum_of_squares(kind, size):
    values, covariance, columns = features(0, kind=kind, size=size)
    values[30, 2] = np.nan
    found = change_of(values, covariance, columns, LATER, 1e-3)
    assert found.kind == kind
    best = {}
    rows, targets = stacked(values, covariance, columns)
    before = np.linalg.lstsq(rows, targets)[1][0]
    for k in range(15, 40):
        form = np.arange(40) >= k if kind == "step" else np.maximum(np.arange(40.0) - k + 1, 0)
        wider = np.concatenate([columns, form[:, None]], axis=1)
        rows, targets = stacked(values, covariance, wider)
        solution, after, *_ = np.linalg.lstsq(rows, targets)
        best[k] = before - after[0], solution.reshape(4, -1)[:, -1] * (40 - k if kind == "ramp" else 1)
    k = max(best, key=lambda k: best[k][0])
    assert found.index == k
    assert found.gain == pytest.approx(best[k][0], rel=1e-6)
    np.testing.assert_allclose(found.size, best[k][1], rtol=1e-5)
    limit = 7.35 if kind == "step" else 3.84
    inside = [k for k, (gain, _) in best.items() if gain > found.gain - limit]
    assert found.interval == (min(inside), max(inside))


@pytest.mark.slow
def test_nothing_is_found_in_noise():
    found = [change_of(*features(seed, size=0.0), LATER, 1e-2) for seed in range(30)]
    assert sum(one is not None for one in found) <= 3


def test_the_baseline_has_no_change():
    """A step that begins in the baseline is not looked for there."""
    values, covariance, columns = features(1, at=5, size=8.0)
    found = change_of(values, covariance, columns, LATER, 1e-3)
    assert found is None or found.index >= 15
