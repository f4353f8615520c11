"""Samples that are missing, measured inputs or outputs alone: left out, and nothing else changes."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from tests.driven import ambient_of, mathieu, pulls, record_of

from floquid import Channel, ConstantPeriod, IdentificationError, InputError, Record, identify
from floquid.findings import Severity
from floquid.innovations import predicted
from floquid.innovations._derivatives import gradient, slopes
from floquid.inputs import columns_at, linearise, samples_of
from floquid.inputs._solver import normal_equations as driven_equations
from floquid.preparation import prepare

SYSTEM, PHASES = mathieu(), 16
KINDS = {"inputs": {"inputs": ["F"]}, "ambient": {"excitation": "ambient"}}


def of(kind, seed=0, periods=None):
    """A record of a kind: the response x, and the force F that was measured."""
    clock = ConstantPeriod(period=SYSTEM.period)
    if kind == "inputs":
        rows = np.concatenate(record_of(SYSTEM, periods or 60, PHASES, 0.05, seed))
        channels = [Channel(name="x", unit="m"), Channel(name="F", unit="N")]
    else:
        rows, channels = ambient_of(SYSTEM, periods or 250, PHASES, 0.02, seed), ["x"]
    return Record(values=rows, sample_rate=PHASES / SYSTEM.period, channels=channels, clock=clock)


def blocks(record, seed, share=0.05, many=5):
    """The record with a share of the response missing, in some blocks."""
    values, length = np.array(record.values), int(share * record.n_samples / many)
    for begin in np.random.default_rng(seed).choice(record.n_samples // length - 1, many, replace=False):
        values[0, begin * length : (begin + 1) * length] = np.nan
    return replace(record, values=values)


@cache
def whole(kind):
    return identify(of(kind), **KINDS[kind])


@cache
def at_of(kind):
    """The fit to a record of a kind, of outputs alone to a shorter one."""
    if kind == "inputs":
        return whole(kind).driven.at
    return identify(of(kind, periods=100), **KINDS[kind], validate=False).driven.at


@pytest.mark.first(1)
@pytest.mark.parametrize("kind", KINDS)
def test_a_record_with_gaps_gives_its_exponents(kind):
    found = identify(blocks(of(kind), 1), **KINDS[kind])
    assert found.model.order == 2
    assert pulls(SYSTEM, found.model).max() < 4.0
    assert found.passed
    assert {own.code for own in found.findings} >= {"missing_samples"}
    ratio = found.model.exponent_std.real / whole(kind).model.exponent_std.real
    assert (np.abs(ratio - 1.0) < 0.2).all()


def test_deviations_grow_with_what_is_missing():
    """Each sample counts alike where inputs go on: half of them make deviations √2 as large."""
    record = of("inputs")
    values = np.array(record.values)
    values[0, np.random.default_rng(0).random(record.n_samples) < 0.5] = np.nan
    found = identify(replace(record, values=values), inputs=["F"], repair=False, validate=False)
    ratio = found.model.exponent_std.real / whole("inputs").model.exponent_std.real
    assert (np.abs(ratio - 2.0**0.5) < 0.25).all()
    assert pulls(SYSTEM, found.model).max() < 4.0


def of_values(kind, seed=0):
    """Samples of two outputs, some of them missing, modes near a fit, and what the fit holds beside."""
    record, g = of(kind, periods=40), np.random.default_rng(seed + 50)
    values = np.concatenate([record.values[:1], 0.3 * g.standard_normal((1, record.n_samples))])
    inputs, there = record.values[1:], g.random(record.n_samples) > 0.2
    return values, inputs, there


def samples_with(values, inputs, there, filled):
    values = np.where(there, values, np.nan)
    samples = samples_of([values], [inputs], [0.3], step=SYSTEM.period / PHASES, fundamental=1.0, turns=(1,))
    # What is at samples that are not there must count for nothing.
    return samples if filled is None else replace(samples, values=np.where(there, values, filled))


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_put_at_samples_that_are_not_there_changes_nothing(kind):
    values, inputs, there = of_values(kind)
    plain, other = (samples_with(values, inputs, there, filled) for filled in (None, 7.0))
    at = at_of(kind)
    found = []
    for samples in (plain, replace(other, values=other.kept(other.values))):
        if kind == "inputs":
            fit = linearise(samples, at.modes, at.direct)
            found.append([fit.log_likelihood, *driven_equations(samples, fit)])
        else:
            (mode,) = at.modes
            modes = [replace(mode, shape=np.repeat(mode.shape, 2, 0), gains=np.repeat(0.4 * mode.gains, 2, 0))]
            fit = predicted(samples, modes, np.zeros((2, len(samples.known))), at.initial)
            found.append([fit.log_likelihood, gradient(samples, fit, fit.innovations)])
    for one, two in zip(*found, strict=True):
        assert_array_equal(one, two)


def test_a_sample_that_is_not_there_is_no_equation_of_measured_inputs():
    """The fit is that of the rows that are there, made of the columns of all samples."""
    values, inputs, there = of_values("inputs")
    modes, direct = at_of("inputs").modes, (0.0,)
    fit = linearise(samples_with(values, inputs, there, None), modes, direct)
    whole_samples = samples_with(values, inputs, there | True, None)
    columns = columns_at(whole_samples, modes, direct).of(whole_samples, slice(0, len(there)))[:, there]
    expected, squares, rank, _ = np.linalg.lstsq(columns.T, values[:, there].T, rcond=None)
    assert_allclose(fit.columns.response(fit.coefficients)[:, there], expected.T @ columns, atol=1e-9)
    assert_allclose(fit.noise**2 * (there.sum() - rank), squares, rtol=1e-9)
    assert fit.count == there.sum()


def test_slopes_past_gaps_are_those_of_differences():
    """With what makes up for gaps held."""
    at = at_of("ambient")
    values, inputs, there = of_values("ambient")
    samples = samples_with(values[:1], inputs, there, None)
    start = predicted(samples, at.modes, np.zeros((1, len(samples.known))), at.initial)
    whole_slopes = np.concatenate([part for _, part in slopes(samples, start, start.root)])[:, 0]
    nudge = 1e-6
    for number in (0, 1, 3, 5):
        step = np.zeros(whole_slopes.shape[1])
        step[number] = nudge
        sides = []
        for sign in (1.0, -1.0):
            mode = at.modes[0].moved(sign * step[: sum(at.modes[0].sizes)])
            sides.append(predicted(samples, [mode], start.columns, start.initial, scales=start.scales).innovations)
        by_differences = start.white(sides[0] - sides[1])[0] / (2.0 * nudge)
        assert_allclose(whole_slopes[:, number], by_differences, rtol=1e-4, atol=1e-5 * np.abs(by_differences).max())
    assert not whole_slopes[~there].any()


def test_innovations_after_gaps_are_made_as_small_as_others():
    """The variance that a gap leaves is known by hand of a system of first order."""
    at, count = at_of("ambient"), 400
    values = np.random.default_rng(0).standard_normal((1, count))
    there = np.arange(count) % 50 > 1
    samples = samples_with(values, np.zeros((0, count)), there, None)
    mode = replace(
        at.modes[0], real=True, exponent=complex(-0.1), turns=np.zeros(1), shape=np.ones((1, 1), complex),
        reach=np.zeros(1), gains=np.full((1, 1), 0.7 + 0j),
    )  # fmt: skip
    found = predicted(samples, [mode], np.zeros((1, len(samples.known))), np.zeros((1, 1)))
    decay, gain = np.exp(-0.1 * samples.step), 0.7
    spread = 0.0
    for number in range(count):
        if there[number]:
            assert found.scales[number, 0, 0] ** -2 == pytest.approx(1.0 + spread, rel=1e-6)
        spread = spread * (decay - gain) ** 2 if there[number] else spread * decay**2 + gain**2


def test_an_input_with_a_gap_is_refused():
    record = of("inputs")
    values = np.array(record.values)
    values[1, [40, 41, 300]] = np.nan
    with pytest.raises(InputError, match=r"input 'F' misses 3, at .*s\.\n  Cut the record there"):
        identify(replace(record, values=values), inputs=["F"])


def test_a_channel_that_is_hardly_there_is_named():
    record = of("ambient")
    beside = np.where(np.arange(record.n_samples) < 0.6 * record.n_samples, np.nan, record.values[0] ** 2)
    both = replace(record, values=np.stack([record.values[0], beside]), channels=["x", "y"])
    with pytest.raises(IdentificationError, match="Channel 'y' misses 60 %"):
        identify(both, excitation="ambient")


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_faults_are_mended_of_every_kind(kind):
    """A spike, and a stretch at which the response stands still."""
    record = of(kind)
    values = np.array(record.values)
    values[0, 310] += 30.0 * values[0].std()
    values[0, 500:520] = 0.0
    faulty = replace(record, values=values)
    found = identify(faulty, **KINDS[kind])
    assert {own.code for own in found.findings} >= {"spikes", "left_out"}
    assert np.isnan(found.records[0].values[0, 500:520]).all()
    assert pulls(SYSTEM, found.model).max() < 4.0
    assert found.passed
    assert_allclose(found.model.exponent_std, whole(kind).model.exponent_std, rtol=0.2)
    left = identify(faulty, **KINDS[kind], repair=False)
    assert not np.isnan(left.records[0].values).any()
    assert "bad_samples" in {own.code for own in left.findings}


@pytest.mark.parametrize(
    ("height", "code", "severity"), [(1.5, "clipped", Severity.FAILURE), (2.5, "left_out", Severity.WARNING)]
)
def test_outputs_alone_that_are_clipped_much_fail(height, code, severity):
    """What is missing because it was large biases what nobody measured the excitation of."""
    record = of("ambient")
    most = height * record.values.std()
    clipped = replace(record, values=np.clip(record.values, -most, most))
    found = prepare(clipped, excitation="ambient")
    told = {own.code: own.severity for own in (*found.findings, *found.parted.findings)}
    assert told[code] == severity
    assert (code == "clipped") == (found.parted.samples.count == record.n_samples)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_deviations_of_records_with_gaps_cover(kind):
    """Forty draws, 5 % of the samples missing in blocks: errors are as large as their deviations."""
    errors = []
    for seed in range(40):
        found = identify(blocks(of(kind, seed), seed), **KINDS[kind], validate=False)
        assert found.model.order == 2
        errors.append(pulls(SYSTEM, found.model))
    assert 0.7 < np.sqrt(np.mean(np.square(errors))) < 1.3
