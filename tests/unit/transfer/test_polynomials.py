"""G from polynomials over neighbouring lines of an arbitrary record, against steady responses of the equations."""

from __future__ import annotations

import numpy as np
import pytest
from tests.driven import mathieu, record_of, two_masses
from tests.unit.transfer.test_repeats import squares

from floquid import IdentificationError, Record, measure_transfer


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


def test_two_inputs_and_frequencies_that_are_named():
    system = two_masses()
    found = measured(system, 24, 1500, 0.01, 0, frequencies_hz=[0.1, 0.25])
    assert found.transfer.frequencies_hz == pytest.approx([0.1, 0.25], abs=1e-4)
    assert found.method == "polynomials"
    assert squares(found, system, 24).mean() < 1.6
    assert (found.coherence > 0.9).any()


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
