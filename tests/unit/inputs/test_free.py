"""Matrices at each phase that do not depend on each other: the fit against the system that the samples were made of."""

import numpy as np
import pytest

from floquid.inputs import Uncertainty, fitted_freely, samples_of

STEP = 0.5


def system_of(seed, phases, order, direct):
    """A, B, C and D of each phase, two inputs and two outputs, with a monodromy of radius 0.3 from phase zero."""
    generator = np.random.default_rng(seed)
    a = generator.standard_normal((phases, order, order))
    whole = np.eye(order)
    for matrix in a:
        whole = matrix @ whole
    share = 0.3 / np.abs(np.linalg.eigvals(whole)).max()
    b = generator.standard_normal((phases, order, 2))
    c, d = generator.standard_normal((phases, 2, order)), direct * generator.standard_normal((phases, 2, 2))
    return (a * share ** (1.0 / phases), b, c, d), share * np.linalg.eigvals(whole)


def response(system, inputs, first):
    """Outputs (2, samples) from rest, of which the first sample is at a phase."""
    a, b, c, d = system
    state, found = np.zeros(a.shape[1]), []
    for number, own in enumerate(inputs.T):
        j = (first + number) % len(a)
        found.append(c[j] @ state + d[j] @ own)
        state = a[j] @ state + b[j] @ own
    return np.array(found).T


def fitted(seed, phases, order, direct, noise=0.02):
    """The fit to two records that begin at different phases, with the system and the noise."""
    system, multipliers = system_of(seed, phases, order, direct)
    generator = np.random.default_rng(100 + seed)
    first, lengths = (phases - 2, 3), (250 * phases + 1, 180 * phases)
    inputs = [generator.standard_normal((2, length)) for length in lengths]
    clean = [response(system, own, j) for own, j in zip(inputs, first, strict=True)]
    values = [own + noise * generator.standard_normal(own.shape) for own in clean]
    samples = samples_of(
        values,
        inputs,
        [STEP * j for j in first],
        step=STEP,
        fundamental=2.0 * np.pi / (phases * STEP),
    )
    return samples, fitted_freely(samples), multipliers


@pytest.mark.first(1)
@pytest.mark.parametrize(
    ("seed", "phases", "order", "direct"), [(5, 4, 2, 0.0), (7, 7, 1, 1.0), (0, 5, 3, 0.0), (1, 6, 3, 1.0)]
)
def test_multipliers_are_found_and_noise_is_left(seed, phases, order, direct):
    samples, found, multipliers = fitted(seed, phases, order, direct)
    np.testing.assert_allclose(found.left.std(axis=1), 0.02, rtol=0.06)
    assert (len(found.direct) > 0) == (direct > 0.0)
    own = Uncertainty(samples, found)
    assert sum(1 if mode.real else 2 for mode in found.modes) == order
    for mode, (place, _) in zip(found.modes, own.places, strict=True):
        sign = -1.0 if mode.real and mode.turns[0] == 0.5 else 1.0
        multiplier = sign * np.exp(mode.exponent * phases * STEP)
        gap = np.abs(np.concatenate([multipliers, multipliers.conj()]) - multiplier).min() / abs(multiplier)
        assert gap < 5.0 * phases * STEP * np.sqrt(2.0 * own.parameters[place, place][0, 0]) < 0.5


def test_samples_that_meet_no_phase_twice_are_not_fitted():
    generator = np.random.default_rng(0)
    both = generator.standard_normal((2, 1, 600))
    assert fitted_freely(samples_of([both[0]], [both[1]], [0.0], step=1.0, fundamental=2.0)) is None
