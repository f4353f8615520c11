"""Records drawn from models whose excitation goes on: deviations that hold, and such that do not."""

import functools
from dataclasses import replace

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose
from tests.driven import ambient_of, mathieu, record_of

import floquid
from floquid import Channel, Record, bootstrap, identify
from floquid.errors import IdentificationError
from floquid.findings import failure
from floquid.pipeline._deviations import with_state

DRAWS = 60
PHASES = 24
FORM = "stiffness 1; damping 0"

DISPLACEMENT, FORCE = Channel(name="y", quantity="displacement", unit="m"), Channel(name="F", unit="N")


def record(kind, seed=1, periods=60):
    system = mathieu()
    if kind == "inputs":
        values = np.concatenate(record_of(system, periods, PHASES, 0.01, seed))
        return Record(values=values, sample_rate=PHASES / system.period, channels=[DISPLACEMENT, FORCE])
    values = ambient_of(system, 120, 16, 0.01, seed)
    return Record(values=values, sample_rate=16 / system.period, channels=[DISPLACEMENT])


@functools.cache
def found(kind, structure=""):
    options = {"period": mathieu().period, "states": ["y"], "structure": structure, "system_times": 5}
    options |= {"inputs": ["F"]} if kind == "inputs" else {"excitation": "ambient"}
    return identify(record(kind), **options, validate=False)


@functools.cache
def drawn(kind, structure=""):
    return bootstrap(found(kind, structure), draws=DRAWS, workers=1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "structure"),
    [("inputs", FORM), ("outputs alone", ""), ("inputs", ""), ("outputs alone", FORM)],
    ids=["inputs, structure", "outputs alone, free A(t)", "inputs, free A(t)", "outputs alone, structure"],
)
def test_the_deviations_of_a_right_fit_hold(kind, structure):
    """Of 60 draws a ratio is known to 9 %."""
    checked = drawn(kind, structure)
    assert checked.n_used == DRAWS
    assert checked.holds
    for spread in (checked.exponents, checked.coefficients):
        assert np.median(spread.ratios()) == pytest.approx(1.0, abs=0.15)
    assert (checked.inputs is None) == (kind == "outputs alone")
    assert checked.period is None
    if structure:
        assert np.median(checked.system.ratios()) == pytest.approx(1.0, abs=0.2)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["inputs", "outputs alone"])
def test_deviations_said_too_small_are_found(kind):
    right = found(kind)
    small = replace(right, model=replace(right.model, covariance=0.3 * right.model.covariance))
    checked = bootstrap(small, draws=20, workers=1)
    assert checked.n_used == 20
    assert not checked.holds
    assert "exponents" in checked.doubtful


def test_a_structure_is_told_more_of_than_the_free_matrix():
    for kind in ("inputs", "outputs alone"):
        free, own = found(kind), found(kind, FORM)
        assert own.refinement.p_value > 1e-3
        assert own.state.system_std[:, 1].max() < free.state.system_std[:, 1].max()
        truth = np.array([mathieu().A(time) for time in own.state.times])
        assert (np.abs(own.state.system - truth)[:, 1] < 4.0 * own.state.system_std[:, 1] + 1e-12).all()


def test_a_model_that_fails_is_given_no_structure():
    right = found("inputs", FORM)
    failing = replace(right, findings=(failure("undetermined"),), state=None, refinement=None)
    again = failing.driven.estimates_at
    told = with_state(failing, again, lambda _: None)
    assert (told.state, told.refinement) == (None, None)
    assert any("one that fails has none to quote" in words for words in told.warnings)
    free = with_state(replace(failing, settings=replace(failing.settings, structure="")), again, lambda _: None)
    assert free.state is not None
    assert free.state.system_std is None


def test_b_of_t_comes_with_a_structure_too():
    own, free = found("inputs", FORM).state, found("inputs").state
    assert_allclose(own.inputs, free.inputs)
    assert (own.inputs_std > 0.0).all()


def test_one_output_error_step_changes_next_to_nothing_of_a_good_record():
    """Structure and record agree: the estimates at the exponents of one are those of the other to first order."""
    for kind in ("inputs", "outputs alone"):
        right = found(kind, FORM)
        moved = right.fit.estimates_at(right.refinement.exponents[right.model.exponents.imag > 0.0])
        std = right.model.exponent_std[right.model.exponents.imag > 0.0]
        gap = moved.exponents - right.model.exponents[right.model.exponents.imag > 0.0]
        assert (np.abs(gap.real) < 0.1 * std.real).all()
        assert (np.abs(gap.imag) < 0.1 * std.imag).all()


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["inputs", "outputs alone"])
def test_a_result_that_was_read_gives_the_same_draws(kind, tmp_path):
    right = found(kind, FORM)
    floquid.save(right, tmp_path / "result.h5")
    read = floquid.load(tmp_path / "result.h5")
    assert read.refinement.structure == right.refinement.structure
    assert_allclose(read.refinement.state.system_std, right.refinement.state.system_std)
    own, other = (bootstrap(one, draws=20, workers=1) for one in (right, read))
    assert own.holds
    assert_allclose(own.exponents.draws, other.exponents.draws, rtol=1e-9)
    assert_allclose(own.coefficients.draws, other.coefficients.draws, rtol=1e-6)


@pytest.mark.slow
def test_the_whole_identification_again():
    brief = identify(record("inputs", periods=25), period=mathieu().period, inputs=["F"])
    checked = bootstrap(brief, draws=20, workers=1, whole=True)
    assert checked.n_used >= 19
    assert checked.holds


def test_of_a_mode_that_grows_beyond_all_bounds_nothing_is_drawn():
    """Over the record it would have grown by far more than e^2000: what held it is in no model."""
    right = found("outputs alone")
    grown = replace(right.fit.at.modes[0], exponent=complex(1e3, right.fit.at.modes[0].exponent.imag))
    fit = replace(right.fit, at=replace(right.fit.at, modes=(grown, *right.fit.at.modes[1:])))
    with pytest.raises(IdentificationError, match="grows over the record"):
        fit.drawn(default_rng(0))


def test_what_is_drawn_is_the_response_with_noise_of_its_size():
    right = found("inputs").fit
    left = right.drawn(default_rng(3)) - right.at.columns.response(right.at.coefficients)
    assert left.std() == pytest.approx(right.at.noise[0], rel=0.05)
    ambient = found("outputs alone").fit
    values = ambient.drawn(default_rng(3))
    assert values.std() == pytest.approx(ambient.samples.values.std(), rel=0.3)
    assert ambient.refitted(values).at.noise[0, 0] == pytest.approx(ambient.at.noise[0, 0], rel=0.05)


@pytest.mark.slow
def test_a_search_ends_with_its_time_and_says_so():
    found = floquid.identify(record("inputs"), inputs=["F"], period=mathieu().period, seconds=1e-6)
    assert found.model.order
    assert "out_of_time" in {finding.code for finding in found.findings}
