"""AMI: the composites, and the modes it isolates, at the edges too."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import linear_sum_assignment

from floquid.lti import AMI, WHITE, MaximumLikelihood, Outcome, TimeResponses, composites

IDENTIFIER = AMI()


def ringing(logs, *, outputs=8, inputs=1, samples=200, noise=0.01, seed=0, sizes=None, lengths=None):
    """Logarithms of all multipliers, and decays whose residues are outer products, of `sizes` in turn.

    Noise is a share of the largest response of each output and input; for none it is said to be 1e-11 of it.
    """
    generator = np.random.default_rng(seed)
    full, residues = [], []
    for s, size in zip(np.asarray(logs, complex), np.ones(len(logs)) if sizes is None else sizes, strict=True):
        shape = generator.standard_normal((2, outputs))
        part = generator.uniform(0.5, 1.5, inputs) * np.exp(2j * np.pi * generator.uniform(size=inputs))
        if s.imag in (0.0, np.pi):
            full.append(s)
            residues.append(size * np.outer(shape[0], np.abs(part) * np.sign(part.real)))
        else:
            residue = size * np.outer(shape[0] + 1j * shape[1], part)
            full += [s, s.conjugate()]
            residues += [residue, residue.conj()]
    full = np.array(full)
    values = np.einsum("roi,rk->oik", np.array(residues), np.exp(np.multiply.outer(full, np.arange(samples)))).real
    std = max(noise, 1e-11) * np.abs(values).max(axis=2)
    values = values + (noise > 0) * std[..., None] * generator.standard_normal(values.shape)
    return full, TimeResponses(values=values, dt=1.0, noise=std, lengths=lengths)


def identified(data, order=None, identifier=IDENTIFIER):
    return identifier.extract(identifier.prepare(data), order)


def farthest(found, expected):
    """The largest distance of logarithms, paired so that their sum is least; turns count modulo 2π."""
    found = np.log(found)
    assert len(found) == len(expected), f"{len(found)} poles, but {len(expected)} were expected"
    distance = np.abs(np.expm1(np.subtract.outer(found, expected)))
    return distance[linear_sum_assignment(distance)].max()


def found_within_deviations(model, logs, *, most=5.0, largest=2e-3):
    """Every pole within `most` of its deviations in both parts, none of which is above `largest`."""
    assert model.order == len(logs), f"{model.order} poles, but {len(logs)} were expected"
    distance = np.abs(np.exp(logs)[:, None] - model.multipliers)
    columns = linear_sum_assignment(distance)[1]
    off = np.log(model.multipliers[columns] / np.exp(logs))
    std = np.sqrt(np.diag(model.covariance)).reshape(2, -1)[:, columns]
    assert std.max() < largest
    assert (np.abs(off.real) <= most * std[0]).all()
    assert (np.abs(off.imag) <= most * std[1] + 1e-12).all()


# Composites.


def slow_composites(data, model):
    """Sum by sum from the definition; an input that ends early is followed by zeros."""
    outputs, inputs, samples = data.values.shape
    k, curves = np.arange(samples), np.zeros((3, samples // 2 + 1))
    for line in range(samples // 2 + 1):
        turn = np.exp(-2j * np.pi * line * k / samples)
        for o in range(outputs):
            for i in range(inputs):
                length = data.lengths[i]
                modelled = (model.residues[:, o, i] @ model.multipliers[:, None] ** k).real
                parts = np.array([data.values[o, i], modelled, data.values[o, i] - modelled])
                sums = np.abs(parts[:, :length] @ turn[:length])
                curves[:, line] += sums / (data.noise[o, i] * np.sqrt(length))
    return curves / (outputs * inputs)


@pytest.mark.first(1)
@pytest.mark.parametrize("lengths", [(30, 30), (30, 21), (12, 29)])
def test_composites_are_the_mean_magnitudes_of_data_model_and_difference(lengths):
    _, data = ringing([-0.05 + 1.0j, -0.1], outputs=3, inputs=2, samples=30, lengths=lengths)
    model = identified(data)
    found = composites(data, model)
    assert_allclose(found.angles, 2.0 * np.pi * np.arange(16) / 30, rtol=1e-15)
    assert_allclose([found.data, found.model, found.difference], slow_composites(data, model), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("samples", [200, 201])
def test_the_model_carries_its_composites_and_what_is_left_is_white(samples):
    full, data = ringing([-0.02 + 1.0j, -0.03 + 2.0j], outputs=40, samples=samples)
    model = identified(data)
    own, again = model.composites, composites(data, model)
    for name in ("angles", "data", "model", "difference"):
        curve = getattr(own, name)
        assert curve.shape == (samples // 2 + 1,)
        assert_array_equal(curve, getattr(again, name))
    assert own.data.max() > 100.0 * WHITE
    peak = own.angles[np.argmax(own.data)]
    assert np.abs(peak - np.abs(full.imag)).min() < 2.0 * np.pi / samples
    assert_allclose(own.model, own.data, atol=6.0 * WHITE)
    inner = own.difference[1:-1]
    assert np.abs(inner - WHITE).max() < 5.0 * np.sqrt((1.0 - np.pi / 4.0) / 40)
    assert inner.mean() == pytest.approx(WHITE, abs=0.02)


def test_of_no_mode_the_difference_is_the_data():
    data = TimeResponses(values=np.random.default_rng(0).standard_normal((20, 2, 50)), dt=1.0)
    own = identified(data).composites
    assert_array_equal(own.model, 0.0)
    assert_array_equal(own.difference, own.data)


# The modes that it isolates.

SYSTEMS = {
    "a pair": [-0.02 + 1.0j],
    "three pairs": [-0.02 + 0.5j, -0.03 + 1.3j, -0.015 + 2.4j],
    "a real pole": [-0.03],
    "a negative one": [-0.03 + np.pi * 1j],
    "a pair and both real kinds": [-0.02 + 1.0j, -0.03, -0.05 + np.pi * 1j],
    "a pair beside its conjugate at zero": [-0.02 + 0.01j],
    "a pair beside its conjugate at π": [-0.02 + 3.13j],
    "pairs beside their conjugates at both ends": [-0.02 + 0.01j, -0.03 + 3.12j],
    "a growing pair": [0.01 + 2.0j, -0.03 + 0.5j],
    "a growing negative one": [0.01 + np.pi * 1j, -0.03 + 0.5j],
    "one frequency, two decays": [-0.02 + 1.0j, -0.05 + 1.0j],
    "a half-power width apart": [-0.02 + 1.0j, -0.02 + 1.04j],
}


@pytest.mark.first(4)
@pytest.mark.parametrize("logs", SYSTEMS.values(), ids=SYSTEMS)
def test_every_kind_of_mode_is_found(logs):
    for seed in range(2):
        full, data = ringing(logs, seed=seed)
        model = identified(data)
        assert model.outcome is Outcome.SUCCESS
        found_within_deviations(model, full)
        assert np.count_nonzero(model.multipliers.imag == 0.0) == np.count_nonzero(np.isin(full.imag, [0.0, np.pi]))


def test_one_output_is_enough():
    full, data = ringing(SYSTEMS["three pairs"], outputs=1)
    found_within_deviations(identified(data), full, largest=0.004)


@pytest.mark.parametrize("samples", [6, 12])
def test_few_samples(samples):
    full, data = ringing([-0.1 + 1.0j], outputs=20, samples=samples)
    found_within_deviations(identified(data), full)


def test_inputs_of_unequal_length():
    full, data = ringing([-0.02 + 1.0j, -0.03 + 2.0j], inputs=3, lengths=[200, 101, 40])
    model = identified(data)
    found_within_deviations(model, full)
    assert_allclose(model.residual_std, data.noise, rtol=0.4)


@pytest.mark.parametrize("inputs", [1, 2])
def test_two_modes_of_equal_poles_are_two_where_two_inputs_tell_their_shapes_apart(inputs):
    """With one input their sum is a mode like any other."""
    full, data = ringing([-0.02 + 1.0j, -0.02 + 1.0j], inputs=inputs)
    expected = full[: 2 * inputs]
    assert farthest(identified(data).multipliers, expected) < 1e-3
    anyhow = identified(data, identifier=AMI(rank_one=False))
    assert farthest(anyhow.multipliers, full[:2]) < 1e-3


@pytest.mark.first(1)
@pytest.mark.parametrize("lengths", [None, [200, 90, 150]])
def test_residues_of_several_inputs_are_outer_products(lengths):
    _, data = ringing(SYSTEMS["a pair and both real kinds"], inputs=3, lengths=lengths)
    model, free = identified(data), identified(data, identifier=AMI(rank_one=False))
    values = np.linalg.svd(model.residues, compute_uv=False)
    assert model.order == free.order == 4
    assert (values[:, 1] < 1e-12 * values[:, 0]).all()
    loose = np.linalg.svd(free.residues, compute_uv=False)
    assert (loose[:, 1] > 1e-6 * loose[:, 0]).all()


@pytest.mark.parametrize("weaker", [1e-5, 1e-8, 1e-10])
def test_a_mode_far_below_another(weaker):
    full, data = ringing([-0.02 + 1.0j, -0.03 + 2.0j], noise=0.0, sizes=[1.0, weaker])
    assert farthest(identified(data).multipliers, full) < 1e-12 / weaker


def test_modes_of_many_strengths():
    logs = [-0.02 + 0.5j, -0.03 + 1.0j, -0.02 + 1.5j, -0.01 + 2.0j, -0.03 + 2.5j]
    full, data = ringing(logs, noise=1e-7, sizes=10.0 ** -np.arange(5))
    found_within_deviations(identified(data), full)


@pytest.mark.parametrize(("outputs", "inputs", "samples"), [(1, 1, 200), (50, 1, 200), (200, 1, 60), (10, 3, 101)])
def test_noise_alone_holds_no_mode(outputs, inputs, samples):
    for seed in range(4):
        values = np.random.default_rng(seed).standard_normal((outputs, inputs, samples))
        model = identified(TimeResponses(values=values, dt=1.0))
        assert (model.order, model.outcome) == (0, Outcome.NO_MODE)
        assert model.residues.shape == (0, outputs, inputs)


@pytest.mark.parametrize("order", [None, 2])
def test_nothing_at_all_holds_no_mode(order):
    model = identified(TimeResponses(values=np.zeros((3, 1, 20)), dt=1.0), order)
    assert model.order == 0
    assert model.outcome is (Outcome.NO_MODE if order is None else Outcome.ORDER_UNREACHED)


@pytest.mark.first(6)
@pytest.mark.parametrize("samples", [1, 2, 3, 4, 5, 8])
@pytest.mark.parametrize("outputs", [1, 2, 8])
def test_the_smallest_sizes_end_in_an_outcome_and_never_in_a_wrong_success(outputs, samples):
    for noise in (0.0, 0.02):
        full, data = ringing([-0.1 + 1.0j], outputs=outputs, samples=samples, noise=noise)
        model = identified(data)
        assert model.residues.shape == (model.order, outputs, 1)
        if model.outcome is Outcome.SUCCESS:
            assert samples >= 4
            if model.order == 2:
                assert farthest(model.multipliers, full) < (1e-9 if noise == 0.0 else 0.3)


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_fewer_samples_than_the_modes_need_are_an_outcome(noise):
    logs = -0.05 + 1j * np.linspace(0.3, 2.8, 3)
    _, data = ringing(logs, outputs=100, samples=8, noise=noise, seed=1)
    assert identified(data).outcome is Outcome.TOO_FEW_SAMPLES


def test_more_modes_than_are_allowed_are_an_outcome():
    _, data = ringing(SYSTEMS["three pairs"])
    assert identified(data, identifier=AMI(most=4)).outcome is Outcome.NOT_WHITE


# A fixed order.


def test_fewer_poles_than_there_are():
    """The strongest stay."""
    full, data = ringing([-0.02 + 1.0j, -0.03 + 2.0j, -0.1], sizes=[1.0, 0.3, 0.2])
    for order, expected in ((2, full[:2]), (4, full[:4])):
        model = identified(data, order)
        assert (model.order, model.outcome) == (order, Outcome.SUCCESS)
        assert farthest(model.multipliers, expected) < 0.02
    alone = identified(ringing([-0.02 + 1.0j])[1], 1)
    assert (alone.order, alone.outcome) == (2, Outcome.ORDER_UNREACHED), "a clear pair cannot be halved"


@pytest.mark.first(1)
@pytest.mark.parametrize("order", [4, 5, 6])
def test_more_poles_than_there_are_leave_the_true_ones_where_they_were(order):
    full, data = ringing([-0.02 + 1.0j, -0.03], sizes=[1.0, 0.5])
    model = identified(data, order)
    assert (model.order, model.outcome) == (order, Outcome.SUCCESS)
    distance = np.abs(np.subtract.outer(np.exp(full), model.multipliers)).min(axis=1)
    assert distance.max() < 2e-3
    assert model.stats["cost"] < identified(data).stats["cost"]


def test_an_order_may_be_asked_of_noise():
    model = identified(TimeResponses(values=np.random.default_rng(0).standard_normal((10, 1, 60)), dt=1.0), 2)
    assert (model.order, model.outcome) == (2, Outcome.SUCCESS)


# What it hands over.


def test_refining_goes_round_from_another_models_poles_on_other_noise():
    full, data = ringing(SYSTEMS["a pair and both real kinds"], inputs=2)
    rough = identified(data, identifier=MaximumLikelihood())
    scale = np.linspace(0.5, 2.0, 8)[:, None]
    state = IDENTIFIER.prepare(TimeResponses(values=data.values, dt=1.0, noise=data.noise * scale))
    refined, again = IDENTIFIER.refine(state, rough), IDENTIFIER.extract(state)
    assert refined.order == again.order == 4
    assert farthest(refined.multipliers, np.log(again.multipliers)) < 1e-6
    assert_allclose(refined.stats["cost"], again.stats["cost"], rtol=1e-6)
    found_within_deviations(refined, full)


def test_refining_keeps_the_outcome_and_the_order_zero():
    state = IDENTIFIER.prepare(TimeResponses(values=np.random.default_rng(0).standard_normal((3, 1, 50)), dt=1.0))
    refined = IDENTIFIER.refine(state, IDENTIFIER.extract(state))
    assert (refined.order, refined.outcome) == (0, Outcome.NO_MODE)


@pytest.mark.first(2)
@pytest.mark.parametrize("name", ["three pairs", "a pair and both real kinds", "a half-power width apart"])
@pytest.mark.parametrize("inputs", [1, 2])
def test_the_finish_of_maximum_likelihood_has_its_own_poles(name, inputs):
    _, data = ringing(SYSTEMS[name], inputs=inputs)
    alone, finished = (identified(data, identifier=MaximumLikelihood(initial=x)) for x in (None, AMI()))
    assert farthest(finished.multipliers, np.log(alone.multipliers)) < 1e-7
    position = np.abs(np.subtract.outer(alone.multipliers, finished.multipliers)).argmin(axis=1)
    std = np.sqrt(np.diag(finished.covariance)).reshape(2, -1)[:, position]
    assert_allclose(std, np.sqrt(np.diag(alone.covariance)).reshape(2, -1), rtol=1e-4)
    assert finished.stats["cost"] <= identified(data).stats["cost"] * (1.0 + 1e-9)


def test_the_finish_takes_the_order_and_the_outcome_of_the_wrapped_identifier():
    _, data = ringing(SYSTEMS["three pairs"])
    both = MaximumLikelihood(initial=AMI(most=4))
    assert identified(data, identifier=both).outcome is Outcome.NOT_WHITE
    assert identified(data, 4, identifier=MaximumLikelihood(initial=AMI())).order == 4
    noise = TimeResponses(values=np.random.default_rng(0).standard_normal((3, 1, 50)), dt=1.0)
    assert identified(noise, identifier=both).outcome is Outcome.NO_MODE


def test_where_two_poles_are_one_there_are_no_deviations():
    """A millionth apart, with one input: how they share their residues is for rounding to say."""
    _, data = ringing([-0.02 + 1.0j])
    model = identified(data)
    twice = type(model)(
        multipliers=np.concatenate([model.multipliers, model.multipliers * np.exp(1e-6)]),
        residues=np.concatenate([model.residues, model.residues]),
        dt=1.0,
    )
    refined = IDENTIFIER.refine(IDENTIFIER.prepare(data), twice)
    assert refined.order == 4
    assert farthest(refined.multipliers, np.log(twice.multipliers)) < 1e-4
    assert refined.covariance is refined.residue_spread is refined.residue_slope is None
    assert model.covariance is not None


def test_the_search_reports_each_mode_and_says_how_it_ended():
    said: list[str] = []
    _, data = ringing(SYSTEMS["three pairs"], outputs=40)
    model = IDENTIFIER.extract(IDENTIFIER.prepare(data), report=said.append)
    assert said == ["2 poles isolated", "4 poles isolated", "6 poles isolated"]
    assert model.stats["rest"] < IDENTIFIER.tolerance
    free = 40 * (200 - 6) - 6
    assert model.stats["cost"] == pytest.approx(free, abs=5.0 * np.sqrt(2.0 * free))
    assert np.sqrt(np.mean((model.residual_std / data.noise) ** 2)) == pytest.approx(1.0, rel=0.03)
