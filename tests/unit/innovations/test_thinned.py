"""Linearisations of few of many samples: their rows are those of all, and steps and tests by them end where all do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.innovations.test_parts import samples
from tests.unit.innovations.test_predictor import OMEGA, STEP, modes_of, response_of

from floquid.fit import REST
from floquid.innovations import _solve
from floquid.innovations._covariance import reweighed
from floquid.innovations._derivatives import slopes
from floquid.innovations._mode import Mode
from floquid.innovations._predictor import predicted
from floquid.innovations._solve import normal_of, roughly, solve, thinned
from floquid.innovations.search import _fewer
from floquid.inputs import Limits, samples_of


def block(generator):
    """Two exponents near an axis."""

    def some(*shape):
        return 0.02 * (generator.standard_normal(shape) + 1j * generator.standard_normal(shape))

    band = np.arange(2.0)
    return Mode(exponent=-0.2 + 0j, real=True, turns=band, shape=some(4, 2), reach=band, gains=some(6, 2), square=0.01)


@pytest.mark.parametrize("stride", [1, 2, 9])
def test_derivatives_at_few_samples_are_those_at_all(stride, monkeypatch):
    for room in ("inputs._samples", "innovations._predictor", "innovations._covariance"):
        monkeypatch.setattr(f"floquid.{room}.BLOCK", 1)
    monkeypatch.setattr("floquid.inputs._samples.CHUNK", 150)
    own, generator = samples((500, 400)), np.random.default_rng(4)
    modes = [replace(mode, gains=0.1 * mode.gains) for mode in modes_of(generator)]
    at = predicted(own, [*modes, block(generator)], np.zeros((2, len(own.known))), np.ones((2, 5)))
    at = reweighed(own, at)
    whole = np.concatenate([part for _, part in slopes(own, at, at.root)])
    places, rows = (np.concatenate(found) for found in zip(*thinned(own, at, stride), strict=True))
    assert len(places) <= 900 / stride + 130
    size = np.abs(rows).max(axis=(1, 2)) / np.maximum(np.abs(whole[places]).max(axis=(1, 2)), 1e-300)
    measured = own.there[places]
    assert np.abs(rows[measured] - (size[:, None, None] * whole[places])[measured]).max() < 1e-9 * np.abs(whole).max()
    assert not rows[~measured].any()
    # Each stands for all up to the next.
    ends = np.append(places[1:], 900)
    assert np.abs(size**2 - (ends - places))[measured].max() < 1e-9


def record(seed, count, modes):
    generator = np.random.default_rng(seed)
    noise, inputs = generator.standard_normal((2, count)), generator.standard_normal((1, count))
    values = response_of(modes, noise, inputs, 0.4 + STEP * np.arange(count), np.zeros(3))
    return samples_of([values], [inputs], [0.4], step=STEP, fundamental=OMEGA, hold="none")


def test_fits_by_few_samples_end_where_those_by_all_do(monkeypatch):
    modes = [replace(mode, gains=15.0 * mode.gains) for mode in modes_of(np.random.default_rng(5))]
    own = record(6, 6000, modes)
    start = [replace(mode, exponent=1.1 * mode.exponent, gains=0.9 * mode.gains) for mode in modes]
    start = predicted(own, start, np.zeros((2, 1)), np.zeros((1, 3)))
    assert np.array_equal(roughly(own, start).matrix, normal_of(own, start).matrix)
    by_all = solve(own, start, rough=True)
    monkeypatch.setattr(_solve, "BLOCK", 1)
    whole, few = normal_of(own, by_all), roughly(own, by_all)
    assert np.array_equal(few.gradient, whole.gradient)
    assert 1e-3 < np.abs(few.matrix - whole.matrix).max() / np.abs(whole.matrix).max() < 0.3
    assert abs(solve(own, start, rough=True).log_likelihood - by_all.log_likelihood) < 3.0 * REST


def test_modes_gone_within_a_period_that_noise_explains_go_at_once(monkeypatch):
    generator, lasting = np.random.default_rng(5), modes_of(np.random.default_rng(5))[0]
    lasting = replace(lasting, gains=15.0 * lasting.gains)
    silent = replace(modes_of(generator)[1], gains=np.zeros((3, 1), complex))
    own = record(7, 3000, [lasting, silent])
    brief = [replace(lasting, exponent=at, shape=1e-3 * lasting.shape) for at in (-0.7 + 0.1j, -0.5 - 0.2j)]
    found = predicted(own, [lasting, *brief], np.zeros((2, 1)), np.zeros((1, 6)))

    def none(*_):
        raise AssertionError

    monkeypatch.setattr(_fewer, "merged", none)
    left = _fewer.needed(own, found, Limits(highest=3))
    assert len(left.modes) == 1
    assert abs(left.modes[0].exponent - lasting.exponent) < 0.03
