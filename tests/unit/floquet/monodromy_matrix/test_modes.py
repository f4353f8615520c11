"""The modes of a known A(t): branches, shapes, participation, defective cases, the Floquet-Lyapunov transform."""

import numpy as np
import pytest
from benchmarks.truth import system_with_exponents
from scipy.special import mathieu_a

from floquid import floquet
from floquid.errors import InputError
from floquid.floquet import ModesOutcome
from floquid.floquet.monodromy_matrix import _periodic_schur
from floquid.systems import JeffcottRotor

PERIOD = 2.0 * np.pi


def residual(modes, system, times):
    """Return p' + λp - A p (modes, states, times), by the coefficients and the equation."""
    waves = np.exp(1j * modes.fundamental * np.outer(modes.harmonics, times))
    p = modes.coefficients @ waves
    rate = modes.coefficients @ (1j * modes.fundamental * modes.harmonics[:, None] * waves)
    a = np.stack([np.asarray(system(t)) for t in times])
    return rate + modes.exponents[:, None, None] * p - np.einsum("tij,rjt->rit", a, p)


def test_rotor_is_on_the_branches_of_its_natural_frequencies():
    modes = floquet.modes(JeffcottRotor().system, PERIOD)
    expected = -0.002 + 1j * np.array([-0.8696643, 0.8696643, -0.7406064, 0.7406064])
    assert modes.exponents == pytest.approx(expected, abs=6e-8)
    assert modes.principal() == pytest.approx(floquet.exponents(JeffcottRotor().system, PERIOD), abs=1e-13)
    assert modes.outcome is ModesOutcome.FULL
    assert modes.mean_trace == pytest.approx(-0.008, abs=1e-15)
    assert modes.growth == pytest.approx(-0.002, abs=1e-9)
    assert modes.frequencies_hz == pytest.approx(np.abs(expected) / (2 * np.pi), rel=1e-7)
    assert modes.damping_ratios == pytest.approx(0.002 / np.abs(expected), rel=1e-6)


def test_conjugates_mirror_each_other():
    modes = floquet.modes(JeffcottRotor().system, PERIOD)
    assert modes.exponents[0] == pytest.approx(modes.exponents[1].conj(), abs=1e-14)
    assert modes.coefficients[0] == pytest.approx(modes.coefficients[1][:, ::-1].conj(), abs=1e-12)


def test_the_strongest_state_of_the_strongest_harmonic_is_one():
    modes = floquet.modes(JeffcottRotor().system, PERIOD)
    middle = len(modes.harmonics) // 2
    for coefficients, exponent in zip(modes.coefficients, modes.exponents, strict=True):
        weighed = np.abs(coefficients[:, middle]) * [0.87, 0.87, 1.0, 1.0]  # a velocity over its frequency
        assert coefficients[weighed.argmax(), middle] == pytest.approx(1.0, abs=1e-14)
        assert weighed.argmax() % 2 == (0 if abs(exponent.imag) < 0.8 else 1)
    assert modes.participation.sum(axis=1) == pytest.approx(np.ones(4), abs=1e-14)
    assert (modes.participation.argmax(axis=1) == middle).all()


@pytest.mark.parametrize("power", [-40, 30])
def test_units_change_nothing_but_the_shapes_units(power):
    rotor, scale = JeffcottRotor(), np.array([2.0**power, 1.0, 2.0**power, 1.0])
    plain = floquet.modes(rotor.system, PERIOD)
    scaled = floquet.modes(lambda t: scale[:, None] * rotor.system(t) / scale, PERIOD)
    assert scaled.exponents == pytest.approx(plain.exponents, abs=1e-12)
    assert scaled.participation == pytest.approx(plain.participation, abs=1e-10)
    assert scaled.condition == pytest.approx(plain.condition, rel=1e-8)
    found = scaled.coefficients / scale[:, None]
    ratio = found[:, :1, 31:32] / plain.coefficients[:, :1, 31:32]
    assert found / ratio == pytest.approx(plain.coefficients, abs=1e-9)


def test_real_negative_multipliers_are_on_the_upper_edge():
    truth = np.array([-0.3 + 0.5j, -0.7 + 0.5j])
    modes = floquet.modes(system_with_exponents(truth, PERIOD, seed=4))
    assert modes.exponents == pytest.approx(truth, abs=1e-12)


def test_multiple_exponents_with_shapes_of_their_own_are_not_defective():
    modes = floquet.modes(lambda t: -np.eye(3) * (1.0 + np.cos(t)), PERIOD)
    assert modes.exponents == pytest.approx([-1.0] * 3, abs=1e-13)
    assert modes.defective == ()
    assert modes.condition == pytest.approx([1.0] * 3)


@pytest.mark.parametrize(
    "system",
    [
        lambda t: [[-0.1, 1.0 + np.cos(t)], [0.0, -0.1]],
        lambda t: [[0.0, 1.0], [2 * 0.3 * np.cos(t) / 4.0 - mathieu_a(2, 0.3) / 4.0, 0.0]],
    ],
    ids=["Jordan block", "Mathieu's equation on a characteristic curve"],
)
def test_defective_systems_are_said_to_be(system):
    modes = floquet.modes(system, PERIOD)
    assert modes.defective == ((0, 1),)
    assert modes.outcome is ModesOutcome.DEFECTIVE
    assert "lyapunov" in modes.outcome.value
    assert modes.exponents.mean().real == pytest.approx(np.trace(system(0.0)) / 2.0, abs=1e-12)


def test_a_close_pair_is_no_defective_one():
    modes = floquet.modes(lambda t: [[0.0, 1.0], [-4.0 - 0.2 * np.cos(t), -0.005]], PERIOD)
    assert modes.defective == ()
    # Two states apart by 1e-5, coupled ten thousand times as strongly: ill conditioned, and yet told apart.
    modes = floquet.modes(lambda t: [[-0.1, 1.0 + np.cos(t)], [0.0, -0.10001]], PERIOD)
    assert modes.condition.max() > 1e3
    assert modes.defective == ()
    assert np.sort(modes.exponents.real) == pytest.approx([-0.10001, -0.1], abs=1e-9)


def test_a_defective_pair_beside_other_modes_is_found_by_its_indices():
    a = np.zeros((4, 4))
    a[:2, :2] = [[-0.1, 1.0], [0.0, -0.1]]
    a[2:, 2:] = [[-0.3, 0.2], [-0.2, -0.3]]
    turn = np.linalg.qr(np.random.default_rng(0).standard_normal((4, 4)))[0]
    modes = floquet.modes((turn @ a @ turn.T)[:, :, None], PERIOD)
    assert modes.defective == ((0, 1),)
    assert np.abs(modes.exponents[[0, 1]] + 0.1).max() < 1e-5
    assert modes.exponents[[2, 3]] == pytest.approx([-0.3 + 0.2j, -0.3 - 0.2j], abs=1e-12)


def test_shapes_with_jumps_in_their_slope_solve_the_equation_between_the_jumps():
    edges = [0.0, 2.0]
    system = floquet.PiecewiseMatrix(
        values=np.moveaxis([[[0.0, 1.0], [-0.8, -0.1]], [[0.0, 1.0], [-1.4, -0.1]]], 0, 2), edges=edges, period=PERIOD
    )
    modes = floquet.modes(system, n_phases=512)
    # The second derivative jumps, so the coefficients fall as 1/m² and a derivative is right to about 1/512.
    assert np.abs(residual(modes, system, np.array([1.0, 4.0]))).max() < 0.01
    assert residual(modes, system, np.array([1.0, 4.0]))[:, 0] == pytest.approx(0.0, abs=1e-4)
    assert floquet.modes(system).exponents == pytest.approx(modes.exponents, abs=1e-12)


def test_few_phases_may_be_asked_for():
    modes = floquet.modes(JeffcottRotor().system, PERIOD, n_phases=8)
    assert modes.harmonics.tolist() == [-3, -2, -1, 0, 1, 2, 3]
    with pytest.raises(InputError, match=r"`n_phases` of `floquet.modes` must be an integer of at least 8"):
        floquet.modes(JeffcottRotor().system, PERIOD, n_phases=4)


@pytest.mark.parametrize("call", [floquet.exponents, floquet.modes, floquet.floquet_lyapunov])
def test_exponents_that_miss_the_mean_trace_are_refused(call, monkeypatch):
    """As if the eigenvalue solver had lost one."""
    whole, carried = _periodic_schur.logarithms, _periodic_schur.modes

    def lost(form):
        return whole(form) + np.array([0.0, 1e-3])

    monkeypatch.setattr(_periodic_schur, "logarithms", lost)
    monkeypatch.setattr(_periodic_schur, "modes", lambda form: carried(form)._replace(logarithms=lost(form)))
    with pytest.raises(InputError, match=r"where the mean trace of A"):
        call(lambda t: [[-0.1, 1.0], [-1.0 - np.cos(t), -0.1]], PERIOD)


def test_lyapunov_transform_of_a_defective_system():
    def system(t):
        return np.array([[-0.1, 1.0 + np.cos(t)], [0.0, -0.1]])

    found = floquet.floquet_lyapunov(system, PERIOD, n_phases=16)
    assert found.constant @ found.constant + 0.2 * found.constant == pytest.approx(-0.01 * np.eye(2), abs=1e-13)
    assert np.abs(found.constant + 0.1 * np.eye(2)).max() > 0.01
    assert found.times == pytest.approx(PERIOD * np.arange(16) / 16)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 1e-9])
def test_a_loose_tolerance_holds_for_the_small_multiplier_too(tolerance):
    """Colaneri's system: an error that is small beside the large directions of Φ alone would ruin the exponent -24."""
    found = floquet.exponents(lambda t: [[0, 1], [-10 * np.cos(t), -24 - 10 * np.sin(t)]], PERIOD, tolerance=tolerance)
    assert np.abs(found * PERIOD - [0.0, -48.0 * np.pi]).max() < 20 * tolerance


def test_a_burst_within_one_step_is_resolved():
    """The decay of a pulse 1/500 of the period wide, which no probe of the size of A(t) meets."""
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])

    def system(t):
        pulse = 80.0 * np.exp(-(((t % 1.0 - 0.51) / 0.002) ** 2)) / (0.002 * np.sqrt(np.pi))
        return turn @ np.diag([0.0, -pulse]) @ turn.T

    assert floquet.exponents(system, 1.0, breaks=[0.0]) == pytest.approx([0.0, -80.0], abs=1e-9)


@pytest.mark.parametrize("harmonic", [8, 16, 24, 32, 48])
def test_fast_harmonics_are_not_folded(harmonic):
    """The first 16 samples see a harmonic of 16 as a constant."""
    found = floquet.exponents(lambda t: [[np.cos(harmonic * t) - 0.3, 1.0], [0.0, -1.0]], PERIOD)
    assert found == pytest.approx([-0.3, -1.0], abs=1e-12)


def test_harmonics_just_above_half_the_samples_are_seen_though_the_probes_miss_them():
    offset = 0.381966
    phases = PERIOD * np.array([offset, 0.5 * offset])

    def system(t):
        return [[0.01 * np.sin(9 * (t - phases[0])) * np.sin(t - phases[1]) - 0.3, 1.0], [-1.0, 0.0]]

    exact = np.linalg.eigvals(floquet.monodromy(system, PERIOD, breaks=[0.0]))
    assert np.poly(floquet.multipliers(system, PERIOD)) == pytest.approx(np.poly(exact), abs=1e-11)


@pytest.mark.parametrize("n_nodes", [2, 3, 4])
def test_collocation_has_its_order(n_nodes):
    """The error over an interval falls as its width to the power 2s + 1."""
    from floquid.floquet.monodromy_matrix import gauss
    from floquid.floquet.monodromy_matrix._collocation import collocate

    def a(t):
        return np.array([[0.2, 1.0], [-1.0 - 0.5 * np.cos(t), -0.1]])

    exact = []
    errors = []
    widths = np.array([0.8, 0.4, 0.2])
    for width in widths:
        exact = floquet.transition(a, PERIOD, [0.3 + width], start=0.3, tolerance=1e-14)[0]
        values = np.stack([a(0.3 + width * c) for c in gauss(n_nodes).nodes])[None]
        errors.append(np.abs(collocate(values, np.array([width]))[0] - exact).max())
    slope = np.polyfit(np.log(widths), np.log(errors), 1)[0]
    assert slope == pytest.approx(2 * n_nodes + 1, abs=0.35)


@pytest.mark.parametrize("begin", [0.07, 0.381, 0.9])
def test_a_short_pulse_that_nobody_named_is_seen(begin):
    """As of a blade that passes its tower: a fiftieth of the period."""

    def system(t):
        return [[0.0, 1.0], [-1.0, -0.1 + 2.0 * (begin < (t / PERIOD) % 1.0 < begin + 0.02)]]

    named = floquet.exponents(system, PERIOD, breaks=[begin * PERIOD, (begin + 0.02) * PERIOD])
    assert np.abs(named.real + 0.05).max() > 0.01
    assert floquet.exponents(system, PERIOD) == pytest.approx(named, abs=1e-10)


def test_what_must_be_seen_is_said_by_its_length():
    calls = []

    def system(t):
        calls.append(t)
        return np.array([[0.0, 1.0], [-1.0 - np.cos(t), -0.1]])

    exact = floquet.exponents(system, PERIOD)
    few, many = len(calls), 0
    for narrowest in (1.0 / 16.0, 1.0 / 1000.0):
        calls.clear()
        matrix = floquet.FunctionMatrix(function=system, period=PERIOD, narrowest=narrowest)
        assert floquet.exponents(matrix) == pytest.approx(exact, abs=1e-12)
        few, many = min(few, len(calls)), max(many, len(calls))
    assert few < 40
    assert 1000 <= many < 1100
    with pytest.raises(InputError, match=r"`narrowest` of `FunctionMatrix` must lie in \[1e-4, 1/8\]"):
        floquet.FunctionMatrix(function=system, period=PERIOD, narrowest=0.5)


def test_samples_with_the_end_repeated_are_refused():
    def samples(times):
        return np.stack([[[0.0, 1.0], [-2.0 - np.cos(t), -0.1]] for t in times], axis=-1)

    with pytest.raises(InputError, match=r"ends with its first sample again, the 65th"):
        floquet.exponents(samples(np.linspace(0.0, PERIOD, 65)), PERIOD)
    # Samples that are alike at both ends by their symmetry are no repetition.
    half = PERIOD / 32.0
    shifted = samples(np.arange(16) * PERIOD / 16.0 + half)
    assert shifted[..., 0] == pytest.approx(shifted[..., -1], abs=1e-15)
    plain = floquet.exponents(samples(np.arange(16) * PERIOD / 16.0), PERIOD)
    assert floquet.exponents(shifted, PERIOD) == pytest.approx(plain, abs=1e-11)


def test_a_wrong_period_of_a_small_entry_is_refused():
    with pytest.raises(InputError, match="must be a period of A"):
        floquet.exponents(lambda t: [[0.0, 1.0], [-1e8, -0.3 * (1.0 + 0.9 * np.cos(700.0 * t))]], PERIOD / 1e3)


def test_lyapunov_transform_of_a_double_multiplier_of_minus_one():
    """Rounding makes a complex pair of it."""
    a, q = mathieu_a(1, 0.7), 0.7
    found = floquet.floquet_lyapunov(lambda t: [[0.0, 1.0], [2 * q * np.cos(2 * t) - a, 0.0]], np.pi)
    assert found.period == pytest.approx(2 * np.pi)
    assert np.linalg.cond(found.transform).max() < 1e3
    assert np.abs(found.constant).max() < 10.0


def test_negative_multipliers_that_rounding_turns_stay_on_the_upper_edge():
    assert floquet.exponents(lambda t: [[0.0, 0.5], [-0.5, 0.0]], PERIOD).imag == pytest.approx([0.5, 0.5], abs=1e-9)


def test_a_multiplier_that_overflows_is_infinite():
    assert floquet.multipliers(np.array([[[800.0]]]), 1.0).tolist() == [np.inf]
    assert floquet.multipliers(np.array([[[-800.0]]]), 1.0).tolist() == [0.0]


@pytest.mark.parametrize(
    "call",
    [
        lambda: floquet.exponents([[[1], [2]], [[3]]], PERIOD),
        lambda: floquet.exponents(lambda t: [[1, 2], [3]], PERIOD),
        lambda: floquet.SampledMatrix(values=[[1, 2], [3]], period=1.0),
        lambda: floquet.stability_map(lambda t, p: [[0, 1], [p]], 1.0, {"p": [0.0, 1.0]}),
    ],
)
def test_rows_of_unequal_length_are_refused(call):
    with pytest.raises(InputError, match="but has rows of unequal length"):
        call()


def test_a_period_without_a_fundamental_is_refused():
    with pytest.raises(InputError, match=r"`period` of `floquet.exponents` must be long enough"):
        floquet.exponents(lambda t: np.eye(2), 1e-320)


def test_more_steps_than_can_be_taken_are_refused_at_once():
    with pytest.raises(InputError, match="must be integrable in 200000 steps"):
        floquet.exponents(np.array([[[-1e300]]]), 1.0)


@pytest.mark.parametrize("entry", [0.0, 4e-16])
def test_fast_harmonics_of_a_slow_system_are_integrated(entry):
    """The double integral of a force: an entry that is rounding makes units in which nothing seems to move."""
    times = np.array([1.3, 3.0])
    phi = floquet.transition(lambda t: [[0.0, entry], [np.cos(t) + 1e-5 * np.cos(40 * t), 0.0]], PERIOD, times)
    exact = np.sin(times) + 1e-5 * np.sin(40 * times) / 40
    assert phi[:, 1, 0] == pytest.approx(exact, abs=1e-12)
