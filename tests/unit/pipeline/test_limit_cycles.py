"""Limit cycles: the period is that of lines that do not decay, half of it where the orbit is half-wave symmetric."""

from __future__ import annotations

import re
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import floquid
from floquid import IdentificationError, Record
from floquid.periodic import estimate_period

EXACT = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-13}
NOISE = 1e-3
"""The noise over the rms of the orbit."""


def oscillator(mu, coupling=0.0, even=0.0):
    """Van der Pol's equation with a spring that may be uneven, coupled to a linear oscillator."""

    def rates(_, x):
        u, v, w, r = x
        pull = coupling * (u - w)
        return np.array([v, mu * (1.0 - u * u) * v - u - even * u * u - pull, r, -0.09 * r - 5.3 * w + pull])

    return rates


@cache
def orbit_of(mu, coupling=0.0, even=0.0):
    """A state on the limit cycle and its period, by integration of the equations alone."""
    rates = oscillator(mu, coupling, even)

    def crossing(_, x):
        return x[0]

    crossing.direction = 1.0
    decays = 400.0 if coupling else 40.0 / mu  # of what is not the cycle, to e⁻⁴⁰ beside the linear oscillator at rest
    settled = solve_ivp(rates, (0.0, decays), [2.0, 0.0, 0.0, 0.0], **EXACT).y[:, -1]
    found = solve_ivp(rates, (0.0, 40.0), settled, events=crossing, **EXACT)
    return found.y_events[0][-1], float(np.diff(found.t_events[0])[-2:].mean())


def multipliers_of(*system):
    """The multipliers of the limit cycle, by differences of the integration."""
    (start, period), columns, step = orbit_of(*system), [], 1e-6
    for part in np.eye(4):
        moved = [start + s * step * part for s in (1.0, -1.0)]
        ends = [solve_ivp(oscillator(*system), (0.0, period), one, **EXACT).y[:, -1] for one in moved]
        columns.append((ends[0] - ends[1]) / (2.0 * step))
    return np.linalg.eigvals(np.array(columns).T)


def record_of(*system, blow=(0.0, 0.05, 0.0, 0.1), seed=0, channels=slice(0, 4)):
    """Forty-five periods after a blow, at a rate out of step, and its period."""
    start, period = orbit_of(*system)
    times = period / 50.3 * np.arange(int(45 * 50.3))
    values = solve_ivp(
        oscillator(*system), (0.0, times[-1]), start + blow, t_eval=times, rtol=1e-10, atol=1e-12, method="DOP853"
    ).y[channels]
    noise = NOISE * values.std(axis=1, keepdims=True) * np.random.default_rng(seed).standard_normal(values.shape)
    names = ["u [m]", "v [m/s]", "w [m]", "r [m/s]"][channels]
    return Record(values=values + noise, sample_rate=50.3 / period, channels=names), period


def nearest(model, exponent):
    """The deviations of the model's exponent that is nearest to another one, modulo its fundamental."""
    gap = model.exponents - exponent
    gap = gap.real + 1j * (gap.imag - model.fundamental * np.rint(gap.imag / model.fundamental))
    own = int(np.abs(gap).argmin())
    std = model.exponent_std[own]
    return abs(gap[own].real) / std.real, abs(gap[own].imag) / max(std.imag, 1e-9)


def test_the_period_is_that_of_lines_that_do_not_decay():
    record, period = record_of(0.3, blow=(0.0, 0.02, 0.0, 0.0), channels=slice(0, 2))
    found = estimate_period([record])
    assert found.told
    assert found.orbit.symmetric
    assert set(found.orbit.harmonics) == {1, 3, 5, 7}
    assert abs(2.0 * found.period - period) < 4.0 * 2.0 * found.period_std
    assert found.period_std < 1e-6 * period
    assert "half-wave symmetric" in found.reasons[0]


@pytest.mark.slow
def test_an_orbit_that_is_not_symmetric_has_its_own_period():
    record, period = record_of(0.2, 0.0, 0.15, blow=(0.0, 0.02, 0.0, 0.0), channels=slice(0, 2))
    found = estimate_period([record])
    assert not found.orbit.symmetric
    assert abs(found.period - period) < 4.0 * found.period_std


@pytest.mark.slow
def test_modes_beside_a_limit_cycle_are_found_and_the_cycle_is_none_of_them():
    record, period = record_of(0.3, 0.3)
    analysis = floquid.identify(record, estimate_period=True)
    model = analysis.model
    assert analysis.validation.passed
    assert model.period == pytest.approx(0.5 * period, rel=1e-6)
    pair = next(m for m in multipliers_of(0.3, 0.3) if m.imag > 0)
    half = np.log(pair) / period
    # The square root of a multiplier has two signs: the branch over half a period is that of the response.
    assert min(max(nearest(model, half + 1j * k * np.pi / period)) for k in (0, 1)) < 5.0
    assert model.exponents.real.max() < -0.01
    assert analysis.fit.forced.harmonics[0] == 1
    assert analysis.fit.forced.revolution == pytest.approx(period, rel=1e-6)
    assert "orbit_of_two_periods" in [own.code for own in analysis.findings]


@pytest.mark.slow
def test_an_orbit_of_two_periods_is_no_mode_where_the_period_is_given():
    record, period = record_of(0.1, blow=(0.0, 0.02, 0.0, 0.0), channels=slice(0, 2))
    analysis = floquid.identify(record, period=0.5 * period)
    # Beside the cycle's own multiplier 1 and the pair of the oscillator that is not coupled.
    own = [m.real for m in multipliers_of(0.1) if abs(m.imag) < 1e-6 and abs(m - 1.0) > 0.1]
    decay = float(np.log(own[0])) / period
    assert analysis.model.order == 1
    assert max(nearest(analysis.model, decay + 0.5j * analysis.model.fundamental)) < 4.0
    assert not {"multiplier_one", "multiplier_minus_one"} & {own.code for own in analysis.findings}


@pytest.mark.slow
@pytest.mark.parametrize("decay", [1.4, 0.05])
def test_a_mode_near_minus_one_that_decays_is_no_orbit(decay):
    # A real negative multiplier that hardly decays over the record: a parametric resonance near its edge.
    rate, cycles, phases = -decay / 60.0, 60, 25
    times = np.arange(cycles * phases) / phases
    values = np.array([[1.0], [0.6]]) * np.cos(np.pi * times + np.array([[0.0], [0.7]])) * np.exp(rate * times)
    values += np.array([[1.0], [-0.4]]) * np.cos(2.2 * times) * np.exp(-0.05 * times)
    values += 0.01 * np.random.default_rng(1).standard_normal((2, len(times)))
    analysis = floquid.identify(Record(values=values, sample_rate=phases, channels=["a", "b"]), period=1.0)
    assert analysis.model.order == 3
    assert max(nearest(analysis.model, rate + 1j * np.pi)) < 4.0
    own = np.abs(analysis.model.exponents.real - rate).argmin()
    assert analysis.model.exponent_std[own].real < 5e-5


@pytest.mark.slow
def test_an_orbit_alone_is_said_to_be_one():
    record, _ = record_of(1.0, blow=(0.0, 0.0, 0.0, 0.0), channels=slice(0, 2))
    with pytest.raises(IdentificationError, match="no decay was seen on it"):
        floquid.identify(record, estimate_period=True)


def test_harmonics_of_the_mains_say_nothing_against_a_period_given():
    generator = np.random.default_rng(5)
    times = np.arange(3000) / 25.0
    mode = np.exp(-0.02 * times) * np.cos(2.0 * times) * (1.0 + 0.4 * np.cos(2.0 * np.pi * times))
    hum = 0.05 * sum(np.cos(2.0 * np.pi * 1.37 * m * times + m) / m for m in (1, 3, 5))
    values = np.array([mode + hum, 0.7 * mode - hum]) + 0.005 * generator.standard_normal((2, len(times)))
    record = Record(values=values, sample_rate=25.0, channels=["a", "b"])
    analysis = floquid.identify(record, period=1.0, validate=False)
    assert max(nearest(analysis.model, -0.02 + 2.0j)) < 5.0


def locked(seed, growth=0.008, period=1.0):
    """Two hits of two pairs and two real multipliers next to -1, and a clock of a stated period."""
    generator, clock = np.random.default_rng(seed), floquid.ConstantPeriod(period=period)
    times, rates = np.arange(40 * 24) / 24.0, [growth + 1j * np.pi, -0.055 + 1j * np.pi, -0.02 + 1.1j, -0.015 + 2.2j]
    found = []
    for _ in range(2):
        values = np.zeros((3, len(times)))
        for number, rate in enumerate(rates):
            real, imag = np.random.default_rng(number + 10 * seed).standard_normal((2, 3))
            state, shape = (1.0, real) if number < 2 else (np.exp(2j * number), real + 1j * imag)
            values += 2.0 * (generator.standard_normal() * state * np.outer(shape, np.exp(rate * times))).real
        values += 0.01 * np.abs(values).max() * generator.standard_normal(values.shape)
        found.append(Record(values=values, sample_rate=24.0, channels=["x", "y", "z"], clock=clock))
    return found


@pytest.mark.first(1)
@pytest.mark.parametrize("seed", [1, 2])
def test_a_lock_near_its_edge_is_no_orbit(seed):
    """A real multiplier next to -1 was taken for a steady orbit of two periods, and left out of the modes."""
    model = floquid.identify(locked(seed), validate=False).model
    real = np.flatnonzero(model.real)
    assert (model.order, len(real)) == (6, 2)
    off = np.sort(model.exponents[real].real)[::-1] - [0.008, -0.055]
    assert np.abs(off / np.sort(model.exponent_std[real].real)).max() < 3.0


@pytest.mark.slow
@pytest.mark.parametrize("growth", [0.008, 0.012, 0.016])
def test_a_lock_at_a_wrong_period_does_not_pass(growth):
    """Its exponents are not determined there: it was in the fit, and in no model, which passed."""
    try:
        found = floquid.identify(locked(1, growth, period=1.001))
    except floquid.errors.IdentificationError as error:
        own = re.search(r"its own is ([\d.]+) ±", str(error))
        assert float(own[1]) == pytest.approx(1.0, abs=4e-4)
        return
    assert not found.passed
