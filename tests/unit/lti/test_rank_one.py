"""Several hits: modes of equal multipliers are told apart, and none are made where there are none."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import linear_sum_assignment
from scipy.signal import lfilter

from floquid.lti import MaximumLikelihood, ModalModel, TimeResponses
from floquid.lti._exponentials import fit
from floquid.lti._factor import factor, factors
from floquid.lti._poles import PoleSet
from floquid.lti._significance import Removal
from floquid.lti.likelihood._rank_one import Products, Stacked, fit_products, ranks

IDENTIFIER = MaximumLikelihood()
EQUAL = [-0.02 + 1.0j, -0.02 + 1.0j]


def ringing(logs, *, outputs=30, inputs=2, samples=150, noise=0.02, seed=0, lengths=None):
    """One system started in different ways: outer products of shapes and participations."""
    generator = np.random.default_rng(seed)
    values = np.zeros((outputs, inputs, samples))
    for number, log in enumerate(np.asarray(logs, complex)):
        shape = generator.standard_normal((2, outputs))
        # Hits that excite no two modes in nearly the same proportion: those could not be told from one in noise.
        share = generator.uniform(0.6, 1.4, (2, inputs)) * np.cos(
            np.pi * number * np.arange(inputs) / (inputs - 1 or 1)
        )
        if log.imag in {0.0, np.pi}:
            residue = np.outer(shape[0], share[0])
        else:
            residue = np.outer(shape[0] + 1j * shape[1], share[0] + 1j * share[1])
        values += (residue[..., None] * np.exp(log * np.arange(samples))).real
    sigma = noise * np.abs(values).max() * np.ones((outputs, inputs))
    values = values + sigma[..., None] * generator.standard_normal(values.shape)
    return TimeResponses(values=values, dt=1.0, noise=sigma, lengths=lengths)


def found(data):
    return IDENTIFIER.extract(IDENTIFIER.prepare(data))


def farthest(one, other):
    assert len(one) == len(other), f"{len(one)} poles, but {len(other)} were expected"
    distance = np.abs(np.subtract.outer(one, other))
    return distance[linear_sum_assignment(distance)].max()


def full(logs):
    return np.exp(np.concatenate([[s, np.conj(s)] if 0 < s.imag < np.pi else [s] for s in np.asarray(logs, complex)]))


@pytest.mark.first(6)
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(
    ("logs", "inputs"),
    [
        (EQUAL, 2),
        (EQUAL, 3),
        ([*EQUAL, -0.02 + 1.0j], 3),
        ([*EQUAL, -0.03 + 2.0j], 2),
        ([-0.05 + 0j, -0.05 + 0j], 2),
        ([-0.05 + 1j * np.pi, -0.05 + 1j * np.pi, -0.02 + 1.0j], 2),
    ],
    ids=["two", "two, three hits", "three", "two of three", "two real ones", "two negative ones of three"],
)
def test_modes_of_equal_multipliers_are_told_apart_by_hits(logs, inputs, seed):
    model = found(ringing(logs, inputs=inputs, seed=seed))
    assert farthest(model.multipliers, full(logs)) < 0.02
    for residues in model.residues:
        values = np.linalg.svd(residues, compute_uv=False)
        assert values[1] < 1e-9 * values[0]


@pytest.mark.parametrize("seed", range(5))
def test_one_hit_holds_no_more_than_one_mode_of_a_multiplier(seed):
    assert found(ringing(EQUAL, inputs=1, seed=seed)).order == 2


@pytest.mark.first(3)
@pytest.mark.parametrize("noise", [0.0, 0.02, 0.1])
@pytest.mark.parametrize(
    "logs", [[-0.02 + 1.0j], [-0.02 + 1.0j, -0.03 + 2.0j], [-0.02 + 1.0j, -0.02 + 1.02j, -0.05 + 0j]]
)
def test_no_mode_is_made_where_the_multipliers_differ(logs, noise):
    for seed in range(4):
        data = ringing(logs, noise=max(noise, 1e-9), seed=seed)
        model = found(data)
        assert model.order == len(full(logs))


@pytest.mark.slow
def test_no_mode_is_made_of_coloured_noise():
    """At the frequency of a mode red noise is stronger than its mean says."""
    for seed in range(6):
        data = ringing([-0.02 + 0.1j, -0.03 + 2.0j], noise=1e-9, seed=seed)
        red = lfilter([1.0], [1.0, -0.8], np.random.default_rng(seed).standard_normal((30, 2, 250)), axis=2)[..., 100:]
        sigma = 0.03 * np.abs(data.values).max()
        values = data.values + sigma * red / red.std()
        noisy = TimeResponses(values=values, dt=1.0, noise=np.full((30, 2), sigma))
        assert found(noisy).order == 4


def test_inputs_of_unequal_length():
    data = ringing(EQUAL, lengths=[150, 60])
    assert farthest(found(data).multipliers, full(EQUAL)) < 0.02


def test_noise_that_differs_between_inputs_and_outputs():
    data = ringing(EQUAL, noise=1e-3)
    unit = np.outer(np.geomspace(1e-3, 1e3, 30), [1.0, 5.0])
    scaled = TimeResponses(values=data.values * unit[..., None], dt=1.0, noise=data.noise * unit)
    assert farthest(found(scaled).multipliers, found(data).multipliers) < 1e-6


@pytest.mark.slow
def test_the_deviations_are_those_of_the_errors():
    """Of one of two equal poles the error has the covariance stated, over draws of the noise."""
    pulls = []
    for seed in range(60):
        model = found(ringing([*EQUAL, -0.03 + 2.0j], seed=1000 + seed))
        assert model.order == 6
        off = np.log(model.multipliers) - np.log(full([-0.03 + 2.0j])[0])
        k = int(np.argmin(np.abs(off)))
        std = np.sqrt(np.diag(model.covariance))
        pulls += [off[k].real / std[k], off[k].imag / std[k + model.order]]
    assert np.sqrt(np.mean(np.square(pulls))) == pytest.approx(1.0, abs=0.25)


def test_with_one_input_the_fit_of_products_is_the_free_one():
    """Cost, gradient and Gauss-Newton matrix of the poles: two codes."""
    data = ringing([-0.02 + 1.0j, -0.05 + 0j], inputs=1)
    poles = PoleSet.from_multipliers(full([-0.021 + 1.003j, -0.052 + 0j]))
    stacked = Stacked.of(data)
    one = fit_products(Products.of(poles, np.ones((2, 1), complex)), stacked.block, data.lengths)
    other = fit(poles, [factor((data.values[:, 0] / data.noise).T)])
    assert one.cost == pytest.approx(other.cost, rel=1e-10)
    assert_allclose(one.gradient, other.gradient, rtol=1e-8)
    assert_allclose(one.whole, other.gauss_newton, rtol=1e-8)


def test_the_gradient_is_that_of_the_cost():
    """By central differences in every parameter, participations too."""
    from floquid.lti.likelihood._rank_one import _moved

    data = ringing([-0.02 + 1.0j, -0.03 + 2.0j, -0.05 + 0j])
    stacked = Stacked.of(data)
    generator = np.random.default_rng(0)
    shares = generator.standard_normal((3, 2)) + 1j * generator.standard_normal((3, 2))
    now = Products.of(PoleSet.from_multipliers(full([-0.021 + 1.003j, -0.03 + 2.01j, -0.05 + 0j])), shares)
    here = fit_products(now, stacked.block, data.lengths)
    for k in range(len(here.gradient)):
        step = np.zeros(len(here.gradient))
        step[k] = 1e-6
        ahead, behind = (fit_products(_moved(now, sign * step), stacked.block, data.lengths).cost for sign in (1, -1))
        assert -2.0 * here.gradient[k] == pytest.approx((ahead - behind) / 2e-6, rel=1e-4, abs=1e-3)


def test_the_rank_is_that_of_the_residues():
    data = ringing([*EQUAL, -0.03 + 2.0j], seed=3)
    free = IDENTIFIER.extract(IDENTIFIER.prepare(data), 4)
    near = np.abs(np.subtract.outer(np.log(free.multipliers), [-0.02 + 1.0j, -0.03 + 2.0j])).argmin(axis=0)
    assert ranks(free, data, 1e-9)[near].tolist() == [2, 1]


@pytest.mark.parametrize("unequal", [0.0, 0.5, 1.0])
def test_noise_that_is_no_product_makes_no_second_mode(unequal):
    """One product and noise e^±unequal in each response: more products than one are found as seldom as asked for."""
    rng, size, draws = np.random.default_rng(1), (12, 3), 300
    noise = np.exp(unequal * rng.choice([-1.0, 1.0], size))
    data = TimeResponses(values=rng.standard_normal((*size, 9)), dt=1.0, noise=noise)
    strong = 1e3 * np.outer(rng.standard_normal(size[0]), rng.standard_normal(size[1]))
    more = 0
    for _ in range(draws):
        parts = rng.standard_normal((2, *size)) / np.sqrt(2.0)
        residues = strong + noise * (parts[0] + 1j * parts[1])
        model = ModalModel(
            multipliers=np.array([0.9 * np.exp(1j)]), residues=residues[None], dt=1.0, residue_spread=np.ones((3, 1, 1))
        )
        more += int(ranks(model, data, 0.05)[0] > 1)
    assert more / draws < 0.1


def test_refining_on_another_noise_keeps_them_apart():
    data = ringing(EQUAL)
    model = found(data)
    again = TimeResponses(values=data.values, dt=1.0, noise=1.1 * data.noise)
    refined = IDENTIFIER.refine(IDENTIFIER.prepare(again), model)
    assert refined.order == 4
    assert farthest(refined.multipliers, model.multipliers) < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("shared", [0.0, 0.04])
def test_deviations_beside_noise_that_outputs_share(shared):
    """A mode of one shape with the noise that all outputs share, beside two of equal multipliers."""
    pulls, alone = [], -0.03 + 2.0j
    for seed in range(12):
        clean = ringing(EQUAL, noise=1e-9, seed=seed).values
        ring = np.real(np.exp(alone * np.arange(clean.shape[2])))
        clean = clean + np.array([1.0, -0.5])[:, None] * ring
        generator = np.random.default_rng(100 + seed)
        noise = 0.02 * generator.standard_normal(clean.shape) + shared * generator.standard_normal(clean.shape[1:])
        spread = np.full(clean.shape[:2], np.hypot(0.02, shared))
        model = found(TimeResponses(values=clean + noise, dt=1.0, noise=spread))
        assert model.order == 6, f"seed {seed}"
        here = int(np.argmin(np.abs(model.poles - alone)))
        std = np.sqrt(np.diag(model.covariance))[[here, here + 6]]
        off = model.poles[here] - alone
        pulls.append(np.array([off.real, off.imag]) / std)
    assert 0.6 < np.sqrt(np.mean(np.square(pulls))) < 1.45


def test_a_hit_shorter_than_the_starts_is_identified_as_one_without_it():
    """Its few samples hold no pole by themselves, and none is kept for their sake."""
    logs = [-0.02 + 1.0j, -0.03 + 2.0j]
    data = ringing(logs, lengths=[150, 12])
    poles = PoleSet.from_multipliers(full([*logs, *(-0.05 + 1j * np.arange(0.2, 3.0, 0.4))]))
    blocks = factors(data)
    assert min(len(block.values) for block in blocks) < poles.order
    # What the short hit can do without counts for nothing: the rises are those of the long one.
    assert_allclose(Removal.of(poles, blocks).rises(), Removal.of(poles, blocks[:1]).rises())
    assert farthest(found(data).multipliers, full(logs)) < 5e-3


def test_growing_modes_of_equal_multipliers_give_the_responses_back():
    """Their columns are counted from the end of the record; residues belong to its begin."""
    generator, k = np.random.default_rng(6), np.arange(100)
    mu = 1.02 * np.exp(0.7j)
    parts = generator.standard_normal((4, 2, 6)), generator.standard_normal((4, 2, 3))
    shapes, shares = parts[0][::2] + 1j * parts[0][1::2], parts[1][::2] + 1j * parts[1][1::2]
    residues = np.einsum("amo,ami->oi", shapes, shares) * 1.02**-99
    values = 2.0 * (residues[:, :, None] * mu**k).real + 1e-3 * generator.standard_normal((6, 3, 100))
    identifier = MaximumLikelihood()
    model = identifier.extract(identifier.prepare(TimeResponses(values=values, dt=0.1, noise=np.full((6, 3), 1e-3))))
    assert model.order > 2
    back = np.einsum("roi,rk->oik", model.residues, model.multipliers[:, None] ** k).real
    assert np.abs(back - values).max() < 6e-3
