"""G from polynomials over neighbouring lines of an arbitrary record, against steady responses of the equations."""

from __future__ import annotations

import numpy as np
import pytest
from tests.driven import mathieu, record_of, two_masses
from tests.unit.transfer.test_repeats import squares

from floquid import IdentificationError, InputError, Record, measure_transfer, multisine


def measured(system, phases, periods, noise, seed, **words):
    values, inputs = record_of(system, periods, phases, noise, seed)
    names = [f"F{number}" for number in range(len(inputs))]
    record = Record(
        values=np.concatenate([values, inputs]),
        sample_rate=phases / system.period,
        channels=[*(f"y{number}" for number in range(len(values))), *names],
    )
    words = {"harmonics": np.arange(-2, 3), **words}
    return measure_transfer(record, period=system.period, inputs=names, **words)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("system", "phases", "periods", "noise"),
    [(mathieu(damping=0.1), 20, 1600, 0.05), (mathieu(damping=0.2), 20, 400, 0.2)],
)
def test_the_variance_is_calibrated_where_resonances_are_wide(system, phases, periods, noise):
    found = [measured(system, phases, periods, noise, seed) for seed in range(6)]
    # Over a variance estimated of some twenty lines of two parts the mean is some five per cent above 1.
    assert np.mean([squares(own, system, phases).mean() for own in found]) == pytest.approx(1.05, abs=0.05)
    assert not any(own.warnings for own in found)
    assert all(np.isnan(own.nonlinear).all() for own in found)


def looped(system, phases, periods, feedback, noise, on_input, seed):
    """A record of a loop u = r - K y, y with noise and u measured with noise."""
    generator = np.random.default_rng(seed)
    command = generator.standard_normal(periods * phases)
    off, maps, step = noise * generator.standard_normal(len(command)), system.maps(phases), system.period / phases
    state, rows = np.zeros(len(system.A(0.0))), []
    for number, own in enumerate(command.tolist()):
        answer = float((system.C(number * step) @ state)[0]) + off[number]
        force = own - feedback * answer
        rows.append([answer, force, own])
        transition, forcing = maps[number % phases]
        state = transition @ state + forcing[:, 0] * force
    values = np.array(rows).T
    values[1] += on_input * generator.standard_normal(len(command))
    return Record(values=values, sample_rate=phases / system.period, channels=["y", "F", "r"])


def bias(records, truth, hertz, **words):
    """The squared mean error over records, over the variance of that mean: 1 where there is no bias."""
    found = [measure_transfer(own, inputs=["F"], period=np.pi, frequencies_hz=hertz, **words) for own in records]
    error = np.mean([own.transfer.values - truth for own in found], axis=0)
    variance = np.mean([np.abs(own.transfer.std) ** 2 for own in found], axis=0) / len(found)
    return np.mean(np.abs(error) ** 2 / variance)


@pytest.mark.slow
@pytest.mark.parametrize(("feedback", "noise", "on_input"), [(0.5, 0.5, 0.02), (0.0, 0.02, 0.3)])
def test_a_reference_takes_the_bias_of_a_loop_and_of_noise_on_the_input(feedback, noise, on_input):
    system, phases = mathieu(damping=0.1), 20
    records = [looped(system, phases, 800, feedback, noise, on_input, seed) for seed in range(20)]
    hertz = np.rint(np.linspace(0.5, 1.0, 30) * 800) / (800 * np.pi)
    truth = system.sampled_transfer(hertz, np.arange(-2, 3), phases)
    words = {"harmonics": np.arange(-2, 3)}
    assert bias(records, truth, hertz, reference=["r"], **words) == pytest.approx(1.0, abs=0.25)
    assert bias(records, truth, hertz, channels=["y"], method="polynomials", **words) > 3.0


def test_references_that_cannot_stand_for_the_inputs():
    record = looped(mathieu(), 20, 60, 0.1, 0.01, 0.0, 0)
    for words, message in (({"reference": ["F"]}, "reference"), ({"reference": ["r"], "method": "repeats"}, "method")):
        with pytest.raises(InputError, match=message):
            measure_transfer(record, period=np.pi, inputs=["F"], **words)


def test_a_reference_is_looked_for_beside_the_channels_and_named():
    record = looped(mathieu(damping=0.2), 20, 200, 0.1, 0.01, 0.0, 0)
    words = {"period": np.pi, "inputs": ["F"], "frequencies_hz": [0.1, 0.2]}
    found, same = (measure_transfer(record, reference=["r"], **words, **more) for more in ({}, {"channels": ["y"]}))
    assert np.array_equal(found.transfer.values, same.transfer.values)
    for more in ({}, {"channels": ["y"]}):
        with pytest.raises(InputError, match=r"`reference` of `measure_transfer` must name channels.*has 'q'"):
            measure_transfer(record, reference=["q"], **words, **more)


def test_two_inputs_and_frequencies_that_are_named():
    system = two_masses()
    found = measured(system, 24, 1500, 0.01, 0, frequencies_hz=[0.1, 0.25])
    assert found.transfer.frequencies_hz == pytest.approx([0.1, 0.25], abs=1e-4)
    assert found.method == "polynomials"
    assert squares(found, system, 24).mean() < 1.6
    assert (found.coherence > 0.9).any()


@pytest.mark.slow
def test_units_of_two_inputs_may_be_far_apart():
    """The power that an input has between the lines of others is its own."""
    system = two_masses()
    values, inputs = record_of(system, 60, 24, 0.01, 0)
    names = ["y0", "y1", "F0", "F1"]
    found = [
        measure_transfer(
            Record(values=np.vstack([values, own]), sample_rate=24 / system.period, channels=names),
            period=system.period,
            inputs=names[2:],
            method="polynomials",
        ).transfer.values
        for own in (inputs, inputs * [[1.0], [1e4]])
    ]
    assert np.isfinite(found[0]).all()
    assert found[1][:, :, 1] * 1e4 == pytest.approx(found[0][:, :, 1], rel=1e-6)


@pytest.mark.slow
def test_a_resonance_that_is_too_narrow_is_told():
    found = measured(mathieu(damping=0.02), 20, 400, 0.05, 0)
    assert any("flattened" in words for words in found.warnings)
    assert squares(found, mathieu(damping=0.02), 20).mean() > 1.08


def test_a_record_too_short_is_refused():
    with pytest.raises(IdentificationError, match="too few"):
        measured(mathieu(), 20, 10, 0.05, 0, harmonics=np.arange(-6, 7))


def test_inputs_that_do_not_repeat_have_no_repeats():
    with pytest.raises(IdentificationError, match="do not repeat"):
        measured(mathieu(), 20, 60, 0.05, 0, method="repeats")


def test_the_method_may_be_named():
    assert measured(mathieu(), 20, 200, 0.05, 0, method="polynomials").method == "polynomials"


@pytest.mark.parametrize("digits", [5, 10, 17])
def test_between_the_lines_of_a_multisine_there_is_nothing_to_tell(digits):
    design = multisine(np.pi, 20 / np.pi, turns=64, band=(0.05, 1.0))
    inputs = np.tile(design.values, 4)
    values = np.concatenate(record_of(mathieu(), None, 20, 0.01, 0, inputs))
    values = np.array([float(f"{own:.{digits}g}") for own in values.ravel()]).reshape(values.shape)
    record = Record(values=values, sample_rate=20.0 / np.pi, channels=["y", "F"])
    words = {"period": np.pi, "inputs": ["F"], "harmonics": [-1, 0, 1], "method": "polynomials"}
    with pytest.raises(
        IdentificationError, match=r"no power between their lines(.|\n)*G is not determined there(.|\n)*repeats"
    ):
        measure_transfer(record, **words)


def test_frequencies_beyond_the_inputs_have_no_value():
    system, phases, periods = mathieu(damping=0.2), 20, 400
    spectrum = np.fft.rfft(np.random.default_rng(0).standard_normal(periods * phases))
    spectrum[int(1.5 * periods * np.pi) :] = 0.0
    values, inputs = record_of(system, None, phases, 0.05, 0, np.fft.irfft(spectrum)[None])
    record = Record(values=np.concatenate([values, inputs]), sample_rate=phases / np.pi, channels=["y", "F"])
    words = {"period": np.pi, "inputs": ["F"], "harmonics": [-1, 0, 1], "method": "polynomials"}
    found = measure_transfer(record, frequencies_hz=[0.2, 0.4, 2.5], **words)
    assert np.isnan(found.transfer.values).tolist() == [[[[False, False, True]]]] * 3
    assert np.isnan(found.transfer.std).tolist() == [[[[False, False, True]]]] * 3
    assert squares(found, system, phases).mean() < 2.0
