"""Modes fitted to lines that were measured, against the equations and against the fit of the samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.driven import flapping, lag, mathieu, pulls, record_of, shaken, two_masses

from floquid import Channel, IdentificationError, InputError, Record, fit_transfer, identify, measure_transfer
from floquid.findings import Severity
from floquid.inputs import InputMode, Limits, TransferFunctions
from floquid.transfer import MeasuredTransfer, Modal
from floquid.transfer._modal import Lines, eliminated
from floquid.transfer._search import _with_real_ones

HARMONICS = np.arange(-3, 4)


def lines(system, phases, turns, repeats, noise, seed, drop=1, **design) -> MeasuredTransfer:
    _, record, names = shaken(system, phases, turns, repeats, noise, seed, **design)
    return measure_transfer(record, inputs=names, harmonics=HARMONICS, drop=drop)


def of_equations(system, hertz, noise=1e-3, harmonics=HARMONICS, seed=0) -> TransferFunctions:
    """G of continuous time as others may have measured it, with noise of a share of its largest value."""
    truth = system.transfer(hertz, harmonics)
    std = noise * np.abs(truth).max() * np.ones(truth.shape)
    generator = np.random.default_rng(seed)
    off = std * generator.standard_normal(truth.shape) + 1j * std * generator.standard_normal(truth.shape)
    return TransferFunctions(
        frequencies_hz=hertz,
        harmonics=harmonics,
        values=truth + off,
        std=std * (1.0 + 1.0j),
        outputs=tuple(Channel(name=f"y{n}") for n in range(truth.shape[1])),
        inputs=tuple(Channel(name=f"F{n}") for n in range(truth.shape[2])),
    )


@pytest.mark.slow
def test_modes_of_lines_that_were_measured():
    system = mathieu()
    measured = lines(system, 20, 64, 5, 0.02, 3)
    found = fit_transfer(measured)
    assert found.model.order == 2
    assert pulls(system, found.model).max() < 4.0
    assert 0.7 < found.chi_square / found.degrees < 1.3
    own, truth = found.transfer(sampled=True), system.sampled_transfer(measured.transfer.frequencies_hz, HARMONICS, 20)
    error, before = own.values - truth, measured.transfer.values - truth
    assert np.linalg.norm(error) < 0.4 * np.linalg.norm(before)
    assert np.mean(np.abs(error) ** 2 / np.abs(own.std) ** 2) < 3.0
    # Of continuous time, at frequencies between the lines.
    hertz = np.linspace(0.1, 0.5, 9)
    other, exact = found.transfer(hertz, [-1, 0, 1]), system.transfer(hertz, [-1, 0, 1])
    assert np.abs(other.values - exact).max() < 0.02 * np.abs(exact).max()
    assert np.mean(np.abs(other.values - exact) ** 2 / np.abs(other.std) ** 2) < 4.0
    assert not found.warnings
    # The hold forgotten is seen in the direct term or in what is left.
    held = fit_transfer(measured, hold="none")
    assert np.abs(held.transfer(hertz, [0]).values - exact[1:2]).max() > 0.02 * np.abs(exact).max()


@pytest.mark.slow
def test_deviations_hold_and_the_fit_is_five_times_as_near_as_the_lines():
    system, off, errors = mathieu(), [], []
    for seed in range(20):
        measured = lines(system, 20, 128, 5, 0.05, seed, spare=0.0)
        found = fit_transfer(measured)
        truth = system.sampled_transfer(measured.transfer.frequencies_hz, HARMONICS, 20)
        both = (measured.transfer.values, found.transfer(sampled=True).values)
        errors.append([np.mean(np.abs(one - truth) ** 2) for one in both])
        off.append(pulls(system, found.model)[0])
    assert 0.75 < np.sqrt(np.mean(np.square(off))) < 1.25
    before, after = np.sqrt(np.mean(errors, axis=0))
    assert before > 5.0 * after


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 3])
def test_six_lines_have_their_mode_and_its_harmonics(seed):
    system = mathieu()
    lines = of_equations(system, np.linspace(0.08, 0.42, 6), harmonics=np.arange(-1, 2), seed=seed)
    fit = fit_transfer(lines, period=system.period)
    assert fit.model.order == 2
    assert fit.chi_square < 2.0 * fit.degrees
    assert pulls(system, fit.model).max() < 4.0


@pytest.mark.slow
def test_two_modes_two_inputs_of_lines_measured_by_others():
    system = two_masses()
    given = of_equations(system, np.linspace(0.05, 0.6, 60))
    found = fit_transfer(given, period=system.period)
    assert found.model.order == 4
    assert pulls(system, found.model).max() < 4.5
    assert 0.8 < found.chi_square / found.degrees < 1.25
    with pytest.raises(InputError, match="sampled"):
        found.transfer(sampled=True)


@pytest.mark.slow
def test_a_real_multiplier_is_one():
    system = lag()
    given = of_equations(system, np.linspace(0.02, 0.4, 20), harmonics=np.arange(-1, 2))
    found = fit_transfer(given, period=np.pi, limits=Limits(modes=1))
    assert found.model.real.tolist() == [True]
    assert pulls(system, found.model)[0, 0] < 4.0
    assert not found.warnings


def a_lag(exponent, held=None):
    """Lines of two outputs, and a real mode of some exponent."""
    one = of_equations(lag(), np.linspace(0.02, 0.4, 12), harmonics=np.arange(-1, 2))
    both = (np.concatenate([own, 0.5 * own[:, :, :, ::-1].conj()], axis=1) for own in (one.values, one.std))
    values, std = both
    lines = Lines(
        omega=2.0 * np.pi * one.frequencies_hz,
        harmonics=one.harmonics,
        values=values,
        std=np.abs(std.real) + 1j * np.abs(std.imag),
        fundamental=2.0,
        held=held,
        echoes=(np.zeros((0, 1, 12), complex), np.zeros(0)),
    )
    turns = np.arange(2.0)
    gains = np.array([[1.0, 0.3 + 0.1j]])
    mode = InputMode(
        exponent=exponent + 0j,
        real=True,
        reach=turns,
        gains=gains,
        turns=turns,
        initial=np.zeros(0, complex),
        sizes=np.ones(1),
    )
    return lines, Modal((mode,), (np.zeros((2, 2), complex),), (np.zeros((2, 1), complex),))


def test_an_exponent_that_overflows_explains_nothing():
    """A step of a fit may go that far; it is taken back, and does not end the search."""
    with np.errstate(over="ignore", invalid="ignore"):
        off = eliminated(*a_lag(1e6, held=(0.1, "zero")))
    assert np.isfinite(off.cost)
    assert off.cost > eliminated(*a_lag(-0.5, held=(0.1, "zero"))).cost


def test_nothing_is_tried_for_a_pair_that_ran_away_from_the_lines():
    """It has as many harmonics up to its axis as it is away: five thousand million took all memory."""
    some, modal = a_lag(-0.5)
    pair = replace(modal.modes[0], exponent=-2e10 + 1e10j, real=False)
    now = eliminated(some, replace(modal, modes=(pair,)))
    assert _with_real_ones(some, now, Limits()) is now


def test_the_joint_covariance_is_the_inverse_of_all_products_of_slopes():
    found = eliminated(*a_lag(-0.5))
    count, width = len(found.slopes[0]), len(found.columns[0])
    rows = np.zeros((count + 2 * width, sum(own.shape[1] for own in found.slopes)))
    for output, (slopes, columns) in enumerate(zip(found.slopes, found.columns, strict=True)):
        place = slice(output * slopes.shape[1], (output + 1) * slopes.shape[1])
        rows[:count, place] = slopes
        rows[count + output * width : count + (output + 1) * width, place] = columns
    exact = np.linalg.inv(rows @ rows.T)
    assert found.covariance() == pytest.approx(exact, rel=1e-6, abs=1e-6 * np.abs(exact).max())
    assert found.parameters == pytest.approx(exact[:count, :count], rel=1e-6)


@pytest.mark.slow
def test_lines_that_do_not_tell_a_pair_from_two_real_ones_fail():
    system = flapping()
    given = of_equations(system, np.linspace(0.01, 0.5, 60), noise=0.01, seed=1)
    found = fit_transfer(given, period=system.period)
    assert pulls(system, found.model)[:, 0].max() > 5.0
    assert [one.code for one in found.findings if one.severity == Severity.FAILURE] == ["modes_of_lines_real"]


def test_a_decay_that_lines_do_not_tell_fails():
    given = of_equations(mathieu(damping=1e-4), np.linspace(0.05, 0.8, 30), noise=0.1, harmonics=np.arange(-1, 2))
    found = fit_transfer(given, period=np.pi, limits=Limits(modes=1))
    assert (2.0 * found.model.exponent_std.real > np.abs(found.model.exponents.real)).all()
    assert [one.code for one in found.findings if one.severity == Severity.FAILURE] == ["modes_of_lines_undetermined"]
    assert found.warnings[0].startswith("The decay is not determined: mode at ")


def test_a_direct_term():
    system = mathieu(direct=0.4)
    given = of_equations(system, np.linspace(0.05, 0.8, 30), harmonics=np.arange(-1, 2))
    found = fit_transfer(given, period=system.period, limits=Limits(modes=1))
    own = found.model.inputs
    assert own.direct[0, 0, own.direct_harmonics == 0].real == pytest.approx(0.4, abs=0.02)


@pytest.mark.slow
def test_it_agrees_with_the_fit_of_the_samples():
    system = mathieu()
    _, record, names = shaken(system, 20, 64, 5, 0.02, 2)
    found = fit_transfer(measure_transfer(record, inputs=names, harmonics=HARMONICS), period=system.period)
    other = identify(record, inputs=names, validate=False).model
    gap = found.model.exponents[0].real - other.exponents[0].real
    assert abs(gap) < 3.0 * other.exponent_std[0].real
    assert found.model.exponent_std[0].real == pytest.approx(other.exponent_std[0].real, rel=0.35)


@pytest.mark.slow
def test_a_transient_that_is_alive_is_modelled():
    system = mathieu(damping=0.011)
    measured = lines(system, 20, 64, 4, 0.002, 0, spare=0.0)
    found = fit_transfer(measured)
    assert pulls(system, found.model).max() < 4.0
    # Without what it adds the exponents are off.
    bare = fit_transfer(measured.transfer, period=system.period, limits=Limits(modes=1))
    assert pulls(system, bare.model).max() > 4.5


def test_noise_has_no_modes():
    given = of_equations(mathieu(), np.linspace(0.05, 0.8, 40), noise=1.0)
    generator = np.random.default_rng(0)
    noise = generator.standard_normal(given.values.shape) + 1j * generator.standard_normal(given.values.shape)
    with pytest.raises(IdentificationError, match="no mode rises"):
        fit_transfer(replace(given, values=noise * given.std.real), period=np.pi)


@pytest.mark.slow
def test_deviations_that_are_too_small_are_told():
    given = of_equations(mathieu(), np.linspace(0.05, 0.8, 50), noise=0.01)
    found = fit_transfer(replace(given, std=0.4 * given.std), period=np.pi)
    assert any("times the variance" in words for words in found.warnings)
    assert pulls(mathieu(), found.model).max() < 4.5


def test_slips_are_named():
    given = of_equations(mathieu(), np.linspace(0.05, 0.8, 20))
    with pytest.raises(InputError, match="period"):
        fit_transfer(given, period=0.0)
    with pytest.raises(InputError, match="deviations"):
        fit_transfer(replace(given, std=None), period=np.pi)


@pytest.mark.slow
def test_modes_of_lines_that_are_flattened_fail():
    """Polynomials over more than a resonance is wide: one mode came out as two, χ² as it should be."""
    system = mathieu()
    values, inputs = record_of(system, 300, 16, 0.02, 0)
    record = Record(values=np.vstack([values, inputs]), sample_rate=16 / system.period, channels=["y", "F"])
    lines = measure_transfer(record, period=system.period, inputs=["F"], method="polynomials", harmonics=[-1, 0, 1])
    fit = fit_transfer(lines, limits=Limits(modes=1))
    assert "modes_of_lines_flattened" in {one.code for one in fit.findings if one.severity is Severity.FAILURE}
    assert "Narrower than the 0.0" in fit.warnings[0]
