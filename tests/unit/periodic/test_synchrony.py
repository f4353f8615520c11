"""Whether the response repeats with the period it was given: silent when it does, clear when it does not."""

import re

import numpy as np
import pytest

from floquid import identify
from floquid.core import ConstantPeriod, PeriodicModel, Record
from floquid.errors import IdentificationError
from floquid.lifting import lift
from floquid.lti import MaximumLikelihood
from floquid.periodic import Synchrony, assemble, drift, spacing, synchrony
from floquid.sync import segment
from floquid.systems import JeffcottRotor

TRUE_PERIOD = 2.0 * np.pi


@pytest.fixture(scope="module")
def rotor() -> PeriodicModel:
    """The paper's rotor as a model that can be sampled at any step, exact to 1e-11."""
    return identify(JeffcottRotor().simulate(n_periods=300, noise=0.0), validate=False).model


def sampled(model, step, *, n_phases=50, n_cycles=1024, noise=0.02, seed=0) -> Record:
    """The response at this step, with `n_phases` samples a period declared whatever the model's own period is."""
    values = model.response(step * np.arange(n_phases * n_cycles))[:, 0]
    generator = np.random.default_rng(seed)
    values = values + noise * np.abs(values).max(axis=1, keepdims=True) * generator.standard_normal(values.shape)
    clock = ConstantPeriod(period=n_phases * step)
    return Record(values=values, sample_rate=1.0 / step, channels=model.channels, clock=clock)


def small(seed=0) -> PeriodicModel:
    """Two pairs with harmonics to ±2 in two channels."""
    generator = np.random.default_rng(seed)
    shapes = generator.standard_normal((2, 2, 1, 5)) + 1j * generator.standard_normal((2, 2, 1, 5))
    shapes *= [0.05, 0.3, 1.0, 0.3, 0.05]
    upper = np.array([-0.03 + 0.85j, -0.02 + 0.32j])
    return PeriodicModel(
        exponents=np.stack([upper, upper.conj()], axis=1).ravel(),
        coefficients=np.stack([shapes, shapes[..., ::-1].conj()], axis=1).reshape(4, 2, 1, 5),
        harmonics=np.arange(-2, 3),
        period=6.0,
        channels=["a", "b"],
    )


def own_period(error) -> tuple[float, float]:
    """The period that the message names, and its deviation."""
    found = re.search(r"its own is ([\d.]+) ± (\S+) s", str(error))
    assert found, str(error)
    return float(found[1]), float(found[2])


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_the_right_period_is_not_suspected(rotor, seed):
    analysis = identify(sampled(rotor, TRUE_PERIOD / 50, seed=seed), validate=False)
    found = synchrony(analysis.model, analysis.lifted)
    assert not found.broken
    assert abs(found.relative) < 4.0 * found.std
    # Known to about 1.5e-5, so that the slip of 1e-4 below stands out by six deviations and more.
    assert 1e-5 < found.std < 2e-5
    assert found.slip == pytest.approx(abs(found.relative) * 51200)


@pytest.mark.slow
def test_the_right_period_without_noise_is_not_suspected(rotor):
    """Then the deviation is tiny, but so is the slip."""
    analysis = identify(sampled(rotor, TRUE_PERIOD / 50, noise=0.0))
    found = synchrony(analysis.model, analysis.lifted)
    assert not found.broken
    assert found.slip < 1e-3


@pytest.mark.first(1)
@pytest.mark.parametrize("wrong", [1.0 + 1e-4, 1.0 - 1e-4])
def test_a_period_wrong_by_1e_4_is_refused_and_the_true_one_named(rotor, wrong):
    with pytest.raises(IdentificationError, match="does not repeat with the period given") as error:
        identify(sampled(rotor, TRUE_PERIOD / 50 * wrong))
    period, std = own_period(error.value)
    assert abs(period - TRUE_PERIOD) < 4.0 * std
    assert std < 2e-4


@pytest.mark.slow
def test_a_period_that_is_trusted_is_warned_of_instead(rotor):
    record = sampled(rotor, TRUE_PERIOD / 50 * (1.0 + 1e-4))
    analysis = identify(record, trust_period=True, validate=False)
    assert analysis.model.order == 4
    assert "does not repeat with the period given" in analysis.warnings[0]


@pytest.mark.slow
def test_the_papers_step_taken_literally_is_refused_and_the_true_period_named(rotor):
    """Δt = 0.126 is 2π/50 rounded: a period wrong by 0.27 %, which tears each harmonic into a mode of its own."""
    with pytest.raises(IdentificationError, match="does not repeat with the period given") as error:
        identify(sampled(rotor, 0.126))
    assert "not 6.3 s" in str(error.value)
    assert "137 samples" in str(error.value) or "138 samples" in str(error.value)
    period, _ = own_period(error.value)
    assert period == pytest.approx(TRUE_PERIOD, rel=1e-4)


def test_a_slip_that_does_no_harm_is_let_pass_however_clear():
    assert not Synchrony(relative=1e-9, std=1e-12, slip=0.009).broken
    assert Synchrony(relative=1e-9, std=1e-12, slip=0.011).broken
    assert not Synchrony(relative=-1e-3, std=2e-4, slip=5.0).broken
    assert Synchrony(relative=-1e-3, std=1e-4, slip=5.0).broken


def analysed(record, *, harmonics=None):
    """The chain without the refusal."""
    lifted = lift(segment(record))
    identifier = MaximumLikelihood()
    modal = identifier.extract(identifier.prepare(lifted.responses))
    return assemble(modal, lifted, harmonics=harmonics), lifted


@pytest.mark.slow
@pytest.mark.parametrize("relative", [-1e-3, -2e-4, 2e-4, 1e-3])
def test_drift_estimates_a_small_difference_without_bias(relative):
    """(own - given)/given, over draws of the noise: the mean within what the deviation of the mean allows."""
    model = small()
    found = []
    for seed in range(15):
        record = sampled(model, 6.0 / 12 / (1.0 + relative), n_phases=12, n_cycles=60, noise=0.02, seed=seed)
        found.append(drift(*analysed(record, harmonics=2)))
    pulls = np.array([(one.relative - relative) / one.std for one in found])
    assert abs(pulls.mean()) < 3.3 / np.sqrt(len(pulls))
    assert np.sum((pulls - pulls.mean()) ** 2) < 36.5  # chi-square of 14 degrees, 1 in 1000
    assert np.sum((pulls - pulls.mean()) ** 2) > 3.0  # and at the other end


def test_one_harmonic_does_not_tell_the_period():
    """A constant system seen by fixed sensors: nothing turns, whatever period is declared."""
    model = small()
    still = PeriodicModel(
        exponents=model.exponents,
        coefficients=model.coefficients[..., 2:3],
        harmonics=[0],
        period=6.0,
        channels=model.channels,
    )
    assert drift(*analysed(sampled(still, 0.5, n_phases=12, n_cycles=60))) is None
    # Nor is there anything to refuse: the exponents are right with any period.
    analysis = identify(sampled(still, 0.5, n_phases=11, n_cycles=60), validate=False)
    assert analysis.model.order == 4


def model_of(exponents, *, std=1e-6) -> PeriodicModel:
    """Modes with one harmonic each, as a wrong period makes them, with deviations for `spacing`."""
    full = np.stack([exponents, np.conj(exponents)], axis=1).ravel()
    return PeriodicModel(
        exponents=full,
        coefficients=np.ones((len(full), 1, 1, 1)),
        harmonics=[0],
        period=TRUE_PERIOD,
        channels=["a"],
        covariance=std**2 * np.eye(2 * len(full)),
    )


def test_spacing_reads_the_period_off_torn_modes(rotor):
    """Harmonics -1, 0, 1 of two modes as six modes of their own, spaced by ω/(1 + ε)."""
    _, lifted = analysed(sampled(small(), 0.5, n_phases=12, n_cycles=60))
    epsilon = 0.0027
    spaced = np.arange(-1, 2) / (1.0 + epsilon)
    torn = np.concatenate([-0.002 + 1j * (4.13 + spaced), -0.003 + 1j * (7.26 + spaced)])
    found = spacing(model_of(torn), lifted)
    assert found.relative == pytest.approx(epsilon, abs=5.0 * found.std)
    assert found.std < 1e-5
    assert found.broken


@pytest.mark.parametrize(
    "exponents",
    [
        [-0.002 + 4.13j, -0.003 + 5.13j],  # the decays differ
        [-0.002 + 4.13j, -0.002 + 5.0j],  # not spaced by ω
        [-0.002 + 4.13j, -0.002 + 5.127j],  # a single witness
        [-0.002 + 4.13j],
        [-0.002 + 0.33j, -0.002 + 0.330001j, -0.002 + 0.330002j],  # modes of one multiplier, and conjugates of others
    ],
)
def test_spacing_says_nothing_without_two_witnesses(exponents):
    _, lifted = analysed(sampled(small(), 0.5, n_phases=12, n_cycles=60))
    assert spacing(model_of(np.array(exponents)), lifted) is None


def test_spacing_needs_deviations():
    _, lifted = analysed(sampled(small(), 0.5, n_phases=12, n_cycles=60))
    bare = PeriodicModel(
        exponents=[-0.1], coefficients=np.ones((1, 1, 1, 1)), harmonics=[0], period=6.0, channels=["a"]
    )
    assert spacing(bare, lifted) is None
