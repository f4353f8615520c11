"""The Matlab user's files at the command line: what is typed, what is printed, and that it is the same system."""

import json

import h5py
import numpy as np
import pytest
import scipy.io
from tests.cli.conftest import simulated
from tests.cli.test_commands import typed

from floquid.systems import JeffcottRotor

PERIOD = "6.283185307179586"
QUICK = "--order 4 --no-validate --no-constrained"


@pytest.fixture
def rows():
    """The record of the example rotor, by what its channels are called."""
    record = simulated()
    return dict(zip([channel.name for channel in record.channels], record.values, strict=True))


def exponents(words):
    modes = json.loads(typed(f"{words} --period {PERIOD} {QUICK} --format json"))["modes"]
    return np.array([mode["exponent"] for mode in modes])


@pytest.mark.slow
def test_the_rotor_of_the_paper_saved_by_matlab(here):
    """`save run.mat values sample_rate channels`, then one command."""
    record = JeffcottRotor().simulate(n_periods=128, noise=0.02, seed=0)
    channels = np.array([channel.name for channel in record.channels], dtype=object)
    content = {"values": record.values, "sample_rate": record.sample_rate, "channels": channels}
    scipy.io.savemat("run.mat", content, do_compression=True)
    text = typed(f"identify run.mat --period {PERIOD}")
    assert "1 record, 4 channels at 7.9577472 Hz" in text
    assert "Read 4 channels of 6400 samples from a MATLAB file (.mat)." in text
    assert "Modes: order 4" in text
    assert "X_tt" in typed("info run.mat")


@pytest.mark.first(1)
@pytest.mark.parametrize("suffix", ["mat", "h5", "hdf5"])
def test_simulated_identified_and_the_same_as_from_an_archive(here, suffix):
    for name in (f"rotor.{suffix}", "rotor.npz"):
        typed(f"simulate --periods 40 --samples-per-period 8 --seed 1 --out {name}")
    assert "4 channels, 320 samples" in typed(f"info rotor.{suffix}")
    np.testing.assert_array_equal(exponents(f"identify rotor.{suffix}"), exponents("identify rotor.npz"))


@pytest.mark.slow
def test_variables_of_a_struct_are_channels(here, rows):
    run = {"acc": {"x": rows["X_tt"], "y": rows["Y_tt"][:, None]}, "note": "calm"}
    scipy.io.savemat("lab.mat", {"run": run, "pos": np.column_stack([rows["X"], rows["Y"]])})
    words = "identify lab.mat --channels pos.T[0],pos.T[1],run.acc.x,run/acc/y --rate 1.2732395447351628"
    found = exponents(words)
    np.testing.assert_allclose(found, exponents("identify good.npz"), rtol=1e-9)
    assert "run.acc.x" in typed(f"{words} --period {PERIOD} --verbose")


def test_datasets_of_an_hdf5_file_are_channels_with_their_times(here, rows):
    with h5py.File("lab.h5", "w") as file:
        for name, row in rows.items():
            file[f"daq/{name}"] = row
        file["daq/time"] = np.arange(320) / simulated().sample_rate
        file["daq/X"].attrs["units"] = "mm"
    found = exponents("identify lab.h5 --channels daq/X,daq/Y,daq/X_tt,daq/Y_tt")
    np.testing.assert_allclose(found, exponents("identify good.npz"), rtol=1e-6)


@pytest.mark.parametrize("suffix", ["mat", "h5"])
def test_info_lists_the_variables_to_choose_from(here, rows, suffix):
    if suffix == "mat":
        scipy.io.savemat(
            "lab.mat", {"run": {"x": rows["X"], "y": rows["Y"]}, "data": np.column_stack([*rows.values()])}
        )
    else:
        with h5py.File("lab.h5", "w") as file:
            file["run/x"], file["run/y"], file["data"] = rows["X"], rows["Y"], np.column_stack([*rows.values()])
    message = "    data: 320 x 4\n    run/x: 1 x 320\n" if suffix == "mat" else "    data: 320 x 4\n    run/x: 320\n"
    typed(f"info lab.{suffix}", code=2, message=message)
    typed(f"info lab.{suffix}", code=2, message="`--channels`, as in data.T[0],data.T[1];")
    typed(f"identify lab.{suffix} --period 1", code=2, message=message)


MISTAKES = [
    ("--channels run/z --rate 1", "`--channels` must name variables of the file by their paths"),
    ("--channels run/x", "`FILE` must say its sampling rate"),
    ("--channels data[0] --rate 1", "write 'data.T'"),
    ("--channels data.T[4] --rate 1", "rows 0 to 3 (counted from 0)"),
    ("--channels data.T[-1] --rate 1", "has 'data.T[-1]', which is not in lab.mat"),
    ("--channels run/x,run.x --rate 1", "`--channels` must name each variable once"),
    ("--channels note --rate 1", "`FILE` must hold real numbers in `note`"),
]


@pytest.mark.parametrize(("words", "message"), MISTAKES)
def test_mistakes_in_paths(here, rows, words, message):
    scipy.io.savemat("lab.mat", {"run": {"x": rows["X"]}, "data": np.column_stack([*rows.values()]), "note": "calm"})
    typed(f"identify lab.mat --period {PERIOD} {words}", code=2, message=message)


def test_values_the_wrong_way_round(here, rows):
    values = np.column_stack([*rows.values()])
    content = {"values": values, "sample_rate": 1.0, "channels": np.array([*rows], dtype=object)}
    scipy.io.savemat("run.mat", content)
    typed(f"identify run.mat --period {PERIOD}", code=2, message="save `values.'`")


def test_names_for_the_columns_of_a_matrix(here, rows):
    data = np.column_stack([rows["X"], rows["Y"]])
    scipy.io.savemat("lab.mat", {"data": data, "labels": np.array(["hip", "knee"], object), "fs": 1.2732395447351628})
    found = []
    for names in ("labels", "hip,knee", "from the settings"):
        words = f"--channels data.T --period {PERIOD} {QUICK} --names {names}"
        if names == "from the settings":
            words = "--settings out/settings.toml"
        typed(f"identify lab.mat {words} --out out")
        found.append(json.loads((here / "out" / "summary.json").read_text()))
    assert "hip" in json.dumps(found[0])
    assert found[0]["modes"] == found[1]["modes"] == found[2]["modes"]
    typed("convert lab.mat lab.csv --channels data.T --names left,right")
    assert "left" in typed("info lab.csv")
    typed("convert lab.mat lab.csv --channels data.T --names a,b,c", 2, "`--names` must be as many as the channels")
