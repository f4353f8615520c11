"""Output of OpenFAST at the command line: the azimuth is found by its name, and is the clock."""

import numpy as np
import pytest
from tests.cli.test_commands import rows_of_modes, strict_json, typed
from tests.foreign import save_outb

from floquid.core import Channel, Record
from floquid.systems import JeffcottRotor


@pytest.fixture(scope="module")
def turbine():
    """The rotor of the paper as a simulation would output it: two periods a revolution, and the azimuth."""
    run = JeffcottRotor().simulate(n_periods=128, noise=0.02, seed=0)
    azimuth = (360.0 * np.arange(run.n_samples) / 100 + 30.0) % 360.0
    channels = [*run.channels, Channel(name="Azimuth", unit="deg", quantity="angle")]
    return Record(values=[*run.values, azimuth], sample_rate=80.0, channels=channels)


def as_text(record, path):
    """What OpenFAST itself prints: times to four decimals, numbers to four digits, and no word of floquid's."""
    names = "\t".join(["Time", *(channel.name for channel in record.channels)])
    units = "\t".join(["(s)", *("(deg)" if channel.unit == "deg" else "(m)" for channel in record.channels)])
    rows = [
        f"{t:.4f}\t" + "\t".join(f"{x:.4E}" for x in row) for t, row in zip(record.times, record.values.T, strict=True)
    ]
    path.write_text(
        "\n".join(["", "Predictions were generated on 22-Nov-2026", "", "", "A test", "", names, units, *rows]) + "\n"
    )


@pytest.mark.first(1)
@pytest.mark.parametrize("name", ["run.outb", "run.out"])
def test_from_info_to_modes(turbine, name, here):
    if name == "run.out":
        as_text(turbine, here / name)
    else:
        save_outb(turbine, here / name)
    text = " ".join(typed(["info", name]).split())
    assert "Azimuth angle deg" in text
    assert "jumps back by a turn of 360 deg" in text
    assert "Use --azimuth Azimuth." in text
    assert text.endswith(f"Next: floquid identify {name} --azimuth Azimuth")
    typed(["identify", name], 2, "This file seems to have one: --azimuth Azimuth\n")
    command = ["identify", name, "--azimuth", "Azimuth", "--periods-per-rev", "2", "--no-validate", "--no-constrained"]
    assert [row[0] for row in rows_of_modes(typed(command))] == ["1", "2"]
    summary = strict_json(typed([*command, "--format", "json"]))
    assert summary["order"] == 4
    assert summary["period"] == pytest.approx(50 / 80.0, rel=1e-6)


def test_info_of_a_tachometer_ends_with_its_option(here):
    typed("simulate jeffcott --as-measured --periods 20 --out run.parquet")
    text = typed("info run.parquet")
    assert text.endswith("Next: floquid identify run.parquet --tach tach\n")


NO_PERIOD = (
    " --estimate-period\n  This file does not state the period; --estimate-period finds it from a free response."
)


def test_info_of_a_record_without_a_clock_makes_no_period_up(here):
    text = typed("info good.npz")
    assert f"Next: floquid identify good.npz{NO_PERIOD}" in text
    assert "give the period and --excitation ambient." in " ".join(text.split())
    text = typed("info good.npz --channels X --rate 5")
    assert "1 channel, 320 samples, 5 Hz" in text
    assert f"Next: floquid identify good.npz --channels X --rate 5{NO_PERIOD}" in text


def test_info_proposes_no_voltage_as_a_response(here):
    rows = "\n".join(f"{k},{k % 3},{k % 5},{k % 7},{k % 11},{k % 4}" for k in range(20))
    (here / "run.csv").write_text(f"time [s],x [mm],drive [V],hammer [V],motor [Nm],acc [V]\n{rows}\n")
    text = typed("info run.csv")
    assert "floquid identify run.csv --channels x,acc --inputs hammer --period S" in text
    (here / "run.csv").write_text(f"time [s],x [mm],drive [V],knock [V],motor [Nm],acc [V]\n{rows}\n")
    assert f"floquid identify run.csv --channels x,acc{NO_PERIOD}" in typed("info run.csv")
    (here / "raw.csv").write_text(f"time [s],a [V],b [V],c [V],d [V],e [V]\n{rows}\n")
    assert f"floquid identify raw.csv{NO_PERIOD}" in typed("info raw.csv")


def test_info_of_a_table_without_a_rate(here):
    (here / "run.csv").write_text("x [m],rpm [rpm]\n1,2\n2,1\n")
    assert typed("info run.csv").endswith("Next, with the sampling rate [Hz]: floquid info run.csv --rate HZ\n")
    text = typed("info run.csv --rate 10")
    assert "Possible clock: rpm" in text
    assert "--tach rpm" not in text
    assert f"Next: floquid identify run.csv --rate 10{NO_PERIOD}" in text
