"""The benchmark in small: motions are those of the equations, truths those of the oracle, the judge finds fault."""

import json
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.simulators import others, run, turbines, walker
from benchmarks.simulators.__main__ import main
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

from floquid import floquet


@pytest.mark.parametrize("make", [others.strip, others.converter, others.cracked, turbines.two_blades])
def test_modes_make_up_the_response(make):
    machine = make()
    start = machine.blow * np.random.default_rng(0).standard_normal(len(machine.blow))
    modes, times = machine.modes(start), machine.period * np.arange(machine.phases * 3) / machine.phases
    shapes = np.exp(1j * machine.fundamental * np.multiply.outer(modes.harmonics, times))
    whole = np.einsum("mch,ht,mt->ct", modes.coefficients, shapes, np.exp(np.multiply.outer(modes.exponents, times)))
    free = machine.free(start)[:, : len(times)]
    assert_allclose(2.0 * whole.real, free, atol=1e-9 * np.abs(free).max())


@pytest.fixture(scope="module")
def gait():
    return walker.gait()


def test_the_walker_comes_back_and_angular_momentum_about_the_foot_that_lands_is_kept(gait):
    state, period = gait
    after = solve_ivp(walker.rates, (0.0, period), state, method="DOP853", rtol=1e-11, atol=1e-13).y[:, -1]
    assert abs(walker.landing(0.0, after)) < 1e-8
    assert_allclose(walker.stepped_over(after), state, atol=1e-7)

    def momentum(x, feet):
        (stand, swing), (fast, slow) = x[:2], x[2:]
        hip, pace = walker.LENGTH * np.array([-np.sin(stand), np.cos(stand)]), walker.LENGTH * fast
        pace = pace * np.array([-np.cos(stand), -np.sin(stand)])
        lower = walker.BELOW / walker.LENGTH
        leg = hip + walker.ABOVE * np.array([np.sin(swing), -np.cos(swing)])
        leg_pace = pace + walker.ABOVE * slow * np.array([np.cos(swing), np.sin(swing)])
        foot = hip + walker.LENGTH * np.array([np.sin(swing), -np.cos(swing)]) if feet == "swing" else np.zeros(2)
        parts = (walker.LEG, lower * hip, lower * pace), (walker.HIP, hip, pace), (walker.LEG, leg, leg_pace)
        return sum(m * np.linalg.det(np.array([place - foot, rate])) for m, place, rate in parts)

    assert_allclose(momentum(walker.stepped_over(after), "stand"), momentum(after, "swing"), rtol=1e-9)


def test_energy_of_the_walker_is_kept_between_contacts(gait):
    state, period = gait
    path = solve_ivp(walker.rates, (0.0, 0.9 * period), state, method="DOP853", rtol=1e-11, atol=1e-13).y

    def energy(x):
        coupling = walker.LEG * walker.LENGTH * walker.ABOVE
        inertia = walker.HIP * walker.LENGTH**2 + walker.LEG * (walker.BELOW**2 + walker.LENGTH**2)
        motion = 0.5 * inertia * x[2] ** 2 + 0.5 * walker.LEG * walker.ABOVE**2 * x[3] ** 2
        motion -= coupling * np.cos(x[0] - x[1]) * x[2] * x[3]
        weight = walker.HIP * walker.LENGTH + walker.LEG * (walker.BELOW + walker.LENGTH)
        return motion + walker.GRAVITY * (weight * np.cos(x[0]) - walker.LEG * walker.ABOVE * np.cos(x[1]))

    assert_allclose(energy(path[:, -1]), energy(state), rtol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("make", [turbines.gravity, walker.walker])
def test_small_motions_about_an_orbit_are_those_of_the_transitions(make):
    machine = make()
    start = 0.1 * machine.blow * np.random.default_rng(0).standard_normal(len(machine.blow))
    whole, linear = machine.free(start), replace(machine, motion=None).free(start)
    assert np.abs(whole - linear).max() < 1e-3 * np.abs(linear).max()
    assert np.abs(machine.free(0.0 * start)).max() < 1e-2 * np.abs(linear).max()


def test_a_wrong_model_is_called_false(monkeypatch):
    honest, identify = [], run.floquid.identify

    def kept(*arguments, **options):
        honest.append(identify(*arguments, **options))
        return honest[-1]

    monkeypatch.setattr(run.floquid, "identify", kept)
    right = run.judged("strip", 0.01, 0)
    assert (right.outcome, right.found, right.must, right.false) == ("passed", 8, 8, 0)

    def shifted(*_, **__):
        found = honest[0]
        off = found.model.exponents - 0.1 * found.model.fundamental
        return replace(found, model=replace(found.model, exponents=off, estimates=None))

    monkeypatch.setattr(run.floquid, "identify", shifted)
    wrong = run.judged("strip", 0.01, 0)
    assert wrong.found == 0
    assert wrong.false == 8


@pytest.mark.slow
@pytest.mark.skipif(not turbines.LINEARISED.is_dir(), reason="the linearisations are not here")
@pytest.mark.parametrize("seed", [0, 1])
def test_modes_beside_those_that_are_gone_within_a_period_are_found(seed):
    row = run.judged("soft_blade", 0.01, seed)
    assert row.outcome == "passed"
    assert row.found >= 5  # two of the seven are nearer to each other than a fifth of their decay
    assert row.false == 0


def test_two_exponents_for_one_mode_are_one_too_many():
    truth, std = np.array([-1.0 + 2.0j, -1.0 - 2.0j]), np.full(3, 0.01 + 0.01j)
    twice = np.append(truth, -1.001 + 2.001j)
    assert run.false_of(truth, twice, std, 20.0) == 1
    assert run.false_of(truth, truth + 20.0j, std[:2], 20.0) == 0


@pytest.mark.slow
def test_the_command_writes_a_row_a_draw(tmp_path, capsys):
    out = tmp_path / "new" / "rows.json"
    assert main(["--draws", "1", "--only", "strip", "--noise", "0.01", "--out", str(out)]) == 0
    assert "| strip | 1.0% | 1 | 0 | 0 | 1 | 8 (8) | 8 of 8 | 0 |" in capsys.readouterr().out
    assert [row["machine"] for row in json.loads(out.read_text())] == ["strip"]


@pytest.mark.skipif(not turbines.LINEARISED.is_dir(), reason="the linearisations are not here")
def test_the_soft_blade_without_softness_has_the_exponents_of_the_oracle(monkeypatch):
    monkeypatch.setattr(turbines, "SOFT", 1.0)
    orders, parts = floquet.read_openfast(str(turbines.LINEARISED)).harmonics()
    soft = turbines.soft_blade.__wrapped__()
    matrix = floquet.HarmonicMatrix(coefficients=parts, harmonics=orders, period=soft.period)
    assert_allclose(np.sort(soft.exponents.real), np.sort(floquet.exponents(matrix).real), rtol=1e-4)
