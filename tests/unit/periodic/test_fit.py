"""The fit of records as they were sampled: exact without noise, within its deviations with it, whatever the record."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from floquid import ConstantPeriod, IdentificationError, InputError, Record
from floquid.findings import texts
from floquid.lifting import lift
from floquid.periodic import fit
from floquid.periodic.least_squares import LiftedBlock, ModeParameters, forced_entries, linearise, record_blocks
from floquid.sync import segment

PERIOD = 2.0
OMEGA = 2.0 * np.pi / PERIOD
EXPONENTS = np.array([-0.05 + 1.1j, -0.08 + 4.9j])
CHANNELS = ["a", "b"]


def shapes(seed=0, hits=1):
    """Coefficients (modes, channels, hits, harmonics -1 to 1)."""
    generator = np.random.default_rng(seed)
    found = generator.standard_normal((2, 2, hits, 3)) + 1j * generator.standard_normal((2, 2, hits, 3))
    return found * np.array([0.3, 1.0, 0.2])


def response(times, angles, coefficients, hit=0, exponents=EXPONENTS):
    """2 Re Σ B e^{λt + imθ} (channels, samples)."""
    columns = np.exp(np.multiply.outer(exponents, times))[:, None, :] * np.exp(
        1j * np.multiply.outer(np.arange(-1, 2), angles)
    )
    return 2.0 * np.einsum("rcm,rmn->cn", coefficients[:, :, hit], columns).real


def record(*, rate=20.3, n=1600, noise=0.0, start=0.0, hit=0, hits=1, forced=0.0, drift=0.0, seed=0):
    times = start + np.arange(n) / rate
    values = response(times - start, OMEGA * times, shapes(hits=hits), hit)
    values += forced * np.array([[1.0], [0.5]]) * np.cos(0.5 * OMEGA * times + 0.3) + 0.2 * forced + drift * times
    values += noise * np.random.default_rng(seed).standard_normal(values.shape)
    return Record(values=values, sample_rate=rate, channels=CHANNELS, start=start)


CLOCK = ConstantPeriod(period=PERIOD)


def pulls(model, exponents=EXPONENTS, *, std=None):
    """Errors over deviations, its own unless given, of the exponents, modulo iω."""
    found, std = [], model.exponent_std if std is None else std
    for value in exponents:
        gap = model.exponents - value
        gap = gap.real + 1j * (gap.imag - model.fundamental * np.rint(gap.imag / model.fundamental))
        k = int(np.argmin(np.abs(gap)))
        found += [gap[k].real / std[k].real, gap[k].imag / std[k].imag]
    return np.array(found)


@pytest.mark.parametrize("rate", [20.3, 17.0 * np.sqrt(2.0)])
def test_a_rate_out_of_step_is_no_matter(rate):
    found = fit([record(rate=rate, noise=0.02)], [CLOCK], forced="none")
    assert found.model.order == 4
    assert np.abs(pulls(found.model)).max() < 4.0
    assert found.noise == pytest.approx(0.02, rel=0.1)
    assert found.forced is None


@pytest.mark.slow
def test_deviations_are_those_of_repetition():
    every = [pulls(fit([record(noise=0.05, seed=seed)], [CLOCK], forced="none").model) for seed in range(12)]
    assert np.sqrt(np.mean(np.square(every))) == pytest.approx(1.0, abs=0.22)


def test_the_forced_response_is_fitted_beside_the_modes():
    found = fit([record(forced=5.0, drift=0.01, noise=0.02)], [CLOCK], periods_per_revolution=2.0)
    assert found.model.order == 4
    assert np.abs(pulls(found.model)).max() < 4.0
    forced = found.forced
    assert forced.harmonics.tolist() == [1]
    assert_allclose(forced.amplitudes[:, 0, 0], [5.0, 2.5], rtol=2e-3)
    assert_allclose(np.angle(forced.coefficients[:, 0, 0]), 0.3, atol=2e-3)
    assert_allclose(forced.drift, 0.01, rtol=0.05)
    assert forced.revolution == pytest.approx(2.0 * PERIOD)
    left = found.free[0].values - response(found.free[0].times, OMEGA * found.free[0].times, shapes())
    assert np.std(left) == pytest.approx(0.02, rel=0.1)


@pytest.mark.slow
def test_the_forced_response_subtracted_before_would_bend_the_modes():
    """The mutant that this way is there to avoid: a fit of the forced response alone, taken off first."""
    given = record(forced=5.0, noise=0.002)
    columns = [np.ones(given.n_samples), np.cos(0.5 * OMEGA * given.times), np.sin(0.5 * OMEGA * given.times)]
    columns = np.stack(columns, axis=1)
    values = given.values - (columns @ np.linalg.lstsq(columns, given.values.T, rcond=None)[0]).T
    bent = fit([replace(given, values=values)], [CLOCK], forced="none", order=4)
    joint = fit([given], [CLOCK], periods_per_revolution=2.0)
    assert np.abs(pulls(joint.model)).max() < 4.0
    # What is left of the forced response passes for noise, so errors are counted in deviations of the right fit.
    assert np.abs(pulls(bent.model, std=joint.model.exponent_std)).max() > 4.0


@pytest.mark.slow
def test_missing_samples_have_exact_weights():
    given = record(noise=0.02)
    values = np.array(given.values)
    values[0, 100:400] = np.nan
    values[1, 50:60] = np.nan
    values[:, 700:720] = np.nan
    found = fit([replace(given, values=values)], [CLOCK], forced="none")
    assert np.abs(pulls(found.model)).max() < 4.0
    # The mutant: zeros that count. Its noise is that of the zeros, so its errors are seen in deviations of the other.
    zeros = replace(given, values=np.nan_to_num(values))
    filled = fit([zeros], [CLOCK], start=ModeParameters.of(found.model), search=False, forced="none", order=4)
    assert np.abs(pulls(filled.model, std=found.model.exponent_std)).max() > 10.0
    blocks, fundamental, _ = record_blocks([replace(given, values=values)], [CLOCK], 1.0)
    assert sum(len(block.rows) * block.n_samples for block in blocks) == np.isfinite(values).sum()
    entries = ModeParameters.made(EXPONENTS, [(-1, 1)] * 2, fundamental)
    cost = sum(float(own.left.sum()) for own in linearise(blocks, entries).linear)
    assert cost == pytest.approx(0.02**2 * (np.isfinite(values).sum() - 24), rel=0.1)


def test_several_hits_start_at_any_phase_and_have_any_length():
    hits = [record(hit=0, hits=2, noise=0.02), record(hit=1, hits=2, start=0.77, n=1100, rate=23.1, noise=0.02, seed=1)]
    found = fit(hits, [CLOCK, CLOCK], forced="none")
    assert found.model.order == 4
    assert found.model.n_hits == 2
    assert np.abs(pulls(found.model)).max() < 4.0


@pytest.mark.slow
def test_a_free_period_comes_with_its_deviation():
    every = []
    for seed in range(6):
        given = [record(noise=0.05, seed=seed)]
        found = fit(given, [ConstantPeriod(period=PERIOD * (1.0 + 2e-4))], forced="none", free_period=True)
        every.append((found.model.period - PERIOD) / found.period_std)
    assert np.sqrt(np.mean(np.square(every))) == pytest.approx(1.0, abs=0.5)


@pytest.mark.slow
def test_it_says_when_the_period_is_another():
    off = 1e-3
    found = fit([record(noise=0.02)], [ConstantPeriod(period=PERIOD * (1.0 + off))], forced="none", order=4)
    relative, std = found.own_period
    assert relative < -6.0 * std
    right = fit([record(noise=0.02)], [CLOCK], forced="none")
    assert abs(right.own_period[0]) < 5.0 * right.own_period[1]


def test_a_real_multiplier_beside_a_pair():
    times = np.arange(1600) / 20.3
    values = response(times, OMEGA * times, shapes()[:1], exponents=EXPONENTS[:1])
    half = np.cos(0.5 * OMEGA * times + 0.7) + 0.4 * np.cos(1.5 * OMEGA * times)
    values += np.exp(-0.06 * times) * half * np.array([[1.0], [-0.4]])
    values += 0.01 * np.random.default_rng(0).standard_normal(values.shape)
    found = fit([Record(values=values, sample_rate=20.3, channels=CHANNELS)], [CLOCK], forced="none").model
    assert found.order == 3
    alone = [value for value in found.multipliers if abs(value.imag) < 1e-9 * abs(value)]
    assert alone[0].real == pytest.approx(-np.exp(-0.06 * PERIOD), rel=5e-3)


def test_noise_alone_has_no_mode():
    for seed in range(5):
        values = np.random.default_rng(seed).standard_normal((2, 800))
        with pytest.raises(IdentificationError, match="no mode rises"):
            fit([Record(values=values, sample_rate=20.0, channels=CHANNELS)], [CLOCK])


def coloured(given, share, *, seed):
    """The record with noise of 0.05, each sample of it `share` of the one before and something new."""
    from scipy.signal import lfilter

    white = np.random.default_rng(seed).standard_normal((2, given.n_samples + 200))
    noise = lfilter([np.sqrt(1.0 - share**2)], [1.0, -share], white, axis=1)[:, 200:]
    return replace(given, values=given.values + 0.05 * noise)


@pytest.mark.slow
@pytest.mark.parametrize("seeds", [range(3), range(8)])
def test_noise_that_is_coloured_along_the_record_is_whitened(seeds):
    scores = []
    for seed in seeds:
        found = fit([coloured(record(n=1000), 0.9, seed=seed)], [CLOCK], forced="none")
        assert found.model.order == 4
        assert found.whitening is not None
        assert found.noise == pytest.approx(0.05 * np.sqrt(1.0 - 0.9**2), rel=0.15)
        assert not any("noise is not white: about" in doubt for doubt in texts(found.findings, "warning"))
        scores.append(pulls(found.model))
    assert np.abs(scores).max() < 4.5
    assert 0.7 < np.sqrt(np.mean(np.square(scores))) < 1.4


def test_noise_that_is_coloured_and_not_whitened_is_named():
    """Without a search the noise is taken for white."""
    start = ModeParameters.made(EXPONENTS, [(-1, 1)] * 2, OMEGA)
    for seed in range(2):
        given = coloured(record(n=1000), 0.9, seed=seed)
        found = fit([given], [CLOCK], start=start, search=False, forced="none")
        assert found.whitening is None
        assert any("noise is not white: about" in doubt for doubt in texts(found.findings, "warning"))


@pytest.mark.slow
def test_white_noise_is_not_called_coloured():
    """In the lowest band of this record hardly a line is apart from the exponentials, which take its noise away."""
    for seed in range(20):
        doubts = fit([coloured(record(n=500), 0.0, seed=seed)], [CLOCK], forced="none").findings
        assert not any(own.code == "coloured_noise" for own in doubts)
    assert texts(fit([record(n=500)], [CLOCK], forced="none").findings, "warning") == ()


@pytest.mark.first(1)
@pytest.mark.parametrize("n", [500, 1600])
@pytest.mark.parametrize("noise", [0.0, 1e-6, 1e-3])
def test_hardly_any_noise(n, noise):
    """Far from a loud mode its own skirts are loud beside the noise: they are no mode, and hide none."""
    model = fit([record(n=n, noise=noise)], [CLOCK], forced="none").model
    assert model.order == 4
    if noise:
        assert np.abs(pulls(model)).max() < 4.0
    gap = model.exponents[:, None] - EXPONENTS
    gap = gap.real + 1j * (gap.imag - OMEGA * np.rint(gap.imag / OMEGA))
    assert np.abs(gap).min(axis=0).max() < 1e-9 + 0.1 * noise


def test_a_search_that_ends_but_for_its_limit_says_so(monkeypatch):
    monkeypatch.setattr("floquid.periodic._fit_records.MODES", 2)
    given, others = record(n=500, noise=0.01), np.array([-0.06 + 2.6j, -0.07 + 7.3j])
    more = response(given.times, OMEGA * given.times, shapes(seed=3), exponents=others)
    found = fit([replace(given, values=given.values + more)], [CLOCK], forced="none")
    doubts = texts(found.findings, "warning")
    assert any("ended at 2 modes, its limit" in doubt for doubt in doubts)
    assert any("peak of the residual" in doubt and "is not explained" in doubt for doubt in doubts)
    monkeypatch.setattr("floquid.periodic._fit_records.MODES", 3)
    right = fit([coloured(record(n=500), 0.0, seed=0)], [CLOCK], forced="none")
    assert not any(own.code == "search_ended" for own in right.findings)


@pytest.mark.parametrize("samples", [15, 16])
def test_a_mode_of_as_many_harmonics_as_a_period_has_samples_is_one(samples):
    """As after a blow once a period: it begins as two, each with the harmonics of one side."""
    generator, harmonics = np.random.default_rng(4), np.arange(-(samples // 2), (samples + 1) // 2)
    times, exponent = PERIOD / samples * np.arange(120 * samples), -0.02 + 0.69j * OMEGA
    shape = generator.standard_normal((2, samples)) + 1j * generator.standard_normal((2, samples))
    values = 2.0 * (shape @ np.exp(np.multiply.outer(exponent + 1j * OMEGA * harmonics, times))).real
    values += 0.05 * generator.standard_normal(values.shape)
    given = Record(values=values, sample_rate=samples / PERIOD, channels=CHANNELS)
    model = fit([given], [CLOCK], forced="none").model
    assert model.order == 2
    assert np.abs(pulls(model, [exponent])).max() < 4.0


@pytest.mark.slow
def test_times_far_from_zero_lose_no_digits():
    """Where time itself is known to 0.1 ms only, samples are as far apart as ever."""
    here = record(n=300, noise=1e-3)
    far = replace(here, start=1e12 * PERIOD)
    one, other = (fit([own], [CLOCK], forced="none").model for own in (here, far))
    assert_allclose(other.exponents, one.exponents, atol=1e-9)


def test_the_two_kinds_of_blocks_have_the_same_sums():
    """Lifted responses and the record that they are lifted from, a growing mode and a half-turn among the entries."""
    given = replace(record(rate=8.0, noise=0.1, n=480), clock=CLOCK)
    lifted = lift(segment(given))
    blocks, fundamental, _ = record_blocks([given], [CLOCK], 1.0)
    entries = ModeParameters.made([-0.05 + 1.1j, 0.02 + 2.3j], [(-1, 1), (0, 2)], fundamental)
    entries = entries.joined(ModeParameters.made([-0.03], [(0, 1)], fundamental, real=True, offsets=0.5))
    entries = entries.joined(forced_entries([0.0, 0.5], fundamental))
    one = linearise(blocks, entries)
    other = linearise([replace(block, noise=np.ones(2)) for block in LiftedBlock.all_of(lifted)], entries)
    assert one.cost == pytest.approx(other.cost, rel=1e-9)
    assert_allclose(one.gradient, other.gradient, rtol=1e-6, atol=1e-6 * np.abs(one.gradient).max())
    assert_allclose(one.gauss_newton, other.gauss_newton, rtol=1e-6, atol=1e-9 * np.abs(one.gauss_newton).max())


def test_an_order_that_cannot_be_reached_is_said():
    with pytest.raises(IdentificationError, match="order 40 cannot be reached"):
        fit([record(noise=0.05, n=800)], [CLOCK], forced="none", order=40)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"forced": "all"}, "auto, none or a list"),
        ({"forced": (99,)}, "what the sampling shows"),
        ({"clocks": []}, "one clock a record"),
        ({"clocks": [ConstantPeriod(period=0.05)]}, "two sampling intervals"),
    ],
)
def test_what_is_refused(changes, words):
    arguments = {"clocks": [CLOCK], "forced": "auto"} | changes
    with pytest.raises(InputError, match=words):
        fit([record()], arguments.pop("clocks"), **arguments)


def test_coefficients_from_afar_lose_no_digits():
    """Of a record with hardly any noise, what is left is as exact from coefficients of zero as from near ones."""
    given = record(n=500, noise=1e-10)
    blocks, fundamental, _ = record_blocks([given], [CLOCK], 1.0)
    entries = ModeParameters.made(EXPONENTS, [(-1, 1)] * 2, fundamental)
    near = linearise(blocks, entries)
    afar = linearise(blocks, entries, tuple(np.zeros_like(own.coefficients) for own in near.linear))
    for one, other in zip(near.linear, afar.linear, strict=True):
        np.testing.assert_allclose(other.left, one.left, rtol=1e-6)
