"""A tachometer that is a logic level, on a steady shaft: the period is fitted to the response, and that is said."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import floquid
from floquid import ConstantPeriod, Record, identify, load, save
from floquid.pipeline import prepare
from floquid.pipeline.draws._redraw import draw, redrawn
from floquid.pipeline.free import _identify as chain
from floquid.pipeline.free._doubts import wrong_period_fitted
from floquid.systems import JeffcottRotor, Run
from floquid.testing import pair_exponents

ROTOR = JeffcottRotor()


def level(record):
    """The record with the pulses as a logic level."""
    values = np.array(record.values)
    values[-1] = 5.0 * (values[-1] > 2.5)
    return replace(record, values=values)


@cache
def coarse(seed=0, wander=0.0, imbalance=5.0, samples=20.1):
    run = Run(n_periods=80, samples_per_period=samples, wander=wander, imbalance=imbalance, noise=0.01, seed=seed)
    return level(run.record())


@cache
def found(**options):
    return identify(coarse(**options))


def off(analysis):
    """Errors of all exponents and of the period, over their deviations."""
    model = analysis.model
    pairs = pair_exponents(model.exponents, ROTOR.exponents(), ROTOR.period)
    std = model.exponent_std[pairs.permutation]
    errors = [pairs.differences.real / std.real, pairs.differences.imag / std.imag]
    return np.abs([*np.concatenate(errors), (model.period - ROTOR.period) / analysis.period_std])


@pytest.mark.first(1)
@pytest.mark.parametrize("samples", [20.1, 12.37, 33.5, 50.2])
def test_the_modes_are_found_and_no_others(samples):
    analysis = found(samples=samples)
    assert analysis.model.order == 4
    assert analysis.passed
    assert off(analysis).max() < 5.0
    assert not analysis.shafts
    assert "speed_fitted" in {own.code for own in analysis.findings}
    pulses = floquid.sync.shaft_angle(coarse(samples=samples))
    assert analysis.period_std < pulses.period_std


@pytest.mark.slow
def test_deviations_hold_what_the_period_adds():
    """On average over some draws: half of the errors are within 0.67 deviations."""
    errors = np.concatenate([off(found(seed=seed)) for seed in range(3)])
    assert 0.2 < np.median(errors) < 1.2


def test_the_steady_response_tells_a_better_period_than_the_pulses(monkeypatch):
    prepared = prepare(coarse())
    better = chain.with_steady_period(prepared, lambda _: None)
    errors = [abs(own.clocks[0].period / ROTOR.period - 1.0) for own in (prepared, better)]
    assert errors[1] < 1e-6 < errors[0]
    assert better.clocks[0].origin == prepared.clocks[0].origin  # in the middle, where the phase is right
    assert abs(better.clocks[0].origin - 0.5 * prepared.responses[0].duration) < 2.0 * ROTOR.period


@pytest.mark.slow
def test_without_a_steady_response_the_pulses_tell_where_to_start():
    prepared = prepare(coarse(imbalance=0.0))
    assert chain.with_steady_period(prepared, lambda _: None).clocks == prepared.clocks
    analysis = found(imbalance=0.0)
    assert analysis.model.order == 4
    assert off(analysis).max() < 5.0


def test_a_speed_that_wanders_beyond_the_rounding_is_followed():
    prepared = prepare(coarse(wander=0.01))
    assert len(prepared.shafts) == 1
    assert not prepared.shafts[0].coarse
    assert "speed_fitted" not in {own.code for own in prepared.findings}


def test_pulses_with_edges_that_are_sampled_tell_more_and_are_kept():
    run = Run(n_periods=80, samples_per_period=20.1, wander=0.0, imbalance=0.0, pulse_deg=36.0)
    (shaft,) = prepare(run.record()).shafts
    assert shaft.rounded == 0.0


@pytest.mark.slow
def test_shafts_of_several_records_are_kept():
    """Pulses known to a sample do not tell whether all turned equally fast."""
    one = coarse()
    slower = replace(one, sample_rate=one.sample_rate * 0.99, values=1.5 * one.values[:, 5:])
    assert len(prepare([one, slower]).shafts) == 2
    alike = replace(one, values=np.concatenate([1.5 * one.values[:-1, 5:], one.values[-1:, 5:]]))
    assert len(prepare([one, alike]).shafts) == 2


def test_the_revolution_of_the_tachometer_counts():
    """The record's own clock has two periods a revolution, and no option says so."""
    analysis = found(samples=20.1)
    assert analysis.settings.periods_per_revolution == 2.0
    assert analysis.model.point["speed_rpm"] == pytest.approx(30.0 / np.pi * ROTOR.speed, rel=1e-5)
    assert 1 in analysis.forced.harmonics


@pytest.mark.slow
def test_such_a_result_is_loaded_and_drawn_from(tmp_path):
    analysis = found(samples=20.1)
    save(analysis, tmp_path / "result.h5")
    back = load(tmp_path / "result.h5")
    assert back.clocks == analysis.clocks
    assert back.clocks[0].fitted
    one = draw(redrawn(back, whole=True), np.random.SeedSequence(3))
    assert one.failure == ""
    assert one.order == 4
    assert 0.0 < abs(one.period - ROTOR.period) < 6.0 * analysis.period_std


@pytest.mark.slow
def test_a_first_value_may_be_given():
    """As a clock of a record, beside `estimate_period`, which needs none."""
    record = coarse()
    rows = record.select([c.name for c in record.channels if c.name != "tach"])
    near = ConstantPeriod(period=ROTOR.period * (1.0 + 2e-5), origin=0.5 * record.duration, fitted=True)
    analysis = identify(rows.with_clock(near), periods_per_revolution=2)
    assert analysis.model.order == 4
    assert abs(analysis.model.period - ROTOR.period) < 5.0 * analysis.period_std


@pytest.mark.slow
def test_a_level_is_straight_within_its_rounding_alone():
    """Edges are within half a sample of those of a steady shaft, whatever pattern the rounding makes."""
    rng = np.random.default_rng(1)
    for rate, width in zip(rng.uniform(15.0, 120.0, 12), rng.uniform(0.04, 0.5, 12), strict=True):
        times = np.arange(int(100 * rate)) / rate  # a revolution a second
        for wander in (0.0, 3.0 / rate):
            turns = times - 0.3 + wander * np.sin(0.1 * times)
            high = np.mod(turns, 1.0) < width
            values = np.stack([np.cos(times), 5.0 * high])
            record = Record(
                values=values,
                sample_rate=rate,
                channels=["x", "tach"],
                clock=floquid.TachometerSignal(channel="tach"),
            )
            shaft = floquid.sync.shaft_angle(record)
            assert shaft.rounded > 0.0
            assert shaft.coarse == (wander == 0.0)
            if shaft.coarse:
                error = shaft.angle(times) / (2.0 * np.pi) - times
                assert np.std(error) < 0.1 / rate


def test_a_period_that_pulses_speak_against_is_refused(monkeypatch):
    """Something else near a line of the revolution may draw the period away: here a first value that is off."""
    prepared = prepare(coarse())
    off = 1.0 + 4.0 / prepared.responses[0].n_samples
    monkeypatch.setattr(chain, "steady_period", lambda _, clocks, *__, **___: clocks[0].period * off)
    assert chain.with_steady_period(prepared, lambda _: None) is prepared
    fit = found(samples=20.1).fit
    assert wrong_period_fitted(fit, None, prepared) is None
    model = replace(fit.model, period=fit.model.period * off, estimates=None, unselected=None)
    wrong = wrong_period_fitted(replace(fit, model=model), None, prepared)
    assert "does not repeat with the period given" in str(wrong)
    vague = replace(fit, model=model, period_std=fit.model.period)  # such a response says nothing against the pulses
    assert wrong_period_fitted(vague, None, prepared) is None


def test_draws_of_the_modes_alone_hold_a_period_that_the_steady_response_told():
    analysis = found(samples=20.1)
    for whole in (False, True):
        plan = redrawn(analysis, whole=whole)
        assert plan.free_period == whole
        assert plan.period_std == (analysis.period_std if whole else None)
    one = draw(redrawn(analysis, whole=False), np.random.SeedSequence(3))
    assert one.failure == ""
    assert one.period == pytest.approx(analysis.model.period, rel=1e-12)
    std = analysis.model.exponent_std
    assert (np.abs((one.exponents - analysis.model.exponents).real) < 5.0 * std.real).all()
    assert (np.abs((one.exponents - analysis.model.exponents).imag) < 5.0 * std.imag).all()
