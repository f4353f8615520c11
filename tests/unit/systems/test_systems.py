"""The example rotor: its equations against independent ones, and the record that it simulates."""

import subprocess
import sys

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from floquid import floquet
from floquid.core import ConstantPeriod
from floquid.errors import InputError
from floquid.systems import SYSTEMS, JeffcottRotor
from floquid.testing import assert_exponents_close

ODD = JeffcottRotor(rotor_x=0.8, rotor_y=1.7, support_x=1.3, support_y=2.2, damping=0.03, speed=0.7)


def springs(rotor, t):
    """K_R' and K_F written out, independently of the class."""
    c, s = np.cos(rotor.speed * t), np.sin(rotor.speed * t)
    turn = np.array([[c, s], [-s, c]])
    return turn.T @ np.diag([rotor.rotor_x, rotor.rotor_y]) @ turn, np.diag([rotor.support_x, rotor.support_y])


def integrated(rotor, times, initial, damping):
    """X, Y, X_tt, Y_tt of the full equations in one run, from the compliances in series and the force balance."""

    def derivative(t, x):
        turning, fixed = springs(rotor, t)
        series = np.linalg.inv(np.linalg.inv(turning) + np.linalg.inv(fixed))
        return np.concatenate([x[2:], -series @ x[:2] - damping @ x[2:]])

    run = solve_ivp(derivative, (times[0], times[-1]), initial, "RK45", rtol=1e-10, atol=1e-12, dense_output=True)
    states = run.sol(times)
    out = np.empty((4, len(times)))
    for k, t in enumerate(times):
        turning, fixed = springs(rotor, t)
        out[:2, k] = states[:2, k]
        out[2:, k] = np.linalg.solve(turning + fixed, turning @ states[:2, k])
    return out


@pytest.mark.first(2)
@pytest.mark.parametrize("form", ["identity", "support"])
@pytest.mark.parametrize("first_phase", [0.0, 0.37])
def test_simulation_solves_the_full_equations(form, first_phase):
    rotor = JeffcottRotor(
        rotor_x=0.8, rotor_y=1.7, support_x=1.3, support_y=2.2, damping=0.03, speed=0.7, damping_form=form
    )
    record = rotor.simulate(n_periods=6, samples_per_period=20, noise=0.0, impulse_deg=30.0, first_phase=first_phase)
    damping = 0.03 * (np.diag([1.3, 2.2]) if form == "support" else np.eye(2))
    initial = np.array([0.0, 0.0, np.cos(np.pi / 6), np.sin(np.pi / 6)])
    assert record.values == pytest.approx(integrated(rotor, record.times, initial, damping), abs=2e-7)


def test_simulation_of_many_periods_agrees_with_the_modes():
    """Period 1000 of 1024, from the multipliers of the monodromy matrix raised to that power."""
    rotor = JeffcottRotor(damping=0.0005)
    record = rotor.simulate(n_periods=1001, samples_per_period=8, noise=0.0)
    late = record.times[8000:] - 1000 * rotor.period
    values, vectors = np.linalg.eig(floquet.monodromy(rotor.system, rotor.period))
    state = (vectors * values**1000) @ np.linalg.solve(vectors, np.array([0.0, 0.0, 1.0, 1.0]) / np.sqrt(2.0))
    expected = rotor.outputs(late) @ floquet.transition(rotor.system, rotor.period, late + 1e-12) @ state
    assert record.values[:, 8000:] == pytest.approx(expected.T.real, abs=1e-9)
    assert np.abs(expected).max() > 0.05


def test_record_of_a_simulation():
    record = JeffcottRotor().simulate(n_periods=3, samples_per_period=50, seed=4, first_phase=0.25)
    assert [channel.name for channel in record.channels] == ["X", "Y", "X_tt", "Y_tt"]
    assert {(channel.quantity, channel.unit) for channel in record.channels} == {("displacement", "-")}
    assert record.values.shape == (4, 150)
    assert record.sample_rate == 50 / JeffcottRotor().period
    assert record.start == 0.25 * JeffcottRotor().period
    assert record.clock == ConstantPeriod(period=JeffcottRotor().period, origin=0.0)
    (words,) = record.provenance.sources
    for word in ("JeffcottRotor(", "45 deg", "phase 0.25", "3 periods of 50 samples", "noise 2 %", "seed 4"):
        assert word in words


def test_defaults_are_the_paper_experiment():
    record = JeffcottRotor().simulate()
    assert record.values.shape == (4, 51200)
    assert 1.0 / record.sample_rate == pytest.approx(0.1256637, abs=5e-8)


def test_noise_is_white_and_a_fraction_of_the_largest_response_of_each_channel():
    rotor, n_samples = JeffcottRotor(), 400 * 50
    clean = rotor.simulate(n_periods=400, noise=0.0).values
    noise = (rotor.simulate(n_periods=400, noise=0.05, seed=2).values - clean) / np.abs(clean).max(axis=1)[:, None]
    assert noise.std(axis=1) == pytest.approx(np.full(4, 0.05), rel=5.0 / np.sqrt(2 * n_samples))
    assert np.abs(noise.mean(axis=1)).max() < 5.0 * 0.05 / np.sqrt(n_samples)
    correlation = np.corrcoef(np.vstack([noise, np.roll(noise, 1, axis=1), np.roll(noise, 50, axis=1)]))
    assert np.abs(correlation - np.eye(12)).max() < 5.0 / np.sqrt(n_samples)


def test_seed_decides_the_noise():
    rotor = JeffcottRotor()
    first, again, other = (rotor.simulate(n_periods=4, seed=seed).values for seed in (1, 1, 2))
    assert (first == again).all()
    assert (first != other).mean() > 0.99


def test_turntable_system_has_the_exponents_of_the_mass():
    found = floquet.exponents(ODD.turntable_system, ODD.period)
    assert_exponents_close(found, ODD.exponents(), ODD.period, atol=1e-11)


def test_turntable_system_rules_the_simulated_turntable():
    """u_tt'' by central differences of eighth order of the simulated outputs, no state of the mass in sight."""
    record = ODD.simulate(n_periods=3, samples_per_period=200, noise=0.0)
    u, step = record.values[2:], 1.0 / record.sample_rate
    first = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280]) / step
    second = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560]) / step**2
    rate, acceleration = (np.stack([np.correlate(row, w, "valid") for row in u]) for w in (first, second))
    state = np.concatenate([u[:, 4:-4], rate])
    predicted = np.einsum("tij,jt->it", ODD.turntable_system(record.times[4:-4]), state)
    assert predicted[:2] == pytest.approx(rate, abs=1e-12)
    assert predicted[2:] == pytest.approx(acceleration, abs=1e-7)


def test_matrices_are_stacks_over_any_times():
    t = np.linspace(0.0, 5.0, 6).reshape(2, 3)
    for function, n in ((ODD.stiffness, 2), (ODD.system, 4), (ODD.outputs, 4), (ODD.turntable_system, 4)):
        stack = function(t)
        assert stack.shape == (2, 3, n, n)
        assert stack[1, 2] == pytest.approx(function(5.0), abs=1e-14)
        assert function(t + ODD.period) == pytest.approx(stack, abs=1e-13)
    assert ODD.frozen_frequencies(t).shape == (2, 3, 2)
    assert ODD.frozen_frequencies(0.0) == pytest.approx(sorted([(0.8 * 1.3 / 2.1) ** 0.5, (1.7 * 2.2 / 3.9) ** 0.5]))


def test_state_matrix_blocks():
    a = ODD.system(0.4)
    turning, fixed = springs(ODD, 0.4)
    assert a[:2] == pytest.approx(np.hstack([np.zeros((2, 2)), np.eye(2)]))
    assert a[2:, :2] == pytest.approx(-np.linalg.inv(np.linalg.inv(turning) + np.linalg.inv(fixed)), abs=1e-14)
    assert a[2:, 2:] == pytest.approx(-0.03 * np.eye(2))


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"rotor_x": 0.0}, "`rotor_x` of `JeffcottRotor` must be positive"),
        ({"support_y": -1.0}, "`support_y` of `JeffcottRotor` must be positive"),
        ({"speed": np.nan}, "`speed` of `JeffcottRotor` must be a finite number"),
        ({"damping": -0.1}, "`damping` of `JeffcottRotor` must not be negative, but is -0.1"),
        ({"damping_form": "rayleigh"}, '`damping_form` of `JeffcottRotor` must be "identity" or "support"'),
    ],
)
def test_wrong_rotors_are_refused(keywords, message):
    with pytest.raises(InputError, match=message):
        JeffcottRotor(**keywords)


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"n_periods": 0}, "`n_periods` of `JeffcottRotor.simulate` must be an integer of at least 1"),
        ({"samples_per_period": 2.5}, "`samples_per_period` of .* must be an integer"),
        ({"noise": -0.1}, "`noise` of .* must not be negative"),
        ({"seed": -1}, "`seed` of .* must be an integer of at least 0"),
        ({"seed": None}, "`seed` of .* must be an integer of at least 0"),
        ({"impulse_deg": np.inf}, "`impulse_deg` of .* must be a finite number"),
        ({"first_phase": 1.0}, r"`first_phase` of .* must lie in \[0, 1\)"),
    ],
)
def test_wrong_simulations_are_refused(keywords, message):
    with pytest.raises(InputError, match=message):
        JeffcottRotor().simulate(**keywords)


def test_overflow_of_an_unstable_rotor_is_refused():
    with pytest.raises(InputError, match="must end before the response overflows"):
        JeffcottRotor(support_x=0.01, support_y=2.0, rotor_y=100.0, speed=1.0, damping=0.0).simulate(
            n_periods=20000, samples_per_period=2, noise=0.0
        )


def test_registry_names_the_systems():
    assert SYSTEMS["jeffcott"] is JeffcottRotor


def test_import_is_light():
    """SciPy is loaded by the first integration, not by the import: it costs seconds on a slow machine."""
    code = "import sys, floquid.systems, floquid.floquet, floquid.testing; sys.exit('scipy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
