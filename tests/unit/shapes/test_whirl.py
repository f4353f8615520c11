"""Whirl of modes: of known rotors by their eigenvectors, with deviations by brute force; exchanged axes; refusals."""

import numpy as np
import pytest

import floquid as fq
from floquid import floquet
from floquid.core import Channel, PeriodicModel
from floquid.shapes import read_shapes

OMEGA = 2.0


def model_of(lines, exponent=-0.1 + 5j, channels=("x", "y")):
    """A model of one pair by its lines (channels, harmonics)."""
    values = np.asarray(lines, complex)[:, None]
    half = values.shape[2] // 2
    return PeriodicModel(
        exponents=[exponent, exponent.conjugate()],
        coefficients=[values, values[..., ::-1].conj()],
        harmonics=np.arange(-half, half + 1),
        period=2.0 * np.pi / OMEGA,
        channels=list(channels),
    )


def read(model, pairs=("x:y",)):
    return read_shapes(model, pairs=pairs).modes[0].whirl


def test_circles_ellipses_and_lines():
    """x = cos σt, y = sin σt is forward; an axis ratio of r has the index 2r/(1 + r²)."""
    for side in (1.0, -1.0):
        whirl = read(model_of([[0, 1, 0], [0, -1j * side, 0]]))
        assert (whirl.index, whirl.word) == (pytest.approx(side), "forward" if side > 0 else "backward")
        assert read(model_of([[0, 1, 0], [0, -0.5j * side, 0]])).index == pytest.approx(0.8 * side)
    for angle in (0.3, 2.0):
        whirl = read(model_of([[0, 0.2j + np.cos(angle) * 2j - 0.2j, 0], [0, np.sin(angle) * 2j, 0]]))
        assert (whirl.index, whirl.word) == (pytest.approx(0.0, abs=1e-12), "mixed (planar)")
        assert whirl.axis == pytest.approx(angle)


def test_a_pair_without_motion_does_not_whirl():
    """It was told to whirl backward, with the index -1."""
    model = model_of([[0, 0, 0], [0, 0, 0], [0, 1, 0]], channels=("x", "y", "z"))
    whirl = read(model)
    assert (whirl.index, whirl.strongest, whirl.word) == (0.0, 0.0, "mixed")


def test_axes_exchanged_and_the_rotor_turning_the_other_way_flip_the_sign():
    generator = np.random.default_rng(1)
    model = model_of(generator.standard_normal((2, 5)) + 1j * generator.standard_normal((2, 5)))
    whirl = read(model)
    assert read(model, ["y:x"]).index == pytest.approx(-whirl.index)
    back = model_of(model.coefficients[0][:, 0].conj(), exponent=model.exponents[0])
    assert read(back).index == pytest.approx(-whirl.index)


def test_lines_of_negative_frequency_count_the_other_way():
    """The line at 5 - 3·2 rad/s is seen at +1 rad/s, going the other way."""
    lines = np.zeros((2, 7), complex)
    lines[:, 0] = 1.0, -1j
    assert read(model_of(lines)).index == pytest.approx(-1.0)


def test_pairs_along_the_shaft():
    channels = [Channel(name=name, unit="mm") for name in ("x", "y", "x2", "y2")]
    same = read(model_of([[0, 1, 0], [0, -1j, 0], [0, 0.5, 0], [0, -0.5j, 0]], channels=channels), ["x:y,x2:y2"])
    assert same.by_pair == pytest.approx([1.0, 1.0])
    apart = read(
        model_of([[0, 1, 0], [0, -1j, 0], [0, 0.5, 0], [0, 0.5j, 0]], channels=channels), ["x:y", ("x2", "y2")]
    )
    assert apart.word == "mixed, differs along the shaft"
    assert apart.index == pytest.approx(0.6)


@pytest.mark.parametrize(
    ("other", "words"), [({"unit": "um"}, "one unit"), ({"frame": "rotating"}, "fixed frame"), ({}, "two channels")]
)
def test_pairs_that_cannot_be_are_refused(other, words):
    channels = [Channel(name="x", unit="mm"), Channel(**{"name": "y", "unit": "mm"} | other)]
    with pytest.raises(fq.InputError, match=words):
        read(model_of([[1.0], [1j]], channels=channels), ["x:y" if other else "x"])


def test_whirl_of_a_known_rotor(oracle):
    """A disc with gyroscopic terms and unequal bearings: as the eigenvectors of the constant matrix say."""
    stiffness, damping = np.diag([30.0, 41.0]), np.array([[0.3, 3.0], [-3.0, 0.3]])
    system = oracle.System.second_order([stiffness], [damping])
    model = floquet.modes(system.oracle(), outputs=np.eye(4)[:2], channels=["x", "y"])
    values, vectors = np.linalg.eig(np.block([[np.zeros((2, 2)), np.eye(2)], [-stiffness, -damping]]))
    for one in read_shapes(model, pairs=["x:y"]).modes:
        x, y = vectors[:2, np.abs(values - one.exponent).argmin()]
        assert one.whirl.index == pytest.approx(-2.0 * (x.conj() * y).imag / (abs(x) ** 2 + abs(y) ** 2), rel=1e-8)
        assert one.whirl.std is None
    sides = [one.whirl.word for one in read_shapes(model, pairs=["x:y"]).modes]
    assert sorted(sides) == ["backward", "forward"]


def test_deviations_are_those_of_brute_force(oracle):
    known = oracle.known(oracle.systems["gyroscopic"], oracle.displacements(2), width=1)

    def indices(model):
        return np.array([one.whirl.index for one in read_shapes(model, pairs=["c0:c1"]).modes])

    wanted = np.sqrt(known.variances(indices))
    found = [one.whirl.std for one in read_shapes(known.model, pairs=["c0:c1"]).modes]
    assert found == pytest.approx(wanted, rel=1e-3)


@pytest.mark.slow
def test_whirl_is_within_two_of_its_deviations(oracle):
    """In 95 % of draws, of ellipses and of a circle, whose index has no slope, at errors of 3 %."""
    generator = np.random.default_rng(4)
    known = oracle.known(oracle.systems["gyroscopic"], oracle.displacements(2), hits=2, size=0.03)
    truth = np.array([one.whirl.index for one in read_shapes(known.model, pairs=["c0:c1"]).modes])
    scores = []
    for _ in range(400):
        modes = sorted(read_shapes(known.drawn(generator), pairs=["c0:c1"]).modes, key=lambda one: one.mode)
        scores.append([(one.whirl.index - true) / one.whirl.std for one, true in zip(modes, truth, strict=True)])
    assert np.mean(np.abs(scores) < 2.0) > 0.93


def test_participation(oracle):
    """Shares of the lines of one channel, which sum to one, with deviations by brute force."""
    known = oracle.known(oracle.systems["pairs"], oracle.displacements(2), width=1)

    def shares(model):
        return read_shapes(model, participation="c1").modes[0].participation.shares

    found = read_shapes(known.model, participation="c1").modes[0].participation
    assert found.shares.sum() == pytest.approx(1.0)
    assert found.std == pytest.approx(np.sqrt(known.variances(shares)), rel=1e-3, abs=1e-9)
