"""`--enforce`: exit code 3 and the reasons where the model does not pass its checks; the result is written anyway."""

import json

import numpy as np
import pytest
from tests.cli.conftest import save_npz, simulated
from tests.cli.test_commands import GOOD, strict_json, typed

TITLE = "Verdict fails, for "


@pytest.fixture
def forced(here):
    """A record with a forced response, three times a revolution, in one channel."""
    values = simulated().values.copy()
    times = np.arange(values.shape[1]) / simulated().sample_rate
    values[1] += 0.04 * np.abs(values[1]).max() * np.cos(3.0 * times)
    save_npz(here / "good.npz", values)
    return here


def test_a_model_that_passes(here):
    text = typed(f"{GOOD} --enforce --out new")
    assert "Verdict passes: " in text
    assert TITLE not in text
    told = strict_json((here / "new" / "summary.json").read_text())
    assert (told["failed"], told["validation"]["passed"]) == (False, True)
    assert "validate = true" in (here / "new" / "settings.toml").read_text()


def test_a_model_that_does_not_pass(forced):
    words = f"{GOOD} --forced none --order 4 --out new"
    text = typed(words)
    assert TITLE in text
    assert "3 per revolution in Y" in " ".join(text.split())
    again = typed(f"{words} --enforce", code=3, message="floquid: The model does not pass its checks.\n  ")
    assert again == text
    told = strict_json((forced / "new" / "summary.json").read_text())["validation"]
    assert told["passed"] is False
    assert (forced / "new" / "result.h5").exists()


def test_the_reasons_are_on_stderr_and_json_stays_whole(forced):
    words = f"{GOOD} --forced none --order 4 --format json --enforce"
    told = json.loads(typed(words, code=3, message="3 per revolution in Y"))["validation"]
    assert told["passed"] is False
    assert told["metrics"]["tone"] > told["criteria"]["tone"]["at_most"]


def test_checks_may_be_left_out_but_not_enforced_then(here):
    text = typed(f"{GOOD} --no-validate --out new")
    assert "alidation" not in text
    assert strict_json((here / "new" / "summary.json").read_text())["validation"] is None
    typed(f"{GOOD} --no-validate --enforce", code=2, message="`--enforce` must come with the checks")
    typed("identify good.npz --settings new/settings.toml --enforce", code=2, message="they are switched off")
    typed("identify good.npz --settings new/settings.toml --validate --enforce")
