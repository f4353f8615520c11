"""Maximum likelihood: the cost's slope against plain least squares, kinds of poles, orders and sizes at the edge."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import linear_sum_assignment

from floquid.lti import MaximumLikelihood, ModalModel, Outcome, TimeResponses, fit_residues, white_noise_std
from floquid.lti._era import Realisation, hankel_covariance
from floquid.lti._exponentials import fit, polish
from floquid.lti._factor import factor
from floquid.lti._poles import PoleSet
from floquid.lti.likelihood._select import _by_columns, _by_diagonals

IDENTIFIER = MaximumLikelihood(rank_one=False)
"""The responses made here have residues of any rank."""


def with_conjugates(multipliers):
    return np.concatenate([[mu, np.conj(mu)] if np.imag(mu) else [mu] for mu in multipliers]).astype(complex)


def decays(multipliers, *, outputs=6, inputs=1, samples=100, noise=0.0, seed=0, lengths=None):
    """Responses with random residues, beside noise of `noise` times the largest response of each output and input."""
    generator = np.random.default_rng(seed)
    values = np.zeros((outputs, inputs, samples))
    for mu in np.asarray(multipliers, complex):
        residue = generator.standard_normal((outputs, inputs)) + 1j * generator.standard_normal((outputs, inputs))
        values += (residue[..., None] * mu ** np.arange(samples)).real
    largest = np.abs(values).max(axis=2)
    values = values + noise * largest[..., None] * generator.standard_normal(values.shape)
    return TimeResponses(values=values, dt=1.0, noise=max(noise, 1e-10) * largest, lengths=lengths)


def identified(data, order=None) -> ModalModel:
    return IDENTIFIER.extract(IDENTIFIER.prepare(data), order)


def farthest(found, expected):
    assert len(found) == len(expected), f"{len(found)} poles, but {len(expected)} were expected"
    distance = np.abs(np.subtract.outer(found, expected))
    return distance[linear_sum_assignment(distance)].max()


def plain_cost(multipliers, data):
    """What is left over when each response, over its noise, is fitted by least squares on the exponentials."""
    total = 0.0
    for hit, length in enumerate(data.lengths):
        columns = multipliers ** np.arange(length)[:, None]
        columns = np.concatenate([columns.real, columns.imag], axis=1)
        y = (data.values[:, hit, :length] / data.noise[:, hit, None]).T
        total += np.sum((y - columns @ np.linalg.lstsq(columns, y, rcond=1e-12)[0]) ** 2)
    return total


KINDS = {
    "a pair": [np.exp(-0.02 + 1.0j)],
    "a positive one": [0.95],
    "a negative one": [-0.9],
    "a pair and both real kinds": [np.exp(-0.02 + 1.0j), 0.95, -0.9],
    "two growing, one not": [np.exp(0.01 + 2.0j), 1.02, np.exp(-0.03 + 0.5j)],
    "a growing negative one": [-1.01],
    "a pair beside a constant": [np.exp(-0.02 + 1.0j), 1.0],
    "a pair next to the positive axis": [np.exp(-0.02 + 0.01j)],
    "a pair next to the negative axis": [np.exp(-0.02 + (np.pi - 0.01) * 1j)],
    "one frequency, two decays": [np.exp(-0.02 + 1.0j), np.exp(-0.05 + 1.0j)],
    "two real ones": [0.95, 0.93],
}
CLOSE = {
    "a tenth of the half-power width apart": [np.exp(-0.02 + 1.0j), np.exp(-0.02 + 1.004j)],
    "a twentieth of the decay apart": [np.exp(-0.02 + 1.0j), np.exp(-0.021 + 1.0j)],
}
SIZES = [(1, 1, 100), (6, 2, 100), (200, 1, 100), (3, 1, 1000)]


@pytest.mark.first(3)
@pytest.mark.parametrize(("outputs", "inputs", "samples"), SIZES)
@pytest.mark.parametrize("multipliers", KINDS.values(), ids=KINDS)
def test_every_kind_of_pole_is_recovered_exactly_without_noise(multipliers, outputs, inputs, samples):
    found = identified(decays(multipliers, outputs=outputs, inputs=inputs, samples=samples))
    assert found.outcome is Outcome.SUCCESS
    # Beside a mode that has grown to 4e8 the others are known to as many digits less.
    worst = np.sqrt(np.diag(found.covariance)).max()
    assert farthest(found.multipliers, with_conjugates(multipliers)) < max(1e-10, 1e-5 * worst)
    assert np.count_nonzero(found.multipliers.imag == 0) == sum(not np.imag(mu) for mu in multipliers)


@pytest.mark.parametrize(("outputs", "atol"), [(1, 1e-7), (6, 1e-10), (200, 1e-10)])
@pytest.mark.parametrize("multipliers", CLOSE.values(), ids=CLOSE)
def test_close_pairs_without_noise(multipliers, outputs, atol):
    """With one output their separation multiplies rounding by about 1e5."""
    found = identified(decays(multipliers, outputs=outputs))
    assert farthest(found.multipliers, with_conjugates(multipliers)) < atol


@pytest.mark.parametrize("multipliers", KINDS.values(), ids=KINDS)
def test_cost_and_gradient_are_those_of_plain_least_squares(multipliers):
    """Away from the optimum, by central differences of a cost that shares no code; two inputs, unequal lengths."""
    data = decays(multipliers, inputs=2, samples=40, noise=0.05, lengths=[40, 25])
    poles = PoleSet.from_multipliers(with_conjugates(multipliers))
    poles = poles.moved(0.01 * np.random.default_rng(5).standard_normal(poles.order))
    here = fit(poles, IDENTIFIER.prepare(data).factors)
    assert here.cost == pytest.approx(plain_cost(poles.multipliers(), data), rel=1e-9)
    slope = np.zeros(poles.order)
    for k in range(poles.order):
        step = np.zeros(poles.order)
        step[k] = 1e-5
        ahead, behind = (plain_cost(poles.moved(sign * step).multipliers(), data) for sign in (1, -1))
        slope[k] = (ahead - behind) / 2e-5
    assert_allclose(-2.0 * here.gradient, slope, rtol=1e-4, atol=1e-6 * np.abs(slope).max())


@pytest.mark.parametrize("multipliers", KINDS.values(), ids=KINDS)
def test_where_the_fit_is_exact_the_gauss_newton_matrix_is_half_the_hessian(multipliers):
    """By second differences of the plain cost around the true poles, where it is zero."""
    data = decays(multipliers, inputs=2, samples=40, lengths=[40, 25])
    poles = PoleSet.from_multipliers(with_conjugates(multipliers))
    here = fit(poles, IDENTIFIER.prepare(data).factors)
    size, n = 1e-4, poles.order
    hessian = np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
                step = np.zeros(n)
                step[i] += a * size
                step[j] += b * size
                hessian[i, j] += a * b * plain_cost(poles.moved(step).multipliers(), data) / (4.0 * size**2)
    assert_allclose(here.gauss_newton, 0.5 * hessian, rtol=1e-3, atol=1e-4 * np.abs(hessian).max())


def test_the_information_has_the_noise_of_the_residues_taken_off():
    """Over draws of the noise the Gauss-Newton matrix is too large and `information` is right, in the mean."""
    multipliers = [np.exp(-0.05 + 1.0j), np.exp(-0.08 + 1.3j)]
    poles = PoleSet.from_multipliers(with_conjugates(multipliers))
    clean = decays(multipliers, outputs=20, samples=60)
    generator = np.random.default_rng(3)
    sigma = 0.5

    def matrices(values):
        found = fit(poles, [factor((values / sigma).reshape(-1, 60).T)])
        return found.gauss_newton, found.information

    truth = matrices(clean.values)[0]
    draws = [matrices(clean.values + sigma * generator.standard_normal(clean.values.shape)) for _ in range(300)]
    inflated, right = (np.diag(np.mean(part, axis=0)) for part in zip(*draws, strict=True))
    error = np.std([np.diag(information) for _, information in draws], axis=0) / np.sqrt(len(draws))
    assert (np.abs(right - np.diag(truth)) < 4.0 * error).all()
    assert (inflated - np.diag(truth) > 10.0 * error).all()


def test_polish_walks_to_the_least_cost_and_stays():
    multipliers = KINDS["a pair and both real kinds"]
    data = decays(multipliers, noise=0.02)
    factors = IDENTIFIER.prepare(data).factors
    truth = PoleSet.from_multipliers(with_conjugates(multipliers))
    best = polish(truth.moved(np.array([0.01, -0.01, 0.01, 0.02])), factors, tolerance=1e-8)
    assert plain_cost(best.poles.multipliers(), data) < plain_cost(with_conjugates(multipliers), data)
    for k in range(4):
        for sign in (1, -1):
            step = np.zeros(4)
            step[k] = sign * 0.2 * np.sqrt(best.covariance()[k, k])
            assert plain_cost(best.poles.moved(step).multipliers(), data) > best.cost


@pytest.mark.parametrize("kind", KINDS)
def test_a_realisation_is_exact_without_noise_at_the_right_order(kind):
    data = decays(KINDS[kind])
    full = with_conjugates(KINDS[kind])
    realisation = Realisation.of(IDENTIFIER.prepare(data).factors, 30, 12)
    assert farthest(realisation.multipliers(len(full)), full) < 1e-6


@pytest.mark.parametrize(("window", "order"), [(60, 24), (30, 24), (26, 25)])
def test_a_realisation_of_a_generous_order_holds_the_true_poles(window, order):
    full = with_conjugates(KINDS["one frequency, two decays"])
    data = decays(KINDS["one frequency, two decays"], outputs=20, noise=0.001)
    found = Realisation.of(IDENTIFIER.prepare(data).factors, window, order).multipliers(order)
    assert len(found) == order
    assert np.abs(np.subtract.outer(full, found)).min(axis=1).max() < 0.01


def test_the_hankel_covariance_is_that_of_the_hankel_matrices():
    generator = np.random.default_rng(0)
    blocks = [generator.standard_normal((samples, 4)) for samples in (20, 13, 5)]
    expected = np.zeros((8, 8))
    for block in blocks:
        for column in block.T:
            if len(column) >= 8:
                hankel = np.stack([column[i : i + len(column) - 7] for i in range(8)])
                expected += hankel @ hankel.T
    assert_allclose(hankel_covariance([factor(b) for b in blocks], 8), expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("outputs", "samples", "bias"), [(1, 40, 0.1), (1, 400, 0.05), (5, 40, 0.05), (100, 12, 0.02), (50, 1000, 0.005)]
)
def test_white_noise_has_its_own_deviation(outputs, samples, bias):
    """In the mean over draws, to what so few samples allow."""
    draws = 0.3 * np.random.default_rng(0).standard_normal((30, outputs, samples))
    found = np.array([white_noise_std(draw) for draw in draws])
    assert np.mean(found) == pytest.approx(0.3, rel=bias)


def test_a_fixed_order_is_reached_or_said_not_to_be():
    data = decays([np.exp(-0.02 + 1.0j), 0.95], outputs=10, samples=60, noise=0.02)
    full = with_conjugates([np.exp(-0.02 + 1.0j), 0.95])
    for order in range(2, 6):
        found = identified(data, order)
        assert (found.order, found.outcome) == (order, Outcome.SUCCESS)
    assert farthest(identified(data, 2).multipliers, full[:2]) < 0.01
    assert farthest(identified(data, 3).multipliers, full) < 0.01
    alone = identified(data, 1)
    assert (alone.order, alone.outcome) == (2, Outcome.ORDER_UNREACHED), "a clear pair cannot be halved"


def test_a_fixed_order_finds_poles_in_noise_that_the_test_refuses():
    data = TimeResponses(values=np.random.default_rng(0).standard_normal((10, 1, 60)), dt=1.0)
    assert identified(data).outcome is Outcome.NO_MODE
    assert identified(data, 2).order == 2


def test_nothing_at_all_holds_no_mode():
    found = identified(TimeResponses(values=np.zeros((3, 1, 20)), dt=1.0))
    assert (found.order, found.outcome) == (0, Outcome.NO_MODE)
    assert found.residues.shape == (0, 3, 1)
    found = identified(TimeResponses(values=np.zeros((3, 1, 20)), dt=1.0), 2)
    assert (found.order, found.outcome) == (0, Outcome.ORDER_UNREACHED)


@pytest.mark.first(8)
@pytest.mark.parametrize("samples", [1, 2, 3, 4, 5, 6, 8, 12])
@pytest.mark.parametrize("outputs", [1, 2, 8, 50])
def test_the_smallest_sizes_end_in_an_outcome_and_never_in_a_wrong_success(outputs, samples):
    """With noise and without; a success must have a pole near each true one."""
    full = with_conjugates([np.exp(-0.1 + 1.0j)])
    for noise in (0.0, 0.02):
        found = identified(decays([full[0]], outputs=outputs, samples=samples, noise=noise))
        assert isinstance(found.outcome, Outcome)
        assert found.residues.shape == (found.order, outputs, 1)
        if found.outcome is Outcome.SUCCESS:
            assert samples >= 4
            if found.order == 2:
                assert farthest(found.multipliers, full) < (1e-10 if noise == 0.0 else 0.3)
    if samples >= 6:
        assert identified(decays([full[0]], outputs=outputs, samples=samples)).outcome is Outcome.SUCCESS


@pytest.mark.first(1)
@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize(("pairs", "samples"), [(3, 8), (5, 12), (8, 16), (10, 30)])
def test_fewer_samples_than_the_modes_need_are_an_outcome(pairs, samples, noise):
    multipliers = np.exp(-0.05 + 1j * np.linspace(0.3, 2.8, pairs))
    found = identified(decays(multipliers, outputs=100, samples=samples, noise=noise, seed=1))
    assert found.outcome is Outcome.TOO_FEW_SAMPLES


def test_a_search_ends_with_the_poles_so_far_when_its_time_is_over():
    values = np.random.default_rng(0).standard_normal((3, 1, 400)).cumsum(axis=2)
    data = TimeResponses(values=values, dt=1.0, noise=np.ones((3, 1)))
    method = MaximumLikelihood(seconds=0.0)
    found = method.extract(method.prepare(data))
    assert found.outcome is Outcome.OUT_OF_TIME
    assert found.order > 0
    assert method.extract(method.prepare(data), 4).outcome is Outcome.OUT_OF_TIME


@pytest.mark.slow
@pytest.mark.parametrize("pairs", [26, pytest.param(30, marks=pytest.mark.slow)])
def test_many_modes_are_no_residual_that_is_not_white(pairs):
    generator = np.random.default_rng(pairs)
    angles = np.pi * (np.arange(pairs) + 0.5 + 0.2 * generator.uniform(-1.0, 1.0, pairs)) / pairs
    truth = with_conjugates(np.exp(-generator.uniform(0.01, 0.04, pairs) + 1j * angles))
    found = identified(decays(truth, outputs=24, samples=300, noise=0.05))
    assert found.outcome is Outcome.SUCCESS
    assert found.order == 2 * pairs
    assert farthest(found.multipliers, truth) < 1e-2


@pytest.mark.slow
def test_a_mode_that_outlasts_the_energy_of_the_others_is_fitted_to_its_end():
    """5000 samples: the first pair is gone after 100, the second is a third of the noise and lasts for 3000."""
    slow, fast = np.exp(-0.001 + 2.0j), np.exp(-0.05 + 1.0j)
    generator = np.random.default_rng(0)
    k, noise = np.arange(5000), 0.1
    residues = generator.standard_normal((2, 20)) + 1j * generator.standard_normal((2, 20))
    values = (np.outer(10.0 * residues[0], fast**k) + np.outer(0.03 * residues[1], slow**k)).real
    values = (values + noise * generator.standard_normal(values.shape))[:, None]

    def of_the_slow_mode(samples):
        data = TimeResponses(values=values[..., :samples], dt=1.0, noise=np.full((20, 1), noise))
        assert [len(f.values) for f in IDENTIFIER.prepare(data).factors] == [600]
        found = identified(data)
        assert found.order == 4
        weak = np.argmin(np.abs(found.multipliers - slow))
        return np.log(found.multipliers[weak] / slow).real, np.sqrt(found.covariance[weak, weak])

    off, std = of_the_slow_mode(5000)
    _, std_of_the_loud_part = of_the_slow_mode(600)
    assert std < 0.35 * std_of_the_loud_part
    assert abs(off) < 4.0 * std


def test_the_fit_says_how_much_is_left():
    data = decays(KINDS["a pair"], outputs=30, samples=200, noise=0.05)
    found = identified(data)
    assert found.stats["cost"] == pytest.approx(found.stats["degrees"], rel=5.0 * np.sqrt(2.0 / 6000))
    assert found.stats["degrees"] == 30 * (200 - 2) - 2
    assert_allclose(found.residual_std, data.noise, rtol=0.25)
    assert np.sqrt(np.mean((found.residual_std / data.noise) ** 2)) == pytest.approx(1.0, rel=0.03)


def test_the_deviation_of_what_is_left_counts_the_poles():
    noise = np.random.default_rng(0).standard_normal((5000, 1, 12))
    multipliers = np.exp([-0.1 + 0.5j, -0.1 - 0.5j, -0.2 + 1.5j, -0.2 - 1.5j, -0.1 + 2.5j, -0.1 - 2.5j])
    left = fit_residues(multipliers, TimeResponses(values=noise, dt=1.0)).residual_std
    assert np.sqrt(np.mean(left**2)) == pytest.approx(1.0, rel=0.03)


def test_refining_on_other_noise_keeps_the_order_and_moves_to_the_new_optimum():
    data = decays(KINDS["a pair and both real kinds"], noise=0.02)
    found = identified(data)
    other = TimeResponses(values=data.values, dt=1.0, noise=data.noise * np.linspace(0.5, 2.0, 6)[:, None])
    state = IDENTIFIER.prepare(other)
    refined = IDENTIFIER.refine(state, found)
    assert refined.order == found.order
    assert farthest(refined.multipliers, IDENTIFIER.extract(state).multipliers) < 1e-6


@pytest.mark.parametrize(("samples", "rank"), [(1, 1), (2, 1), (63, 5), (64, 3), (65, 70), (130, 2)])
def test_sums_along_and_across_the_gram_matrix_are_those_of_transformed_columns(samples, rank):
    values = np.random.default_rng(samples).standard_normal((samples, rank))
    decays = np.array([0.0, 0.01, 0.3])
    envelopes = np.exp(-np.multiply.outer(decays, np.arange(samples)))
    lines = 1 << int(np.ceil(np.log2(2 * samples)))
    both = (sums(values, envelopes, decays, lines) for sums in (_by_diagonals, _by_columns))
    for found, expected in zip(*both, strict=True):
        assert_allclose(found, expected, atol=1e-13 * np.abs(expected).max())
