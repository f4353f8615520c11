"""The benchmark in small: truth by integration, hits that were refused are found, the judge finds fault."""

from pathlib import Path

import numpy as np
import pytest
from benchmarks.short.__main__ import main
from benchmarks.short.run import FAR, Row, judged, pulls_of
from benchmarks.short.systems import flapping
from numpy.testing import assert_allclose

import floquid

FILES = Path(__file__).parents[2] / ".." / "shared" / "cases"


def test_the_truth_is_that_of_the_literature_of_one_blade():
    truth = flapping(8.0, 1, hits=1, revolutions=4).exponents
    assert_allclose(truth, [-0.5 + 0.15208j, -0.5 - 0.15208j], atol=1e-5)


@pytest.mark.slow
def test_six_exponents_of_three_blades_are_found():
    row = judged(flapping(6.0, 3, hits=24, revolutions=8), 0)
    assert (row.found, row.must, row.false) == (6, 6, 0)


def test_a_wrong_exponent_is_far_off():
    truth = np.array([-0.5 + 0.15j, -0.5 - 0.15j])
    std = np.full(2, 0.01 + 0.01j)
    right, _ = pulls_of(truth + 0.01 + 1j, std, truth, 2.0 * np.pi)
    wrong, _ = pulls_of(truth + 0.05, std, truth, 2.0 * np.pi)
    assert right.max() < FAR < wrong.min()


@pytest.mark.slow
def test_a_blade_of_four_revolutions_is_found(capsys):
    assert main(["--runs", "2", "--only", "1 blade, Lock number 8"]) == 0
    assert "| 1 blade, Lock number 8 | 12 | 4 | 4/4 | 0 | 0 |" in capsys.readouterr().out


def test_the_command_says_what_was_found(monkeypatch, capsys):
    rows = [
        Row(0, 2, 2, 0, np.array([1.0, 3.0]), 0.1, True, 1.0),
        Row(1, 1, 2, 1, np.array([2.0, 9.0]), 0.3, False, 3.0),
    ]
    monkeypatch.setattr("benchmarks.short.__main__.judged", lambda case, seed: rows[seed])
    assert main(["--runs", "2", "--only", "1 blade, Lock number 8"]) == 0
    assert "| 1 blade, Lock number 8 | 12 | 4 | 3/4 | 1 | 0 | 9.0 | 4.87 | 0.2 | 1/2 | 2.0 |" in capsys.readouterr().out


@pytest.mark.skipif(not FILES.is_dir(), reason="the files handed to developers are not here")
def test_the_hits_that_were_taken_for_noise():
    records = [floquid.read(FILES / f"flap_g8_hit{hit}.npz", period=2.0 * np.pi) for hit in (1, 2)]
    model = floquid.identify(records, validate=False).model
    principal = np.abs(model.exponents.imag - np.rint(model.exponents.imag))
    assert_allclose(model.exponents.real, -0.5, atol=3e-4)
    assert_allclose(principal, 0.15208, atol=3e-4)
