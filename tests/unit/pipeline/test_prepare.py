"""One preparation of records: every consumer sees the same channels, cycles and clocks, and slips are named early."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from tests.cli.test_commands import strict_json, typed

import floquid.pipeline as chain
from floquid import ConstantPeriod, IdentificationError, InputError, PulseTimes, Record, identify, load, save
from floquid.core import Channel, TachometerSignal
from floquid.lifting import lift
from floquid.pipeline.draws._redraw import draw, plan_of, redrawn
from floquid.pipeline.free._complete import by_cycles
from floquid.preparation import for_command
from floquid.readers import write
from floquid.sync import ShaftAngle
from floquid.systems import JeffcottRotor, Run

ROTOR = JeffcottRotor()
PERIOD = ROTOR.period
TWO = ["X", "Y"]


def ringing(*, n_periods=64, samples=8, seed=5, deg=45.0):
    return ROTOR.simulate(
        n_periods=n_periods, samples_per_period=samples, noise=0.02, seed=seed, impulse_deg=deg
    ).select(TWO)


def beside(record, row, **facts):
    """`record` with one more channel."""
    channel = Channel(**facts)
    return replace(record, values=np.vstack([record.values, row]), channels=(*record.channels, channel))


def with_force():
    """A hammer's force beside the responses."""
    record = ringing()
    blow = np.where(np.arange(record.n_samples) < 3, 40.0, 0.01 * np.sin(np.arange(record.n_samples)))
    return beside(record, blow, name="H", quantity="force", unit="N")


def with_orbit():
    """A decay about an orbit that the file holds, five times as large, and with harmonics."""
    record, phases = ringing(), 2.0 * np.pi * np.arange(8) / 8
    orbit = 5.0 * np.array([np.cos(phases) + 0.3 * np.cos(2 * phases), np.sin(phases + 0.4)])
    return replace(record, values=record.values + np.tile(orbit, 64), orbit=orbit)


def with_hits():
    """Two blows in one record, seen in the force."""
    one, other = ringing(n_periods=80), ringing(n_periods=40, seed=6, deg=120.0)
    values = one.values.copy()
    values[:, 320:] += other.values
    blows = np.zeros(640)
    blows[[0, 1, 320, 321]] = 40.0
    return beside(replace(one, values=values), blows, name="H", quantity="force", unit="N")


@cache
def with_tachometer():
    return Run(n_periods=80, wander=0.0, imbalance=0.0, samples_per_period=16.37, pulse_deg=90.0, seed=1).record()


def out_of_step():
    record = with_tachometer()
    return record.select(TWO).with_clock(ConstantPeriod(period=PERIOD))


def with_a_gap():
    record = ringing()
    values = record.values.copy()
    values[0, 100:103] = np.nan
    return replace(record, values=values)


CASES = {
    "force": (with_force, {}),
    "orbit": (with_orbit, {}),
    "hits and skip": (with_hits, {"find_hits": True, "skip": 2.0}),
    "channels": (with_force, {"channels": ("Y",)}),
    "tachometer": (with_tachometer, {}),
    "out of step": (out_of_step, {}),
    "missing samples": (with_a_gap, {}),
}
EVERY = pytest.mark.parametrize("case", CASES)


@cache
def found(case):
    make, options = CASES[case]
    record = make()
    return record, options, identify(record, validate=False, **options)


def as_lifted(analysis):
    """Whether cycles hold all that was fitted."""
    return by_cycles(analysis.fit, analysis.shafts)


def names(record):
    return [channel.name for channel in record.channels]


@pytest.mark.first(1)
@EVERY
def test_identify_starts_from_what_is_prepared(case):
    record, options, analysis = found(case)
    prepared, used = chain.prepare(record, **options), analysis.records
    assert len(prepared.records) == len(prepared.responses) == len(prepared.clocks) == len(used)
    for own, taken, response in zip(prepared.records, used, prepared.responses, strict=True):
        assert_array_equal(own.values, taken.values)
        assert (own.start, own.clock) == (taken.start, taken.clock)
        assert names(response) == [channel.name for channel in analysis.model.channels]
    assert tuple(own for own in analysis.findings if own in prepared.findings) == prepared.findings
    assert bool(prepared.shafts) == (case == "tachometer")


@EVERY
def test_lifted_responses_are_of_the_same_channels_and_cycles(case):
    record, options, analysis = found(case)
    lifted = chain.lifted(record, **options)
    assert names(lifted) == [channel.name for channel in analysis.model.channels]
    assert lifted.responses.lengths.tolist() == [cycles.n_cycles for cycles in analysis.cycles]
    assert lifted.period == pytest.approx(analysis.model.period, rel=1e-5)
    if as_lifted(analysis):
        assert_array_equal(lifted.responses.values, lift(analysis.cycles).responses.values)
    again = chain.lifted(chain.prepare(record, **options))
    assert_array_equal(again.responses.values, lifted.responses.values)


@pytest.mark.first(3)
@EVERY
def test_a_scan_that_is_typed_is_of_the_same_channels_and_cycles(case, tmp_path, monkeypatch):
    record, options, analysis = found(case)
    monkeypatch.chdir(tmp_path)
    write(record, "run.npz")
    clock = ["--tach", "tach"] if case == "tachometer" else ["--period", repr(PERIOD)]
    if case == "tachometer":
        assert record.clock.channel == "tach"
        clock += ["--pulses-per-rev", str(record.clock.pulses_per_revolution)]
        clock += ["--periods-per-rev", str(record.clock.periods_per_revolution)]
    words = {"skip": ["--skip", str(options.get("skip"))], "find_hits": ["--find-hits"], "orbit": ["--no-orbit"]}
    words["channels"] = ["--channels", ",".join(options.get("channels", ()))]
    told = [word for name in options for word in words[name]]
    content = strict_json(typed(["scan", "run.npz", *clock, *told, "--orders", "2", "--format", "json"]))
    assert content["channels"] == [channel.name for channel in analysis.model.channels]
    assert content["n_cycles"] == [cycles.n_cycles for cycles in analysis.cycles]
    assert content["n_phases"] == chain.lifted(record, **options).n_phases
    assert content["synchronisation"] == [str(own) for own in chain.prepare(record, **options).findings]
    shown = " ".join(typed(["scan", "run.npz", *clock, *told, "--orders", "2"]).split())
    assert all(" ".join(for_command(sentence).split()) in shown for sentence in content["synchronisation"])


@EVERY
def test_draws_and_checks_are_of_the_same_channels_and_clocks(case):
    record, options, analysis = found(case)
    prepared, plan = chain.prepare(record, **options), plan_of(analysis, whole=True)
    records, clocks = analysis.fit.free, analysis.clocks
    assert [names(one) for one in records] == [names(one) for one in prepared.responses]
    assert len(plan.clean) == len(records) == len(clocks)
    if as_lifted(analysis):
        lengths = [hit.n_cycles * hit.n_phases for hit in analysis.cycles]
        assert [clean.shape for clean in plan.clean] == [(len(names(records[0])), n) for n in lengths]
        return
    for own, clock, drawn, clean, rows in zip(
        prepared.responses, clocks, plan.clocks, plan.clean, plan.rows, strict=True
    ):
        assert clean.shape == own.values.shape
        assert [names(plan.records[0])[row] for row in rows] == names(own)
        times = own.times[::50]
        for tied in (clock, drawn):
            assert type(tied) is type(prepared.clocks[0])
            if isinstance(tied, ShaftAngle):
                assert_array_equal(tied.angle(times), prepared.clocks[0].angle(times))
            else:
                assert tied == prepared.clocks[0]


def test_a_loaded_result_has_the_clocks_that_were_found(tmp_path):
    analysis = found("tachometer")[2]
    save(analysis, tmp_path / "result.h5")
    back, plan = load(tmp_path / "result.h5"), plan_of(analysis, whole=False)
    again = plan_of(back, whole=False)
    times = analysis.records[0].times
    np.testing.assert_allclose(again.clocks[0].angle(times), plan.clocks[0].angle(times), rtol=1e-12)


@pytest.mark.slow
def test_a_force_that_was_named_for_a_response_stays_one_in_a_draw():
    """Each draw identified from the beginning: the force would be left out of it for being no response."""
    record = ringing()
    half = beside(record.select(["X"]), record.values[1], name="Y", quantity="force", unit="N")
    analysis = identify(half, channels=("X", "Y"), validate=False)
    assert [channel.name for channel in analysis.model.channels] == TWO
    one = draw(redrawn(analysis, whole=True), np.random.SeedSequence(1))
    assert one.failure == ""
    assert one.order == analysis.model.order
    # Of one channel alone, the shapes would be those of it twice.
    assert np.abs(one.coefficients[:, 1] - one.coefficients[:, 0]).max() > 0.01
    np.testing.assert_allclose(one.coefficients, analysis.model.coefficients, atol=0.1)


def test_a_force_in_one_of_two_records_is_left_out_of_it():
    one, other = with_force(), ringing(seed=6, deg=120.0)
    for several in ([one, other], [other, one]):
        prepared = chain.prepare(several)
        assert [names(record) for record in prepared.responses] == [TWO, TWO]
        assert len(prepared.findings) == 1


def test_periods_are_skipped_of_each_hit():
    whole, less = (chain.prepare(with_hits(), find_hits=True, skip=skip).responses for skip in (None, 2.0))
    assert [one.n_samples - other.n_samples for one, other in zip(whole, less, strict=True)] == [16, 16]


def test_pulses_that_are_alike_in_two_records_are_no_copied_response():
    record = with_tachometer()
    noise = 0.001 * np.random.default_rng(3).standard_normal(record.values.shape)
    noise[names(record).index("tach")] = 0.0
    prepared = chain.prepare([record, replace(record, values=record.values + noise)])
    assert len(prepared.shafts) == 2


def test_hits_on_shafts_of_other_speeds_are_lifted_with_the_mean_period():
    record = with_tachometer()
    slower = replace(record, sample_rate=record.sample_rate * 0.999, values=1.5 * record.values[:, 5:])
    lifted = chain.lifted([record, slower])
    shafts = chain.prepare([record, slower]).shafts
    assert lifted.period == pytest.approx(np.mean([shaft.period for shaft in shafts]), rel=1e-12)
    assert lifted.n_hits == 2


# What is refused before any long work.

HERTZ = (
    r"shorter than the record \(2\.1 s\), but is 50 s\.\n  "
    r"0\.02 s \(1/50, if 50 was meant in Hz\) would fit: `period=0\.02`"
)
SECONDS = (
    r"two sampling intervals or more \(0\.2 s\), but is 0\.0333333 s\.\n  "
    r"30 s \(if 30 was meant in s, and no frequency\) would fit: `period=30`"
)
SLIPS = {
    "hertz": (50.0, 1000.0, HERTZ),
    "milliseconds": (20.0, 1000.0, r"0\.02 s \(if it was meant in ms\) would fit: `period=0\.02`"),
    "revolutions a minute": (3000.0, 1000.0, r"0\.02 s \(if 3000 was meant in revolutions a minute\) would fit"),
    "seconds for hertz": (1.0 / 30.0, 10.0, SECONDS),
    "a frequency a minute": (1.0 / 3000.0, 1000.0, r"0\.02 s \(if the frequency of 3000 was meant in revolutions"),
    "kilohertz": (0.02, 1.0, r"a sampling rate of 1000 Hz \(if times or rate .*\) would fit: `rate=1000`"),
    "none fits": (1.9, 1.0, r"two sampling intervals or more \(2 s\), but is 1\.9 s\.\n  "),
    "too long": (2.0, 1.0, None),
    "fewer than four": (525.2, 1.0, r"holds 3 whole periods: fewer than 4 .* check the period\.$"),
    "just four": (525.1, 1.0, None),
    "fewer than four hertz": (700.0, 1.0, r"holds 3 whole periods: .* check the period\.$"),
    "two in a minute": (1.0, 1.0, None),
    "five hertz": (5.0, 200.0, r"holds 2 whole periods: (.|\n)*0\.2 s \(1/5, if 5 was meant in Hz\) would fit"),
}  # fmt: skip


@pytest.mark.parametrize(("period", "rate", "words"), SLIPS.values(), ids=SLIPS)
@pytest.mark.parametrize("use", ["identify", "lifted", "prepare"])
def test_a_period_that_cannot_be_is_refused_with_the_slip_that_fits(period, rate, words, use):
    values = np.random.default_rng(0).standard_normal((1, 2100))
    record = Record(values=values, sample_rate=rate, channels=["x"])
    if words is None:
        assert use != "prepare" or chain.prepare(record, period=period).clocks[0].period == period
        return
    with pytest.raises((InputError, IdentificationError), match=words):
        getattr(chain, use)(record, period=period)


def test_a_shaft_that_turns_too_seldom_is_refused():
    record = ringing()
    pulses = PulseTimes(times=np.arange(0.0, record.duration, 30.0), periods_per_revolution=0.2)
    with pytest.raises(
        IdentificationError, match=r"holds 2 whole periods.*`pulses_per_revolution=`, `periods_per_revolution=`"
    ):
        chain.prepare(record.with_clock(pulses))


@pytest.mark.parametrize(
    ("records", "options", "words"),
    [
        ([], {}, "`records` of `identify` must be a Record or a list of them"),
        ([3], {}, "must be a Record or a list of them"),
        (lambda: replace(ringing(), clock=None), {}, "must have a clock, but the record has none"),
        (lambda: replace(with_a_gap(), clock=None), {}, "must have a clock, but the record has none"),
        (lambda: replace(ringing(), clock=None), {"forced": "1"}, "must have a clock, but the record has none"),
        (lambda: [ringing(), replace(ringing(seed=6), clock=None)], {}, "must have a clock, but one has none"),
        (lambda: replace(ringing(), clock=None), {"skip": 1.0}, "`skip` of `identify` must come with a clock"),
        (lambda: [ringing(), with_tachometer().select([*TWO, "tach"])], {}, "all have a measured shaft angle, or none"),
        (lambda: [ringing(), ringing(seed=6).select(["Y", "X"])], {}, "have the same channels, but number 1 has"),
        (lambda: [ringing(), ringing()], {}, "channel 'X' of record 2 is a copy"),
        (lambda: replace(ringing(), values=ringing().values[:, :1]), {}, "must be shorter than the record"),
        (lambda: replace(ringing(), values=ringing().values[:, :2]), {"skip": 1.0}, "must be shorter than the record"),
        (lambda: replace(ringing(), values=0.0 * ringing().values), {}, "is constant"),
        (ringing, {"states": ("X", "Q")}, "'Q'"),
        (ringing, {"skip": 60.5}, "holds 3 whole periods"),
        (ringing, {"skip": 63.9}, "leave most of each record"),
        (ringing, {"no_such": 1}, "has no option `no_such`"),
        (ringing, {"estimate_period": True, "period": 1e-3}, "two sampling intervals or more"),
        (ringing, {"estimate_period": True, "period": 1e4}, "shorter than the record"),
    ],
)
def test_what_cannot_be_prepared_is_refused(records, options, words):
    with pytest.raises((InputError, IdentificationError), match=words):
        chain.prepare(records() if callable(records) else records, **options)


def test_a_record_of_its_clock_alone_is_refused():
    record = with_tachometer().select(["tach"])
    with pytest.raises(InputError, match="`records` of `identify` must have a channel of responses"):
        chain.prepare(record)


@pytest.mark.parametrize(
    ("argument", "options"),
    [
        ("settings", {"settings": 3}), ("channels", {"channels": ["Q"]}), ("channels", {"channels": ["X", "X"]}),
        ("tach", {"tach": "Q"}), ("tach", {"tach": "X"}), ("azimuth", {"azimuth": "Q"}), ("records", {"azimuth": "X"}),
        ("records", {"tach": "tach", "periods_per_revolution": 50}), ("forced", {"forced": "1,99"}),
        ("structure", {"states": TWO, "structure": "junk"}), ("structure", {"states": TWO, "structure": "damping foo"}),
        ("periods_per_revolution", {"periods_per_revolution": 0.7}),
        ("harmonics", {"identifier": "era"}),
    ],
)  # fmt: skip
def test_messages_name_the_arguments_of_the_callable_asked(argument, options):
    record = with_tachometer().select([*TWO, "tach"]) if "tach" in options.values() else ringing()
    with pytest.raises(InputError, match=rf"Argument `{argument}` of `(identify|Settings)` must "):
        identify(record, validate=False, **options)


def test_one_sample_a_period_is_one_of_a_constant_system():
    record = Record(values=0.9 ** np.arange(40.0)[None, :], sample_rate=1.0, channels=["x"])
    assert chain.prepare(record, period=1.0).clocks[0].period == 1.0


def test_a_period_that_is_found_takes_the_place_of_any_other_clock():
    record = ROTOR.simulate(n_periods=100, samples_per_period=16, noise=0.02, seed=3)
    pulses = np.where(np.arange(record.n_samples) % 16 == 0, 5.0, 0.0)
    record = beside(record, pulses, name="tach", quantity="other", unit="V")
    prepared = chain.prepare(record.with_clock(TachometerSignal(channel="tach")), estimate_period=True)
    assert "tach" not in names(prepared.records[0])
    assert prepared.clocks[0].period == pytest.approx(PERIOD, rel=1e-3)
    assert prepared.shafts == ()


@pytest.mark.first(1)
@pytest.mark.parametrize("facts", [{"name": "Azimuth", "unit": "deg"}, {"name": "tacho"}])
def test_two_runs_at_one_speed_share_their_clock_channel(facts):
    """Simulated runs have one azimuth to the last digit: it is no response, whatever ties the records to the phase."""
    angle = np.arange(512) * 45.0 % 360.0
    pair = [beside(ringing(seed=seed, deg=deg), angle, **facts) for seed, deg in ((5, 45.0), (6, 120.0))]
    for options in ({}, {"estimate_period": True}, *([{"azimuth": "Azimuth"}] if "unit" in facts else [])):
        prepared = chain.prepare(pair, **options)
        assert [names(record) for record in prepared.responses] == [TWO, TWO]
    with pytest.raises(InputError, match="is a copy"):
        chain.prepare(pair, channels=("X", facts["name"]))


def test_what_is_wrong_with_samples_is_told_with_a_refusal():
    record = ringing()
    values = np.clip(record.values, -0.5 * record.values.max(), 0.5 * record.values.max())[:, :24]
    with pytest.raises(IdentificationError, match=r"holds 3 whole periods(.|\n)*clip"):
        chain.prepare(replace(record, values=values))


def test_an_orbit_is_left_in_where_that_is_asked_for():
    record = with_orbit()
    without, within = chain.lifted(record), chain.lifted(record, orbit=False)
    assert np.abs(within.responses.values).max() > 4.0 * np.abs(without.responses.values).max()
    assert chain.prepare(record, orbit=False).findings == ()


def test_settings_are_given_once():
    prepared = chain.prepare(ringing())
    with pytest.raises(InputError, match="`period` of `lifted` must be left out with records that are prepared"):
        chain.lifted(prepared, period=1.0)
    with pytest.raises(InputError, match="`settings` of `lifted`"):
        chain.lifted(prepared, chain.Settings())
