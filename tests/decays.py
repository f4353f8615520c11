"""Analyses of free responses: one that figures are drawn of, one that is locked, and such with other parts."""

from dataclasses import replace
from functools import cache

import numpy as np

from floquid.core import Channel, ConstantPeriod, Record
from floquid.pipeline import identify
from floquid.systems import JeffcottRotor


def with_decay(analysis, **changes):
    """The analysis with these parts of its decay."""
    return replace(analysis, decay=replace(analysis.decay, **changes))


@cache
def two_hits():
    """Two hits of unequal length that start at odd phases; the second loses samples before the first one's phase."""
    hits = {"samples_per_period": 20, "noise": 0.01}
    first = JeffcottRotor(damping=0.02).simulate(n_periods=60, seed=1, first_phase=0.25, **hits)
    second = JeffcottRotor(damping=0.02).simulate(n_periods=50, seed=2, first_phase=0.1, impulse_deg=80.0, **hits)
    return identify([first, second], states=["X", "Y"], validate=False)


def half_a_turn(*, period=1.0, seed=3):
    """One channel that rings once in two periods: a real negative multiplier. The clock has periods of 1 s."""
    times = np.arange(4800) / 24.0
    theta = 2.0 * np.pi * times / period
    turns = ((0.5, 1.0, 0.3), (1.5, 0.4, -0.5), (2.5, 0.2, 0.0))
    values = np.exp(-0.01 * times) * sum(size * np.cos(m * theta + phase) for m, size, phase in turns)
    values = values + 0.02 * np.random.default_rng(seed).standard_normal(len(times))
    return Record(
        values=values[None],
        sample_rate=24.0,
        channels=[Channel(name="acc", unit="m/s^2")],
        clock=ConstantPeriod(period=1.0),
    )


@cache
def one_locked():
    """Its analysis."""
    return identify(half_a_turn(), validate=False)
