"""Modes that share lines, and what is none: found apart, with deviations that cover the rest, or refused at once."""

from dataclasses import replace

import numpy as np
import pytest
from tests.records.test_rotor_records import duffing
from tests.unit.periodic.test_constrain import OMEGA, PERIOD, records, system

from floquid import identify
from floquid.errors import IdentificationError
from floquid.periodic import fit
from floquid.periodic.least_squares import ModeParameters, RecordBlock, forced_entries, linearise
from floquid.periodic.search import Bounds, Point, priced, searched
from floquid.periodic.search._final import beyond_noise
from floquid.periodic.search._folds import folds, shared_harmonics, with_all_lines
from floquid.periodic.search._objective import Price
from floquid.testing import assert_exponents_close, pair_exponents


def pulls(found, model):
    pairing = pair_exponents(found.exponents, model.exponents, PERIOD)
    std = found.exponent_std[pairing.permutation]
    return np.concatenate([pairing.differences.real / std.real, pairing.differences.imag / std.imag])


@pytest.mark.first(1)
@pytest.mark.parametrize("seed", [1, 3])
def test_modes_a_twelfth_of_their_decay_apart_are_two(seed):
    """They came out as three, one of them wrong by 10 deviations."""
    model = system([-0.06 + 0.9j, -0.06 + 1j * (0.905 + OMEGA)], channels=2)
    found = identify(records(model, noise=0.01, n_cycles=60, seed=seed), validate=False).model
    assert found.order == 4
    assert np.abs(pulls(found, model)).max() < 4.0
    assert found.exponent_std.real.max() < 5e-4


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(8))
def test_weak_harmonics_that_two_modes_share_are_kept_together(seed):
    """Each alone is less than noise exceeds: left out, they moved an exponent by 6 of its deviations."""
    model = system([-0.06 + 0.9j, -0.063 + 1j * (0.912 + OMEGA)], channels=2, width=3, seed=seed)
    coefficients = 0.1 * np.array(model.coefficients)
    middle = coefficients.shape[-1] // 2
    for mode, exponent in enumerate(model.exponents):
        upwards = (exponent.imag > 0.0) == (abs(exponent.imag) < 2.0)
        loud = [middle, middle + (1 if upwards else -1)]
        coefficients[mode, ..., loud] *= 10.0
    model = replace(model, coefficients=coefficients)
    found = identify(records(model, noise=0.01, n_cycles=60, seed=seed), validate=False).model
    assert found.order == 4
    assert np.abs(pulls(found, model)).max() < 4.0


@pytest.mark.parametrize("sign", [1, -1])
def test_lines_of_folded_modes_are_the_same_seen_from_either(sign):
    second = -0.06 + 1j * (0.91 + 3.0 * OMEGA) if sign > 0 else -0.06 + 1j * (3.0 * OMEGA - 0.91)
    entries = ModeParameters.made([-0.06 + 0.9j, second, -0.06 + 1.3j], [(-1, 2), (-2, 0), (0, 0)], OMEGA)
    (fold,) = folds(entries)
    assert (fold.first, fold.second, fold.sign) == (0, 1, sign)
    ends = np.array([-2, 0])
    of_first = fold.of_first(ends)
    assert fold.of_second(of_first).tolist() == [-2, 0]
    rates = entries.exponents[1] + 1j * OMEGA * ends
    beside = entries.exponents[0] + 1j * OMEGA * of_first
    assert np.sort(np.abs(rates.imag)) == pytest.approx(np.sort(np.abs(beside.imag)), abs=0.02)
    # What both have is one unit; the third mode has a line of its own.
    every = with_all_lines(entries, fold)
    assert shared_harmonics([fold], every.bands) == [np.ptp(every.bands[0]) + 1]
    price = Price(mode_alarm=1e-9, harmonic_alarm=1e-6, rows=2)
    assert price.of(every) < price.of(replace(every, exponents=every.exponents + np.array([0.0, 0.5j, 0.0])))


def test_where_the_speed_wanders_other_branches_share_no_lines():
    entries = ModeParameters.made([-0.06 + 0.9j, -0.06 + 0.91j, -0.06 + 1j * (0.9 + OMEGA)], [(0, 1)] * 3, OMEGA)
    assert len(folds(entries)) == 3
    (only,) = folds(entries, wanders=True)
    assert (only.first, only.second, only.turns) == (0, 1, 0)


def columns_at(rates, times):
    """Re z and Im z of exponentials (2 rates, samples)."""
    turning = np.exp(np.outer(rates, times))
    return np.concatenate([turning.real, turning.imag])


def test_harmonics_left_out_on_shared_lines_move_exponents_as_far_as_their_variance_says():
    """Deviations of modes that share lines were half of their errors: their weak harmonics were no part of the fit."""
    times, generator = np.linspace(0.0, 60.0 * PERIOD, 960, endpoint=False), np.random.default_rng(0)
    entries = ModeParameters.made([-0.06 + 0.9j, -0.062 + 1j * (0.91 + OMEGA)], [(-1, 1), (-2, 0)], OMEGA)
    amplitudes = generator.standard_normal((2, 12))

    def point_of(values, modes=entries):
        """The modes and their noise as they are known."""
        blocks = (RecordBlock(times=times, values=values, hit=0, rows=np.arange(2), noise=np.full(2, 0.01)),)
        floors, price = priced(blocks, modes.picked([]), 1e-12, mode_alarm=1e-9, harmonic_alarm=1e-6)
        return Point(blocks, floors, price, linearise(blocks, modes), 0.0)

    fitted = columns_at(entries.columns().rates, times)
    beyond = entries.exponents[:, None] + 1j * OMEGA * (entries.bands + np.array([-1, 1]))
    out = columns_at(beyond.ravel(), times)
    beside = out - out @ np.linalg.pinv(fitted) @ fitted
    sizes = 0.01 / np.linalg.norm(beside, axis=1)
    further = beyond_noise(point_of(amplitudes @ fitted), 8, branches=True).further
    steps = []
    for _ in range(300):
        hidden = sizes * generator.standard_normal((2, len(out))) @ out
        solution = point_of(amplitudes @ fitted + hidden).solution
        steps.append(np.linalg.solve(solution.information, solution.gradient))
    assert np.mean(np.square(steps), axis=0) == pytest.approx(further, rel=0.3)
    # Of modes that share none, a further harmonic is part of the fit.
    apart = replace(entries, exponents=entries.exponents + np.array([0.0, 0.4j]))
    alone = point_of(amplitudes @ columns_at(apart.columns().rates, times), apart)
    assert not beyond_noise(alone, 8, branches=True).further.any()


def test_a_mode_next_to_its_own_conjugate_has_a_deviation_for_the_mirrored_harmonics(monkeypatch):
    """Left out, they move it between the two; a mode that is away from its conjugate keeps its own deviation."""
    model = system([-0.06 + 1j * (1.5 * OMEGA + 0.006), -0.05 + 2.2j], channels=2)
    (record,) = records(model, noise=0.01, n_cycles=60, seed=1)
    wide = identify(record, validate=False).model
    monkeypatch.setattr("floquid.periodic.search._near_axis._near", lambda _: [])
    bare = identify(record, validate=False).model
    assert wide.order == bare.order == 4
    assert np.abs(pulls(wide, model)).max() < 4.0
    growth = np.sort(wide.exponent_std.real / bare.exponent_std.real)
    assert growth[:2] == pytest.approx(1.0, abs=0.05)
    assert growth[2:].min() > 2.0


@pytest.mark.parametrize("beside", [-0.02, 0.02])
def test_a_pair_next_to_an_axis_is_counted_from_its_strongest_line(beside):
    """Of either side of the axis: it was always counted from the line above."""
    model = system([-0.06 + 1j * (1.5 * OMEGA + beside), -0.05 + 2.2j], channels=2)
    found = identify(records(model, noise=0.003, n_cycles=60, seed=1), validate=False).model
    assert found.order == 4
    for true in model.exponents:
        assert np.abs(found.exponents - true).min() < 0.01
    energy = np.sum(np.abs(found.coefficients) ** 2, axis=(1, 2))
    assert (np.argmax(energy, axis=1) == list(found.harmonics).index(0)).all()


@pytest.mark.slow
def test_missing_samples_hide_no_mode():
    """Filled in for the start, they hid both modes beside an orbit 500 times as large."""
    record, truth = duffing(0.01, orbit=None)
    values, generator = np.array(record.values), np.random.default_rng(2)
    for first in generator.integers(0, values.shape[1] - 20, round(0.01 * values.shape[1] / 20)):
        values[:, first : first + 20] = np.nan
    values[generator.random(values.shape) < 0.01] = np.nan
    found = identify(replace(record, values=values), validate=False).model
    assert_exponents_close(found.exponents, truth, record.clock.period, atol=5e-3)


def test_a_step_is_no_sum_of_modes():
    """It took minutes, and gave modes that were none."""
    (record,) = records(system(channels=2), noise=1e-3, n_cycles=200)
    values = np.array(record.values)
    values[0, values.shape[1] // 3 :] += 0.2 * np.abs(values[0]).max()
    with pytest.raises(IdentificationError, match="Likely: a step or a glitch"):
        identify(replace(record, values=values), validate=False)


def test_a_start_that_is_over_at_once_does_not_hold_the_other_modes():
    """No step was taken beside it: four modes were found in place of two."""
    model = system(channels=2)
    (record,) = records(model, noise=0.01, n_cycles=60)
    values = np.array(record.values)
    values[:, 0] += 20.0
    exponents = [-0.0592 + 0.9012j, -0.041 + 2.1985j, -13.0 / PERIOD + 0.9j]
    start = ModeParameters.made(exponents, [(-1, 1), (-1, 1), (-2, 2)], OMEGA)
    found = fit([replace(record, values=values)], [record.clock], start=start).model
    # Whether the first sample is a mode of its own, which is over within a third of a period, is left to rounding.
    lasting = np.flatnonzero(found.exponents.real > -3.0 / PERIOD)
    assert len(lasting) == 4
    pairing = pair_exponents(found.exponents[lasting], model.exponents, PERIOD)
    std = found.exponent_std[lasting][pairing.permutation]
    assert (np.abs(pairing.differences.real) < 4.0 * std.real).all()
    assert (np.abs(pairing.differences.imag) < 4.0 * std.imag).all()


def test_errors_of_the_angle_raise_the_price_of_a_mode():
    times = np.linspace(0.0, 40.0, 2000)
    values = 3.0 * np.cos(OMEGA * times)[None] + 0.1 * np.random.default_rng(0).standard_normal((1, 2000))
    blocks = (RecordBlock(times=times, values=values, hit=0, rows=np.array([0]), noise=np.array([0.1])),)
    base = forced_entries([1.0], OMEGA)
    point = Point.at(blocks, *priced(blocks, base, 1e-12, mode_alarm=1e-9, harmonic_alarm=1e-6), base)
    bounds = Bounds(most=3, span=6, modes=4, forced=np.zeros(0))
    one, other = (searched(point, replace(bounds, angle_std=std)).price for std in ((), (1e-2,)))
    more = other.mode(real=False) - one.mode(real=False)
    assert more == pytest.approx(0.5 * 2000 * (3.0 * 1e-2 / 0.1) ** 2, rel=0.02)
