"""The constrained fit: exact without noise, within its deviations with it, for all kinds of modes and responses."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.signal import lfilter

from floquid import Record, identify
from floquid.core import ConstantPeriod, PeriodicModel
from floquid.errors import IdentificationError, InputError
from floquid.lifting import lift, whitened
from floquid.lti import fit_residues
from floquid.periodic import assemble, fit, refit
from floquid.periodic.least_squares import LiftedBlock, ModeParameters, linearise
from floquid.store import load, save
from floquid.sync import segment
from floquid.testing import pair_exponents

PERIOD = 2.5
OMEGA = 2.0 * np.pi / PERIOD


def system(exponents=(-0.06 + 0.9j, -0.04 + 2.2j), *, real=(), channels=2, hits=1, width=1, seed=0) -> PeriodicModel:
    """Pairs, and real multipliers given as (decay, half turns), of random shape about harmonic zero."""
    generator = np.random.default_rng(seed)
    span = width + 2
    size = (len(exponents), channels, hits, 2 * span + 1)
    pairs = np.zeros(size, complex)
    inner = slice(span - width, span + width + 1)
    pairs[..., inner] = generator.standard_normal((2, *size[:3], 2 * width + 1)).T.view(float).reshape(
        *size[:3], 2 * width + 1, 2
    ) @ np.array([0.3, 0.3j])
    pairs[..., span] += np.exp(2j * np.pi * generator.uniform(size=size[:-1]))
    upper = np.array(exponents, complex)
    listed = [np.stack([upper, upper.conj()], axis=1).ravel()]
    shapes = [np.stack([pairs, pairs[..., ::-1].conj()], axis=1).reshape(2 * len(upper), *size[1:])]
    for decay, turns in real:
        own = np.zeros((1, *size[1:]), complex)
        for m in range(-span, span + 1):
            mirror = -turns - m
            if abs(m + 0.5 * turns) <= 1 and 2 * m + turns >= 0 and -span <= mirror <= span:
                value = generator.standard_normal(size[1:3]) + 1j * generator.standard_normal(size[1:3])
                own[0, ..., m + span] = value.real if m == mirror else value
                own[0, ..., mirror + span] = own[0, ..., m + span].conj()
        listed.append(np.array([decay + 0.5j * turns * OMEGA]))
        shapes.append(own)
    return PeriodicModel(
        exponents=np.concatenate(listed),
        coefficients=np.concatenate(shapes),
        harmonics=np.arange(-span, span + 1),
        period=PERIOD,
        channels=[f"c{i}" for i in range(channels)],
    )


def records(model, *, noise=0.0, n_phases=16, n_cycles=50, first=0, colour=0.0, seed=0):
    generator = np.random.default_rng(seed)
    times = PERIOD / n_phases * (first + np.arange(n_phases * n_cycles))
    made = []
    for hit in range(model.n_hits):
        white = generator.standard_normal((len(model.channels), 200 + len(times)))
        made.append(
            Record(
                values=model.response(times)[:, hit] + noise * lfilter([1.0], [1.0, -colour], white, axis=1)[:, 200:],
                sample_rate=n_phases / PERIOD,
                start=times[0],
                channels=model.channels,
                clock=ConstantPeriod(period=PERIOD),
            )
        )
    return made


def near(model, lifted, *, off=1e-3):
    """A model of responses whose exponents are a little off."""
    moved = model.multipliers * np.exp(
        np.where(model.multipliers.imag == 0, off, off * (1 + 1j * np.sign(model.multipliers.imag)))
    )
    real = np.abs(model.multipliers.imag) < 1e-9 * np.abs(model.multipliers)
    moved = np.where(real, moved.real, moved)
    covariance = np.zeros((2 * model.order, 2 * model.order))
    return assemble(fit_residues(moved, lifted.responses, covariance=covariance), lifted, harmonics=3)


def held(model, lifted):
    """The model of the same modes with bands chosen anew."""
    silent = Record(values=np.zeros((lifted.n_channels, 1)), sample_rate=1.0, channels=model.channels)
    clock = ConstantPeriod(period=PERIOD)
    given = {"start": ModeParameters.of(model), "lifted": lifted, "forced": "none", "search": False}
    return fit([silent] * lifted.n_hits, [clock] * lifted.n_hits, **given)


ZERO = np.exp((-0.06 + 0.95j) * PERIOD / 16)
NOTCH = [1.0, -2.0 * ZERO.real, abs(ZERO) ** 2]
"""A filter that all but takes the first mode's largest harmonic away: its gain there hangs on the exponent."""

KINDS = {
    "pairs": system(),
    "a positive real multiplier": system(real=[(-0.05, 0)]),
    "a negative real multiplier": system(real=[(-0.05, 1)]),
    "a negative real multiplier turning backwards": system(real=[(-0.05, -1)]),
    "a growing mode": system([0.03 + 0.9j, -0.05 + 2.2j]),
    "real alone": system([], real=[(-0.05, 0), (-0.03, 1)]),
    "three channels, two hits": system(channels=3, hits=2),
}


@pytest.mark.first(5)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("first", [0, 5])
def test_without_noise_it_is_exact(kind, first):
    model = KINDS[kind]
    lifted = lift(segment(records(model, first=first))).with_noise(np.full((len(model.channels), model.n_hits), 1e-6))
    found = held(near(model, lifted), lifted).model
    pairing = pair_exponents(found.exponents, model.exponents, PERIOD)
    assert_allclose(np.abs(pairing.differences).max(), 0.0, atol=1e-8)
    times = np.linspace(0.0, 20.0 * PERIOD, 133)
    assert_allclose(found.response(times), model.response(times), atol=1e-6 * np.abs(model.response(times)).max())


def test_the_gradient_of_a_multiplier_turning_backwards_is_that_of_the_cost():
    model = KINDS["a negative real multiplier turning backwards"]
    lifted = lift(segment(records(model, noise=0.1))).with_noise(np.full((len(model.channels), model.n_hits), 0.1))
    entries = ModeParameters.of(near(model, lifted, off=0.02))
    now = linearise(LiftedBlock.all_of(lifted), entries)
    largest = np.abs(now.gradient).max()
    for k in range(len(now.gradient)):
        step = np.zeros(len(now.gradient))
        step[k] = 1e-5
        up, down = (linearise(LiftedBlock.all_of(lifted), entries.moved(sign * step)).cost for sign in (1.0, -1.0))
        assert (up - down) / 4e-5 == pytest.approx(-now.gradient[k], rel=1e-4, abs=1e-5 * largest)


@pytest.mark.first(1)
@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "noise", "taps"),
    [
        (system(real=[(-0.06, 1)], channels=3), 0.05, None),
        (system([0.03 + 0.9j, -0.05 + 2.2j], channels=3), 0.3, None),
        (system(channels=3), 0.05, [1.0, -0.9]),
        (system(channels=3), 0.02, NOTCH),
        (system([-0.3 + 0.9j, -0.25 + 2.2j], channels=2), 0.08, None),
        (system([-0.3 + 0.9j, -0.2 + 2.2j], channels=1, width=2), 0.05, None),
    ],
    ids=[
        "a real multiplier",
        "growing",
        "whitened",
        "under a notch",
        "fast and hardly above the noise",
        "weak harmonics",
    ],
)
def test_errors_are_those_of_the_deviations(model, noise, taps):
    """Over draws: exponents and coefficients, of the harmonics that are largest."""

    def responses(values, seed):
        clean = lift(segment(records(model)))
        clean = clean if taps is None else whitened(clean, np.tile(taps, (len(model.channels), 1)))
        drawn = np.random.default_rng(seed).standard_normal(clean.responses.values.shape)
        data = clean.responses
        noisy = type(data)(values=data.values + values * drawn, dt=data.dt, noise=data.noise, lengths=data.lengths)
        return replace(clean, responses=noisy).with_noise(np.full((len(model.channels), 1), noise))

    start = near(model, responses(0.0, 0), off=0.0)
    of_exponents, of_shapes = [], []
    for seed in range(60):
        found = held(start, responses(noise, seed)).model
        pairing = pair_exponents(found.exponents, model.exponents, PERIOD)
        std = found.exponent_std[pairing.permutation]
        of_exponents.append(
            np.concatenate([pairing.differences.real / std.real, pairing.differences.imag[[0, 2]] / std.imag[[0, 2]]])
        )
        here, there = (int(np.flatnonzero(one.harmonics == 0)[0]) for one in (found, model))
        off = found.coefficients[pairing.permutation][..., here] - model.coefficients[..., there]
        std = found.coefficient_std[pairing.permutation][..., here]
        of_shapes.append(np.stack([off.real / std.real, off.imag / std.imag])[:, ::2])
    assert np.sqrt(np.mean(np.square(of_exponents))) == pytest.approx(1.0, abs=0.17)
    assert np.sqrt(np.mean(np.square(of_shapes))) == pytest.approx(1.0, abs=0.13)


@pytest.mark.slow
def test_the_noise_of_the_coefficients_is_taken_off_the_information():
    model, noise = system([-0.3 + 0.9j, -0.25 + 2.2j]), 0.2
    clean = lift(segment(records(model))).with_noise(np.full((2, 1), noise))
    entries = replace(ModeParameters.of(near(model, clean, off=0.0)), bands=np.array([[-3, 3], [-3, 3]]))
    exact = np.diag(linearise(LiftedBlock.all_of(clean), entries).gauss_newton)
    drawn = []
    for seed in range(200):
        noisy = lift(segment(records(model, noise=noise, seed=seed))).with_noise(np.full((2, 1), noise))
        found = linearise(LiftedBlock.all_of(noisy), entries)
        drawn.append([np.diag(found.gauss_newton), np.diag(found.information)])
    whole, reduced = np.mean(drawn, axis=0)
    assert (whole > 1.06 * exact).all()
    assert_allclose(reduced, exact, rtol=0.04)


@pytest.mark.slow
def test_it_says_more_than_free_residues_of_a_mode_aliased_next_to_another():
    """Folded, the two are a twentieth of their width apart; unfolded, they have nothing to do with one another."""
    model = system([-0.06 + 0.9j, -0.06 + 1j * (0.905 + OMEGA)], channels=2)
    ratios, pulls = [], []
    for seed in range(10):
        lifted = lift(segment(records(model, noise=0.01, n_cycles=60, seed=seed))).with_noise(np.full((2, 1), 0.01))
        modal = fit_residues(model.multipliers, lifted.responses, covariance=np.eye(8) * 1e-6)
        found = held(assemble(modal, lifted, harmonics=3), lifted).model
        pairing = pair_exponents(found.exponents, model.exponents, PERIOD)
        std = found.exponent_std[pairing.permutation]
        pulls.append(np.concatenate([pairing.differences.real / std.real, pairing.differences.imag / std.imag]))
        free = bound_of_free_residues(model, lifted)
        ratios.append(std.real.mean() / free)
    # Where noise has passed for a harmonic, some of the gain is lost again.
    assert np.median(ratios) < 0.15
    assert np.sqrt(np.mean(np.square(pulls))) < 1.6


def bound_of_free_residues(model, lifted):
    from benchmarks.truth import cramer_rao_bound

    modal = fit_residues(model.multipliers, lifted.responses)
    lengths = [int(lifted.responses.lengths[0])]
    bound = cramer_rao_bound(modal.multipliers, modal.residues, lifted.responses.noise, lengths, PERIOD)
    return np.sqrt(np.diag(bound))[: modal.order].mean()


def test_whitened_responses_give_the_shapes_of_the_record():
    model = system(channels=2)
    raw = lift(segment(records(model, noise=0.02, colour=0.9, n_cycles=80)))
    through = whitened(raw, np.array([[1.0, -0.9], [1.0, -0.9]])).with_noise(np.full((2, 1), 0.02))
    found = held(near(model, through, off=0.0), through).model
    pairing = pair_exponents(found.exponents, model.exponents, PERIOD)
    here = int(np.flatnonzero(found.harmonics == 0)[0])
    off = found.coefficients[pairing.permutation][..., here] - model.coefficients[..., 3]
    std = found.coefficient_std[pairing.permutation][..., here]
    assert (np.abs(off.real) < 4.5 * std.real).all()
    assert (np.abs(off.imag) < 4.5 * std.imag).all()


def test_the_bands_are_those_of_the_system():
    """One harmonic a side in each mode, found again from three a side, and the noise with them."""
    model = system(channels=3)
    lifted = lift(segment(records(model, noise=0.01))).with_noise(np.full((3, 1), 0.01))
    found = held(near(model, lifted, off=0.0), lifted)
    kept = (found.model.coefficients != 0).any(axis=(1, 2))
    for mode in range(4):
        assert found.model.harmonics[kept[mode]].tolist() == [-1, 0, 1]
    assert_allclose(found.noise, 0.01, rtol=0.1)


def test_the_band_may_be_left_as_it_is():
    lifted = lift(segment(records(system(), noise=0.01))).with_noise(np.full((2, 1), 0.01))
    start = near(system(), lifted, off=0.0)
    kept = refit(start, lifted=lifted)
    assert kept.harmonics.tolist() == start.harmonics.tolist()


def test_a_model_of_other_responses_is_refused():
    lifted = lift(segment(records(system(channels=3))))
    with pytest.raises(InputError, match=r"`lifted` of `refit` must be responses of 1 hits and 2 channels"):
        refit(system(), lifted=lifted)


@pytest.mark.slow
def test_what_right_bands_leave_is_noise():
    model = system(channels=3)
    misfits = []
    for seed in range(20):
        lifted = lift(segment(records(model, noise=0.03, seed=seed))).with_noise(np.full((3, 1), 0.03))
        given = {"start": ModeParameters.of(model), "lifted": lifted, "forced": "none"}
        misfits.append(fit(records(model, noise=0.03, seed=seed), [ConstantPeriod(period=PERIOD)], **given).misfit)
    assert_allclose(misfits, 1.0, atol=0.1)
    assert np.std(misfits) > 1e-3


@pytest.mark.slow
def test_harmonics_that_are_held_out_are_warned_of():
    made = records(system(channels=3), noise=0.03)
    assert not any("times the noise" in words for words in identify(made, constrained=True, validate=False).warnings)
    short = identify(made, constrained=True, harmonics=0, validate=False)
    assert any("times the noise" in words and "Allow more harmonics" in words for words in short.warnings)


def test_a_fit_that_runs_away_is_refused():
    """Modes of which nothing is left after a period, in more noise than response."""
    model = system([-0.9 + 0.9j, -0.8 + 2.2j])
    lifted = lift(segment(records(model, noise=1.0))).with_noise(np.full((2, 1), 1.0))
    with pytest.raises(IdentificationError, match="moves an exponent by"):
        refit(near(model, lifted, off=0.0), lifted=lifted)


@pytest.mark.slow
def test_a_constrained_result_is_stored(tmp_path):
    found = identify(records(system(real=[(-0.05, 1)]), noise=0.02), constrained=True, validate=False)
    save(found, tmp_path / "r.h5")
    back = load(tmp_path / "r.h5")
    assert back.settings.constrained
    assert_array_equal(back.model.coefficients, found.model.coefficients)


def test_the_chain_with_the_constrained_finish():
    model = system(channels=3)
    free, held = (identify(records(model, noise=0.05), constrained=flag, validate=False) for flag in (False, True))
    assert held.settings.constrained
    for one in (free, held):
        pairing = pair_exponents(one.model.exponents, model.exponents, PERIOD)
        std = one.model.exponent_std[pairing.permutation]
        assert (np.abs(pairing.differences.real) < 4.5 * std.real).all()
    # At equal noise: both estimate it, and that may differ by more than there is to be gained.
    known, unknown = (np.sqrt(np.mean(one.noise**2)) / one.model.exponent_std.real for one in (held, free))
    assert (known > unknown).all()
