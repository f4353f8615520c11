"""Tests of the tests: estimators broken on purpose must fail the very assertions that the right one passes.

Each is broken in a way that has been seen in earnest and is plausible at a glance: its exponents are near the truth.
"""

import dataclasses
from typing import final

import numpy as np
import pytest
from scipy.optimize import least_squares

from floquid import identify
from floquid.lti import AbstractIdentifier, MaximumLikelihood, TimeResponses

SEEDS = range(40)
IDENTIFIER = MaximumLikelihood()


# Deviations and coefficients. An estimator makes a model of an analysis, which is done once for all of them.


@pytest.fixture(scope="module")
def analyses(plain):
    return [identify(plain.records(seed), harmonics=2, validate=False) for seed in SEEDS]


def right(analysis):
    return analysis.model


def without_delay(part):
    """Shapes from residues whose turn (or decay alone) between phase zero and each phase is not taken off (eq. 9)."""

    def estimate(analysis):
        model, lifted, modal = analysis.model, analysis.lifted, analysis.modal
        coefficients = np.array(model.coefficients)
        for r, exponent in enumerate(model.exponents):
            k = np.argmin(np.abs(modal.multipliers - model.multipliers[r]))
            rates = exponent - part(exponent) + 1j * model.harmonics * model.fundamental
            kernel = np.exp(-np.multiply.outer(rates, lifted.phase_times)) / lifted.n_phases
            coefficients[r] = np.einsum("mk,ckh->chm", kernel, lifted.by_channel(modal.residues)[k])
        return dataclasses.replace(model, coefficients=coefficients)

    return estimate


def biased_damping(deviations):
    """Each real part too large by some of its own standard deviations."""

    def estimate(analysis):
        model = analysis.model
        moved = model.exponents + deviations * model.exponent_std.real
        return dataclasses.replace(model, exponents=moved, estimates=None)

    return estimate


def wrong_size(factor):
    """Deviations that are a factor of what they should be."""

    def estimate(analysis):
        model = analysis.model
        return dataclasses.replace(
            model, covariance=factor**2 * model.covariance, coefficient_std=factor * model.coefficient_std
        )

    return estimate


def exponents_err_as_they_say(known, models, assert_that):
    errors, covariances = map(np.array, zip(*(known.exponent_errors(model) for model in models), strict=True))
    assert_that.errors_have_the_covariance(errors, covariances)
    assert_that.pulls_have_unit_variance(errors / np.sqrt(np.diagonal(covariances, axis1=1, axis2=2)))


def coefficients_err_as_they_say(known, models, assert_that):
    assert_that.pulls_have_unit_variance(np.array([known.coefficient_pulls(model) for model in models]))


EXPONENT_MUTANTS = {
    "damping biased by 5 deviations": biased_damping(5.0),
    "damping biased by 1 deviation": biased_damping(1.0),
    "deviations 0.7 of what they are": wrong_size(0.7),
    "deviations 1.4 of what they are": wrong_size(1.4),
}
COEFFICIENT_MUTANTS = {
    "turn and decay within the period not taken off": without_delay(lambda exponent: exponent),
    "decay within the period not taken off": without_delay(lambda exponent: exponent.real),
    "deviations half of what they are": wrong_size(0.5),
    "deviations twice what they are": wrong_size(2.0),
}


def test_the_right_estimator_passes_both(plain, analyses, assert_that):
    models = [right(analysis) for analysis in analyses]
    exponents_err_as_they_say(plain, models, assert_that)
    coefficients_err_as_they_say(plain, models, assert_that)


@pytest.mark.parametrize("mutant", EXPONENT_MUTANTS.values(), ids=EXPONENT_MUTANTS)
def test_exponents_that_do_not_err_as_they_say_are_caught(plain, analyses, assert_that, mutant):
    with pytest.raises(AssertionError, match=r"mean square|bias"):
        exponents_err_as_they_say(plain, [mutant(analysis) for analysis in analyses], assert_that)


@pytest.mark.parametrize("mutant", COEFFICIENT_MUTANTS.values(), ids=COEFFICIENT_MUTANTS)
def test_coefficients_that_do_not_err_as_they_say_are_caught(plain, analyses, assert_that, mutant):
    with pytest.raises(AssertionError, match=r"mean square|bias"):
        coefficients_err_as_they_say(plain, [mutant(analysis) for analysis in analyses], assert_that)


# Efficiency. An estimator makes multipliers of lifted responses, from the right model of them.


def started(known):
    """The responses and the right model of each draw."""
    drawn = [known.lifted(seed).responses for seed in SEEDS]
    return [(data, IDENTIFIER.extract(IDENTIFIER.prepare(data))) for data in drawn]


def logs_near_the_truth(known, multipliers):
    """ln(μ̂/μ)/T of the upper modes: the errors, real parts, then imaginary parts."""
    logs = np.log(multipliers / known.truth.multipliers[::2, None])
    best = logs[np.arange(len(logs)), np.argmin(np.abs(logs), axis=1)] / known.truth.period
    return np.concatenate([best.real, best.imag])


def refined(noise_of):
    """Maximum likelihood from there, with the noise as `noise_of` would have it."""

    def estimate(data, start):
        other = TimeResponses(values=data.values, dt=data.dt, noise=noise_of(data.noise), lengths=data.lengths)
        return IDENTIFIER.refine(IDENTIFIER.prepare(other), start).multipliers

    return estimate


def continuous_form(data, start):
    """Eq. (10) as printed: Σ R/(iω - λ) fitted to the transform of the lifted response, by least squares."""
    upper = start.poles[start.poles.imag > 0]
    lines = np.fft.rfft(data.values[:, 0] / data.noise, axis=1).T
    omega = 2.0 * np.pi * np.fft.rfftfreq(data.values.shape[2], data.dt)

    def left(parts):
        poles = parts[: len(upper)] + 1j * parts[len(upper) :]
        columns = 1.0 / (1j * omega[:, None] - np.concatenate([poles, poles.conj()]))
        residual = lines - columns @ np.linalg.lstsq(columns, lines, rcond=None)[0]
        return np.concatenate([residual.real.ravel(), residual.imag.ravel()])

    parts = least_squares(left, np.concatenate([upper.real, upper.imag]), x_scale="jac").x
    poles = parts[: len(upper)] + 1j * parts[len(upper) :]
    return np.exp(np.concatenate([poles, poles.conj()]) * data.dt)


def is_efficient(known, draws, estimate, assert_that):
    errors = np.array([logs_near_the_truth(known, estimate(*draw)) for draw in draws])
    assert np.abs(errors).max() < 0.05, "not even plausible"
    assert_that.is_efficient(errors, known.bound(), loss=1.05)


@pytest.fixture(scope="module")
def uneven(experiment):
    """Channels of very different noise."""
    known = experiment([-0.03 + 0.85j, -0.02 + 0.32j], units=[0.3, 5.0])
    return known, started(known)


def test_the_right_weights_are_efficient(uneven, assert_that):
    is_efficient(*uneven, refined(lambda noise: noise), assert_that)


@pytest.mark.parametrize(
    "noise_of",
    [lambda noise: np.full_like(noise, noise.mean()), lambda noise: 1.0 / noise, lambda noise: noise[::-1]],
    ids=["no weights", "weights upside down", "channels exchanged"],
)
def test_wrong_weights_are_caught(uneven, assert_that, noise_of):
    with pytest.raises(AssertionError, match="times the Cramér-Rao bound"):
        is_efficient(*uneven, refined(noise_of), assert_that)


def test_the_continuous_form_of_the_transform_is_caught(uneven, assert_that):
    with pytest.raises(AssertionError, match="times the Cramér-Rao bound"):
        is_efficient(*uneven, continuous_form, assert_that)


# The order.


@final
@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class AlwaysFour(AbstractIdentifier):
    """Maximum likelihood that never asks how many poles there are."""

    def prepare(self, data):
        return IDENTIFIER.prepare(data)

    def extract(self, state, order=None):
        return IDENTIFIER.extract(state, order or 4)

    def refine(self, state, model):
        return IDENTIFIER.refine(state, model)


CREDULOUS = MaximumLikelihood(false_alarm=0.5, most=8, starts=(6,))
ORDER_MUTANTS = pytest.mark.parametrize("mutant", [AlwaysFour(), CREDULOUS], ids=["always four", "credulous"])


def orders_are_right(orders, identifier, assert_that):
    drawn = [orders.decays(3, outputs=24, samples=64, seed=seed) for seed in range(5)]
    successes = sum(orders.is_right(*one, identifier) for one in drawn)
    assert_that.happens_at_least(successes, len(drawn), 0.99)


@ORDER_MUTANTS
def test_a_wrong_order_is_caught(orders, assert_that, mutant):
    orders_are_right(orders, IDENTIFIER, assert_that)
    with pytest.raises(AssertionError, match="were promised"):
        orders_are_right(orders, mutant, assert_that)


@ORDER_MUTANTS
def test_modes_seen_in_noise_are_caught(orders, mutant):
    assert orders.seen_in_noise(IDENTIFIER, range(5)) == 0
    assert orders.seen_in_noise(mutant, range(2)) > 0
