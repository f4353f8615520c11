"""What figures show, as numbers: against sums written out, against the truth, and against records made wrong."""

import subprocess
import sys
from dataclasses import fields, replace

import numpy as np
import pytest
from benchmarks.paper._residues import expansion, identified_residue
from scipy.interpolate import CubicSpline
from tests.decays import half_a_turn, one_locked, two_hits, with_decay
from tests.driven import Driven

from floquid import views
from floquid.core import Channel, ConstantPeriod, Estimates, PeriodicModel, Record
from floquid.errors import InputError
from floquid.lti import fit_residues
from floquid.order import scan
from floquid.periodic import assemble, physical_exponents
from floquid.pipeline import identify
from floquid.reconstruction import StateModel
from floquid.reporting._page import modes_of
from floquid.store import load, save
from floquid.systems import JeffcottRotor, Run

ROTOR = JeffcottRotor(damping=0.02)
OMEGA = 2.0 * np.pi / ROTOR.period
P = 20


@pytest.fixture(scope="module")
def found():
    return two_hits()


def pair(*, period=1.0, wander=0.0, seed=3):
    """A conjugate pair with three harmonics in two channels, in periods of 1 s as the clock has it."""
    times = np.arange(4800) / 24.0
    theta = 2.0 * np.pi * times / period + wander * np.sin(2.0 * np.pi * times / 200.0)
    carrier = (-0.01 + 2j * np.pi * 0.31) * times
    rows = [
        sum(size * np.exp(carrier + 1j * m * theta + 1j * phase) for m, size, phase in own)
        for own in (((-1, 0.3, 0.4), (0, 1.0, 0.0), (1, 0.2, 1.0)), ((-1, 0.1, 2.0), (0, 0.4, 1.5), (1, 0.3, 0.3)))
    ]
    values = np.real(rows) + 0.01 * np.random.default_rng(seed).standard_normal((2, len(times)))
    return Record(values=values, sample_rate=24.0, channels=["a", "b"], clock=ConstantPeriod(period=1.0))


@pytest.fixture(scope="module")
def locked():
    return one_locked()


# Families.


def test_a_family_has_the_lines_of_a_mode_and_their_shares(found):
    families = views.families(found)
    assert [family.mode for family in families] == [0, 2]
    model = found.model
    for family in families:
        weighted = np.abs(model.coefficients[family.mode]) ** 2 / found.noise[:, :, None] ** 2
        whole = weighted.sum(axis=(0, 1))
        kept = whole > 0
        assert family.harmonics.tolist() == model.harmonics[kept].tolist()
        assert family.omega == pytest.approx(np.abs(model.exponents[family.mode].imag + OMEGA * model.harmonics[kept]))
        assert family.share == pytest.approx(whole[kept] / whole.sum())
        assert family.share.sum() == pytest.approx(1.0)
        assert family.harmonics[np.argmax(family.share)] == 0  # the branch reported


def test_of_a_real_multiplier_a_line_is_one_line(locked):
    (family,) = views.families(locked)
    assert family.omega == pytest.approx(2.0 * np.pi * np.array([0.5, 1.5, 2.5]))
    sizes = np.array([1.0, 0.4, 0.2]) ** 2
    assert family.share == pytest.approx(sizes / sizes.sum(), abs=0.005)


@pytest.mark.slow
def test_shares_do_not_depend_on_units(found):
    records = [replace(r, values=r.values * np.array([[1e-6], [1.0], [1e3], [1.0]])) for r in found.records]
    for one, other in zip(views.families(found), views.families(identify(records, validate=False)), strict=True):
        assert other.share == pytest.approx(one.share, rel=1e-3)


# Regions.


def test_an_ellipse_holds_its_share_of_draws():
    covariance = np.array([[2.0, 1.2], [1.2, 1.0]]) * 1e-6
    rng = np.random.default_rng(0)
    draws = rng.multivariate_normal([0.3, -2.0], covariance, size=20_000)
    inverse = np.linalg.inv(covariance)
    for level in (0.5, 0.95):
        edge = views.ellipse(0.3 - 2.0j, covariance, level)
        off = np.stack([edge.real - 0.3, edge.imag + 2.0])
        radius = np.einsum("ik,ij,jk->k", off, inverse, off)
        assert radius == pytest.approx(np.full(73, radius[0]))
        away = draws - [0.3, -2.0]
        inside = np.mean(np.einsum("ki,ij,kj->k", away, inverse, away) < radius[0])
        assert inside == pytest.approx(level, abs=4.0 * np.sqrt(level * (1 - level) / 20_000))
        assert edge[0] == pytest.approx(edge[-1])


def test_two_rows_that_are_one_locked_mode_are_told(locked):
    """Mathieu's equation, damped, inside its first lock; of one real multiplier alone nothing is told."""
    system = Driven(
        A=lambda t: np.array([[0.0, 1.0], [-1.02 - 0.16 * np.cos(2.0 * t), -0.1]]),
        B=lambda _: np.array([[0.0], [1.0]]),
        C=lambda _: np.array([[1.0, 0.0]]),
        period=np.pi,
    )
    values = system.response(np.zeros((1, 720)), 24, np.array([1.0, 0.3]))
    values += 0.002 * values.std() * np.random.default_rng(1).standard_normal(values.shape)
    record = Record(values=values, sample_rate=24.0 / np.pi, channels=["x"], clock=ConstantPeriod(period=np.pi))
    analysis = identify(record, validate=False)
    assert analysis.model.multipliers.real == pytest.approx([-0.9653, -0.7567], abs=2e-3)
    told = "rows 1 and 2: shapes alike, as of one mode locked to the period"
    assert told in " ".join(analysis.summary().split())
    assert told in modes_of(analysis)["meanings"]
    assert "locked to the period" not in locked.summary()


def test_a_part_without_error_gives_a_line(locked):
    edge = views.exponent_ellipses(locked.model)[0]
    std = locked.model.exponent_std[0]
    assert edge.imag == pytest.approx(np.full(73, locked.model.exponents[0].imag), abs=1e-15)
    reach = 1.959964 * std.real  # one degree of freedom
    assert np.ptp(edge.real) == pytest.approx(2.0 * reach, rel=2e-3)
    wide = views.multiplier_ellipses(locked.model)[0]
    assert np.ptp(wide.real) == pytest.approx(2.0 * reach * abs(locked.model.multipliers[0]), rel=2e-3)


def test_regions_are_as_wide_as_the_deviations_say(found):
    factor = np.sqrt(-2.0 * np.log(0.05))
    for edges, centre, std in (
        (views.exponent_ellipses(found.model), found.model.exponents, found.model.exponent_std),
        (views.multiplier_ellipses(found.model), found.model.multipliers, found.model.multiplier_std),
    ):
        off = edges - centre[:, None]
        assert np.abs(off.real).max(axis=1) == pytest.approx(factor * std.real, rel=3e-3)
        assert np.abs(off.imag).max(axis=1) == pytest.approx(factor * std.imag, rel=3e-3)
    bare = replace(found.model, covariance=None)
    assert views.exponent_ellipses(bare) is None
    assert views.multiplier_ellipses(bare) is None


def test_the_region_of_a_multiplier_has_the_period_in_it(found):
    """Against the region with the period known, and the slope of μ = e^{λT} by T."""
    own = found.model.estimates
    covariance = np.array(own.covariance)
    spread = 1e-3  # of ω, far above what the exponents have
    covariance[2 * len(own.exponents), 2 * len(own.exponents)] += (spread * own.fundamental) ** 2
    fields = {name: getattr(own, name) for name in Estimates.__dataclass_fields__}
    model = replace(found.model, estimates=Estimates(**{**fields, "covariance": covariance}))
    edges = views.multiplier_ellipses(model)
    slope = model.multipliers * model.exponents * model.period * spread
    off = edges - model.multipliers[:, None]
    factor = np.sqrt(-2.0 * np.log(0.05))
    assert np.abs(off).max(axis=1) == pytest.approx(factor * np.abs(slope), rel=0.02)
    longest = off[np.arange(len(off)), np.argmax(np.abs(off), axis=1)]
    turned = np.abs(np.sin(np.angle(longest / slope)))
    assert (turned < 0.1).all()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((0j, np.eye(3)), "`covariance` of `ellipse` must have shape"),
        ((0j, -np.eye(2)), "`covariance` of `ellipse` must have no negative variance"),
        ((0j, np.eye(2), 1.0), "`level` of `ellipse` must lie between 0 and 1"),
    ],
)
def test_no_ellipse(arguments, words):
    with pytest.raises(InputError, match=words):
        views.ellipse(*arguments)


# Shapes and coefficients.


def test_shapes_are_the_models_own(found):
    curves = views.shape_curves(found.model, 2, 1, points=13)
    times = np.linspace(0.0, 1.0, 13) * ROTOR.period
    assert curves.turns == pytest.approx(np.linspace(0.0, 1.0, 13))
    assert curves.values == pytest.approx(found.model.shapes(times)[2, :, 1])
    assert curves.std == pytest.approx(found.model.shape_std(times)[2, :, 1])
    assert curves.values[:, 0] == pytest.approx(curves.values[:, -1])
    assert views.shape_curves(replace(found.model, estimates=None), 0).std is None


def test_coefficients_of_a_fit_have_their_floor():
    """A record fitted as it was sampled: what the model leaves out lies at the deviation."""
    record = pair()
    values = np.array(record.values)
    values[:, 700:703] = np.nan
    analysis = identify(replace(record, values=values), validate=False)
    assert "Fitted at the original sampling times: samples are missing." in analysis.synchronisation
    seen = expansion(analysis, 0, 0)
    assert seen.harmonics[seen.kept].tolist() == [-1, 0, 1]
    own = analysis.model.coefficients[0, 0, 0]
    assert np.abs(seen.values[seen.kept] - own) == pytest.approx(0.0, abs=6.0 * np.nanmax(seen.std))
    left = (seen.magnitudes / seen.std)[~seen.kept & np.isfinite(seen.std)]
    assert 0.4 < np.sqrt(np.mean(left**2)) < 1.6


# Synthesis.


def test_synthesis_is_the_models_response_at_the_samples(found):
    """The second hit begins before the first one's phase: what leads in is left out, on the record's own time axis."""
    for hit, (channel, lead) in enumerate(((1, 0), (2, 3))):
        record = found.records[hit]
        seen = views.synthesis(found, channel, hit)
        used = slice(lead, lead + found.cycles[hit].n_cycles * P)
        assert seen.times == pytest.approx(record.times[used])
        assert np.array_equal(seen.measured, record.values[channel, used])
        begin = record.times[lead] - found.cycles[hit].first_phase * ROTOR.period
        expected = found.model.response(seen.times - begin)[channel, hit]
        assert seen.predicted == pytest.approx(expected, abs=1e-9)
        assert seen.residual == pytest.approx(seen.measured - expected, abs=1e-9)
        assert seen.residual.std() == pytest.approx(seen.noise, rel=0.06)
        assert seen.noise == pytest.approx(found.noise[channel, hit])


@pytest.fixture(scope="module")
def odd():
    """Samples are missing: fitted as sampled, and resampled, from later periods on."""
    record = pair()
    values = np.array(record.values)
    values[0, 100:104] = np.nan
    values[:, 40:43] = np.nan
    record = replace(record, values=values, sample_rate=24.3, start=7.0, clock=ConstantPeriod(period=24.0 / 24.3))
    return identify(record, validate=False)


def test_synthesis_of_a_record_fitted_as_sampled(odd):
    assert "Fitted at the original sampling times: samples are missing." in odd.synchronisation
    seen = views.synthesis(odd, 0)
    record = odd.fit.free[0]
    assert seen.times == pytest.approx(record.times)
    assert np.array_equal(np.isnan(seen.measured), np.isnan(odd.records[0].values[0]))
    assert np.isnan(seen.predicted[[41, 102]]).all()
    assert np.isnan(seen.residual).sum() == 7
    phase = odd.records[0].clock.phase(7.0)
    expected = odd.model.response(seen.times - 7.0 + phase * odd.model.period)[0, 0]
    there = np.isfinite(seen.predicted)
    assert seen.predicted[there] == pytest.approx(expected[there], abs=1e-9)
    assert np.nanstd(seen.residual) == pytest.approx(seen.noise, rel=0.05)


@pytest.fixture(scope="module")
def rig():
    """A tachometer, and a speed that wanders."""
    return identify(Run(n_periods=60, seed=2).record(), validate=False)


@pytest.mark.first(1)
@pytest.mark.parametrize("name", ["odd", "rig"])
def test_a_result_that_was_read_shows_the_same(name, request, tmp_path):
    """Samples missing, a begin at any time, the angle of a shaft: the file has the record as it was measured."""
    analysis = request.getfixturevalue(name)
    save(analysis, tmp_path / "result.h5")
    again = load(tmp_path / "result.h5")
    for show in (lambda a: views.synthesis(a, 1), views.synchronisation):
        one, other = show(analysis), show(again)
        for field in fields(one):
            np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name), err_msg=field.name)
    for one, other in zip(views.lifted_points(analysis, 1), views.lifted_points(again, 1), strict=True):
        np.testing.assert_array_equal(one, other)
    times = np.linspace(-5.0, 150.0, 50)
    for shaft, other in zip(analysis.shafts, again.shafts, strict=True):
        assert np.array_equal(shaft.angle(times), other.angle(times))
        assert np.array_equal(shaft.speed_std(times), other.speed_std(times))


def test_points_of_lifted_responses_are_where_the_record_is(found, odd, rig):
    for analysis in (found, odd, rig):
        seen, (times, values) = views.synthesis(analysis, 1), views.lifted_points(analysis, 1)
        assert len(times) == analysis.cycles[0].n_cycles
        whole = np.interp(times, seen.times, np.arange(len(seen.times)))
        if np.abs(whole - np.rint(whole)).max() < 1e-6 and analysis is found:
            assert np.array_equal(values, seen.measured[np.rint(whole).astype(int)])
        there = np.isfinite(seen.predicted)
        expected = CubicSpline(seen.times[there], seen.predicted[there])(times)
        assert np.sqrt(np.mean((values - expected) ** 2)) < 1.5 * seen.noise
        assert np.abs(values).max() > 10.0 * seen.noise


def test_residues_of_a_record_that_begins_later_are_the_models(odd):
    """The cycles resampled begin whole periods after the model's phase zero; a wrong count turns the residues."""
    mode = views.families(odd)[0].mode
    residue = identified_residue(odd, mode, 0)
    shape = odd.model.shapes(odd.lifted.phase_times)[mode, 0, 0]
    assert np.abs(residue - shape).max() < 0.02 * np.abs(shape).max()
    assert odd.cycles[0].first_cycle > 0


@pytest.mark.slow
def test_points_of_lifted_responses_begin_at_the_first_phase():
    """A record that begins in the middle of a period, beside a forced response."""
    record = ROTOR.simulate(n_periods=80, samples_per_period=P, noise=0.01, seed=1, first_phase=0.25)
    record = replace(record, values=record.values[:, 1:] + 0.3)
    found = identify(record, validate=False)
    assert found.fit.forced.offset.any()
    seen, (times, values) = views.synthesis(found, 1), views.lifted_points(found, 1)
    assert times == pytest.approx(seen.times[::P])
    assert np.array_equal(values, seen.measured[::P])


# Branches.


def test_poles_of_a_scan_lie_on_their_branches(found):
    seen = scan(found.lifted.responses, orders=[4, 6, 8])
    for model, exponents in zip(seen.models, views.unfolded(seen, found), strict=True):
        assert len(exponents) == model.order
        assert np.exp(exponents * ROTOR.period) == pytest.approx(model.multipliers)
        for own in found.model.exponents:
            assert np.abs(exponents - own).min() < 0.02 * OMEGA
    folded = np.abs(np.angle(seen.models[0].multipliers)) / ROTOR.period
    assert np.abs(np.sort(folded) - np.sort(np.abs(found.model.exponents.imag))).max() > 0.2 * OMEGA


def test_physical_exponents_are_those_that_assemble_reports(found):
    modal = fit_residues(found.modal.multipliers, found.lifted.responses)
    mine = physical_exponents(modal, found.lifted)
    theirs = assemble(modal, found.lifted, harmonics=2).exponents
    assert np.abs(np.subtract.outer(mine, theirs)).min(axis=1) == pytest.approx(0.0, abs=1e-12)
    assert mine.imag.sum() == pytest.approx(0.0, abs=1e-12)
    with pytest.raises(InputError, match="`modal` of `physical_exponents`"):
        physical_exponents(replace(modal, residues=modal.residues[:, :5], residual_std=None), found.lifted)


def test_a_scan_of_something_else_is_refused(found, locked):
    seen = scan(locked.lifted.responses, orders=[1, 2])
    with pytest.raises(InputError, match="`scan` of `unfolded` must be one of the analysis"):
        views.unfolded(seen, found)
    with pytest.raises(InputError, match="`scan` of `unfolded` must be an OrderScan"):
        views.unfolded(3, found)


# Synchronisation.


def test_a_record_that_keeps_step_has_no_slip(found, locked):
    for analysis, hits in ((found, 2), (locked, 1)):
        for hit in range(hits):
            seen = views.synchronisation(analysis, hit)
            assert seen.told.sum() >= 3
            assert abs(seen.relative) < 4.0 * seen.relative_std
            score = (seen.slip / seen.slip_std)[seen.told]
            assert np.sqrt(np.mean(score**2)) < 2.0
            assert seen.misfit < 4.0


@pytest.mark.slow
def test_slips_scatter_as_their_deviations_say():
    """Twelve stretches of ten records: the mean square of slip over deviation is that of 120 normal numbers."""
    scores = [
        (seen.slip / seen.slip_std)[seen.told]
        for seen in (views.synchronisation(identify(half_a_turn(seed=seed), validate=False)) for seed in range(10))
    ]
    every = np.concatenate(scores)
    assert len(every) == 120
    # Less what the model has taken up; the band is that of chi-square at one in a thousand on either side.
    assert 0.55 < np.mean(every**2) < 1.5


@pytest.mark.first(2)
@pytest.mark.parametrize(("make", "off"), [(pair, -1e-4), (half_a_turn, 2e-5), (pair, 2e-5)])
def test_a_wrong_period_is_a_slope(make, off):
    """The own period is (1 + off) s; the record was cut at 1 s."""
    analysis = identify(make(period=1.0 + off), order=2 if make is pair else 1, trust_period=True, validate=False)
    seen = views.synchronisation(analysis)
    assert seen.relative == pytest.approx(off, abs=4.0 * seen.relative_std + 0.02 * abs(off))
    assert abs(seen.relative) > 4.0 * seen.relative_std


@pytest.mark.slow
def test_a_wandering_speed_is_a_curve():
    straight = views.synchronisation(identify(pair(), order=2, trust_period=True, validate=False))
    wanders = views.synchronisation(identify(pair(wander=0.05), order=2, trust_period=True, validate=False))
    assert straight.misfit < 3.0
    assert wanders.misfit > 10.0
    # The slip is the sine that was put in, up to what a straight line and the model take up.
    times, weight = wanders.times, 1.0 / wanders.slip_std
    given = 0.05 * np.sin(2.0 * np.pi * times / 200.0)
    left = [weight * (v - np.polyval(np.polyfit(times, v, 1, w=weight), times)) for v in (wanders.slip, given)]
    assert left[0] @ left[1] / np.sqrt((left[0] @ left[0]) * (left[1] @ left[1])) > 0.97


def test_phases_of_lines_turn_with_their_harmonic():
    seen = views.synchronisation(identify(pair(period=1.0 + 1e-4), order=2, trust_period=True, validate=False))
    slopes = {
        int(m): np.polyfit(seen.times, phase, 1, w=1.0 / std)[0]
        for m, phase, std in zip(seen.harmonics, seen.phases, seen.phases_std, strict=True)
    }
    assert slopes[1] - slopes[0] == pytest.approx(-2.0 * np.pi * 1e-4, rel=0.1)
    assert slopes[0] - slopes[-1] == pytest.approx(-2.0 * np.pi * 1e-4, rel=0.1)


def test_an_exponent_that_is_off_is_no_slip():
    """All lines of the mode turn together then, by up to 0.3 rad over the record."""
    analysis = identify(pair(), validate=False)
    model = analysis.model
    moved = model.exponents + 1j * np.sign(model.exponents.imag) * 0.3 / 200.0
    bare = replace(model, exponents=moved, covariance=None, coefficient_std=None, estimates=None, unselected=None)
    seen = views.synchronisation(replace(analysis, model=bare))
    score = (seen.slip / seen.slip_std)[seen.told]
    assert np.sqrt(np.mean(score**2)) < 2.0
    strongest = seen.phases[seen.harmonics.tolist().index(0)]
    assert np.ptp(strongest) > 0.2


def test_one_harmonic_does_not_tell():
    times = np.arange(4800) / 24.0
    values = np.exp(-0.01 * times) * np.cos(2.0 * np.pi * 0.31 * times)
    values = values + 0.01 * np.random.default_rng(0).standard_normal(len(times))
    record = Record(values=values[None], sample_rate=24.0, channels=["a"], clock=ConstantPeriod(period=1.0))
    seen = views.synchronisation(identify(record, validate=False))
    assert not seen.told.any()
    assert np.isnan([seen.relative, seen.relative_std, seen.misfit]).all()
    assert len(seen.harmonics) == 1
    assert np.isfinite(seen.phases).any()


# All.


def test_nothing_writable_is_handed_out(found):
    for thing in (
        views.families(found)[0],
        expansion(found, 0, 0),
        views.synthesis(found, 0),
        views.synchronisation(found),
        views.record_spectrum(found, 0),
        views.shape_curves(found.model, 0),
    ):
        for name in type(thing).__slots__:
            value = getattr(thing, name)
            assert not isinstance(value, np.ndarray) or not value.flags.writeable, name


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda a: views.families(3), "`analysis` of `families` must be an Analysis"),
        (lambda a: views.synthesis(a, 4), "`channel` of `synthesis` must be less than 4"),
        (lambda a: views.synthesis(a, 0, 2), "`hit` of `synthesis` must be less than 2"),
        (lambda a: views.lifted_points(a, 4), "`channel` of `lifted_points` must be less than 4"),
        (lambda a: expansion(a, 4, 0), "`mode` of"),
        (lambda a: views.lifted_spectrum(a, 0, 20), "`phase` of `lifted_spectrum` must be less than 20"),
        (lambda a: views.record_spectrum(a, -1), "`channel` of `record_spectrum`"),
        (lambda a: views.shape_curves(a.model, 4), "`mode` of `shape_curves` must be less than 4"),
        (lambda a: views.shape_curves(a.model, 0, points=1), "`points` of `shape_curves`"),
        (lambda a: views.synchronisation(a, 2), "`hit` of `synchronisation` must be less than 2"),
    ],
)
def test_what_is_not_there_is_refused(found, call, words):
    with pytest.raises(InputError, match=words):
        call(found)


def test_modes_of_a_pair_are_one(found, locked):
    assert found.model.upper_modes == (0, 2)
    assert locked.model.upper_modes == (0,)
    order = [1, 0, 3, 2]
    turned = PeriodicModel(
        exponents=found.model.exponents[order],
        coefficients=found.model.coefficients[order],
        harmonics=found.model.harmonics,
        period=found.model.period,
        channels=found.model.channels,
    )
    assert turned.upper_modes == (1, 3)


def test_growth_is_told_from_its_deviation(found):
    deviation = found.model.exponent_std[0].real
    bare = replace(found.model, estimates=None, unselected=None)
    slight = replace(bare, exponents=bare.exponents + 3.0 * deviation - bare.exponents[0].real)
    assert not views.grows(slight, 0)
    assert views.grows(replace(slight, covariance=None), 0)
    assert views.grows(replace(slight, exponents=slight.exponents + 2.0 * deviation), 0)


def test_a_long_name_keeps_both_ends():
    assert views.shortened("abcdefghij", 10) == "abcdefghij"
    assert views.shortened("abcdefghij", 7) == "abc…hij"
    assert views.shortened("abcdefghij", 6) == "abc…ij"
    assert views.shortened("ab", 1) == "…"


def test_two_modes_of_one_multiplier_have_a_residue_each(found):
    """Pairs of modes, one of which is the other moved by ω."""
    upper = found.model.exponents[0]
    lam = np.array([upper, upper.conj(), upper + 1j * OMEGA, upper.conj() - 1j * OMEGA])
    mu = np.exp(lam * found.model.period)
    bare = replace(found.model, exponents=lam, estimates=None, unselected=None)
    modal = replace(found.modal, multipliers=np.where(found.modal.multipliers.imag > 0, mu[0], mu[1]))
    twice = with_decay(replace(found, model=bare), modal=modal)
    one, other = (np.abs(identified_residue(twice, mode, 0)) for mode in (0, 2))
    assert not np.allclose(one, other)


def test_deviations_of_shapes_of_some_modes_are_those_of_all(found):
    times = np.linspace(0.0, 1.0, 5)
    assert np.array_equal(found.model.shape_std(times, [3, 0]), found.model.shape_std(times)[[3, 0]])


def test_a_gap_is_no_extreme():
    x, y = np.arange(1000.0), np.sin(np.arange(1000.0))
    y[300:350] = np.nan
    y[355] = 7.0  # in a stretch that is half missing
    thin_x, thin_y = views.envelope(x, y, 100)
    assert np.nanmax(thin_y) == 7.0
    assert np.isnan(thin_y).any()
    assert np.isfinite(thin_y).sum() > 80
    assert len(thin_x) <= 100


@pytest.mark.slow
def test_no_plotting_library_is_loaded():
    code = "import sys, floquid.views; assert not {'matplotlib', 'bokeh', 'jinja2'} & set(sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr


def test_units_of_the_elements_of_channels_as_they_are():
    """In first-order form no state is a derivative of another: the halves of their list mean nothing."""
    channels = [Channel(name="x", unit="m"), Channel(name="tilt", unit="rad"), Channel(name="vx", unit="m/s")]
    names = [*(channel.name for channel in channels), "unknown"]
    zeros = np.zeros((3, 4, 4))
    state = StateModel(
        times=np.arange(3) / 3, transition=zeros, system=zeros, condition=np.ones(3), states=tuple(names)
    )
    assert views.element_unit(state, 0, 0, channels) == "1/s"
    assert views.element_unit(state, 0, 1, channels) == "m/rad · 1/s"
    assert views.element_unit(state, 2, 0, channels) == "(m/s)/m · 1/s"
    assert views.element_unit(state, 3, 0, channels) == "1/s"
    delayed = replace(state, states=("x", "x(t + 1.768 s)", "tilt(t + 1.768 s)", "vx"))
    assert views.element_unit(delayed, 1, 0, channels) == "1/s"
    assert views.element_unit(delayed, 2, 0, channels) == "rad/m · 1/s"
