"""Outputs alone: the chain from a record to a verdict."""

import json
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.drawn.__main__ import drawn, record_of_draw
from scipy.signal import lfilter
from tests.driven import ambient_of, mathieu, pulls

from floquid import (
    Channel,
    ConstantPeriod,
    IdentificationError,
    InputError,
    Record,
    identify,
    reconstruct,
)
from floquid.checks import Ambient
from floquid.checks._excitation import _copies, excitation_of
from floquid.checks._residual import of_outliers
from floquid.exports import summary
from floquid.findings import Severity
from floquid.innovations import Fit, first_innovations, period_step, predicted, repetition
from floquid.innovations._mode import Mode
from floquid.innovations._predictor import rebuilt
from floquid.innovations._solve import solve
from floquid.innovations.search._bands import bent
from floquid.inputs import Limits, samples_of
from floquid.pipeline import Settings
from floquid.preparation._excited import parted

SYSTEM, PHASES = mathieu(), 16


def record_from(values, period=SYSTEM.period, phases=PHASES, names=("x",)):
    return Record(values=values, sample_rate=phases / period, channels=list(names), clock=ConstantPeriod(period=period))


@pytest.fixture(scope="module")
def values():
    return ambient_of(SYSTEM, 250, PHASES, 0.02, 0)


@pytest.fixture(scope="module")
def analysis(values):
    return identify(record_from(values), excitation="ambient")


def test_exponents_of_outputs_alone_are_within_their_deviations(analysis):
    assert analysis.model.order == 2
    assert pulls(SYSTEM, analysis.model).max() < 3.5
    assert analysis.passed
    assert np.array_equal(analysis.model.coefficient_std[0].max(axis=-1) > 0.0, [[True]])


@pytest.mark.slow
def test_settings_and_options_say_the_same(values, analysis):
    found = identify(record_from(values), Settings(excitation="ambient"))
    assert np.array_equal(found.model.exponents, analysis.model.exponents)
    assert found.lengths == pytest.approx(analysis.lengths)


def test_its_damping_tells_how_long_a_record_would_do(analysis):
    relative = analysis.model.exponent_std.real / np.abs(analysis.model.exponents.real)
    duration = analysis.records[0].n_samples / analysis.records[0].sample_rate
    assert analysis.lengths == pytest.approx(duration * (relative / 0.1) ** 2)
    assert {finding.code for finding in analysis.findings} == {"all_needed", "ambient_length"}


def test_its_summary_and_its_words_are_whole(analysis):
    content = json.loads(json.dumps(summary(analysis)))
    assert content["excitation"] == "ambient"
    assert content["inputs"] is None
    assert len(content["lengths"]) == 2
    assert "Innovations" in analysis.summary()
    assert "One mode is needed" in " ".join(analysis.summary().split())
    with pytest.raises(InputError, match="measured inputs"):
        analysis.transfer()


def test_the_matrix_of_the_system_comes_of_outputs_alone(analysis):
    """Of entries from 1 to 3; the largest error of five seeds was 0.15."""
    found = reconstruct(analysis.model, ["x"], times=8)
    truth = np.array([SYSTEM.A(t) for t in found.times])
    assert np.abs(found.system - truth).max() < 0.25
    assert np.abs((found.system - truth)[:, 1] / found.system_std[:, 1]).max() < 4.0
    with pytest.raises(InputError, match="states"):
        reconstruct(analysis.model, ["x", "x"])


def test_a_gap_that_is_too_long_to_be_bridged_cuts_a_record(analysis, values):
    """With one state on both sides the decay was 3 to 14 deviations off, and passed."""
    holed = values.copy()
    holed[:, 1000:1400] = np.nan
    holed[:, 3000:3002] = np.nan
    found = identify(record_from(holed), excitation="ambient", validate=False)
    assert [record.n_samples for record in found.records] == [1000, values.shape[1] - 1400]
    assert [own.numbers["parts"] for own in found.findings if own.code == "cut_at_gaps"] == [2]
    off = found.model.exponents - analysis.model.exponents
    assert np.abs(off.real / found.model.exponent_std.real).max() < 1.0
    # A part shorter than a period says less than its first state costs, and inputs tell the state over a gap.
    holed[:, 1400:1410], holed[:, 1410:1500] = values[:, 1400:1410], np.nan
    again = parted([record_from(holed)], Settings(excitation="ambient"))
    assert [record.n_samples for record in again.records] == [1000, values.shape[1] - 1500]
    both = record_from(np.concatenate([holed, values]), names=("x", "F"))
    assert len(parted([both], Settings(inputs=("F",))).records) == 1


@pytest.mark.parametrize(("decay", "severity"), [(1.0, Severity.FAILURE), (6.0, Severity.WARNING)])
def test_a_copy_of_a_mode_that_outlasts_a_period_fails(analysis, decay, severity):
    fit, own = analysis.fit, analysis.fit.at.modes[0]
    exponent = complex(decay * own.exponent.real, own.exponent.imag)
    copies = [replace(own, exponent=share * exponent, gains=0.5 * own.gains) for share in (1.0, 1.001)]
    at = predicted(fit.samples, copies, fit.at.columns, np.zeros((1, 4)))
    twice = Fit(fit.samples, at, fit.acting)
    model = twice.model(analysis.model.channels, (), analysis.model.provenance)
    told = excitation_of(twice, model, np.full(4, 0.1), 1.0, ())
    assert [own.severity for own in told if own.code == "ambient_alike"] == [severity]
    # Far from each other over their deviations both are there.
    told = excitation_of(twice, model, np.full(4, 1e-4), 1.0, ())
    assert [own.severity for own in told if own.code == "ambient_alike"] == [Severity.WARNING]
    # Pairs that were read from two blocks may be copies; two real multipliers of one block are two.
    told = excitation_of(twice, model, np.full(4, 0.1), 1.0, (0, 1))
    assert [own.severity for own in told if own.code == "ambient_alike"] == [severity]
    band = np.arange(2.0)
    reals = [
        replace(one, exponent=complex(one.exponent.real), real=True, turns=band, shape=one.shape[:, :2], reach=band,
                gains=0.1 * one.gains[:, :2])
        for one in copies
    ]  # fmt: skip
    at = predicted(fit.samples, reals, fit.at.columns, np.zeros((1, 2)))
    both = Fit(fit.samples, at, fit.acting)
    model = both.model(analysis.model.channels, (), analysis.model.provenance)
    for read, found in (((), [severity]), ((0, 1), [])):
        told = excitation_of(both, model, np.full(2, 0.1), 1.0, read)
        assert [own.severity for own in told if own.code == "ambient_alike"] == found


@pytest.mark.first(1)
@pytest.mark.parametrize(
    ("decay", "turn", "reached", "told"),
    [
        (6.0, 0.0, 0.0, True),
        (6.0, 0.2, 0.0, True),
        (6.0, 0.3, 0.0, True),
        (6.0, 0.5, 0.0, False),
        (2.0, 0.0, 0.0, False),
        (6.0, 0.0, 1e3, False),
    ],
    ids=[
        "gone",
        "gone and swinging",
        "nearer to half, and badly known",
        "a negative multiplier",
        "lasting",
        "reached by a measured input",
    ],
)
def test_a_mode_gone_within_a_period_may_be_the_excitations(analysis, decay, turn, reached, told, monkeypatch):
    """Mathieu's mode loses 0.22 nepers a period."""
    fit, own = analysis.fit, analysis.fit.at.modes[0]
    exponent = complex(decay * own.exponent.real, turn * fit.samples.fundamental)
    gone = replace(own, exponent=exponent, gains=0.5 * own.gains)
    at = predicted(fit.samples, [replace(own, gains=0.5 * own.gains), gone], fit.at.columns, np.zeros((1, 4)))
    monkeypatch.setattr(Fit, "varying", lambda *_: (1e3, 4))
    monkeypatch.setattr(Fit, "reached", lambda *_: (reached, 4))
    both = Fit(fit.samples, at, fit.acting)
    model = both.model(analysis.model.channels, (), analysis.model.provenance)
    found = excitation_of(both, model, np.full(4, 0.05), 1.0, ())
    hertz = [abs(exponent) / (2.0 * np.pi)]
    named = [own.numbers["frequencies"] for own in found if own.code == "ambient_fast"]
    assert named == ([pytest.approx(hertz)] if told else [])


@pytest.mark.parametrize(("decay", "share", "told"), [(27.0, 0.3, False), (27.0, 0.6, True), (2.0, 0.6, False)])
def test_a_decay_is_not_determined_to_a_neper_a_period_nor_to_half_of_it(analysis, decay, share, told):
    """Mathieu's mode loses 0.22 nepers a period."""
    fit, own = analysis.fit, analysis.fit.at.modes[0]
    gone = replace(own, exponent=complex(decay * own.exponent.real, own.exponent.imag))
    alone = Fit(fit.samples, predicted(fit.samples, [gone], fit.at.columns, np.zeros((1, 2))), fit.acting)
    model = alone.model(analysis.model.channels, (), analysis.model.provenance)
    found = excitation_of(alone, model, np.full(2, share), 1.0, ())
    assert any(own.code == "undetermined" for own in found) == told


@pytest.mark.parametrize("axis", [0.0, 0.5])
def test_a_mode_of_one_harmonic_is_named_but_for_a_negative_multiplier(analysis, axis, monkeypatch):
    """What decays without turning in the excitation has a positive one."""
    fit, own = analysis.fit, analysis.fit.at.modes[0]
    one = replace(
        own, turns=np.array([axis]), shape=own.shape[:, :1], reach=np.array([axis]), gains=0.1 * own.gains[:, :1]
    )
    one = replace(one, exponent=complex(own.exponent.real), real=True)
    at = predicted(fit.samples, [replace(own, gains=0.5 * own.gains), one], fit.at.columns, np.zeros((1, 3)))
    monkeypatch.setattr(Fit, "varying", lambda _, number: (1e3, 4) if number == 0 else (0.0, 0))
    both = Fit(fit.samples, at, fit.acting)
    model = both.model(analysis.model.channels, (), analysis.model.provenance)
    found = excitation_of(both, model, np.full(3, 0.05), 1.0, ())
    named = [own.severity for own in found if own.code == "ambient_single"]
    assert named == ([Severity.WARNING] if axis == 0.0 else [])


@pytest.mark.parametrize(("axis", "decay", "told"), [(0.0, 0.3, True), (0.5, 0.3, False), (0.0, 2.0, False)])
def test_a_real_mode_that_lasts_may_be_slow_excitation(analysis, axis, decay, told, monkeypatch):
    """Two of 87 models of a turbine that passed had one too many, and nothing said so."""
    fit, own = analysis.fit, analysis.fit.at.modes[0]
    turns = np.array([axis, axis + 1.0])
    one = replace(own, turns=turns, shape=own.shape[:, :2], reach=turns, gains=0.1 * own.gains[:, :2])
    one = replace(one, exponent=complex(-decay / analysis.model.period), real=True)
    at = predicted(fit.samples, [replace(own, gains=0.5 * own.gains), one], fit.at.columns, np.zeros((1, 3)))
    monkeypatch.setattr(Fit, "varying", lambda *_: (1e3, 4))
    both = Fit(fit.samples, at, fit.acting)
    model = both.model(analysis.model.channels, (), analysis.model.provenance)
    found = excitation_of(both, model, np.full(3, 0.05), 1.0, ())
    assert [own.severity for own in found if own.code == "ambient_real"] == ([Severity.WARNING] if told else [])


def test_a_line_at_the_speed_is_taken_off(values):
    angle = 2.0 * np.pi * np.arange(values.shape[1]) / PHASES
    found = identify(record_from(values + 3.0 * np.cos(angle + 0.3)), validate=False, excitation="ambient")
    assert found.model.order == 2
    assert pulls(SYSTEM, found.model).max() < 3.5
    assert "steady_beside_inputs" in {finding.code for finding in found.findings}


@pytest.mark.slow
def test_a_measured_shaft_gives_the_angle(values):
    turned = np.arange(values.shape[1]) * 360.0 / PHASES % 360.0
    record = record_from(np.concatenate([values, turned[None]]), names=("x", "shaft"))
    found = identify(record, azimuth="shaft", validate=False, excitation="ambient")
    assert [channel.name for channel in found.model.channels] == ["x"]
    assert found.shafts
    assert found.model.period == pytest.approx(SYSTEM.period, rel=1e-5)
    assert pulls(SYSTEM, found.model).max() < 3.5


def test_what_cannot_be_is_refused(values):
    noise = np.random.default_rng(0).standard_normal((1, 2000))
    with pytest.raises(IdentificationError, match="rises above the noise"):
        identify(record_from(noise), excitation="ambient")
    with pytest.raises(InputError, match="identifier"):
        identify(record_from(values), identifier="era", excitation="ambient")
    with pytest.raises(InputError, match="be 'zero' or 'none'"):
        identify(
            record_from(np.concatenate([values] * 2), names=("x", "f")),
            inputs=["f"],
            hold="first",
            excitation="ambient",
        )
    with pytest.raises(IdentificationError, match="periods, fewer than"):
        identify(record_from(values[:, : 5 * PHASES]), excitation="ambient")


@pytest.mark.parametrize("off", [3e-3, 1e-2])
def test_a_wrong_period_is_refused_with_its_own(values, off):
    with pytest.raises(IdentificationError, match=r"its own is about 3\.14"):
        identify(record_from(values), period=SYSTEM.period * (1.0 + off), excitation="ambient")


def test_a_period_of_two_is_refused_with_the_half(values):
    with pytest.raises(IdentificationError, match=r"period=3\.1415"):
        identify(record_from(values), period=2.0 * SYSTEM.period, excitation="ambient")


@pytest.mark.slow
def test_a_period_that_is_slightly_off_fails_with_its_own(values):
    found = identify(record_from(values), period=SYSTEM.period * 1.0008, validate=False, excitation="ambient")
    told = [own for own in found.findings if own.code == "wrong_period"]
    assert len(told) == 1
    assert not found.passed
    step, std = period_step(found.fit)
    assert abs(step + 8e-4) < 4.0 * std < 4e-4


@pytest.mark.slow
def test_half_the_period_fails():
    """Its harmonics are the even ones of the system, and two copies of a mode explain most of the odd ones."""
    values = ambient_of(SYSTEM, 200, PHASES, 0.02, 115)
    record = Record(values=values, sample_rate=PHASES / SYSTEM.period, channels=["x"])
    found = identify(record, period=0.5 * SYSTEM.period, excitation="ambient", validate=False)
    (told,) = [own for own in found.findings if own.code == "wrong_period"]
    assert found.failed
    assert told.numbers["own"] == pytest.approx(SYSTEM.period, rel=1e-3)


def test_a_response_that_is_not_periodic_is_not_said_to_be():
    generator = np.random.default_rng(2)
    values = lfilter([1.0], [1.0, -1.7, 0.9], generator.standard_normal((1, 4000)))
    found = repetition(samples_of([values], [np.zeros((0, 4000))], [0.0], step=0.1, fundamental=2.0 * np.pi / 1.6))
    assert found.own < found.limit
    assert found.even < found.limit


@pytest.mark.slow
def test_units_of_the_channels_change_nothing(values, analysis):
    other = np.random.default_rng(1).standard_normal(values.shape)
    own, large = (
        identify(
            record_from(size * np.concatenate([values, other]), names=("x", "n")), validate=False, excitation="ambient"
        )
        for size in (1.0, np.array([[1e6], [1e-3]]))
    )
    assert np.abs(own.model.exponents - large.model.exponents).max() < 0.1 * np.abs(analysis.model.exponent_std).min()
    assert [finding.code for finding in own.findings] == [finding.code for finding in large.findings]


def test_its_repr_is_its_verdict(analysis):
    assert repr(analysis) == "Analysis(order=2, period=3.142 s, 1 channel, 250 periods: passes)"


def test_an_output_that_does_not_change_is_refused(values):
    with pytest.raises(IdentificationError, match="channels="):
        identify(record_from(np.concatenate([values, 0.0 * values]), names=("x", "n")), excitation="ambient")


def test_an_output_that_is_a_copy_is_left_out(values, analysis):
    found = identify(record_from(np.concatenate([values, 2.0 * values]), names=("x", "n")), excitation="ambient")
    assert "Channel 'n' was left out: it is 2 times channel 'x'" in found.warnings[0]
    np.testing.assert_array_equal(found.model.exponents, analysis.model.exponents)


@pytest.mark.slow
def test_forces_that_were_not_measured_do_not_bend_what_was(analysis):
    del analysis
    generator = np.random.default_rng(3)
    force, other = generator.standard_normal((2, 1, 200 * PHASES))
    values = SYSTEM.response(force + 0.5 * other, PHASES)
    values += 0.02 * values.std() * generator.standard_normal(values.shape)
    found = identify(record_from(np.concatenate([values, force]), names=("x", "f")), inputs=["f"], excitation="ambient")
    assert found.model.order == 2
    assert pulls(SYSTEM, found.model).max() < 3.5
    own = found.transfer([0.1, 0.2, 0.3], [-1, 0, 1])
    truth = SYSTEM.transfer([0.1, 0.2, 0.3], [-1, 0, 1])
    off = np.abs(own.values - truth) / np.abs(own.std)
    assert off.max() < 4.0
    assert np.abs(own.values).max() > 10.0 * np.abs(own.std).max()


def test_first_innovations_are_near_the_true_ones():
    generator = np.random.default_rng(0)
    drive = generator.standard_normal(4000)
    values = np.zeros(4000)
    for k in range(2, 4000):
        values[k] = (1.5 + 0.2 * np.cos(0.4 * k)) * values[k - 1] - 0.8 * values[k - 2] + drive[k]
    samples = samples_of([values[None]], [np.zeros((0, 4000))], [0.0], step=1.0, fundamental=0.4)
    found = first_innovations(samples)[0]
    assert np.corrcoef(found[100:], drive[100:])[0, 1] > 0.995


def test_lasting_modes_that_neither_deviations_nor_shapes_tell_apart_fail(analysis, monkeypatch):
    """Of excitation that is coloured a copy of a mode passed, at 0.8 of its decay from it."""
    fit, own = analysis.fit, analysis.fit.at.modes[0]
    exponent, decay = complex(1.8 * own.exponent.real, own.exponent.imag), abs(own.exponent.real)
    turned = np.roll(own.shape, 1, axis=1)

    def copies(shape, share=0.25, lasting=True, conjugate=False, std=1e-3):
        monkeypatch.setattr(Fit, "parameters", property(lambda fit: std**2 * np.eye(len(fit.normal.gradient))))
        other = replace(own, exponent=exponent, shape=shape, gains=0.2 * own.gains)
        other = other.conjugate() if conjugate else other
        at = predicted(fit.samples, [replace(own, gains=0.5 * own.gains), other], fit.at.columns, np.zeros((1, 4)))
        twice = Fit(fit.samples, at, fit.acting)
        return len(_copies(twice, np.full(2, share * decay), np.array([True, lasting]), ()))

    assert copies(own.shape) == copies(1j * own.shape) == copies(own.shape, conjugate=True) == 1
    assert copies(own.shape, share=0.1) == copies(own.shape, lasting=False) == 0
    assert copies(turned) == copies(turned, conjugate=True) == 0
    assert copies(own.shape + 0.1 * turned) == copies(turned, std=1.0) == 1


@pytest.mark.parametrize("axis", [0.0, 0.5])
def test_a_pair_with_the_shape_of_a_real_multiplier_may_be_a_copy(axis, analysis):
    """Harmonics of one sign were set against those of both, half a fundamental off: nothing was a multiple."""
    fit, generator, turns = analysis.fit, np.random.default_rng(0), np.arange(axis, 2.6)
    omega, step, none = fit.samples.fundamental, fit.samples.step, np.zeros(1)
    shape, gains = (generator.standard_normal((2, 1, len(turns))).T @ [1.0, 1j]).T, np.full((1, 1), 0.1 + 0j)
    shape[:, turns == 0.0] = shape[:, turns == 0.0].real
    real = Mode(exponent=-0.07 + 0j, real=True, turns=turns, shape=shape, reach=turns[:1], gains=gains)
    both = np.unique(np.concatenate([-turns, turns]))
    values = np.stack([shape[:, turns == abs(turn)][:, 0] for turn in both], axis=1)
    values = np.where(both < 0.0, values.conj(), values) * np.where(both, 0.5, 1.0)
    exponent, other = -0.075 + 0.01j + 1j * axis * omega, (0.3 - 0.8j) * values
    pair = Mode(exponent=exponent, real=False, turns=both - axis, shape=other, reach=none, gains=gains)
    bent_shape = replace(pair, shape=other * np.exp(1j * np.arange(len(both))))
    for own, copied in ((pair.turned(2.0, omega, step), True), (pair.conjugate(), True), (bent_shape, False)):
        for modes in ([real, own], [own, real]):
            at = predicted(fit.samples, modes, fit.at.columns, np.zeros((1, 3)))
            share = Fit(fit.samples, at, fit.acting).beside(0, 1)[2]
            assert share < 1e-12 if copied else share > 0.5


def test_harmonics_left_out_that_would_move_an_exponent_are_seen(analysis):
    """Of three modes that are nearly one the exponents were 11 deviations off, each harmonic left out within noise."""
    fit, mode = analysis.fit, analysis.fit.at.modes[0]
    limits = Limits(highest=7)
    assert not bent(fit.samples, fit.at, limits)
    largest = int(np.argmax(np.abs(mode.shape[0])))
    for bands in ((mode.turns[largest - 1 : largest + 2], mode.reach), (mode.turns, np.zeros(1))):
        fewer = solve(fit.samples, rebuilt(fit.samples, fit.at, [mode.widened(*bands)]))
        assert bent(fit.samples, fewer, limits)


@pytest.mark.slow
def test_a_shape_of_twelve_samples_has_as_many_harmonics():
    """The exponents were 11 deviations off and passed: of twelve harmonics the search had eleven."""
    draw = drawn(44, "ambient")
    found = identify(record_of_draw(draw, 44, "ambient"), period=draw.system.period, excitation="ambient")
    assert found.passed
    assert pulls(draw.system, found.model).max() < 3.5


def test_records_of_other_channels_or_units_are_refused(values):
    one = record_from(values)
    for other in (record_from(values, names=["y"]), replace(one, channels=[Channel(name="x", unit="mm")])):
        with pytest.raises(InputError, match="must have the same"):
            identify([one, other], excitation="ambient")


@pytest.mark.slow
def test_a_record_at_another_phase_than_the_first_fails(values):
    """A shift of the clock has to come out, and one that is said to stay without a word."""
    other = ambient_of(SYSTEM, 250, PHASES, 0.02, 1)
    later = record_from(other[:, 3:])
    found = identify([record_from(values), later], validate=False, excitation="ambient")
    assert [own.numbers["record"] for own in found.findings if own.code == "records_phase"] == [2]
    assert not found.passed
    told = replace(later, start=3 * SYSTEM.period / PHASES)
    found = identify([record_from(values), told], validate=False, excitation="ambient")
    assert not [own for own in found.findings if own.code == "records_phase"]
    # By half a period the slope along the phase is none.
    found = identify([record_from(values), record_from(other[:, PHASES // 2 :])], validate=False, excitation="ambient")
    assert [own.numbers["record"] for own in found.findings if own.code == "records_phase"] == [2]
    assert not found.passed


@pytest.mark.first(1)
@pytest.mark.parametrize("share", [1.07, 0.5])
def test_a_period_that_is_far_off_fails_with_its_own(values, share):
    found = identify(record_from(values), period=share * SYSTEM.period, validate=False, excitation="ambient")
    told = [own for own in found.findings if own.code == "wrong_period"]
    assert told[0].numbers["own"] == pytest.approx(SYSTEM.period, rel=0.01)
    assert not found.passed


@pytest.mark.slow
def test_a_period_that_is_off_fails_where_more_modes_make_the_innovations_white():
    values = ambient_of(SYSTEM, 1000, PHASES, 0.05, 3)
    found = identify(record_from(values), period=0.95 * SYSTEM.period, excitation="ambient")
    codes = {own.code for own in found.findings}
    assert "colour_left" not in codes
    assert "wrong_period" in codes
    assert not found.passed


@pytest.mark.slow
def test_narrow_lines_are_no_period():
    """Of a structure that does not change, in noise as large as its response, 60 samples a period."""
    drive = np.random.default_rng(1).standard_normal((4, 9000))
    modes = [
        np.exp(2.0 * np.pi * own / 60.0 * (1j - share)) for own, share in ((1.37, 0.01), (3.3, 0.01), (4.1, 0.008))
    ]
    lines = [lfilter([1.0], [1.0, -2.0 * own.real, abs(own) ** 2], row) for own, row in zip(modes, drive, strict=False)]
    values = sum(row / row.std() for row in lines)
    record = record_from((values / values.std() + drive[3])[None], 1.0, 60)
    samples = samples_of([record.values], [np.zeros((0, 9000))], [0.0], step=1.0 / 60.0, fundamental=2.0 * np.pi)
    assert repetition(samples).other > 0.0
    assert "wrong_period" not in {own.code for own in identify(record, validate=False, excitation="ambient").findings}


@pytest.mark.parametrize("samples", [0.02, 1.0, 1.9, 2.0])
def test_too_few_samples_a_period_are_refused(values, samples):
    with pytest.raises(InputError, match=r"more than 2 samples|sampling intervals or more"):
        identify(record_from(values), period=samples * SYSTEM.period / PHASES, excitation="ambient")


def test_a_drift_is_no_mode(values):
    slow = np.cumsum(np.random.default_rng(3).standard_normal(values.shape[1]))
    found = identify(record_from(values + 0.02 * slow), validate=False, excitation="ambient")
    told = [own for own in found.findings if own.code == "ambient_slow"]
    assert len(told) == 1
    assert not found.passed
    hertz = found.model.frequencies_hz
    assert told[0].numbers["frequencies"] == pytest.approx([hertz.min()])


@pytest.mark.slow
def test_a_line_of_the_mains_is_no_mode(values):
    """It came out as a mode of one harmonic, likely the excitation's own, and passed; then it failed the model."""
    time = np.arange(values.shape[1]) * SYSTEM.period / PHASES
    hertz = 2.37 / SYSTEM.period
    line = values.std() * np.sin(2.0 * np.pi * hertz * time)
    found = identify(record_from(values + line), validate=False, excitation="ambient")
    (told,) = found.interference
    assert told.numbers["frequency"] == pytest.approx(hertz, rel=1e-3)
    assert told.numbers["amplitude"] == pytest.approx(values.std(), rel=0.05)
    assert found.model.order == 2
    assert "ambient_single" not in {own.code for own in found.findings}


def test_clipped_outputs_fail(values):
    clipped = np.clip(values, -1.2 * values.std(), 1.2 * values.std())
    told = parted([record_from(clipped)], Settings()).findings
    assert [(own.code, own.severity) for own in told] == [("clipped", Severity.FAILURE)]


@pytest.mark.parametrize(("size", "severity"), [(15.0, Severity.WARNING), (40.0, Severity.FAILURE)])
def test_a_spike_is_told_and_fails_where_it_is_most_of_what_is_left(analysis, size, severity):
    left = analysis.fit.at.innovations.copy()
    own = parted(analysis.records, analysis.settings)
    assert not of_outliers(left, own)
    left[0, 1000] = size * left.std()
    (told,) = of_outliers(left, own)
    assert told.severity == severity
    assert (told.numbers["record"], told.numbers["sample"]) == (1, 1001)


def test_a_prediction_that_grows_fails(values, monkeypatch):
    monkeypatch.setattr(Ambient, "errors", lambda _: np.array([np.inf]))
    found = identify(record_from(values), excitation="ambient")
    assert found.failed
    assert "fails" in repr(found)
    assert "of samples left out of the fit grows" in " ".join(found.summary().split())


@pytest.mark.slow
@pytest.mark.parametrize(("short", "told"), [(2.5, Severity.FAILURE), (0.9, Severity.WARNING), (0.4, None)])
def test_a_fit_that_is_not_at_its_maximum_isexcitation_of(short, told, values, monkeypatch):
    monkeypatch.setattr(Fit, "short", lambda self, number: short)
    found = identify(record_from(values), validate=False, excitation="ambient")
    assert [one.severity for one in found.findings if one.code == "ambient_short"] == [told] * (told is not None)


@pytest.mark.parametrize("inputs", [0, 1])
def test_a_fit_short_of_its_maximum_is_advised_to_do_without_excitation_beside_inputs_alone(
    inputs, analysis, monkeypatch
):
    monkeypatch.setattr(Fit, "short", lambda self, number: 2.5)
    fit, (mode,) = analysis.fit, analysis.fit.at.modes
    samples = replace(fit.samples, inputs=np.zeros((inputs, fit.samples.n_samples)))
    mode = replace(mode, gains=np.concatenate([np.zeros((inputs, len(mode.reach))), mode.gains]))
    at = predicted(samples, [mode], fit.at.columns, fit.at.initial)
    told = excitation_of(Fit(samples, at, fit.acting), analysis.model, np.full(1, 0.1), 1.0, ())
    (short,) = (own for own in told if own.code == "ambient_short")
    assert ("leave `excitation=` out" in str(short)) == bool(inputs)


@pytest.mark.slow
def test_measured_inputs_without_other_forces_are_predicted():
    """The gain of the innovations is next to none, and a period of the predictor not normal: it does not grow."""
    forces = np.random.default_rng(0).standard_normal((1, 60 * PHASES))
    response = SYSTEM.response(forces, PHASES)
    response += 0.02 * response.std() * np.random.default_rng(1).standard_normal(response.shape)
    found = identify(
        record_from(np.concatenate([response, forces]), names=["x", "F"]), inputs=["F"], excitation="ambient"
    )
    assert found.model.order == 2
    assert np.isfinite(found.validation.held_out_error).all()
    assert found.passed


def test_a_highest_harmonic_of_zero_is_obeyed(values):
    """Candidates began with one harmonic on either side whatever was asked for."""
    found = identify(record_from(values), excitation="ambient", harmonics=0, validate=False)
    assert found.model.harmonics.tolist() == [0]
