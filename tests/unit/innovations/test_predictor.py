"""The one-step predictor: its innovations, its derivatives, and what a change of its states leaves as it is."""

from dataclasses import replace

import numpy as np
import pytest

from floquid.fit import CHUNK, LONGEST_STEP, ROUNDING
from floquid.innovations import _products, _result
from floquid.innovations._covariance import colour, stable_gains, whitening_of
from floquid.innovations._derivatives import gradient, slopes
from floquid.innovations._mode import Mode
from floquid.innovations._predictor import matrices, predicted
from floquid.innovations._products import as_real, merged
from floquid.innovations._result import Fit, period_step, sized
from floquid.innovations._solve import held, moved, normal_of, places, solve
from floquid.innovations.search import _bands
from floquid.innovations.search._fewer import alike, needed
from floquid.inputs import Limits, samples_of

OMEGA, STEP, COUNT = 1.3, 0.2, 400


def modes_of(generator, channels=2, inputs=1):
    """A pair and a real negative multiplier."""

    def some(*shape):
        return 0.08 * (generator.standard_normal(shape) + 1j * generator.standard_normal(shape))

    pair = Mode(
        exponent=-0.1 + 0.7j,
        real=False,
        turns=np.arange(-1.0, 2.0),
        shape=some(channels, 3),
        reach=np.arange(-1.0, 1.0),
        gains=some(inputs + channels, 2),
    )
    real = Mode(
        exponent=-0.3 + 0j,
        real=True,
        turns=np.array([0.5, 1.5]),
        shape=some(channels, 2),
        reach=np.array([0.5]),
        gains=some(inputs + channels, 1),
    )
    return [pair, real]


def response_of(modes, noise, inputs, times, initial):
    """Outputs of the innovations form, sample by sample, pairs as complex numbers."""
    states = [complex(*initial[:2]), complex(initial[2])]
    values = np.zeros_like(noise)
    for k, t in enumerate(times):
        drive = np.concatenate([inputs[:, k], noise[:, k]])
        values[:, k] = noise[:, k]
        for number, mode in enumerate(modes):
            shape = mode.shape @ np.exp(1j * mode.turns * OMEGA * t)
            gain = np.exp(1j * mode.reach * OMEGA * t) @ mode.gains.T @ drive
            state = states[number]
            values[:, k] += (shape.real * state.real) if mode.real else (shape * state).real
            states[number] = np.exp(mode.exponent * STEP) * state + (gain.real if mode.real else gain)
    return values


@pytest.fixture(scope="module")
def case():
    generator = np.random.default_rng(1)
    modes, times = modes_of(generator), 0.4 + STEP * np.arange(COUNT)
    noise, inputs = generator.standard_normal((2, COUNT)), generator.standard_normal((1, COUNT))
    initial = np.array([0.5, -0.2, 0.3])
    values = response_of(modes, noise, inputs, times, initial) + 0.7
    samples = samples_of([values], [inputs], [0.4], step=STEP, fundamental=OMEGA, hold="none")
    at = predicted(samples, modes, np.full((2, 1), 0.7), initial[None])
    return samples, at, noise


def test_innovations_are_what_drove_the_response(case):
    _, at, noise = case
    assert np.abs(at.innovations - noise).max() < 1e-9


def test_derivatives_are_those_of_differences(case):
    samples, at, _ = case
    whole = np.concatenate([part for _, part in slopes(samples, at, at.whitening.__getitem__)])
    generator = np.random.default_rng(2)
    for _ in range(3):
        step = 1e-6 * generator.standard_normal(whole.shape[2])
        up, down = (moved(samples, at, sign * step, 1e-9).innovations for sign in (1.0, -1.0))
        assert np.abs((up - down) / 2.0 - (whole @ step).T).max() < 1e-4 * np.abs(up - down).max()


def test_the_adjoint_gives_the_gradient(case):
    samples, at, _ = case
    signals = np.random.default_rng(3).standard_normal(at.innovations.shape)
    whole = np.concatenate([part for _, part in slopes(samples, at, at.root)])
    expected = -np.einsum("kcp,ck->p", whole, at.white(signals))
    assert np.abs(gradient(samples, at, signals) - expected).max() < 1e-12 * np.abs(expected).max()


def test_what_is_left_of_a_first_state_does_not_underflow(case):
    _, at, _ = case
    generator = np.random.default_rng(8)
    long = samples_of(
        [generator.standard_normal((2, 9 * CHUNK))], [generator.standard_normal((1, 9 * CHUNK))], [0.4],
        step=STEP, fundamental=OMEGA, hold="none",
    )  # fmt: skip
    start = predicted(long, at.modes, at.columns, at.initial)
    parts = [np.abs(part[:, :, -at.initial.size :]) for _, part in slopes(long, start, start.root)]
    assert parts[0].max() > 0.01
    assert not any(((part > 0.0) & (part < 1e-6 * ROUNDING)).any() for part in parts)
    assert parts[-1].max() == 0.0


def test_a_step_that_is_held_is_the_best_that_moves_no_exponent_too_far(case):
    samples, at, _ = case
    normal, period = normal_of(samples, at), 2.0 * np.pi / OMEGA
    values, vectors = np.linalg.eigh(normal.matrix + 1e-3 * np.diag(normal.scale**2))
    root = vectors / np.sqrt(values)
    pull = normal.gradient.copy()
    for place in places(at.modes):
        pull[place.start] += 3.0 * normal.matrix[place.start, place.start] * LONGEST_STEP / period
    whole = root @ (root.T @ pull)
    step = held(at, whole, lambda which: root @ root[which].T, period)
    sizes = [
        np.linalg.norm(step[place.start : place.start + mode.rows]) * period
        for mode, place in zip(at.modes, places(at.modes), strict=True)
    ]
    assert np.allclose(sizes, LONGEST_STEP)
    slope = pull - (vectors * values) @ vectors.T @ step
    exponents = np.zeros(len(slope), bool)
    exponents[[0, 1, places(at.modes)[1].start]] = True
    assert np.abs(slope[~exponents] / normal.scale[~exponents]).max() < 1e-8 * np.abs(slope / normal.scale).max()
    assert np.array_equal(held(at, 0.01 * step, lambda which: root @ root[which].T, period), 0.01 * step)


def test_the_scale_of_a_state_and_its_branch_change_nothing(case):
    samples, at, noise = case
    assert np.abs(sized(Fit(samples, at)).at.modes[0].gains - at.modes[0].gains).max() > 1e-3
    scaled = sized(Fit(samples, at)).at
    again = predicted(samples, scaled.modes, scaled.columns, scaled.initial)
    assert np.abs(again.innovations - noise).max() < 1e-9
    odd = replace(at.modes[0], shape=at.modes[0].shape * [[0.0, 0.1, 5.0]])
    other = predicted(samples, [odd, at.modes[1]], at.columns, at.initial)
    centred = _bands.centred(samples, other)
    assert centred.modes[0].turns[-1] == 0.0
    assert np.abs(centred.innovations - other.innovations).max() < 1e-9


def test_one_linearisation_has_that_with_and_without_harmonics_more(case, monkeypatch):
    samples, at, _ = case
    formed, whole = [], _result.normal_of
    monkeypatch.setattr(_result, "normal_of", lambda *given: formed.append(1) or whole(*given))
    fit = sized(Fit(samples, at))
    fit.estimates_at(np.array([mode.exponent for mode in fit.at.modes]))
    plain = whole(samples, replace(fit.at))
    assert np.abs(fit.normal.matrix - plain.matrix).max() < 1e-9 * np.abs(plain.matrix).max()
    assert np.abs(fit.normal.gradient - plain.gradient).max() < 1e-9 * np.abs(np.sqrt(np.diag(plain.matrix))).max()
    assert len(formed) == 1


def test_a_fit_from_beside_comes_back_within_its_deviations(case):
    samples, at, _ = case
    aside = replace(at.modes[0], exponent=at.modes[0].exponent + 0.02 - 0.03j)
    start = predicted(samples, [aside, at.modes[1]], at.columns, at.initial)
    found = Fit(samples, solve(samples, start))
    place = found.places[0].start
    spread = np.sqrt(np.diag(found.parameters)[place : place + 2])
    gap = found.at.modes[0].exponent - at.modes[0].exponent
    assert found.at.log_likelihood > at.log_likelihood
    assert (np.abs([gap.real, gap.imag]) < 4.0 * spread).all()


@pytest.mark.slow
@pytest.mark.parametrize("seed", [5, 6, 7])
def test_a_fit_that_has_ended_gains_nothing_more_and_one_that_has_not_is_told(seed):
    generator, times = np.random.default_rng(seed), 0.4 + STEP * np.arange(3000)
    modes = [replace(mode, gains=15.0 * mode.gains) for mode in modes_of(np.random.default_rng(5))]
    noise, inputs = generator.standard_normal((2, 3000)), generator.standard_normal((1, 3000))
    values = response_of(modes, noise, inputs, times, np.zeros(3))
    samples = samples_of([values], [inputs], [0.4], step=STEP, fundamental=OMEGA, hold="none")
    aside = [replace(mode, exponent=1.3 * mode.exponent) for mode in modes]
    found = solve(samples, predicted(samples, aside, np.zeros((2, 1)), np.zeros((1, 3))))
    assert solve(samples, found).log_likelihood < found.log_likelihood + 0.01
    fit = Fit(samples, found)
    assert max(fit.short(number) for number in range(2)) < 0.05
    std = fit.parameters[fit.places[0].start, fit.places[0].start] ** 0.5
    beside = [replace(found.modes[0], exponent=found.modes[0].exponent + std), found.modes[1]]
    off = Fit(samples, predicted(samples, beside, found.columns, found.initial, found.whitening))
    assert off.short(0) > 0.5


@pytest.mark.slow
def test_a_fit_that_will_not_come_as_far_as_it_must_is_given_up(case):
    samples, at, _ = case
    aside = [replace(mode, exponent=mode.exponent - 0.3, shape=0.3 * mode.shape) for mode in at.modes]
    start = predicted(samples, aside, at.columns, at.initial)
    whole = solve(samples, start, rough=True).log_likelihood
    assert start.log_likelihood < solve(samples, start, rough=True, least=whole + 1e4).log_likelihood < whole - 0.3
    assert solve(samples, start, rough=True, least=whole).log_likelihood == whole


def test_a_predictor_that_diverges_is_none(case):
    samples, at, _ = case
    wild = [replace(mode, gains=-30.0 * mode.gains) for mode in at.modes]
    assert predicted(samples, wild, at.columns, at.initial) is None


def test_gains_of_a_predictor_that_grows_have_a_stable_one_of_the_same_spectrum(case):
    generator, times = np.random.default_rng(4), 0.4 + STEP * np.arange(4000)
    wild = [replace(mode, gains=25.0 * mode.gains) for mode in case[1].modes]
    noise, inputs = generator.standard_normal((2, 4000)), np.zeros((1, 4000))
    values = response_of(wild, noise, inputs, times, np.zeros(3))
    samples = samples_of([values], [inputs], [0.4], step=STEP, fundamental=OMEGA, hold="none")
    still = np.zeros((2, 1)), np.zeros((1, 3))
    assert predicted(samples, wild, *still) is None
    stable = stable_gains(samples, wild, np.eye(2), 8.0)
    found = predicted(samples, stable, *still)
    assert found is not None
    assert colour(samples, found)[1] > 1e-3
    # Half of the gain is no longer that spectrum.
    half = predicted(samples, [replace(mode, gains=0.5 * mode.gains) for mode in stable], *still)
    assert half is None or colour(samples, half)[1] < 1e-9
    # Of no harmonic a negative multiplier has the one at half a turn: there was none, and the search broke off.
    assert [mode.reach.tolist() for mode in stable_gains(samples, wild, np.eye(2), 0.0)] == [[0.0], [0.5]]


@pytest.mark.parametrize("number", [0, 1], ids=["pair", "real"])
def test_of_copies_of_a_mode_one_stays(number):
    generator, times = np.random.default_rng(5), 0.4 + STEP * np.arange(3000)
    modes = [replace(mode, gains=15.0 * mode.gains) for mode in modes_of(generator)]
    noise, inputs = generator.standard_normal((2, 3000)), generator.standard_normal((1, 3000))
    values = response_of(modes, noise, inputs, times, np.zeros(3))
    samples = samples_of([values], [inputs], [0.4], step=STEP, fundamental=OMEGA, hold="none")
    whole = predicted(samples, stable_gains(samples, modes, np.eye(2), 3.0), np.zeros((2, 1)), np.zeros((1, 3)))
    own = whole.modes[number]
    other = replace(own, shape=-19.0 * own.shape)
    if number == 0:
        other = other.turned(1.0, OMEGA, STEP).conjugate()
    twice = [*whole.modes, replace(other, exponent=1.001 * other.exponent.real + 1j * other.exponent.imag)]
    twice[number] = replace(own, shape=20.0 * own.shape)
    found = predicted(samples, twice, whole.columns, np.zeros((1, sum(mode.rows for mode in twice))))
    assert [number, 2] in alike(found.modes, OMEGA)
    assert needed(samples, found, Limits(highest=3, until=0.0)) is found
    left = needed(samples, found, Limits(highest=3))
    assert [mode.real for mode in left.modes].count(number == 1) == 1
    assert len(left.modes) == 2
    assert left.log_likelihood > whole.log_likelihood - 1.0


def test_of_copies_that_are_gone_within_a_period_two_states_stay_where_these_do():
    """Two at one place, as a pair on their axis and a copy of it."""
    generator, times, none = np.random.default_rng(5), 0.4 + STEP * np.arange(3000), np.zeros(1)
    shape, gains = np.array([[0.6 + 0.1j], [0.2 - 0.5j]]), np.array([[0.4 - 0.1j], [0.2 + 0.3j]])
    pair = Mode(exponent=-0.5 + 0j, real=False, turns=none, shape=shape, reach=none, gains=gains)
    noise, inputs = generator.standard_normal((2, 3000)), np.zeros((0, 3000))
    values = response_of([pair], noise, inputs, times, np.zeros(3))
    samples = samples_of([values], [inputs], [0.4], step=STEP, fundamental=OMEGA, hold="none")
    whole = predicted(samples, [pair], np.zeros((2, 1)), np.zeros((1, 2)))
    parts = ((0.05j, 0.6), (-0.05 + 0j, 0.4))
    copies = [replace(pair, exponent=pair.exponent + off, shape=share * shape) for off, share in parts]
    found = predicted(samples, copies, np.zeros((2, 1)), np.zeros((1, 4)))
    assert needed(samples, found, Limits(highest=3, until=0.0)) is found
    left = needed(samples, found, Limits(highest=3))
    assert sum(mode.rows for mode in left.modes) == 2
    assert left.log_likelihood > whole.log_likelihood - 1.0


def test_stable_gains_are_those_of_the_equation_run_along_a_record(case):
    """Half harmonics change their sign from period to period: two periods are what they repeat with."""
    slow = [replace(mode, exponent=0.3 * mode.exponent.real + 1j * mode.exponent.imag) for mode in case[1].modes]
    wild = [replace(mode, gains=25.0 * mode.gains) for mode in slow]
    step = 2.0 * np.pi / (24.0 * OMEGA)
    nothing = np.zeros((2, 24 * 150))
    samples = samples_of([nothing], [nothing[:1]], [0.4], step=step, fundamental=OMEGA, hold="none")
    system, gains, seen, _ = matrices(samples, wild)
    variance, found = 1e3 * np.eye(len(system)), []
    for drive, output in zip(gains, seen, strict=True):
        across = system @ variance @ output.T + drive
        gain = across @ np.linalg.inv(output @ variance @ output.T + np.eye(2))
        variance = system @ variance @ system.T + drive @ drive.T - gain @ across.T
        variance = 0.5 * (variance + variance.T)
        found.append(output @ gain)
    own = matrices(samples, stable_gains(samples, wild, np.eye(2), 11.0))
    # A state's own scale is free: what counts is the gain seen at the outputs.
    off = own[2][-24:] @ own[1][-24:] - np.array(found[-24:])
    assert np.sqrt(np.mean(off**2)) < 0.02 * np.abs(found[-24:]).max()


def test_a_predictor_that_grows_unseen_is_none(case):
    samples, at, _ = case
    silent = replace(at.modes[1], exponent=0.2 + 0.0j, gains=0.0 * at.modes[1].gains, shape=1e-9 * at.modes[1].shape)
    assert predicted(samples, [at.modes[0], silent], at.columns, 0.0 * at.initial) is None


def test_a_predictor_stays_whatever_the_scale_of_its_states_is(case):
    samples, at, _ = case
    first, *rest = at.modes
    large = replace(first, gains=1e-30 * first.gains, shape=1e30 * first.shape)
    found = predicted(samples, [large, *rest], at.columns, 0.0 * at.initial)
    same = predicted(samples, at.modes, at.columns, 0.0 * at.initial)
    assert found is not None
    assert same is not None
    assert np.abs(found.innovations - same.innovations).max() < 1e-9 * np.abs(same.innovations).max()


@pytest.mark.parametrize("half", [0.0, 0.5])
def test_a_pair_on_the_axis_beside_a_real_multiplier_is_three_of_them(case, half, monkeypatch):
    samples, at, _ = case
    monkeypatch.setattr(_products, "APART", (1.0, 1.0))
    pair = replace(at.modes[0], exponent=-0.2 + 1j * half * OMEGA)
    turns = half + np.arange(at.modes[1].turns.size), half + np.arange(at.modes[1].reach.size)
    other = replace(at.modes[1], exponent=-0.2 + 0j, turns=turns[0], reach=turns[1])
    modes = [pair, other]
    both = predicted(samples, modes, at.columns, np.zeros((1, 3)))
    three = predicted(samples, as_real(samples, both, modes, half, 3), at.columns, np.zeros((1, 3)))
    assert np.abs(both.innovations - three.innovations).max() < 1e-9 * np.abs(both.innovations).max()
    assert alike(both.modes, OMEGA) == [[0, 1]]
    assert [mode.real for mode in merged(samples, both, modes, 2)] == [True, True]


def test_real_multipliers_of_both_signs_are_never_one(case):
    """Nor where a pair between them is near to either."""
    _, at, _ = case
    negative = replace(at.modes[1], exponent=-5.0 + 0j)
    positive = replace(negative, turns=np.arange(2.0), reach=np.arange(float(negative.reach.size)))
    pair = replace(at.modes[0], exponent=-5.0 + 0.25j * OMEGA)
    assert alike([positive, pair, negative], OMEGA) == [[0, 1], [2]]
    assert alike([negative, pair, positive], OMEGA) == [[0, 1], [2]]


def test_copies_are_no_more_than_there_are_products():
    """Of one harmonic, seen in one channel and driven by one innovation, there is one product of a pair."""
    generator = np.random.default_rng(3)
    pair = replace(modes_of(generator, channels=1, inputs=0)[0], turns=np.zeros(1), reach=np.zeros(1))
    pair = replace(pair, shape=0.1 + 0.05j * np.ones((1, 1)), gains=0.1 * np.ones((1, 1), complex))
    values = generator.standard_normal((1, COUNT))
    samples = samples_of([values], [values[:0]], [0.4], step=STEP, fundamental=OMEGA, hold="none")
    modes = [replace(pair, exponent=decay + 0.4j) for decay in (-0.09, -0.1, -0.11)]
    at = predicted(samples, modes, np.zeros((1, 1)), np.zeros((1, 6)))
    assert len(merged(samples, at, modes, 2)) == 1


def test_the_covariance_along_a_period_is_found():
    """Two signals, the second's share of the first and its deviation by hand."""
    generator, times = np.random.default_rng(0), STEP * np.arange(8000)
    angle = OMEGA * times
    white = generator.standard_normal((2, len(times)))
    share, deviation = 0.5 + 0.4 * np.cos(angle), np.exp(0.6 * np.sin(angle))
    signals = np.array([3.0 * white[0], 3.0 * share * white[0] + deviation * white[1]])
    samples = samples_of([signals], [np.zeros((0, len(times)))], [0.0], step=STEP, fundamental=OMEGA)
    found = whitening_of(samples, signals)[:]
    assert np.abs(found[:, 0, 0] - 1.0).max() < 1e-12
    assert np.abs(found[:, 1, 1] * deviation - 1.0).max() < 0.1
    assert np.abs(found[:, 1, 0] / found[:, 1, 1] + share).max() < 0.1
    assert abs(np.log(np.linalg.det(found)).mean()) < 1e-9


def test_bands_change_only_while_there_is_time():
    generator, times, turns = np.random.default_rng(0), STEP * np.arange(2000), np.arange(-1.0, 2.0)
    shape, gains = np.array([[0.3j, 1.0, 0.2]]), np.array([[0.09, 0.3 + 0.15j, 0.12j]])
    pair = Mode(exponent=-0.1 + 0.4j, real=False, turns=turns, shape=shape, reach=turns, gains=gains)
    noise, inputs = generator.standard_normal((1, 2000)), np.zeros((0, 2000))
    values = response_of([pair], noise, inputs, times, np.zeros(3))
    samples = samples_of([values], [inputs], [0.0], step=STEP, fundamental=OMEGA, hold="none")
    for change, mode in ((_bands.grown, pair.widened(turns[1:], turns)), (_bands.narrowed, pair.padded(1.0, 3.0))):
        start = solve(samples, predicted(samples, [mode], np.zeros((1, 1)), np.zeros((1, 2))))
        assert change(samples, start, Limits(highest=3, until=0.0)) is start
        assert change(samples, start, Limits(highest=3)).n_parameters != start.n_parameters


def test_the_period_of_a_fit_at_the_edge_of_divergence_is_told_from_one_side(case, monkeypatch):
    """A search that was ended left a fit there, and the chain with an error."""
    samples, at, _ = case
    fit, diverging = Fit(samples, at), set()
    whole = period_step(fit)

    def edge(own, *given, **more):
        above = own.fundamental > samples.fundamental
        return None if above in diverging else predicted(own, *given, **more)

    monkeypatch.setattr(_result, "predicted", edge)
    for above in (True, False):
        diverging.add(above)
        assert period_step(fit) == pytest.approx(whole, rel=1e-4)
        diverging.clear()
    diverging.update({True, False})
    assert period_step(fit) == (0.0, np.inf)
