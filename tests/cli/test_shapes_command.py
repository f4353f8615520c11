"""`floquid shapes`: the table, all of it for a program, and what cannot be read, in the words of the command."""

import json

import numpy as np
import pytest

import floquid as fq
from floquid.cli import run


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
