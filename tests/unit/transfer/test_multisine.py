"""Multisines: each line of the response belongs to one line of one input at one harmonic."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from floquid import InputError, multisine


@given(
    turns=st.integers(4, 90),
    phases=st.integers(4, 24),
    inputs=st.integers(1, 3),
    band=st.tuples(st.floats(0.0, 0.3), st.floats(0.35, 0.5)),
    seed=st.integers(0, 1000),
)
def test_no_two_lines_of_the_response_meet(turns, phases, inputs, band, seed):
    low, high = (share * phases for share in band)
    try:
        found = multisine(1.0, float(phases), turns=turns, band=(low, high), inputs=inputs, seed=seed)
    except InputError:
        return  # too few lines for the inputs
    responses = []
    for own in found.lines:
        assert len(own)
        assert (own >= low * turns).all()
        assert (own <= high * turns).all()
        for line in own.tolist():  # a real line is one at -k, too
            responses.append({(sign * line + m * turns) % (phases * turns) for sign in (1, -1) for m in range(phases)})
            assert len(responses[-1]) == 2 * phases
    assert len(set().union(*responses)) == sum(map(len, responses))
    assert not any(spare in own for own in responses for spare in found.spare.tolist())
    spectrum = np.abs(np.fft.rfft(found.values, axis=1)) / found.values.shape[1]
    for own, lines in zip(spectrum, found.lines, strict=True):
        assert np.array_equal(np.flatnonzero(own > 1e-9), lines)
    assert np.sqrt(np.mean(found.values**2, axis=1)) == pytest.approx(1.0)


def test_as_many_lines_as_there_are_pairs_of_classes():
    assert [len(own) for own in multisine(1.0, 20.0, turns=128, spare=0.0).lines] == [63]
    assert [len(own) for own in multisine(1.0, 20.0, turns=128, inputs=3, spare=0.0).lines] == [21, 21, 21]


@pytest.mark.parametrize("seed", range(5))
def test_lines_are_spread_over_the_band(seed):
    found = multisine(1.0, 20.0, turns=64, inputs=2, seed=seed)
    for own in found.lines:
        assert np.diff([0, *own, 4 * 64]).max() < 3.0 * 4 * 64 / len(own)


def test_it_can_be_played():
    found = multisine(0.5, 40.0, turns=16, rms=3.0)
    record = found.record(3, ["force"])
    assert record.duration == pytest.approx(3 * 16 * 0.5)
    assert record.values.std() == pytest.approx(3.0)
    assert 1.0 < found.peak < 4.0
    assert found.frequencies_hz[0] == pytest.approx(found.lines[0] / 8.0)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"turns": 3}, "turns"),
        ({"inputs": 0}, "inputs"),
        ({"spare": 1.0}, "spare"),
        ({"rms": 0.0}, "rms"),
        ({"band": (3.0, 2.0)}, "band"),
        ({"sample_rate": 20.001}, "sample_rate"),
    ],
)
def test_slips_are_named(words, message):
    with pytest.raises(InputError, match=message):
        multisine(**{"period": 1.0, "sample_rate": 20.0, **words})


def test_a_rate_as_it_is_written_is_that_of_whole_samples():
    found = multisine(6.2831853, 7.9577472, turns=128)
    assert found.values.shape[1] == 6400
    assert found.sample_rate * 128 * found.period == pytest.approx(6400, abs=1e-9)


def test_a_repeat_is_at_least_one():
    with pytest.raises(InputError, match="repeats"):
        multisine(1.0, 20.0).record(0)
