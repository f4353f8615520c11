"""Names of a rate and of a step, and what a number so called states."""

import pytest

from floquid.tables import rate_stated, says_rate


@pytest.mark.parametrize(
    ("name", "value", "rate"),
    [
        ("fs", 50.0, 50.0), ("Fs", 50.0, 50.0), ("SampleRate", 50.0, 50.0), ("sample_rate", 50.0, 50.0),
        ("Time_Sample_Rate", 50.0, 50.0), ("Sampling rate [kHz]", 51.2, 51200.0), ("Sampling frequency:", 8.0, 8.0),
        ("fs_Hz", 50.0, 50.0), ("dt", 0.02, 50.0), ("dt_ms", 20.0, 50.0), ("time_step", 0.02, 50.0),
        ("TimeStep", 0.02, 50.0), ("XInc", 1.6e-4, 6250.0), ("wf_increment", 0.02, 50.0), ("Ts", 0.001, 1000.0),
    ],
)  # fmt: skip
def test_a_name_of_a_rate_or_a_step_makes_a_rate(name: str, value: float, rate: float) -> None:
    assert rate_stated(name, value) == rate


@pytest.mark.parametrize("name", ["rate", "step", "f", "T", "time", "fs1", "period", "speed", "rate of flow", "", "µ"])
def test_other_names_make_none(name: str) -> None:
    assert says_rate(name) is None
    assert rate_stated(name, 50.0) is None


def test_a_unit_beside_the_name_counts_and_one_of_another_kind_makes_no_rate() -> None:
    assert rate_stated("dt", 20.0, "ms") == 50.0
    assert rate_stated("fs", 1.6, "kHz") == 1600.0
    assert rate_stated("dt", 20.0, "Hz") is None
    assert rate_stated("fs", 20.0, "N") is None
