"""Universal files at the command line: the paper's rotor, and a rate that six digits of a step would spoil."""

import numpy as np
import pytest
import pyuff
from tests.cli.test_commands import PERIOD, rows_of_modes, strict_json, typed

from floquid.readers import write
from floquid.systems import JeffcottRotor


@pytest.fixture(scope="module")
def rotor():
    """The rotor of the paper with 2 % noise: 128 periods of 50 samples, 4 channels."""
    return JeffcottRotor().simulate(n_periods=128, noise=0.02, seed=0)


@pytest.fixture
def at_51200(rotor, here, capsys):
    """The same as a data logger at 51.2 kHz exports it: text, six digits of the step, no period; in `run.unv`."""
    for node, row in enumerate(rotor.values, start=1):
        dataset = pyuff.prepare_58(
            func_type=1, rsp_node=node, rsp_dir=1, ref_node=0, ref_dir=0, data=row.copy(), binary=0,
            x=np.arange(len(row)) / 51200, abscissa_spacing=1, abscissa_spec_data_type=17, ordinate_spec_data_type=8,
            orddenom_spec_data_type=0,
        )  # fmt: skip
        pyuff.UFF("run.unv").write_sets(dataset, "add")
    capsys.readouterr()
    assert b"  1.95312e-05" in (here / "run.unv").read_bytes() or b"  1.95313e-05" in (here / "run.unv").read_bytes()
    return here / "run.unv"


def test_the_rotor_of_the_paper(rotor, here):
    write(rotor, "run.uff")
    text = typed(["identify", "run.uff", "--period", PERIOD])
    assert "Modes: order 4" in text
    assert [row[0] for row in rows_of_modes(text)] == ["1", "2"]
    assert "universal file (.uff)" in text


@pytest.mark.slow
def test_convert_to_a_universal_file_changes_nothing(rotor, here):
    write(rotor, "run.uff")
    write(rotor, "run.npz")
    one, other = (
        strict_json(typed(["identify", name, "--period", PERIOD, "--format", "json"]))
        for name in ("run.uff", "run.npz")
    )
    assert one["modes"] == other["modes"]


@pytest.mark.slow
def test_six_digits_of_the_step_are_seen_through(at_51200):
    assert "51200 Hz" in typed("info run.unv")
    period = repr(50 / 51200)
    summary = strict_json(typed(["identify", "run.unv", "--period", period, "--format", "json"]))
    assert summary["order"] == 4
    assert summary["n_phases"] == 50
    text = typed(["identify", "run.unv", "--period", period])
    assert "Sampling rate 51200 Hz: nominal" in " ".join(text.split())
    # As printed, the step is another, and the phase would slip along the record: so it is fitted as it was sampled.
    printed = 1 / pyuff.UFF("run.unv").read_sets(0, header_only=True)["abscissa_inc"]
    assert printed != 51200.0
    text = typed(["identify", "run.unv", "--period", period, "--rate", repr(printed)])
    assert "Fitted at the original sampling times: a period is no whole number of samples." in " ".join(text.split())


def test_a_rate_typed_is_the_one_used(at_51200):
    text = typed(["identify", "run.unv", "--period", repr(50 / 50000), "--rate", "50000"])
    assert "Sampling rate 50000 Hz: as given; the file states 51200 Hz." in " ".join(text.split())


def test_a_cut_file_ends_in_one_message(at_51200):
    data = at_51200.read_bytes()
    at_51200.write_bytes(data[: len(data) * 2 // 5])
    for words in (["info", "run.unv"], ["identify", "run.unv", "--period", "1e-3"]):
        assert typed(words, 2, "it is cut short") == ""
