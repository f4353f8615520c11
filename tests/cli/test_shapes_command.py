"""`floquid shapes`: the table, all of it for a program, and what cannot be read, in the words of the command."""

import json
from dataclasses import replace

import numpy as np
import pytest

import floquid as fq
from floquid.cli import run
from floquid.findings import Severity, note


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """A saved result of a short record, of two channels."""
    place = tmp_path_factory.mktemp("shapes") / "result.h5"
    record = fq.systems.JeffcottRotor().simulate(n_periods=40, noise=0.01, seed=1).select(["X", "Y"])
    fq.save(fq.identify(record, order=4, validate=False), place)
    return str(place)


def test_the_table_and_all_of_it(result, capsys):
    assert run(["shapes", result, "--pairs", "X:Y", "--participation", "X"]) == 0
    words = capsys.readouterr().out
    assert "planar" in words
    assert "lines of X" in words
    assert run(["shapes", result, "--pairs", "X:Y", "--blades", "flap=X,Y", "--format", "json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["format"] == "floquid-shapes/1"
    assert found["point"]["speed_rpm"] == pytest.approx(60.0 / found["period"])
    one = found["modes"][0]
    assert abs(one["whirl"]["index"]) < 0.2
    assert one["whirl"]["std"] > 0.0
    assert np.shape(one["blades"]["tables"]["flap"]["values"]) == (2, len(found["harmonics"]), 2)


def test_results_whose_modes_have_no_names(result):
    """One that fails, and one whose period is half a revolution, which is refused."""
    found = fq.load(result)
    blades = {"flap": ["X", "Y"]}
    assert fq.read_shapes(found, blades=blades).modes[0].name
    failed = fq.read_shapes(
        replace(found, findings=(replace(note("speed_constant", hz=2.5), severity=Severity.FAILURE),)), blades=blades
    )
    assert [one.name for one in failed.modes] == [None, None]
    assert "fails" in failed.warnings[0]
    half = replace(found, settings=replace(found.settings, periods_per_revolution=2.0))
    with pytest.raises(fq.InputError, match="periods_per_revolution"):
        fq.read_shapes(half, blades=blades)
    assert fq.read_shapes(half, pairs=["X:Y"]).modes[0].name is None


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--pairs", "X:Z"], "--pairs"),
        (["--blades", "flap=X"], "`--blades` must name two blades"),
        (["--blades", "X,Y", "--scale", "X=wide"], "`--scale` must be NAME=NUMBER"),
        (["--blades", "X,Y", "--scale", "X=1/60"], "`--scale` must be of groups"),
        ([], "`--pairs` must be given, or blades"),
    ],
)
def test_what_cannot_be_read_is_said_in_options(result, options, words, capsys):
    assert run(["shapes", result, *options]) == 2
    assert words in capsys.readouterr().err
