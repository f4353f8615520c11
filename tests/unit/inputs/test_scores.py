"""Weights of modes, and the gain by noise that drives them, to first order."""

from dataclasses import replace

import numpy as np
import pytest
from tests.driven import mathieu, record_of
from tests.unit.inputs.test_start import samples_from

from floquid.fit import FEW_STEPS
from floquid.inputs import Uncertainty, samples_of, solve
from floquid.inputs._start import bare_mode, chosen_together
from floquid.inputs.search import Scores, unmeasured


@pytest.fixture(scope="module")
def fit():
    system = mathieu()
    samples = samples_from(system, 60, 20, 0.3)
    turns = np.arange(-1.0, 2.0)
    bare = [bare_mode(samples, complex(system.exponents()[0]), turns, turns)]
    first = chosen_together(samples, bare, 1)[0]
    small = replace(first, turns=first.turns[1:], reach=first.reach[1:], gains=first.gains[:, 1:])
    return samples, solve(samples, [small], (0.0,), at_rest=1e-9)


def test_a_mode_of_noise_weighs_little(fit):
    samples, now = fit
    false = replace(now.modes[0], exponent=-0.3 + 4.0j)
    # A fit to the end would move it onto the line of the true mode beside the next harmonic.
    with_both = solve(samples, [*now.modes, false], now.direct, iterations=FEW_STEPS)
    weights = Scores(samples, with_both).of_modes
    assert weights[0] > 1e3
    assert weights[1] < 1e2


def fit_with_force_beside(beside, seed=4, periods=60):
    """A fit to Mathieu's equation, a share of the force unmeasured."""
    system = mathieu()
    force, noise = np.random.default_rng(seed).standard_normal((2, 1, 20 * periods))
    values, _ = record_of(system, periods, 20, 0.1, 100 + seed, force + beside * noise)
    samples = samples_of([values], [force], [0.0], step=system.period / 20, fundamental=2.0, hold="zero")
    turns = np.arange(-3.0, 4.0)
    bare = [bare_mode(samples, complex(system.exponents()[0]), turns, turns)]
    return samples, solve(samples, chosen_together(samples, bare, 1))


def with_force_beside(beside, **more):
    """Its scores."""
    return Scores(*fit_with_force_beside(beside, **more))


@pytest.mark.parametrize("beside", [0.0, 0.05])
def test_the_gain_by_noise_that_drives_the_modes(beside):
    """A fit takes what is near its mode from the noise: without draws that do, too, a little of it is not seen."""
    assert (with_force_beside(beside).by_noise() > 16.0) == (beside > 0.0)


def test_few_draws_tell_how_far_that_gain_is_from_noise():
    """Their spread is known: that of thirty was three fifths of what it is, and the gain twice and a half too large."""
    scores = with_force_beside(0.1)
    assert scores.by_noise() == pytest.approx(scores.by_noise(600), rel=0.1)
    assert scores.by_noise() > 50.0


@pytest.mark.slow
def test_the_variance_of_a_force_beside_is_that_of_the_force():
    """It is quadratic in the share of the force that nobody measured, and none without."""
    small, large = (unmeasured(with_force_beside(beside, periods=400)) for beside in (0.1, 0.2))
    assert large == pytest.approx(4.0 * small, rel=0.3)
    assert unmeasured(with_force_beside(0.0)) == 0.0


@pytest.mark.slow
def test_deviations_count_a_force_beside():
    """Errors of 30 exponents over their deviations: those of white noise are too small."""
    true, pulls = mathieu().exponents(), []
    for seed in range(30):
        fit = Uncertainty(*fit_with_force_beside(0.1, seed))
        off = fit.at.modes[0].exponent - true[np.argmin(np.abs(true - fit.at.modes[0].exponent))]
        rows = fit.places[0][0].start + np.array([0, int(fit.at.modes[0].free.sum()) // 2])
        variances = np.array([np.diag(fit.of_white)[rows], np.diag(fit.parameters)[rows]])
        pulls.append(np.array([off.real, off.imag]) / np.sqrt(variances))
    white, counted = np.sqrt(np.mean(np.square(pulls), axis=(0, 2)))
    assert white > 3.0
    assert 0.7 < counted < 1.4
