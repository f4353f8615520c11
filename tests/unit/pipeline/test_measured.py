"""`identify` for records as they really come: clocks, wrong periods, impacts, and what is said of them."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

from floquid import ConstantPeriod, IdentificationError, InputError, Record, identify
from floquid.lifting import lift
from floquid.periodic import Synchrony, fit
from floquid.pipeline import Settings, prepare
from floquid.pipeline.free import _doubts
from floquid.plot import FIGURES, save_figures
from floquid.sync import resample, shaft_angle
from floquid.systems import JeffcottRotor, Run

ROTOR = JeffcottRotor()


def off(model, true):
    """Errors of the exponents over their deviations, modulo i times the rotor's own ω (modes, 2), upper half."""
    found = []
    for value, std in zip(model.exponents, model.exponent_std, strict=True):
        gap = np.asarray(true) - value
        gap = gap.real + 1j * (gap.imag - np.rint(gap.imag))
        gap = gap[np.argmin(np.abs(gap))]
        if value.imag > 0:
            found.append([gap.real / std.real, gap.imag / std.imag])
    return np.array(found)


@cache
def record_of_run():
    return Run(n_periods=150, seed=2).record()


@cache
def of_run():
    return identify(record_of_run())


@pytest.mark.slow
def test_a_rig_with_a_tachometer_a_wander_and_an_imbalance():
    analysis = of_run()
    assert analysis.model.order == 4
    assert np.abs(off(analysis.model, ROTOR.exponents())).max() < 5.0
    assert set(analysis.fit.forced.harmonics) >= {1}
    assert analysis.shafts[0].wander == pytest.approx(0.002, rel=0.3)
    assert analysis.model.channels == ROTOR.channels
    said = " ".join(analysis.synchronisation)
    assert "the shaft angle is measured" in said
    assert "1 a revolution" in said


@pytest.mark.slow
def test_its_figures_have_the_speed(tmp_path, monkeypatch):
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", lambda self, target, **_: target.write_bytes(b""))
    written = [path.stem for path in save_figures(of_run(), tmp_path)]
    assert written == [name for name in FIGURES if name not in ("system_elements", "transfer", "harmonic_spectra")]


@pytest.mark.slow
def test_resampling_everything_to_angle_would_not_do():
    """The mutant that a fit in time and angle is there for: equal angles taken for equal times bend the exponential."""
    record = Run(n_periods=200, wander=0.006, imbalance=0.0, seed=2).record()
    shaft = shaft_angle(record)
    record = record.select(["X", "Y", "X_tt", "Y_tt"])
    right = fit([record], [shaft], order=4).model
    (cut,) = resample(record, shaft, n_phases=16)
    values = cut.values.transpose(0, 2, 1).reshape(4, -1)
    bent = Record(values=values, sample_rate=16.0 / shaft.period, channels=record.channels)
    wrong = fit([bent], [ConstantPeriod(period=shaft.period)], order=4).model
    assert np.abs(off(right, ROTOR.exponents())).max() < 5.0
    assert np.abs(off(wrong, ROTOR.exponents())).max() > 10.0


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_a_rounded_sampling_interval_is_refused_with_its_cause(seed):
    """Allen 2009, section 3: 2π/50 printed as 0.126."""
    right = ROTOR.simulate(n_periods=300, seed=seed)
    wrong = Record(
        values=right.values, sample_rate=1.0 / 0.126, channels=right.channels, clock=ConstantPeriod(period=2.0 * np.pi)
    )
    with pytest.raises(IdentificationError, match=r"50 samples exactly.*rounded(.|\n)*rate=7\.9577"):
        identify(wrong)
    assert identify(right).model.order == 4


@pytest.mark.slow
@pytest.mark.parametrize("share", [1.01, 1.0025, 1.05])
def test_any_other_wrong_period_is_refused(share):
    record = ROTOR.simulate(n_periods=40, samples_per_period=8, seed=1)
    with pytest.raises(IdentificationError) as refused:
        identify(record, period=2.0 * np.pi * share)
    assert_its_own_is_told(str(refused.value))


def assert_its_own_is_told(words):
    """The period of the rotor, 2π, within what is said of it."""
    said = re.search(r"does not repeat with the period given: its own is (\S+) ± (\S+) s", words)
    assert said, words
    own, std = map(float, said.groups())
    assert abs(own - 2.0 * np.pi) < 4.0 * std
    assert std < 0.01 * own


def steady(n_periods, *, samples=16.37, share=1.0, seed=0, imbalance=0.0):
    """Responses out of step on a shaft that turns evenly, declared with `share` of the period."""
    run = Run(n_periods=n_periods, wander=0.0, imbalance=imbalance, samples_per_period=samples, seed=seed)
    return (
        run.record()
        .select([channel.name for channel in ROTOR.channels])
        .with_clock(ConstantPeriod(period=2.0 * np.pi * share))
    )


@pytest.mark.slow
def test_a_period_that_tears_modes_by_as_much_as_they_decay_is_refused():
    """Harmonics that are left in a band, others on their own, none of them sure enough to be a sign by itself."""
    with pytest.raises(IdentificationError) as refused:
        identify(steady(200, share=1.002))
    assert_its_own_is_told(str(refused.value))


@cache
def drifting():
    """A fit with a period 3e-4 off, six deviations and more, the free response lifted, and the records."""
    record = steady(200, share=1.0003)
    found = fit([record], [record.clock], forced="none")
    assert found.own_period[0] < -6.0 * found.own_period[1]
    return found, lift(resample(found.free, [record.clock])), prepare(record)


def vague(_):
    """An estimate from the response alone that would let any period near 2π pass."""
    return 6.284, 0.01


@pytest.mark.parametrize("torn", [None, Synchrony(relative=1e-6, std=1e-5, slip=0.01)])
def test_harmonics_that_turn_are_not_overruled(monkeypatch, torn):
    monkeypatch.setattr(_doubts, "_period_alone", vague)
    monkeypatch.setattr(_doubts, "spacing", lambda *_: torn)
    said = str(_doubts.wrong_period_fitted(*drifting()))
    assert "does not repeat" in said
    assert float(said.split("its own is ")[1].split(" ", maxsplit=1)[0]) == pytest.approx(2.0 * np.pi, abs=1e-3)


@pytest.mark.parametrize("own", [None, (0.0, 1e-5), (3e-4, 1e-3), (1e-9, 1e-11)])
def test_what_no_deviation_or_no_sample_shows_says_nothing(monkeypatch, own):
    monkeypatch.setattr(_doubts, "spacing", lambda *_: None)
    monkeypatch.setattr(_doubts, "_period_alone", vague)
    found, lifted, prepared = drifting()
    assert _doubts.wrong_period_fitted(replace(found, own_period=own), lifted, prepared) is None


@pytest.mark.parametrize(("own", "refused"), [((1e-5, 1e-4), False), (None, True), ((0.01, 0.1), True)])
def test_equal_decays_do_not_outweigh_harmonics_that_turn_as_given(monkeypatch, own, refused):
    """An isotropic rotor with like dampers has many modes of one decay, and of those some a whole distance apart."""
    found, lifted, prepared = drifting()
    monkeypatch.setattr(_doubts, "spacing", lambda *_: Synchrony(relative=0.18, std=2e-4, slip=230.0))
    said = _doubts.wrong_period_fitted(replace(found, own_period=own), lifted, prepared)
    assert (said is not None) == refused


def test_a_step_that_no_fit_can_tell_is_overruled(monkeypatch):
    """A turn of many radians: modes that are none make it. The response alone decides."""
    found, lifted, prepared = drifting()
    monkeypatch.setattr(_doubts, "spacing", lambda *_: None)
    monkeypatch.setattr(_doubts, "_period_alone", vague)
    many = replace(found, own_period=(1.2, 0.03))
    assert _doubts.wrong_period_fitted(many, lifted, prepared) is None
    monkeypatch.setattr(_doubts, "_period_alone", lambda _: None)
    assert _doubts.wrong_period_fitted(many, lifted, prepared) is None
    monkeypatch.setattr(_doubts, "_period_alone", lambda _: (6.4, 0.01))
    assert "its own is 6.4 " in str(_doubts.wrong_period_fitted(many, lifted, prepared))


@pytest.mark.slow
def test_an_imbalance_that_is_left_in_is_named():
    """Half a revolution a period: the revolution is a multiplier of -1."""
    record = steady(60, imbalance=5.0)
    analysis = identify(record, forced="none", validate=False)
    assert any("multiplier of -1 neither grows nor decays" in warning for warning in analysis.warnings)
    beside = identify(record, periods_per_revolution=2, validate=False)
    assert beside.model.order == 4
    assert not any("neither grows" in warning for warning in beside.warnings)


@pytest.mark.slow
def test_an_angle_too_rough_for_its_imbalance_is_named():
    """Pulses of one and a half samples: what the errors of the angle leave of the imbalance looks like a mode."""
    rough = identify(Run(n_periods=100, samples_per_period=16.37, seed=3).record())
    assert any("gives the shaft angle to ±0.2" in warning for warning in rough.warnings)
    fine = identify(Run(n_periods=100, samples_per_period=16.37, pulse_deg=60.0, seed=3).record())
    assert fine.model.order == 4
    assert not any("angle of the shaft" in warning for warning in (*fine.warnings, *of_run().warnings))


@pytest.mark.slow
def test_a_tachometer_without_slopes_says_where_to_start():
    """High or low and nothing between: each pulse is known to a sample, and the response tells the period."""
    fine = Run(n_periods=80, samples_per_period=25.1, imbalance=5.0, pulse_deg=36.0).record()
    values = np.concatenate([fine.values[:-1], [5.0 * (fine.values[-1] > 2.5)]])
    level = identify(replace(fine, values=values), validate=False)
    assert "speed_fitted" in {own.code for own in level.findings}
    measured = identify(fine, validate=False)
    # A wander within a sample makes a mode beside the line of the imbalance.
    assert any("beside a harmonic of the revolution" in warning for warning in level.warnings)
    assert not any("beside a harmonic of the revolution" in warning for warning in measured.warnings)
    assert level.model.period == pytest.approx(measured.model.period, rel=2e-4)
    assert not any("angle of the shaft" in warning for warning in measured.warnings)


def test_the_period_is_found():
    record = ROTOR.simulate(n_periods=100, samples_per_period=8, seed=3)
    analysis = identify(replace(record, clock=None), estimate_period=True, validate=False)
    assert abs(analysis.model.period - 2.0 * np.pi) < 4.0 * analysis.fit.period_std
    assert analysis.fit.period_std < 1e-3
    assert np.abs(off(analysis.model, ROTOR.exponents())).max() < 5.0


@pytest.mark.slow
def test_a_first_value_says_which_multiple_of_the_period_is_meant():
    record = replace(ROTOR.simulate(n_periods=60, samples_per_period=16, seed=3), clock=None)
    near, twice = (identify(record, estimate_period=True, period=value).model for value in (5.0, 11.0))
    assert near.period == pytest.approx(2.0 * np.pi, rel=1e-3)
    assert twice.period == pytest.approx(4.0 * np.pi, rel=1e-3)
    with pytest.raises(InputError, match=r"must be shorter than the record \(376\.991 s\), but is 600 s"):
        identify(record, estimate_period=True, period=600.0)
    with pytest.raises(InputError, match="Argument `period` of `identify` must be two sampling intervals or more"):
        identify(record, estimate_period=True, period=0.01)


def test_a_constant_system_does_not_tell_a_period():
    times = np.arange(2000) / 20.0
    values = np.exp(-0.05 * times) * np.cos(3.1 * times) + np.exp(-0.07 * times) * np.cos(5.2 * times)
    values = values + 0.01 * np.random.default_rng(0).standard_normal((2, 2000))
    record = Record(values=values, sample_rate=20.0, channels=["a", "b"])
    with pytest.raises(IdentificationError, match="does not tell its period"):
        identify(record, estimate_period=True)
    words = r"does not tell its period between 1\.33333 and 3 s(.|\n)*another first value"
    with pytest.raises(IdentificationError, match=words):
        identify(record, estimate_period=True, period=2.0)


def test_impacts_are_several_hits():
    still = {"n_periods": 200, "samples_per_period": 16, "noise": 0.0}
    one, other = (ROTOR.simulate(impulse_deg=angle, **still) for angle in (45.0, 130.0))
    values = np.array(one.values)
    later = 50 * 16
    values[:, later:] += other.values[:, : values.shape[1] - later]
    values += 0.01 * np.random.default_rng(0).standard_normal(values.shape)
    analysis = identify(replace(one, values=values), find_hits=True, validate=False)
    assert "impact" in analysis.synchronisation[0]
    assert np.abs(off(analysis.model, ROTOR.exponents())).max() < 5.0


@pytest.mark.slow
def test_clipped_channels_and_missing_samples_are_reported():
    record = ROTOR.simulate(n_periods=60)
    values = np.array(record.values)
    values[0] = np.clip(values[0], -0.6, 0.6)
    values[1, 100:130] = np.nan
    analysis = identify(replace(record, values=values), order=4, trust_period=True)
    assert any("'X' is clipped at -0.6 and 0.6" in warning for warning in analysis.warnings)
    assert any("'Y' misses 30 samples" in sentence for sentence in analysis.synchronisation)
    assert not any("clipped" in warning for warning in identify(record).warnings)


def test_the_first_periods_can_be_left_out():
    record = ROTOR.simulate(n_periods=200, samples_per_period=16)
    analysis = identify(record, skip=10.0, validate=False)
    assert analysis.cycles[0].n_cycles == 190
    assert np.abs(off(analysis.model, ROTOR.exponents())).max() < 5.0
    with pytest.raises(InputError, match="Skip less"):
        identify(record, skip=200.0)


def test_a_run_up_is_refused():
    with pytest.raises(IdentificationError, match="not constant enough"):
        identify(Run(n_periods=400, samples_per_period=16.37, wander=0.1, imbalance=0.0).record())


def test_a_steady_run_is_the_simulation():
    run = Run(n_periods=100, samples_per_period=50.0, wander=0.0, imbalance=0.0, start_deg=0.0)
    free, _ = run.responses()
    whole = ROTOR.simulate(n_periods=100, noise=0.0).values
    assert_allclose(free, whole[:, : free.shape[1]], atol=1e-8)


def test_the_response_to_the_imbalance_is_periodic():
    run = Run(n_periods=20, samples_per_period=40.0, wander=0.0)
    _, forced = run.responses()
    assert_allclose(forced[:, 80:], forced[:, :-80], atol=1e-6)
    assert np.abs(forced[0]).max() == pytest.approx(5.0 * np.abs(run.responses()[0][0]).max())


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"tach": "tach", "period": 1.0}, "beside another clock"),
        ({"azimuth": "a", "estimate_period": True}, "beside another clock"),
        ({"forced": "all"}, "harmonics of the revolution"),
        ({"forced": (1.5,)}, "harmonics of the revolution"),
        ({"skip": -1.0}, "not be negative"),
        ({"periods_per_revolution": 1.5}, "whole number"),
        ({"pulses_per_revolution": 0}, "at least 1"),
    ],
)
def test_settings_that_are_refused(options, words):
    with pytest.raises(InputError, match=words):
        Settings(**options)


def test_a_channel_that_is_not_there():
    with pytest.raises(InputError, match="tacho"):
        identify(record_of_run(), tach="tacho")


def test_an_orbit_of_another_shape_is_refused():
    with pytest.raises(InputError, match="orbit"):
        Record(values=np.ones((2, 9)), sample_rate=1.0, channels=["a", "b"], orbit=np.ones((3, 4)))
