"""The order chosen: right, with its reasons, in doubt when the data are; in noise that is coloured or dependent too."""

import numpy as np
import pytest
from scipy.signal import lfilter

from floquid.lti import AMI, ERA, MaximumLikelihood, Outcome, TimeResponses, white_noise_std
from floquid.lti._factor import factor, factors
from floquid.lti._poles import PoleSet
from floquid.lti.likelihood._residual import Residual, filtered, whitening_of
from floquid.order import choose, judge

PAIRS = [-0.02 + 0.8j, -0.03 + 1.7j, -0.04 + 2.6j]


def ringing(logs, noise, *, outputs=40, inputs=1, seed=0):
    """Decays beside noise (samples, outputs, inputs) of unit variance times `noise` of the largest response."""
    generator = np.random.default_rng(seed)
    samples = len(noise[0])
    residues = generator.standard_normal((2, outputs, inputs, len(logs)))
    values = ((residues[0] + 1j * residues[1]) @ np.exp(np.multiply.outer(logs, np.arange(samples)))).real
    sigma = noise[1] * np.abs(values).max()
    values = values + sigma * np.moveaxis(noise[0].reshape(samples, outputs, inputs), 0, 2)
    return TimeResponses(values=values, dt=0.5, noise=np.full((outputs, inputs), sigma))


def white(samples=200, outputs=40, seed=0):
    return np.random.default_rng(100 + seed).standard_normal((samples, outputs))


def coloured(pole, samples=200, outputs=40, seed=0):
    """Noise that depends on the samples before."""
    made = lfilter([1.0], [1.0, -pole], white(samples + 100, outputs, seed), axis=0)[100:]
    return made / made.std()


def dependent(pole, samples=200, outputs=40, seed=0):
    """Noise that depends on the responses before, as that of a record sampled faster than its noise changes does."""
    made = lfilter([1.0], [1.0, -pole], white(samples, outputs, seed).ravel())
    return (made / made.std()).reshape(samples, outputs)


def upper(model):
    logs = np.log(model.multipliers)
    return np.sort_complex(logs[logs.imag > 0])


NOISES = {
    "white": white,
    "red": lambda **options: coloured(0.8, **options),
    "blue": lambda **options: coloured(-0.8, **options),
    "dependent": lambda **options: dependent(0.9, **options),
}


@pytest.mark.first(4)
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("share", [0.01, 0.1])
@pytest.mark.parametrize("kind", NOISES)
def test_the_order_is_right_in_noise_of_any_colour(kind, share, seed):
    choice = choose(ringing(PAIRS, (NOISES[kind](seed=seed), share), seed=seed))
    assert choice.order == 6
    assert not choice.ambiguous, choice.doubts
    assert np.abs(np.sort_complex(np.array(PAIRS)) - upper(choice.model)).max() < 0.02


@pytest.mark.parametrize("kind", NOISES)
def test_noise_alone_holds_no_mode(kind):
    for seed in range(2):
        noise = NOISES[kind](seed=seed)
        data = TimeResponses(values=noise.T[:, None], dt=1.0)
        identifier = MaximumLikelihood()
        assert identifier.extract(identifier.prepare(data)).outcome is Outcome.NO_MODE


@pytest.mark.slow
def test_without_whitening_coloured_noise_passes_for_modes(monkeypatch):
    """What the right estimator is spared."""
    monkeypatch.setattr("floquid.lti.likelihood._maximum_likelihood.whitening_of", lambda _: None)
    data = ringing(PAIRS, (coloured(0.5), 0.02))
    identifier = MaximumLikelihood(most=12)
    assert identifier.extract(identifier.prepare(data)).order > 6


@pytest.mark.slow
def test_deviations_hold_in_coloured_noise():
    """Errors over their deviations, over draws of the noise: whitened, the poles err as they say."""
    pulls = []
    for seed in range(60):
        data = ringing(PAIRS, (coloured(0.7, seed=seed), 0.03), seed=0)
        identifier = MaximumLikelihood()
        model = identifier.extract(identifier.prepare(data))
        assert model.order == 6
        std = np.sqrt(np.diag(model.covariance)) * model.dt
        for log in PAIRS:
            off = np.log(model.multipliers) - log
            k = int(np.argmin(np.abs(off)))
            pulls += [off[k].real / std[k], off[k].imag / std[k + 6]]
    assert np.sqrt(np.mean(np.square(pulls))) == pytest.approx(1.0, abs=0.15)


def pulls_in_shared_noise(seeds):
    """Errors over deviations where half of the noise is the same in all responses."""
    pulls = []
    for seed in seeds:
        generator = np.random.default_rng(1000 + seed)
        noise = np.sqrt(0.5) * (white(seed=seed) + generator.standard_normal((200, 1)))
        identifier = MaximumLikelihood()
        model = identifier.extract(identifier.prepare(ringing(PAIRS, (noise, 0.03), seed=0)))
        if model.order == 6:
            std = np.sqrt(np.diag(model.covariance)) * model.dt
            for log in PAIRS:
                off = np.log(model.multipliers) - log
                k = int(np.argmin(np.abs(off)))
                pulls += [off[k].real / std[k], off[k].imag / std[k + 6]]
    assert len(pulls) > 5 * len(seeds)
    return np.sqrt(np.mean(np.square(pulls)))


@pytest.mark.slow
def test_deviations_hold_in_noise_that_responses_share(monkeypatch):
    right = pulls_in_shared_noise(range(60))
    assert right == pytest.approx(1.0, abs=0.1)
    monkeypatch.setattr("floquid.lti.likelihood._maximum_likelihood.of_dependent_noise", lambda found, _: found)
    assert pulls_in_shared_noise(range(60)) > right + 0.05


def test_the_reasons_name_what_was_looked_at():
    choice = choose(ringing(PAIRS, (white(), 0.02)))
    text = " ".join(choice.reasons)
    for words in (
        "3 modes is needed",
        "well determined",
        "standard deviations apart",
        "further candidate",
        "white noise",
    ):
        assert words in text
    assert choice.doubts == ()
    assert choice.runner_up.order in {4, 5, 7, 8}
    assert choice.evidence.less.order == 4


@pytest.mark.parametrize("identifier", [AMI(), ERA(), MaximumLikelihood(initial=ERA())])
def test_any_identifier_may_find_the_poles(identifier):
    assert choose(ringing(PAIRS, (white(), 0.02)), identifier).order == 6


def test_an_order_too_low_is_in_doubt():
    data = ringing(PAIRS, (white(), 0.02))
    identifier = MaximumLikelihood()
    choice = judge(data, identifier.extract(identifier.prepare(data), 4))
    assert choice.ambiguous
    assert any("further candidate exceeds" in doubt for doubt in choice.doubts)
    assert choice.runner_up.order == 6


def test_an_order_too_high_is_in_doubt():
    data = ringing(PAIRS, (white(), 0.02))
    identifier = MaximumLikelihood()
    choice = judge(data, identifier.extract(identifier.prepare(data), 8))
    assert choice.ambiguous
    assert any("Not each of the 4 modes is needed" in doubt for doubt in choice.doubts)
    assert choice.runner_up.order in {6, 7}


def test_a_pair_that_cannot_be_told_is_in_doubt_or_seen_as_one():
    """A tenth of the half-power width apart in 20 % noise: the separation is below one standard deviation."""
    for seed in range(8):
        data = ringing([-0.02 + 1.0j, -0.02 + 1.004j], (white(samples=256, seed=seed), 0.2), seed=seed)
        choice = choose(data)
        if choice.order == 2 and not choice.ambiguous:
            said = next(reason for reason in choice.reasons if "would be seen as one" in reason)
            assert float(said.split("about ")[1].split()[0]) > 0.1
        else:
            assert choice.ambiguous


def test_a_pair_that_is_told_is_farther_apart_than_what_is_said_to_be_seen_as_one():
    """Of the same strengths and noise, a mode alone says how near another might be."""
    told = choose(ringing([-0.02 + 1.0j, -0.02 + 1.04j], (white(samples=256), 0.02)))
    assert told.order == 4
    alone = choose(ringing([-0.02 + 1.0j], (white(samples=256), 0.02)))
    said = next(reason for reason in alone.reasons if "would be seen as one" in reason)
    assert 0.01 < float(said.split("about ")[1].split()[0]) < 1.0


@pytest.mark.slow
def test_a_random_walk_is_never_clearly_a_mode():
    """Twenty samples a period of noise that wanders, and nothing else."""
    for seed in range(6):
        walk = np.cumsum(np.random.default_rng(seed).standard_normal((4, 8000)), axis=1)
        values = walk.reshape(4, 400, 20).transpose(0, 2, 1).reshape(80, 1, 400)
        noise = np.array([[white_noise_std(values[20 * c : 20 * (c + 1), 0])] * 20 for c in range(4)]).reshape(80, 1)
        choice = choose(TimeResponses(values=values, dt=1.0, noise=noise))
        assert choice.order == 0 or choice.ambiguous


def test_white_noise_has_no_colour_and_independent_responses():
    residuals = [Residual.of(PoleSet.empty(), [factor(white(seed=seed))]) for seed in range(40)]
    colours = np.array([residual.colour() for residual in residuals])
    assert abs(colours.mean()) < 4.0 / np.sqrt(40)
    assert 0.6 < colours.std() < 1.4
    assert {residual.independent for residual in residuals} == {1.0}


@pytest.mark.parametrize("pole", [0.3, 0.6, 0.9])
def test_what_dependent_responses_are_worth(pole):
    """(tr Σ)²/tr Σ² of an autoregression along the responses is (1 - φ²)/(1 + φ²) of their number."""
    left = Residual.of(PoleSet.empty(), [factor(dependent(pole, samples=400, outputs=60))])
    assert left.independent == pytest.approx((1 - pole**2) / (1 + pole**2), rel=0.15, abs=0.02)


def test_whitening_makes_white():
    made = factor(coloured(0.8, samples=400))
    taps = whitening_of(Residual.of(PoleSet.empty(), [made]))
    assert taps[1] / taps[0] == pytest.approx(-0.8, abs=0.03)
    assert abs(Residual.of(PoleSet.empty(), [filtered(made, taps)]).colour()) < 5.0
    assert whitening_of(Residual.of(PoleSet.empty(), [factor(white())])) is None


TAKEN = {
    "what is steady": lambda times: [np.ones_like(times)],
    "what alternates": lambda times: [np.cos(np.pi * times)],
    "a drift": lambda times: [np.ones_like(times), times],
    "a steady tone": lambda times: [np.cos(2.0 * np.pi * times / 5.0), np.sin(2.0 * np.pi * times / 5.0)],
}


def without(noise, functions, *, told=True):
    """Residual of noise (samples, outputs) without functions of time, with or without the knowledge of them."""
    basis, _ = np.linalg.qr(np.stack(functions(np.arange(len(noise), dtype=float)), axis=1))
    values = noise - basis @ (basis.T @ noise)
    data = TimeResponses(values=values.T[:, None], dt=1.0, taken=basis if told else None)
    return Residual.of(PoleSet.empty(), factors(data))


@pytest.mark.parametrize("functions", TAKEN.values(), ids=TAKEN)
@pytest.mark.parametrize("samples", [60, 140])
def test_what_was_taken_off_is_no_colour(functions, samples):
    noise = white(samples, 800)
    left = without(noise, functions)
    assert abs(left.colour()) < 4.0
    assert whitening_of(left) is None
    assert np.abs(left.autocorrelation(8)[1:]).max() < 4.5 / np.sqrt(noise.size)
    assert without(noise, functions, told=False).colour() > 8.0


@pytest.mark.parametrize("functions", TAKEN.values(), ids=TAKEN)
def test_colour_beside_what_was_taken_off_is_whitened(functions):
    left = without(coloured(0.8, samples=140, outputs=400), functions)
    taps = whitening_of(left)
    # Such noise is loudest at rest: a drift takes more of it than white noise would lose.
    assert taps[1] / taps[0] == pytest.approx(-0.8, abs=0.05)
    assert abs(left.filtered(taps).colour()) < 8.0


def test_a_decay_left_over_is_not_taken_for_noise():
    data = ringing(PAIRS, (white(), 0.01))
    left = Residual.of(PoleSet.empty(), [factor((data.values[:, 0] / data.noise).T)])
    assert not left.judged
    assert whitening_of(left) is None
