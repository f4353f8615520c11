"""The scan over orders: true poles stay, those of noise mostly do not, and what is measured is what is said."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import linear_sum_assignment

import floquid.order._scan as stable_module
from floquid.errors import InputError
from floquid.lti import (
    AMI,
    ERA,
    WHITE,
    AbstractIdentifier,
    MaximumLikelihood,
    ModalModel,
    Outcome,
    TimeResponses,
    compress,
    fit_residues,
)
from floquid.lti import _factor as compress_module
from floquid.order import Stability, Tolerances, indicators, scan, stability
from floquid.order._types import delayed_edge

DT = 0.5
PAIRS = [np.exp(-0.02 + 0.5j), np.exp(-0.03 + 1.4j), np.exp(-0.015 + 2.6j)]
NEGATIVE = -0.97
MULTIPLIERS = np.array([mu for upper in PAIRS for mu in (upper, upper.conjugate())] + [NEGATIVE])


def decays(*, outputs=40, inputs=1, samples=200, noise=0.02, seed=0, multipliers=MULTIPLIERS, lengths=None):
    """Responses of complex residues of rank one, and white noise of its own size on each output."""
    generator = np.random.default_rng(seed)
    residues = []
    for mu in multipliers:
        shape, gain = (np.array([1.0, 1.0j]) @ generator.standard_normal((2, n)) for n in (outputs, inputs))
        if mu.imag < 0:
            residues.append(residues[-1].conj())
        else:
            residues.append(np.outer(shape, gain) if mu.imag > 0 else np.outer(shape.real, gain.real) + 0j)
    residues = np.reshape(residues, (len(multipliers), outputs, inputs))
    values = np.einsum("roi,rk->oik", residues, multipliers[:, None] ** np.arange(samples)).real
    scale = np.geomspace(1e-3, 1e3, outputs)[:, None, None]
    largest = np.abs(values).max(axis=2).mean(axis=1, keepdims=True) if len(multipliers) else np.ones((outputs, 1))
    std = noise * largest * np.ones((1, inputs))
    values = (values + std[:, :, None] * generator.standard_normal(values.shape)) * scale
    return TimeResponses(values=values, dt=DT, noise=std * scale[:, :, 0], lengths=lengths)


def true_ones(model, multipliers=MULTIPLIERS):
    """Which poles of a model are the true ones (modes,): those nearest to them, one to one, and near."""
    distance = np.abs(np.subtract.outer(model.multipliers, multipliers))
    rows, columns = linear_sum_assignment(distance)
    near = np.zeros(model.order, dtype=bool)
    near[rows[distance[rows, columns] < 0.01]] = True
    return near


def shares_that_stay(seeds=range(5), **changes):
    """Of the true poles and of the others, the share that is stable in everything, orders 10 to 30."""
    true, false = [], []
    for seed in seeds:
        found = scan(decays(seed=seed, **changes), orders=range(8, 31, 2))
        for model, levels in zip(found.models[1:], found.stable[1:], strict=True):
            near = true_ones(model)
            true += list(levels[near] == Stability.SHAPE) + [False] * (len(MULTIPLIERS) - near.sum())
            false += list(levels[~near] == Stability.SHAPE)
    return np.mean(true), np.mean(false)


# Stability.


@pytest.mark.first(1)
@pytest.mark.parametrize(("inputs", "noise"), [(1, 0.02), (2, 0.02), (1, 0.1)])
def test_true_poles_stay_and_poles_of_noise_mostly_do_not(inputs, noise):
    true, false = shares_that_stay(inputs=inputs, noise=noise)
    assert true > 0.9
    assert false < 0.25


def without_conjugate(a, b):
    lengths = np.outer(np.sum(np.abs(a) ** 2, axis=1), np.sum(np.abs(b) ** 2, axis=1))
    return np.abs(a @ b.T) ** 2 / lengths


def by_index(misfit):
    n = min(misfit.shape)
    return np.arange(n), np.arange(n)


def by_nearest(misfit):
    return np.arange(len(misfit)), misfit.argmin(axis=1)


@pytest.mark.parametrize(("name", "mutant"), [("mac", without_conjugate), ("paired", by_index)])
def test_the_test_sees_a_broken_comparison(monkeypatch, name, mutant):
    """A test of the test: with these, true poles seem to come and go."""
    monkeypatch.setattr(stable_module, name, mutant)
    assert shares_that_stay(range(2))[0] < 0.7


def model_of(multipliers, shapes, **changes):
    """A model of pairs, given by their upper multiplier, and of real poles."""
    full, residues = [], []
    for mu, shape in zip(multipliers, shapes, strict=True):
        both = np.iscomplexobj(mu) and np.imag(mu) != 0
        full += [mu, np.conj(mu)] if both else [mu]
        residues += [shape, np.conj(shape)] if both else [np.real(shape)]
    return ModalModel(multipliers=full, residues=np.array(residues)[:, :, None], dt=DT, **changes)


SHAPES = np.random.default_rng(3).standard_normal((4, 6)) + 1j * np.random.default_rng(4).standard_normal((4, 6))


def levels(here, there, shapes=(SHAPES[:1], SHAPES[:1]), **changes):
    return stability(model_of(here, shapes[0]), model_of(there, shapes[1]), **changes).tolist()


def test_each_level_has_its_own_limit():
    mu = np.exp(-0.02 + 1.0j)
    limits = Tolerances(frequency=0.002, damping=0.05, decay=5e-4, shape=0.95)
    assert limits == Tolerances()
    turn = 2.0 * np.pi * limits.frequency
    for factor, level in ((0.99, 3), (1.01, 0)):
        assert levels([mu], [mu * np.exp(1j * factor * turn)]) == [level, level]
        # of the larger decay; of hardly any damping, the absolute limit
        slower = -0.02 * (1.0 - 0.05 * factor)
        assert levels([mu], [np.exp(slower + 1.0j)]) == [3 if factor < 1 else 1] * 2
        still = [[np.exp(-1e-6 + 1.0j)], [np.exp(-1e-6 - factor * limits.decay + 1.0j)]]
        assert levels(*still) == [3 if factor < 1 else 1] * 2
        # a heavily damped mode has a wide line
        assert levels([np.exp(-1.0 + 1.0j)], [np.exp(-1.0 + 1.0j * (1.0 + 0.05 * factor))]) == [level, level]
        orthogonal = SHAPES[1] - SHAPES[0] * (SHAPES[0].conj() @ SHAPES[1]) / np.linalg.norm(SHAPES[0]) ** 2
        angle = np.arccos(np.sqrt(1.0 - factor * 0.05))
        unit = [one / np.linalg.norm(one) for one in (SHAPES[0], orthogonal)]
        turned = np.cos(angle) * unit[0] + np.sin(angle) * unit[1]
        assert levels([mu], [mu], (SHAPES[:1], [turned])) == [3 if factor < 1 else 2] * 2


def test_a_shape_is_free_up_to_a_complex_factor_and_weighed_by_noise():
    mu = np.exp(-0.02 + 1.0j)
    assert levels([mu], [mu], (SHAPES[:1], SHAPES[:1] * (3.0 - 4.0j))) == [3, 3]
    assert levels([mu], [mu], (SHAPES[:1], SHAPES[:1].conj())) == [2, 2]
    loud = SHAPES[0].copy()
    loud[2] += 40.0
    noise = np.ones((6, 1))
    assert levels([mu], [mu], (SHAPES[:1], [loud])) == [2, 2]
    noise[2] = 1e4
    assert levels([mu], [mu], (SHAPES[:1], [loud]), noise=noise) == [3, 3]


def test_angles_go_round_at_pi():
    """A mode next to the end of the band, seen on this side and on the other."""
    here, there = np.exp(-0.02 + 1j * (np.pi - 0.003)), np.exp(-0.02 + 1j * (np.pi + 0.003))
    assert levels([here], [there]) == [3, 3]


def test_real_multipliers_compare_by_decay_alone():
    near, far = -0.9, -0.9 * np.exp(-0.02)
    assert levels([near], [near * np.exp(-0.001)]) == [3]
    assert levels([near], [far]) == [0]
    assert levels([near], [-near]) == [0]
    assert levels([near], [near], (SHAPES[:1], SHAPES[1:2])) == [2]
    pair = np.exp(np.log(0.9) + 1j * (np.pi - 1e-4))
    assert levels([near], [pair], (SHAPES[:1], SHAPES[:1])) == [0]


def test_poles_are_paired_one_to_one():
    """Two poles near one: a single match; and crossing poles are told apart by their shapes."""
    mu, close = np.exp(-0.02 + 1.0j), np.exp(-0.02 + 1.004j)
    twice = levels([mu, close], [mu], (SHAPES[:2], SHAPES[:1]))
    assert twice == [3, 3, 0, 0]
    crossed = levels([mu, close], [close, mu], (SHAPES[:2], SHAPES[:2]))
    assert crossed == [3, 3, 3, 3]
    # Of shapes that are alike, each pole is within all tolerances of one, and has the decay of the other.
    here, there = (np.exp(np.array([first, second])) for first, second in
                   ((-0.02 + 1.0j, -0.0209 + 1.4j), (-0.0209 + 1.0115j, -0.02 + 1.3885j)))  # fmt: skip
    assert levels(here, there, (SHAPES[[0, 0]], SHAPES[[0, 0]])) == [3, 3, 3, 3]


def test_the_pairing_can_fail(monkeypatch):
    monkeypatch.setattr(stable_module, "paired", by_nearest)
    mu, close = np.exp(-0.02 + 1.0j), np.exp(-0.02 + 1.004j)
    assert levels([mu, close], [mu], (SHAPES[:2], SHAPES[:1])) != [3, 3, 0, 0]


def test_models_of_other_responses_are_refused():
    with pytest.raises(InputError, match="of the same responses"):
        stability(model_of([0.5], SHAPES[:1]), model_of([0.5], SHAPES[:1, :4]))


@pytest.mark.parametrize("name", ["frequency", "damping", "decay", "shape"])
@pytest.mark.parametrize("value", [0.0, 1.0, -0.1, np.nan, "a"])
def test_impossible_tolerances_are_refused(name, value):
    with pytest.raises(InputError, match=f"Argument `{name}` of `Tolerances` must"):
        Tolerances(**{name: value})


# The scan.


@pytest.mark.first(1)
@pytest.mark.parametrize("identifier", [None, MaximumLikelihood(), MaximumLikelihood(initial=ERA())], ids=repr)
def test_any_identifier_is_scanned_and_prepared_once(identifier, monkeypatch):
    chosen = ERA() if identifier is None else identifier
    prepared, words = [], []
    prepare = type(chosen).prepare
    monkeypatch.setattr(type(chosen), "prepare", lambda self, data: (prepared.append(self), prepare(self, data))[1])
    found = scan(decays(), identifier, [8, 2, 7, 8], report=words.append)
    assert found.orders == (2, 7, 8)
    assert [model.order for model in found.models] == [2, 7, 8]
    assert prepared.count(chosen) == 1
    assert words[-3:] == ["scanning: order 2", "scanning: order 7", "scanning: order 8"]
    assert true_ones(found.models[1]).all()
    assert found.n_stable.tolist() == [int((flags == 3).sum()) for flags in found.stable]
    assert found.n_stable[-1] >= 7


@pytest.mark.slow
def test_an_identifier_of_rank_one_is_given_residues_of_rank_one():
    """Weights that differ from hit to hit would turn the shapes: AMI, which relies on them, would not end."""
    data = decays(inputs=2, samples=100)
    uneven = TimeResponses(
        values=data.values, dt=DT, noise=data.noise * np.random.default_rng(0).uniform(0.5, 2.0, data.noise.shape)
    )
    for identifier in (AMI(), MaximumLikelihood(initial=AMI())):
        assert true_ones(scan(uneven, identifier, [7]).models[0]).all()
    exact, product = (compress(uneven, rank_one=one) for one in (False, True))

    def second(principal):
        """The second singular value of each mode's residues, over the first, with hardly any noise on them."""
        model = fit_residues(MULTIPLIERS, principal)
        return max(np.divide(*np.linalg.svd(r, compute_uv=False)[:2][::-1]) for r in model.residues)

    assert second(product) < 0.05
    assert second(exact) > 0.1


class Unreached(AbstractIdentifier):
    """ERA, that stops at eight poles."""

    __slots__ = ()
    decides = False

    def prepare(self, data):
        return ERA().prepare(data)

    def extract(self, state, order=None, *, report=lambda _: None):
        found = ERA().extract(state, min(order, 8))
        outcome = Outcome.SUCCESS if order <= 8 else Outcome.ORDER_UNREACHED
        return ModalModel(multipliers=found.multipliers, residues=found.residues, dt=found.dt, outcome=outcome)

    def refine(self, state, model):
        return model


def test_an_order_not_reached_is_kept_and_takes_no_part():
    found = scan(decays(), Unreached(), [7, 8, 9, 11])
    assert [model.outcome.name for model in found.models] == ["SUCCESS", "SUCCESS", *["ORDER_UNREACHED"] * 2]
    assert found.n_stable[1] >= 7
    # The same eight poles again: they would all agree with themselves.
    assert [levels.tolist() for levels in found.stable[2:]] == [[0] * 8] * 2
    assert_allclose(found.criteria.cost[2:], found.criteria.cost[1])


def test_an_order_is_compared_with_the_last_one_that_was_reached():
    class Skipping(Unreached):
        def extract(self, state, order=None, *, report=lambda _: None):
            found = ERA().extract(state, 2 if order == 8 else order)
            outcome = Outcome.ORDER_UNREACHED if order == 8 else Outcome.SUCCESS
            return ModalModel(multipliers=found.multipliers, residues=found.residues, dt=found.dt, outcome=outcome)

    found = scan(decays(), Skipping(), [7, 8, 9])
    assert found.n_stable.tolist()[1] == 0
    assert found.n_stable[2] >= 7


def test_orders_when_none_are_given():
    assert scan(decays(samples=200)).orders == tuple(range(2, 41, 2))
    assert scan(decays(samples=21)).orders == (2, 4, 6, 8, 10)
    for samples in (2, 3, 4):
        assert len(scan(decays(samples=samples)).models) == 1


@pytest.mark.parametrize("orders", [[], [0], [2.5], "2", 4, [2, 200], [True]])
def test_impossible_orders_are_refused(orders):
    with pytest.raises(InputError, match="Argument `orders` of `scan` must"):
        scan(decays(), orders=orders)


def test_what_is_no_identifier_is_refused():
    with pytest.raises(InputError, match="Argument `identifier` of `scan` must be an identifier"):
        scan(decays(), "era")


# Criteria.


def left_by(model, data):
    """The weighted sum of squares that the model leaves of the data themselves."""
    fitted = fit_residues(model.multipliers, data)
    total = 0.0
    for i, length in enumerate(data.lengths):
        powers = model.multipliers[:, None] ** np.arange(length)
        rest = data.values[:, i, :length] - (fitted.residues[:, :, i].T @ powers).real
        total += np.sum((rest / data.noise[:, i, None]) ** 2)
    return total


SIZES = [{}, {"outputs": 90, "samples": 60}, {"inputs": 2, "samples": 60, "lengths": [60, 45]}]


@pytest.mark.parametrize("size", SIZES, ids=["tall", "wide", "two of unequal length"])
def test_criteria_are_those_of_the_data_themselves(size):
    data = decays(**size)
    found = scan(data, orders=[2, 7, 9])
    criteria, numbers = found.criteria, data.n_outputs * data.lengths.sum()
    costs = [left_by(model, data) for model in found.models]
    assert_allclose(criteria.cost, costs, rtol=1e-9)
    parameters = np.array([2, 7, 9]) * (1 + data.n_outputs * data.n_inputs)
    energy = sum(np.sum((data.values[:, i, :n] / data.noise[:, i, None]) ** 2) for i, n in enumerate(data.lengths))
    assert_allclose(criteria.left, np.array(costs) / energy, rtol=1e-9)
    fitted = numbers * np.log(np.array(costs) / numbers)
    assert_allclose(criteria.aic, fitted + 2 * parameters)
    charge = np.array([2, 7, 9]) * (np.log(numbers) + data.n_outputs * np.log(data.lengths).sum())
    assert_allclose(criteria.bic, fitted + charge)
    assert np.argmin(criteria.aic) == np.argmin(criteria.bic) == 1
    assert_allclose(criteria.degrees, numbers - parameters)
    assert criteria.misfit[1] == pytest.approx(1.0, abs=6.0 * np.sqrt(2.0 / criteria.degrees[1]))


def test_a_growing_pole_overflows_nothing():
    class Growing(Unreached):
        def extract(self, state, order=None, *, report=lambda _: None):
            return ModalModel(multipliers=[40.0], residues=np.zeros((1, *state.data.noise.shape)), dt=DT)

    criteria = scan(decays(samples=400), Growing(), [1]).criteria
    assert np.isfinite(criteria.cost).all()
    assert 0.0 < criteria.left[0] < 1.0


# Principal responses.


@pytest.mark.parametrize("size", SIZES, ids=["tall", "wide", "two of unequal length"])
def test_principal_responses_say_the_same(size):
    data = decays(**size)
    found = compress(data)
    width = int(data.lengths.sum())
    assert found.values.shape == (min(data.n_outputs, width), data.n_inputs, data.values.shape[2])
    assert found.dt == data.dt
    assert not found.values.flags.writeable
    rows = [
        np.concatenate([v[:, i, :n] / s[:, i, None] for i, n in enumerate(data.lengths)], axis=1)
        for v, s in ((data.values, data.noise), (found.values, np.ones_like(found.noise)))
    ]
    assert_allclose(rows[1].T @ rows[1], rows[0].T @ rows[0], atol=1e-9 * np.abs(rows[0].T @ rows[0]).max())
    strength = np.linalg.norm(rows[1], axis=1)
    assert (np.diff(strength) <= 1e-9 * strength[0]).all()
    both = [fit_residues(MULTIPLIERS, one) for one in (data, found)]
    shapes = [(one.residues / s).reshape(7, -1) for one, s in zip(both, (data.noise, 1.0), strict=True)]
    assert_allclose(stable_module.mac(shapes[1], shapes[1]), stable_module.mac(shapes[0], shapes[0]), atol=1e-9)
    # White noise keeps its energy.
    quiet = decays(**size, multipliers=MULTIPLIERS[:0])
    small = compress(quiet)
    energy = sum(np.sum((small.values[:, i, :n] / small.noise[:, i, None]) ** 2) for i, n in enumerate(small.lengths))
    assert energy == pytest.approx(len(small.values) * width, rel=6.0 * np.sqrt(2.0 / (quiet.n_outputs * width)))


@pytest.mark.parametrize("noise", [1e-9, 1e-7, 0.02])
def test_rounding_stays_below_the_noise(noise):
    """More outputs than samples, nearly without noise: a squared matrix would drown what is left in rounding."""
    data = decays(outputs=120, samples=60, noise=noise)
    found = scan(data, orders=[7])
    assert found.criteria.misfit[0] == pytest.approx(1.0, abs=0.15)
    assert found.criteria.cost[0] == pytest.approx(left_by(found.models[0], data), rel=5e-4)


def test_what_is_too_large_is_seen_by_its_leading_directions(monkeypatch):
    data = decays(outputs=60, samples=300)
    whole = scan(data, orders=[2, 7])
    monkeypatch.setattr(compress_module, "LARGEST", 1000)
    monkeypatch.setattr(compress_module, "LEADING", 20)
    assert compress(data).values.shape == (20, 1, 300)
    part = scan(data, orders=[2, 7])
    assert true_ones(part.models[1]).all()
    assert_allclose(part.criteria.cost, whole.criteria.cost, rtol=0.02)
    assert_allclose(part.criteria.left, whole.criteria.left, rtol=0.02)
    assert part.indicators.n_above == 7


# Indicators.


@pytest.mark.parametrize("size", [{}, {"outputs": 90, "samples": 60}, {"inputs": 2}], ids=["tall", "wide", "two"])
def test_mode_indicator_functions_are_singular_values_of_adjacent_lines(size):
    data = decays(**size)
    found = indicators(data, smoothing=3)
    samples = data.values.shape[2]
    spectra = np.fft.fft(data.values / data.noise[:, :, None]) / np.sqrt(samples)
    assert_allclose(found.angles, 2.0 * np.pi * np.arange(samples // 2 + 1) / samples)
    for line in (0, 1, 16, samples // 2):
        matrix = spectra[:, :, np.mod([line - 1, line, line + 1], samples)].reshape(data.n_outputs, -1)
        values = np.linalg.svd(matrix, compute_uv=False)
        edge = np.sqrt(data.n_outputs) + np.sqrt(matrix.shape[1])
        assert_allclose(found.cmif[line], values / edge, rtol=1e-6, atol=1e-9)


def test_a_second_curve_rises_where_there_are_two_modes():
    alone = np.array([PAIRS[1], PAIRS[1].conjugate()])
    close = PAIRS[1] * np.exp(0.03j)
    both = np.concatenate([alone, [close, close.conjugate()]])
    seconds = []
    for multipliers in (alone, both):
        found = indicators(decays(outputs=100, multipliers=multipliers))
        assert found.cmif[:, 0].max() > 10.0
        peak = np.abs(found.angles - 1.4) < 0.1
        seconds.append(found.cmif[peak, 1].max())
    assert seconds[0] < 2.0
    assert seconds[1] > 2.5 * seconds[0]


def test_several_inputs_of_one_mode_raise_one_curve():
    """Noise that differs from hit to hit must not make a second mode out of one."""
    data = decays(inputs=3, multipliers=MULTIPLIERS[:2])
    uneven = TimeResponses(
        values=data.values, dt=DT, noise=data.noise * np.random.default_rng(0).uniform(0.5, 2.0, data.noise.shape)
    )
    found = indicators(uneven)
    top = int(np.argmax(found.cmif[:, 0]))
    assert found.cmif[top, 1] < 0.1 * found.cmif[top, 0]


def test_composites_are_those_of_the_data_and_of_what_a_model_leaves():
    data = decays(samples=400)
    found = indicators(data, fit_residues(MULTIPLIERS, data))
    mean = np.abs(np.fft.rfft(data.values[:, 0] / data.noise)).mean(axis=0) / 20.0
    assert_allclose(found.composite, mean, rtol=1e-9)
    assert found.residual is not None
    assert found.residual.mean() == pytest.approx(WHITE, rel=0.05)
    assert indicators(data).residual is None


@pytest.mark.parametrize(
    ("size", "delays"),
    [({"outputs": 100}, 1), ({"outputs": 400, "samples": 60}, 1), ({"outputs": 3}, 22), ({"outputs": 1}, 64),
     ({"outputs": 40, "inputs": 2}, 1), ({"outputs": 10, "inputs": 2, "lengths": [200, 90]}, 4)],
)  # fmt: skip
def test_as_many_singular_values_rise_above_the_noise_as_there_are_poles(size, delays):
    for seed in range(4):
        found = indicators(decays(seed=seed, noise=0.004, **size))
        assert found.delays == delays
        assert found.n_above == 7
        noise = indicators(decays(seed=seed, multipliers=MULTIPLIERS[:0], **size))
        assert noise.n_above == 0
        assert noise.singular_values[0] > 0.5 * noise.noise_edge
        assert noise.cmif[:, 0].max() < 1.6


def test_the_edge_of_noise_is_passed_once_in_a_thousand():
    """By draws: hardly ever above, and close below."""
    generator = np.random.default_rng(0)
    ratios = [
        np.linalg.svd(generator.standard_normal((80, 120)), compute_uv=False)[0] / delayed_edge(80, 120, 1)
        for _ in range(300)
    ]
    assert np.mean(np.array(ratios) > 1.0) < 0.015
    assert 0.97 < max(ratios) < 1.03


@pytest.mark.parametrize("smoothing", [0, 2, 1.5, 203])
def test_impossible_smoothing_is_refused(smoothing):
    with pytest.raises(InputError, match="Argument `smoothing` of `indicators` must"):
        indicators(decays(), smoothing=smoothing)


def test_a_model_of_a_scan_is_not_one_of_the_data():
    data = decays(outputs=300, samples=50)
    with pytest.raises(InputError, match="fit_residues"):
        indicators(data, scan(data, orders=[7]).models[0])
