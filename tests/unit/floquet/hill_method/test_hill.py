"""Hill's method and the Fourier coefficients it starts from.

Systems of the literature with the numbers printed or known exactly: Zhou and Hagiwara; Vinograd; Colaneri; Bittanti
and Colaneri; Mathieu and its damped forms; flapping of a rotor blade (see `tests/published` for the sources).
Meissner's equation is held against the product of two matrix exponentials.
"""

import numpy as np
import pytest
from numpy import cos, exp, pi, sin
from scipy.linalg import block_diag, expm
from scipy.special import iv, mathieu_a

import floquid.floquet
from floquid.errors import InputError
from floquid.floquet import FunctionMatrix, HarmonicMatrix, HillOutcome, PiecewiseMatrix, SampledMatrix, hill
from floquid.floquet.hill_method import block_toeplitz
from floquid.floquet.hill_method._eigenpairs import Problem, effect_of_edges, in_exponentials, real_hill, truncated
from floquid.floquet.matrices import fourier, reach
from floquid.testing import assert_exponents_close, pair_exponents

T = 2.3
W = 2 * pi / T


def function(f, breaks=(), period=T):
    return FunctionMatrix(function=f, period=period, breaks=breaks)


def test_smooth_function_has_the_coefficients_of_its_series():
    exact = iv(np.abs(np.arange(-40, 41)), 1.0)
    for breaks in ((), (0.3, 1.0)):
        found = fourier(function(lambda t: [[exp(cos(W * t))]], breaks), 40)[0, 0]
        assert np.abs(found - exact).max() < 2e-15


@pytest.mark.parametrize("breaks", [(), (0.2, 0.9)])
def test_square_wave_in_all_forms(breaks):
    pieces = fourier(PiecewiseMatrix(values=[[[1.0, -1.0]]], edges=[0.2, 0.9], period=T), 200)
    m = np.arange(1, 201)
    exact = (exp(-1j * m * W * 0.2) - exp(-1j * m * W * 0.9)) / (1j * m * pi)
    assert np.abs(pieces[0, 0, 201:] - exact).max() < 2e-15
    assert pieces[0, 0, 200] == pytest.approx(2 * 0.7 / T - 1, abs=1e-15)
    found = fourier(function(lambda t: [[1.0 if 0.2 <= t % T < 0.9 else -1.0]], breaks), 200)
    assert np.abs(found - pieces).max() < 5e-15


def test_kink_that_is_not_named_is_found():
    m = np.arange(-300, 301)
    found = fourier(function(lambda t: [[abs(sin(0.5 * W * t))]]), 300)[0, 0]
    assert np.abs(found - 2 / pi / (1 - 4 * m**2)).max() < 2e-15


def test_a_line_that_equal_samples_fold_is_not_missed():
    found = fourier(function(lambda t: [[cos(32 * W * t)]]), 32)[0, 0]
    assert found[[0, 64]] == pytest.approx([0.5, 0.5], abs=1e-14)
    assert np.abs(np.delete(found, [0, 64])).max() < 1e-15
    assert np.abs(fourier(function(lambda t: [[cos(32 * W * t)]]), 3)).max() < 1e-14  # 32 equal samples see one


@pytest.mark.parametrize("n_samples", [7, 8])
def test_samples_away_from_the_origin(n_samples):
    values = np.random.default_rng(0).normal(size=(2, 2, n_samples))
    matrix = SampledMatrix(values=values, period=T, times=0.1 + T * np.arange(n_samples) / n_samples)
    at = np.array([0.05, 0.5, 2.2])
    series = fourier(matrix, 5) @ np.exp(1j * W * np.multiply.outer(np.arange(-5, 6), at))
    assert np.abs(series - np.moveaxis(matrix.at(at), 0, 2)).max() < 1e-13


@pytest.mark.parametrize("interpolation", ["cubic", "linear"])
def test_spline_is_the_function_it_is(interpolation):
    values = np.random.default_rng(0).normal(size=(1, 2, 8))
    times = np.array([0.05, 0.1, 0.3, 0.8, 1.0, 1.3, 1.9, 2.0])
    matrix = SampledMatrix(values=values, period=T, times=times, interpolation=interpolation)
    fine = T * (np.arange(200_000) + 0.5) / 200_000
    waves = np.exp(-1j * W * np.multiply.outer(np.arange(-3, 4), fine)) / len(fine)
    assert np.abs(fourier(matrix, 3) - np.einsum("trc,ht->rch", matrix.at(fine), waves)).max() < 1e-9


def test_harmonics_are_cut_and_filled():
    matrix = HarmonicMatrix.from_cosines([[1.0]], [[[2.0, 4.0]]], [[[0.0, 6.0]]], period=T)
    assert fourier(matrix, 1)[0, 0].tolist() == [1.0, 1.0, 1.0]
    assert fourier(matrix, 3)[0, 0].tolist() == [0.0, 2.0 + 3.0j, 1.0, 1.0, 1.0, 2.0 - 3.0j, 0.0]


def test_noise_is_refused():
    noise = function(lambda t: [[sin(1e9 * t**2)]])
    with pytest.raises(InputError, match=r"smooth in pieces, but more than 4096 pieces"):
        fourier(noise, 3)


def test_real_form_is_similar_to_the_complex_one():
    generator, n, count = np.random.default_rng(0), 3, 4
    values = generator.normal(size=(n, n, 17)) + 1j * generator.normal(size=(n, n, 17))
    values = values + values[..., ::-1].conj()
    complex_form = block_toeplitz(values, count) - np.kron(np.diag(1.3j * np.arange(-count, count + 1)), np.eye(n))
    eigenvalues, vectors = np.linalg.eig(real_hill(values, count, 1.3))
    q = in_exponentials(vectors, n).transpose(2, 1, 0).reshape(-1, len(eigenvalues))
    assert np.linalg.norm(q, axis=0) == pytest.approx(np.ones(len(eigenvalues)))
    assert np.abs(complex_form @ q - q * eigenvalues).max() < 1e-12


def zhou_hagiwara(t):
    return [[-1 - sin(2 * t) ** 2, 2 - 0.5 * sin(4 * t)], [-2 - 0.5 * sin(4 * t), -1 - cos(2 * t) ** 2]]


def vinograd(t):
    s, c = sin(6 * t), cos(6 * t)
    return [[-1 - 9 * c**2 + 12 * s * c, 12 * c**2 + 9 * s * c], [-12 * s**2 + 9 * s * c, -1 - 9 * s**2 - 12 * s * c]]


def colaneri(t):
    return [[0, 1], [-10 * cos(t), -24 - 10 * sin(t)]]


def bittanti_colaneri(t):
    return [[-1 + sin(t), 0], [1 - cos(t), -3]]


def oscillator(stiffness, damping=lambda t: 0.0):
    return lambda t: [[0, 1], [-stiffness(t), -damping(t)]]


def mathieu(a, q):
    return oscillator(lambda t: a - 2 * q * cos(2 * t))


def flapping(gamma, mu):
    return oscillator(
        lambda t: 1 + gamma / 8 * (4 / 3 * mu * cos(t) + mu**2 * sin(2 * t)),
        lambda t: gamma / 8 * (1 + 4 / 3 * mu * sin(t)),
    )


HOVER = -0.375 + 1j * np.sqrt(1 - 0.375**2)
LITERATURE = {
    "Zhou and Hagiwara": (zhou_hagiwara, pi, [-1, -2], 2e-14),
    "Zhou and Hagiwara, half the period": (zhou_hagiwara, pi / 2, [-1 + 2j, -2 + 2j], 2e-14),
    "Vinograd": (vinograd, pi / 3, [2, -13], 1e-13),
    "Colaneri": (colaneri, 2 * pi, [0, -24], 2e-12),
    "Bittanti and Colaneri": (bittanti_colaneri, 2 * pi, [-1, -3], 2e-14),
    "Mathieu (1, 0.1)": (mathieu(1, 0.1), pi, [0.0499415702 + 1j, -0.0499415702 + 1j], 6e-11),
    "Mathieu (2, 0.5)": (mathieu(2, 0.5), pi, [0.6304914303j, -0.6304914303j], 6e-11),
    "Mathieu (3, 1)": (mathieu(3, 1), pi, [0.3284189108j, -0.3284189108j], 6e-11),
    "lossy Mathieu": (
        oscillator(lambda t: 0.5 * (1 - 0.4 * cos(2 * t)), lambda t: 0.1),
        pi,
        [-0.05 + 0.7124490252j, -0.05 - 0.7124490252j],
        6e-11,
    ),
    "near-degenerate": (
        oscillator(lambda t: 4 + 0.2 * cos(t), lambda t: 0.005),
        2 * pi,
        [-0.0025 + 3.351501e-4j, -0.0025 - 3.351501e-4j],
        6e-11,
    ),
    "flapping in hover": (flapping(6, 0.0), 2 * pi, [HOVER, HOVER.conjugate()], 2e-14),
    "flapping 6, 0.3": (flapping(6, 0.3), 2 * pi, [-0.375 + 0.0796775j, -0.375 - 0.0796775j], 6e-8),
    "flapping 12, 0.3": (flapping(12, 0.3), 2 * pi, [-0.8896271 + 0.5j, -0.6103729 + 0.5j], 6e-8),
}


@pytest.mark.parametrize("name", LITERATURE)
def test_literature(name):
    system, period, expected, atol = LITERATURE[name]
    found = hill(system, period)
    assert found.converged
    assert_exponents_close(found.exponents, expected, period, atol=atol)
    assert found.n_harmonics < 30


def meissner(zeta, q=0.1):
    first, second = ([[0.0, 1.0], [-(1 - 2 * q * sign), -2 * zeta]] for sign in (1, -1))
    monodromy = expm(np.array(second) * 2 * pi / 3) @ expm(np.array(first) * pi / 3)
    return np.stack([first, second], axis=2), np.log(np.linalg.eigvals(monodromy).astype(complex)) / pi


@pytest.mark.first(1)
@pytest.mark.parametrize(("zeta", "q"), [(0.0, 0.1), (0.2, 0.1), (0.1, 5.0)])
def test_jumps_do_not_cost_digits(zeta, q):
    """Plainly truncated, Meissner's exponents are good to 3e-9 at 60 harmonics."""
    values, exact = meissner(zeta, q)
    pieces = PiecewiseMatrix(values=values, edges=[0.0, pi / 3], period=pi)
    jumping = hill(lambda t: values[..., 0] if t % pi < pi / 3 else values[..., 1], pi, breaks=[0.0, pi / 3])
    for found in (hill(pieces), jumping):
        assert found.converged
        assert found.n_harmonics < 200
        assert_exponents_close(found.exponents, exact, pi, atol=10 * found.change.max() + 1e-13)


def test_jumps_settle_to_the_last_digits():
    values, exact = meissner(0.2)
    found = hill(PiecewiseMatrix(values=values, edges=[0.0, pi / 3], period=pi), tolerance=1e-13)
    assert found.change.max() < 2e-13
    assert_exponents_close(found.exponents, exact, pi, atol=5e-14)


@pytest.mark.slow
def test_shapes_of_a_system_that_jumps():
    """Shape times exponential is carried by the transition matrix of each piece."""
    values, _ = meissner(0.2)
    found = hill(PiecewiseMatrix(values=values, edges=[0.0, pi / 3], period=pi))
    start, end = (found.shapes([t])[..., 0] * np.exp(found.exponents * t)[:, None] for t in (0.2, 0.9))
    # The velocity's harmonics fall as 1/m², and those beyond the truncation are missing.
    assert np.abs(end - start @ expm(values[..., 0] * 0.7).T).max() < 3e-3
    long = hill(PiecewiseMatrix(values=values, edges=[0.0, pi / 3], period=pi), n_harmonics=200)
    start, end = (long.shapes([t])[..., 0] * np.exp(long.exponents * t)[:, None] for t in (0.2, 0.9))
    assert np.abs(end - start @ expm(values[..., 0] * 0.7).T).max() < 2e-5


@pytest.mark.parametrize("angle", [0.0, 0.7])
def test_swings_of_amplitude_do_not_cost_digits(angle):
    """Colaneri's second shape swings by e^20: in harmonics its exponent has a condition of 5e7."""
    turn = np.array([[cos(angle), -sin(angle)], [sin(angle), cos(angle)]])
    found = hill(lambda t: turn @ colaneri(t) @ turn.T, 2 * pi)
    assert found.converged
    assert found.exponents == pytest.approx(np.array([0.0, -24.0]), abs=1e-12)
    assert found.condition.max() < 10.0
    times = np.array([0.3, 1.0, 4.0])
    assert _equation_misses(found, lambda t: turn @ colaneri(t) @ turn.T, times) < 2e-8


def _equation_misses(found, system, times):
    """The largest |λp + p' - A p| of the shapes."""
    slopes = found.coefficients * (1j * found.fundamental * found.harmonics)
    waves = np.exp(1j * found.fundamental * np.multiply.outer(found.harmonics, times))
    shapes = found.shapes(times)
    a = np.stack([system(t) for t in times])
    missed = found.exponents[:, None, None] * shapes + slopes @ waves - np.einsum("tij,mjt->mit", a, shapes)
    return np.abs(missed).max()


def rotation(growth, speed):
    return np.array([[growth, speed], [-speed, growth]])


def hidden(R, seed, amplitude=0.2):
    """Return A = (P' + P R) P⁻¹ of period 2π with a random smooth P(t): its exponents are the eigenvalues of R."""
    generator, n = np.random.default_rng(seed), len(R)
    cosines, sines = amplitude / np.sqrt(n) * generator.normal(size=(2, 2, n, n))
    middle = np.linalg.qr(generator.normal(size=(n, n)))[0]
    m = np.array([1.0, 2.0])

    def system(t):
        p = middle + np.tensordot(cos(m * t), cosines, 1) + np.tensordot(sin(m * t), sines, 1)
        slope = np.tensordot(-m * sin(m * t), cosines, 1) + np.tensordot(m * cos(m * t), sines, 1)
        return np.linalg.solve(p.T, (slope + p @ R).T).T

    return system


HIDDEN = {
    "double real": np.diag([-0.3, -0.3, -1.0]),
    "double pair": block_diag(rotation(-0.1, 0.3), rotation(-0.1, 0.3)),
    "double pair modulo iω": block_diag(rotation(-0.1, 0.3), rotation(-0.1, 3.3)),
    "close pairs modulo iω": block_diag(rotation(-0.1, 0.3), rotation(-0.1, 3.3 + 1e-7), rotation(-0.1, 0.3 - 3e-5)),
    "undamped": block_diag(rotation(0, 0.3), rotation(0, 0.4), rotation(0, 2.2)),
    "two real negative multipliers": block_diag(rotation(-0.1, 2.5), rotation(-0.2, 0.5)),
    "all multipliers one": np.zeros((2, 2)),
    "pairs at multiples of ω": block_diag(rotation(-0.1, 1.0), rotation(-0.2, 2.0)),
    "seventeen revolutions up": block_diag(rotation(-0.1, 17.3), rotation(-0.2, 0.4)),
    "an odd number": block_diag(rotation(-0.1, 1.4), [[-0.7]]),
}


@pytest.mark.first(4)
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", HIDDEN)
def test_one_mode_of_each_family(name, seed):
    system = hidden(HIDDEN[name], seed)
    found = hill(system, 2 * pi)
    assert found.converged
    assert_exponents_close(found.exponents, np.linalg.eigvals(HIDDEN[name]), 2 * pi, atol=2e-13)
    assert (found.exponents.imag > -0.5).all()
    assert (found.exponents.imag <= 0.5).all()
    assert np.sort_complex(np.round(found.multipliers, 9)) == pytest.approx(
        np.sort_complex(np.round(found.multipliers.conj(), 9))
    )
    assert _equation_misses(found, system, np.array([0.3, 2.0])) < 1e-9
    energy = (np.abs(found.coefficients) ** 2).sum(axis=(1, 2))
    assert energy == pytest.approx(np.ones(found.exponents.size))


def test_conjugates_and_real_multipliers_are_exact():
    found = hill(hidden(HIDDEN["two real negative multipliers"], 0), 2 * pi)
    assert (found.exponents.imag == 0.5).all()
    assert (found.multipliers.imag == 0.0).all()
    assert (found.multipliers.real < 0.0).all()
    found = hill(hidden(HIDDEN["undamped"], 0), 2 * pi)
    assert (found.exponents[::2] == found.exponents[1::2].conj()).all()
    assert (found.exponents[::2].imag > 0).all()
    assert (found.coefficients[::2] == found.coefficients[1::2, :, ::-1].conj()).all()


@pytest.mark.parametrize(
    "R", [[[-0.3, 1.0, 0], [0, -0.3, 0], [0, 0, -1.0]], [[-0.3, 1.0, 0], [0, -0.3, 1.0], [0, 0, -0.3]]]
)
def test_defective_exponents_are_known_to_what_is_said(R):
    found = hill(hidden(np.array(R), 1), 2 * pi)
    assert found.outcome is HillOutcome.ROUNDED
    assert not found.converged
    off = np.abs(pair_exponents(found.exponents, np.diag(R), 2 * pi).differences)
    # As far as from each other, on any processor: how much they change from one truncation to the next is for chance.
    assert 1e-9 < found.change.max() < 1e-3
    assert off.max() < found.change.max()
    assert found.condition.max() > 1e6
    assert found.exponents.real.sum() == pytest.approx(np.trace(R), abs=1e-6)


def test_exactly_defective_exponents_are_not_one_with_others():
    """A constant Jordan block has a condition without bound, and its exponents are exact."""
    found = hill(lambda t: block_diag([[-0.3, 1.0], [0.0, -0.3]], [[-0.8, 1.0], [0.0, -0.8]]), 2 * pi)
    assert found.change.max() < 1e-4
    assert np.sort(found.exponents.real) == pytest.approx([-0.8, -0.8, -0.3, -0.3], abs=1e-7)


def test_mathieu_on_a_characteristic_curve():
    found = hill(mathieu(mathieu_a(1, 2.0), 2.0), pi)
    assert found.outcome is HillOutcome.ROUNDED
    assert_exponents_close(found.exponents, [1j, 1j], pi, atol=3e-6)


@pytest.mark.slow
def test_forty_states():
    """A chain of oscillators up to twelve times the fundamental."""
    generator, m = np.random.default_rng(1), 20
    stiffness, change = np.diag(np.linspace(1, 12, m) ** 2), 0.05 * generator.normal(size=(m, m))
    change = change + change.T

    def system(t):
        lower = np.hstack([-stiffness - change * cos(t), -0.02 * np.eye(m)])
        return np.vstack([np.hstack([np.zeros((m, m)), np.eye(m)]), lower])

    found = hill(system, 2 * pi)
    assert found.n_harmonics < 10
    assert_exponents_close(found.exponents, floquid.floquet.exponents(system, 2 * pi), 2 * pi, atol=1e-10)


def far_lines(stiffness, damping, lines, period=2 * pi):
    swing = np.zeros((2, 2, len(lines)))
    swing[1, 0] = [-value for value in lines.values()]
    mean = [[0, 1], [-stiffness, -damping]]
    return HarmonicMatrix.from_cosines(mean, swing, 0 * swing, period=period, harmonics=list(lines))


FAR = {
    "1 and 12": (far_lines(36, 0.01, {1: 0.3, 12: 0.4}), [0.01165624, -0.02165624]),
    "17": (far_lines(72.25, 0.0, {17: 0.3 * 72.25}), [0.63582962 + 0.5j, -0.63582962 + 0.5j]),
    "8": (far_lines(16, 0.0, {8: 4.8}), [0.29921394, -0.29921394]),
    "20": (far_lines(100, 0.0, {20: 30.0}), [0.74803485, -0.74803485]),
}


@pytest.mark.first(4)
@pytest.mark.parametrize("form", ["harmonics", "function", "samples"])
@pytest.mark.parametrize("name", FAR)
def test_lines_that_are_far_apart_are_met(name, form):
    """The truth is that of `solve_ivp`."""
    system, exact = FAR[name]
    if form == "function":
        found = hill(system.at, system.period)
    elif form == "samples":
        found = hill(np.moveaxis(system.at(2 * pi * np.arange(64) / 64), 0, 2), system.period)
    else:
        found = hill(system)
    assert found.converged
    assert_exponents_close(found.exponents, exact, system.period, atol=1e-8)
    assert_exponents_close(found.exponents, floquid.floquet.exponents(system), system.period, atol=1e-10)


@pytest.mark.parametrize("n_harmonics", [3, 5, 11, 14])
def test_a_truncation_below_the_lines_is_not_settled(n_harmonics):
    """At 5 harmonics nothing changes any more, to 1e-15, and the exponents are wrong."""
    system, exact = FAR["1 and 12"]
    found = hill(system, n_harmonics=n_harmonics, raises=False)
    assert found.outcome is HillOutcome.TRUNCATED
    with pytest.raises(InputError, match=r"A\(t\) has harmonics \(up to 12\) that were not met"):
        hill(system, n_harmonics=n_harmonics)
    assert hill(system, n_harmonics=36).converged
    assert_exponents_close(hill(system, n_harmonics=36).exponents, exact, 2 * pi, atol=1e-8)


@pytest.mark.slow
def test_lines_beyond_what_can_be_held_are_refused():
    with pytest.raises(InputError, match=r"harmonics \(up to 300\) that were not met"):
        hill(block_matrix(far_lines(16, 0.0, {300: 1.0}), 6))


def block_matrix(matrix, count):
    coefficients = np.asarray(matrix.coefficients)
    blocks = np.stack([np.kron(np.eye(count), c) for c in np.moveaxis(coefficients, 2, 0)], axis=2)
    return HarmonicMatrix(coefficients=blocks, harmonics=matrix.harmonics, period=matrix.period)


def test_reach_of_lines():
    assert reach(FAR["1 and 12"][0], 1e-10) == (12, 12, True)
    assert reach(far_lines(4, 0, {1: 1.0, 9: 1e-6, 40: 1e-13}), 1e-10) == (9, 1, True)
    assert reach(function(lambda t: [[1.0, 0.0]]), 1e-10) == (0, 0, True)
    assert reach(function(lambda t: [[cos(W * t) + 1e-4 * cos(90 * W * t)]]), 1e-10) == (90, 1, True)
    assert reach(PiecewiseMatrix(values=[[[1.0, -1.0]]], edges=[0.0, 0.5 * T], period=T), 1e-10) == (19, 19, False)


def test_what_leaks_over_the_edges_moves_the_exponents():
    """The bound falls with the truncation as the error does."""
    system, exact = FAR["8"]
    for n_harmonics in (8, 12, 16, 24):
        problem = Problem(fourier(system, 2 * n_harmonics), 1.0)
        modes = truncated(problem)
        off = np.abs(pair_exponents(modes.exponents, exact, 2 * pi).differences).max()
        bound = effect_of_edges(problem, modes).max()
        assert bound > off - 1e-8
    assert bound < 1e-4


def test_unequal_units():
    system = HarmonicMatrix.from_cosines(
        [[0, 1], [-4e6, -8.0]], [[[0.0], [0.0]], [[4e5], [0.0]]], np.zeros((2, 2, 1)), period=4e-3
    )
    found = hill(system)
    assert_exponents_close(found.exponents, floquid.floquet.exponents(system), 4e-3, atol=1e-9)


@pytest.mark.slow
def test_a_jump_that_is_not_named_is_refused():
    values, exact = meissner(0.2)
    system = lambda t: values[..., 0] if t % pi < pi / 3 else values[..., 1]  # noqa: E731
    with pytest.raises(InputError, match=r"settle to 1e-12 of") as caught:
        hill(system, pi, tolerance=1e-12)
    assert "name the instants in `breaks`" in str(caught.value)
    found = hill(system, pi, tolerance=1e-12, raises=False)
    assert found.outcome is HillOutcome.TRUNCATED
    off = np.abs(pair_exponents(found.exponents, exact, pi).differences).max()
    assert 1e-14 < off < 10 * found.change.max() < 1e-8


def test_no_family_is_taken_twice():
    """Where copies of a real negative multiplier differ still, Liouville's formula tells; else the error is 0.1."""
    values, exact = meissner(0.2)
    system = lambda t: values[..., 0] if t % pi < pi / 3 else values[..., 1]  # noqa: E731
    for n_harmonics in (3, 10, 15):
        found = hill(system, pi, n_harmonics=n_harmonics, raises=False)
        off = np.abs(pair_exponents(found.exponents, exact, pi).differences).max()
        assert off < 2 * found.change.max() < 1e-4


@pytest.mark.first(1)
@pytest.mark.parametrize("seed", range(4))
def test_the_best_centred_copy_is_taken(seed):
    """At 40 harmonics most copies leak nothing; one far off the strip would have been moved far to get back to it."""
    system = hidden(HIDDEN["an odd number"], seed)
    found = hill(system, 2 * pi, n_harmonics=40)
    assert found.harmonics.max() <= 43
    assert_exponents_close(found.exponents, np.linalg.eigvals(HIDDEN["an odd number"]), 2 * pi, atol=1e-13)


def test_a_truncation_that_is_asked_for():
    system = mathieu(3, 1)
    coarse = hill(system, pi, n_harmonics=3, raises=False)
    assert coarse.n_harmonics == 3
    exact = [0.3284189108j, -0.3284189108j]
    off = np.abs(pair_exponents(coarse.exponents, exact, pi).differences).max()
    assert 1e-9 < off < coarse.change.max()
    with pytest.raises(InputError, match="at 3 harmonics: the truncation is too low"):
        hill(system, pi, n_harmonics=3)
    assert hill(system, pi, n_harmonics=25).change.max() < 1e-13


@pytest.mark.parametrize(
    ("system", "keywords", "message"),
    [
        (mathieu(3, 1), {"tolerance": 0.5}, r"`tolerance` of `floquet.hill` must lie in"),
        (mathieu(3, 1), {"n_harmonics": 2000}, r"2000 harmonics of 2 states are 8002"),
        (mathieu(3, 1), {"n_harmonics": 0}, "`n_harmonics` of `floquet.hill` must be an integer of at least 1"),
        (np.zeros((800, 800, 1)), {}, r"3 harmonics of 800 states are 5600"),
        (lambda t: [[sin(0.7 * t)]], {}, r"must be a period of A\(t\)"),
        (lambda t: [[1.0, 2.0]], {}, "must be a square matrix"),
    ],
)
def test_refusals(system, keywords, message):
    with pytest.raises(InputError, match=message):
        hill(system, pi, **keywords)
