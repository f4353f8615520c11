"""A model that leaves many times the noise: exit code 1, no deviation in what is printed, and the files are there."""

import json
import re

import numpy as np
import pytest
from tests.cli.conftest import save_npz
from tests.cli.test_commands import PERIOD, strict_json, typed

from floquid.systems import JeffcottRotor

WORDS = f"identify good.npz --period {PERIOD} --order 2"
FILES = {"result.h5", "summary.json", "settings.toml", "report.html"}
RECORD = JeffcottRotor().simulate(n_periods=100, samples_per_period=16, noise=1e-3, seed=1)


@pytest.fixture
def quiet(here):
    """A record with hardly any noise."""
    save_npz(here / "good.npz", np.array(RECORD.values), sample_rate=RECORD.sample_rate)
    return here


def test_a_model_that_fails(quiet):
    text = typed(f"{WORDS} --out new", code=1, message="floquid: The model fails: its residual is 4")
    assert {path.name for path in (quiet / "new").iterdir()} >= FILES
    told = strict_json((quiet / "new" / "summary.json").read_text())
    assert told["failed"] is True
    assert told["warnings"][0].startswith("The model fails: ")
    assert told["validation"]["passed"] is False
    plain = " ".join(text.split())
    assert "Modes of a model that fails: order 2" in plain
    assert "there are no standard deviations, since the model fails" in plain
    assert plain.count("The model fails: ") == 1
    assert "Written to new/" in plain
    assert not re.search(r"\d\(\d+\)|\d ± \d", text)


@pytest.mark.slow
def test_json_stays_whole_and_enforcing_changes_nothing(quiet):
    for more in ("", "--enforce", "--no-validate"):
        told = json.loads(typed(f"{WORDS} --format json {more}", code=1, message="floquid: The model fails: "))
        assert told["failed"] is True
        assert told["modes"][0]["exponent_std"] is None


@pytest.mark.slow
def test_a_bootstrap_of_it_is_refused(quiet):
    typed(f"{WORDS} --out new", code=1, message="The model fails")
    typed("bootstrap new/result.h5 --draws 20", code=1, message="Records drawn from it say nothing")
    typed("report new/result.h5 --out page.html")
