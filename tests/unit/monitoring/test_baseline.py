"""Least squares over covariates, scatter, limits and charts, against sums written out and against draws."""

import numpy as np
import pytest
from scipy import stats
from tests.machines import machine

from floquid.monitoring._baseline import chart, fit_baseline, scatter_of, squared_limit
from floquid.monitoring._work import columns_of, regress, selected, slopes_of, squared_distances, terms_of


def drawn(seed, records=40, modes=2):
    values, covariance, points = zip(*machine(seed, records, modes), strict=True)
    conditions = np.array([[point["speed_rpm"], point["temperature"]] for point in points])
    return np.array(values), np.array(covariance), conditions


def stacked(values, covariance, columns):
    """One least-squares problem of white rows: features in blocks of columns, missing ones left out."""
    rows, targets = [], []
    for x, spread, d in zip(values, covariance, columns, strict=True):
        there = np.flatnonzero(np.isfinite(x))
        white = np.linalg.inv(np.linalg.cholesky(spread[np.ix_(there, there)]))
        rows.append(white @ np.kron(np.eye(len(x)), d)[there])
        targets.append(white @ x[there])
    return np.concatenate(rows), np.concatenate(targets)


def test_coefficients_and_their_covariance():
    values, covariance, conditions = drawn(0)
    values[3, 1] = values[7] = np.nan
    columns = columns_of((conditions - [700.0, 20.0]) / [50.0, 8.0], terms_of(2, 2))
    rows, targets = stacked(values, covariance, columns)
    found = regress(values, covariance, columns)
    np.testing.assert_allclose(found.coefficients.ravel(), np.linalg.lstsq(rows, targets)[0], rtol=1e-7)
    np.testing.assert_allclose(found.covariance, np.linalg.inv(rows.T @ rows), rtol=1e-6, atol=1e-16)
    one = np.kron(np.eye(4), columns[5])
    np.testing.assert_allclose(found.uncertainty(columns)[5], one @ found.covariance @ one.T, rtol=1e-9)


def test_terms_and_their_slopes():
    terms = terms_of(2, 2)
    assert terms == ((), (0,), (1,), (0, 0), (0, 1), (1, 1))
    c = np.array([[0.3, -0.7]])
    for k in range(2):
        step = np.eye(2)[k] * 1e-6
        slope = (columns_of(c + step, terms) - columns_of(c - step, terms)) / 2e-6
        np.testing.assert_allclose(slopes_of(c, terms)[:, :, k], slope, atol=1e-9)


def test_terms_that_the_features_have_are_kept():
    kept = []
    for seed in range(20):
        values, covariance, conditions = drawn(seed)
        kept.append(fit_baseline(values, covariance, conditions, 0.0 * conditions, 2).terms)
    assert all({(), (0,), (1,), (0, 0)} <= set(terms) for terms in kept)
    assert sum(len(terms) > 4 for terms in kept) <= 5  # two that are not there, each at 5 %


def test_errors_of_covariates_widen_the_features():
    values, covariance, conditions = drawn(1)
    sharp = fit_baseline(values, covariance, conditions, 0.0 * conditions, 2)
    errors = np.full_like(conditions, 0.5)
    extra = sharp.spread(covariance, conditions, errors) - covariance
    by = np.zeros((40, 4, 2))
    for k in range(2):
        step = np.eye(2)[k] * 1e-3
        up, down = (sharp.regression.predicted(sharp.columns(conditions + side * step)) for side in (1, -1))
        by[:, :, k] = (up - down) / 2e-3
    np.testing.assert_allclose(extra, 0.25 * by @ by.swapaxes(1, 2), rtol=1e-4, atol=1e-12)


def test_scatter_is_zero_until_it_is_seen():
    seen = []
    for seed in range(20):
        values, covariance, conditions = drawn(seed)
        seen.append(fit_baseline(values, covariance, conditions, 0.0 * conditions, 2).scatter.any())
    assert sum(seen) <= 5  # two tests at 5 %
    generator = np.random.default_rng(0)
    covariance = np.repeat([[[2.0, 0.5], [0.5, 1.0]]], 4000, axis=0)
    true = covariance[0] + np.array([[9.0, 3.0], [3.0, 1.0]])
    noise = generator.standard_normal((4000, 2)) @ np.linalg.cholesky(true).T
    found, rank = scatter_of(noise, covariance, 4000)
    assert rank >= 1
    np.testing.assert_allclose(found, true - covariance[0], atol=0.6)


@pytest.mark.parametrize(("degrees", "rank", "behind"), [(12, 0, 24), (12, 2, 24), (3, 3, 10), (1, 1, 12)])
def test_limits(degrees, rank, behind):
    """χ² where all is known, Hotelling's T² where no direction is, and in between more than χ²."""
    limit = squared_limit(degrees, rank, behind, 1e-3)
    if rank == 0:
        assert limit == pytest.approx(stats.chi2.isf(1e-3, degrees))
    elif rank == degrees:
        left = behind - rank + 1
        assert limit == pytest.approx(rank * behind / left * stats.f.isf(1e-3, rank, left), rel=1e-5)
    else:
        assert stats.chi2.isf(1e-3, degrees) < limit < 3.0 * stats.chi2.isf(1e-3, degrees)


@pytest.mark.parametrize("inside", [True, False])
def test_charts_have_the_covariance_of_their_averages(inside):
    """By weights of all residuals written out, errors of coefficients in common, and features that are missing."""
    values, covariance, conditions = drawn(2)
    values[4, 1] = values[6, 2] = np.nan
    base = fit_baseline(values[:20], covariance[:20], conditions[:20], 0.0 * conditions[:20], 1)
    covariance = base.spread(covariance, conditions, 0.0 * conditions)
    rows = slice(0, 20) if inside else slice(20, 40)
    columns = base.columns(conditions)[rows]
    residual = values[rows] - base.regression.predicted(columns)
    direction = np.array([1.0, 0.0, -2.0, 0.5])
    found = chart(base, residual, covariance[rows], columns, inside=inside, memory=0.25, direction=direction)
    weights = np.zeros((20, 20, 4))  # record, of record, feature
    for row in range(20):
        weights[row] = weights[row - 1] if row else 0.0
        there = np.isfinite(residual[row])
        weights[row, :, there] *= 0.75
        weights[row, row, there] += 0.25
    sign = -1.0 if inside else 1.0
    filled = np.nan_to_num(residual)
    for row in (0, 5, 8, 19):
        mean = np.einsum("jf,jf->f", weights[row], filled)
        own = np.einsum("jf,jfg,jg->fg", weights[row], covariance[rows], weights[row])
        by = np.einsum("jf,jk->fk", weights[row], columns)
        common = np.zeros((4, 4 * columns.shape[1]))
        for f in range(4):
            common[f, f * columns.shape[1] : (f + 1) * columns.shape[1]] = by[f]
        whole = own + sign * common @ base.regression.covariance @ common.T
        inverse = np.linalg.inv(whole)
        assert found.ewma[row] == pytest.approx(mean @ inverse @ mean, rel=1e-6)
        along = direction @ inverse @ mean / np.sqrt(direction @ inverse @ direction)
        assert found.directed[row] == pytest.approx(along, rel=1e-6)
    spread = covariance[rows] + sign * base.regression.uncertainty(columns)
    assert found.t2[10] == pytest.approx(residual[10] @ np.linalg.solve(spread[10], residual[10]))
    assert found.degrees[4] == (3 if inside else 4)


def test_distances_do_not_count_what_is_missing():
    values = np.array([[1.0, np.nan, 2.0]])
    spread = np.array([[[2.0, 0.3, 0.5], [0.3, 1.0, 0.2], [0.5, 0.2, 3.0]]])
    kept = spread[0][np.ix_([0, 2], [0, 2])]
    distance, degrees = squared_distances(values, spread)
    assert distance[0] == pytest.approx([1.0, 2.0] @ np.linalg.solve(kept, [1.0, 2.0]))
    assert degrees[0] == 2


def test_a_weak_dependence_is_kept():
    """Of 0.8 deviations over half the range of a third covariate: χ² about 34 of 4 degrees of freedom."""
    kept = 0
    for seed in range(10):
        values, covariance, conditions = drawn(seed)
        third = np.random.default_rng(seed).uniform(-1.0, 1.0, 40)
        values = values + 0.8 * third[:, None] * np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
        scaled = np.stack([*((conditions - [700.0, 20.0]) / [50.0, 8.0]).T, third], axis=1)
        terms = ((), (0,), (1,), (2,), (0, 0))
        kept += 3 in selected(values, covariance, scaled, terms, 0.05)
    assert kept >= 9
