"""The whole chain by `identify`: options, intermediates, refusals, warnings, and systems of awkward kinds."""

import dataclasses
import re
from typing import get_args

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from floquid import floquet
from floquid.core import Channel, ConstantPeriod, PeriodicModel, Record
from floquid.errors import IdentificationError, InputError
from floquid.lti import AMI, ERA, LSCF, MaximumLikelihood, PolyLSCF
from floquid.pipeline import Analysis, IdentifierName, Settings, identify
from floquid.preparation import prepare
from floquid.preparation._before import responses_of
from floquid.systems import JeffcottRotor
from floquid.testing import assert_exponents_close, pair_exponents

PERIOD, PHASES = 6.0, 12


def pairs(exponents, *, channels=2, hits=1, width=2, seed=0) -> PeriodicModel:
    """Pairs with random shapes, the zeroth harmonic the largest."""
    upper, n = np.asarray(exponents), len(exponents)
    generator = np.random.default_rng(seed)
    size = (n, channels, hits, 2 * width + 1)
    shapes = generator.standard_normal(size) + 1j * generator.standard_normal(size)
    shapes *= 0.3 ** np.abs(np.arange(-width, width + 1))
    shapes[..., width] += 2.0
    if hits > 1:
        # One system started in different ways: a hit has so much of the whole shape, and no shape of its own.
        share = generator.uniform(0.5, 1.5, (n, 1, hits, 1)) * np.exp(
            2j * np.pi * generator.uniform(size=(n, 1, hits, 1))
        )
        shapes = shapes[:, :, :1] * share
    return PeriodicModel(
        exponents=np.stack([upper, upper.conj()], axis=1).ravel(),
        coefficients=np.stack([shapes, shapes[..., ::-1].conj()], axis=1).reshape(2 * n, *size[1:]),
        harmonics=np.arange(-width, width + 1),
        period=PERIOD,
        channels=[f"c{i}" for i in range(channels)],
    )


def ringing(model, *, n_cycles=60, noise=0.01, seed=0, first=0, offset=0.0) -> list[Record]:
    """One record a hit of the model."""
    generator = np.random.default_rng(seed)
    step = model.period / PHASES
    values = model.response(step * (first + np.arange(n_cycles * PHASES)))
    values = values + noise * np.abs(values).max(axis=2, keepdims=True) * generator.standard_normal(values.shape)
    return [
        Record(
            values=values[:, hit] + offset,
            sample_rate=1.0 / step,
            channels=model.channels,
            clock=ConstantPeriod(period=model.period),
            start=step * first,
        )
        for hit in range(model.n_hits)
    ]


TWO = [-0.03 + 0.85j, -0.02 + 0.32j]
STAGES: list[str] = []
"""What the identification of the fixture told."""


@pytest.fixture(scope="module")
def analysis() -> Analysis:
    return identify(ringing(pairs(TWO)), states=["c0", "c1"], system_times=9, report=STAGES.append)


def test_every_stage_is_kept(analysis):
    assert analysis.settings == Settings(states=("c0", "c1"), system_times=9)
    assert [r.n_samples for r in analysis.records] == [720]
    assert [c.values.shape for c in analysis.cycles] == [(2, 12, 60)]
    assert analysis.lifted.responses.values.shape == (24, 1, 60)
    assert analysis.modal.order == analysis.model.order == 4
    assert analysis.state.system.shape == (9, 4, 4)
    assert analysis.warnings == ()
    assert_exponents_close(analysis.model.exponents, pairs(TWO).exponents, PERIOD, atol=2e-3)


def test_exponents_are_on_their_physical_branch(analysis):
    assert_allclose(analysis.model.exponents[::2].imag, [0.32, 0.85], atol=2e-3)


def test_the_noise_is_that_of_the_record(analysis):
    model = pairs(TWO)
    times = model.period / PHASES * np.arange(720)
    sigma = 0.01 * np.abs(model.response(times)).max(axis=2)
    assert_allclose(analysis.lifted.noise, sigma, rtol=0.1)


def test_the_residual_is_noise(analysis):
    """Response and data differ by the noise: nothing is left out and nothing fitted twice."""
    (record,) = analysis.records
    left = (record.values - analysis.model.response(record.times)[:, 0]) / analysis.lifted.noise
    assert np.mean(left**2) == pytest.approx(1.0, abs=0.1)


def test_the_history_is_told(analysis):
    assert analysis.provenance.steps == ("cut into 60 periods of 12 samples",)
    assert analysis.state.provenance.steps[-1] == "state matrix in second-order form from c0, c1"


def test_options_are_fields_of_settings_by_name_or_as_one(analysis):
    records = ringing(pairs(TWO))
    once = identify(records, Settings(states=("c0", "c1"), validate=False), system_times=9)
    assert once.settings == dataclasses.replace(analysis.settings, validate=False)
    assert_array_equal(once.model.exponents, analysis.model.exponents)
    assert_array_equal(once.state.system, analysis.state.system)


def test_an_unknown_option_is_refused():
    with pytest.raises(InputError, match=r"^`identify` has no option `perid`. Did you mean `period`"):
        identify(ringing(pairs(TWO)), perid=6.0)
    with pytest.raises(InputError, match="has no option `colour`") as error:
        identify(ringing(pairs(TWO)), colour="red")
    for field in dataclasses.fields(Settings):
        assert field.name in str(error.value)


@pytest.mark.parametrize(
    ("option", "wrong", "words"),
    [
        ("period", 0.0, "be positive"),
        ("period", -6.0, "be positive"),
        ("period", np.nan, "be a finite number"),
        ("period", "6", "be a finite number"),
        ("channels", "c0", "be a list of channel names"),
        ("states", "c0", "be a list of channel names"),
        ("states", [0, 1], "be a list of channel names"),
        ("order", 0, "be an integer of at least 1"),
        ("order", 2.5, "be an integer of at least 1"),
        ("harmonics", -1, "be an integer of at least 0"),
        ("system_times", 0, "be an integer of at least 1"),
        ("form", "third-order", 'be one of "second-order", "first-order", "delayed", but is .third-order.'),
        ("delay", 0.5, 'be None unless the form is "delayed", but is 0.5'),
        ("delay", -1.0, "be positive"),
        ("structure", 2, "be a structure, its text"),
        ("structure", "auto", "come with states, but is .auto. without any"),
        ("structure", "system 1", 'come with the form "first-order"'),
        ("output_error", True, "come with a structure, but there is none"),
        ("output_error", 1, "be true or false"),
        ("mode_false_alarm", 0.0, "be positive"),
        ("mode_false_alarm", 1.0, "lie between 0 and 1"),
        ("harmonic_false_alarm", 2.0, "lie between 0 and 1"),
    ],
)
def test_an_option_that_is_not_possible_is_refused(option, wrong, words):
    with pytest.raises(InputError, match=rf"^Argument `{option}` of `Settings` must {words}"):
        Settings(**{option: wrong})


@pytest.mark.slow
def test_the_period_given_goes_before_the_records_clock(analysis):
    (record,) = ringing(pairs(TWO))
    unclocked = Record(values=record.values, sample_rate=record.sample_rate, channels=record.channels)
    with pytest.raises(InputError, match="must have a clock"):
        identify(unclocked)
    for other in (unclocked, record.with_clock(ConstantPeriod(period=1.0))):
        found = identify(other, period=PERIOD, validate=False)
        assert_array_equal(found.model.exponents, analysis.model.exponents)


def test_the_clocks_origin_stays_when_the_period_is_given():
    (record,) = ringing(pairs(TWO), first=5)
    moved = record.with_clock(ConstantPeriod(period=1.0, origin=1.5))
    assert identify(moved, period=PERIOD, validate=False).cycles[0].first_phase == pytest.approx((2.5 - 1.5) / PERIOD)


def test_channels_are_chosen_by_name_and_order():
    records = ringing(pairs(TWO, channels=3))
    chosen = identify(records, channels=["c2", "c0"], validate=False)
    assert [c.name for c in chosen.model.channels] == ["c2", "c0"]
    assert chosen.model.order == 4
    with pytest.raises(InputError, match="'c9'"):
        identify(records, channels=["c9"])


def test_several_hits_share_exponents_and_keep_their_shapes_apart():
    truth = pairs(TWO, hits=3)
    records = ringing(truth, n_cycles=40)
    # Hits of unequal length, the second one starting later in the period.
    late = ringing(truth, first=7, n_cycles=40)[1]
    records = [records[0], late, dataclasses.replace(records[2], values=records[2].values[:, :400])]
    found = identify(records, validate=False)
    assert found.model.n_hits == 3
    assert [c.n_cycles for c in found.cycles] == [40, 39, 33]
    assert_exponents_close(found.model.exponents, truth.exponents, PERIOD, atol=2e-3)
    alone = identify(records[0], validate=False)
    assert (found.model.exponent_std.real < alone.model.exponent_std.real).all()
    for hit in (0, 2):
        ring = found.model.response(records[hit].times)[:, hit]
        left = (records[hit].values - ring) / found.lifted.noise[:, hit, None]
        assert np.mean(left**2) == pytest.approx(1.0, abs=0.15)


def test_a_fixed_order_and_fixed_harmonics():
    records = ringing(pairs(TWO))
    low = identify(records, order=2, validate=False)
    assert low.model.order == 2
    assert low.state is None
    with pytest.raises(IdentificationError, match="order 1 cannot be reached"):
        identify(records, order=1)
    fixed = identify(records, harmonics=3, validate=False).model
    assert fixed.harmonics.tolist() == list(range(-3, 4))
    assert (fixed.coefficients != 0).all()


@pytest.mark.parametrize(
    ("option", "wrong"), [("order", 60), ("harmonics", 6), ("states", ["c0", "c9"]), ("channels", ["c0", "c0"])]
)
def test_what_the_record_cannot_hold_is_refused(option, wrong):
    with pytest.raises(InputError, match=r"^Argument `"):
        identify(ringing(pairs(TWO)), **{option: wrong})


@pytest.mark.parametrize("records", [[], ["file.npz"], [np.zeros((2, 100))]])
def test_what_is_no_record_is_refused(records):
    with pytest.raises(InputError, match=r"^Argument `records` of `identify` must be a Record or a list of them"):
        identify(records)


def test_fewer_than_four_periods_are_refused():
    with pytest.raises(IdentificationError, match="holds 3 whole periods: fewer than 4"):
        identify(ringing(pairs(TWO), n_cycles=3))


@pytest.mark.first(1)
def test_fewer_periods_than_modes_are_refused():
    many = pairs(-0.02 + 1j * np.linspace(0.05, 0.5, 5), channels=6)
    with pytest.raises(IdentificationError, match="holds 7 whole periods, too few for the 8 poles"):
        identify(ringing(many, n_cycles=7, noise=1e-3))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 16))
def test_fewer_periods_than_modes_do_not_pass_without_a_word(seed):
    """Ten exponents in seven periods: fewer modes leave what is above the noise, or their decays are not determined."""
    many = pairs(-0.02 + 1j * np.linspace(0.05, 0.5, 5), channels=6)
    try:
        analysis = identify(ringing(many, n_cycles=7, noise=1e-3, seed=seed))
    except IdentificationError as error:
        assert re.search("holds 7 whole periods, too few for the (8|10) poles|does not repeat", str(error))  # noqa: PT017
        return
    assert not analysis.passed or "misfit" in {finding.code for finding in analysis.findings}


@pytest.mark.first(2)
@pytest.mark.parametrize(("n_pairs", "n_cycles"), [(2, 5), (3, 8), (5, 20), (2, 6)])
def test_fewer_periods_than_free_residues_need_are_enough_for_shapes(n_pairs, n_cycles):
    exponents = -0.02 + 1j * np.linspace(0.05, 0.5, n_pairs)
    model = identify(ringing(pairs(exponents, channels=6), n_cycles=n_cycles, noise=1e-3), validate=False).model
    assert model.order == 2 * n_pairs
    pairing = pair_exponents(model.exponents, np.concatenate([exponents, exponents.conj()]), model.period)
    assert np.abs(pairing.differences).max() < 1e-3


@pytest.mark.first(1)
@pytest.mark.parametrize("seed", range(3))
def test_pure_noise_is_refused(seed):
    generator = np.random.default_rng(seed)
    record = Record(
        values=generator.standard_normal((3, 1200)),
        sample_rate=2.0,
        channels=["a", "b", "c"],
        clock=ConstantPeriod(period=6.0),
    )
    with pytest.raises(IdentificationError, match="no mode rises above the noise"):
        identify(record)


def test_zeros_and_a_constant_channel_are_refused():
    (record,) = ringing(pairs(TWO))
    values = np.array(record.values)
    values[1] = 3.0
    with pytest.raises(InputError, match=r"channel 'c1' .* is constant"):
        identify(dataclasses.replace(record, values=values))
    with pytest.raises(InputError, match="is constant"):
        identify(dataclasses.replace(record, values=0.0 * values))


def test_a_channel_given_twice_is_refused():
    """Its noise would count twice and make the deviations too small by the square root of two."""
    (record,) = ringing(pairs(TWO))
    doubled = np.concatenate([record.values, record.values[:1]])
    with pytest.raises(InputError, match="'again' is a copy of channel 'c0'"):
        identify(dataclasses.replace(record, values=doubled, channels=[*record.channels, "again"]))
    with pytest.raises(InputError, match="is a copy of"):
        identify([record, record])


def test_an_offset_is_told_apart_from_the_modes():
    found = identify(ringing(pairs(TWO), offset=0.5))
    assert_exponents_close(found.model.exponents, pairs(TWO).exponents, PERIOD, atol=2e-3)
    assert found.fit.forced.offset == pytest.approx(0.5, rel=0.05)
    assert "An offset of the channels was fitted beside the modes." in found.synchronisation
    assert found.warnings == ()


@pytest.mark.slow
def test_an_offset_that_is_left_in_is_warned_of():
    found = identify(ringing(pairs(TWO), offset=0.5), forced="none")
    assert found.model.order == 5
    still = np.argmin(np.abs(found.model.exponents))
    assert abs(found.model.multipliers[still] - 1.0) < 1e-3
    assert len(found.warnings) == 1
    assert "multiplier of 1" in found.warnings[0]
    others = np.delete(found.model.exponents, still)
    assert_exponents_close(others, pairs(TWO).exponents, PERIOD, atol=2e-3)


@pytest.mark.slow
def test_a_real_mode_that_decays_is_not_taken_for_an_offset():
    truth = pairs(TWO)
    generator = np.random.default_rng(1)
    half = generator.standard_normal((1, 2, 1, 5)) + 1j * generator.standard_normal((1, 2, 1, 5))
    truth = dataclasses.replace(
        truth,
        exponents=np.append(truth.exponents, -0.03),
        coefficients=np.concatenate([truth.coefficients, half + half[..., ::-1].conj()]),
    )
    found = identify(ringing(truth))
    assert_exponents_close(found.model.exponents, truth.exponents, PERIOD, atol=2e-3)
    assert found.warnings == ()


def test_a_constant_system_is_warned_of():
    found = identify(ringing(pairs(TWO, width=0)), validate=False)
    assert any("No mode has a second harmonic" in warning for warning in found.warnings)


def test_a_growing_mode_is_found_and_warned_of():
    truth = pairs([0.01 + 0.85j, -0.02 + 0.32j])
    found = identify(ringing(truth, noise=1e-4), validate=False)
    assert_exponents_close(found.model.exponents, truth.exponents, PERIOD, atol=2e-3)
    assert any("2 of 4 exponents grow" in warning for warning in found.warnings)


def test_a_weakly_determined_mode_is_warned_of():
    found = identify(ringing(pairs([-0.2 + 0.85j, -0.02 + 0.32j]), noise=0.1), validate=False)
    assert any("exponents are weakly determined" in warning for warning in found.warnings)


def test_stages_are_reported(analysis):
    stages = ["cutting into", "estimating the noise", "searching for modes", "expanding the", "rebuilding the"]
    positions = [next(i for i, text in enumerate(STAGES) if text.startswith(stage)) for stage in stages]
    assert positions == sorted(positions)


def test_units_of_the_channels_do_not_matter(analysis):
    records = ringing(pairs(TWO))
    factor = np.array([[1e9], [1e-9]])
    scaled = [dataclasses.replace(r, values=r.values * factor) for r in records]
    here, there = analysis.model, identify(scaled, validate=False).model
    assert_allclose(there.exponents, here.exponents, rtol=1e-9)
    assert_array_equal(there.harmonics, here.harmonics)
    assert_allclose(there.coefficients / factor[:, :, None], here.coefficients, atol=1e-7)


def mathieu(damping=0.06, q=0.1):
    """x'' + 2ζx' + (1 - 2q cos 2t)x = 0, locked at half the parametric frequency: multipliers real and negative."""

    def system(t):
        t = np.asarray(t, float)
        a = np.zeros((*t.shape, 2, 2))
        a[..., 0, 1] = 1.0
        a[..., 1, 0] = -(1.0 - 2.0 * q * np.cos(2.0 * t))
        a[..., 1, 1] = -2.0 * damping
        return a

    return system


@pytest.mark.slow
@pytest.mark.parametrize(("noise", "atol", "system_atol"), [(0.0, 1e-8, 1e-6), (1e-4, 1e-3, 0.05)])
def test_a_locked_system_with_real_negative_multipliers(noise, atol, system_atol):
    """Both exponents of the damped Mathieu equation, and its A(t), from x alone."""
    system, period, phases, cycles = mathieu(), np.pi, 32, 200
    within = floquet.transition(system, period, period * np.arange(phases) / phases)
    states, monodromy = [np.array([0.3, 1.0])], floquet.monodromy(system, period)
    for _ in range(cycles - 1):
        states.append(monodromy @ states[-1])
    values = np.einsum("pn,kn->kp", within[:, 0, :], states).reshape(1, -1)
    values = values + noise * np.abs(values).max() * np.random.default_rng(0).standard_normal(values.shape)
    record = Record(values=values, sample_rate=phases / period, channels=["x"], clock=ConstantPeriod(period=period))
    found = identify(record, states=["x"], validate=False)
    assert_array_equal(found.modal.multipliers.imag, 0.0)
    assert (found.modal.multipliers.real < 0).all()
    assert_exponents_close(found.model.exponents, floquet.exponents(system, period), period, atol=atol)
    assert_allclose(found.state.system, system(found.state.times), atol=system_atol)
    assert "grow" not in " ".join(found.warnings)


def test_a_hit_too_short_to_judge_its_noise_is_refused_beside_a_long_one():
    record = JeffcottRotor().simulate(n_periods=120, samples_per_period=16, noise=0.01, seed=0)
    short = dataclasses.replace(record, values=record.values[:, ::-1][:, : 6 * 16])
    with pytest.raises(IdentificationError, match=r"Hit 2 holds 6 whole periods, fewer than 3 for each of \d+ poles"):
        identify([record, short])


@pytest.mark.slow
def test_half_of_the_true_period_is_warned_of():
    record = JeffcottRotor().simulate(n_periods=200, samples_per_period=16, noise=0.02, seed=0)
    warned = identify(record, period=np.pi).warnings
    assert any("is listed twice" in words for words in warned)
    assert not any("is listed twice" in words for words in identify(record).warnings)


@pytest.mark.slow
def test_an_order_that_is_too_low_is_warned_of_and_its_modes_are_not_whitened_away():
    records = ringing(pairs([-0.03 + 0.85j, -0.02 + 0.32j]), n_cycles=200)
    low = identify(records, order=2)
    assert low.lifted.whitening is None
    assert any("The order given, 2, is too low" in words for words in low.warnings)
    right = identify(records, order=4)
    assert not any("too low" in words for words in right.warnings)


def test_the_words_of_the_command_are_identifiers_in_python():
    assert Settings(identifier="poly").identifier == PolyLSCF()
    assert Settings(identifier="ami", mode_false_alarm=1e-4).identifier == AMI(false_alarm=1e-4)
    assert Settings(identifier="era-ml").identifier == MaximumLikelihood(initial=ERA())
    assert all(Settings(identifier=word).identifier for word in get_args(IdentifierName))
    for wrong in ("svd", "ml-poly", "poly-", 3, ERA):
        with pytest.raises(InputError, match=r"must be one of ml, ami, .*, an object of `floquid.lti`"):
            Settings(identifier=wrong)


def test_an_identifier_of_a_part_of_the_band_is_refused():
    records = ringing(pairs([-0.03 + 0.85j, -0.02 + 0.32j]))
    with pytest.raises(InputError, match=r"`identifier` of `identify` must look at the whole band"):
        identify(records, identifier=LSCF(band=(0.2, 0.4)), harmonics=2)


@pytest.mark.parametrize("quantity", ["force", "pulse"])
def test_what_is_no_response_is_left_out(quantity):
    """A hammer's force and a tachometer's pulses beside the responses: neither is one, unless it is named."""
    record = JeffcottRotor().simulate(n_periods=40, samples_per_period=16, noise=0.02, seed=5).select(["X", "Y"])
    unit = "N" if quantity == "force" else "V"
    hammer = np.where(np.arange(record.n_samples) < 3, 40.0, 0.01 * np.sin(np.arange(record.n_samples)))
    channels = [*record.channels, Channel(name="H", quantity=quantity, unit=unit)]
    beside = dataclasses.replace(record, values=np.vstack([record.values, hammer]), channels=channels)
    found, alone = prepare(beside), prepare(record)
    assert [channel.name for channel in found.responses[0].channels] == ["X", "Y"]
    assert np.array_equal(found.responses[0].values, alone.responses[0].values)
    assert any(str(said).startswith(f"Channel H is a {quantity} and was left out") for said in found.findings)
    assert responses_of((beside,), Settings(channels=("X", "H"))) == ((beside,), ())
