"""The branch of a mode at a speed that wanders: the one whose frequency does not follow it."""

from dataclasses import replace

import numpy as np
import pytest

from floquid import AzimuthSignal, Channel, Record, identify
from floquid.periodic.search import _final


def synthetic(*, strongest=1, wander=2e-3, noise=1e-3, seed=0, second=0.0):
    """A mode whose strongest harmonic is another than the one whose frequency does not follow the speed.

    Beside it one of a single harmonic, `second` its size.
    """
    generator = np.random.default_rng(seed)
    times = np.arange(24 * 150 + 7) / 24.3
    angle = 2.0 * np.pi * (times + wander / 0.3 * np.sin(0.3 * times))
    exponent, shape = -0.02 + 2.0 * np.pi * 0.21j, np.array([[0.3, 1.0], [0.2, -0.4j], [0.5, 1.2]])
    harmonics = np.array([0, strongest])
    free = 2.0 * (shape @ np.exp(exponent * times + 1j * np.outer(harmonics, angle))).real
    free = free + second * shape[:, :1].real * np.exp(-0.05 * times) * np.cos(2.0 * np.pi * 0.37 * times)
    values = free + noise * generator.standard_normal(free.shape)
    values = np.concatenate([values, np.mod(np.rad2deg(angle), 360.0)[None]])
    names = ["a", "b", "c", Channel(name="azimuth", quantity="angle", unit="deg")]
    return exponent, Record(values=values, sample_rate=24.3, channels=names, clock=AzimuthSignal(channel="azimuth"))


@pytest.mark.slow
@pytest.mark.parametrize("strongest", [1, -1])
def test_a_mode_is_on_the_branch_that_does_not_follow_the_speed(strongest, monkeypatch):
    exponent, record = synthetic(strongest=strongest)
    model = identify(record, validate=False).model
    assert model.order == 2
    found = model.exponents[model.exponents.imag > 0][0]
    std = model.exponent_std[0]
    assert abs(found.imag - exponent.imag) < 4.0 * std.imag
    assert abs(found.real - exponent.real) < 4.0 * std.real
    if strongest == -1:
        return  # that is where the search begins
    monkeypatch.setattr("floquid.periodic.search._policies.branches", lambda point: iter(()))
    other = identify(record, validate=False).model
    gap = np.abs(other.exponents - exponent).min()
    assert other.order > 2 or gap > 4.0 * std.imag


def test_a_record_of_little_wander_says_nothing_of_the_branch_and_the_deviation_covers_it():
    exponent, record = synthetic(wander=2e-5, noise=3e-2)
    model = identify(record, validate=False).model
    gap = model.exponents - exponent
    gap = np.abs(gap.imag - model.fundamental * np.rint(gap.imag / model.fundamental)).min()
    assert gap < 4.0 * model.exponent_std[0].imag


class Reached(Exception):  # noqa: N818 - no error: the search has come as far as it is looked at
    """The search is where branches are looked for."""


def test_a_mode_that_is_held_has_no_variance_of_branches(monkeypatch):
    """A fit on another branch that held a mode ended in an IndexError."""
    _, record = synthetic(second=1.0)
    reached = []

    def caught(point):
        reached.append(point)
        raise Reached

    own = _final._spread_of_branches
    monkeypatch.setattr(_final, "_spread_of_branches", caught)
    with pytest.raises(Reached):
        identify(record, validate=False)
    (point,) = reached
    free = np.flatnonzero(~point.entries.fixed)
    assert len(free) > 1
    whole = own(point)
    assert whole.shape == point.solution.gradient.shape
    for entry in free:
        fixed = point.entries.fixed.copy()
        fixed[entry] = True
        held = point.with_entries(replace(point.entries, fixed=fixed))
        further = own(held)
        assert further.shape == held.solution.gradient.shape == (len(whole) - 2,)
        assert np.isfinite(replace(held.solution, further=further).covariance()).all()
