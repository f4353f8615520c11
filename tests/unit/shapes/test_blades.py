"""Patterns over blades: isotropic rotors against Coleman's coordinates, all patterns of two to six blades, refusals."""

from dataclasses import replace

import numpy as np
import pytest
from tests.blades import FIXED, OMEGA, coleman, modelled, rotor

import floquid as fq
from floquid.core import Channel, PeriodicModel
from floquid.shapes import read_shapes


@pytest.fixture(scope="module")
def isotropic():
    return modelled(rotor(*coleman()))


def shares_by_coleman():
    """Frequency, and the share of each pattern, of each mode by eigenvectors of the constant system."""
    stiffness, damping = coleman()
    n = len(stiffness)
    values, vectors = np.linalg.eig(np.block([[np.zeros((n, n)), np.eye(n)], [-stiffness, -damping]]))
    found = {}
    for value, vector in zip(values, vectors.T, strict=True):
        if value.imag > 0:
            shares = {}
            for group, first in (("flap", 0), ("edge", 3)):
                a0, ac, as_ = vector[first : first + 3]
                for wave, beta in ((0, a0), (1, 0.5 * (ac - 1j * as_)), (-1, 0.5 * (ac + 1j * as_))):
                    shares[group, wave] = 3.0 * abs(beta) ** 2
            shares |= {(name, None): abs(vector[row]) ** 2 for row, name in enumerate(FIXED, start=6)}
            total = sum(shares.values())
            found[value.imag] = {key: share / total for key, share in shares.items()}
    return found


def test_an_isotropic_rotor_is_as_coleman_has_it(isotropic):
    """Frequencies in the fixed frame and shares of all patterns as the constant system has them; no leak."""
    readings = read_shapes(isotropic, fixed=FIXED).modes
    wanted = shares_by_coleman()
    assert [one.frequency for one in readings] == pytest.approx(sorted(wanted), rel=1e-9)
    for one, frequency in zip(readings, sorted(wanted), strict=True):
        assert one.blades.leak < 1e-10
        shares = {(pattern.family, pattern.wave): pattern.share for pattern in one.blades.shares}
        assert shares == pytest.approx(wanted[frequency], abs=1e-7)
        assert one.blades.leak_std is None
    names = [one.name for one in readings]
    assert "1st flap backward" in names
    assert "1st flap forward" in names
    assert "1st edge forward" in names
    assert "1st fa" in names
    assert readings[names.index("1st flap backward")].frequency == pytest.approx(2.9 - OMEGA, abs=0.1)


def test_coordinates_of_the_rotor_are_those_of_the_constant_system(isotropic):
    stiffness, damping = coleman()
    values, vectors = np.linalg.eig(np.block([[np.zeros((10, 10)), np.eye(10)], [-stiffness, -damping]]))
    for one in read_shapes(isotropic, fixed=FIXED).modes:
        own = vectors[:, np.abs(values.imag - one.frequency).argmin()]
        whole = np.array([part for group in ("flap", "edge") for part in one.blades.coordinates(group).values()])
        whole = whole if one.exponent.imag + one.blades.branch * OMEGA > 0 else whole.conj()
        assert abs(np.vdot(whole, own[:6])) == pytest.approx(np.linalg.norm(whole) * np.linalg.norm(own[:6]), rel=1e-9)


def test_blades_in_reverse_order_turn_the_other_way(isotropic):
    ahead = {one.mode: one for one in read_shapes(isotropic).modes}
    back = {"flap": ["flap3", "flap2", "flap1"], "edge": ["edge3", "edge2", "edge1"]}
    for one in read_shapes(isotropic, blades=back).modes:
        first, other = ahead[one.mode].blades.shares[0], one.blades.shares[0]
        assert (first.family, first.wave) == (other.family, -other.wave)
        assert first.share == pytest.approx(other.share)


def test_angles_put_blades_in_order(isotropic):
    """Members given as they stand by their angles: reversed, the reading is reversed too."""
    angles = [0.5, 0.5 - 2.0 * np.pi / 3, 0.5 - 4.0 * np.pi / 3]
    channels = [replace(channel, angle=angles[(channel.member or 1) - 1]) for channel in isotropic.channels]
    turned = replace(isotropic, channels=channels)
    ahead = {one.mode: one for one in read_shapes(isotropic).modes}
    for one in read_shapes(turned).modes:
        assert ahead[one.mode].blades.shares[0].wave == -one.blades.shares[0].wave
    channels[1] = replace(channels[1], angle=0.1)
    with pytest.raises(fq.InputError, match="evenly spaced"):
        read_shapes(replace(isotropic, channels=channels))


def test_a_soft_blade_leaks():
    readings = read_shapes(modelled(rotor(*coleman(), soft=0.1 * 2.9**2)), fixed=FIXED).modes
    assert max(one.blades.leak for one in readings) > 0.05
    assert any(one.name.startswith("mixed: ") for one in readings)


def test_words_of_other_programs(isotropic):
    for words, backward, collective in (("openfast", "regressive", "collective"), ("hawc", "BW", "SYM")):
        names = [one.name for one in read_shapes(isotropic, fixed=FIXED, words=words).modes]
        assert f"1st flap {backward}" in names
        assert f"1st flap {collective}" in names


def single_pattern(count, wave, frequency=2.1, harmonic=0):
    """A model of one pattern: n over `count` blades, at Im λ + m Ω on them."""
    lines = np.zeros((2, count, 1, 9), complex)
    lines[0, :, 0, 4 + harmonic] = np.exp(2j * np.pi * wave * np.arange(count) / count)
    lines[1] = lines[0, ..., ::-1].conj()
    exponent = -0.1 + 1j * (frequency - harmonic * OMEGA)
    return PeriodicModel(
        exponents=[exponent, exponent.conjugate()],
        coefficients=lines,
        harmonics=np.arange(-4, 5),
        period=2.0 * np.pi / OMEGA,
        channels=[f"flap{j}" for j in range(1, count + 1)],
    )


@pytest.mark.parametrize("count", [2, 3, 4, 5, 6])
def test_all_patterns_are_named(count):
    """Whatever the branch; reactionless patterns by their frequency on the blades, others in the fixed frame."""
    for wave in range(-((count - 1) // 2), count // 2 + 1):
        for harmonic in (-2, 0, 1):
            frequency = 2.1 + 2.0 * OMEGA  # on the blades; above zero in the fixed frame for all patterns
            frequency += OMEGA
            one = read_shapes(single_pattern(count, wave, frequency, harmonic)).modes[0]
            side = f"{'backward' if wave > 0 else 'forward'}{f' {abs(wave)}' if abs(wave) > 1 else ''}"
            word = "collective" if wave == 0 else side
            if 2 * wave == count:
                word = "differential" if count == 2 else "reactionless"
            assert one.name == f"1st flap {word}"
            on_blades = 2 * wave == count
            assert one.frequency == pytest.approx(frequency if on_blades else frequency - wave * OMEGA)
            assert one.blades.leak < 1e-12


def test_a_line_of_negative_frequency_turns_the_name_round():
    one = read_shapes(single_pattern(3, 1, frequency=0.4)).modes[0]
    assert (one.name, one.frequency) == ("1st flap forward", pytest.approx(OMEGA - 0.4))


def test_a_locked_mode_is_read_from_one_of_its_halves():
    """A real multiplier: its shape is real, so each pattern is there with its mirror image."""
    lines = np.zeros((1, 3, 1, 5), complex)
    wave = np.exp(2j * np.pi * np.arange(3) / 3)
    lines[0, :, 0, 4], lines[0, :, 0, 0] = wave, wave.conj()
    model = PeriodicModel(
        exponents=[-0.1],
        coefficients=lines,
        harmonics=np.arange(-2, 3),
        period=1.0,
        channels=["flap1", "flap2", "flap3"],
    )
    one = read_shapes(model).modes[0]
    assert one.name == "1st flap backward"
    assert one.frequency == pytest.approx(2.0 * np.pi)
    assert one.blades.leak < 1e-12


def test_groups_of_unlike_units_are_named_each_for_itself(isotropic):
    units = [replace(channel, unit="rad" if channel.group == "edge" else "m") for channel in isotropic.channels]
    model = replace(isotropic, channels=units)
    readings = read_shapes(model)
    assert "unit" in readings.warnings[0]
    assert all(";" in one.name for one in readings.modes)
    scaled = read_shapes(model, fixed=["fa"], scales={"edge": 1.0})
    assert scaled.warnings == ()
    wanted = {one.mode: one.name for one in read_shapes(isotropic, fixed=["fa"]).modes}
    assert {one.mode: one.name for one in scaled.modes} == wanted
    heavy = read_shapes(isotropic, fixed=["fa"], scales={"fa": 1e3})
    assert sum(one.name.endswith("fa") for one in heavy.modes) == 2  # the flap that it is coupled with, too


def test_half_a_revolution_is_refused_by_the_speed(isotropic):
    """Blades have changed places then; a speed that is no part of the period's is that of a generator."""
    rpm = 30.0 * OMEGA / np.pi
    for speed in (rpm, 1.01 * rpm, 97.0 * rpm):
        assert read_shapes(replace(isotropic, point={"speed_rpm": speed})).modes
    for part in (2, 3):
        with pytest.raises(fq.InputError, match=f"periods_per_revolution.*is {part}"):
            read_shapes(replace(isotropic, point={"speed_rpm": rpm / part}))


REFUSED = {
    "two blades": {"blades": ["flap=flap1"]},
    "one unit": {"blades": ["flap=flap1,flap2,flap3"]},
    "turn with": {"blades": ["flap=flap1,YawBrTAxp"]},
    "groups": {"blades": ["flap=flap1,flap2"], "scales": {"edge": 2.0}},
    "periods_per_revolution": {"blades": ["flap=flap1,flap2"], "periods_per_revolution": 2.0},
    "words": {"blades": ["flap=flap1,flap2"], "words": "latin"},
    "be given": {"blades": []},
}


@pytest.mark.parametrize("words", REFUSED)
def test_what_cannot_be_read_is_refused(words):
    model = single_pattern(4, 0)
    names = ["flap1", "flap2", "flap3", "YawBrTAxp"]
    channels = [Channel(name=name, unit="rad" if name == "flap3" else "m") for name in names]
    if words == "be given":
        channels = ["a", "b", "c", "d"]
    with pytest.raises(fq.InputError, match=words):
        read_shapes(replace(model, channels=channels), **REFUSED[words])
