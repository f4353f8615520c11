"""Identities of periodic matrices: whatever the form, the values at every time decide."""

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from floquid.floquet import FunctionMatrix, HarmonicMatrix, PiecewiseMatrix, SampledMatrix

LAWS = settings(max_examples=20, deadline=None, derandomize=True)
KINDS = ["harmonics", "odd harmonics", "pieces", "samples", "spline", "polygon", "function", "vectorised"]
TIMES = np.mod(0.3819660112501051 * np.arange(1, 200), 1.0) * 90.0 - 41.0


class Stepped:
    """A plain callable that jumps at two places of its period."""

    def __init__(self, values, period):
        self.values, self.period = values, period

    def __call__(self, t):
        phase = np.mod(t / self.period, 1.0)
        late = (phase >= 0.25) & (phase < 0.625)
        return np.where(late, self.values[..., 1], self.values[..., 0]) * np.cos(2.0 * np.pi * phase)


class Smooth:
    """A callable of an array of times, with harmonics without end that die away quickly."""

    def __init__(self, values, period):
        self.values, self.period = values, period

    def __call__(self, times):
        turn = 2.0 * np.pi * times[:, None, None] / self.period
        return self.values[..., 0] / (2.0 + np.cos(turn)) + self.values[..., 1] * np.exp(np.sin(turn))


def build(kind, shape, period, seed):
    generator = np.random.default_rng(seed)
    values = generator.uniform(-1.0, 1.0, (*shape, 7))
    if "harmonics" in kind:
        lines = [1, 2, 5] if kind == "harmonics" else [1, 3]
        cosines, sines = values[..., : len(lines)], values[..., 3 : 3 + len(lines)]
        full = HarmonicMatrix.from_cosines(values[..., 6], cosines, sines, harmonics=lines, period=period)
        if kind == "harmonics":
            return full
        kept = np.asarray(full.harmonics) != 0  # a series need have no mean
        return HarmonicMatrix(
            coefficients=np.asarray(full.coefficients)[..., kept], harmonics=full.harmonics[kept], period=period
        )
    edges = period * np.sort(generator.choice(24, 7, replace=False)) / 24.0
    if kind == "pieces":
        return PiecewiseMatrix(values=values, edges=edges, period=period)
    if kind == "samples":
        count = 6 + seed % 2
        start = period * (seed % 3) / 30.0
        times = start + period * np.arange(count) / count
        return SampledMatrix(values=values[..., :count], period=period, times=times)
    if kind in ("spline", "polygon"):
        interpolation = "cubic" if kind == "spline" else "linear"
        return SampledMatrix(values=values, period=period, times=edges, interpolation=interpolation)
    if kind == "function":
        breaks = [0.25 * period, 0.625 * period]
        return FunctionMatrix(function=Stepped(values, period), period=period, breaks=breaks)
    return FunctionMatrix(function=Smooth(values, period), period=period, vectorised=True)


kinds, seeds, periods = st.sampled_from(KINDS), st.integers(0, 2**32 - 1), st.sampled_from([0.3, 0.2, 0.45])


def away(*several):
    """Times that lie on no jump of any of them."""
    keep = np.ones(len(TIMES), dtype=bool)
    for matrix in several:
        for at in np.asarray(matrix.breaks):
            phase = np.mod((TIMES - at) / matrix.period, 1.0)
            keep &= np.minimum(phase, 1.0 - phase) > 1e-9
    assert keep.sum() > 100
    return TIMES[keep]


def assert_close(found, wanted, tolerance):
    assert np.shape(found) == np.shape(wanted)
    assert np.abs(found - wanted).max() <= tolerance


def assert_same(found, expected, times):
    wanted = expected(times)
    assert_close(found.at(times), wanted, 2e-11 * max(1.0, np.abs(wanted).max()))


@LAWS
@given(kinds, kinds, periods, seeds, st.floats(-3.0, 3.0))
def test_arithmetic_is_pointwise(kind, other_kind, period, seed, factor):
    a = build(kind, (2, 3), period, seed)
    b, c = build(other_kind, (2, 3), period, seed + 1), build(other_kind, (3, 2), period, seed + 2)
    times = away(a, b, c)
    assert_same(a + b, lambda t: a.at(t) + b.at(t), times)
    assert_same(a - b, lambda t: a.at(t) - b.at(t), times)
    assert_same(a @ c, lambda t: a.at(t) @ c.at(t), times)
    assert_same(c @ a, lambda t: c.at(t) @ a.at(t), times)
    assert_same(a * factor, lambda t: factor * a.at(t), times)
    assert_same(np.float64(factor) * a, lambda t: factor * a.at(t), times)
    assert_same(-a, lambda t: -a.at(t), times)
    assert_same(a.T, lambda t: a.at(t).swapaxes(1, 2), times)
    assert {result.period for result in (a + b, a - b, a @ c)} == {period}


@LAWS
@given(kinds, periods, seeds)
def test_constants_keep_the_form(kind, period, seed):
    a = build(kind, (2, 3), period, seed)
    constant = np.random.default_rng(seed).normal(size=(2, 3))
    single = PiecewiseMatrix(values=constant[:, :, None], edges=[0.0], period=np.pi)  # of any period
    times = away(a)
    for other in (constant, single):
        results = [a + other, other + a, a - other, other - a, a @ other.T, other.T @ a]
        values = a.at(times)
        wanted = [values + constant, constant + values, values - constant, constant - values]
        wanted += [values @ constant.T, constant.T @ values]
        for result, expected in zip(results, wanted, strict=True):
            assert type(result) is type(a)
            assert result.period == a.period
            assert_close(result.at(times), expected, 1e-12)


@LAWS
@given(seeds, periods)
def test_exact_forms_are_kept(seed, period):
    for kind, form in (("harmonics", HarmonicMatrix), ("pieces", PiecewiseMatrix), ("spline", SampledMatrix)):
        a, b = build(kind, (2, 2), period, seed), build(kind, (2, 2), period, seed + 1)
        if kind != "spline":
            assert isinstance(a + b, form)
            assert isinstance(a @ b, form)
        assert isinstance(a + a * 2.0, form)
    trigonometric = build("samples", (2, 2), period, seed), build("harmonics", (2, 2), period, seed)
    assert isinstance(trigonometric[0] @ trigonometric[1], HarmonicMatrix)
    pieces = build("pieces", (2, 2), period, seed)
    assert np.asarray((pieces + pieces).edges) == pytest.approx(np.asarray(pieces.edges), abs=0.0)


formed = st.sampled_from(["harmonics", "pieces", "function", "vectorised"])


@LAWS
@given(formed, formed, periods, seeds)
def test_results_survive_pickling(kind, other_kind, period, seed):
    """They are sent to other processes."""
    a, b = build(kind, (2, 2), period, seed), build(other_kind, (2, 2), period, seed + 1)
    result, times = (a @ b).T + np.eye(2), away(a, b)
    assert_close(pickle.loads(pickle.dumps(result)).at(times), result.at(times), 0.0)
