"""Laws of the search for modes: J falls, units gain what a fit with them gains, a branch is a name."""

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.periodic.test_constrain import OMEGA, records, system

from floquid.fit import chi2_limit
from floquid.periodic.least_squares import ModeParameters, forced_entries, record_blocks
from floquid.periodic.search import Bounds, Point, lines, priced, searched
from floquid.periodic.search._moves import bands, doubles, merges, splits, together
from floquid.periodic.search._near_axis import with_axis_pairs
from floquid.periodic.search._tests import Units, wide_of

MOST = 6


def point(exponents, ends, *, truth=(-0.06 + 0.9j, -0.05 + 2.2j), noise=0.01, seed=1):
    measured = records(system(list(truth), channels=2), noise=noise, n_cycles=60, seed=seed)
    blocks, omega, _ = record_blocks(measured, [record.clock for record in measured], 1.0)
    base = forced_entries([], omega)
    entries = ModeParameters.made(exponents, ends, omega)
    return Point.at(blocks, *priced(blocks, base, 1e-12, mode_alarm=1e-9, harmonic_alarm=1e-6), base.joined(entries))


def test_j_falls_at_every_step_and_its_noise_is_that_of_the_residual():
    now = point([-0.08 + 0.93j, -0.04 + 2.15j], [(-1, 1), (-1, 1)])
    values = [now.settled(steps=steps, rest=0.0).value for steps in range(6)]
    assert (np.diff(values) <= 1e-6).all()
    assert values[-1] < values[0] - 100.0
    for block, linear in zip(now.blocks, now.solution.linear, strict=True):
        np.testing.assert_allclose(block.noise**2, linear.left / block.n_samples, rtol=1e-9)


def test_units_gain_and_lose_what_fits_with_and_without_them_do():
    now = point([-0.06 + 0.9j, -0.05 + 2.2j], [(-1, 0), (0, 1)])
    wide = wide_of(now, MOST)
    units, columns = Units(now, wide), wide.entries.columns()
    gains = units.gains()
    assert units.inside.sum() == 4
    for column, inside in enumerate(units.inside):
        mode, harmonic = int(columns.modes[column]), int(columns.harmonics[column])
        low, high = now.entries.bands[mode]
        ends = now.entries.bands.copy()
        ends[mode] = (
            (harmonic + (harmonic == low), high - (harmonic == high))
            if inside
            else (min(low, harmonic), max(high, harmonic))
        )
        if np.ptp(ends[mode]) != np.ptp([low, high]) + (-1 if inside else 1):
            continue  # farther off, the harmonics between come with it
        if inside and harmonic == low:
            ends[mode] = harmonic + 1, high
        other = now.with_entries(replace(now.entries, bands=ends))
        change = sum(
            float((one.left - two.left) @ (1.0 / block.noise**2))
            for block, one, two in zip(now.blocks, now.solution.linear, other.solution.linear, strict=True)
        )
        assert gains[column] == pytest.approx(abs(change), rel=1e-5, abs=1e-6)


def test_modes_nearer_than_they_decay_are_two_where_one_was_fitted():
    truth = (-0.06 + 0.9j, -0.064 + 0.905j)
    now = point([-0.06 + 0.9j], [(-1, 1)], truth=truth, noise=1e-3).settled()
    (double,) = doubles(now)
    found = now.tried(double)
    assert found.value < now.value + double.change < now.value
    assert found.n_modes == 2


def test_one_mode_is_not_doubled():
    now = point([-0.06 + 0.9j], [(-1, 1)], truth=(-0.06 + 0.9j,), noise=1e-3).settled()
    assert not list(doubles(now))


def test_what_bands_are_predicted_to_lower_j_by_they_lower_it_by():
    now = point([-0.06 + 0.9j, -0.05 + 2.2j], [(0, 3), (-3, 0)]).settled()
    for move in bands(now, MOST):
        other = now.with_entries(move.structure)
        assert move.change < 0.0
        assert other.value <= now.value + move.change + 5.0
    assert not list(bands(point([-0.06 + 0.9j, -0.05 + 2.2j], [(-1, 1), (-1, 1)]).settled(), MOST))


def test_a_structure_is_one_on_every_branch():
    first = ModeParameters.made([-0.06 + 0.9j, -0.05 + 2.2j], [(-1, 1), (0, 1)], OMEGA)
    other = ModeParameters.made([-0.05 + 2.2j - 1j * OMEGA, -0.06 + 0.9j], [(1, 2), (-1, 1)], OMEGA)
    now = point([-0.06 + 0.9j], [(0, 0)])
    assert now.name(first) == now.name(other)
    assert now.name(first) != now.name(replace(other, bands=other.bands + np.array([0, 1])))


def test_a_mode_that_is_two_is_split_and_two_that_are_one_are_merged():
    truth = [-0.06 + 0.9j, -0.05 + 2.2j]
    one = point([-0.055 + 0.9j], [(-1, 2)], truth=[-0.06 + 0.9j, -0.05 + 0.96j + 1j * OMEGA]).settled()
    assert min(splits(one), key=lambda move: move.change).change < 0.0
    halves = point([truth[0], truth[0] + 1j * OMEGA, truth[1]], [(-1, 0), (0, 0), (-1, 1)]).settled()
    assert [len(move.structure.exponents) for move in merges(halves, 2 * MOST)] == [2]


@pytest.mark.first(1)
@pytest.mark.parametrize("seed", range(3))
def test_the_search_ends_at_the_modes_whatever_it_starts_from(seed):
    exponents, ends = [-0.06 + 0.9j, -0.05 + 2.2j], [(-1, 1), (-1, 1)]
    best = point(exponents, ends, seed=seed).settled()
    bounds = Bounds(most=MOST, span=2 * MOST, modes=8, forced=np.zeros(0))
    for start in ([], [0], [0, 1, 1]):
        begin = point([exponents[k] for k in start], [(0, 0) for _ in start], seed=seed) if start else None
        first = best.with_entries(best.entries.picked([])) if begin is None else begin
        found = searched(first, bounds)
        assert not found.unfinished
        assert found.value <= best.value + 1.0
        assert len(found.entries.exponents) == 2
        assert np.ptp(found.entries.bands, axis=1).max() <= 2  # the truth has three harmonics of each


def test_copies_of_a_mode_are_one_where_nothing_but_rounding_is_left():
    """Three copies within 1e-10 of each other took a little more out of the rounding than they cost."""
    truth = [-0.06 + 0.9j, -0.05 + 2.2j]
    parts = [truth[0], truth[0] + 1j * OMEGA, truth[1], truth[1].conjugate()], [(-1, 0), (0, 0), (0, 1), (0, 1)]
    copies = point(*parts, noise=0.0)
    assert copies.at_floor
    assert together(copies).entries.bands[copies.entries.fixed.sum() :].tolist() == [[-1, 1], [-1, 1]]
    noisy = point(*parts)
    assert together(noisy) is noisy


@pytest.mark.parametrize("seed", range(3))
def test_modes_near_one_axis_on_lines_of_their_own_stay_modes_of_their_own(seed):
    """One pair for both, with all lines between, was taken as simpler: it was nowhere near either."""
    truth = [-0.05 + 0.01j, -0.2 + 5.0j * OMEGA + 0.02j]
    found = point(truth, [(0, 1), (0, 0)], truth=truth, seed=seed).settled()
    bands = found.entries.bands
    near, kept = with_axis_pairs(found, bands)
    result = near.entries
    assert len(kept) == len(result.exponents)
    decays = np.unique(np.round(result.exponents.real, 6))
    assert np.abs(decays[:, None] - np.real(truth)).min(axis=0).max() < 0.02
    assert near.value < found.value + near.price.harmonics(np.ones(8, bool)).sum()


@pytest.mark.parametrize("alarm", [1e-9, 1e-3])
def test_a_line_alone_costs_the_limit_of_its_numbers(alarm):
    """An exponent and an amplitude, each at a limit of its own, cost half as much again: weak lines were not found."""
    measured = records(system([-0.06 + 0.9j], channels=2), noise=0.01, n_cycles=60, seed=1)
    blocks, omega, _ = record_blocks(measured, [record.clock for record in measured], 1.0)
    found = lines(blocks, forced_entries([], omega), alarm)
    assert len(found.entries.exponents) == 3  # the mode has three harmonics
    one = found.price.of(found.entries.picked([0]))
    assert one == pytest.approx(chi2_limit(2 + 2 * 2, alarm))
