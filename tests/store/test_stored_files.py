"""Result files of every released version are read. Each is kept with the script that wrote it."""

import importlib.util
import json
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest
from tests.contracts.test_copies import assert_same

from floquid.core import Channel
from floquid.errors import InputError
from floquid.lti import Outcome
from floquid.pipeline import Settings
from floquid.store import load, save
from floquid.views import synthesis

FILES = Path(__file__).parent / "files"


@pytest.fixture(scope="module")
def found():
    return load(FILES / "result_v1.h5")


@pytest.fixture(scope="module")
def truth():
    with np.load(FILES / "result_v1.npz", allow_pickle=False) as file:
        return {name: file[name] for name in file.files}


def test_every_kept_file_has_a_script():
    scripts = {path.name for path in FILES.glob("write_*.py")}
    assert {f"write_{path.stem}.py" for path in FILES.glob("*.h5")} == scripts
    assert scripts


def test_version_1_arrays(found, truth):
    read = {
        "values_1": found.records[0].values,
        "values_2": found.records[1].values,
        "sample_rate": found.records[1].sample_rate,
        "noise": found.lifted.noise,
        "multipliers": found.modal.multipliers,
        "residues": found.modal.residues,
        "poles_covariance": found.modal.covariance,
        "residue_spread": found.modal.residue_spread,
        "residue_slope": found.modal.residue_slope,
        "residual_std": found.modal.residual_std,
        "cost": found.modal.stats["cost"],
        "exponents": found.model.exponents,
        "coefficients": found.model.coefficients,
        "coefficient_std": found.model.coefficient_std,
        "covariance": found.model.covariance,
        "harmonics": found.model.harmonics,
        "period": found.model.period,
        "times": found.state.times,
        "transition": found.state.transition,
        "system": found.state.system,
        "condition": found.state.condition,
    }
    assert read.keys() == truth.keys()
    assert [name for name, value in read.items() if not np.array_equal(value, truth[name])] == []


def test_version_1_words(found):
    assert found.settings == Settings(states=("x", "y"), system_times=8, harmonic_false_alarm=1e-8)
    assert found.warnings == ("a warning, with an ümlaut",)
    assert found.model.channels == (
        Channel(name="x", unit="mm", location="disc", direction="X"),
        Channel(name="y", quantity="displacement", unit="µm"),
    )
    assert found.records[1].provenance.sources == ("hit at 75°",)
    assert found.model.provenance.sources == ("hit at 20°", "hit at 75°")
    assert found.model.provenance.steps[0] == "simulated"
    assert found.state.states == ("x", "y", "d/dt x", "d/dt y")
    assert found.state.system_std is None
    assert found.modal.outcome is Outcome.SUCCESS


def test_version_1_records_are_cut_and_lifted_again(found):
    assert [cycles.values.shape for cycles in found.cycles] == [(2, 6, 14), (2, 6, 12)]
    assert found.lifted.responses.lengths.tolist() == [14, 12]
    assert np.array_equal(found.lifted.responses.values[6:, 1, :12], found.cycles[1].values[1])


def test_version_1_can_be_written_again(found, tmp_path):
    """By the version of today, whose file is read in turn."""
    save(found, tmp_path / "again.h5")
    again = load(tmp_path / "again.h5")
    assert np.array_equal(again.model.coefficients, found.model.coefficients)
    assert again.settings == found.settings


@pytest.mark.parametrize("name", ["plain", "sampled", "resampled"])
def test_what_was_fitted_in_version_1(name, tmp_path):
    """Lifted as it is; as sampled beside a forced response; resampled, residues free: each with its records and fit."""
    found = load(FILES / f"result_v1_{name}.h5")
    with np.load(FILES / f"result_v1_{name}.npz", allow_pickle=False) as file:
        truth = {key: file[key] for key in file.files}
    seen = synthesis(found, len(found.model.channels) - 1)
    read = {
        "noise": found.noise,
        "exponents": found.model.exponents,
        "residues": found.modal.residues,
        "lifted": found.lifted.responses.values,
        "times": seen.times,
        "residual": seen.residual,
        "values": found.cycles[0].values if name == "plain" else found.records[0].values,
    }
    if name == "sampled":
        times = found.records[0].times[10:-10]
        read |= {"free": seen.measured, "forced": found.fit.forced.coefficients, "angle": found.shafts[0].angle(times)}
    assert read.keys() == truth.keys() - {"misfit"}
    for key, value in read.items():
        np.testing.assert_allclose(value, truth[key], rtol=1e-9, atol=1e-12, err_msg=key)
    assert found.constrained == (name != "resampled")
    assert found.misfit == (truth["misfit"] if found.constrained else None)
    assert bool(found.fit.findings) == (name == "sampled")
    save(found, tmp_path / "again.h5")
    again = load(tmp_path / "again.h5")
    for key in ("constrained", "misfit", "settings"):
        assert getattr(again, key) == getattr(found, key)
    assert_same(again.shafts, found.shafts, "shafts")
    assert np.array_equal(again.lifted.responses.values, found.lifted.responses.values)
    assert np.array_equal(again.fit.free[0].values, found.fit.free[0].values, equal_nan=True)


def test_an_early_file_without_its_records_is_refused(tmp_path):
    shutil.copy(FILES / "result_v1_sampled.h5", tmp_path / "r.h5")
    with h5py.File(tmp_path / "r.h5", "r+") as file:
        del file["fit/measured"]
    with pytest.raises(InputError, match="an early floquid, which did not keep the record"):
        load(tmp_path / "r.h5")


@pytest.mark.parametrize("name", ["result_v1", "result_v1_plain", "result_v1_sampled", "result_v1_resampled"])
def test_the_scripts_of_version_1_still_run(name, tmp_path):
    """Their numbers may change with the algorithms; that each writes a result that is read must not."""
    spec = importlib.util.spec_from_file_location(name, FILES / f"write_{name}.py")
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    script.main(tmp_path)
    assert load(tmp_path / f"{name}.h5").model.order == 4


def test_sentences_of_version_2_are_findings():
    said = json.loads((FILES / "result_v2.json").read_text(encoding="utf-8"))
    found = load(FILES / "result_v2.h5")
    assert said["synchronisation"]
    assert said["warnings"]
    assert {
        "synchronisation": list(found.synchronisation),
        "warnings": list(found.warnings),
        "validation": list(found.validation.reasons),
        "reasons": list(found.choice.reasons),
        "doubts": list(found.choice.doubts),
        "shaft": list(found.shafts[0].reasons),
    } == said
    assert {own.code for own in found.findings} == {"sentence"}
