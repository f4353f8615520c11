"""The benchmark of the chain in small: its records are what they say, and its judgement can find fault."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from benchmarks.chain import paper, run, synthetic
from benchmarks.chain.__main__ import chosen, main
from benchmarks.chain.case import Case, response
from benchmarks.chain.records import RECORDS
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

from floquid import IdentificationError


def test_the_paper_s_rotor_is_its_simulation():
    simulated = paper.ROTOR.simulate(n_periods=40, noise=0.0)
    assert_allclose(paper.free_of(paper.steady(50.0, 40)), simulated.values, atol=1e-7)


@pytest.mark.slow
def test_the_turbine_is_what_its_equations_say():
    """Its orbit and its free response, from one integration of both over two turns."""
    modes, (turns, sizes) = synthetic.turbine_modes(), synthetic.gravity_orbit()
    times = np.linspace(0.0, 4.0 * np.pi, 50)
    orbit = 2.0 * (sizes @ np.exp(1j * np.multiply.outer(turns, times))).real
    rates = 2.0 * (sizes * 1j * turns).sum(axis=1).real
    start = np.concatenate([orbit[:, 0], rates]) + synthetic.BLOW
    found = solve_ivp(
        lambda t, x: synthetic.turbine(np.array(t)) @ x + synthetic.weight(t),
        (0.0, times[-1]),
        start,
        t_eval=times,
        method="DOP853",
        rtol=1e-10,
        atol=1e-11,
    ).y[:4]
    free = response(modes.exponents, modes.coefficients, modes.harmonics, times, times)
    assert_allclose(orbit + free, found, atol=1e-6)


def test_the_bound_is_that_of_the_paper_s_record():
    bound = RECORDS["paper_clean"](0.01, 0).bound
    assert_allclose([bound.real, np.abs(bound.imag)], 1.9e-6, rtol=0.04)


@pytest.mark.slow
def test_it_runs_and_writes_its_table(tmp_path, capsys):
    out = tmp_path / "rows.json"
    assert main(["--records", "two_real,period_off_lifted_0.01", "--seeds", "1", "--out", str(out)]) == 0
    assert "| two_real | 1 |" in capsys.readouterr().out
    rows = json.loads(out.read_text(encoding="utf-8"))["rows"]
    assert [row["record"] for row in rows] == ["two_real", "period_off_lifted_0.01"]
    assert [row["linearisations"] > 0 for row in rows] == [True, False]
    assert [row["outcome"] for row in rows] == ["believed", "refused"]


def test_unknown_records_are_refused(capsys):
    assert main(["--records", "no such record"]) == 2
    assert "two_real" in capsys.readouterr().err


def test_names_and_their_beginnings():
    assert chosen("paper_clean") == ["paper_clean"]
    assert chosen("coloured, two_real") == [*(name for name in RECORDS if name.startswith("coloured")), "two_real"]
    assert chosen("") == list(RECORDS)


def judged(monkeypatch, exponents, std=1e-3, *, limit=10.0):
    """The row of a case with exponents -0.1 ± 1i and ω = 4, of which these were found."""
    truth = np.array([-0.1 + 1j, -0.1 - 1j])
    period = 0.5 * np.pi
    case = Case(records=(), period=period, exponents=truth, must=np.ones(2, bool), declared=period)

    def identify(*_, **__):
        if isinstance(exponents, Exception):
            raise exponents
        while exponents is None:
            pass
        found = np.array(exponents)
        deviations = np.full(len(found), std * (1 + 1j))
        return SimpleNamespace(
            model=SimpleNamespace(
                exponents=found, exponent_std=deviations, order=len(found), fundamental=4.0, period=period
            )
        )

    monkeypatch.setattr(run.floquid, "identify", identify)
    return run.judged("a", case, 0, limit)


def test_what_is_right_is_right_modulo_the_fundamental(monkeypatch):
    row = judged(monkeypatch, [-0.1 + 5.002j, -0.1 - 1.002j])
    assert row.right
    assert row.found == 2
    assert max(row.pulls) == pytest.approx(2.0, rel=1e-4)
    assert row.outcome == "believed"


def test_what_is_wrong_is_seen(monkeypatch):
    far = judged(monkeypatch, [-0.1 + 1.005j, -0.1 - 1.005j])
    assert (far.found, far.false, far.right) == (0, 2, False)
    extra = judged(monkeypatch, [-0.1 + 1j, -0.1 - 1j, -0.3 + 1.5j, -0.3 - 1.5j])
    assert (extra.found, extra.false, extra.order) == (2, 2, 4)
    vague = judged(monkeypatch, [-0.1 + 1.1j, -0.1 - 1.1j], std=0.1)
    assert (vague.found, vague.sure, vague.false) == (2, 0, 0)
    lost = judged(monkeypatch, [])
    assert (lost.found, lost.pulls) == (0, (run.LOST, run.LOST))


def test_refusals_defects_and_time(monkeypatch):
    refused = judged(monkeypatch, IdentificationError("no\nand why"))
    assert (refused.outcome, refused.message) == ("refused", "no")
    assert judged(monkeypatch, ValueError("odd")).outcome == "failed"
    assert judged(monkeypatch, None, limit=0.1).outcome == "no answer"


def test_a_function_that_is_not_there_is_not_counted():
    with run.counted("nothing", "floquid.nowhere") as counter:
        pass
    assert counter.calls == 0
