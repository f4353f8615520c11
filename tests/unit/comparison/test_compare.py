"""Two sets of modes against one another: what is convention does not matter, and χ² is that of the deviations."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.stats import kstest
from tests.locks import HALF, known

import floquid as fq
from floquid import floquet
from floquid.core import Channel, PeriodicModel
from floquid.errors import InputError
from floquid.surveys import Point
from floquid.systems import JeffcottRotor

NOISE = {"std": 0.002, "shape_std": 0.01}
OUTSIDE, LOCKED = 17.0, 20.3
"""Speeds at which mode 1 is a pair, and two real multipliers."""


def correlated(model, count):
    """The model with a covariance in which all parts of the first `count` modes are correlated; conjugates follow."""
    generator = np.random.default_rng(3)
    root = generator.standard_normal((2 * count, 2 * count)) * NOISE["std"]
    root[count:][model.real[:count]] = 0.0
    pairs = [k for k in range(count) if not model.real[k]]
    of = np.concatenate([np.arange(count), pairs])
    sign = np.concatenate([np.ones(count), -np.ones(len(pairs))])
    order = model.order
    to = np.zeros((2 * order, 2 * count))
    to[np.arange(order), of], to[np.arange(order, 2 * order), of + count] = 1.0, sign
    return replace(model, covariance=to @ root @ root.T @ to.T)


def differences(found):
    return sorted((pair.a, pair.difference.real, np.nan_to_num(pair.difference.imag)) for pair in found.pairs)


@pytest.mark.parametrize("speed", [OUTSIDE, LOCKED])
@pytest.mark.parametrize("branch", [(1, -2, 3, 0), (-5, 5, -1, 4)])
def test_branches_and_their_order_do_not_matter(speed, branch):
    count = 4 if speed == OUTSIDE else 5
    first = known(speed, seed=1, **NOISE)
    plain = fq.compare(first, correlated(known(speed, seed=2, **NOISE), count))
    moved = correlated(known(speed, seed=2, branch=branch, **NOISE), count)
    back = np.arange(moved.order)[::-1]
    both = np.concatenate([back, back + moved.order])
    turned = PeriodicModel(
        exponents=moved.exponents[back], coefficients=moved.coefficients[back], harmonics=moved.harmonics,
        period=moved.period, channels=moved.channels, covariance=moved.covariance[np.ix_(both, both)],
        coefficient_std=moved.coefficient_std[back],
    )  # fmt: skip
    other = fq.compare(first, turned)
    assert len(plain.pairs) == count
    assert np.allclose(differences(plain), differences(other), atol=1e-9)
    assert other.chi2 == pytest.approx(plain.chi2)
    assert other.dof == plain.dof == 8
    assert [pair.mac for pair in other.pairs] == pytest.approx([pair.mac for pair in plain.pairs])


@pytest.mark.parametrize("speed", [OUTSIDE, LOCKED])
@pytest.mark.parametrize("turn", [0.1, 0.37, 0.8])
def test_the_instant_at_which_a_record_begins_does_not_matter(speed, turn):
    """Before: a mode was missing on both sides, and a similarity of one fell to 0.3."""
    first = known(speed, seed=1, **NOISE)
    plain, later = (fq.compare(first, known(speed, seed=2, turn=own, **NOISE)) for own in (0.0, turn))
    assert not later.missing_in_a
    assert not later.missing_in_b
    assert np.allclose(differences(plain), differences(later), atol=1e-9)
    assert [pair.mac for pair in later.pairs] == pytest.approx([pair.mac for pair in plain.pairs], abs=1e-6)
    assert (later.points[0].turn - plain.points[0].turn) % 1.0 == pytest.approx(turn, abs=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("speed", [OUTSIDE, LOCKED])
def test_chi_square_is_that_of_the_deviations(speed):
    """With the true model, and with each other: p is uniform."""
    draws = [known(speed, seed=seed, **NOISE) for seed in range(40)]
    truth = known(speed)
    alone = [fq.compare(one, truth) for one in draws]
    both = [fq.compare(one, other) for one, other in zip(draws[::2], draws[1::2], strict=True)]
    for found in (alone, both):
        assert {len(one.missing_in_a) + len(one.missing_in_b) for one in found} == {0}
        assert kstest([one.p for one in found], "uniform").pvalue > 0.01
    assert np.mean([one.chi2 for one in alone]) == pytest.approx(8.0, abs=4.0 * 4.0 / np.sqrt(40.0))


def test_a_pair_beside_two_real_multipliers_has_no_kink():
    """Either side of the edge of a lock: the mean and the squared half-difference, near on both sides."""
    edge = 20.0 - 2.0 * HALF
    inside, outside = known(edge + 1e-4, seed=1, **NOISE), known(edge - 1e-4, **NOISE)
    assert inside.couples
    (mixed,) = [pair for pair in fq.compare(inside, outside).pairs if np.isnan(pair.difference.imag)]
    assert mixed.z < 4.0
    near = replace(known(edge + 1e-9), covariance=known(edge + 1e-9, **NOISE).covariance)
    (least,) = [pair for pair in fq.compare(near, known(edge - 5e-6)).pairs if np.isnan(pair.difference.imag)]
    assert least.z < 2.0  # both are alike within the deviations, though no slope of √q says so
    far = fq.compare(known(edge + 0.3, seed=1, **NOISE), outside)
    assert max(pair.z for pair in far.pairs) > 10.0
    (back,) = [pair for pair in fq.compare(outside, inside).pairs if np.isnan(pair.difference.imag)]
    assert back.z == pytest.approx(mixed.z)


@pytest.mark.parametrize("speed", [OUTSIDE, LOCKED])
def test_modes_that_one_side_alone_has(speed):
    whole, less = known(speed, seed=1, **NOISE), known(speed, seed=2, without=(3,), **NOISE)
    found = fq.compare(whole, less)
    (lost,) = found.missing_in_b
    assert lost == (0, 3)
    assert not found.missing_in_a
    assert fq.compare(less, whole).missing_in_a == (lost,)
    assert "Missing in b: mode 4 of a, f = " in found.summary()


def test_modes_that_are_not_alike_are_no_pair():
    found = fq.compare(known(OUTSIDE, without=(3,), **NOISE), known(OUTSIDE, without=(2,)))
    assert (len(found.pairs), found.missing_in_a, found.missing_in_b) == (3 - 1, ((0, 2),), ((0, 2),))


def test_one_of_two_real_multipliers_below_the_noise():
    whole, less = known(LOCKED, seed=1, **NOISE), known(LOCKED, seed=2, without=(1,), **NOISE)
    found = fq.compare(whole, less)
    assert found.missing_in_b == ((0, 1),)
    assert found.dof == 7


def test_what_differs_is_told():
    found = fq.compare(known(OUTSIDE, seed=1, **NOISE), known(OUTSIDE + 0.1))
    assert found.p < 1e-10
    assert "more than the deviations explain, most in mode " in found.summary()


def test_known_systems_have_no_deviations():
    found = fq.compare(known(OUTSIDE), known(OUTSIDE + 0.05))
    assert (found.chi2, found.dof, found.p) == (None, 0, None)
    assert np.isnan(found.pairs[0].z)
    assert "No χ²: neither side has deviations." in found.summary()


def test_weak_modes_and_results_that_fail_are_shown_and_not_counted():
    model, truth = known(OUTSIDE, seed=1, **NOISE), known(OUTSIDE)
    weak = np.zeros(model.order, bool)
    weak[0] = True
    point = Point(values={}, model=model, passed=True, weak=weak)
    found = fq.compare(point, truth)
    assert [pair.counted for pair in found.pairs] == [False, True, True, True]
    assert found.dof == 6
    fails = fq.compare(Point(values={}, model=model, reason="It is not explained. Try again."), truth)
    assert fails.chi2 is None
    assert "the model fails. It is not explained." in fails.warnings[0]


def test_surveys_are_paired_by_the_operating_point():
    speeds = np.arange(17.0, 18.1, 0.25)
    survey = fq.survey(
        [Point(values={"speed": v}, model=known(v, seed=k, **NOISE)) for k, v in enumerate(speeds)], over="speed"
    )
    found = fq.compare(survey, known)
    assert (len(found.points), len(found.pairs), found.dof) == (5, 20, 40)
    assert found.p > 1e-3
    half = fq.survey([Point(values={"speed": v}, model=known(v)) for v in speeds[::2]], over="speed")
    assert [point.value for point in fq.compare(survey, half).points] == speeds[::2].tolist()
    one = Point(values={"speed": 17.5}, model=known(17.5))
    assert [point.value for point in fq.compare(survey, one).points] == [17.5]
    near = fq.compare(survey, Point(values={"speed": 17.6}, model=known(17.6)))
    assert [point.value for point in near.points] == [17.5]
    assert near.warnings[0] == "Points are paired whose speed differs by up to 0.57 %."
    with pytest.raises(InputError, match=r"have a value of speed that a has, but .* is at 17, 17.25"):
        fq.compare(survey, Point(values={"speed": 18.5}, model=known(18.5)))


def test_scales_take_channels_to_one_unit():
    model = known(OUTSIDE, seed=1, **NOISE)
    by = np.array([1000.0, 1.0, 1.0, 1.0])[:, None, None]
    channels = (Channel(name="a", unit="mm"), *model.channels[1:])
    other = replace(
        model, coefficients=model.coefficients * by, coefficient_std=model.coefficient_std * by, channels=channels
    )
    metres = replace(model, channels=(Channel(name="a", unit="m"), *model.channels[1:]))
    with pytest.raises(InputError, match=r"has 'a' in mm, and a in m\.\n.*scale="):
        fq.compare(metres, other)
    found = fq.compare(metres, other, scale={"a": 1e-3})
    assert [pair.mac for pair in found.pairs] == pytest.approx([1.0] * 4)
    with pytest.raises(InputError, match="name channels of b, but has 'e'"):
        fq.compare(metres, other, scale={"e": 1e-3})


def test_without_common_channels_exponents_pair_modes():
    other = replace(known(OUTSIDE), channels=("e", "f", "g", "h"))
    found = fq.compare(known(OUTSIDE, seed=1, **NOISE), other)
    assert len(found.pairs) == 4
    assert np.isnan(found.pairs[0].mac)
    assert found.p > 1e-3
    assert "by exponents alone" in found.warnings[0]


def test_systems_and_files(tmp_path):
    rotor = JeffcottRotor(support_y=2.1)
    times = rotor.period * np.arange(64) / 64
    matrices = {"A": np.moveaxis(rotor.system(times), 0, -1), "period": rotor.period, "states": list("XYuv")}
    np.savez(tmp_path / "states.npz", **matrices)
    outputs = np.moveaxis(rotor.outputs(times), 0, -1)
    names = [channel.name for channel in rotor.channels]
    np.savez(tmp_path / "outputs.npz", **matrices, C=outputs, outputs=names)
    np.savez(tmp_path / "constant.npz", **matrices, C=np.eye(2, 4), outputs=["X", "Y"])
    for file, channels in (("states.npz", 2), ("outputs.npz", 4), ("constant.npz", 2)):
        found = fq.compare(tmp_path / file, "systems:jeffcott,support_y=2.1")
        assert len(set(found.points[0].model_a.channels) & set(found.points[0].model_b.channels)) <= channels
        assert max(abs(pair.difference) for pair in found.pairs) < 1e-9
        assert min(pair.mac for pair in found.pairs) > 1.0 - 1e-9
    matrix = floquet.FunctionMatrix(function=rotor.system, period=rotor.period, vectorised=True)
    assert len(fq.compare(matrix, rotor).pairs) == 2
    turned = floquet.modes(floquet.FunctionMatrix(function=JeffcottRotor(speed=0.6).system, period=np.pi / 0.6))
    assert len(fq.compare(turned, "systems:jeffcott").pairs) == 2  # at the speed of the other side


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (3, "`b` of `compare` must be a result, a survey, modes, a known system"),
        ("none.npz", "`b` of `compare` must be the path of a file that can be read"),
        ("systems:laval", "must name an example system .jeffcott., but is 'systems:laval'"),
        ("systems:jeffcott,mass=3", "must set numbers of jeffcott .rotor_x, .*, but is"),
        (JeffcottRotor(speed=0.6), "have the period of a, but has 5.23599 s, and a 6.28319 s"),
        (known, "be one system beside one result, but is a function"),
        (".", "must hold a result, a survey or .lin files"),
    ],
)
def test_what_is_refused(other, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=message):
        fq.compare(JeffcottRotor(speed=0.5), other)


def test_a_file_without_a_period_is_refused(tmp_path):
    np.savez(tmp_path / "a.npz", A=np.zeros((2, 2, 4)))
    with pytest.raises(InputError, match=r"state the period of A\(t\), but .*a\.npz does not"):
        fq.compare(JeffcottRotor(), tmp_path / "a.npz")


def test_the_same_record_gives_no_chi_square():
    record = JeffcottRotor(damping=0.02).simulate(n_periods=40, samples_per_period=8, noise=0.01)
    found = [fq.identify(record, channels=names, validate=False) for names in (["X", "Y"], ["X", "X_tt"])]
    same = fq.compare(*found)
    assert same.chi2 is None
    assert not same.independent
    assert "No χ²: both sides are identified from one record" in same.summary()
    assert "p = " in fq.compare(found[0], "systems:jeffcott,damping=0.02").summary()


def test_the_same_record_in_a_survey_gives_no_chi_square(tmp_path):
    """Before: χ² 0 and p 1, as if the deviations explained that there was no difference."""
    record = replace(JeffcottRotor(damping=0.02).simulate(n_periods=20, noise=0.01), point={"load": 1.0})
    values = record.values.copy()
    values[:, 100:102] = np.nan  # of channels with a gap there was no mark
    found = fq.identify(replace(record, values=values), channels=["X", "Y"], validate=False)
    other = Point(values={"load": 2.0}, model=found.model)
    survey = fq.survey([found, other], over="load")
    fq.save(survey, tmp_path / "survey.h5")
    for side in (survey, tmp_path / "survey.h5"):
        same = fq.compare(found, side)
        assert (same.chi2, same.independent) == (None, False)
        assert "No χ²: both sides are identified from one record" in same.summary()
    assert fq.compare(other, survey).independent


@pytest.mark.parametrize("speed", [OUTSIDE, LOCKED])
def test_the_figure(speed):
    found = fq.compare(known(speed, seed=1, **NOISE), known(speed))
    figure = found.plot.comparison()
    assert isinstance(figure, Figure)
    assert len(figure.axes) == 2 + len(found.pairs)


def test_a_kept_comparison_is_no_side(tmp_path):
    fq.save(fq.compare(known(OUTSIDE), known(OUTSIDE)), tmp_path / "kept.h5")
    with pytest.raises(
        InputError, match=r"`b` of `compare` must be what `floquid identify`.*something else .Comparison"
    ):
        fq.compare(known(OUTSIDE), tmp_path / "kept.h5")


@pytest.mark.pages
def test_page(tmp_path):
    less = [Point(values={"v": v}, model=known(v, without=(3,) if v == 17.5 else ())) for v in (17.0, 17.5, 18.0)]
    survey = fq.survey([Point(values={"v": v}, model=known(v, seed=4, **NOISE)) for v in (17.0, 17.5, 18.0)], over="v")
    found = fq.compare(survey, fq.survey(less, over="v"))
    text = fq.report(found, tmp_path / "comparison.html").read_text(encoding="utf-8")
    assert "Missing in b: mode 4 of a at v = 17.5" in text
    assert f"11 pairs of modes at 3 points; χ² = {found.chi2:.4g}" in text
    assert all(f'id="{name}"' in text for name in ("strip", "similarity", "differences"))
    plain = fq.report(fq.compare(known(17.0), known(17.0)), tmp_path / "plain.html").read_text(encoding="utf-8")
    assert "No χ²: neither side has deviations." in plain
