"""`--point`: the operating point by options, kept by settings and files."""

import numpy as np
import pytest

import floquid as fq
from floquid.cli import run
from floquid.cli.arguments.options import Choices, choices_of
from floquid.cli.arguments.shared import point_given


@pytest.fixture
def record(tmp_path):
    place = tmp_path / "run.npz"
    np.savez(place, values=np.ones((1, 50)), sample_rate=10.0, channels=["x"], temperature=21.5)
    return place


def test_convert_keeps_the_point_and_adds_to_it(record, tmp_path, capsys):
    assert run(["convert", str(record), str(tmp_path / "run.h5"), "--point", "speed_rpm=742", "--point", "wind=8"]) == 0
    assert fq.read(tmp_path / "run.h5").point == {"temperature": 21.5, "speed_rpm": 742.0, "wind": 8.0}
    assert "Not kept" not in capsys.readouterr().out
    assert run(["convert", str(record), str(tmp_path / "run.uff")]) == 0
    assert "Not kept: the operating point." in capsys.readouterr().out
    assert run(["info", str(record)]) == 0
    assert "Operating point: temperature = 21.5." in capsys.readouterr().out


def test_settings_keep_it(tmp_path):
    choices = Choices().with_given(point=point_given(["speed_rpm=742"], "floquid identify"))
    (tmp_path / "settings.toml").write_text(choices.text())
    assert choices_of(tmp_path / "settings.toml").point == {"speed_rpm": 742.0}


@pytest.mark.parametrize("word", ["speed_rpm", "speed_rpm=fast", "=7", "speed_rpm=nan"])
def test_what_is_no_point_is_refused(record, word, tmp_path, capsys):
    assert run(["convert", str(record), str(tmp_path / "run.h5"), "--point", word]) == 2
    assert "--point" in capsys.readouterr().err
