"""Many short responses: their poles from the step of the outputs, and none where any step would do."""

from dataclasses import replace

import numpy as np
import pytest

from floquid.lti import Ensemble, MaximumLikelihood, Outcome, TimeResponses, brief, pooled_noise
from floquid.order import judge_products
from floquid.testing import assert_exponents_close

LOGS = np.array([-1.2 + 0.5j, -1.2 - 0.5j, -2.5 + 0.9j, -2.5 - 0.9j])


def decays(*, outputs=40, inputs=12, samples=6, noise=0.01, seed=0):
    """One system of the poles above, started in different ways."""
    generator = np.random.default_rng(seed)
    shapes, shares = (generator.standard_normal((2, size, 2)) @ [1.0, 1j] for size in (outputs, inputs))
    full = [np.stack([part, part.conj()], axis=-1).reshape(-1, 4) for part in (shapes.T, shares.T)]
    powers = np.exp(LOGS[:, None] * np.arange(samples))
    values = np.einsum("or,ir,rk->oik", *full, powers).real
    sigma = noise * np.abs(values).max()
    values += sigma * generator.standard_normal(values.shape)
    return TimeResponses(values=values, dt=1.0, noise=np.full((outputs, inputs), sigma))


def found(data):
    identifier = Ensemble()
    return identifier.extract(identifier.prepare(data))


def test_four_poles_of_responses_that_last_three_samples():
    """Free residues hold three quarters of a pole a sample: maximum likelihood with them finds fewer."""
    data = decays()
    assert brief(data, 2)
    model = found(data)
    assert_exponents_close(model.poles, LOGS, 2.0 * np.pi, atol=0.05)
    free = MaximumLikelihood(rank_one=False)
    assert free.extract(free.prepare(data)).order < 4


@pytest.mark.slow
@pytest.mark.parametrize("seeds", [5, 20])
def test_errors_are_as_large_as_their_deviations(seeds):
    pulls = []
    for seed in range(seeds):
        model = found(decays(seed=seed))
        std = np.sqrt(np.diag(model.covariance))[: model.order]
        order = np.argsort(np.abs(model.poles.real))
        pulls += list((model.poles.real[order] - np.sort(LOGS.real)[::-1])[::2] / std[order][::2])
    assert 0.6 < np.sqrt(np.mean(np.square(pulls))) < 1.6


def test_a_search_ends_with_the_poles_so_far_when_its_time_is_over():
    data = decays(noise=0.05)
    method = Ensemble().bounded(0.0)
    state = method.prepare(data)
    model = method.extract(state)
    assert model.outcome is Outcome.OUT_OF_TIME
    assert model.order > 0
    assert method.extract(state, 2).outcome is Outcome.OUT_OF_TIME
    said = judge_products(data, model, method).findings
    assert Outcome.OUT_OF_TIME.value in [own.code for own in said]


def test_noise_is_no_mode_and_not_brief():
    data = TimeResponses(values=np.random.default_rng(0).standard_normal((40, 12, 6)), dt=1.0)
    assert found(data).outcome is Outcome.NO_MODE
    assert not brief(data, 2)


def test_fewer_steps_than_poles_are_too_few():
    assert found(decays(inputs=1, samples=4, noise=1e-6)).outcome is Outcome.TOO_FEW_SAMPLES


def test_a_long_response_is_not_brief():
    generator = np.random.default_rng(0)
    values = np.outer(generator.standard_normal(40), 0.98 ** np.arange(60))[:, None]
    assert not brief(TimeResponses(values=values, dt=1.0, noise=np.full((40, 1), 1e-3)), 3)


def test_long_inputs_tell_their_own_noise_and_short_ones_that_of_all():
    generator = np.random.default_rng(2)

    def block(samples, noise):
        signal = generator.standard_normal((32, 4)) @ generator.standard_normal((4, samples)) * 50.0
        return signal + noise * generator.standard_normal((32, samples))

    ((loud, quiet, first, second),) = pooled_noise([[block(40, 0.9), block(40, 0.3), block(6, 0.9), block(6, 0.3)]])
    assert abs(loud / 0.9 - 1.0) < 0.2
    assert abs(quiet / 0.3 - 1.0) < 0.2
    assert quiet < first == second < loud


@pytest.mark.parametrize("samples", [48, 200])
def test_the_noise_that_all_inputs_tell(samples):
    generator = np.random.default_rng(1)
    signal = generator.standard_normal((32, 4)) @ generator.standard_normal((4, samples)) * 50.0
    ((sigma,),) = pooled_noise([[signal + 0.3 * generator.standard_normal((32, samples))]])
    assert abs(sigma / 0.3 - 1.0) < 0.15


def test_poles_that_any_matrix_gives_have_deviations():
    """Four steps of four poles leave a residual that says nothing of them: deviations were rounding."""
    identifier = Ensemble()
    model = identifier.extract(identifier.prepare(decays(inputs=1, samples=5, noise=1e-3)), 4)
    assert model.order == 4
    off = np.abs(np.sort_complex(model.poles) - np.sort_complex(LOGS)).max()
    std = np.sqrt(np.diag(model.covariance))
    assert std.min() > 1e-4
    assert off < 8.0 * std.max()


def test_a_multiplier_of_exactly_zero_is_no_mode():
    """Its participation stayed without a pole: a record of four periods ended in a ValueError."""
    data = decays(noise=1e-3)
    state = Ensemble().prepare(data)
    still = replace(state, loud=np.where(np.isin(np.arange(state.loud.shape[1]), state.first), state.loud, 0.0))
    assert len(still.start(2).poles) == len(still.start(2).shares)
    assert Ensemble().extract(still).order == 0
