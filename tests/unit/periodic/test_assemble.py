"""A modal model of lifted responses made periodic: delay, branch, bands of harmonics, real multipliers, order."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from tests.several_hits import Hits

from floquid import floquet
from floquid.core import Channel, ConstantPeriod, PeriodicModel, Record
from floquid.errors import InputError
from floquid.lifting import Lifted, lift
from floquid.lti import Ensemble, MaximumLikelihood, ModalModel
from floquid.periodic import assemble, participation, select_bands
from floquid.sync import segment

PERIOD = 3.0
FUNDAMENTAL = 2.0 * np.pi / PERIOD


def pair_model(exponents, shapes, harmonics, *, period=PERIOD) -> PeriodicModel:
    """Modes of positive imaginary part (modes,), shapes (modes, channels, hits, harmonics), with their conjugates."""
    upper, shapes = np.asarray(exponents), np.asarray(shapes)
    n, channels, hits, width = shapes.shape
    return PeriodicModel(
        exponents=np.stack([upper, upper.conj()], axis=1).ravel(),
        coefficients=np.stack([shapes, shapes[..., ::-1].conj()], axis=1).reshape(2 * n, channels, hits, width),
        harmonics=harmonics,
        period=period,
        channels=[f"c{i}" for i in range(channels)],
    )


def lifted_from(model, *, n_cycles=40, n_phases=16, first_phase=0.0, noise=0.0, seed=0) -> Lifted:
    """The model's response sampled from `first_phase` on, cut and lifted."""
    times = first_phase * model.period + model.period / n_phases * np.arange(n_cycles * n_phases)
    generator = np.random.default_rng(seed)
    records = []
    for hit in range(model.n_hits):
        values = model.response(times)[:, hit]
        values = values + noise * np.abs(values).max(axis=1, keepdims=True) * generator.standard_normal(values.shape)
        clock = ConstantPeriod(period=model.period)
        records.append(
            Record(
                values=values,
                sample_rate=n_phases / model.period,
                channels=model.channels,
                clock=clock,
                start=times[0],
            )
        )
    return lift(segment(records))


def exact_modal(lifted: Lifted, multipliers) -> ModalModel:
    """The modal model of known multipliers, its residues by plain least squares, without uncertainties."""
    values, multipliers = lifted.responses.values, np.asarray(multipliers, complex)
    powers = multipliers ** np.arange(values.shape[2])[:, None]
    flat = np.linalg.lstsq(powers, values.reshape(-1, values.shape[2]).T.astype(complex), rcond=None)[0]
    return ModalModel(
        multipliers=multipliers, residues=flat.reshape(len(multipliers), *values.shape[:2]), dt=lifted.period
    )


def shapes_of(n_modes, *, channels=2, hits=1, width=2, seed=0, strongest=0):
    """Random shapes of which harmonic `strongest` is the largest by far in every channel."""
    generator = np.random.default_rng(seed)
    size = (n_modes, channels, hits, 2 * width + 1)
    shapes = generator.standard_normal(size) + 1j * generator.standard_normal(size)
    shapes *= 0.3 ** np.abs(np.arange(-width, width + 1) - strongest)
    shapes[..., width + strongest] += 2.0
    return shapes


def assert_same_model(found: PeriodicModel, expected: PeriodicModel, *, atol=1e-9):
    """Modes paired by exponent on the same branch; harmonics that only one of them keeps are zero in the other."""
    assert found.order == expected.order
    for r, exponent in enumerate(expected.exponents):
        k = int(np.argmin(np.abs(found.exponents - exponent)))
        assert abs(found.exponents[k] - exponent) < atol
        for m in np.union1d(found.harmonics, expected.harmonics):
            mine, wanted = (
                model.coefficients[i][..., model.harmonics == m].sum(axis=-1)
                for model, i in ((found, k), (expected, r))
            )
            assert_allclose(mine, wanted, atol=atol)


@pytest.mark.parametrize("hits", [1, 2])
@pytest.mark.parametrize("first_phase", [0.0, 0.25, 0.9375])
def test_a_models_own_response_gives_the_model_back(first_phase, hits):
    """Delay, branch and coefficients are exact, wherever in the period the record starts."""
    truth = pair_model([-0.05 + 0.8j, -0.1 + 5.0j], shapes_of(2, hits=hits), np.arange(-2, 3))
    lifted = lifted_from(truth, first_phase=first_phase)
    found = assemble(exact_modal(lifted, truth.multipliers), lifted, harmonics=2)
    assert_same_model(found, truth)
    assert found.channels == truth.channels
    assert found.period == pytest.approx(truth.period, rel=1e-12)


@pytest.mark.parametrize("strongest", [-2, -1, 1, 2])
def test_the_branch_is_where_the_zeroth_harmonic_is_largest(strongest):
    """A shape whose harmonic k is the largest comes out with the exponent moved by k iω and its indices by -k."""
    drawn = pair_model([-0.05 + 0.8j], shapes_of(1, width=2, strongest=strongest), np.arange(-2, 3))
    lifted = lifted_from(drawn)
    found = assemble(exact_modal(lifted, drawn.multipliers), lifted, harmonics=4)
    moved = -0.05 + 1j * (0.8 + strongest * FUNDAMENTAL)
    first = int(np.argmax(found.exponents.imag))
    assert found.exponents[first] == pytest.approx(moved if moved.imag > 0 else moved.conjugate(), abs=1e-10)
    energy = np.sum(np.abs(found.coefficients[first]) ** 2, axis=(0, 1))
    assert found.harmonics[np.argmax(energy)] == 0
    times = np.linspace(0.0, 20.0, 77)
    assert_allclose(found.response(times), drawn.response(times), atol=1e-9)


def test_the_branch_is_chosen_over_the_noise_of_each_channel_so_that_units_do_not_matter():
    """Channel a has its energy at 0 and little noise; b, in units of a millionth, has it at harmonic 1 and much."""
    shapes = np.zeros((1, 2, 1, 3), complex)
    shapes[0, 0, 0], shapes[0, 1, 0] = [0.0, 1.0, 0.1], [0.0, 1e5, 1e6]
    truth = pair_model([-0.02 + 0.8j], shapes, np.arange(-1, 2))
    lifted = lifted_from(truth)
    modal = exact_modal(lifted, truth.multipliers)
    quiet, loud = np.array([[1e-3], [1e5]]), np.array([[10.0], [1e-3]])
    assert assemble(modal, lifted.with_noise(quiet), harmonics=1).exponents[0].imag == pytest.approx(0.8)
    assert assemble(modal, lifted.with_noise(loud), harmonics=1).exponents[0].imag == pytest.approx(0.8 + FUNDAMENTAL)


def test_modes_come_by_ascending_size_each_conjugate_after_its_partner():
    truth = pair_model([-0.1 + 5.0j, -0.05 + 0.8j, -0.2 + 3.0j], shapes_of(3), np.arange(-2, 3))
    lifted = lifted_from(truth)
    shuffled = np.random.default_rng(0).permutation(truth.multipliers)
    found = assemble(exact_modal(lifted, shuffled), lifted, harmonics=2)
    assert (np.diff(np.abs(found.exponents[::2])) > 0).all()
    assert (found.exponents[::2].imag > 0).all()
    assert_array_equal(found.exponents[1::2], found.exponents[::2].conj())
    assert_array_equal(found.harmonics, -found.harmonics[::-1])
    assert_array_equal(found.coefficients[1::2], found.coefficients[::2, ..., ::-1].conj())


def locked_mathieu(damping=0.06, q=0.1):
    """x'' + 2ζx' + (1 - 2q cos 2t)x = 0, locked at half the parametric frequency: multipliers real and negative."""

    def system(t):
        t = np.asarray(t, float)
        a = np.zeros((*t.shape, 2, 2))
        a[..., 0, 1] = 1.0
        a[..., 1, 0] = -(1.0 - 2.0 * q * np.cos(2.0 * t))
        a[..., 1, 1] = -2.0 * damping
        return a

    return system


def test_real_negative_multipliers_stay_real_and_so_does_the_response():
    """Damped Mathieu: two of them. Their shapes are their own conjugates about a half-integer harmonic."""
    system, period, phases, cycles = locked_mathieu(), np.pi, 32, 200
    within = floquet.transition(system, period, period * np.arange(phases) / phases)
    states, monodromy = [np.array([0.3, 1.0])], floquet.monodromy(system, period)
    for _ in range(cycles - 1):
        states.append(monodromy @ states[-1])
    values = np.einsum("pn,kn->kp", within[:, 0, :], states).reshape(1, -1)
    record = Record(values=values, sample_rate=phases / period, channels=["x"], clock=ConstantPeriod(period=period))
    lifted = lift(segment(record)).with_noise(np.zeros((1, 1)))
    identifier = MaximumLikelihood()
    modal = identifier.extract(identifier.prepare(lifted.responses))
    assert_array_equal(modal.multipliers.imag, 0.0)
    model = assemble(modal, lifted)
    expected = floquet.exponents(system, period)
    assert_allclose(np.sort(model.exponents.real), np.sort(expected.real), atol=1e-9)
    assert_allclose(model.exponents.imag, 1.0, atol=1e-12)
    times = period / phases * np.arange(values.shape[1])
    terms = np.einsum("rchn,rn->chn", model.shapes(times), np.exp(np.multiply.outer(model.exponents, times)))
    assert np.abs(terms.imag).max() < 1e-9 * np.abs(values).max()
    assert_allclose(terms.real[:, 0], values, atol=1e-8 * np.abs(values).max())


@pytest.mark.parametrize("multiplier", [0.8, -0.8])
def test_a_real_multiplier_keeps_the_mirror_image_of_its_band(multiplier):
    """λ + imω and its conjugate must both be kept: exactly one real harmonic for +, a pair of them for -."""
    turn = 0.0 if multiplier > 0 else 0.5
    exponent = np.log(abs(multiplier)) / PERIOD + 1j * turn * FUNDAMENTAL
    harmonics = np.arange(-3, 3) if turn else np.arange(-2, 3)
    generator = np.random.default_rng(0)
    half = generator.standard_normal((2, 1, len(harmonics))) + 1j * generator.standard_normal((2, 1, len(harmonics)))
    mirror = (half + half[..., ::-1].conj()) * 0.2 ** np.abs(harmonics + turn)
    truth = PeriodicModel(
        exponents=[exponent],
        coefficients=mirror[None],
        harmonics=harmonics,
        period=PERIOD,
        channels=["a", "b"],
    )
    lifted = lifted_from(truth, noise=0.01)
    identifier = MaximumLikelihood()
    modal = identifier.extract(identifier.prepare(lifted.responses))
    for found in (assemble(modal, lifted), assemble(modal, lifted, harmonics=0)):
        assert found.exponents[0].imag == pytest.approx(turn * FUNDAMENTAL)
        kept = found.harmonics[np.abs(found.coefficients[0]).max(axis=(0, 1)) > 0]
        mirrored = -kept[::-1] - (1 if turn else 0)
        assert_array_equal(kept, mirrored)
        assert_allclose(found.coefficients[0], found.coefficients[0][..., ::-1].conj(), atol=1e-12)
        assert (found.coefficient_std[0].real >= 0).all()
    assert len(kept) == (2 if turn else 1)


def test_deviations_are_none_where_the_modal_model_has_none():
    truth = pair_model([-0.05 + 0.8j], shapes_of(1), np.arange(-2, 3))
    lifted = lifted_from(truth)
    modal = exact_modal(lifted, truth.multipliers)
    found = assemble(modal, lifted, harmonics=2)
    assert found.covariance is None
    assert found.coefficient_std is None
    with pytest.raises(InputError, match=r"`harmonics` of `assemble` must be given when the modal model has no dev"):
        assemble(modal, lifted)


def test_the_noise_of_a_coefficient_is_what_least_squares_says():
    """White noise σ on R known exactly in its poles: a coefficient has σ²(E⁺E⁺ᴴ) Σ|e^{-(λ+imω)t}|²/P² in all."""
    truth = pair_model([-0.05 + 0.8j], shapes_of(1, channels=1), np.arange(-2, 3))
    lifted = lifted_from(truth, noise=0.02, n_cycles=80).with_noise(np.array([[0.1]]))
    identifier = MaximumLikelihood()
    modal = identifier.extract(identifier.prepare(lifted.responses))
    still = dataclasses.replace(modal, covariance=np.zeros_like(modal.covariance))
    found = assemble(still, lifted, harmonics=1)
    powers = modal.multipliers ** np.arange(80)[:, None]
    spread = np.linalg.inv(powers.conj().T @ powers)[0, 0].real
    for column, m in enumerate(found.harmonics):
        kernel = np.exp(-(found.exponents[0] + 1j * m * FUNDAMENTAL) * lifted.phase_times) / lifted.n_phases
        whole = np.abs(found.coefficient_std[0, 0, 0, column].real) ** 2
        whole += np.abs(found.coefficient_std[0, 0, 0, column].imag) ** 2
        assert whole == pytest.approx(0.1**2 * spread * np.sum(np.abs(kernel) ** 2), rel=1e-6)


@pytest.mark.parametrize(
    "exponents", [[-0.05 + 0.8j, -0.08 + 0.83j], [-0.3 + 0.8j, -0.4 + 1.7j]], ids=["close", "fast"]
)
def test_what_an_error_of_the_poles_does_to_a_coefficient_is_its_derivative(exponents):
    """With no noise on the residues, the deviations are D C Dᵀ, D by differences of the whole way from the poles.

    The poles are moved, the residues fitted again by plain least squares, the delay taken off, the branch kept.
    """
    truth = pair_model(exponents, shapes_of(2, hits=2), np.arange(-2, 3))
    lifted = lifted_from(truth, n_cycles=20).with_noise(np.full((2, 2), 0.01))
    identifier = MaximumLikelihood()
    modal = identifier.refine(identifier.prepare(lifted.responses), exact_modal(lifted, truth.multipliers))
    still = dataclasses.replace(modal, residue_spread=np.zeros_like(modal.residue_spread))
    found = assemble(still, lifted, harmonics=2)

    def coefficients(poles):
        moved = assemble(exact_modal(lifted, np.exp(poles * lifted.period)), lifted, harmonics=2)
        return moved.coefficients[np.argsort(np.abs(moved.exponents), kind="stable")][::2]

    size, slopes = 1e-6, []
    upper = np.flatnonzero(modal.multipliers.imag > 0)
    lower = [int(np.argmin(np.abs(modal.multipliers - modal.multipliers[u].conj()))) for u in upper]
    for turn in (1.0, 1.0j):
        for u, v in zip(upper, lower, strict=True):
            step = np.zeros(4, complex)
            step[u], step[v] = size * turn, size * np.conj(turn)
            slopes.append((coefficients(modal.poles + step) - coefficients(modal.poles - step)) / (2.0 * size))
    slopes = np.array(slopes)
    both = np.concatenate([upper, upper + 4])
    covariance = modal.covariance[np.ix_(both, both)]
    real = np.sqrt(np.einsum("i...,ij,j...->...", slopes.real, covariance, slopes.real))
    imag = np.sqrt(np.einsum("i...,ij,j...->...", slopes.imag, covariance, slopes.imag))
    assert_allclose(found.coefficient_std[::2].real, real, rtol=1e-4, atol=1e-4 * real.max())
    assert_allclose(found.coefficient_std[::2].imag, imag, rtol=1e-4, atol=1e-4 * real.max())


def test_models_that_do_not_belong_together_are_refused():
    truth = pair_model([-0.05 + 0.8j], shapes_of(1), np.arange(-2, 3))
    lifted, other = lifted_from(truth), lifted_from(truth, n_phases=12)
    with pytest.raises(InputError, match=r"^Argument `modal` of `assemble` must be a model of `lifted.responses`, but"):
        assemble(exact_modal(other, truth.multipliers), lifted)


@pytest.mark.parametrize("harmonics", [-1, 8, 100])
def test_more_harmonics_than_phases_hold_are_refused(harmonics):
    truth = pair_model([-0.05 + 0.8j], shapes_of(1), np.arange(-2, 3))
    lifted = lifted_from(truth, n_phases=16)
    with pytest.raises(InputError, match=r"`harmonics` of `assemble` must be at least 0 and less than half the 16"):
        assemble(exact_modal(lifted, truth.multipliers), lifted, harmonics=harmonics)


# Bands. Scores are given as sizes of one channel's coefficients over a deviation of one in each part.

HARMONICS = np.arange(-6, 7)


def bands(sizes, *, seeds=(0, 0), false_alarm=1e-8, std=1.0 + 1.0j, channels=1):
    coefficients = np.zeros((1, channels, 1, len(HARMONICS)), complex)
    for m, size in sizes.items():
        coefficients[0, :, 0, m + 6] = size
    kept = select_bands(
        coefficients, np.full(coefficients.shape, std), HARMONICS, np.array([seeds]), false_alarm=false_alarm
    )
    return HARMONICS[kept[0]].tolist()


@pytest.mark.parametrize(
    ("sizes", "expected"),
    [
        ({0: 100.0}, [0]),
        ({}, [0]),
        ({0: 100.0, 1: 50.0, -1: 50.0}, [-1, 0, 1]),
        ({0: 100.0, 1: 50.0}, [0, 1]),
        ({0: 100.0, 2: 50.0}, [0, 1, 2]),
        ({0: 100.0, 3: 50.0}, [0, 1, 2, 3]),
        ({0: 100.0, 4: 50.0}, [0, 1, 2, 3, 4]),
        ({0: 100.0, 5: 50.0}, [0]),
        ({0: 100.0, 3: 50.0, 6: 50.0}, [0, 1, 2, 3, 4, 5, 6]),
        ({0: 100.0, -6: 50.0, 6: 50.0}, [0]),
        ({-2: 50.0}, [-2, -1, 0]),
    ],
)
def test_a_band_grows_over_at_most_three_harmonics_that_are_not_seen(sizes, expected):
    assert bands(sizes) == expected


def test_a_harmonic_counts_when_chance_would_hardly_make_it():
    """Two degrees of freedom: the chance of a size s is exp(-s²/2), so that of 6.4030 is an eighth of 1e-8."""
    assert bands({1: 6.40}) == [0]
    assert bands({1: 6.41}) == [0, 1]
    assert bands({1: 3.66}, false_alarm=0.01) == [0, 1]
    assert bands({1: 3.65}, false_alarm=0.01) == [0]


def test_channels_are_judged_together():
    assert bands({1: 5.0}) == [0]
    assert bands({1: 5.0}, channels=3) == [0, 1]


def test_seeds_are_kept_whatever_they_are():
    assert bands({}, seeds=(-3, 0)) == [-3, -2, -1, 0]
    assert bands({2: 50.0}, seeds=(-1, 0)) == [-1, 0, 1, 2]


def test_a_part_that_has_no_deviation_of_its_own_does_not_count():
    """The imaginary part of a real mode's zeroth coefficient is zero by construction, and so is its deviation."""
    assert bands({1: 6.41}, std=1.0 + 0.0j) == [0, 1]
    assert bands({1: 6.06j}, std=1.0 + 0.0j) == [0]


def test_participation_shares_the_energy_over_the_noise():
    shapes = np.zeros((1, 2, 1, 5), complex)
    shapes[0, :, 0, 2], shapes[0, 0, 0, 3] = [3.0, 4.0], 5.0j
    model = pair_model([-0.05 + 0.8j], shapes, np.arange(-2, 3))
    harmonics, shares = participation(model, 0, np.array([[1.0], [0.5]]))
    assert_array_equal(harmonics, [0, 1])
    assert_allclose(shares, np.array([9.0 + 4.0, 25.0]) / 38.0)
    assert participation(model, 1, np.ones((2, 1)))[0].tolist() == [-1, 0]


def test_channels_keep_their_units():
    truth = pair_model([-0.05 + 0.8j], shapes_of(1), np.arange(-2, 3))
    channels = (Channel(name="a", unit="m"), Channel(name="b", unit="g"))
    truth = PeriodicModel(
        exponents=truth.exponents,
        coefficients=truth.coefficients,
        harmonics=truth.harmonics,
        period=PERIOD,
        channels=channels,
    )
    lifted = lifted_from(truth)
    assert assemble(exact_modal(lifted, truth.multipliers), lifted, harmonics=2).channels == channels


@pytest.mark.parametrize("noise", [(1.0, 1.0, 1.0), (1.0, 3.0, 0.5)])
def test_outer_products_err_alike_in_all_hits(noise):
    """Deviations are the Cramér-Rao bound of one shape; that of a sum over hits, too, whose errors are not independent.

    With three samples a period the free residues of each phase are three harmonics, as the bound has them.
    """
    size = np.array(noise)
    hits = Hits.drawn([-0.25 + 1.4j, -0.2 + 2.6j], 3, 12, channels=3, phases=3, noise=1e-4, seed=2)
    hits = dataclasses.replace(hits, states=hits.states / size)  # the bound is of hits of equal noise
    records = [
        dataclasses.replace(record, values=record.values * own)
        for record, own in zip(hits.records(0), noise, strict=True)
    ]
    lifted = lift(segment(records)).with_noise(np.tile(hits.noise * size, (3, 1)))
    identifier = Ensemble()
    model = assemble(identifier.extract(identifier.prepare(lifted.responses), 4), lifted, harmonics=1)
    assert_allclose(model.exponents[::2], hits.exponents, atol=1e-3)
    estimates, (_, bound) = model.estimates, hits.bound()
    wanted = np.array([bound[m, :, :, k + 1] for m, k in zip(estimates.modes, estimates.harmonics, strict=True)])
    found = estimates.std() / size
    assert_allclose(found.real, wanted.real, rtol=0.15)
    assert_allclose(found.imag, wanted.imag, rtol=0.15)
    whole = np.broadcast_to(1.0 / size, (1, *estimates.coefficients.shape)).astype(complex)
    assert np.sqrt(estimates.variance(by_coefficients=whole)[0]) == pytest.approx(hits.bound_of_sum(), rel=0.1)
