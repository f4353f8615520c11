"""The parametric bootstrap: draws, their spread against the deviations of the fit, and the verdict."""

import dataclasses
import functools
import os
import signal
import subprocess
import sys
import textwrap
import warnings

import numpy as np
import pytest
import scipy.stats
from numpy.random import SeedSequence, default_rng
from numpy.testing import assert_allclose, assert_array_equal
from tests.decays import with_decay

import floquid
from floquid.core import PeriodicModel
from floquid.errors import IdentificationError, InputError
from floquid.lti import ERA
from floquid.periodic import refit
from floquid.pipeline import Spread, bootstrap, identify
from floquid.pipeline.draws import _redraw as draws_of
from floquid.pipeline.draws._plan import aligned
from floquid.pipeline.draws._redraw import draw, drawn, noisy, plan_of
from floquid.reconstruction import reconstruct, text_of
from floquid.systems import JeffcottRotor

DRAWS = 60


def record(*, periods=150, samples=12, noise=0.02, seed=1, **options):
    return JeffcottRotor().simulate(n_periods=periods, samples_per_period=samples, noise=noise, seed=seed, **options)


def with_gaps(whole):
    values = whole.values.copy()
    values[:, 500:560] = np.nan
    values[1, 900:930] = np.nan
    return dataclasses.replace(whole, values=values)


def coloured(seed=2):
    """An autoregression along the record, its root 0.8, of the size of 3 % white noise."""
    clean, generator = record(periods=300, noise=0.0), default_rng(seed)
    size = 0.03 * np.abs(clean.values).max(axis=1, keepdims=True) * np.sqrt(1.0 - 0.8**2)
    noise = size * generator.standard_normal(clean.values.shape)
    for n in range(1, noise.shape[1]):
        noise[:, n] += 0.8 * noise[:, n - 1]
    return dataclasses.replace(clean, values=clean.values + noise)


def with_tachometer(whole):
    """A pulse a period in a channel between the others, samples out of step with it, and an imbalance."""
    times = np.arange(whole.n_samples) / whole.sample_rate
    period = 2.0 * np.pi
    # Edges of two samples: the angle is measured.
    pulses = 5.0 * np.clip(0.5 + 20.0 * (0.05 - np.abs((times / period + 0.46) % 1.0 - 0.5)), 0.0, 1.0)
    turning = 0.5 * np.abs(whole.values).max() * np.cos(2.0 * np.pi * times / period)
    values = np.insert(whole.values + turning, 1, pulses, axis=0)
    channels = [*whole.channels[:1], "tach", *whole.channels[1:]]
    return floquid.Record(values=values, sample_rate=whole.sample_rate, channels=channels)


@functools.cache
def analysis(name):
    """An identification by each of the ways that records are fitted."""
    options = {"states": ["X", "Y"], "system_times": 5, "validate": False}
    if name == "two hits":
        return identify([record(seed=3), record(periods=120, noise=0.05, seed=4, impulse_deg=10.0)], **options)
    if name == "gaps":
        return identify(with_gaps(record()), **options)
    if name == "tachometer":
        return identify(with_tachometer(record(samples=40)), tach="tach", **options)
    if name == "coloured":
        return identify(coloured(), **options)
    if name == "free residues":
        return identify(record(), constrained=False, **options)
    if name == "refined":
        return identify(record(), structure="stiffness 2 symmetric; damping 0", **options)
    if name == "output error":
        return identify(record(), structure="auto", output_error=True, **options)
    if name == "output error as given":
        return identify(record(), structure="stiffness 1 symmetric; damping 0", output_error=True, **options)
    if name == "refined with gaps":
        return identify(with_gaps(record()), structure="stiffness 1 symmetric; damping 0", output_error=True, **options)
    if name == "first-order":
        return identify(record(), **options | {"states": ["X", "Y", "X_tt", "Y_tt"], "form": "first-order"})
    if name == "own period":
        return identify(record(periods=60), estimate_period=True, period=2.0 * np.pi * 1.01, **options)
    if name == "no deviations":
        return identify(record(), identifier=ERA(), order=4, harmonics=2, **options)
    return identify(record(), **options)


@functools.cache
def found(name, **options):
    return bootstrap(analysis(name), draws=DRAWS, seed=5, workers=1, **options)


def drawn_once(plan, seed):
    return draw(plan, seed)


WAYS = ["lifted", "two hits", "gaps", "tachometer", "coloured", "free residues", "own period"]
STRUCTURED = ["refined", "output error as given", "refined with gaps"]


# Draws.


@pytest.mark.first(1)
@pytest.mark.parametrize("name", ["lifted", "two hits", "gaps", "tachometer"])
def test_what_is_drawn_from_is_what_the_model_makes_of_the_record(name):
    """The records less it are noise, of the size that was found: the samples are those of the record."""
    whole = analysis(name)
    plan = plan_of(whole, False)
    for hit, (own, clean) in enumerate(zip(whole.fit.free, plan.clean, strict=True)):
        assert_array_equal(np.isnan(own.values), np.isnan(clean))
        left = np.sqrt(np.nanmean((own.values - clean) ** 2, axis=1))
        assert_allclose(left, whole.noise[:, hit], rtol=0.1)


def test_white_noise_is_as_large_as_said():
    plan = plan_of(analysis("two hits"), False)
    values = noisy(plan, default_rng(0))
    for hit, (own, clean) in enumerate(zip(values, plan.clean, strict=True)):
        assert_allclose((own - clean).std(axis=1), plan.noise[:, hit], rtol=0.06)
    both = np.corrcoef(np.concatenate([values[0] - plan.clean[0], (values[0] - plan.clean[0])[:, ::-1]]))
    assert np.abs(both - np.eye(len(both))).max() < 0.1


def test_coloured_noise_is_whitened_by_the_filter():
    plan = plan_of(analysis("coloured"), False)
    (values,) = noisy(plan, default_rng(0))
    for row, (taps, noise) in enumerate(zip(plan.lifted.whitening, values - plan.clean[0], strict=True)):
        assert np.corrcoef(noise[1:], noise[:-1])[0, 1] == pytest.approx(0.8, abs=0.06)
        white = np.convolve(noise, taps, mode="valid")
        assert white.std() == pytest.approx(plan.noise[row, 0], rel=0.05)
        assert abs(np.corrcoef(white[1:], white[:-1])[0, 1]) < 0.06


def test_coloured_noise_is_there_from_the_first_sample_on():
    plan = plan_of(analysis("coloured"), False)
    short = dataclasses.replace(plan, clean=(plan.clean[0][:, :200],))
    generator = default_rng(0)
    begins = np.array([(noisy(short, generator)[0] - short.clean[0])[:, [0, -1]] for _ in range(400)])
    first, last = begins.std(axis=0).T
    assert_allclose(first, last, rtol=0.2)
    assert (first > 1.3 * plan.noise[:, 0]).all()


def test_modes_are_paired_whatever_their_order_and_branch():
    model = dataclasses.replace(analysis("lifted").model, estimates=None, unselected=None)
    order, by = [2, 0, 3, 1], np.array([1, 0, -1, 0])
    wide = np.arange(-4, 5)
    coefficients = np.zeros((4, *model.coefficients.shape[1:3], 9), complex)
    for mode in range(4):
        coefficients[mode][..., model.harmonics + by[mode] + 4] = model.coefficients[mode]
    other = PeriodicModel(
        exponents=(model.exponents - 1j * model.fundamental * by)[order] + 1e-4,
        coefficients=coefficients[order],
        harmonics=wide,
        period=model.period,
        channels=model.channels,
    )
    exponents, placed = aligned(model, other)
    assert_allclose(exponents, model.exponents + 1e-4, rtol=1e-12)
    assert_array_equal(placed, model.coefficients)


def test_the_quick_fit_and_that_of_lifted_responses_are_the_same():
    plan = plan_of(analysis("two hits"), False)
    quick = drawn_once(plan, SeedSequence(3))
    bands = (plan.fitted.coefficients != 0).any(axis=(0, 1, 2))
    assert bands.sum() > (plan.model.coefficients != 0).any(axis=(0, 1, 2)).sum()
    drawn_ones = zip(plan.records, noisy(plan, default_rng(SeedSequence(3))), strict=True)
    records = [dataclasses.replace(like, values=values) for like, values in drawn_ones]
    lifted = draws_of._lifted(plan.lifted, plan.settings, records)
    held = refit(plan.fitted, lifted=lifted, one_shape=plan.one_shape)
    assert_allclose(quick.exponents, held.exponents, rtol=1e-9)


@pytest.mark.first(3)
@pytest.mark.parametrize("name", [*WAYS, *STRUCTURED, "first-order", "no deviations"])
def test_without_noise_a_draw_gives_the_analysis_back(name):
    """Modes, coefficients and A(t): what is done to a draw is what was done to the record."""
    whole = analysis(name)
    plan = plan_of(whole, False)
    one = draws_of._fitted(plan, plan.clean)
    std = whole.model.exponent_std
    assert_allclose(one.exponents, whole.model.exponents, atol=1e-3 * np.abs(std).max() if std is not None else 1e-9)
    assert_allclose(one.coefficients, whole.model.coefficients, atol=1e-6 * np.abs(whole.model.coefficients).max())
    for part in ("system", "transition"):
        # A structure is fitted to harmonics beyond those that are drawn from: what these say is noise alone.
        near = 0.2 * getattr(whole.state, f"{part}_std").max() if name in STRUCTURED else 1e-9
        assert_allclose(getattr(one, part), getattr(whole.state, part), atol=near)


# The spread against what was said of it.


@pytest.mark.first(1)
@pytest.mark.parametrize("name", WAYS)
def test_the_deviations_of_a_right_fit_hold(name):
    checked = found(name)
    assert checked.n_used == checked.n_draws == DRAWS
    assert checked.holds
    assert checked.doubtful == {}
    assert checked.reasons[0].startswith("The asymptotic deviations hold: ")
    assert all("exceed the spread of the draws for" in reason for reason in checked.reasons[1:])
    if name != "own period":
        assert_allclose(checked.multipliers.draws, np.exp(checked.exponents.draws * analysis(name).model.period))
    named = {spread.name for spread in checked.quantities if len(spread.ratios())}
    assert {"exponents", "frequencies_hz", "damping_ratios", "coefficients", "multipliers"} <= named
    assert checked.system.draws.shape == (DRAWS, 5, 4, 4)
    # Of 60 draws a ratio is known to 9 %.
    assert np.median(checked.coefficients.ratios()) == pytest.approx(1.0, abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("name", STRUCTURED)
def test_a_t_with_a_structure_has_deviations_that_hold(name):
    checked = found(name)
    assert checked.n_used == checked.n_draws == DRAWS  # though some of them would be refused
    assert checked.holds
    assert len(checked.reasons) == 1
    for spread in (checked.system, checked.transition):
        assert not spread.bound
        assert np.median(spread.ratios()) == pytest.approx(1.0, abs=0.12)
    assert len(checked.system.ratios()) == 5 * 8  # the velocities' rows are what they are by definition


@pytest.mark.slow
def test_the_free_a_t_is_the_same_to_first_order_but_for_the_harmonics_left_out():
    """Its deviations are an upper bound: noise alone does a quarter of them here, and they are said to be one."""
    checked = found("lifted")
    assert checked.system.bound
    assert checked.transition.bound
    assert len(checked.system.ratios()) == 5 * 8
    assert 0.15 < np.median(checked.system.ratios()) < 0.5
    (said,) = checked.reasons[1:]
    median = 1.0 / np.median(checked.system.ratios())
    assert f"A(t) ({median:.2f} times, median)" in said
    assert "they also count parts that the model leaves out" in said


@pytest.mark.slow
@pytest.mark.parametrize(("name", "word", "share"), [("lifted", "A(t)", 0.1), ("refined", "A(t)", 0.4)])
def test_deviations_of_a_t_said_too_small_are_found(name, word, share):
    """Those of the free A(t) count harmonics left out, too, and hold until they are a tenth."""
    whole = analysis(name)
    wrong = dataclasses.replace(whole.state, system_std=share * whole.state.system_std)
    checked = bootstrap(dataclasses.replace(whole, state=wrong), draws=DRAWS, seed=5, workers=1)
    assert list(checked.doubtful) == ["system"]
    assert checked.holds is False
    assert f"deviations are wrong for {word} (" in checked.reasons[0]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "holds"), [("lifted", True), ("refined", False)])
def test_deviations_of_a_t_said_too_large_are_a_fault_only_with_a_structure(name, holds):
    whole = analysis(name)
    wrong = dataclasses.replace(whole.state, system_std=2.5 * whole.state.system_std)
    checked = bootstrap(dataclasses.replace(whole, state=wrong), draws=DRAWS, seed=5, workers=1)
    assert checked.holds is holds
    said = " ".join(checked.reasons)
    assert ("exceed the spread of the draws" in said) == holds


@pytest.mark.slow
def test_the_harmonics_of_a_t_and_the_delay_are_held():
    """A fifth of the draws would choose others for the free A(t), and each draw another delay."""
    for name, settings in (("lifted", {}), ("delayed", {"states": ["X"], "form": "delayed"})):
        whole = (
            analysis("lifted") if name == "lifted" else identify(record(), validate=False, system_times=5, **settings)
        )
        plan = plan_of(whole, False)
        state = reconstruct(whole.model, plan.settings.states, form=plan.settings.form, times=5)
        own = dataclasses.replace(plan.built, estimates=None)
        again = reconstruct(own, plan.settings.states, form=plan.settings.form, delay=plan.settings.delay, times=5)
        assert_allclose(again.system, state.system, atol=1e-9)
        several = [drawn_once(plan, seed) for seed in SeedSequence(3).spawn(5)]
        assert [one.failure for one in several] == [""] * 5
        assert plan.states == whole.state.states
    assert plan.settings.delay > 0.0
    assert whole.settings.delay is None


def test_states_that_come_out_otherwise_are_a_failure():
    plan = dataclasses.replace(plan_of(analysis("lifted"), False), states=("X", "Y", "d/dt X", "d/dt Z"))
    failure = drawn_once(plan, SeedSequence(0)).failure
    assert failure == "The states of A(t) came out as X, Y, d/dt X, d/dt Y, and not as X, Y, d/dt X, d/dt Z."


@pytest.mark.slow
def test_a_structure_that_was_found_is_held():
    whole = analysis("output error")
    assert whole.settings.structure == "auto"
    assert plan_of(whole, False).settings.structure == text_of(whole.refinement.structure)


@pytest.mark.slow
def test_the_bootstrap_of_a_loaded_result_with_a_structure(tmp_path):
    floquid.save(analysis("refined"), tmp_path / "result.h5")
    checked = bootstrap(floquid.load(tmp_path / "result.h5"), draws=20, seed=5, workers=1)
    assert checked.holds
    # Noise and whitening are found again from the records when a file is read.
    assert_allclose(checked.system.draws, found("refined").system.draws[:20], atol=1e-3)


@pytest.mark.first(1)
@pytest.mark.parametrize(("factor", "word"), [(4.0, "0.2"), (0.25, "4")])
def test_wrong_deviations_are_found(factor, word):
    model = analysis("lifted").model
    wrong = dataclasses.replace(model, covariance=model.covariance * factor**2)
    checked = bootstrap(dataclasses.replace(analysis("lifted"), model=wrong), draws=20, seed=5, workers=1)
    assert checked.holds is False
    assert set(checked.doubtful) == {"exponents", "multipliers", "frequencies_hz", "damping_ratios"}
    assert "are wrong for exponents (4 of 4 elements" in checked.reasons[0]
    assert "They hold for Fourier coefficients, A(t), Φ(t, t0)." in checked.reasons[0]
    right = dataclasses.replace(found("lifted").exponents, draws=found("lifted").exponents.draws[:20])
    assert_allclose(checked.exponents.ratio.real, right.ratio.real / factor, rtol=1e-9)
    assert word in checked.reasons[0]


@pytest.mark.slow
def test_coefficients_said_too_small_are_found_alone():
    model = analysis("lifted").model
    wrong = dataclasses.replace(model, coefficient_std=0.3 * model.coefficient_std)
    checked = bootstrap(dataclasses.replace(analysis("lifted"), model=wrong), draws=DRAWS, seed=5, workers=1)
    assert list(checked.doubtful) == ["coefficients"]


def test_a_bias_is_named():
    checked = found("lifted")
    moved = dataclasses.replace(
        checked.damping_ratios, draws=checked.damping_ratios.draws + 2.0 * checked.damping_ratios.std
    )
    assert not any("bias" in reason for reason in checked.reasons)
    (sentence,) = [r for r in dataclasses.replace(checked, damping_ratios=moved).reasons if "bias" in r]
    assert sentence.startswith("The estimates are biased: damping ratios (2 of 2 elements, up to 2")


def test_without_asymptotic_deviations_the_draws_are_all_there_is():
    checked = bootstrap(analysis("no deviations"), draws=20, seed=5, workers=1)
    assert checked.holds is None
    assert checked.exponents.ratio is None
    assert "no asymptotic deviations" in checked.reasons[0]
    # ERA is near the bound here, and cannot be below it but by chance.
    assert_allclose(checked.exponents.std.real, analysis("lifted").model.exponent_std.real, rtol=0.8)


@pytest.mark.slow
def test_the_bootstrap_of_a_loaded_result(tmp_path):
    floquid.save(analysis("lifted"), tmp_path / "result.h5")
    checked = bootstrap(floquid.load(tmp_path / "result.h5"), draws=DRAWS, seed=5, workers=1)
    assert checked.holds
    assert_allclose(checked.exponents.std.real, found("lifted").exponents.std.real, rtol=0.05)


# The numbers of one quantity.


def spread_of(values, estimate, asymptotic=None, distinct=True):
    return Spread(
        name="thing", unit="-", estimate=estimate, draws=values, asymptotic=asymptotic, distinct=np.array(distinct)
    )


def test_real_numbers():
    values = default_rng(0).standard_normal((500, 3)) * [1.0, 2.0, 3.0] + [0.0, 0.0, 1.0]
    thing = spread_of(values, np.zeros(3), np.array([1.0, 1.0, 0.0]))
    assert_allclose(thing.std, values.std(axis=0, ddof=1))
    assert_allclose(thing.bias, values.mean(axis=0))
    assert_allclose(thing.ratio[:2], thing.std[:2])
    assert np.isnan(thing.ratio[2])
    assert_allclose(thing.interval(0.9), np.quantile(values, [0.05, 0.95], axis=0))
    assert thing.sampling_error == pytest.approx(1.0 / np.sqrt(2 * 499))
    one, two = thing.chances()
    assert one > 0.05
    assert two < 1e-12
    # The chance is the two-sided one of the chi-square distribution.
    score = 499 * thing.ratios()[0] ** 2
    tail = scipy.stats.chi2(499)
    assert one == pytest.approx(2.0 * min(tail.cdf(score), tail.sf(score)))


def test_complex_numbers_are_two_real_ones():
    generator = default_rng(0)
    values = generator.standard_normal((400, 2)) + 5j * generator.standard_normal((400, 2))
    thing = spread_of(values, np.zeros(2, complex), np.array([1.0 + 5.0j, 1.0 + 1.0j]))
    assert_allclose(thing.std.imag, values.imag.std(axis=0, ddof=1))
    assert_allclose(thing.ratio.real, values.real.std(axis=0, ddof=1))
    assert thing.ratio[0].imag == pytest.approx(1.0, abs=0.1)
    assert thing.ratio[1].imag == pytest.approx(5.0, abs=0.5)
    assert thing.interval()[1].imag == pytest.approx(1.96 * 5.0 * np.ones(2), rel=0.15)
    assert len(thing.ratios()) == 4
    alone = spread_of(values, np.zeros(2, complex), np.array([1.0 + 5.0j, 1.0 + 1.0j]), [True, False])
    assert_allclose(alone.ratios(), thing.ratios()[:2])


def test_chances_are_chances():
    """Over many quantities that spread as said, they are spread evenly between zero and one."""
    values = default_rng(3).standard_normal((50, 2000))
    chances = spread_of(values, np.zeros(2000), np.ones(2000)).chances()
    assert scipy.stats.kstest(chances, "uniform").pvalue > 0.01


def test_of_a_bound_the_distance_from_the_estimate_counts_and_only_upwards():
    values = np.add(default_rng(4).standard_normal((400, 3)), [0.0, 2.0, 0.0])
    thing = dataclasses.replace(spread_of(values, np.zeros(3), np.array([1.0, 1.0, 3.0])), bound=True)
    expected = np.sqrt(np.mean(values**2, axis=0)) / [1.0, 1.0, 3.0]
    assert_allclose(thing.ratio, expected)
    assert_allclose(thing.ratios(), expected)
    right, moved, large = thing.chances()
    assert right > 0.01
    assert moved < 1e-12
    assert large > 0.999
    assert right == pytest.approx(scipy.stats.chi2(400).sf(400 * expected[0] ** 2))
    assert thing.spare()[2] < 1e-12
    assert thing.spare()[0] == pytest.approx(1.0 - right)


@pytest.mark.parametrize("level", [0.0, 1.0, -1.0, 2.0])
def test_a_level_that_is_none_is_refused(level):
    with pytest.raises(InputError, match=r"`level` of `Spread.interval` must lie between 0 and 1"):
        found("lifted").exponents.interval(level)


# Workers.


@pytest.mark.slow
def test_the_numbers_do_not_depend_on_the_workers():
    told = []
    one = bootstrap(analysis("lifted"), draws=20, seed=7, workers=1, report=told.append)
    two = bootstrap(analysis("lifted"), draws=20, seed=7, workers=2, progress=True)
    for left, right in zip(one.quantities, two.quantities, strict=True):
        assert_array_equal(left.draws, right.draws)
    assert told == [f"drawing: {n} of 20" for n in range(21)]


@pytest.mark.slow
def test_more_draws_begin_with_the_same_and_another_seed_is_another():
    short, other = (bootstrap(analysis("lifted"), draws=20, seed=seed, workers=1) for seed in (5, 6))
    assert_array_equal(short.exponents.draws, found("lifted").exponents.draws[:20])
    assert np.abs(short.exponents.draws - other.exponents.draws).min() > 0.0


class Deadly:
    """Ends the process that unpickles it."""

    def __reduce__(self):
        return os._exit, (3,)


@pytest.mark.kill
def test_a_worker_that_dies_is_said():
    with pytest.raises(InputError, match=r"one of them ended before its time.\n .*`workers=1`"):
        list(drawn(Deadly(), SeedSequence(0).spawn(4), 2))


def test_what_cannot_be_sent_to_a_worker_is_said():
    with pytest.raises(InputError, match="cannot be sent to another"):
        list(drawn(lambda: None, SeedSequence(0).spawn(4), 2))


SCRIPT = """
    import signal
    from floquid import bootstrap, identify
    from floquid.systems import JeffcottRotor

    if __name__ == "__main__":
        signal.signal(signal.SIGINT, signal.default_int_handler)
        record = JeffcottRotor().simulate(n_periods=100, samples_per_period=12, noise=0.02, seed=1)
        try:
            bootstrap(identify(record), draws=100_000, workers=2, report=lambda words: print(words, flush=True))
        except KeyboardInterrupt:
            print("\\ninterrupted", flush=True)
"""


@pytest.mark.kill
def test_an_interrupt_ends_it_and_leaves_no_process(tmp_path):
    script = tmp_path / "long.py"
    script.write_text(textwrap.dedent(SCRIPT), encoding="utf-8")
    with subprocess.Popen(
        [sys.executable, str(script)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        while "drawing: 3 of" not in process.stdout.readline():
            assert process.poll() is None
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to all of them
        # Ends when the last process that may write is gone: the workers, too.
        said, wrong = process.communicate()
        assert said.splitlines()[-1] == "interrupted"
        assert wrong == ""


# Draws that fail, and draws identified from the beginning.


def louder(found, factor):
    """The same result with so much more noise to draw."""
    noise = factor * found.noise
    return with_decay(found, fit=dataclasses.replace(found.fit, noise=noise), lifted=found.lifted.with_noise(noise))


@pytest.mark.slow
def test_draws_that_fail_are_counted_and_said():
    loud = louder(analysis("lifted"), 300.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of numbers that run away
        checked = bootstrap(loud, draws=40, seed=5, workers=1)
    assert 0 < len(checked.failures) < 38
    assert checked.n_used + len(checked.failures) == checked.n_draws == 40
    assert (checked.orders == 0).sum() == len(checked.failures)
    assert checked.failure_counts[0][1] == len(checked.failures) > 1  # they differ in a number alone
    (sentence,) = [reason for reason in checked.reasons if "failed" in reason]
    assert sentence.startswith(f"{len(checked.failures)} of 40 draws failed, so the spread may be too")
    assert f" {len(checked.failures)}: The fit with shared harmonics moves an exponent" in sentence


def test_when_none_succeeds_that_is_an_error(monkeypatch):
    def refuse(*_, **__):
        raise IdentificationError("No such thing.\n  At all.")

    monkeypatch.setattr(draws_of, "refit", refuse)
    with pytest.raises(IdentificationError, match=r"Of 20 records drawn from the model, 0 gave .* No such thing\."):
        bootstrap(analysis("lifted"), draws=20, workers=1)


def test_a_mistake_of_ours_is_no_failed_draw(monkeypatch):
    def wrong(*_, **__):
        raise TypeError("a mistake")

    monkeypatch.setattr(draws_of, "refit", wrong)
    with pytest.raises(TypeError, match="a mistake"):
        bootstrap(analysis("lifted"), draws=20, workers=1)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["lifted", "two hits", "coloured"])
def test_the_whole_identification_again(name):
    checked = bootstrap(analysis(name), draws=20, seed=5, workers=1, whole=True)
    assert checked.whole
    assert (checked.orders == 4).sum() == checked.n_used >= 19
    assert checked.reasons[-1].startswith(f"{checked.n_used} of 20 draws gave the same order. Orders: 4 in ")
    ratio = np.sqrt(np.mean(checked.exponents.ratios() ** 2))
    assert ratio == pytest.approx(1.0, abs=0.35)
    assert checked.system.draws.shape == (checked.n_used, 5, 4, 4)


@pytest.mark.slow
def test_the_whole_again_has_clock_and_forced_response_as_they_were():
    """Noise alone is anew: the pulses stay, and what was forced is there to be found again."""
    whole = analysis("tachometer")
    assert len(whole.fit.forced.harmonics)
    plan = plan_of(whole, True)
    (rows,) = plan.rows
    assert rows == (0, 2, 3, 4)
    left = whole.records[0].values[list(rows)] - plan.clean[0]
    assert_allclose(left.std(axis=1), whole.noise[:, 0], rtol=0.1)
    one = drawn_once(plan, SeedSequence(0))
    off = (one.exponents - whole.model.exponents) / whole.model.exponent_std.real
    assert 0.1 < np.abs(off).max() < 6.0


@pytest.mark.slow
def test_a_draw_of_the_whole_is_an_identification_of_its_record():
    plan = plan_of(analysis("gaps"), True)
    (seed,) = SeedSequence(5).spawn(1)
    (values,) = noisy(plan, default_rng(seed))
    again = identify(dataclasses.replace(analysis("gaps").records[0], values=values), states=["X", "Y"], validate=False)
    one = drawn_once(plan, seed)
    assert_allclose(one.exponents, again.model.exponents, rtol=1e-12)
    assert_allclose(one.system, again.state.system[::10], rtol=1e-9, atol=1e-12)


@pytest.mark.slow
def test_orders_that_come_out_otherwise_are_counted():
    """Of a mode that hardly rises above the noise, the order is found in some draws and not in others."""
    weak = identify(record(periods=40, noise=0.02), order=4, validate=False)
    loud = dataclasses.replace(louder(weak, 80.0), settings=dataclasses.replace(weak.settings, order=None))
    checked = bootstrap(loud, draws=40, seed=1, workers=1, whole=True)
    assert 2 <= checked.n_used < 40
    assert len(set(checked.orders[checked.orders > 0].tolist())) > 1
    assert f"{checked.n_used} of 40 draws gave the same order" in checked.reasons[-1]


# What cannot be.


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"draws": 19}, "`draws` of `bootstrap` must be an integer of at least 20, but is 19"),
        ({"draws": 50.0}, "`draws` of `bootstrap` must be an integer"),
        ({"seed": -1}, "`seed` of `bootstrap` must be an integer of at least 0"),
        ({"workers": 0}, "`workers` of `bootstrap` must be an integer of at least 1"),
        ({"whole": "yes"}, "`whole` of `bootstrap` must be true or false"),
    ],
)
def test_bad_arguments(options, message):
    with pytest.raises(InputError, match=message):
        bootstrap(analysis("lifted"), **options)


def test_what_is_no_analysis_is_refused():
    with pytest.raises(InputError, match="`identify`, but is an array"):
        bootstrap(np.zeros(3))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["gaps", "own period"])
def test_a_result_that_was_read_gives_the_same_draws(name, tmp_path):
    """A record that was fitted as it was sampled is in the file as it was sampled."""
    floquid.save(analysis(name), tmp_path / "result.h5")
    one, other = (bootstrap(of, draws=20, workers=1) for of in (analysis(name), floquid.load(tmp_path / "result.h5")))
    assert_allclose(one.exponents.draws, other.exponents.draws, rtol=1e-12)


@pytest.mark.slow
def test_a_period_that_was_found_is_fitted_anew():
    whole, checked = analysis("own period"), found("own period")
    assert checked.period.std > 0.0
    assert checked.period.estimate == whole.model.period
    assert checked.period.ratios() == pytest.approx(1.0, abs=0.35)
    assert_allclose(checked.period.asymptotic, whole.fit.period_std)
    assert_allclose(
        checked.multipliers.draws, np.exp(checked.exponents.draws * checked.period.draws[:, None]), rtol=1e-12
    )


def test_a_period_that_was_found_is_found_anew_from_the_beginning():
    plan = plan_of(analysis("own period"), True)
    one = drawn_once(plan, SeedSequence(2))
    assert one.failure == ""
    assert 0.0 < abs(one.period - plan.model.period) < 6.0 * analysis("own period").fit.period_std


@pytest.mark.slow
def test_with_a_structure_the_whole_again_is_not_refused():
    """What is left between the free model and the structure is in each draw already, and noise comes to it."""
    checked = bootstrap(analysis("refined with gaps"), draws=20, seed=5, workers=1, whole=True)
    assert checked.failures == ()
    assert checked.holds
    ratio = np.sqrt(np.mean(checked.system.ratios() ** 2))
    assert ratio == pytest.approx(1.0, abs=0.35)
