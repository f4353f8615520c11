"""The descent on points that are numbers: what it accepts, when it ends, and how often it tries a structure."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace

import numpy as np

from floquid.search import Move, descended, longer

HOUR = 3600.0


@dataclass(frozen=True)
class Whole:
    """A whole number with the J of `values`; `asked` holds the numbers tried."""

    number: int
    values: tuple[float, ...]
    asked: list[int] = field(default_factory=list)
    unfinished: bool = False

    @property
    def value(self):
        return self.values[self.number]

    @property
    def n_modes(self):
        return self.number

    def name(self, structure=None):
        return self.number if structure is None else structure

    def tried(self, move):
        self.asked.append(move.structure)
        return replace(self, number=move.structure)

    def ended(self, *, unfinished):
        return replace(self, unfinished=unfinished)


def neighbours(point, least=1e-3):
    near = (point.number - 1, point.number + 1)
    yield [Move(0.0, "beside", number, least) for number in near if 0 <= number < len(point.values)]


def test_it_ends_where_no_move_lowers_j_and_tries_each_structure_once():
    begin = Whole(0, (5.0, 4.0, 3.0, 3.5, 1.0))
    end = descended(begin, neighbours, time.process_time() + HOUR)
    assert end.number == 2
    assert not end.unfinished
    assert begin.asked == [1, 2, 3]


def test_a_later_stage_is_made_only_where_none_before_lowers_j():
    def stages(point):
        yield from neighbours(point)
        assert point.number in (2, 4)  # the ends of the first stage
        yield [Move(0.0, "far", 4)]

    assert descended(Whole(0, (5.0, 4.0, 3.0, 3.5, 1.0)), stages, time.process_time() + HOUR).number == 4


def test_a_fall_below_the_least_of_a_move_is_none():
    point = Whole(0, (5.0, 4.0, 3.9))
    assert descended(point, lambda own: neighbours(own, 0.5), time.process_time() + HOUR).number == 1


def test_a_fit_goes_on_once_and_a_budget_that_is_over_is_said():
    point = Whole(0, (5.0,))
    descended(point, lambda _: iter([[Move(-1.0, "settle", 0, again=True)]]), time.process_time() + HOUR)
    assert point.asked == [0]
    assert descended(Whole(0, (5.0, 4.0)), neighbours, 0.0).unfinished


def test_bands_hold_as_many_harmonics_as_a_period_has_samples():
    """Of twelve samples five on one side of a pair, and six on the other; of a real multiplier what turns alone."""
    for samples, band in ((12, np.arange(-5.0, 6.5)), (13, np.arange(-6.0, 6.5))):
        highest = 0.5 * (samples - 1)
        assert np.array_equal(longer(np.zeros(1), samples, highest, real=False), band)
        assert len(band) == samples
        for branch in (-band[::-1], band[:-3] - 3.0, band[3:] + 3.0):
            assert np.ptp(longer(branch, samples, highest, real=False)) == samples - 1
    assert np.array_equal(longer(np.zeros(1), 12, 5.5, real=True), np.arange(6.0))
    assert np.array_equal(longer(np.array([0.5]), 12, 5.5, real=True), np.arange(0.5, 6.0))
