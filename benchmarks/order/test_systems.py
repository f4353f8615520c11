"""Random systems are what they say, and the bound and what must be found in them are right."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.order.drawing import random_system
from benchmarks.order.findable import findable
from benchmarks.order.random_systems import CLASSES, Ranges
from benchmarks.truth import cramer_rao_bound
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import chi2, f

from floquid.errors import InputError
from floquid.lifting import lift
from floquid.lti import MaximumLikelihood, TimeResponses

SMALL = Ranges(modes=(1, 4), outputs=(1, 30), cycles=(30, 80))


def decays(logs, *, outputs=20, inputs=1, seed=0):
    """Multipliers of pairs (and of real ones, where the logarithm is on the axis) with random residues."""
    generator = np.random.default_rng(seed)
    multipliers, residues = [], []
    for s in logs:
        mu = np.exp(s)
        own = generator.standard_normal((2, outputs, inputs))
        if abs(mu.imag) < 1e-12:
            multipliers.append(mu.real)
            residues.append(own[0])
        else:
            multipliers += [mu, np.conj(mu)]
            residues += [own[0] + 1j * own[1], own[0] - 1j * own[1]]
    return np.array(multipliers, complex), np.array(residues, complex)


def clean(multipliers, residues, samples):
    """The responses (outputs, inputs, samples)."""
    return np.einsum("roi,rk->oik", residues, multipliers[:, None] ** np.arange(samples)).real


def dense_bound(logs, residues, noise, lengths, dt):
    """The covariance of Re λ and Im λ of each pair by a Jacobian in every parameter, differences of the response.

    Of a real multiplier the imaginary part is left out. `residues` are those of `decays`.
    """
    pairs = [abs(np.exp(s).imag) > 1e-12 for s in logs]
    first = np.concatenate([[0], np.cumsum([2 if p else 1 for p in pairs])[:-1]])
    poles = [v for s, p in zip(logs, pairs, strict=True) for v in ([s.real, s.imag] if p else [s.real])]
    free = [residues[start] for start in first]
    outputs, inputs = residues.shape[1:]
    parts = [x for own, p in zip(free, pairs, strict=True) for x in ([own.real, own.imag] if p else [own.real])]
    theta = np.concatenate([poles, np.ravel(parts)])

    def response(theta):
        at, total = 0, 0.0
        values = theta[len(poles) :].reshape(-1, outputs, inputs)
        row = 0
        for s, p in zip(logs, pairs, strict=True):
            if p:
                power = np.exp((theta[at] + 1j * theta[at + 1]) * np.arange(max(lengths)))
                total = total + 2.0 * np.multiply.outer(values[row] + 1j * values[row + 1], power).real
            else:
                power = (np.sign(np.exp(s).real) * np.exp(theta[at])) ** np.arange(max(lengths))
                total = total + np.multiply.outer(values[row], power)
            at, row = at + (2 if p else 1), row + (2 if p else 1)
        seen = np.arange(max(lengths)) < np.asarray(lengths)[None, :, None]
        return np.broadcast_to(seen, total.shape) * total / noise[:, :, None]

    jacobian = np.stack(
        [(response(theta + step) - response(theta - step)).ravel() / 2e-6 for step in 1e-6 * np.eye(len(theta))],
        axis=1,
    )
    return np.linalg.inv(jacobian.T @ jacobian)[: len(poles), : len(poles)] / dt**2


class TestBound:
    def test_it_is_that_of_a_dense_jacobian(self):
        logs = [-0.05 + 0.9j, -0.03 + 1.2j, -0.1 + 0j, -0.04 + np.pi * 1j]
        multipliers, residues = decays(logs, outputs=3, inputs=2)
        noise = np.array([[0.1, 0.2], [0.3, 0.1], [1.0, 0.5]])
        ours = cramer_rao_bound(multipliers, residues, noise, [40, 25], 0.5)
        dense = dense_bound(logs, residues, noise, [40, 25], 0.5)
        # Real parts of modes 0 (conjugate 1), 2 (3), 4 and 5; imaginary parts follow six places later.
        own = [0, 6, 2, 8, 4, 5]
        assert_allclose(ours[np.ix_(own, own)], dense, rtol=1e-5, atol=1e-7 * np.abs(dense).max())

    def test_conjugates_move_together_and_real_ones_stay_on_the_axis(self):
        multipliers, residues = decays([-0.05 + 0.9j, -0.1 + 0j], outputs=3)
        ours = cramer_rao_bound(multipliers, residues, np.ones((3, 1)), [40], 1.0)
        assert_allclose(ours[1, :3], ours[0, :3], rtol=1e-12)
        assert_allclose(ours[4], -ours[3], rtol=1e-12)
        assert_array_equal(ours[5], 0.0)

    def test_it_needs_nothing_of_the_scale_of_a_growing_mode(self):
        multipliers, residues = decays([0.5 + 0.9j], outputs=2)
        values = []
        for samples in (50, 1000):
            scaled = residues * multipliers[:, None, None] ** -(samples - 1.0)
            values.append(cramer_rao_bound(multipliers, scaled, np.ones((2, 1)), [samples], 1.0))
        assert np.isfinite(values).all()
        # Seen from its end, a growing mode is a decaying one of which a longer record shows no more.
        assert_allclose(values[1], values[0], rtol=1e-6)

    def test_maximum_likelihood_spreads_as_it_says(self):
        logs = [-0.04 + 0.8j, -0.06 + 1.1j]
        multipliers, residues = decays(logs, outputs=4, seed=3)
        noise, samples, draws = np.full((4, 1), 0.3), 60, 200
        bound = cramer_rao_bound(multipliers, residues, noise, [samples], 1.0)
        generator, values = np.random.default_rng(0), clean(multipliers, residues, samples)
        identifier, errors = MaximumLikelihood(time_constants=100.0), []
        for _ in range(draws):
            noisy = values + 0.3 * generator.standard_normal(values.shape)
            state = identifier.prepare(TimeResponses(values=noisy, dt=1.0, noise=noise))
            found = np.log(identifier.extract(state, 4).multipliers)
            nearest = found[np.argmin(np.abs(np.subtract.outer(logs, found)), axis=1)]
            errors.append(np.concatenate([(nearest - logs).real, (nearest - logs).imag]))
        own = np.ix_([0, 2, 4, 6], [0, 2, 4, 6])
        total = sum(e @ np.linalg.solve(bound[own], e) for e in errors)
        low, high = chi2.ppf([5e-4, 1.0 - 5e-4], 4 * draws)
        assert low < total < 1.1**2 * high, total / (4 * draws)

    def test_a_mode_without_a_conjugate_is_refused(self):
        with pytest.raises(InputError, match="conjugate of each"):
            cramer_rao_bound([0.9 * np.exp(0.4j)], np.ones((1, 1, 1)), np.ones((1, 1)), [10], 1.0)

    def test_as_many_poles_as_samples_are_refused(self):
        multipliers, residues = decays([-0.05 + 0.9j, -0.1 + 2j])
        with pytest.raises(InputError, match="fewer than the 4 samples"):
            cramer_rao_bound(multipliers, residues, np.ones((20, 1)), [4], 1.0)


def judged(logs, sizes, *, noise=0.02, samples=200, outputs=20, **options):
    """`findable(...).must` of pairs of these sizes, one answer a pair."""
    multipliers, residues = decays(logs, outputs=outputs)
    residues = residues * np.repeat(sizes, 2)[:, None, None]
    must = findable(multipliers, residues, np.full((outputs, 1), noise), [samples], 1.0, **options).must
    assert_array_equal(must[::2], must[1::2])
    return must[::2].tolist()


class TestMustBeFound:
    def test_clear_modes(self):
        assert judged([-0.02 + 0.8j, -0.03 + 1.9j], [1.0, 1.0]) == [True, True]

    def test_a_mode_under_the_threshold_and_its_neighbour(self):
        assert judged([-0.02 + 0.8j, -0.03 + 1.9j], [1.0, 0.003]) == [True, False]

    def test_the_threshold_is_twice_that_of_the_test_less_its_degrees(self):
        """One pair alone: the cost of removal is its energy."""
        multipliers, residues = decays([-0.02 + 0.8j], outputs=5)
        energy = float(np.sum(clean(multipliers, residues, 100) ** 2))
        degrees = 2 * (5 + 1)
        limit = degrees * f.isf(1e-9, degrees, 500 - degrees)
        edge = np.sqrt(energy / (2.0 * limit - degrees))
        for factor, expected in ((0.99, True), (1.01, False)):
            found = findable(multipliers, residues, np.full((5, 1), factor * edge), [100], 1.0)
            assert_allclose(found.rises, energy / (factor * edge) ** 2, rtol=1e-9)
            assert (found.rises >= found.needed).tolist() == [expected, expected]

    def test_a_stricter_test_asks_for_more(self):
        sizes = [0.015]
        answers = [judged([-0.02 + 0.8j], sizes, false_alarm=p) for p in (1e-2, 1e-100)]
        assert answers == [[True], [False]]

    @pytest.mark.parametrize(("apart", "expected"), [(0.4, True), (0.002, False)])
    def test_a_close_pair(self, apart, expected):
        """Their distance in half-power widths; each still makes a large rise when removed with its partner held."""
        damping = 0.02
        logs = [-damping + 0.8j, -damping + 1j * (0.8 + 2.0 * damping * apart)]
        assert judged(logs, [1.0, 1.0]) == [expected, expected]

    def test_the_rest_is_refitted_when_one_of_a_close_pair_is_removed(self):
        """The other one alone, where it was, costs a hundred times as much as where it goes best."""
        logs = np.array([-0.02 + 0.8j, -0.02 + 0.802j])
        multipliers, residues = decays(logs, outputs=20)
        values = clean(multipliers, residues, 200)
        columns = (multipliers[2] ** np.arange(200))[:, None]
        columns = np.concatenate([columns.real, columns.imag], axis=1)
        flat = values.reshape(20, 200).T
        held = np.sum((flat - columns @ np.linalg.lstsq(columns, flat, rcond=None)[0]) ** 2) / 0.002**2
        rise = findable(multipliers, residues, np.full((20, 1), 0.002), [200], 1.0).rises[0]
        assert 0.0 < rise < 0.7 * held

    @pytest.mark.parametrize(("angle", "expected"), [(0.5, True), (0.001, False), (np.pi - 0.001, False)])
    def test_a_mode_merged_with_its_conjugate(self, angle, expected):
        assert judged([-0.05 + 1j * angle], [1.0]) == [expected]

    def test_an_exponent_of_large_deviation(self):
        """Clear in energy, but gone after three samples."""
        multipliers, residues = decays([-1.5 + 0.8j], outputs=200)
        found = findable(multipliers, residues, np.full((200, 1), 0.2), [100], 1.0)
        assert (found.rises > found.needed).all()
        assert not found.must.any()

    def test_what_cannot_be_seen_does_not_blur_its_neighbour(self):
        logs = [-0.02 + 0.8j, -0.021 + 0.805j]
        multipliers, residues = decays(logs, outputs=20)
        noise = np.full((20, 1), 0.02)
        alone = findable(multipliers[:2], residues[:2], noise, [200], 1.0)
        beside = findable(multipliers, residues * np.array([1, 1, 1e-6, 1e-6])[:, None, None], noise, [200], 1.0)
        assert_allclose(beside.std[:2], alone.std, rtol=1e-9)
        assert beside.must.tolist() == [True, True, False, False]

    def test_nothing_is_no_mode(self):
        assert findable([], np.zeros((0, 2, 1)), np.ones((2, 1)), [10], 1.0).must.tolist() == []
        assert cramer_rao_bound([], np.zeros((0, 2, 1)), np.ones((2, 1)), [10], 1.0).shape == (0, 0)


class TestRandomSystem:
    def test_each_seed_gives_one_system(self):
        one, again, other = random_system(3, SMALL), random_system(3, SMALL), random_system(4, SMALL)
        assert_array_equal(one.truth.exponents, again.truth.exponents)
        assert_array_equal(one.records()[0].values, again.records()[0].values)
        assert not np.array_equal(one.records(draw=1)[0].values, one.records()[0].values)
        assert other.truth.period != one.truth.period

    def test_every_class_and_the_whole_of_each_range_is_drawn(self):
        systems = [random_system(seed) for seed in range(200)]
        ranges = Ranges()
        for name in CLASSES:
            assert 8 <= sum(name in s.classes for s in systems) <= 100, name
        assert sum(not s.classes for s in systems) > 8
        outputs = np.array([s.noise.shape[0] * s.n_phases for s in systems])
        modes = np.array([(s.multipliers.imag >= 0).sum() for s in systems])
        cycles = np.concatenate([s.lengths for s in systems])
        assert (modes.min(), modes.max()) == ranges.modes
        assert outputs.min() == 1
        assert 300 < outputs.max() <= 400
        assert cycles.min() < 60
        assert 800 < cycles.max() <= 1000
        assert all((s.lengths >= 3 * s.truth.order).all() for s in systems)
        decay = -np.concatenate([s.truth.exponents.real * s.truth.period for s in systems])
        assert 0.004 < decay.min() < 0.006
        assert 0.25 < decay.max() < 0.4

    @pytest.mark.parametrize("seed", range(12))
    def test_records_are_the_response_of_the_truth(self, seed):
        system = random_system(seed, SMALL)
        for hit, values in enumerate(system.clean()):
            times = np.arange(values.shape[1]) * system.truth.period / system.n_phases
            expected = system.truth.response(times)[:, hit]
            scale = np.abs(expected).max(axis=1, keepdims=True)
            assert_allclose(values / scale, expected / scale, atol=1e-9)

    @pytest.mark.parametrize("seed", range(12))
    def test_modes_are_those_of_a_real_response(self, seed):
        """Summed over conjugates nothing imaginary is left, which `response` would drop in silence."""
        truth = random_system(seed, SMALL).truth
        times = np.linspace(0.0, 2.7 * truth.period, 7)
        whole = np.einsum("rchn,rn->chn", truth.shapes(times), np.exp(np.multiply.outer(truth.exponents, times)))
        assert np.abs(whole.imag).max() < 1e-12 * np.abs(whole).max()

    def test_noise_is_a_share_of_the_largest_response(self):
        system = random_system(5, replace(SMALL, noise=(0.1, 0.1), coloured=0.0, exact=0.0, cycles=(400, 400)))
        noisy, without = system.records()[0].values, system.clean()[0]
        largest = np.max([np.abs(v).max(axis=1) for v in system.clean()], axis=0)
        assert_allclose((noisy - without).std(axis=1), 0.1 * largest, rtol=0.2)
        assert_allclose(system.noise[:, 0], 0.1 * largest, rtol=1e-12)

    def test_coloured_noise_has_its_size_and_its_colour(self):
        ranges = Ranges(modes=(1, 1), outputs=(64, 64), channels=(2, 2), cycles=(500, 500), several=0.0, coloured=1.0)
        system = random_system(1, replace(ranges, exact=0.0, correlation=(0.2, 0.2)))
        noise = (system.records()[0].values - system.clean()[0]) / system.noise
        assert_allclose(noise.std(axis=1), 1.0, rtol=0.1)
        after = np.mean(noise[:, 1:] * noise[:, :-1], axis=1)
        assert_allclose(after, np.exp(-1.0 / (0.2 * 32)), rtol=0.05)

    def test_the_bound_in_coloured_noise_is_that_of_generalised_least_squares(self):
        """Against the dense covariance of the noise: slopes and residues of all phases in one Jacobian."""
        ranges = Ranges(modes=(2, 2), outputs=(4, 4), channels=(1, 1), cycles=(60, 60), decay=(0.05, 0.1), several=0.0)
        ranges = replace(ranges, pairs=0.0, weak=0.0, real=0.0, half=0.0, coloured=1.0, exact=0.0)
        system = random_system(2, ranges)
        white, coloured = system.findable()
        mu, free, samples = system.multipliers[::2], system.residues[::2, :, 0], 60
        cycle, phase = np.divmod(np.arange(4 * samples), 4)
        powers, columns = mu[:, None] ** cycle, []
        for r in range(2):
            slope = 2.0 * cycle * powers[r] * free[r, phase]
            columns += [slope.real, -slope.imag]
        for r in range(2):
            for p in range(4):
                columns += [(phase == p) * powers[r].real, (phase == p) * powers[r].imag]
        jacobian = np.stack(columns, axis=1)
        apart = np.abs(np.subtract.outer(np.arange(4 * samples), np.arange(4 * samples)))
        noise = system.noise[0, 0] ** 2 * system.correlation**apart
        covariance = np.linalg.inv(jacobian.T @ np.linalg.solve(noise, jacobian))[:4, :4] / system.truth.period**2
        std = np.sqrt(np.diag(covariance)).reshape(2, 2)
        # All but the first sample are filtered: a share of 1/240.
        assert_allclose(coloured.std[::2].real, std[:, 0], rtol=0.02)
        assert_allclose(coloured.std[::2].imag, std[:, 1], rtol=0.02)
        assert (np.abs(white.std[::2].real / std[:, 0] - 1.0) > 0.1).any()

    @pytest.mark.parametrize("seed", range(6))
    def test_lifted_responses_are_those_of_the_public_path(self, seed):
        system = random_system(seed, SMALL)
        lifted, ours = lift(system.cycles()), system.responses()
        assert_array_equal(lifted.responses.values, ours.values)
        assert_array_equal(lifted.responses.lengths, ours.lengths)
        longest = int(ours.lengths[0])
        whole = clean(system.multipliers, system.residues, longest)[:, 0] / ours.noise[:, :1]
        residual = ours.values[:, 0] / ours.noise[:, :1] - whole
        assert np.abs(residual).max() < 8.0

    def test_a_close_pair_is_as_close_as_asked(self):
        ranges = Ranges(modes=(2, 2), pairs=1.0, weak=0.0, real=0.0, half=0.0, separation=(0.1, 0.1))
        for seed in range(10):
            system = random_system(seed, replace(ranges, width_ratio=(1.0, 1.0)))
            one, other = np.log(system.multipliers[np.log(system.multipliers).imag > 0])
            assert abs(abs(one - other) - 0.1 * 2.0 * abs(one.real)) < 1e-9
            assert "close pair" in system.classes

    def test_real_multipliers_are_exactly_real(self):
        ranges = replace(SMALL, modes=(2, 2), real=1.0, half=1.0, pairs=0.0)
        for seed in range(5):
            multipliers = random_system(seed, ranges).multipliers
            assert_array_equal(multipliers.imag, 0.0)
            assert sorted(np.sign(multipliers.real)) == [-1.0, 1.0]

    @pytest.mark.parametrize(
        ("options", "words"),
        [
            ({"noise": (0.2, 0.1)}, "least, most"),
            ({"pairs": 1.5}, "between 0 and 1"),
            ({"modes": (0, 3)}, "at least 1"),
        ],
    )
    def test_ranges_that_cannot_be_are_refused(self, options, words):
        with pytest.raises(InputError, match=words):
            Ranges(**options)

    def test_a_seed_that_cannot_be_is_refused(self):
        with pytest.raises(InputError, match="seed"):
            random_system(-1)
