"""The adversary in small: its truth is that of its equations, every kind can be run, and its judgement finds fault."""

import json

import numpy as np
import pytest
from benchmarks.adversary.__main__ import main, table
from benchmarks.adversary.driven import setting
from benchmarks.adversary.kinds import KINDS
from benchmarks.adversary.run import judged
from benchmarks.adversary.systems import Clock, drawn
from benchmarks.chain.case import response
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

import floquid


def test_the_modes_are_those_of_the_motion_and_the_motion_that_of_the_equations():
    system = drawn(np.random.default_rng(3))
    modes, times = system.modes(), 2.0 * np.pi / 48 * np.arange(48 * 6)
    free = system.response(times, Clock())
    assert_allclose(
        response(modes.exponents, modes.coefficients, modes.harmonics, times, times),
        free,
        atol=1e-6 * np.abs(free).max(),
    )

    def rates(t, x):
        return system.matrices(np.array([t]), np.zeros(1))[0] @ x

    whole = solve_ivp(
        rates, (0.0, times[-1]), np.append(system.start, 1.0), t_eval=times, method="DOP853", rtol=1e-10, atol=1e-12
    ).y
    assert_allclose(system.seen(whole, times), free, atol=1e-6 * np.abs(free).max())


def test_there_are_980():
    runs = {name: kind.runs for name, kind in KINDS.items()}
    inputs = sum(own for name, own in runs.items() if name.startswith("inputs"))
    alone = sum(own for name, own in runs.items() if name.startswith("alone"))
    assert (inputs, alone, sum(runs.values())) == (150, 80, 980)


def test_coordinates_of_modes_are_those_of_the_response():
    """Of a driven system, with the shapes of its free motion."""
    own = setting(np.random.default_rng(3))
    inputs = own.white(own.directions.shape[2])
    modes = own.system.modes()
    coordinates, _ = own.coordinates(modes, inputs)
    turned = np.exp(1j * np.multiply.outer(modes.harmonics, own.times))
    seen = 2.0 * np.einsum("rn,rcm,mn->cn", coordinates, modes.coefficients, turned).real
    assert_allclose(seen, own.response(inputs), atol=1e-9 * np.abs(seen).max())


ALIKE = ("alone", "alone: gaps", "alone: hum", "alone: orbit", "alone: drift")
"""Kinds that are simulated as others are, seconds each."""


@pytest.mark.parametrize("kind", [pytest.param(k, marks=[pytest.mark.slow] * (k in ALIKE)) for k in KINDS])
def test_every_kind_makes_a_case(kind):
    case = KINDS[kind].make(np.random.default_rng(1))
    assert len(case.exponents) == len(case.must)
    assert all(np.isfinite(record.values).any() for record in case.records)


def test_a_wrong_model_is_called_wrong(monkeypatch, tmp_path):
    assert not judged("plain", 2).wrong
    honest = floquid.identify

    def shifted(records, **options):
        from dataclasses import replace

        found = honest(records, **options)
        return replace(found, model=replace(found.model, exponents=found.model.exponents * 1.001, estimates=None))

    monkeypatch.setattr(floquid, "identify", shifted)
    row = judged("plain", 2)
    assert row.wrong
    assert row.silent
    assert "| 1 | 0 |" in table([row])


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_modes_that_grow_beyond_any_number_do_not_end_in_a_refusal_of_the_record():
    """What a spike leaves at the end grew by 700 nepers, and its coefficients were refused as an argument."""
    row = judged("spikes", 7)
    assert row.outcome == "failed"
    assert row.found == 4


def test_the_command_writes_a_row_a_run(tmp_path, capsys):
    assert main(["--kinds", "plain", "--share", "0.01", "--out", str(tmp_path / "rows.json")]) == 0
    assert "| plain | 2 | 2 |" in capsys.readouterr().out
    assert [row["kind"] for row in json.loads((tmp_path / "rows.json").read_text())] == ["plain", "plain"]
