"""The benchmark in small: its edges are edges, and its judgement finds fault."""

import json
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.edge import __main__ as edge
from benchmarks.edge.systems import FAMILIES
from scipy import integrate

from floquid import floquet

MATHIEU, COLUMN = FAMILIES[0], FAMILIES[-1]


@pytest.mark.parametrize("family", [MATHIEU, COLUMN], ids=lambda own: own.name)
def test_multipliers_are_real_on_one_side_of_an_edge_alone(family):
    counts = [family.locked(family.edge() * (1.0 + step)) for step in (-1e-3, 1e-3)]
    assert abs(counts[0] - counts[1]) == 2


def test_the_response_is_one_of_the_system():
    matrix, _ = MATHIEU.system(0.01)
    ends = MATHIEU.response(0.01, np.array([1.0, 0.0]))[0, :: MATHIEU.phases]
    monodromy = floquet.monodromy(matrix)
    recurrence = ends[2:] - np.trace(monodromy) * ends[1:-1] + np.linalg.det(monodromy) * ends[:-2]
    assert np.abs(recurrence).max() < 1e-9 * np.abs(ends).max()


def test_a_force_is_held_between_the_samples():
    """By superposition with a state: what a force of one sample leaves decays as a free response."""
    force = np.zeros(MATHIEU.phases * MATHIEU.cycles)
    force[MATHIEU.phases - 1] = 3.0
    ends = MATHIEU.forced(0.01, np.zeros(2), force)[0, MATHIEU.phases :]
    matrix, _ = MATHIEU.system(0.01)
    step = matrix.period / MATHIEU.phases
    exact = integrate.solve_ivp(
        lambda t, x: matrix(t) @ x + [0.0, 3.0], (-step, 0.0), np.zeros(2), rtol=1e-10, atol=1e-12
    )
    assert np.abs(ends - MATHIEU.response(0.01, exact.y[:, -1])[0, : len(ends)]).max() < 1e-8


def test_the_command_writes_a_row_a_draw_and_finds_fault_with_exponents_that_are_off(monkeypatch, tmp_path):
    monkeypatch.setattr(edge, "STEPS", (0.03,))
    assert edge.main(["--draws", "1", "--only", "rotor_low", "--out", str(tmp_path / "rows.json")]) == 0
    rows = json.loads((tmp_path / "rows.json").read_text())
    assert [row["step"] for row in rows] == [-0.03, 0.03]
    honest = edge.floquid.identify

    def shifted(*arguments, **options):
        found = honest(*arguments, **options)
        off = found.model.exponents + 9.0 * found.model.exponent_std.real
        return replace(found, model=replace(found.model, exponents=off, estimates=None))

    monkeypatch.setattr(edge.floquid, "identify", shifted)
    row = edge.judged(COLUMN, -0.03, 0)
    assert max(row.pulls) > edge.FAR
    assert row.wrong


def test_a_response_to_a_measured_force_is_judged_alike():
    row = edge.judged(MATHIEU, 0.001, 0, "inputs")
    assert row.outcome == "passed"
    assert row.order == 2
    assert max(row.pulls) < edge.FAR
