"""Lines of a revolution that holds several periods, where the excitation goes on: they are no modes."""

from types import SimpleNamespace

import numpy as np
import pytest
from tests.driven import ambient_of, imbalance_of, mathieu, pulls, record_of

from floquid import Channel, ConstantPeriod, Record, Settings, TachometerSignal, identify
from floquid.checks._modes import lines_of_revolution
from floquid.errors import IdentificationError, InputError
from floquid.findings import Severity, texts
from floquid.preparation import for_command
from floquid.preparation._excited import parted
from floquid.preparation._lines import BESIDE, MOST_PERIODS, _above_beside

SYSTEM, PHASES = mathieu(), 20
HALVES = tuple(0.5 * j for j in range(1, 19))


def record_from(values, names=("x", "F")):
    channels = [Channel(name=name) for name in names[: len(values)]]
    return Record(values=values, sample_rate=PHASES / SYSTEM.period, channels=channels)


@pytest.fixture(scope="module")
def driven():
    """120 periods, a force that is measured, and an imbalance twenty times what it does."""
    values, inputs = record_of(SYSTEM, 120, PHASES, 0.02, 0)
    return np.concatenate([values + 20.0 * values.std() * imbalance_of(SYSTEM, 120, PHASES), inputs])


def turns_of(values, **options):
    record = record_from(values).with_clock(ConstantPeriod(period=SYSTEM.period))
    return parted([record], Settings(inputs=("F",), **options))


@pytest.mark.slow
def test_lines_of_the_revolution_are_fitted_beside_the_modes(driven):
    found = identify(record_from(driven), period=SYSTEM.period, inputs=["F"], periods_per_revolution=2)
    assert found.model.order == 2
    assert pulls(SYSTEM, found.model).max() < 4.0
    assert found.passed
    assert found.warnings == ()
    assert "period or the revolution was fitted beside the modes; 1/2, 1, 3/2, 2" in " ".join(texts(found.findings))
    assert lines_of_revolution(found.model, found.records[0].duration, (), 1.0) == ()
    # Left in they are a mode that never decays, and told where nobody wanted that.
    left = identify(record_from(driven), period=SYSTEM.period, inputs=["F"], forced="none", validate=False)
    assert left.model.order > 2
    assert "line_as_mode" not in {own.code for own in left.findings}
    (told,) = [own for own in left.findings if own.code == "unreached"]
    assert told.severity is Severity.FAILURE
    assert told.numbers["frequencies"] == pytest.approx((0.5 / SYSTEM.period,), rel=1e-3)


def told_of(turns, deviations, real, unreached=(), periods_of_turn=1.0):
    """What is told of modes that do not decay, at these turns a period, known to these deviations."""
    exponents = 1e-6 + 2j * np.array(turns)
    model = SimpleNamespace(
        exponents=exponents, exponent_std=1e-3 + 2j * np.array(deviations), fundamental=2.0, real=np.array(real)
    )
    return lines_of_revolution(model, 400.0, unreached, periods_of_turn)


def test_a_line_of_half_a_turn_is_told_with_what_takes_it():
    (said,) = told_of([0.5], [1e-5], [False], periods_of_turn=2.0)
    assert '`forced="1"`' in str(said)
    (told,) = told_of([0.5], [1e-5], [False])
    assert told.severity is Severity.FAILURE
    assert told.numbers["periods"] == 2
    assert "does not decay and is at a multiple of 1/2 of the period's frequency" in str(told)


def test_a_real_multiplier_at_its_limit_may_be_one():
    """Its frequency is half the fundamental by its kind: it is measured in none."""
    (told,) = told_of([0.5], [0.0], [True])
    assert told.severity is Severity.WARNING
    assert "a real negative multiplier at the limit of stability" in str(told)
    (told,) = told_of([0.5], [0.0], [True], [abs(1e-6 + 1j) / (2.0 * np.pi)])
    assert told.severity is Severity.FAILURE


def test_each_line_is_told_by_how_well_it_is_known():
    (both,) = told_of([0.25, 0.75], [1e-5, 5e-4], [False, False])
    assert both.severity is Severity.FAILURE
    assert "modes at 0.07958 and 0.2387 Hz do not decay and are at multiples of 1/4" in str(both)
    assert "limit of stability" not in str(both)
    (vague,) = told_of([0.25], [5e-4], [False])
    assert vague.severity is Severity.WARNING
    half, third = told_of([0.5, 1.0 / 3.0], [0.0, 1e-5], [True, False])
    assert (half.severity, third.severity) == (Severity.WARNING, Severity.FAILURE)


def test_a_line_that_nobody_told_of_is_told_with_the_remedy(driven):
    found = identify(record_from(driven), period=SYSTEM.period, inputs=["F"])
    assert found.model.order == 2
    assert len(found.warnings) == 1
    assert "`periods_per_revolution=2`" in found.warnings[0]
    assert "`--forced none` leaves them to the modes" in for_command(found.warnings[0])


@pytest.mark.slow
def test_outputs_alone_of_a_tachometer_with_a_pulse_a_turn(monkeypatch):
    given = []
    monkeypatch.setattr("floquid.checks._modes.lines_of_revolution", lambda *own: given.append(own[-1]) or ())
    values = ambient_of(SYSTEM, 300, PHASES, 0.02, 0)
    values += 20.0 * values.std() * imbalance_of(SYSTEM, 300, PHASES)
    pulses = 5.0 * (np.arange(values.shape[1]) % (2 * PHASES) < 4)
    record = record_from(np.concatenate([values, [pulses]]), ("x", "tach"))
    clock = TachometerSignal(channel="tach", periods_per_revolution=2)  # settings know nothing of it
    found = identify(record.with_clock(clock), validate=False, excitation="ambient")
    assert given == [2.0]
    assert [channel.name for channel in found.model.channels] == ["x"]
    assert found.model.order == 2
    assert found.model.period == pytest.approx(SYSTEM.period, rel=1e-4)
    assert pulls(SYSTEM, found.model).max() < 4.0
    assert [one.code for one in found.findings if one.code == "lines_between"] == []


def test_harmonics_that_are_asked_for_are_those_of_the_revolution(driven):
    assert turns_of(driven, forced="1,2", periods_per_revolution=2).turns == (0.5, 1.0)
    assert turns_of(driven, forced="1,2").turns == (1.0, 2.0)
    assert turns_of(driven, forced="none", periods_per_revolution=2).turns == ()
    assert turns_of(driven, periods_per_revolution=2).turns == HALVES


def test_a_line_of_the_inputs_is_no_imbalance():
    """The force has that line itself: what it does says something of the system."""
    angle = np.pi / PHASES * np.arange(120 * PHASES)
    force = np.random.default_rng(0).standard_normal((1, len(angle))) + 20.0 * np.cos(angle)
    values, inputs = record_of(SYSTEM, 120, PHASES, 0.02, 0, force)
    found = turns_of(np.concatenate([values, inputs]))
    assert found.turns == ()
    assert found.findings == ()


@pytest.mark.parametrize(("turn", "told"), [(3, 3), (4, 4)])
def test_revolutions_of_more_periods_are_told_apart(turn, told):
    values, inputs = record_of(SYSTEM, 120, PHASES, 0.02, 0)
    values += 20.0 * values.std() * imbalance_of(SYSTEM, 120, PHASES, turn)
    (finding, between) = turns_of(np.concatenate([values, inputs])).findings
    assert between.numbers == {"periods": told}
    assert 1.0 / turn in finding.numbers["harmonics"]


@pytest.mark.slow
def test_lines_of_two_revolutions_are_none_of_one_that_holds_both():
    values, inputs = record_of(SYSTEM, 120, PHASES, 0.02, 0)
    for turn in (4, 5, 6):
        values += 20.0 * values.std() * imbalance_of(SYSTEM, 120, PHASES, turn)
    between = turns_of(np.concatenate([values, inputs])).findings[-1]
    assert between.code == "lines_between"
    assert between.numbers["periods"] <= MOST_PERIODS


@pytest.mark.parametrize("wander", [0.0, 0.3])
@pytest.mark.parametrize("samples", [256, 1000])
def test_lines_are_fourier_sums_over_those_beside(samples, wander):
    """At instants of a constant period and of an angle; line by line."""
    generator = np.random.default_rng(0)
    times = np.arange(samples) * SYSTEM.period / PHASES
    times += wander * np.sin(0.03 * times)
    values = generator.standard_normal((2, samples)) + 5.0 + np.cos(times)
    harmonics = np.array([0.5, 1.0, 4.0 / 3.0, 1.7, 3.5, 7.0])
    lines = (
        np.array([0.0, *(s * k for k in range(1, BESIDE + 1) for s in (1, -1))])
        * SYSTEM.period
        / (times[-1] - times[0])
    )
    angles = 2.0 * np.pi / SYSTEM.period * np.multiply.outer(np.add.outer(harmonics, lines), times)
    sizes = np.abs(np.einsum("ct,hlt->chl", values - values.mean(axis=1, keepdims=True), np.exp(-1j * angles)))
    exact = sizes[..., 0] / np.sqrt(np.mean(sizes[..., 1:] ** 2, axis=2))
    np.testing.assert_allclose(_above_beside(values, times, SYSTEM.period, harmonics), exact, rtol=1e-6)


def test_lines_are_told_of_outputs_alone(driven):
    record = record_from(driven[:1]).with_clock(ConstantPeriod(period=SYSTEM.period))
    assert parted([record], Settings(excitation="ambient")).findings[-1].numbers == {"periods": 2}


def test_a_mode_that_hardly_decays_is_no_line():
    """It rings between two lines of a short record: at 0.7406 of the fundamental, a fifth of a line off 3/4."""
    angle = 2.0 * np.pi / PHASES * np.arange(20 * PHASES)
    values = np.exp(-0.002 * angle) * np.cos(0.7406 * angle)
    force = np.random.default_rng(0).standard_normal(len(angle))
    assert turns_of(np.array([values + 1e-3 * force, force])).turns == ()


def test_a_period_of_the_whole_turn_is_refused_with_the_way():
    values = ambient_of(SYSTEM, 300, PHASES, 0.02, 0)
    values += 5.0 * values.std() * imbalance_of(SYSTEM, 300, PHASES)
    with pytest.raises(IdentificationError, match=r"period=3\.1415.*periods_per_revolution=2"):
        identify(record_from(values), period=2.0 * SYSTEM.period, excitation="ambient")


def test_periods_of_a_revolution_are_positive(driven):
    with pytest.raises(InputError, match="periods_per_revolution"):
        identify(record_from(driven), period=SYSTEM.period, inputs=["F"], periods_per_revolution=0)
