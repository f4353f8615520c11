"""The benchmark of peers in small, and that it can find fault."""

import json
from dataclasses import replace

import numpy as np
import pytest
from benchmarks.peers import cases, tables
from benchmarks.peers.__main__ import main
from benchmarks.peers.entries import PEERS, Entry, entries
from benchmarks.peers.growth import measured, slope
from benchmarks.peers.measure import judged, pulls

from floquid.lti import fit_residues

CASE = cases.modes(2, 0, outputs=10, samples=120)


def test_it_runs_and_writes_its_tables(tmp_path, capsys):
    """Ours on the paper's record, twice: the second time finds what the first wrote."""
    told = ["--seeds", "2", "--only", "Likelihood (order unknown)", "--out", str(tmp_path)]
    for parts in ("paper", "growth"):
        assert main([*told, "--parts", parts, "--quick"]) == 0
        assert (tmp_path / f"{parts}.txt").read_text(encoding="utf-8") == capsys.readouterr().out
    result = json.loads((tmp_path / "peers.json").read_text(encoding="utf-8"))
    (row,) = result["paper"]
    assert (row["runs"], row["lost"], row["chosen"]) == (2, 0, "nothing")
    assert 0.3 < row["error"] < 2.0
    assert [(g["outputs"], g["cycles"]) for g in result["growth"]] == [(200, 1024), (200, 256)]
    assert all(g["seconds"] > 0 for g in result["growth"])
    assert (tmp_path / "growth.svg").read_text(encoding="utf-8").startswith("<?xml")


def test_unknown_names_are_refused(capsys):
    assert main(["--only", "no such identifier"]) == 2
    assert "MaximumLikelihood (order unknown)" in capsys.readouterr().err


@pytest.mark.parametrize("entry", entries(), ids=lambda e: e.name)
def test_everyone_finds_two_modes(entry):
    """In twenty times less than the paper's noise: settings are for the paper's record, and these are 120 samples."""
    clean = replace(CASE, data=_less_noise(CASE))
    row = judged(entry, [clean])
    assert (row["lost"], row["failures"]) == (0, [])
    assert row["seconds"] > 0


def _less_noise(case):
    """The responses of the best model, and a twentieth of what it leaves."""
    both = np.exp(np.concatenate([case.logs, case.logs.conj()]))
    model = fit_residues(both, case.data)
    powers = model.multipliers[:, None] ** np.arange(case.data.values.shape[2])
    clean = np.einsum("roi,rk->oik", model.residues, powers).real
    return type(case.data)(values=0.95 * clean + 0.05 * case.data.values, dt=1.0, noise=case.data.noise)


def test_every_package_has_its_entries():
    assert {module for module, *_ in PEERS} == {"pydmd", "pymor", "control", "sdypy", "pyoma2"}
    assert len({entry.name for entry in entries()}) == len(entries())


def test_the_bound_of_the_rotor_is_that_of_a_dense_jacobian():
    """Every output by itself, slopes beside the real columns of its residues."""
    logs, std = cases._rotor_truth()
    clean = cases.lift(cases.segment(cases.ROTOR.simulate(noise=0.0))).responses.values[:, 0]
    k = np.arange(clean.shape[1])
    powers = np.exp(np.multiply.outer(k, logs))
    columns = np.concatenate([powers.real, powers.imag], axis=1)
    information = np.zeros((4, 4))
    for output, samples in enumerate(clean):
        parts = np.linalg.lstsq(columns, samples, rcond=None)[0]
        slopes = k[:, None] * powers * (parts[:2] - 1j * parts[2:])
        jacobian = np.concatenate([slopes.real, -slopes.imag], axis=1)
        jacobian = jacobian - columns @ np.linalg.lstsq(columns, jacobian, rcond=None)[0]
        channel = clean[output // 50 * 50 : output // 50 * 50 + 50]
        information += jacobian.T @ jacobian / (cases.NOISE * np.abs(channel).max()) ** 2
    assert np.allclose(np.sqrt(np.diag(np.linalg.inv(information))), std.ravel(), rtol=1e-6)


def entry_that_gives(found):
    return Entry("known", "everything", lambda data, order: found)


def test_the_true_poles_cost_nothing_and_spare_ones_are_not_looked_at():
    truth = np.exp(CASE.logs)
    row = judged(entry_that_gives(np.concatenate([truth, truth.conj(), [0.1, np.nan, 0.0]])), [CASE])
    assert (row["lost"], row["failures"]) == (0, [])
    assert row["error"] < 1e-6


@pytest.mark.parametrize(("off", "lost"), [(9.0, 0), (11.0, 1)])
def test_eleven_bounds_off_is_lost_and_nine_is_not(off, lost):
    moved = np.exp(CASE.logs + np.array([off * CASE.std[0, 0], 0.0]))
    row = judged(entry_that_gives(moved), [CASE])
    assert row["lost"] == lost
    assert row["error"] == (None if lost else pytest.approx(off / 2.0))


def test_a_pole_missing_and_an_exception_are_lost_runs():
    assert pulls(np.exp(CASE.logs[:1]), CASE) is None

    def fails(data, order):
        raise ZeroDivisionError("as written")

    row = judged(Entry("broken", "nothing", fails), [CASE])
    assert (row["lost"], row["failures"], row["seconds"]) == (1, ["ZeroDivisionError: as written"], None)
    assert "1 of 1" in tables.paper([row])


def test_turning_once_round_is_no_error():
    assert np.abs(pulls(np.exp(CASE.logs + 2j * np.pi), CASE)).max() < 1e-6


def test_slopes_are_exponents():
    assert slope([10, 100, 1000], [1.0, 100.0, 10_000.0]) == pytest.approx(2.0)


def test_memory_beyond_the_data_is_seen(monkeypatch):
    def hungry(data, order):
        return np.full(8_000_000, data.values.sum())

    monkeypatch.setattr("benchmarks.peers.growth.entries", lambda: [replace(entry_that_gives(None), run=hungry)])
    row = measured("known", 20, 64)
    assert row["data_bytes"] == 8 * 20 * 64
    assert row["peak_bytes"] > 60e6
