"""G from chirps with its curvature penalised, against steady responses of the equations."""

from __future__ import annotations

import numpy as np
import pytest
from tests.driven import mathieu, two_masses

from floquid import Channel, IdentificationError, InputError, Record, measure_transfer
from floquid.inputs import samples_of
from floquid.transfer import by_chirps

BAND = 0.02, 0.2
"""Over the sampling rate."""

QUARTERS = 0.0, 0.25, 0.5, 0.75
"""Of a period, at which chirps begin."""


def chirped(system, phases, periods, shares, *, noise=0.0, steady=0.0, sources=1):
    """Samples of chirps from rest for each input, begun at shares of the period, and room for what rings to die."""
    count, step = periods * phases, system.period / phases
    time = np.arange(count // 2)
    once = np.sin(2.0 * np.pi * (BAND[0] * time + 0.5 * (BAND[1] - BAND[0]) * time**2 / len(time)))
    generator, values, inputs = np.random.default_rng(0), [], []
    for source in range(sources):
        for share in shares:
            begin = round(share * phases)
            own = np.zeros((sources, count))
            own[source, begin : begin + len(time)] = 10.0**source * once
            answer = system.response(own, phases)
            own_line = steady * np.cos(2.0 * np.pi * np.arange(count) / phases)
            values.append(answer + noise * answer.std() * generator.standard_normal(answer.shape) + own_line)
            inputs.append(own)
    # The second record begins half a period later: what is its first half period is its last.
    starts, late = np.zeros(len(values)), phases // 2
    starts[1] = late * step
    values[1], inputs[1] = (np.roll(own[1], -late, axis=1) for own in (values, inputs))
    return samples_of(values, inputs, starts.tolist(), step=step, fundamental=2.0 * np.pi / system.period)


def measured(samples, most=1, **words):
    """G at harmonics up to so many, in the middle of the band of the chirps."""
    channels = tuple(
        tuple(Channel(name=f"{letter}{number}") for number in range(len(own)))
        for letter, own in (("y", samples.values), ("u", samples.inputs))
    )
    rate = 1.0 / samples.step
    hertz = np.linspace(1.2 * BAND[0] * rate, 0.9 * BAND[1] * rate, 60)
    return by_chirps(samples, np.arange(-most, most + 1), channels, hertz, **words)


def off(found, system, phases):
    """The largest error over the largest value."""
    own = found.transfer
    truth = system.sampled_transfer(own.frequencies_hz, own.harmonics, phases)
    return np.abs(own.values - truth).max() / np.abs(truth).max()


def test_it_is_that_of_the_equations():
    system = mathieu(damping=0.2)
    found = measured(chirped(system, 16, 120, np.arange(8) / 8), most=3, curvature=1e-6)
    assert off(found, system, 16) < 1e-9
    assert found.method == "chirps"
    assert found.transfer.std is None


def test_what_repeats_with_the_period_is_no_answer():
    system = mathieu(damping=0.2)
    clean, turning = (chirped(system, 16, 120, QUARTERS, steady=own) for own in (0.0, 100.0))
    found, same = measured(clean), measured(turning)
    assert same.transfer.values == pytest.approx(found.transfer.values, abs=1e-9)


@pytest.mark.slow
def test_two_inputs_of_other_sizes():
    system = two_masses()
    found = measured(chirped(system, 24, 240, np.arange(6) / 6, sources=2), most=2, curvature=1e-3)
    assert found.transfer.values.shape == (5, 2, 2, 60)
    assert off(found, system, 24) < 4e-3


def test_the_weight_trades_noise_for_curvature():
    system = mathieu(damping=0.2)
    samples = chirped(system, 16, 120, QUARTERS, noise=0.5)
    none, right, much = (off(measured(samples, curvature=own), system, 16) for own in (1e-9, 1e3, 1e5))
    assert right < 0.5 * min(none, much)


@pytest.mark.parametrize("shares", [(0.0, 0.5), (0.0, 0.0, 0.0, 0.0), (0.0, 0.5, 0.0, 0.5)])
def test_chirps_that_do_not_part_the_harmonics_are_refused(shares):
    with pytest.raises(IdentificationError, match="do not part 3 transfer functions"):
        measured(chirped(mathieu(damping=0.2), 16, 120, shares))


def records_of(samples):
    """The same as records."""
    both = np.concatenate([samples.values, samples.inputs])
    starts = [float(samples.times[own.start]) for own in samples.records]
    return [
        Record(values=both[:, own], sample_rate=1.0 / samples.step, start=start, channels=["y", "F"])
        for own, start in zip(samples.records, starts, strict=True)
    ]


def test_it_is_a_method_by_name():
    samples = chirped(mathieu(damping=0.2), 16, 120, QUARTERS)
    own = measured(samples, curvature=0.5).transfer
    words = {"period": np.pi, "inputs": ["F"], "harmonics": [-1, 0, 1], "method": "chirps"}
    found = measure_transfer(records_of(samples), frequencies_hz=own.frequencies_hz, curvature=0.5, **words)
    assert found.transfer.values == pytest.approx(own.values, abs=1e-9)
    for slip in ({"curvature": 0.0}, {"reference": ["y"]}):
        with pytest.raises(InputError, match=r"`(curvature|method)` of `measure_transfer` must"):
            measure_transfer(records_of(samples), **words, **slip)
