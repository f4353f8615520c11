"""One shape for several hits, its deviations by brute force; couples of real multipliers; modes of a known A(t)."""

from dataclasses import replace

import numpy as np
import pytest

import floquid as fq
from floquid import floquet
from floquid.core import Channel, PeriodicModel, PeriodicModes, couples_of

OMEGA = 2.0


def along(one, other):
    """The share of one shape along another."""
    return abs(np.vdot(one, other)) ** 2 / (np.vdot(one, one).real * np.vdot(other, other).real)


def whirl(shape):
    x, y = shape[0], shape[1]
    forward, backward = np.abs(x + 1j * y) ** 2, np.abs(x - 1j * y) ** 2
    return (forward - backward).sum() / (forward + backward).sum()


@pytest.fixture
def unequal():
    """A mode in four hits whose noise differs by channel and hit, and is no product of both."""
    generator = np.random.default_rng(3)
    truth = generator.standard_normal((2, 5)) + 1j * generator.standard_normal((2, 5))
    states = np.array([1.0, 0.7j, -1.2, 0.9 + 0.5j])
    noise = np.array([[1e-3, 2e-2, 1e-3, 2e-2], [2e-2, 1e-3, 2e-3, 1e-2]])
    errors = generator.standard_normal((2, 4, 5)) + 1j * generator.standard_normal((2, 4, 5))
    lines = truth[:, None] * states[:, None] + noise[:, :, None] * errors
    model = PeriodicModel(
        exponents=[-0.1 + 5j, -0.1 - 5j],
        coefficients=[lines, lines[..., ::-1].conj()],
        harmonics=np.arange(-2, 3),
        period=2.0 * np.pi / OMEGA,
        channels=["x", "y"],
        coefficient_std=np.broadcast_to(noise[None, :, :, None] * (1.0 + 1j), (2, 2, 4, 5)),
    )
    return model, truth


def test_hits_of_unequal_noise_give_the_true_shape(unequal):
    """Shares and whirl within the noise; lines over the noise of their channel and hit miss by a tenth."""
    model, truth = unequal
    for mode, wanted in ((0, truth), (1, truth[:, ::-1].conj())):
        found = model.shape(mode).values
        assert along(found, wanted) > 1.0 - 1e-3
        assert abs(whirl(found) - whirl(wanted)) < 0.02


def test_a_loud_hit_does_not_spoil_the_shape(unequal):
    """A hit of a thousand times the noise of another counts a millionth of it."""
    model, truth = unequal
    generator, noise = np.random.default_rng(4), np.array([1e-3, 1.0])
    errors = generator.standard_normal((2, 2, 5)) + 1j * generator.standard_normal((2, 2, 5))
    lines = truth[:, None] * np.array([1.0, 0.7j])[:, None] + noise[:, None] * errors
    std = np.broadcast_to(noise[:, None] * (1.0 + 1j), (2, 2, 2, 5))
    noisy = replace(model, coefficients=np.array([lines, lines[..., ::-1].conj()]), coefficient_std=std)
    assert along(noisy.shape(0).values, truth) > 1.0 - 1e-5


def test_the_free_factor_is_fixed(unequal):
    model, _ = unequal
    shape = model.shape(0)
    largest = shape.values.flat[np.abs(shape.values).argmax()]
    assert largest == pytest.approx(abs(largest), rel=1e-12)
    row = model.shape(0, reference="y").values[1]
    assert row[np.abs(row).argmax()] == pytest.approx(np.abs(row).max(), rel=1e-12)
    size = np.linalg.norm(model.coefficients[0]) / np.sqrt(model.n_hits)
    assert np.linalg.norm(shape.values) == pytest.approx(size, rel=1e-3)
    with pytest.raises(fq.InputError, match="reference"):
        model.shape(0, reference="z")
    with pytest.raises(fq.InputError, match="mode"):
        model.shape(2)


def test_hits_with_shapes_of_their_own_do_not_agree(unequal):
    """By the energy along each of two shapes at right angles; noise is no disagreement."""
    model, _ = unequal
    assert model.shape(0).agreement > 1.0 - 1e-4
    for size in (0.5, 1.0):
        lines = np.zeros((2, 2, 1), complex)
        lines[0, 0], lines[1, 1] = 1.0, 1j * size
        exponents, phases = [-0.1 + 5j, -0.1 - 5j], [lines, lines.conj()]
        apart = PeriodicModel(exponents=exponents, coefficients=phases, harmonics=[0], period=1.0, channels=["x", "y"])
        # Without noise channels are weighted by their size, which is that of the hits here.
        assert apart.shape(0).agreement == pytest.approx(0.0, abs=1e-12)
        noisy = replace(apart, coefficient_std=np.full((2, 2, 2, 1), 1e-9 * (1.0 + 1j)))
        assert noisy.shape(0).agreement == pytest.approx((1.0 - size**2) / (1.0 + size**2), abs=1e-9)


def test_noise_is_no_disagreement():
    """Of one shape in three hits noise makes others, of a size that its deviations tell."""
    generator, found = np.random.default_rng(1), []
    for _ in range(40):
        shape, states = (generator.standard_normal((*size, 2)) @ [1.0, 1j] for size in ((6, 1, 3), (1, 3, 1)))
        lines = shape * states + 0.3 * generator.standard_normal((6, 3, 3, 2)) @ [1.0, 1j]
        model = PeriodicModel(
            exponents=[-0.1 + 5j, -0.1 - 5j],
            coefficients=[lines, lines.conj()[..., ::-1]],
            coefficient_std=np.full((2, 6, 3, 3), 0.3 + 0.3j),
            harmonics=[-1, 0, 1],
            period=1.0,
            channels=list("abcdef"),
        )
        found.append(model.shape(0).agreement)
    assert np.median(found) > 0.95


@pytest.mark.first(1)
@pytest.mark.parametrize("name", ["pairs", "locked", "blade"])
def test_deviations_are_those_of_brute_force(oracle, name):
    """Of shares of lines, which no factor moves, for a pair and its conjugate, and for real multipliers."""
    system = oracle.systems[name]
    known = oracle.known(system, oracle.displacements(system.half), hits=2, free_period=True, seed=1)
    weights = np.random.default_rng(2).random(known.model.shape(0).values.shape)

    def share(values):
        return (weights * np.abs(values) ** 2).sum() / (np.abs(values) ** 2).sum()

    modes = range(2)
    wanted = known.variances(lambda model: np.array([share(model.shape(mode).values) for mode in modes]))
    for mode, variance in enumerate(wanted):
        shape = known.model.shape(mode)
        by = 2.0 * (weights - share(shape.values)) * shape.values.conj() / (np.abs(shape.values) ** 2).sum()
        assert shape.variance(by[None])[0] == pytest.approx(variance, rel=1e-4)


def test_draws_spread_as_deviations_say(oracle):
    known = oracle.known(oracle.systems["pairs"], oracle.displacements(2), hits=2)
    shape = known.model.shape(0)
    drawn = shape.drawn(4000, np.random.default_rng(0)) - shape.values
    assert drawn.real.std(axis=0) == pytest.approx(shape.std.real, rel=0.06, abs=1e-15)
    assert drawn.imag.std(axis=0) == pytest.approx(shape.std.imag, rel=0.06, abs=1e-15)


def test_two_real_multipliers_of_a_lock_are_a_couple(oracle):
    """In the tongue of a Mathieu oscillator, beside a pair that is none; a third of that sign leaves it unsure."""
    matrix = oracle.systems["locked"].oracle()
    model = floquet.modes(matrix, outputs=np.eye(2)[:1], channels=["x"])
    assert model.couples == ((0, 1),)
    assert couples_of(model)[0].is_sure
    assert floquet.modes(oracle.systems["pairs"].oracle(), outputs=np.eye(4)[:2]).couples == ()
    third = PeriodicModel(
        exponents=[*model.exponents, model.exponents[0] - 0.1],
        coefficients=[*model.coefficients, model.coefficients[0]],
        harmonics=model.harmonics,
        period=model.period,
        channels=["x"],
    )
    assert not any(couple.is_sure for couple in couples_of(third))


def test_real_multipliers_of_unlike_shapes_are_none():
    coefficients = np.zeros((2, 2, 1, 1))
    coefficients[0, 0] = coefficients[1, 1] = 1.0
    model = PeriodicModel(
        exponents=[-1.0, -2.0], coefficients=coefficients, harmonics=[0], period=1.0, channels=["x", "y"]
    )
    assert model.couples == ()


def test_modes_of_a_known_system_in_outputs(oracle):
    """As those in states times C; of a periodic C as the product at each instant says."""
    matrix, known = oracle.systems["gyroscopic"].oracle(), np.eye(4)[[0, 1]]
    states = floquet.modes(matrix)
    model = floquet.modes(matrix, outputs=known, channels=[Channel(name="x"), "y"], point={"speed_rpm": 30.0})
    assert isinstance(model, PeriodicModes)
    assert model.point == {"speed_rpm": 30.0}
    assert model.exponents == pytest.approx(states.exponents, rel=1e-12)
    assert model.shape(0).variance(np.ones((1, 2, model.harmonics.size))) is None

    def turned(t):
        return np.array([[np.cos(np.pi * t), np.sin(np.pi * t), 0, 0]])

    rotating = floquet.FunctionMatrix(function=turned, period=2.0)
    times = np.array([0.3, 1.1])
    found = floquet.modes(matrix, outputs=rotating).shapes(times)[:, :, 0]
    wanted = np.stack([states.shapes(times)[..., k].T for k in range(2)])
    for k, t in enumerate(times):
        assert found[..., k] == pytest.approx((turned(t) @ wanted[k]).T, rel=1e-8, abs=1e-8)
    with pytest.raises(fq.InputError, match="outputs"):
        floquet.modes(matrix, outputs=np.eye(3))
