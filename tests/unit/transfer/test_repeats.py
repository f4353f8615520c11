"""G from repeats against steady responses of the equations, which share no code; its variance by repetition."""

from __future__ import annotations

import numpy as np
import pytest
from tests.driven import mathieu, record_of, shaken, two_masses

from floquid import IdentificationError, InputError, Record, identify, measure_transfer, multisine
from floquid.transfer import Multisine

HARMONICS = np.arange(-3, 4)


def measured(system, phases, turns, repeats, noise, seed, drop=1, **design):
    _, record, names = shaken(system, phases, turns, repeats, noise, seed, **design)
    return measure_transfer(record, inputs=names, harmonics=HARMONICS, drop=drop)


def squares(found, system, phases):
    """Squared errors over their variances, of what was measured."""
    own = found.transfer
    error = own.values - system.sampled_transfer(own.frequencies_hz, own.harmonics, phases)
    return (np.abs(error) / np.abs(own.std))[np.isfinite(error)] ** 2


@pytest.mark.parametrize(
    ("system", "phases"), [(mathieu(direct=0.4), 20), pytest.param(two_masses(), 24, marks=pytest.mark.slow)]
)
def test_without_noise_it_is_that_of_the_equations(system, phases):
    found = measured(system, phases, 24, 8, 0.0, 0, drop=6).transfer
    truth = system.sampled_transfer(found.frequencies_hz, HARMONICS, phases)
    assert found.step == pytest.approx(system.period / phases)
    # Each line is that of one input.
    assert (np.isfinite(found.values[0, 0]).sum(axis=0) == 1).all()
    assert np.nanmax(np.abs(found.values - truth)) < 1e-4 * np.abs(truth).max()
    # Mutants: the sign of the harmonic, half of the sidebands, the hold.
    wide = np.nanmax(np.abs(found.values[::-1] - truth))
    assert wide > 0.05 * np.abs(truth).max()
    assert np.abs(truth[HARMONICS < 0]).max() > 0.05 * np.abs(truth).max()
    held = np.nanmax(np.abs(found.values - system.transfer(found.frequencies_hz, HARMONICS)))
    assert held > 0.02 * np.abs(truth).max()


def test_a_record_that_starts_within_the_period_has_the_same():
    system, phases = mathieu(), 20
    _, record, names = shaken(system, phases, 64, 4, 0.0, 0)
    late = Record(
        values=record.values[:, 7:],
        sample_rate=record.sample_rate,
        channels=record.channels,
        clock=record.clock,
        start=7.0 / record.sample_rate,
    )
    both = [measure_transfer(own, inputs=names, drop=1).transfer.values for own in (record, late)]
    assert np.nanmax(np.abs(both[0] - both[1])) < 1e-6 * np.nanmax(np.abs(both[0]))


@pytest.mark.slow
@pytest.mark.parametrize(("system", "phases"), [(mathieu(), 20), (two_masses(), 24)])
def test_the_variance_is_right_to_five_per_cent(system, phases):
    found = [measured(system, phases, 64, 6, 0.05, seed, drop=2) for seed in range(24)]
    assert np.mean([squares(own, system, phases).mean() for own in found]) == pytest.approx(1.0, abs=0.05)
    assert not any(own.warnings for own in found)
    assert np.mean([own.nonlinear for own in found]) == pytest.approx(1.0, abs=0.1)


@pytest.mark.slow
def test_noise_on_the_input_is_in_the_variance():
    system, phases, found = mathieu(), 20, []
    for seed in range(12):
        _, record, names = shaken(system, phases, 32, 8, 0.002, seed)
        values = record.values.copy()
        values[-1] += 0.03 * np.random.default_rng(seed).standard_normal(values.shape[1])
        noisy = Record(values=values, sample_rate=record.sample_rate, channels=record.channels, clock=record.clock)
        found.append(squares(measure_transfer(noisy, inputs=names, drop=3), system, phases).mean())
    assert np.mean(found) == pytest.approx(1.0, abs=0.2)


def test_several_records_are_one():
    system, phases = mathieu(), 20
    parts = [shaken(system, phases, 32, 5, 0.05, seed)[1] for seed in (0, 0)]
    found = measure_transfer(parts, inputs=["F0"], drop=2)
    alone = measure_transfer(parts[0], inputs=["F0"], drop=2)
    ratio = np.nanmean(np.abs(alone.transfer.std) ** 2) / np.nanmean(np.abs(found.transfer.std) ** 2)
    assert ratio == pytest.approx(2.0, rel=0.3)


def test_a_scan_is_a_record_a_line():
    system, phases, turns = mathieu(), 20, 16
    angle = 2.0 * np.pi * np.arange(turns * phases) / (turns * phases)
    lines, records = [3, 5, 11, 5 + turns, 27], []
    for line in lines:  # 5 and 5 + J would meet in one record
        once = np.cos(line * angle + 0.3 * line)
        values, inputs = record_of(system, None, phases, 0.01, line, np.tile(once, 6)[None])
        both = np.concatenate([values, inputs])
        records.append(Record(values=both, sample_rate=phases / np.pi, channels=["y", "F"]))
    found = measure_transfer(records, period=np.pi, inputs=["F"], drop=3, harmonics=HARMONICS)
    assert found.transfer.frequencies_hz == pytest.approx(np.sort(lines) / (turns * np.pi))
    assert squares(found, system, phases).mean() == pytest.approx(1.0, abs=0.6)
    truth = system.sampled_transfer(found.transfer.frequencies_hz, HARMONICS, phases)
    assert np.abs(found.transfer.values - truth).max() < 0.02 * np.abs(truth).max()


def cubic(phases, design: Multisine, repeats, stiffness):
    """x'' + 0.2 x' + (2 - cos 2t) x + k x³ = u by Runge and Kutta's steps, u held."""
    step, inner = np.pi / phases, 8
    h, state, found = step / inner, np.zeros(2), []

    def rates(t, x, u):
        return np.array([x[1], u - 0.2 * x[1] - (2.0 - np.cos(2.0 * t)) * x[0] - stiffness * x[0] ** 3])

    for number, u in enumerate(np.tile(design.values[0], repeats).tolist()):
        found.append(state[0])
        for part in range(inner):
            t = number * step + part * h
            k1 = rates(t, state, u)
            k2 = rates(t + 0.5 * h, state + 0.5 * h * k1, u)
            k3 = rates(t + 0.5 * h, state + 0.5 * h * k2, u)
            state = state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + rates(t + h, state + h * k3, u))
    return np.array(found)


@pytest.mark.slow
@pytest.mark.parametrize(("stiffness", "seen"), [(0.0, False), (0.3, True)])
def test_what_is_not_linear_is_seen(stiffness, seen):
    design = multisine(np.pi, 20.0 / np.pi, turns=32, seed=3)
    values = cubic(20, design, 5, stiffness)
    values += 0.02 * values.std() * np.random.default_rng(0).standard_normal(len(values))
    played = design.record(5, ["F"])
    record = Record(
        values=np.concatenate([values[None], played.values]),
        sample_rate=played.sample_rate,
        channels=["x", "F"],
        clock=played.clock,
    )
    found = measure_transfer(record, inputs=["F"], drop=1)
    assert np.isfinite(found.nonlinear[0])
    assert (found.nonlinear[0] > 2.0) == seen
    assert any("not linear at this force" in words for words in found.warnings) == seen


@pytest.mark.parametrize(("drop", "seen"), [(0, True), (1, False)])
def test_a_transient_that_is_alive_is_seen(drop, seen):
    found = measured(mathieu(), 20, 32, 4, 0.02, 5, drop=drop)
    assert any("The transient is not over" in words for words in found.warnings) == seen
    assert not any("not linear at this force" in words for words in found.warnings)
    assert np.isnan(found.nonlinear).all() == seen


def test_what_rings_on_for_repeats_is_no_noise():
    """By the third repeat, too, what rings at the resonance is many times the noise."""
    system, phases, turns = mathieu(damping=0.01), 20, 32
    (_, record, names), (_, clean, _) = (shaken(system, phases, turns, 5, noise, 5) for noise in (0.01, 0.0))
    found = measure_transfer(record, inputs=names)
    std = (record.values - clean.values)[0].std()
    over = found.noise[0] / (2.0 * std / np.sqrt(turns * phases))
    assert 0.6 < over.min() < over.max() < 2.0
    assert 0.85 < np.sqrt(np.mean(over**2)) < 1.25


@pytest.mark.slow
def test_g_of_samples_of_a_model_is_what_is_measured():
    system, phases = mathieu(direct=0.3), 20
    _, record, names = shaken(system, phases, 16, 5, 1e-4, 1)
    found = measure_transfer(record, inputs=names, drop=3).transfer
    model = identify(record, inputs=names, validate=False)
    own = model.transfer(found.frequencies_hz, found.harmonics, sampled=True)
    assert own.step == found.step
    assert np.abs(own.values - found.values).max() < 1e-3 * np.abs(own.values).max()
    # The hold forgotten is seen.
    other = model.transfer(found.frequencies_hz, found.harmonics)
    assert np.abs(other.values - found.values).max() > 0.02 * np.abs(own.values).max()


def test_lines_that_meet_are_refused():
    system, phases, count = mathieu(), 20, 32 * 20
    angle = 2.0 * np.pi * np.arange(count) / count
    once = np.cos(9 * angle) + np.cos((9 + 32) * angle + 1.0)
    values, inputs = record_of(system, None, phases, 0.01, 0, np.tile(once, 4)[None])
    record = Record(values=np.concatenate([values, inputs]), sample_rate=20.0 / np.pi, channels=["y", "F"])
    with pytest.raises(IdentificationError, match="multiple of the fundamental apart"):
        measure_transfer(record, period=np.pi, inputs=["F"])


def test_too_few_repeats_are_refused():
    _, record, names = shaken(mathieu(), 20, 32, 3, 0.01, 0)
    with pytest.raises(IdentificationError, match="two at least"):
        measure_transfer(record, inputs=names, drop=2)


@pytest.mark.parametrize(
    ("words", "message"),
    [({"drop": -1}, "drop"), ({"repeat": 1}, "repeat"), ({"method": "lines"}, "method"), ({"inputs": []}, "inputs")],
)
def test_slips_are_named(words, message):
    _, record, names = shaken(mathieu(), 20, 16, 3, 0.01, 0)
    with pytest.raises(InputError, match=message):
        measure_transfer(record, **{"inputs": names, **words})
