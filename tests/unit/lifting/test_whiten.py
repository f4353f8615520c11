"""Noise coloured along the record: when it is whitened, by what, and that modes stay as they are."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.signal import lfilter

from floquid import Record, identify
from floquid.core import ConstantPeriod, PeriodicModel
from floquid.lifting import filters_of, lift, unlift, whitened, whitening_filter
from floquid.lti import fit_residues
from floquid.periodic import Known, assemble, synchrony
from floquid.periodic.significance import drift
from floquid.pipeline import Settings
from floquid.pipeline import lifted as lifted_of
from floquid.pipeline.free import _find_poles, _start
from floquid.pipeline.free._find_poles import first_filter
from floquid.store import load, save
from floquid.sync import segment
from floquid.testing import pair_exponents

PERIOD = 1.6


def system(*, channels=2, hits=1, seed=0) -> PeriodicModel:
    """A pair with harmonics -2 … 2, and a real negative multiplier on its branch at half a turn."""
    generator = np.random.default_rng(seed)
    omega = 2.0 * np.pi / PERIOD
    size = (channels, hits, 5)
    pair = (generator.standard_normal(size) + 1j * generator.standard_normal(size)) * [0.1, 0.3, 1.0, 0.3, 0.1]
    pair[..., 2] += 2.0
    # Harmonic m of a real solution at half a turn is the conjugate of harmonic -1 - m.
    real = np.zeros(size, complex)
    real[..., 2] = 1.0 + 0.5j
    real[..., 1] = real[..., 2].conj()
    return PeriodicModel(
        exponents=[-0.03 + 1.1j, -0.03 - 1.1j, -0.05 + 0.5j * omega],
        coefficients=np.stack([pair, pair[..., ::-1].conj(), real]),
        harmonics=np.arange(-2, 3),
        period=PERIOD,
        channels=[f"c{i}" for i in range(channels)],
    )


def records(model, *, noise=0.0, colour=(), n_phases=12, n_cycles=150, first_phase=0.0, seed=0) -> list[Record]:
    """The response from a phase on, beside noise of unit innovations times `noise` with these autoregressive taps."""
    made, generator = [], np.random.default_rng(seed)
    step = model.period / n_phases
    times = first_phase * model.period + step * np.arange(n_phases * n_cycles)
    for hit in range(model.n_hits):
        white = generator.standard_normal((len(model.channels), 400 + len(times)))
        coloured = lfilter([1.0], [1.0, *colour], white, axis=1)[:, 400:]
        made.append(
            Record(
                values=model.response(times)[:, hit] + noise * coloured,
                sample_rate=1.0 / step,
                start=times[0],
                channels=model.channels,
                clock=ConstantPeriod(period=model.period),
            )
        )
    return made


def lifted(model, **options):
    return lift(segment(records(model, **options)))


def found_filter(responses, model):
    return whitening_filter(responses, fit_residues(model.multipliers, responses.responses))


@pytest.mark.slow
@settings(max_examples=12, deadline=None)
@given(
    taps=st.lists(st.floats(-0.8, 0.8), min_size=1, max_size=5),
    first_phase=st.floats(0.0, 0.95),
    hits=st.integers(1, 2),
    seed=st.integers(0, 99),
)
def test_a_filter_leaves_the_periodic_model_as_it_is(taps, first_phase, hits, seed):
    model = system(hits=hits, seed=seed)
    raw = lifted(model, first_phase=first_phase)
    filters = np.array([[1.0, *taps], [1.0, *taps[::-1]]])
    through = whitened(raw, filters)
    back = assemble(fit_residues(model.multipliers, through.responses), through, harmonics=3)
    plain = assemble(fit_residues(model.multipliers, raw.responses), raw, harmonics=3)
    pairing = pair_exponents(back.exponents, plain.exponents, PERIOD)
    assert_allclose(np.abs(pairing.differences).max(), 0.0, atol=1e-9)
    # The gain may be small at a harmonic: rounding is divided by it.
    weakest = np.abs(through.gain(model.exponents[:, None] + 2j * np.pi / PERIOD * np.arange(-5, 6))).min()
    times = np.linspace(0.0, 5.0 * PERIOD, 37)
    assert_allclose(back.response(times), plain.response(times), atol=1e-10 / weakest)


@pytest.mark.parametrize("first_phase", [0.0, 0.4])
def test_each_sample_is_filtered_with_its_own_past(first_phase):
    raw = lifted(system(hits=2), first_phase=first_phase, noise=0.1, n_cycles=30)
    taps = np.array([[1.0, -0.5, 0.25], [1.0, 0.3, 0.0]])
    through = whitened(raw, taps)
    assert through.responses.lengths.tolist() == [29, 29]
    for hit, (before, after) in enumerate(zip(unlift(raw), unlift(through), strict=True)):
        for channel in range(2):
            along = before.values[channel].T.ravel()
            expected = lfilter(taps[channel], [1.0], along)[2 : 2 + 29 * 12]
            assert_allclose(after.values[channel].T.ravel(), expected, atol=1e-12, err_msg=f"hit {hit}")
    assert_allclose(through.phase_times - raw.phase_times, 2 * PERIOD / 12)


def test_the_gain_and_its_slope():
    plain = lifted(system())
    through = whitened(plain, np.array([[1.0, -0.9, 0.2], [1.0, 0.0, 0.0]]))
    rates = np.array([[-0.1 + 3.0j, 0.2 - 1.0j]])
    delay = PERIOD / 12
    expected = 1.0 - 0.9 * np.exp(-rates * delay) + 0.2 * np.exp(-2 * rates * delay)
    assert_allclose(through.gain(rates), [expected, np.ones((1, 2))], rtol=1e-14)
    near = (through.gain(rates + 1e-6) - through.gain(rates - 1e-6)) / 2e-6
    assert_allclose(through.gain(rates, slope=True), near, atol=1e-9)
    assert_array_equal(plain.gain(rates), np.ones((2, 1, 2)))
    assert_array_equal(plain.gain(rates, slope=True), np.zeros((2, 1, 2)))


@pytest.mark.first(1)
@pytest.mark.parametrize("n_phases", [2, 5, 12, 40])
def test_white_noise_is_left_alone(n_phases):
    model = system(channels=3, hits=2)
    for seed in range(20):
        assert found_filter(lifted(model, noise=0.1, n_phases=max(n_phases, 6), seed=seed), model) is None


@pytest.mark.parametrize("lags", [1, 6])
def test_a_filter_is_made_from_eight_deviations_on(lags):
    """Box and Pierce's sum over white noise has the mean of the lags, and twice their variance."""
    numbers, kinds = np.array([150.0]), []
    for deviations in (7.5, 8.5):
        correlations = np.zeros((1, lags + 1))
        correlations[0, :2] = 1.0, np.sqrt((lags + deviations * np.sqrt(2.0 * lags)) / numbers[0])
        kinds.append(filters_of(correlations, numbers) is not None)
    assert kinds == [False, True]


@pytest.mark.parametrize("colour", [(-0.9,), (0.7,), (-0.5,), (-1.2, 0.8), (-0.999,)])
def test_autoregressions_are_whitened(colour):
    model = system()
    raw = lifted(model, noise=0.1, colour=colour, n_cycles=400)
    taps = found_filter(raw, model)
    order = len(colour)
    assert_allclose(taps[:, 1 : order + 1], np.tile(colour, (2, 1)), atol=0.05)
    through = whitened(raw, taps)
    assert found_filter(through, model) is None
    left = fit_residues(model.multipliers, through.responses).residual_std
    assert_allclose(left, 0.1, rtol=0.2)


def test_a_channel_of_white_noise_is_left_as_it_is():
    model = system(channels=2)
    white, coloured = records(model, noise=0.1)[0], records(model, noise=0.1, colour=(-0.9,))[0]
    both = Record(
        values=[white.values[0], coloured.values[1]],
        sample_rate=white.sample_rate,
        channels=model.channels,
        clock=white.clock,
    )
    taps = found_filter(lift(segment([both])), model)
    assert_array_equal(taps[0], np.eye(1, taps.shape[1])[0])
    assert taps[1, 1] == pytest.approx(-0.9, abs=0.05)


def test_rounding_is_no_noise():
    """Without noise what is left is of the size of rounding, and of any colour."""
    model = system()
    assert found_filter(lifted(model), model) is None
    # Samples of a smooth response to six digits, the floor stated: what is left is below it.
    raw = lifted(model)
    smooth = 1e-7 * np.cos(0.01 * np.arange(raw.responses.values.shape[2]))
    values = raw.responses.values + smooth
    rough = replace(raw, responses=replace_values(raw.responses, values), floor=1e-6)
    assert found_filter(rough, model) is None
    assert found_filter(replace(rough, floor=1e-10), model) is not None


def replace_values(data, values):
    return type(data)(values=values, dt=data.dt, noise=data.noise, lengths=data.lengths)


def test_too_few_phases_or_periods_are_left_alone():
    model = system()
    colour = {"noise": 0.1, "colour": (-0.95,)}
    assert found_filter(lifted(model, **colour), model) is not None
    assert found_filter(lifted(model, n_cycles=23, **colour), model) is None
    single = lift(segment([records(model, n_phases=1, **colour)[0]]))
    assert found_filter(single, model) is None


FILTER = np.array([[1.0, -0.9, 0.1], [1.0, 0.6, 0.0]])


def upper(model):
    """The index of the mode at 1.1 rad/s."""
    return int(np.argmin(np.abs(model.exponents - (-0.03 + 1.1j))))


def test_deviations_of_the_shapes_follow_the_poles():
    """A pole that moves moves the residues, the delay and the gain: by differences."""
    through = whitened(lifted(system()), FILTER)
    tiny = through.with_noise(np.full((2, 1), 1e-12))
    multipliers = fit_residues(system().multipliers, tiny.responses).multipliers
    which = int(np.argmin(np.abs(multipliers - np.exp((-0.03 + 1.1j) * PERIOD))))
    other = int(np.argmin(np.abs(multipliers - multipliers[which].conj())))
    for turn in (1.0, 1.0j):
        shift = np.zeros(3, complex)
        shift[which], shift[other] = turn, np.conj(turn)
        direction = np.concatenate([shift.real, shift.imag])
        modal = fit_residues(multipliers, tiny.responses, covariance=1e-12 * np.outer(direction, direction))
        found = assemble(modal, tiny, harmonics=3)
        near = [
            assemble(fit_residues(multipliers * np.exp(step * shift * PERIOD), tiny.responses), tiny, harmonics=3)
            for step in (1e-6, -1e-6)
        ]
        moved = (near[0].coefficients[upper(near[0])] - near[1].coefficients[upper(near[1])]) / 2e-6
        std = found.coefficient_std[upper(found)]
        assert_allclose(std.real, 1e-6 * np.abs(moved.real), rtol=1e-3, atol=1e-10)
        assert_allclose(std.imag, 1e-6 * np.abs(moved.imag), rtol=1e-3, atol=1e-10)


@pytest.mark.slow
def test_deviations_of_the_shapes_are_those_of_the_noise():
    """With the poles known, over draws of innovations on the filtered responses."""
    model, clean = system(), whitened(lifted(system()), FILTER)
    generator = np.random.default_rng(0)
    found = []
    for _ in range(300):
        noise = 0.05 * generator.standard_normal(clean.responses.values.shape)
        noisy = replace(clean, responses=replace_values(clean.responses, clean.responses.values + noise))
        noisy = noisy.with_noise(np.full((2, 1), 0.05))
        modal = fit_residues(model.multipliers, noisy.responses, covariance=np.zeros((6, 6)))
        found.append(assemble(modal, noisy, harmonics=3))
    mode = upper(found[0])
    drawn = np.array([one.coefficients[mode] for one in found])
    std = found[0].coefficient_std[mode]
    assert_allclose(drawn.real.std(axis=0), std.real, rtol=0.2)
    assert_allclose(drawn.imag.std(axis=0), std.imag, rtol=0.2)


@pytest.mark.parametrize("through", [lambda raw: raw, lambda raw: whitened(raw, FILTER)], ids=["raw", "whitened"])
def test_a_wrong_period_is_measured(through):
    """The response repeats a little later than the samples are cut."""
    late = 1e-6
    model = replace(system(), period=PERIOD * (1.0 + late))
    times = PERIOD / 12 * np.arange(12 * 150)
    record = Record(
        values=model.response(times)[:, 0],
        sample_rate=12 / PERIOD,
        channels=model.channels,
        clock=ConstantPeriod(period=PERIOD),
    )
    responses = through(lift(segment([record]))).with_noise(np.full((2, 1), 1e-6))
    assert drift(system(), responses).relative == pytest.approx(late, rel=0.05)


def test_the_chain_in_coloured_noise():
    """Exponents within their deviations, the innovations found, the order not in doubt."""
    model = system(channels=3)
    found = identify(records(model, noise=0.05, colour=(-0.98,)), validate=False)
    assert found.lifted.whitening.shape[0] == 3
    assert found.model.order == 3
    assert not found.choice.ambiguous
    pairing = pair_exponents(found.model.exponents, model.exponents, PERIOD)
    std = found.model.exponent_std[pairing.permutation]
    assert (np.abs(pairing.differences.real) < 4.5 * std.real).all()
    assert (np.abs(pairing.differences.imag) < 4.5 * std.imag + 1e-12).all()
    assert_allclose(found.lifted.noise, 0.05, rtol=0.1)
    sign = synchrony(found.model, found.lifted)
    assert abs(sign.relative) < 4.5 * sign.std
    times = np.linspace(0.0, 30.0 * PERIOD, 200)
    scale = 0.05 / np.sqrt(1.0 - 0.98**2)
    assert np.abs(found.model.response(times) - model.response(times)).max() < scale


@pytest.mark.slow
def test_noise_that_wanders_beside_modes():
    """A random walk: its increments are white. What passes for a mode that hardly changes leaves the order in doubt."""
    model = system(channels=3)
    for seed in range(3):
        found = identify(records(model, noise=0.02, colour=(-1.0,), seed=seed))
        pairing = pair_exponents(found.model.exponents, model.exponents, PERIOD)
        std = found.model.exponent_std[pairing.permutation]
        assert (np.abs(pairing.differences.real) < 4.5 * std.real).all()
        others = np.delete(found.model.multipliers, pairing.permutation)
        assert len(others) <= 2
        assert_allclose(others, 1.0, atol=0.05)
        assert not len(others) or any("at a peak of the noise" in words for words in found.choice.doubts)


def test_what_is_scanned_is_whitened():
    model = system()
    assert lifted_of(records(model, noise=0.1, colour=(-0.9,))).whitening is not None
    assert lifted_of(records(model, noise=0.1)).whitening is None


@pytest.mark.slow
def test_the_filter_is_stored(tmp_path):
    found = identify(records(system(), noise=0.05, colour=(-0.9,)), noise_floor=1e-6)
    save(found, tmp_path / "r.h5")
    back = load(tmp_path / "r.h5")
    assert_array_equal(back.lifted.whitening, found.lifted.whitening)
    assert_array_equal(back.lifted.responses.values, found.lifted.responses.values)
    assert back.lifted.first_phase == found.lifted.first_phase
    assert_array_equal(back.lifted.noise, found.lifted.noise)
    assert_array_equal(back.lifted.floor, found.lifted.floor)


def two_hits(*, second=1.0, seed=0):
    """One system started in two ways: a mode has one shape, times one number a hit."""
    one = system(channels=3, seed=seed)
    shares = np.array([[1.0, 0.4 - 0.6j], [1.0, 0.4 + 0.6j], [1.0, -1.3]])
    shares[:, 1] *= second
    return replace(one, coefficients=one.coefficients * shares[:, None, :, None])


@pytest.mark.slow
def test_a_record_of_two_hits_in_coloured_noise():
    model = two_hits()
    pulls = []
    for seed in range(8):
        found = identify(records(model, noise=0.05, colour=(-0.95,), seed=seed))
        assert found.model.order == 3
        assert not found.choice.ambiguous
        pairing = pair_exponents(found.model.exponents, model.exponents, PERIOD)
        std = found.model.exponent_std[pairing.permutation]
        pulls.append(
            [(pairing.differences.real / std.real)[[0, 2]], (pairing.differences.imag[0] / std.imag[0]).repeat(2)]
        )
    assert 0.5 < np.sqrt(np.mean(np.square(pulls))) < 1.6


def test_colour_is_seen_in_any_hit():
    model = two_hits()
    white, coloured = records(model, noise=0.1)[0], records(model, noise=0.1, colour=(-0.9,))[1]
    taps = found_filter(lift(segment([white, coloured])), model)
    assert (taps[:, 1] < -0.2).all()


def test_the_shortest_filter_that_does_is_taken():
    model = system()
    assert found_filter(lifted(model, noise=0.1, colour=(-0.9,), n_cycles=100), model).shape == (2, 2)
    long = (-0.5, 0.0, 0.0, 0.0, 0.0, 0.45)
    assert found_filter(lifted(model, noise=0.1, colour=long, n_cycles=400), model).shape == (2, 9)


def test_colour_beside_a_pole_whose_powers_overflow():
    """A generous fit may hold one, with a residue of nothing."""
    model = system()
    raw = lifted(model, noise=0.1, colour=(-0.9,), n_cycles=800)
    generous = fit_residues(np.append(model.multipliers, 3.0), raw.responses)
    assert_allclose(whitening_filter(raw, generous)[:, 1], -0.9, atol=0.05)


def test_generous_poles_are_as_many_as_modes_at_least():
    """Ten pairs in white noise: what too few poles leave would look coloured."""
    generator = np.random.default_rng(0)
    upper = -0.03 + 1j * np.linspace(0.1, 0.45, 10) * 2.0 * np.pi / PERIOD
    shapes = generator.standard_normal((10, 2, 1, 3)) + 1j * generator.standard_normal((10, 2, 1, 3))
    model = PeriodicModel(
        exponents=np.stack([upper, upper.conj()], axis=1).ravel(),
        coefficients=np.stack([shapes, shapes[..., ::-1].conj()], axis=1).reshape(20, 2, 1, 3),
        harmonics=[-1, 0, 1],
        period=PERIOD,
        channels=["c0", "c1"],
    )
    assert first_filter(lifted(model, noise=0.05, n_cycles=200)) is None


def test_the_branch_is_that_of_the_record_and_not_of_the_filtered_responses():
    """The filter all but takes the largest harmonic away."""
    model = system()
    raw = lifted(model, noise=1e-6)
    delay, rate = PERIOD / 12, -0.03 + 1.1j
    turn = np.exp(rate * delay)
    notch = np.array([1.0, -2.0 * turn.real, abs(turn) ** 2])
    through = whitened(raw, np.stack([notch, notch]) + np.array([0.0, 0.0, 0.02]))
    back = assemble(fit_residues(model.multipliers, through.responses), through, harmonics=2)
    assert np.abs(back.exponents - rate).min() < 1e-6


def test_the_noise_floor_goes_through_the_filter():
    """What the record cannot be believed below: rounding is white, and a filter makes it √(Σ a²) times as large."""
    raw = lift(segment(records(system(), noise=1e-6, colour=(-0.99,))), floor=1e-4)
    through = whitened(raw, np.array([[1.0, -0.99], [1.0, -0.99]]))
    assert_allclose(through.noise, raw.noise * np.hypot(1.0, 0.99), rtol=1e-6)


@pytest.mark.slow
def test_a_narrow_peak_of_the_noise_is_no_mode_without_a_doubt():
    peak = (-2.0 * 0.999 * np.cos(0.14 * np.pi), 0.999**2)
    model, wrong = system(channels=3), 0
    for seed in range(5):
        found = identify(records(model, noise=2e-4, colour=peak, seed=seed))
        wrong += found.model.order != 3
        assert found.model.order == 3 or found.choice.ambiguous
    assert wrong, "every order was right: the doubt was not tried"


class ReachedError(Exception):
    """What is looked at has been reached."""


@pytest.mark.parametrize(("order", "kept"), [(24, 25), (23, 24)])
def test_an_order_that_needs_every_period_is_not_whitened(monkeypatch, order, kept):
    """The filter takes a period, of which an order must leave one.

    How such a search ends is not looked at: 24 poles all but fit 25 periods of noise, and rounding decides which they
    are, so that one processor finds them and another says that they cannot be reached or that the noise is not told.
    """

    def reached(lifted, *_):
        raise ReachedError(lifted)

    monkeypatch.setattr(_find_poles, "_settled", reached)
    with pytest.raises(ReachedError) as caught:
        identify(records(system(), noise=0.05, colour=(-0.95,), n_cycles=25), order=order)
    (lifted,) = caught.value.args
    assert lifted.responses.lengths.max() == kept
    assert (lifted.whitening is None) == (kept == 25)


@pytest.mark.first(1)
@pytest.mark.parametrize(
    ("order", "n_cycles", "words"),
    [
        (None, 25, "rounded to a few levels?"),
        (2, 25, "asked for, 2, too low?"),
        (3, 8, "asked for, 3, too high for 8 whole periods, which it all but fits?"),
    ],
)
def test_noise_that_does_not_settle_says_which_order_may_be_to_blame(monkeypatch, order, n_cycles, words):
    share = iter(np.geomspace(1.2, 2.0, 4))
    monkeypatch.setattr(_find_poles, "_noise_left", lambda lifted, *_, **__: lifted.noise * next(share))
    with pytest.raises(_find_poles.UnsettledError) as caught:
        _find_poles._settled(lifted(system(), noise=0.05, n_cycles=n_cycles), Settings(order=order), lambda _: None)
    assert str(caught.value).endswith(words)


@pytest.mark.first(1)
@pytest.mark.parametrize(
    ("first", "searches"),
    [(-0.86, 2), (-0.9, 1), (-0.4, 2), (None, 2)],
    ids=["one that is nearly", "a filter that is right", "one that leaves colour", "none"],
)
def test_the_noise_is_judged_again_by_what_the_poles_leave(monkeypatch, first, searches):
    model = system(channels=3)
    taps, count, settled = None if first is None else np.tile([1.0, first], (3, 1)), [], _find_poles._settled
    monkeypatch.setattr(_start, "without_forced", lambda lifted, *_: (lifted, Known(), taps))
    monkeypatch.setattr(_find_poles, "_settled", lambda *given: count.append(1) or settled(*given))
    found = identify(records(model, noise=0.05, colour=(-0.9,), n_cycles=300), validate=False)
    assert len(count) == searches
    assert_allclose(found.lifted.whitening[:, 1], -0.9, atol=0.02)
    assert found.model.order == 3
