"""A fit that leaves more than noise: wider deviations where it is a little, none where it is many times it."""

import re
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from tests.decays import with_decay

from floquid import IdentificationError, bootstrap, export_modes, identify, load, report, save
from floquid.exports import summary
from floquid.pipeline import validated
from floquid.pipeline._deviations import widening_of, with_misfit
from floquid.pipeline.free import _complete as complete
from floquid.reporting._words import verdict
from floquid.systems import JeffcottRotor
from floquid.views import period_words, synchronisation

NOISE = 1e-3
RECORD = JeffcottRotor().simulate(n_periods=100, samples_per_period=16, noise=NOISE, seed=1)
TIMES = np.arange(RECORD.n_samples) / RECORD.sample_rate


def beside(size):
    """The record with a third mode of `size` times the noise, that an order of 4 has no place for."""
    line = np.exp(-0.004 * TIMES) * np.cos(0.3 * TIMES)
    noise = NOISE * np.abs(RECORD.values).max(axis=1, keepdims=True)
    return replace(RECORD, values=RECORD.values + size * noise * line)


def imbalanced():
    """The record with a forced response, whose period is to be found."""
    return replace(RECORD, values=RECORD.values + 0.1 * np.cos(TIMES))


@pytest.fixture(scope="module")
def sound():
    return identify(RECORD)


@pytest.fixture(scope="module")
def failing():
    """Two poles where there are four: the residual is hundreds of noises."""
    return identify(RECORD, order=2, states=["X", "Y"], form="first-order")


@pytest.fixture(scope="module")
def forced():
    """The same, fitted as sampled with a forced response and the period as a parameter."""
    return identify(imbalanced(), order=2, estimate_period=True)


@pytest.fixture(scope="module")
def bent():
    """A misfit of about 1.5, and the same fit with the deviations of noise alone."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(complete, "with_misfit", lambda found: found)
        plain = identify(beside(3.0), order=4, validate=False)
    return plain, identify(beside(3.0), order=4)


def test_a_sound_fit_keeps_the_deviations_of_noise(sound):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(complete, "with_misfit", lambda found: found)
        plain = identify(RECORD, validate=False)
    assert 0.9 < sound.misfit < 1.1
    assert widening_of(sound) == 1.0
    assert not sound.failed
    assert sound.validation.passed
    assert sound.warnings == ()
    for name in ("exponents", "covariance", "coefficients", "coefficient_std"):
        assert_array_equal(getattr(sound.model, name), getattr(plain.model, name))


def test_a_small_misfit_widens_every_deviation_alike(bent):
    plain, wide = bent
    factor = wide.misfit
    assert 1.3 < factor < 1.8
    assert_array_equal(wide.model.exponents, plain.model.exponents)
    assert_allclose(wide.model.covariance, factor**2 * plain.model.covariance)
    for name in ("exponent_std", "multiplier_std", "frequency_std_hz", "damping_ratio_std", "coefficient_std"):
        assert_allclose(getattr(wide.model, name), factor * getattr(plain.model, name))
    assert_allclose(wide.model.shape_std(TIMES[:5]), factor * plain.model.shape_std(TIMES[:5]))
    for name in ("estimates", "unselected"):
        assert_allclose(getattr(wide.model, name).std(), factor * getattr(plain.model, name).std())
    assert any(f"{factor:.3g} times the noise" in words for words in wide.warnings)
    assert wide.validation.metrics["misfit"] == factor
    assert not wide.failed


@pytest.mark.slow
def test_what_is_fitted_to_the_model_is_as_much_wider():
    """A(t) with a structure, also with the step on the record linearised anew."""
    structure = "stiffness 2 symmetric; damping 0"
    options = {"order": 4, "states": ["X", "Y"], "structure": structure, "output_error": True, "validate": False}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(complete, "with_misfit", lambda found: found)
        patch.setattr(complete, "widening", lambda misfit, records: 1.0)
        plain = identify(beside(3.0), **options)
    wide = identify(beside(3.0), **options)
    assert plain.refinement.names == wide.refinement.names
    assert_allclose(wide.refinement.std, wide.misfit * plain.refinement.std, rtol=0.02)
    # What is left between structure and free model counts for as much less.
    assert plain.refinement.chi_square == pytest.approx(wide.misfit**2 * wide.refinement.chi_square, rel=0.05)


def test_deviations_of_a_forced_response_widen_too():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(complete, "with_misfit", lambda found: found)
        found = identify(imbalanced(), estimate_period=True, validate=False).fit
    wide = with_misfit(replace(found, misfit=2.0))
    assert len(found.forced.harmonics)
    for name in ("coefficient_std", "offset_std", "drift_std"):
        assert_allclose(getattr(wide.forced, name), 2.0 * getattr(found.forced, name))
    assert wide.period_std == 2.0 * found.period_std
    # The deviation of the period is in that of the multipliers.
    assert_allclose(wide.model.multiplier_std, 2.0 * found.model.multiplier_std)
    fails = with_misfit(replace(found, misfit=1000.0))
    assert (fails.period_std, fails.model.multiplier_std, fails.forced.offset_std) == (None, None, None)


@pytest.mark.slow
def test_chance_widens_nothing_in_a_short_record():
    """The level of the noise is estimated from what is left: of few samples it is known to a tenth only."""
    rotor, misfits = JeffcottRotor(damping=0.02), []
    for seed in range(6):
        short = rotor.simulate(n_periods=30, samples_per_period=8, noise=0.01, seed=seed)
        found = identify(short, order=4, validate=False)
        misfits.append(found.misfit)
        assert widening_of(found) == 1.0
    assert max(misfits) > 1.1


@pytest.mark.slow
def test_a_bootstrap_takes_wider_deviations_for_bounds(bent):
    plain, wide = bent
    plain = bootstrap(with_decay(plain, fit=replace(plain.fit, misfit=1.0)), draws=40, workers=1)
    wide = bootstrap(wide, draws=40, workers=1)
    # Bent as it is, a mode may pass for a cluster: whether plain deviations hold is not asked here.
    assert not plain.exponents.bound
    assert wide.exponents.bound
    assert wide.holds
    assert any("they also count the residual's excess over noise" in reason for reason in wide.reasons)


@pytest.mark.first(1)
@pytest.mark.parametrize("which", ["failing", "forced"])
def test_a_model_that_fails_has_no_deviations(which, request):
    found = request.getfixturevalue(which)
    model = found.model
    assert found.misfit > 100.0
    assert found.failed
    none = (model.covariance, model.coefficient_std, model.estimates, model.unselected, model.exponent_std)
    assert none == (None,) * 5
    assert (model.multiplier_std, model.frequency_std_hz, model.damping_ratio_std) == (None,) * 3
    assert found.modal.covariance is None
    assert found.periodicity is None
    assert found.warnings[0].startswith("The model fails: its residual is ")
    assert "`order=`" in found.warnings[0]
    assert not found.validation.passed
    assert found.reasons[0].startswith("The model fails: ")
    assert "misfit" in found.validation.unmet
    assert validated(found).reasons == found.reasons


def test_it_fails_without_validation_too():
    found = identify(RECORD, order=2, validate=False)
    assert found.failed
    assert found.validation is None
    assert found.warnings[0].startswith("The model fails: ")
    assert verdict(found) == ("failed", "The model fails.", "Do not use the numbers of this page:")


@pytest.mark.slow
def test_every_output_of_a_model_that_fails_is_without_deviations(failing, forced, tmp_path):
    assert failing.state.system_std is None
    assert failing.state.transition_std is None
    assert forced.fit.forced.coefficient_std is None
    assert forced.fit.period_std is None
    assert not np.isfinite(synchronisation(failing).relative_std)
    for found in (failing, forced):
        told = summary(found)
        assert told["failed"] is True
        assert told["misfit"] == found.misfit
        assert told["period_std"] is None
        assert {mode["exponent_std"] for mode in told["modes"]} == {None}
        assert "(" not in period_words(found)
        export_modes(found, tmp_path / "modes.csv")
        head, first = (line.split(",") for line in (tmp_path / "modes.csv").read_text().splitlines()[:2])
        assert {cell for name, cell in zip(head, first, strict=True) if "std" in name} == {""}
        for name in ("modes.mat", "modes.uff"):
            export_modes(found, tmp_path / name)
        report(found, tmp_path / "report.html")
        page = re.sub(r"<script.*?</script>", "", (tmp_path / "report.html").read_text(encoding="utf-8"), flags=re.S)
        assert "The model fails." in page
        assert "since the model fails" in page
        assert not re.search(r"\d\(\d+\)</td>|\d ± \d", page)


@pytest.mark.first(1)
@pytest.mark.parametrize("which", ["failing", "forced"])
def test_it_is_in_the_file(which, request, tmp_path):
    found = request.getfixturevalue(which)
    save(found, tmp_path / "result.h5")
    back = load(tmp_path / "result.h5")
    assert back.misfit == back.fit.misfit == found.misfit
    assert back.failed
    assert back.warnings == found.warnings
    assert summary(back) == summary(found)
    assert which == "failing" or back.fit.forced.offset_std is None


def test_what_needs_deviations_refuses_a_model_that_fails(failing):
    found = identify(RECORD, order=2, states=["X"], structure="auto")
    assert found.failed
    assert found.state is None
    assert any("one that fails has none to quote" in words for words in found.warnings)
    with pytest.raises(IdentificationError, match=r"The model fails.*\n  Records drawn from it say nothing"):
        bootstrap(failing, draws=20)


def test_what_to_try_goes_by_what_was_asked_for():
    found = identify(RECORD, harmonics=0, order=2, forced="none", validate=False)
    for way in ("order=", "harmonics=", "forced=", "skip="):
        assert f"`{way}`" in found.warnings[0]
